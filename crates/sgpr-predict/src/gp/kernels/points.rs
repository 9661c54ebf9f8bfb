use super::{Element, REGISTERS};
use crate::simd::Simd;

/// Points of a block of registers.
#[inline(always)]
pub const fn block<T: Element, S: Simd>() -> usize {
    REGISTERS * size_of::<T::Register<S>>() / size_of::<T>()
}

/// Points in the coordinates of a plan.
pub trait Points<T: Element> {
    /// Squared distances, in the coordinates of a leaf of the plan, of a block of points from
    /// `start` on to the query `c`.
    fn squares_at<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        c: &[T],
    ) -> [T::Register<S>; REGISTERS];

    /// The same for whole blocks, as many points as there is room for in `squares`.
    #[inline(always)]
    fn squared_distances<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        c: &[T],
        squares: &mut [T],
    ) {
        for (k, squares) in squares.chunks_exact_mut(block::<T, S>()).enumerate() {
            T::store(self.squares_at(simd, leaf, start + k * block::<T, S>(), c), squares);
        }
    }
}
