//! Rigid-body dynamics: what torque a motion needs, what motion a torque makes, and how both depend
//! on the parameters.
//!
//! Every function takes the [`Robot`](crate::robot::Robot), a workspace that owns all buffers, and
//! its inputs, in this order, and allocates nothing. [`Workspace`] serves one sample at a time;
//! `BatchWorkspace` (feature `simd`) serves whole logs, one sample per register lane. Only the
//! rigid body is in here: friction, rotor inertia and all else are [effects](crate::effects).

#[cfg(feature = "simd")]
mod batch;
mod body;
mod energy;
mod forward_dynamics;
mod kinematics;
mod machine;
mod mass_matrix;
mod momentum;
mod number_workspace;
mod regressor;
mod rnea;
mod scratch;
mod workspace;

#[cfg(feature = "simd")]
pub use batch::{BatchWorkspace, Samples, regressor_batch, rnea_batch};
pub use energy::{kinetic_energy, potential_energy};
pub use forward_dynamics::{forward_dynamics, forward_dynamics_with_rotors};
pub use kinematics::{forward_kinematics, frame_pose, jacobian};
pub use mass_matrix::mass_matrix;
pub(crate) use momentum::Momentum;
pub use number_workspace::NumberWorkspace;
pub use regressor::regressor;
pub use rnea::{bias_forces, gravity_torque, rnea};
pub use workspace::Workspace;

/// For [`crate::internal`].
pub(crate) mod parts {
    #[cfg(feature = "simd")]
    pub use super::batch::for_each_regressor_block;
    pub use super::body::Body;
    pub use super::regressor::regressor_kernel;
}
