//! Position, velocity, acceleration and torque from samples as they come.

use alloc::vec::Vec;

use super::OnlineError;
use super::error::{require, require_positive};
#[cfg(not(feature = "std"))]
use crate::math::Float;

/// The same two low-passes in a row on position and torque, and differences of what comes out: four
/// signals with the same delay, as a regression needs them. Owns its buffers; an update allocates
/// nothing.
///
/// Dry friction jumps when a joint turns, and the filter makes a slope of the jump. The joint turns
/// before its filtered velocity does, so a joint counts as moving only if it will still do so some
/// time constants ahead, and once the filter has forgotten the last time it did not.
///
/// Source: P. C. Young, Parameter estimation for continuous-time models - a survey, Automatica
/// 17(1) (1981), state variable filters.
#[derive(Clone, Debug)]
pub struct MotionFilter {
    period: f64,
    /// Share of the way that a low-pass goes in one period.
    share: f64,
    standstill_speed: f64,
    /// Samples until the filter has forgotten.
    settling: usize,
    samples: usize,
    /// Both stages of the position, `[2, n]`.
    stages_q: Vec<f64>,
    stages_tau: Vec<f64>,
    tau_before: Vec<f64>,
    /// The last three filtered positions, the latest first, `[3, n]`.
    positions: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    tau: Vec<f64>,
    since_rest: Vec<usize>,
    moving: Vec<bool>,
}

/// Time constants after which a jump is forgotten to two percent by two low-passes.
const SETTLING: f64 = 6.0;

/// Time constants by which the filtered velocity is behind, two, and one more.
const LOOK_AHEAD: f64 = 3.0;

impl MotionFilter {
    /// - `period`: time from one sample to the next, s
    /// - `cutoff_hz`: of each low-pass; a tenth of the sampling rate at most
    /// - `standstill_speed`: below it a joint stands, rad/s (m/s)
    ///
    /// # Errors
    /// If a number is not positive or the cut-off too high.
    pub fn new(
        dof: usize,
        period: f64,
        cutoff_hz: f64,
        standstill_speed: f64,
    ) -> Result<Self, OnlineError> {
        require_positive("period", period)?;
        require_positive("cutoff_hz", cutoff_hz)?;
        require_positive("standstill_speed", standstill_speed)?;
        let omega = core::f64::consts::TAU * cutoff_hz;
        if cutoff_hz * period > 0.1 {
            let expected = "at most a tenth of the sampling rate";
            return Err(OnlineError::InvalidOption {
                option: "cutoff_hz",
                value: cutoff_hz,
                expected,
            });
        }
        let zeros = vec![0.0; dof];
        Ok(Self {
            period,
            share: -(-omega * period).exp_m1(),
            standstill_speed,
            settling: (SETTLING / (omega * period)).ceil() as usize,
            samples: 0,
            stages_q: vec![0.0; 2 * dof],
            stages_tau: vec![0.0; 2 * dof],
            tau_before: zeros.clone(),
            positions: vec![0.0; 3 * dof],
            q: zeros.clone(),
            dq: zeros.clone(),
            ddq: zeros.clone(),
            tau: zeros,
            since_rest: vec![0; dof],
            moving: vec![false; dof],
        })
    }

    /// One sample.
    ///
    /// - `q`: `[n]`, rad (m)
    /// - `tau`: torque of the drives since the sample before, `[n]`, N·m (N)
    ///
    /// # Errors
    /// If a slice is not of length n or a value not finite; nothing changes then.
    pub fn update(&mut self, q: &[f64], tau: &[f64]) -> Result<(), OnlineError> {
        let n = self.q.len();
        require("q", q, n)?;
        require("tau", tau, n)?;
        let first = self.samples == 0;
        self.samples += 1;
        let period = self.period;
        self.positions.copy_within(0..2 * n, n);
        for j in 0..n {
            if first {
                self.tau_before[j] = tau[j];
            }
            // At the sample before: the torque of the period to it and that of the period from it.
            let at_sample = 0.5 * (self.tau_before[j] + tau[j]);
            self.tau_before[j] = tau[j];
            for (stages, input) in [(&mut self.stages_q, q[j]), (&mut self.stages_tau, at_sample)] {
                if first {
                    (stages[j], stages[n + j]) = (input, input);
                }
                stages[j] += self.share * (input - stages[j]);
                stages[n + j] += self.share * (stages[j] - stages[n + j]);
            }
            self.positions[j] = self.stages_q[n + j];
            if first {
                (self.positions[n + j], self.positions[2 * n + j]) = (q[j], q[j]);
            }
            let [after, now, before] = [0, 1, 2].map(|k| self.positions[k * n + j]);
            self.q[j] = now;
            self.dq[j] = (after - before) / (2.0 * period);
            self.ddq[j] = (after - 2.0 * now + before) / (period * period);
            self.tau[j] = self.stages_tau[n + j];
            let ahead = self.dq[j] + LOOK_AHEAD * period / self.share * self.ddq[j];
            let slowest =
                if self.dq[j] * ahead < 0.0 { 0.0 } else { self.dq[j].abs().min(ahead.abs()) };
            self.since_rest[j] = if slowest < self.standstill_speed {
                0
            } else {
                self.since_rest[j].saturating_add(1)
            };
            self.moving[j] = self.since_rest[j] > self.settling && self.samples > self.settling;
        }
        Ok(())
    }

    /// Filtered positions, `[n]`, rad (m).
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Filtered velocities, `[n]`, rad/s (m/s).
    pub fn dq(&self) -> &[f64] {
        &self.dq
    }

    /// Filtered accelerations, `[n]`, rad/s² (m/s²).
    pub fn ddq(&self) -> &[f64] {
        &self.ddq
    }

    /// Filtered torques, `[n]`, N·m (N).
    pub fn tau(&self) -> &[f64] {
        &self.tau
    }

    /// Which joints have been moving for as long as the filter remembers, `[n]`.
    pub fn moving(&self) -> &[bool] {
        &self.moving
    }

    /// Samples that tell as much as one independent sample: four time constants of the low-pass.
    pub(super) fn samples_per_independent_sample(&self) -> f64 {
        4.0 / -(-self.share).ln_1p()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_signals_have_the_same_delay() {
        // q and tau = ddq of a sine: whatever the filter does, tau stays ddq.
        let (period, omega) = (1e-3, 9.0);
        let mut filter = MotionFilter::new(1, period, 10.0, 1e-6).expect("valid");
        let mut worst: f64 = 0.0;
        for k in 0..4000 {
            let time = f64::from(k) * period;
            // A torque held over the period before the sample has the acceleration of its middle.
            let middle = time - 0.5 * period;
            let acceleration = -omega * omega * (omega * middle).sin();
            filter.update(&[(omega * time).sin()], &[acceleration]).expect("finite");
            if k > 1000 {
                worst = worst.max((filter.tau()[0] - filter.ddq()[0]).abs());
                let amplitude = filter.q()[0].hypot(filter.dq()[0] / omega);
                // Two first-order low-passes: 1 / (1 + (9 / 20 pi)²).
                assert!((amplitude - 0.9799).abs() < 2e-3, "{amplitude}");
            }
        }
        // Differences over a period: (omega period)² / 12 of the acceleration, twice.
        assert!(worst < 81.0 * 2e-5, "{worst:e}");
    }

    #[test]
    fn a_joint_that_is_about_to_turn_does_not_count() {
        let mut filter = MotionFilter::new(1, 1e-3, 10.0, 0.01).expect("valid");
        let mut counted = 0;
        for k in 0..4000 {
            let time = 1e-3 * f64::from(k);
            filter.update(&[(2.0 * time).sin()], &[0.0]).expect("finite");
            // The true velocity, 2 cos(2 t), at the sample: of the sign of the filtered one
            // wherever the joint counts.
            let turned = filter.dq()[0] * (2.0 * time).cos() < 0.0;
            assert!(!(turned && filter.moving()[0]), "at {time} s");
            counted += u32::from(filter.moving()[0]);
        }
        assert!(counted > 2500, "{counted} of 4000");
    }

    #[test]
    fn a_joint_moves_once_the_filter_has_forgotten_its_rest() {
        let mut filter = MotionFilter::new(1, 1e-3, 10.0, 0.01).expect("valid");
        for k in 0..300 {
            filter.update(&[0.2 * 1e-3 * f64::from(k)], &[0.0]).expect("finite");
            if k < 95 {
                assert!(!filter.moving()[0], "after {k} samples");
            }
        }
        assert!(filter.moving()[0]);
        assert!(MotionFilter::new(1, 1e-3, 200.0, 0.01).is_err());
        assert!(
            filter.update(&[f64::NAN], &[0.0]).is_err()
                && filter.update(&[0.0, 0.0], &[0.0]).is_err()
        );
    }
}
