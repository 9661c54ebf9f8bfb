//! The triangular factor of a tall matrix of which only a few rows are ever in memory.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, MatRef, Par, prelude::*};

use super::Matrix;
use super::decompositions::{cholesky, symmetric_eigen, triangle};

/// Upper triangular R with RᵀR = WᵀW for the rows of W seen so far.
///
/// Everything that least squares needs of W is in R: sums of squares, residuals, singular values. R
/// is k x k, however many rows there were.
///
/// The rows are collected in blocks. The Cholesky factor of the first block's Gram matrix, slightly
/// shifted so that rounding is not blown up where the block says nothing, gives a first factor P;
/// from then on the Gram matrix of W P⁻¹ is summed, whose condition number is small whatever W's
/// is, and R = chol(Gram) P. So the work is matrix multiplication, several times as fast as a
/// Householder QR of a tall block, and the result is as accurate: the error grows with the
/// condition number, not with its square. A block that moves in ways of which P knows nothing,
/// after a log's start at rest say, goes through a Householder QR, and P is renewed.
///
/// Source: T. Fukaya, R. Kannan, Y. Nakatsukasa, Y. Yamamoto, Y. Yanagisawa, Shifted Cholesky QR
/// for computing the QR factorization of ill-conditioned matrices, SIAM J. Sci. Comput. 42(1)
/// (2020), for the principle of the two steps.
#[derive(Clone, Debug)]
pub struct TriangularFactor {
    columns: usize,
    rows: usize,
    /// Rows waiting, row-major.
    pending: Vec<f64>,
    stage: Option<BlockStage>,
}

/// A factor P, its inverse, and the Gram matrix of all rows times that inverse.
#[derive(Clone, Debug)]
struct BlockStage {
    first: Mat<f64>,
    inverse: Mat<f64>,
    gram: Mat<f64>,
    product: Mat<f64>,
}

impl TriangularFactor {
    /// Rows per block: enough that the matrix products dominate, few enough for the second-level
    /// cache.
    pub const BLOCK: usize = 512;

    /// The factor of a matrix of `columns` columns without rows.
    pub fn new(columns: usize) -> Self {
        Self { columns, rows: 0, pending: Vec::with_capacity(Self::BLOCK * columns), stage: None }
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
        if self.pending.len() == Self::BLOCK * self.columns {
            self.absorb();
        }
    }

    /// Adds many rows, row-major; blocks without copying them where none waits, the last one too if
    /// it is worth a product.
    ///
    /// # Panics
    /// If they are no whole rows.
    pub fn push_all(&mut self, mut rows: &[f64]) {
        /// Rows of a block that is worth a product.
        const WORTH: usize = 128;
        assert!(rows.len().is_multiple_of(self.columns), "one number per column");
        while !rows.is_empty() {
            let count = rows.len() / self.columns;
            let taken = count.min(Self::BLOCK - self.pending.len() / self.columns);
            let (block, rest) = rows.split_at(taken * self.columns);
            rows = rest;
            self.rows += taken;
            // The first block has as many rows as it can have: its factor is for all that follow.
            let enough = if self.stage.is_some() { WORTH } else { Self::BLOCK };
            if self.pending.is_empty() && taken >= enough {
                self.absorb_rows(block);
                continue;
            }
            self.pending.extend_from_slice(block);
            if self.pending.len() == Self::BLOCK * self.columns {
                self.absorb();
            }
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
    pub fn factor(&self) -> Matrix {
        let mut complete = self.clone();
        complete.absorb();
        complete
            .stage
            .map_or_else(|| Mat::zeros(self.columns, self.columns), |stage| stage.factor())
            .into()
    }

    fn absorb(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        self.absorb_rows(&pending);
        self.pending = pending;
        self.pending.clear();
    }

    fn absorb_rows(&mut self, rows: &[f64]) {
        if rows.is_empty() {
            return;
        }
        let block = MatRef::from_row_major_slice(rows, rows.len() / self.columns, self.columns);
        self.stage.get_or_insert_with(|| BlockStage::of_block(block)).absorb(block);
    }
}

/// Share of the columns' length by which a factor is shifted: the square root of what rounding does
/// to a Gram matrix.
const SHIFT: f64 = 1e-7;

/// Rows times P⁻¹ that are longer than this come from motion of which P knows nothing.
const STRANGE: f64 = 30.0;

impl BlockStage {
    /// No rows yet, P from a block.
    fn of_block(block: MatRef<'_, f64>) -> Self {
        let k = block.ncols();
        let mut gram = Mat::zeros(k, k);
        add_gram(&mut gram, block);
        let (mut scaled, lengths) = equilibrated(&gram);
        for j in 0..k {
            scaled[(j, j)] = 1.0 + k as f64 * SHIFT.powi(2);
        }
        let root = cholesky(scaled.as_ref()).expect("the shift exceeds the rounding");
        Self::with_factor(columns_times(&root, &lengths))
    }

    /// The rows of an upper triangular factor, as they are and as P.
    fn of_factor(factor: &Mat<f64>) -> Self {
        let k = factor.ncols();
        // What filters leave of something far away is no column that others can be measured by.
        let length = |j: usize| {
            let length = factor.col(j).norm_l2();
            if length * length > EMPTY { length } else { 0.0 }
        };
        if (0..k).all(|j| length(j) > 0.0 && factor[(j, j)] > SHIFT * length(j)) {
            let mut stage = Self::with_factor(factor.clone());
            stage.gram = Mat::identity(k, k);
            return stage;
        }
        let shift = |j: usize| if length(j) > 0.0 { SHIFT * length(j) } else { 1.0 };
        let shifted = Mat::from_fn(2 * k, k, |i, j| match i.checked_sub(k) {
            None => factor[(i, j)],
            Some(i) if i == j => shift(j),
            Some(_) => 0.0,
        });
        let mut stage = Self::with_factor(triangle(shifted.as_ref()));
        stage.add(factor.as_ref());
        stage
    }

    fn with_factor(first: Mat<f64>) -> Self {
        let k = first.ncols();
        let mut inverse = Mat::<f64>::identity(k, k);
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(
            first.as_ref(),
            inverse.as_mut(),
            Par::Seq,
        );
        Self {
            first,
            inverse,
            gram: Mat::zeros(k, k),
            product: Mat::zeros(TriangularFactor::BLOCK.max(k), k),
        }
    }

    fn absorb(&mut self, block: MatRef<'_, f64>) {
        let before: Vec<f64> = (0..block.ncols()).map(|j| self.gram[(j, j)]).collect();
        let gram = self.gram.clone();
        self.add(block);
        let longest = before
            .iter()
            .enumerate()
            .map(|(j, before)| self.gram[(j, j)] - before)
            .fold(0.0, f64::max);
        if longest > STRANGE.powi(2) {
            self.gram = gram;
            let factor = self.factor();
            let k = factor.ncols();
            let all = Mat::from_fn(k + block.nrows(), k, |i, j| match i.checked_sub(k) {
                None => factor[(i, j)],
                Some(i) => block[(i, j)],
            });
            *self = Self::of_factor(&triangle(all.as_ref()));
        }
    }

    /// Adds the Gram matrix of the rows times P⁻¹.
    fn add(&mut self, rows: MatRef<'_, f64>) {
        let mut product = self.product.as_mut().subrows_mut(0, rows.nrows());
        matmul(
            product.rb_mut(),
            BlockStructure::Rectangular,
            Accum::Replace,
            rows,
            BlockStructure::Rectangular,
            self.inverse.as_ref(),
            BlockStructure::TriangularUpper,
            1.0,
            Par::Seq,
        );
        add_gram(&mut self.gram, product.rb());
    }

    fn factor(&self) -> Mat<f64> {
        let (scaled, lengths) = equilibrated(&self.gram);
        if let Some(root) = cholesky(scaled.as_ref()) {
            return multiply(&columns_times(&root, &lengths), &self.first);
        }
        // Rank deficient: a square root that is not triangular, made so by a QR.
        let (values, vectors) = symmetric_eigen(scaled.as_ref());
        let k = values.len();
        let noise = 1e-13 * values[k - 1];
        let root = |value: f64| if value > noise { value.sqrt() } else { 0.0 };
        // A column of zeros stays one: rounding must not stand in for its content.
        let root = Mat::from_fn(k, k, |i, j| {
            if is_empty(&self.gram, j) { 0.0 } else { root(values[i]) * vectors[(j, i)] }
        });
        triangle(multiply(&columns_times(&root, &lengths), &self.first).as_ref())
    }
}

/// Squared lengths up to this one have lost digits to the end of the range of numbers: such columns
/// are empty.
const EMPTY: f64 = 1e-280;

fn is_empty(gram: &Mat<f64>, j: usize) -> bool {
    gram[(j, j)] <= EMPTY
}

/// A Gram matrix of columns of unit length, lower triangle, and the lengths that the columns have;
/// one for empty columns, which are zero.
fn equilibrated(gram: &Mat<f64>) -> (Mat<f64>, Vec<f64>) {
    let k = gram.ncols();
    let lengths: Vec<f64> =
        (0..k).map(|j| if is_empty(gram, j) { 1.0 } else { gram[(j, j)].sqrt() }).collect();
    let has_entry = |i: usize, j: usize| i >= j && !is_empty(gram, i) && !is_empty(gram, j);
    let entry = |i: usize, j: usize| {
        if has_entry(i, j) { gram[(i, j)] / (lengths[i] * lengths[j]) } else { 0.0 }
    };
    (Mat::from_fn(k, k, entry), lengths)
}

fn columns_times(matrix: &Mat<f64>, factors: &[f64]) -> Mat<f64> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * factors[j])
}

/// gram += blockᵀ block, lower triangle.
fn add_gram(gram: &mut Mat<f64>, block: MatRef<'_, f64>) {
    matmul(
        gram.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        block.transpose(),
        BlockStructure::Rectangular,
        block,
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
}

fn multiply(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    let mut product = Mat::zeros(a.nrows(), b.ncols());
    faer::linalg::matmul::matmul(product.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of very different size, two of them nearly parallel.
    fn row(i: usize) -> Vec<f64> {
        let t = i as f64 * 0.37;
        let a = t.sin();
        vec![
            1e3 * a,
            1e-3 * (1.3 * t).cos(),
            1e3 * a + 1e-2 * (2.1 * t).sin(),
            1.0,
            (0.7 * t).sin() * a,
        ]
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
    fn columns_at_the_end_of_the_range_of_numbers_are_empty() {
        for tiny in [1e-150, 1e-170, 1e-310] {
            let mut factor = TriangularFactor::new(5);
            for i in 0..700 {
                let mut row = row(i);
                (row[1], row[4]) = (tiny * row[1], tiny * row[4]);
                factor.push(&row);
            }
            let found = factor.factor();
            let expected = householder(0..700);
            // Column 0 is the first of all: its length is that of the data.
            assert!((found[(0, 0)] / expected[(0, 0)] - 1.0).abs() < 1e-12, "{tiny:e}");
            assert!((0..5).all(|i| (0..5).all(|j| found[(i, j)].is_finite())), "{tiny:e}");
            assert!(found[(1, 1)].abs() < 1e-100 && found[(4, 4)].abs() < 1e-100, "{tiny:e}");
        }
    }

    #[test]
    fn agrees_with_a_householder_qr_of_all_rows_at_once() {
        for count in [3, 5, 700, 1024, 5000] {
            let mut factor = TriangularFactor::new(5);
            (0..count).for_each(|i| factor.push(&row(i)));
            assert_eq!(factor.rows(), count);
            let error = relative_error(&factor.factor(), &householder(0..count));
            // With no more rows than columns the factor rests on the shift, a 1e-7 of the columns.
            // Else rounding, 2.2e-16, is enlarged by the condition number, 1e5, and by the square
            // root of five columns.
            let tolerance = if count <= 5 { 1e-9 } else { 5e-11 };
            assert!(error < tolerance, "{count} rows: {error:e}");
        }
    }

    #[test]
    fn small_singular_values_survive_where_normal_equations_lose_them() {
        // Columns 0 and 2 differ by 1e-5 of their size: WᵀW would leave 6 digits of the difference,
        // R has 11.
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
        let mut rows: Vec<Vec<f64>> =
            (0..5).map(|i| (0..5).map(|j| moving[(i, j)]).collect()).collect();
        rows.push(rest.iter().map(|x| x * 2000f64.sqrt()).collect());
        let expected = triangle(Mat::from_fn(6, 5, |i, j| rows[i][j]).as_ref());
        let error = relative_error(&factor.factor(), &expected);
        assert!(error < 1e-10, "{error:e}");
    }

    #[test]
    fn whole_blocks_at_once_are_the_same_rows() {
        let rows: Vec<f64> = (0..2345).flat_map(row).collect();
        let (mut one_by_one, mut at_once) = (TriangularFactor::new(5), TriangularFactor::new(5));
        rows.chunks_exact(5).for_each(|row| one_by_one.push(row));
        at_once.push_all(&rows[..5 * 700]);
        at_once.push_all(&rows[5 * 700..]);
        assert_eq!(at_once.rows(), 2345);
        assert!(relative_error(&at_once.factor(), &one_by_one.factor()) < 1e-12);
    }

    #[test]
    fn slow_motion_at_the_start_does_no_harm() {
        // The first block is nearly singular: everything moves along one line.
        let slow = |i: usize| row(0).iter().map(|x| x + 1e-9 * i as f64).collect::<Vec<_>>();
        let mut factor = TriangularFactor::new(5);
        (0..600).for_each(|i| factor.push(&slow(i)));
        (0..900).for_each(|i| factor.push(&row(i)));
        let rows: Vec<Vec<f64>> = (0..600).map(slow).chain((0..900).map(row)).collect();
        let expected = triangle(Mat::from_fn(1500, 5, |i, j| rows[i][j]).as_ref());
        let error = relative_error(&factor.factor(), &expected);
        assert!(error < 1e-10, "{error:e}");
    }

    #[test]
    fn what_filters_leave_of_a_column_before_it_begins_does_no_harm() {
        for tiny in [1e-150, 1e-200, 1e-300, 1e-308, 1e-310] {
            let tail = |row: Vec<f64>| {
                let by_column = row.iter().enumerate();
                by_column.map(|(j, x)| if [1, 4].contains(&j) { tiny * x } else { *x }).collect()
            };
            let slow = |i: usize| tail(row(0).iter().map(|x| x + 1e-9 * i as f64).collect());
            let rows: Vec<Vec<f64>> = (0..600)
                .map(slow)
                .chain((0..600).map(|i| tail(row(i))))
                .chain((0..900).map(row))
                .collect();
            let mut factor = TriangularFactor::new(5);
            rows.iter().for_each(|row| factor.push(row));
            let expected = triangle(Mat::from_fn(rows.len(), 5, |i, j| rows[i][j]).as_ref());
            let error = relative_error(&factor.factor(), &expected);
            assert!(error < 1e-10, "{tiny:e}: {error:e}");
        }
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
        let gram = r.transpose() * r.as_ref();
        let expected = [[squares, 0.0, sum], [0.0; 3], [sum, 0.0, 3000.0]];
        for (i, row) in expected.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((gram[(i, j)] - value).abs() < 1e-9, "{i} {j}");
            }
        }
        // Its row is none: what the other column leaves of the last is in the last entry.
        let left = 3000.0 - sum * sum / squares;
        assert_eq!(r[(1, 2)], 0.0);
        assert!((r[(2, 2)].powi(2) / left - 1.0).abs() < 1e-12, "{} {left}", r[(2, 2)].powi(2));
    }
}
