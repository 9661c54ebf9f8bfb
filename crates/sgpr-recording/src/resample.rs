//! Values between samples.

use std::sync::Arc;

use super::{Channel, Recording};

/// The recording on the stamps t0, t0 + `period`, ... up to the last sample; `period` in ns, not
/// zero. See [`at_stamps`].
///
/// The time must increase strictly.
pub(super) fn resample(recording: &Recording, period: u64) -> Recording {
    let time = recording.time();
    let (Some(&first), Some(&last)) = (time.first(), time.last()) else { return recording.clone() };
    let count = first.abs_diff(last) / period;
    at_stamps(recording, (0..=count).map(|k| first.saturating_add_unsigned(k * period)).collect())
}

/// The recording on increasing stamps between its first and its last.
///
/// Positions follow a cubic Hermite curve through the samples whose slopes are those of the
/// parabola through three neighbours (Catmull-Rom for unequal steps); everything else is
/// interpolated linearly. On a sample the curve has its value; next to a value that is not finite
/// it is NaN.
///
/// The time must increase strictly.
pub(super) fn at_stamps(recording: &Recording, stamps: Vec<i64>) -> Recording {
    let places = places(recording.time(), &stamps);
    let n = recording.dof();
    let seconds = recording.time_seconds();
    let linear = |values: &[f64]| -> Vec<f64> {
        let row = |place: &BetweenSamples| {
            (0..n).map(|joint| place.linear(|i| values[i * n + joint])).collect::<Vec<_>>()
        };
        places.iter().flat_map(row).collect()
    };
    let of_channel = |channel: &Channel| {
        places.iter().map(|place| place.linear(|i| channel.values[i])).collect()
    };
    let channels = recording.channels().iter();
    Recording {
        source: recording.source.clone(),
        joint_names: recording.joint_names.clone(),
        position: Arc::new(cubic(&recording.position, n, &seconds, &places)),
        velocity: recording.velocity().map(linear).map(Arc::new),
        torque: recording.torque().map(linear).map(Arc::new),
        channels: channels
            .map(|channel| Channel { name: channel.name.clone(), values: of_channel(channel) })
            .collect(),
        notes: recording.notes.clone(),
        layout: recording.layout.clone(),
        accepted: recording.accepted.clone(),
        kept: Default::default(),
        time: Arc::new(stamps),
    }
}

/// A stamp among samples: `fraction` of the way from sample `before` to the next one.
pub(super) struct BetweenSamples {
    pub(super) before: usize,
    pub(super) fraction: f64,
}

impl BetweenSamples {
    /// The value between two samples.
    pub(super) fn linear(&self, value: impl Fn(usize) -> f64) -> f64 {
        if self.fraction == 0.0 {
            return value(self.before);
        }
        let (from, to) = (value(self.before), value(self.before + 1));
        from + self.fraction * (to - from)
    }
}

/// Where each of the increasing `stamps` lies in the strictly increasing `time`, which spans them.
fn places(time: &[i64], stamps: &[i64]) -> Vec<BetweenSamples> {
    let mut before = 0;
    let place = |&stamp: &i64| {
        while before + 1 < time.len() && time[before + 1] <= stamp {
            before += 1;
        }
        let passed = time[before].abs_diff(stamp);
        let fraction = if passed == 0 {
            0.0
        } else {
            passed as f64 / time[before].abs_diff(time[before + 1]) as f64
        };
        BetweenSamples { before, fraction }
    };
    stamps.iter().map(place).collect()
}

fn cubic(values: &[f64], n: usize, seconds: &[f64], places: &[BetweenSamples]) -> Vec<f64> {
    let slopes = slopes(values, n, seconds);
    let mut result = Vec::with_capacity(places.len() * n);
    for BetweenSamples { before, fraction } in places {
        for joint in 0..n {
            let from = before * n + joint;
            if *fraction == 0.0 {
                result.push(values[from]);
                continue;
            }
            let (to, step, u) = (from + n, seconds[before + 1] - seconds[*before], *fraction);
            // Hermite basis, with the change over the step taken out so that a constant stays
            // exact.
            let change = values[to] - values[from];
            let curve = u * u * (3.0 - 2.0 * u) * change
                + step * u * (1.0 - u) * ((1.0 - u) * slopes[from] - u * slopes[to]);
            result.push(values[from] + curve);
        }
    }
    result
}

/// Slope at each sample of the parabola through it and its neighbours, `[samples, n]`.
fn slopes(values: &[f64], n: usize, seconds: &[f64]) -> Vec<f64> {
    let samples = seconds.len();
    let mut slopes = Vec::with_capacity(values.len());
    for sample in 0..samples {
        let middle = sample.clamp(1, samples.saturating_sub(2).max(1));
        for joint in 0..n {
            let secant = |from: usize| {
                let change = values[(from + 1) * n + joint] - values[from * n + joint];
                change / (seconds[from + 1] - seconds[from])
            };
            slopes.push(match samples {
                0 | 1 => 0.0,
                2 => secant(0),
                _ => {
                    let (left, right) = (secant(middle - 1), secant(middle));
                    let span = seconds[middle + 1] - seconds[middle - 1];
                    let bend = (right - left) / span;
                    left + bend * (2.0 * seconds[sample] - seconds[middle - 1] - seconds[middle])
                }
            });
        }
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uneven(values: impl Fn(f64) -> f64) -> Recording {
        let time: Vec<i64> =
            (0..40).map(|k: i64| k * 10_000_000 + (k * k * 7 % 5) * 1_000_000).collect();
        let position: Vec<f64> = time.iter().map(|&t| values(t as f64 * 1e-9)).collect();
        let torque = Some(position.clone());
        Recording::new("test", vec!["a".into()], time, position, None, torque, vec![])
            .expect("consistent")
    }

    #[test]
    fn parabolas_are_kept() {
        let parabola = |t: f64| 1.0 - 3.0 * t + 20.0 * t * t;
        let even = resample(&uneven(parabola), 4_000_000);
        for (t, q) in even.time_seconds().iter().zip(even.position()) {
            assert!((q - parabola(*t)).abs() < 1e-12, "at {t}");
        }
        assert!(even.time().windows(2).all(|pair| pair[1] - pair[0] == 4_000_000));
    }

    #[test]
    fn torques_are_interpolated_linearly() {
        let line = |t: f64| 2.0 - 5.0 * t;
        let even = resample(&uneven(line), 3_000_000);
        for (t, tau) in even.time_seconds().iter().zip(even.torque().expect("given")) {
            assert!((tau - line(*t)).abs() < 1e-12, "at {t}");
        }
    }

    #[test]
    fn the_own_grid_changes_nothing() {
        let time = (0..10).map(|k| k * 1_000_000).collect();
        let position: Vec<f64> = (0..10).map(|k| f64::from(k * k % 7)).collect();
        let recording =
            Recording::new("test", vec!["a".into()], time, position, None, None, vec![])
                .expect("fits");
        assert_eq!(resample(&recording, 1_000_000), recording);
    }

    #[test]
    fn one_and_two_samples() {
        for samples in 1..3 {
            let time = (0..samples).map(|k| k * 10).collect();
            let position = (0..samples).map(|k| k as f64).collect();
            let recording =
                Recording::new("test", vec!["a".into()], time, position, None, None, vec![])
                    .expect("fits");
            assert_eq!(resample(&recording, 5).len() as i64, 2 * samples - 1);
        }
    }
}
