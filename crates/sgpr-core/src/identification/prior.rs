//! What is believed of the parameters before the data: the robot file for bodies, least norm for
//! the rest.
//!
//! Logs determine some combinations of the parameters well, others badly, some not at all. A proper
//! prior, wide where nothing is known, makes one rule of that: the posterior mean follows the data
//! where they speak and stays with the robot file where they do not. Bodies have the parameters of
//! the file with a deviation that is a share of them, in the units of each link's mass and size;
//! friction, offsets and gains are zero (or what the file says) with a deviation that makes a
//! torque as large as what the file leaves of the joint's own, in the motion of the logs.
//!
//! How wrong the file is the data say themselves: each share counts as the data are probable under
//! it, so that what well-determined combinations show of the file holds for the others.
//!
//! Source: D. J. C. MacKay, Bayesian interpolation, Neural Computation 4(3) (1992), for the choice
//! of widths by the evidence.

use faer::Mat;

use super::least_squares::{residual_norm, torque_sizes};
use super::parameter_scales::parameter_scales;
use super::{BaseParameters, JointFactor, ParameterSet};
use crate::effects::{JointState, Role};
use crate::linalg::{Matrix, cholesky, triangle};
use crate::robot::{Joint, Robot};

/// A normal prior on the base parameters: for every estimator, and for regressions that estimate
/// them beside others.
///
/// The rows of [`Self::rows`] stand below data that are in units of their noise:
///
/// ```text
/// let prior = ParameterPrior::new(robot, set, base, &nominal, &factors).chosen_by(&estimate.whitened);
/// let rows = prior.rows();           // [rank, rank + 1]: rows[.., ..rank] * base = rows[.., rank], deviation one
/// ```
#[derive(Clone, Debug)]
pub struct ParameterPrior {
    /// Base parameters of the robot file.
    of_file: Vec<f64>,
    left_by_file: Vec<f64>,
    /// Root B of the covariance B Bᵀ that bodies give to the base parameters at a relative
    /// deviation of one: what each parameter of a body, off by its deviation, adds;
    /// `[rank, inertial parameters]`.
    bodies: Mat<f64>,
    /// The same of effects, `[rank, parameters of effects]`.
    effects: Mat<f64>,
    relative_deviation: f64,
    /// What the deviations of effects are multiplied by.
    effect_scale: f64,
    non_negative: Vec<usize>,
    /// Those of them that are friction.
    friction: Vec<usize>,
    /// Base parameters that stay as the robot file has them.
    kept: Vec<usize>,
}

/// Relative deviations of the robot file among which the data choose.
pub(crate) const WIDTHS: [f64; 8] = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];

/// Torques of friction, offsets and gains as shares of what the robot file leaves, among which the
/// data choose.
pub(crate) const EFFECT_SCALES: [f64; 4] = [0.1, 0.3, 1.0, 3.0];

/// Torques that count in the evidence: of at most so many standard deviations, all rows together;
/// the noise of data without noise could not be told from rounding.
const MOST_DEVIATIONS: f64 = 1e5;

/// Deviation of a constant offset as a share of that of friction. A joint that moves one way only
/// shows the sum of its Coulomb friction and its offset; least norm shares it out by their
/// variances, ten to one.
const OFFSET_SHARE: f64 = 0.316;

/// Times that the prior pulls.
pub(super) const PULLS: usize = 2;

/// Friction that would be negative by more standard deviations than this is no chance: something
/// that the model lacks imitates it. Of a normal law one in 44 lies below.
const NO_CHANCE: f64 = 2.0;

impl ParameterPrior {
    /// The prior of a robot with effects, its bodies with a relative deviation of one.
    ///
    /// - `nominal`: all parameters of the set, those of the robot file; zero where it says nothing
    /// - `factors`: of the logs, which give the scale of each joint's torque and motion
    ///
    /// # Panics
    /// If `nominal` is not of the length of the set.
    pub fn new(
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        nominal: &[f64],
        factors: &[JointFactor],
    ) -> Self {
        assert_eq!(nominal.len(), set.len(), "every parameter of the set");
        let torque = torque_sizes(factors, robot.dof());
        let mut file = robot.standard_parameters();
        file.resize(set.len(), 0.0);
        let mut scale = parameter_scales(set, &file, &torque);
        let of_file = base.combine(nominal);
        let left = left_over(factors, &of_file, &torque);
        for (index, deviation) in effect_deviations(robot, set, base, factors, &left) {
            scale[index] = deviation;
        }
        let combination = base.matrix();
        let (rank, width) = (base.rank(), set.len());
        let root = |range: std::ops::Range<usize>| {
            Mat::from_fn(rank, range.len(), |i, k| {
                combination[i * width + range.start + k] * scale[range.start + k]
            })
        };
        let stands_alone = |k: usize| {
            let parameter = base.independent()[k];
            parameter >= set.inertial()
                && base.combination(k).is_empty()
                && set.is_non_negative(parameter)
        };
        let is_friction = |k: usize| {
            let parameter = base.independent()[k];
            parameter < set.of_state() && role_of(set, parameter) != Some(Role::RotorInertia)
        };
        Self {
            of_file,
            left_by_file: left,
            bodies: root(0..set.inertial()),
            effects: root(set.inertial()..width),
            relative_deviation: 1.0,
            effect_scale: 1.0,
            friction: (0..rank).filter(|k| stands_alone(*k) && is_friction(*k)).collect(),
            non_negative: (0..rank).filter(|k| stands_alone(*k)).collect(),
            kept: Vec::new(),
        }
    }

    /// The same, under which these base parameters stay what the robot file says, whatever the data
    /// say.
    #[must_use]
    pub fn keeping(mut self, parameters: Vec<usize>) -> Self {
        self.kept = parameters;
        self
    }

    /// The same for rich logs, with one width for bodies and effects: rotors may come out negative,
    /// as without a prior. Friction may not.
    #[must_use]
    pub(crate) fn of_rich_logs(mut self, width: f64) -> Self {
        self.non_negative.clone_from(&self.friction);
        self.with_relative_deviation(width).with_effect_scale(width)
    }

    /// The same for the error of a model, in which friction may be less than in the model.
    #[must_use]
    pub fn of_an_error(mut self) -> Self {
        self.non_negative.clear();
        self.friction.clear();
        self
    }

    /// Base parameters that stay as the robot file has them.
    pub fn kept(&self) -> &[usize] {
        &self.kept
    }

    /// The same with this relative deviation of the robot file's bodies.
    #[must_use]
    pub fn with_relative_deviation(mut self, relative_deviation: f64) -> Self {
        self.relative_deviation = relative_deviation;
        self
    }

    /// The same with the deviations, of bodies and of effects, that the data make probable: the
    /// means of their logarithms by the evidence. Where two are about as probable a few rows more
    /// do not make it jump from one to the other.
    ///
    /// - `whitened`: `[rank + 1, rank + 1]`, the triangular factor of [W tau] in units of its
    ///   noise, as in [`Estimate::whitened`](super::Estimate::whitened)
    #[must_use]
    pub fn chosen_by(mut self, whitened: &Matrix) -> Self {
        let rank = self.of_file.len();
        let size = whitened.col(rank).norm_l2();
        let scale = if size > MOST_DEVIATIONS { MOST_DEVIATIONS / size } else { 1.0 };
        let w = Mat::from_fn(rank, rank, |i, j| scale * whitened[(i, j)]);
        let [bodies, effects] = [&self.bodies, &self.effects].map(|root| {
            let torque = &w * root;
            &torque * torque.transpose()
        });
        let explained = |i: usize| (i..rank).map(|j| w[(i, j)] * self.of_file[j]).sum::<f64>();
        let left = Mat::from_fn(rank, 1, |i, _| scale * whitened[(i, rank)] - explained(i));
        let evidence = |deviation: f64, share: f64| {
            let variance = Mat::from_fn(rank, rank, |i, j| {
                f64::from(i == j)
                    + share.powi(2) * effects[(i, j)]
                    + deviation.powi(2) * bodies[(i, j)]
            });
            cholesky(variance.as_ref()).map_or(f64::NEG_INFINITY, |root| log_evidence(&root, &left))
        };
        let pairs =
            WIDTHS.iter().flat_map(|width| EFFECT_SCALES.iter().map(move |share| [*width, *share]));
        let known: Vec<([f64; 2], f64)> =
            pairs.map(|[width, share]| ([width, share], evidence(width, share))).collect();
        let most = known.iter().map(|(_, evidence)| *evidence).fold(f64::NEG_INFINITY, f64::max);
        if most.is_finite() {
            let probability = |evidence: f64| (evidence - most).exp();
            let all: f64 = known.iter().map(|(_, evidence)| probability(*evidence)).sum();
            let mean = |of: usize| {
                let logarithms = known
                    .iter()
                    .map(|(pair, evidence)| probability(*evidence) / all * pair[of].ln());
                logarithms.sum::<f64>().exp()
            };
            (self.relative_deviation, self.effect_scale) = (mean(0), mean(1));
        }
        self
    }

    /// The same with deviations of friction, offsets and gains multiplied by this.
    #[must_use]
    pub fn with_effect_scale(mut self, effect_scale: f64) -> Self {
        self.effect_scale = effect_scale;
        self
    }

    /// Relative deviation of the robot file's bodies.
    pub fn relative_deviation(&self) -> f64 {
        self.relative_deviation
    }

    /// What the deviations of friction, offsets and gains are multiplied by: a torque of this share
    /// of what the robot file leaves of the joint's own.
    pub fn effect_scale(&self) -> f64 {
        self.effect_scale
    }

    /// Expected base parameters, `[rank]`: those of the robot file.
    pub fn mean(&self) -> &[f64] {
        &self.of_file
    }

    /// Base parameters that physics forbids to be negative, each of which is one parameter of an
    /// effect.
    pub fn non_negative(&self) -> &[usize] {
        &self.non_negative
    }

    /// Those of [`Self::non_negative`] that are friction.
    pub fn friction(&self) -> &[usize] {
        &self.friction
    }

    /// Covariance of the base parameters, `[rank, rank]`.
    pub fn covariance(&self) -> Matrix {
        let root = self.root();
        (root.transpose() * &root).into()
    }

    /// Root A of the covariance AᵀA, `[parameters of the set, rank]`.
    fn root(&self) -> Mat<f64> {
        let (rank, inertial) = (self.of_file.len(), self.bodies.ncols());
        Mat::from_fn(inertial + self.effects.ncols(), rank, |i, k| match i.checked_sub(inertial) {
            None => self.relative_deviation * self.bodies[(k, i)],
            Some(effect) => self.effect_scale * self.effects[(k, effect)],
        })
    }

    /// Prior rows `[P | p]`, `[rank, rank + 1]`, in units of one standard deviation: P (base -
    /// mean) is standard normal, so that P base = p are equations to be put below data that are in
    /// units of their noise.
    pub fn rows(&self) -> Matrix {
        let (root, mean) = (self.root(), self.mean());
        let rank = mean.len();
        // Scaled to columns of length one, so that units do not spoil the factor.
        let size: Vec<f64> = (0..rank).map(|k| root.col(k).norm_l2()).collect();
        let scaled = Mat::from_fn(root.nrows(), rank, |i, j| root[(i, j)] / size[j]);
        // RᵀR is the scaled covariance, so the rows are R⁻ᵀ; its Cholesky factor has half the
        // digits.
        let root = triangle(scaled.as_ref());
        let mut inverse = Mat::<f64>::identity(rank, rank);
        faer::linalg::triangular_solve::solve_lower_triangular_in_place(
            root.transpose(),
            inverse.as_mut(),
            faer::Par::Seq,
        );
        Matrix::from_fn(rank, rank + 1, |i, j| match j < rank {
            true => inverse[(i, j)] / size[j],
            false => (0..=i).map(|k| inverse[(i, k)] / size[k] * mean[k]).sum(),
        })
    }

    /// Gives an estimate under this prior another covariance of the data alone, infinite where they
    /// say nothing; where it is not finite the covariance stays.
    ///
    /// - `data`: as in [`Self::chosen_by`]
    pub(crate) fn hold_covariance(
        &self,
        estimate: &mut super::Estimate,
        data: &Mat<f64>,
        of_data: &Mat<f64>,
    ) {
        let rank = self.of_file.len();
        if (0..rank).any(|k| !of_data[(k, k)].is_finite()) {
            return;
        }
        let r = data.as_ref().submatrix(0, 0, rank, rank);
        let information = r.transpose() * r;
        estimate.covariance =
            self.posterior(data).covariance(&(&information * of_data * &information)).into();
    }

    /// Root mean square of what the robot file leaves of each joint's torque, N·m (N), `[n]`.
    pub(crate) fn left_by_file(&self) -> &[f64] {
        &self.left_by_file
    }

    /// Base parameters whose variance the data have not halved, beside a robot file that may be
    /// wrong by its own size and friction as large as what it leaves; those that are kept among
    /// them.
    ///
    /// - `whitened`: as in [`Self::chosen_by`]
    pub(crate) fn undecided(&self, whitened: &Mat<f64>) -> Vec<usize> {
        /// Half.
        const SHARE: f64 = 0.5;
        let mut wide = self.clone();
        wide.relative_deviation = self.relative_deviation.max(1.0);
        wide.effect_scale = self.effect_scale.max(1.0);
        let before = wide.covariance();
        let root = wide.posterior(whitened).root;
        let held = |k: usize| {
            root.row(k).squared_norm_l2() > SHARE * before[(k, k)] || self.kept.contains(&k)
        };
        (0..self.of_file.len()).filter(|k| held(*k)).collect()
    }

    /// Triangle of data and of the prior as it pulled last, what is kept included: equations for
    /// whatever else has to hold.
    ///
    /// - `whitened`: as in [`Self::chosen_by`]
    pub(crate) fn beside(&self, whitened: &Mat<f64>) -> Mat<f64> {
        /// Deviation of what is kept, in standard deviations of the prior.
        const KEPT: f64 = 1e-3;
        let (rank, rows, covariance) =
            (self.of_file.len(), self.posterior(whitened).rows, self.covariance());
        let kept = |k: usize, j: usize| {
            let weight = 1.0 / (KEPT * covariance[(k, k)].sqrt());
            if j == rank { weight * self.of_file[k] } else { f64::from(u8::from(j == k)) * weight }
        };
        let all = Mat::from_fn(2 * rank + 1 + self.kept.len(), rank + 1, |i, j| match i {
            _ if i <= rank => whitened[(i, j)],
            _ if i <= 2 * rank => rows[(i - rank - 1, j)],
            _ => kept(self.kept[i - 2 * rank - 1], j),
        });
        triangle(all.as_ref())
    }

    /// Base parameters by data and prior, those that physics forbids to be negative not negative:
    /// friction whatever the data say, rotor inertia unless they insist.
    ///
    /// The prior pulls [`PULLS`] times, each time toward what the pull before has found (iterated
    /// Tikhonov regularisation): of what the data say in a direction of which they know `k` times
    /// what the prior knows, in information, the share 1 - 1 / (1 + k)ⁿ is kept; so data that know
    /// more than the prior are followed, not drawn to it.
    ///
    /// - `whitened`: as in [`Self::chosen_by`]
    ///
    /// Source: H. W. Engl, M. Hanke, A. Neubauer, Regularization of Inverse Problems (1996),
    /// section 5.1.
    pub(super) fn posterior(&self, whitened: &Mat<f64>) -> Posterior {
        let mut rows = self.rows();
        let rank = rows.nrows();
        let stacked = |rows: &Mat<f64>| {
            let all = Mat::from_fn(2 * rank + 1, rank + 1, |i, j| match i.checked_sub(rank + 1) {
                None => whitened[(i, j)],
                Some(i) => rows[(i, j)],
            });
            triangle(all.as_ref())
        };
        let mut system = stacked(&rows);
        let mut root = Mat::<f64>::identity(rank, rank);
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(
            system.as_ref().submatrix(0, 0, rank, rank),
            root.as_mut(),
            faer::Par::Seq,
        );
        for _ in 1..PULLS {
            let values = solve_with(&system, &[], &[]);
            for i in 0..rank {
                rows[(i, rank)] = (0..=i).map(|j| rows[(i, j)] * values[j]).sum();
            }
            system = stacked(&rows);
        }
        let kept: Vec<(usize, f64)> = self.kept.iter().map(|k| (*k, self.of_file[*k])).collect();
        let free = solve_with(&system, &[], &kept);
        let refused = refused(&free, |k| root.row(k).norm_l2(), &self.non_negative);
        // Friction would drive the arm; an inertia beside others only looks odd.
        let insisted = |k: &usize| {
            !self.friction.contains(k) && refused.iter().any(|(refused, _)| refused == k)
        };
        let constrained: Vec<usize> =
            self.non_negative.iter().copied().filter(|k| !insisted(k)).collect();
        let values = non_negative(&system, &constrained, &kept);
        Posterior { values, root, rows: rows.into(), refused }
    }
}

/// What data and prior say together.
pub(super) struct Posterior {
    /// `[rank]`.
    pub values: Vec<f64>,
    /// Upper triangular root U of the covariance U Uᵀ for data whose noise is what they are in
    /// units of.
    pub root: Mat<f64>,
    /// [`ParameterPrior::rows`], as they pulled last.
    rows: Mat<f64>,
    /// Parameters that the data make negative beyond chance although physics forbids it, and what
    /// the data make them.
    pub refused: Vec<(usize, f64)>,
}

impl Posterior {
    /// Covariance under the noise that the data really have: C (noise + PᵀP) C with the covariance
    /// C of unit noise.
    ///
    /// - `noise`: covariance of Rᵀ times the residual, for data R in units of their noise
    pub fn covariance(&self, noise: &Mat<f64>) -> Mat<f64> {
        let rank = self.values.len();
        let p = self.rows.as_ref().subcols(0, rank);
        let unit = &self.root * self.root.transpose();
        &unit * (noise + p.transpose() * p) * &unit
    }
}

/// Logarithm of the normal density of `left` with the covariance RᵀR, but for a constant.
fn log_evidence(root: &Mat<f64>, left: &Mat<f64>) -> f64 {
    let mut scaled = left.clone();
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(
        root.transpose(),
        scaled.as_mut(),
        faer::Par::Seq,
    );
    let logarithm: f64 = (0..root.nrows()).map(|k| root[(k, k)].ln()).sum();
    -logarithm - 0.5 * scaled.col(0).squared_norm_l2()
}

/// Role of the effect that a parameter is of; none for those of links, of trajectories, and of
/// effects without one.
pub(crate) fn role_of(set: &ParameterSet, parameter: usize) -> Option<Role> {
    let column = set.effect_columns().get(parameter.checked_sub(set.inertial())?)?;
    set.effects()[column.effect].role()
}

/// Parameters of `constrained` whose values are negative beyond chance.
pub(super) fn refused(
    values: &[f64],
    deviation: impl Fn(usize) -> f64,
    constrained: &[usize],
) -> Vec<(usize, f64)> {
    let negative = constrained.iter().filter(|k| values[**k] < -NO_CHANCE * deviation(**k));
    negative.map(|k| (*k, values[*k])).collect()
}

/// Least squares of a triangular system with some unknowns not negative: those that would be are
/// held at zero, the most negative first, as long as none pulls away from it.
///
/// - `kept`: unknowns that have these values
///
/// Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), chapter 23.
pub(super) fn non_negative(
    system: &Mat<f64>,
    constrained: &[usize],
    kept: &[(usize, f64)],
) -> Vec<f64> {
    let rank = system.ncols() - 1;
    let is_kept = |k: usize| kept.iter().any(|(kept, _)| *kept == k);
    let constrained: Vec<usize> = constrained.iter().copied().filter(|k| !is_kept(*k)).collect();
    let mut held: Vec<usize> = Vec::new();
    let norm = |k: usize| system.col(k).norm_l2();
    // Each round holds or frees one; more rounds than twice the unknowns would be a cycle of ties.
    for _ in 0..=2 * constrained.len() {
        let values = solve_with(system, &held, kept);
        let negative = constrained.iter().copied().filter(|k| values[*k] < 0.0);
        if let Some(worst) =
            negative.min_by(|a, b| (values[*a] * norm(*a)).total_cmp(&(values[*b] * norm(*b))))
        {
            held.push(worst);
            continue;
        }
        let residual = |i: usize| {
            system[(i, rank)] - (i..rank).map(|j| system[(i, j)] * values[j]).sum::<f64>()
        };
        let residual: Vec<f64> = (0..rank).map(residual).collect();
        let pull = |k: usize| (0..=k).map(|i| system[(i, k)] * residual[i]).sum::<f64>() / norm(k);
        let size = system.col(rank).norm_l2();
        match held.iter().position(|k| pull(*k) > 1e-12 * size) {
            Some(freed) => _ = held.swap_remove(freed),
            None => return values,
        }
    }
    let mut values = solve_with(system, &held, kept);
    constrained.iter().for_each(|k| values[*k] = values[*k].max(0.0));
    values
}

/// Least squares of a triangular system, some unknowns zero and some given.
fn solve_with(system: &Mat<f64>, zero: &[usize], given: &[(usize, f64)]) -> Vec<f64> {
    let rank = system.ncols() - 1;
    let mut values = vec![0.0; rank];
    given.iter().for_each(|(k, value)| values[*k] = *value);
    let is_given = |k: usize| given.iter().any(|(given, _)| *given == k);
    let free: Vec<usize> = (0..rank).filter(|k| !zero.contains(k) && !is_given(*k)).collect();
    let entry = |i: usize, k: usize| match free.get(k) {
        Some(&column) => system[(i, column)],
        None => {
            system[(i, rank)] - given.iter().map(|(k, value)| system[(i, *k)] * value).sum::<f64>()
        }
    };
    let reduced = Mat::from_fn(rank + 1, free.len() + 1, entry);
    let reduced = if free.len() == rank { reduced } else { triangle(reduced.as_ref()) };
    for k in (0..free.len()).rev() {
        let known: f64 = (k + 1..free.len()).map(|j| reduced[(k, j)] * values[free[j]]).sum();
        values[free[k]] = (reduced[(k, free.len())] - known) / reduced[(k, k)];
    }
    values
}

/// Root mean square of what the robot file leaves of each joint's torque, over its rows of all
/// kinds; not more than the torque itself.
fn left_over(factors: &[JointFactor], of_file: &[f64], torque: &[f64]) -> Vec<f64> {
    let of_joint = |(joint, torque): (usize, &f64)| {
        let own = factors.iter().filter(|factor| factor.joint == joint);
        let squares = own.clone().map(|factor| residual_norm(factor, of_file).powi(2)).sum::<f64>();
        let rows: usize = own.map(|factor| factor.rows).sum();
        (squares / rows.max(1) as f64).sqrt().min(*torque)
    };
    torque.iter().enumerate().map(of_joint).collect()
}

/// Deviations of the parameters of effects, by their index in the set: each makes a torque of the
/// size of what the robot file leaves of its joint's, in the motion of the joint that shows the
/// effect most, or in the reference motion if that shows it more. Offsets are expected to be
/// smaller.
///
/// - `torque`: what the robot file leaves, N·m (N), `[n]`
fn effect_deviations(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    factors: &[JointFactor],
    torque: &[f64],
) -> Vec<(usize, f64)> {
    let largest = torque.iter().copied().fold(0.0, f64::max);
    let of_arm = |torque: f64| if torque > 0.0 { torque } else { largest };
    let rotates = |joint: usize| robot.joints()[joint].kind.is_rotation();
    let reference = reference_columns(robot, set);
    let columns = set.effect_columns().iter().zip(set.inertial()..);
    let mut deviations = Vec::new();
    for ((column, index), reference) in columns.clone().zip(reference) {
        let alike = columns.clone().filter(|(other, _)| {
            (other.effect, other.parameter) == (column.effect, column.parameter)
                && rotates(other.joint) == rotates(column.joint)
        });
        let size =
            alike.map(|(_, other)| column_size(base, factors, other)).fold(reference, f64::max);
        let share = if set.effects()[column.effect].role() == Some(Role::Offset) {
            OFFSET_SHARE
        } else {
            1.0
        };
        let torque = of_arm(torque[column.joint]);
        deviations.push((index, share * torque / if size > 0.0 { size } else { 1.0 }));
    }
    for (column, index) in set.trajectory_columns().iter().zip(set.of_state()..) {
        let torque = column.joint.map_or(largest, |joint| of_arm(torque[joint]));
        deviations.push((index, torque / if column.size > 0.0 { column.size } else { 1.0 }));
    }
    deviations.retain(|(_, deviation)| *deviation > 0.0 && deviation.is_finite());
    deviations
}

/// Fastest speed that a joint is taken to be made for, rad/s (m/s). Limits of more than twice that,
/// three turns a second, stand for "no limit" (100, 1000).
const FASTEST: f64 = 10.0;

/// Speed that a joint is made for, rad/s (m/s): half of the robot file's limit, up to [`FASTEST`],
/// one where it has none.
pub(crate) fn usual_speed(joint: &Joint) -> f64 {
    match joint.limits.velocity {
        Some(limit) if limit > 0.0 && limit.is_finite() => (0.5 * limit).min(FASTEST),
        _ => 1.0,
    }
}

/// Sizes of the effects' columns in a reference motion, by column: an oscillation of 1 rad (m) at
/// the usual speed v, so at a speed of v and an acceleration of v².
fn reference_columns(robot: &Robot, set: &ParameterSet) -> Vec<f64> {
    let dq: Vec<f64> = robot.joints().iter().map(usual_speed).collect();
    let ddq: Vec<f64> = dq.iter().map(|speed| speed * speed).collect();
    let q = vec![1.0; dq.len()];
    let mut sizes = vec![0.0; set.effect_columns().len()];
    let mut row = vec![0.0; set.effect_columns_per_joint()];
    for joint in 0..robot.dof() {
        set.effect_row(joint, &JointState { q: &q, dq: &dq, ddq: &ddq }, &mut row);
        for (parameter, value) in set.effect_parameters_of(joint).into_iter().zip(&row) {
            sizes[parameter - set.inertial()] = value.abs();
        }
    }
    sizes
}

/// Root mean square of the column of a parameter over the rows in motion; zero if it stands for no
/// base parameter.
fn column_size(base: &BaseParameters, factors: &[JointFactor], parameter: usize) -> f64 {
    let Ok(position) = base.independent().binary_search(&parameter) else { return 0.0 };
    let moving = factors.iter().filter(|factor| !factor.resting);
    let (mut squares, mut rows) = (0.0, 0);
    for factor in moving {
        if let Some(k) = factor.columns.iter().position(|column| *column == position) {
            squares += factor.factor.col(k).squared_norm_l2();
            rows += factor.rows;
        }
    }
    (squares / f64::max(rows as f64, 1.0)).sqrt()
}
