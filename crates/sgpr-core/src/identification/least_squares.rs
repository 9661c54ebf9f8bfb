//! Least squares on the factors of an [`Observation`](super::Observation).

use derive_setters::Setters;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};

use super::{BaseParameters, IdentificationError, JointFactor, Method};
use crate::linalg::{Matrix, Svd, triangle};

/// Least squares for the base parameters of a robot.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct LeastSquares {
    /// Weights; those of `Wls` for methods that begin with it.
    pub method: Method,
    /// Per factor: how many rows carry as much as one independent row, because the noise remembers.
    /// The variance of the estimates grows by it.
    pub correlation: Option<Vec<f64>>,
}

/// Estimated base parameters with all that can be said of them.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Estimate {
    /// Estimates, `[rank]`.
    pub values: Vec<f64>,
    /// Covariance of the estimates, `[rank, rank]`; infinite where the motion says nothing.
    pub covariance: Matrix,
    /// Root mean square of the torque residual per factor, N·m (N).
    pub noise: Vec<f64>,
    /// What the motion excited.
    pub excitation: ParameterExcitation,
    /// Triangular factor of [W tau] weighted as in this estimate, in units of its noise (memory of
    /// the noise included), `[rank + 1, rank + 1]`: all that the data say about the parameters.
    pub whitened: Matrix,
    /// Noise level by which the rows of each factor were divided, N·m (N); infinite for those left
    /// out.
    pub weights: Vec<f64>,
    /// Noise level of each log as a share of that of the factor, per factor and trajectory; empty
    /// where all logs count as one.
    pub log_shares: Vec<Vec<f64>>,
    /// Standard deviation of the weighted rows, memory of the noise included: what `whitened` was
    /// divided by.
    pub unit: f64,
    /// Times the equations were gone through or weights changed.
    pub iterations: usize,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Estimate {
    /// Standard deviations, `[rank]`.
    pub fn standard_deviations(&self) -> Vec<f64> {
        (0..self.values.len()).map(|k| self.covariance[(k, k)].max(0.0).sqrt()).collect()
    }

    /// Standard deviation of the noise of a row of this factor, memory included, N·m (N); infinite
    /// if it is left out.
    pub(super) fn row_noise(&self, factor: usize, trajectory: usize) -> f64 {
        let share = self.log_shares.get(factor).map_or(1.0, |shares| shares[trajectory]);
        self.weights[factor] * share * self.unit
    }

    /// Standard deviations as a share of the estimate, `[rank]`.
    pub fn relative_standard_deviations(&self) -> Vec<f64> {
        self.standard_deviations()
            .iter()
            .zip(&self.values)
            .map(|(std, value)| std / value.abs())
            .collect()
    }
}

/// How well the motion excites the base parameters.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ParameterExcitation {
    /// Singular values of W, largest first.
    pub singular_values: Vec<f64>,
    /// cond(W), the ratio of the largest and smallest singular value (thesis eq. 3-10); infinite if
    /// one is zero.
    pub condition: f64,
    /// The same with every column scaled to unit length, which does not depend on units.
    pub scaled_condition: f64,
    /// Directions that no row depends on.
    pub unexcited: Vec<SingularDirection>,
    /// The direction with the smallest singular value.
    pub weakest: Option<SingularDirection>,
}

/// A combination of base parameters that the data do not determine.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SingularDirection {
    /// Singular value of the scaled W, relative to the largest.
    pub relative_singular_value: f64,
    /// (Base parameter, share), largest share first; shares below a tenth are left out.
    pub shares: Vec<(usize, f64)>,
}

/// Weights are iterated until they change by less than this share; a thousandth of the weights
/// changes the estimates by far less than their standard deviation.
pub(super) const SAME_WEIGHTS: f64 = 1e-4;
pub(super) const MOST_ITERATIONS: usize = 20;

/// Below this share of the largest singular value a direction is not excited.
const RANK_TOLERANCE: f64 = 1e-9;

impl LeastSquares {
    /// With these weights.
    pub fn new(method: Method) -> Self {
        Self { method, correlation: None }
    }

    /// Estimates the base parameters. In directions that the data do not determine the estimate
    /// stays at `nominal`.
    ///
    /// # Errors
    /// If there are fewer rows than parameters, or known noise levels are not positive.
    ///
    /// # Panics
    /// If `nominal` is not of length `base.rank()`.
    pub fn solve(
        &self,
        factors: &[JointFactor],
        base: &BaseParameters,
        nominal: &[f64],
    ) -> Result<Estimate, IdentificationError> {
        assert_eq!(nominal.len(), base.rank(), "a nominal value for every base parameter");
        self.solve_unknowns(factors, nominal)
    }

    /// [`Self::solve`] for factors whose columns are any unknowns.
    pub(crate) fn solve_unknowns(
        &self,
        factors: &[JointFactor],
        nominal: &[f64],
    ) -> Result<Estimate, IdentificationError> {
        let unknowns = nominal.len();
        let used: Vec<bool> = factors.iter().map(|factor| self.uses(factor)).collect();
        let count = |(factor, used): (&JointFactor, &bool)| if *used { factor.rows } else { 0 };
        match factors.iter().zip(&used).map(count).sum::<usize>() {
            0 => return Err(IdentificationError::NoData),
            rows if rows < unknowns => {
                return Err(IdentificationError::TooFewRows { rows, parameters: unknowns });
            }
            _ => {}
        }
        let ignored = |weight: f64, used: &bool| if *used { weight } else { f64::INFINITY };
        let ones: Vec<f64> = used.iter().map(|used| ignored(1.0, used)).collect();
        let excitation = ParameterExcitation::of(&stack(factors, unknowns, &ones));
        let freedom = degrees_of_freedom(factors, unknowns);
        let residual = |weights: &[f64]| {
            let system = stack(factors, unknowns, weights);
            let values =
                back_substitute(&system).unwrap_or_else(|| Solution::new(&system, nominal).values);
            residual_noise(factors, &values, &freedom)
        };
        let mut weights = ones;
        let mut iterations = 0;
        match &self.method {
            Method::Ols => {}
            Method::WlsKnown(known) => {
                if let Some(joint) = known.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
                    return Err(IdentificationError::Noise { joint, value: known[joint] });
                }
                let of_joint =
                    |(factor, used): (&JointFactor, &bool)| ignored(known[factor.joint], used);
                weights = factors.iter().zip(&used).map(of_joint).collect();
            }
            _ => {
                let mut least = vec![0.0; factors.len()];
                for _ in 0..MOST_ITERATIONS {
                    iterations += 1;
                    let noise = floored(&residual(&weights), factors, &least);
                    if iterations == 1 {
                        least = least_noise(&noise, factors);
                    }
                    let noise = noise
                        .iter()
                        .zip(&used)
                        .map(|(noise, used)| ignored(*noise, used))
                        .collect();
                    let before = std::mem::replace(&mut weights, noise);
                    let change = |((new, old), used): ((&f64, &f64), &bool)| {
                        if *used { (new / old - 1.0).abs() } else { 0.0 }
                    };
                    if weights.iter().zip(&before).zip(&used).map(change).fold(0.0, f64::max)
                        < SAME_WEIGHTS
                    {
                        break;
                    }
                }
            }
        }
        let system = stack(factors, unknowns, &weights);
        let solution = Solution::new(&system, nominal);
        let noise = residual_noise(factors, &solution.values, &freedom);
        let inflation: Vec<f64> =
            (0..factors.len()).map(|index| self.correlation_of(index)).collect();
        let covariance = solution.covariance(factors, &weights, &noise, &inflation);
        let unit = unit_noise(factors, &weights, &noise, &freedom, &inflation);
        let whitened = faer::Scale(1.0 / unit) * system;
        Ok(Estimate {
            values: solution.values,
            covariance: covariance.into(),
            noise,
            excitation,
            whitened: whitened.into(),
            unit,
            weights,
            log_shares: vec![],
            iterations,
            notes: vec![],
        })
    }

    /// Rows at rest need a weight of their own.
    pub(super) fn uses(&self, factor: &JointFactor) -> bool {
        !factor.resting || !matches!(self.method, Method::Ols | Method::WlsKnown(_))
    }

    pub(super) fn correlation_of(&self, index: usize) -> f64 {
        self.correlation.as_ref().map_or(1.0, |correlation| correlation[index])
    }
}

/// Rows of all joints in all columns, each joint divided by its noise, reduced to
/// `[unknowns + 1, unknowns + 1]`.
pub(crate) fn stack(factors: &[JointFactor], unknowns: usize, noise: &[f64]) -> Mat<f64> {
    let height: usize = factors.iter().map(|joint| joint.factor.nrows()).sum();
    let mut all = Mat::zeros(height, unknowns + 1);
    let mut first = 0;
    for (joint, noise) in factors.iter().zip(noise) {
        let size = joint.factor.nrows();
        for (from, &to) in joint.columns.iter().chain([&unknowns]).enumerate() {
            for row in 0..size {
                all[(first + row, to)] = joint.factor[(row, from)] / noise;
            }
        }
        first += size;
    }
    triangle(all.as_ref())
}

impl Estimate {
    /// [`Self::whitened`] with the noise levels that other base parameters leave: where constraints
    /// move them, joints whose rows they fit worse weigh less.
    pub(crate) fn whitened_at(
        &self,
        factors: &[JointFactor],
        values: &[f64],
        correlation: &[f64],
    ) -> Mat<f64> {
        let unknowns = values.len();
        let freedom = degrees_of_freedom(factors, unknowns);
        let least = least_noise(&self.weights, factors);
        let noise = floored(&residual_noise(factors, values, &freedom), factors, &least);
        let used =
            |(noise, weight): (&f64, &f64)| if weight.is_finite() { *noise } else { f64::INFINITY };
        let weights: Vec<f64> = noise.iter().zip(&self.weights).map(used).collect();
        let unit = unit_noise(factors, &weights, &noise, &freedom, correlation);
        faer::Scale(1.0 / unit) * stack(factors, unknowns, &weights)
    }
}

/// Rows of each factor less their share of the unknowns.
pub(super) fn degrees_of_freedom(factors: &[JointFactor], unknowns: usize) -> Vec<f64> {
    let total: usize = factors.iter().map(|factor| factor.rows).sum();
    let share = |rows: usize| rows as f64 * (1.0 - unknowns as f64 / total as f64);
    factors.iter().map(|factor| share(factor.rows).max(1.0)).collect()
}

/// Standard deviation of the residual of each factor.
pub(super) fn residual_noise(factors: &[JointFactor], values: &[f64], freedom: &[f64]) -> Vec<f64> {
    let norm = |joint: &JointFactor| residual_norm(joint, values);
    factors.iter().zip(freedom).map(|(joint, freedom)| norm(joint) / freedom.sqrt()).collect()
}

/// |tau - W base| of a joint's rows.
pub(crate) fn residual_norm(joint: &JointFactor, values: &[f64]) -> f64 {
    let size = joint.factor.nrows();
    let row = |i: usize| {
        let columns = joint.columns.iter().enumerate();
        joint.factor[(i, size - 1)]
            - columns.map(|(k, &base)| joint.factor[(i, k)] * values[base]).sum::<f64>()
    };
    (0..size).map(|i| row(i).powi(2)).sum::<f64>().sqrt()
}

/// Standard deviation of the weighted rows, their memory included.
pub(super) fn unit_noise(
    factors: &[JointFactor],
    weights: &[f64],
    noise: &[f64],
    freedom: &[f64],
    inflation: &[f64],
) -> f64 {
    let used = (0..factors.len()).filter(|&index| weights[index].is_finite());
    let (mut squares, mut rows) = (0.0, 0.0);
    for index in used {
        squares += (noise[index] / weights[index]).powi(2) * inflation[index] * freedom[index];
        rows += freedom[index];
    }
    // Without noise the unit is what rounding leaves of the torque.
    let size: f64 = factors.iter().zip(weights).map(|(factor, weight)| size(factor) / weight).sum();
    (squares / rows).sqrt().max(1e-9 * size / f64::sqrt(rows)).max(f64::MIN_POSITIVE)
}

pub(super) fn torque_norm(factor: &JointFactor) -> f64 {
    factor.factor.col(factor.factor.ncols() - 1).norm_l2()
}

/// Norm of the torques; equations whose right-hand side is but rounding are measured by their left
/// one.
fn size(factor: &JointFactor) -> f64 {
    torque_norm(factor).max(1e-6 * factor.factor.norm_max())
}

/// Share of a torque below which no noise is told apart from none.
pub(super) const TRIFLE: f64 = 1e-10;

/// Noise levels that can be divided by, none below `least` or what is known of the rows: a joint
/// without noise gets a trifle of its torque.
pub(super) fn floored(noise: &[f64], factors: &[JointFactor], least: &[f64]) -> Vec<f64> {
    let torque = |joint: &JointFactor| size(joint) / (joint.rows.max(1) as f64).sqrt();
    let floors = factors
        .iter()
        .zip(least)
        .map(|(joint, least)| least.max(joint.least_noise).max(TRIFLE * torque(joint)));
    noise.iter().zip(floors).map(|(noise, floor)| noise.max(floor).max(f64::MIN_POSITIVE)).collect()
}

/// Noise below which factors with fewer rows than parameters do not come: these can follow the rows
/// exactly, and the closer they do the more the rows would weigh. Zero for the others.
pub(super) fn least_noise(noise: &[f64], factors: &[JointFactor]) -> Vec<f64> {
    let few = |factor: &JointFactor| factor.rows < factor.columns.len();
    let least = |(noise, factor): (&f64, &JointFactor)| {
        if few(factor) && noise.is_finite() { *noise } else { 0.0 }
    };
    noise.iter().zip(factors).map(least).collect()
}

/// Solution of a triangular system by back substitution; `None` if a direction may be undetermined.
fn back_substitute(triangle: &Mat<f64>) -> Option<Vec<f64>> {
    let unknowns = triangle.ncols() - 1;
    let norm = |j: usize| triangle.col(j).subrows(0, j + 1).norm_l2();
    if (0..unknowns).any(|j| triangle[(j, j)] <= 1e-6 * norm(j)) {
        return None;
    }
    let mut x: Vec<f64> = (0..unknowns).map(|i| triangle[(i, unknowns)]).collect();
    for j in (0..unknowns).rev() {
        x[j] /= triangle[(j, j)];
        for i in 0..j {
            x[i] -= triangle[(i, j)] * x[j];
        }
    }
    Some(x)
}

/// Least-squares solution of a triangular system `[unknowns + 1, unknowns + 1]`; what it does not
/// determine stays at `nominal`.
pub(crate) fn triangular_solution(triangle: &Mat<f64>, nominal: &[f64]) -> Vec<f64> {
    back_substitute(triangle).unwrap_or_else(|| Solution::new(triangle, nominal).values)
}

/// Covariance of the unknowns of a triangular system whose rows are in units of their noise; none
/// if it does not determine all of them.
pub(crate) fn unit_covariance(triangle: &Mat<f64>) -> Option<Mat<f64>> {
    let solution = Solution::new(triangle, &vec![0.0; triangle.ncols() - 1]);
    solution.undetermined.iter().all(|dark| !dark).then_some(solution.inverse)
}

/// Number of singular values that count.
pub(super) fn determined(descending: &[f64]) -> usize {
    let smallest = RANK_TOLERANCE * descending.first().copied().unwrap_or(0.0);
    descending.iter().take_while(|value| **value > smallest).count()
}

/// Sum of factor * WᵀW over the rows of the used factors, `[unknowns, unknowns]`.
pub(super) fn weighted_gram(
    factors: &[JointFactor],
    used: &[bool],
    weights: &[f64],
    unknowns: usize,
) -> Mat<f64> {
    let mut sum = Mat::<f64>::zeros(unknowns, unknowns);
    for ((joint, used), weight) in factors.iter().zip(used).zip(weights) {
        if !used {
            continue;
        }
        let w = joint.factor.as_ref().subcols(0, joint.columns.len());
        let gram = w.transpose() * w;
        for (a, &i) in joint.columns.iter().enumerate() {
            for (b, &j) in joint.columns.iter().enumerate() {
                sum[(i, j)] += weight * gram[(a, b)];
            }
        }
    }
    sum
}

/// Root mean square torque per joint, over its rows of all kinds.
pub(crate) fn torque_sizes(factors: &[JointFactor], joints: usize) -> Vec<f64> {
    let of_joint = |joint: usize| {
        let own = factors.iter().filter(|factor| factor.joint == joint);
        let (squares, rows) = own.fold((0.0, 0), |(sum, rows), factor| {
            (sum + torque_norm(factor).powi(2), rows + factor.rows)
        });
        (squares / f64::max(rows as f64, 1.0)).sqrt()
    };
    (0..joints).map(of_joint).collect()
}

/// Least-squares solution of a triangular system by its singular values.
pub(super) struct Solution {
    pub values: Vec<f64>,
    /// Pseudo-inverse of RᵀR.
    pub inverse: Mat<f64>,
    /// Parameters with a share in an undetermined direction.
    pub undetermined: Vec<bool>,
}

impl Solution {
    pub fn new(triangle: &Mat<f64>, nominal: &[f64]) -> Self {
        let unknowns = nominal.len();
        let Scaled { norms, u, values: singular, v } = Scaled::new(triangle);
        let determined = determined(&singular);
        // Deviation from the nominal values, so that undetermined directions stay there.
        let rhs: Vec<f64> = (0..unknowns)
            .map(|i| {
                triangle[(i, unknowns)]
                    - (i..unknowns).map(|j| triangle[(i, j)] * nominal[j]).sum::<f64>()
            })
            .collect();
        // Zero for a column without content.
        let basis = Mat::from_fn(unknowns, determined, |i, k| v[(i, k)] / (norms[i] * singular[k]));
        let mut values = nominal.to_vec();
        for k in 0..determined {
            let along: f64 = (0..unknowns).map(|i| u[(i, k)] * rhs[i]).sum();
            values
                .iter_mut()
                .zip(basis.col(k).iter())
                .for_each(|(value, component)| *value += component * along);
        }
        let mut inverse = Mat::zeros(unknowns, unknowns);
        matmul(inverse.as_mut(), Accum::Replace, &basis, basis.transpose(), 1.0, Par::Seq);
        let in_the_dark = |i: usize| {
            norms[i].is_infinite() || (determined..unknowns).any(|k| v[(i, k)].abs() > 1e-6)
        };
        let undetermined = (0..unknowns).map(in_the_dark).collect();
        Self { values, inverse, undetermined }
    }

    /// Covariance of the solution under the noise that each joint really has (sandwich of the
    /// weights).
    fn covariance(
        &self,
        factors: &[JointFactor],
        weights: &[f64],
        noise: &[f64],
        inflation: &[f64],
    ) -> Mat<f64> {
        let used: Vec<bool> = weights.iter().map(|weight| weight.is_finite()).collect();
        let variance = noise.iter().zip(weights).zip(inflation);
        let variance: Vec<f64> = variance
            .map(|((noise, weight), inflation)| (noise / weight.powi(2)).powi(2) * inflation)
            .collect();
        self.sandwich(&weighted_gram(factors, &used, &variance, self.values.len()))
    }

    /// Inverse * middle * inverse, infinite for what is undetermined.
    pub fn sandwich(&self, middle: &Mat<f64>) -> Mat<f64> {
        let mut covariance = &self.inverse * middle * &self.inverse;
        for (k, undetermined) in self.undetermined.iter().enumerate() {
            if *undetermined {
                covariance[(k, k)] = f64::INFINITY;
            }
        }
        covariance
    }
}

/// Combinations of base parameters that the data determine, scaled so that the weighted rows,
/// expressed in them, have the identity as their Gram matrix.
pub(super) struct Directions {
    /// `[rank, directions]`: base = basis * coordinates.
    pub basis: Mat<f64>,
    /// The same, a base parameter to a column.
    by_parameter: Mat<f64>,
    /// Base parameters with a share in an undetermined direction.
    pub undetermined: Vec<bool>,
}

impl Directions {
    /// Of the first columns of a triangle.
    pub fn of(triangle: &Mat<f64>) -> Self {
        let Scaled { norms, values, v, .. } = Scaled::new(triangle);
        let determined = determined(&values);
        let basis =
            Mat::from_fn(norms.len(), determined, |i, k| v[(i, k)] / (norms[i] * values[k]));
        let dark = |i: usize| {
            norms[i].is_infinite() || (determined..norms.len()).any(|k| v[(i, k)].abs() > 1e-6)
        };
        let by_parameter = basis.transpose().to_owned();
        Self { basis, by_parameter, undetermined: (0..norms.len()).map(dark).collect() }
    }

    pub fn len(&self) -> usize {
        self.basis.ncols()
    }

    /// The factors of a row in the coordinates, times `scale`, added to `out`.
    pub fn add_coordinates(&self, columns: &[usize], row: &[f64], scale: f64, out: &mut [f64]) {
        for (&column, factor) in columns.iter().zip(row) {
            if *factor != 0.0 {
                let along = self.by_parameter.col_as_slice(column);
                out.iter_mut().zip(along).for_each(|(out, along)| *out += scale * factor * along);
            }
        }
    }

    /// base += basis * step.
    pub fn advance(&self, base: &mut [f64], step: &[f64]) {
        for (i, base) in base.iter_mut().enumerate() {
            *base +=
                step.iter().enumerate().map(|(k, step)| self.basis[(i, k)] * step).sum::<f64>();
        }
    }

    /// Covariance of the base parameters from that of the coordinates, infinite where nothing is
    /// known.
    pub fn covariance(&self, coordinates: &Mat<f64>) -> Mat<f64> {
        let mut covariance = &self.basis * coordinates * self.basis.transpose();
        for (k, undetermined) in self.undetermined.iter().enumerate() {
            if *undetermined {
                covariance[(k, k)] = f64::INFINITY;
            }
        }
        covariance
    }
}

/// Singular values of the first columns of a triangle, columns scaled to unit length.
pub(super) struct Scaled {
    /// Length of each column, infinite for one without content.
    pub norms: Vec<f64>,
    pub u: Mat<f64>,
    pub values: Vec<f64>,
    pub v: Mat<f64>,
}

impl Scaled {
    pub fn new(triangle: &Mat<f64>) -> Self {
        let unknowns = triangle.ncols() - 1;
        let square = triangle.as_ref().submatrix(0, 0, unknowns, unknowns);
        let norms: Vec<f64> = (0..unknowns).map(|j| square.col(j).norm_l2()).collect();
        // A column without content is left without content: what rounding puts there must not be
        // scaled to unit length.
        let largest = norms.iter().fold(0.0f64, |largest, norm| largest.max(*norm));
        let norms: Vec<f64> = norms
            .iter()
            .map(|norm| if *norm > 1e-10 * largest { *norm } else { f64::INFINITY })
            .collect();
        let scaled = Mat::from_fn(unknowns, unknowns, |i, j| square[(i, j)] / norms[j]);
        let Svd { u, values, v } = Svd::new(scaled.as_ref());
        Self { norms, u, values, v }
    }
}

impl ParameterExcitation {
    pub(super) fn of(triangle: &Mat<f64>) -> Self {
        let unknowns = triangle.ncols() - 1;
        let singular_values =
            Svd::new(triangle.as_ref().submatrix(0, 0, unknowns, unknowns)).values;
        let scaled = Scaled::new(triangle);
        let largest = scaled.values.first().copied().unwrap_or(0.0);
        let shares = |k: usize| {
            let mut shares: Vec<(usize, f64)> =
                (0..unknowns).map(|i| (i, scaled.v[(i, k)])).collect();
            shares.retain(|(_, share)| share.abs() > 0.1);
            shares.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            shares
        };
        let unexcited = (0..unknowns).filter(|&k| scaled.values[k] <= RANK_TOLERANCE * largest);
        let direction = |k: usize| SingularDirection {
            relative_singular_value: scaled.values[k] / largest,
            shares: shares(k),
        };
        let unexcited = unexcited.map(direction).collect();
        Self {
            weakest: unknowns.checked_sub(1).map(direction),
            condition: ratio(&singular_values),
            scaled_condition: ratio(&scaled.values),
            singular_values,
            unexcited,
        }
    }
}

fn ratio(descending: &[f64]) -> f64 {
    match descending {
        [] => 1.0,
        [largest, ..] => largest / descending[descending.len() - 1],
    }
}
