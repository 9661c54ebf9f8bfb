//! From one register per quantity to contiguous quantities per sample.

use pulp::Simd;

use super::{Lanes, MAX_LANES};

/// Turns ten registers into one row of ten numbers per lane.
///
/// `pulp`'s fast interleaving leaves the lanes in an order of its own, found here by interleaving
/// lane numbers.
#[derive(Clone, Copy, Debug)]
pub struct Transpose<S: Simd> {
    simd: S,
    /// Where the row of each interleaved group of two and of four starts.
    starts_of_twos: [usize; MAX_LANES],
    starts_of_fours: [usize; MAX_LANES],
}

impl<S: Simd> Transpose<S> {
    /// Rows are `stride` numbers apart; lanes from `count` on are not written.
    #[inline(always)]
    pub fn new(simd: S, count: usize, stride: usize) -> Self {
        const { assert!(S::F64_LANES <= MAX_LANES) };
        let numbers =
            simd.partial_load_f64s(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0][..S::F64_LANES]);
        let mut order = Self {
            simd,
            starts_of_twos: [NOWHERE; MAX_LANES],
            starts_of_fours: [NOWHERE; MAX_LANES],
        };
        let twos = simd.interleave_shfl_f64s([numbers; 2]);
        let fours = simd.interleave_shfl_f64s([numbers; 4]);
        let twos =
            bytemuck::cast_slice::<S::f64s, [f64; 2]>(&twos).iter().map(|group| group[0] as usize);
        let fours =
            bytemuck::cast_slice::<S::f64s, [f64; 4]>(&fours).iter().map(|group| group[0] as usize);
        for (group, (lane_of_two, lane_of_four)) in twos.zip(fours).enumerate() {
            if lane_of_two < count {
                order.starts_of_twos[group] = lane_of_two * stride;
            }
            if lane_of_four < count {
                order.starts_of_fours[group] = lane_of_four * stride;
            }
        }
        order
    }

    /// Writes lane `k` of `block` to `target[k * stride..][..10]`.
    #[inline(always)]
    pub fn write_rows(&self, block: [Lanes<S>; 10], target: &mut [f64]) {
        let [a, b, c, d, e, f, g, h, i, j] = block;
        let first =
            self.simd.interleave_shfl_f64s([a.values(), b.values(), c.values(), d.values()]);
        let second =
            self.simd.interleave_shfl_f64s([e.values(), f.values(), g.values(), h.values()]);
        let third = self.simd.interleave_shfl_f64s([i.values(), j.values()]);
        let first = bytemuck::cast_slice::<S::f64s, [f64; 4]>(&first);
        let second = bytemuck::cast_slice::<S::f64s, [f64; 4]>(&second);
        let third = bytemuck::cast_slice::<S::f64s, [f64; 2]>(&third);
        for group in 0..S::F64_LANES {
            let start = self.starts_of_fours[group];
            if let Some(row) = target.get_mut(start..start + 8) {
                row[..4].copy_from_slice(&first[group]);
                row[4..].copy_from_slice(&second[group]);
            }
            let start = self.starts_of_twos[group];
            if let Some(row) = target.get_mut(start + 8..start + 10) {
                row.copy_from_slice(&third[group]);
            }
        }
    }
}

/// A place outside of every slice.
const NOWHERE: usize = usize::MAX / 2;
