//! Filters, derivatives and spectra of uniformly sampled signals; knows nothing of robots.
//!
//! Arrays are `[samples, columns]`, row-major: a filter runs down the samples of every column at
//! once.

mod autoregression;
mod butterworth;
mod differentiate;
mod error;
mod low_pass;
mod savitzky_golay;
mod spectrum;

pub use differentiate::Differentiation;
pub use error::SignalError;
pub use low_pass::LowPass;
pub use spectrum::{CutoffChoice, Spectrum, choose_cutoff};

/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::autoregression::Autoregression;
    pub use super::low_pass::HIGHEST_ORDER;
    pub use super::spectrum::power_by_order;
}
