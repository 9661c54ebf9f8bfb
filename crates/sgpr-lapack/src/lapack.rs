//! Factorisations of small matrices, stored by columns, `ld` numbers from one column to the next.

use std::cmp::Ordering;

use crate::Real;
use crate::blas::{Triangle, View};

/// Sweeps of Jacobi's method; it converges quadratically, in six to ten.
const SWEEPS: usize = 60;

/// The matrix has no such factor; counted from one, as LAPACK's `info`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoFactor(pub usize);

/// Cholesky factor in place: L Lᵀ = A in the lower or UᵀU = A in the upper triangle.
///
/// # Errors
/// With the order of the first leading minor that is not positive.
pub fn potrf<T: Real>(
    triangle: Triangle,
    n: usize,
    a: &mut [T],
    lda: usize,
) -> Result<(), NoFactor> {
    // Entry (i, j) of L, j <= i.
    let at =
        |i: usize, j: usize| if triangle == Triangle::Lower { i + j * lda } else { j + i * lda };
    for j in 0..n {
        for i in j..n {
            let mut rest = a[at(i, j)];
            for k in 0..j {
                rest -= a[at(i, k)] * a[at(j, k)];
            }
            if i > j {
                a[at(i, j)] = rest / a[at(j, j)];
            } else if rest > T::ZERO && rest.is_finite() {
                a[at(j, j)] = rest.sqrt();
            } else {
                return Err(NoFactor(j + 1));
            }
        }
    }
    Ok(())
}

/// Solves A X = B in place of B from the factor of [`potrf`], B `[n, columns]`.
pub fn potrs<T: Real>(
    triangle: Triangle,
    n: usize,
    columns: usize,
    a: View<'_, T>,
    b: &mut [T],
    ldb: usize,
) {
    let factor = |i: usize, j: usize| a.symmetric(triangle, i, j);
    for column in 0..columns {
        let b = &mut b[column * ldb..][..n];
        for i in 0..n {
            for k in 0..i {
                let known = b[k];
                b[i] -= factor(i, k) * known;
            }
            b[i] /= factor(i, i);
        }
        for i in (0..n).rev() {
            for k in i + 1..n {
                let known = b[k];
                b[i] -= factor(k, i) * known;
            }
            b[i] /= factor(i, i);
        }
    }
}

/// Solves A X = B in place of B, B `[n, columns]`; A becomes its factors with unit L below the
/// diagonal, `pivots` the rows exchanged, counted from one.
///
/// # Errors
/// With the first pivot that is zero.
pub fn gesv<T: Real>(
    n: usize,
    columns: usize,
    a: &mut [T],
    lda: usize,
    pivots: &mut [i32],
    b: &mut [T],
    ldb: usize,
) -> Result<(), NoFactor> {
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if a[i + k * lda].abs() > a[pivot + k * lda].abs() {
                pivot = i;
            }
        }
        pivots[k] = pivot as i32 + 1;
        if a[pivot + k * lda] == T::ZERO {
            return Err(NoFactor(k + 1));
        }
        (0..n).for_each(|j| a.swap(k + j * lda, pivot + j * lda));
        (0..columns).for_each(|j| b.swap(k + j * ldb, pivot + j * ldb));
        for i in k + 1..n {
            let factor = a[i + k * lda] / a[k + k * lda];
            a[i + k * lda] = factor;
            for j in k + 1..n {
                let above = a[k + j * lda];
                a[i + j * lda] -= factor * above;
            }
            for j in 0..columns {
                let above = b[k + j * ldb];
                b[i + j * ldb] -= factor * above;
            }
        }
    }
    for j in 0..columns {
        for i in (0..n).rev() {
            for k in i + 1..n {
                let known = b[k + j * ldb];
                b[i + j * ldb] -= a[i + k * lda] * known;
            }
            b[i + j * ldb] /= a[i + i * lda];
        }
    }
    Ok(())
}

/// cos and sin of the rotation that makes the off-diagonal entry of `[[p, r], [r, q]]` zero.
fn jacobi_rotation<T: Real>(p: T, q: T, r: T) -> (T, T) {
    let two = T::ONE + T::ONE;
    let theta = (q - p) / (two * r);
    let sign = if theta < T::ZERO { -T::ONE } else { T::ONE };
    // The smaller of the two angles; theta² may overflow to infinity, which makes the angle zero as
    // it should.
    let t = sign / (theta.abs() + (theta * theta + T::ONE).sqrt());
    let c = T::ONE / (t * t + T::ONE).sqrt();
    (c, t * c)
}

/// Columns `i` and `j` of a matrix with `rows` rows turned by a rotation.
fn turn<T: Real>(matrix: &mut [T], rows: usize, i: usize, j: usize, (c, s): (T, T)) {
    for k in 0..rows {
        let (x, y) = (matrix[k + i * rows], matrix[k + j * rows]);
        matrix[k + i * rows] = c * x - s * y;
        matrix[k + j * rows] = s * x + c * y;
    }
}

/// Eigenvalues, ascending, and eigenvectors as columns, of a symmetric matrix; `None` if it, or one
/// of them, is not finite.
///
/// Source: G. H. Golub, C. F. Van Loan, Matrix Computations (2013), section 8.5, cyclic Jacobi.
pub fn symmetric_eigen<T: Real>(
    triangle: Triangle,
    n: usize,
    a: View<'_, T>,
) -> Option<(Vec<T>, Vec<T>)> {
    let mut work: Vec<T> = (0..n * n).map(|k| a.symmetric(triangle, k % n, k / n)).collect();
    if work.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let mut vectors = identity::<T>(n);
    for _ in 0..SWEEPS {
        let mut turned = false;
        for i in 0..n {
            for j in i + 1..n {
                let (p, q, r) = (work[i + i * n], work[j + j * n], work[i + j * n]);
                // Against the smaller of the two diagonal entries' geometric mean would lose
                // indefinite matrices.
                if r.abs() <= T::EPSILON * T::EPSILON * (p.abs() + q.abs()) || r == T::ZERO {
                    continue;
                }
                turned = true;
                let rotation = jacobi_rotation(p, q, r);
                turn(&mut work, n, i, j, rotation);
                let (c, s) = rotation;
                for k in 0..n {
                    let (x, y) = (work[i + k * n], work[j + k * n]);
                    work[i + k * n] = c * x - s * y;
                    work[j + k * n] = s * x + c * y;
                }
                // Exactly zero in exact arithmetic; what rounding leaves would be turned again and
                // again.
                work[i + j * n] = T::ZERO;
                work[j + i * n] = T::ZERO;
                turn(&mut vectors, n, i, j, rotation);
            }
        }
        if !turned {
            break;
        }
    }
    // Squares of entries above 1e154 overflow, and what is no number has no order.
    if (0..n).any(|k| !work[k + k * n].is_finite()) {
        return None;
    }
    let mut order: Vec<usize> = (0..n).collect();
    order
        .sort_by(|&i, &j| work[i + i * n].partial_cmp(&work[j + j * n]).unwrap_or(Ordering::Equal));
    let values: Vec<T> = order.iter().map(|&k| work[k + k * n]).collect();
    Some((values, order.iter().flat_map(|&k| vectors[k * n..(k + 1) * n].to_vec()).collect()))
}

/// Thin singular value decomposition A = U diag(values) Vᵀ.
#[derive(Clone, Debug)]
pub struct Svd<T> {
    /// `[m, k]`, k = min(m, n).
    pub u: Vec<T>,
    /// Descending, `[k]`.
    pub values: Vec<T>,
    /// `[k, n]`.
    pub vt: Vec<T>,
}

/// Singular values and vectors of a matrix `[m, n]`; `None` if it is not finite.
///
/// Source: J. Demmel, K. Veselić, Jacobi's method is more accurate than QR, SIAM J. Matrix Anal.
/// Appl. 13(4) (1992), one-sided Jacobi.
pub fn svd<T: Real>(m: usize, n: usize, a: View<'_, T>) -> Option<Svd<T>> {
    if m < n {
        // The transpose: its right vectors are our left ones.
        let transposed: Vec<T> = (0..m * n).map(|k| a.at(k / n, k % n)).collect();
        let Svd { u, values, vt } = svd(n, m, View::plain(&transposed, n))?;
        let turned = |matrix: &[T], rows: usize| -> Vec<T> {
            let columns = matrix.len() / rows.max(1);
            (0..matrix.len()).map(|k| matrix[(k / columns) + (k % columns) * rows]).collect()
        };
        return Some(Svd { u: turned(&vt, m), vt: turned(&u, n), values });
    }
    let mut work: Vec<T> = (0..m * n).map(|k| a.at(k % m, k / m)).collect();
    if work.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let mut v = identity::<T>(n);
    for _ in 0..SWEEPS {
        let mut turned = false;
        for i in 0..n {
            for j in i + 1..n {
                let (x, y) = (&work[i * m..(i + 1) * m], &work[j * m..(j + 1) * m]);
                let (p, q, r) = (dot(x, x), dot(y, y), dot(x, y));
                if r.abs() <= T::EPSILON * (p * q).sqrt() || r == T::ZERO {
                    continue;
                }
                turned = true;
                let rotation = jacobi_rotation(p, q, r);
                turn(&mut work, m, i, j, rotation);
                turn(&mut v, n, i, j, rotation);
            }
        }
        if !turned {
            break;
        }
    }
    let norm = |k: usize| dot(&work[k * m..(k + 1) * m], &work[k * m..(k + 1) * m]).sqrt();
    let mut order: Vec<(T, usize)> = (0..n).map(|k| (norm(k), k)).collect();
    // Squares of entries above 1e154 overflow, and what is no number has no order.
    if order.iter().any(|(value, _)| !value.is_finite()) {
        return None;
    }
    order.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap_or(Ordering::Equal));
    let largest = order.first().map_or(T::ZERO, |(value, _)| *value);
    let mut u: Vec<T> = Vec::with_capacity(m * n);
    let mut vt = vec![T::ZERO; n * n];
    for (row, &(value, k)) in order.iter().enumerate() {
        let column = &work[k * m..(k + 1) * m];
        if value > T::EPSILON * T::EPSILON * largest {
            u.extend(column.iter().map(|x| *x / value));
        } else {
            let other = orthonormal(&u, m);
            u.extend(other);
        }
        (0..n).for_each(|j| vt[row + j * n] = v[j + k * n]);
    }
    Some(Svd { u, values: order.into_iter().map(|(value, _)| value).collect(), vt })
}

fn dot<T: Real>(x: &[T], y: &[T]) -> T {
    let mut sum = T::ZERO;
    for (x, y) in x.iter().zip(y) {
        sum += *x * *y;
    }
    sum
}

fn identity<T: Real>(n: usize) -> Vec<T> {
    (0..n * n).map(|k| if k % n == k / n { T::ONE } else { T::ZERO }).collect()
}

/// A unit vector orthogonal to the columns of `basis`, of which there are fewer than `m`.
fn orthonormal<T: Real>(basis: &[T], m: usize) -> Vec<T> {
    let rest = |axis: usize| {
        let mut vector = vec![T::ZERO; m];
        vector[axis] = T::ONE;
        for _ in 0..2 {
            for column in basis.chunks_exact(m) {
                let along = dot(&vector, column);
                vector.iter_mut().zip(column).for_each(|(v, c)| *v -= along * *c);
            }
        }
        vector
    };
    let candidates = (0..m).map(rest).map(|vector| (dot(&vector, &vector), vector));
    let (square, vector) = candidates
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .expect("a matrix with columns has rows");
    vector.into_iter().map(|x| x / square.sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blas::Op;

    /// Numbers in [-1, 1), the same in every run.
    fn numbers(count: usize, seed: usize) -> Vec<f64> {
        (0..count)
            .map(|k| (((k + 17 * seed) as f64 * 12.9898).sin() * 43_758.545).fract())
            .collect()
    }

    fn product(a: &[f64], b: &[f64], m: usize, k: usize, n: usize) -> Vec<f64> {
        (0..m * n).map(|e| (0..k).map(|l| a[e % m + l * m] * b[l + (e / m) * k]).sum()).collect()
    }

    fn transposed(a: &[f64], m: usize, n: usize) -> Vec<f64> {
        (0..m * n).map(|e| a[e / n + (e % n) * m]).collect()
    }

    fn assert_close(a: &[f64], b: &[f64], tolerance: f64) {
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= tolerance, "{a} {b}");
        }
    }

    #[test]
    fn eigenvectors_are_orthonormal_and_make_the_matrix() {
        for n in 1..=9 {
            let half = numbers(n * n, n);
            let matrix: Vec<f64> =
                (0..n * n).map(|k| half[k] + half[k / n + (k % n) * n]).collect();
            for triangle in [Triangle::Upper, Triangle::Lower] {
                let (values, vectors) =
                    symmetric_eigen(triangle, n, View::plain(&matrix, n)).expect("finite");
                assert!(values.is_sorted());
                let gram = product(&transposed(&vectors, n, n), &vectors, n, n, n);
                assert_close(&gram, &identity::<f64>(n), 1e-14);
                let scaled: Vec<f64> = (0..n * n).map(|k| vectors[k] * values[k / n]).collect();
                assert_close(
                    &product(&scaled, &transposed(&vectors, n, n), n, n, n),
                    &matrix,
                    1e-13,
                );
            }
        }
    }

    #[test]
    fn singular_vectors_are_orthonormal_and_make_the_matrix() {
        for (m, n) in [(1, 1), (4, 4), (8, 8), (7, 3), (3, 7), (1, 5)] {
            for rank_one in [false, true] {
                let mut matrix = numbers(m * n, m + n);
                if rank_one {
                    let (x, y) = (numbers(m, 1), numbers(n, 2));
                    matrix = (0..m * n).map(|e| x[e % m] * y[e / m]).collect();
                }
                let Svd { u, values, vt } = svd(m, n, View::plain(&matrix, m)).expect("finite");
                let k = m.min(n);
                assert_eq!((u.len(), values.len(), vt.len()), (m * k, k, k * n));
                assert!(values.iter().rev().is_sorted() && values.iter().all(|v| *v >= 0.0));
                assert_close(
                    &product(&transposed(&u, m, k), &u, k, m, k),
                    &identity::<f64>(k),
                    1e-13,
                );
                assert_close(
                    &product(&vt, &transposed(&vt, k, n), k, n, k),
                    &identity::<f64>(k),
                    1e-13,
                );
                let scaled: Vec<f64> = (0..m * k).map(|e| u[e] * values[e / m]).collect();
                assert_close(&product(&scaled, &vt, m, k, n), &matrix, 1e-13);
            }
        }
    }

    #[test]
    fn tiny_eigenvalues_of_a_scaled_definite_matrix_keep_their_digits() {
        // D A D with A well conditioned: Jacobi gets every eigenvalue to full relative accuracy, QR
        // the large ones only.
        let scale = [1.0, 1e-4, 1e-8, 1e-12];
        let matrix: Vec<f64> = (0..16)
            .map(|k| scale[k % 4] * scale[k / 4] * if k % 4 == k / 4 { 1.0 } else { 0.3 })
            .collect();
        let (values, _) =
            symmetric_eigen(Triangle::Upper, 4, View::plain(&matrix, 4)).expect("finite");
        // To first order the smallest one is the Schur complement of the others: (1 - 0.3² * 3 /
        // 1.6) scale².
        let expected = 1e-24 * (1.0 - 0.09 * 3.0 / 1.6);
        assert!((values[0] / expected - 1.0).abs() < 1e-6, "{:e} {expected:e}", values[0]);
    }

    #[test]
    fn factors_solve_their_systems() {
        for n in 1..=8 {
            let half = numbers(n * n, n);
            let mut definite = product(&half, &transposed(&half, n, n), n, n, n);
            (0..n).for_each(|k| definite[k * (n + 1)] += 1.0);
            let x = numbers(3 * n, 5);
            let b = product(&definite, &x, n, n, 3);
            for triangle in [Triangle::Upper, Triangle::Lower] {
                let (mut factor, mut solution) = (definite.clone(), b.clone());
                potrf(triangle, n, &mut factor, n).expect("definite");
                potrs(triangle, n, 3, View::plain(&factor, n), &mut solution, n);
                assert_close(&solution, &x, 1e-12);
            }
            let (mut general, mut solution) = (half.clone(), product(&half, &x, n, n, 3));
            gesv(n, 3, &mut general, n, &mut vec![0; n], &mut solution, n).expect("regular");
            assert_close(&solution, &x, 1e-10);
        }
    }

    #[test]
    fn matrices_without_a_factor_say_where() {
        let mut indefinite = [1.0, 0.0, 0.0, -1.0];
        assert_eq!(potrf(Triangle::Lower, 2, &mut indefinite, 2), Err(NoFactor(2)));
        let mut nan = [f64::NAN];
        assert_eq!(potrf(Triangle::Lower, 1, &mut nan, 1), Err(NoFactor(1)));
        let mut singular = [1.0, 2.0, 2.0, 4.0];
        assert_eq!(gesv(2, 1, &mut singular, 2, &mut [0; 2], &mut [1.0, 1.0], 2), Err(NoFactor(2)));
        assert!(symmetric_eigen(Triangle::Upper, 1, View::plain(&nan, 1)).is_none());
        let large = [1e200, 1.0, 1.0, 1e200];
        assert!(svd(2, 2, View::plain(&large, 2)).is_none());
        let overflowing = [1e300, 1e308, 1e308, -1e308];
        if let Some((values, _)) = symmetric_eigen(Triangle::Upper, 2, View::plain(&overflowing, 2))
        {
            assert!(values.is_sorted());
        }
        assert!(svd(1, 1, View { data: &nan, ld: 1, op: Op::Plain }).is_none());
    }
}
