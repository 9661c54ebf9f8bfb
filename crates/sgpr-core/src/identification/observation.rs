//! From samples to one triangular factor per joint: the observation matrix W and the torque, without ever holding them.

use faer::Mat;

use super::{BaseParameters, IdentificationError, ParameterSet};
use crate::dynamics::{BatchWorkspace, Samples, for_each_regressor_block};
use crate::effects::JointState;
use crate::linalg::TriangularFactor;
use crate::robot::Robot;
use crate::signal::LowPass;
use crate::spatial::PARAMETERS_PER_LINK;

/// The equations W base = tau of a robot, collected joint by joint.
///
/// The rows of a joint contain few of the columns (the thesis's W is block triangular), and all its rows in motion have
/// one noise level and all at rest another, so each joint keeps two factors of its own. Memory is bounded whatever the
/// length of the log.
#[derive(Debug)]
pub struct Observation<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    layouts: Vec<Layout>,
    /// Per joint: rows in motion, rows at rest.
    factors: Vec<[TriangularFactor; 2]>,
    ws: BatchWorkspace,
    /// Rows of each joint in the present piece of a trajectory, `[samples, columns + 1]`, the torque last.
    rows: Vec<Vec<f64>>,
}

/// What an equation is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Nothing: the derivatives are not right there.
    Skip,
    /// The joint moves.
    Moving,
    /// The joint stands: dry friction holds it with an unknown torque, which makes the equation a rough one.
    Resting,
}

/// R of the rows of one joint: RᵀR = [W tau]ᵀ[W tau].
#[derive(Clone, Debug)]
pub struct JointFactor {
    /// Joint.
    pub joint: usize,
    /// Whether these are the rows at which the joint stands.
    pub resting: bool,
    /// Base parameters whose columns are in the factor; one more column is the torque.
    pub columns: Vec<usize>,
    /// `[columns + 1, columns + 1]`, upper triangular.
    pub factor: Mat<f64>,
    /// Number of rows.
    pub rows: usize,
}

/// Which base parameters stand in the rows of a joint, and where.
#[derive(Clone, Debug)]
struct Layout {
    columns: Vec<usize>,
    /// Per link: (parameter of the link, position in the row).
    of_link: Vec<Vec<(usize, usize)>>,
    /// (Position in the joint's effect row, position in the row).
    of_effects: Vec<(usize, usize)>,
}

impl Layout {
    fn new(joint: usize, robot: &Robot, set: &ParameterSet, base: &BaseParameters) -> Self {
        let effects = set.effect_parameters_of(joint);
        let mut layout = Self { columns: vec![], of_link: vec![vec![]; robot.dof()], of_effects: vec![] };
        for (column, &parameter) in base.independent().iter().enumerate() {
            let position = layout.columns.len();
            if parameter < set.inertial() {
                let (link, of_link) = (parameter / PARAMETERS_PER_LINK, parameter % PARAMETERS_PER_LINK);
                if !robot.carries(joint, link) {
                    continue;
                }
                layout.of_link[link].push((of_link, position));
            } else if let Some(index) = effects.iter().position(|own| *own == parameter) {
                layout.of_effects.push((index, position));
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

/// Numbers held at once for one piece of a trajectory; longer trajectories are cut.
const PIECE: usize = 8 << 20;

impl<'a> Observation<'a> {
    /// No equations yet.
    pub fn new(robot: &'a Robot, set: &'a ParameterSet, base: &BaseParameters) -> Self {
        let layouts: Vec<_> = (0..robot.dof()).map(|joint| Layout::new(joint, robot, set, base)).collect();
        Self {
            robot,
            set,
            factors: layouts.iter().map(|layout| [(); 2].map(|()| TriangularFactor::new(layout.width()))).collect(),
            rows: vec![Vec::new(); layouts.len()],
            layouts,
            ws: BatchWorkspace::new(robot),
        }
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
        self.add(samples, tau, use_as, None, 1)
    }

    /// Adds the equations of one uniformly sampled trajectory, both sides passed through `filter`, every
    /// `decimation`-th row taken.
    ///
    /// Filtering both sides alike keeps the equation true and takes the torque noise beyond the band of the motion out.
    /// Source: M. Gautier, Dynamic identification of robots with power model, IEEE ICRA (1997), parallel filtering.
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
        self.add(samples, tau, use_as, Some(filter), decimation)
    }

    /// The factors of all joints in motion, then those of the joints at rest; without those that have no row.
    pub fn factors(&self) -> Vec<JointFactor> {
        let of_kind = |resting: bool| {
            let joints = self.layouts.iter().zip(&self.factors).enumerate();
            joints.map(move |(joint, (layout, factors))| (joint, layout, &factors[usize::from(resting)], resting))
        };
        let factor = |(joint, layout, factor, resting): (usize, &Layout, &TriangularFactor, bool)| JointFactor {
            joint,
            resting,
            columns: layout.columns.clone(),
            factor: factor.factor(),
            rows: factor.rows(),
        };
        of_kind(false).chain(of_kind(true)).filter(|(_, _, factor, _)| factor.rows() > 0).map(factor).collect()
    }

    fn add(
        &mut self,
        samples: Samples<'_>,
        tau: &[f64],
        use_as: Option<&[Row]>,
        filter: Option<&LowPass>,
        decimation: usize,
    ) -> Result<(), IdentificationError> {
        let n = self.robot.dof();
        let count = samples.count(n);
        assert_eq!(tau.len(), count * n, "one torque per position");
        assert!(use_as.is_none_or(|use_as| use_as.len() == count * n), "one entry per equation");
        require_finite(
            &[("position", samples.q), ("velocity", samples.dq), ("acceleration", samples.ddq), ("torque", tau)],
            n,
        )?;

        // A filtered piece reaches over its ends by as much as the filter remembers, to fifteen digits, and is long
        // against that; otherwise pieces stay in the cache.
        let width: usize = self.layouts.iter().map(Layout::width).sum();
        let (piece, overlap) = match filter {
            None => (TriangularFactor::BLOCK, 0),
            Some(filter) => {
                let overlap = 8 * filter.settling_samples();
                ((PIECE / width).max(4 * overlap), overlap)
            }
        };
        let piece = piece.next_multiple_of(decimation);
        let mut start = 0;
        while start < count {
            let end = if count - start < piece + overlap { count } else { start + piece };
            let reach = start.saturating_sub(overlap)..(end + overlap).min(count);
            self.fill(samples, tau, reach.clone());
            for joint in 0..n {
                let width = self.layouts[joint].width();
                if let Some(filter) = filter {
                    filter.apply(&mut self.rows[joint], width)?;
                }
                let rows = &self.rows[joint][(start - reach.start) * width..][..(end - start) * width];
                let [moving, resting] = &mut self.factors[joint];
                if use_as.is_none() && decimation == 1 {
                    moving.push_all(rows);
                    continue;
                }
                for (sample, row) in (start..end).zip(rows.chunks_exact(width)).step_by(decimation) {
                    match use_as.map_or(Row::Moving, |use_as| use_as[sample * n + joint]) {
                        Row::Skip => {}
                        Row::Moving => moving.push(row),
                        Row::Resting => resting.push(row),
                    }
                }
            }
            start = end;
        }
        Ok(())
    }

    /// Sets `rows` to the equations of the samples in `range`.
    fn fill(&mut self, samples: Samples<'_>, tau: &[f64], range: std::ops::Range<usize>) {
        let n = self.robot.dof();
        let Self { robot, set, layouts, rows, ws, .. } = self;
        for (rows, layout) in rows.iter_mut().zip(layouts.iter()) {
            rows.resize(range.len() * layout.width(), 0.0);
        }
        let cut = range.start * n..range.end * n;
        let piece = Samples { q: &samples.q[cut.clone()], dq: &samples.dq[cut.clone()], ddq: &samples.ddq[cut] };
        for_each_regressor_block(
            robot,
            ws,
            piece,
            #[inline(always)]
            |joint, link, first, count, block| {
                let layout = &layouts[joint];
                let width = layout.width();
                let rows = rows[joint][first * width..].chunks_exact_mut(width);
                for (k, row) in rows.take(count).enumerate() {
                    for &(parameter, position) in &layout.of_link[link] {
                        row[position] = block[parameter][k];
                    }
                }
            },
        );
        let mut effects = vec![0.0; set.effect_columns_per_joint()];
        for (k, sample) in range.enumerate() {
            let at = sample * n..(sample + 1) * n;
            let state = JointState { q: &samples.q[at.clone()], dq: &samples.dq[at.clone()], ddq: &samples.ddq[at] };
            for joint in 0..n {
                let layout = &layouts[joint];
                let width = layout.width();
                let row = &mut rows[joint][k * width..(k + 1) * width];
                set.effect_row(joint, &state, &mut effects);
                for &(index, position) in &layout.of_effects {
                    row[position] = effects[index];
                }
                row[width - 1] = tau[sample * n + joint];
            }
        }
    }
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
