//! A thin layer over faer: factors that grow row by row, column selection, singular values.

mod column_selection;
mod decompositions;
mod dot;
mod triangular_factor;

pub use column_selection::{ColumnSelection, select_columns};
pub(crate) use decompositions::{Svd, cholesky, solve_general, symmetric_eigen, triangle};
pub(crate) use dot::{dot, dot_in_lanes, mean_square, rms};
pub use triangular_factor::TriangularFactor;
