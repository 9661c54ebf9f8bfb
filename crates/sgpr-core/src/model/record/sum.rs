//! Records summed: a model, and how far a model is off.

use std::collections::BTreeSet;

use faer::Mat;

use super::super::identify::{
    PARTS, Place, Setup, Source, SourceFactors, parts_of_blocks, require_one_arm,
};
use super::super::torque_model::nominal_parameters;
use super::super::{
    IdentificationReport, IdentifyError, IdentifyOptions, Start, TorqueModel, Uncertainty,
};
use super::{JointExtent, Record, RecordError, RecordMemory};
use crate::identification::{
    BaseParameters, Equations, EstimatorNeeds, JointFactor, ParameterSet, piece_of, residual_norm,
    rows_per_independent_row, stacked,
};
use crate::linalg::Matrix;
use crate::progress::Progress;
use crate::robot::Robot;

/// Identifies the torque model of `robot` from records: what [`identify`](super::super::identify)
/// finds in the logs that they were made of, processed alike.
///
/// Everything that estimators make of triangular factors works: least squares, a pull toward the
/// robot file, total least squares; priors, physical consistency, essential parameters. Effects and
/// processing are those of the records; what [`IdentifyOptions`] says of these does not count.
/// Parts of the data that are left out are whole blocks: those of the logs, with records of five
/// blocks each.
///
/// Records without products of all columns ([`RecordOptions::lags`](super::RecordOptions::lags))
/// speak for the memory of the residual by that of their own solution. Records are summed in an
/// order of their own, so that the model has the same bits in whatever order they come.
///
/// # Errors
/// If a record is of another robot, the records differ in effects or processing, an option needs
/// single rows, or the records hold too little.
pub fn identify_records(
    robot: &Robot,
    records: &[&Record],
    options: &IdentifyOptions,
) -> Result<(TorqueModel, IdentificationReport), RecordError> {
    require_sums(options)?;
    let (set, base) = check(robot, records)?;
    let (records, copies) = ordered(records);
    let source = RecordSums { base: &base, records: &records };
    if let Some(older) =
        records.iter().find(|record| options.prior.is_some() && record.extents.is_empty())
    {
        return Err(RecordError::Older {
            source_name: older.source.clone(),
            version: older.library_version.clone(),
        });
    }
    require_one_arm(options)?;
    let effects = records[0].effects.clone();
    let (options, processing) =
        (&IdentifyOptions { effects, ..options.clone() }, &records[0].processing);
    let start = match options.start {
        Start::RobotFile => nominal_parameters(robot, &set),
        Start::Zero => vec![0.0; set.len()],
    };
    let nominal = base.combine(&start);
    let setup = Setup {
        robot,
        options,
        processing,
        source: &source,
        set: &set,
        base: &base,
        start: &start,
        nominal,
    };
    let mut model = TorqueModel::from_parameters(robot.clone(), set.clone(), start.clone(), vec![]);
    let outcome = setup.fit(&mut model, &mut Equations::new(robot, &set, &base, vec![]), &())?;
    let mut logs: Vec<String> = records.iter().map(|record| record.source.clone()).collect();
    logs.dedup();
    model.provenance.logs = logs;
    let samples = records.iter().map(|record| record.samples).sum();
    let report = outcome.report(&model, copies, samples);
    Ok((model, report))
}

/// Refuses what looks at single rows.
fn require_sums(options: &IdentifyOptions) -> Result<(), RecordError> {
    let needs_rows = |what: &str| Err(RecordError::NeedsRows { what: what.into() });
    match options.uncertainty {
        Uncertainty::Memory if options.method.needs() == EstimatorNeeds::Factors => {}
        Uncertainty::Memory => return needs_rows(options.method.title()),
        Uncertainty::Hac => return needs_rows("uncertainty `hac`"),
        Uncertainty::Bootstrap { .. } => return needs_rows("uncertainty `bootstrap`"),
    }
    if options.forecast {
        return needs_rows("a forecast of how much data is enough");
    }
    if !options.instruments.is_empty() || options.controller.is_some() {
        return needs_rows("an estimate with instruments or a controller");
    }
    Ok(())
}

/// Records as where equations come from.
struct RecordSums<'a> {
    base: &'a BaseParameters,
    records: &'a [&'a Record],
}

impl<'a> RecordSums<'a> {
    /// Blocks of all records, put together by the part that each belongs to.
    fn by_part(&self, parts: usize, part: impl Fn(usize, usize) -> usize) -> Vec<Vec<JointFactor>> {
        let mut of_parts: Vec<Vec<&JointFactor>> = vec![vec![]; parts];
        for (index, record) in self.records.iter().enumerate() {
            for (block, of_block) in record.blocks.iter().enumerate() {
                of_parts[part(index, block)].extend(&of_block.factors);
            }
        }
        of_parts.into_iter().map(stacked).collect()
    }

    fn consecutive(&self, parts: usize) -> Vec<Vec<JointFactor>> {
        let places: Vec<Place<'_>> = self.records.iter().map(|record| place_of(record)).collect();
        let of_blocks = parts_of_blocks(&places, parts);
        self.by_part(parts, |record, block| of_blocks[record][block])
    }
}

/// Where a record stands among others.
pub(super) fn place_of(record: &Record) -> Place<'_> {
    let Record { source, time, key, samples, blocks, .. } = record;
    Place { source, time: *time, key: *key, samples: *samples, blocks: blocks.len() }
}

impl Source for RecordSums<'_> {
    fn factors(
        &self,
        parts: usize,
        _progress: &dyn Progress,
    ) -> Result<SourceFactors, IdentifyError> {
        // A long log is in several records, one after the other.
        let logs: Vec<_> = self.records.chunk_by(|one, next| one.source == next.source).collect();
        let of_log = |records: &&[&Record]| {
            (
                records[0].source.clone(),
                stacked(records.iter().flat_map(|record| factors_of(record))),
            )
        };
        let several = if logs.len() > 1 { &logs[..] } else { &[] };
        Ok(SourceFactors {
            parts: self.consecutive(parts),
            logs: several.iter().map(of_log).collect(),
        })
    }

    /// Consecutive parts of all logs where a record has too few blocks.
    fn folds(&self) -> Result<Vec<Vec<JointFactor>>, IdentifyError> {
        let blocks = |record: usize| self.records[record].blocks.len();
        if (0..self.records.len()).any(|record| blocks(record) < PARTS) {
            return Ok(self.consecutive(PARTS));
        }
        Ok(self.by_part(PARTS, |record, block| piece_of(block, blocks(record), PARTS)))
    }

    fn correlation(
        &self,
        model: &TorqueModel,
        factors: &[JointFactor],
    ) -> Result<Vec<f64>, IdentifyError> {
        Ok(correlation(self.records, factors, &self.base.combine(model.parameters())))
    }

    fn extents(&self) -> Vec<JointExtent> {
        let mut extents = self.records[0].extents.clone();
        for record in &self.records[1..] {
            extents.iter_mut().zip(&record.extents).for_each(|(extent, other)| extent.add(other));
        }
        extents
    }
}

/// How far a model is off on the rows of records, one joint.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RecordedError {
    /// Rows at which the joint moves.
    pub rows: usize,
    /// Root mean square of measured minus predicted torque, in the band of the records, N·m (N).
    pub rmse: f64,
    /// Root mean square of the measured torque, N·m (N).
    pub torque: f64,
}

/// The error of `model` on the rows of records at which joints move, joint by joint, without the
/// logs.
///
/// # Errors
/// If a record is of another robot or lacks an effect of the model.
pub fn compare_records(
    model: &TorqueModel,
    records: &[&Record],
) -> Result<Vec<RecordedError>, RecordError> {
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
pub(super) fn parameters_in(
    model: &TorqueModel,
    set: &ParameterSet,
    record: &Record,
) -> Result<Vec<f64>, RecordError> {
    let missing = |parameter: &str| {
        let source_name = record.source.clone();
        RecordError::OtherParameters { parameter: parameter.into(), source_name }
    };
    if let Some(term) = model.terms().first() {
        return Err(missing(term.effect.name()));
    }
    let mut parameters = vec![0.0; set.len()];
    for (name, value) in model.parameter_set().names().iter().zip(model.parameters()) {
        let index =
            set.names().iter().position(|other| other == name).ok_or_else(|| missing(name))?;
        parameters[index] = *value;
    }
    Ok(parameters)
}

/// Whether records can be summed for this robot, and what their columns mean.
pub(super) fn check(
    robot: &Robot,
    records: &[&Record],
) -> Result<(ParameterSet, BaseParameters), RecordError> {
    let first = records.first().ok_or(RecordError::NoRecord)?;
    let expected = robot.fingerprint();
    for record in records {
        let differs = |what| RecordError::Different {
            first: first.source.clone(),
            other: record.source.clone(),
            what,
        };
        if record.robot != expected {
            let (source_name, found) = (record.source.clone(), record.robot.clone());
            return Err(RecordError::OtherRobot {
                source_name,
                found,
                robot: robot.name().into(),
                expected,
            });
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
        if factors_of(record).any(joint)
            || columns.iter().any(|own| own.last().is_some_and(|k| *k >= base.rank()))
        {
            let message = format!(
                "{}: columns that the equations of `{}` do not have",
                record.source,
                robot.name()
            );
            return Err(RecordError::Malformed { message });
        }
        let own_columns = |memory: &RecordMemory| {
            let width = memory.sums.first().map_or(1, Matrix::ncols);
            let same = |factor: &&JointFactor| {
                (factor.joint, factor.resting) == (memory.joint, memory.resting)
            };
            width == 1
                || factors_of(record)
                    .find(same)
                    .is_some_and(|factor| factor.columns.len() + 1 == width)
        };
        if record.center.len() != base.rank() || !record.memory.iter().all(own_columns) {
            let message = format!(
                "{}: its memory is not that of the equations of `{}`",
                record.source,
                robot.name()
            );
            return Err(RecordError::Malformed { message });
        }
    }
    Ok((set, base))
}

pub(super) fn factors_of(record: &Record) -> impl Iterator<Item = &JointFactor> {
    record.blocks.iter().flat_map(|block| &block.factors)
}

/// What is to be said of records that are copies of others: they count once.
pub fn copies_among(records: &[&Record]) -> Vec<String> {
    ordered(records).1
}

/// The records in the order of time, each once, and what is to be said of the copies.
pub(super) fn ordered<'a>(records: &[&'a Record]) -> (Vec<&'a Record>, Vec<String>) {
    let mut sorted = records.to_vec();
    sorted
        .sort_by(|a, b| (a.time, a.identity(), &a.source).cmp(&(b.time, b.identity(), &b.source)));
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

/// Per factor: rows that carry as much as one independent row, of the residual that `values` leave
/// in all records.
pub(super) fn correlation(
    records: &[&Record],
    factors: &[JointFactor],
    values: &[f64],
) -> Vec<f64> {
    let of_factor = |factor: &JointFactor| {
        let mut products: Vec<(f64, usize)> = Vec::new();
        for record in records {
            let same = |memory: &&RecordMemory| {
                (memory.joint, memory.resting) == (factor.joint, factor.resting)
            };
            for memory in record.memory.iter().filter(same) {
                products.resize(products.len().max(memory.sums.len()), (0.0, 0));
                // The residual is that of the centre less the columns times what the values are off
                // from it.
                let off =
                    factor.columns.iter().map(|&column| record.center[column] - values[column]);
                let mut residual: Vec<f64> = off.chain([1.0]).collect();
                for (product, (sum, count)) in
                    products.iter_mut().zip(memory.sums.iter().zip(&memory.counts))
                {
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
    let column =
        |j: usize| vector.iter().enumerate().map(|(i, value)| value * matrix[(i, j)]).sum::<f64>();
    vector.iter().enumerate().map(|(j, value)| value * column(j)).sum()
}
