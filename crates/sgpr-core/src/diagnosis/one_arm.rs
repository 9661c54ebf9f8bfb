//! Whether all logs are of one arm.
//!
//! A log of another robot, with another load that was not found or with columns in another order is explained by itself as
//! well as others are, but by no model of all of them: what is found to bring them together is no effect.

use super::DiagnosisError;
use super::basis::Noise;
use super::fit::{Fitted, by_log};
use super::left_out::{FoldFits, Held};
use super::problem::Problem;
use crate::linalg::rms;

/// Growth of a log's error, geometric mean of the joints, from a fit to it alone to one of all logs, that neither a single joint
/// makes nor a lack of motion: logs of ten real arms stay below 1.4, of logs of two of them one is above 2.8.
const APART: f64 = 2.0;

/// Share of its torque that a fit to all logs then leaves of a log at least: less is a model of this arm that lacks something.
const MUCH: f64 = 0.1;

/// Errors below this share of a joint's torque are none.
const SMALL: f64 = 0.005;

/// A log is judged by itself if it has this many times as many rows as there are parameters.
const ENOUGH: f64 = 4.0;

/// Fails if a fit to one of the logs alone leaves much less of its torque than a fit to all of them.
pub(super) fn require_one_arm(problem: &Problem, fitted: &Fitted, noise: &Noise) -> Result<(), DiagnosisError> {
    if problem.stretches.len() < 2 {
        return Ok(());
    }
    let of_log = |rows: &Vec<(usize, usize)>| rows.iter().map(|(log, _)| *log).collect();
    let logs: Vec<Vec<usize>> = problem.rows.iter().map(of_log).collect();
    let held = Held { file: &problem.priors, precision: &fitted.precision };
    let fits = FoldFits::new(&fitted.columns, &fitted.target, (noise, held), (&logs, None));
    let [alone, together, torque] =
        [&fits.errors_of_each(held), &fitted.residual, &problem.y].map(|errors| by_log(problem, errors));
    let judged = (0..problem.stretches.len()).filter_map(|log| {
        let count: usize = logs.iter().flatten().filter(|own| **own == log).count();
        let freedom = 1.0 - fitted.columns.len() as f64 / count.max(1) as f64;
        (freedom > 1.0 - 1.0 / ENOUGH).then_some((log, freedom.sqrt()))
    });
    let growth = |(log, freedom): (usize, f64)| {
        let shares = (0..problem.dof()).filter_map(|joint| {
            let size = torque[joint][1 + log];
            let share = |errors: &[Vec<f64>]| (errors[joint][1 + log] / size).hypot(SMALL);
            (size > 0.0).then(|| [share(&alone) / freedom, share(&together)])
        });
        let shares: Vec<[f64; 2]> = shares.collect();
        let logarithms: f64 = shares.iter().map(|[alone, together]| (together / alone).ln()).sum();
        let percent = |of: usize| 100.0 * rms(&shares.iter().map(|both| both[of]).collect::<Vec<_>>());
        (log, (logarithms / shares.len().max(1) as f64).exp(), [percent(0), percent(1)])
    };
    match judged.map(growth).max_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((log, growth, [alone, together])) if growth > APART && together > 100.0 * MUCH => {
            Err(DiagnosisError::LogsApart { log: problem.stretches[log].motion.source.clone(), alone, together })
        }
        _ => Ok(()),
    }
}
