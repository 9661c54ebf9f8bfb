//! What the physics leaves over on parts of the logs that it has not seen.

use std::borrow::Cow;

use faer::Mat;
use faer::linalg::solvers::Solve;

use super::super::IdentifyError;
use super::super::compare::LogResidual;
use super::basis::{self, ParameterBasis};
use super::rows::{LeftOutRows, ResidualRows, Unseen};
use super::{Mean, TorqueModel};
use crate::identification::half_run;
use crate::motion::Processing;

/// Parts that are left out in turn ...
const PARTS: usize = 8;

/// ... unless there are this many logs.
const FEWEST_LOGS: usize = 3;

/// For each joint and part: the residual of physics whose parameters were estimated without that
/// part, and the variance that their uncertainty brings. The estimate without a part is the
/// posterior mean of all rows with those of the part taken back: what held the parameters in the
/// identification holds them here ([`held_by`]), too, so that a part which alone determines a
/// parameter is missed as a new motion would be. For a part that says nothing nothing changes,
/// however the physics was estimated. A part lies among the others: its errors tell the noise, and
/// the parameters are as certain beside it as noise leaves them, without the dispersion of their
/// fit, which is for other motions.
///
/// A part of a log that determines all parameters is missed more than a log among others: what only
/// it determines runs off without it, further than on another log. With few such logs the physics
/// therefore stays as it is, and the errors of physics that was estimated anew count beside these
/// for the intervals alone ([`Unseen::anew`]). Not so with [`Mean::Joint`], where it is compared
/// with physics and processes that are estimated anew without the part.
pub(super) fn left_out(
    physics: &TorqueModel,
    logs: &[LogResidual],
    rows: &[ResidualRows],
    processing: &Processing,
    mean: Mean,
) -> Result<Vec<Unseen>, IdentifyError> {
    let (count, part_of) = divide(logs);
    let parts: Vec<Vec<Vec<usize>>> =
        rows.iter().map(|rows| parts(rows, count, &part_of)).collect();
    let together = together(count);
    let rows_of = |joint: usize, group: &Group| -> Vec<usize> {
        let mut rows: Vec<usize> =
            group.parts.iter().flat_map(|part| parts[joint][*part].iter().copied()).collect();
        rows.sort_unstable();
        rows
    };
    let mut result: Vec<Unseen> = rows.iter().map(|_| Unseen::default()).collect();
    if mean == Mean::Zero {
        for group in &together {
            for (joint, rows) in rows.iter().enumerate() {
                let part = rows_of(joint, group);
                let variance = vec![0.0; part.len()];
                group.of(&mut result[joint]).push(LeftOutRows {
                    residual: rows.residual.clone(),
                    variance,
                    part,
                });
            }
        }
        return Ok(result);
    }
    let unknowns = basis::unknowns(physics);
    let mut matrices = Vec::with_capacity(rows.len());
    for (joint, rows) in rows.iter().enumerate() {
        matrices.push(match &rows.terms {
            Some(terms) => Cow::Borrowed(terms),
            None => Cow::Owned(basis::matrix(physics, logs, joint, rows, processing)?),
        });
    }
    let open = physics.fit.as_ref().is_some_and(|fit| !fit.undetermined.is_empty());
    let stays = mean == Mean::Physics && logs.len() < FEWEST_LOGS && !open;
    let left = |joint: usize, group: &Group, (change, covariance): &(Mat<f64>, Mat<f64>)| {
        let matrix = &*matrices[joint];
        let explained = matrix * change;
        let residual = rows[joint]
            .residual
            .iter()
            .enumerate()
            .map(|(i, residual)| residual - explained[(i, 0)]);
        let part = rows_of(joint, group);
        let seen = Mat::from_fn(part.len(), unknowns, |i, k| matrix[(part[i], k)]);
        let spread = &seen * covariance;
        let variance =
            (0..part.len()).map(|i| (spread.row(i) * seen.row(i).transpose()).max(0.0)).collect();
        LeftOutRows { residual: residual.collect(), variance, part }
    };
    let whole = ParameterBasis::of_physics(physics).filter(|_| stays);
    let whole = whole.map(|whole| {
        let dispersion = physics.fit.as_ref().map_or(1.0, |fit| fit.dispersion);
        (Mat::zeros(unknowns, 1), faer::Scale(dispersion.powi(-2)) * &whole.covariance)
    });
    let anew = changes(physics, rows, &matrices, &parts, &together);
    for (group, anew) in together.iter().zip(&anew) {
        for (joint, result) in result.iter_mut().enumerate() {
            group.of(result).push(left(joint, group, whole.as_ref().unwrap_or(anew)));
            if whole.is_some() && !group.is_run {
                result.anew.push(left(joint, group, anew));
            }
        }
    }
    Ok(result)
}

/// What happens to the parameters without each group of parts, `[unknowns, 1]`, and their
/// covariance then.
///
/// - `matrices`: per joint, `[rows, unknowns]`
/// - `parts`: per joint and part, its rows
fn changes(
    physics: &TorqueModel,
    rows: &[ResidualRows],
    matrices: &[Cow<'_, Mat<f64>>],
    parts: &[Vec<Vec<usize>>],
    together: &[Group],
) -> Vec<(Mat<f64>, Mat<f64>)> {
    let unknowns = basis::unknowns(physics);
    let none = || Normal {
        information: Mat::zeros(unknowns, unknowns),
        projection: Mat::zeros(unknowns, 1),
    };
    let mut all = none();
    let count = parts.first().map_or(0, Vec::len);
    let mut of_parts = Vec::with_capacity(count);
    for index in 0..count {
        let mut of_part = none();
        for ((rows, matrix), parts) in rows.iter().zip(matrices).zip(parts) {
            of_part.add(rows, matrix, &parts[index]);
        }
        all.information += &of_part.information;
        all.projection += &of_part.projection;
        of_parts.push(of_part);
    }
    let memory = memory(physics, rows);
    if physics.fit.as_ref().is_some_and(|fit| !fit.undetermined.is_empty()) {
        // What holds the parameters pulls as much as all rows do.
        all.information +=
            faer::Scale(memory) * held_by(physics, &(faer::Scale(1.0 / memory) * &all.information));
        all.projection.fill(0.0);
    }
    let (with_all, _) = basis::solve(&all.information, &all.projection);
    let without = |group: &Group| {
        let (mut information, mut projection) = (all.information.clone(), all.projection.clone());
        for part in &group.parts {
            information -= &of_parts[*part].information;
            projection -= &of_parts[*part].projection;
        }
        let (without, covariance) = basis::solve(&information, &projection);
        (
            Mat::from_fn(unknowns, 1, |k, _| without[k] - with_all[k]),
            faer::Scale(memory) * covariance,
        )
    };
    together.iter().map(without).collect()
}

/// Parts that are left out together.
struct Group {
    parts: Vec<usize>,
    /// Half of all parts, rather than one.
    is_run: bool,
}

impl Group {
    /// Where it belongs.
    fn of<'a>(&self, unseen: &'a mut Unseen) -> &'a mut Vec<LeftOutRows> {
        if self.is_run { &mut unseen.runs } else { &mut unseen.parts }
    }
}

/// What is left out in turn of so many parts.
fn together(count: usize) -> Vec<Group> {
    let parts = (0..count).map(|part| Group { parts: vec![part], is_run: false });
    parts
        .chain((0..count).map(|first| Group { parts: half_run(first, count), is_run: true }))
        .collect()
}

/// What the identification knows of the base parameters beside the rows, where these leave some
/// undetermined: the part of its information, the inverse of the covariance, by which it is more
/// than that of the rows.
fn held_by(physics: &TorqueModel, information: &Mat<f64>) -> Mat<f64> {
    let unknowns = information.ncols();
    let rank = physics.base().rank();
    let none = Mat::zeros(unknowns, unknowns);
    let Some(fit) = physics.fit.as_ref().filter(|fit| !fit.undetermined.is_empty()) else {
        return none;
    };
    let finite =
        |k: usize| fit.covariance[k * rank + k] > 0.0 && fit.covariance[k * rank + k].is_finite();
    if !(0..rank).all(finite) {
        return none;
    }
    let covariance = |i: usize, j: usize| fit.covariance[i * rank + j] / fit.dispersion.powi(2);
    let deviation: Vec<f64> = (0..rank).map(|k| covariance(k, k).sqrt()).collect();
    let scaled = Mat::from_fn(rank, rank, |i, j| covariance(i, j) / (deviation[i] * deviation[j]));
    let Ok(factor) = scaled.llt(faer::Side::Lower) else { return none };
    let all = factor.solve(Mat::<f64>::identity(rank, rank));
    let more = Mat::from_fn(rank, rank, |i, j| {
        0.5 * (all[(i, j)] + all[(j, i)]) - information[(i, j)] * deviation[i] * deviation[j]
    });
    let Ok(eigen) = more.self_adjoint_eigen(faer::Side::Lower) else { return none };
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    Mat::from_fn(unknowns, unknowns, |i, j| match i < rank && j < rank {
        true => {
            let sum = (0..rank)
                .map(|k| vectors[(i, k)] * vectors[(j, k)] * values[k].max(0.0))
                .sum::<f64>();
            sum / (deviation[i] * deviation[j])
        }
        false => 0.0,
    })
}

/// Normal equations of the linear parameters.
struct Normal {
    information: Mat<f64>,
    projection: Mat<f64>,
}

impl Normal {
    /// Adds some rows of a joint.
    ///
    /// - `matrix`: `[rows, unknowns]`, of all its rows
    fn add(&mut self, rows: &ResidualRows, matrix: &Mat<f64>, chosen: &[usize]) {
        let weight = faer::Scale(weight(rows));
        let residual = Mat::from_fn(chosen.len(), 1, |i, _| rows.residual[chosen[i]]);
        let matrix = Mat::from_fn(chosen.len(), matrix.ncols(), |i, k| matrix[(chosen[i], k)]);
        self.information += matrix.transpose() * &matrix * weight;
        self.projection += matrix.transpose() * residual * weight;
    }
}

/// One over the mean square of the residual; nothing for a joint without residual, which needs no
/// change.
fn weight(rows: &ResidualRows) -> f64 {
    let squares: f64 = rows.residual.iter().map(|residual| residual * residual).sum();
    if squares > 0.0 { rows.residual.len() as f64 / squares } else { 0.0 }
}

/// Rows that say as much as one independent row, the mean over all rows.
fn memory(physics: &TorqueModel, rows: &[ResidualRows]) -> f64 {
    let Some(fit) = &physics.fit else { return 1.0 };
    let all: usize = rows.iter().map(|rows| rows.residual.len()).sum();
    let counted =
        rows.iter().zip(&fit.correlation).map(|(rows, memory)| rows.residual.len() as f64 * memory);
    (counted.sum::<f64>() / all.max(1) as f64).max(1.0)
}

/// Number of parts, and for each log the part of each sample: whole logs if there are enough; else
/// eighths of their period if a motion repeats itself, for an eighth of the time would be seen
/// again in every other period; else of the time.
fn divide(logs: &[LogResidual]) -> (usize, Vec<Vec<usize>>) {
    let lengths = logs.iter().map(|log| log.motion.len());
    if logs.len() >= FEWEST_LOGS {
        return (logs.len(), lengths.enumerate().map(|(log, length)| vec![log; length]).collect());
    }
    let periods: Vec<Option<usize>> =
        logs.iter().map(|log| period(&log.motion.q, log.dof())).collect();
    if periods.iter().any(Option::is_some) {
        let of_log = |(length, period): (usize, &Option<usize>)| {
            let period = period.unwrap_or(length);
            (0..length).map(|k| k % period * PARTS / period).collect()
        };
        return (PARTS, lengths.zip(&periods).map(of_log).collect());
    }
    let total: usize = lengths.clone().sum();
    let mut before = 0;
    let of_log = |length: usize| {
        before += length;
        (before - length..before).map(|k| k * PARTS / total).collect()
    };
    (PARTS, lengths.map(of_log).collect())
}

/// Samples that are looked at for a period.
const LOOKED_AT: usize = 2000;

/// Mean square difference of a motion to itself a period later, in its variance: below this it
/// repeats itself, above the other it has gone elsewhere.
const ALIKE: f64 = 0.01;
const ELSEWHERE: f64 = 0.2;

/// Samples after which a motion, `[samples, dof]`, repeats itself; none if it does not, or only
/// after more than half of them.
fn period(q: &[f64], dof: usize) -> Option<usize> {
    let samples = q.len() / dof;
    let step = samples.div_ceil(LOOKED_AT);
    let thinned: Vec<&[f64]> = q.chunks_exact(dof).step_by(step).collect();
    let count = thinned.len();
    let square =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let mean: Vec<f64> =
        (0..dof).map(|j| thinned.iter().map(|q| q[j]).sum::<f64>() / count as f64).collect();
    let variance = thinned.iter().map(|q| square(q, &mean)).sum::<f64>() / count as f64;
    let difference = |lag: usize| {
        let pairs = thinned.iter().zip(&thinned[lag..]);
        pairs.map(|(a, b)| square(a, b)).sum::<f64>() / ((count - lag) as f64 * variance)
    };
    let differences: Vec<f64> = (0..=count / 2).map(difference).collect();
    let away = differences.iter().position(|difference| *difference > ELSEWHERE)?;
    let lowest = |lag: &usize| {
        differences[*lag] < ALIKE
            && differences[*lag..].iter().take(2).all(|d| *d >= differences[*lag])
    };
    (away..differences.len()).find(lowest).map(|lag| lag * step)
}

/// Rows of each part.
fn parts(rows: &ResidualRows, count: usize, part_of: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut parts = vec![Vec::new(); count];
    for (row, (log, sample)) in rows.source.iter().enumerate() {
        parts[part_of[*log][*sample]].push(row);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_that_repeats_itself_is_known_by_its_period() {
        let wave = |k: usize, period: f64| (std::f64::consts::TAU * k as f64 / period).sin();
        // Two joints, the second three times as fast; measured with noise that no two periods
        // share.
        let noise = |k: usize| 1e-3 * ((k * 7919 % 1009) as f64 / 504.0 - 1.0);
        let repeated: Vec<f64> = (0..9000)
            .flat_map(|k| [wave(k, 2400.0) + noise(k), 0.5 * wave(k, 800.0) + noise(k + 5)])
            .collect();
        let found = period(&repeated, 2).expect("three periods and a half");
        assert!(found.abs_diff(2400) <= 5, "{found}");
        // The period would only be over after the log, the motion never comes back, or never
        // leaves.
        assert_eq!(period(&repeated[..2 * 4000], 2), None);
        let chirp: Vec<f64> = (0..9000).map(|k| wave(k * k / 3000, 2400.0)).collect();
        assert_eq!(period(&chirp, 1), None);
        assert_eq!(period(&[0.3; 500], 1), None);
    }
}
