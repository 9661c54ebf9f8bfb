//! Sums over columns.

use pulp::{Arch, Simd, WithSimd};

/// Sum of the products, one after the other.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Shorter columns are not worth the choice of an instruction set.
const LONG: usize = 32;

/// Sum of the products of long columns, in several sums, so that the additions need not wait for
/// each other. Of columns of different lengths the shorter counts.
pub fn dot_in_lanes(a: &[f64], b: &[f64]) -> f64 {
    let length = a.len().min(b.len());
    if length < LONG {
        return dot(&a[..length], &b[..length]);
    }
    Arch::new().dispatch(Dot(&a[..length], &b[..length]))
}

struct Dot<'a>(&'a [f64], &'a [f64]);

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let ((a, rest_of_a), (b, rest_of_b)) = (S::as_simd_f64s(self.0), S::as_simd_f64s(self.1));
        let ((a, last_a), (b, last_b)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
        let mut sums = [simd.splat_f64s(0.0); 4];
        for (a, b) in a.iter().zip(b) {
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum = simd.mul_add_f64s(*a, *b, *sum);
            }
        }
        for (a, b) in last_a.iter().zip(last_b) {
            sums[0] = simd.mul_add_f64s(*a, *b, sums[0]);
        }
        let sum = simd.add_f64s(simd.add_f64s(sums[0], sums[1]), simd.add_f64s(sums[2], sums[3]));
        simd.reduce_sum_f64s(sum) + dot(rest_of_a, rest_of_b)
    }
}

/// Mean of the squares; zero of none.
pub fn mean_square(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64
}

/// Root of the mean of the squares.
pub fn rms(values: &[f64]) -> f64 {
    mean_square(values).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_in_lanes_are_those_one_after_the_other() {
        let a: Vec<f64> = (0..1003).map(|k| (0.37 * f64::from(k)).sin()).collect();
        let b: Vec<f64> = (0..1003).map(|k| (0.11 * f64::from(k * k)).cos()).collect();
        for length in [0, 1, 7, 8, 31, 32, 33, 63, 64, 100, 1003] {
            let (exact, lanes) = (dot(&a[..length], &b[..length]), dot_in_lanes(&a[..length], &b));
            assert!((exact - lanes).abs() <= 1e-13 * length as f64, "{length}: {exact} {lanes}");
        }
    }
}
