use alloc::vec::Vec;

use super::Kernel;
use super::kernels::{
    BLOCK, Element, GroupedPoints, Plan, Points, Query, TILE, Work, padded, weigh,
};
#[cfg(feature = "simd")]
use super::kernels::{Grid, GridPoints};
use crate::simd::{Arch, Simd, WithSimd};

/// Arithmetic of Gaussian processes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 64 bits.
    #[default]
    Double,
    /// 32 bits, sums of tiles in 64: twice as fast. [`GpPredictor::error`] says what it costs.
    Single,
}

/// Predicts one point after the other, for a controller: owns its buffers, allocates nothing, takes
/// no lock, and can move to another thread. The work of a prediction does not depend on the point.
///
/// # Examples
/// ```
/// use sgpr_predict::gp::{GpPredictor, Kernel, Precision, Shape};
/// let kernel = Kernel::isotropic(Shape::Matern52, 1, 1.0).scaled(1.0);
/// let (x, weights) = ([0.0, 1.0, 2.0], [vec![-0.5, 1.2, 0.1]]);
/// let mut predictor = GpPredictor::weighing(&kernel, &x, 1, &weights, Precision::Double);
/// let expected: f64 = x.iter().zip(&weights[0]).map(|(x, w)| w * kernel.value(&[0.3], &[*x])).sum();
/// assert!((predictor.mean(&[0.3])[0] - expected).abs() < 1e-15);
/// assert!(predictor.mean(&[50.0])[0].abs() < 1e-9, "far from the data nothing is said");
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

/// Points kept apart from the others: as they enter, nothing moves or grows.
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
    #[cfg(feature = "simd")]
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

/// A matrix in blocks of four rows, padded with zeros to whole registers: [`BLOCK`] numbers of the
/// first row, as many of the second, and so on, so that it is read in the order of memory and the
/// vector once for four rows.
#[derive(Clone, Debug)]
struct Packed<T> {
    values: Vec<T>,
    /// Of the rows of each block.
    lengths: Vec<usize>,
}

/// Products that are summed in the arithmetic of the matrix; these sums are summed in double
/// precision.
const RUN: usize = 512;

/// Share of the prior variance from which a point counts as far from the data.
const FAR: f64 = 0.95;

/// Some points of the data, each followed by one half-way to another: where a predictor is held
/// against its process.
pub(crate) fn probes(x: &[f64], inputs: usize) -> Vec<f64> {
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
#[derive(Debug)]
pub struct Parts<'a> {
    /// The kernel of the signal.
    pub plan: Plan,
    /// Points, `[points, inputs]`, row-major.
    pub x: &'a [f64],
    /// Number of inputs.
    pub inputs: usize,
    /// One per point, for each output.
    pub weights: &'a [Vec<f64>],
    /// What the variance is computed from, if it is wanted.
    pub variance: Option<VarianceParts<'a>>,
    /// The grid of the points, if they are on one.
    #[cfg(feature = "simd")]
    pub grid: Option<&'a Grid>,
    /// The variance in 32 bits.
    pub compact: bool,
}

impl<'a> Parts<'a> {
    /// Without variance.
    pub fn new(signal: &Kernel, x: &'a [f64], inputs: usize, weights: &'a [Vec<f64>]) -> Self {
        let plan = Plan::new(signal);
        Self {
            plan,
            x,
            inputs,
            weights,
            variance: None,
            #[cfg(feature = "simd")]
            grid: None,
            compact: false,
        }
    }
}

/// The process that a predictor was made of: means and variances of points.
pub type Exact<'a> = &'a dyn Fn(&[f64], bool) -> (Vec<f64>, Vec<f64>);

/// Variance = prior - |subtracted k|² + |added k|².
#[derive(Debug)]
pub struct VarianceParts<'a> {
    /// What is explained.
    pub subtracted: WeightRows<'a>,
    /// What of that is not known, after all.
    pub added: Option<WeightRows<'a>>,
}

/// A matrix, to be multiplied with k.
pub struct WeightRows<'a> {
    /// The number at a row and a column.
    pub at: &'a dyn Fn(usize, usize) -> f64,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Of which the lower triangle counts.
    pub triangle: bool,
}

impl core::fmt::Debug for WeightRows<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Rows")
            .field("rows", &self.rows)
            .field("columns", &self.columns)
            .finish_non_exhaustive()
    }
}

impl GpPredictor {
    /// k(x, X) times each of `weights`, without variance; the only place that allocates.
    ///
    /// - `x`: X, `[points, inputs]`, row-major
    ///
    /// # Panics
    /// If the kernel looks at an input that is not there, or there is not one weight per point.
    pub fn weighing(
        signal: &Kernel,
        x: &[f64],
        inputs: usize,
        weights: &[Vec<f64>],
        precision: Precision,
    ) -> Self {
        Self::from_parts(&Parts::new(signal, x, inputs, weights), precision)
    }

    /// The only place that allocates.
    pub fn from_parts(parts: &Parts<'_>, precision: Precision) -> Self {
        let inputs = parts.inputs;
        let samples = (parts.x.len() / inputs) as f64;
        let mean = |m: usize| parts.x.iter().skip(m).step_by(inputs).sum::<f64>() / samples;
        let centre: Vec<f64> = (0..inputs).map(mean).collect();
        #[cfg(feature = "simd")]
        let centre = parts.grid.map_or(centre, |grid| grid.middle().to_vec());
        let plan = parts.plan.clone().centred(&centre);
        Self {
            mean: vec![0.0; parts.weights.len()],
            prior_variance: plan.variance(),
            error: 0.0,
            variance_error: 0.0,
            inputs,
            kind: match precision {
                Precision::Double => Kind::Double(Core::new(plan, parts)),
                Precision::Single => Kind::Single(Core::new(plan, parts)),
            },
        }
    }

    /// Measures the largest differences to the process itself, at points of `x` and half-way
    /// between them.
    ///
    /// - `exact`: means `[points, outputs]` and variances `[points]` of the process, these if
    ///   wanted
    pub fn measure(&mut self, x: &[f64], with_variance: bool, exact: Exact<'_>) {
        let probes = probes(x, self.inputs);
        let (mean, variance) = exact(&probes, with_variance);
        let outputs = self.mean.len();
        for (k, x) in probes.chunks_exact(self.inputs).enumerate() {
            if with_variance {
                let difference = (self.mean_and_variance(x).1 - variance[k]).abs();
                self.variance_error = self.variance_error.max(difference);
            }
            let differences =
                self.mean(x).iter().zip(&mean[k * outputs..]).map(|(a, b)| (a - b).abs());
            let largest = differences.fold(0.0, f64::max);
            self.error = self.error.max(largest);
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

    /// Whether a variance is that of a point so far from the data that they say nothing about it:
    /// within 5 % of the variance before any data.
    pub fn is_far(&self, variance: f64) -> bool {
        variance > FAR * self.prior_variance
    }

    /// Variance before any data.
    pub fn prior_variance(&self) -> f64 {
        self.prior_variance
    }

    /// Largest error of the mean against all digits of the points and double precision, measured at
    /// up to 200 points of the data and as many between them; zero in double precision that is not
    /// compact.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Largest difference of the variance to that from all points in double precision, measured at
    /// the same points; of fewer points it is too large there, never too small. Zero in double
    /// precision from all points that is not compact, or without variance.
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
        let full = || Kept::Full(GroupedPoints::new(&plan, parts.x, parts.inputs));
        #[cfg(feature = "simd")]
        let compact = |grid| {
            Kept::Compact(
                GridPoints::new(&plan, grid, parts.x, parts.inputs).expect("no input is periodic"),
            )
        };
        Self {
            #[cfg(feature = "simd")]
            points: parts.grid.map_or_else(full, compact),
            #[cfg(not(feature = "simd"))]
            points: full(),
            weights: parts.weights.iter().map(|weights| padded(weights)).collect(),
            variance: match &parts.variance {
                None => Variance::None,
                Some(of_process) if parts.compact => {
                    Variance::Compact(VarianceOf::new(of_process, count))
                }
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
        let Self {
            core: Core { plan, points, weights, variance, query, work },
            x,
            mean,
            with_variance,
        } = self;
        plan.set_query(x, query);
        mean.fill(0.0);
        let none = &mut Variance::None;
        let keep = if with_variance { &mut *variance } else { none };
        let mut tiles = Tiles { plan, weights, query, work, mean, keep };
        match points {
            Kept::Full(points) => tiles.add(simd, points),
            #[cfg(feature = "simd")]
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
        if let (Some((shape, columns)), [weights], Variance::None) =
            (self.plan.single_leaf(), self.weights, &self.keep)
        {
            let c = self.query.coordinates(&columns);
            for (tile, weights) in weights.chunks(TILE).enumerate() {
                self.mean[0] +=
                    self.plan.variance() * weigh(simd, points, shape, tile * TILE, c, weights);
            }
            return;
        }
        let count = self.weights[0].len();
        for (start, length) in
            (0..count).step_by(TILE).map(|start| (start, TILE.min(count - start)))
        {
            let values = self.plan.values::<T, S, false>(
                simd,
                points,
                (start, length),
                self.query,
                self.work,
            );
            for (mean, weights) in self.mean.iter_mut().zip(self.weights) {
                *mean += T::dot(simd, values, &weights[start..start + length]);
            }
            match self.keep {
                Variance::None => {}
                Variance::Full(of_process) => {
                    of_process.cross[start..start + length].copy_from_slice(values)
                }
                Variance::Compact(of_process) => {
                    let cross = &mut of_process.cross[start..start + length];
                    cross
                        .iter_mut()
                        .zip(values)
                        .for_each(|(cross, value)| *cross = value.to_f64() as f32);
                }
            }
        }
    }
}

impl<T: Element> VarianceOf<T> {
    /// - `count`: points
    fn new(VarianceParts { subtracted, added }: &VarianceParts<'_>, count: usize) -> Self {
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
    fn new(matrix: &WeightRows<'_>) -> Self {
        let WeightRows { at, rows: count, columns, triangle } = *matrix;
        let (mut values, mut lengths) = (Vec::new(), Vec::new());
        for first in (0..count).step_by(4) {
            let used = if triangle { (first + 4).min(columns) } else { columns };
            let length = used.next_multiple_of(BLOCK);
            for (start, row) in (0..length)
                .step_by(BLOCK)
                .flat_map(|start| (first..first + 4).map(move |row| (start, row)))
            {
                let there =
                    |column: usize| row < count && column < columns && (column <= row || !triangle);
                let value = |column: usize| {
                    if there(column) { T::from_f64(at(row, column)) } else { T::default() }
                };
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
