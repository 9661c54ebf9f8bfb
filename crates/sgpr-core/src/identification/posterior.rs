//! Every estimator under a prior: the posterior mean.

use faer::Mat;

use super::least_squares::{
    Excitation, MOST_ITERATIONS, SAME_WEIGHTS, floored, least_noise, residual_noise, stack, unit_noise, weighted_gram,
};
use super::prior::{ParameterPrior, Posterior};
use super::{Equations, Estimate, IdentificationError, JointFactor, LeastSquares, Method, estimate};

/// How wide the prior on bodies is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PriorWidth {
    /// As the data make most probable ([`ParameterPrior::chosen_by`]).
    #[default]
    Chosen,
    /// This relative deviation of the robot file's values.
    Given(f64),
}

/// An estimate and the prior that holds it where the data do not.
#[derive(Clone, Debug)]
pub struct Held {
    /// The posterior mean, and its covariance: that of the estimator where the data speak, the prior's where they do not.
    pub estimate: Estimate,
    /// With the width that was used.
    pub prior: ParameterPrior,
}

/// A factor with fewer rows than this many per column is followed by its parameters too closely to start from.
const ROWS_PER_COLUMN: usize = 2;

/// Iterations in which widths are chosen: with the first weights, and with better ones.
const CHOICES: usize = 2;

impl PriorWidth {
    fn of(self, prior: ParameterPrior, whitened: &Mat<f64>) -> ParameterPrior {
        match self {
            Self::Chosen => prior.chosen_by(whitened),
            Self::Given(deviation) => prior.with_relative_deviation(deviation),
        }
    }

    fn check(self) -> Result<(), IdentificationError> {
        match self {
            Self::Given(value) if !(value > 0.0 && value.is_finite()) => Err(IdentificationError::Prior { value }),
            _ => Ok(()),
        }
    }
}

/// [`estimate`](super::estimate()) under a prior.
///
/// Other methods than least squares give an estimate t with the information I of its rows; data and prior together say
/// (I + PᵀP)⁻¹ (I t + PᵀP mean). [`Method::Ridge`] has a prior of its own and stays as it is.
///
/// # Errors
/// As [`estimate`](super::estimate()), but that there may be few rows; [`IdentificationError::Prior`] for a width that is
/// not positive.
pub fn estimate_with_prior(
    method: &Method,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    prior: &ParameterPrior,
    width: PriorWidth,
    correlation: Option<&[f64]>,
) -> Result<Held, IdentificationError> {
    let start = LeastSquares { method: method.clone(), correlation: correlation.map(<[f64]>::to_vec) };
    let held = start.solve_with_prior(factors, prior, width)?;
    if matches!(method, Method::Ols | Method::Wls | Method::WlsKnown(_)) {
        return Ok(held);
    }
    let mut found = estimate::from_start(method, equations, factors, held.estimate, held.prior.mean(), correlation)?;
    if matches!(method, Method::Ridge { .. }) {
        return Ok(Held { estimate: found, prior: held.prior });
    }
    let rank = found.values.len();
    let r = found.whitened.as_ref().submatrix(0, 0, rank, rank).to_owned();
    let mut whitened = found.whitened.clone();
    for i in 0..rank {
        whitened[(i, rank)] = (i..rank).map(|j| r[(i, j)] * found.values[j]).sum();
    }
    let prior = width.of(held.prior, &whitened);
    let posterior = prior.posterior(&whitened);
    let information = r.transpose() * &r;
    let finite = (0..rank).all(|k| found.covariance[(k, k)].is_finite());
    let noise = if finite { &information * &found.covariance * &information } else { information };
    found.covariance = posterior.covariance(&noise);
    found.values = posterior.values;
    Ok(Held { estimate: found, prior })
}

impl LeastSquares {
    /// [`Self::solve`] under a prior, joints weighted by what the posterior mean leaves over and by the degrees of freedom
    /// that it takes, so that there may be fewer rows than parameters.
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
        let inflation: Vec<f64> = (0..factors.len()).map(|index| self.correlation_of(index)).collect();
        let mut now = self.start(factors, prior)?;
        let least = if now.few { vec![0.0; factors.len()] } else { least_noise(&now.weights, factors) };
        let mut prior = prior.clone();
        for iteration in 1.. {
            now.iterations += 1;
            let unit = unit_noise(factors, &now.weights, &now.noise, &now.freedom, &inflation);
            let whitened = faer::Scale(1.0 / unit) * stack(factors, unknowns, &now.weights);
            if iteration <= CHOICES {
                prior = width.of(prior, &whitened);
            }
            let posterior = prior.posterior(&whitened);
            let levels: Vec<f64> = now.weights.iter().map(|weight| weight * unit).collect();
            now.freedom = freedom_left(factors, &levels, &posterior);
            now.noise = residual_noise(factors, &posterior.values, &now.freedom);
            let noise = floored(&now.noise, factors, &least);
            let change = |(new, old): (&f64, &f64)| if old.is_finite() { (new / old - 1.0).abs() } else { 0.0 };
            let moved = noise.iter().zip(&now.weights).map(change).fold(0.0, f64::max);
            let settled = !self.reweighted() || moved < SAME_WEIGHTS || iteration >= MOST_ITERATIONS;
            if settled {
                let variance = now.noise.iter().zip(&levels).zip(&inflation);
                let variance: Vec<f64> =
                    variance.map(|((noise, level), inflation)| (noise / level.powi(2)).powi(2) * inflation).collect();
                let used: Vec<bool> = levels.iter().map(|level| level.is_finite()).collect();
                let covariance = posterior.covariance(&weighted_gram(factors, &used, &variance, unknowns));
                let Start { weights, noise, excitation, iterations, .. } = now;
                let estimate = Estimate {
                    values: posterior.values,
                    covariance,
                    noise,
                    excitation,
                    whitened,
                    weights,
                    log_shares: vec![],
                    unit,
                    iterations,
                    notes: vec![],
                };
                return Ok(Held { estimate, prior });
            }
            let used = |(noise, weight): (&f64, &f64)| if weight.is_finite() { *noise } else { f64::INFINITY };
            now.weights = noise.iter().zip(&now.weights).map(used).collect();
        }
        unreachable!("the last iteration returns")
    }

    /// Where the iteration begins: with least squares where that is well determined, else with what the expected parameters
    /// leave over.
    fn start(&self, factors: &[JointFactor], prior: &ParameterPrior) -> Result<Start, IdentificationError> {
        let unknowns = prior.mean().len();
        let used: Vec<bool> = factors.iter().map(|factor| self.uses(factor)).collect();
        let rows = |(factor, used): (&JointFactor, &bool)| if *used { factor.rows } else { 0 };
        let total: usize = factors.iter().zip(&used).map(rows).sum();
        if total == 0 {
            return Err(IdentificationError::NoData);
        }
        let is_few = |factor: &JointFactor| factor.rows < ROWS_PER_COLUMN * factor.columns.len();
        let few = total < unknowns || factors.iter().zip(&used).any(|(factor, used)| *used && is_few(factor));
        if !few {
            let Estimate { values, weights, noise, excitation, iterations, .. } =
                self.solve_unknowns(factors, prior.mean())?;
            let freedom = super::least_squares::degrees_of_freedom(factors, values.len());
            return Ok(Start { weights, noise, freedom, excitation, iterations, few });
        }
        let freedom: Vec<f64> = factors.iter().map(|factor| factor.rows as f64).collect();
        let noise = residual_noise(factors, prior.mean(), &freedom);
        let floors = floored(&noise, factors, &vec![0.0; factors.len()]);
        let ignored = |weight: f64, used: bool| if used { weight } else { f64::INFINITY };
        let ones: Vec<f64> = used.iter().map(|used| ignored(1.0, *used)).collect();
        let excitation = Excitation::of(&stack(factors, unknowns, &ones));
        let weights = match &self.method {
            Method::Ols => ones,
            Method::WlsKnown(known) => {
                if let Some(joint) = known.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
                    return Err(IdentificationError::Noise { joint, value: known[joint] });
                }
                factors.iter().zip(&used).map(|(factor, used)| ignored(known[factor.joint], *used)).collect()
            }
            _ => floors.iter().zip(&used).map(|(noise, used)| ignored(*noise, *used)).collect(),
        };
        Ok(Start { weights, noise, freedom, excitation, iterations: 0, few })
    }

    fn reweighted(&self) -> bool {
        !matches!(self.method, Method::Ols | Method::WlsKnown(_))
    }
}

struct Start {
    /// Noise level by which the rows of each factor are divided, infinite for those left out.
    weights: Vec<f64>,
    noise: Vec<f64>,
    freedom: Vec<f64>,
    excitation: Excitation,
    iterations: usize,
    /// Whether the parameters could follow the rows of a factor.
    few: bool,
}

/// Rows of each factor less those that the posterior mean follows: the trace of what turns torques into predictions.
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
