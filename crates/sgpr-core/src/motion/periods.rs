use super::{MotionError, uniform_rate};
use crate::recording::Recording;

/// A periodic motion averaged over its periods, and how much the periods differ.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PeriodAverage {
    /// One period: mean position, velocity and torque.
    pub recording: Recording,
    /// Number of periods averaged, K.
    pub periods: usize,
    /// Per joint: standard deviation of a single position sample about the mean, rad (m).
    pub position_noise: Vec<f64>,
    /// Per joint: standard deviation of a single torque sample about the mean, N·m (N); the weights
    /// of [`Method::WlsKnown`](crate::identification::Method::WlsKnown).
    pub torque_noise: Vec<f64>,
}

/// Averages a recording of a periodic motion over its periods of `period_s` seconds, leaving out
/// the first `skip` periods, in which the arm settles.
///
/// The mean is that of the thesis's eq. 4-7. The variance, pooled over the samples of a period, is
/// that of eq. 4-8 with K - 1 in the place of K, which is unbiased.
///
/// # Errors
/// If there is no torque, time is irregular, a period is not a whole number of samples to a tenth
/// of one, or fewer than two periods are left.
pub fn average_periods(
    recording: &Recording,
    period_s: f64,
    skip: usize,
) -> Result<PeriodAverage, MotionError> {
    let rate = uniform_rate(recording)?;
    let fail =
        |message: String| MotionError::Period { recording: recording.source().into(), message };
    let tau = recording
        .torque()
        .ok_or_else(|| MotionError::NoTorque { recording: recording.source().into() })?;
    if !(period_s > 0.0 && period_s.is_finite()) {
        return Err(fail(format!("a period of {period_s} s is none")));
    }
    let exact = period_s * rate;
    let length = exact.round() as usize;
    let available = recording.len() / length.max(1);
    // An error of the length adds up over all periods.
    let drift = (exact - exact.round()).abs() * available as f64;
    if drift > 0.1 * available.max(1) as f64 {
        return Err(fail(format!(
            "a period of {period_s} s is {exact:.2} samples at {rate:.3} Hz; resample so that it \
             is a whole number"
        )));
    }
    let periods = available.saturating_sub(skip);
    if periods < 2 {
        return Err(fail(format!(
            "{available} whole periods of {period_s} s less {skip} to settle leave {periods}: an \
             average needs two"
        )));
    }
    let n = recording.dof();
    let start = skip * length * n;
    let average =
        |values: &[f64]| average(&values[start..start + periods * length * n], periods, n);
    let (position, position_noise) = average(recording.position());
    let (torque, torque_noise) = average(tau);
    let velocity = recording.velocity().map(|dq| average(dq).0);
    let recording = Recording::new(
        format!("{} (mean of {periods} periods)", recording.source()),
        recording.joint_names().to_vec(),
        recording.time()[skip * length..][..length].to_vec(),
        position,
        velocity,
        Some(torque),
        vec![],
    )
    .expect("arrays of one length");
    Ok(PeriodAverage { recording, periods, position_noise, torque_noise })
}

/// Mean over periods, `[length, n]`, and the standard deviation about it per joint, `[n]`.
fn average(values: &[f64], periods: usize, n: usize) -> (Vec<f64>, Vec<f64>) {
    let length = values.len() / periods;
    let mut mean = vec![0.0; length];
    for period in values.chunks_exact(length) {
        mean.iter_mut().zip(period).for_each(|(mean, value)| *mean += value / periods as f64);
    }
    let mut squares = vec![0.0; n];
    for period in values.chunks_exact(length) {
        for (k, (value, mean)) in period.iter().zip(&mean).enumerate() {
            squares[k % n] += (value - mean).powi(2);
        }
    }
    let freedom = ((periods - 1) * length / n) as f64;
    (mean, squares.into_iter().map(|sum| (sum / freedom).sqrt()).collect())
}
