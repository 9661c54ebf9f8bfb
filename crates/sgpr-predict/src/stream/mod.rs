//! A torque model sample by sample: hidden states, times and delays are carried from call to call.

mod error;
mod options;
mod plain;
mod predictor;
mod residual;
mod sampler;
mod start;
mod steps;

pub use error::StreamError;
pub use options::{Purpose, StreamOptions, UnknownPurpose};
pub use plain::Plain;
pub use predictor::{Predictor, SavedStates};
pub use residual::ResidualOptions;
use steps::TermSteps;

/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::residual::{BasisParts, ResidualJoint, ResidualPredictor, base_value, together};
    pub use super::sampler::Sampler;
    pub use super::start::StreamStart;
    pub use super::steps::TermSteps;
}
