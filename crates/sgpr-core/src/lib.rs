//! Torque models of robot arms: from a robot file and recorded logs to an identified model, with
//! what is missing named.
//!
//! The rooms, in the order in which they build on each other:
//!
//! - [`spatial`], [`simd`]: vectors, poses, inertias; arithmetic for one sample and for many
//! - [`robot`]: URDF and Denavit-Hartenberg robots
//! - [`dynamics`]: inverse and forward dynamics, regressor, mass matrix, kinematics
//! - [`recording`]: logs in CSV, MCAP and, with the feature `formats`, other files: reading,
//!   checking, repairing, writing (`sgpr-recording`)
//! - [`signal`]: filters, derivatives, spectra
//! - [`motion`]: from a log to filtered position, velocity and acceleration
//! - [`expression`]: arithmetic that is recorded, for code in other languages
//! - [`effects`]: friction and other physics beside the rigid body
//! - [`identification`]: base parameters, observation matrix, least squares
//! - [`gp`]: Gaussian processes, for what the physics leaves over (`sgpr-gp`)
//! - [`model`]: identify, compare, predict, save and load
//! - [`simulation`]: an arm that moves under a controller
//! - [`control`]: compensation, torque from outside
//! - [`export`]: models as source files in C and Rust
//! - [`online`]: models that learn while the arm runs: a payload, a residual that changes
//! - [`excitation`]: motions that reveal the parameters
//! - [`diagnosis`]: which physical effect the model lacks
//! - [`progress`]: how long work reports and is stopped
//! - [`threads`]: what parallel work needs in forked processes
//! - [`linalg`]: the factors and selections behind the identification
#![warn(clippy::too_many_lines)]
#![forbid(unsafe_code)]

#[cfg(test)]
mod conditioned_once;
pub mod diagnosis;
pub mod excitation;
pub mod export;
pub mod identification;
pub mod model;
pub mod motion;
pub mod online;
pub mod simulation;

/// Gaussian processes, for what the physics leaves over: the crate `sgpr-gp`.
pub mod gp {
    pub(crate) use sgpr_gp::internal::*;
    pub use sgpr_gp::*;
}

/// The factors and selections behind the identification.
pub mod linalg {
    pub(crate) use sgpr_numeric::internal::linalg::*;
    pub use sgpr_numeric::linalg::*;
    pub(crate) use sgpr_predict::internal::{dot, dot_in_lanes, mean_square, rms};
}

/// Logs of moving arms: the crate `sgpr-recording`.
pub mod recording {
    pub(crate) use sgpr_recording::internal::*;
    pub use sgpr_recording::*;
}

use sgpr_numeric::internal::{intervals, memory};
pub use sgpr_numeric::{progress, threads};
use sgpr_predict::internal::{atomic_file, limited_file};
pub use sgpr_predict::{
    control, dynamics, effects, expression, names, robot, signal, simd, spatial,
};
