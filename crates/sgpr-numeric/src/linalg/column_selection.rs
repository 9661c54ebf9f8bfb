//! Which columns of a matrix carry all others.

use sgpr_predict::internal::dot;

/// Columns kept, and how each other column depends on them.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ColumnSelection {
    /// Indices of independent columns, in the order in which they were offered.
    pub independent: Vec<usize>,
    /// Every other column with its coefficients: column = sum over `independent` of coefficient *
    /// column; none for a column of zeros.
    pub dependent: Vec<(usize, Vec<f64>)>,
    /// Largest share of a dependent column's norm that the independent ones leave over.
    pub largest_dependent: f64,
    /// Smallest share of an independent column's norm that the ones before it leave over.
    pub smallest_independent: f64,
}

/// Goes through the columns of `matrix` (each a slice of the same length) in the given `order` and
/// keeps those that are independent of the ones kept before: a rank-revealing QR whose pivots are
/// set by the caller, so that the choice does not depend on the data.
///
/// A column counts as dependent when less than `tolerance` of its norm is left by modified
/// Gram-Schmidt, done twice.
///
/// Source: M. Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic
/// Systems 8(4) (1991), with the order of columns as the choice.
///
/// # Panics
/// If the columns differ in length or `order` is not a permutation.
pub fn select_columns(matrix: &[Vec<f64>], order: &[usize], tolerance: f64) -> ColumnSelection {
    assert_eq!(matrix.len(), order.len(), "every column once");
    let mut selection = ColumnSelection {
        independent: Vec::new(),
        dependent: Vec::new(),
        largest_dependent: 0.0,
        smallest_independent: 1.0,
    };
    let largest_norm = matrix.iter().map(|column| norm(column)).fold(0.0, f64::max);
    // Orthonormal basis of the kept columns, and the triangle that makes them from it.
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut triangle: Vec<Vec<f64>> = Vec::new();
    for &index in order {
        let column = &matrix[index];
        let size = norm(column);
        if size <= 1e-12 * largest_norm {
            selection.dependent.push((index, Vec::new()));
            continue;
        }
        let mut rest = column.clone();
        let mut shares = vec![0.0; basis.len()];
        for _ in 0..2 {
            for (share, direction) in shares.iter_mut().zip(&basis) {
                let along = dot(&rest, direction);
                rest.iter_mut().zip(direction).for_each(|(r, d)| *r -= along * d);
                *share += along;
            }
        }
        let left = norm(&rest) / size;
        if left < tolerance {
            selection.largest_dependent = selection.largest_dependent.max(left);
            selection.dependent.push((index, back_substitute(&triangle, shares)));
        } else {
            selection.smallest_independent = selection.smallest_independent.min(left);
            let length = norm(&rest);
            rest.iter_mut().for_each(|r| *r /= length);
            shares.push(length);
            triangle.push(shares);
            basis.push(rest);
            selection.independent.push(index);
        }
    }
    selection
}

/// Solves R x = b, R given by its columns.
fn back_substitute(columns: &[Vec<f64>], mut b: Vec<f64>) -> Vec<f64> {
    for j in (0..b.len()).rev() {
        b[j] /= columns[j][j];
        let x = b[j];
        for i in 0..j {
            b[i] -= columns[j][i] * x;
        }
    }
    b
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_columns_are_expressed_by_earlier_ones() {
        let a: Vec<f64> = (0..30).map(|k| f64::from(k).sin()).collect();
        let b: Vec<f64> = (0..30).map(|k| f64::from(k).cos()).collect();
        let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 2.0 * a - 0.5 * b).collect();
        let columns = vec![a, sum, vec![0.0; 30], b];
        let selection = select_columns(&columns, &[0, 3, 2, 1], 1e-9);
        assert_eq!(selection.independent, [0, 3]);
        assert_eq!(selection.dependent[0], (2, vec![]));
        let (index, coefficients) = &selection.dependent[1];
        assert_eq!(*index, 1);
        assert!((coefficients[0] - 2.0).abs() < 1e-13 && (coefficients[1] + 0.5).abs() < 1e-13);
        // In another order, others are kept.
        assert_eq!(select_columns(&columns, &[1, 0, 2, 3], 1e-9).independent, [1, 0]);
        assert!(selection.largest_dependent < 1e-15 && selection.smallest_independent > 0.1);
    }
}
