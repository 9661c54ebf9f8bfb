//! Torque models of robot arms: from a robot file and recorded logs to an identified model, with what is missing named.
//!
//! The rooms, in the order in which they build on each other:
//!
//! - [`spatial`], [`simd`]: vectors, poses, inertias; arithmetic for one sample and for many
//! - [`robot`]: URDF and Denavit-Hartenberg robots
//! - [`dynamics`]: inverse and forward dynamics, regressor, mass matrix, kinematics
#![forbid(unsafe_code)]

pub mod dynamics;
pub mod robot;
pub mod simd;
pub mod spatial;
