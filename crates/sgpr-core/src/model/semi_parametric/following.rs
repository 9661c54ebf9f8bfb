//! Intervals that follow the errors of the log they are used on.

use crate::intervals::WITHIN_ONE_DEVIATION;

/// Shares that the two intervals are to hold.
const SHARES: [f64; 2] = [WITHIN_ONE_DEVIATION, 0.95];

/// Time over which a width that is wrong by a factor of e is put right, s: longer than errors last,
/// shorter than a log.
const SECONDS: f64 = 5.0;

/// Largest factor.
const WIDEST: f64 = 100.0;

/// Smallest factors. Every third error tells that the interval of 68 % is too wide; that of 95 % is
/// missed so rarely that a few seconds without a miss tell nothing, and it stays as wide as
/// predicted.
const NARROWEST: [f64; 2] = [0.01, 1.0];

/// Factors on the half widths of the intervals of 68 % and 95 %, which follow the errors of the
/// torques measured so far: after a miss the interval grows, after a hit it shrinks by as much less
/// as misses are to be rarer.
///
/// Parts left out of the training logs say how large errors are on motion of that kind. A log with
/// disturbances or a spectrum that no training log has is told from its own errors only. Whatever
/// these are, after T samples the share of misses differs from that asked for by at most 2 ln(100)
/// / (T step), as long as the factor is not at a bound: the factor of the interval of 95 % does not
/// go below one, for a few seconds without one of its rare misses say nothing.
///
/// Source: I. Gibbs, E. Candès, Adaptive conformal inference under distribution shift, NeurIPS
/// (2021), on the logarithm of the width as A. Angelopoulos, E. Candès, R. Tibshirani, Conformal
/// PID control for time series prediction, NeurIPS (2023).
///
/// # Examples
/// ```
/// use sgpr_core::model::FollowingIntervals;
/// let mut intervals = FollowingIntervals::new(100.0);
/// // Errors twice as large as predicted.
/// for k in 0..20_000 {
///     let error = 2.0 * (f64::from(k) * 0.7).sin();
///     intervals.observe(error, 0.5, 1.0);
/// }
/// let [half_68, half_95] = intervals.factors();
/// assert!((0.5 * half_68 - 1.76).abs() < 0.1 && (half_95 - 2.0).abs() < 0.1);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FollowingIntervals {
    logarithms: [f64; 2],
    steps: [f64; 2],
}

impl FollowingIntervals {
    /// Starts with the intervals as they are predicted.
    ///
    /// - `rate_hz`: of the samples that will be observed
    pub fn new(rate_hz: f64) -> Self {
        // A width that is wrong by a factor of e moves the share by about share (1 - share).
        let step = |share: f64| 1.0 / (SECONDS * rate_hz * share * (1.0 - share));
        Self { logarithms: [0.0; 2], steps: SHARES.map(step) }
    }

    /// What the standard deviation and the half interval of 95 % of the next sample are multiplied
    /// by.
    pub fn factors(&self) -> [f64; 2] {
        self.logarithms.map(f64::exp)
    }

    /// Takes note of a measurement; says whether it was within each of the two intervals.
    ///
    /// - `error`: measured minus predicted torque, N·m (N)
    /// - `standard_deviation`, `interval_95`: as predicted, before these factors, N·m (N)
    pub fn observe(&mut self, error: f64, standard_deviation: f64, interval_95: f64) -> [bool; 2] {
        let factors = self.factors();
        let within = [
            error.abs() <= factors[0] * standard_deviation,
            error.abs() <= factors[1] * interval_95,
        ];
        for k in 0..2 {
            let excess = SHARES[k] - f64::from(u8::from(within[k]));
            let moved = self.logarithms[k] + self.steps[k] * excess;
            self.logarithms[k] = moved.clamp(NARROWEST[k].ln(), WIDEST.ln());
        }
        within
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::internal::Random;

    #[test]
    fn shares_hold_though_the_errors_change_their_size() {
        let mut random = Random::new(3);
        let (mut intervals, samples) = (FollowingIntervals::new(100.0), 60_000);
        let mut hits = [0.0; 2];
        for k in 0..samples {
            let size = if k < samples / 2 { 1.5 } else { 4.0 };
            let within = intervals.observe(size * random.normal(), 1.0, 1.96);
            hits.iter_mut()
                .zip(within)
                .for_each(|(hits, within)| *hits += f64::from(u8::from(within)));
        }
        let shares = hits.map(|hits| hits / f64::from(samples));
        assert!(
            (shares[0] - SHARES[0]).abs() < 0.01 && (shares[1] - SHARES[1]).abs() < 0.01,
            "{shares:?}"
        );
        let factors = intervals.factors();
        assert!(
            (factors[0] / 4.0).ln().abs() < 0.2 && (factors[1] / 4.0).ln().abs() < 0.2,
            "{factors:?}"
        );
    }

    #[test]
    fn without_errors_the_intervals_stay_at_their_bounds() {
        let mut intervals = FollowingIntervals::new(10.0);
        (0..100_000).for_each(|_| {
            intervals.observe(0.0, 1.0, 1.96);
        });
        let factors = intervals.factors();
        assert!(
            factors
                .iter()
                .zip(NARROWEST)
                .all(|(factor, bound)| (factor / bound - 1.0).abs() < 1e-9)
        );
    }
}
