//! How wrong a model is of a joint that moves, and of one that rests.

use alloc::vec::Vec;

#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd;

/// Standard deviation of a model's torque at one joint:
///
/// variance = moving² + resting² r, r = 1 / (1 + (dq / speed)²),
///
/// because dry friction of a joint that rests, or turns back, has any value up to that at which the
/// joint breaks away, and no model of the velocity knows which.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct JointError {
    /// While the joint moves, N·m (N).
    pub moving: f64,
    /// What rest adds, as a standard deviation, N·m (N).
    pub resting: f64,
    /// Speed at which half of the variance of rest is left, rad/s (m/s).
    pub speed: f64,
}

/// What an observer said along a log without contact, and the speeds of the joint.
pub(super) struct ContactFree {
    pub error: Vec<f64>,
    pub speed: Vec<f64>,
}

/// Speeds that are tried: the root mean square of the log over 2 to this power, and all between.
const HALVINGS: i32 = 10;

/// Steps of the scoring; it converges in some ten.
const STEPS: usize = 40;

/// Least share of the mean square that is left to a moving joint, so that a variance is never zero.
const LEAST_SHARE: f64 = 1e-6;

impl JointError {
    /// The same whether the joint moves or not.
    pub(super) fn even(deviation: f64) -> Self {
        Self { moving: deviation, resting: 0.0, speed: 1.0 }
    }

    /// How much a joint rests: 1 at rest, 0 when it moves fast.
    pub(super) fn rest<S: simd::Number>(&self, dq: S) -> S {
        ((dq / self.speed).squared() + 1.0).recip()
    }

    /// Of a torque with this share of rest in it.
    pub(super) fn deviation<S: simd::Number>(&self, rest: S) -> S {
        (rest * (self.resting * self.resting) + self.moving * self.moving).sqrt()
    }

    /// Of largest likelihood under normal errors, of the speeds that are tried and all variances.
    ///
    /// - `blend`: share of a new sample in what the observer says
    ///
    /// None if there is no error at all.
    pub(super) fn fit(logs: &[ContactFree], blend: f64) -> Option<Self> {
        let samples: usize = logs.iter().map(|log| log.error.len()).sum();
        let mean_square = |of: fn(&ContactFree) -> &[f64]| {
            logs.iter().flat_map(of).map(|x| x * x).sum::<f64>() / samples.max(1) as f64
        };
        let (error, speed) = (mean_square(|log| &log.error), mean_square(|log| &log.speed));
        if !(error > 0.0 && error.is_finite()) {
            return None;
        }
        let even = (Self::even(error.sqrt()), 1.0 + error.ln());
        let tried = (1..=HALVINGS).filter(|_| speed > 0.0).map(|k| {
            let speed = speed.sqrt() * 0.5f64.powi(k);
            fit_variances(logs, speed, error, blend)
        });
        // Of equals the even one: rest has to show.
        let better =
            |best: (Self, f64), other: (Self, f64)| if other.1 < best.1 { other } else { best };
        Some(tried.fold(even, better).0)
    }
}

/// The variances of largest likelihood by Fisher's scoring, and what is left of the negative
/// logarithm of it per sample, doubled.
fn fit_variances(
    logs: &[ContactFree],
    speed: f64,
    mean_square: f64,
    blend: f64,
) -> (JointError, f64) {
    let shape = JointError { moving: 0.0, resting: 0.0, speed };
    let mut rests = Vec::new();
    for log in logs {
        let mut rest = RestShare::default();
        rests.extend(log.speed.iter().map(|dq| rest.next(&shape, *dq, blend)));
    }
    let squares = || logs.iter().flat_map(|log| &log.error).map(|error| error * error).zip(&rests);
    let least = LEAST_SHARE * mean_square;
    let (mut moving, mut resting) = (mean_square, mean_square);
    for _ in 0..STEPS {
        // Least squares of the squared errors over 1 and the share of rest, weighted by their own
        // variance.
        let [mut ww, mut wr, mut rr, mut we, mut re] = [0.0; 5];
        for (square, rest) in squares() {
            let variance = moving + resting * rest;
            let weight = 1.0 / (variance * variance);
            ww += weight;
            wr += weight * rest;
            rr += weight * rest * rest;
            we += weight * square;
            re += weight * rest * square;
        }
        let determinant = ww * rr - wr * wr;
        (moving, resting) = ((rr * we - wr * re) / determinant, (ww * re - wr * we) / determinant);
        if resting.is_nan() || resting <= 0.0 {
            (moving, resting) = (we / ww, 0.0);
        } else if moving < least {
            (moving, resting) = (least, ((re - least * wr) / rr).max(0.0));
        }
    }
    let cost = |(square, rest): (f64, &f64)| {
        let variance = moving + resting * rest;
        square / variance + variance.ln()
    };
    let costs: f64 = squares().map(cost).sum();
    (
        JointError { moving: moving.sqrt(), resting: resting.sqrt(), speed },
        costs / rests.len() as f64,
    )
}

/// Share of rest in what an observer says: as the errors it goes through the observer's lag, and is
/// that of the first sample at first. The square of a mean of errors is at most the mean of their
/// squares, so that this is at most too much.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RestShare<S = f64>(Option<S>);

impl<S: simd::Number> RestShare<S> {
    pub(super) fn next(&mut self, of: &JointError, dq: S, blend: f64) -> S {
        let now = of.rest(dq);
        let last = self.0.unwrap_or(now);
        let rest = last + (now - last) * blend;
        self.0 = Some(rest);
        rest
    }
}
