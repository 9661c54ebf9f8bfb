//! What a controller makes of a torque model: torque that holds and drives the arm, and torque that
//! comes from outside.
//!
//! Laws of motion control on a model are in `sgpr_core::simulation`: feed-forward, computed torque,
//! impedance.

mod compensation;
mod inverse_dynamics;
mod joint_error;
mod momentum_observer;

pub use compensation::{Compensation, CompensationOptions};
pub use inverse_dynamics::InverseDynamics;
pub use joint_error::JointError;
pub use momentum_observer::{
    Alarm, MeasuredMotion, MomentumObserver, ObserverError, ObserverOptions,
};
