//! How sure predictions are on motion that the logs do not show.
//!
//! Blocks and parts that were left out are motion like the others. A term whose factors the logs
//! determine only together with others may predict them well, and run off at other positions: there
//! the uncertainty of the parameters shows.

use super::problem::{Problem, union};
use crate::dynamics::Samples;
use crate::model::{TorqueModel, Trajectory};

/// Motion of the logs, and the same at positions beside theirs, after their end.
pub(super) struct Elsewhere {
    own: Vec<StretchSamples>,
    beside: Vec<StretchSamples>,
}

struct StretchSamples {
    rate_hz: f64,
    time: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
}

/// By how much a log is expected to go beyond the positions of others before any others are seen,
/// in ranges of the joint.
const BEYOND: f64 = 0.5;

/// Samples that are looked at.
const MOST: usize = 2000;

impl StretchSamples {
    fn trajectory(&self) -> Trajectory<'_> {
        let samples = Samples { q: &self.q, dq: &self.dq, ddq: &self.ddq };
        Trajectory { samples, rate_hz: self.rate_hz, time: &self.time, channels: &[] }
    }
}

impl Elsewhere {
    pub fn new(problem: &Problem) -> Self {
        let n = problem.dof();
        let robot = problem.nominal.robot();
        let end =
            problem.stretches.iter().filter_map(|s| s.time.last()).copied().fold(0.0, f64::max);
        let each = MOST / (2 * problem.stretches.len()).max(1);
        let shift = |joint: usize, sign: f64| {
            let logs = problem.range_by_stretch(joint);
            let [low, high] = union(&logs);
            let wanted = sign * beyond(&logs);
            let [lowest, highest] =
                robot.joints()[joint].limits.position.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            wanted.clamp((lowest - low).min(0.0), (highest - high).max(0.0))
        };
        // Neighbouring joints go to opposite sides.
        let shifts = [1.0, -1.0].map(|side| -> Vec<f64> {
            (0..n)
                .map(|joint| shift(joint, if joint.is_multiple_of(2) { side } else { -side }))
                .collect()
        });
        let (mut own, mut beside) = (Vec::new(), Vec::new());
        for stretch in &problem.stretches {
            let motion = &stretch.motion;
            let step = stretch.decimation();
            let samples: Vec<usize> = (0..motion.len()).step_by(step).take(each.max(1)).collect();
            let rate_hz = motion.rate_hz / step as f64;
            let of = |values: &[f64]| -> Vec<f64> {
                samples.iter().flat_map(|k| values[k * n..(k + 1) * n].iter().copied()).collect()
            };
            let along = |q: Vec<f64>, start: Option<f64>| {
                let time = start.map_or(vec![], |start| {
                    (0..samples.len()).map(|k| start + k as f64 / rate_hz).collect()
                });
                StretchSamples { rate_hz, time, q, dq: of(&motion.dq), ddq: of(&motion.ddq) }
            };
            let start = stretch.time.first().copied();
            own.push(along(of(&motion.q), start));
            for shifts in &shifts {
                let q = of(&motion.q).iter().enumerate().map(|(k, q)| q + shifts[k % n]).collect();
                beside.push(along(q, start.map(|_| end)));
            }
        }
        Self { own, beside }
    }

    /// By how much the mean variance of the torque that a model predicts is larger there than on
    /// the motion of the logs, where parts that were left out tell what it errs by, per joint,
    /// (N·m)² (N²); infinite for a model that cannot tell.
    pub fn variance(&self, model: &TorqueModel) -> Vec<f64> {
        let [own, beside] = [&self.own, &self.beside].map(|motions| mean_variance(motions, model));
        own.iter()
            .zip(&beside)
            .map(|(own, beside)| if own.is_finite() { (beside - own).max(0.0) } else { *own })
            .collect()
    }

    /// Mean square of what two models predict differently there, per joint, (N·m)² (N²).
    pub fn difference(&self, models: [&TorqueModel; 2]) -> Vec<f64> {
        let differ = |motion: &StretchSamples| -> Vec<f64> {
            let [own, other] = models.map(|model| model.predict_trajectory(&motion.trajectory()));
            own.iter().zip(&other).map(|(own, other)| own - other).collect()
        };
        mean_squares(models[0].robot().dof(), self.beside.iter().map(differ))
    }
}

fn mean_variance(motions: &[StretchSamples], model: &TorqueModel) -> Vec<f64> {
    let n = model.robot().dof();
    let deviations = motions.iter().map(|s| model.standard_deviation_along(&s.trajectory()));
    match deviations.collect::<Result<Vec<_>, _>>() {
        Ok(deviations) => mean_squares(n, deviations.into_iter()),
        Err(_) => vec![f64::INFINITY; n],
    }
}

/// Per joint, of values per sample and joint of some motions.
fn mean_squares(n: usize, motions: impl Iterator<Item = Vec<f64>>) -> Vec<f64> {
    let (mut sums, mut rows) = (vec![0.0; n], 0.0);
    for values in motions {
        values.iter().enumerate().for_each(|(k, value)| sums[k % n] += value * value);
        rows += (values.len() / n) as f64;
    }
    sums.into_iter().map(|sum| sum / f64::max(rows, 1.0)).collect()
}

/// By how much a new log may go beyond the positions that others show, each from the lowest to the
/// highest: the root mean square of what each of them goes beyond the others, to both sides, and of
/// what is expected before, which counts as one more.
fn beyond(logs: &[[f64; 2]]) -> f64 {
    let [low, high] = union(logs);
    let mut squares = vec![(BEYOND * (high - low)).powi(2)];
    for k in (0..logs.len()).filter(|_| logs.len() > 1) {
        let rest = union(&[&logs[..k], &logs[k + 1..]].concat());
        let sides = [rest[0] - logs[k][0], logs[k][1] - rest[1]];
        squares.push(sides.map(|side| side.max(0.0).powi(2)).iter().sum::<f64>() / 2.0);
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_say_by_how_much_another_goes_beyond_them() {
        // Nothing is known of a log by itself, and the more are alike the less is expected of
        // another.
        assert_eq!(beyond(&[[-1.0, 3.0]]), 2.0);
        assert_eq!(beyond(&[[-1.0, 3.0]; 3]), 1.0);
        // The second goes beyond the first by 4 to the right, which goes beyond it by 1 to the
        // left.
        let squares = [4.0f64.powi(2), 1.0 / 2.0, 16.0 / 2.0];
        assert!(
            (beyond(&[[-1.0, 3.0], [0.0, 7.0]]) - (squares.iter().sum::<f64>() / 3.0).sqrt()).abs()
                < 1e-12
        );
    }
}
