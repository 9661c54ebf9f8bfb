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

/// Times that a step is halved before it is given up.
const HALVINGS: usize = 6;

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
    // Noise can make of an estimate an arm that no controller holds: steps end before it, the first one from the robot file.
    let mut held = nominal.to_vec();
    let mut last_diverged = None;
    for iteration in 1..=MOST_ITERATIONS {
        let Held { values, motions, diverged } = simulate_toward(equations, &held, best.values)?;
        last_diverged = diverged.map(|trajectory| (iteration, trajectory)).or(last_diverged);
        best.values = values;
        held.clone_from(&best.values);
        let trajectories = equations.trajectories().iter().zip(&motions);
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
    // Where steps end early to the last nothing is found.
    if let Some((iteration, trajectory)) = last_diverged
        && 2 * iteration > MOST_ITERATIONS
    {
        return Err(IdentificationError::Diverged { trajectory });
    }
    best.notes.push(format!("simulation and least squares did not agree after {MOST_ITERATIONS} rounds"));
    Ok(best)
}

/// An arm that its controller holds.
struct Held {
    /// Its base parameters.
    values: Vec<f64>,
    motions: Vec<SimulatedMotion>,
    /// The trajectory that diverged with parameters farther away.
    diverged: Option<usize>,
}

/// The farthest arm that its controller holds on the way from `held` to `values`, halved from the far end.
fn simulate_toward(equations: &Equations<'_>, held: &[f64], mut values: Vec<f64>) -> Result<Held, IdentificationError> {
    let mut diverged = None;
    for _ in 0..HALVINGS {
        match simulate(equations, &values) {
            Err(IdentificationError::Diverged { trajectory }) => {
                diverged = Some(trajectory);
                values.iter_mut().zip(held).for_each(|(value, held)| *value = 0.5 * (*value + held));
            }
            result => return Ok(Held { values, motions: result?, diverged }),
        }
    }
    Ok(Held { values: held.to_vec(), motions: simulate(equations, held)?, diverged })
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

#[cfg(test)]
mod tests {
    use super::super::{BaseParameters, ClosedLoop, ParameterSet};
    use super::*;
    use crate::dynamics::Samples;
    use crate::robot::two_link;

    #[test]
    fn steps_end_where_a_controller_still_holds_the_arm() {
        let robot = two_link();
        let set = ParameterSet::new(&robot, &["viscous_friction"]).expect("a known effect");
        let base = BaseParameters::new(&robot, &set);
        let wave = |phase: f64| (0..400).map(|k| 0.5 * (0.02 * k as f64 + phase).sin()).collect::<Vec<_>>();
        let (q, dq, ddq) = (wave(0.0), wave(1.6), wave(3.1));
        let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
        let (kp, kd) = ([400.0, 300.0], [40.0, 30.0]);
        let closed_loop =
            ClosedLoop { reference: samples, feed_forward: None, kp: &kp, kd: &kd, rate_hz: 100.0, steps: 10 };
        let tau = vec![0.0; q.len()];
        let trajectory = Trajectory { closed_loop: Some(&closed_loop), ..Trajectory::new(samples, &tau) };
        let equations = Equations::new(&robot, &set, &base, vec![trajectory]);
        let mut parameters = robot.standard_parameters();
        parameters.resize(set.len(), 0.5);
        let held = base.combine(&parameters);
        // An arm of negative inertia, which runs away.
        let wild: Vec<f64> = held.iter().map(|value| -0.2 * value).collect();
        assert!(matches!(simulate(&equations, &wild), Err(IdentificationError::Diverged { trajectory: 0 })));
        let Held { values, motions, diverged } =
            simulate_toward(&equations, &held, wild.clone()).expect("the held arm");
        assert_eq!((motions.len(), diverged), (1, Some(0)));
        let share = (values[0] - held[0]) / (wild[0] - held[0]);
        assert!(share > 0.0 && share <= 0.5, "{share}");
        let Held { values, diverged, .. } = simulate_toward(&equations, &held, held.clone()).expect("the held arm");
        assert_eq!((values, diverged), (held, None));
    }
}
