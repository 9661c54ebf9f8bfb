//! An arm that picks something up while it moves.

use super::{
    Controller, Experiment, Reference, SimulationError, SimulationRecord, Simulator, simulate,
};
use crate::progress::Progress;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// What is picked up, by which link, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PickUp {
    /// Time, s: a whole number of record periods after the start, before the end.
    pub time: f64,
    /// Link that holds it from then on.
    pub link: usize,
    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the frame of the link.
    pub parameters: [f64; PARAMETERS_PER_LINK],
}

impl PickUp {
    /// - `time`: s
    /// - `link`: index of the link that holds it
    /// - `parameters`: in the frame of the link
    pub fn new(time: f64, link: usize, parameters: [f64; PARAMETERS_PER_LINK]) -> Self {
        Self { time, link, parameters }
    }

    /// The arm with what it holds.
    ///
    /// # Panics
    /// If the robot has no such link.
    pub fn loaded(&self, robot: &Robot) -> Robot {
        assert!(self.link < robot.dof(), "a link of the robot");
        let mut parameters = robot.standard_parameters();
        let held = parameters[self.link * PARAMETERS_PER_LINK..].iter_mut().zip(&self.parameters);
        held.for_each(|(parameter, more)| *parameter += more);
        robot.clone().with_standard_parameters(&parameters)
    }
}

/// [`simulate`], with bodies that change at the time of the pick-up; what is picked up moves with
/// the link already.
///
/// # Errors
/// As [`simulate`], or if the time is no whole number of record periods within the experiment.
///
/// # Panics
/// If the robot has no such link.
pub fn simulate_pick_up(
    simulator: &mut Simulator,
    controller: &mut dyn Controller,
    reference: &dyn Reference,
    duration: f64,
    experiment: &Experiment,
    pick_up: &PickUp,
    progress: &dyn Progress,
) -> Result<SimulationRecord, SimulationError> {
    let invalid = |value, expected| SimulationError::InvalidOption {
        option: "time of the pick-up",
        value,
        expected,
    };
    let loaded = pick_up.loaded(simulator.robot());
    let periods = pick_up.time / experiment.record_period;
    if !(pick_up.time > 0.0 && pick_up.time < duration) {
        return Err(invalid(pick_up.time, "between the start and the end of the experiment"));
    }
    if (periods - periods.round()).abs() > 1e-6 * periods.max(1.0) {
        return Err(invalid(pick_up.time, "a whole number of record periods"));
    }
    let mut record =
        simulate(simulator, controller, reference, pick_up.time, experiment, progress)?;
    simulator.set_robot(&loaded);
    let after = Experiment { seed: experiment.seed.wrapping_add(1), ..experiment.clone() };
    let rest = duration - pick_up.time;
    record.append(simulate(simulator, controller, reference, rest, &after, progress)?);
    Ok(record)
}
