use alloc::string::{String, ToString};

use super::Channel;
use super::JointState;
#[cfg(feature = "simd")]
use crate::dynamics::Samples;
use crate::robot::Robot;
#[cfg(feature = "trajectories")]
use crate::signal::Differentiation;
use crate::simd::Number;

/// A stretch of a trajectory and what a model says of it: everything that an effect may depend on.
///
/// Arrays are `[samples, n]`, row-major, SI.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Context<'a> {
    /// The robot with the inertias of the model.
    pub robot: &'a Robot,
    /// Sampling rate, Hz; NaN if the samples are not evenly spaced.
    pub rate_hz: f64,
    /// Time of the session, `[samples]`, s; empty if it is not known.
    pub time: &'a [f64],
    /// Positions, rad (m).
    pub q: &'a [f64],
    /// Velocities, rad/s (m/s).
    pub dq: &'a [f64],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a [f64],
    /// Torque of the rigid body, N·m (N).
    pub rigid_torque: &'a [f64],
    /// Torque of the rigid body and the effects that the model has everywhere, N·m (N).
    pub torque: &'a [f64],
    /// What else was logged.
    pub channels: &'a [Channel],
}

impl<'a> Context<'a> {
    setters! {
        with_robot(robot: &'a Robot),
        with_rate_hz(rate_hz: f64),
        with_time(time: &'a [f64]),
        with_q(q: &'a [f64]),
        with_dq(dq: &'a [f64]),
        with_ddq(ddq: &'a [f64]),
        with_rigid_torque(rigid_torque: &'a [f64]),
        with_torque(torque: &'a [f64]),
        with_channels(channels: &'a [Channel]),
    }
}

impl<'a> Context<'a> {
    /// A motion of which nothing but itself is known: no torques, no channels.
    #[cfg(feature = "simd")]
    pub fn new(robot: &'a Robot, rate_hz: f64, time: &'a [f64], motion: Samples<'a>) -> Self {
        let Samples { q, dq, ddq } = motion;
        Self { robot, rate_hz, time, q, dq, ddq, rigid_torque: &[], torque: &[], channels: &[] }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.robot.dof()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.q.len() / self.dof()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }

    /// Motion at sample `k`.
    pub fn state(&self, k: usize) -> JointState<'a> {
        let row = k * self.dof()..(k + 1) * self.dof();
        JointState { q: &self.q[row.clone()], dq: &self.dq[row.clone()], ddq: &self.ddq[row] }
    }

    /// Values of one joint in a `[samples, n]` array.
    pub fn of_joint(&self, array: &'a [f64], joint: usize) -> impl Iterator<Item = f64> + 'a {
        array.iter().skip(joint).step_by(self.dof()).copied()
    }

    /// Root mean square of one joint's values in a `[samples, n]` array.
    pub fn rms(&self, array: &[f64], joint: usize) -> f64 {
        let squares: f64 = array.iter().skip(joint).step_by(self.dof()).map(|x| x * x).sum();
        Number::sqrt(squares / self.len().max(1) as f64)
    }

    /// The channel that holds a temperature in degrees Celsius, of `joint` if there is one of its
    /// own.
    pub fn temperature_celsius(&self, joint: usize) -> Option<&'a [f64]> {
        let name = &self.robot.joints()[joint].name;
        let number = (joint + 1).to_string();
        let words = |channel: &&Channel| {
            let lower = channel.name.to_lowercase();
            lower.contains("temp") || lower.starts_with("t_joint")
        };
        let of_joint = |channel: &&Channel| {
            let digits: String = channel.name.chars().filter(char::is_ascii_digit).collect();
            channel.name.contains(name.as_str()) || digits == number
        };
        let general = |channel: &&Channel| !channel.name.chars().any(|c| c.is_ascii_digit());
        let all = || {
            self.channels
                .iter()
                .filter(words)
                .filter(|channel| channel.values.iter().all(|v| v.is_finite()))
        };
        all()
            .find(of_joint)
            .or_else(|| all().find(general))
            .map(|channel| channel.values.as_slice())
    }
}

/// Motion of the links, `[samples, n]`, where a transform makes it differ from the measured one.
#[cfg(feature = "trajectories")]
#[derive(Clone, Debug, PartialEq)]
pub struct LinkMotion {
    /// Positions, rad (m).
    pub q: Vec<f64>,
    /// Velocities, rad/s (m/s).
    pub dq: Vec<f64>,
    /// Accelerations, rad/s² (m/s²).
    pub ddq: Vec<f64>,
}

#[cfg(feature = "trajectories")]
impl LinkMotion {
    /// Adds a deflection of `joint`, `[samples]`, and its derivatives. Without a sampling rate only
    /// the position moves.
    pub fn deflect(&mut self, joint: usize, deflection: &[f64], rate_hz: f64) {
        let n = self.q.len() / deflection.len().max(1);
        let add = |target: &mut [f64], values: &[f64]| {
            target
                .iter_mut()
                .skip(joint)
                .step_by(n)
                .zip(values)
                .for_each(|(target, value)| *target += value);
        };
        add(&mut self.q, deflection);
        let differentiation = Differentiation::Central { accuracy: 4 };
        if rate_hz.is_finite()
            && let Ok((velocity, acceleration)) =
                differentiation.derivatives(deflection, 1, rate_hz)
        {
            add(&mut self.dq, &velocity);
            add(&mut self.ddq, &acceleration);
        }
    }
}
