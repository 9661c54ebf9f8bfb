use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::exact::Prediction;
use super::induced::{
    CHUNK, Evidence, InducedPosterior, InducedProcess, InducedVariance, JITTER, cross_covariances,
    mirror, outputs_of, plan,
};
use super::kernels::{Features, Plan, TILE};
use super::matrix::inverse_from;
use super::{Compute, Covariance, Data, GpError, KernelError, LeaveOneOut};

/// Lower bound of the log marginal likelihood of a process that sees the data through m inducing
/// points: n m² operations and memory for n (inputs + outputs) + 6 m² numbers, so that a million
/// points are no burden.
///
/// log p(y) >= log N(y; 0, Q + noise I) - (n k(x, x) - tr Q) / (2 noise), Q = K_fu K_uu⁻¹ K_uf,
/// summed over outputs. The second term is what keeps the bound honest: points that the inducing
/// points do not explain cost something.
///
/// Source: M. K. Titsias, Variational learning of inducing variables in sparse Gaussian processes,
/// AISTATS (2009).
#[derive(Debug)]
pub struct SparseBound<'a> {
    data: &'a Data,
    compute: Compute,
}

/// Derivatives of the bound.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SparseGradient {
    /// By [`Covariance::theta`].
    pub theta: Vec<f64>,
    /// By the inducing points, `[inducing, inputs]`, row-major.
    pub inducing: Vec<f64>,
}

/// The bound, and what its gradient and the predictions need.
struct SolvedBound {
    value: f64,
    posterior: InducedPosterior,
}

/// Sum of the squares of y.
fn squares(evidence: &Evidence) -> f64 {
    (0..evidence.squares.ncols()).map(|o| evidence.squares[(o, o)]).sum()
}

impl<'a> SparseBound<'a> {
    /// The bound for data.
    pub fn new(data: &'a Data, compute: &Compute) -> Self {
        Self { data, compute: *compute }
    }

    /// The bound with these inducing points, `[inducing, inputs]`, row-major.
    ///
    /// # Errors
    /// If the covariance or the inducing points do not fit the data, or the covariance has
    /// correlated noise.
    pub fn value(&self, covariance: &Covariance, inducing: &[f64]) -> Result<f64, GpError> {
        let plan = self.plan(covariance, inducing)?;
        let points = plan.features(self.data.x(), self.data.inputs());
        let inducing = plan.features(inducing, self.data.inputs());
        let evidence = self.evidence(&plan, &points, &inducing);
        Ok(self.solve(&plan, &inducing, &evidence, covariance.noise_variance)?.value)
    }

    /// The bound and its derivatives.
    ///
    /// # Errors
    /// As [`SparseBound::value`].
    pub fn value_and_gradient(
        &self,
        covariance: &Covariance,
        inducing: &[f64],
    ) -> Result<(f64, SparseGradient), GpError> {
        let plan = self.plan(covariance, inducing)?;
        let noise = covariance.noise_variance;
        let (inputs, outputs) = (self.data.inputs(), self.data.outputs() as f64);
        let points = plan.features(self.data.x(), inputs);
        let induced = plan.features(inducing, inputs);
        let evidence = self.evidence(&plan, &points, &induced);
        let solution = self.solve(&plan, &induced, &evidence, noise)?;
        let Adjoints { of_inducing, of_products, of_noise } =
            self.adjoints(&plan, &evidence, &solution, noise);

        // d bound / d K_fu = 2 K_fu (d bound / d products) + y weightsᵀ / noise, a chunk of rows at
        // a time.
        let m = induced.count();
        let mut theta = vec![0.0; plan.theta_len()];
        let mut coordinates = vec![0.0; m * plan.coordinates()];
        let mut cross = Mat::zeros(CHUNK, m);
        let mut adjoint = Mat::zeros(CHUNK, m);
        for first in (0..points.count()).step_by(CHUNK) {
            let rows = CHUNK.min(points.count() - first);
            cross_covariances(&plan, &points, &induced, first, &mut cross, &self.compute);
            let part = cross.as_ref().subrows(0, rows);
            let mut out = adjoint.as_mut().subrows_mut(0, rows);
            matmul(
                out.as_mut(),
                Accum::Replace,
                part,
                of_products.as_ref(),
                2.0,
                self.compute.par(),
            );
            let y = outputs_of(self.data, first, rows);
            matmul(
                out,
                Accum::Add,
                y.as_ref(),
                solution.posterior.weights.transpose(),
                1.0 / noise,
                self.compute.par(),
            );
            let sums = [&mut theta[..], &mut coordinates];
            self.add_gradient(&plan, &points, first..first + rows, &induced, &adjoint, sums);
        }
        // By the inducing points K_uu changes in a row and in a column.
        let mut by_coordinates = vec![0.0; coordinates.len()];
        for (first, columns) in (0..m).step_by(CHUNK).map(|first| (first, CHUNK.min(m - first))) {
            let part = of_inducing.as_ref().subrows(first, columns);
            adjoint.as_mut().subrows_mut(0, columns).copy_from(part);
            let sums = [&mut theta[..], &mut by_coordinates];
            self.add_gradient(&plan, &induced, first..first + columns, &induced, &adjoint, sums);
        }
        coordinates.iter_mut().zip(&by_coordinates).for_each(|(sum, part)| *sum += 2.0 * part);
        let trace: f64 = (0..m).map(|i| of_inducing[(i, i)]).sum();
        let of_variance = -0.5 * outputs * points.count() as f64 / noise;
        plan.diagonal_gradient(JITTER * trace + of_variance, &mut theta);
        theta.push(noise * of_noise);

        let mut by_inputs = vec![0.0; inducing.len()];
        for (k, x) in inducing.chunks_exact(inputs).enumerate() {
            let coordinates = &coordinates[k * plan.coordinates()..(k + 1) * plan.coordinates()];
            plan.by_inputs(x, coordinates, &mut by_inputs[k * inputs..(k + 1) * inputs]);
        }
        Ok((solution.value, SparseGradient { theta, inducing: by_inputs }))
    }

    fn plan(&self, covariance: &Covariance, inducing: &[f64]) -> Result<Plan, GpError> {
        if covariance.correlated_noise.is_some() {
            let found =
                "correlated noise, which the search for a sparse process cannot have".into();
            return Err(KernelError::Unfit {
                found,
                advice: "leave it out, or thin the data and take the exact process",
            }
            .into());
        }
        let found = inducing.len() / self.data.inputs();
        if found > self.data.len() {
            return Err(GpError::InducingPoints { found, points: self.data.len() });
        }
        plan(self.data, covariance, inducing, &self.compute)
    }

    /// Of errors with variance one.
    fn evidence(&self, plan: &Plan, points: &Features<f64>, inducing: &Features<f64>) -> Evidence {
        Evidence::collect(self.data, plan, points, inducing, None, &self.compute)
    }

    fn solve(
        &self,
        plan: &Plan,
        inducing: &Features<f64>,
        evidence: &Evidence,
        noise: f64,
    ) -> Result<SolvedBound, GpError> {
        let (m, n) = (inducing.count(), self.data.len() as f64);
        let Evidence { products, projection, .. } = evidence;
        let posterior =
            InducedPosterior::new(plan, inducing, products, projection, noise, &self.compute)?;
        let fit = squares(evidence) / noise - posterior.fit;
        let log_root: f64 = (0..m).map(|i| posterior.inner_factor[(i, i)].ln()).sum();
        let per_output = n * (std::f64::consts::TAU * noise).ln() + 2.0 * log_root;
        let unexplained = (n * plan.variance() - posterior.explained) / noise;
        let value = -0.5 * (self.data.outputs() as f64 * (per_output + unexplained) + fit);
        Ok(SolvedBound { value, posterior })
    }

    fn adjoints(
        &self,
        plan: &Plan,
        evidence: &Evidence,
        solution: &SolvedBound,
        noise: f64,
    ) -> Adjoints {
        let (m, par) = (solution.posterior.inner_factor.ncols(), self.compute.par());
        let (n, outputs) = (self.data.len() as f64, self.data.outputs() as f64);
        let inverse_of = |inverse_factor: &Mat<f64>| {
            let mut inverse = Mat::zeros(m, m);
            inverse_from(inverse_factor.as_ref(), inverse.as_mut(), par);
            mirror(&mut inverse);
            inverse
        };
        let [prior, data] = solution.posterior.inverse_factors(par);
        let (prior_inverse, posterior_inverse) = (inverse_of(&prior), inverse_of(&data));
        let weights = &solution.posterior.weights;
        // By the matrix K_uu + products / noise.
        let mut of_sum = &posterior_inverse * faer::Scale(-0.5 * outputs);
        matmul(of_sum.as_mut(), Accum::Add, weights.as_ref(), weights.transpose(), -0.5, par);
        let mut of_products = &of_sum * faer::Scale(1.0 / noise);
        of_products += &prior_inverse * faer::Scale(0.5 * outputs / noise);
        let half = &prior_inverse * &evidence.products;
        let mut of_inducing = of_sum.clone();
        of_inducing += &prior_inverse * faer::Scale(0.5 * outputs);
        matmul(
            of_inducing.as_mut(),
            Accum::Add,
            half.as_ref(),
            prior_inverse.as_ref(),
            -0.5 * outputs / noise,
            par,
        );
        let inner_product = |a: &Mat<f64>, b: &Mat<f64>| -> f64 {
            a.col_iter().zip(b.col_iter()).map(|(a, b)| a.transpose() * b).sum()
        };
        let unexplained = n * plan.variance() - solution.posterior.explained;
        let of_noise = -0.5 * outputs * n / noise
            - inner_product(&of_sum, &evidence.products) / noise.powi(2)
            + 0.5 * squares(evidence) / noise.powi(2)
            - inner_product(&evidence.projection, weights) / noise.powi(2)
            + 0.5 * outputs * unexplained / noise.powi(2);
        Adjoints { of_inducing, of_products, of_noise }
    }

    /// Adds the share of some rows of `points`, with the adjoint of their covariances with the
    /// inducing points in the first rows of `adjoint`, to the derivatives by the hyperparameters
    /// and by the coordinates of the inducing points.
    fn add_gradient(
        &self,
        plan: &Plan,
        points: &Features<f64>,
        rows: Range<usize>,
        inducing: &Features<f64>,
        adjoint: &Mat<f64>,
        [theta, coordinates]: [&mut [f64]; 2],
    ) {
        let (first, width) = (rows.start, plan.coordinates());
        let work = |(u, coordinates): (usize, &mut [f64])| {
            let weights = &adjoint.col_as_slice(u)[..rows.len()];
            Arch::new().dispatch(PointGradient {
                plan,
                points,
                first,
                inducing,
                u,
                weights,
                coordinates,
            })
        };
        let add = |mut sum: Vec<f64>, part: Vec<f64>| {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            sum
        };
        let zero = || vec![0.0; plan.theta_len()];
        let sum = if self.compute.threads > 1 {
            // Collected first, so that the order of the sum does not depend on the threads.
            let parts: Vec<Vec<f64>> =
                coordinates.par_chunks_exact_mut(width).enumerate().map(work).collect();
            parts.into_iter().fold(zero(), add)
        } else {
            coordinates.chunks_exact_mut(width).enumerate().map(work).fold(zero(), add)
        };
        theta.iter_mut().zip(sum).for_each(|(theta, part)| *theta += part);
    }
}

/// Derivatives of the bound by what it is made of.
struct Adjoints {
    of_inducing: Mat<f64>,
    of_products: Mat<f64>,
    of_noise: f64,
}

struct PointGradient<'a> {
    plan: &'a Plan,
    points: &'a Features<f64>,
    first: usize,
    inducing: &'a Features<f64>,
    u: usize,
    weights: &'a [f64],
    coordinates: &'a mut [f64],
}

impl WithSimd for PointGradient<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { plan, points, first, inducing, u, weights, coordinates } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        let mut theta = vec![0.0; plan.theta_len()];
        let mut tile = [0.0; TILE];
        inducing.point(u, &mut query);
        for (start, length) in points.tiles_from(first).take(weights.len().div_ceil(TILE)) {
            let weights = &weights[start - first..];
            let count = length.min(weights.len());
            tile[..count].copy_from_slice(&weights[..count]);
            tile[count..].fill(0.0);
            plan.values::<_, S, true>(simd, points, (start, length), &query, &mut work);
            let location = Some(&mut *coordinates);
            plan.gradient(
                simd,
                (points, start, length),
                &query,
                &tile[..length],
                &mut work,
                (&mut theta, location),
            );
        }
        theta
    }
}

/// A Gaussian process that has seen its data through inducing points.
///
/// # Examples
/// ```
/// use sgpr_gp::{Compute, Covariance, Data, Kernel, Shape, SparseGaussianProcess, informative_points};
/// let x: Vec<f64> = (0..5000).map(|k| 0.002 * f64::from(k)).collect();
/// let y = x.iter().map(|x| x.sin()).collect();
/// let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 1.0).scaled(1.0);
/// let chosen = informative_points(&kernel, &x, 1, 25);
/// let data = Data::new(x, 1, y, 1)?;
/// let inducing = data.select(&chosen).x().to_vec();
/// let gp = SparseGaussianProcess::fit(&data, Covariance::new(kernel, 1e-4), inducing, &Compute::default())?;
/// assert!((gp.predict(&[1.0], true)?.mean[0] - 1f64.sin()).abs() < 1e-3);
/// # Ok::<(), sgpr_gp::GpError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SparseGaussianProcess {
    pub(super) process: InducedProcess,
    bound: f64,
}

impl SparseGaussianProcess {
    /// Conditions on data through `inducing`, `[inducing, inputs]`, with the hyperparameters as
    /// they are.
    ///
    /// # Errors
    /// As [`SparseBound::value`].
    pub fn fit(
        data: &Data,
        covariance: Covariance,
        inducing: Vec<f64>,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let bound = SparseBound::new(data, compute);
        let plan = bound.plan(&covariance, &inducing)?;
        let points = plan.features(data.x(), data.inputs());
        let induced = plan.features(&inducing, data.inputs());
        let evidence = bound.evidence(&plan, &points, &induced);
        let SolvedBound { value, posterior } =
            bound.solve(&plan, &induced, &evidence, covariance.noise_variance)?;
        let process = InducedProcess::from_posterior(
            covariance,
            inducing,
            data.inputs(),
            &posterior,
            compute,
        );
        Ok(Self { process, bound: value })
    }

    /// The covariance with its hyperparameters.
    pub fn covariance(&self) -> &Covariance {
        self.process.covariance()
    }

    /// Inducing points, `[inducing, inputs]`, row-major.
    pub fn inducing(&self) -> &[f64] {
        self.process.inducing()
    }

    /// Lower bound of the log marginal likelihood.
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Signal at the points `x`, `[points, inputs]`, row-major.
    ///
    /// # Errors
    /// If `x` does not hold whole points, or a value is not finite.
    pub fn predict(&self, x: &[f64], with_variance: bool) -> Result<Prediction, GpError> {
        self.process.predict(x, with_variance)
    }

    /// Every point of the data that it was fitted to predicted from all others, through the same
    /// inducing points.
    ///
    /// What is learned are the values at the inducing points, by linear regression on the
    /// covariances with them: without a point its residual is r / (1 - h), with h its leverage.
    ///
    /// # Errors
    /// If the data have other inputs.
    ///
    /// Source: D. A. Belsley, E. Kuh, R. E. Welsch, Regression Diagnostics (1980), ch. 2, on the
    /// model of Titsias (2009).
    pub fn leave_one_out(&self, data: &Data) -> Result<LeaveOneOut, GpError> {
        let noise = self.covariance().noise_variance;
        let mut parts = Vec::with_capacity(data.len());
        let mean = self.process.predict_parts(data.x(), Some(&mut |point| parts.push(point)))?;
        // Rounding may leave a point that is seen by itself alone nothing.
        let left = |point: &InducedVariance| (1.0 - point.unknown / noise).max(1e-9);
        let variance = parts
            .iter()
            .map(|point| noise + point.unseen.max(0.0) + point.unknown / left(point))
            .collect();
        let errors = data.y().iter().zip(&mean).enumerate();
        let errors: Vec<f64> =
            errors.map(|(k, (y, mean))| (y - mean) / left(&parts[k / data.outputs()])).collect();
        Ok(LeaveOneOut::new(data, &errors, variance))
    }
}
