//! A torque model sample by sample, compared with logs; the predictor itself is that of `sgpr-predict`.

mod compare;

pub use compare::{StreamedMotion, compare_streaming};
pub use sgpr_predict::stream::{Predictor, Purpose, SavedStates, StreamError, StreamOptions, UnknownPurpose};
pub(crate) use sgpr_predict::stream::{Sampler, StreamStart, TermSteps};
