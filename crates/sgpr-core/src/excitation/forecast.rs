//! How much of a motion to record, before it is recorded.

use faer::Mat;

use super::{ExcitationError, Trajectory, TrajectorySamples};
use crate::dynamics::{BatchWorkspace, Samples, rnea_batch};
use crate::identification::{
    self as estimation, BaseParameters, Forecast, JointFactor, LONGER, Observation, ParameterSet, STATES, deviation_of,
    stack,
};
use crate::linalg::Svd;
use crate::random::Random;
use crate::robot::Robot;

/// Equations of a joint in a second that are as good as independent: what a model leaves of the torque of a real robot
/// remembers for half a second. Median of the joints of five robots (docs/real-data.md), which have 0.4 to 11.
const INDEPENDENT_HZ: f64 = 2.0;

/// What a model leaves of the torque, as a share of a joint's largest torque, where nothing else is known: the median of the
/// same joints (0.2 to 18 %) ...
const LEFT: f64 = 0.024;

/// ... and not less than this share of what it leaves at the joint where that is most: what a robot file says of a joint
/// without load is friction that it does not have.
const LEAST: f64 = 0.1;

/// Samples per second of the motion.
const RATE_HZ: f64 = 50.0;

/// What parameters that are identified from a motion, repeated, add to the torque of other motion of its kind: in which every
/// joint has a position, speed and acceleration of it, each joint at another time, and half of them on the way back.
///
/// - `parameters`: of the set, for the size of the torque
/// - `noise`: standard deviation of what the model will leave of the torque, `[n]`, N·m (N); 2.4 % of each joint's largest torque if
///   `None`
///
/// # Errors
/// If the noise does not fit the robot.
pub fn forecast(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    trajectory: &Trajectory,
    parameters: &[f64],
    noise: Option<&[f64]>,
) -> Result<Forecast, ExcitationError> {
    super::information::require_noise(robot, noise)?;
    let n = robot.dof();
    let recorded = trajectory.samples(RATE_HZ, trajectory.duration());
    let motion = Samples { q: &recorded.q, dq: &recorded.dq, ddq: &recorded.ddq };
    let noise = noise.map_or_else(|| usual_noise(robot, set, parameters, motion), <[f64]>::to_vec);
    let once = || {
        let factors = equations(robot, set, base, motion)?;
        let own_noise: Vec<f64> = factors.iter().map(|factor| noise[factor.joint]).collect();
        let per_row = recorded.len() as f64 / (INDEPENDENT_HZ * trajectory.duration());
        let covariance = covariance(&stack(&factors, base.rank(), &own_noise), per_row.max(1.0))?;
        let [q, dq, ddq] = states(&recorded, n);
        let states = equations(robot, set, base, Samples { q: &q, dq: &dq, ddq: &ddq })?;
        Some(deviation_of(&covariance, &states, n))
    };
    let once = once().unwrap_or_else(|| vec![f64::INFINITY; n]);
    Ok(Forecast {
        seconds: LONGER.iter().map(|longer| longer * trajectory.duration()).collect(),
        deviation: LONGER.iter().map(|longer| once.iter().map(|one| one / longer.sqrt()).collect()).collect(),
        noise,
        advice: vec![],
    })
}

/// None if they are too large for numbers.
fn equations(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    motion: Samples<'_>,
) -> Option<Vec<JointFactor>> {
    let zeros = vec![0.0; motion.q.len()];
    let mut observation = Observation::new(robot, set, base);
    observation.add(&estimation::Trajectory::new(motion, &zeros)).ok()?;
    Some(observation.factors())
}

/// A share of the largest torque in motion.
fn usual_noise(robot: &Robot, set: &ParameterSet, parameters: &[f64], motion: Samples<'_>) -> Vec<f64> {
    let n = robot.dof();
    let body = robot.clone().with_standard_parameters(&parameters[..set.inertial()]);
    let mut torque = vec![0.0; motion.q.len()];
    rnea_batch(&body, &mut BatchWorkspace::new(&body), motion, &mut torque);
    for (sample, tau) in torque.chunks_exact_mut(n).enumerate() {
        let of = sample * n..(sample + 1) * n;
        let state =
            crate::effects::JointState { q: &motion.q[of.clone()], dq: &motion.dq[of.clone()], ddq: &motion.ddq[of] };
        set.add_effect_torque(parameters, &state, tau);
    }
    let size = |joint: usize| torque.iter().skip(joint).step_by(n).fold(0.0, |most: f64, tau| most.max(tau.abs()));
    let sizes: Vec<f64> = (0..n).map(size).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let least = if largest > 0.0 { LEAST * largest } else { 1.0 };
    sizes.iter().map(|size| LEFT * size.max(least)).collect()
}

/// (WᵀΣ⁻¹W)⁻¹ times a factor; none if the motion does not determine all parameters.
fn covariance(system: &Mat<f64>, factor: f64) -> Option<Mat<f64>> {
    let count = system.ncols() - 1;
    let length = |column: usize| system.col(column).norm_l2();
    let scale: Vec<f64> = (0..count).map(|k| if length(k) > 0.0 { length(k).recip() } else { 0.0 }).collect();
    let scaled = Mat::from_fn(count, count, |i, j| system[(i, j)] * scale[j]);
    let Svd { values, v, .. } = Svd::new(scaled.as_ref());
    if values.last().is_none_or(|least| *least <= 1e-9 * values[0]) {
        return None;
    }
    let entry = |i: usize, j: usize| {
        let sum: f64 = values.iter().enumerate().map(|(k, value)| v[(i, k)] * v[(j, k)] / (value * value)).sum();
        factor * sum * scale[i] * scale[j]
    };
    Some(Mat::from_fn(count, count, entry))
}

/// States in which every joint has a position, speed and acceleration of the motion, each joint at another time, and half of
/// them on the way back, `[states, n]` each.
fn states(recorded: &TrajectorySamples, n: usize) -> [Vec<f64>; 3] {
    let mut random = Random::new(0);
    let mut states = [const { vec![] }; 3].map(|_: Vec<f64>| Vec::with_capacity(STATES * n));
    for _ in 0..STATES {
        for joint in 0..n {
            let at = random.below(recorded.len()) * n + joint;
            let direction = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
            let values = [recorded.q[at], direction * recorded.dq[at], recorded.ddq[at]];
            states.iter_mut().zip(values).for_each(|(all, value)| all.push(value));
        }
    }
    states
}
