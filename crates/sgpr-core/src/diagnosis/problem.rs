//! The logs as equations: rows of every joint, columns of the model and of candidates, all through
//! one filter.

use std::sync::Arc;

use faer::Mat;
use rayon::prelude::*;

use super::DiagnosisError;
use super::by_log::{ByLog, LogSums};
use super::file_prior::FilePrior;
use super::remembered::Remembered;
use sgpr_predict::internal::{JointRanges, for_each_regressor_block};

use crate::dynamics::{BatchWorkspace, Samples, Workspace, mass_matrix};
use crate::effects::{Context, Reach, sgn};
use crate::identification::{
    BaseParameters, EFFECT_SCALES, JointFactor, ParameterPrior, ParameterSet, Row, WIDTHS,
};
use crate::linalg::{dot_in_lanes, rms, triangle};
use crate::model::{
    AlongMotion, Rigid, Term, TorqueModel, Trajectory, common_clock, nominal_parameters,
    seconds_since, select_joints, torque_of,
};
use crate::motion::{Motion, Processing, all_stretches};
use crate::recording::Recording;
use crate::signal::LowPass;
use crate::spatial::{PARAMETERS_PER_LINK, Vector3};

/// Highest cut-off of both sides of the equation, Hz: ripple and reversals show up to here.
const BAND_HZ: f64 = 25.0;

/// Rows per second, in cut-offs.
const ROWS_PER_CUTOFF: f64 = 2.5;

/// Folds of the held-out error.
pub(super) const FOLDS: usize = 5;

/// Longest block of a fold, s. Short logs are cut into so many blocks a fold, of which each has as
/// many periods of the band.
const LONGEST_BLOCK_S: f64 = 2.0;
/// Least number of blocks to a fold: a fiftieth of a short log is a block.
const BLOCKS: f64 = 10.0;

/// Blocks of time of logs, one after the other, each in one fold.
pub(super) struct Blocks {
    /// Per log: blocks before it, and samples of a block.
    logs: Vec<(usize, usize)>,
}

impl Blocks {
    /// Of `seconds` each.
    pub fn new<'m>(motions: impl Iterator<Item = &'m Motion>, seconds: f64) -> Self {
        let mut before = 0;
        let of_log = |motion: &Motion| {
            let length = (seconds * motion.rate_hz).max(1.0) as usize;
            let first = before;
            before += motion.len() / length + 1;
            (first, length)
        };
        Self { logs: motions.map(of_log).collect() }
    }

    /// The fold of a sample of a log.
    pub fn fold(&self, log: usize, sample: usize) -> usize {
        let (first, length) = self.logs[log];
        (first + sample / length) % FOLDS
    }
}

/// Length of a block for logs of so many seconds in a band, s.
fn block_seconds(seconds: f64, band_hz: f64) -> f64 {
    (seconds / (BLOCKS * FOLDS as f64)).max(BLOCKS / band_hz).min(LONGEST_BLOCK_S)
}

/// Shortest logs in a band with two of the shortest blocks for every fold, or one of the longest, s.
fn least_seconds(band_hz: f64) -> f64 {
    FOLDS as f64 * LONGEST_BLOCK_S.min(2.0 * BLOCKS / band_hz)
}

/// Lowest band, Hz, of which logs of so many seconds are long enough, rounding aside.
fn least_band(seconds: f64) -> f64 {
    let (folds, margin) = (FOLDS as f64, 1.0 + 4.0 * f64::EPSILON);
    if seconds < folds * LONGEST_BLOCK_S { margin * 2.0 * folds * BLOCKS / seconds } else { 0.0 }
}

/// One processed stretch of a log.
#[derive(Debug)]
pub(super) struct Stretch {
    pub motion: Arc<Motion>,
    /// On the clock of the session, s; empty if the logs share none.
    pub time: Vec<f64>,
    filter: LowPass,
    decimation: usize,
}

impl Stretch {
    /// Samples from one row of the equations to the next.
    pub fn decimation(&self) -> usize {
        self.decimation
    }

    /// Length, s.
    fn seconds(&self) -> f64 {
        self.motion.len() as f64 / self.motion.rate_hz
    }
}

/// From the lowest to the highest value of some ranges.
pub(super) fn union(ranges: &[[f64; 2]]) -> [f64; 2] {
    ranges.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], own| {
        [low.min(own[0]), high.max(own[1])]
    })
}

/// A column: per joint its rows, empty where it is zero.
pub(super) type Column = Vec<Vec<f64>>;

/// The equations of all joints.
#[derive(Debug)]
pub(super) struct Problem {
    pub set: ParameterSet,
    pub base: BaseParameters,
    /// The model without terms, from which constants of transforms are counted.
    pub nominal: TorqueModel,
    /// Whether the robot file has inertias.
    inertias_known: bool,
    /// Terms that the model has already.
    pub given: Vec<Term>,
    pub stretches: Vec<Stretch>,
    /// Per joint: (stretch, sample) of each row.
    pub rows: Vec<Vec<(usize, usize)>>,
    /// Per joint and row: rows right before it without a gap.
    pub run: Vec<Vec<usize>>,
    /// Per joint and row: block of the held-out error.
    pub fold: Vec<Vec<usize>>,
    /// Length of a block of a fold, s.
    pub block_s: f64,
    /// Per joint: largest torque of the logs, if the torque stays at it.
    pub limits: Vec<Option<f64>>,
    /// How long after a rest the logged torque may still be that of the rest, s; rows there are
    /// left out.
    pub after_rest: f64,
    /// Per joint: how long before a reversal it may stick, s; rows there are left out.
    holds: Vec<f64>,
    /// Per joint: whether its rows are left out.
    closed: Vec<bool>,
    /// Torque, per joint.
    pub y: Column,
    /// The logs as the model's own processing has them, against which the torque as logged is held.
    logged: Vec<Arc<Motion>>,
    /// Stamp at which the clock of the session starts, ns, if the logs share one.
    pub clock: Option<i64>,
    /// Cut-off of the equations, Hz.
    pub band_hz: f64,
    /// Per joint: what the logs show of it.
    ranges: Vec<JointRanges>,
    /// Per joint: whether the noise of its position makes about as much torque in the band as the
    /// noise of the torque.
    pub noisy: Vec<bool>,
    /// Per joint: median change of speed over the sample in which it reverses, rad/s (m/s).
    pub speed_steps: Vec<f64>,
    /// The robot file at several widths, for fits that rows are left out of; none before
    /// [`Self::believe_file`].
    pub priors: Vec<FilePrior>,
    /// What depends on the measured motion alone.
    along: Remembered,
}

/// Torque of an effect, one standard deviation before any data, as a share of what its joint has
/// shown.
const WIDEST_EFFECT: f64 = EFFECT_SCALES[EFFECT_SCALES.len() - 1];

impl Problem {
    pub fn new(
        model: &TorqueModel,
        train: &[Recording],
        processing: &Processing,
    ) -> Result<Self, DiagnosisError> {
        let recordings = select_joints(model.robot(), train)?;
        let quiet = quiet_bands(model, &recordings)?;
        let base = BaseParameters::new(model.robot(), model.parameter_set());
        let logged = all_stretches(&recordings, processing)?;
        let judged_s = logged.iter().map(|motion| motion.len() as f64 / motion.rate_hz).sum();
        let lowest = least_band(judged_s);
        let narrow = narrower((&quiet, lowest), base.rank(), &recordings, processing);
        let motions = match narrow {
            Some(cutoff_hz) => {
                all_stretches(&recordings, &Processing { cutoff_hz, ..processing.clone() })?
            }
            None => logged.clone(),
        };
        let band = narrow.unwrap_or(processing.cutoff_hz);
        let mut problem = Self::with_motions(model, base, [motions, logged], processing, narrow)?;
        problem.noisy = quiet.iter().map(|quiet| band > MUCH_WIDER * quiet).collect();
        Ok(problem)
    }

    fn with_motions(
        model: &TorqueModel,
        base: BaseParameters,
        [motions, logged]: [Vec<Arc<Motion>>; 2],
        processing: &Processing,
        quiet: Option<f64>,
    ) -> Result<Self, DiagnosisError> {
        let robot = model.robot();
        let clock = common_clock(&motions).and(model.clock_start()).or(common_clock(&motions));
        let n = robot.dof();
        let mut stretches = Vec::new();
        for motion in motions {
            torque_of(&motion)?;
            let band = quiet.unwrap_or(BAND_HZ.max(processing.cutoff_hz)).min(0.2 * motion.rate_hz);
            let filter = LowPass::butterworth(4, band, motion.rate_hz)?;
            let decimation = (motion.rate_hz / (ROWS_PER_CUTOFF * band)).floor().max(1.0) as usize;
            let time = clock.map_or(vec![], |start| seconds_since(start, &motion.time));
            stretches.push(Stretch { motion, time, filter, decimation });
        }
        let set = model.parameter_set().clone();
        let mut nominal = model.clone().with_terms(vec![], clock);
        nominal.processing = Some(processing.clone());
        let file = nominal_parameters(robot, &set);
        let mut inertias_known = (0..n).all(|link| file[PARAMETERS_PER_LINK * link] > 0.0);
        if inertias_known {
            let split = BaseParameters::with_effects_first(robot, &set);
            let mut with_file = nominal.clone();
            with_file.set_parameters(split.expand(&split.combine(nominal.parameters()), &file));
            inertias_known = are_of_this_arm(&with_file, &nominal, &stretches);
            if inertias_known {
                nominal = with_file;
            }
        }
        let band_hz = quiet.unwrap_or(BAND_HZ);
        let mut problem = Self {
            base: base.extended_for(&generic(robot), &set),
            set,
            nominal,
            inertias_known,
            given: model.terms().to_vec(),
            rows: vec![vec![]; n],
            run: vec![vec![]; n],
            fold: vec![vec![]; n],
            block_s: block_seconds(stretches.iter().map(Stretch::seconds).sum(), band_hz),
            limits: (0..n).map(|joint| flat_top(&stretches, joint)).collect(),
            after_rest: 0.0,
            holds: vec![0.0; n],
            closed: vec![false; n],
            y: vec![vec![]; n],
            logged,
            stretches,
            clock,
            band_hz,
            ranges: vec![],
            noisy: vec![false; n],
            speed_steps: vec![],
            priors: vec![],
            along: Remembered::default(),
        };
        problem.lay_out_rows();
        problem.fill_torque()?;
        Ok(problem)
    }

    /// Precision before any data of the factor of a term's column: one part of an effect makes,
    /// while it acts, torque of the size that its joints have shown, and no more than other parts
    /// can cancel. Parts that the motion does not tell apart would else run off against each other.
    pub fn precision(&self, column: &Column) -> f64 {
        let (mut own, mut shown) = (0.0, 0.0);
        for (column, ranges) in
            column.iter().zip(&self.ranges).filter(|(column, _)| !column.is_empty())
        {
            let acts = column.iter().filter(|x| **x != 0.0).count().max(1) as f64;
            own += dot_in_lanes(column, column) / acts;
            shown += ranges.torque.powi(2);
        }
        if shown > 0.0 { own / (shown * WIDEST_EFFECT.powi(2)) } else { 0.0 }
    }

    /// Lets the robot file hold parameters in fits that rows are left out of: bodies with a
    /// relative deviation that left-out rows choose, friction and offsets by no more than that
    /// their torques are of the size of the joint's own.
    ///
    /// - `columns`: of the base parameters
    pub fn believe_file(&mut self, columns: &[Arc<Column>]) {
        /// Rows of a joint that say how large its torques are.
        const ROWS: usize = 2000;
        let factor = |joint: usize| {
            let of_joint: Vec<usize> =
                (0..columns.len()).filter(|&k| !columns[k][joint].is_empty()).collect();
            let step = self.y[joint].len() / ROWS + 1;
            let rows = self.y[joint].len() / step;
            let value = |row: usize, k: usize| match of_joint.get(k) {
                Some(&column) => columns[column][joint][row * step],
                None => self.y[joint][row * step],
            };
            let factor = triangle(Mat::from_fn(rows, of_joint.len() + 1, value).as_ref());
            JointFactor {
                joint,
                resting: false,
                columns: of_joint,
                factor: factor.into(),
                rows,
                least_noise: 0.0,
            }
        };
        let factors: Vec<JointFactor> = (0..self.dof()).map(factor).collect();
        let robot = self.nominal.robot();
        let file = nominal_parameters(robot, &self.set);
        let of_file = ParameterPrior::new(robot, &self.set, &self.base, &file, &factors);
        let from = self.base.combine(self.nominal.parameters());
        let prior = |width: &f64| {
            let of_file =
                of_file.clone().with_relative_deviation(*width).with_effect_scale(WIDEST_EFFECT);
            FilePrior::new(&of_file, &from)
        };
        self.priors = WIDTHS.iter().map(prior).collect();
    }

    /// Rows of the blocks of time of a joint, in order: contiguous, each in one log and one fold.
    pub fn blocks(&self, joint: usize) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let key = move |row: usize| (self.rows[joint][row].0, self.fold[joint][row]);
        let count = self.rows[joint].len();
        let mut first = 0;
        std::iter::from_fn(move || {
            let start = first;
            let here = (start < count).then(|| key(start))?;
            first = (start..count).find(|&row| key(row) != here).unwrap_or(count);
            Some(start..first)
        })
    }

    /// Per joint and row its part of the logs: contiguous, each in one log, about as many as are
    /// wanted. A part is far from the others in time and in motion, as a log is that nobody has
    /// seen.
    pub fn parts(&self, count: usize) -> Vec<Vec<usize>> {
        let wanted = self.seconds() / count as f64;
        let counts: Vec<usize> = self
            .stretches
            .iter()
            .map(|s| ((s.seconds() / wanted).round() as usize).max(1))
            .collect();
        let part = |(stretch, sample): &(usize, usize)| {
            let before: usize = counts[..*stretch].iter().sum();
            before + sample * counts[*stretch] / self.stretches[*stretch].motion.len()
        };
        self.rows.iter().map(|rows| rows.iter().map(part).collect()).collect()
    }

    /// Whether half of the rows of so many parts are farther from other parts than any row of a
    /// block is from other blocks.
    pub fn are_far(&self, parts: usize) -> bool {
        self.seconds() >= parts as f64 * 2.0 * LONGEST_BLOCK_S
    }

    /// Length of all logs, s.
    pub fn seconds(&self) -> f64 {
        self.stretches.iter().map(Stretch::seconds).sum()
    }

    /// Shortest logs that can be judged in the band, s.
    pub fn least_seconds(&self) -> f64 {
        least_seconds(self.band_hz)
    }

    pub fn dof(&self) -> usize {
        self.rows.len()
    }

    fn lay_out_rows(&mut self) {
        let n = self.dof();
        let blocks =
            Blocks::new(self.stretches.iter().map(|stretch| &*stretch.motion), self.block_s);
        self.rows.iter_mut().for_each(Vec::clear);
        self.run.iter_mut().for_each(Vec::clear);
        self.fold.iter_mut().for_each(Vec::clear);
        for (index, stretch) in self.stretches.iter().enumerate() {
            let motion = &stretch.motion;
            let settled = stretch.motion.settled(&stretch.filter);
            for joint in (0..n).filter(|joint| !self.closed[*joint]) {
                let mut run = 0;
                let smear = 0.5 * stretch.decimation as f64 * ROWS_PER_CUTOFF / motion.rate_hz;
                let late = (self.after_rest * motion.rate_hz).ceil() as usize;
                let mut sticks = sticking(motion, joint, self.top_speed(joint), smear);
                if let Some(limit) = self.limits[joint] {
                    let tau = motion.tau.as_deref().unwrap_or_default();
                    let margin = stretch.filter.settling_samples();
                    for k in (0..motion.len()).filter(|&k| tau[k * n + joint].abs() >= limit) {
                        sticks[k.saturating_sub(margin)..(k + margin).min(motion.len())].fill(true);
                    }
                }
                if self.holds[joint] > 0.0 {
                    let wait = until_reversal(motion, joint);
                    let margin = (smear * motion.rate_hz).ceil() as usize;
                    for k in (0..motion.len()).filter(|&k| wait[k] < self.holds[joint]) {
                        sticks[k.saturating_sub(margin)..(k + margin).min(motion.len())].fill(true);
                    }
                }
                for k in (0..motion.len().saturating_sub(1)).rev().filter(|_| late > 0) {
                    if sticks[k] && !sticks[k + 1] {
                        sticks[k..(k + late).min(motion.len())].fill(true);
                    }
                }
                for sample in (0..motion.len()).step_by(stretch.decimation) {
                    if !settled.contains(&sample)
                        || motion.use_as[sample * n + joint] != Row::Moving
                        || sticks[sample]
                    {
                        run = 0;
                        continue;
                    }
                    self.rows[joint].push((index, sample));
                    self.run[joint].push(run);
                    self.fold[joint].push(blocks.fold(index, sample));
                    run += 1;
                }
            }
        }
    }

    /// Leaves the rows of a joint out in which it may stick before it reverses.
    pub fn leave_out_holds(&mut self, holds: &[(usize, f64)]) -> Result<(), DiagnosisError> {
        self.choose_rows(&|problem| {
            holds.iter().for_each(|(joint, seconds)| problem.holds[*joint] = *seconds)
        })
    }

    /// Leaves the rows out for so long after each rest, s.
    pub fn leave_out_after_rests(&mut self, seconds: f64) -> Result<(), DiagnosisError> {
        self.choose_rows(&|problem| problem.after_rest = seconds)
    }

    /// Leaves all rows of some joints out, and only of these.
    pub fn leave_out_joints(&mut self, closed: &[bool]) -> Result<(), DiagnosisError> {
        self.choose_rows(&|problem| problem.closed = closed.to_vec())
    }

    /// The rows anew by another rule.
    fn choose_rows(&mut self, change: &dyn Fn(&mut Self)) -> Result<(), DiagnosisError> {
        change(self);
        self.lay_out_rows();
        self.fill_torque()
    }

    /// Whether rows of a joint were left out by [`Self::leave_out_holds`].
    pub fn leaves_holds_out(&self, joint: usize) -> bool {
        self.holds[joint] > 0.0
    }

    /// One in the direction of the motion to come while a joint is less than `seconds` before a
    /// reversal: what friction lacks if the joint sticks there, while the filtered position still
    /// creeps to a stop.
    pub fn approach_column(&self, joint: usize, seconds: f64) -> Column {
        let n = self.dof();
        let of_stretch = |index: usize, out: &mut [Column]| {
            let motion = &self.stretches[index].motion;
            let wait = until_reversal(motion, joint);
            let mut values: Vec<f64> = (0..motion.len())
                .map(|k| if wait[k] < seconds { -sgn(motion.dq[k * n + joint]) } else { 0.0 })
                .collect();
            self.append(&self.nominal, (index, joint), &mut values, out);
        };
        self.by_stretch(1, of_stretch).swap_remove(0)
    }

    /// Speed that a joint stays below for 95 % of the time, rad/s (m/s).
    fn top_speed(&self, joint: usize) -> f64 {
        let n = self.dof();
        let all = self
            .stretches
            .iter()
            .flat_map(|s| s.motion.dq.iter().skip(joint).step_by(n).map(|dq| dq.abs()));
        let mut speeds: Vec<f64> = all.collect();
        speeds.sort_by(f64::total_cmp);
        speeds.get(speeds.len() * 19 / 20).copied().unwrap_or_default()
    }

    fn fill_torque(&mut self) -> Result<(), DiagnosisError> {
        let n = self.dof();
        let mut y = vec![vec![]; n];
        for (index, stretch) in self.stretches.iter().enumerate() {
            let tau = torque_of(&stretch.motion)?;
            let mut smooth = tau.to_vec();
            stretch.filter.apply(&mut smooth, n)?;
            for joint in 0..n {
                let own = self.rows[joint].iter().filter(|(stretch, _)| *stretch == index);
                y[joint].extend(own.map(|(_, sample)| smooth[sample * n + joint]));
            }
        }
        self.y = y;
        self.ranges = (0..n).map(|joint| self.ranges_of(joint)).collect();
        self.speed_steps = (0..n).map(|joint| self.speed_step(joint)).collect();
        Ok(())
    }

    /// Whether a base column is that of an effect of the model, if the robot file has inertias.
    /// Where an arm's inertia cannot be told from its rotor's, the link keeps that of the file:
    /// effects that follow the torque of the gear, which the rotor's is not part of, need the two
    /// apart.
    pub fn is_rotor(&self, column: usize) -> bool {
        let effect = |parameter: &usize| *parameter >= self.set.inertial();
        self.inertias_known && self.base.independent().get(column).is_some_and(effect)
    }

    /// Errors against the torque as logged while a joint moves, per log; of every joint one after
    /// the other.
    pub fn logged_rows(&self, model: &TorqueModel) -> Vec<Vec<Option<f64>>> {
        let of_log = |motion: &Arc<Motion>| {
            let measured = motion.tau.as_deref().unwrap_or_default();
            let predicted = model.predict_motion(motion);
            let rows = predicted.iter().zip(measured).zip(&motion.use_as);
            rows.map(|((predicted, measured), used)| {
                (*used == Row::Moving).then(|| measured - predicted)
            })
            .collect()
        };
        self.logged.par_iter().map(of_log).collect()
    }

    /// Errors per joint of such rows.
    pub fn errors_of(&self, rows: &[Vec<Option<f64>>]) -> Vec<ByLog> {
        let n = self.dof();
        let mut sums: Vec<LogSums> = (0..n).map(|_| LogSums::new(self.stretches.len())).collect();
        for (index, rows) in rows.iter().enumerate() {
            for (k, error) in rows.iter().enumerate().filter_map(|(k, row)| Some((k, (*row)?))) {
                sums[k % n].add(index, error * error);
            }
        }
        sums.iter().map(LogSums::roots).collect()
    }

    /// Errors against the torque as logged, per joint, of all logs together, N·m (N).
    pub fn logged_error(&self, model: &TorqueModel) -> Vec<f64> {
        self.errors_of(&self.logged_rows(model)).iter().map(|error| error[0]).collect()
    }

    /// Per stretch: the rigid body as `model` has it.
    pub fn rigid(&self, model: &TorqueModel) -> Vec<Rigid> {
        let stretches = self.stretches.par_iter().enumerate();
        stretches
            .map(|(k, stretch)| model.rigid_with(&stretch.trajectory(), &self.along.along(k)))
            .collect()
    }

    /// Per stretch: what effects may depend on.
    pub fn contexts<'c>(&'c self, model: &TorqueModel, rigid: &'c [Rigid]) -> Vec<Context<'c>> {
        let stretches = self.stretches.iter().zip(rigid);
        stretches.map(|(stretch, rigid)| model.context(&stretch.trajectory(), rigid)).collect()
    }

    /// Columns to which `of_stretch` appends the rows of one stretch, on all cores.
    fn by_stretch(
        &self,
        width: usize,
        of_stretch: impl Fn(usize, &mut [Column]) + Sync,
    ) -> Vec<Column> {
        let none = || vec![vec![vec![]; self.dof()]; width];
        let rows = |index: usize| {
            let mut rows = none();
            of_stretch(index, &mut rows);
            rows
        };
        let parts: Vec<Vec<Column>> = (0..self.stretches.len()).into_par_iter().map(rows).collect();
        let mut parts = parts.into_iter();
        let mut columns = parts.next().unwrap_or_else(none);
        for part in parts {
            let pairs = columns.iter_mut().flatten().zip(part.into_iter().flatten());
            pairs.for_each(|(column, rows)| column.extend(rows));
        }
        columns
    }

    /// Filters full-rate columns of a joint, `[samples, width]` row-major, and appends their rows
    /// to `out`.
    fn append(
        &self,
        model: &TorqueModel,
        (index, joint): (usize, usize),
        values: &mut [f64],
        out: &mut [Column],
    ) {
        let width = out.len();
        let stretch = &self.stretches[index];
        if values.iter().any(|value| *value != 0.0) {
            transmit(model, joint, stretch.motion.rate_hz, values, width);
            stretch.filter.apply(values, width).expect("a stretch is longer than the filter");
        }
        self.pick(index, joint, |sample, k| values[sample * width + k], out);
    }

    /// The same of all joints, `[samples, joints, width]`: the filter takes them together.
    fn append_all(
        &self,
        model: &TorqueModel,
        index: usize,
        values: &mut [f64],
        out: &mut [Column],
    ) {
        let (n, width) = (self.dof(), out.len());
        let stretch = &self.stretches[index];
        if model.terms().iter().any(Term::is_transform) {
            let mut own = vec![0.0; values.len() / n];
            for joint in 0..n {
                let of_joint = joint * width..(joint + 1) * width;
                let rows = values.chunks_exact(n * width).zip(own.chunks_exact_mut(width));
                rows.for_each(|(row, own)| own.copy_from_slice(&row[of_joint.clone()]));
                if own.iter().all(|value| *value == 0.0) {
                    continue;
                }
                transmit(model, joint, stretch.motion.rate_hz, &mut own, width);
                let rows = values.chunks_exact_mut(n * width).zip(own.chunks_exact(width));
                rows.for_each(|(row, own)| row[of_joint.clone()].copy_from_slice(own));
            }
        }
        if values.iter().any(|value| *value != 0.0) {
            stretch.filter.apply(values, n * width).expect("a stretch is longer than the filter");
        }
        (0..n).for_each(|joint| {
            self.pick(index, joint, |sample, k| values[(sample * n + joint) * width + k], out)
        });
    }

    /// Appends the rows that a joint has in a stretch to `out`, value (sample, column).
    fn pick(
        &self,
        index: usize,
        joint: usize,
        value: impl Fn(usize, usize) -> f64,
        out: &mut [Column],
    ) {
        let rows = &self.rows[joint];
        let own =
            rows.partition_point(|row| row.0 < index)..rows.partition_point(|row| row.0 <= index);
        out.iter_mut().for_each(|column| column[joint].reserve(own.len()));
        for (_, sample) in &rows[own] {
            out.iter_mut()
                .enumerate()
                .for_each(|(k, column)| column[joint].push(value(*sample, k)));
        }
    }

    /// Columns of the base parameters, rank of them, under the transforms of `model`.
    pub fn base_columns(
        &self,
        base: &BaseParameters,
        model: &TorqueModel,
        rigid: &[Rigid],
    ) -> Vec<Column> {
        let n = self.dof();
        let robot = model.robot();
        let inertial = self.set.inertial();
        let of_stretch = |index: usize, columns: &mut [Column]| {
            let (stretch, rigid) = (&self.stretches[index], &rigid[index]);
            let samples = stretch.motion.len();
            let trajectory = stretch.trajectory();
            let links = rigid.motion.as_ref();
            let motion =
                links.map_or(trajectory.samples, |m| Samples { q: &m.q, dq: &m.dq, ddq: &m.ddq });
            let mut of_joint: Vec<Vec<usize>> = vec![vec![]; n];
            for (column, &parameter) in base.independent().iter().enumerate() {
                for (joint, own) in of_joint.iter_mut().enumerate() {
                    let there = match parameter.checked_sub(inertial) {
                        None => robot.carries(joint, parameter / PARAMETERS_PER_LINK),
                        Some(effect) => self.set.effect_columns()[effect].joint == joint,
                    };
                    if there {
                        own.push(column);
                    }
                }
            }
            let mut tables: Vec<Vec<f64>> =
                of_joint.iter().map(|own| vec![0.0; samples * own.len()]).collect();
            // Per joint and link: (parameter of the link, position in the row).
            let place = |joint: usize, link: usize| -> Vec<(usize, usize)> {
                let own = of_joint[joint].iter().enumerate();
                let of_link = own.filter(|(_, column)| base.independent()[**column] < inertial);
                of_link
                    .map(|(position, column)| (base.independent()[*column], position))
                    .filter(|(parameter, _)| parameter / PARAMETERS_PER_LINK == link)
                    .map(|(parameter, position)| (parameter % PARAMETERS_PER_LINK, position))
                    .collect()
            };
            let places: Vec<Vec<Vec<(usize, usize)>>> =
                (0..n).map(|joint| (0..n).map(|link| place(joint, link)).collect()).collect();
            for_each_regressor_block(
                &rigid.robot,
                &mut BatchWorkspace::new(&rigid.robot),
                motion,
                |joint, link, first, count, block| {
                    let width = of_joint[joint].len();
                    for &(parameter, position) in &places[joint][link] {
                        for (k, value) in (first..first + count).zip(&block[parameter]) {
                            tables[joint][k * width + position] = *value;
                        }
                    }
                },
            );
            let context = model.context(&trajectory, rigid);
            let mut values = vec![0.0; self.set.effect_columns_per_joint()];
            for joint in 0..n {
                let parameters = self.set.effect_parameters_of(joint);
                let width = of_joint[joint].len();
                let wanted: Vec<(usize, usize)> = of_joint[joint]
                    .iter()
                    .enumerate()
                    .filter_map(|(position, column)| {
                        let parameter = base.independent()[*column];
                        parameters
                            .iter()
                            .position(|own| *own == parameter)
                            .map(|index| (index, position))
                    })
                    .collect();
                for k in 0..samples {
                    self.set.effect_row(joint, &context.state(k), &mut values);
                    wanted
                        .iter()
                        .for_each(|&(index, at)| tables[joint][k * width + at] = values[index]);
                }
                let mut out: Vec<Column> =
                    of_joint[joint].iter().map(|_| vec![vec![]; n]).collect();
                self.append(model, (index, joint), &mut tables[joint], &mut out);
                for (own, out) in of_joint[joint].iter().zip(&mut out) {
                    columns[*own][joint].append(&mut out[joint]);
                }
            }
        };
        self.by_stretch(base.rank(), of_stretch)
    }

    /// The torque less that of the model's parameters as they were, under the transforms of
    /// `model`.
    pub fn target(&self, model: &TorqueModel, rigid: &[Rigid]) -> Column {
        let of_stretch = |index: usize, out: &mut [Column]| {
            let mut torque =
                self.nominal.torque_under(&rigid[index], &self.stretches[index].trajectory());
            self.append_all(model, index, &mut torque, out);
        };
        let known = self.by_stretch(1, of_stretch).swap_remove(0);
        self.y
            .iter()
            .zip(known)
            .map(|(y, known)| y.iter().zip(known).map(|(y, k)| y - k).collect())
            .collect()
    }

    /// Columns of the linear parameters of a term that enters by columns.
    pub fn term_columns(&self, model: &TorqueModel, rigid: &[Rigid], term: &Term) -> Vec<Column> {
        let n = self.dof();
        let contexts = self.contexts(model, rigid);
        let of_stretch = |index: usize, out: &mut [Column]| {
            let context = &contexts[index];
            let columns = self.along.along(index).columns(term, context);
            match term.effect.reach() {
                Reach::Own => {
                    let joint = term.site.joint().expect("it reaches its own joint");
                    self.append(
                        model,
                        (index, joint),
                        &mut interleaved(&columns, context.len()),
                        out,
                    );
                }
                Reach::All => self.append_all(
                    model,
                    index,
                    &mut interleaved(&columns, n * context.len()),
                    out,
                ),
            }
        };
        match term.effect.parameters().len() {
            0 => vec![],
            width => self.by_stretch(width, of_stretch),
        }
    }

    /// Slope of the torque of a term that enters by columns over one of its constants, between two
    /// values of it.
    pub fn slope(
        &self,
        model: &TorqueModel,
        rigid: &[Rigid],
        term: &Term,
        index: usize,
        [low, high]: [f64; 2],
    ) -> Column {
        let columns = [low, high].map(|value| {
            let mut term = term.clone();
            term.constants[index] = value;
            self.term_columns(model, rigid, &term)
        });
        let mut slope = vec![vec![]; self.dof()];
        for (sign, columns) in [-1.0, 1.0].into_iter().zip(columns) {
            for (column, factor) in columns.iter().zip(&term.coefficients) {
                let factor = sign * factor / (high - low);
                for (slope, rows) in slope.iter_mut().zip(column) {
                    slope.resize(rows.len(), 0.0);
                    slope
                        .iter_mut()
                        .zip(rows)
                        .for_each(|(slope, x): (&mut f64, _)| *slope += factor * x);
                }
            }
        }
        slope
    }

    /// A column from the torque difference of two models, per unit.
    pub fn difference(&self, models: [&TorqueModel; 2], per: f64) -> Column {
        let of_stretch = |index: usize, out: &mut [Column]| {
            let (trajectory, known) = (self.stretches[index].trajectory(), self.along.along(index));
            let [a, b] = models.map(|model| model.predict_with(&trajectory, &known));
            let mut values: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (b - a) / per).collect();
            self.append_all(&self.nominal, index, &mut values, out);
        };
        self.by_stretch(1, of_stretch).swap_remove(0)
    }

    /// Columns that take up what is wrong with sgn(dq) near reversals, two per joint with dry
    /// friction.
    pub fn reversal_columns(
        &self,
        model: &TorqueModel,
        rigid: &[Rigid],
        joint: usize,
        widths: [f64; 2],
    ) -> Vec<Column> {
        let contexts = self.contexts(model, rigid);
        let of_stretch = |index: usize, out: &mut [Column]| {
            let shape = |dq: f64, width: f64| sgn(dq) * (-(dq / width).abs()).exp();
            let both = |dq: f64| widths.map(|width| shape(dq, width));
            let context = &contexts[index];
            let mut table: Vec<f64> = context.of_joint(context.dq, joint).flat_map(both).collect();
            self.append(model, (index, joint), &mut table, out);
        };
        self.by_stretch(2, of_stretch)
    }

    /// Columns of any function of a sample, given by its stretch and its index there, at one joint.
    pub fn feature_columns(
        &self,
        joint: usize,
        width: usize,
        features: impl Fn(usize, usize, &mut [f64]) + Sync,
    ) -> Vec<Column> {
        let of_stretch = |index: usize, out: &mut [Column]| {
            let mut table = vec![0.0; self.stretches[index].motion.len() * width];
            table.chunks_exact_mut(width).enumerate().for_each(|(k, row)| features(index, k, row));
            self.append(&self.nominal, (index, joint), &mut table, out);
        };
        self.by_stretch(width, of_stretch)
    }

    /// Lowest and highest value of a joint's positions.
    pub fn range(&self, joint: usize) -> [f64; 2] {
        union(&self.range_by_stretch(joint))
    }

    /// The same of each stretch.
    pub fn range_by_stretch(&self, joint: usize) -> Vec<[f64; 2]> {
        let positions = |stretch: &Stretch| -> [f64; 2] {
            let own = stretch.motion.q.iter().skip(joint).step_by(self.dof());
            own.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], q| {
                [low.min(*q), high.max(*q)]
            })
        };
        self.stretches.iter().map(positions).collect()
    }

    /// What the logs show of a joint.
    pub fn ranges(&self, joint: usize) -> &JointRanges {
        &self.ranges[joint]
    }

    fn ranges_of(&self, joint: usize) -> JointRanges {
        let torque = &self.y[joint];
        JointRanges {
            position: self.range(joint),
            torque: rms(torque),
            largest_torque: torque.iter().fold(0.0, |largest, tau| f64::max(largest, tau.abs())),
            time: self.time_span(),
            band_hz: self.band_hz,
        }
    }

    fn speed_step(&self, joint: usize) -> f64 {
        let n = self.dof();
        let speeds = |stretch: &Stretch| -> Vec<f64> {
            stretch.motion.dq.iter().skip(joint).step_by(n).copied().collect()
        };
        let reverses = |pair: &[f64]| (pair[0] * pair[1] < 0.0).then(|| (pair[1] - pair[0]).abs());
        let steps = |stretch: &Stretch| -> Vec<f64> {
            speeds(stretch).windows(2).filter_map(reverses).collect()
        };
        let mut steps: Vec<f64> = self.stretches.iter().flat_map(steps).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or_default()
    }

    /// First and last time of the session, s.
    pub fn time_span(&self) -> [f64; 2] {
        let times = self.stretches.iter().flat_map(|s| s.time.iter());
        times.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], t| [low.min(*t), high.max(*t)])
    }

    /// Time of a row, s.
    pub fn time_of(&self, (stretch, sample): (usize, usize)) -> f64 {
        self.stretches[stretch].time[sample]
    }
}

impl Stretch {
    pub fn trajectory(&self) -> Trajectory<'_> {
        Trajectory {
            samples: self.motion.samples(),
            rate_hz: self.motion.rate_hz,
            time: &self.time,
            channels: &self.motion.channels,
        }
    }
}

/// Samples at which a joint sticks, or hardly moves for longer than its acceleration before and
/// after explains: while it does, dry friction holds it with any torque up to the Coulomb level,
/// and no model can say which.
///
/// - `smear`: how far the filter of the equation carries the torque of such a moment, s
fn sticking(motion: &Motion, joint: usize, top_speed: f64, smear: f64) -> Vec<bool> {
    /// Share of the top speed below which a joint may stick.
    const SLOW: f64 = 0.03;
    /// A joint sticks that is slow for so many times longer than its acceleration explains.
    const PATIENCE: f64 = 1.4;
    /// Time before and after in which its acceleration is looked at, s.
    const AROUND_S: f64 = 0.1;
    let n = motion.dq.len() / motion.len().max(1);
    let samples = motion.len();
    let speed = |k: usize| motion.dq[k * n + joint].abs();
    let (limit, around) = (SLOW * top_speed, (AROUND_S * motion.rate_hz).max(1.0) as usize);
    let margin = (smear * motion.rate_hz).ceil() as usize;
    let mut sticks = vec![false; samples];
    let mut first = 0;
    while first < samples {
        if speed(first) >= limit {
            first += 1;
            continue;
        }
        let end = (first..samples).find(|&k| speed(k) >= limit).unwrap_or(samples);
        let (before, after) = (first.saturating_sub(around), (end + around).min(samples - 1));
        let gained = 0.5 * (speed(before) + speed(after)) - limit;
        let expected = 2.0 * limit / (gained.max(0.1 * limit) / around as f64);
        if (end - first) as f64 > PATIENCE * expected + 2.0 {
            sticks[first.saturating_sub(margin)..(end + margin).min(samples)].fill(true);
        }
        first = end;
    }
    sticks
}

/// Time until the joint moves the other way, s; infinite if it does not any more.
fn until_reversal(motion: &Motion, joint: usize) -> Vec<f64> {
    let n = motion.dq.len() / motion.len().max(1);
    let (mut wait, mut sign) = (f64::INFINITY, 0.0);
    let mut times = vec![f64::INFINITY; motion.len()];
    for k in (0..motion.len()).rev() {
        let now = sgn(motion.dq[k * n + joint]);
        if now != 0.0 && sign != 0.0 && now != sign {
            wait = 0.0;
        }
        sign = if now == 0.0 { sign } else { now };
        times[k] = wait;
        wait += 1.0 / motion.rate_hz;
    }
    times
}

/// A band that is wider by less than this factor than one in which the acceleration is no noise is
/// none the worse for it.
const MUCH_WIDER: f64 = 1.2;

/// Per joint a band, Hz, in which the noise of the positions makes less torque than the noise of
/// the torque. Beyond it the acceleration is noise, and what smooths the prediction, a lag, would
/// seem to be missing.
///
/// White noise of the position with standard deviation s at rate f leaves (2 pi)² s sqrt(2 B⁵ / (5
/// f)) in the acceleration below B, white noise of the torque t sqrt(2 B / f).
fn quiet_bands(model: &TorqueModel, recordings: &[Recording]) -> Result<Vec<f64>, DiagnosisError> {
    /// Share of the noise of the torque that the noise of the position may make.
    const SHARE: f64 = 0.5;
    let (_, choices) = Processing::choose(recordings, &Default::default())?;
    let robot = model.identified_robot();
    let n = robot.dof();
    let mut ws = Workspace::new(robot);
    let names = model.parameter_set().names();
    let mut of_joint = |joint: usize| {
        let name = format!("{}.Ia", robot.joints()[joint].name);
        let rotor = names
            .iter()
            .position(|own| *own == name)
            .map_or(0.0, |index| model.parameters()[index]);
        let (mut mass, mut count) = (0.0, 0.0);
        let mut differences: Vec<f64> = Vec::new();
        for recording in recordings {
            for q in recording.position().chunks_exact(n).step_by(POSES) {
                mass += (mass_matrix(robot, &mut ws, q)[joint * n + joint] + rotor).abs();
                count += 1.0;
            }
            let Some(tau) = recording.torque() else { continue };
            let own: Vec<f64> = tau.iter().skip(joint).step_by(n).copied().collect();
            differences.extend(own.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()));
        }
        differences.sort_by(f64::total_cmp);
        let median = differences.get(differences.len() / 2).copied().unwrap_or_default();
        let torque = median / (MEDIAN_OF_NORMAL * 6f64.sqrt());
        let position = choices.iter().map(|choice| choice.noise[joint]).fold(0.0, f64::max);
        let acceleration = std::f64::consts::TAU.powi(2) * position * mass / f64::max(count, 1.0);
        if acceleration > 0.0 && torque > 0.0 {
            (SHARE * 5f64.sqrt() * torque / acceleration).sqrt()
        } else {
            f64::INFINITY
        }
    };
    Ok((0..n).map(&mut of_joint).collect())
}

/// The band, Hz, in which the acceleration of no joint is noise, as far as rows enough are left, if
/// that of the model is much wider.
///
/// - `quiet`: that of each joint, and the lowest of which the logs are long enough
fn narrower(
    (quiet, least): (&[f64], f64),
    parameters: usize,
    recordings: &[Recording],
    processing: &Processing,
) -> Option<f64> {
    /// Lowest band, Hz.
    const LOWEST_HZ: f64 = 3.0;
    /// Rows of a joint that have to be left for each parameter of the arm.
    const ROWS_EACH: f64 = 10.0;
    let seconds = recordings.iter().map(Recording::duration).sum::<f64>().max(1e-9);
    let rows = ROWS_EACH * parameters as f64;
    let lowest = (rows / (ROWS_PER_CUTOFF * seconds)).max(least).clamp(LOWEST_HZ, BAND_HZ);
    let band = quiet.iter().copied().fold(f64::INFINITY, f64::min).max(lowest);
    (processing.cutoff_hz > MUCH_WIDER * band).then_some(band)
}

/// The largest torque of a joint in the logs, if it stays there again and again: a limit of drive
/// or logger.
fn flat_top(stretches: &[Stretch], joint: usize) -> Option<f64> {
    /// As many samples in a row are no chance ...
    const RUN: usize = 4;
    /// ... and this share of all samples is worth a word.
    const SHARE: f64 = 0.002;
    let of_joint = |stretch: &Stretch| -> Vec<f64> {
        let n = stretch.motion.use_as.len() / stretch.motion.len().max(1);
        stretch
            .motion
            .tau
            .iter()
            .flat_map(|tau| tau.iter().skip(joint).step_by(n.max(1)).map(|t| t.abs()))
            .collect()
    };
    let all: Vec<Vec<f64>> = stretches.iter().map(of_joint).collect();
    let limit = all.iter().flatten().copied().fold(0.0, f64::max);
    let runs = all
        .iter()
        .flat_map(|tau| tau.chunk_by(|a, b| a == b))
        .filter(|run| run[0] == limit && run.len() >= RUN);
    let flat: usize = runs.map(<[f64]>::len).sum();
    let samples: usize = all.iter().map(Vec::len).sum();
    (limit > 0.0 && flat as f64 > SHARE * samples as f64).then_some(limit)
}

/// Every so many samples a mass matrix for its mean.
const POSES: usize = 200;

/// Median of the absolute value of a standard normal variable.
const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// Whether links of the robot file can be those of the arm: at some joint they make a tenth or more
/// of the torque that links make which take all that rotors need not. If not, the file has
/// placeholders.
fn are_of_this_arm(
    with_file: &TorqueModel,
    with_links: &TorqueModel,
    stretches: &[Stretch],
) -> bool {
    /// A tenth.
    const PART: f64 = 0.1;
    let n = with_file.robot().dof();
    let energies = |model: &TorqueModel| {
        let mut sums = vec![0.0; n];
        for stretch in stretches {
            let torque = model.rigid(&stretch.trajectory()).rigid_torque;
            torque.iter().enumerate().for_each(|(k, torque)| sums[k % n] += torque * torque);
        }
        sums
    };
    let (of_file, of_links) = (energies(with_file), energies(with_links));
    of_file.iter().zip(&of_links).any(|(file, links)| *file >= PART * PART * links)
}

/// A robot of the same kind without what makes parameters of an arm invisible: axes that are
/// parallel, cross or stand upright. An arm that leans, or a link that is longer, shows more
/// parameters than the robot file's does.
fn generic(robot: &crate::robot::Robot) -> crate::robot::Robot {
    let gravity = robot.gravity();
    let size = 0.05 * gravity.dot(gravity).sqrt();
    (0..robot.dof())
        .fold(robot.clone(), |robot, joint| {
            let step = joint as f64;
            robot.with_placement_moved(
                joint,
                Vector3::new(0.011 + 0.003 * step, 0.017 - 0.002 * step, 0.013),
            )
        })
        .with_gravity(gravity + Vector3::new(size, 0.7 * size, 0.3 * size))
}

/// What lies between the torque of a joint and its log, applied to columns, `[samples, width]`
/// row-major.
fn transmit(model: &TorqueModel, joint: usize, rate_hz: f64, values: &mut [f64], width: usize) {
    for term in model.terms().iter().filter(|term| term.is_transform()) {
        term.effect.transmit(term.site, &term.constants, joint, rate_hz, values, width);
    }
}

/// Columns side by side, row-major.
fn interleaved(columns: &[Vec<f64>], rows: usize) -> Vec<f64> {
    let width = columns.len();
    let mut table = vec![0.0; rows * width];
    for (k, column) in columns.iter().enumerate() {
        table.iter_mut().skip(k).step_by(width).zip(column).for_each(|(own, value)| *own = *value);
    }
    table
}
