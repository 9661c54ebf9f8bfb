//! Points on a grid of 16 bits for each input: a quarter of the memory that a query has to read.

use std::ops::Range;

use pulp::Simd;

use super::{Element, Features, Plan, TILE};

/// Points in the coordinates of a plan, tile by tile.
pub(crate) trait Points<T: Element> {
    /// Squared distances, in the coordinates `columns`, of the points of a tile (start, length) to the query `c`.
    fn squared_distances<S: Simd>(
        &self,
        simd: S,
        columns: Range<usize>,
        tile: (usize, usize),
        c: &[T],
        squares: &mut [T],
    );
}

/// Largest number of steps from the middle of the grid.
const LARGEST: f64 = 32_767.0;

/// Middle and step of the grid of every input.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    middle: Vec<f64>,
    step: Vec<f64>,
}

impl Grid {
    /// A grid over the range of each input of `x`, `[points, inputs]` row-major.
    pub fn of(x: &[f64], inputs: usize) -> Self {
        let range = |input: usize| {
            let column = x.iter().skip(input).step_by(inputs);
            column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
        };
        let ranges: Vec<(f64, f64)> = (0..inputs).map(range).collect();
        let step = |(low, high): &(f64, f64)| if high > low { (high - low) / (2.0 * LARGEST) } else { 1.0 };
        Self {
            middle: ranges.iter().map(|(low, high)| 0.5 * (low + high)).collect(),
            step: ranges.iter().map(step).collect(),
        }
    }

    /// Middle of every input.
    pub fn middle(&self) -> &[f64] {
        &self.middle
    }

    /// The point of the grid next to `x`, in steps from the middle.
    fn steps(&self, input: usize, x: f64) -> f64 {
        ((x - self.middle[input]) / self.step[input]).round()
    }

    /// The point of the grid next to `x`.
    pub fn nearest(&self, input: usize, x: f64) -> f64 {
        self.middle[input] + self.step[input] * self.steps(input, x)
    }
}

/// Points of a grid.
#[derive(Clone, Debug)]
pub(crate) struct GridPoints<T> {
    /// A tile after the other: its columns, each [`TILE`] long, in steps.
    steps: Vec<i16>,
    /// Coordinate of a step, per column.
    scales: Vec<T>,
    count: usize,
}

impl<T: Element> GridPoints<T> {
    /// The points `x` in the coordinates of `plan`, which is centred on the grid; none if an input is periodic.
    pub fn new(plan: &Plan, grid: &Grid, x: &[f64], inputs: usize) -> Option<Self> {
        let columns = plan.straight_columns()?;
        let count = x.len() / inputs;
        let mut steps = vec![0; count.div_ceil(TILE) * columns.len() * TILE];
        for (k, point) in x.chunks_exact(inputs).enumerate() {
            let tile = &mut steps[k / TILE * columns.len() * TILE..];
            for (c, (input, _)) in columns.iter().enumerate() {
                tile[c * TILE + k % TILE] = grid.steps(*input, point[*input]) as i16;
            }
        }
        let scales = columns.iter().map(|(input, factor)| T::from_f64(grid.step[*input] * factor)).collect();
        Some(Self { steps, scales, count })
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.count
    }
}

impl<T: Element> Points<T> for GridPoints<T> {
    #[inline(always)]
    fn squared_distances<S: Simd>(
        &self,
        simd: S,
        columns: Range<usize>,
        (start, length): (usize, usize),
        c: &[T],
        squares: &mut [T],
    ) {
        squares.fill(T::default());
        let tile = &self.steps[start * self.scales.len()..];
        for (column, c) in columns.zip(c) {
            T::add_grid_squares(simd, &tile[column * TILE..][..length], self.scales[column], *c, squares);
        }
    }
}

impl<T: Element> Points<T> for Features<T> {
    #[inline(always)]
    fn squared_distances<S: Simd>(
        &self,
        simd: S,
        columns: Range<usize>,
        (start, _): (usize, usize),
        c: &[T],
        squares: &mut [T],
    ) {
        let (x, stride) = self.columns_from(columns.start, start);
        T::squared_distances(simd, x, stride, c, squares);
    }
}
