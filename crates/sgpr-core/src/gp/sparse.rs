use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{BlockStructure, matmul as triangular_matmul};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::data::require_finite;
use super::exact::{Cross, Prediction, padded, require_points};
use super::kernels::{Features, Plan, TILE};
use super::matrix::{assemble_and_factor, factor, inverse_from, invert_factor};
use super::{Compute, Covariance, Data, GpError};

/// Data points whose covariances with the inducing points are held at a time.
const CHUNK: usize = 4 * TILE;

/// Share of the variance on the diagonal of the covariance of the inducing points.
const JITTER: f64 = 1e-6;

/// Lower bound of the log marginal likelihood of a process that sees the data through m inducing points: n m² operations
/// and memory for n (inputs + outputs) + 6 m² numbers, so that a million points are no burden.
///
/// log p(y) >= log N(y; 0, Q + noise I) - (n k(x, x) - tr Q) / (2 noise), Q = K_fu K_uu⁻¹ K_uf, summed over outputs. The
/// second term is what keeps the bound honest: points that the inducing points do not explain cost something.
///
/// Source: M. K. Titsias, Variational learning of inducing variables in sparse Gaussian processes, AISTATS (2009).
#[derive(Debug)]
pub struct SparseBound<'a> {
    data: &'a Data,
    compute: Compute,
}

/// Derivatives of the bound.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseGradient {
    /// By [`Covariance::theta`].
    pub theta: Vec<f64>,
    /// By the inducing points, `[inducing, inputs]`, row-major.
    pub inducing: Vec<f64>,
}

/// What the data say about the values at the inducing points.
struct Statistics {
    /// K_uf K_fu, lower triangle.
    products: Mat<f64>,
    /// K_uf y, `[inducing, outputs]`.
    projection: Mat<f64>,
    /// Sum of the squares of y.
    squares: f64,
}

/// The bound, and what its gradient and the predictions need.
struct Solution {
    value: f64,
    /// L, K_uu = L Lᵀ.
    factor: Mat<f64>,
    /// L_B, I + L⁻¹ K_uf K_fu L⁻ᵀ / noise = L_B L_Bᵀ.
    inner_factor: Mat<f64>,
    /// (K_uu + K_uf K_fu / noise)⁻¹ K_uf y / noise, `[inducing, outputs]`.
    weights: Mat<f64>,
    /// tr(K_uu⁻¹ K_uf K_fu).
    explained: f64,
}

impl<'a> SparseBound<'a> {
    /// The bound for data.
    pub fn new(data: &'a Data, compute: &Compute) -> Self {
        Self { data, compute: *compute }
    }

    /// The bound with these inducing points, `[inducing, inputs]`, row-major.
    ///
    /// # Errors
    /// If the covariance or the inducing points do not fit the data, or the covariance has correlated noise.
    pub fn value(&self, covariance: &Covariance, inducing: &[f64]) -> Result<f64, GpError> {
        let plan = self.plan(covariance, inducing)?;
        let points = plan.features(self.data.x(), self.data.inputs());
        let inducing = plan.features(inducing, self.data.inputs());
        let statistics = self.statistics(&plan, &points, &inducing);
        Ok(self.solve(&plan, &inducing, &statistics, covariance.noise_variance)?.value)
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
        let statistics = self.statistics(&plan, &points, &induced);
        let solution = self.solve(&plan, &induced, &statistics, noise)?;
        let Adjoints { of_inducing, of_products, of_noise } = self.adjoints(&plan, &statistics, &solution, noise);

        // d bound / d K_fu = 2 K_fu (d bound / d products) + y weightsᵀ / noise, a chunk of rows at a time.
        let m = induced.count();
        let mut theta = vec![0.0; plan.theta_len()];
        let mut coordinates = vec![0.0; m * plan.coordinates()];
        let mut cross = Mat::zeros(CHUNK, m);
        let mut adjoint = Mat::zeros(CHUNK, m);
        for first in (0..points.count()).step_by(CHUNK) {
            let rows = CHUNK.min(points.count() - first);
            self.cross(&plan, &points, &induced, first, &mut cross);
            let part = cross.as_ref().subrows(0, rows);
            let mut out = adjoint.as_mut().subrows_mut(0, rows);
            matmul(out.as_mut(), Accum::Replace, part, of_products.as_ref(), 2.0, self.compute.par());
            let y = self.outputs_of(first, rows);
            matmul(out, Accum::Add, y.as_ref(), solution.weights.transpose(), 1.0 / noise, self.compute.par());
            self.add_gradient(&plan, &points, first, rows, &induced, &adjoint, &mut theta, &mut coordinates);
        }
        // By the inducing points K_uu changes in a row and in a column.
        let mut by_coordinates = vec![0.0; coordinates.len()];
        for (first, columns) in (0..m).step_by(CHUNK).map(|first| (first, CHUNK.min(m - first))) {
            let part = of_inducing.as_ref().subrows(first, columns);
            adjoint.as_mut().subrows_mut(0, columns).copy_from(part);
            self.add_gradient(&plan, &induced, first, columns, &induced, &adjoint, &mut theta, &mut by_coordinates);
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
        let inputs = self.data.inputs();
        covariance.validate(inputs)?;
        if covariance.correlated_noise.is_some() {
            let found = "correlated noise, which a sparse process cannot have".into();
            return Err(GpError::Kernel { found, advice: "leave it out, or thin the data and take the exact process" });
        }
        let found = inducing.len() / inputs;
        if found == 0 || found > self.data.len() || !inducing.len().is_multiple_of(inputs) {
            return Err(GpError::InducingPoints { found, points: self.data.len() });
        }
        self.compute.check(found, 6)?;
        require_finite("the inducing points", inducing, inputs)?;
        Ok(Plan::new(&covariance.signal))
    }

    /// Covariances of the data points from `first` on, a row each, with the inducing points.
    fn cross(&self, plan: &Plan, points: &Features<f64>, inducing: &Features<f64>, first: usize, cross: &mut Mat<f64>) {
        let work = |(u, column): (usize, MatMut<'_, f64>)| {
            Arch::new().dispatch(CrossColumns { plan, points, inducing, first, u, columns: column });
        };
        const COLUMNS: usize = 32;
        if self.compute.threads > 1 {
            cross.as_mut().par_col_chunks_mut(COLUMNS).enumerate().for_each(|(k, c)| work((k * COLUMNS, c)));
        } else {
            work((0, cross.as_mut()));
        }
    }

    /// Measurements of the points from `first` on, `[rows, outputs]`.
    fn outputs_of(&self, first: usize, rows: usize) -> Mat<f64> {
        let outputs = self.data.outputs();
        Mat::from_fn(rows, outputs, |i, o| self.data.y()[(first + i) * outputs + o])
    }

    fn statistics(&self, plan: &Plan, points: &Features<f64>, inducing: &Features<f64>) -> Statistics {
        let (m, par) = (inducing.count(), self.compute.par());
        let mut products = Mat::zeros(m, m);
        let mut projection = Mat::zeros(m, self.data.outputs());
        let mut cross = Mat::zeros(CHUNK, m);
        for first in (0..points.count()).step_by(CHUNK) {
            let rows = CHUNK.min(points.count() - first);
            self.cross(plan, points, inducing, first, &mut cross);
            let part = cross.as_ref().subrows(0, rows);
            triangular_matmul(
                products.as_mut(),
                BlockStructure::TriangularLower,
                Accum::Add,
                part.transpose(),
                BlockStructure::Rectangular,
                part,
                BlockStructure::Rectangular,
                1.0,
                par,
            );
            let y = self.outputs_of(first, rows);
            matmul(projection.as_mut(), Accum::Add, part.transpose(), y.as_ref(), 1.0, par);
        }
        mirror(&mut products);
        Statistics { products, projection, squares: self.data.y().iter().map(|y| y * y).sum() }
    }

    fn solve(
        &self,
        plan: &Plan,
        inducing: &Features<f64>,
        statistics: &Statistics,
        noise: f64,
    ) -> Result<Solution, GpError> {
        let (m, n, par) = (inducing.count(), self.data.len() as f64, self.compute.par());
        let mut factor_u = Mat::zeros(m, m);
        assemble_and_factor(plan, inducing, JITTER * plan.variance(), &mut factor_u, &self.compute)?;
        // L⁻¹ K_uf K_fu L⁻ᵀ, from both sides.
        let mut inner = statistics.products.clone();
        solve_lower_triangular_in_place(factor_u.as_ref(), inner.as_mut(), par);
        let mut inner = inner.transpose().to_owned();
        solve_lower_triangular_in_place(factor_u.as_ref(), inner.as_mut(), par);
        let explained: f64 = (0..m).map(|i| inner[(i, i)]).sum();
        inner = &inner * faer::Scale(1.0 / noise);
        (0..m).for_each(|i| inner[(i, i)] += 1.0);
        if !factor(inner.as_mut(), par) {
            return Err(GpError::NotPositiveDefinite { jitter: JITTER * plan.variance() });
        }
        let mut half = &statistics.projection * faer::Scale(1.0 / noise);
        solve_lower_triangular_in_place(factor_u.as_ref(), half.as_mut(), par);
        solve_lower_triangular_in_place(inner.as_ref(), half.as_mut(), par);
        let fit = statistics.squares / noise - half.squared_norm_l2();
        let mut weights = half;
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(inner.transpose(), weights.as_mut(), par);
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(factor_u.transpose(), weights.as_mut(), par);
        let log_root: f64 = (0..m).map(|i| inner[(i, i)].ln()).sum();
        let per_output = n * (std::f64::consts::TAU * noise).ln() + 2.0 * log_root;
        let unexplained = (n * plan.variance() - explained) / noise;
        let value = -0.5 * (self.data.outputs() as f64 * (per_output + unexplained) + fit);
        Ok(Solution { value, factor: factor_u, inner_factor: inner, weights, explained })
    }

    fn adjoints(&self, plan: &Plan, statistics: &Statistics, solution: &Solution, noise: f64) -> Adjoints {
        let (m, par) = (solution.factor.ncols(), self.compute.par());
        let (n, outputs) = (self.data.len() as f64, self.data.outputs() as f64);
        let inverse_of = |inverse_factor: &Mat<f64>| {
            let mut inverse = Mat::zeros(m, m);
            inverse_from(inverse_factor.as_ref(), inverse.as_mut(), par);
            mirror(&mut inverse);
            inverse
        };
        let [prior, data] = solution.inverse_factors(par);
        let (prior_inverse, posterior_inverse) = (inverse_of(&prior), inverse_of(&data));
        let weights = &solution.weights;
        // By the matrix K_uu + products / noise.
        let mut of_sum = &posterior_inverse * faer::Scale(-0.5 * outputs);
        matmul(of_sum.as_mut(), Accum::Add, weights.as_ref(), weights.transpose(), -0.5, par);
        let mut of_products = &of_sum * faer::Scale(1.0 / noise);
        of_products += &prior_inverse * faer::Scale(0.5 * outputs / noise);
        let half = &prior_inverse * &statistics.products;
        let mut of_inducing = of_sum.clone();
        of_inducing += &prior_inverse * faer::Scale(0.5 * outputs);
        matmul(of_inducing.as_mut(), Accum::Add, half.as_ref(), prior_inverse.as_ref(), -0.5 * outputs / noise, par);
        let inner_product = |a: &Mat<f64>, b: &Mat<f64>| -> f64 {
            a.col_iter().zip(b.col_iter()).map(|(a, b)| a.transpose() * b).sum()
        };
        let unexplained = n * plan.variance() - solution.explained;
        let of_noise = -0.5 * outputs * n / noise - inner_product(&of_sum, &statistics.products) / noise.powi(2)
            + 0.5 * statistics.squares / noise.powi(2)
            - inner_product(&statistics.projection, weights) / noise.powi(2)
            + 0.5 * outputs * unexplained / noise.powi(2);
        Adjoints { of_inducing, of_products, of_noise }
    }

    /// Adds the share of the rows of `points` from `first` on, with the adjoint of their covariances with the inducing
    /// points in the first rows of `adjoint`.
    #[allow(clippy::too_many_arguments)]
    fn add_gradient(
        &self,
        plan: &Plan,
        points: &Features<f64>,
        first: usize,
        rows: usize,
        inducing: &Features<f64>,
        adjoint: &Mat<f64>,
        theta: &mut [f64],
        coordinates: &mut [f64],
    ) {
        let width = plan.coordinates();
        let work = |(u, coordinates): (usize, &mut [f64])| {
            let weights = &adjoint.col_as_slice(u)[..rows];
            Arch::new().dispatch(PointGradient { plan, points, first, inducing, u, weights, coordinates })
        };
        let add = |mut sum: Vec<f64>, part: Vec<f64>| {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            sum
        };
        let zero = || vec![0.0; plan.theta_len()];
        let sum = if self.compute.threads > 1 {
            // Collected first, so that the order of the sum does not depend on the threads.
            let parts: Vec<Vec<f64>> = coordinates.par_chunks_exact_mut(width).enumerate().map(work).collect();
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

impl Solution {
    /// L⁻¹ and L_B⁻¹ L⁻¹.
    fn inverse_factors(&self, par: faer::Par) -> [Mat<f64>; 2] {
        let m = self.factor.ncols();
        let mut prior = Mat::zeros(m, m);
        invert_factor(self.factor.as_ref(), prior.as_mut(), par);
        let mut data = prior.clone();
        solve_lower_triangular_in_place(self.inner_factor.as_ref(), data.as_mut(), par);
        [prior, data]
    }
}

/// The upper triangle from the lower one.
fn mirror(matrix: &mut Mat<f64>) {
    for j in 0..matrix.ncols() {
        for i in 0..j {
            matrix[(i, j)] = matrix[(j, i)];
        }
    }
}

struct CrossColumns<'a> {
    plan: &'a Plan,
    points: &'a Features<f64>,
    inducing: &'a Features<f64>,
    first: usize,
    u: usize,
    columns: MatMut<'a, f64>,
}

impl WithSimd for CrossColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, points, inducing, first, u, mut columns } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        for (k, column) in columns.as_mut().col_iter_mut().enumerate() {
            let column = column.try_as_col_major_mut().expect("column-major").as_slice_mut();
            inducing.point(u + k, &mut query);
            for (start, length) in points.tiles_from(first).take(CHUNK / TILE) {
                let values = plan.values::<_, S, false>(simd, points, (start, length), &query, &mut work);
                column[start - first..][..length].copy_from_slice(values);
            }
        }
    }
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
            plan.gradient(simd, points, (start, length), &query, &tile[..length], &mut work, &mut theta, location);
        }
        theta
    }
}

/// A Gaussian process that has seen its data through inducing points.
///
/// # Examples
/// ```
/// use sgpr_core::gp::{Compute, Covariance, Data, Kernel, Shape, SparseGaussianProcess, informative_points};
/// let x: Vec<f64> = (0..5000).map(|k| 0.002 * f64::from(k)).collect();
/// let y = x.iter().map(|x| x.sin()).collect();
/// let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 1.0).scaled(1.0);
/// let chosen = informative_points(&kernel, &x, 1, 25);
/// let data = Data::new(x, 1, y, 1)?;
/// let inducing = data.select(&chosen).x().to_vec();
/// let gp = SparseGaussianProcess::fit(&data, Covariance::new(kernel, 1e-4), inducing, &Compute::default())?;
/// assert!((gp.predict(&[1.0], true)?.mean[0] - 1f64.sin()).abs() < 1e-3);
/// # Ok::<(), sgpr_core::gp::GpError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SparseGaussianProcess {
    pub(super) covariance: Covariance,
    pub(super) inducing: Vec<f64>,
    pub(super) inputs: usize,
    /// Per output.
    pub(super) weights: Vec<Vec<f64>>,
    /// L⁻¹ and L_B⁻¹ L⁻¹: variance = prior - |first k|² + |second k|².
    pub(super) inverse_factors: [Mat<f64>; 2],
    bound: f64,
}

impl SparseGaussianProcess {
    /// Conditions on data through `inducing`, `[inducing, inputs]`, with the hyperparameters as they are.
    ///
    /// # Errors
    /// As [`SparseBound::value`].
    pub fn fit(data: &Data, covariance: Covariance, inducing: Vec<f64>, compute: &Compute) -> Result<Self, GpError> {
        let bound = SparseBound::new(data, compute);
        let plan = bound.plan(&covariance, &inducing)?;
        let points = plan.features(data.x(), data.inputs());
        let induced = plan.features(&inducing, data.inputs());
        let statistics = bound.statistics(&plan, &points, &induced);
        let solution = bound.solve(&plan, &induced, &statistics, covariance.noise_variance)?;
        Ok(Self {
            covariance,
            inducing,
            inputs: data.inputs(),
            weights: (0..data.outputs()).map(|o| solution.weights.col_as_slice(o).to_vec()).collect(),
            inverse_factors: solution.inverse_factors(compute.par()),
            bound: solution.value,
        })
    }

    /// The covariance with its hyperparameters.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Inducing points, `[inducing, inputs]`, row-major.
    pub fn inducing(&self) -> &[f64] {
        &self.inducing
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
        let inputs = self.inputs;
        require_points(x, inputs)?;
        let plan = Plan::new(&self.covariance.signal);
        let points = plan.features::<f64>(&self.inducing, inputs);
        let alpha: Vec<Vec<f64>> = self.weights.iter().map(|weights| padded(weights)).collect();
        let mut prediction = Prediction { mean: vec![0.0; x.len() / inputs * alpha.len()], variance: vec![] };
        let mut cross = Mat::zeros(points.count(), TILE);
        for (x, mean) in x.chunks(TILE * inputs).zip(prediction.mean.chunks_mut(TILE * alpha.len())) {
            let batch = Cross { plan: &plan, points: &points, alpha: &alpha, x, inputs, mean, cross: Some(&mut cross) };
            Arch::new().dispatch(batch);
            if with_variance {
                let count = x.len() / inputs;
                let norms = self.inverse_factors.each_ref().map(|factor| factor * cross.as_ref().subcols(0, count));
                let variance =
                    |k: usize| plan.variance() - norms[0].col(k).squared_norm_l2() + norms[1].col(k).squared_norm_l2();
                prediction.variance.extend((0..count).map(|k| variance(k).max(0.0)));
            }
        }
        Ok(prediction)
    }
}
