//! Filters, derivatives and spectra of uniformly sampled signals; knows nothing of robots.
//!
//! Arrays are `[samples, columns]`, row-major: a filter runs down the samples of every column at once.

mod autoregression;
mod butterworth;
mod differentiate;
mod error;
mod low_pass;
mod savitzky_golay;
mod spectrum;

#[doc(hidden)]
pub use autoregression::Autoregression;
pub use differentiate::Differentiation;
pub use error::SignalError;
#[doc(hidden)]
pub use low_pass::HIGHEST_ORDER;
pub use low_pass::LowPass;
#[doc(hidden)]
pub use spectrum::power_by_order;
pub use spectrum::{CutoffChoice, Spectrum, choose_cutoff};
