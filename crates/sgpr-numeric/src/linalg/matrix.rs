use std::fmt;
use std::ops::{Deref, DerefMut, Index, IndexMut};

use faer::Mat;

/// A matrix of numbers, by row and column from 0.
///
/// The interfaces of these crates show it in the place of what it is made of, which may change.
#[derive(Clone, PartialEq)]
pub struct Matrix(Mat<f64>);

impl Matrix {
    /// The matrix of the values of `element(row, column)`.
    pub fn from_fn(rows: usize, columns: usize, element: impl FnMut(usize, usize) -> f64) -> Self {
        Self(Mat::from_fn(rows, columns, element))
    }

    /// Number of rows.
    pub fn nrows(&self) -> usize {
        self.0.nrows()
    }

    /// Number of columns.
    pub fn ncols(&self) -> usize {
        self.0.ncols()
    }

    /// The numbers row by row.
    pub fn to_row_major(&self) -> Vec<f64> {
        let columns = 0..self.ncols();
        (0..self.nrows()).flat_map(|i| columns.clone().map(move |j| self.0[(i, j)])).collect()
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, at: (usize, usize)) -> &f64 {
        &self.0[at]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, at: (usize, usize)) -> &mut f64 {
        &mut self.0[at]
    }
}

impl fmt::Debug for Matrix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[doc(hidden)]
impl Deref for Matrix {
    type Target = Mat<f64>;

    fn deref(&self) -> &Mat<f64> {
        &self.0
    }
}

#[doc(hidden)]
impl DerefMut for Matrix {
    fn deref_mut(&mut self) -> &mut Mat<f64> {
        &mut self.0
    }
}

#[doc(hidden)]
impl From<Mat<f64>> for Matrix {
    fn from(matrix: Mat<f64>) -> Self {
        Self(matrix)
    }
}

#[doc(hidden)]
impl From<Matrix> for Mat<f64> {
    fn from(matrix: Matrix) -> Self {
        matrix.0
    }
}
