//! Closed-loop output error: the parameters with which the simulated arm under its controller needs
//! the measured torque.
//!
//! The rows of W are those of the simulated motion, which has no noise, so the estimate has no bias
//! from noise in the positions, and needs neither filters nor derivatives. Simulation and least
//! squares alternate until they agree.
//!
//! Source: M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for
//! parameter identification of robot dynamics, IEEE T-CST 21(2) (2013): DIDIM, direct and inverse
//! dynamic identification models.

use super::closed_loop::SimulatedMotion;
use super::estimator::{Estimator, EstimatorNeeds, EstimatorTask};
use super::least_squares::residual_norm;
use super::{
    ClosedLoop, Equations, Estimate, IdentificationError, JointFactor, LeastSquares, Method,
    ParameterSet, Trajectory,
};
use crate::dynamics::Samples;

const MOST_ITERATIONS: usize = 50;

/// Times that a step is halved before it is given up.
const HALVINGS: usize = 8;

/// A step shorter than this, in standard deviations, moves nothing that could be told from noise
/// ...
const SMALL_STEP: f64 = 1e-3;

/// ... and one of this share of the estimates is rounding.
const ROUNDING: f64 = 1e-12;

/// A step that no part of which makes the arm better is left alone below this length, in standard
/// deviations: the least misfit is not where simulation and least squares agree to the last digit.
const SETTLED: f64 = 0.5;

/// Closed-loop output error: the rows are those of the arm simulated under its controller
/// ([`Trajectory::closed_loop`]), again and again with the parameters found (DIDIM).
pub static OUTPUT_ERROR: Estimator = Estimator {
    needs: EstimatorNeeds::Controller,
    ..Estimator::new("output_error", "closed-loop output error", estimate)
};

fn estimate(task: EstimatorTask<'_, '_>, start: Estimate) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { equations, nominal, correlation, .. } = task;
    let least_squares =
        LeastSquares { method: Method::Wls, correlation: correlation.map(<[f64]>::to_vec) };
    let mut best: Option<SearchEnd> = None;
    for run in starts(equations, &start.values, nominal)? {
        let found = search(equations, &least_squares, run, nominal)?;
        let settled = found.step < SETTLED;
        if best.as_ref().is_none_or(|best| settled || found.misfit < best.misfit) {
            best = Some(found);
        }
        if settled {
            break;
        }
    }
    let SearchEnd { mut estimate, step, .. } = best.expect("one start at least");
    if step >= SETTLED {
        estimate.notes.push(format!(
            "simulation and least squares do not agree: least squares on the simulated motion \
             would move the parameters by {step:.1} of their standard deviations, and the \
             simulated torque would fit worse; the motion of a joint that mostly stands depends on \
             its friction more than on its torque"
        ));
    }
    Ok(estimate)
}

/// Where a search ended.
struct SearchEnd {
    estimate: Estimate,
    /// Step that least squares would take from there, in its largest standard deviation.
    step: f64,
    misfit: f64,
}

/// Simulation and least squares in turns, until they agree or no step makes the arm better.
fn search(
    equations: &Equations<'_>,
    least_squares: &LeastSquares,
    mut run: SimulatedArm,
    nominal: &[f64],
) -> Result<SearchEnd, IdentificationError> {
    let mut iteration = 1;
    loop {
        let next = least_squares.solve(&run.factors, equations.base(), nominal)?;
        let next = Estimate { iterations: iteration, ..next };
        let (step, misfit) = (length_of_step(&run.values, &next), run.misfit);
        if step < SMALL_STEP {
            return Ok(SearchEnd { estimate: next, step, misfit });
        }
        match run_toward(equations, &run, &next.values)? {
            Some(better) if iteration < MOST_ITERATIONS => run = better,
            _ => {
                return Ok(SearchEnd {
                    estimate: Estimate { values: run.values, ..next },
                    step,
                    misfit,
                });
            }
        }
        iteration += 1;
    }
}

/// The arm with some parameters under its controllers.
struct SimulatedArm {
    /// Base parameters.
    values: Vec<f64>,
    /// Rows of its motions beside the measured torque.
    factors: Vec<JointFactor>,
    /// How far its torque is from the measured one: minus the logarithm of the likelihood, each
    /// joint with its own noise.
    misfit: f64,
}

impl SimulatedArm {
    fn new(equations: &Equations<'_>, values: Vec<f64>) -> Result<Self, IdentificationError> {
        let (robot, base) = (equations.robot(), equations.base());
        let set = equations.parameter_set().clone().with_sticking_joints();
        let motions = simulate_with(equations, &set, &values)?;
        let trajectories = equations.trajectories().iter().zip(&motions);
        let trajectories = trajectories
            .map(|(trajectory, motion)| Trajectory { samples: motion.samples(), ..*trajectory });
        let factors = Equations::new(robot, &set, base, trajectories.collect()).factors()?;
        let misfit =
            |factor: &JointFactor| factor.rows as f64 * residual_norm(factor, &values).ln();
        Ok(Self { misfit: factors.iter().map(misfit).sum(), factors, values })
    }
}

/// The arms to start from that their controllers hold, the one with the smaller misfit first.
///
/// Least squares on a noisy log can give an arm that no controller holds, the robot file one
/// without any friction.
fn starts(
    equations: &Equations<'_>,
    estimate: &[f64],
    nominal: &[f64],
) -> Result<Vec<SimulatedArm>, IdentificationError> {
    let nominal = SimulatedArm::new(equations, nominal.to_vec());
    let Some(estimate) = held(SimulatedArm::new(equations, estimate.to_vec()))? else {
        return Ok(vec![nominal?]);
    };
    let mut starts: Vec<SimulatedArm> = held(nominal)?.into_iter().chain([estimate]).collect();
    starts.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
    Ok(starts)
}

/// A run that does not diverge.
fn held(
    run: Result<SimulatedArm, IdentificationError>,
) -> Result<Option<SimulatedArm>, IdentificationError> {
    match run {
        Err(IdentificationError::Diverged { .. }) => Ok(None),
        run => run.map(Some),
    }
}

/// The first arm with a smaller misfit on the way from `run` to `values`, halved from the far end.
fn run_toward(
    equations: &Equations<'_>,
    run: &SimulatedArm,
    values: &[f64],
) -> Result<Option<SimulatedArm>, IdentificationError> {
    let mut trial = values.to_vec();
    for _ in 0..=HALVINGS {
        let next = held(SimulatedArm::new(equations, trial.clone()))?;
        if let Some(next) = next.filter(|next| next.misfit < run.misfit) {
            return Ok(Some(next));
        }
        trial.iter_mut().zip(&run.values).for_each(|(value, from)| *value = 0.5 * (*value + from));
    }
    Ok(None)
}

/// Length of the step from `values` to an estimate, in its largest standard deviation; zero where
/// it is rounding.
fn length_of_step(values: &[f64], next: &Estimate) -> f64 {
    let step: Vec<f64> =
        next.values.iter().zip(values).map(|(new, old)| (new - old).abs()).collect();
    let size = next.values.iter().fold(0.0f64, |size, value| size.max(value.abs()));
    if step.iter().copied().fold(0.0, f64::max) < ROUNDING * size {
        return 0.0;
    }
    let in_deviations =
        step.iter().zip(next.standard_deviations()).filter(|(_, deviation)| *deviation > 0.0);
    in_deviations.map(|(step, deviation)| step / deviation).fold(0.0, f64::max)
}

/// The trajectories as the arm with these base parameters runs them.
pub(super) fn simulate(
    equations: &Equations<'_>,
    base: &[f64],
) -> Result<Vec<SimulatedMotion>, IdentificationError> {
    simulate_with(equations, &equations.parameter_set().clone().with_sticking_joints(), base)
}

fn simulate_with(
    equations: &Equations<'_>,
    set: &ParameterSet,
    base: &[f64],
) -> Result<Vec<SimulatedMotion>, IdentificationError> {
    let parameters = all_parameters(equations, base);
    let n = equations.robot().dof();
    let run = |(index, trajectory): (usize, &Trajectory<'_>)| {
        let Samples { q, dq, .. } = trajectory.samples;
        let motion = closed_loop(index, trajectory)?.simulate(
            equations.robot(),
            set,
            &parameters,
            &q[..n],
            &dq[..n],
        );
        motion.ok_or(IdentificationError::Diverged { trajectory: index })
    };
    equations.trajectories().iter().enumerate().map(run).collect()
}

fn closed_loop<'a>(
    index: usize,
    trajectory: &Trajectory<'a>,
) -> Result<&'a ClosedLoop<'a>, IdentificationError> {
    trajectory.closed_loop.ok_or(IdentificationError::NoController { trajectory: index })
}

/// All parameters that these base parameters make of those of the robot.
fn all_parameters(equations: &Equations<'_>, base: &[f64]) -> Vec<f64> {
    let mut standard = equations.robot().standard_parameters();
    standard.resize(equations.parameter_set().len(), 0.0);
    equations.base().expand(base, &standard)
}

#[cfg(test)]
mod tests {
    use super::super::BaseParameters;
    use super::*;
    use crate::robot::{Robot, two_link};

    const RATE_HZ: f64 = 100.0;

    /// A two-link arm with friction, its reference, and what is asked of it.
    struct Case {
        robot: Robot,
        set: ParameterSet,
        base: BaseParameters,
        truth: Vec<f64>,
        reference: [Vec<f64>; 3],
    }

    const KP: [f64; 2] = [400.0, 300.0];
    const KD: [f64; 2] = [40.0, 30.0];

    impl Case {
        fn new() -> Self {
            let robot = two_link();
            let set = ParameterSet::new(&robot, &["viscous_friction", "coulomb_friction"])
                .expect("known effects");
            let base = BaseParameters::new(&robot, &set);
            let mut parameters = robot.standard_parameters();
            parameters.extend([0.5, 0.5, 3.0, 2.0]);
            let truth = base.combine(&parameters);
            let wave = |phase: f64| {
                (0..800).map(|k| 0.5 * (0.01 * k as f64 + phase).sin()).collect::<Vec<_>>()
            };
            Self { robot, set, base, truth, reference: [wave(0.0), wave(1.6), wave(3.1)] }
        }

        fn with<T>(&self, tau: &[f64], then: impl FnOnce(&Equations<'_>) -> T) -> T {
            let [q, dq, ddq] = &self.reference;
            let reference = Samples { q, dq, ddq };
            let closed_loop = ClosedLoop {
                reference,
                feed_forward: None,
                kp: &KP,
                kd: &KD,
                rate_hz: RATE_HZ,
                steps: 40,
            };
            let trajectory =
                Trajectory { closed_loop: Some(&closed_loop), ..Trajectory::new(reference, tau) };
            then(&Equations::new(&self.robot, &self.set, &self.base, vec![trajectory]))
        }

        /// Torque of the arm as it is.
        fn tau(&self) -> Vec<f64> {
            self.with(&[0.0; 800], |equations| {
                simulate(equations, &self.truth).expect("a held arm")[0].tau.clone()
            })
        }
    }

    #[test]
    fn a_step_ends_where_the_arm_is_better_and_a_start_where_it_is_held() {
        let case = Case::new();
        case.with(&case.tau(), |equations| {
            let run = |values: &[f64]| SimulatedArm::new(equations, values.to_vec());
            // An arm of negative inertia runs away.
            let wild: Vec<f64> = case.truth.iter().map(|value| -0.2 * value).collect();
            assert!(matches!(run(&wild), Err(IdentificationError::Diverged { trajectory: 0 })));
            let heavy: Vec<f64> = case.truth.iter().map(|value| 1.5 * value).collect();
            let starts = |estimate: &[f64], nominal: &[f64]| -> Result<Vec<Vec<f64>>, _> {
                Ok(starts(equations, estimate, nominal)?
                    .into_iter()
                    .map(|run| run.values)
                    .collect())
            };
            assert_eq!(starts(&wild, &heavy).expect("one is held"), std::slice::from_ref(&heavy));
            assert_eq!(starts(&heavy, &wild).expect("one is held"), std::slice::from_ref(&heavy));
            assert_eq!(
                starts(&heavy, &case.truth).expect("both are held"),
                [case.truth.clone(), heavy.clone()]
            );
            assert!(matches!(
                starts(&wild, &wild),
                Err(IdentificationError::Diverged { trajectory: 0 })
            ));
            // From the heavy arm toward the wild one lies the truth; from the truth nothing better.
            let heavy = run(&heavy).expect("held");
            let better = run_toward(equations, &heavy, &wild).expect("held").expect("better");
            assert!(better.misfit < heavy.misfit);
            let truth = run(&case.truth).expect("held");
            assert!(run_toward(equations, &truth, &wild).expect("held").is_none());
        });
    }

    #[test]
    fn a_joint_that_sticks_keeps_its_place_and_its_rows_hold() {
        let case = Case::new();
        case.with(&vec![0.0; 800], |equations| {
            let set = case.set.clone().with_sticking_joints();
            let motion = &simulate_with(equations, &set, &case.truth).expect("a held arm")[0];
            let friction = |k: usize| {
                let range = 2 * k..2 * k + 2;
                let (q, dq, ddq) =
                    (&motion.q[range.clone()], &motion.dq[range.clone()], &motion.ddq[range]);
                let mut row = [0.0; 2];
                set.effect_row(1, &crate::effects::JointState { q, dq, ddq }, &mut row);
                row[1]
            };
            let sticks: Vec<usize> = (0..400).filter(|&k| friction(k).abs() < 0.99).collect();
            // The speeds do not chatter: from sample to sample they have one sign but at reversals.
            let turns =
                (1..400).filter(|k| motion.dq[2 * k + 1] * motion.dq[2 * k - 1] < 0.0).count();
            assert!(sticks.len() > 4 && turns < 6, "{sticks:?} {turns}");
            for k in sticks.windows(2).filter(|pair| pair[1] == pair[0] + 1).map(|pair| pair[0]) {
                let travel = (motion.q[2 * k + 3] - motion.q[2 * k + 1]).abs();
                assert!(travel < 1e-4, "{k}: {travel:e}");
            }
            // The rows of the motion give its torque, sticking or not.
            let found = SimulatedArm::new(equations, case.truth.clone()).expect("held");
            let factors = case.with(&motion.tau, |equations| {
                SimulatedArm::new(equations, found.values).expect("held").factors
            });
            for factor in &factors {
                assert!(residual_norm(factor, &case.truth) < 1e-9);
            }
        });
    }
}
