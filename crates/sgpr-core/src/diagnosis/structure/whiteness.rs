//! Is a residual noise? Tests whose bands know that noise remembers itself.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::rows::JointRows;
use sgpr_predict::internal::Autoregression;

/// Highest order of the autoregression that describes noise: what passed a low-pass remembers many
/// rows.
const ORDER: usize = 20;

/// Lags of the portmanteau test beyond the order.
const LAGS: usize = 20;

/// Longest memory of noise that a band takes into account, rows.
const LONGEST_LAG: usize = 120;

/// Coefficients of the autoregression of a series; none if it is too short for one.
///
/// - `run`: values right before each value without a gap
pub(super) fn autoregression(values: &[f64], run: &[usize]) -> Vec<f64> {
    let covariance: Vec<f64> = (0..=ORDER).map(|lag| product(values, values, run, lag).0).collect();
    if covariance[0] <= 0.0 || values.len() < 20 * ORDER {
        return vec![];
    }
    Autoregression::of(&covariance, values.len() as f64).phi
}

/// Innovations of a series and their runs; rows without enough past are left out by a run of zero
/// and the value zero.
pub(super) fn whitened(values: &[f64], run: &[usize], phi: &[f64]) -> (Vec<f64>, Vec<usize>) {
    let innovation = |k: usize| {
        if run[k] < phi.len() {
            return 0.0;
        }
        values[k] - phi.iter().enumerate().map(|(lag, p)| p * values[k - 1 - lag]).sum::<f64>()
    };
    let white = (0..values.len()).map(innovation).collect();
    (white, run.iter().map(|run| run.saturating_sub(phi.len())).collect())
}

/// Mean product of values that are `lag` rows apart, and the number of such pairs.
fn product(a: &[f64], b: &[f64], run: &[usize], lag: usize) -> (f64, f64) {
    let pairs = (lag..a.len()).filter(|&k| run[k] >= lag);
    let (sum, count) =
        pairs.fold((0.0, 0.0), |(sum, count), k| (sum + a[k] * b[k - lag], count + 1.0));
    (sum / f64::max(count, 1.0), count)
}

/// Probability that noise with the autoregression `phi` is as far from white as `residual` is, once
/// whitened with it.
///
/// Source: G. M. Ljung, G. E. P. Box, On a measure of lack of fit in time series models, Biometrika
/// 65(2) (1978).
pub(super) fn portmanteau(residual: &[f64], run: &[usize], phi: &[f64]) -> f64 {
    let (white, run) = whitened(residual, run, phi);
    let (variance, _) = product(&white, &white, &run, 0);
    if variance <= 0.0 {
        return 1.0;
    }
    let statistic: f64 = (1..=LAGS + phi.len())
        .map(|lag| {
            let (mean, count) = product(&white, &white, &run, lag);
            count * (mean / variance).powi(2)
        })
        .sum();
    above_chi_squared(statistic, LAGS as f64)
}

/// Probability that chi-squared with so many degrees of freedom is larger.
fn above_chi_squared(value: f64, degrees: f64) -> f64 {
    ChiSquared::new(degrees).map_or(f64::NAN, |law| law.sf(value))
}

/// Autocorrelation of noise up to where it drowns in its own uncertainty, from lag one on.
pub(super) fn memory(noise: &[f64], run: &[usize]) -> Vec<f64> {
    let (variance, _) = product(noise, noise, run, 0);
    let mut correlations = Vec::new();
    for lag in 1..=LONGEST_LAG.min(noise.len().saturating_sub(1)) {
        let (mean, count) = product(noise, noise, run, lag);
        let correlation = mean / variance;
        if correlation.is_nan() || correlation.abs() <= 2.0 / f64::max(count, 1.0).sqrt() {
            break;
        }
        correlations.push(correlation);
    }
    correlations
}

/// Correlation of a residual with a function of the state, and its standard deviation for noise
/// that remembers itself: (1 + 2 sum of both autocorrelations' products) / N.
///
/// Source: M. S. Bartlett, Some aspects of the time-correlation problem in regard to tests of
/// significance, J. R. Stat. Soc. 98 (1935).
pub(super) fn correlation(rows: &JointRows, function: &[f64], memory: &[f64]) -> (f64, f64) {
    let count = rows.len() as f64;
    let centred = |values: &[f64]| -> Vec<f64> {
        let mean = values.iter().sum::<f64>() / count;
        values.iter().map(|x| x - mean).collect()
    };
    let (x, r) = (centred(function), centred(&rows.residual));
    let energy = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
    let (own, left) = (energy(&x), energy(&r));
    if own <= 0.0 || left <= 0.0 {
        return (0.0, 1.0 / count.sqrt());
    }
    let value = x.iter().zip(&r).map(|(x, r)| x * r).sum::<f64>() / (own * left).sqrt();
    let products = memory.iter().enumerate().map(|(k, noise)| {
        let (mean, _) = product(&x, &x, &rows.run, k + 1);
        noise * mean / (own / count)
    });
    let variance = (1.0 + 2.0 * products.sum::<f64>()).max(0.1) / count;
    (value, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::internal::Random;

    fn first_order(seed: u64, memory: f64, count: usize) -> Vec<f64> {
        let (mut random, mut x) = (Random::new(seed), 0.0);
        (0..count)
            .map(|_| {
                x = memory * x + random.normal();
                x
            })
            .collect()
    }

    #[test]
    fn tails_are_those_of_tables() {
        // Upper 5 and 1 percent of chi-squared with 20 degrees of freedom.
        for (value, tail) in [(31.410, 0.05), (37.566, 0.01)] {
            assert!((above_chi_squared(value, 20.0) / tail - 1.0).abs() < 0.02, "{value}");
        }
    }

    #[test]
    fn noise_with_a_memory_passes_and_structure_does_not() {
        let run: Vec<usize> = (0..2000).collect();
        let mut rejected = 0;
        for seed in 0..200 {
            let noise = first_order(seed, 0.8, 2000);
            let phi = autoregression(&noise, &run);
            rejected += usize::from(portmanteau(&noise, &run, &phi) < 0.05);
            let with: Vec<f64> =
                noise.iter().enumerate().map(|(k, x)| x + 2.0 * (0.02 * k as f64).sin()).collect();
            assert!(portmanteau(&with, &run, &phi) < 1e-4);
        }
        // 5 % of 200 with a standard deviation of 3; the order was chosen from the same numbers, so
        // somewhat fewer.
        assert!((1..20).contains(&rejected), "{rejected}");
    }

    #[test]
    fn a_correlation_stays_in_its_band_when_both_remember_themselves() {
        let run: Vec<usize> = (0..1500).collect();
        let mut outside = 0;
        for seed in 0..200 {
            let noise = first_order(2 * seed, 0.9, 1500);
            let x = first_order(2 * seed + 1, 0.95, 1500);
            let rows =
                JointRows { run: run.clone(), residual: noise.clone(), ..JointRows::default() };
            let (value, deviation) = correlation(&rows, &x, &memory(&noise, &run));
            outside += usize::from(value.abs() > 2.0 * deviation);
        }
        // 4.6 % of 200 is 9 with a standard deviation of 3; the band of white noise would leave
        // more than half outside.
        assert!((1..22).contains(&outside), "{outside}");
    }
}
