//! From samples to one triangular factor per joint: the observation matrix W and the torque,
//! without ever holding them.

use std::collections::BTreeMap;
use std::ops::Range;

use derive_setters::Setters;
use faer::Mat;
use rayon::prelude::*;

use super::{BaseParameters, ClosedLoop, IdentificationError, ParameterSet};
use sgpr_predict::internal::for_each_regressor_block;

use crate::dynamics::{BatchWorkspace, Samples};
use crate::effects::JointState;
use crate::linalg::{Matrix, TriangularFactor, dot_in_lanes, triangle};
use crate::robot::Robot;
use crate::signal::LowPass;
use crate::spatial::PARAMETERS_PER_LINK;

/// The equations W base = tau of a robot, collected joint by joint.
///
/// The rows of a joint contain few of the columns (the thesis's W is block triangular), and all its
/// rows in motion have one noise level and all at rest another, so each joint keeps two factors of
/// its own. Memory is bounded whatever the length of the log.
#[derive(Debug)]
pub struct Observation<'a> {
    source: RowSource<'a>,
    /// Per part and joint: rows in motion, rows at rest.
    parts: Vec<Vec<[TriangularFactor; 2]>>,
    /// Rows that are kept beside, if they are to be and are few enough.
    kept: Option<KeptRows>,
    /// Trajectories that were added.
    trajectories: usize,
}

/// The rows of equations, kept for another pass through them.
#[derive(Debug)]
pub(crate) struct KeptRows {
    joints: Vec<KeptJointRows>,
}

#[derive(Debug)]
struct KeptJointRows {
    columns: Vec<usize>,
    /// `[rows, columns + 1]`, the torque last.
    rows: Vec<f64>,
    /// Trajectory and sample of each, and whether the joint stands.
    of: Vec<(usize, usize, bool)>,
}

impl KeptRows {
    /// Most numbers that are kept: 32 MB.
    const MOST: usize = 1 << 22;

    /// Visits every equation that is good for something, joint by joint, trajectory by trajectory,
    /// sample by sample.
    pub fn for_each(&self, mut visit: impl FnMut(Equation<'_>)) {
        for (joint, KeptJointRows { columns, rows, of }) in self.joints.iter().enumerate() {
            for (row, &(trajectory, sample, resting)) in
                rows.chunks_exact(columns.len() + 1).zip(of)
            {
                visit(Equation { trajectory, sample, joint, resting, columns, row });
            }
        }
    }

    fn numbers(&self) -> usize {
        self.joints.iter().map(|joint| joint.rows.len()).sum()
    }
}

/// Which of `pieces` of as many samples each a sample lies in: piece k begins at sample
/// `k * count / pieces`.
pub(crate) fn piece_of(sample: usize, count: usize, pieces: usize) -> usize {
    ((sample + 1) * pieces - 1) / count
}

/// What an equation is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Nothing: the derivatives are not right there.
    Skip,
    /// The joint moves.
    Moving,
    /// The joint stands: dry friction holds it with an unknown torque, which makes the equation a
    /// rough one.
    Resting,
}

/// R of the rows of one joint: RᵀR = [W tau]ᵀ[W tau].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct JointFactor {
    /// Joint.
    pub joint: usize,
    /// Whether these are the rows at which the joint stands.
    pub resting: bool,
    /// Base parameters whose columns are in the factor; one more column is the torque.
    pub columns: Vec<usize>,
    /// `[columns + 1, columns + 1]`, upper triangular.
    pub factor: Matrix,
    /// Number of rows.
    pub rows: usize,
    /// Noise that its rows have at least, N·m (N), whatever a fit leaves of them; 0 if nothing is
    /// known.
    pub least_noise: f64,
}

/// One factor for all rows of each joint and kind: joints in motion, then joints at rest.
pub(crate) fn stacked<'a>(factors: impl IntoIterator<Item = &'a JointFactor>) -> Vec<JointFactor> {
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
        for (k, one) in
            std::iter::once(&factor).chain(part.iter().map(|one| &one.factor)).enumerate()
        {
            all.as_mut().subrows_mut(k * width, width).copy_from(one.as_ref());
        }
        factor = triangle(all.as_ref()).into();
    }
    JointFactor { factor, rows: group.iter().map(|one| one.rows).sum(), ..group[0].clone() }
}

/// Which base parameters stand in the rows of a joint, and where.
#[derive(Clone, Debug)]
struct RowLayout {
    columns: Vec<usize>,
    /// Per link: (parameter of the link, position in the row).
    of_link: Vec<Vec<(usize, usize)>>,
    /// (Position in the joint's effect row, position in the row).
    of_effects: Vec<(usize, usize)>,
    /// (Index into the columns of the trajectory, position in the row).
    of_trajectory: Vec<(usize, usize)>,
}

impl RowLayout {
    fn new(joint: usize, robot: &Robot, set: &ParameterSet, base: &BaseParameters) -> Self {
        let effects = set.effect_parameters_of(joint);
        let mut layout = Self {
            columns: vec![],
            of_link: vec![vec![]; robot.dof()],
            of_effects: vec![],
            of_trajectory: vec![],
        };
        for (column, &parameter) in base.independent().iter().enumerate() {
            let position = layout.columns.len();
            if parameter < set.inertial() {
                let (link, of_link) =
                    (parameter / PARAMETERS_PER_LINK, parameter % PARAMETERS_PER_LINK);
                if !robot.carries(joint, link) {
                    continue;
                }
                layout.of_link[link].push((of_link, position));
            } else if let Some(index) = effects.iter().position(|own| *own == parameter) {
                layout.of_effects.push((index, position));
            } else if let Some(index) = parameter.checked_sub(set.of_state())
                && set.trajectory_columns()[index].joint.is_none_or(|own| own == joint)
            {
                layout.of_trajectory.push((index, position));
            } else {
                continue;
            }
            layout.columns.push(column);
        }
        layout
    }

    fn width(&self) -> usize {
        self.columns.len() + 1
    }
}

/// Samples of one piece of a trajectory, a whole number of blocks, few enough for the caches;
/// longer trajectories are cut.
const PIECE: usize = 4 * TriangularFactor::BLOCK;

/// Pieces are that many times as long as what they overlap by.
const OVERLAPS: usize = 12;

impl<'a> Observation<'a> {
    /// No equations yet.
    pub fn new(robot: &'a Robot, set: &'a ParameterSet, base: &BaseParameters) -> Self {
        Self::in_parts(robot, set, base, 1)
    }

    /// No equations yet; they will be kept apart by the part that they are added to
    /// ([`Self::add_to`]), [`Self::parts`].
    ///
    /// # Panics
    /// If there is no part.
    pub fn in_parts(
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &BaseParameters,
        parts: usize,
    ) -> Self {
        assert!(parts > 0, "one part at least");
        let source = RowSource::new(robot, set, base);
        let factors = |_| {
            let layouts = source.layouts.iter();
            layouts.map(|layout| [(); 2].map(|()| TriangularFactor::new(layout.width()))).collect()
        };
        Self { parts: (0..parts).map(factors).collect(), source, kept: None, trajectories: 0 }
    }

    /// The same, which keeps the rows that are added if they are few enough ([`Self::kept`]).
    pub(crate) fn keeping_rows(mut self) -> Self {
        let layouts = self.source.layouts.iter();
        let joint = |layout: &RowLayout| KeptJointRows {
            columns: layout.columns.clone(),
            rows: vec![],
            of: vec![],
        };
        self.kept = Some(KeptRows { joints: layouts.map(joint).collect() });
        self
    }

    /// The rows that were added; `None` if they were not to be kept, or too many.
    pub(crate) fn kept(&mut self) -> Option<KeptRows> {
        self.kept.take()
    }

    /// Adds the equations of samples as they are.
    ///
    /// - `tau`: `[samples, n]`, N·m (N)
    /// - `use_as`: `[samples, n]`, what the equations are good for; all are in motion if `None`
    ///
    /// # Errors
    /// If a value is not finite.
    ///
    /// # Panics
    /// If the arrays do not hold the same samples.
    pub fn add_samples(
        &mut self,
        samples: Samples<'_>,
        tau: &[f64],
        use_as: Option<&[Row]>,
    ) -> Result<(), IdentificationError> {
        self.add(&Trajectory { use_as, ..Trajectory::new(samples, tau) })
    }

    /// Adds the equations of one uniformly sampled trajectory, both sides passed through `filter`,
    /// every `decimation`-th row taken.
    ///
    /// Filtering both sides alike keeps the equation true and takes the torque noise beyond the
    /// band of the motion out. Source: M. Gautier, Dynamic identification of robots with power
    /// model, IEEE ICRA (1997), parallel filtering.
    ///
    /// # Errors
    /// If a value is not finite or the trajectory shorter than the filter.
    ///
    /// # Panics
    /// If the arrays do not hold the same samples.
    pub fn add_trajectory(
        &mut self,
        samples: Samples<'_>,
        tau: &[f64],
        use_as: Option<&[Row]>,
        filter: &LowPass,
        decimation: usize,
    ) -> Result<(), IdentificationError> {
        self.add(&Trajectory {
            use_as,
            filter: Some(filter),
            decimation,
            ..Trajectory::new(samples, tau)
        })
    }

    /// The factors of all joints in motion, then those of the joints at rest; without those that
    /// have no row.
    pub fn factors(&self) -> Vec<JointFactor> {
        stacked(self.parts().iter().flatten())
    }

    /// The factors of each part.
    pub fn parts(&self) -> Vec<Vec<JointFactor>> {
        self.parts.iter().map(|factors| self.factors_of(factors)).collect()
    }

    fn factors_of(&self, factors: &[[TriangularFactor; 2]]) -> Vec<JointFactor> {
        let of_kind = |resting: bool| {
            let joints = self.source.layouts.iter().zip(factors).enumerate();
            joints.map(move |(joint, (layout, factors))| {
                (joint, layout, &factors[usize::from(resting)], resting)
            })
        };
        let factor =
            |(joint, layout, factor, resting): (usize, &RowLayout, &TriangularFactor, bool)| {
                JointFactor {
                    joint,
                    resting,
                    columns: layout.columns.clone(),
                    factor: factor.factor(),
                    rows: factor.rows(),
                    least_noise: 0.0,
                }
            };
        of_kind(false)
            .chain(of_kind(true))
            .filter(|(_, _, factor, _)| factor.rows() > 0)
            .map(factor)
            .collect()
    }

    /// Adds the equations of a trajectory, to the first part.
    ///
    /// # Errors
    /// If a value is not finite or the trajectory shorter than the filter.
    ///
    /// # Panics
    /// If the arrays do not hold the same samples.
    pub fn add(&mut self, trajectory: &Trajectory<'_>) -> Result<(), IdentificationError> {
        self.add_to(trajectory, |_| 0)
    }

    /// Adds the equations of a trajectory, those of each sample to the part that `part` names.
    ///
    /// # Errors
    /// As [`Self::add`].
    ///
    /// # Panics
    /// As [`Self::add`], and if there is no such part.
    pub fn add_to(
        &mut self,
        trajectory: &Trajectory<'_>,
        part: impl Fn(usize) -> usize + Sync,
    ) -> Result<(), IdentificationError> {
        let n = self.source.robot.dof();
        let (parts, kept, index) = (&mut self.parts, &mut self.kept, self.trajectories);
        self.trajectories += 1;
        let count = parts.len();
        let Trajectory { use_as, decimation, .. } = *trajectory;
        let kind = |sample: usize, joint: usize| {
            let row = use_as.map_or(Row::Moving, |use_as| use_as[sample * n + joint]);
            (if row == Row::Skip { 0 } else { part(sample) }, row)
        };
        self.source.for_each_piece(trajectory, |piece| {
            let mut joints: Vec<Vec<&mut [TriangularFactor; 2]>> =
                (0..n).map(|_| Vec::with_capacity(count)).collect();
            for part in parts.iter_mut() {
                joints.iter_mut().zip(part).for_each(|(own, factors)| own.push(factors));
            }
            if kept.as_ref().is_some_and(|kept| kept.numbers() > KeptRows::MOST) {
                *kept = None;
            }
            let mut keep: Vec<Option<&mut KeptJointRows>> = match kept.as_mut() {
                Some(kept) => kept.joints.iter_mut().map(Some).collect(),
                None => (0..n).map(|_| None).collect(),
            };
            joints.par_iter_mut().zip(&mut keep).enumerate().for_each(|(joint, (parts, keep))| {
                let (rows, width) = piece.rows(joint);
                if let Some(keep) = keep {
                    for (sample, row) in
                        piece.samples.clone().zip(rows.chunks_exact(width)).step_by(decimation)
                    {
                        let row_kind = kind(sample, joint).1;
                        if row_kind != Row::Skip {
                            keep.rows.extend_from_slice(row);
                            keep.of.push((index, sample, row_kind == Row::Resting));
                        }
                    }
                }
                let mut push = |(part, row): (usize, Row), rows: &[f64]| match row {
                    Row::Skip => {}
                    Row::Moving => parts[part][0].push_all(rows),
                    Row::Resting => parts[part][1].push_all(rows),
                };
                let samples = piece.samples.clone();
                if decimation > 1 {
                    let taken = samples.zip(rows.chunks_exact(width)).step_by(decimation);
                    taken.for_each(|(sample, row)| push(kind(sample, joint), row));
                    return;
                }
                // Neighbours that go to the same factor go together.
                let mut first = samples.start;
                while first < samples.end {
                    let own = kind(first, joint);
                    let end = (first + 1..samples.end).find(|sample| kind(*sample, joint) != own);
                    let end = end.unwrap_or(samples.end);
                    push(
                        own,
                        &rows[(first - samples.start) * width..(end - samples.start) * width],
                    );
                    first = end;
                }
            });
        })
    }
}

/// One uniformly sampled stretch of motion and torque, and how its equations are taken.
#[derive(Clone, Copy, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Trajectory<'a> {
    /// Motion.
    pub samples: Samples<'a>,
    /// Torque, `[samples, n]`, N·m (N).
    pub tau: &'a [f64],
    /// `[samples, n]`, what the equations are good for; all are in motion if `None`.
    pub use_as: Option<&'a [Row]>,
    /// Low-pass on both sides of the equation.
    pub filter: Option<&'a LowPass>,
    /// Every how many rows are taken.
    pub decimation: usize,
    /// The same motion without its measurement noise, from a simulation or the reference: for
    /// [`INSTRUMENTAL_VARIABLES`](super::INSTRUMENTAL_VARIABLES).
    pub instruments: Option<Samples<'a>>,
    /// Controller and reference of the motion, for [`OUTPUT_ERROR`](super::OUTPUT_ERROR), and to
    /// simulate instruments with where none are given.
    pub closed_loop: Option<&'a ClosedLoop<'a>>,
    /// Values of [`ParameterSet::trajectory_columns`], `[samples]` each, `[samples, n]` where a
    /// column is part of the torque of all joints.
    pub columns: &'a [Vec<f64>],
    /// `[n]`, how much of the torque of each joint the log shows; all of it if empty. Values of
    /// `columns` are as logged.
    pub gains: &'a [f64],
}

impl<'a> Trajectory<'a> {
    /// Samples as they are, all of them in motion.
    ///
    /// - `tau`: `[samples, n]`, N·m (N)
    pub fn new(samples: Samples<'a>, tau: &'a [f64]) -> Self {
        Self {
            samples,
            tau,
            use_as: None,
            filter: None,
            decimation: 1,
            instruments: None,
            closed_loop: None,
            columns: &[],
            gains: &[],
        }
    }
}

/// One equation, row * base = torque.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Equation<'a> {
    /// Index of the trajectory.
    pub trajectory: usize,
    /// Sample of the trajectory.
    pub sample: usize,
    /// Joint.
    pub joint: usize,
    /// Whether the joint stands.
    pub resting: bool,
    /// Base parameters in the row.
    pub columns: &'a [usize],
    /// Their factors; the torque comes last.
    pub row: &'a [f64],
}

impl Equation<'_> {
    /// Torque of the joint, N·m (N).
    pub fn torque(&self) -> f64 {
        self.row[self.columns.len()]
    }

    /// Torque that `base` gives.
    pub fn predicted(&self, base: &[f64]) -> f64 {
        self.columns.iter().zip(self.row).map(|(&column, factor)| factor * base[column]).sum()
    }

    /// Measured minus predicted.
    pub fn residual(&self, base: &[f64]) -> f64 {
        self.torque() - self.predicted(base)
    }
}

/// The equations of several trajectories, made anew each time they are gone through: memory stays
/// bounded, and methods that look at single rows can go through them as often as they need.
#[derive(Debug)]
pub struct Equations<'a> {
    source: RowSource<'a>,
    base: &'a BaseParameters,
    trajectories: Vec<Trajectory<'a>>,
}

impl<'a> Equations<'a> {
    /// The equations of these trajectories.
    pub fn new(
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &'a BaseParameters,
        trajectories: Vec<Trajectory<'a>>,
    ) -> Self {
        Self { source: RowSource::new(robot, set, base), base, trajectories }
    }

    /// The robot.
    pub fn robot(&self) -> &'a Robot {
        self.source.robot
    }

    /// All its parameters.
    pub fn parameter_set(&self) -> &'a ParameterSet {
        self.source.set
    }

    /// The unknowns.
    pub fn base(&self) -> &'a BaseParameters {
        self.base
    }

    /// The trajectories.
    pub fn trajectories(&self) -> &[Trajectory<'a>] {
        &self.trajectories
    }

    /// Visits every equation that is good for something, trajectory by trajectory, sample by
    /// sample, joint by joint.
    ///
    /// # Errors
    /// If a value is not finite or a trajectory shorter than its filter.
    pub fn for_each(
        &mut self,
        mut visit: impl FnMut(Equation<'_>),
    ) -> Result<(), IdentificationError> {
        for index in 0..self.trajectories.len() {
            let trajectory = self.trajectories[index];
            self.visit(index, &trajectory, &mut visit)?;
        }
        Ok(())
    }

    /// As [`Self::for_each`], with the row that the instruments give in the place of the measured
    /// one beside it; the torque of the instruments' row has no meaning.
    pub(super) fn for_each_with_instruments(
        &mut self,
        mut visit: impl FnMut(Equation<'_>, &[f64]),
    ) -> Result<(), IdentificationError> {
        for index in 0..self.trajectories.len() {
            let trajectory = self.trajectories[index];
            let samples = trajectory
                .instruments
                .ok_or(IdentificationError::NoInstruments { trajectory: index })?;
            assert_eq!(samples.q.len(), trajectory.samples.q.len(), "one instrument per sample");
            let mut rows: Vec<f64> = Vec::new();
            let instruments = Trajectory { samples, ..trajectory };
            self.visit(index, &instruments, |equation| rows.extend_from_slice(equation.row))?;
            let mut rest = &rows[..];
            self.visit(index, &trajectory, |equation| {
                let (row, later) = rest.split_at(equation.row.len());
                rest = later;
                visit(equation, row);
            })?;
        }
        Ok(())
    }

    fn visit(
        &mut self,
        index: usize,
        trajectory: &Trajectory<'_>,
        mut visit: impl FnMut(Equation<'_>),
    ) -> Result<(), IdentificationError> {
        let n = self.source.robot.dof();
        self.source.for_each_piece(trajectory, |piece| {
            for (k, sample) in piece.samples.clone().enumerate().step_by(trajectory.decimation) {
                for joint in 0..n {
                    let kind =
                        trajectory.use_as.map_or(Row::Moving, |use_as| use_as[sample * n + joint]);
                    if kind == Row::Skip {
                        continue;
                    }
                    let (rows, width) = piece.rows(joint);
                    visit(Equation {
                        trajectory: index,
                        sample,
                        joint,
                        resting: kind == Row::Resting,
                        columns: piece.columns(joint),
                        row: &rows[k * width..(k + 1) * width],
                    });
                }
            }
        })
    }

    /// The factors of all equations, as of an [`Observation`].
    ///
    /// # Errors
    /// As [`Self::for_each`].
    pub fn factors(&self) -> Result<Vec<JointFactor>, IdentificationError> {
        let mut observation = Observation::new(self.source.robot, self.source.set, self.base);
        self.trajectories.iter().try_for_each(|trajectory| observation.add(trajectory))?;
        Ok(observation.factors())
    }
}

/// What makes the rows of a trajectory, piece by piece.
#[derive(Debug)]
struct RowSource<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    layouts: Vec<RowLayout>,
    /// One per thread.
    workspaces: Vec<BatchWorkspace>,
    /// Rows of each joint in the present piece of a trajectory, `[samples, columns + 1]`, the
    /// torque last.
    rows: Vec<Vec<f64>>,
}

/// Rows of consecutive samples.
struct Piece<'a> {
    samples: Range<usize>,
    /// Samples before them in the buffers.
    before: usize,
    layouts: &'a [RowLayout],
    buffers: &'a [Vec<f64>],
}

impl Piece<'_> {
    /// Rows of a joint and their width.
    fn rows(&self, joint: usize) -> (&[f64], usize) {
        let width = self.layouts[joint].width();
        (&self.buffers[joint][self.before * width..][..self.samples.len() * width], width)
    }

    fn columns(&self, joint: usize) -> &[usize] {
        &self.layouts[joint].columns
    }
}

impl<'a> RowSource<'a> {
    fn new(robot: &'a Robot, set: &'a ParameterSet, base: &BaseParameters) -> Self {
        let layouts: Vec<_> =
            (0..robot.dof()).map(|joint| RowLayout::new(joint, robot, set, base)).collect();
        crate::threads::prepare();
        let workspaces =
            (0..rayon::current_num_threads()).map(|_| BatchWorkspace::new(robot)).collect();
        Self { robot, set, rows: vec![Vec::new(); layouts.len()], layouts, workspaces }
    }

    /// Rows of a trajectory, filtered and not yet decimated.
    fn for_each_piece(
        &mut self,
        trajectory: &Trajectory<'_>,
        mut take: impl FnMut(Piece<'_>),
    ) -> Result<(), IdentificationError> {
        let Trajectory { samples, tau, use_as, filter, decimation, columns, gains, .. } =
            *trajectory;
        let n = self.robot.dof();
        let count = samples.count(n);
        assert_eq!(tau.len(), count * n, "one torque per position");
        assert!(gains.is_empty() || gains.len() == n, "one gain per joint");
        assert_eq!(
            columns.len(),
            self.set.trajectory_columns().len(),
            "every column of the trajectory"
        );
        assert!(use_as.is_none_or(|use_as| use_as.len() == count * n), "one entry per equation");
        require_finite(
            &[
                ("position", samples.q),
                ("velocity", samples.dq),
                ("acceleration", samples.ddq),
                ("torque", tau),
            ],
            n,
        )?;
        for (values, column) in columns.iter().zip(self.set.trajectory_columns()) {
            let width = if column.joint.is_some() { 1 } else { n };
            require_finite(&[("a column of an effect", values)], width)?;
        }

        // A filtered piece reaches over its ends by as much as the filter remembers, to fifteen
        // digits, and is long against that; otherwise pieces stay in the cache.
        let (piece, overlap) = match filter {
            None => (PIECE, 0),
            Some(filter) => {
                let overlap = 8 * filter.settling_samples();
                (PIECE.max(OVERLAPS * overlap), overlap)
            }
        };
        let piece = piece.next_multiple_of(decimation);
        let mut start = 0;
        while start < count {
            let end = if count - start < piece + overlap { count } else { start + piece };
            let reach = start.saturating_sub(overlap)..(end + overlap).min(count);
            self.fill(trajectory, reach.clone());
            let rows = self.rows.par_iter_mut().zip(&self.layouts).enumerate();
            let results = rows.map(|(joint, (rows, layout))| {
                if let Some(filter) = filter {
                    filter.apply(rows, layout.width())?;
                }
                require_squares(rows, layout.width(), joint, reach.start)
            });
            results.collect::<Vec<_>>().into_iter().collect::<Result<(), IdentificationError>>()?;
            let (layouts, buffers) = (&self.layouts[..], &self.rows[..]);
            take(Piece { samples: start..end, before: start - reach.start, layouts, buffers });
            start = end;
        }
        Ok(())
    }

    /// Sets `rows` to the equations of the samples in `range`, each thread those of a part of it.
    fn fill(&mut self, trajectory: &Trajectory<'_>, range: Range<usize>) {
        let Self { robot, set, layouts, rows, workspaces } = self;
        let parts = workspaces.len();
        let part = |k: usize| {
            range.start + k * range.len() / parts..range.start + (k + 1) * range.len() / parts
        };
        let mut of_parts: Vec<Vec<&mut [f64]>> =
            (0..parts).map(|_| Vec::with_capacity(layouts.len())).collect();
        for (rows, layout) in rows.iter_mut().zip(layouts.iter()) {
            rows.resize(range.len() * layout.width(), 0.0);
            let mut rest = &mut rows[..];
            for (k, own) in of_parts.iter_mut().enumerate() {
                let (first, others) = rest.split_at_mut(part(k).len() * layout.width());
                own.push(first);
                rest = others;
            }
        }
        let of_threads = workspaces.par_iter_mut().zip(of_parts).enumerate();
        of_threads.for_each(|(k, (ws, mut rows))| {
            fill_rows(robot, set, layouts, trajectory, part(k), (ws, &mut rows))
        });
    }
}

/// Sets the rows of each joint to the equations of the samples in `range`.
fn fill_rows(
    robot: &Robot,
    set: &ParameterSet,
    layouts: &[RowLayout],
    trajectory: &Trajectory<'_>,
    range: Range<usize>,
    (ws, rows): (&mut BatchWorkspace, &mut [&mut [f64]]),
) {
    let Trajectory { samples, tau, columns, gains, .. } = *trajectory;
    let n = robot.dof();
    let gain = |joint: usize| gains.get(joint).copied().unwrap_or(1.0);
    let cut = range.start * n..range.end * n;
    let piece = Samples {
        q: &samples.q[cut.clone()],
        dq: &samples.dq[cut.clone()],
        ddq: &samples.ddq[cut],
    };
    for_each_regressor_block(
        robot,
        ws,
        piece,
        #[inline(always)]
        |joint, link, first, count, block| {
            let (layout, gain) = (&layouts[joint], gain(joint));
            let width = layout.width();
            let rows = rows[joint][first * width..].chunks_exact_mut(width);
            for (k, row) in rows.take(count).enumerate() {
                for &(parameter, position) in &layout.of_link[link] {
                    row[position] = gain * block[parameter][k];
                }
            }
        },
    );
    let mut effects = vec![0.0; set.effect_columns_per_joint()];
    for (k, sample) in range.enumerate() {
        let at = sample * n..(sample + 1) * n;
        let state = JointState {
            q: &samples.q[at.clone()],
            dq: &samples.dq[at.clone()],
            ddq: &samples.ddq[at],
        };
        for joint in 0..n {
            let (layout, gain) = (&layouts[joint], gain(joint));
            let width = layout.width();
            let row = &mut rows[joint][k * width..(k + 1) * width];
            set.effect_row(joint, &state, &mut effects);
            for &(index, position) in &layout.of_effects {
                row[position] = gain * effects[index];
            }
            for &(index, position) in &layout.of_trajectory {
                let own = set.trajectory_columns()[index].joint.is_some();
                row[position] = columns[index][if own { sample } else { sample * n + joint }];
            }
            row[width - 1] = tau[sample * n + joint];
        }
    }
}

/// Largest sum of squares over a piece: with it no product of sums over any log overflows.
const LARGEST_SQUARES: f64 = 1e200;

/// Refuses rows whose squares overflow: robot and channels have numbers that no arm has.
///
/// - `rows`: of a joint, from the sample `first` on
fn require_squares(
    rows: &[f64],
    width: usize,
    joint: usize,
    first: usize,
) -> Result<(), IdentificationError> {
    // Not a number where a product was none.
    if dot_in_lanes(rows, rows) <= LARGEST_SQUARES {
        return Ok(());
    }
    let size = |value: f64| if value.is_nan() { f64::INFINITY } else { value.abs() };
    let most = rows.iter().copied().enumerate().max_by(|a, b| size(a.1).total_cmp(&size(b.1)));
    most.map_or(Ok(()), |(index, value)| {
        Err(IdentificationError::TooLarge { sample: first + index / width, joint, value })
    })
}

fn require_finite(arrays: &[(&'static str, &[f64])], n: usize) -> Result<(), IdentificationError> {
    for (quantity, values) in arrays {
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            let (sample, joint, value) = (index / n, index % n, values[index]);
            return Err(IdentificationError::NotFinite { sample, quantity, joint, value });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::two_link;

    #[test]
    fn rows_that_are_kept_are_those_that_are_made_again() {
        let robot = two_link();
        let set = ParameterSet::new(&robot, &["viscous_friction"]).expect("a known effect");
        let base = BaseParameters::new(&robot, &set);
        let samples = 3000;
        let wave = |speed: f64, scale: f64| -> Vec<f64> {
            (0..2 * samples)
                .map(|k| scale * (speed * (k / 2) as f64 + (k % 2) as f64).sin())
                .collect()
        };
        let (q, dq, ddq, tau) =
            (wave(0.01, 1.0), wave(0.013, 2.0), wave(0.017, 3.0), wave(0.02, 9.0));
        let kinds = [Row::Moving, Row::Skip, Row::Resting, Row::Moving, Row::Moving];
        let use_as: Vec<Row> = (0..2 * samples).map(|k| kinds[k / 37 % kinds.len()]).collect();
        let filter = LowPass::butterworth(4, 10.0, 200.0).expect("a filter");
        let motion = Samples { q: &q, dq: &dq, ddq: &ddq };
        let one = Trajectory {
            use_as: Some(&use_as),
            filter: Some(&filter),
            decimation: 3,
            ..Trajectory::new(motion, &tau)
        };
        let trajectories = vec![one, Trajectory { filter: None, decimation: 1, ..one }];

        let mut observation = Observation::new(&robot, &set, &base).keeping_rows();
        trajectories
            .iter()
            .try_for_each(|trajectory| observation.add(trajectory))
            .expect("good data");
        type Seen = (usize, usize, usize, bool, Vec<usize>, Vec<f64>);
        let seen = |equation: Equation<'_>| -> Seen {
            let Equation { trajectory, sample, joint, resting, columns, row } = equation;
            (joint, trajectory, sample, resting, columns.to_vec(), row.to_vec())
        };
        let (mut kept, mut made) = (Vec::new(), Vec::new());
        observation.kept().expect("few rows").for_each(|equation| kept.push(seen(equation)));
        let mut equations = Equations::new(&robot, &set, &base, trajectories);
        equations.for_each(|equation| made.push(seen(equation))).expect("good data");
        made.sort_by_key(|(joint, trajectory, sample, ..)| (*joint, *trajectory, *sample));
        assert!(kept.len() > samples && kept == made);
        assert!(Observation::new(&robot, &set, &base).kept().is_none());
    }
}
