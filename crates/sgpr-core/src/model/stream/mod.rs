//! A torque model sample by sample, compared with logs; the predictor itself is that of `sgpr-predict`.

mod compare;

pub use compare::{StreamedMotion, compare_streaming};
pub(crate) use sgpr_predict::internal::{Sampler, StreamStart, TermSteps};
pub use sgpr_predict::stream::{
    Predictor, Purpose, RestOptions, SavedStates, StreamError, StreamOptions, UnknownPurpose,
};
