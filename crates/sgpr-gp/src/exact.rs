use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::prelude::*;
use faer::{Mat, MatMut};
use pulp::{Arch, Simd, WithSimd};

use super::data::require_finite;
use super::kernels::{Element, Features, Plan, padded};
use super::likelihood::weights_and_likelihood;
use super::matrix::{Storage, assemble_and_factor, inverse_diagonal};
use super::{Compute, Covariance, Data, GpError, Kernel, LeaveOneOut};

/// A Gaussian process that has seen its data: exact inference, all points in the factor.
///
/// # Examples
/// ```
/// use sgpr_gp::{Compute, Covariance, Data, GaussianProcess, Kernel, Shape};
/// let x: Vec<f64> = (0..20).map(|k| 0.3 * f64::from(k)).collect();
/// let y = x.iter().map(|x| x.sin()).collect();
/// let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 1.0).scaled(1.0);
/// let gp = GaussianProcess::fit(Data::new(x, 1, y, 1)?, Covariance::new(kernel, 1e-6), &Compute::default())?;
/// let prediction = gp.predict(&[1.0, 100.0], true)?;
/// assert!((prediction.mean[0] - 1f64.sin()).abs() < 1e-2);
/// assert!(prediction.mean[1].abs() < 1e-9, "far from the data the prior mean");
/// assert!((prediction.variance[1] - 1.0).abs() < 1e-9, "and the prior variance");
/// # Ok::<(), sgpr_gp::GpError>(())
/// ```
#[derive(Clone, Debug)]
pub struct GaussianProcess {
    pub(super) data: Data,
    pub(super) covariance: Covariance,
    /// K⁻¹ y per output.
    pub(super) alpha: Vec<Vec<f64>>,
    pub(super) factor: Storage,
    pub(super) jitter: f64,
    pub(super) log_marginal_likelihood: f64,
    pub(super) compute: Compute,
}

/// Predicted signal.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Prediction {
    /// Mean, `[points, outputs]`, row-major.
    pub mean: Vec<f64>,
    /// Variance of the signal, the same for all outputs, `[points]`; empty if not asked for. For
    /// the variance of a measurement add [`Covariance::total_noise_variance`].
    pub variance: Vec<f64>,
}

/// Points of a batch that are solved for at once.
const BATCH: usize = 256;

impl GaussianProcess {
    /// Conditions on data, with the hyperparameters as they are.
    ///
    /// # Errors
    /// If the covariance does not fit the data, is not positive definite even with jitter, or needs
    /// more memory than allowed.
    pub fn fit(data: Data, covariance: Covariance, compute: &Compute) -> Result<Self, GpError> {
        compute.check(data.len(), 1)?;
        covariance.validate(data.inputs())?;
        let plan = Plan::new(&covariance.kernel());
        let points = plan.features(data.x(), data.inputs());
        let mut factor = Storage::square(data.len());
        let jitter = assemble_and_factor(
            &plan,
            &points,
            covariance.noise_variance,
            factor.view_mut(),
            compute,
        )?;
        let (alpha, log_marginal_likelihood) =
            weights_and_likelihood(factor.view(), &data, compute);
        Ok(Self {
            data,
            covariance,
            alpha,
            factor,
            jitter,
            log_marginal_likelihood,
            compute: *compute,
        })
    }

    /// The data.
    pub fn data(&self) -> &Data {
        &self.data
    }

    /// The covariance with its hyperparameters.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// log p(y), summed over outputs.
    pub fn log_marginal_likelihood(&self) -> f64 {
        self.log_marginal_likelihood
    }

    /// What had to be added to the diagonal; zero if the covariance was well-conditioned.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// The same process for other measurements at the same points; the factor is kept.
    ///
    /// # Errors
    /// If `y` does not hold as many finite numbers as before.
    pub fn with_outputs(&self, y: Vec<f64>) -> Result<Self, GpError> {
        let data = Data::new(self.data.x().to_vec(), self.data.inputs(), y, self.data.outputs())?;
        let (alpha, log_marginal_likelihood) =
            weights_and_likelihood(self.factor.view(), &data, &self.compute);
        Ok(Self { data, alpha, log_marginal_likelihood, ..self.clone() })
    }

    /// K⁻¹ times the columns of `right`, `[points, ...]`.
    #[doc(hidden)]
    pub fn solve(&self, right: &Mat<f64>) -> Mat<f64> {
        let (factor, par) = (self.factor.view::<f64>(), self.compute.par());
        let mut solution = right.clone();
        solve_lower_triangular_in_place(factor, solution.as_mut(), par);
        solve_upper_triangular_in_place(factor.transpose(), solution.as_mut(), par);
        solution
    }

    /// k(x, X) times each of `columns`, `[points of x, columns]`, row-major.
    #[doc(hidden)]
    pub fn weigh(&self, x: &[f64], columns: &[Vec<f64>]) -> Vec<f64> {
        let mut products = vec![0.0; x.len() / self.data.inputs() * columns.len()];
        self.expansion().for_each_batch(x, columns, &mut products, None);
        products
    }

    fn expansion(&self) -> Expansion<'_> {
        Expansion {
            signal: &self.covariance.signal,
            points: self.data.x(),
            inputs: self.data.inputs(),
        }
    }

    /// Signal at the points `x`, `[points, inputs]`, row-major.
    ///
    /// Mean k(x, X) K⁻¹ y and variance k(x, x) - k(x, X) K⁻¹ k(X, x), thesis eqs. B-7 and B-8.
    ///
    /// # Errors
    /// If `x` does not hold whole points, or a value is not finite.
    pub fn predict(&self, x: &[f64], with_variance: bool) -> Result<Prediction, GpError> {
        require_points(x, self.data.inputs())?;
        let points = x.len() / self.data.inputs();
        let mut prediction =
            Prediction { mean: vec![0.0; points * self.alpha.len()], variance: vec![] };
        let prior = self.covariance.signal.variance();
        if with_variance {
            let variance = &mut prediction.variance;
            let mut explain = |mut cross: MatMut<'_, f64>| {
                solve_lower_triangular_in_place(
                    self.factor.view::<f64>(),
                    cross.rb_mut(),
                    self.compute.par(),
                );
                let explained = cross.rb().col_iter().map(|column| column.squared_norm_l2());
                variance.extend(explained.map(|explained| (prior - explained).max(0.0)));
            };
            self.expansion().for_each_batch(
                x,
                &self.alpha,
                &mut prediction.mean,
                Some(&mut explain),
            );
        } else {
            prediction.mean = self.weigh(x, &self.alpha);
        }
        Ok(prediction)
    }

    /// Every point predicted from all others, without fitting again.
    ///
    /// Source: GPML eqs. 5.10 to 5.12.
    pub fn leave_one_out(&self) -> LeaveOneOut {
        let (n, outputs) = (self.data.len(), self.data.outputs());
        let variance = inverse_diagonal(self.factor.view(), self.compute.par());
        let variance: Vec<f64> = variance.into_iter().map(|precision| 1.0 / precision).collect();
        let error = |k: usize| self.alpha[k % outputs][k / outputs] * variance[k / outputs];
        let errors: Vec<f64> = (0..n * outputs).map(error).collect();
        LeaveOneOut::new(&self.data, &errors, variance)
    }
}

/// Takes covariances with the points of an expansion, a column per point asked for.
pub(super) type ForCovariances<'a> = &'a mut dyn FnMut(MatMut<'_, f64>);

/// What means are sums over: k(x, X) times weights.
pub(super) struct Expansion<'a> {
    pub signal: &'a Kernel,
    /// X, `[points, inputs]`, row-major.
    pub points: &'a [f64],
    pub inputs: usize,
}

impl Expansion<'_> {
    /// k(x, X) times `columns`, and for each batch of points the covariances k(X, x), a column per
    /// point, to `each`.
    ///
    /// - `x`: `[points asked for, inputs]`, row-major
    /// - `products`: `[points asked for, columns]`, row-major, zero before
    pub fn for_each_batch(
        &self,
        x: &[f64],
        columns: &[Vec<f64>],
        products: &mut [f64],
        mut each: Option<ForCovariances<'_>>,
    ) {
        if columns.is_empty() {
            return;
        }
        let inputs = self.inputs;
        let plan = Plan::new(self.signal);
        let points = plan.features::<f64>(self.points, inputs);
        let columns: Vec<Vec<f64>> = columns.iter().map(|column| padded(column)).collect();
        let mut cross = Mat::zeros(if each.is_some() { points.count() } else { 0 }, BATCH);
        for (x, mean) in x.chunks(BATCH * inputs).zip(products.chunks_mut(BATCH * columns.len())) {
            let cross_mut = each.is_some().then_some(&mut cross);
            let batch = Cross {
                plan: &plan,
                points: &points,
                alpha: &columns,
                x,
                inputs,
                mean,
                cross: cross_mut,
            };
            Arch::new().dispatch(batch);
            if let Some(each) = &mut each {
                each(cross.as_mut().subcols_mut(0, x.len() / inputs));
            }
        }
    }
}

pub(super) fn require_points(x: &[f64], inputs: usize) -> Result<(), GpError> {
    if !x.len().is_multiple_of(inputs) {
        return Err(GpError::Shape {
            what: "x",
            found: x.len(),
            expected: (x.len() / inputs + 1) * inputs,
        });
    }
    require_finite("x", x, inputs)
}

/// Means of a batch, and the covariances with the points, a column per point asked for.
struct Cross<'a> {
    pub plan: &'a Plan,
    pub points: &'a Features<f64>,
    pub alpha: &'a [Vec<f64>],
    pub x: &'a [f64],
    pub inputs: usize,
    pub mean: &'a mut [f64],
    pub cross: Option<&'a mut Mat<f64>>,
}

impl WithSimd for Cross<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, points, alpha, x, inputs, mean, mut cross } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        for (k, (x, mean)) in
            x.chunks_exact(inputs).zip(mean.chunks_exact_mut(alpha.len())).enumerate()
        {
            plan.set_query(x, &mut query);
            for (start, length) in points.tiles_from(0) {
                let values =
                    plan.values::<_, S, false>(simd, points, (start, length), &query, &mut work);
                for (mean, alpha) in mean.iter_mut().zip(alpha) {
                    *mean += f64::dot(simd, values, &alpha[start..start + length]);
                }
                if let Some(cross) = &mut cross {
                    let end = (start + length).min(points.count());
                    cross.col_as_slice_mut(k)[start..end].copy_from_slice(&values[..end - start]);
                }
            }
        }
    }
}
