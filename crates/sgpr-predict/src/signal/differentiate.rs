//! Derivatives of uniformly sampled signals.

use serde::{Deserialize, Serialize};

use super::SignalError;
use super::savitzky_golay::weights;

/// How velocity and acceleration are taken from a sampled position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Differentiation {
    /// Central differences whose error falls with the power `accuracy` (2, 4, 6 or 8) of the
    /// sampling period; the acceleration is the difference of the velocity.
    Central {
        /// Power of the sampling period in the error.
        accuracy: usize,
    },
    /// Slope and curvature of a polynomial fitted to a sliding window (Savitzky and Golay (1964)).
    SavitzkyGolay {
        /// Samples in the window, odd.
        window: usize,
        /// Degree of the polynomial.
        degree: usize,
    },
}

impl Default for Differentiation {
    /// Sixth-order central differences: at a tenth of the sampling rate they lose 0.05 % of a
    /// velocity, where the common second-order ones lose 6 %.
    fn default() -> Self {
        Self::Central { accuracy: 6 }
    }
}

impl Differentiation {
    /// Velocity and acceleration of `position`, `[samples, columns]` row-major, sampled at
    /// `rate_hz`.
    ///
    /// The first and last [`Self::edge`] rows repeat the nearest full estimate; they are no
    /// measurements.
    ///
    /// # Errors
    /// If the window or accuracy cannot be, or is longer than the signal.
    pub fn derivatives(
        &self,
        position: &[f64],
        columns: usize,
        rate_hz: f64,
    ) -> Result<(Vec<f64>, Vec<f64>), SignalError> {
        self.check()?;
        let samples = position.len() / columns;
        if samples <= self.edge().saturating_mul(2) {
            return Err(SignalError::TooShort { samples, needed: self.edge().saturating_mul(2) });
        }
        match *self {
            Self::Central { accuracy } => {
                let weights = central_weights(accuracy)?;
                let velocity = convolve(position, columns, &weights, rate_hz);
                let mut acceleration = convolve(&velocity, columns, &weights, rate_hz);
                hold_ends(&mut acceleration, columns, self.edge());
                Ok((velocity, acceleration))
            }
            Self::SavitzkyGolay { window, degree } => {
                let weights = |derivative| weights(window / 2, degree, derivative);
                let velocity = convolve(position, columns, &weights(1), rate_hz);
                let acceleration = convolve(position, columns, &weights(2), rate_hz * rate_hz);
                Ok((velocity, acceleration))
            }
        }
    }

    /// # Errors
    /// If no derivatives can be taken in this way, for signals of any length.
    #[doc(hidden)]
    pub fn check(&self) -> Result<(), SignalError> {
        match *self {
            Self::Central { accuracy } => central_weights(accuracy).map(|_| ()),
            Self::SavitzkyGolay { window, degree }
                if window % 2 == 0 || degree < 2 || degree >= window =>
            {
                let message = format!(
                    "a Savitzky-Golay window of {window} samples with a polynomial of degree \
                     {degree} gives no acceleration: take an odd window and a degree from 2 to \
                     window - 1"
                );
                Err(SignalError::Window { message })
            }
            Self::SavitzkyGolay { .. } => Ok(()),
        }
    }

    /// Rows at either end without a full estimate.
    pub fn edge(&self) -> usize {
        match *self {
            Self::Central { accuracy } => accuracy,
            Self::SavitzkyGolay { window, .. } => window / 2,
        }
    }

    /// Standard deviation of velocity (1/s) and acceleration (1/s²) that white noise of unit
    /// standard deviation in the position makes.
    ///
    /// # Errors
    /// As [`Self::derivatives`].
    pub fn noise_gain(&self, rate_hz: f64) -> Result<[f64; 2], SignalError> {
        let length = 4 * self.edge() + 3;
        let mut impulse = vec![0.0; length];
        impulse[length / 2] = 1.0;
        let (velocity, acceleration) = self.derivatives(&impulse, 1, rate_hz)?;
        let norm = |values: Vec<f64>| values.iter().map(|v| v * v).sum::<f64>().sqrt();
        Ok([norm(velocity), norm(acceleration)])
    }
}

/// Weights of the central difference for the first derivative, from -p/2 to p/2 (Fornberg (1988),
/// table 1).
fn central_weights(accuracy: usize) -> Result<Vec<f64>, SignalError> {
    let right: &[f64] = match accuracy {
        2 => &[1.0 / 2.0],
        4 => &[2.0 / 3.0, -1.0 / 12.0],
        6 => &[3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0],
        8 => &[4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0],
        _ => {
            let message = format!(
                "central differences of accuracy {accuracy} are not there: choose 2, 4, 6 or 8"
            );
            return Err(SignalError::Window { message });
        }
    };
    let left = right.iter().rev().map(|w| -w);
    Ok(left.chain([0.0]).chain(right.iter().copied()).collect())
}

/// Weighted sum over a centred window, times `factor`; the ends hold the nearest full estimate.
fn convolve(values: &[f64], columns: usize, weights: &[f64], factor: f64) -> Vec<f64> {
    /// Values that stay in the cache while all weights are summed.
    const AT_ONCE: usize = 1024;
    let half = weights.len() / 2;
    let mut result = vec![0.0; values.len()];
    let centre = half * columns..values.len() - half * columns;
    for (block, sums) in result[centre].chunks_mut(AT_ONCE).enumerate() {
        for (offset, weight) in weights.iter().enumerate() {
            let weight = weight * factor;
            let shifted = &values[block * AT_ONCE + offset * columns..];
            for (sum, value) in sums.iter_mut().zip(shifted) {
                *sum += weight * value;
            }
        }
    }
    hold_ends(&mut result, columns, half);
    result
}

/// Copies the first and last full row over the `edge` rows outside of them.
fn hold_ends(values: &mut [f64], columns: usize, edge: usize) {
    let rows = values.len() / columns;
    for row in 0..edge {
        values.copy_within(edge * columns..(edge + 1) * columns, row * columns);
        let last = rows - 1 - edge;
        values.copy_within(last * columns..(last + 1) * columns, (rows - 1 - row) * columns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: f64 = 50.0;

    fn sampled(f: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..60).flat_map(|k| [f(f64::from(k) / RATE), 1.0]).collect()
    }

    #[test]
    fn polynomials_up_to_the_order_are_differentiated_exactly() {
        // The acceleration needs the velocity, one degree lower, to be in reach too.
        let methods = [
            (Differentiation::Central { accuracy: 2 }, 2),
            (Differentiation::Central { accuracy: 6 }, 6),
            (Differentiation::Central { accuracy: 8 }, 8),
            (Differentiation::SavitzkyGolay { window: 9, degree: 4 }, 4),
        ];
        for (method, degree) in methods {
            let position = sampled(|t| t.powi(degree));
            let (velocity, acceleration) =
                method.derivatives(&position, 2, RATE).expect("long enough");
            for row in method.edge()..60 - method.edge() {
                let t = row as f64 / RATE;
                let p = f64::from(degree);
                assert!((velocity[2 * row] - p * t.powi(degree - 1)).abs() < 1e-9, "{method:?}");
                assert!(
                    (acceleration[2 * row] - p * (p - 1.0) * t.powi(degree - 2)).abs() < 1e-8,
                    "{method:?}"
                );
                assert!(
                    velocity[2 * row + 1].abs() < 1e-10 && acceleration[2 * row + 1].abs() < 1e-9,
                    "{method:?}"
                );
            }
        }
    }

    #[test]
    fn loss_at_a_tenth_of_the_sampling_rate_is_as_documented() {
        let position = sampled(|t| (std::f64::consts::TAU * 0.1 * RATE * t).sin());
        for (accuracy, loss) in [(2, 0.0645), (6, 0.0005)] {
            let (velocity, _) = Differentiation::Central { accuracy }
                .derivatives(&position, 2, RATE)
                .expect("long enough");
            let share = velocity[2 * 30] / (std::f64::consts::TAU * 0.1 * RATE);
            assert!(((1.0 - share) - loss).abs() < 1e-4, "{accuracy}: {share}");
        }
    }

    #[test]
    fn noise_gain_of_the_plain_difference() {
        // (x[k+1] - x[k-1]) rate / 2 and (x[k+2] - 2 x[k] + x[k-2]) rate² / 4
        let [velocity, acceleration] =
            Differentiation::Central { accuracy: 2 }.noise_gain(RATE).expect("a valid window");
        assert!((velocity - RATE * 0.5f64.sqrt()).abs() < 1e-9);
        assert!((acceleration - RATE * RATE * 6f64.sqrt() / 4.0).abs() < 1e-6);
    }

    #[test]
    fn bad_windows_are_refused_with_advice() {
        let message = |method: Differentiation| {
            method.derivatives(&sampled(|t| t), 2, RATE).expect_err("impossible").to_string()
        };
        assert!(
            message(Differentiation::SavitzkyGolay { window: 8, degree: 3 }).contains("odd window")
        );
        assert!(message(Differentiation::Central { accuracy: 3 }).contains("2, 4, 6 or 8"));
        assert!(
            message(Differentiation::SavitzkyGolay { window: 201, degree: 3 }).contains("too few")
        );
    }
}
