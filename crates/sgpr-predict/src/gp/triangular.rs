//! Factors of covariances, row by row, so that all sums run along memory: enough for the points of
//! a model file.

use alloc::vec::Vec;

use super::kernels::Element;
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::{Arch, Simd, WithSimd};

/// A square matrix, row-major.
#[derive(Clone, Debug)]
pub(crate) struct Square {
    pub values: Vec<f64>,
    pub size: usize,
}

impl Square {
    pub fn from_fn(size: usize, at: impl Fn(usize, usize) -> f64) -> Self {
        Self { values: (0..size * size).map(|k| at(k / size, k % size)).collect(), size }
    }

    pub fn identity(size: usize) -> Self {
        Self::from_fn(size, |i, j| f64::from(u8::from(i == j)))
    }

    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.size..][..self.size]
    }

    pub fn transposed(&self) -> Self {
        Self::from_fn(self.size, |i, j| self.values[j * self.size + i])
    }

    /// L of A = L Lᵀ, of which the lower triangle counts; none if A is not positive definite.
    pub fn cholesky(mut self) -> Option<Self> {
        Arch::new().dispatch(Cholesky(&mut self)).then_some(self)
    }

    /// L⁻¹ B for this lower triangle L, in the place of B.
    pub fn solve_lower(&self, right: &mut Self) {
        let n = self.size;
        for i in 0..n {
            let (above, rest) = right.values.split_at_mut(i * n);
            let (row, pivot) = (&mut rest[..n], self.values[i * n + i]);
            for (factor, above) in self.row(i).iter().zip(above.chunks_exact(n)) {
                row.iter_mut().zip(above).for_each(|(value, above)| *value -= factor * above);
            }
            row.iter_mut().for_each(|value| *value /= pivot);
        }
    }

    /// A x.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let product = |row: &[f64]| row.iter().zip(x).map(|(a, x)| a * x).sum();
        self.values.chunks_exact(self.size).map(product).collect()
    }

    /// Aᵀ x.
    pub fn transposed_times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; self.size];
        for (row, x) in self.values.chunks_exact(self.size).zip(x) {
            product.iter_mut().zip(row).for_each(|(sum, value)| *sum += value * x);
        }
        product
    }
}

struct Cholesky<'a>(&'a mut Square);

impl WithSimd for Cholesky<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Square { values, size: n } = self.0;
        for i in 0..*n {
            let (above, rest) = values.split_at_mut(i * *n);
            let row = &mut rest[..*n];
            for (j, other) in above.chunks_exact(*n).enumerate() {
                row[j] = (row[j] - dot(simd, &row[..j], &other[..j])) / other[j];
            }
            let square = row[i] - dot(simd, &row[..i], &row[..i]);
            if !(square > 0.0 && square.is_finite()) {
                return false;
            }
            row[i] = square.sqrt();
            row[i + 1..].fill(0.0);
        }
        true
    }
}

/// Sum of the products: whole registers, and what is left one by one.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let rest = S::as_simd_f64s(a).1.len();
    let whole = a.len() - rest;
    let rest: f64 = a[whole..].iter().zip(&b[whole..]).map(|(a, b)| a * b).sum();
    f64::dot(simd, &a[..whole], &b[..whole]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_gives_the_matrix_back_and_solves() {
        let n = 37;
        // Positive definite: a kernel of points on a line, and something on the diagonal.
        let matrix = Square::from_fn(n, |i, j| {
            let apart = 0.2 * (i as f64 - j as f64);
            (-0.5 * apart * apart).exp() + f64::from(u8::from(i == j)) * 1e-3
        });
        let factor = matrix.clone().cholesky().expect("positive definite");
        for i in 0..n {
            for j in 0..n {
                let product: f64 =
                    factor.row(i).iter().zip(factor.row(j)).map(|(a, b)| a * b).sum();
                assert!((product - matrix.row(i)[j]).abs() < 1e-14);
            }
        }
        let mut inverse = Square::identity(n);
        factor.solve_lower(&mut inverse);
        let x: Vec<f64> = (0..n).map(|k| (k as f64).sin()).collect();
        let back = inverse.transposed_times(&inverse.times(&matrix.times(&x)));
        // The condition of the matrix is some 1e4.
        assert!(back.iter().zip(&x).all(|(back, x)| (back - x).abs() < 1e-10));
        let not = Square::from_fn(2, |i, j| if i == j { 1.0 } else { 2.0 });
        assert!(not.cholesky().is_none());
    }
}
