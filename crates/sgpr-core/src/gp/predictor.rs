use faer::Mat;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use pulp::{Arch, Simd, WithSimd};

use super::exact::{Prediction, padded};
use super::kernels::{BLOCK, Element, Grid, GridPoints, GroupedPoints, Plan, Points, Query, TILE, Work, weigh};
use super::matrix::{factor, invert_factor};
use super::subset::partial_factor;
use super::{Data, GaussianProcess, GpError, InducedProcess, Kernel, SparseGaussianProcess};

/// Arithmetic of a [`GpPredictor`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 64 bits.
    #[default]
    Double,
    /// 32 bits, sums of tiles in 64: twice as fast. [`GpPredictor::error`] says what it costs.
    Single,
}

/// What a [`GpPredictor`] keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PredictorOptions {
    /// Arithmetic.
    pub precision: Precision,
    /// What the variance is computed from: all measurements if none; nothing, for no variance, if zero; else so many
    /// combinations of them, those that say most about the leading directions of the signal. The variance can
    /// then only be too large, for what is not seen explains nothing; [`GpPredictor::variance_error`] says by how much. One
    /// prediction reads n²/2 numbers for all, n times the rank for so many.
    pub variance_rank: Option<usize>,
    /// Less to read, for points that do not fit into the cache: they are moved to a grid of 16 bits for each input, a
    /// 65,534th of its range, and the process is conditioned on them anew, so that its weights are exact for the points
    /// that are kept; what the variance is computed from is kept in 32 bits. Arithmetic of the mean stays that of
    /// `precision`. [`GpPredictor::error`] and [`GpPredictor::variance_error`] say what it costs. Inducing points are few:
    /// they are not moved.
    pub compact: bool,
}

impl Default for PredictorOptions {
    fn default() -> Self {
        Self { precision: Precision::Double, variance_rank: Some(0), compact: false }
    }
}

/// Predicts one point after the other, for a controller: owns its buffers, allocates nothing, takes no lock, and can
/// move to another thread. The work of a prediction does not depend on the point.
///
/// # Examples
/// ```
/// use sgpr_core::gp::{Compute, Covariance, Data, GaussianProcess, GpPredictor, Kernel, PredictorOptions, Shape};
/// let kernel = Kernel::isotropic(Shape::Matern52, 1, 1.0).scaled(1.0);
/// let data = Data::new(vec![0.0, 1.0, 2.0], 1, vec![0.0, 1.0, 0.5], 1)?;
/// let gp = GaussianProcess::fit(data, Covariance::new(kernel, 1e-4), &Compute::default())?;
/// let mut predictor = GpPredictor::new(&gp, PredictorOptions { variance_rank: None, ..Default::default() })?;
/// let (mean, variance) = predictor.mean_and_variance(&[50.0]);
/// assert!(mean[0].abs() < 1e-9 && predictor.is_far(variance));
/// # Ok::<(), sgpr_core::gp::GpError>(())
/// ```
#[derive(Clone, Debug)]
pub struct GpPredictor {
    kind: Kind,
    mean: Vec<f64>,
    prior_variance: f64,
    error: f64,
    variance_error: f64,
    inputs: usize,
}

#[derive(Clone, Debug)]
enum Kind {
    Double(Core<f64>),
    Single(Core<f32>),
}

/// Points kept apart from the rest: as they enter, nothing moves or grows.
#[derive(Clone, Debug)]
struct Core<T> {
    plan: Plan,
    points: Kept<T>,
    /// Weights per output.
    weights: Vec<Vec<T>>,
    variance: Variance<T>,
    query: Query<T>,
    work: Work<T>,
}

/// The points.
#[derive(Clone, Debug)]
enum Kept<T> {
    Full(GroupedPoints<T>),
    Compact(GridPoints<T>),
}

/// Arithmetic of the variance.
#[derive(Clone, Debug)]
enum Variance<T> {
    None,
    Full(VarianceOf<T>),
    Compact(VarianceOf<f32>),
}

/// Variance = prior - |subtracted k|² + |added k|².
#[derive(Clone, Debug)]
struct VarianceOf<T> {
    subtracted: Packed<T>,
    added: Option<Packed<T>>,
    cross: Vec<T>,
}

/// A matrix in blocks of four rows, padded with zeros to whole registers: [`BLOCK`] numbers of the first row, as many of
/// the second, and so on, so that it is read in the order of memory and the vector once for four rows.
#[derive(Clone, Debug)]
struct Packed<T> {
    values: Vec<T>,
    /// Of the rows of each block.
    lengths: Vec<usize>,
}

/// Products that are summed in the arithmetic of the matrix; these sums are summed in double precision.
const RUN: usize = 512;

/// Share of the prior variance from which a point counts as far from the data.
const FAR: f64 = 0.95;

/// Some points of the data, each followed by one half-way to another: where a predictor is held against its process.
pub(super) fn probes(x: &[f64], inputs: usize) -> Vec<f64> {
    const MOST: usize = 200;
    let points: Vec<&[f64]> = x.chunks_exact(inputs).collect();
    let mut probes = Vec::new();
    for k in (0..points.len()).step_by(points.len().div_ceil(MOST)) {
        let other = points[(k * 31 + 7) % points.len()];
        probes.extend_from_slice(points[k]);
        probes.extend(points[k].iter().zip(other).map(|(a, b)| 0.5 * (a + b)));
    }
    probes
}

/// What a predictor is made of, whatever process it comes from.
pub(super) struct Parts<'a> {
    pub plan: Plan,
    pub x: &'a [f64],
    pub inputs: usize,
    pub weights: &'a [Vec<f64>],
    pub variance: Option<VarianceParts>,
    /// Of the points, if they are on one.
    pub grid: Option<Grid>,
    /// The variance in 32 bits.
    pub compact: bool,
}

/// The process that a predictor was made of: means and variances of points.
type Exact<'a> = &'a dyn Fn(&[f64], bool) -> Result<Prediction, GpError>;

/// What its variance is made of.
pub(super) struct VarianceParts {
    pub subtracted: Rows,
    pub added: Option<Rows>,
}

/// A matrix times k.
pub(super) enum Rows {
    /// Of which the lower triangle counts.
    Triangle(Mat<f64>),
    Full(Mat<f64>),
}

impl GpPredictor {
    /// The only place that allocates.
    ///
    /// # Errors
    /// If the variance needs more memory than allowed, or a compact one is asked for and an input is periodic.
    pub fn new(gp: &GaussianProcess, options: PredictorOptions) -> Result<Self, GpError> {
        let (n, inputs) = (gp.data.len(), gp.data.inputs());
        let original = gp;
        let moved = options.compact.then(|| on_grid(gp)).transpose()?;
        let (gp, grid) = moved.as_ref().map_or((gp, None), |(gp, grid)| (gp, Some(grid.clone())));
        let variance = match options.variance_rank {
            Some(0) => None,
            Some(rank) if rank < n => {
                Some(VarianceParts { subtracted: Rows::Full(leading_directions(gp, rank)?), added: None })
            }
            _ => {
                gp.compute.check(n, 2)?;
                let mut inverse = Mat::zeros(n, n);
                invert_factor(gp.factor.view(), inverse.as_mut(), gp.compute.par());
                Some(VarianceParts { subtracted: Rows::Triangle(inverse), added: None })
            }
        };
        let plan = Plan::new(&gp.covariance.signal);
        let compact = options.compact;
        let parts = Parts { plan, x: gp.data.x(), inputs, weights: &gp.alpha, variance, grid, compact };
        let mut predictor = Self::from_parts(parts, options.precision);
        let exact = options.precision == Precision::Double && !compact;
        if !exact || options.variance_rank.is_some_and(|rank| 0 < rank && rank < n) {
            predictor.compare(original.data.x(), options, &|x, with_variance| original.predict(x, with_variance));
        }
        Ok(predictor)
    }

    /// The same for a sparse process, whose inducing points are all it keeps; `variance_rank` other than zero gives its
    /// variance, which needs all of them.
    pub fn from_sparse(gp: &SparseGaussianProcess, options: PredictorOptions) -> Self {
        Self::from_induced(&gp.process, options)
    }

    pub(crate) fn from_induced(gp: &InducedProcess, options: PredictorOptions) -> Self {
        let [prior, data] = &gp.inverse_factors;
        let variance = (options.variance_rank != Some(0)).then(|| VarianceParts {
            subtracted: Rows::Triangle(prior.clone()),
            added: Some(Rows::Triangle(data.clone())),
        });
        let plan = Plan::new(&gp.covariance.signal);
        let compact = options.compact;
        let parts =
            Parts { plan, x: &gp.inducing, inputs: gp.inputs, weights: &gp.weights, variance, grid: None, compact };
        let mut predictor = Self::from_parts(parts, options.precision);
        if options.precision == Precision::Single || compact {
            predictor.compare(&gp.inducing, options, &|x, with_variance| gp.predict(x, with_variance));
        }
        predictor
    }

    /// k(x, X) times each of `weights`, in double precision, without variance.
    ///
    /// - `x`: X, `[points, inputs]`, row-major
    pub(crate) fn weighing(signal: &Kernel, x: &[f64], inputs: usize, weights: &[Vec<f64>]) -> Self {
        let plan = Plan::new(signal);
        let parts = Parts { plan, x, inputs, weights, variance: None, grid: None, compact: false };
        Self::from_parts(parts, Precision::Double)
    }

    fn from_parts(parts: Parts<'_>, precision: Precision) -> Self {
        let inputs = parts.inputs;
        let samples = (parts.x.len() / inputs) as f64;
        let mean = |m: usize| parts.x.iter().skip(m).step_by(inputs).sum::<f64>() / samples;
        let centre: Vec<f64> =
            parts.grid.as_ref().map_or_else(|| (0..inputs).map(mean).collect(), |grid| grid.middle().to_vec());
        let plan = parts.plan.clone().centred(&centre);
        Self {
            mean: vec![0.0; parts.weights.len()],
            prior_variance: plan.variance(),
            error: 0.0,
            variance_error: 0.0,
            inputs,
            kind: match precision {
                Precision::Double => Kind::Double(Core::new(plan, &parts)),
                Precision::Single => Kind::Single(Core::new(plan, &parts)),
            },
        }
    }

    /// Measures the largest differences to the process itself, at points of the data and half-way between them.
    fn compare(&mut self, x: &[f64], options: PredictorOptions, exact: Exact<'_>) {
        let probes = probes(x, self.inputs);
        let with_variance = options.variance_rank != Some(0);
        let exact = exact(&probes, with_variance).expect("points of the data");
        let outputs = self.mean.len();
        for (k, x) in probes.chunks_exact(self.inputs).enumerate() {
            if with_variance {
                let difference = (self.mean_and_variance(x).1 - exact.variance[k]).abs();
                self.variance_error = self.variance_error.max(difference);
            }
            if options.precision == Precision::Single || options.compact {
                let differences = self.mean(x).iter().zip(&exact.mean[k * outputs..]).map(|(a, b)| (a - b).abs());
                let largest = differences.fold(0.0, f64::max);
                self.error = self.error.max(largest);
            }
        }
    }

    /// Mean of the signal, one number per output.
    ///
    /// # Panics
    /// If `x` has another length than the inputs.
    pub fn mean(&mut self, x: &[f64]) -> &[f64] {
        assert_eq!(x.len(), self.inputs, "one number per input");
        match &mut self.kind {
            Kind::Double(core) => core.predict(x, &mut self.mean, false),
            Kind::Single(core) => core.predict(x, &mut self.mean, false),
        };
        &self.mean
    }

    /// Mean of the signal and its variance.
    ///
    /// # Panics
    /// If `x` has another length than the inputs, or the predictor was made without variance.
    pub fn mean_and_variance(&mut self, x: &[f64]) -> (&[f64], f64) {
        assert_eq!(x.len(), self.inputs, "one number per input");
        let explained = match &mut self.kind {
            Kind::Double(core) => core.predict(x, &mut self.mean, true),
            Kind::Single(core) => core.predict(x, &mut self.mean, true),
        };
        (&self.mean, (self.prior_variance - explained).max(0.0))
    }

    /// Whether a variance is that of a point so far from the data that they say nothing about it: within 5 % of the
    /// variance before any data.
    pub fn is_far(&self, variance: f64) -> bool {
        variance > FAR * self.prior_variance
    }

    /// Variance before any data.
    pub fn prior_variance(&self) -> f64 {
        self.prior_variance
    }

    /// Largest error of the mean against all digits of the points and double precision, measured at up to 200 points of
    /// the data and as many between them; zero in double precision that is not compact.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Largest difference of the variance to that from all points in double precision, measured at the same points; of
    /// fewer points it is too large there, never too small. Zero in double precision from all points that is not compact, or
    /// without variance.
    pub fn variance_error(&self) -> f64 {
        self.variance_error
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }
}

impl<T: Element> Core<T> {
    fn new(plan: Plan, parts: &Parts<'_>) -> Self {
        let count = parts.x.len() / parts.inputs;
        let grid = |grid: &Grid| GridPoints::new(&plan, grid, parts.x, parts.inputs).expect("no input is periodic");
        Self {
            points: match &parts.grid {
                Some(of_points) => Kept::Compact(grid(of_points)),
                None => Kept::Full(GroupedPoints::new(&plan, parts.x, parts.inputs)),
            },
            weights: parts.weights.iter().map(|weights| padded(weights)).collect(),
            variance: match &parts.variance {
                None => Variance::None,
                Some(of_process) if parts.compact => Variance::Compact(VarianceOf::new(of_process, count)),
                Some(of_process) => Variance::Full(VarianceOf::new(of_process, count)),
            },
            query: plan.query(),
            work: plan.work(),
            plan,
        }
    }

    /// Writes the means; returns the explained variance if asked.
    fn predict(&mut self, x: &[f64], mean: &mut [f64], with_variance: bool) -> f64 {
        Arch::new().dispatch(Predict { core: self, x, mean, with_variance })
    }
}

struct Predict<'a, T> {
    core: &'a mut Core<T>,
    x: &'a [f64],
    mean: &'a mut [f64],
    with_variance: bool,
}

impl<T: Element> WithSimd for Predict<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { core: Core { plan, points, weights, variance, query, work }, x, mean, with_variance } = self;
        plan.set_query(x, query);
        mean.fill(0.0);
        let none = &mut Variance::None;
        let keep = if with_variance { &mut *variance } else { none };
        let mut tiles = Tiles { plan, weights, query, work, mean, keep };
        match points {
            Kept::Full(points) => tiles.add(simd, points),
            Kept::Compact(points) => {
                points.set_query(tiles.query);
                tiles.add(simd, points);
            }
        }
        match variance {
            _ if !with_variance => 0.0,
            Variance::None => unreachable!("made with variance"),
            Variance::Full(of_process) => of_process.explained(simd),
            Variance::Compact(of_process) => of_process.explained(simd),
        }
    }
}

/// The sum over all points.
struct Tiles<'a, T> {
    plan: &'a Plan,
    weights: &'a [Vec<T>],
    query: &'a Query<T>,
    work: &'a mut Work<T>,
    mean: &'a mut [f64],
    /// Keeps the covariances.
    keep: &'a mut Variance<T>,
}

impl<T: Element> Tiles<'_, T> {
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, points: &impl Points<T>) {
        if let (Some((shape, columns)), [weights], Variance::None) = (self.plan.single_leaf(), self.weights, &self.keep)
        {
            let c = self.query.coordinates(&columns);
            for (tile, weights) in weights.chunks(TILE).enumerate() {
                self.mean[0] += self.plan.variance() * weigh(simd, points, shape, tile * TILE, c, weights);
            }
            return;
        }
        let count = self.weights[0].len();
        for (start, length) in (0..count).step_by(TILE).map(|start| (start, TILE.min(count - start))) {
            let values = self.plan.values::<T, S, false>(simd, points, (start, length), self.query, self.work);
            for (mean, weights) in self.mean.iter_mut().zip(self.weights) {
                *mean += T::dot(simd, values, &weights[start..start + length]);
            }
            match self.keep {
                Variance::None => {}
                Variance::Full(of_process) => of_process.cross[start..start + length].copy_from_slice(values),
                Variance::Compact(of_process) => {
                    let cross = &mut of_process.cross[start..start + length];
                    cross.iter_mut().zip(values).for_each(|(cross, value)| *cross = value.to_f64() as f32);
                }
            }
        }
    }
}

impl<T: Element> VarianceOf<T> {
    /// - `count`: points
    fn new(VarianceParts { subtracted, added }: &VarianceParts, count: usize) -> Self {
        Self {
            subtracted: Packed::new(subtracted),
            added: added.as_ref().map(Packed::new),
            cross: vec![T::default(); count + TILE],
        }
    }

    #[inline(always)]
    fn explained<S: Simd>(&self, simd: S) -> f64 {
        let added = self.added.as_ref().map_or(0.0, |added| added.squared_norm(simd, &self.cross));
        self.subtracted.squared_norm(simd, &self.cross) - added
    }
}

impl<T: Element> Packed<T> {
    fn new(rows: &Rows) -> Self {
        let (matrix, triangle) = match rows {
            Rows::Triangle(matrix) => (matrix, true),
            Rows::Full(matrix) => (matrix, false),
        };
        let columns = matrix.ncols();
        let count = if triangle { columns } else { matrix.nrows() };
        let (mut values, mut lengths) = (Vec::new(), Vec::new());
        for first in (0..count).step_by(4) {
            let used = if triangle { (first + 4).min(columns) } else { columns };
            let length = used.next_multiple_of(BLOCK);
            for (start, row) in
                (0..length).step_by(BLOCK).flat_map(|start| (first..first + 4).map(move |row| (start, row)))
            {
                let there = |column: usize| row < count && column < columns && (column <= row || !triangle);
                let value =
                    |column: usize| if there(column) { T::from_f64(matrix[(row, column)]) } else { T::default() };
                values.extend((start..start + BLOCK).map(value));
            }
            lengths.push(length);
        }
        Self { values, lengths }
    }

    /// |matrix * vector|².
    #[inline(always)]
    fn squared_norm<S: Simd>(&self, simd: S, vector: &[T]) -> f64 {
        let mut sum = 0.0;
        let mut rest = &self.values[..];
        for length in &self.lengths {
            let (rows, after) = rest.split_at(4 * length);
            let mut products = [0.0; 4];
            for (rows, vector) in rows.chunks(4 * RUN).zip(vector[..*length].chunks(RUN)) {
                let run = T::four_dots(simd, rows, vector);
                products.iter_mut().zip(run).for_each(|(product, run)| *product += run);
            }
            sum += products[0] * products[0] + products[1] * products[1];
            sum += products[2] * products[2] + products[3] * products[3];
            rest = after;
        }
        sum
    }
}

/// The same process with its points moved to a grid.
fn on_grid(gp: &GaussianProcess) -> Result<(GaussianProcess, Grid), GpError> {
    let (inputs, grid) = (gp.data.inputs(), Grid::of(gp.data.x(), gp.data.inputs()));
    let Some(columns) = Plan::new(&gp.covariance.signal).straight_columns() else {
        let found = "a periodic input, whose cosine and sine have no grid".into();
        return Err(GpError::Kernel { found, advice: "ask for a predictor that is not compact" });
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

/// Rows B so that |B k(X, x)|² is what `rank` combinations V' y of the measurements explain: V (V' K V)⁻¹ V' = B' B, K with
/// all noise. Whatever V is, the variance is that of a process which has seen V' y only: never smaller than that of one
/// which has seen y.
///
/// V = K⁻¹ U, with U the directions of the largest eigenvalues of the covariance of the signal, from a partial Cholesky factor
/// of twice the rank: the mean at a point with k(X, x) in their span is a combination k' K⁻¹ y of these.
fn leading_directions(gp: &GaussianProcess, rank: usize) -> Result<Mat<f64>, GpError> {
    /// Share of the largest eigenvalue below which a direction is lost in rounding.
    const LOST: f64 = 1e-12;
    let par = gp.compute.par();
    let plan = Plan::new(&gp.covariance.signal);
    let features = plan.features(gp.data.x(), gp.data.inputs());
    let rows = partial_factor(&plan, &features, 2 * rank).1;
    let partial = Mat::from_fn(rows.len(), gp.data.len(), |i, j| rows[i][j]);
    let eigen = (&partial * partial.transpose()).self_adjoint_eigen(faer::Side::Lower).expect("finite numbers");
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let mut leading: Vec<usize> = (0..rows.len()).collect();
    leading.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let least = LOST * values[leading[0]];
    leading.retain(|k| values[*k] > least);
    leading.truncate(rank);
    let turn = Mat::from_fn(leading.len(), rows.len(), |i, k| vectors[(k, leading[i])] / values[leading[i]].sqrt());
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
