//! Which base parameters the data support.
//!
//! Parameters that are no larger than their uncertainty cost nothing to leave out and make what is
//! left more certain. They are dropped one by one, each time the one whose absence raises the
//! residual least. How many may go is decided twice: by the rise of the residual, which under the
//! hypothesis "they are zero" follows a chi-squared law, and by prediction of data that were kept
//! out of the fit.
//!
//! Sources: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
//! 12.5.4 (essential parameters); C. M. Pham, M. Gautier, Essential parameters of robots, IEEE CDC
//! (1991).

use faer::Mat;

use super::least_squares::{Solution, stack};
use super::{IdentificationError, JointFactor};
use crate::linalg::{Matrix, triangle};

/// Base parameters in the order in which they can go.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Essential {
    /// Base parameters that stay, ascending.
    pub kept: Vec<usize>,
    /// Those that go, least missed first.
    pub dropped: Vec<Dropped>,
    /// Estimates without the dropped ones, `[rank]`, zero for those.
    pub values: Vec<f64>,
    /// Their covariance, `[rank, rank]`, zero for those.
    pub covariance: Matrix,
    /// Error of the prediction of data kept out, as a share of that of all parameters: with 0, 1,
    /// 2, ... dropped.
    pub validation: Vec<f64>,
}

/// A base parameter that the data do not support.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Dropped {
    /// Index of the base parameter.
    pub base: usize,
    /// Standard deviation relative to the estimate, when it went.
    pub relative_deviation: f64,
    /// What the residual has risen since the first drop, in units of its variance.
    pub rise: f64,
    /// What the rise may be with 95 % probability if all that went are zero.
    pub limit: f64,
}

/// Prediction may get worse by this share before the choice takes parameters back.
const WORSE: f64 = 1e-3;

/// Drops what the data do not support.
///
/// - `folds`: factors of parts of the data; each part is predicted from the others
/// - `weights`: noise level of the rows by joint and by whether it rests, memory included; infinite
///   leaves rows out
///
/// # Errors
/// If there is no data.
pub fn essential_parameters(
    folds: &[Vec<JointFactor>],
    rank: usize,
    weight: impl Fn(&JointFactor) -> f64,
) -> Result<Essential, IdentificationError> {
    let reduced: Vec<Mat<f64>> = folds
        .iter()
        .map(|factors| stack(factors, rank, &factors.iter().map(&weight).collect::<Vec<_>>()))
        .collect();
    if reduced.is_empty() {
        return Err(IdentificationError::NoData);
    }
    let all = below_each_other(reduced.iter(), rank + 1);
    let order = elimination_order(&all, rank);
    let validation = validation(&reduced, rank, &order);
    let supported = order.iter().take_while(|dropped| dropped.rise <= dropped.limit).count();
    let best = validation[..=supported].iter().fold(f64::INFINITY, |best, error| best.min(*error));
    let count = (0..=supported).rev().find(|&count| validation[count] <= best + WORSE).unwrap_or(0);
    let dropped = order[..count].to_vec();
    let kept: Vec<usize> =
        (0..rank).filter(|k| dropped.iter().all(|gone| gone.base != *k)).collect();
    let solution = Reduced::new(&all, &kept);
    let mut values = vec![0.0; rank];
    let mut covariance = Mat::zeros(rank, rank);
    for (i, &k) in kept.iter().enumerate() {
        values[k] = solution.values[i];
        for (j, &l) in kept.iter().enumerate() {
            covariance[(k, l)] = solution.inverse[(i, j)];
        }
    }
    Ok(Essential { kept, dropped, values, covariance: covariance.into(), validation })
}

/// Least squares on some of the columns of a triangle.
struct Reduced {
    values: Vec<f64>,
    inverse: Mat<f64>,
    triangle: Mat<f64>,
}

impl Reduced {
    fn new(all: &Mat<f64>, kept: &[usize]) -> Self {
        let last = all.ncols() - 1;
        let column = |k: usize| if k < kept.len() { kept[k] } else { last };
        let triangle = triangle(
            Mat::from_fn(all.nrows(), kept.len() + 1, |i, k| all[(i, column(k))]).as_ref(),
        );
        let Solution { values, inverse, .. } = Solution::new(&triangle, &vec![0.0; kept.len()]);
        Self { values, inverse, triangle }
    }

    fn residual(&self) -> f64 {
        let last = self.triangle.ncols() - 1;
        self.triangle[(last, last)].powi(2)
    }
}

/// All base parameters, each time the one with the smallest ratio of estimate and deviation.
fn elimination_order(all: &Mat<f64>, rank: usize) -> Vec<Dropped> {
    let mut kept: Vec<usize> = (0..rank).collect();
    let first = Reduced::new(all, &kept).residual();
    let mut order = Vec::new();
    while !kept.is_empty() {
        let fit = Reduced::new(all, &kept);
        // A parameter without any influence has neither estimate nor deviation, and goes first.
        let ratio = |k: usize| {
            let deviation = fit.inverse[(k, k)].max(0.0).sqrt();
            if deviation > 0.0 { fit.values[k].abs() / deviation } else { 0.0 }
        };
        let weakest =
            (0..kept.len()).min_by(|&a, &b| ratio(a).total_cmp(&ratio(b))).expect("some are kept");
        let relative_deviation = 1.0 / ratio(weakest);
        let base = kept.remove(weakest);
        let rise = Reduced::new(all, &kept).residual() - first;
        order.push(Dropped {
            base,
            relative_deviation,
            rise,
            limit: chi_squared_95(order.len() + 1),
        });
    }
    order
}

/// Error on each fold of the fit to the others, with 0, 1, 2, ... parameters dropped.
fn validation(folds: &[Mat<f64>], rank: usize, order: &[Dropped]) -> Vec<f64> {
    let mut errors = vec![0.0; order.len() + 1];
    for (index, fold) in folds.iter().enumerate() {
        let others =
            folds.iter().enumerate().filter(|(other, _)| *other != index || folds.len() == 1);
        let training = below_each_other(others.map(|(_, fold)| fold), rank + 1);
        for (count, error) in errors.iter_mut().enumerate() {
            let kept: Vec<usize> =
                (0..rank).filter(|k| order[..count].iter().all(|gone| gone.base != *k)).collect();
            let fit = Reduced::new(&training, &kept);
            let row = |i: usize| {
                let predicted =
                    kept.iter().zip(&fit.values).map(|(&k, value)| fold[(i, k)] * value);
                fold[(i, rank)] - predicted.sum::<f64>()
            };
            *error += (0..=rank).map(|i| row(i).powi(2)).sum::<f64>();
        }
    }
    let whole = errors[0].max(f64::MIN_POSITIVE);
    errors.iter().map(|error| (error / whole).sqrt()).collect()
}

fn below_each_other<'a>(parts: impl Iterator<Item = &'a Mat<f64>>, width: usize) -> Mat<f64> {
    let parts: Vec<&Mat<f64>> = parts.collect();
    triangle(
        Mat::from_fn(parts.len() * width, width, |i, j| parts[i / width][(i % width, j)]).as_ref(),
    )
}

/// 95 % quantile of the chi-squared law.
///
/// Source: E. B. Wilson, M. M. Hilferty, The distribution of chi-square, PNAS 17 (1931); within 2 %
/// from one degree of freedom on.
fn chi_squared_95(degrees: usize) -> f64 {
    const NORMAL_95: f64 = 1.644_853_626_951_472_7;
    let k = degrees as f64;
    let part = 2.0 / (9.0 * k);
    k * (1.0 - part + NORMAL_95 * part.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (degrees, table) in [(1, 3.841), (2, 5.991), (5, 11.070), (30, 43.773)] {
            assert!((chi_squared_95(degrees) / table - 1.0).abs() < 0.025, "{degrees}");
        }
    }
}
