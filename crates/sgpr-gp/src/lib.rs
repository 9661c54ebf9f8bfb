//! Gaussian processes: kernels, exact inference by Cholesky, hyperparameters by marginal
//! likelihood, a sparse process for more data than exact inference can take, and predictors for
//! controllers.
//!
//! y = f(x) + noise, f ~ GP(0, k), one process per output. What is learned is the residual of a
//! physical model, so the prior mean is zero: far from the data the prediction returns
//! to the physics, and its variance to k(x, x).
//!
//! Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006);
//! thesis 4-3, appendix B.

#![warn(clippy::too_many_lines)]
#![forbid(unsafe_code)]

mod budget;
mod data;
mod error;
mod exact;
mod fading_noise;
mod induced;
mod leave_one_out;
mod likelihood;
mod matrix;
mod minimise;
mod predictor;
mod search;
mod shared_predictor;
mod sparse;
mod sparse_search;
mod subset;

pub use budget::Inference;
pub use data::{Compute, Data};
pub use error::GpError;
pub use exact::{GaussianProcess, Prediction};
use induced::InducedProcess;
pub use leave_one_out::{Calibration, LeaveOneOut};
pub use likelihood::{Likelihood, LikelihoodMemory};
pub use minimise::SearchStatus;
pub use predictor::PredictorOptions;
pub use search::{SearchOptions, SearchReport, search};
pub use sgpr_numeric::progress;
pub use sgpr_predict::gp::{
    Covariance, GpPredictor, Input, Kernel, KernelError, Precision, Shape, SharedPredictor,
    Stationary, WeightedKernel,
};
use sgpr_predict::internal as kernels;
pub use shared_predictor::shared_predictor;
pub use sparse::{SparseBound, SparseGaussianProcess, SparseGradient};
pub use sparse_search::{SparseOptions, SparseReport, search_sparse};
pub use subset::{informative_points, spread_points};

/// What `sgpr-core` takes of this crate beside its interface. No part of that: it changes without
/// notice, and so do methods that the documentation does not list.
#[doc(hidden)]
pub mod internal {
    pub use crate::fading_noise::FadingNoise;
    pub use crate::induced::{Evidence, InducedProcess};
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
