//! What effects beside the rigid body are computed from.

use derive_setters::Setters;

use crate::dynamics::Samples;
use crate::effects::LinkMotion;
use crate::motion::Motion;
use crate::recording::Channel;
use crate::robot::Robot;

/// Evenly sampled motion with what effects may depend on beside it. Arrays are `[samples, n]`,
/// row-major, SI.
#[derive(Clone, Copy, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Trajectory<'a> {
    /// Joint motion.
    pub samples: Samples<'a>,
    /// Sampling rate, Hz; NaN if it is not known: delays and elastic joints are then left out.
    pub rate_hz: f64,
    /// Time of the model's session, `[samples]`, s; empty if it is not known: effects of time are
    /// then left out.
    pub time: &'a [f64],
    /// What else was logged.
    pub channels: &'a [Channel],
}

impl<'a> Trajectory<'a> {
    /// Samples alone: effects that need time, a sampling rate or a channel are left out.
    pub fn of_samples(samples: Samples<'a>) -> Self {
        Self { samples, rate_hz: f64::NAN, time: &[], channels: &[] }
    }

    /// A processed stretch of a log.
    ///
    /// - `time`: of [`TorqueModel::time_of`](super::TorqueModel::time_of)
    pub fn of(motion: &'a Motion, time: &'a [f64]) -> Self {
        Self {
            samples: motion.samples(),
            rate_hz: motion.rate_hz,
            time,
            channels: &motion.channels,
        }
    }
}

/// The rigid body as the transforms of a model make it.
pub(crate) struct Rigid {
    pub robot: Robot,
    /// Motion of the links, where it is not the measured one.
    pub motion: Option<LinkMotion>,
    pub rigid_torque: Vec<f64>,
    /// With the effects that the model has everywhere.
    pub torque: Vec<f64>,
}
