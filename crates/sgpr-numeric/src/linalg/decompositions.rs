//! faer's decompositions on one thread: the matrices here are small, and waking other threads costs
//! more than the work.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::evd::{self, ComputeEigenvectors};
use faer::linalg::lu::partial_pivoting::factor as lu;
use faer::linalg::lu::partial_pivoting::solve::{solve_in_place, solve_in_place_scratch};
use faer::linalg::qr::no_pivoting::factor as qr;
use faer::linalg::svd::{self, ComputeSvdVectors};
use faer::{Mat, MatRef, Par};

/// Upper triangular factor of a Householder QR, diagonal non-negative, `[k, k]` also for fewer rows
/// than columns.
///
/// The row of a column that depends on those before it is zero, as in the factor of a semidefinite
/// Gram matrix: what is left of the last column stands in its last entry alone.
pub fn triangle(matrix: MatRef<'_, f64>) -> Mat<f64> {
    let k = matrix.ncols();
    let rows = matrix.nrows().max(k);
    let mut work = Mat::zeros(rows, k);
    work.as_mut().subrows_mut(0, matrix.nrows()).copy_from(matrix);
    let size = qr::recommended_block_size::<f64>(rows, k);
    let mut householder = Mat::zeros(size, k);
    let mut buffer =
        MemBuffer::new(qr::qr_in_place_scratch::<f64>(rows, k, size, Par::Seq, Default::default()));
    qr::qr_in_place(
        work.as_mut(),
        householder.as_mut(),
        Par::Seq,
        MemStack::new(&mut buffer),
        Default::default(),
    );
    let mut factor = Mat::from_fn(k, k, |i, j| if i <= j { work[(i, j)] } else { 0.0 });
    free_rows_of_dependent_columns(&mut factor);
    let sign = |i: usize| if factor[(i, i)] < 0.0 { -1.0 } else { 1.0 };
    Mat::from_fn(k, k, |i, j| sign(i) * factor[(i, j)])
}

/// Turns the row that a dependent column took from those after it into their rows, by Givens
/// rotations.
fn free_rows_of_dependent_columns(factor: &mut Mat<f64>) {
    let k = factor.ncols();
    for dependent in 0..k {
        let length = factor.col(dependent).subrows(0, dependent + 1).norm_l2();
        if factor[(dependent, dependent)].abs() > k as f64 * f64::EPSILON * length {
            continue;
        }
        factor[(dependent, dependent)] = 0.0;
        for row in dependent + 1..k {
            let (kept, taken) = (factor[(row, row)], factor[(dependent, row)]);
            if taken == 0.0 {
                continue;
            }
            let length = kept.hypot(taken);
            let (cosine, sine) = (kept / length, taken / length);
            for j in row..k {
                let (a, b) = (factor[(row, j)], factor[(dependent, j)]);
                factor[(row, j)] = cosine * a + sine * b;
                factor[(dependent, j)] = cosine * b - sine * a;
            }
            factor[(dependent, row)] = 0.0;
        }
    }
}

/// Upper triangular R with RᵀR = matrix, of which the lower triangle is read; `None` if it is not
/// positive definite.
pub fn cholesky(matrix: MatRef<'_, f64>) -> Option<Mat<f64>> {
    let k = matrix.nrows();
    let mut work = matrix.to_owned();
    let mut buffer =
        MemBuffer::new(llt::cholesky_in_place_scratch::<f64>(k, Par::Seq, Default::default()));
    llt::cholesky_in_place(
        work.as_mut(),
        Default::default(),
        Par::Seq,
        MemStack::new(&mut buffer),
        Default::default(),
    )
    .ok()?;
    Some(Mat::from_fn(k, k, |i, j| if i <= j { work[(j, i)] } else { 0.0 }))
}

/// A power of two that brings entries whose squares are no numbers near one; one for others, and
/// for zeros.
fn range_factor(matrix: MatRef<'_, f64>) -> f64 {
    let largest = matrix.norm_max();
    if largest == 0.0 || (1e-120..=1e120).contains(&largest) {
        1.0
    } else {
        (-largest.log2().round()).clamp(-1022.0, 1022.0).exp2()
    }
}

/// Eigenvalues, ascending, and eigenvectors of a symmetric matrix, of which the lower triangle is
/// read.
///
/// # Panics
/// If an entry is not finite.
pub fn symmetric_eigen(matrix: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    assert!(matrix.is_all_finite(), "a finite matrix");
    let factor = range_factor(matrix);
    if factor != 1.0 {
        let (values, vectors) = symmetric_eigen((matrix * faer::Scale(factor)).as_ref());
        return (values.into_iter().map(|value| value / factor).collect(), vectors);
    }
    let k = matrix.nrows();
    let mut vectors = Mat::zeros(k, k);
    let mut values = faer::Col::<f64>::zeros(k);
    let scratch = evd::self_adjoint_evd_scratch::<f64>(
        k,
        ComputeEigenvectors::Yes,
        Par::Seq,
        Default::default(),
    );
    evd::self_adjoint_evd(
        matrix,
        values.as_mut().as_diagonal_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .expect("a finite matrix");
    (values.iter().copied().collect(), vectors)
}

/// Solves A X = B with an LU decomposition; `None` if A is singular or not finite.
pub fn solve_general(a: &Mat<f64>, b: &Mat<f64>) -> Option<Mat<f64>> {
    let n = a.nrows();
    if !a.is_all_finite() {
        return None;
    }
    let (mut factors, mut x) = (a.clone(), b.clone());
    let (mut rows, mut rows_inverse) = (vec![0usize; n], vec![0usize; n]);
    let scratch = lu::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Default::default())
        .or(solve_in_place_scratch::<usize, f64>(n, b.ncols(), Par::Seq));
    let mut buffer = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut buffer);
    let (matrix, settings) = (factors.as_mut(), Default::default());
    let (_, order) =
        lu::lu_in_place(matrix, &mut rows, &mut rows_inverse, Par::Seq, stack, settings);
    if (0..n).any(|k| factors[(k, k)] == 0.0 || !factors[(k, k)].is_finite()) {
        return None;
    }
    let factors = factors.as_ref();
    solve_in_place(factors, factors, order, x.as_mut(), Par::Seq, stack);
    Some(x)
}

/// Thin singular value decomposition U diag(values) Vᵀ, values descending.
pub struct Svd {
    /// Left singular vectors, `[rows, values]`.
    pub u: Mat<f64>,
    /// Singular values, descending.
    pub values: Vec<f64>,
    /// Right singular vectors, `[columns, values]`.
    pub v: Mat<f64>,
}

impl Svd {
    /// # Panics
    /// If an entry is not finite.
    pub fn new(matrix: MatRef<'_, f64>) -> Self {
        assert!(matrix.is_all_finite(), "a finite matrix");
        let factor = range_factor(matrix);
        if factor != 1.0 {
            let scaled = Self::new((matrix * faer::Scale(factor)).as_ref());
            return Self {
                values: scaled.values.iter().map(|value| value / factor).collect(),
                ..scaled
            };
        }
        let (rows, columns) = (matrix.nrows(), matrix.ncols());
        let size = rows.min(columns);
        let mut u = Mat::zeros(rows, size);
        let mut v = Mat::zeros(columns, size);
        let mut values = faer::Col::<f64>::zeros(size);
        let thin = ComputeSvdVectors::Thin;
        let scratch =
            svd::svd_scratch::<f64>(rows, columns, thin, thin, Par::Seq, Default::default());
        svd::svd(
            matrix,
            values.as_mut().as_diagonal_mut(),
            Some(u.as_mut()),
            Some(v.as_mut()),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            Default::default(),
        )
        .expect("a finite matrix");
        Self { u, values: values.iter().copied().collect(), v }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "a finite matrix")]
    fn infinity_has_no_singular_values() {
        Svd::new(Mat::full(2, 2, f64::INFINITY).as_ref());
    }

    #[test]
    #[should_panic(expected = "a finite matrix")]
    fn infinity_has_no_eigenvalues() {
        symmetric_eigen(Mat::full(2, 2, f64::INFINITY).as_ref());
    }

    fn table(i: usize, j: usize) -> f64 {
        (1.7 * (3 * i + j) as f64 + 0.3).sin() + if i == j { 2.0 } else { 0.0 }
    }

    #[test]
    fn general_systems_are_solved_and_singular_ones_told() {
        for n in 1..=20 {
            let (a, x) = (Mat::from_fn(n, n, table), Mat::from_fn(n, 3, |i, j| table(j, i)));
            let found = solve_general(&a, &(&a * &x)).expect("regular");
            assert!((found - x).norm_max() < 1e-10, "{n}");
        }
        // Pivots are needed: the first is zero.
        let swap = Mat::from_fn(2, 2, |i, j| if i == j { 0.0 } else { 1.0 });
        let found = solve_general(&swap, &Mat::from_fn(2, 1, |i, _| i as f64 + 1.0))
            .expect("a permutation");
        assert_eq!([found[(0, 0)], found[(1, 0)]], [2.0, 1.0]);
        let right = Mat::from_fn(3, 1, |i, _| i as f64);
        assert!(solve_general(&Mat::zeros(3, 3), &right).is_none());
        assert!(solve_general(&Mat::from_fn(3, 3, |i, _| i as f64), &right).is_none());
        assert!(
            solve_general(
                &Mat::from_fn(3, 3, |i, j| table(i, j) / f64::from(u8::from(i != 1))),
                &right
            )
            .is_none()
        );
    }

    #[test]
    fn numbers_of_any_size_have_singular_and_eigenvalues() {
        let plain = Mat::from_fn(4, 4, |i, j| table(i.min(j), i.max(j)));
        let (values, singular) =
            (symmetric_eigen(plain.as_ref()).0, Svd::new(plain.as_ref()).values);
        for size in [f64::MIN_POSITIVE, 1e-200, 1e200, 1e307] {
            let scaled = Mat::from_fn(4, 4, |i, j| size * plain[(i, j)]);
            for (found, expected) in symmetric_eigen(scaled.as_ref()).0.iter().zip(&values) {
                assert!(
                    (found / size - expected).abs() < 1e-13 * values[3],
                    "{size}: {found} {expected}"
                );
            }
            for (found, expected) in Svd::new(scaled.as_ref()).values.iter().zip(&singular) {
                assert!(
                    (found / size - expected).abs() < 1e-13 * singular[0],
                    "{size}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn what_dependent_columns_leave_of_the_last_one_is_in_its_last_entry() {
        let (a, b) = (|i: usize| (0.7 * i as f64).sin(), |i: usize| (1.3 * i as f64).cos());
        let row = |i: usize| [a(i), 0.0, 2.0 * a(i), b(i), a(i) - b(i), 1.0 + 0.1 * i as f64];
        let r = triangle(Mat::from_fn(9, 6, |i, j| row(i)[j]).as_ref());
        let alone = triangle(Mat::from_fn(9, 3, |i, j| [a(i), b(i), row(i)[5]][j]).as_ref());
        assert!((r[(5, 5)] / alone[(2, 2)] - 1.0).abs() < 1e-13, "{} {}", r[(5, 5)], alone[(2, 2)]);
        for dependent in [1, 2, 4] {
            assert!((dependent..6).all(|j| r[(dependent, j)].abs() < 1e-14), "{dependent}");
        }
        for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
            let gram: f64 = (0..9).map(|k| row(k)[i] * row(k)[j]).sum();
            let found: f64 = (0..6).map(|k| r[(k, i)] * r[(k, j)]).sum();
            assert!((found - gram).abs() < 1e-13, "{i} {j}: {found} {gram}");
        }
    }
}
