//! Vectors, rotations, poses and the inertia of a rigid body.
//!
//! Conventions are in `docs/conventions.md`: right-handed frames, 6-vectors with the linear part
//! first, inertia about the origin of the link frame.

mod inertia;
mod matrix3;
mod pose;
mod vector3;

pub use inertia::{
    LinkInertia, PARAMETERS_PER_LINK, STANDARD_PARAMETER_NAMES, STANDARD_PARAMETER_UNITS,
};
pub use matrix3::Matrix3;
pub use pose::Pose;
pub use vector3::Vector3;
