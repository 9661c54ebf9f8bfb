//! Whether all logs are of one arm.
//!
//! A log of another robot, with another load that was not found or with columns in another order is
//! explained by itself as well as others are, but by no model of all of them: what is found to
//! bring them together is no effect.

use super::DiagnosisError;
use super::basis::Noise;
use super::fit::{Fitted, by_log};
use super::left_out::{FoldFits, Held};
use super::problem::Problem;
use crate::identification::{Apart, Left, beyond_own_rows, logs_apart};

/// Growth of a log's error from a fit to it alone to one of all logs that logs of one arm do not
/// make once what it lacks was found: those of ten real arms stay below 1.4, of logs of two of them
/// one is above 2.8.
const MOST: f64 = 2.0;

/// Fails if a fit to one of the logs alone leaves much less of its torque than a fit to all of
/// them.
pub(super) fn require_one_arm(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
) -> Result<(), DiagnosisError> {
    if problem.stretches.len() < 2 {
        return Ok(());
    }
    let of_log = |rows: &Vec<(usize, usize)>| rows.iter().map(|(log, _)| *log).collect();
    let logs: Vec<Vec<usize>> = problem.rows.iter().map(of_log).collect();
    let held = Held { file: &problem.priors, precision: &fitted.precision };
    let fits = FoldFits::new(&fitted.columns, &fitted.target, (noise, held), (&logs, None));
    let [alone, together, torque] = [&fits.errors_of_each(held), &fitted.residual, &problem.y]
        .map(|errors| by_log(problem, errors));
    let of_others = fits.shares_left_of_others();
    let left = |log: usize| {
        let rows = logs.iter().flatten().filter(|own| **own == log).count();
        let wider = beyond_own_rows(rows, fitted.columns.len())?;
        let of_joint = |joint: usize| {
            let size = torque[joint][1 + log];
            (size > 0.0)
                .then(|| [wider * alone[joint][1 + log] / size, together[joint][1 + log] / size])
        };
        let of_joints = (0..problem.dof()).filter_map(of_joint).collect();
        Some((log, Left { of_joints, of_others: of_others[log] }))
    };
    let Some(Apart { odd, grown, left }) =
        logs_apart(MOST, (0..problem.stretches.len()).filter_map(left))
    else {
        return Ok(());
    };
    let [log, odd] = [grown, odd].map(|log| problem.stretches[log].motion.source.clone());
    Err(DiagnosisError::LogsApart { log, left, odd })
}
