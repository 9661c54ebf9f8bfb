//! What the physics leaves over on parts of the logs that it has not seen.

use std::ops::Range;

use faer::Mat;

use super::super::compare::LogResidual;
use super::super::identify::IdentifyError;
use super::basis;
use super::rest::{LeftOut, Rows};
use super::{Mean, TorqueModel};
use crate::motion::Processing;

/// Parts that are left out in turn ...
const PARTS: usize = 8;

/// ... unless there are this many logs.
const FEWEST_LOGS: usize = 3;

/// For each joint and part: the residual of physics whose parameters were estimated without that part. Least squares in
/// the rows of the joints in motion, weighted as the identification found their noise; the parameters change by what the
/// part had to say, which takes one small solution for each part. A part of a log is missed more than a log among others:
/// without it directions may stay undetermined that every whole log excites, so that the physics then stays as it is.
pub(super) fn left_out(
    physics: &TorqueModel,
    logs: &[LogResidual],
    rows: &[Rows],
    processing: &Processing,
    mean: Mean,
) -> Result<Vec<Vec<LeftOut>>, IdentifyError> {
    let edges = edges(logs);
    let parts: Vec<Vec<Range<usize>>> = rows.iter().map(|rows| parts(rows, &edges)).collect();
    let unchanged = |rows: &Rows, part: &Range<usize>| LeftOut { part: part.clone(), residual: rows.residual.clone() };
    if mean == Mean::Zero || logs.len() < FEWEST_LOGS {
        let joints = rows.iter().zip(&parts);
        return Ok(joints.map(|(rows, parts)| parts.iter().map(|part| unchanged(rows, part)).collect()).collect());
    }
    let unknowns = basis::unknowns(physics);
    let mut matrices = Vec::with_capacity(rows.len());
    for (joint, rows) in rows.iter().enumerate() {
        matrices.push(basis::matrix(physics, logs, joint, rows, processing)?);
    }
    let weights: Vec<f64> = rows.iter().map(weight).collect();
    let mut result: Vec<Vec<LeftOut>> = rows.iter().map(|_| Vec::new()).collect();
    for index in 0..edges.len() {
        let mut information = Mat::<f64>::zeros(unknowns, unknowns);
        let mut projection = Mat::<f64>::zeros(unknowns, 1);
        for (joint, matrix) in matrices.iter().enumerate() {
            let Range { start, end } = parts[joint][index];
            for other in [0..start, end..matrix.nrows()] {
                let kept = matrix.as_ref().subrows(other.start, other.len());
                let residual = Mat::from_fn(other.len(), 1, |i, _| rows[joint].residual[other.start + i]);
                information += kept.transpose() * kept * faer::Scale(weights[joint]);
                projection += kept.transpose() * residual * faer::Scale(weights[joint]);
            }
        }
        let (change, _) = basis::solve(&information, &projection);
        let change = Mat::from_fn(unknowns, 1, |k, _| change[k]);
        for (joint, matrix) in matrices.iter().enumerate() {
            let explained = matrix * &change;
            let residual = rows[joint].residual.iter().enumerate().map(|(i, residual)| residual - explained[(i, 0)]);
            result[joint].push(LeftOut { part: parts[joint][index].clone(), residual: residual.collect() });
        }
    }
    Ok(result)
}

/// One over the mean square of the residual; nothing for a joint without residual, which needs no change.
fn weight(rows: &Rows) -> f64 {
    let squares: f64 = rows.residual.iter().map(|residual| residual * residual).sum();
    if squares > 0.0 { rows.residual.len() as f64 / squares } else { 0.0 }
}

/// Log and sample with which each part starts.
fn edges(logs: &[LogResidual]) -> Vec<(usize, usize)> {
    if logs.len() >= FEWEST_LOGS {
        return (0..logs.len()).map(|log| (log, 0)).collect();
    }
    let all: Vec<(usize, usize)> =
        logs.iter().enumerate().flat_map(|(log, residual)| (0..residual.time.len()).map(move |k| (log, k))).collect();
    (0..PARTS).map(|part| all[part * all.len() / PARTS]).collect()
}

/// Rows of each part.
fn parts(rows: &Rows, edges: &[(usize, usize)]) -> Vec<Range<usize>> {
    let first = |edge: &(usize, usize)| rows.source.partition_point(|source| source < edge);
    let ends = edges[1..].iter().map(first).chain([rows.source.len()]);
    edges.iter().map(first).zip(ends).map(|(start, end)| start..end).collect()
}
