//! Closed-loop output error: the parameters with which the simulated arm under its controller needs the measured torque.
//!
//! The rows of W are those of the simulated motion, which has no noise, so the estimate has no bias from noise in the
//! positions, and needs neither filters nor derivatives. Simulation and least squares alternate until they agree.
//!
//! Source: M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for parameter identification of
//! robot dynamics, IEEE T-CST 21(2) (2013): DIDIM, direct and inverse dynamic identification models.

use super::closed_loop::SimulatedMotion;
use super::{Equations, Estimate, IdentificationError, LeastSquares, Method, Trajectory};

const MOST_ITERATIONS: usize = 50;

/// A step shorter than this, in standard deviations, moves nothing that could be told from noise ...
const SMALL_STEP: f64 = 1e-3;

/// ... and one of this share of the estimates is rounding.
const ROUNDING: f64 = 1e-12;

pub(super) fn estimate(
    equations: &Equations<'_>,
    start: Estimate,
    nominal: &[f64],
    correlation: Option<&[f64]>,
) -> Result<Estimate, IdentificationError> {
    let least_squares = LeastSquares { method: Method::Wls, correlation: correlation.map(<[f64]>::to_vec) };
    let mut best = start;
    for iteration in 1..=MOST_ITERATIONS {
        let simulated = match simulate(equations, &best.values) {
            // Noise can make of the first estimate an arm that no controller holds: the robot file is better than that.
            Err(IdentificationError::Diverged { .. }) if iteration == 1 => simulate(equations, nominal)?,
            result => result?,
        };
        let trajectories = equations.trajectories().iter().zip(&simulated);
        let trajectories =
            trajectories.map(|(trajectory, motion)| Trajectory { samples: motion.samples(), ..*trajectory });
        let model =
            Equations::new(equations.robot(), equations.parameter_set(), equations.base(), trajectories.collect());
        let next = least_squares.solve(&model.factors()?, equations.base(), nominal)?;
        let step = next.values.iter().zip(&best.values).map(|(new, old)| (new - old).abs());
        let deviations = next.standard_deviations();
        let in_deviations = step.clone().zip(&deviations).filter(|(_, deviation)| **deviation > 0.0);
        let in_deviations = in_deviations.map(|(step, deviation)| step / deviation).fold(0.0, f64::max);
        let size = next.values.iter().fold(0.0f64, |size, value| size.max(value.abs()));
        let rounded = step.fold(0.0, f64::max) < ROUNDING * size;
        best = Estimate { iterations: iteration, ..next };
        if in_deviations < SMALL_STEP || rounded {
            return Ok(best);
        }
    }
    best.notes.push(format!("simulation and least squares did not agree after {MOST_ITERATIONS} rounds"));
    Ok(best)
}

/// The trajectories as the arm with these base parameters runs them.
pub(super) fn simulate(equations: &Equations<'_>, base: &[f64]) -> Result<Vec<SimulatedMotion>, IdentificationError> {
    let (robot, set) = (equations.robot(), equations.parameter_set());
    let mut standard = robot.standard_parameters();
    standard.resize(set.len(), 0.0);
    let parameters = equations.base().expand(base, &standard);
    let n = robot.dof();
    let run = |(index, trajectory): (usize, &Trajectory<'_>)| {
        let closed_loop = trajectory.closed_loop.ok_or(IdentificationError::NoController { trajectory: index })?;
        let Trajectory { samples, .. } = trajectory;
        let motion = closed_loop.simulate(robot, set, &parameters, &samples.q[..n], &samples.dq[..n]);
        motion.ok_or(IdentificationError::Diverged { trajectory: index })
    };
    equations.trajectories().iter().enumerate().map(run).collect()
}
