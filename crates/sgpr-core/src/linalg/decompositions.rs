//! faer's decompositions on one thread: the matrices here are small, and waking other threads costs more than the work.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::evd::{self, ComputeEigenvectors};
use faer::linalg::qr::no_pivoting::factor as qr;
use faer::linalg::svd::{self, ComputeSvdVectors};
use faer::{Mat, MatRef, Par};

/// Upper triangular factor of a Householder QR, diagonal non-negative, `[k, k]` also for fewer rows than columns.
pub(crate) fn triangle(matrix: MatRef<'_, f64>) -> Mat<f64> {
    let k = matrix.ncols();
    let rows = matrix.nrows().max(k);
    let mut work = Mat::zeros(rows, k);
    work.as_mut().subrows_mut(0, matrix.nrows()).copy_from(matrix);
    let size = qr::recommended_block_size::<f64>(rows, k);
    let mut householder = Mat::zeros(size, k);
    let mut buffer = MemBuffer::new(qr::qr_in_place_scratch::<f64>(rows, k, size, Par::Seq, Default::default()));
    qr::qr_in_place(work.as_mut(), householder.as_mut(), Par::Seq, MemStack::new(&mut buffer), Default::default());
    let sign = |i: usize| if work[(i, i)] < 0.0 { -1.0 } else { 1.0 };
    Mat::from_fn(k, k, |i, j| if i <= j { sign(i) * work[(i, j)] } else { 0.0 })
}

/// Upper triangular R with RᵀR = matrix, of which the lower triangle is read; `None` if it is not positive definite.
pub(crate) fn cholesky(matrix: MatRef<'_, f64>) -> Option<Mat<f64>> {
    let k = matrix.nrows();
    let mut work = matrix.to_owned();
    let mut buffer = MemBuffer::new(llt::cholesky_in_place_scratch::<f64>(k, Par::Seq, Default::default()));
    llt::cholesky_in_place(work.as_mut(), Default::default(), Par::Seq, MemStack::new(&mut buffer), Default::default())
        .ok()?;
    Some(Mat::from_fn(k, k, |i, j| if i <= j { work[(j, i)] } else { 0.0 }))
}

/// Eigenvalues, ascending, and eigenvectors of a symmetric matrix, of which the lower triangle is read.
pub(crate) fn symmetric_eigen(matrix: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let k = matrix.nrows();
    let mut vectors = Mat::zeros(k, k);
    let mut values = faer::Col::<f64>::zeros(k);
    let scratch = evd::self_adjoint_evd_scratch::<f64>(k, ComputeEigenvectors::Yes, Par::Seq, Default::default());
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

/// Solves A X = B by elimination with row exchanges; `None` if A is singular. For matrices of base parameters' size.
pub(crate) fn solve_general(a: &Mat<f64>, b: &Mat<f64>) -> Option<Mat<f64>> {
    let n = a.nrows();
    let (mut a, mut x) = (a.clone(), b.clone());
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[(i, k)].abs().total_cmp(&a[(j, k)].abs()))?;
        if a[(pivot, k)].is_nan() || a[(pivot, k)] == 0.0 {
            return None;
        }
        for matrix in [&mut a, &mut x] {
            for j in 0..matrix.ncols() {
                let kept = matrix[(k, j)];
                matrix[(k, j)] = matrix[(pivot, j)];
                matrix[(pivot, j)] = kept;
            }
        }
        for i in k + 1..n {
            let factor = a[(i, k)] / a[(k, k)];
            if factor != 0.0 {
                (k..n).for_each(|j| a[(i, j)] -= factor * a[(k, j)]);
                (0..x.ncols()).for_each(|j| x[(i, j)] -= factor * x[(k, j)]);
            }
        }
    }
    for j in 0..x.ncols() {
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| a[(i, k)] * x[(k, j)]).sum();
            x[(i, j)] = (x[(i, j)] - known) / a[(i, i)];
        }
    }
    Some(x)
}

/// Thin singular value decomposition U diag(values) Vᵀ, values descending.
pub(crate) struct Svd {
    pub u: Mat<f64>,
    pub values: Vec<f64>,
    pub v: Mat<f64>,
}

impl Svd {
    pub fn new(matrix: MatRef<'_, f64>) -> Self {
        let (rows, columns) = (matrix.nrows(), matrix.ncols());
        let size = rows.min(columns);
        let mut u = Mat::zeros(rows, size);
        let mut v = Mat::zeros(columns, size);
        let mut values = faer::Col::<f64>::zeros(size);
        let thin = ComputeSvdVectors::Thin;
        let scratch = svd::svd_scratch::<f64>(rows, columns, thin, thin, Par::Seq, Default::default());
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
