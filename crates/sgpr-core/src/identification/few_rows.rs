//! What a fit takes from a residual that remembers.
//!
//! Rows that remember are worth few independent ones, and motion is slow beside them: each
//! parameter takes as much of the residual as one independent row has. What is left is smaller than
//! the noise, and remembers less.

use faer::Mat;

use super::hac::{MOST_LOST, student};
use super::least_squares::{Solution, stack, weighted_gram};
use super::{Estimate, JointFactor};

/// Independent rows that a fit leaves of `rows`, one for each of `taken` parameters gone, where its
/// residual has an independent one in as many rows as `residual` says.
///
/// Noise of first order with correlation r has one in c = (1 + r) / (1 - r) rows. Every slow
/// direction that a fit takes lowers the sums of products at all lags by as much, c times the
/// variance, so that the residual has a correlation of (r - x) / (1 - x), x = `taken` c / `rows`.
/// For the mean alone that is the bias that is known, -(1 + r) / `rows`. It makes up for no more
/// than half of the rows that the residual suggests: a residual that is slow because the model
/// lacks something suggests few.
///
/// Source: F. H. C. Marriott, J. A. Pope, Bias in the estimation of autocorrelations, Biometrika 41
/// (1954), for the mean.
fn independent_rows(rows: f64, taken: f64, residual: f64) -> f64 {
    let share = taken / rows;
    let found = (residual - 1.0) / (residual + 1.0);
    // The lower root of r² - 2 half r + product; where there is none the fit has taken all that can
    // be told.
    let half = 0.5 * (1.0 - share + found + share * found);
    let product = found + share - share * found;
    let r = half - (half * half - product).max(0.0).sqrt();
    let left = rows * (1.0 - r) / (1.0 + r) - taken;
    left.max((1.0 - MOST_LOST) * rows / residual)
}

impl Estimate {
    /// Widens the covariance by what the fit took from the residual, of which its noise and the
    /// memory of that were estimated, and by Student's quantile, as the rows that tell them are
    /// few: 1.96 standard deviations hold 95 %.
    ///
    /// - `correlation`: per factor, rows that carry as much as one independent row, of the residual
    ///
    /// # Panics
    /// If there is not one for each factor.
    pub fn widen_for_few_rows(&mut self, factors: &[JointFactor], correlation: &[f64]) {
        let unknowns = self.values.len();
        let noise: Vec<f64> = self.weights.iter().map(|weight| weight * self.unit).collect();
        // Of all rows alike, as the products below: `whitened` of a robust or a recursive fit has
        // fewer.
        let inverse = Solution::new(&stack(factors, unknowns, &noise), &self.values).inverse;
        let (mut own, mut all) = (vec![0.0; unknowns], vec![0.0; unknowns]);
        for index in (0..factors.len()).filter(|&index| self.weights[index].is_finite()) {
            let only: Vec<bool> = (0..factors.len()).map(|other| other == index).collect();
            let weights = vec![noise[index].powi(-2); factors.len()];
            let along: Mat<f64> = &inverse * weighted_gram(factors, &only, &weights, unknowns);
            let taken: f64 = (0..unknowns).map(|k| along[(k, k)]).sum();
            let (rows, memory) = (factors[index].rows as f64, correlation[index]);
            let freedom = independent_rows(rows, taken, memory);
            let widening =
                (rows - taken).max(freedom) / (memory * freedom) * student(freedom).powi(2);
            // What the noise of this joint makes of the variances.
            let scale = (self.noise[index] / self.weights[index]).powi(2) * memory;
            let shares = scale * &along * &inverse;
            for k in 0..unknowns {
                own[k] += widening.max(1.0) * shares[(k, k)];
                all[k] += shares[(k, k)];
            }
        }
        let factor = |k: usize| if all[k] > 0.0 { (own[k] / all[k]).sqrt() } else { 1.0 };
        let factors: Vec<f64> = (0..unknowns).map(factor).collect();
        for (i, row) in factors.iter().enumerate() {
            factors
                .iter()
                .enumerate()
                .for_each(|(k, column)| self.covariance[(i, k)] *= row * column);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_of_the_mean_has_the_bias_of_theory() {
        // Of the correlation of neighbours, -(1 + r) / n.
        let (rows, r) = (10_000.0, 0.8);
        let biased = r - (1.0 + r) / rows;
        let left = independent_rows(rows, 1.0, (1.0 + biased) / (1.0 - biased));
        assert!((left - (rows / 9.0 - 1.0)).abs() < 0.01, "{left}");
        assert_eq!(independent_rows(1000.0, 0.0, 1.0), 1000.0);
        assert_eq!(independent_rows(100.0, 12.0, 10.0), (1.0 - MOST_LOST) * 10.0);
    }
}
