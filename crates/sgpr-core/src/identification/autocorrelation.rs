//! How much a residual remembers.

use crate::linalg::dot_in_lanes;

/// Numbers in the order of time, of which some are missing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Series {
    /// Zero where missing.
    values: Vec<f64>,
    present: Vec<bool>,
}

impl FromIterator<Option<f64>> for Series {
    fn from_iter<I: IntoIterator<Item = Option<f64>>>(values: I) -> Self {
        let (values, present) = values.into_iter().map(|value| (value.unwrap_or(0.0), value.is_some())).unzip();
        Self { values, present }
    }
}

impl Series {
    fn push(&mut self, value: Option<f64>) {
        self.values.push(value.unwrap_or(0.0));
        self.present.push(value.is_some());
    }

    /// Sum and number of the products of values that are `lag` apart.
    fn products(&self, lag: usize) -> (f64, usize) {
        let Self { values, present } = self;
        if lag >= values.len() {
            return (0.0, 0);
        }
        let pairs = present.iter().zip(&present[lag..]);
        (dot_in_lanes(values, &values[lag..]), pairs.map(|(a, b)| usize::from(*a & *b)).sum())
    }
}

/// Longest memory that is looked at, in rows.
const LONGEST_LAG: usize = 500;

/// Autocorrelation from lag one on, up to where it drowns in its own noise.
pub(crate) fn correlations(series: &[Series]) -> Vec<f64> {
    correlations_of((0..=LONGEST_LAG).map(|lag| products(series, lag)))
}

/// The same from sums and numbers of products, from lag zero on.
pub(crate) fn correlations_of(products: impl IntoIterator<Item = (f64, usize)>) -> Vec<f64> {
    let mut means = products.into_iter().map(|(sum, count)| {
        let count = f64::max(count as f64, 1.0);
        (sum / count, count)
    });
    let Some((variance, _)) = means.next() else { return Vec::new() };
    // A series without rows or without residual has the correlation 0 / 0.
    let drowned = |correlation: f64, count: f64| correlation.is_nan() || correlation <= 2.0 / count.sqrt();
    means
        .map(|(mean, count)| (mean / variance, count))
        .take_while(|(correlation, count)| !drowned(*correlation, *count))
        .map(|(correlation, _)| correlation)
        .collect()
}

/// Sums and numbers of products by lag, from lag zero to twice where the autocorrelation drowns: with those of other
/// logs the noise is smaller, and more of it shows.
pub(crate) fn lag_products(series: &[Series]) -> Vec<(f64, usize)> {
    const SPARE: usize = 16;
    let lags = (2 * correlations(series).len() + SPARE).min(LONGEST_LAG);
    (0..=lags).map(|lag| products(series, lag)).collect()
}

fn products(series: &[Series], lag: usize) -> (f64, usize) {
    let parts = series.iter().map(|series| series.products(lag));
    parts.fold((0.0, 0), |(sum, count), (s, c)| (sum + s, count + c))
}

/// How many rows carry as much as one independent row, 1 + 2 sum of the autocorrelation.
///
/// Source: G. V. Bayley, J. M. Hammersley, The effective number of independent observations in an autocorrelated time
/// series, Suppl. J. R. Stat. Soc. 8(2) (1946).
pub(crate) fn rows_per_independent_row(series: &[Series]) -> f64 {
    1.0 + 2.0 * correlations(series).iter().sum::<f64>()
}

/// Residuals of one kind of rows, collected row by row, with holes where there was no such row.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    series: Vec<Series>,
    /// Trajectory and row of the last residual.
    at: Option<(usize, usize)>,
}

impl Memory {
    /// Adds the residual of row `time` of a trajectory; rows come in order.
    pub fn push(&mut self, trajectory: usize, time: usize, residual: f64) {
        match self.at {
            // A hole longer than any memory begins anew.
            Some((last, before)) if last == trajectory && time - before <= LONGEST_LAG => {
                let series = self.series.last_mut().expect("begun before");
                (before + 1..time).for_each(|_| series.push(None));
            }
            _ => self.series.push(Series::default()),
        }
        self.series.last_mut().expect("just begun").push(Some(residual));
        self.at = Some((trajectory, time));
    }

    /// How many rows carry as much as one independent row.
    pub fn rows_per_independent_row(&self) -> f64 {
        rows_per_independent_row(&self.series)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_order_process_has_the_memory_of_theory() {
        // x[k] = a x[k-1] + e: correlations a^lag, so 1 + 2 a / (1 - a) rows per independent one.
        let (mut state, mut x) = (1u64, 0.0);
        let mut memory = Memory::default();
        for time in 0..100_000 {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1u64 << 53) as f64;
            }
            x = 0.8 * x + (sum - 6.0);
            // Holes must not shift the lags.
            if time % 7 != 3 {
                memory.push(time / 25_000, time % 25_000, x);
            }
        }
        let expected = 1.0 + 2.0 * 0.8 / 0.2;
        let found = memory.rows_per_independent_row();
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
    }

    #[test]
    fn no_rows_and_no_residual_remember_nothing() {
        assert_eq!(Memory::default().rows_per_independent_row(), 1.0);
        let mut zeros = Memory::default();
        (0..10).for_each(|time| zeros.push(0, time, 0.0));
        assert_eq!(zeros.rows_per_independent_row(), 1.0);
    }
}
