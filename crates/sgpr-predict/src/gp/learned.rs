//! The process of a model file: conditioned when its variance is asked for, for the weights of its
//! mean are in the file.

use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::kernels::Plan;
use super::triangular::Square;
use super::{Covariance, GpPredictor, Parts, Precision, VarianceParts, WeightRows};

/// A process and what it has seen.
#[derive(Clone, Debug)]
pub(crate) struct LearnedProcess {
    covariance: Covariance,
    /// X, `[points, inputs]`, row-major.
    x: Vec<f64>,
    inputs: usize,
    seen: Seen,
    /// Of the mean, one per point.
    weights: Vec<f64>,
}

/// What a process has seen.
#[derive(Clone, Debug)]
pub(crate) enum Seen {
    /// Measurements at its points.
    AtPoints(Vec<f64>),
    /// All rows, through its points, which are inducing ones.
    Through {
        /// K_uf R⁻¹ K_fu, columns of the lower triangle one after the other.
        products: Vec<f64>,
        /// K_uf R⁻¹ y.
        projection: Vec<f64>,
    },
}

/// variance = prior - |seen k|² + |unknown k|².
struct InverseFactors {
    seen: Square,
    unknown: Option<Square>,
}

impl InverseFactors {
    /// The inverse of the covariance of what was seen, times a column.
    fn solve(&self, column: &[f64]) -> Vec<f64> {
        let factor = self.unknown.as_ref().unwrap_or(&self.seen);
        factor.transposed_times(&factor.times(column))
    }
}

/// Share of the variance on the diagonal of the covariance of inducing points.
const INDUCING_JITTER: f64 = 1e-6;

/// Shares of the variance that are added to the diagonal where a covariance is not positive
/// definite without.
const JITTERS: [f64; 8] = [0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4];

impl LearnedProcess {
    /// - `weights`: solved for if none
    ///
    /// # Errors
    /// What is wrong.
    pub fn new(
        covariance: Covariance,
        x: Vec<f64>,
        inputs: usize,
        seen: Seen,
        weights: Option<Vec<f64>>,
    ) -> Result<Self, String> {
        covariance.validate(inputs).map_err(|error| error.to_string())?;
        let (count, all) = match &seen {
            Seen::AtPoints(y) => (y.len(), [&x[..], y, &[]]),
            Seen::Through { products, projection } => {
                (projection.len(), [&x[..], products, projection])
            }
        };
        if count == 0
            || x.len() != count * inputs
            || weights.as_ref().is_some_and(|weights| weights.len() != count)
        {
            return Err("the arrays of a process do not belong together".into());
        }
        if all.into_iter().chain(weights.as_deref()).flatten().any(|value| !value.is_finite()) {
            return Err("a process has numbers that are not finite".into());
        }
        let solve = weights.is_none();
        let mut process =
            Self { covariance, x, inputs, seen, weights: weights.unwrap_or_default() };
        if solve {
            process.weights = process.inverse_factors()?.solve(process.seen());
        }
        Ok(process)
    }

    fn seen(&self) -> &[f64] {
        match &self.seen {
            Seen::AtPoints(y) => y,
            Seen::Through { projection, .. } => projection,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len() / self.inputs
    }

    /// Variance before any data.
    pub fn prior_variance(&self) -> f64 {
        self.covariance.signal.variance()
    }

    /// Its mean.
    pub fn weighted_kernel(&self) -> super::WeightedKernel<'_> {
        let Self { covariance, x, inputs, weights, .. } = self;
        super::WeightedKernel { signal: &covariance.signal, x, inputs: *inputs, weights }
    }

    /// The mean, one point after the other.
    pub fn mean(&self, precision: Precision) -> GpPredictor {
        let weights = [self.weights.clone()];
        GpPredictor::weighing(&self.covariance.signal, &self.x, self.inputs, &weights, precision)
    }

    /// Mean and variance, one point after the other; and k(x, X) times the weights of what was seen
    /// of other outputs, if there are some.
    ///
    /// - `others`: `[points, others]`, row-major
    ///
    /// # Errors
    /// If its covariance is not positive definite.
    pub fn mean_and_variance(
        &self,
        precision: Precision,
        others: Option<&[f64]>,
    ) -> Result<(GpPredictor, Option<GpPredictor>), String> {
        let factors = self.inverse_factors()?;
        let size = self.len();
        let (seen, unknown) = (&factors.seen, factors.unknown.as_ref());
        let of_seen = |i: usize, j: usize| seen.row(i)[j];
        let of_unknown = |i: usize, j: usize| unknown.map_or(0.0, |unknown| unknown.row(i)[j]);
        let subtracted = WeightRows { at: &of_seen, rows: size, columns: size, triangle: true };
        let added = unknown.map(|_| WeightRows { at: &of_unknown, ..subtracted });
        let signal = &self.covariance.signal;
        let weights = [self.weights.clone()];
        let variance = Some(VarianceParts { subtracted, added });
        let parts = Parts { variance, ..Parts::new(signal, &self.x, self.inputs, &weights) };
        let predictor = GpPredictor::from_parts(&parts, precision);
        let others = others.filter(|others| !others.is_empty()).map(|others| {
            let width = others.len() / size;
            let column =
                |k: usize| others.iter().skip(k).step_by(width).copied().collect::<Vec<f64>>();
            let weights: Vec<Vec<f64>> = (0..width).map(|k| factors.solve(&column(k))).collect();
            GpPredictor::weighing(signal, &self.x, self.inputs, &weights, Precision::Double)
        });
        Ok((predictor, others))
    }

    /// Source: GPML algorithm 2.1; M. K. Titsias, Variational learning of inducing variables in
    /// sparse Gaussian processes, AISTATS (2009).
    fn inverse_factors(&self) -> Result<InverseFactors, String> {
        let failed =
            || String::from("the covariance of the points of a process is not positive definite");
        match &self.seen {
            Seen::AtPoints(_) => {
                let noise = self.covariance.noise_variance;
                let factor = self.factor(&self.covariance.kernel(), noise).ok_or_else(failed)?;
                Ok(InverseFactors { seen: inverse(&factor), unknown: None })
            }
            Seen::Through { products, .. } => {
                let size = self.len();
                let signal = &self.covariance.signal;
                let factor =
                    self.factor(signal, INDUCING_JITTER * signal.variance()).ok_or_else(failed)?;
                let place = |i: usize, j: usize| {
                    let (column, row) = (i.min(j), i.max(j));
                    column * size - column * (column + 1) / 2 + row
                };
                // L⁻¹ K_uf R⁻¹ K_fu L⁻ᵀ, from both sides.
                let mut inner = Square::from_fn(size, |i, j| products[place(i, j)]);
                factor.solve_lower(&mut inner);
                let mut inner = inner.transposed();
                factor.solve_lower(&mut inner);
                (0..size).for_each(|k| inner.values[k * size + k] += 1.0);
                let inner = inner.cholesky().ok_or_else(failed)?;
                let seen = inverse(&factor);
                let mut unknown = seen.clone();
                inner.solve_lower(&mut unknown);
                Ok(InverseFactors { seen, unknown: Some(unknown) })
            }
        }
    }

    /// Of the covariance of the points; `diagonal` is added.
    fn factor(&self, kernel: &super::Kernel, diagonal: f64) -> Option<Square> {
        let plan = Plan::new(kernel);
        let covariances = plan.covariances(&self.x, self.inputs);
        let size = self.len();
        JITTERS.iter().find_map(|share| {
            let mut matrix = Square { values: covariances.clone(), size };
            let diagonal = plan.variance() * (1.0 + share) + diagonal;
            (0..size).for_each(|k| matrix.values[k * size + k] = diagonal);
            matrix.cholesky()
        })
    }
}

fn inverse(factor: &Square) -> Square {
    let mut inverse = Square::identity(factor.size);
    factor.solve_lower(&mut inverse);
    inverse
}
