//! How much data is enough, after recording: what uncertain parameters bring to the torque of other
//! motion, after these logs and after more of their kind.

use std::sync::Arc;

use super::held::{Held, Task};
use crate::dynamics::Samples;
use crate::identification::{
    BaseParameters, Estimate, Forecast, IdentificationError, JointFactor, LONGER, ParameterSet,
    Row, STATES, deviation_of, either_way, equations_of,
};
use crate::motion::Motion;
use crate::robot::Robot;
use sgpr_numeric::internal::Random;

impl Task<'_> {
    /// - `estimate`: its covariance is that of the model
    /// - `dispersion`: what it was multiplied by, squared
    /// - `recorded`, `states`: seconds of the logs, and equations of states of their motion
    pub fn forecast(
        &self,
        estimate: &Estimate,
        held: Option<&Held>,
        dispersion: f64,
        noise: Vec<f64>,
        (recorded, states): (f64, Vec<JointFactor>),
    ) -> Forecast {
        let deviation = LONGER.map(|longer| {
            let covariance = match held {
                _ if longer == 1.0 => (*estimate.covariance).clone(),
                None => faer::Scale(1.0 / longer) * &*estimate.covariance,
                Some(held) => faer::Scale(dispersion * dispersion) * held.covariance_with(longer),
            };
            deviation_of(&covariance, &states, self.robot.dof())
        });
        Forecast {
            seconds: LONGER.iter().map(|longer| longer * recorded).collect(),
            deviation: deviation.to_vec(),
            noise,
            advice: held.map_or(vec![], |held| self.all_advice(held)),
        }
    }
}

/// Equations of states in which each joint moves as at some time of the logs, or on the way back.
pub(super) fn states_of(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    motions: &[Arc<Motion>],
) -> Result<Vec<JointFactor>, IdentificationError> {
    let n = robot.dof();
    let mut random = Random::new(0);
    let mut motion = [const { vec![] }; 3].map(|_: Vec<f64>| vec![0.0; STATES * n]);
    for joint in 0..n {
        let rows = |moving: bool| -> Vec<(usize, usize)> {
            let of_log = |(log, motion): (usize, &Arc<Motion>)| {
                let used = (0..motion.len())
                    .filter(move |k| !moving || motion.use_as[k * n + joint] == Row::Moving);
                used.map(move |k| (log, k * n + joint)).collect::<Vec<_>>()
            };
            motions.iter().enumerate().flat_map(of_log).collect()
        };
        let mut from = rows(true);
        if from.is_empty() {
            from = rows(false);
        }
        for state in 0..STATES {
            let (log, at) = from[random.below(from.len())];
            let log = &motions[log];
            let values = either_way(&mut random, [log.q[at], log.dq[at], log.ddq[at]]);
            motion.iter_mut().zip(values).for_each(|(all, value)| all[state * n + joint] = value);
        }
    }
    let [q, dq, ddq] = &motion;
    equations_of(robot, set, base, Samples { q, dq, ddq })
}
