//! How much of a motion to record, before it is recorded.

use super::{ExcitationError, Trajectory, TrajectorySamples, peaks};
use crate::dynamics::Samples;
use crate::identification::{
    BaseParameters, Forecast, LONGER, ParameterSet, STATES, deviation_of, either_way, equations_of,
    stack, unit_covariance,
};
use crate::robot::Robot;
use sgpr_numeric::internal::Random;

/// Equations of a joint in a second that are as good as independent: what a model leaves of the
/// torque of a real robot remembers for half a second. Median of the joints of five robots
/// (docs/real-data.md), which have 0.4 to 11.
const INDEPENDENT_HZ: f64 = 2.0;

/// What a model leaves of the torque, as a share of a joint's largest torque, where nothing else is
/// known: the median of the same joints (0.2 to 18 %) ...
const LEFT: f64 = 0.024;

/// ... and not less than this share of what it leaves at the joint where that is most: what a robot
/// file says of a joint without load is friction that it does not have.
const LEAST: f64 = 0.1;

/// Samples per second of the motion.
const RATE_HZ: f64 = 50.0;

/// What parameters that are identified from a motion, repeated, add to the torque of other motion
/// of its kind: in which every joint has a position, speed and acceleration of it, each joint at
/// another time, and half of them on the way back.
///
/// - `parameters`: of the set, for the size of the torque
/// - `noise`: standard deviation of what the model will leave of the torque, `[n]`, N·m (N); 2.4 %
///   of each joint's largest torque if `None`
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
    let noise = noise.map_or_else(
        || usual_noise(&peaks(robot, set, parameters, trajectory).torque),
        <[f64]>::to_vec,
    );
    let once = || {
        let factors = equations_of(robot, set, base, motion).ok()?;
        let own_noise: Vec<f64> = factors.iter().map(|factor| noise[factor.joint]).collect();
        let per_row = recorded.len() as f64 / (INDEPENDENT_HZ * trajectory.duration());
        let covariance = faer::Scale(per_row.max(1.0))
            * &unit_covariance(&stack(&factors, base.rank(), &own_noise))?;
        let [q, dq, ddq] = states(&recorded, n);
        let states = equations_of(robot, set, base, Samples { q: &q, dq: &dq, ddq: &ddq }).ok()?;
        Some(deviation_of(&covariance, &states, n))
    };
    let once = once().unwrap_or_else(|| vec![f64::INFINITY; n]);
    Ok(Forecast {
        seconds: LONGER.iter().map(|longer| longer * trajectory.duration()).collect(),
        deviation: LONGER
            .iter()
            .map(|longer| once.iter().map(|one| one / longer.sqrt()).collect())
            .collect(),
        noise,
        advice: vec![],
    })
}

/// A share of each joint's largest torque, N·m (N).
fn usual_noise(sizes: &[f64]) -> Vec<f64> {
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let least = if largest > 0.0 { LEAST * largest } else { 1.0 };
    sizes.iter().map(|size| LEFT * size.max(least)).collect()
}

/// States in which every joint has a position, speed and acceleration of the motion, each joint at
/// another time, and half of them on the way back, `[states, n]` each.
fn states(recorded: &TrajectorySamples, n: usize) -> [Vec<f64>; 3] {
    let mut random = Random::new(0);
    let mut states = [const { vec![] }; 3].map(|_: Vec<f64>| Vec::with_capacity(STATES * n));
    for _ in 0..STATES {
        for joint in 0..n {
            let at = random.below(recorded.len()) * n + joint;
            let values =
                either_way(&mut random, [recorded.q[at], recorded.dq[at], recorded.ddq[at]]);
            states.iter_mut().zip(values).for_each(|(all, value)| all.push(value));
        }
    }
    states
}
