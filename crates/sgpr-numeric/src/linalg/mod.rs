//! A thin layer over faer: factors that grow row by row, column selection, singular values.

mod column_selection;
mod decompositions;
mod matrix;
mod triangular_factor;

pub use column_selection::{ColumnSelection, select_columns};
pub use matrix::Matrix;
pub use triangular_factor::TriangularFactor;

/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::decompositions::{Svd, cholesky, solve_general, symmetric_eigen, triangle};
}
