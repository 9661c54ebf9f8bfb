//! Excitation trajectories: motions that reveal the parameters of an arm and stay within what the
//! arm may do.
//!
//! A [`Trajectory`] is a [`Basis`] (Fourier series, B-splines, point to point) with coefficients;
//! [`optimise`] finds the coefficients that make a [`Criterion`] small under [`MotionLimits`];
//! [`evaluate`] says how well any motion excites the base parameters. Source of the chapter: S.
//! Krishnamoorthi, MSc thesis, TU Delft (2018), chapter 3.

mod basis;
mod collision_shapes;
mod criterion;
mod error;
mod evaluate;
mod forecast;
mod information;
mod limits;
mod nominal;
mod optimise;
mod peaks;
mod problem;
mod surroundings;
mod trajectory;

pub use basis::Basis;
pub use criterion::Criterion;
pub use error::ExcitationError;
pub use evaluate::{ExcitationReport, evaluate};
pub use forecast::forecast;
pub use limits::MotionLimits;
pub use nominal::{NominalEffects, nominal_terms};
pub use optimise::{
    Excitation, ExciteOptions, SearchStep, Status, optimise, random_motion, usual_effects,
};
pub use peaks::{Peaks, peaks};
pub use surroundings::{Block, Capsule, Surroundings};
pub use trajectory::{Trajectory, TrajectorySamples};
