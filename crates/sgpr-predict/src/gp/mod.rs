//! Gaussian processes that are asked: kernels, means, variances. They are learned by `sgpr-core`,
//! or [while the arm runs](crate::online).
//!
//! y = f(x) + noise, f ~ GP(0, k). What is learned is the residual of a physical model,
//! so the prior mean is zero: far from the data the prediction returns to the physics, and its
//! variance to k(x, x).
//!
//! Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006).

mod covariance;
mod error;
pub(crate) mod kernels;
mod learned;
mod predictor;
mod shared_predictor;
mod triangular;

pub use covariance::Covariance;
pub use error::KernelError;
pub use kernels::{Input, Kernel, Shape, Stationary};
pub(crate) use learned::{LearnedProcess, Seen};
pub use predictor::{GpPredictor, Precision};
pub(crate) use predictor::{Parts, VarianceParts, WeightRows};

/// For [`crate::internal`].
pub(crate) mod parts {
    #[cfg(feature = "simd")]
    pub use super::kernels::Grid;
    pub use super::kernels::{Element, Features, Plan, TILE, padded, spreads};
    pub use super::predictor::{Parts, VarianceParts, WeightRows};
}
pub use shared_predictor::{SharedPredictor, WeightedKernel};
