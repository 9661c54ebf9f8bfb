//! A torque model sample by sample: hidden states, times and delays are carried from call to call.

mod error;
mod options;
mod predictor;
mod sampler;
mod steps;

pub use error::StreamError;
pub use options::{Purpose, StreamOptions, UnknownPurpose};
pub use predictor::{Predictor, SavedStates};
#[doc(hidden)]
pub use sampler::{Buffers, Sampler, StreamStart};
#[doc(hidden)]
pub use steps::{TermSteps, TransformSteps};
