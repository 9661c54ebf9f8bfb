//! From a log to joint motion: filtered position, velocity, acceleration, and which samples can be
//! trusted.
//!
//! What is done to a log is decided once, by [`Processing::choose`] from the training logs, kept
//! with the model, and done in the same way to every log that is compared with it.

mod conditioned;
#[cfg(test)]
mod counted;
mod error;
mod periods;
mod pieces;
mod processing;
mod standstill;

pub(crate) use conditioned::{all_stretches, stretches_of};
#[cfg(test)]
pub(crate) use counted::times_conditioned;
pub use error::MotionError;
pub use periods::{PeriodAverage, average_periods};
pub use processing::{Conditioning, Processing, TorqueBand};

use crate::dynamics::Samples;
use crate::identification::Row;
use crate::recording::{
    GAP_FACTOR, Implausible, MOST_JITTER, PERIODS, Recording, SMALLEST_TORQUE, jitter, seconds,
    stretches,
};
use crate::signal::LowPass;
use standstill::{rows_of, separate_rests};

/// One uniformly sampled stretch of a log, processed. Arrays are `[samples, n]`, row-major, SI.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Motion {
    /// Where it comes from.
    pub source: String,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Time stamps of the log, ns.
    pub time: Vec<i64>,
    /// Low-passed positions.
    pub q: Vec<f64>,
    /// Their first derivative; zero while a joint rests.
    pub dq: Vec<f64>,
    /// Their second derivative; zero while a joint rests.
    pub ddq: Vec<f64>,
    /// Torques as logged, if they were; what is only rounding of zero is zero.
    pub tau: Option<Vec<f64>>,
    /// What else was logged.
    pub channels: Vec<crate::recording::Channel>,
    /// Whether a sample is far enough from the ends of the stretch for its derivatives to be right,
    /// `[samples]`.
    pub inner: Vec<bool>,
    /// What the equation of a joint at a sample is good for, `[samples, n]`.
    pub use_as: Vec<Row>,
}

impl Motion {
    /// The stretches of a recording between its gaps, processed. Stretches shorter than the filter
    /// are left out.
    ///
    /// # Errors
    /// If the recording has samples that are not finite or that no arm makes, time that does not
    /// run forward or is irregular, or is shorter than the filter needs; if the processing cannot
    /// be done.
    pub fn from_recording(
        recording: &Recording,
        processing: &Processing,
    ) -> Result<Vec<Self>, MotionError> {
        processing.check(recording.dof())?;
        #[cfg(test)]
        counted::count(recording.source());
        let mut motions = Vec::new();
        let mut too_short = None;
        for stretch in stretches(recording, GAP_FACTOR) {
            match Self::of_stretch(&stretch, processing) {
                Ok(motion) => motions.push(motion),
                Err(error @ MotionError::TooShort { .. }) => too_short = Some(error),
                Err(error) => return Err(error),
            }
        }
        match too_short {
            Some(error) if motions.is_empty() => Err(error),
            _ => Ok(motions),
        }
    }

    fn of_stretch(recording: &Recording, processing: &Processing) -> Result<Self, MotionError> {
        let rate_hz = uniform_rate(recording)?;
        let (samples, n) = (recording.len(), recording.dof());
        let filter = LowPass::butterworth(processing.order, processing.cutoff_hz, rate_hz)?;
        let edge = filter.settling_samples() + processing.differentiation.edge();
        if samples < 2 * edge + SHORTEST {
            return Err(MotionError::TooShort {
                recording: recording.source().into(),
                seconds: samples as f64 / rate_hz,
                needed: (2 * edge + SHORTEST) as f64 / rate_hz,
            });
        }
        let mut q = recording.position().to_vec();
        filter.apply(&mut q, n)?;
        let (mut dq, mut ddq) = processing.differentiation.derivatives(&q, n, rate_hz)?;
        let inner: Vec<bool> = (0..samples).map(|k| k >= edge && k < samples - edge).collect();
        let threshold = &processing.standstill_speed;
        let period = rate_hz / processing.cutoff_hz;
        let mut use_as =
            separate_rests(&mut dq, &mut ddq, threshold, period, processing.turn_margin);
        skip_ends(&mut use_as, &inner);
        Ok(Self {
            source: recording.source().into(),
            rate_hz,
            time: recording.time().to_vec(),
            q,
            dq,
            ddq,
            tau: recording.torque().map(|tau| tau.iter().copied().map(without_rounding).collect()),
            channels: recording.channels().to_vec(),
            inner,
            use_as,
        })
    }

    /// What `use_as` would be if the motion had been processed with another `turn_margin`.
    pub(crate) fn rows_between_turns(&self, processing: &Processing) -> Vec<Row> {
        let period = self.rate_hz / processing.cutoff_hz;
        let mut rows =
            rows_of(&self.dq, &processing.standstill_speed, period, processing.turn_margin);
        skip_ends(&mut rows, &self.inner);
        rows
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Samples at which the filter of the equations does not show either where the log begins and
    /// ends. Derivatives are wrong there, and that filter carries this inwards: a log that starts
    /// in full motion would seem to start with a contact, or with outliers.
    ///
    /// - `filter`: that of the equations
    pub(crate) fn settled(&self, filter: &LowPass) -> std::ops::Range<usize> {
        /// A log that is short for its filter keeps what is left.
        const MOST: f64 = 0.05;
        let samples = self.len();
        let Some(first) = self.inner.iter().position(|inner| *inner) else { return 0..0 };
        let last = self.inner.iter().rposition(|inner| *inner).expect("the first, if no other");
        let margin = (2 * filter.settling_samples()).min((MOST * samples as f64) as usize);
        first + margin..(last + 1).saturating_sub(margin)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The motion as the dynamics takes it.
    pub fn samples(&self) -> Samples<'_> {
        Samples { q: &self.q, dq: &self.dq, ddq: &self.ddq }
    }
}

/// Takes the rows near the ends of a stretch out.
fn skip_ends(use_as: &mut [Row], inner: &[bool]) {
    let n = use_as.len() / inner.len();
    for (row, inner) in use_as.chunks_exact_mut(n).zip(inner) {
        if !inner {
            row.fill(Row::Skip);
        }
    }
}

/// A torque, zero where it is no more than the rounding of one.
fn without_rounding(torque: f64) -> f64 {
    if torque.abs() < SMALLEST_TORQUE { 0.0 } else { torque }
}

/// Samples that must remain between the ends.
const SHORTEST: usize = 10;

/// Sampling rate of a recording that is uniform enough to be differentiated.
fn uniform_rate(recording: &Recording) -> Result<f64, MotionError> {
    let source = || recording.source().to_string();
    let time = recording.time();
    let n = recording.dof();
    let since_start = |stamp: i64| seconds(time[0], stamp);
    let columns =
        [Some(("position", recording.position())), recording.torque().map(|tau| ("torque", tau))];
    for (quantity, values) in columns.into_iter().flatten() {
        if let Some(index) = values.iter().position(|value| !value.is_finite()) {
            return Err(MotionError::NotFinite {
                recording: source(),
                quantity,
                joint: recording.joint_names()[index % n].clone(),
                seconds: since_start(time[index / n]),
            });
        }
    }
    let steps: Vec<i64> = time.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
    if let Some(index) = steps.iter().position(|step| *step <= 0) {
        let seconds = since_start(time[index]);
        return Err(MotionError::TimeNotIncreasing {
            recording: source(),
            row: index + 1,
            seconds,
        });
    }
    let Some((median, jitter)) = jitter(&steps) else {
        return Err(MotionError::TooShort { recording: source(), seconds: 0.0, needed: 1.0 });
    };
    let period = median as f64 * 1e-9;
    if !(PERIODS[0]..=PERIODS[1]).contains(&period) {
        return Err(MotionError::Rate { recording: source(), period, periods: PERIODS });
    }
    if let Some(found) = recording.implausible() {
        let Implausible { quantity, joint, seconds, value, expected } = found;
        let joint = recording.joint_names()[joint].clone();
        return Err(MotionError::Implausible {
            recording: source(),
            quantity,
            joint,
            seconds,
            value,
            expected,
        });
    }
    if jitter > MOST_JITTER {
        return Err(MotionError::Irregular {
            recording: source(),
            median_ms: median as f64 * 1e-6,
            jitter_percent: 100.0 * jitter,
            rate_hz: 1e9 / median as f64,
        });
    }
    // Over the whole stretch: the median of rounded stamps is a rounded number.
    let nanoseconds = i128::from(time[time.len() - 1]) - i128::from(time[0]);
    Ok(steps.len() as f64 * 1e9 / nanoseconds as f64)
}
