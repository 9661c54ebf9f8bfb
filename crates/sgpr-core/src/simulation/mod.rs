//! An arm that moves: fixed-step simulation of any robot with rotors, friction, sensors and a
//! sampled controller.
//!
//! [`Simulator`] makes single steps; [`simulate`] runs a whole experiment: a [`Controller`] that
//! follows a [`Reference`] with encoders and noise as [`Sensors`] say. The same inputs give the
//! same bits on the same machine.

mod controller;
mod drive;
mod dry_friction;
mod error;
mod pick_up;
mod reference;
mod sensors;
mod side_torque;
mod simulate;
mod simulator;

pub use controller::{
    ComputedTorque, Controller, FeedForward, Gains, InverseDynamics, JointImpedance, Measurement,
    Pd, RigidBody, Scheduled, Setpoint,
};
pub use drive::{Drive, Motor, puma560_drives, two_link_drives};
pub use error::SimulationError;
pub use pick_up::{PickUp, simulate_pick_up};
pub(crate) use reference::quintic;
pub use reference::{Reference, SampledReference, StandStill};
pub(crate) use sensors::NormalNumbers;
pub use sensors::{Sensors, VelocitySensor};
pub use side_torque::{
    DrivesAndSideTorques, SideTorque, drives_from_model, drives_from_parameters,
};
pub use simulate::{Experiment, SimulationRecord, simulate};
pub use simulator::{Integrator, SPEED_LIMIT, Simulator};
