use derive_setters::Setters;
use faer::Mat;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use sgpr_predict::gp::{GpPredictor, Precision};
use sgpr_predict::internal::{Parts, VarianceParts, WeightRows};

use super::exact::Prediction;
use super::kernels::{Grid, Plan};
use super::matrix::{factor, invert_factor};
use super::subset::partial_factor;
use super::{Data, GaussianProcess, GpError, InducedProcess, KernelError, SparseGaussianProcess};

/// What a [`GpPredictor`] keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct PredictorOptions {
    /// Arithmetic.
    pub precision: Precision,
    /// What the variance is computed from: all measurements if none; nothing, for no variance, if
    /// zero; else so many combinations of them, those that say most about the leading directions of
    /// the signal. The variance can then only be too large, for what is not seen explains nothing;
    /// [`GpPredictor::variance_error`] says by how much. One prediction reads n²/2 numbers for all,
    /// n times the rank for so many.
    pub variance_rank: Option<usize>,
    /// Less to read, for points that do not fit into the cache: they are moved to a grid of 16 bits
    /// for each input, a 65,534th of its range, and the process is conditioned on them anew, so
    /// that its weights are exact for the points that are kept; what the variance is computed from
    /// is kept in 32 bits. Arithmetic of the mean stays that of `precision`. [`GpPredictor::error`]
    /// and [`GpPredictor::variance_error`] say what it costs. Inducing points are few: they are not
    /// moved.
    pub compact: bool,
}

impl Default for PredictorOptions {
    fn default() -> Self {
        Self { precision: Precision::Double, variance_rank: Some(0), compact: false }
    }
}

impl GaussianProcess {
    /// One point after the other, for a controller; the only place that allocates.
    ///
    /// # Errors
    /// If the variance needs more memory than allowed, or a compact one is asked for and an input
    /// is periodic.
    ///
    /// # Examples
    /// ```
    /// use sgpr_gp::{Compute, Covariance, Data, GaussianProcess, Kernel, PredictorOptions, Shape};
    /// let kernel = Kernel::isotropic(Shape::Matern52, 1, 1.0).scaled(1.0);
    /// let data = Data::new(vec![0.0, 1.0, 2.0], 1, vec![0.0, 1.0, 0.5], 1)?;
    /// let gp = GaussianProcess::fit(data, Covariance::new(kernel, 1e-4), &Compute::default())?;
    /// let mut predictor = gp.predictor(PredictorOptions::default().with_variance_rank(None))?;
    /// let (mean, variance) = predictor.mean_and_variance(&[50.0]);
    /// assert!(mean[0].abs() < 1e-9 && predictor.is_far(variance));
    /// # Ok::<(), sgpr_gp::GpError>(())
    /// ```
    pub fn predictor(&self, options: PredictorOptions) -> Result<GpPredictor, GpError> {
        let (n, inputs) = (self.data.len(), self.data.inputs());
        let moved = options.compact.then(|| on_grid(self)).transpose()?;
        let (gp, grid) = moved.as_ref().map_or((self, None), |(gp, grid)| (gp, Some(grid)));
        let leading = options.variance_rank.filter(|rank| (1..n).contains(rank));
        let matrix = match options.variance_rank {
            Some(0) => None,
            _ => Some(match leading {
                Some(rank) => leading_directions(gp, rank)?,
                None => {
                    gp.compute.check(n, 2)?;
                    let mut inverse = Mat::zeros(n, n);
                    invert_factor(gp.factor.view(), inverse.as_mut(), gp.compute.par());
                    inverse
                }
            }),
        };
        let at = |i, j| matrix.as_ref().map_or(0.0, |matrix: &Mat<f64>| matrix[(i, j)]);
        let rows = |matrix: &Mat<f64>| matrix.nrows();
        let subtracted = matrix.as_ref().map(rows).map(|rows| WeightRows {
            at: &at,
            rows,
            columns: n,
            triangle: leading.is_none(),
        });
        let variance = subtracted.map(|subtracted| VarianceParts { subtracted, added: None });
        let parts = Parts {
            variance,
            grid,
            compact: options.compact,
            ..Parts::new(&gp.covariance.signal, gp.data.x(), inputs, &gp.alpha)
        };
        let mut predictor = GpPredictor::from_parts(&parts, options.precision);
        if options.precision == Precision::Single || options.compact || leading.is_some() {
            measure(&mut predictor, self.data.x(), options, &|x, with_variance| {
                self.predict(x, with_variance)
            });
        }
        Ok(predictor)
    }
}

impl SparseGaussianProcess {
    /// One point after the other, for a controller: its inducing points are all that is kept.
    /// `variance_rank` other than zero gives its variance, which needs all of them.
    pub fn predictor(&self, options: PredictorOptions) -> GpPredictor {
        self.process.predictor(options)
    }
}

impl InducedProcess {
    #[doc(hidden)]
    pub fn predictor(&self, options: PredictorOptions) -> GpPredictor {
        let [prior, data] = &self.inverse_factors;
        let m = prior.nrows();
        let (of_prior, of_data) = (|i, j| prior[(i, j)], |i, j| data[(i, j)]);
        let triangle = |at| WeightRows { at, rows: m, columns: m, triangle: true };
        let variance = (options.variance_rank != Some(0)).then(|| VarianceParts {
            subtracted: triangle(&of_prior),
            added: Some(triangle(&of_data)),
        });
        let parts = Parts {
            variance,
            compact: options.compact,
            ..Parts::new(&self.covariance.signal, &self.inducing, self.inputs, &self.weights)
        };
        let mut predictor = GpPredictor::from_parts(&parts, options.precision);
        if options.precision == Precision::Single || options.compact {
            measure(&mut predictor, &self.inducing, options, &|x, with_variance| {
                self.predict(x, with_variance)
            });
        }
        predictor
    }
}

/// What a process predicts at some points, with standard deviations or without.
type PredictedProcess<'a> = dyn Fn(&[f64], bool) -> Result<Prediction, GpError> + 'a;

/// Measures the differences of a predictor to its process at points of the data.
fn measure(
    predictor: &mut GpPredictor,
    x: &[f64],
    options: PredictorOptions,
    process: &PredictedProcess<'_>,
) {
    predictor.measure(x, options.variance_rank != Some(0), &|x, with_variance| {
        let Prediction { mean, variance } = process(x, with_variance).expect("points of the data");
        (mean, variance)
    });
}

/// The same process with its points moved to a grid.
fn on_grid(gp: &GaussianProcess) -> Result<(GaussianProcess, Grid), GpError> {
    let (inputs, grid) = (gp.data.inputs(), Grid::of(gp.data.x(), gp.data.inputs()));
    let Some(columns) = Plan::new(&gp.covariance.signal).straight_columns() else {
        let found = "a periodic input, whose cosine and sine have no grid".into();
        return Err(KernelError::Unfit {
            found,
            advice: "ask for a predictor that is not compact",
        }
        .into());
    };
    // Others, such as a time that only noise looks at, stay where they are.
    let mut x = gp.data.x().to_vec();
    for point in x.chunks_exact_mut(inputs) {
        for (input, _) in &columns {
            point[*input] = grid.nearest(*input, point[*input]);
        }
    }
    let data = Data::new(x, inputs, gp.data.y().to_vec(), gp.data.outputs())?;
    Ok((GaussianProcess::fit(data, gp.covariance.clone(), &gp.compute)?, grid))
}

/// Rows B so that |B k(X, x)|² is what `rank` combinations V' y of the measurements explain: V (V'
/// K V)⁻¹ V' = B' B, K with all noise. Whatever V is, the variance is that of a process which has
/// seen V' y only: never smaller than that of one which has seen y.
///
/// V = K⁻¹ U, with U the directions of the largest eigenvalues of the covariance of the signal,
/// from a partial Cholesky factor of twice the rank: the mean at a point with k(X, x) in their span
/// is a combination k' K⁻¹ y of these.
fn leading_directions(gp: &GaussianProcess, rank: usize) -> Result<Mat<f64>, GpError> {
    /// Share of the largest eigenvalue below which a direction is lost in rounding.
    const LOST: f64 = 1e-12;
    let par = gp.compute.par();
    let plan = Plan::new(&gp.covariance.signal);
    let features = plan.features(gp.data.x(), gp.data.inputs());
    let rows = partial_factor(&plan, &features, 2 * rank).1;
    let partial = Mat::from_fn(rows.len(), gp.data.len(), |i, j| rows[i][j]);
    let eigen = (&partial * partial.transpose())
        .self_adjoint_eigen(faer::Side::Lower)
        .expect("finite numbers");
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let mut leading: Vec<usize> = (0..rows.len()).collect();
    leading.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let least = LOST * values[leading[0]];
    leading.retain(|k| values[*k] > least);
    leading.truncate(rank);
    let turn = Mat::from_fn(leading.len(), rows.len(), |i, k| {
        vectors[(k, leading[i])] / values[leading[i]].sqrt()
    });
    let lower = gp.factor.view::<f64>();
    let mut directions = (&turn * &partial).transpose().to_owned();
    solve_lower_triangular_in_place(lower, directions.as_mut(), par);
    let mut inner = directions.transpose() * &directions;
    solve_upper_triangular_in_place(lower.transpose(), directions.as_mut(), par);
    if !factor(inner.as_mut(), par) {
        return Err(GpError::NotPositiveDefinite { jitter: gp.jitter });
    }
    let mut rows = directions.transpose().to_owned();
    solve_lower_triangular_in_place(inner.as_ref(), rows.as_mut(), par);
    Ok(rows)
}
