//! What a model leaves of one joint's torque, row by row, with what it may depend on.

use super::super::fit::Fitted;
use super::super::problem::{Blocks, Problem};
use crate::model::LogResidual;

/// Length of the blocks that are left out, s.
const BLOCK_S: f64 = 2.0;

/// Most rows that are looked at; of more every second, third, ... is.
const MOST_ROWS: usize = 8000;

/// Residual of one joint and the state of all joints, in the order of the logs.
#[derive(Clone, Debug, Default)]
pub(super) struct JointRows {
    pub joint: usize,
    /// Rows right before a row without a gap.
    pub run: Vec<usize>,
    /// Block that a row is left out with.
    pub fold: Vec<usize>,
    /// Time of the session, s; empty if the logs share no clock.
    pub time: Vec<f64>,
    /// Measured minus predicted, N·m (N).
    pub residual: Vec<f64>,
    /// Per joint, rad (m).
    pub q: Vec<Vec<f64>>,
    /// Per joint, rad/s (m/s).
    pub dq: Vec<Vec<f64>>,
    /// Of the joint, rad/s² (m/s²).
    pub ddq: Vec<f64>,
    /// Torque of the joint by the model, N·m (N).
    pub load: Vec<f64>,
}

impl JointRows {
    fn new(joint: usize, dof: usize) -> Self {
        Self { joint, q: vec![vec![]; dof], dq: vec![vec![]; dof], ..Self::default() }
    }

    pub fn len(&self) -> usize {
        self.residual.len()
    }

    /// Rows of a fit to the equations of a diagnosis.
    pub fn of_fit(problem: &Problem, fitted: &Fitted, joint: usize) -> Self {
        let n = problem.dof();
        let mut rows = Self::new(joint, n);
        let every = problem.rows[joint].len().div_ceil(MOST_ROWS).max(1);
        let blocks = Blocks::new(problem.stretches.iter().map(|stretch| &*stretch.motion), BLOCK_S);
        for (k, &(index, sample)) in problem.rows[joint].iter().enumerate() {
            let run = problem.run[joint][k] / every;
            if !problem.run[joint][k].is_multiple_of(every) {
                continue;
            }
            let motion = &problem.stretches[index].motion;
            rows.run.push(run);
            rows.fold.push(blocks.fold(index, sample));
            if problem.clock.is_some() {
                rows.time.push(problem.time_of((index, sample)));
            }
            rows.residual.push(fitted.residual[joint][k]);
            rows.push_state(&motion.q[sample * n..][..n], &motion.dq[sample * n..][..n]);
            rows.ddq.push(motion.ddq[sample * n + joint]);
            rows.load.push(fitted.rigid[index].torque[sample * n + joint]);
        }
        rows
    }

    /// Rows of a comparison, one in `decimation` samples.
    pub fn of_logs(logs: &[&LogResidual], dof: usize, decimation: usize, joint: usize) -> Self {
        let mut rows = Self::new(joint, dof);
        let total: usize = logs.iter().map(|log| log.motion.len()).sum();
        let every = decimation.max(1) * (total / decimation.max(1)).div_ceil(MOST_ROWS).max(1);
        let clock = common_clock(logs);
        let blocks = Blocks::new(logs.iter().map(|log| &*log.motion), BLOCK_S);
        for (index, log) in logs.iter().enumerate() {
            let mut run = 0;
            let in_band = log.in_band(joint);
            for sample in (0..log.motion.len()).step_by(every) {
                let at = sample * dof + joint;
                if !log.counts(at) {
                    run = 0;
                    continue;
                }
                rows.run.push(run);
                run += 1;
                rows.fold.push(blocks.fold(index, sample));
                if let Some(start) = clock {
                    rows.time.push((log.time()[sample] - start) as f64 * 1e-9);
                }
                rows.residual.push(in_band.residual(sample));
                rows.push_state(
                    &log.motion.q[sample * dof..][..dof],
                    &log.motion.dq[sample * dof..][..dof],
                );
                rows.ddq.push(log.motion.ddq[at]);
                rows.load.push(in_band.predicted[sample]);
            }
        }
        rows
    }

    fn push_state(&mut self, q: &[f64], dq: &[f64]) {
        self.q.iter_mut().zip(q).for_each(|(own, value)| own.push(*value));
        self.dq.iter_mut().zip(dq).for_each(|(own, value)| own.push(*value));
    }

    /// Every so many rows, at most `most`.
    pub fn thinned(&self, most: usize) -> Self {
        let every = self.len().div_ceil(most).max(1);
        let pick = |values: &Vec<f64>| values.iter().step_by(every).copied().collect();
        Self {
            joint: self.joint,
            // Neighbours are not neighbours any more.
            run: vec![0; self.len().div_ceil(every)],
            fold: self.fold.iter().step_by(every).copied().collect(),
            time: pick(&self.time),
            residual: pick(&self.residual),
            q: self.q.iter().map(pick).collect(),
            dq: self.dq.iter().map(pick).collect(),
            ddq: pick(&self.ddq),
            load: pick(&self.load),
        }
    }

    /// The same rows with another residual.
    pub fn with_residual(&self, residual: Vec<f64>) -> Self {
        Self { residual, ..self.clone() }
    }

    /// Highest speed of a joint, rad/s (m/s).
    pub fn top_speed(&self, joint: usize) -> f64 {
        self.dq[joint].iter().fold(1e-12, |top: f64, dq| top.max(dq.abs()))
    }
}

/// The earliest stamp, ns, if no two logs overlap in time; stamps near zero count from zero.
fn common_clock(logs: &[&LogResidual]) -> Option<i64> {
    /// Stamps that begin within an hour of zero count from zero, ns.
    const NEAR_ZERO_NS: i64 = 3_600_000_000_000;
    let mut spans: Vec<(i64, i64)> =
        logs.iter().filter_map(|l| Some((*l.time().first()?, *l.time().last()?))).collect();
    spans.sort_unstable();
    let apart = spans.windows(2).all(|pair| pair[0].1 <= pair[1].0);
    let first = spans.first()?.0;
    apart.then_some(if first.abs() < NEAR_ZERO_NS { 0 } else { first })
}
