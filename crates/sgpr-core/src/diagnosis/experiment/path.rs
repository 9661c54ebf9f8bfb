//! Motions of one joint from rest to rest within limits, piece by piece.

use crate::simulation::quintic;

/// What a joint may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct JointLimits {
    /// Lowest and highest position, rad (m).
    pub range: [f64; 2],
    /// Highest speed, rad/s (m/s).
    pub speed: f64,
    /// Highest acceleration, rad/s² (m/s²).
    pub acceleration: f64,
}

impl JointLimits {
    /// Width of the range, rad (m).
    pub fn span(&self) -> f64 {
        self.range[1] - self.range[0]
    }
}

/// Samples of position, velocity and acceleration of one joint.
#[derive(Clone, Debug)]
pub(super) struct Path {
    pub rate_hz: f64,
    pub limits: JointLimits,
    pub samples: Vec<[f64; 3]>,
}

/// Largest speed and acceleration of a quintic from rest to rest over unit distance in unit time.
pub(super) const QUINTIC_PEAKS: [f64; 2] = [1.875, 5.773_503];

/// Largest slope of the quintic from zero to one.
const BLEND_PEAK: f64 = 1.875;

/// Shortest blend, s: an acceleration that a drive can follow.
const SHORTEST_BLEND_S: f64 = 0.08;

impl Path {
    /// Standing at `home`.
    pub fn new(home: f64, limits: JointLimits, rate_hz: f64) -> Self {
        Self { rate_hz, limits, samples: vec![[home, 0.0, 0.0]] }
    }

    pub fn position(&self) -> f64 {
        self.samples.last().expect("it begins somewhere")[0]
    }

    /// Stands still.
    pub fn hold(&mut self, seconds: f64) {
        let here = [self.position(), 0.0, 0.0];
        let count = (seconds * self.rate_hz).round() as usize;
        self.samples.extend(std::iter::repeat_n(here, count));
    }

    /// Samples of `motion` over so many seconds, ended by standing at `end`.
    fn follow(&mut self, seconds: f64, end: f64, motion: impl Fn(f64) -> [f64; 3]) {
        let count = (seconds * self.rate_hz).ceil().max(1.0) as usize;
        let scale = seconds * self.rate_hz / count as f64;
        // A whole number of samples: the motion is slowed down by less than one.
        self.samples.extend((1..count).map(|k| {
            let [q, dq, ddq] = motion(k as f64 / self.rate_hz * scale);
            [q, scale * dq, scale * scale * ddq]
        }));
        self.samples.push([end, 0.0, 0.0]);
    }

    /// Moves to a position, as fast as the limits allow times `share`.
    pub fn move_to(&mut self, target: f64, share: f64) {
        let target = target.clamp(self.limits.range[0], self.limits.range[1]);
        let start = self.position();
        let seconds = quintic_time(
            target - start,
            share * self.limits.speed,
            share * self.limits.acceleration,
        );
        if seconds <= 0.0 {
            return;
        }
        self.follow(seconds, target, |t| {
            let [x, v, a] = quintic([start, 0.0, 0.0], [target, 0.0, 0.0], t / seconds);
            [x, v / seconds, a / (seconds * seconds)]
        });
    }

    /// Moves to a position at constant speed, with smooth ends.
    pub fn ramp_to(&mut self, target: f64, speed: f64) {
        let target = target.clamp(self.limits.range[0], self.limits.range[1]);
        let speed = speed.min(self.limits.speed);
        let start = self.position();
        let blend = (BLEND_PEAK * speed / self.limits.acceleration).max(SHORTEST_BLEND_S);
        let distance = (target - start).abs();
        if distance <= speed * blend {
            self.move_to(target, 1.0);
            return;
        }
        let way = (target - start).signum();
        let cruise = distance / speed - blend;
        let total = cruise + 2.0 * blend;
        // The integral of the blend's speed over its time.
        let blended = |t: f64| {
            let s = t / blend;
            let [share, slope, _] = quintic([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], s);
            let integral = s.powi(4) * (2.5 + s * (-3.0 + s));
            [speed * blend * integral, speed * share, speed * slope / blend]
        };
        self.follow(total, target, |t| {
            let [x, v, a] = if t < blend {
                blended(t)
            } else if t <= blend + cruise {
                [speed * (0.5 * blend + t - blend), speed, 0.0]
            } else {
                let [x, v, a] = blended(total - t);
                [distance - x, v, -a]
            };
            [start + way * x, way * v, way * a]
        });
    }

    /// Sine waves about the present position, faded in and out over a period, as large as the
    /// limits and `room` allow.
    pub fn sine(&mut self, hz: f64, periods: usize, room: f64) {
        let centre = self.position();
        let (pulse, seconds, fade) = (std::f64::consts::TAU * hz, periods as f64 / hz, 1.0 / hz);
        let unit = |t: f64| {
            let (from, sign) = if t < fade { (t, 1.0) } else { (seconds - t, -1.0) };
            let [w, dw, ddw] = if from < fade {
                let [w, dw, ddw] = quintic([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], from / fade);
                [w, sign * dw / fade, ddw / (fade * fade)]
            } else {
                [1.0, 0.0, 0.0]
            };
            let (sine, cosine) = (pulse * t).sin_cos();
            [
                w * sine,
                dw * sine + w * pulse * cosine,
                ddw * sine + 2.0 * dw * pulse * cosine - w * pulse * pulse * sine,
            ]
        };
        let grid = (0..=400).map(|k| unit(seconds * f64::from(k) / 400.0));
        let peaks = grid.fold([0.0f64; 3], |[a, b, c], [x, v, w]| {
            [a.max(x.abs()), b.max(v.abs()), c.max(w.abs())]
        });
        let [low, high] = self.limits.range;
        let room = room.min(centre - low).min(high - centre).max(0.0);
        // Between the points of the grid a peak is up to one percent higher.
        let size = 0.98
            * (room / peaks[0])
                .min(self.limits.speed / peaks[1])
                .min(self.limits.acceleration / peaks[2]);
        self.follow(seconds, centre, |t| {
            let [x, v, a] = unit(t);
            [centre + size * x, size * v, size * a]
        });
    }
}

/// Time of a quintic from rest to rest within a speed and an acceleration, s.
pub(super) fn quintic_time(distance: f64, speed: f64, acceleration: f64) -> f64 {
    let distance = distance.abs();
    (QUINTIC_PEAKS[0] * distance / speed).max((QUINTIC_PEAKS[1] * distance / acceleration).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: JointLimits = JointLimits { range: [-1.0, 1.5], speed: 1.2, acceleration: 4.0 };

    /// Derivatives by differences of the samples, and the limits.
    fn check(path: &Path) {
        let step = 1.0 / path.rate_hz;
        for (k, three) in path.samples.windows(3).enumerate() {
            let [[before, ..], [x, v, a], [after, ..]] = [three[0], three[1], three[2]];
            let slope = (after - before) / (2.0 * step);
            let curvature = (after - 2.0 * x + before) / (step * step);
            // Pieces meet at rest with no acceleration; differences err by a step times the jerk.
            assert!((slope - v).abs() < 0.02, "{k}: {slope} {v}");
            assert!((curvature - a).abs() < 0.6, "{k}: {curvature} {a}");
            assert!(x > LIMITS.range[0] - 1e-9 && x < LIMITS.range[1] + 1e-9);
            assert!(
                v.abs() < LIMITS.speed * 1.0001 && a.abs() < LIMITS.acceleration * 1.0001,
                "{k}: {v} {a}"
            );
        }
    }

    #[test]
    fn pieces_fit_together_and_stay_within_limits() {
        let mut path = Path::new(0.2, LIMITS, 500.0);
        path.move_to(-3.0, 1.0);
        assert_eq!(path.position(), -1.0);
        path.hold(0.3);
        path.ramp_to(1.0, 0.3);
        path.ramp_to(0.0, 7.0);
        path.ramp_to(0.01, 1.0);
        for hz in [0.4, 1.0, 5.0] {
            path.sine(hz, 5, 2.0);
        }
        assert!((path.position() - 0.01).abs() < 1e-12);
        path.move_to(0.2, 0.5);
        check(&path);
        let fastest = path.samples.iter().map(|s| s[2].abs()).fold(0.0, f64::max);
        assert!(fastest > 0.9 * LIMITS.acceleration, "the limits are used: {fastest}");
    }
}
