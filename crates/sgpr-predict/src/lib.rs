//! The torque of a robot arm, one sample after the other: what a controller needs of a model, and
//! nothing else.
//!
//! A [`model::StreamedModel`] is read from a model file; its [`stream::Predictor`] gives the torque
//! of each sample, with friction that remembers, lags and delays. Nothing allocates, locks or calls
//! the system after set-up, and without the feature `std` the crate needs an allocator and no
//! operating system.
//!
//! - [`spatial`], [`simd`]: vectors, poses, inertias; numbers that the code is generic over
//! - [`robot`]: joints, links, limits
//! - [`dynamics`]: inverse and forward dynamics, regressor, mass matrix, kinematics
//! - [`effects`]: friction and other physics beside the rigid body
//! - [`gp`]: Gaussian processes of what the physics leaves over
//! - [`model`]: a model, and its file
//! - [`stream`]: the predictor
//! - [`control`]: compensation, torque from outside
//! - [`online`]: models that learn while the arm runs: a payload, a residual that changes
//!
//! `sgpr-core` identifies and diagnoses such models. It builds on this crate with the features
//! `simd`, `trajectories`, `expressions` and `files`, so that there is one implementation of each
//! effect and of the dynamics.
#![warn(clippy::too_many_lines)]
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

#[macro_use]
extern crate alloc;

#[macro_use]
mod setters;

#[cfg(feature = "complete-files")]
mod atomic_file;
pub mod control;
pub mod dynamics;
pub mod effects;
#[cfg(feature = "expressions")]
pub mod expression;
pub mod gp;
#[cfg(feature = "files")]
mod limited_file;
#[cfg(not(feature = "std"))]
mod math;
pub mod model;
pub mod names;
pub mod online;
pub mod robot;
#[cfg(feature = "trajectories")]
pub mod signal;
pub mod simd;
pub mod spatial;
pub mod stream;

/// What `sgpr-core` takes of this crate beside its interface. No part of that: it changes without
/// notice, and so do methods that the documentation does not list.
#[doc(hidden)]
pub mod internal {
    pub use crate::dynamics::parts::*;
    pub use crate::effects::parts::*;
    #[cfg(feature = "expressions")]
    pub use crate::expression::parts::*;
    pub use crate::gp::parts::*;
    pub use crate::model::parts::*;
    #[cfg(feature = "trajectories")]
    pub use crate::signal::parts::*;
    #[cfg(feature = "simd")]
    pub use crate::simd::parts::*;
    pub use crate::stream::parts::*;

    /// Files that are complete or not there.
    #[cfg(feature = "complete-files")]
    pub mod atomic_file {
        pub use crate::atomic_file::*;
    }

    /// Files that are not too large.
    #[cfg(feature = "files")]
    pub mod limited_file {
        pub use crate::limited_file::*;
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
