//! Every estimator under a prior: the posterior mean.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::forecast::variances;
use super::least_squares::{
    MOST_ITERATIONS, ParameterExcitation, SAME_WEIGHTS, TRIFLE, floored, least_noise,
    residual_noise, stack, triangular_solution, unit_noise,
};
use super::prior::{ParameterPrior, Posterior, non_negative, refused};
use super::{
    Equations, Estimate, IdentificationError, JointFactor, LeastSquares, Method, estimate,
};
use crate::linalg::Matrix;

/// How wide the prior on bodies is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PriorWidth {
    /// As the data make probable ([`ParameterPrior::chosen_by`]); weak for rich logs.
    #[default]
    Chosen,
    /// As the data make probable, however rich the logs look.
    InForce,
    /// The same, but no wider than this relative deviation: what a fit with less freedom took.
    AtMost(f64),
    /// This relative deviation of the robot file's values.
    Given(f64),
}

/// An estimate and the prior that holds it where the data do not.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Held {
    /// The posterior mean, and its covariance: that of the estimator where the data speak, the
    /// prior's where they do not.
    pub estimate: Estimate,
    /// With the width that was used.
    pub prior: ParameterPrior,
    /// What the prior is put beside: `[rank + 1, rank + 1]`, a triangle [R | R t] of an estimate t
    /// without prior, rows of R in units of their joint's noise, its memory counted.
    pub data: Matrix,
    /// Those units by factor, N·m (N); infinite for factors that are left out.
    pub levels: Vec<f64>,
    /// Parameters that the data make negative beyond chance although physics forbids it, and what
    /// the data make them.
    pub refused: Vec<(usize, f64)>,
}

impl Held {
    /// Covariance of the parameters after `longer` times as much data of the same kind,
    /// `[rank, rank]`.
    pub(crate) fn covariance_with(&self, longer: f64) -> Mat<f64> {
        let root = self.prior.posterior(&(faer::Scale(longer.sqrt()) * &*self.data)).root;
        &root * root.transpose()
    }
}

/// A factor with fewer rows than this many per column is followed by its parameters too closely to
/// start from.
const ROWS_PER_COLUMN: usize = 2;

/// Iterations in which widths are chosen: with the first weights, and with better ones.
const CHOICES: usize = 2;

impl PriorWidth {
    fn of(self, prior: ParameterPrior, whitened: &Matrix) -> ParameterPrior {
        match self {
            Self::Chosen | Self::InForce => prior.chosen_by(whitened),
            Self::AtMost(widest) => {
                let chosen = prior.chosen_by(whitened);
                let deviation = chosen.relative_deviation().min(widest);
                chosen.with_relative_deviation(deviation)
            }
            Self::Given(deviation) => prior.with_relative_deviation(deviation),
        }
    }

    pub(crate) fn check(self) -> Result<(), IdentificationError> {
        match self {
            Self::Given(value) | Self::AtMost(value) => super::check_prior_deviation(value),
            _ => Ok(()),
        }
    }
}

/// [`estimate`](super::estimate()) under a prior.
///
/// Other methods than least squares give an estimate t with the information I of its rows; data and
/// prior together say (I + PᵀP)⁻¹ (I t + PᵀP mean). [`RIDGE`](super::RIDGE) has a prior of its own
/// and stays as it is.
///
/// # Errors
/// As [`estimate`](super::estimate()), but that there may be few rows;
/// [`IdentificationError::Prior`] for a width that is not positive.
pub fn estimate_with_prior(
    method: &Method,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    prior: &ParameterPrior,
    width: PriorWidth,
    correlation: Option<&[f64]>,
) -> Result<Held, IdentificationError> {
    let start =
        LeastSquares { method: method.clone(), correlation: correlation.map(<[f64]>::to_vec) };
    let held = start.solve_with_prior(factors, prior, width)?;
    if method.is_least_squares() {
        return Ok(held);
    }
    let mut found = estimate::from_start(
        method,
        equations,
        factors,
        held.estimate.clone(),
        held.prior.mean(),
        correlation,
    )?;
    if method.has_prior() {
        return Ok(Held { estimate: found, ..held });
    }
    // The rows know as much as those of least squares, joint by joint; where the method puts the
    // parameters is its own.
    let data = informed(&held.data, &found.values);
    let prior = width.of(held.prior, &data);
    let posterior = prior.posterior(&data);
    found.covariance = posterior.covariance(&of_estimate(&data, &found.covariance)).into();
    found.values = posterior.values;
    Ok(Held { estimate: found, prior, data, levels: held.levels, refused: posterior.refused })
}

/// Triangle [R | R t] of data that know as much of the parameters as R and put them at `values` t.
fn informed(data: &Mat<f64>, values: &[f64]) -> Matrix {
    let rank = values.len();
    let along = |i: usize| (i..rank).map(|j| data[(i, j)] * values[j]).sum::<f64>();
    Matrix::from_fn(rank + 1, rank + 1, |i, j| match (i < rank, j < rank) {
        (true, true) => data[(i, j)],
        (true, false) => along(i),
        _ => 0.0,
    })
}

/// The estimate with some parameters not negative, as far from it as its rows allow, and those that
/// it makes negative beyond chance. Its covariance stays.
pub(crate) fn without_negative(
    mut estimate: Estimate,
    constrained: &[usize],
) -> (Estimate, Vec<(usize, f64)>) {
    let deviations = estimate.standard_deviations();
    let refused = refused(&estimate.values, |k| deviations[k], constrained);
    if constrained.iter().any(|k| estimate.values[*k] < 0.0) {
        estimate.values =
            non_negative(&informed(&estimate.whitened, &estimate.values), constrained, &[]);
    }
    (estimate, refused)
}

/// Covariance of RᵀR t for an estimate t of this covariance; RᵀR itself where that is not finite.
fn of_estimate(data: &Mat<f64>, covariance: &Mat<f64>) -> Mat<f64> {
    let rank = covariance.nrows();
    let r = data.as_ref().submatrix(0, 0, rank, rank);
    let information = r.transpose() * r;
    match (0..rank).all(|k| covariance[(k, k)].is_finite()) {
        true => &information * covariance * &information,
        false => information,
    }
}

impl LeastSquares {
    /// [`Self::solve`] under a prior: least squares gives an estimate t, what the rows know of each
    /// direction the information of rows in units of their own joint's noise and memory; (I +
    /// PᵀP)⁻¹ (I t + PᵀP mean) is the estimate. So t stays where the rows know more than the prior,
    /// and a joint whose residual remembers long takes no certainty from the others.
    ///
    /// Noise is what least squares leaves: what a prior leaves in conflict with the data would
    /// count as noise and make the prior stronger. With fewer than two rows per column least
    /// squares follows them, and noise is what the posterior mean leaves, by the degrees of freedom
    /// that it takes; so there may be fewer rows than parameters.
    ///
    /// # Errors
    /// If there is no row, known noise levels are not positive, or the width is not.
    pub fn solve_with_prior(
        &self,
        factors: &[JointFactor],
        prior: &ParameterPrior,
        width: PriorWidth,
    ) -> Result<Held, IdentificationError> {
        width.check()?;
        let unknowns = prior.mean().len();
        let inflation: Vec<f64> =
            (0..factors.len()).map(|index| self.correlation_of(index)).collect();
        let mut now = self.start(factors, prior)?;
        let least = resolved(factors, &prior.covariance());
        let mut prior = prior.clone();
        for iteration in 1.. {
            now.iterations += 1;
            let unit = unit_noise(factors, &now.weights, &now.noise, &now.freedom, &inflation);
            let whitened = faer::Scale(1.0 / unit) * stack(factors, unknowns, &now.weights);
            let levels = now.levels(factors, &inflation, &least);
            let data = informed(
                &stack(factors, unknowns, &levels),
                &triangular_solution(&whitened, prior.mean()),
            );
            if iteration <= CHOICES {
                prior = width.of(prior, &data);
            }
            let posterior = prior.posterior(&data);
            let settled = !now.few || {
                now.freedom = freedom_left(factors, &levels, &posterior);
                now.noise = residual_noise(factors, &posterior.values, &now.freedom);
                now.reweigh(factors, self.reweighted()) < SAME_WEIGHTS
                    || iteration >= MOST_ITERATIONS
            };
            if settled {
                let noise = residual_noise(factors, &posterior.values, &now.freedom);
                let covariance = posterior.covariance(&of_estimate(&data, &now.covariance));
                let WeightStart { weights, excitation, iterations, .. } = now;
                let estimate = Estimate {
                    values: posterior.values,
                    covariance: covariance.into(),
                    noise,
                    excitation,
                    whitened: whitened.into(),
                    weights,
                    log_shares: vec![],
                    unit,
                    iterations,
                    notes: vec![],
                };
                return Ok(Held { estimate, prior, data, levels, refused: posterior.refused });
            }
        }
        unreachable!("the last iteration returns")
    }

    /// Where the iteration begins: with least squares where that is well determined, else with what
    /// the expected parameters leave over.
    fn start(
        &self,
        factors: &[JointFactor],
        prior: &ParameterPrior,
    ) -> Result<WeightStart, IdentificationError> {
        let unknowns = prior.mean().len();
        let used: Vec<bool> = factors.iter().map(|factor| self.uses(factor)).collect();
        let rows = |(factor, used): (&JointFactor, &bool)| if *used { factor.rows } else { 0 };
        let total: usize = factors.iter().zip(&used).map(rows).sum();
        if total == 0 {
            return Err(IdentificationError::NoData);
        }
        let few = self.has_few_rows(factors, unknowns);
        if !few {
            let Estimate { values, covariance, weights, noise, excitation, iterations, .. } =
                self.solve_unknowns(factors, prior.mean())?;
            let freedom = super::least_squares::degrees_of_freedom(factors, values.len());
            return Ok(WeightStart {
                weights,
                noise,
                freedom,
                covariance: covariance.into(),
                excitation,
                iterations,
                few,
            });
        }
        let freedom: Vec<f64> = factors.iter().map(|factor| factor.rows as f64).collect();
        let noise = residual_noise(factors, prior.mean(), &freedom);
        let floors = floored(&noise, factors, &vec![0.0; factors.len()]);
        let ignored = |weight: f64, used: bool| if used { weight } else { f64::INFINITY };
        let ones: Vec<f64> = used.iter().map(|used| ignored(1.0, *used)).collect();
        let excitation = ParameterExcitation::of(&stack(factors, unknowns, &ones));
        let weights = match &self.method {
            Method::Ols => ones,
            Method::WlsKnown(known) => {
                if let Some(joint) = known.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
                    return Err(IdentificationError::Noise { joint, value: known[joint] });
                }
                factors
                    .iter()
                    .zip(&used)
                    .map(|(factor, used)| ignored(known[factor.joint], *used))
                    .collect()
            }
            _ => floors.iter().zip(&used).map(|(noise, used)| ignored(*noise, *used)).collect(),
        };
        let covariance = Mat::from_fn(unknowns, unknowns, |_, _| f64::INFINITY);
        Ok(WeightStart { weights, noise, freedom, covariance, excitation, iterations: 0, few })
    }

    /// Whether parameters could follow the rows, of all factors or of a joint in motion.
    pub(crate) fn has_few_rows(&self, factors: &[JointFactor], unknowns: usize) -> bool {
        let used = factors.iter().filter(|factor| self.uses(factor));
        let total: usize = used.clone().map(|factor| factor.rows).sum();
        let few = |factor: &JointFactor| factor.rows < ROWS_PER_COLUMN * factor.columns.len();
        total < unknowns || used.filter(|factor| !factor.resting).any(few)
    }

    fn reweighted(&self) -> bool {
        !matches!(self.method, Method::Ols | Method::WlsKnown(_))
    }
}

struct WeightStart {
    /// Noise level by which the rows of each factor are divided, infinite for those left out.
    weights: Vec<f64>,
    noise: Vec<f64>,
    freedom: Vec<f64>,
    /// Of least squares, not finite where it does not know.
    covariance: Mat<f64>,
    excitation: ParameterExcitation,
    iterations: usize,
    /// Whether the parameters could follow the rows of a factor.
    few: bool,
}

impl WeightStart {
    /// Noise of each factor with its memory counted; infinite for those left out. Rows at rest that
    /// least squares follows, fewer than their columns, have the noise that it weighed them by.
    ///
    /// - `least`: noise below which none comes
    fn levels(&self, factors: &[JointFactor], inflation: &[f64], least: &[f64]) -> Vec<f64> {
        let mut least = least.to_vec();
        if !self.few {
            let weighed = least_noise(&self.weights, factors);
            least.iter_mut().zip(weighed).for_each(|(least, weighed)| *least = least.max(weighed));
        }
        let noise = floored(&self.noise, factors, &least);
        let pairs = noise.iter().zip(inflation).zip(&self.weights);
        let level = |((noise, inflation), weight): ((&f64, &f64), &f64)| {
            if weight.is_finite() { noise * inflation.sqrt() } else { f64::INFINITY }
        };
        pairs.map(level).collect()
    }

    /// Takes the noise for the weights, if these are to be found; by which share they moved at
    /// most.
    fn reweigh(&mut self, factors: &[JointFactor], reweighted: bool) -> f64 {
        if !reweighted {
            return 0.0;
        }
        let noise = floored(&self.noise, factors, &vec![0.0; factors.len()]);
        let used =
            |(noise, weight): (&f64, &f64)| if weight.is_finite() { *noise } else { f64::INFINITY };
        let weights: Vec<f64> = noise.iter().zip(&self.weights).map(used).collect();
        let before = std::mem::replace(&mut self.weights, weights);
        let change =
            |(new, old): (&f64, &f64)| if old.is_finite() { (new / old - 1.0).abs() } else { 0.0 };
        self.weights.iter().zip(&before).map(change).fold(0.0, f64::max)
    }
}

/// Noise of each factor, a trifle of the torque that parameters of a covariance make: rows that
/// knew more would leave no digit to a prior of this covariance.
fn resolved(factors: &[JointFactor], covariance: &Mat<f64>) -> Vec<f64> {
    let of = |factor: &JointFactor| {
        TRIFLE * (variances(covariance, factor) / factor.rows.max(1) as f64).sqrt()
    };
    factors.iter().map(of).collect()
}

/// Rows of each factor less those that the posterior mean follows: the trace of what turns torques
/// into predictions.
fn freedom_left(factors: &[JointFactor], levels: &[f64], posterior: &Posterior) -> Vec<f64> {
    let rank = posterior.root.nrows();
    let taken = |(factor, level): (&JointFactor, &f64)| {
        if level.is_infinite() {
            return 0.0;
        }
        let count = factor.columns.len();
        let root = Mat::from_fn(count, rank, |i, j| posterior.root[(factor.columns[i], j)]);
        let product = factor.factor.as_ref().submatrix(0, 0, count, count) * root;
        product.squared_norm_l2() / level.powi(2)
    };
    let pairs = factors.iter().zip(levels);
    pairs.map(|pair| (pair.0.rows as f64 - taken(pair)).max(1.0)).collect()
}
