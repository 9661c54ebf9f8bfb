//! How much data is enough: what uncertain parameters bring to the torque of other motion.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::{
    BaseParameters, IdentificationError, JointFactor, Observation, ParameterSet, Trajectory,
};
use crate::dynamics::Samples;
use crate::robot::Robot;
use sgpr_numeric::internal::Random;

/// How surely a model of logs predicts the torque of other motion, and a model of more such logs.
///
/// Made after recording by [`identify`](crate::model::identify), before recording by
/// [`optimise`](crate::excitation::optimise). Other motion is one in which every joint has a
/// position, speed and acceleration that it had in the logs, each joint at another time, and half
/// of them on the way back. What the parameters do not know is their covariance, its part of the
/// data in proportion to the time; torque that the model has no law for is not in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Forecast {
    /// Seconds of logs: those that there are, or one repetition of the motion, then twice, four
    /// times as long and so on.
    pub seconds: Vec<f64>,
    /// Standard deviation that uncertain parameters bring to each joint's torque, root mean square
    /// over such motion, `[seconds][n]`, N·m (N).
    pub deviation: Vec<Vec<f64>>,
    /// Standard deviation of what the model leaves of each joint's torque, `[n]`, N·m (N); zero for
    /// a joint that does not move.
    pub noise: Vec<f64>,
    /// Which motion would free parameters that the logs do not determine, a sentence for each joint
    /// that lacks one.
    pub advice: Vec<String>,
}

/// Parameters are sure enough if they bring a third of the noise: it makes the error larger by a
/// twentieth.
const ENOUGH: f64 = 1.0 / 3.0;

/// Times what there is.
pub(crate) const LONGER: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];

/// States that stand for other motion.
pub(crate) const STATES: usize = 200;

impl Forecast {
    /// Seconds of logs, those that there are among them, after which the parameters of a joint are
    /// sure enough; none if sixteen times the logs are not enough.
    pub fn enough_at(&self, joint: usize) -> Option<f64> {
        let limit = ENOUGH * self.noise[joint];
        let share = |at: usize| self.deviation[at][joint] / limit;
        let first = (0..self.seconds.len()).find(|at| share(*at) <= 1.0)?;
        let Some(before) = first.checked_sub(1) else { return Some(self.seconds[0]) };
        // A power of the time in between.
        let [above, below] = [share(before).ln(), -share(first).ln()];
        let [from, to] = [self.seconds[before], self.seconds[first]];
        Some(from * (to / from).powf(above / (above + below)))
    }

    /// Seconds of further logs of their kind until the parameters of all joints are sure enough,
    /// zero if they are; none if such logs do not help some joint.
    pub fn seconds_to_go(&self) -> Option<f64> {
        let all: Option<Vec<f64>> =
            (0..self.noise.len()).map(|joint| self.enough_at(joint)).collect();
        all.map(|all| all.into_iter().fold(self.seconds[0], f64::max) - self.seconds[0])
    }
}

/// Position, speed and acceleration of a joint as they were, or on the way back.
pub(crate) fn either_way(random: &mut Random, [q, dq, ddq]: [f64; 3]) -> [f64; 3] {
    let direction = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
    [q, direction * dq, ddq]
}

/// Standard deviation that parameters of this covariance bring to each joint's torque, root mean
/// square over states, `[n]`.
pub(crate) fn deviation_of(
    covariance: &Mat<f64>,
    states: &[JointFactor],
    joints: usize,
) -> Vec<f64> {
    let of = |joint: usize| {
        let own = states.iter().filter(|factor| factor.joint == joint);
        let (sum, rows) = own.fold((0.0, 0), |(sum, rows), factor| {
            (sum + variances(covariance, factor), rows + factor.rows)
        });
        (sum / rows.max(1) as f64).sqrt()
    };
    (0..joints).map(of).collect()
}

/// Equations of single states, without torque.
///
/// # Errors
/// If they are too large for numbers.
pub(crate) fn equations_of(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    states: Samples<'_>,
) -> Result<Vec<JointFactor>, IdentificationError> {
    let zeros = vec![0.0; states.q.len()];
    let columns = vec![zeros.clone(); set.trajectory_columns().len()];
    let mut observation = Observation::new(robot, set, base);
    observation.add(&Trajectory { columns: &columns, ..Trajectory::new(states, &zeros) })?;
    Ok(observation.factors())
}

/// Sum over the rows of a factor of the variance that parameters of a covariance bring to them.
pub(crate) fn variances(covariance: &Mat<f64>, factor: &JointFactor) -> f64 {
    let count = factor.columns.len();
    let own = Mat::from_fn(count, count, |i, j| covariance[(factor.columns[i], factor.columns[j])]);
    let rows = factor.factor.as_ref().submatrix(0, 0, count, count);
    (rows * own * rows.transpose()).diagonal().column_vector().sum()
}
