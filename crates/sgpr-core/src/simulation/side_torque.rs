//! Torques beside rigid body, rotors and friction.

use std::fmt::Debug;

use super::{Drive, SimulationError};
use crate::dynamics::Samples;
use crate::effects::{Dahl, Entry, JointState};
use crate::identification::ParameterSet;
use crate::model::{Term, TorqueModel, Trajectory};

/// A torque that the drives have to overcome beside the rigid body and the friction of the [`Drive`]s: a spring, a
/// ripple, an effect with a memory.
///
/// Treated explicitly: it is asked once per step, in order, and may carry a state of its own from step to step.
pub trait SideTorque: Send + Debug {
    /// Adds the torque in the step from `time` to `time + step` to `tau`, `[n]`, N·m (N), with the sign of
    /// tau = M ddq + ... + side torque.
    ///
    /// - `q`, `dq`: `[n]`, state at `time`
    /// - `ddq`: `[n]`, acceleration in the step before
    fn add(&mut self, time: f64, step: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]);
}

/// Effects of the library that a [`Drive`] does not know, with their parameters.
#[derive(Debug)]
struct Effects {
    set: ParameterSet,
    /// Zero for what the drives do.
    parameters: Vec<f64>,
}

impl SideTorque for Effects {
    fn add(&mut self, _: f64, _: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.set.add_effect_torque(&self.parameters, &JointState { q, dq, ddq }, tau);
    }
}

/// Drives and side torque that together are the effects of `set` with these parameters: viscous and Coulomb friction
/// and rotor inertia are treated as those of a [`Drive`], stiffly; every other effect as a side torque.
///
/// # Panics
/// If `parameters` is not of the length of the set.
pub fn drives_from_parameters(set: &ParameterSet, parameters: &[f64]) -> (Vec<Drive>, Option<Box<dyn SideTorque>>) {
    assert_eq!(parameters.len(), set.len(), "every parameter of the set");
    let mut drives = vec![Drive::default(); set.dof()];
    let mut rest = parameters.to_vec();
    for (index, column) in set.effect_columns().iter().enumerate() {
        let value = &mut rest[set.inertial() + index];
        let drive = &mut drives[column.joint];
        match set.effects()[column.effect].name() {
            "viscous_friction" => drive.viscous_friction = *value,
            "coulomb_friction" => (drive.coulomb_friction, drive.static_friction) = ([*value; 2], [*value; 2]),
            "rotor_inertia" => drive.rotor_inertia = *value,
            _ => continue,
        }
        *value = 0.0;
    }
    let others = rest[set.inertial()..].iter().any(|value| *value != 0.0);
    let side = others.then(|| Box::new(Effects { set: set.clone(), parameters: rest }) as Box<dyn SideTorque>);
    (drives, side)
}

/// Effects of a model at single sites.
#[derive(Debug)]
struct Terms {
    with: TorqueModel,
    without: TorqueModel,
}

impl Terms {
    fn new(model: &TorqueModel, terms: Vec<Term>) -> Self {
        let with = |terms| model.clone().with_terms(terms, Some(0));
        Self { with: with(terms), without: with(vec![]) }
    }

    /// Torque of the terms alone, `[n]`.
    fn torque(&self, time: f64, q: &[f64], dq: &[f64], ddq: &[f64]) -> Vec<f64> {
        let samples = Samples { q, dq, ddq };
        let time = [time];
        let trajectory = Trajectory { samples, rate_hz: f64::NAN, time: &time, channels: &[] };
        let without = self.without.predict(samples);
        self.with.predict_trajectory(&trajectory).iter().zip(without).map(|(with, without)| with - without).collect()
    }

    /// Whether an acceleration of this joint in the step before changes the torque by a large share of what it takes:
    /// the next step would overshoot.
    fn overshoots(&self, joint: usize) -> bool {
        let n = self.with.robot().dof();
        let moving = vec![0.1; n];
        let at = |acceleration: f64| {
            let mut ddq = vec![0.0; n];
            ddq[joint] = acceleration;
            let all = self.without.predict(Samples { q: &moving, dq: &moving, ddq: &ddq });
            (self.torque(0.0, &moving, &moving, &ddq)[joint], all[joint])
        };
        let ((own, all), (own_at_one, all_at_one)) = (at(0.0), at(1.0));
        (own_at_one - own).abs() > LARGEST_SHARE * (all_at_one - all).abs()
    }
}

/// Of the inertia at a joint: what an explicit torque may have of an inertia itself.
const LARGEST_SHARE: f64 = 0.5;

impl SideTorque for Terms {
    fn add(&mut self, time: f64, _: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        tau.iter_mut().zip(self.torque(time, q, dq, ddq)).for_each(|(tau, own)| *tau += own);
    }
}

/// Friction and cables with a Dahl element of the joint's position: joint, torque of the full element, state.
#[derive(Debug)]
struct Dahls(Vec<(usize, f64, Dahl)>);

impl SideTorque for Dahls {
    fn add(&mut self, _: f64, _: f64, q: &[f64], _: &[f64], _: &[f64], tau: &mut [f64]) {
        self.0.iter_mut().for_each(|(joint, size, element)| tau[*joint] += *size * element.next(q[*joint]));
    }
}

/// What acts on an arm beside its rigid body.
pub type DrivesAndSideTorques = (Vec<Drive>, Vec<Box<dyn SideTorque>>);

/// Drives and side torques that together are all effects of a model, those at single sites included. Stribeck friction is
/// treated as that of a [`Drive`]; Dahl elements of a position carry their state. The clock of the session starts with the
/// simulation.
///
/// # Errors
/// If the torque of an effect is none of present motion and time, and no Dahl element: it has another memory, changes robot,
/// motion or torque, or follows the acceleration as an inertia does. For those write a [`SideTorque`].
pub fn drives_from_model(model: &TorqueModel) -> Result<DrivesAndSideTorques, SimulationError> {
    let (mut drives, side) = drives_from_parameters(model.parameter_set(), model.parameters());
    let mut side: Vec<_> = side.into_iter().collect();
    let (mut terms, mut dahls) = (Vec::new(), Vec::new());
    for term in model.terms() {
        let refuse = |reason| Err(SimulationError::Effect { name: term.effect.name().into(), reason });
        if let (Some(joint), Some(distance)) = (term.site.joint(), term.effect.dahl_distance(&term.constants)) {
            dahls.push((joint, term.coefficients[0], Dahl::new(distance)));
            continue;
        }
        match term.effect.entry() {
            Entry::Transform => return refuse("it changes robot, motion or torque"),
            _ if term.effect.has_memory() => return refuse("it has a hidden state"),
            Entry::Gate => return refuse("it is found by checks of a log"),
            _ if term.effect.name() == "temperature_dependent_friction" => return refuse("it needs a temperature"),
            Entry::State | Entry::Trajectory => {}
        }
        if let (Some(joint), "stribeck_friction") = (term.site.joint(), term.effect.name()) {
            let drive = &mut drives[joint];
            if drive.stribeck_velocity == 0.0 && term.coefficients[0] >= 0.0 {
                drive.static_friction = drive.coulomb_friction.map(|size| size + term.coefficients[0]);
                drive.stribeck_velocity = term.constants[0];
                continue;
            }
        }
        let alone = Terms::new(model, vec![term.clone()]);
        if (0..drives.len()).any(|joint| alone.overshoots(joint)) {
            return refuse("it follows the acceleration as an inertia does; give the arm that inertia instead");
        }
        terms.push(term.clone());
    }
    if !dahls.is_empty() {
        side.push(Box::new(Dahls(dahls)));
    }
    if !terms.is_empty() {
        side.push(Box::new(Terms::new(model, terms)));
    }
    Ok((drives, side))
}
