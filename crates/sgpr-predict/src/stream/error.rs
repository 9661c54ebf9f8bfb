use alloc::string::String;
use alloc::vec::Vec;

use crate::names::counted;

/// Why a model cannot be streamed, or a sample not be taken. The hidden states are as before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StreamError {
    /// An array of another length than there are joints.
    #[error("{name}: got {} for {}: one is needed for each", counted(*found, "value"), counted(*expected, "joint"))]
    Length {
        /// The array.
        name: &'static str,
        /// Its length.
        found: usize,
        /// Number of joints.
        expected: usize,
    },
    /// A number that is none.
    #[error("{name}: the value of joint {joint} is {value}, expected a finite number")]
    NotFinite {
        /// The array.
        name: &'static str,
        /// Index of the joint.
        joint: usize,
        /// The value.
        value: f64,
    },
    /// A number that is none for this, such as a share of friction above one.
    #[error("{name}: got {found}, expected {expected}")]
    OutOfRange {
        /// What the number is, as it is called in the options.
        name: String,
        /// The number.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A rate that is none.
    #[error("rate_hz: got {found}, expected a finite number above zero")]
    Rate {
        /// The rate, Hz.
        found: f64,
    },
    /// Effects that need a rate, and none given.
    #[error("{} need the rate of the calls: give rate_hz", effects.join(", "))]
    RateNeeded {
        /// Names of the effects.
        effects: Vec<String>,
    },
    /// A time between samples that is none.
    #[error("step: got {found} s, expected a finite number above zero")]
    Step {
        /// The time, s.
        found: f64,
    },
    /// A time between samples that is too short for the memory of a delay.
    #[error(
        "step: got {found} s, but a delay needs samples that are {shortest} s apart or more: give \
         a higher rate_hz"
    )]
    StepTooShort {
        /// The time, s.
        found: f64,
        /// Half of the time that the rate says, s.
        shortest: f64,
    },
    /// An effect that needs the temperature of its joint, and none given.
    #[error(
        "{effect} at {joint} needs the temperature of the joint: call set_temperature with it, in \
         °C"
    )]
    TemperatureNeeded {
        /// Name of the effect.
        effect: String,
        /// Name of the joint.
        joint: String,
    },
    /// An effect that needs a channel of the log.
    #[error("{effect} needs the channel `{channel}` of the logs, which a predictor does not have")]
    ChannelNeeded {
        /// Name of the effect.
        effect: String,
        /// Name of the channel.
        channel: String,
    },
    /// An effect that cannot be advanced sample by sample.
    #[error("{effect} cannot be streamed: {reason}")]
    NotStreamed {
        /// Name of the effect.
        effect: String,
        /// Why.
        reason: String,
    },
    /// A standard deviation, of a model without processes.
    #[error(
        "a standard deviation is that of a learned model, and this one has no Gaussian processes: \
         ask for none"
    )]
    NotLearned,
    /// A process of a learned model that cannot be asked for this.
    #[error("the Gaussian process of {joint}: {reason}")]
    Process {
        /// Name of the joint.
        joint: String,
        /// Why.
        reason: String,
    },
    /// An effect of a user that failed at this sample.
    #[error("{effect} failed: {reason}")]
    EffectFailed {
        /// Name of the effect.
        effect: String,
        /// What it says.
        reason: String,
    },
    /// A name to keep that is that of no effect of the model.
    #[error("keep: the model has no effect `{name}`; it has {}", known.join(", "))]
    UnknownEffect {
        /// The name.
        name: String,
        /// Effects of the model.
        known: Vec<String>,
    },
}
