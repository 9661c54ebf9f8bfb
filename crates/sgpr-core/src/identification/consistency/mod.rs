//! Parameters that a real arm can have: every link a body of positive density, friction that takes
//! energy.
//!
//! Least squares knows nothing of bodies: it returns negative masses, or inertias that break the
//! triangle inequality. Here the full set of parameters, not only its base, is estimated under
//!
//! - per link: the pseudo-inertia `[[S, h], [hᵀ, m]]` is positive definite, which says that a
//!   distribution of positive mass has these parameters, and nothing more (Wensing, Kim, Slotine
//!   (2018));
//! - per effect: parameters that physics forbids to be negative are not;
//! - no link is heavier than the whole arm is by its robot file or, if the file has placeholders,
//!   by its torques;
//! - limits of the user ([`PhysicalBounds`]): masses, places of centres of mass, any parameter.
//!
//! The data enter by the triangular factor R of the weighted base parameters, so the program has
//! the size of the robot, not of the log. Where the data are silent (a robot has more parameters
//! than motion reveals) a weak pull toward the robot file decides ([`Prior`]).
//!
//! Sources: P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically
//! consistent inertial parameter identification, IEEE RA-L 3(1) (2018); C. D. Sousa, R. Cortesão,
//! Physical feasibility of robot base inertial parameter identification: a linear matrix inequality
//! approach, IJRR 33(6) (2014); T. Lee, P. M. Wensing, F. C. Park, Geometric robot dynamic
//! identification: a convex programming approach, IEEE T-RO 36(2) (2020), for the entropic pull.

mod bounds;
mod cross_validation;
mod drives;
mod prices;
mod program;

use derive_setters::Setters;
use faer::Mat;
use serde::{Deserialize, Serialize};

pub use bounds::{LinkBounds, ParameterBounds, PhysicalBounds, Region};
pub use cross_validation::{DEVIATIONS, KeptOut, weakest_good_deviation};
pub use drives::KnownPayload;
pub(super) use drives::{Carrier, bounded_least_squares};
pub use prices::{Costs, Price, Stage};

use super::parameter_scales::{LinkSize, nominal_links, parameter_scales};
use super::{BaseParameters, IdentificationError, ParameterSet};
use crate::linalg::{Matrix, symmetric_eigen};
use crate::robot::Robot;
use crate::spatial::{LinkInertia, PARAMETERS_PER_LINK, Vector3};
use bounds::{BadBound, Bound};
use program::{Affine, ConicOutcome, ConicProgram, ConicStatus};

/// What makes parameters consistent, beside physics.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Consistency {
    /// Pull toward the robot file.
    pub prior: Prior,
    /// Limits of the user.
    pub bounds: PhysicalBounds,
}

/// Pull toward the nominal parameters. It decides where the data are silent, and hardly counts
/// where they speak: data and prior are weighed by their standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Prior {
    /// How the distance to the nominal parameters is measured.
    pub distance: Distance,
    /// Standard deviation of the nominal parameters as a share of them. With 1 they may well be
    /// wrong by their own size; the default of 30 leaves them no say where the data have any, as
    /// for robot files with placeholders. Friction, rotors and offsets of which the robot file says
    /// nothing (zero) are as good as free, whatever the deviation.
    pub relative_deviation: f64,
}

impl Default for Prior {
    fn default() -> Self {
        Self { distance: Distance::Entropic, relative_deviation: 30.0 }
    }
}

/// Distance of a link from its nominal inertia.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distance {
    /// Sum of squares of the parameters, each relative to the size of its link. Depends on the
    /// frame of the link.
    Euclidean,
    /// tr(P₀⁻¹ P) - ln det(P₀⁻¹ P) - 4, with P the pseudo-inertia: depends neither on frame nor
    /// units, and keeps P inside the cone.
    #[default]
    Entropic,
}

/// Parameters that a real arm can have.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ConsistentParameters {
    /// All parameters of the set.
    pub parameters: Vec<f64>,
    /// Their base parameters, `[rank]`.
    pub base: Vec<f64>,
    /// Per link: the proof that it is a body.
    pub links: Vec<LinkCertificate>,
    /// Limits at which the estimate lies: without them it would be elsewhere.
    pub active: Vec<String>,
    /// Root mean square of what consistency adds to the residual, in standard deviations of the
    /// whole fit.
    pub cost: f64,
    /// Iterations of the solver.
    pub iterations: u32,
    /// Time in the solver, s.
    pub seconds: f64,
    /// What the caller should know: nominal inertias that had to be mended before they could pull.
    pub notes: Vec<String>,
}

/// What shows that a link is a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LinkCertificate {
    /// Joint that carries it.
    pub joint: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the link frame, m.
    pub centre: [f64; 3],
    /// Smallest eigenvalue of the pseudo-inertia, whose entries are in kg, kg·m and kg·m²; above
    /// zero.
    pub smallest_eigenvalue: f64,
    /// The same with lengths in units of the link's size and masses in units of its mass.
    pub relative_eigenvalue: f64,
    /// Principal moments of inertia about the centre of mass, kg·m², ascending; the largest is at
    /// most the sum of the others.
    pub principal_moments: [f64; 3],
}

/// The scaled pseudo-inertia keeps this distance from the border of the cone, and so stays definite
/// under rounding.
const MARGIN: f64 = 1e-6;

/// A limit is active within this share of its size.
const ACTIVE: f64 = 1e-4;

/// Relative deviation of parameters of effects of which the robot file says nothing, in units of
/// their expected size: it keeps those finite that the data do not determine, and draws no others
/// to zero.
const UNKNOWN: f64 = 100.0;

impl Consistency {
    /// The consistent parameters nearest to the data.
    ///
    /// - `whitened`: `[rank + 1, rank + 1]`, the triangular factor of [W tau] in units of its
    ///   noise, as in [`Estimate::whitened`](super::Estimate::whitened). Data without noise may be
    ///   given: they count as if they had a noise that the solver can resolve
    /// - `nominal`: all parameters of the set, those of the robot file
    /// - `torque`: size of the torque per joint, N·m (N), `[n]`; parameters of effects are expected
    ///   to be of that order
    ///
    /// # Errors
    /// If limits contradict each other: the message lists a smallest set of limits that no arm
    /// keeps.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn solve(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        whitened: &Matrix,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<ConsistentParameters, IdentificationError> {
        let task = ConsistencyTask::new(&self.bounds, robot, set, base, whitened, nominal, torque)?;
        let deviation = self.prior.relative_deviation;
        super::check_prior_deviation(deviation)?;
        // Where data that are almost without noise meet a pull that is almost none, the solver may
        // give up: a distance that is easier to compute, and then a stronger pull, are better than
        // no result.
        let Prior { distance, relative_deviation } = self.prior;
        let stronger = |distance, factor: f64| Prior {
            distance,
            relative_deviation: relative_deviation / factor,
        };
        let priors = [
            self.prior,
            stronger(Distance::Euclidean, 1.0),
            stronger(distance, 3.0),
            stronger(distance, 10.0),
            stronger(Distance::Euclidean, 30.0),
        ];
        let mut failure = None;
        for prior in priors {
            match task.attempt(prior) {
                Ok(mut found) => {
                    if prior != self.prior {
                        found.notes.push(format!(
                            "the program of consistent parameters was solved with {} pull toward \
                             the robot file of relative deviation {:.2} instead of what was asked \
                             for",
                            if prior.distance == Distance::Euclidean {
                                "a Euclidean"
                            } else {
                                "an \
                                 entropic"
                            },
                            prior.relative_deviation
                        ));
                    }
                    return Ok(found);
                }
                Err(error @ IdentificationError::Unsolved { .. }) => {
                    failure.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        Err(failure.expect("every attempt failed"))
    }
}

/// Data and limits of a program of consistent parameters.
struct ConsistencyTask<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    base: &'a BaseParameters,
    /// Triangular factor of [W tau] in units of its noise, or of what the solver resolves.
    whitened: Mat<f64>,
    nominal: &'a [f64],
    /// Of the links.
    sizes: Vec<LinkSize>,
    /// Units in which all parameters are of order one.
    scale: Vec<f64>,
    bounds: Vec<Bound>,
}

/// A limit of a program.
#[derive(Clone, Copy, PartialEq)]
enum Limit {
    /// The link is a body.
    Body(usize),
    /// One of [`ConsistencyTask::bounds`].
    Bound(usize),
}

impl<'a> ConsistencyTask<'a> {
    fn new(
        bounds: &PhysicalBounds,
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &'a BaseParameters,
        whitened: &Mat<f64>,
        nominal: &'a [f64],
        torque: &[f64],
    ) -> Result<Self, IdentificationError> {
        assert_eq!(nominal.len(), set.len(), "every parameter of the set");
        let same = (whitened.nrows(), torque.len()) == (base.rank() + 1, robot.dof());
        assert!(same, "the factor and torques of this robot");
        let sizes = nominal_links(nominal, set).map(LinkSize::of).collect();
        let scale = parameter_scales(set, nominal, torque);
        let masses = bounds::masses(bounds, robot, base, nominal, torque, &scale);
        let mut bounds =
            bounds::collect(bounds, robot, set, &scale).map_err(|BadBound { bound, reason }| {
                IdentificationError::BadBound { bound, reason }
            })?;
        bounds.extend(masses);
        let whitened = resolved(whitened);
        Ok(Self { robot, set, base, whitened, nominal, sizes, scale, bounds })
    }

    /// The program, all limits in it but `without`, and what had to be mended for the pull.
    fn program(&self, prior: Prior, without: &[Limit]) -> (ConicProgram, Vec<String>) {
        let mut program = ConicProgram::default();
        let x = program.variables(self.set.len());
        debug_assert_eq!(x, 0, "parameters come first");
        add_data(&mut program, self.base, &self.whitened, &self.scale);
        let notes = prior.add_to(
            &mut program,
            self.robot,
            self.set,
            self.nominal,
            &self.sizes,
            &self.scale,
        );
        let links = (0..self.robot.dof()).filter(|link| !without.contains(&Limit::Body(*link)));
        links.for_each(|link| require_body(&mut program, link * PARAMETERS_PER_LINK));
        let kept = self
            .bounds
            .iter()
            .enumerate()
            .filter(|(index, _)| !without.contains(&Limit::Bound(*index)));
        kept.for_each(|(_, bound)| bound.require(&mut program));
        (program, notes)
    }

    /// The parameters in their units.
    fn parameters(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.scale).map(|(x, scale)| x * scale).collect()
    }

    fn attempt(&self, prior: Prior) -> Result<ConsistentParameters, IdentificationError> {
        let Self { robot, set, bounds, .. } = self;
        let (program, notes) = self.program(prior, &[]);
        let ConicOutcome { x, status, iterations, seconds } = program.solve();
        match status {
            ConicStatus::Solved => {}
            ConicStatus::Infeasible => return Err(explain(robot.dof(), set.len(), bounds)),
            ConicStatus::Failed(reason) => {
                // Limits without a common interior stop the solver before it has a proof.
                let conflict = smallest_conflict(robot.dof(), set.len(), bounds);
                return Err(conflict.map_or(IdentificationError::Unsolved { reason }, |limits| {
                    IdentificationError::Contradiction { limits }
                }));
            }
        }

        let parameters = self.parameters(&x);
        let estimate = self.base.combine(&parameters);
        let links = nominal_links(&parameters, set).zip(robot.joints()).zip(&self.sizes);
        let links: Vec<LinkCertificate> = links
            .map(|((link, joint), size)| LinkCertificate::of(&joint.name, &link, size))
            .collect();
        if let Some(link) = links
            .iter()
            .find(|link| link.relative_eigenvalue.is_nan() || link.relative_eigenvalue <= 0.0)
        {
            let reason = format!("the link of `{}` is no body by a rounding error", link.joint);
            return Err(IdentificationError::Unsolved { reason });
        }
        let mut active: Vec<String> = bounds
            .iter()
            .filter(|bound| bound.margin(&x) < ACTIVE)
            .map(|bound| bound.name.clone())
            .collect();
        let at_border = links.iter().filter(|link| link.relative_eigenvalue < 10.0 * MARGIN);
        active.extend(
            at_border
                .map(|link| format!("the link of `{}` is a body of positive density", link.joint)),
        );
        Ok(ConsistentParameters {
            cost: added_residual(&self.whitened, &estimate),
            base: estimate,
            parameters,
            links,
            active,
            iterations,
            seconds,
            notes,
        })
    }
}

impl Prior {
    /// Adds the pull to a program whose first variables are the parameters of `set` in units of
    /// `scale`; what had to be mended for it.
    fn add_to(
        &self,
        program: &mut ConicProgram,
        robot: &Robot,
        set: &ParameterSet,
        nominal: &[f64],
        sizes: &[LinkSize],
        scale: &[f64],
    ) -> Vec<String> {
        let weight = self.relative_deviation.powi(-2);
        let mut notes = Vec::new();
        for (index, (link, size)) in nominal_links(nominal, set).zip(sizes).enumerate() {
            let (matrix, mended) = size.definite(&link);
            if mended {
                notes.push(format!(
                    "the robot file gives the link of `{}` an inertia that no body has; the pull \
                     goes toward the nearest body",
                    robot.joints()[index].name
                ));
            }
            match self.distance {
                Distance::Entropic => {
                    add_divergence(program, index * PARAMETERS_PER_LINK, &matrix, weight)
                }
                Distance::Euclidean => {
                    for (k, centre) in parameters_of(&matrix).into_iter().enumerate() {
                        program.add_square(index * PARAMETERS_PER_LINK + k, centre, weight);
                    }
                }
            }
        }
        let unknown = self.relative_deviation.max(UNKNOWN).powi(-2);
        for index in set.inertial()..set.len() {
            let weight = if nominal[index] == 0.0 { unknown } else { weight };
            program.add_square(index, nominal[index] / scale[index], weight);
        }
        notes
    }
}

/// A body, and how far from it its estimated parameters are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearestBody {
    pub parameters: [f64; PARAMETERS_PER_LINK],
    /// Square of the distance, in standard deviations of the estimate.
    pub distance2: f64,
}

/// The body taken up or put down that is nearest to ten estimated parameters, distances measured by
/// their covariance.
///
/// - `reach`: largest radius of gyration about the origin of the link that holds it, m
pub(crate) fn nearest_load(
    parameters: &[f64; PARAMETERS_PER_LINK],
    covariance: &Mat<f64>,
    reach: f64,
) -> Result<NearestBody, IdentificationError> {
    let taken_up = nearest_body(parameters, covariance, reach)?;
    if taken_up.distance2 < SAME_BODY {
        return Ok(taken_up);
    }
    let put_down = nearest_body(&parameters.map(|x| -x), covariance, reach)?;
    if put_down.distance2 < taken_up.distance2 {
        return Ok(NearestBody { parameters: put_down.parameters.map(|x| -x), ..put_down });
    }
    Ok(taken_up)
}

/// Squares of distances below this are the solver's.
const SAME_BODY: f64 = 1e-6;

/// The body nearest to ten estimated parameters, distances measured by their covariance.
///
/// - `reach`: largest distance of its mass from the origin, in the root mean square, m
pub(super) fn nearest_body(
    parameters: &[f64; PARAMETERS_PER_LINK],
    covariance: &Mat<f64>,
    reach: f64,
) -> Result<NearestBody, IdentificationError> {
    let estimated = LinkInertia::from_standard_parameters(parameters);
    let scale = LinkSize::of(estimated).scales();
    // A direction of which nothing is known has a deviation of a hundred times the size of the
    // body.
    const UNKNOWN: f64 = 100.0;
    let spread = |i: usize, j: usize| {
        let scaled = covariance[(i, j)] / (scale[i] * scale[j]);
        if scaled.is_finite() { scaled } else { UNKNOWN * UNKNOWN }
    };
    let known = |i: usize| covariance[(i, i)].is_finite();
    let spread = Mat::from_fn(PARAMETERS_PER_LINK, PARAMETERS_PER_LINK, |i, j| {
        if i == j || (known(i) && known(j)) { spread(i, j) } else { 0.0 }
    });
    let (values, vectors) = symmetric_eigen(spread.as_ref());
    let largest = values[PARAMETERS_PER_LINK - 1];
    let mut program = ConicProgram::default();
    program.variables(PARAMETERS_PER_LINK);
    let residual = program.variables(PARAMETERS_PER_LINK);
    let rows = (0..PARAMETERS_PER_LINK).map(|k| {
        // Directions known to more digits than the solver has are weighed by those it has.
        let weight = values[k].max(1e-10 * largest).max(f64::MIN_POSITIVE).sqrt().recip();
        let mut row = Affine::variable(residual + k, -1.0);
        for i in 0..PARAMETERS_PER_LINK {
            row.terms.push((i, weight * vectors[(i, k)]));
            row.constant -= weight * vectors[(i, k)] * parameters[i] / scale[i];
        }
        row
    });
    program.require_zero(rows.collect());
    (residual..residual + PARAMETERS_PER_LINK)
        .for_each(|variable| program.add_square(variable, 0.0, 1.0));
    require_body(&mut program, 0);
    if reach.is_finite() {
        // The trace of the second moment of mass about the origin, in the units of the variables.
        let moment = |axis: usize| pseudo_inertia_entry(0, axis, axis).scaled(-scale[4] / scale[0]);
        let most = Affine::variable(0, reach * reach);
        program.require_non_negative(vec![(0..3).map(moment).fold(most, Affine::and)]);
    }
    let outcome = program.solve();
    match outcome.status {
        ConicStatus::Solved => Ok(NearestBody {
            parameters: std::array::from_fn(|k| outcome.x[k] * scale[k]),
            distance2: outcome.x[residual..residual + PARAMETERS_PER_LINK]
                .iter()
                .map(|r| r * r)
                .sum(),
        }),
        ConicStatus::Infeasible => Err(IdentificationError::Unsolved { reason: "no body".into() }),
        ConicStatus::Failed(reason) => Err(IdentificationError::Unsolved { reason }),
    }
}

/// Data without noise would be known to more digits than the solver has: torques of at most so many
/// standard deviations, all rows together.
fn resolved(whitened: &Mat<f64>) -> Mat<f64> {
    const MOST: f64 = 1e7;
    let torque = whitened.col(whitened.ncols() - 1).norm_l2();
    faer::Scale((MOST / torque).min(1.0)) * whitened
}

/// 1/2 |R B x - rho|²: in extra variables for the residual, because squaring R would square its
/// condition number.
fn add_data(program: &mut ConicProgram, base: &BaseParameters, whitened: &Mat<f64>, scale: &[f64]) {
    let rank = base.rank();
    let combination = base.matrix();
    let width = scale.len();
    let residual = program.variables(rank);
    let rows = (0..rank).map(|i| {
        let mut row = Affine::variable(residual + i, -1.0).plus(-whitened[(i, rank)]);
        for (k, scale) in scale.iter().enumerate() {
            let factor: f64 =
                (i..rank).map(|j| whitened[(i, j)] * combination[j * width + k]).sum();
            if factor != 0.0 {
                row.terms.push((k, factor * scale));
            }
        }
        row
    });
    let rows = rows.collect();
    program.require_zero(rows);
    (residual..residual + rank).for_each(|variable| program.add_square(variable, 0.0, 1.0));
}

/// |R (base - least squares)| / sqrt(rank).
fn added_residual(whitened: &Mat<f64>, base: &[f64]) -> f64 {
    let rank = base.len();
    let row =
        |i: usize| whitened[(i, rank)] - (i..rank).map(|j| whitened[(i, j)] * base[j]).sum::<f64>();
    ((0..rank).map(|i| row(i).powi(2)).sum::<f64>() / rank as f64).sqrt()
}

/// The pseudo-inertia of the ten scaled variables from `first` on is definite.
fn require_body(program: &mut ConicProgram, first: usize) {
    program.require_semidefinite(4, |row, column| {
        let margin = if row == column { -MARGIN } else { 0.0 };
        pseudo_inertia_entry(first, row, column).plus(margin)
    });
}

/// weight (tr(P₀⁻¹ P) - ln det P) of the link whose variables begin at `first`, the logarithm of
/// the determinant by a definite matrix `[[P, Z], [Zᵀ, diag Z]]` with Z lower triangular.
///
/// Source: MOSEK Modeling Cookbook, section 6.2.3, log-determinant.
fn add_divergence(
    program: &mut ConicProgram,
    first: usize,
    nominal: &nalgebra::Matrix4<f64>,
    weight: f64,
) {
    // Without an inverse in double precision the program is refused by what it holds.
    let inverse = nominal.try_inverse().unwrap_or_else(|| nalgebra::Matrix4::repeat(f64::NAN));
    for column in 0..4 {
        for row in 0..4 {
            let (low, high) = (row.min(column), row.max(column));
            program.add_cost(
                &pseudo_inertia_entry(first, low, high).scaled(weight * inverse[(row, column)]),
            );
        }
    }
    let z = program.variables(10);
    let logarithm = program.variables(4);
    // Lower triangle by rows.
    let z = |row: usize, column: usize| Affine::variable(z + row * (row + 1) / 2 + column, 1.0);
    program.require_semidefinite(8, |row, column| match (row, column) {
        (_, 0..4) => pseudo_inertia_entry(first, row, column),
        (0..4, _) if row >= column - 4 => z(row, column - 4),
        (0..4, _) => Affine::default(),
        _ if row == column => z(row - 4, row - 4),
        _ => Affine::default(),
    });
    for k in 0..4 {
        program.require_below_log(Affine::variable(logarithm + k, 1.0), z(k, k));
        program.add_cost(&Affine::variable(logarithm + k, -weight));
    }
}

/// Entry of the pseudo-inertia of a link by its parameters m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz,
/// Izz, which are the variables from `first` on; row <= column.
fn pseudo_inertia_entry(first: usize, row: usize, column: usize) -> Affine {
    const DIAGONAL: [usize; 3] = [4, 6, 9];
    match (row, column) {
        (3, 3) => Affine::variable(first, 1.0),
        (row, 3) => Affine::variable(first + 1 + row, 1.0),
        (row, column) if row == column => {
            let terms = DIAGONAL.iter().enumerate();
            let terms =
                terms.map(|(axis, offset)| (first + offset, if axis == row { -0.5 } else { 0.5 }));
            Affine { terms: terms.collect(), constant: 0.0 }
        }
        (0, 1) => Affine::variable(first + 5, -1.0),
        (0, 2) => Affine::variable(first + 7, -1.0),
        _ => Affine::variable(first + 8, -1.0),
    }
}

/// The other way round: the ten parameters of a pseudo-inertia.
fn parameters_of(matrix: &nalgebra::Matrix4<f64>) -> [f64; PARAMETERS_PER_LINK] {
    let trace = matrix[(0, 0)] + matrix[(1, 1)] + matrix[(2, 2)];
    let inertia = |row: usize, column: usize| {
        if row == column { trace - matrix[(row, row)] } else { -matrix[(row, column)] }
    };
    let h = |axis: usize| matrix[(axis, 3)];
    [
        matrix[(3, 3)],
        h(0),
        h(1),
        h(2),
        inertia(0, 0),
        inertia(0, 1),
        inertia(1, 1),
        inertia(0, 2),
        inertia(1, 2),
        inertia(2, 2),
    ]
}

impl LinkCertificate {
    fn of(joint: &str, link: &LinkInertia, size: &LinkSize) -> Self {
        let centre = link.centre_of_mass();
        let rows = link.inertia_at_centre().to_rows();
        let inertia = nalgebra::Matrix3::from_fn(|row, column| rows[row][column]);
        let mut principal: Vec<f64> = inertia.symmetric_eigenvalues().iter().copied().collect();
        principal.sort_by(f64::total_cmp);
        let smallest = |matrix: nalgebra::Matrix4<f64>| matrix.symmetric_eigenvalues().min();
        Self {
            joint: joint.into(),
            mass: link.mass,
            centre: Vector3::to_array(centre),
            smallest_eigenvalue: link.smallest_pseudo_inertia_eigenvalue(),
            relative_eigenvalue: smallest(size.scaled(link)),
            principal_moments: [principal[0], principal[1], principal[2]],
        }
    }
}

fn explain(links: usize, width: usize, bounds: &[Bound]) -> IdentificationError {
    smallest_conflict(links, width, bounds).map_or_else(
        || IdentificationError::Unsolved {
            reason: "no arm keeps all limits, though every one can be kept".into(),
        },
        |limits| IdentificationError::Contradiction { limits },
    )
}

/// A set of limits that bodies cannot keep, of which none can be left out: limits are dropped one
/// by one, and stay dropped while the others still contradict each other. None if there is no
/// contradiction.
///
/// Source: J. W. Chinneck, E. W. Dravnieks, Locating minimal infeasible constraint sets in linear
/// programs, ORSA J. Computing 3(2) (1991), deletion filter.
fn smallest_conflict(links: usize, width: usize, bounds: &[Bound]) -> Option<Vec<String>> {
    let contradict = |bounds: &[&Bound]| {
        let mut program = ConicProgram::default();
        program.variables(width);
        (0..links).for_each(|link| require_body(&mut program, link * PARAMETERS_PER_LINK));
        bounds.iter().for_each(|bound| bound.require(&mut program));
        // Of all points that keep the limits the nearest to the origin: the program has one
        // solution.
        (0..width).for_each(|variable| program.add_square(variable, 0.0, 1e-3));
        let outcome = program.solve();
        outcome.status != ConicStatus::Solved
            || bounds.iter().any(|bound| bound.margin(&outcome.x) < -1e-5)
    };
    let mut kept: Vec<&Bound> = bounds.iter().collect();
    if !contradict(&kept) {
        return None;
    }
    let mut index = 0;
    while index < kept.len() {
        let mut fewer = kept.clone();
        fewer.remove(index);
        if contradict(&fewer) {
            kept = fewer;
        } else {
            index += 1;
        }
    }
    Some(kept.iter().map(|bound| bound.name.clone()).collect())
}

#[cfg(test)]
mod tests;
