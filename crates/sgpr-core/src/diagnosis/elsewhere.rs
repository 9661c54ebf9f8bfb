//! How sure predictions are on motion that the logs do not show.
//!
//! Blocks and parts that were left out are motion like the rest. A term whose factors the logs determine only together with
//! others may predict them well, and run off at other positions: there the uncertainty of the parameters shows.

use super::problem::Problem;
use crate::dynamics::Samples;
use crate::model::{TorqueModel, Trajectory};

/// Motion of the logs at positions beside theirs, after their end.
pub(super) struct Elsewhere {
    stretches: Vec<Shifted>,
}

struct Shifted {
    rate_hz: f64,
    time: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
}

/// By how much positions are moved, in ranges of the joint that the logs show.
const SHIFT: f64 = 0.5;

/// Samples that are looked at.
const MOST: usize = 2000;

impl Elsewhere {
    pub fn new(problem: &Problem) -> Self {
        let n = problem.dof();
        let robot = problem.nominal.robot();
        let end = problem.stretches.iter().filter_map(|s| s.time.last()).copied().fold(0.0, f64::max);
        let each = MOST / (2 * problem.stretches.len()).max(1);
        let shift = |joint: usize, sign: f64| {
            let [low, high] = problem.ranges(joint).position;
            let wanted = sign * SHIFT * (high - low);
            let [lowest, highest] = robot.joints()[joint].limits.position.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            wanted.clamp((lowest - low).min(0.0), (highest - high).max(0.0))
        };
        let mut stretches = Vec::new();
        for stretch in &problem.stretches {
            let motion = &stretch.motion;
            let step = stretch.decimation();
            let samples: Vec<usize> = (0..motion.len()).step_by(step).take(each.max(1)).collect();
            for side in [1.0, -1.0] {
                let sign = |joint: usize| if joint.is_multiple_of(2) { side } else { -side };
                let shifts: Vec<f64> = (0..n).map(|joint| shift(joint, sign(joint))).collect();
                let of = |values: &[f64]| -> Vec<f64> {
                    samples.iter().flat_map(|k| values[k * n..(k + 1) * n].iter().copied()).collect()
                };
                let q = of(&motion.q).iter().enumerate().map(|(k, q)| q + shifts[k % n]).collect();
                let rate_hz = motion.rate_hz / step as f64;
                let time = (0..samples.len()).map(|k| end + k as f64 / rate_hz);
                let time = if stretch.time.is_empty() { vec![] } else { time.collect() };
                stretches.push(Shifted { rate_hz, time, q, dq: of(&motion.dq), ddq: of(&motion.ddq) });
            }
        }
        Self { stretches }
    }

    /// Mean variance of the torque that a model predicts there, per joint, (N·m)² (N²); infinite for a model that cannot tell.
    pub fn variance(&self, model: &TorqueModel) -> Vec<f64> {
        let n = model.robot().dof();
        let (mut sums, mut rows) = (vec![0.0; n], 0.0);
        for s in &self.stretches {
            let samples = Samples { q: &s.q, dq: &s.dq, ddq: &s.ddq };
            let along = Trajectory { samples, rate_hz: s.rate_hz, time: &s.time, channels: &[] };
            let Ok(deviations) = model.standard_deviation_along(&along) else { return vec![f64::INFINITY; n] };
            deviations.iter().enumerate().for_each(|(k, deviation)| sums[k % n] += deviation * deviation);
            rows += (deviations.len() / n) as f64;
        }
        sums.into_iter().map(|sum| sum / f64::max(rows, 1.0)).collect()
    }
}
