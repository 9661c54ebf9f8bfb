//! The triangular factor of a tall matrix of which only a few rows are ever in memory.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::qr::no_pivoting::factor as qr;
use faer::{Accum, Mat, MatRef, Par, Side, prelude::*};

/// Upper triangular R with RᵀR = WᵀW for the rows of W seen so far.
///
/// Everything that least squares needs of W is in R: sums of squares, residuals, singular values. R is k x k, however
/// many rows there were.
///
/// The rows are collected in blocks. A Householder QR of the first block gives a first factor P; from then on the
/// Gram matrix of W P⁻¹ is summed, whose condition number is small whatever W's is, and R = chol(Gram) P. So the work is
/// matrix multiplication, several times as fast as a Householder QR of a tall block, and the result is as accurate: the
/// error grows with the condition number, not with its square. P is renewed after 1, 2, 4, 8, ... blocks, so that a log
/// that begins at rest is no worse.
///
/// Source: T. Fukaya, R. Kannan, Y. Nakatsukasa, Y. Yamamoto, Y. Yanagisawa, Shifted Cholesky QR for computing the QR
/// factorization of ill-conditioned matrices, SIAM J. Sci. Comput. 42(1) (2020), for the principle of the two steps.
#[derive(Clone, Debug)]
pub struct TriangularFactor {
    columns: usize,
    rows: usize,
    /// Rows waiting, row-major.
    pending: Vec<f64>,
    stage: Option<Stage>,
    blocks: usize,
}

/// The first factor and what is summed relative to it.
#[derive(Clone, Debug)]
struct Stage {
    first: Mat<f64>,
    first_inverse: Mat<f64>,
    gram: Mat<f64>,
    product: Mat<f64>,
}

/// Rows per block: enough that the matrix products dominate, few enough for the second-level cache.
const BLOCK: usize = 1024;

impl TriangularFactor {
    /// The factor of a matrix of `columns` columns without rows.
    pub fn new(columns: usize) -> Self {
        Self { columns, rows: 0, pending: Vec::with_capacity(BLOCK * columns), stage: None, blocks: 0 }
    }

    /// Number of columns k.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows seen.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it does not have one number per column.
    pub fn push(&mut self, row: &[f64]) {
        assert_eq!(row.len(), self.columns, "one number per column");
        self.pending.extend_from_slice(row);
        self.rows += 1;
        if self.pending.len() == BLOCK * self.columns {
            self.absorb();
        }
    }

    /// Adds all rows of another factor's matrix.
    ///
    /// # Panics
    /// If the matrices differ in width.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.columns, other.columns, "matrices of one width");
        let factor = other.factor();
        let rows = self.rows;
        for i in 0..factor.nrows() {
            self.push(&(0..self.columns).map(|j| factor[(i, j)]).collect::<Vec<_>>());
        }
        self.rows = rows + other.rows;
    }

    /// The factor R, `[k, k]`, upper triangular with a non-negative diagonal.
    pub fn factor(&self) -> Mat<f64> {
        let mut complete = self.clone();
        complete.absorb();
        match &complete.stage {
            None => Mat::zeros(self.columns, self.columns),
            Some(stage) => stage.factor(),
        }
    }

    fn absorb(&mut self) {
        let rows = self.pending.len() / self.columns.max(1);
        if rows == 0 {
            return;
        }
        let block = MatRef::from_row_major_slice(&self.pending, rows, self.columns);
        let stage = self.stage.get_or_insert_with(|| Stage::new(block));
        stage.absorb(block);
        self.blocks += 1;
        if self.blocks.is_power_of_two() {
            let factor = stage.factor();
            *stage = Stage::new(factor.as_ref());
            stage.absorb(factor.as_ref());
        }
        self.pending.clear();
    }
}

impl Stage {
    fn new(block: MatRef<'_, f64>) -> Self {
        let k = block.ncols();
        // A diagonal below the block makes the factor invertible whatever the block excites (the shift of the source).
        let shift = |j: usize| match block.col(j).norm_l2() {
            0.0 => 1.0,
            norm => 1e-7 * norm,
        };
        let rows = block.nrows();
        let shifted = Mat::from_fn(rows + k, k, |i, j| match i.checked_sub(rows) {
            None => block[(i, j)],
            Some(i) if i == j => shift(j),
            Some(_) => 0.0,
        });
        let first = triangle(shifted.as_ref());
        let mut first_inverse = Mat::<f64>::identity(k, k);
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(
            first.as_ref(),
            first_inverse.as_mut(),
            Par::Seq,
        );
        Self { first, first_inverse, gram: Mat::zeros(k, k), product: Mat::zeros(BLOCK.max(block.nrows()), k) }
    }

    fn absorb(&mut self, block: MatRef<'_, f64>) {
        use BlockStructure::{Rectangular, TriangularLower, TriangularUpper};
        let mut product = self.product.as_mut().subrows_mut(0, block.nrows());
        matmul(
            product.rb_mut(),
            Rectangular,
            Accum::Replace,
            block,
            Rectangular,
            self.first_inverse.as_ref(),
            TriangularUpper,
            1.0,
            Par::Seq,
        );
        matmul(
            self.gram.as_mut(),
            TriangularLower,
            Accum::Add,
            product.rb().transpose(),
            Rectangular,
            product.rb(),
            Rectangular,
            1.0,
            Par::Seq,
        );
    }

    fn factor(&self) -> Mat<f64> {
        let root = match self.gram.llt(Side::Lower) {
            Ok(cholesky) => cholesky.L().transpose().to_owned(),
            // Rank deficient: a square root that is not triangular does as well, since a QR follows.
            Err(_) => {
                let eigen = self.gram.self_adjoint_eigen(Side::Lower).expect("a symmetric finite matrix");
                let (values, vectors) = (eigen.S(), eigen.U());
                let k = vectors.nrows();
                let noise = 1e-13 * values[k - 1];
                let root = |value: f64| if value > noise { value.sqrt() } else { 0.0 };
                Mat::from_fn(k, k, |i, j| root(values[i]) * vectors[(j, i)])
            }
        };
        triangle((root * &self.first).as_ref())
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of very different size, two of them nearly parallel.
    fn row(i: usize) -> Vec<f64> {
        let t = i as f64 * 0.37;
        let a = t.sin();
        vec![1e3 * a, 1e-3 * (1.3 * t).cos(), 1e3 * a + 1e-2 * (2.1 * t).sin(), 1.0, (0.7 * t).sin() * a]
    }

    fn householder(rows: std::ops::Range<usize>) -> Mat<f64> {
        let rows: Vec<Vec<f64>> = rows.map(row).collect();
        triangle(Mat::from_fn(rows.len(), 5, |i, j| rows[i][j]).as_ref())
    }

    fn relative_error(found: &Mat<f64>, expected: &Mat<f64>) -> f64 {
        let scale = |j: usize| expected.col(j).norm_l2();
        (0..5).map(|j| (found.col(j) - expected.col(j)).norm_l2() / scale(j)).fold(0.0, f64::max)
    }

    #[test]
    fn agrees_with_a_householder_qr_of_all_rows_at_once() {
        for count in [3, 5, 700, 1024, 5000] {
            let mut factor = TriangularFactor::new(5);
            (0..count).for_each(|i| factor.push(&row(i)));
            assert_eq!(factor.rows(), count);
            let error = relative_error(&factor.factor(), &householder(0..count));
            // With no more rows than columns the factor rests on the shift, a 1e-7 of the columns.
            let tolerance = if count <= 5 { 1e-9 } else { 1e-12 };
            assert!(error < tolerance, "{count} rows: {error:e}");
        }
    }

    #[test]
    fn small_singular_values_survive_where_normal_equations_lose_them() {
        // Columns 0 and 2 differ by 1e-5 of their size: WᵀW would leave 6 digits of the difference, R has 11.
        let mut factor = TriangularFactor::new(5);
        (0..5000).for_each(|i| factor.push(&row(i)));
        let (found, expected) = (factor.factor(), householder(0..5000));
        let error = (found[(2, 2)] / expected[(2, 2)] - 1.0).abs();
        assert!(error < 1e-10, "{error:e}");
    }

    #[test]
    fn a_start_without_motion_does_no_harm() {
        let mut factor = TriangularFactor::new(5);
        let rest = [0.0, 0.0, 0.0, 1.0, 0.0];
        (0..2000).for_each(|_| factor.push(&rest));
        (0..3000).for_each(|i| factor.push(&row(i)));
        let moving = householder(0..3000);
        let mut rows: Vec<Vec<f64>> = (0..5).map(|i| (0..5).map(|j| moving[(i, j)]).collect()).collect();
        rows.push(rest.iter().map(|x| x * 2000f64.sqrt()).collect());
        let expected = triangle(Mat::from_fn(6, 5, |i, j| rows[i][j]).as_ref());
        let error = relative_error(&factor.factor(), &expected);
        assert!(error < 1e-10, "{error:e}");
    }

    #[test]
    fn merging_is_as_good_as_adding_all_rows() {
        let (mut first, mut second) = (TriangularFactor::new(5), TriangularFactor::new(5));
        (0..1500).for_each(|i| first.push(&row(i)));
        (1500..4000).for_each(|i| second.push(&row(i)));
        first.merge(&second);
        assert_eq!(first.rows(), 4000);
        let error = relative_error(&first.factor(), &householder(0..4000));
        assert!(error < 1e-12, "{error:e}");
    }

    #[test]
    fn a_column_of_zeros_stays_one() {
        let mut factor = TriangularFactor::new(3);
        let (mut squares, mut sum) = (0.0, 0.0);
        for i in 0..3000 {
            let x = f64::from(i).sin();
            factor.push(&[x, 0.0, 1.0]);
            (squares, sum) = (squares + x * x, sum + x);
        }
        let r = factor.factor();
        let gram = r.transpose() * &r;
        let expected = [[squares, 0.0, sum], [0.0; 3], [sum, 0.0, 3000.0]];
        for (i, row) in expected.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((gram[(i, j)] - value).abs() < 1e-9, "{i} {j}");
            }
        }
    }
}
