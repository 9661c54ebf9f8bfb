//! Records summed: a model, and how far a model is off.

use std::collections::{BTreeMap, BTreeSet};

use faer::Mat;

use super::super::torque_model::{Fit, nominal_parameters};
use super::super::{IdentifyError, TorqueModel};
use super::{Record, RecordError, RecordMemory};
use crate::identification::{
    BaseParameters, Dispersion, Estimate, JointFactor, LeastSquares, Method, ParameterSet, residual_norm,
    rows_per_independent_row, screen_factors,
};
use crate::linalg::triangle;
use crate::robot::Robot;

/// Identifies the torque model of `robot` from records: what [`identify`](super::super::identify) finds without a prior in
/// the logs that they were made of, processed alike.
///
/// Records without products of all columns ([`RecordOptions::lags`](super::RecordOptions::lags)) speak for the memory of the
/// residual by that of their own solution. Records are summed in an order of their own, so that the model has the same bits
/// in whatever order they come. The warnings come beside the model.
///
/// # Errors
/// If a record is of another robot, the records differ in effects or processing, `method` needs single rows, or the
/// records hold too little.
pub fn identify_records(
    robot: &Robot,
    records: &[&Record],
    method: &Method,
) -> Result<(TorqueModel, Vec<String>), RecordError> {
    if !matches!(method, Method::Ols | Method::Wls | Method::WlsKnown(_)) {
        return Err(RecordError::NeedsRows { what: method.title().into() });
    }
    let (set, base) = check(robot, records)?;
    let (records, mut notes) = ordered(records);
    let all: Vec<&JointFactor> = records.iter().flat_map(|record| factors_of(record)).collect();
    let factors = stacked(&all);
    let start = nominal_parameters(robot, &set);
    let nominal = base.combine(&start);
    // The residual of a first solution tells how much the noise remembers: the estimates stay, their spread grows.
    let mut solver = LeastSquares::new(method.clone());
    let first = solver.solve(&factors, &base, &nominal).map_err(IdentifyError::from)?;
    let correlation = correlation(&records, &factors, &first.values);
    solver.correlation = Some(correlation.clone());
    let estimate = solver.solve(&factors, &base, &nominal).map_err(IdentifyError::from)?;
    notes.extend(estimate.notes.iter().cloned());
    notes.extend(screen_factors(&set, &base, &records[0].joints, &factors, &estimate).iter().map(ToString::to_string));
    let rows: usize = factors.iter().map(|factor| factor.rows).sum();
    let history = format!("identified by {} from {rows} rows of {} records", method.title(), records.len());
    let parameters = base.expand(&estimate.values, &start);
    let mut model = TorqueModel::from_parameters(robot.clone(), set, parameters, vec![history]);
    model.fit = Some(fit(&estimate, &base, &factors, &correlation, (robot.dof(), method)));
    model.processing = Some(records[0].processing.clone());
    let mut logs: Vec<String> = records.iter().map(|record| record.source.clone()).collect();
    logs.dedup();
    model.provenance.logs = logs;
    Ok((model, notes))
}

pub(super) fn fit(
    estimate: &Estimate,
    base: &BaseParameters,
    factors: &[JointFactor],
    correlation: &[f64],
    (joints, method): (usize, &Method),
) -> Fit {
    let deviations = estimate.standard_deviations();
    let infinite = base.names().iter().zip(&deviations).filter(|(_, deviation)| deviation.is_infinite());
    let per_joint = |figures: &[f64]| -> Vec<f64> {
        let of = |joint| factors.iter().position(|factor| factor.joint == joint).map_or(0.0, |index| figures[index]);
        (0..joints).map(of).collect()
    };
    let rows = |joint| factors.iter().filter(|factor| factor.joint == joint).map(|factor| factor.rows).sum();
    let rank = base.rank();
    Fit {
        method: method.name().into(),
        values: estimate.values.clone(),
        covariance: (0..rank * rank).map(|k| estimate.covariance[(k / rank, k % rank)]).collect(),
        covariance_with_terms: vec![],
        noise: per_joint(&estimate.noise),
        rows: (0..joints).map(rows).collect(),
        correlation: per_joint(correlation),
        dispersion: Dispersion::NONE.deviation,
        half_interval_95: Dispersion::NONE.half_interval_95,
        condition: estimate.excitation.condition,
        scaled_condition: estimate.excitation.scaled_condition,
        undetermined: infinite.map(|(name, _)| name.clone()).collect(),
        standard_deviations: deviations,
        consistency: None,
    }
}

/// How far a model is off on the rows of records, one joint.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedError {
    /// Rows at which the joint moves.
    pub rows: usize,
    /// Root mean square of measured minus predicted torque, in the band of the records, N·m (N).
    pub rmse: f64,
    /// Root mean square of the measured torque, N·m (N).
    pub torque: f64,
}

/// The error of `model` on the rows of records at which joints move, joint by joint, without the logs.
///
/// # Errors
/// If a record is of another robot or lacks an effect of the model.
pub fn compare_records(model: &TorqueModel, records: &[&Record]) -> Result<Vec<RecordedError>, RecordError> {
    let robot = model.robot();
    let (set, base) = check(robot, records)?;
    let values = base.combine(&parameters_in(model, &set, records[0])?);
    let (records, _) = ordered(records);
    let error = |joint: usize| {
        let (mut rows, mut residual, mut torque) = (0, 0.0, 0.0);
        let own = |factor: &&JointFactor| factor.joint == joint && !factor.resting;
        for factor in records.iter().flat_map(|record| factors_of(record)).filter(own) {
            rows += factor.rows;
            residual += residual_norm(factor, &values).powi(2);
            torque += factor.factor.col(factor.columns.len()).squared_norm_l2();
        }
        let mean_root = |squares: f64| (squares / f64::max(rows as f64, 1.0)).sqrt();
        RecordedError { rows, rmse: mean_root(residual), torque: mean_root(torque) }
    };
    Ok((0..robot.dof()).map(error).collect())
}

/// The parameters of a model in a set that has more.
pub(super) fn parameters_in(model: &TorqueModel, set: &ParameterSet, record: &Record) -> Result<Vec<f64>, RecordError> {
    let missing = |parameter: &str| {
        let source_name = record.source.clone();
        RecordError::OtherParameters { parameter: parameter.into(), source_name }
    };
    if let Some(term) = model.terms().first() {
        return Err(missing(term.effect.name()));
    }
    let mut parameters = vec![0.0; set.len()];
    for (name, value) in model.parameter_set().names().iter().zip(model.parameters()) {
        let index = set.names().iter().position(|other| other == name).ok_or_else(|| missing(name))?;
        parameters[index] = *value;
    }
    Ok(parameters)
}

/// Whether records can be summed for this robot, and what their columns mean.
pub(super) fn check(robot: &Robot, records: &[&Record]) -> Result<(ParameterSet, BaseParameters), RecordError> {
    let first = records.first().ok_or(RecordError::NoRecord)?;
    let expected = robot.fingerprint();
    for record in records {
        let differs = |what| RecordError::Different { first: first.source.clone(), other: record.source.clone(), what };
        if record.robot != expected {
            let (source_name, found) = (record.source.clone(), record.robot.clone());
            return Err(RecordError::OtherRobot { source_name, found, robot: robot.name().into(), expected });
        }
        if record.effects != first.effects {
            return Err(differs("effects"));
        }
        if record.processing != first.processing {
            return Err(differs("processing"));
        }
    }
    let set = ParameterSet::new(robot, &first.effects).map_err(IdentifyError::from)?;
    let base = BaseParameters::new(robot, &set);
    for record in records {
        let columns: Vec<&Vec<usize>> = factors_of(record).map(|factor| &factor.columns).collect();
        let joint = |factor: &JointFactor| factor.joint >= robot.dof();
        if factors_of(record).any(joint) || columns.iter().any(|own| own.last().is_some_and(|k| *k >= base.rank())) {
            let message = format!("{}: columns that the equations of `{}` do not have", record.source, robot.name());
            return Err(RecordError::Malformed { message });
        }
        let own_columns = |memory: &RecordMemory| {
            let width = memory.sums.first().map_or(1, Mat::ncols);
            let same = |factor: &&JointFactor| (factor.joint, factor.resting) == (memory.joint, memory.resting);
            width == 1 || factors_of(record).find(same).is_some_and(|factor| factor.columns.len() + 1 == width)
        };
        if record.center.len() != base.rank() || !record.memory.iter().all(own_columns) {
            let message = format!("{}: its memory is not that of the equations of `{}`", record.source, robot.name());
            return Err(RecordError::Malformed { message });
        }
    }
    Ok((set, base))
}

fn factors_of(record: &Record) -> impl Iterator<Item = &JointFactor> {
    record.blocks.iter().flat_map(|block| &block.factors)
}

/// The records in the order of time, each once, and what is to be said of the copies.
fn ordered<'a>(records: &[&'a Record]) -> (Vec<&'a Record>, Vec<String>) {
    let mut sorted = records.to_vec();
    sorted.sort_by(|a, b| (a.time, a.identity(), &a.source).cmp(&(b.time, b.identity(), &b.source)));
    let (mut seen, mut notes) = (BTreeSet::new(), Vec::new());
    sorted.retain(|record| {
        let new = seen.insert(record.identity());
        if !new {
            notes.push(format!(
                "{} is a copy of another record's log and is left out: it would count twice",
                record.source
            ));
        }
        new
    });
    (sorted, notes)
}

/// One factor for all rows of each joint and kind: joints in motion, then joints at rest.
pub(super) fn stacked(factors: &[&JointFactor]) -> Vec<JointFactor> {
    let mut groups: BTreeMap<(bool, usize), Vec<&JointFactor>> = BTreeMap::new();
    for factor in factors {
        groups.entry((factor.resting, factor.joint)).or_default().push(factor);
    }
    groups.into_values().map(|group| reduced(&group)).collect()
}

/// Factors below each other, reduced in pieces that stay in the cache.
fn reduced(group: &[&JointFactor]) -> JointFactor {
    const AT_ONCE: usize = 16;
    let width = group[0].factor.ncols();
    let mut factor = group[0].factor.clone();
    for part in group[1..].chunks(AT_ONCE) {
        let mut all = Mat::zeros((part.len() + 1) * width, width);
        for (k, one) in std::iter::once(&factor).chain(part.iter().map(|one| &one.factor)).enumerate() {
            all.as_mut().subrows_mut(k * width, width).copy_from(one);
        }
        factor = triangle(all.as_ref());
    }
    JointFactor { factor, rows: group.iter().map(|one| one.rows).sum(), ..group[0].clone() }
}

/// Per factor: rows that carry as much as one independent row, of the residual that `values` leave in all records.
pub(super) fn correlation(records: &[&Record], factors: &[JointFactor], values: &[f64]) -> Vec<f64> {
    let of_factor = |factor: &JointFactor| {
        let mut products: Vec<(f64, usize)> = Vec::new();
        for record in records {
            let same = |memory: &&RecordMemory| (memory.joint, memory.resting) == (factor.joint, factor.resting);
            for memory in record.memory.iter().filter(same) {
                products.resize(products.len().max(memory.sums.len()), (0.0, 0));
                // The residual is that of the centre less the columns times what the values are off from it.
                let off = factor.columns.iter().map(|&column| record.center[column] - values[column]);
                let mut residual: Vec<f64> = off.chain([1.0]).collect();
                for (product, (sum, count)) in products.iter_mut().zip(memory.sums.iter().zip(&memory.counts)) {
                    residual.drain(..residual.len().saturating_sub(sum.ncols()));
                    *product = (product.0 + quadratic(sum, &residual), product.1 + count);
                }
            }
        }
        rows_per_independent_row(&products)
    };
    factors.iter().map(of_factor).collect()
}

/// vector' matrix vector.
fn quadratic(matrix: &Mat<f64>, vector: &[f64]) -> f64 {
    let column = |j: usize| vector.iter().enumerate().map(|(i, value)| value * matrix[(i, j)]).sum::<f64>();
    vector.iter().enumerate().map(|(j, value)| value * column(j)).sum()
}
