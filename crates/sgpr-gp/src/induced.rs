//! A process that has seen its data through inducing points, and what these data say.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{BlockStructure, matmul as triangular_matmul};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Mat, MatMut};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::data::require_finite;
use super::exact::{Expansion, ForCovariances, Prediction, require_points};
use super::fading_noise::{FadingNoise, FadingStep, whiten};
use super::kernels::{Features, Plan, TILE};
use super::matrix::{assemble_and_factor, factor, invert_factor};
use super::{Compute, Covariance, Data, GpError, KernelError};

/// Data points whose covariances with the inducing points are held at a time.
pub(super) const CHUNK: usize = 4 * TILE;

/// Share of the variance on the diagonal of the covariance of the inducing points.
pub(super) const JITTER: f64 = 1e-6;

/// What data say about the values at inducing points, with R the covariance of their errors: all
/// that a process through these points needs to know of them, however many they are. That of data
/// whose errors have nothing in common is a sum.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// K_uf R⁻¹ K_fu.
    pub products: Mat<f64>,
    /// K_uf R⁻¹ Y, `[inducing, outputs]`.
    pub projection: Mat<f64>,
    /// Yᵀ R⁻¹ Y.
    pub squares: Mat<f64>,
}

impl Evidence {
    /// Of data with the errors of a covariance; if some of these are shared by neighbours, the
    /// points are in order.
    ///
    /// # Errors
    /// If covariance or inducing points do not fit the data, or the correlated noise is not
    /// exponential over one input.
    pub fn new(
        data: &Data,
        covariance: &Covariance,
        inducing: &[f64],
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let plan = plan(data, covariance, inducing, compute)?;
        let Some(noise) = FadingNoise::of(covariance) else {
            let found = "correlated noise that is not exponential over one input".into();
            return Err(KernelError::Unfit {
                found,
                advice: "make it so, or thin the data and take the exact process",
            }
            .into());
        };
        let inputs = data.inputs();
        let steps = noise.steps(data.x().iter().skip(noise.input).step_by(inputs).copied());
        let points = plan.features(data.x(), inputs);
        let inducing = plan.features(inducing, inputs);
        Ok(Self::collect(data, &plan, &points, &inducing, Some(&steps), compute))
    }

    /// - `steps`: of the errors; R is one without
    pub(super) fn collect(
        data: &Data,
        plan: &Plan,
        points: &Features<f64>,
        inducing: &Features<f64>,
        steps: Option<&[FadingStep]>,
        compute: &Compute,
    ) -> Self {
        let (m, outputs, par) = (inducing.count(), data.outputs(), compute.par());
        let mut products = Mat::zeros(m, m);
        let mut projection = Mat::zeros(m, outputs);
        let mut squares = Mat::zeros(outputs, outputs);
        let mut cross = Mat::zeros(CHUNK, m);
        let mut states = vec![0.0; m + outputs];
        for first in (0..points.count()).step_by(CHUNK) {
            let rows = CHUNK.min(points.count() - first);
            cross_covariances(plan, points, inducing, first, &mut cross, compute);
            let mut y = outputs_of(data, first, rows);
            if let Some(steps) = steps {
                let steps = &steps[first..first + rows];
                let (of_points, of_outputs) = states.split_at_mut(m);
                for (k, state) in of_points.iter_mut().enumerate() {
                    whiten(steps, &mut cross.col_as_slice_mut(k)[..rows], state);
                }
                for (k, state) in of_outputs.iter_mut().enumerate() {
                    whiten(steps, y.col_as_slice_mut(k), state);
                }
            }
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
            matmul(projection.as_mut(), Accum::Add, part.transpose(), y.as_ref(), 1.0, par);
            matmul(squares.as_mut(), Accum::Add, y.transpose(), y.as_ref(), 1.0, par);
        }
        mirror(&mut products);
        Self { products, projection, squares }
    }

    /// Of no data.
    pub fn none(inducing: usize, outputs: usize) -> Self {
        let (products, projection) =
            (Mat::zeros(inducing, inducing), Mat::zeros(inducing, outputs));
        Self { products, projection, squares: Mat::zeros(outputs, outputs) }
    }

    /// Adds that of data whose errors have nothing in common with those before.
    pub fn add(&mut self, other: &Self) {
        self.products += &other.products;
        self.projection += &other.projection;
        self.squares += &other.squares;
    }
}

/// A process that has seen data through inducing points.
#[derive(Clone, Debug)]
pub struct InducedProcess {
    pub(super) covariance: Covariance,
    pub(super) inducing: Vec<f64>,
    pub(super) inputs: usize,
    /// Per output.
    pub(super) weights: Vec<Vec<f64>>,
    /// L⁻¹ and L_B⁻¹ L⁻¹: variance = prior - |first k|² + |second k|².
    pub(super) inverse_factors: [Mat<f64>; 2],
}

impl InducedProcess {
    /// Conditions on what data say.
    ///
    /// - `inducing`: `[inducing, inputs]`, row-major
    /// - `products`, `projection`: of [`Evidence`]
    ///
    /// # Errors
    /// If the covariance is none, or the arrays do not belong together.
    pub fn new(
        covariance: Covariance,
        inducing: Vec<f64>,
        inputs: usize,
        products: &Mat<f64>,
        projection: &Mat<f64>,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        covariance.validate(inputs)?;
        require_points(&inducing, inputs)?;
        let m = inducing.len() / inputs;
        for (what, found) in
            [("the products", products.nrows()), ("the projection", projection.nrows())]
        {
            if found != m {
                return Err(GpError::Shape { what, found, expected: m });
            }
        }
        let plan = Plan::new(&covariance.signal);
        let induced = plan.features(&inducing, inputs);
        let posterior = InducedPosterior::new(&plan, &induced, products, projection, 1.0, compute)?;
        Ok(Self::from_posterior(covariance, inducing, inputs, &posterior, compute))
    }

    pub(super) fn from_posterior(
        covariance: Covariance,
        inducing: Vec<f64>,
        inputs: usize,
        posterior: &InducedPosterior,
        compute: &Compute,
    ) -> Self {
        Self {
            covariance,
            inducing,
            inputs,
            weights: columns(&posterior.weights),
            inverse_factors: posterior.inverse_factors(compute.par()),
        }
    }

    /// The covariance with its hyperparameters.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Inducing points, `[inducing, inputs]`, row-major.
    pub fn inducing(&self) -> &[f64] {
        &self.inducing
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// (K_uu + K_uf R⁻¹ K_fu)⁻¹ times the columns of `right`, `[inducing, ...]`.
    pub fn solve(&self, right: &Mat<f64>) -> Mat<f64> {
        let data = &self.inverse_factors[1];
        data.transpose() * (data * right)
    }

    /// k(x, X) times each of `columns`, `[points of x, columns]`, row-major, with X the inducing
    /// points.
    pub fn weigh(&self, x: &[f64], columns: &[Vec<f64>]) -> Vec<f64> {
        let mut products = vec![0.0; x.len() / self.inputs * columns.len()];
        self.expansion().for_each_batch(x, columns, &mut products, None);
        products
    }

    fn expansion(&self) -> Expansion<'_> {
        Expansion { signal: &self.covariance.signal, points: &self.inducing, inputs: self.inputs }
    }

    /// Signal at the points `x`, `[points, inputs]`, row-major.
    ///
    /// # Errors
    /// If `x` does not hold whole points, or a value is not finite.
    pub fn predict(&self, x: &[f64], with_variance: bool) -> Result<Prediction, GpError> {
        let mut variance = vec![];
        let mut add =
            |parts: InducedVariance| variance.push((parts.unseen + parts.unknown).max(0.0));
        let mean = self.predict_parts(x, if with_variance { Some(&mut add) } else { None })?;
        Ok(Prediction { mean, variance })
    }

    /// The means; the parts of the variance of one point after the other go to `each`.
    pub(super) fn predict_parts(
        &self,
        x: &[f64],
        mut each: Option<&mut dyn FnMut(InducedVariance)>,
    ) -> Result<Vec<f64>, GpError> {
        require_points(x, self.inputs)?;
        let mut mean = vec![0.0; x.len() / self.inputs * self.weights.len()];
        let prior = self.covariance.signal.variance();
        let mut batch = each.as_mut().map(|each| {
            move |cross: MatMut<'_, f64>| {
                let norms = self.inverse_factors.each_ref().map(|factor| factor * cross.as_ref());
                for k in 0..cross.ncols() {
                    let [seen, unknown] =
                        norms.each_ref().map(|norms| norms.col(k).squared_norm_l2());
                    each(InducedVariance { unseen: prior - seen, unknown });
                }
            }
        });
        let batch = batch.as_mut().map(|batch| batch as ForCovariances<'_>);
        self.expansion().for_each_batch(x, &self.weights, &mut mean, batch);
        Ok(mean)
    }
}

/// Variance of the signal.
pub(super) struct InducedVariance {
    /// What the inducing points do not see.
    pub unseen: f64,
    /// What data leave unknown of the values at the inducing points.
    pub unknown: f64,
}

/// What data say of a process through inducing points.
pub(super) struct InducedPosterior {
    /// L, K_uu = L Lᵀ.
    factor: Mat<f64>,
    /// L_B, I + L⁻¹ K_uf R⁻¹ K_fu L⁻ᵀ = L_B L_Bᵀ.
    pub inner_factor: Mat<f64>,
    /// (K_uu + K_uf R⁻¹ K_fu)⁻¹ K_uf R⁻¹ y, `[inducing, outputs]`.
    pub weights: Mat<f64>,
    /// tr(K_uu⁻¹ K_uf R⁻¹ K_fu) times the noise.
    pub explained: f64,
    /// What the weights explain of yᵀ R⁻¹ y, summed over outputs.
    pub fit: f64,
}

impl InducedPosterior {
    /// - `products`, `projection`: of [`Evidence`]
    /// - `noise`: what R has to be multiplied by
    pub fn new(
        plan: &Plan,
        inducing: &Features<f64>,
        products: &Mat<f64>,
        projection: &Mat<f64>,
        noise: f64,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let (m, par) = (inducing.count(), compute.par());
        let mut factor_u = Mat::zeros(m, m);
        assemble_and_factor(plan, inducing, JITTER * plan.variance(), factor_u.as_mut(), compute)?;
        // L⁻¹ K_uf K_fu L⁻ᵀ, from both sides.
        let mut inner = products.clone();
        solve_lower_triangular_in_place(factor_u.as_ref(), inner.as_mut(), par);
        let mut inner = inner.transpose().to_owned();
        solve_lower_triangular_in_place(factor_u.as_ref(), inner.as_mut(), par);
        let explained: f64 = (0..m).map(|i| inner[(i, i)]).sum();
        inner = &inner * faer::Scale(1.0 / noise);
        (0..m).for_each(|i| inner[(i, i)] += 1.0);
        if !factor(inner.as_mut(), par) {
            return Err(GpError::NotPositiveDefinite { jitter: JITTER * plan.variance() });
        }
        let mut half = projection * faer::Scale(1.0 / noise);
        solve_lower_triangular_in_place(factor_u.as_ref(), half.as_mut(), par);
        solve_lower_triangular_in_place(inner.as_ref(), half.as_mut(), par);
        let fit = half.squared_norm_l2();
        let mut weights = half;
        solve_upper_triangular_in_place(inner.transpose(), weights.as_mut(), par);
        solve_upper_triangular_in_place(factor_u.transpose(), weights.as_mut(), par);
        Ok(Self { factor: factor_u, inner_factor: inner, weights, explained, fit })
    }

    /// L⁻¹ and L_B⁻¹ L⁻¹.
    pub fn inverse_factors(&self, par: faer::Par) -> [Mat<f64>; 2] {
        let m = self.factor.ncols();
        let mut prior = Mat::zeros(m, m);
        invert_factor(self.factor.as_ref(), prior.as_mut(), par);
        let mut data = prior.clone();
        solve_lower_triangular_in_place(self.inner_factor.as_ref(), data.as_mut(), par);
        [prior, data]
    }
}

/// Checks a covariance and inducing points, `[inducing, inputs]`, against data.
pub(super) fn plan(
    data: &Data,
    covariance: &Covariance,
    inducing: &[f64],
    compute: &Compute,
) -> Result<Plan, GpError> {
    let inputs = data.inputs();
    covariance.validate(inputs)?;
    let found = inducing.len() / inputs;
    if found == 0 || !inducing.len().is_multiple_of(inputs) {
        return Err(GpError::InducingPoints { found, points: data.len() });
    }
    compute.check(found, 6)?;
    require_finite("the inducing points", inducing, inputs)?;
    Ok(Plan::new(&covariance.signal))
}

/// Measurements of the points from `first` on, `[rows, outputs]`.
pub(super) fn outputs_of(data: &Data, first: usize, rows: usize) -> Mat<f64> {
    let outputs = data.outputs();
    Mat::from_fn(rows, outputs, |i, o| data.y()[(first + i) * outputs + o])
}

/// The upper triangle from the lower one.
pub(super) fn mirror(matrix: &mut Mat<f64>) {
    for j in 0..matrix.ncols() {
        for i in 0..j {
            matrix[(i, j)] = matrix[(j, i)];
        }
    }
}

fn columns(matrix: &Mat<f64>) -> Vec<Vec<f64>> {
    (0..matrix.ncols()).map(|k| matrix.col_as_slice(k).to_vec()).collect()
}

/// Covariances of the data points from `first` on, a row each, with the inducing points.
pub(super) fn cross_covariances(
    plan: &Plan,
    points: &Features<f64>,
    inducing: &Features<f64>,
    first: usize,
    cross: &mut Mat<f64>,
    compute: &Compute,
) {
    let work = |(u, column): (usize, MatMut<'_, f64>)| {
        Arch::new().dispatch(CrossColumns { plan, points, inducing, first, u, columns: column });
    };
    const COLUMNS: usize = 32;
    if compute.threads > 1 {
        cross
            .as_mut()
            .par_col_chunks_mut(COLUMNS)
            .enumerate()
            .for_each(|(k, c)| work((k * COLUMNS, c)));
    } else {
        work((0, cross.as_mut()));
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
                let values =
                    plan.values::<_, S, false>(simd, points, (start, length), &query, &mut work);
                column[start - first..][..length].copy_from_slice(values);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GaussianProcess, Kernel, Shape};
    use sgpr_numeric::internal::Random;

    /// Inducing points at all data points lose nothing but what the jitter on their covariance
    /// takes.
    #[test]
    fn through_all_its_points_a_process_with_lasting_errors_is_the_exact_one() {
        let mut random = Random::new(5);
        // An input and a time, two outputs.
        let x: Vec<f64> =
            (0..90).flat_map(|k| [4.0 * random.uniform(), 0.02 * f64::from(k)]).collect();
        let y: Vec<f64> = x
            .chunks_exact(2)
            .flat_map(|x| [x[0].sin() + 0.1 * random.normal(), x[0] * x[0]])
            .collect();
        let data = Data::new(x.clone(), 2, y.clone(), 2).expect("finite");
        let signal = Kernel::isotropic(Shape::Matern52, 1, 0.8).scaled(1.5);
        let lasting = Kernel::isotropic(Shape::Exponential, 1, 0.1).on(&[1]).scaled(0.3);
        let covariance = Covariance::new(signal, 0.05).with_correlated_noise(lasting);
        let compute = Compute::default();
        let exact =
            GaussianProcess::fit(data.clone(), covariance.clone(), &compute).expect("small");
        let Evidence { products, projection, .. } =
            Evidence::new(&data, &covariance, &x, &compute).expect("in order");
        let induced =
            InducedProcess::new(covariance.clone(), x.clone(), 2, &products, &projection, &compute)
                .expect("small");
        let asked: Vec<f64> = (0..40).flat_map(|k| [0.12 * f64::from(k), 0.0]).collect();
        let (a, b) = (
            exact.predict(&asked, true).expect("finite"),
            induced.predict(&asked, true).expect("finite"),
        );
        let largest =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(largest(&a.mean, &b.mean) < 1e-3, "{}", largest(&a.mean, &b.mean));
        assert!(largest(&a.variance, &b.variance) < 1e-4, "{}", largest(&a.variance, &b.variance));

        // What two logs say is the sum of what each says, if they lie far apart.
        let apart: Vec<f64> = x
            .iter()
            .enumerate()
            .map(|(k, x)| if k >= 100 && k % 2 == 1 { x + 1e3 } else { *x })
            .collect();
        let part = |rows: std::ops::Range<usize>| {
            let data = Data::new(
                apart[2 * rows.start..2 * rows.end].to_vec(),
                2,
                y[2 * rows.start..2 * rows.end].to_vec(),
                2,
            );
            Evidence::new(&data.expect("finite"), &covariance, &x, &compute).expect("in order")
        };
        let (whole, mut sum) = (part(0..90), Evidence::none(90, 2));
        sum.add(&part(0..50));
        sum.add(&part(50..90));
        for (a, b) in [
            (&whole.products, &sum.products),
            (&whole.projection, &sum.projection),
            (&whole.squares, &sum.squares),
        ] {
            assert!((a - b).norm_max() < 1e-10 * a.norm_max());
        }
        let over_two = Kernel::isotropic(Shape::Exponential, 2, 0.1);
        let mut wrong = covariance;
        wrong.correlated_noise = Some(over_two);
        let error = Evidence::new(&data, &wrong, &x, &compute).expect_err("no Markov chain");
        assert!(error.to_string().contains("not exponential over one input"), "{error}");
    }
}
