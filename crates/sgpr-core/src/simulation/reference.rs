//! The motion that a controller shall follow.

/// A motion wanted of an arm, at every time.
pub trait Reference: Send + Sync {
    /// Number of joints n.
    fn dof(&self) -> usize;

    /// Motion at `time` (s): position, velocity and acceleration, `[n]` each, rad (m), per s, per
    /// s².
    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]);
}

/// Standing still at a position, `[n]`.
#[derive(Clone, Debug, PartialEq)]
pub struct StandStill(pub Vec<f64>);

impl Reference for StandStill {
    fn dof(&self) -> usize {
        self.0.len()
    }

    fn sample(&self, _: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        q.copy_from_slice(&self.0);
        dq.fill(0.0);
        ddq.fill(0.0);
    }
}

/// Samples of a motion, between which it is interpolated; before the first and after the last it
/// stands still there.
///
/// Between two samples the position is the quintic through position, velocity and acceleration of
/// both, so that all three are continuous and belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledReference {
    dof: usize,
    rate_hz: f64,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
}

impl SampledReference {
    /// Samples at `rate_hz`, each array `[samples, n]`.
    ///
    /// # Panics
    /// If the arrays do not hold the same samples, there is none, or the rate is not positive.
    pub fn new(dof: usize, rate_hz: f64, q: Vec<f64>, dq: Vec<f64>, ddq: Vec<f64>) -> Self {
        assert!(rate_hz > 0.0 && rate_hz.is_finite(), "a sampling rate above zero");
        assert!(!q.is_empty() && q.len().is_multiple_of(dof), "whole samples, at least one");
        assert!(
            q.len() == dq.len() && q.len() == ddq.len(),
            "position, velocity, acceleration of the same samples"
        );
        Self { dof, rate_hz, q, dq, ddq }
    }
}

impl Reference for SampledReference {
    fn dof(&self) -> usize {
        self.dof
    }

    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        let n = self.dof;
        let samples = self.q.len() / n;
        let position = time * self.rate_hz;
        let last = samples - 1;
        if position < 0.0 || position > last as f64 {
            let at = if position < 0.0 { 0 } else { last };
            q.copy_from_slice(&self.q[at * n..(at + 1) * n]);
            dq.fill(0.0);
            ddq.fill(0.0);
            return;
        }
        let nearest = position.round();
        if (position - nearest).abs() < 1e-9 {
            let row = nearest as usize * n..(nearest as usize + 1) * n;
            q.copy_from_slice(&self.q[row.clone()]);
            dq.copy_from_slice(&self.dq[row.clone()]);
            ddq.copy_from_slice(&self.ddq[row]);
            return;
        }
        let first = position.floor() as usize;
        let (s, h) = (position - first as f64, 1.0 / self.rate_hz);
        for joint in 0..n {
            let (a, b) = (first * n + joint, (first + 1) * n + joint);
            let from = [self.q[a], h * self.dq[a], h * h * self.ddq[a]];
            let to = [self.q[b], h * self.dq[b], h * h * self.ddq[b]];
            let [position, velocity, acceleration] = quintic(from, to, s);
            (q[joint], dq[joint], ddq[joint]) = (position, velocity / h, acceleration / (h * h));
        }
    }
}

/// Value, slope and curvature at `s` in [0, 1] of the quintic with given value, slope and curvature
/// at both ends.
pub(crate) fn quintic(from: [f64; 3], to: [f64; 3], s: f64) -> [f64; 3] {
    let [p0, v0, a0] = from;
    let d = [to[0] - (p0 + v0 + 0.5 * a0), to[1] - (v0 + a0), to[2] - a0];
    let c3 = 10.0 * d[0] - 4.0 * d[1] + 0.5 * d[2];
    let c4 = -15.0 * d[0] + 7.0 * d[1] - d[2];
    let c5 = 6.0 * d[0] - 3.0 * d[1] + 0.5 * d[2];
    [
        p0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))),
        v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5))),
        a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_samples_a_smooth_motion_is_followed() {
        let motion = |t: f64| [(2.0 * t).sin(), 2.0 * (2.0 * t).cos(), -4.0 * (2.0 * t).sin()];
        let samples: Vec<[f64; 3]> = (0..=100).map(|k| motion(f64::from(k) / 50.0)).collect();
        let column = |k: usize| samples.iter().map(|s| s[k]).collect::<Vec<_>>();
        let reference = SampledReference::new(1, 50.0, column(0), column(1), column(2));
        let mut found = [[0.0]; 3];
        for k in 0..997 {
            let time = f64::from(k) * 0.002;
            let [q, dq, ddq] = &mut found;
            reference.sample(time, q, dq, ddq);
            // The remainder of a quintic: (2 h)^6 / 46080 in the value, more in its derivatives.
            for (order, (found, expected)) in found.iter().zip(motion(time)).enumerate() {
                let tolerance = [1e-12, 1e-9, 1e-6][order];
                assert!((found[0] - expected).abs() < tolerance, "derivative {order} at {time}");
            }
        }
        let [q, dq, ddq] = &mut found;
        reference.sample(3.0, q, dq, ddq);
        assert_eq!((q[0], dq[0]), (samples[100][0], 0.0));
    }
}
