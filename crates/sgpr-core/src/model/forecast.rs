//! How much data is enough: what uncertain parameters bring to the torque of other motion, after these logs and after
//! more of their kind.

use faer::Mat;

use super::held::{Held, Task};
use crate::dynamics::Samples;
use crate::identification::{Estimate, IdentificationError, JointFactor, Observation, Row, Trajectory};
use crate::random::Random;

/// How surely a model of these logs predicts the torque of other motion of their kind, and a model of more such logs.
///
/// "Of their kind" are states in which every joint has a position, speed and acceleration that it had in the logs, each
/// joint at another time, and half of them on the way back. What the parameters do not know is the posterior covariance,
/// its part of the data in proportion to the time; torque that the model has no law for is not in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Seconds of logs: those that there are, then twice, four times as long and so on.
    pub seconds: Vec<f64>,
    /// Standard deviation that uncertain parameters bring to each joint's torque, root mean square over such motion,
    /// `[seconds][n]`, N·m (N).
    pub deviation: Vec<Vec<f64>>,
    /// Standard deviation of what the model leaves of each joint's torque, `[n]`, N·m (N); zero for a joint that does not move.
    pub noise: Vec<f64>,
    /// Which motion would free parameters that the logs do not determine, a sentence for each joint that lacks one.
    pub advice: Vec<String>,
}

/// Parameters are sure enough if they bring a third of the noise: it makes the error larger by a twentieth.
const ENOUGH: f64 = 1.0 / 3.0;

/// Times the logs.
const LONGER: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];

/// States that stand for other motion.
const STATES: usize = 200;

impl Forecast {
    /// Seconds of logs, those that there are among them, after which the parameters of a joint are sure enough; none if
    /// sixteen times the logs are not enough.
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

    /// Seconds of further logs of their kind until the parameters of all joints are sure enough, zero if they are; none if
    /// such logs do not help some joint.
    pub fn seconds_to_go(&self) -> Option<f64> {
        let all: Option<Vec<f64>> = (0..self.noise.len()).map(|joint| self.enough_at(joint)).collect();
        all.map(|all| all.into_iter().fold(self.seconds[0], f64::max) - self.seconds[0])
    }
}

impl Task<'_> {
    /// - `estimate`: its covariance is that of the model
    /// - `dispersion`: what it was multiplied by, squared
    pub fn forecast(
        &self,
        estimate: &Estimate,
        held: Option<&Held>,
        dispersion: f64,
        noise: Vec<f64>,
    ) -> Result<Forecast, IdentificationError> {
        let states = self.states_of_the_logs()?;
        let recorded: f64 = self.motions.iter().map(|motion| motion.len() as f64 / motion.rate_hz).sum();
        let deviation = LONGER.map(|longer| {
            let covariance = match held {
                _ if longer == 1.0 => estimate.covariance.clone(),
                None => faer::Scale(1.0 / longer) * &estimate.covariance,
                Some(held) => faer::Scale(dispersion * dispersion) * held.covariance_with(longer),
            };
            self.deviation_of(&covariance, &states)
        });
        Ok(Forecast {
            seconds: LONGER.iter().map(|longer| longer * recorded).collect(),
            deviation: deviation.to_vec(),
            noise,
            advice: held.map_or(vec![], |held| self.all_advice(held)),
        })
    }

    /// Equations of states in which each joint moves as at some time of the logs, or on the way back.
    fn states_of_the_logs(&self) -> Result<Vec<JointFactor>, IdentificationError> {
        let n = self.robot.dof();
        let mut random = Random::new(0);
        let mut motion = [const { vec![] }; 3].map(|_: Vec<f64>| vec![0.0; STATES * n]);
        for joint in 0..n {
            let rows = |moving: bool| -> Vec<(usize, usize)> {
                let of_log = |(log, motion): (usize, &crate::motion::Motion)| {
                    let used =
                        (0..motion.len()).filter(move |k| !moving || motion.use_as[k * n + joint] == Row::Moving);
                    used.map(move |k| (log, k * n + joint)).collect::<Vec<_>>()
                };
                self.motions.iter().enumerate().flat_map(of_log).collect()
            };
            let mut from = rows(true);
            if from.is_empty() {
                from = rows(false);
            }
            for state in 0..STATES {
                let (log, at) = from[random.below(from.len())];
                let log = &self.motions[log];
                // Every second joint runs its motion backwards.
                let direction = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
                let values = [log.q[at], direction * log.dq[at], log.ddq[at]];
                motion.iter_mut().zip(values).for_each(|(all, value)| all[state * n + joint] = value);
            }
        }
        let zeros = vec![0.0; STATES * n];
        let columns = vec![zeros.clone(); self.set.trajectory_columns().len()];
        let mut observation = Observation::new(self.robot, self.set, self.base);
        let [q, dq, ddq] = &motion;
        let samples = Samples { q, dq, ddq };
        observation.add(&Trajectory { columns: &columns, ..Trajectory::new(samples, &zeros) })?;
        Ok(observation.factors())
    }

    /// Standard deviation of each joint's torque at these states, `[n]`.
    fn deviation_of(&self, covariance: &Mat<f64>, states: &[JointFactor]) -> Vec<f64> {
        let of = |joint: usize| {
            let own = states.iter().filter(|factor| factor.joint == joint);
            let (sum, rows) =
                own.fold((0.0, 0), |(sum, rows), factor| (sum + variances(covariance, factor), rows + factor.rows));
            (sum / rows.max(1) as f64).sqrt()
        };
        (0..self.robot.dof()).map(of).collect()
    }
}

/// Sum over the rows of a factor of the variance that parameters of a covariance bring to them.
pub(super) fn variances(covariance: &Mat<f64>, factor: &JointFactor) -> f64 {
    let count = factor.columns.len();
    let own = Mat::from_fn(count, count, |i, j| covariance[(factor.columns[i], factor.columns[j])]);
    let rows = factor.factor.as_ref().submatrix(0, 0, count, count);
    (rows * own * rows.transpose()).diagonal().column_vector().sum()
}
