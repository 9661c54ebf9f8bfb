//! Points in groups whose coordinates lie together, so that a query reads memory in its order.

use alloc::vec::Vec;

use super::points::block;
use super::{Element, Features, Plan, Points, REGISTERS, Shape};
use crate::simd::Simd;

/// Points are padded to whole groups of any number; a divisor of a tile.
pub(crate) const PADDED: usize = 64;

/// With zeros at its end, so that whole groups can be read.
pub fn padded<T: Element>(values: &[f64]) -> Vec<T> {
    let mut padded: Vec<T> = values.iter().map(|value| T::from_f64(*value)).collect();
    padded.resize(values.len().next_multiple_of(PADDED), T::default());
    padded
}

/// Points of a group: a block of the widest registers.
pub const fn group<T>() -> usize {
    REGISTERS * 64 / size_of::<T>()
}

/// sum of weights * shape of the distance, for the points from `start` on, of a kernel with one
/// leaf: what is computed of a point never leaves the registers.
///
/// - `weights`: one per point, whole groups
#[inline(always)]
pub fn weigh<T: Element, S: Simd>(
    simd: S,
    points: &impl Points<T>,
    shape: Shape,
    start: usize,
    c: &[T],
    weights: &[T],
) -> f64 {
    shape.known(
        #[inline(always)]
        |shape| {
            let mut sums = [T::splat(simd, T::default()); REGISTERS];
            for (k, weights) in weights.chunks_exact(block::<T, S>()).enumerate() {
                let squares = points.squares_at(simd, 0, start + k * block::<T, S>(), c);
                let weights = T::load::<S, REGISTERS>(weights);
                for position in 0..REGISTERS {
                    let [value, _] = T::shape_at::<S, false>(simd, shape, squares[position]);
                    sums[position] = T::mul_add(simd, value, weights[position], sums[position]);
                }
            }
            T::sum(simd, sums)
        },
    )
}

/// All digits of points.
#[derive(Clone, Debug)]
pub struct GroupedPoints<T> {
    /// Of every leaf.
    leaves: Vec<GroupedLeaf<T>>,
}

#[derive(Clone, Debug)]
struct GroupedLeaf<T> {
    columns: usize,
    /// A group after the other, `[columns, points of a group]` each.
    values: Vec<T>,
}

impl<T: Element> GroupedPoints<T> {
    /// The points `x`, `[points, inputs]` row-major, in the coordinates of `plan`.
    pub fn new(plan: &Plan, x: &[f64], inputs: usize) -> Self {
        let features = plan.features(x, inputs);
        Self {
            leaves: plan
                .leaf_columns()
                .map(|columns| GroupedLeaf::new(&features, columns))
                .collect(),
        }
    }
}

impl<T: Element> GroupedLeaf<T> {
    fn new(features: &Features<T>, columns: core::ops::Range<usize>) -> Self {
        let (count, width) = (features.count(), columns.len());
        let mut values = vec![T::default(); count.next_multiple_of(PADDED) * width];
        for (m, column) in columns.enumerate() {
            for (k, value) in features.column(column).iter().enumerate() {
                values[(k / group::<T>() * width + m) * group::<T>() + k % group::<T>()] = *value;
            }
        }
        Self { columns: width, values }
    }
}

impl<T: Element> Points<T> for GroupedPoints<T> {
    #[inline(always)]
    fn squares_at<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        c: &[T],
    ) -> [T::Register<S>; REGISTERS] {
        let GroupedLeaf { columns, values } = &self.leaves[leaf];
        let size = group::<T>();
        let group = &values[start / size * columns * size..][..columns * size];
        T::squares_at(simd, group, size, start % size, c)
    }
}
