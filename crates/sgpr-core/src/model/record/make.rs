//! From a log to its record.

use std::collections::BTreeMap;
use std::sync::Arc;

use derive_setters::Setters;

use super::super::IdentifyError;
use super::super::experiment::{Experiment, TermColumns, require_torque, select_joints};
use super::super::limits::beyond_limits;
use super::super::torque_model::nominal_parameters;
use super::super::torque_scale;
use super::super::variable_projection;
use super::suspects::{columns_of, suspects_of};
use super::{JointExtent, Record, RecordBlock, RecordError, RecordFinding, RecordMemory};
use crate::identification::{
    BaseParameters, Equation, Equations, Finding, JointFactor, KeptRows, LagProducts, LeastSquares,
    Method, Observation, ParameterSet, Row, ShiftedTorques, Trajectory, piece_of, screen_factors,
    screen_scale, stacked,
};
use crate::linalg::Matrix;
use crate::model::identify::key_of;
use crate::motion::{Conditioning, Motion, Processing};
use crate::recording::{Issue, Recording, inspect};
use crate::robot::Robot;

/// What goes into a record.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct RecordOptions {
    /// Names of effects beside the rigid body, each a linear function of the present motion and at
    /// every joint.
    pub effects: Vec<String>,
    /// Parts of equal length that keep factors of their own, at least one.
    pub blocks: usize,
    /// Part of the log that counts, `[start, end)`, ns: what is before and after only settles
    /// filters. All of it if `None`.
    pub counted: Option<[i64; 2]>,
    /// Whether products of rows some time apart are kept of all columns: then several records have
    /// the standard deviations of their logs together. They are three quarters of a record; without
    /// them the residual of each log's own solution speaks for it.
    pub lags: bool,
    /// Effects that the equations lack and that are to be looked for
    /// ([`diagnose_records`](super::diagnose_records)): names, `torque_ripple` or
    /// `cable_stiffness@joint_2`. Rows within a period of the cut-off of a turn of their joint say
    /// nothing of them.
    pub suspects: Vec<String>,
    /// Names that the record keeps.
    pub labels: BTreeMap<String, String>,
}

impl Default for RecordOptions {
    fn default() -> Self {
        let effects = super::super::IdentifyOptions::default().effects;
        Self {
            effects,
            blocks: 5,
            counted: None,
            lags: true,
            suspects: vec![],
            labels: BTreeMap::new(),
        }
    }
}

/// What is done to logs of a robot so that their records can be summed: what
/// [`identify`](super::super::identify) would choose for the same logs.
///
/// # Errors
/// As [`Processing::choose`], and if a recording lacks a joint.
pub fn choose_processing(
    robot: &Robot,
    recordings: &[Recording],
    conditioning: &Conditioning,
) -> Result<Processing, IdentifyError> {
    Ok(Processing::choose(&select_joints(robot, recordings)?, conditioning)?.0)
}

/// The record of a log, processed as `processing` says.
///
/// The equations are those of [`identify`](super::super::identify): both sides filtered, rows of
/// joints at rest apart.
///
/// # Errors
/// If the log lacks a joint or torque or cannot be differentiated, or an effect cannot be recorded.
///
/// # Panics
/// If there is not at least one block.
pub fn record(
    robot: &Robot,
    recording: &Recording,
    processing: &Processing,
    options: &RecordOptions,
) -> Result<Record, RecordError> {
    assert!(options.blocks > 0, "at least one block");
    let effects = recorded_effects(robot, &options.effects)?;
    let mut experiment = experiment(robot, recording, processing)?;
    count_only(&mut experiment.motions, options.counted);
    let set = ParameterSet::new(robot, &effects).map_err(IdentifyError::from)?;
    let base = BaseParameters::new(robot, &set);
    let mut record =
        record_of(robot, recording, (&experiment, None), (&set, &base), processing, options)?;
    let suspects = suspects_of(robot, &effects, &options.suspects)?;
    if !suspects.is_empty() {
        let calm = between_turns(processing);
        experiment.motions.iter_mut().for_each(|motion| {
            let motion = Arc::make_mut(motion);
            motion.use_as = motion.rows_between_turns(&calm);
        });
        count_only(&mut experiment.motions, options.counted);
        let columns = columns_of(robot, &set, (&experiment, &calm), &suspects)?;
        let set = set.with_trajectory_columns(columns.parameters.clone());
        let base = BaseParameters::new(robot, &set);
        let parts = BlockParts::new(&experiment.motions, options);
        let trajectories =
            experiment.trajectories_with(&[], &[], Some(&columns)).map_err(IdentifyError::from)?;
        let observation = Observation::in_parts(robot, &set, &base, options.blocks);
        let (of_blocks, _) = block_factors(observation, &trajectories, &parts)?;
        record
            .blocks
            .iter_mut()
            .zip(of_blocks)
            .for_each(|(block, factors)| block.suspected = factors);
    }
    Ok(Record { effects, suspects, ..record })
}

/// Periods of the cut-off about turns of a joint in which its rows say nothing of suspects and
/// delays: dry friction jumps there, a sample stands on either side, and any friction that is large
/// at creeping speed would take the error for its own, and a shift of the torque, too.
const TURN_MARGIN: f64 = 1.0;

/// The same processing without the rows near turns.
fn between_turns(processing: &Processing) -> Processing {
    Processing { turn_margin: processing.turn_margin.max(TURN_MARGIN), ..processing.clone() }
}

/// Names of effects that are linear in the present motion, and at every joint.
pub(super) fn recorded_effects(
    robot: &Robot,
    names: &[String],
) -> Result<Vec<String>, RecordError> {
    let (effects, others) = variable_projection::split(robot, names)?;
    match others.first() {
        Some((effect, _)) => Err(RecordError::NotRecorded { effect: effect.name().into() }),
        None => Ok(effects),
    }
}

/// A log made ready.
pub(super) fn experiment(
    robot: &Robot,
    recording: &Recording,
    processing: &Processing,
) -> Result<Experiment, RecordError> {
    let recordings =
        select_joints(robot, std::slice::from_ref(recording)).map_err(IdentifyError::from)?;
    require_torque(robot, &recordings)?;
    Ok(Experiment::new(&recordings, processing)?)
}

/// The record of a log that is ready, its equations with further columns where the set has such.
pub(super) fn record_of(
    robot: &Robot,
    recording: &Recording,
    (experiment, columns): (&Experiment, Option<&TermColumns>),
    (set, base): (&ParameterSet, &BaseParameters),
    processing: &Processing,
    options: &RecordOptions,
) -> Result<Record, RecordError> {
    let parts = BlockParts::new(&experiment.motions, options);
    if parts.samples == 0 {
        return Err(RecordError::NothingCounts { source_name: recording.source().into() });
    }
    let trajectories =
        experiment.trajectories_with(&[], &[], columns).map_err(IdentifyError::from)?;
    let observation = Observation::in_parts(robot, set, base, options.blocks).keeping_rows();
    let (blocks, kept) = block_factors(observation, &trajectories, &parts)?;
    let factors = stacked(blocks.iter().flatten());
    let mut equations = Equations::new(robot, set, base, trajectories);
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    let mut findings = looked_at(robot, recording);
    let nominal = base.combine(&nominal_parameters(robot, set));
    // A log may be too short for a solution of its own.
    let center = match LeastSquares::new(Method::Wls).solve(&factors, base, &nominal) {
        Ok(estimate) => {
            let found = screen_factors(set, base, &joints, &factors, &estimate);
            findings.extend(found.into_iter().map(RecordFinding::from));
            findings.extend(screen_scale(set, base, &nominal, &factors).map(RecordFinding::from));
            estimate.values
        }
        Err(_) => nominal,
    };
    let mut shifts = ShiftedTorques::new(&factors);
    let calm = experiment.calm_rows(&between_turns(processing));
    let memory =
        memory((&mut equations, kept), &factors, &center, options.lags, |equation, row| {
            let is_calm = calm[equation.trajectory][equation.sample * robot.dof() + equation.joint]
                == Row::Moving;
            shifts.push(equation, row, is_calm);
        })?;
    let rates: Vec<f64> = experiment.row_rates_hz();
    findings.extend(shifts.findings(&joints, &rates).into_iter().map(RecordFinding::from));
    let of_block = |(index, factors): (usize, Vec<JointFactor>)| RecordBlock {
        time: parts.time(index..index + 1),
        channels: parts.channels(&experiment.motions, index),
        factors,
        suspected: vec![],
    };
    Ok(Record {
        robot: robot.fingerprint(),
        joints,
        effects: set.effects().iter().map(|effect| effect.name().to_string()).collect(),
        processing: processing.clone(),
        source: recording.source().into(),
        content_hash: format!("{:032x}", recording.content_hash()),
        counted: options.counted,
        time: parts.time(0..options.blocks),
        samples: parts.samples,
        findings,
        labels: options.labels.clone(),
        suspects: vec![],
        extents: JointExtent::of(&experiment.motions, robot.dof()),
        key: experiment.motions.first().map_or([0.0; 2], |motion| key_of(motion)),
        library_version: env!("CARGO_PKG_VERSION").into(),
        center,
        memory,
        blocks: blocks.into_iter().enumerate().map(of_block).collect(),
    })
}

/// What the samples of a log tell, and the limits of the robot file.
fn looked_at(robot: &Robot, recording: &Recording) -> Vec<RecordFinding> {
    let issues =
        inspect(recording).into_iter().chain(torque_scale(robot, recording).ok().flatten());
    let mut findings: Vec<RecordFinding> = issues.map(RecordFinding::from).collect();
    if let Ok(recordings) = select_joints(robot, std::slice::from_ref(recording)) {
        findings.extend(beyond_limits(robot, &recordings).into_iter().map(RecordFinding::from));
    }
    findings
}

impl From<Issue> for RecordFinding {
    fn from(issue: Issue) -> Self {
        let Issue { kind, severity, channel, message, .. } = issue;
        Self { kind: kind.name().into(), rank: severity.rank().into(), subject: channel, message }
    }
}

impl From<Finding> for RecordFinding {
    fn from(finding: Finding) -> Self {
        Self {
            kind: finding.name().into(),
            rank: finding.severity().rank().into(),
            subject: finding.joint().map(String::from),
            message: finding.to_string(),
        }
    }
}

/// Takes the rows outside a part of the log out; none if there is no part.
fn count_only(motions: &mut [Arc<Motion>], counted: Option<[i64; 2]>) {
    let Some([start, end]) = counted else { return };
    for motion in motions.iter_mut().map(Arc::make_mut) {
        let n = motion.use_as.len() / motion.len().max(1);
        for (time, rows) in motion.time.iter().zip(motion.use_as.chunks_exact_mut(n)) {
            if !(start..end).contains(time) {
                rows.fill(Row::Skip);
            }
        }
    }
}

/// Which block a sample of a stretch belongs to: each stretch is cut into as many parts of equal
/// length, as for the parts that are left out one after the other.
struct BlockParts {
    blocks: usize,
    /// Per stretch: samples that count, and the stamps of all.
    stretches: Vec<(std::ops::Range<usize>, Vec<i64>)>,
    samples: usize,
}

impl BlockParts {
    fn new(motions: &[Arc<Motion>], options: &RecordOptions) -> Self {
        let stretch = |motion: &Arc<Motion>| {
            let [start, end] = options.counted.unwrap_or([i64::MIN, i64::MAX]);
            let first = motion.time.partition_point(|time| *time < start);
            let last = motion.time.partition_point(|time| *time < end);
            (first..last.max(first), motion.time.clone())
        };
        let stretches: Vec<_> = motions.iter().map(stretch).collect();
        let samples = stretches.iter().map(|(counted, _)| counted.len()).sum();
        Self { blocks: options.blocks, stretches, samples }
    }

    fn range(&self, stretch: usize, blocks: &std::ops::Range<usize>) -> std::ops::Range<usize> {
        let counted = &self.stretches[stretch].0;
        let place = |block: usize| counted.start + block * counted.len() / self.blocks;
        place(blocks.start)..place(blocks.end)
    }

    fn block(&self, stretch: usize, sample: usize) -> usize {
        let counted = &self.stretches[stretch].0;
        piece_of(sample - counted.start, counted.len(), self.blocks)
    }

    /// First and last stamp.
    fn time(&self, blocks: std::ops::Range<usize>) -> [i64; 2] {
        let mut found = [i64::MAX, i64::MIN];
        for (stretch, (_, time)) in self.stretches.iter().enumerate() {
            for stamp in &time[self.range(stretch, &blocks)] {
                found = [found[0].min(*stamp), found[1].max(*stamp)];
            }
        }
        if found[0] > found[1] { [0, 0] } else { found }
    }

    /// Mean of each channel.
    fn channels(&self, motions: &[Arc<Motion>], block: usize) -> BTreeMap<String, f64> {
        let mut sums: BTreeMap<String, (f64, usize)> = BTreeMap::new();
        for (stretch, motion) in motions.iter().enumerate() {
            let range = self.range(stretch, &(block..block + 1));
            for channel in &motion.channels {
                let (sum, count) = sums.entry(channel.name.clone()).or_default();
                for value in channel.values[range.clone()].iter().filter(|value| value.is_finite())
                {
                    (*sum, *count) = (*sum + value, *count + 1);
                }
            }
        }
        let mean = |(name, (sum, count)): (String, (f64, usize))| {
            (count > 0).then(|| (name, sum / count as f64))
        };
        sums.into_iter().filter_map(mean).filter(|(_, mean)| mean.is_finite()).collect()
    }
}

/// Factors of each block, joints in motion first, then joints at rest; and the rows if the
/// observation kept them.
fn block_factors(
    mut observation: Observation<'_>,
    trajectories: &[Trajectory<'_>],
    parts: &BlockParts,
) -> Result<(Vec<Vec<JointFactor>>, Option<KeptRows>), IdentifyError> {
    for (stretch, trajectory) in trajectories.iter().enumerate() {
        observation.add_to(trajectory, |sample| parts.block(stretch, sample))?;
    }
    let kept = observation.kept();
    Ok((observation.parts(), kept))
}

/// What the residual of each factor remembers.
///
/// - `kept`: the rows of the equations, if they are there
/// - `lags`: whether the products are those of all columns
/// - `beside`: is shown every equation with its row's number in the trajectory
fn memory(
    (equations, kept): (&mut Equations<'_>, Option<KeptRows>),
    factors: &[JointFactor],
    center: &[f64],
    lags: bool,
    mut beside: impl FnMut(&Equation<'_>, usize),
) -> Result<Vec<RecordMemory>, IdentifyError> {
    let columns = |factor: &JointFactor| if lags { factor.columns.len() } else { 0 };
    let mut products: Vec<LagProducts> =
        factors.iter().map(|factor| LagProducts::new(columns(factor) + 1)).collect();
    let steps: Vec<usize> =
        equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    let kinds: BTreeMap<(usize, bool), usize> = factors
        .iter()
        .enumerate()
        .map(|(index, factor)| ((factor.joint, factor.resting), index))
        .collect();
    let visit = |equation: Equation<'_>| {
        let index = kinds[&(equation.joint, equation.resting)];
        let own = equation.row[..columns(&factors[index])].iter().copied();
        let row = own.chain([equation.residual(center)]);
        let place = equation.sample / steps[equation.trajectory];
        products[index].push(equation.trajectory, place, row);
        beside(&equation, place);
    };
    match kept {
        Some(kept) => kept.for_each(visit),
        None => equations.for_each(visit)?,
    }
    let of_factor = |(factor, products): (&JointFactor, LagProducts)| {
        let (sums, counts) = products.finish();
        let sums = sums.into_iter().map(Matrix::from).collect();
        RecordMemory { joint: factor.joint, resting: factor.resting, sums, counts }
    };
    Ok(factors.iter().zip(products).map(of_factor).collect())
}
