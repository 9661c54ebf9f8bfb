//! Why a model could not be identified.

use sgpr_predict::names::counted;
use sgpr_predict::stream::StreamError;

use crate::effects::UnknownEffect;
use crate::identification::IdentificationError;
use crate::motion::MotionError;
use crate::progress::Interrupted;
use crate::recording::RecordingError;
use crate::signal::SignalError;

/// Why a model could not be identified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// A log does not have the robot's joints, or cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A log cannot be turned into motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// A joint that moves without any torque.
    #[error(
        "the torque of `{joint}` is zero in every sample although the joint moves, so it was not \
         measured: give the column that holds it, or leave the joint out (`joints`)"
    )]
    NoTorque {
        /// Joint.
        joint: String,
    },
    /// The parameters cannot be estimated.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// An effect that the library does not have.
    #[error(transparent)]
    Effect(#[from] UnknownEffect),
    /// Logs that cannot show an effect.
    #[error("the logs cannot show `{effect}`: {reason}")]
    NotTestable {
        /// Effect.
        effect: String,
        /// Why.
        reason: String,
    },
    /// An effect at a joint that cannot have it.
    #[error("`{effect}` cannot be at `{joint}`: {}", if known.is_empty() { "it is of the whole \
         arm, or of joints that this robot lacks".into() } else { format!("it \
         can be at {}", known.join(", ")) })]
    NoSite {
        /// Effect.
        effect: String,
        /// Joint that was asked for.
        joint: String,
        /// Joints that can have it.
        known: Vec<String>,
    },
    /// Simulations know effects of the present motion only.
    #[error(
        "simulated motions, of output error and of instruments from a controller, do not know \
         effects that follow the whole trajectory: {}",
        effects.join(", ")
    )]
    NotSimulated {
        /// Effects.
        effects: Vec<String>,
    },
    /// A filter that cannot be.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The model cannot be streamed.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// Parameters set to zero make no body.
    #[error(
        "parameters that are left out make no body: choose between consistent and essential \
         parameters"
    )]
    ConsistentAndEssential,
    /// Instruments of other motions.
    #[error(
        "the instruments hold {found} stretches of {samples:?} samples, the recordings {expected} \
         of {wanted:?}: they are the same motion at the same times; bring both to one rate and one \
         span (resample, trim)"
    )]
    Instruments {
        /// Stretches in the instruments.
        found: usize,
        /// Their samples.
        samples: Vec<usize>,
        /// Stretches in the recordings.
        expected: usize,
        /// Their samples.
        wanted: Vec<usize>,
    },
    /// Output error without its controller.
    #[error(
        "output error simulates the arm under its controller: give the gains, and the references \
         as instruments"
    )]
    NoController,
    /// Gains of other joints.
    #[error("gains: got {} for {}: give one for each", counted(*found, "gain"), counted(*joints, "joint"))]
    Gains {
        /// Gains given.
        found: usize,
        /// Joints of the robot.
        joints: usize,
    },
    /// The difference of two arms need not be an arm.
    #[error(
        "the error of an internal model is the difference of two arms and no arm itself: identify \
         it without consistency"
    )]
    ConsistentError,
    /// The listener stopped the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
