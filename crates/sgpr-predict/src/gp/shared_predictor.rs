//! Several processes over the same points, asked one query after the other.

use alloc::vec::Vec;

use super::kernels::{BLOCK, Element, TILE, padded};
use super::predictor::{Precision, probes};
use super::{Kernel, Shape};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::{Arch, Simd, WithSimd};

/// Means of several processes over the same points, such as those of the joints of an arm: the
/// points are read once, and processes with the same kernel share its values. Owns its buffers,
/// allocates nothing, takes no lock, and can move to another thread; the work of a prediction does
/// not depend on the query.
///
/// # Examples
/// ```
/// use sgpr_predict::gp::{Kernel, Precision, Shape, SharedPredictor, WeightedKernel};
/// let x = [0.0, 1.0, 2.0];
/// let kernels = [1.0, 0.5].map(|scale| Kernel::isotropic(Shape::Matern52, 1, scale).scaled(1.0));
/// let weights = [[0.1, 0.8, 0.2], [1.0, -0.3, 1.0]];
/// let joint = |k: usize| WeightedKernel { signal: &kernels[k], x: &x, inputs: 1, weights: &weights[k] };
/// let mut predictor = SharedPredictor::new(&[joint(0), joint(1)], Precision::Double).expect("same points");
/// let by_hand = |k: usize| (0..3).map(|i| weights[k][i] * kernels[k].value(&[0.7], &[x[i]])).sum::<f64>();
/// let means = predictor.means(&[0.7]);
/// assert!((means[0] - by_hand(0)).abs() < 1e-15 && (means[1] - by_hand(1)).abs() < 1e-15);
/// ```
#[derive(Clone, Debug)]
pub struct SharedPredictor {
    kind: SharedKind,
    means: Vec<f64>,
    error: f64,
    inputs: usize,
}

#[derive(Clone, Debug)]
enum SharedKind {
    Double(SharedCore<f64>),
    Single(SharedCore<f32>),
}

/// The mean of a process: k(x, X) times weights.
#[derive(Clone, Copy, Debug)]
pub struct WeightedKernel<'a> {
    /// k.
    pub signal: &'a Kernel,
    /// X, `[points, inputs]`, row-major.
    pub x: &'a [f64],
    /// Number of inputs.
    pub inputs: usize,
    /// One per point.
    pub weights: &'a [f64],
}

/// Kernels whose distances are summed at once: their sums stay in registers.
const WIDEST: usize = 6;

#[derive(Clone, Debug)]
struct SharedCore<T> {
    /// Inputs that any kernel looks at, and their centres, subtracted so that single precision
    /// keeps its digits.
    columns: Vec<(usize, f64)>,
    /// A tile after the other: its columns, each [`TILE`] long.
    points: Vec<T>,
    count: usize,
    kernels: Vec<KernelGroup<T>>,
    query: Vec<T>,
    squares: Vec<T>,
    values: Vec<T>,
}

/// Up to [`WIDEST`] kernels.
#[derive(Clone, Debug)]
struct KernelGroup<T> {
    shapes: Vec<Shape>,
    /// One over the squared length scales, `[columns, kernels]`; zero for an input that the kernel
    /// does not look at.
    weights: Weights<T>,
    /// For each kernel the processes that have it.
    processes: Vec<OfKernel<T>>,
}

/// Processes of one kernel: index, and K⁻¹ y times the signal variance.
type OfKernel<T> = Vec<(usize, Vec<T>)>;

/// By the number of kernels, which the compiler has to know.
#[derive(Clone, Debug)]
enum Weights<T> {
    One(Vec<[T; 1]>),
    Two(Vec<[T; 2]>),
    Three(Vec<[T; 3]>),
    Four(Vec<[T; 4]>),
    Five(Vec<[T; 5]>),
    Six(Vec<[T; 6]>),
}

impl<T: Element> Weights<T> {
    /// - `of_kernels`: for each kernel one weight per column
    fn new(of_kernels: &[Vec<f64>]) -> Self {
        fn rows<T: Element, const K: usize>(of_kernels: &[Vec<f64>]) -> Vec<[T; K]> {
            let row = |column: usize| {
                core::array::from_fn(|kernel| T::from_f64(of_kernels[kernel][column]))
            };
            (0..of_kernels[0].len()).map(row).collect()
        }
        match of_kernels.len() {
            1 => Self::One(rows(of_kernels)),
            2 => Self::Two(rows(of_kernels)),
            3 => Self::Three(rows(of_kernels)),
            4 => Self::Four(rows(of_kernels)),
            5 => Self::Five(rows(of_kernels)),
            WIDEST => Self::Six(rows(of_kernels)),
            count => unreachable!("{count} kernels in a group"),
        }
    }

    #[inline(always)]
    fn distances<S: Simd>(&self, simd: S, x: &[T], length: usize, query: &[T], squares: &mut [T]) {
        match self {
            Self::One(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
            Self::Two(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
            Self::Three(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
            Self::Four(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
            Self::Five(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
            Self::Six(weights) => T::weighted_distances(simd, x, length, query, weights, squares),
        }
    }
}

impl SharedPredictor {
    /// The only place that allocates. None if there is no process, if they do not have the same
    /// points, or if a kernel is more than one stationary shape: ask each by a
    /// [`super::GpPredictor`] then.
    pub fn new(sums: &[WeightedKernel<'_>], precision: Precision) -> Option<Self> {
        let WeightedKernel { x, inputs, .. } = sums.first()?;
        let alike = |sum: &WeightedKernel<'_>| {
            (sum.inputs, sum.x) == (*inputs, *x) && sum.signal.single_leaf().is_some()
        };
        if !sums.iter().all(alike) {
            return None;
        }
        let means = vec![0.0; sums.len()];
        let kind = match precision {
            Precision::Double => SharedKind::Double(SharedCore::new(sums)),
            Precision::Single => SharedKind::Single(SharedCore::new(sums)),
        };
        let mut predictor = Self { kind, means, error: 0.0, inputs: *inputs };
        if precision == Precision::Single {
            predictor.error = predictor.compare(sums);
        }
        Some(predictor)
    }

    /// Largest difference to double precision at points of the data and half-way between them.
    fn compare(&mut self, sums: &[WeightedKernel<'_>]) -> f64 {
        let mut exact = Self::new(sums, Precision::Double).expect("as in single precision");
        let mut largest: f64 = 0.0;
        for x in probes(sums[0].x, self.inputs).chunks_exact(self.inputs) {
            let differences = self.means(x).iter().zip(exact.means(x)).map(|(a, b)| (a - b).abs());
            largest = differences.fold(largest, f64::max);
        }
        largest
    }

    /// Mean of the signal of every process.
    ///
    /// # Panics
    /// If `x` has another length than the inputs.
    pub fn means(&mut self, x: &[f64]) -> &[f64] {
        assert_eq!(x.len(), self.inputs, "one number per input");
        match &mut self.kind {
            SharedKind::Double(core) => {
                Arch::new().dispatch(PredictShared { core, x, means: &mut self.means })
            }
            SharedKind::Single(core) => {
                Arch::new().dispatch(PredictShared { core, x, means: &mut self.means })
            }
        }
        &self.means
    }

    /// Largest error of a mean against double precision, measured at up to 200 points of the data
    /// and as many between them; zero in double precision.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }
}

impl<T: Element> SharedCore<T> {
    fn new(sums: &[WeightedKernel<'_>]) -> Self {
        let leaves: Vec<_> =
            sums.iter().map(|sum| sum.signal.single_leaf().expect("checked")).collect();
        let WeightedKernel { x, inputs, .. } = sums[0];
        let count = x.len() / inputs;
        let mut used: Vec<usize> =
            leaves.iter().flat_map(|(_, leaf)| leaf.inputs.iter().map(|i| i.index)).collect();
        used.sort_unstable();
        used.dedup();
        let mean = |input: usize| x.iter().skip(input).step_by(inputs).sum::<f64>() / count as f64;
        let columns: Vec<(usize, f64)> = used.iter().map(|&input| (input, mean(input))).collect();

        let tiles = count.div_ceil(TILE);
        let mut points = vec![T::default(); tiles * columns.len() * TILE];
        for (k, point) in x.chunks_exact(inputs).enumerate() {
            let tile = &mut points[k / TILE * columns.len() * TILE..];
            for (c, (input, centre)) in columns.iter().enumerate() {
                tile[c * TILE + k % TILE] = T::from_f64(point[*input] - centre);
            }
        }

        let mut distinct: Vec<usize> = vec![];
        let mut own: Vec<OfKernel<T>> = vec![];
        for (index, (variance, leaf)) in leaves.iter().enumerate() {
            let alpha: Vec<f64> =
                sums[index].weights.iter().map(|alpha| variance * alpha).collect();
            let entry = (index, padded(&alpha));
            match distinct.iter().position(|&other| *leaves[other].1 == **leaf) {
                Some(kernel) => own[kernel].push(entry),
                None => {
                    distinct.push(index);
                    own.push(vec![entry]);
                }
            }
        }
        let weights = |&index: &usize| -> Vec<f64> {
            let leaf = &leaves[index].1;
            let of = |column: usize| leaf.inputs.iter().position(|input| input.index == column);
            columns
                .iter()
                .map(|(input, _)| of(*input).map_or(0.0, |k| leaf.scale(k).powi(-2)))
                .collect()
        };
        let group = |(kernels, processes): (&[usize], &[OfKernel<T>])| KernelGroup {
            shapes: kernels.iter().map(|&index| leaves[index].1.shape).collect(),
            weights: Weights::new(&kernels.iter().map(weights).collect::<Vec<_>>()),
            processes: processes.to_vec(),
        };
        Self {
            kernels: distinct.chunks(WIDEST).zip(own.chunks(WIDEST)).map(group).collect(),
            query: vec![T::default(); columns.len()],
            squares: vec![T::default(); WIDEST * TILE],
            values: vec![T::default(); TILE],
            columns,
            points,
            count,
        }
    }
}

struct PredictShared<'a, T> {
    core: &'a mut SharedCore<T>,
    x: &'a [f64],
    means: &'a mut [f64],
}

impl<T: Element> WithSimd for PredictShared<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            core: SharedCore { columns, points, count, kernels, query, squares, values },
            x,
            means,
        } = self;
        for (value, (input, centre)) in query.iter_mut().zip(&*columns) {
            *value = T::from_f64(x[*input] - centre);
        }
        means.fill(0.0);
        for (tile, x) in points.chunks_exact(columns.len() * TILE).enumerate() {
            let start = tile * TILE;
            let length = (*count - start).min(TILE).next_multiple_of(BLOCK);
            for KernelGroup { shapes, weights, processes } in &*kernels {
                weights.distances(simd, x, length, query, squares);
                for ((shape, processes), squares) in
                    shapes.iter().zip(processes).zip(squares.chunks_exact(TILE))
                {
                    T::shape::<S, false>(
                        simd,
                        *shape,
                        &squares[..length],
                        &mut values[..length],
                        &mut [],
                    );
                    for (process, alpha) in processes {
                        means[*process] +=
                            T::dot(simd, &values[..length], &alpha[start..start + length]);
                    }
                }
            }
        }
    }
}
