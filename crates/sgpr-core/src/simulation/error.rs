use sgpr_predict::names::counted;

use crate::progress::Interrupted;

/// Why a simulation was not done, or stopped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// An option without meaning.
    #[error("{option} is {value}: {expected}")]
    InvalidOption {
        /// Option.
        option: &'static str,
        /// Given value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// One value per joint is needed.
    #[error("{what}: got {} for {}: give one for each", counted(*found, "value"), counted(*expected, "joint"))]
    Length {
        /// Array.
        what: &'static str,
        /// Joints of the robot.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// More samples than fit.
    #[error(
        "{samples} samples need {needed_gb:.1} GB, {limit_gb:.1} GB may be taken: choose a shorter \
         duration or delay, or a longer `record_period`"
    )]
    TooLong {
        /// Samples of the record.
        samples: usize,
        /// Memory needed, GB.
        needed_gb: f64,
        /// Memory that may be taken, GB.
        limit_gb: f64,
    },
    /// A drive that no machine has.
    #[error("the {quantity} of joint `{joint}` is {value}: it is finite and not negative")]
    InvalidDrive {
        /// Joint.
        joint: String,
        /// Field of the drive.
        quantity: &'static str,
        /// Given value.
        value: f64,
    },
    /// A joint moves no inertia: no torque gives it a finite acceleration.
    #[error("joint `{joint}` moves no inertia at {time} s: give its drive a rotor inertia")]
    NoInertia {
        /// Joint.
        joint: String,
        /// Time, s.
        time: f64,
    },
    /// A joint ran away.
    #[error(
        "joint `{joint}` ran away: its speed is {speed:.3e} at {time:.6} s (more than {limit}); \
         lower the gains, take a shorter step or control period, or raise `speed_limit`"
    )]
    Unstable {
        /// Joint.
        joint: String,
        /// Time, s.
        time: f64,
        /// Speed, rad/s (m/s); may be NaN.
        speed: f64,
        /// Highest speed that is taken for motion.
        limit: f64,
    },
    /// The controller or a torque beside the rigid body gave NaN or infinity.
    #[error(
        "the {source_name} gives {value} for joint `{joint}` at {time:.6} s: a torque is a finite \
         number"
    )]
    NotFinite {
        /// Who gave it.
        source_name: &'static str,
        /// Joint.
        joint: String,
        /// Time, s.
        time: f64,
        /// The value.
        value: f64,
    },
    /// An effect of a model that the simulator cannot compute step by step.
    #[error("the simulator cannot follow the effect `{name}` of the model: {reason}")]
    Effect {
        /// Effect.
        name: String,
        /// Why.
        reason: &'static str,
    },
    /// The listener stopped the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
