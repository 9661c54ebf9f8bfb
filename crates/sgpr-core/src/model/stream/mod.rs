//! A torque model sample by sample: hidden states, times and delays are carried from call to call.

mod compare;
mod error;
mod options;
mod predictor;
mod sampler;
mod steps;

pub use compare::{StreamedMotion, compare_streaming};
pub use error::StreamError;
pub use options::{Purpose, StreamOptions, UnknownPurpose};
pub use predictor::{Predictor, SavedStates};
pub(crate) use sampler::{Sampler, StreamStart};
pub(crate) use steps::TermSteps;
