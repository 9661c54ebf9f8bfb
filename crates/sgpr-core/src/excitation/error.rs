use crate::progress::Interrupted;
use crate::recording::RecordingError;

/// Why no excitation trajectory was made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExcitationError {
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
    #[error("{what}: {found} values for {expected} joints")]
    Length {
        /// Array.
        what: &'static str,
        /// Joints of the robot.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A limit that the motion needs is not known.
    #[error("joint `{joint}` has no limit of its {quantity}: give one")]
    NoLimit {
        /// Joint.
        joint: String,
        /// Position, speed or acceleration.
        quantity: &'static str,
    },
    /// A limit that leaves no room.
    #[error("the {quantity} limit of joint `{joint}` is {value}: a limit is finite and above zero")]
    InvalidLimit {
        /// Joint.
        joint: String,
        /// Position, speed, acceleration or torque.
        quantity: &'static str,
        /// Given value.
        value: f64,
    },
    /// A position range that holds nothing.
    #[error("the position range of joint `{joint}` is [{low}, {high}]: the lower end is below the upper, both finite")]
    EmptyRange {
        /// Joint.
        joint: String,
        /// Lower end, rad (m).
        low: f64,
        /// Upper end, rad (m).
        high: f64,
    },
    /// The position in which the motion starts and ends is itself forbidden.
    #[error(
        "the start position breaks a limit: {what} is {value:.6}, allowed is {limit:.6}; start elsewhere or relax it"
    )]
    InfeasibleStart {
        /// The limit.
        what: String,
        /// Value at the start.
        value: f64,
        /// Allowed value.
        limit: f64,
    },
    /// No motion of this kind reveals the parameters.
    #[error(
        "the motion excites {rank} of {expected} base parameters: take more terms, more samples, or move more joints"
    )]
    RankDeficient {
        /// Rank of the observation matrix.
        rank: usize,
        /// Base parameters.
        expected: usize,
    },
    /// An effect that no motion of this robot can show.
    #[error("a motion cannot excite `{name}`: {reason}")]
    Effect {
        /// Effect.
        name: String,
        /// Why.
        reason: String,
    },
    /// Collision shapes that cannot be used.
    #[error("{path}: {message}")]
    Shapes {
        /// File.
        path: String,
        /// What is wrong with it, and what to do.
        message: String,
    },
    /// A frame or link that the robot does not have.
    #[error("the robot `{robot}` has no {kind} `{name}`")]
    Unknown {
        /// Robot.
        robot: String,
        /// Frame or joint.
        kind: &'static str,
        /// Name.
        name: String,
    },
    /// A file could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The listener stopped the work before there was a trajectory.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
