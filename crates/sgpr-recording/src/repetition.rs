//! Motions that come back.

use super::Recording;
use sgpr_predict::internal::rms;

/// Moments of a window, and s between them: a path of a second is alike by chance where a single
/// position is not.
const MOMENTS: usize = 5;
const BETWEEN: f64 = 0.25;

/// Two windows are the same path if they differ by less than this share of what the joints range
/// over ...
const ALIKE: f64 = 0.05;

/// ... and are none if no joint ranges over as much in them.
const STILL: f64 = 0.02;

/// Windows of the new log that are looked at, and s between windows of the known ones.
const WINDOWS: usize = 400;
const STEP: f64 = 0.02;

/// Share of its moving time in which `new` repeats paths of `known` logs, 0 to 1; none if it never
/// moves for a second, or nothing is known.
///
/// An error on a log that repeats motions of the training tells how well a model repeats what it
/// was fitted to, with all that it lacks, and not how it predicts. Paths of a second are compared,
/// deviations in units of each joint's standard deviation over the known logs. Between logs of real
/// robots with motions of their own the share is at most a third, since arms start at the same
/// pose; between logs with the same motion it is 1.
///
/// # Panics
/// If the recordings have different numbers of joints.
pub fn repeated_share(known: &[Recording], new: &Recording) -> Option<f64> {
    let n = new.dof();
    assert!(known.iter().all(|log| log.dof() == n), "joints of one robot");
    let spread: Vec<f64> = (0..n).map(|joint| spread(known, joint)).collect();
    let known: Vec<Windows<'_>> = known.iter().filter_map(|log| Windows::new(log, STEP)).collect();
    let windows = Windows::new(new, BETWEEN)?;
    let thinned = windows.starts().step_by(windows.starts().len().div_ceil(WINDOWS).max(1));
    let (mut moving, mut repeated) = (0usize, 0usize);
    for start in thinned.filter(|&start| windows.moves(start, &spread)) {
        moving += 1;
        let alike = |log: &Windows<'_>| {
            log.starts().any(|there| log.is_alike(there, &windows, start, &spread))
        };
        repeated += usize::from(known.iter().any(alike));
    }
    (moving > 0).then(|| repeated as f64 / moving as f64)
}

/// Standard deviation of the positions of a joint; infinite for one that stands.
fn spread(logs: &[Recording], joint: usize) -> f64 {
    let positions = || {
        logs.iter().flat_map(|log| log.position().iter().skip(joint).step_by(log.dof()).copied())
    };
    let mean = positions().sum::<f64>() / positions().count().max(1) as f64;
    let deviation = rms(&positions().map(|q| q - mean).collect::<Vec<_>>());
    if deviation > 1e-6 { deviation } else { f64::INFINITY }
}

/// The windows of a log.
struct Windows<'a> {
    position: &'a [f64],
    n: usize,
    /// Samples between the moments of a window, and between windows.
    lag: usize,
    step: usize,
}

impl<'a> Windows<'a> {
    fn new(log: &'a Recording, step: f64) -> Option<Self> {
        let samples =
            |seconds: f64| Some(((seconds * log.sample_rate_hz()?).round() as usize).max(1));
        let windows = Self {
            position: log.position(),
            n: log.dof(),
            lag: samples(BETWEEN)?,
            step: samples(step)?,
        };
        (log.len() > (MOMENTS - 1) * windows.lag).then_some(windows)
    }

    fn starts(&self) -> std::iter::StepBy<std::ops::Range<usize>> {
        (0..self.position.len() / self.n - (MOMENTS - 1) * self.lag).step_by(self.step)
    }

    fn moment(&self, start: usize, moment: usize) -> &[f64] {
        &self.position[(start + moment * self.lag) * self.n..][..self.n]
    }

    fn moves(&self, start: usize, spread: &[f64]) -> bool {
        (0..self.n).any(|joint| {
            let path: Vec<f64> = (0..MOMENTS)
                .map(|moment| self.moment(start, moment)[joint] / spread[joint])
                .collect();
            let mean = path.iter().sum::<f64>() / MOMENTS as f64;
            rms(&path.iter().map(|q| q - mean).collect::<Vec<_>>()) > STILL
        })
    }

    /// Leaves as soon as it is not, which is soon.
    fn is_alike(&self, start: usize, other: &Self, there: usize, spread: &[f64]) -> bool {
        let most = ALIKE.powi(2) * (MOMENTS * self.n) as f64;
        let mut squares = 0.0;
        (0..MOMENTS).all(|moment| {
            let pairs =
                self.moment(start, moment).iter().zip(other.moment(there, moment)).zip(spread);
            squares += pairs.map(|((a, b), spread)| ((a - b) / spread).powi(2)).sum::<f64>();
            squares < most
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two joints at 100 Hz for ten seconds.
    fn log(path: impl Fn(f64) -> [f64; 2]) -> Recording {
        let time: Vec<i64> = (0..1000).map(|k| k * 10_000_000).collect();
        let position = time.iter().flat_map(|t| path(*t as f64 * 1e-9)).collect();
        Recording::new("test", vec!["a".into(), "b".into()], time, position, None, None, vec![])
            .expect("a recording")
    }

    fn motion(t: f64) -> [f64; 2] {
        [(1.3 * t).sin() + 0.4 * (3.1 * t).cos(), (0.7 * t).cos() + 0.3 * (2.3 * t).sin()]
    }

    #[test]
    fn a_motion_that_comes_back_later_is_repeated() {
        let known = [log(|t| motion(t + 100.0)), log(motion)];
        assert_eq!(
            repeated_share(
                &known,
                &log(|t| motion(t + 2.503).map(|q| q + 1e-3 * (40.0 * t).sin()))
            ),
            Some(0.75)
        );
    }

    #[test]
    fn other_motions_are_not_even_with_the_same_poses() {
        let known = [log(motion)];
        let backwards = repeated_share(&known, &log(|t| motion(10.0 - t))).expect("a moving arm");
        assert!(backwards < 0.1, "{backwards}");
        let elsewhere = repeated_share(&known, &log(|t| motion(t + 50.0))).expect("a moving arm");
        assert!(elsewhere < 0.1, "{elsewhere}");
    }

    #[test]
    fn an_arm_that_stands_repeats_nothing() {
        assert_eq!(repeated_share(&[log(motion)], &log(|_| [0.3, 0.1])), None);
        assert_eq!(repeated_share(&[], &log(motion)), None);
        let short = log(motion).slice(0..50);
        assert_eq!(repeated_share(&[log(motion)], &short), None);
    }
}
