//! What changed in an arm since its reference model, part by part of a log.
//!
//! The rigid body and all other joints stay those of the reference; what a part of a log says
//! against it is fitted joint by joint with the few parameters that change in service: those of the
//! joint's own effects, and the gain of its torque. A tool shows at all joints at once, in the mass
//! and the first moments that the last link gains.

use faer::Mat;

use super::super::TorqueModel;
use super::sum::{check, correlation, parameters_in};
use super::{Record, RecordBlock, RecordError};
use crate::identification::{BaseParameters, JointFactor, ParameterSet, stacked};
use crate::linalg::triangle;
use crate::spatial::PARAMETERS_PER_LINK;

/// What a log, or a part of it, says against a reference model.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Deviation {
    /// Joints with rows in motion.
    pub joints: Vec<JointDeviation>,
    /// Mass that the last link seems to carry beyond the reference, kg ...
    pub tool_mass: f64,
    /// ... and its standard deviation; infinite where no joint feels it.
    pub tool_mass_deviation: f64,
    /// Share of the residual, weighted by the noise of each joint, that the tool explains.
    pub tool_share: f64,
}

/// What a part of a log says about a joint.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct JointDeviation {
    /// Joint.
    pub joint: usize,
    /// Rows at which it moves.
    pub rows: usize,
    /// Rows that carry as much as one independent row.
    pub memory: f64,
    /// Root mean square torque, N·m (N).
    pub torque: f64,
    /// Root mean square residual of the reference, N·m (N).
    pub error: f64,
    /// The same after the effects of the joint are fitted, N·m (N).
    pub error_after: f64,
    /// The same if nothing but mass and first moments of the last link had changed, at all joints
    /// alike, N·m (N).
    pub error_with_tool: f64,
    /// Parameters of the joint's effects; the gain of the torque comes last.
    pub parameters: Vec<ParameterDeviation>,
}

/// How far a parameter is from the reference.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ParameterDeviation {
    /// `joint_3.Fc`; `joint_3.gain`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Value of the reference.
    pub reference: f64,
    /// Change, all effects of the joint fitted together; the gain is fitted alone.
    pub change: f64,
    /// Its standard deviation; infinite where the motion does not determine it.
    pub standard_deviation: f64,
    /// Root mean square residual if this parameter alone had changed, N·m (N).
    pub error_alone: f64,
}

/// What a record says against `model`: each of its blocks, or all of it.
///
/// # Errors
/// As [`compare_records`](super::compare_records).
pub fn deviations(
    model: &TorqueModel,
    record: &Record,
    by_block: bool,
) -> Result<Vec<Deviation>, RecordError> {
    let (set, base) = check(model.robot(), &[record])?;
    let parameters = parameters_in(model, &set, record)?;
    let reference =
        ReferenceModel { set: &set, values: base.combine(&parameters), parameters, base: &base };
    let moving = |blocks: &[RecordBlock]| -> Vec<JointFactor> {
        let factors =
            blocks.iter().flat_map(|block| &block.factors).filter(|factor| !factor.resting);
        stacked(factors)
    };
    let at_once = if by_block { 1 } else { record.blocks.len() };
    Ok(record
        .blocks
        .chunks(at_once)
        .map(|blocks| reference.deviation(record, &moving(blocks)))
        .collect())
}

struct ReferenceModel<'a> {
    set: &'a ParameterSet,
    base: &'a BaseParameters,
    parameters: Vec<f64>,
    /// Base parameters.
    values: Vec<f64>,
}

impl ReferenceModel<'_> {
    fn deviation(&self, record: &Record, factors: &[JointFactor]) -> Deviation {
        let memory = correlation(&[record], factors, &record.center);
        let mut joints: Vec<JointDeviation> =
            factors.iter().zip(memory).map(|(factor, memory)| self.joint(factor, memory)).collect();
        let (tool_mass, tool_mass_deviation, tool_share) = self.tool(factors, &mut joints);
        Deviation { joints, tool_mass, tool_mass_deviation, tool_share }
    }

    fn joint(&self, factor: &JointFactor, memory: f64) -> JointDeviation {
        let predicted = predicted(factor, &self.values);
        let residual: Vec<f64> =
            torque(factor).iter().zip(&predicted).map(|(tau, model)| tau - model).collect();
        let of_effects = self.set.effect_parameters_of(factor.joint);
        let own: Vec<(usize, Vec<f64>)> = factor
            .columns
            .iter()
            .enumerate()
            .map(|(k, &column)| (k, self.base.independent()[column]))
            .filter(|(_, parameter)| of_effects.contains(parameter))
            .map(|(k, parameter)| (parameter, factor.factor.col(k).iter().copied().collect()))
            .collect();
        let columns: Vec<&[f64]> = own.iter().map(|(_, column)| &column[..]).collect();
        let together = SmallFit::new(&columns, &residual, factor.rows, memory);
        let mean_root = |squares: f64| (squares / f64::max(factor.rows as f64, 1.0)).sqrt();
        let alone = |column: &[f64]| SmallFit::new(&[column], &residual, factor.rows, memory);
        let deviation =
            |(k, (parameter, column)): (usize, &(usize, Vec<f64>))| ParameterDeviation {
                name: self.set.names()[*parameter].clone(),
                unit: self.set.units()[*parameter],
                reference: self.parameters[*parameter],
                change: together.changes[k],
                standard_deviation: together.deviations[k],
                error_alone: mean_root(alone(column).left),
            };
        let mut parameters: Vec<ParameterDeviation> =
            own.iter().enumerate().map(deviation).collect();
        let gain = alone(&predicted);
        let joint = self.set.names()[factor.joint * PARAMETERS_PER_LINK]
            .rsplit_once('.')
            .map_or("", |(name, _)| name);
        parameters.push(ParameterDeviation {
            name: format!("{joint}.gain"),
            unit: "",
            reference: 1.0,
            change: gain.changes[0],
            standard_deviation: gain.deviations[0],
            error_alone: mean_root(gain.left),
        });
        JointDeviation {
            joint: factor.joint,
            rows: factor.rows,
            memory,
            torque: mean_root(squares(&torque(factor))),
            error: mean_root(squares(&residual)),
            error_after: mean_root(together.left),
            error_with_tool: f64::INFINITY,
            parameters,
        }
    }

    /// Mass of the last link beyond the reference, its standard deviation, and the share of the
    /// residual that mass and first moments explain; sets what they leave at each joint.
    fn tool(&self, factors: &[JointFactor], joints: &mut [JointDeviation]) -> (f64, f64, f64) {
        const MASS_AND_MOMENTS: usize = 4;
        let first = self.set.inertial() - PARAMETERS_PER_LINK;
        let directions: Vec<Vec<f64>> = (first..first + MASS_AND_MOMENTS)
            .map(|parameter| {
                let unit: Vec<f64> =
                    (0..self.set.len()).map(|k| f64::from(u8::from(k == parameter))).collect();
                self.base.combine(&unit)
            })
            .collect();
        let (mut columns, mut residual) = (vec![Vec::new(); MASS_AND_MOMENTS], Vec::new());
        let (mut rows, mut weighted_memory) = (0, 0.0);
        let noise_of = |joint: &JointDeviation| {
            joint.error_after.max(1e-9 * joint.torque).max(f64::MIN_POSITIVE)
        };
        for (factor, joint) in factors.iter().zip(joints.iter()) {
            let noise = noise_of(joint);
            let model = predicted(factor, &self.values);
            residual.extend(
                torque(factor).iter().zip(&model).map(|(tau, model)| (tau - model) / noise),
            );
            for (column, direction) in columns.iter_mut().zip(&directions) {
                column.extend(predicted(factor, direction).iter().map(|value| value / noise));
            }
            rows += factor.rows;
            weighted_memory += joint.memory * factor.rows as f64;
        }
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let fit =
            SmallFit::new(&columns, &residual, rows, weighted_memory / f64::max(rows as f64, 1.0));
        let share = 1.0 - fit.left / squares(&residual).max(f64::MIN_POSITIVE);
        let mut first = 0;
        for (factor, joint) in factors.iter().zip(joints) {
            let rows = first..first + factor.factor.nrows();
            let explained = |row: usize| -> f64 {
                columns.iter().zip(&fit.changes).map(|(column, change)| column[row] * change).sum()
            };
            let left: f64 = rows.clone().map(|row| (residual[row] - explained(row)).powi(2)).sum();
            joint.error_with_tool =
                noise_of(joint) * (left / f64::max(factor.rows as f64, 1.0)).sqrt();
            first = rows.end;
        }
        (fit.changes[0], fit.deviations[0], share.clamp(0.0, 1.0))
    }
}

fn squares(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

/// The last column of a factor.
fn torque(factor: &JointFactor) -> Vec<f64> {
    factor.factor.col(factor.columns.len()).iter().copied().collect()
}

/// The rows of a factor times base parameters.
pub(super) fn predicted(factor: &JointFactor, base: &[f64]) -> Vec<f64> {
    let row = |i: usize| {
        let columns = factor.columns.iter().enumerate();
        columns.map(|(k, &column)| factor.factor[(i, k)] * base[column]).sum()
    };
    (0..factor.factor.nrows()).map(row).collect()
}

/// Least squares of a few columns; what they do not determine does not change.
struct SmallFit {
    changes: Vec<f64>,
    deviations: Vec<f64>,
    /// Squares that are left.
    left: f64,
}

impl SmallFit {
    /// - `rows`: that the columns stand for
    /// - `memory`: rows that carry as much as one independent row
    fn new(columns: &[&[f64]], residual: &[f64], rows: usize, memory: f64) -> Self {
        /// Share of a column beyond which the others do not follow it.
        const OWN: f64 = 1e-4;
        let mut kept: Vec<usize> = (0..columns.len()).collect();
        let factor = loop {
            let column = |j: usize| kept.get(j).map_or(residual, |&k| columns[k]);
            let factor = triangle(
                Mat::from_fn(residual.len(), kept.len() + 1, |i, j| column(j)[i]).as_ref(),
            );
            let lost =
                (0..kept.len()).find(|&j| factor[(j, j)] <= OWN * squares(columns[kept[j]]).sqrt());
            match lost {
                Some(j) => drop(kept.remove(j)),
                None => break factor,
            }
        };
        let p = kept.len();
        let left = factor[(p, p)].powi(2);
        let variance = left / f64::max(rows as f64 - p as f64, 1.0) * memory;
        let (mut changes, mut deviations) =
            (vec![0.0; columns.len()], vec![f64::INFINITY; columns.len()]);
        let solution = solved(&factor, p, |i| factor[(i, p)]);
        for (j, &k) in kept.iter().enumerate() {
            changes[k] = solution[j];
        }
        // The inverse of the triangle, column by column; its rows make the diagonal of the inverse
        // Gram matrix.
        let mut inverse_gram = vec![0.0; p];
        for unit in 0..p {
            let column = solved(&factor, p, |i| f64::from(u8::from(i == unit)));
            inverse_gram.iter_mut().zip(column).for_each(|(sum, value)| *sum += value * value);
        }
        for (&k, diagonal) in kept.iter().zip(&inverse_gram) {
            deviations[k] = (variance * diagonal).sqrt();
        }
        Self { changes, deviations, left }
    }
}

/// Back substitution in the first columns of an upper triangle.
fn solved(factor: &Mat<f64>, size: usize, right: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut x: Vec<f64> = (0..size).map(right).collect();
    for j in (0..size).rev() {
        x[j] /= factor[(j, j)];
        for i in 0..j {
            x[i] -= factor[(i, j)] * x[j];
        }
    }
    x
}
