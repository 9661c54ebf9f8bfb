//! The torque of a robot arm, one sample after the other: what a controller needs of a model, and nothing else.
//!
//! A [`model::StreamedModel`] is read from a model file; its [`stream::Predictor`] gives the torque of each sample, with
//! friction that remembers, lags and delays. Nothing allocates, locks or calls the system after set-up, and without the
//! feature `std` the crate needs an allocator and no operating system.
//!
//! - [`spatial`], [`simd`]: vectors, poses, inertias; numbers that the code is generic over
//! - [`robot`]: joints, links, limits
//! - [`dynamics`]: inverse and forward dynamics, regressor, mass matrix, kinematics
//! - [`effects`]: friction and other physics beside the rigid body
//! - [`model`]: a model, and its file
//! - [`stream`]: the predictor
//! - [`control`]: compensation, torque from outside
//!
//! `sgpr-core` identifies and diagnoses such models. It builds on this crate with the features `simd`, `trajectories`,
//! `expressions` and `files`, so that there is one implementation of each effect and of the dynamics.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

#[macro_use]
extern crate alloc;

#[cfg(feature = "files")]
#[doc(hidden)]
pub mod atomic_file;
pub mod control;
pub mod dynamics;
pub mod effects;
#[cfg(feature = "expressions")]
pub mod expression;
#[cfg(feature = "files")]
#[doc(hidden)]
pub mod limited_file;
#[cfg(not(feature = "std"))]
mod math;
pub mod model;
pub mod names;
pub mod robot;
#[cfg(feature = "trajectories")]
pub mod signal;
pub mod simd;
pub mod spatial;
pub mod stream;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
