use sgpr_predict::names::counted;

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
    #[error("{what}: got {} for {}: give one for each", counted(*found, "value"), counted(*expected, "joint"))]
    Length {
        /// Array.
        what: &'static str,
        /// Joints of the robot.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A limit that the motion needs is not known.
    #[error("joint `{joint}` has no limit of its {quantity}: give one (`{option}`)")]
    NoLimit {
        /// Joint.
        joint: String,
        /// Position or speed.
        quantity: &'static str,
        /// What gives it.
        option: &'static str,
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
    #[error(
        "the position range of joint `{joint}` is [{low}, {high}]: the lower end is below the \
         upper, both finite"
    )]
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
        "the start position breaks a limit: {what} is {value:.6}, allowed is {limit:.6}; start \
         elsewhere or relax it"
    )]
    InfeasibleStart {
        /// The limit.
        what: String,
        /// Value at the start.
        value: f64,
        /// Allowed value.
        limit: f64,
    },
    /// A limit under which nothing can move.
    #[error(
        "a motion within all limits covers no more than {room:.0e} of the position ranges; what \
         stops it is the limit on: {limit}; relax it, or start elsewhere"
    )]
    NoRoom {
        /// The limit that the motion uses most.
        limit: String,
        /// Largest share of a joint's position range that the motion covers.
        room: f64,
    },
    /// No motion that was found reveals the parameters.
    #[error(
        "the motion excites {rank} of {expected} parameters and does not tell these apart: {}; \
         take more terms, another start, wider limits, or fewer effects",
        shortened(names)
    )]
    RankDeficient {
        /// Rank of the observation matrix.
        rank: usize,
        /// Its columns.
        expected: usize,
        /// Parameters that the motion cannot tell from each other.
        names: Vec<String>,
    },
    /// Parameters of very different sizes, whose condition number is lost in rounding.
    #[error(
        "the motion excites all parameters, but their columns are of too different sizes for \
         `{criterion}`: choose d_optimality, which does not depend on their units"
    )]
    Units {
        /// Criterion.
        criterion: &'static str,
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

/// The first names of a list, and how many more there are.
fn shortened(names: &[String]) -> String {
    const MOST: usize = 8;
    let more = if names.len() > MOST {
        format!(" and {} more", names.len() - MOST)
    } else {
        String::new()
    };
    names[..names.len().min(MOST)].join(", ") + &more
}
