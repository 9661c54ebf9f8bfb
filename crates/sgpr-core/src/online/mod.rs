//! A torque model that follows the arm while it runs: a payload picked up, and a residual that
//! changes.
//!
//! The models are those of `sgpr-predict`; [`AdaptiveFeedForward`] lets a controller of the
//! simulator use one.

mod controller;

pub use controller::AdaptiveFeedForward;
pub use sgpr_predict::online::{
    Budget, MotionFilter, OnlineError, OnlineGaussianProcess, OnlineModel, OnlineOptions,
    PayloadOptions, PayloadTracker, process_kernel,
};
