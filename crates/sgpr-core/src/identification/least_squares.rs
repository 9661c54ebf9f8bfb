//! Least squares on the factors of an [`Observation`](super::Observation).

use faer::Mat;

use super::{BaseParameters, IdentificationError, JointFactor};
use crate::linalg::{Svd, triangle};

/// How the joints are weighted.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// All rows in motion alike (thesis eq. 4-10).
    Ols,
    /// Each joint by the inverse of its noise variance, found from its residual and iterated (thesis eqs. 4-5, 4-6).
    ///
    /// The rows of a joint at rest are a group of their own: what dry friction may hold shows in their residual.
    Wls,
    /// Each joint by the inverse of a noise variance known beforehand, for instance from repeated periods (thesis eq.
    /// 4-8): standard deviations `[n]`, N·m (N).
    WlsKnown(Vec<f64>),
}

/// Least squares for the base parameters of a robot.
#[derive(Clone, Debug)]
pub struct LeastSquares {
    /// Weights.
    pub method: Method,
    /// Per factor: how many rows carry as much as one independent row, because the noise remembers. The variance of the
    /// estimates grows by it.
    pub correlation: Option<Vec<f64>>,
}

/// Estimated base parameters with all that can be said of them.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Estimates, `[rank]`.
    pub values: Vec<f64>,
    /// Covariance of the estimates, `[rank, rank]`; infinite where the motion says nothing.
    pub covariance: Mat<f64>,
    /// Root mean square of the torque residual per factor, N·m (N).
    pub noise: Vec<f64>,
    /// What the motion excited.
    pub excitation: Excitation,
}

impl Estimate {
    /// Standard deviations, `[rank]`.
    pub fn standard_deviations(&self) -> Vec<f64> {
        (0..self.values.len()).map(|k| self.covariance[(k, k)].max(0.0).sqrt()).collect()
    }

    /// Standard deviations as a share of the estimate, `[rank]`.
    pub fn relative_standard_deviations(&self) -> Vec<f64> {
        self.standard_deviations().iter().zip(&self.values).map(|(std, value)| std / value.abs()).collect()
    }
}

/// How well the motion excites the base parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Excitation {
    /// Singular values of W, largest first.
    pub singular_values: Vec<f64>,
    /// cond(W), the ratio of the largest and smallest singular value (thesis eq. 3-10); infinite if one is zero.
    pub condition: f64,
    /// The same with every column scaled to unit length, which does not depend on units.
    pub scaled_condition: f64,
    /// Directions that no row depends on.
    pub unexcited: Vec<SingularDirection>,
}

/// A combination of base parameters that the data do not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct SingularDirection {
    /// Singular value of the scaled W, relative to the largest.
    pub relative_singular_value: f64,
    /// (Base parameter, share), largest share first; shares below a tenth are left out.
    pub shares: Vec<(usize, f64)>,
}

/// Weights are iterated until they change by less than this share; a thousandth of the weights changes the estimates by
/// far less than their standard deviation.
const SAME_WEIGHTS: f64 = 1e-4;
const MOST_ITERATIONS: usize = 20;

/// Below this share of the largest singular value a direction is not excited.
const RANK_TOLERANCE: f64 = 1e-9;

impl LeastSquares {
    /// With these weights.
    pub fn new(method: Method) -> Self {
        Self { method, correlation: None }
    }

    /// Estimates the base parameters. In directions that the data do not determine the estimate stays at `nominal`.
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
        let unknowns = base.rank();
        assert_eq!(nominal.len(), unknowns, "a nominal value for every base parameter");
        let used: Vec<bool> = factors.iter().map(|factor| self.uses(factor)).collect();
        let count = |(factor, used): (&JointFactor, &bool)| if *used { factor.rows } else { 0 };
        match factors.iter().zip(&used).map(count).sum::<usize>() {
            0 => return Err(IdentificationError::NoData),
            rows if rows < unknowns => return Err(IdentificationError::TooFewRows { rows, parameters: unknowns }),
            _ => {}
        }
        let ignored = |weight: f64, used: &bool| if *used { weight } else { f64::INFINITY };
        let ones: Vec<f64> = used.iter().map(|used| ignored(1.0, used)).collect();
        let excitation = Excitation::of(&stack(factors, unknowns, &ones));
        let freedom = degrees_of_freedom(factors, unknowns);
        let residual = |weights: &[f64]| {
            let system = stack(factors, unknowns, weights);
            let values = back_substitute(&system).unwrap_or_else(|| Solution::new(&system, nominal).values);
            residual_noise(factors, &values, &freedom)
        };
        let mut weights = ones;
        match &self.method {
            Method::Ols => {}
            Method::WlsKnown(known) => {
                if let Some(joint) = known.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
                    return Err(IdentificationError::Noise { joint, value: known[joint] });
                }
                let of_joint = |(factor, used): (&JointFactor, &bool)| ignored(known[factor.joint], used);
                weights = factors.iter().zip(&used).map(of_joint).collect();
            }
            Method::Wls => {
                for _ in 0..MOST_ITERATIONS {
                    let noise = floored(&residual(&weights), factors);
                    let noise = noise.iter().zip(&used).map(|(noise, used)| ignored(*noise, used)).collect();
                    let before = std::mem::replace(&mut weights, noise);
                    let change = |((new, old), used): ((&f64, &f64), &bool)| {
                        if *used { (new / old - 1.0).abs() } else { 0.0 }
                    };
                    if weights.iter().zip(&before).zip(&used).map(change).fold(0.0, f64::max) < SAME_WEIGHTS {
                        break;
                    }
                }
            }
        }
        let solution = Solution::new(&stack(factors, unknowns, &weights), nominal);
        let noise = residual_noise(factors, &solution.values, &freedom);
        let inflation: Vec<f64> = (0..factors.len()).map(|index| self.correlation_of(index)).collect();
        let covariance = solution.covariance(factors, &weights, &noise, &inflation);
        Ok(Estimate { values: solution.values, covariance, noise, excitation })
    }

    /// Rows at rest need a weight of their own.
    fn uses(&self, factor: &JointFactor) -> bool {
        !factor.resting || self.method == Method::Wls
    }

    fn correlation_of(&self, index: usize) -> f64 {
        self.correlation.as_ref().map_or(1.0, |correlation| correlation[index])
    }
}

/// Rows of all joints in all columns, each joint divided by its noise, reduced to `[unknowns + 1, unknowns + 1]`.
fn stack(factors: &[JointFactor], unknowns: usize, noise: &[f64]) -> Mat<f64> {
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

/// Rows of each factor less their share of the unknowns.
fn degrees_of_freedom(factors: &[JointFactor], unknowns: usize) -> Vec<f64> {
    let total: usize = factors.iter().map(|factor| factor.rows).sum();
    let share = |rows: usize| rows as f64 * (1.0 - unknowns as f64 / total as f64);
    factors.iter().map(|factor| share(factor.rows).max(1.0)).collect()
}

/// Standard deviation of the residual of each factor.
fn residual_noise(factors: &[JointFactor], values: &[f64], freedom: &[f64]) -> Vec<f64> {
    let norm = |joint: &JointFactor| residual_norm(joint, values);
    factors.iter().zip(freedom).map(|(joint, freedom)| norm(joint) / freedom.sqrt()).collect()
}

/// |tau - W base| of a joint's rows.
fn residual_norm(joint: &JointFactor, values: &[f64]) -> f64 {
    let size = joint.factor.nrows();
    let row = |i: usize| {
        let columns = joint.columns.iter().enumerate();
        joint.factor[(i, size - 1)] - columns.map(|(k, &base)| joint.factor[(i, k)] * values[base]).sum::<f64>()
    };
    (0..size).map(|i| row(i).powi(2)).sum::<f64>().sqrt()
}

/// Noise levels that can be divided by: a joint without noise gets a trifle of its torque.
fn floored(noise: &[f64], factors: &[JointFactor]) -> Vec<f64> {
    let torque =
        |joint: &JointFactor| joint.factor.col(joint.factor.ncols() - 1).norm_l2() / (joint.rows.max(1) as f64).sqrt();
    noise.iter().zip(factors).map(|(noise, joint)| noise.max(1e-10 * torque(joint)).max(f64::MIN_POSITIVE)).collect()
}

/// Solution of a triangular system by back substitution; `None` if a direction may be undetermined.
fn back_substitute(triangle: &Mat<f64>) -> Option<Vec<f64>> {
    let unknowns = triangle.ncols() - 1;
    let norm = |j: usize| triangle.col(j).subrows(0, j + 1).norm_l2();
    if (0..unknowns).any(|j| triangle[(j, j)] < 1e-6 * norm(j)) {
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

/// Least-squares solution of a triangular system by its singular values.
struct Solution {
    values: Vec<f64>,
    /// Pseudo-inverse of RᵀR.
    inverse: Mat<f64>,
    /// Parameters with a share in an undetermined direction.
    undetermined: Vec<bool>,
}

impl Solution {
    fn new(triangle: &Mat<f64>, nominal: &[f64]) -> Self {
        let unknowns = nominal.len();
        let Scaled { norms, u, values: singular, v } = Scaled::new(triangle);
        let smallest = RANK_TOLERANCE * singular.first().copied().unwrap_or(0.0);
        let determined = singular.iter().take_while(|value| **value > smallest).count();
        // Deviation from the nominal values, so that undetermined directions stay there.
        let rhs: Vec<f64> = (0..unknowns)
            .map(|i| triangle[(i, unknowns)] - (i..unknowns).map(|j| triangle[(i, j)] * nominal[j]).sum::<f64>())
            .collect();
        let mut values = nominal.to_vec();
        let mut inverse = Mat::zeros(unknowns, unknowns);
        for k in 0..determined {
            let along = (0..unknowns).map(|i| u[(i, k)] * rhs[i]).sum::<f64>() / singular[k];
            for i in 0..unknowns {
                let component = v[(i, k)] / norms[i]; // zero for a column without content
                values[i] += component * along;
                for j in 0..unknowns {
                    inverse[(i, j)] += component * v[(j, k)] / (norms[j] * singular[k].powi(2));
                }
            }
        }
        let in_the_dark = |i: usize| norms[i].is_infinite() || (determined..unknowns).any(|k| v[(i, k)].abs() > 1e-6);
        let undetermined = (0..unknowns).map(in_the_dark).collect();
        Self { values, inverse, undetermined }
    }

    /// Covariance of the solution under the noise that each joint really has (sandwich of the weights).
    fn covariance(&self, factors: &[JointFactor], weights: &[f64], noise: &[f64], inflation: &[f64]) -> Mat<f64> {
        let unknowns = self.values.len();
        let mut middle = Mat::<f64>::zeros(unknowns, unknowns);
        for (index, joint) in factors.iter().enumerate() {
            if weights[index].is_infinite() {
                continue;
            }
            let variance = (noise[index] / weights[index].powi(2)).powi(2) * inflation[index];
            let size = joint.columns.len();
            let w = joint.factor.as_ref().subcols(0, size);
            let gram = w.transpose() * w;
            for (a, &i) in joint.columns.iter().enumerate() {
                for (b, &j) in joint.columns.iter().enumerate() {
                    middle[(i, j)] += variance * gram[(a, b)];
                }
            }
        }
        let mut covariance = &self.inverse * middle * &self.inverse;
        for (k, undetermined) in self.undetermined.iter().enumerate() {
            if *undetermined {
                covariance[(k, k)] = f64::INFINITY;
            }
        }
        covariance
    }
}

/// Singular values of the first columns of a triangle, columns scaled to unit length.
struct Scaled {
    norms: Vec<f64>,
    u: Mat<f64>,
    values: Vec<f64>,
    v: Mat<f64>,
}

impl Scaled {
    fn new(triangle: &Mat<f64>) -> Self {
        let unknowns = triangle.ncols() - 1;
        let square = triangle.as_ref().submatrix(0, 0, unknowns, unknowns);
        let norms: Vec<f64> = (0..unknowns).map(|j| square.col(j).norm_l2()).collect();
        // A column without content is left without content: what rounding puts there must not be scaled to unit length.
        let largest = norms.iter().fold(0.0f64, |largest, norm| largest.max(*norm));
        let norms: Vec<f64> =
            norms.iter().map(|norm| if *norm > 1e-10 * largest { *norm } else { f64::INFINITY }).collect();
        let scaled = Mat::from_fn(unknowns, unknowns, |i, j| square[(i, j)] / norms[j]);
        let Svd { u, values, v } = Svd::new(scaled.as_ref());
        Self { norms, u, values, v }
    }
}

impl Excitation {
    fn of(triangle: &Mat<f64>) -> Self {
        let unknowns = triangle.ncols() - 1;
        let singular_values = Svd::new(triangle.as_ref().submatrix(0, 0, unknowns, unknowns)).values;
        let scaled = Scaled::new(triangle);
        let largest = scaled.values.first().copied().unwrap_or(0.0);
        let shares = |k: usize| {
            let mut shares: Vec<(usize, f64)> = (0..unknowns).map(|i| (i, scaled.v[(i, k)])).collect();
            shares.retain(|(_, share)| share.abs() > 0.1);
            shares.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            shares
        };
        let unexcited = (0..unknowns).filter(|&k| scaled.values[k] <= RANK_TOLERANCE * largest);
        let unexcited = unexcited
            .map(|k| SingularDirection { relative_singular_value: scaled.values[k] / largest, shares: shares(k) })
            .collect();
        Self { condition: ratio(&singular_values), scaled_condition: ratio(&scaled.values), singular_values, unexcited }
    }
}

fn ratio(descending: &[f64]) -> f64 {
    match descending {
        [] => 1.0,
        [largest, ..] => largest / descending[descending.len() - 1],
    }
}
