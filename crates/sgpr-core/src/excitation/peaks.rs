//! The largest values of a motion, between samples too.

use serde::{Deserialize, Serialize};

use super::{MotionLimits, Trajectory};
use crate::dynamics::{Workspace, rnea};
use crate::effects::JointState;
use crate::identification::ParameterSet;
use crate::robot::Robot;
use crate::simulation::Reference;

/// Largest values of a motion in continuous time, `[n]` each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Peaks {
    /// Lowest and highest position, rad (m).
    pub position: Vec<[f64; 2]>,
    /// Highest speed, rad/s (m/s).
    pub velocity: Vec<f64>,
    /// Highest acceleration, rad/s² (m/s²).
    pub acceleration: Vec<f64>,
    /// Highest torque, N·m (N).
    pub torque: Vec<f64>,
}

/// Grid points per turn of the fastest component; between them the peaks are refined.
const POINTS_PER_TURN: f64 = 48.0;

/// Largest values of a motion: a fine grid, and around each of its local maxima a golden-section
/// search, which leaves rounding.
///
/// - `parameters`: of `set`, what the torque is computed with
///
/// # Panics
/// If `parameters` has another length than the set.
pub fn peaks(
    robot: &Robot,
    set: &ParameterSet,
    parameters: &[f64],
    trajectory: &Trajectory,
) -> Peaks {
    assert_eq!(parameters.len(), set.len(), "every parameter of the set");
    let n = robot.dof();
    let moving = robot.clone().with_standard_parameters(&parameters[..set.inertial()]);
    let mut ws = Workspace::new(&moving);
    let mut motion = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    // Position up, position down, speed, acceleration, torque of every joint.
    let mut values = move |time: f64, out: &mut [f64]| {
        let [q, dq, ddq] = &mut motion;
        trajectory.sample(time, q, dq, ddq);
        let (own, tau) = out.split_at_mut(4 * n);
        tau.copy_from_slice(rnea(&moving, &mut ws, q, dq, ddq));
        set.add_effect_torque(parameters, &JointState { q, dq, ddq }, tau);
        for joint in 0..n {
            own[joint] = q[joint];
            own[n + joint] = -q[joint];
            own[2 * n + joint] = dq[joint].abs();
            own[3 * n + joint] = ddq[joint].abs();
            tau[joint] = tau[joint].abs();
        }
    };
    let highest =
        suprema(5 * n, trajectory.duration(), trajectory.basis().shortest_time(), &mut values);
    let part = |k: usize| highest[k * n..(k + 1) * n].to_vec();
    let position = part(0).into_iter().zip(part(1)).map(|(high, low)| [-low, high]).collect();
    Peaks { position, velocity: part(2), acceleration: part(3), torque: part(4) }
}

impl Peaks {
    /// The largest share of a limit that the motion uses; one or less if it keeps within all of
    /// them.
    pub fn utilisation(&self, limits: &MotionLimits) -> f64 {
        self.shares(limits).into_iter().map(|(_, _, share)| share).fold(0.0, f64::max)
    }

    /// The share of every limit of every joint: quantity, joint, share.
    pub(super) fn shares(&self, limits: &MotionLimits) -> Vec<(&'static str, usize, f64)> {
        let torque = limits.torque.as_deref().unwrap_or_default();
        let mut shares = Vec::new();
        for joint in 0..self.velocity.len() {
            let [least, largest] = self.position[joint];
            let position =
                limits.position_share(joint, largest).max(-limits.position_share(joint, least));
            shares.push(("position", joint, position));
        }
        for (quantity, peaks, limits) in [
            ("speed", &self.velocity, &limits.velocity[..]),
            ("acceleration", &self.acceleration, &limits.acceleration),
            ("torque", &self.torque, torque),
        ] {
            shares.extend(
                peaks
                    .iter()
                    .zip(limits)
                    .enumerate()
                    .map(|(k, (peak, limit))| (quantity, k, peak / limit)),
            );
        }
        shares
    }

    /// The largest share of a limit other than torque, about `start`, so that a motion scaled by
    /// its inverse keeps within these limits.
    pub(super) fn motion_utilisation(&self, limits: &MotionLimits, start: &[f64]) -> f64 {
        let mut most = 0.0f64;
        for (joint, &q) in start.iter().enumerate() {
            let ([low, high], [least, largest]) = (limits.position[joint], self.position[joint]);
            let [up, down] = [(largest - q) / (high - q), (q - least) / (q - low)];
            let [speed, acceleration] = [
                self.velocity[joint] / limits.velocity[joint],
                self.acceleration[joint] / limits.acceleration[joint],
            ];
            most = most.max(up).max(down).max(speed).max(acceleration);
        }
        most
    }
}

/// Suprema over a duration of `count` functions, evaluated together by `values(time, out)`.
pub(super) fn suprema(
    count: usize,
    duration: f64,
    shortest_time: f64,
    values: &mut dyn FnMut(f64, &mut [f64]),
) -> Vec<f64> {
    let intervals = (POINTS_PER_TURN * duration / shortest_time).ceil() as usize;
    let step = duration / intervals as f64;
    let mut grid = vec![0.0; (intervals + 1) * count];
    for (k, row) in grid.chunks_exact_mut(count).enumerate() {
        values(k as f64 * step, row);
    }
    let mut scratch = vec![0.0; count];
    let mut found = Vec::with_capacity(count);
    for function in 0..count {
        let at = |k: usize| grid[k * count + function];
        let mut most = (0..=intervals).map(at).fold(f64::NEG_INFINITY, f64::max);
        let mut one = |time: f64| {
            values(time, &mut scratch);
            scratch[function]
        };
        // A peak between grid points rises above them by far less than the range of values.
        let least = (0..=intervals).map(at).fold(f64::INFINITY, f64::min);
        let candidate = most - 0.05 * (most - least);
        for k in 1..intervals {
            if at(k) >= candidate && at(k) >= at(k - 1) && at(k) >= at(k + 1) {
                most = most.max(golden_section(
                    &mut one,
                    (k - 1) as f64 * step,
                    (k + 1) as f64 * step,
                ));
            }
        }
        found.push(most);
    }
    found
}

/// Largest value of a function with one maximum between `low` and `high`.
fn golden_section(f: &mut dyn FnMut(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut fa, mut fb) = (f(a), f(b));
    let mut most = fa.max(fb);
    // 0.618^40 = 4e-9 of the interval; the value there is off by the square.
    for _ in 0..40 {
        if fa > fb {
            (high, b, fb) = (b, a, fa);
            a = high - RATIO * (high - low);
            fa = f(a);
        } else {
            (low, a, fa) = (a, b, fb);
            b = low + RATIO * (high - low);
            fb = f(b);
        }
        most = most.max(fa).max(fb);
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::Basis;
    use crate::robot::two_link;

    #[test]
    fn peaks_between_grid_points_are_found() {
        let robot = two_link();
        let set = ParameterSet::new(&robot, &[] as &[&str]).expect("no effects");
        let (a, b) = ([0.3, -0.2, 0.1, 0.4, -0.6, 0.2], [0.1, 0.5, -0.4, 0.0, 0.3, -0.1]);
        let motion = Trajectory::fourier(0.37, 2, &a, &b).expect("three terms");
        assert!(matches!(motion.basis(), Basis::Fourier { .. }));
        let found = peaks(&robot, &set, &robot.standard_parameters(), &motion);
        let dense = motion.samples(400_000.0 * 0.37, motion.duration());
        for joint in 0..2 {
            let most = |values: &[f64], sign: f64| {
                values
                    .iter()
                    .skip(joint)
                    .step_by(2)
                    .fold(f64::NEG_INFINITY, |most, x| most.max(sign * x))
            };
            let size = |values: &[f64]| most(values, 1.0).max(most(values, -1.0));
            assert!((found.position[joint][1] - most(&dense.q, 1.0)).abs() < 1e-9);
            assert!((found.position[joint][0] + most(&dense.q, -1.0)).abs() < 1e-9);
            assert!((found.velocity[joint] - size(&dense.dq)).abs() < 1e-9);
            assert!((found.acceleration[joint] - size(&dense.ddq)).abs() < 1e-8);
        }
    }
}
