//! Whether all logs are of one arm.
//!
//! A log of another robot, with another load or with columns in another order is explained by
//! itself as well as others are, but by no model of all of them.

use super::Finding;
use crate::identification::least_squares::{residual_norm, torque_norm};
use crate::identification::{BaseParameters, JointFactor, LeastSquares, Method, stacked};
use crate::linalg::rms;

/// Growth of a log's error from a fit to it alone to one of all logs that an effect which the model
/// lacks does not make: of five real arms and of simulated ones with hidden effects it stays below
/// 2.5, but for loads that one log has; of logs of two arms it is above 4.8 for at least one.
const MOST: f64 = 3.0;

/// Share of its torque that a fit to all logs then leaves of a log at least: less is a model of
/// this arm that lacks something.
const MUCH: f64 = 0.1;

/// Errors below this share of a joint's torque are none.
const SMALL: f64 = 0.005;

/// A log is judged by itself if it has this many times as many rows as there are parameters.
const ENOUGH: f64 = 4.0;

/// What a fit to a log alone leaves, times this, is what it would leave of other rows; `None` of
/// too few to judge the log by itself.
pub(crate) fn beyond_own_rows(rows: usize, parameters: usize) -> Option<f64> {
    let freedom = 1.0 - parameters as f64 / rows.max(1) as f64;
    (freedom > 1.0 - 1.0 / ENOUGH).then(|| freedom.sqrt().recip())
}

/// Shares of torque that fits leave.
#[derive(Clone, Debug)]
pub(crate) struct Left {
    /// Of each joint in the log: by a fit to this log alone, and by one to all logs.
    pub of_joints: Vec<[f64; 2]>,
    /// Of the other logs, by a fit to these.
    pub of_others: f64,
}

/// Logs that no model of one arm explains.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Apart {
    /// The log without which the others agree best.
    pub odd: usize,
    /// The log whose error grows most, and what a fit to it alone and one to all logs leave of its
    /// torque, %.
    pub grown: usize,
    pub left: [f64; 2],
}

/// Geometric mean of shares of torque; one of none.
fn mean(shares: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = shares.len().max(1) as f64;
    (shares.map(|share| share.hypot(SMALL).ln()).sum::<f64>() / count).exp()
}

/// Whether logs are of one arm: a fit to a log alone leaves not much less of it than one to all,
/// which every log suffers from if one is not theirs.
///
/// - `most`: growth from the one share to the other, geometric means of the joints, that one arm
///   makes
/// - `logs`: index, and what is left
pub(crate) fn logs_apart(most: f64, logs: impl Iterator<Item = (usize, Left)>) -> Option<Apart> {
    let means = |(log, left): (usize, Left)| {
        (
            log,
            left.of_others,
            [0, 1].map(|fit| mean(left.of_joints.iter().map(|shares| shares[fit]))),
        )
    };
    let logs: Vec<_> = logs.map(means).collect();
    let growth = |[alone, together]: [f64; 2]| together / alone;
    let much = logs.iter().filter(|(.., shares)| shares[1] > MUCH);
    let &(grown, _, shares) = much.max_by(|a, b| growth(a.2).total_cmp(&growth(b.2)))?;
    let &(odd, ..) = logs.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (growth(shares) > most).then(|| Apart { odd, grown, left: shares.map(|share| 100.0 * share) })
}

/// Whether one of several logs, each with its name and factors, is of another arm than the others.
///
/// - `nominal`: base parameters where the motion does not determine them, `[rank]`
///
/// # Panics
/// If `nominal` does not have one value for every base parameter.
pub fn screen_logs(
    logs: &[(String, Vec<JointFactor>)],
    base: &BaseParameters,
    nominal: &[f64],
) -> Option<Finding> {
    let moving = |factors: &[JointFactor]| -> Vec<JointFactor> {
        factors.iter().filter(|factor| !factor.resting).cloned().collect()
    };
    let factors: Vec<Vec<JointFactor>> = logs.iter().map(|(_, factors)| moving(factors)).collect();
    let fit = |factors: &[JointFactor]| {
        let estimate = LeastSquares::new(Method::Wls).solve(factors, base, nominal).ok()?;
        Some(estimate.values)
    };
    let together = fit(&stacked(factors.iter().flatten()))?;
    let left_of = |factors: &[JointFactor], values: &[f64]| -> Vec<f64> {
        let moved = factors.iter().filter(|factor| torque_norm(factor) > 0.0);
        moved.map(|factor| residual_norm(factor, values) / torque_norm(factor)).collect()
    };
    let together: Vec<Vec<f64>> = factors.iter().map(|own| left_of(own, &together)).collect();
    // The usual case, in which nothing more is fitted.
    if together.iter().all(|shares| mean(shares.iter().copied()) <= MUCH) {
        return None;
    }
    let left = |(log, own): (usize, &Vec<JointFactor>)| {
        let wider = beyond_own_rows(own.iter().map(|factor| factor.rows).sum(), base.rank())?;
        let alone = left_of(own, &fit(own)?);
        let others = factors.iter().enumerate().filter(|(other, _)| *other != log);
        let others = stacked(others.flat_map(|(_, factors)| factors));
        let of_others = rms(&left_of(&others, &fit(&others)?));
        let of_joints = alone
            .iter()
            .zip(&together[log])
            .map(|(alone, together)| [wider * alone, *together])
            .collect();
        Some((log, Left { of_joints, of_others }))
    };
    let Apart { odd, grown, left } = logs_apart(MOST, factors.iter().enumerate().filter_map(left))?;
    let [log, other] = [grown, odd].map(|log| logs[log].0.clone());
    Some(Finding::LogsApart { log, left, odd: other })
}
