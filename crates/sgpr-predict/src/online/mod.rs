//! A torque model that follows the arm while it runs: a payload picked up, and a residual that
//! changes.
//!
//! [`MotionFilter`] makes velocity and acceleration from encoders as they come; [`PayloadTracker`]
//! estimates the ten inertial parameters of what a link holds, recursively;
//! [`OnlineGaussianProcess`] learns the residual with a budget of points, which come and go by
//! updates of one Cholesky factor. [`OnlineModel`] puts them on top of an identified model. No
//! update allocates.

mod error;
mod filter;
mod gaussian_process;
mod model;
mod payload;

pub use error::OnlineError;
pub use filter::MotionFilter;
pub use gaussian_process::{Budget, OnlineGaussianProcess};
pub use model::{OnlineModel, OnlineOptions, process_kernel};
pub use payload::{PayloadOptions, PayloadTracker};
