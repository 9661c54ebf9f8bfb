//! What is reported of a motion's observation matrix.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::criterion::SINGULAR;
use super::information::{BesideBase, Information, require_noise};
use super::{ExcitationError, NominalEffects, TrajectorySamples};
use crate::identification::{BaseParameters, ParameterSet};
use crate::linalg::{Svd, TriangularFactor};
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// How well a motion excites the base parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ExcitationReport {
    /// cond(W); infinite if a base parameter is not excited.
    pub condition: f64,
    /// cond(W) with every column scaled to unit length.
    pub scaled_condition: f64,
    /// |W|_F |W⁺|_F.
    pub frobenius_condition: f64,
    /// cond of the columns of each link with the friction of its joint; one for a link without.
    pub link_conditions: Vec<f64>,
    /// log det(Wᵀ Σ⁻¹ W) per sample.
    pub log_determinant: f64,
    /// Singular values of W, largest first.
    pub singular_values: Vec<f64>,
    /// Number of base parameters that are excited, with every column of W scaled to unit length.
    pub rank: usize,
    /// Names of the parameters that the motion cannot tell from each other; none if all are
    /// excited.
    pub not_told_apart: Vec<String>,
}

impl ExcitationReport {
    /// Sum of `link_conditions` over the links that have base parameters (thesis eq. 3-13).
    pub fn sum_of_conditions(&self) -> f64 {
        self.link_conditions.iter().filter(|condition| !condition.is_nan()).sum()
    }
}

/// Share of a direction that W does not see, above which a parameter is named.
const TAKES_PART: f64 = 0.05;

/// What `samples` reveal of the base parameters and of effects at nominal values; friction with its
/// true sign function.
///
/// - `samples`: evenly spaced where there are nominal effects
/// - `noise`: standard deviations of the torque, `[n]`, N·m (N); all one if `None`
///
/// # Errors
/// If `noise` has another length than the joints or a value that is not above zero.
pub fn evaluate(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    nominal: Option<&NominalEffects>,
    samples: &TrajectorySamples,
    noise: Option<&[f64]>,
) -> Result<ExcitationReport, ExcitationError> {
    require_noise(robot, noise)?;
    let mut information = Information::new(
        robot,
        set,
        base,
        nominal.map(|nominal| nominal as &dyn BesideBase),
        noise,
        0.0,
    );
    let width = information.parameters();
    let mut factor = TriangularFactor::new(width);
    let n = robot.dof();
    // Effects with memory need the whole motion at once.
    let piece = if width == base.rank() { 256 } else { samples.len() };
    for first in (0..samples.len()).step_by(piece.max(1)) {
        let last = (first + piece).min(samples.len());
        let cut = |values: &[f64]| values[first * n..last * n].to_vec();
        let (q, dq, ddq) = (cut(&samples.q), cut(&samples.dq), cut(&samples.ddq));
        information.observe(&TrajectorySamples {
            time: samples.time[first..last].to_vec(),
            q,
            dq,
            ddq,
        });
        factor.push_all(&information.rows);
    }
    let factor = factor.factor();
    let values = Svd::new(factor.as_ref()).values;
    let condition = |matrix: &Mat<f64>| {
        let values = Svd::new(matrix.as_ref()).values;
        if values.is_empty() { f64::NAN } else { ratio(values[0], values[values.len() - 1]) }
    };
    let columns = |keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<usize> = (0..width).filter(|column| keep(*column)).collect();
        Mat::from_fn(factor.nrows(), kept.len(), |i, j| factor[(i, kept[j])])
    };
    let link_of = |column: usize| {
        let Some(&parameter) = base.independent().get(column) else {
            return nominal.map_or(0, |nominal| nominal.link(column - base.rank()));
        };
        match parameter.checked_sub(set.inertial()) {
            None => parameter / PARAMETERS_PER_LINK,
            Some(index) => set.effect_columns()[index].joint,
        }
    };
    // Columns that are zero come out of the factorisation with rounding, whose direction says
    // nothing.
    let zero = 1e-13 * values[0];
    let scaled = Mat::from_fn(factor.nrows(), width, |i, j| {
        let length = factor.col(j).norm_l2();
        if length > zero { factor[(i, j)] / length } else { 0.0 }
    });
    let scaled = Svd::new(scaled.as_ref());
    let rank =
        scaled.values.iter().filter(|value| **value > SINGULAR.sqrt() * scaled.values[0]).count();
    let in_a_direction =
        |column: usize| (rank..width).any(|k| scaled.v[(column, k)].abs() > TAKES_PART);
    let name = |column: usize| match base.names().get(column) {
        Some(name) => name.clone(),
        None => nominal
            .map_or_else(String::new, |nominal| nominal.names().swap_remove(column - base.rank())),
    };
    let squares = |power: i32| values.iter().map(|value| value.powi(2 * power)).sum::<f64>().sqrt();
    let count = samples.len() as f64;
    Ok(ExcitationReport {
        condition: ratio(values[0], values[values.len() - 1]),
        scaled_condition: ratio(scaled.values[0], scaled.values[width - 1]),
        frobenius_condition: squares(1) * squares(-1),
        link_conditions: (0..n)
            .map(|link| condition(&columns(&|column| link_of(column) == link)))
            .collect(),
        log_determinant: values.iter().map(|value| 2.0 * value.ln() - count.ln()).sum(),
        rank,
        not_told_apart: (0..width).filter(|column| in_a_direction(*column)).map(name).collect(),
        singular_values: values,
    })
}

fn ratio(largest: f64, smallest: f64) -> f64 {
    if smallest > 1e-14 * largest { largest / smallest } else { f64::INFINITY }
}
