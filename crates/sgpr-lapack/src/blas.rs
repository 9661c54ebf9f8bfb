//! Products of matrices and vectors. Matrices are stored by columns, `ld` numbers from one column
//! to the next.

use crate::Real;

/// Whether a matrix enters as it is or transposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// As it is.
    Plain,
    /// Transposed.
    Transposed,
}

/// Which triangle of a symmetric matrix is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Triangle {
    /// The upper one.
    Upper,
    /// The lower one.
    Lower,
}

impl Triangle {
    /// Whether (`i`, `j`) is in it.
    pub fn holds(self, i: usize, j: usize) -> bool {
        match self {
            Self::Upper => i <= j,
            Self::Lower => i >= j,
        }
    }
}

/// A matrix that is read.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, T> {
    /// Numbers by columns.
    pub data: &'a [T],
    /// From one column to the next.
    pub ld: usize,
    /// How the matrix enters.
    pub op: Op,
}

impl<'a, T: Real> View<'a, T> {
    /// A matrix as it is.
    pub fn plain(data: &'a [T], ld: usize) -> Self {
        Self { data, ld, op: Op::Plain }
    }

    /// Entry of the matrix as it enters.
    pub fn at(&self, i: usize, j: usize) -> T {
        match self.op {
            Op::Plain => self.data[i + j * self.ld],
            Op::Transposed => self.data[j + i * self.ld],
        }
    }

    /// Entry of a symmetric matrix of which `triangle` is stored.
    pub fn symmetric(&self, triangle: Triangle, i: usize, j: usize) -> T {
        if triangle.holds(i, j) { self.data[i + j * self.ld] } else { self.data[j + i * self.ld] }
    }
}

/// alpha * sum + beta * old, `old` unread for beta = 0 as BLAS demands (it may be NaN).
fn combine<T: Real>(alpha: T, sum: T, beta: T, old: &mut T) {
    *old = if beta == T::ZERO { alpha * sum } else { alpha * sum + beta * *old };
}

fn sum<T: Real>(count: usize, term: impl Fn(usize) -> T) -> T {
    let mut total = T::ZERO;
    for k in 0..count {
        total += term(k);
    }
    total
}

/// C = alpha A B + beta C, C `[m, n]`, `k` products per entry.
pub fn gemm<T: Real>(
    [m, n, k]: [usize; 3],
    alpha: T,
    a: View<'_, T>,
    b: View<'_, T>,
    beta: T,
    c: &mut [T],
    ldc: usize,
) {
    for j in 0..n {
        for i in 0..m {
            combine(alpha, sum(k, |l| a.at(i, l) * b.at(l, j)), beta, &mut c[i + j * ldc]);
        }
    }
}

/// y = alpha A x + beta y, A `[rows, columns]` as it enters; `steps` from one entry of x and y to
/// the next.
pub fn gemv<T: Real>(
    [rows, columns]: [usize; 2],
    alpha: T,
    a: View<'_, T>,
    x: &[T],
    beta: T,
    y: &mut [T],
    steps: [usize; 2],
) {
    for i in 0..rows {
        combine(alpha, sum(columns, |j| a.at(i, j) * x[j * steps[0]]), beta, &mut y[i * steps[1]]);
    }
}

/// y = alpha A x + beta y, A symmetric `[n, n]`.
#[expect(clippy::too_many_arguments, reason = "those of BLAS")]
pub fn symv<T: Real>(
    triangle: Triangle,
    n: usize,
    alpha: T,
    a: View<'_, T>,
    x: &[T],
    beta: T,
    y: &mut [T],
    steps: [usize; 2],
) {
    for i in 0..n {
        combine(
            alpha,
            sum(n, |j| a.symmetric(triangle, i, j) * x[j * steps[0]]),
            beta,
            &mut y[i * steps[1]],
        );
    }
}

/// One triangle of C = alpha A Aᵀ + beta C, C `[n, n]`, A `[n, k]` as it enters.
pub fn syrk<T: Real>(
    triangle: Triangle,
    [n, k]: [usize; 2],
    alpha: T,
    a: View<'_, T>,
    beta: T,
    c: &mut [T],
    ldc: usize,
) {
    for j in 0..n {
        for i in (0..n).filter(|&i| triangle.holds(i, j)) {
            combine(alpha, sum(k, |l| a.at(i, l) * a.at(j, l)), beta, &mut c[i + j * ldc]);
        }
    }
}

/// One triangle of C = alpha (A Bᵀ + B Aᵀ) + beta C, C `[n, n]`, A and B `[n, k]` as they enter.
#[expect(clippy::too_many_arguments, reason = "those of BLAS")]
pub fn syr2k<T: Real>(
    triangle: Triangle,
    [n, k]: [usize; 2],
    alpha: T,
    a: View<'_, T>,
    b: View<'_, T>,
    beta: T,
    c: &mut [T],
    ldc: usize,
) {
    for j in 0..n {
        for i in (0..n).filter(|&i| triangle.holds(i, j)) {
            let products = sum(k, |l| a.at(i, l) * b.at(j, l) + b.at(i, l) * a.at(j, l));
            combine(alpha, products, beta, &mut c[i + j * ldc]);
        }
    }
}
