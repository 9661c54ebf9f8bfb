//! Points on a grid of 16 bits for each input: a quarter of the memory that a query has to read.

use std::ops::Range;

use super::{Element, PADDED, Plan, Points, Query, REGISTERS, group};
use crate::simd::{Simd, pair, pair_products};

/// Largest number of steps from the middle of the grid, and largest digit.
const LARGEST: f64 = 32_767.0;

/// Largest sum of digits over columns, so that no sum of products leaves 32 bits.
const LARGEST_SUM: f64 = 65_000.0;

/// Step of an input that is the same at all points: so small that no digits are spent on it.
const NO_RANGE: f64 = 1e-100;

/// Middle and step of the grid of every input.
#[derive(Clone, Debug)]
pub struct Grid {
    middle: Vec<f64>,
    step: Vec<f64>,
}

impl Grid {
    /// A grid over the range of each input of `x`, `[points, inputs]` row-major.
    pub fn of(x: &[f64], inputs: usize) -> Self {
        let range = |input: usize| {
            let column = x.iter().skip(input).step_by(inputs);
            column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(*x), high.max(*x))
            })
        };
        let ranges: Vec<(f64, f64)> = (0..inputs).map(range).collect();
        let step = |(low, high): &(f64, f64)| {
            if high > low { (high - low) / (2.0 * LARGEST) } else { NO_RANGE }
        };
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
///
/// |x - c|² = |x|² + |c|² - 2 x·c, where x is in steps and c is split into digits: sums of products of integers of 16 bits.
#[derive(Clone, Debug)]
pub struct GridPoints<T> {
    leaves: Vec<GridLeaf<T>>,
}

/// Points as one leaf of the kernel sees them, and the query.
#[derive(Clone, Debug)]
struct GridLeaf<T> {
    columns: Range<usize>,
    /// A group of points after the other, of two columns in one word: `[pairs, points of a group]`.
    steps: Vec<u32>,
    /// Coordinate of a step, per column.
    scales: Vec<f64>,
    /// |x|², per point.
    norms: Vec<T>,
    query: Digits,
}

/// Coordinates of a query, each times that of a step: the first digit times its unit plus the
/// second times its own.
#[derive(Clone, Debug)]
struct Digits {
    /// Of two columns in one word, `[pairs]`.
    words: Vec<[u32; 2]>,
    units: [f64; 2],
    /// |c|², so that it goes with the rounded products.
    norm: f64,
}

impl<T: Element> GridPoints<T> {
    /// The points `x` in the coordinates of `plan`, which is centred on the grid; none if an input
    /// is periodic.
    pub fn new(plan: &Plan, grid: &Grid, x: &[f64], inputs: usize) -> Option<Self> {
        let columns = plan.straight_columns()?;
        let leaf =
            |range: Range<usize>| GridLeaf::new(&columns[range.clone()], range, grid, x, inputs);
        Some(Self { leaves: plan.leaf_columns().map(leaf).collect() })
    }

    /// Takes the point whose distances are asked for next.
    #[inline(always)]
    pub fn set_query(&mut self, query: &Query<T>) {
        for leaf in &mut self.leaves {
            leaf.query.set(&leaf.scales, query.coordinates(&leaf.columns));
        }
    }
}

impl<T: Element> GridLeaf<T> {
    /// - `inputs_and_factors`: of the columns
    fn new(
        inputs_and_factors: &[(usize, f64)],
        columns: Range<usize>,
        grid: &Grid,
        x: &[f64],
        inputs: usize,
    ) -> Self {
        let pairs = columns.len().div_ceil(2);
        let scales: Vec<f64> =
            inputs_and_factors.iter().map(|(input, factor)| grid.step[*input] * factor).collect();
        let padded = (x.len() / inputs).next_multiple_of(PADDED);
        let (mut steps, mut norms) = (vec![0; padded * pairs], vec![T::default(); padded]);
        for (k, point) in x.chunks_exact(inputs).enumerate() {
            let own: Vec<f64> = inputs_and_factors
                .iter()
                .map(|(input, _)| grid.steps(*input, point[*input]))
                .collect();
            norms[k] = T::from_f64(
                own.iter().zip(&scales).map(|(steps, scale)| (steps * scale).powi(2)).sum(),
            );
            let size = group::<T>();
            let group = &mut steps[k / size * pairs * size..];
            for (p, two) in own.chunks(2).enumerate() {
                group[p * size + k % size] =
                    pair([two[0] as i16, two.get(1).map_or(0, |steps| *steps as i16)]);
            }
        }
        let query = Digits { words: vec![[0; 2]; pairs], units: [0.0; 2], norm: 0.0 };
        Self { columns, steps, scales, norms, query }
    }
}

impl Digits {
    /// Rounds the products of the query with a step to what their digits say, by less than a
    /// billionth of the sum of their sizes over as many as 18 columns.
    #[inline(always)]
    fn set<T: Element>(&mut self, scales: &[f64], query: &[T]) {
        let product = |k: usize| query[k].to_f64() * scales[k];
        let sizes = (0..scales.len()).map(|k| product(k).abs());
        let (total, largest) =
            sizes.fold((0.0, 0.0), |(sum, max), size| (sum + size, f64::max(max, size)));
        let unit = (total / LARGEST_SUM).max(largest / LARGEST).max(f64::MIN_POSITIVE);
        let reciprocal = 1.0 / unit;
        let parts = (LARGEST_SUM / (2 * self.words.len()) as f64).min(LARGEST);
        let part = 1.0 / parts;
        self.units = [unit, unit * part];
        self.norm = 0.0;
        for (pair_index, words) in self.words.iter_mut().enumerate() {
            let mut digits = [[0; 2]; 2];
            for column in 0..2.min(scales.len() - 2 * pair_index) {
                let k = 2 * pair_index + column;
                let exact = product(k) * reciprocal;
                let first = exact.round_ties_even();
                let second = ((exact - first) * parts).round_ties_even();
                (digits[0][column], digits[1][column]) = (first as i16, second as i16);
                // Corrects the error of the product for points close to the query, or on the side
                // of it if it is outside.
                let (c, error) = (query[k].to_f64(), unit * (first + second * part - exact));
                self.norm += c * c + 2.0 * (c / scales[k]).clamp(-LARGEST, LARGEST) * error;
            }
            *words = digits.map(pair);
        }
    }
}

impl<T: Element> Points<T> for GridPoints<T> {
    #[inline(always)]
    fn squares_at<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        _: &[T],
    ) -> [T::Register<S>; REGISTERS] {
        // Of numbers of 64 bits a block has fewer than of 32 bits.
        if size_of::<T::Register<S>>() / size_of::<T>() == S::U32_LANES {
            self.leaves[leaf].squares_at::<S, REGISTERS>(simd, start)
        } else {
            self.leaves[leaf].squares_at::<S, { REGISTERS / 2 }>(simd, start)
        }
    }
}

impl<T: Element> GridLeaf<T> {
    /// - `COUNT`: registers of 32 bits in a block
    #[inline(always)]
    fn squares_at<S: Simd, const COUNT: usize>(
        &self,
        simd: S,
        start: usize,
    ) -> [T::Register<S>; REGISTERS] {
        let size = group::<T>();
        let height = self.query.words.len() * size;
        let group = &self.steps[start / size * height..][..height];
        let norms = T::load::<S, REGISTERS>(&self.norms[start..]);
        let [first, second] = self.query.units;
        let units = [T::from_f64(-2.0 * first), T::from_f64(-2.0 * second)];
        let products = products::<S, COUNT>(simd, group, size, start % size, &self.query.words);
        T::squares_from_products(simd, norms, T::from_f64(self.query.norm), &products, units)
    }
}

/// Sums over columns of steps times each digit of the query, for so many registers of a group of
/// `size` points from `start` on.
#[inline(always)]
fn products<S: Simd, const COUNT: usize>(
    simd: S,
    group: &[u32],
    size: usize,
    start: usize,
    words: &[[u32; 2]],
) -> [[S::u32s; COUNT]; 2] {
    let mut sums = [[simd.splat_u32s(0); COUNT]; 2];
    for (x, words) in group.chunks_exact(size).zip(words) {
        let x = S::as_simd_u32s(&x[start..start + COUNT * S::U32_LANES]).0;
        let x = x.first_chunk::<COUNT>().expect("as many as were cut out");
        for digit in 0..2 {
            let word = simd.splat_u32s(words[digit]);
            for position in 0..COUNT {
                let product = pair_products(simd, x[position], word);
                sums[digit][position] = simd.add_u32s(sums[digit][position], product);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gp::Kernel;
    use crate::gp::kernels::Shape;
    use pulp::{Arch, Scalar, WithSimd};

    struct Distances<'a, T>(&'a GridPoints<T>, usize, usize);

    impl<T: Element> WithSimd for Distances<'_, T> {
        type Output = Vec<f64>;

        fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
            let Self(points, leaf, count) = self;
            let mut squares = vec![T::default(); count.next_multiple_of(PADDED)];
            points.squared_distances(simd, leaf, 0, &[], &mut squares);
            squares.iter().map(|square| square.to_f64()).collect()
        }
    }

    /// Largest error of a squared distance, as a share of the squares of point and query.
    fn largest_error<T: Element>() -> f64 {
        const COUNT: usize = 300;
        let wave = |k: usize, m: usize| (0.37 * k as f64 * (1.0 + m as f64) + m as f64).sin();
        let x: Vec<f64> = (0..COUNT)
            .flat_map(|k| [5.0 * wave(k, 0) + 7.0, 0.1 * wave(k, 1), wave(k, 2), 3.0])
            .collect();
        let wide = Kernel::ard(Shape::SquaredExponential, &[2.0, 0.03, 1.5]).on(&[0, 1, 2]);
        let narrow = Kernel::isotropic(Shape::Matern52, 2, 0.5).on(&[2, 3]);
        let grid = Grid::of(&x, 4);
        let plan = Plan::new(&wide.plus(narrow)).centred(grid.middle());
        let mut points: GridPoints<T> = GridPoints::new(&plan, &grid, &x, 4).expect("no circle");
        let mut largest: f64 = 0.0;
        for query in [[7.0, 0.0, 0.0, 3.0], [4.2, 0.07, -0.9, 3.0], [400.0, -0.2, 30.0, 4.0]] {
            let mut c = plan.query();
            plan.set_query(&query, &mut c);
            points.set_query(&c);
            for (leaf, columns) in plan.leaf_columns().enumerate() {
                let portable = Scalar::new().vectorize(Distances(&points, leaf, COUNT));
                let fast = Arch::new().dispatch(Distances(&points, leaf, COUNT));
                for (k, point) in x.chunks_exact(4).enumerate() {
                    let (mut square, mut of_point, mut of_query): (f64, f64, f64) = (0.0, 0.0, 0.0);
                    for (input, factor) in
                        &plan.straight_columns().expect("no circle")[columns.clone()]
                    {
                        let from_middle = |x: f64| factor * (x - grid.middle()[*input]);
                        let (x, c) = (
                            from_middle(grid.nearest(*input, point[*input])),
                            from_middle(query[*input]),
                        );
                        square += (x - c).powi(2);
                        of_point += x * x;
                        of_query += c * c;
                    }
                    let scale = 1e-3 + of_query + of_point;
                    for found in [portable[k], fast[k]] {
                        assert!(found >= 0.0);
                        largest = largest.max((found - square).abs() / scale);
                    }
                }
            }
        }
        largest
    }

    #[test]
    fn distances_on_the_grid_are_those_of_its_points() {
        let (double, single) = (largest_error::<f64>(), largest_error::<f32>());
        assert!(double < 1e-7, "{double:e}");
        assert!(single < 1e-6, "{single:e}");
    }
}
