//! Numbers that no arm makes: they come from a wrong column, unit or clock, and arithmetic with
//! them overflows.

pub use sgpr_predict::internal::SMALLEST_TORQUE;
use sgpr_predict::internal::{LARGEST_POSITION, LARGEST_TORQUE};

use super::statistics::{first_change, first_place};
use super::{Recording, seconds};

/// Largest change of a position over a step of the time, rad/s (m/s): no joint is as fast, and
/// neither the noise of an encoder nor a position that is wrapped to a turn looks so below a
/// hundred kilohertz.
const LARGEST_SPEED: f64 = 1e6;

/// Shortest and longest median step of a log, s: a logger of a megahertz, and ten seconds, in which
/// an arm does more than any sample tells.
pub const PERIODS: [f64; 2] = [1e-6, 10.0];

/// A value that no arm makes.
#[derive(Clone, Debug, PartialEq)]
pub struct Implausible {
    /// `position` or `torque`.
    pub quantity: &'static str,
    /// Index of the joint.
    pub joint: usize,
    /// Time since the first sample, s.
    pub seconds: f64,
    /// The value.
    pub value: f64,
    /// What a value must be, and what to check.
    pub expected: String,
}

impl Recording {
    /// The first position or torque that no arm makes; values that are not finite are none of them.
    #[doc(hidden)]
    pub fn implausible(&self) -> Option<Implausible> {
        let n = self.dof();
        let at = |quantity, index: usize, value, expected| Implausible {
            quantity,
            joint: index % n,
            seconds: seconds(self.time[0], self.time[index / n]),
            value,
            expected,
        };
        let is_larger = |limit: f64| move |value: f64| value.is_finite() && value.abs() > limit;
        if let Some(index) = first_place(&self.position, is_larger(LARGEST_POSITION)) {
            let expected = format!(
                "at most {LARGEST_POSITION:e} rad (m) are possible: give the unit of the position"
            );
            return Some(at("position", index, self.position[index], expected));
        }
        if let Some(index) = self.impossible_jump() {
            let expected = format!(
                "it changes by more than {LARGEST_SPEED:e} rad/s (m/s) there: drop such samples, \
                 or give the units of position and time"
            );
            return Some(at("position", index, self.position[index], expected));
        }
        let torque = self.torque.as_deref()?;
        let index = first_place(torque, is_larger(LARGEST_TORQUE))?;
        let expected = format!(
            "at most {LARGEST_TORQUE:e} N·m (N) are possible: give the unit of the torque, or \
             torque constants for motor currents"
        );
        Some(at("torque", index, torque[index], expected))
    }

    /// The first position that no joint can have reached from the one before; an index of the
    /// array.
    fn impossible_jump(&self) -> Option<usize> {
        let n = self.dof().max(1);
        // Stamps of samples that were written together may be nearer to each other than the samples
        // were.
        let usual = Some(self.median_period()).filter(|period| *period > 0.0)?;
        // No step is shorter than this, so nothing before the first change that is larger is
        // impossible.
        let shortest = LARGEST_SPEED * usual;
        let first =
            first_change(&self.position, n, |before, now| (now - before).abs() > shortest)? / n - 1;
        let rows = self.position.chunks_exact(n).zip(self.position.chunks_exact(n).skip(1));
        rows.zip(self.time.windows(2)).enumerate().skip(first).find_map(
            |(sample, ((before, now), pair))| {
                let farthest = LARGEST_SPEED * seconds(pair[0], pair[1]).max(usual);
                let joint = (0..n).find(|&joint| (now[joint] - before[joint]).abs() > farthest)?;
                Some((sample + 1) * n + joint)
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One joint at 100 Hz.
    fn log(change: impl Fn(&mut Vec<i64>, &mut Vec<f64>, &mut Vec<f64>)) -> Recording {
        let mut time: Vec<i64> = (0..50).map(|k| k * 10_000_000).collect();
        let mut q: Vec<f64> = (0..50).map(|k| (0.1 * f64::from(k)).sin()).collect();
        let mut tau: Vec<f64> = q.iter().map(|q| 10.0 * q).collect();
        change(&mut time, &mut q, &mut tau);
        Recording::new("log", vec!["joint".into()], time, q, None, Some(tau), vec![])
            .expect("one length")
    }

    #[test]
    fn what_an_arm_may_do_is_plausible() {
        assert_eq!(log(|_, _, _| ()).implausible(), None);
        // Wrapped to a turn, at rest, missing, in other units, with stamps that were made together.
        assert_eq!(
            log(|_, q, _| q[20..].iter_mut().for_each(|q| *q += std::f64::consts::TAU))
                .implausible(),
            None
        );
        assert_eq!(
            log(|_, q, tau| q.iter_mut().chain(tau).for_each(|x| *x = 0.0)).implausible(),
            None
        );
        assert_eq!(log(|_, q, tau| (q[7], tau[8]) = (f64::NAN, f64::INFINITY)).implausible(), None);
        assert_eq!(
            log(|_, q, tau| q.iter_mut().chain(tau).for_each(|x| *x *= 1e3)).implausible(),
            None
        );
        assert_eq!(log(|time, _, _| time[30] = time[29] + 1).implausible(), None);
        assert_eq!(log(|time, _, _| time.fill(0)).implausible(), None);
        assert_eq!(
            Recording::new("none", vec![], vec![0], vec![], None, None, vec![])
                .expect("empty")
                .implausible(),
            None
        );
    }

    #[test]
    fn what_no_arm_does_is_told_with_its_place() {
        let found = |change: fn(&mut Vec<i64>, &mut Vec<f64>, &mut Vec<f64>)| {
            let found = log(change).implausible().expect("implausible");
            (found.quantity, (found.seconds * 100.0).round() as usize, found.value)
        };
        assert_eq!(found(|_, q, _| q[3..].fill(-2e9)), ("position", 3, -2e9));
        assert_eq!(found(|_, q, _| q[4] = 1e5), ("position", 4, 1e5));
        assert_eq!(found(|_, _, tau| tau[5] = 2e15), ("torque", 5, 2e15));
    }
}
