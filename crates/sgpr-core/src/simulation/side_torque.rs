//! Torques beside rigid body, rotors and friction.

use std::fmt::Debug;

use super::Drive;
use crate::effects::JointState;
use crate::identification::ParameterSet;

/// A torque that the drives have to overcome beside the rigid body and the friction of the [`Drive`]s: a spring, a
/// ripple, an effect with a memory.
///
/// Treated explicitly: it is asked once per step, in order, and may carry a state of its own from step to step.
pub trait SideTorque: Send + Debug {
    /// Adds the torque in the step from `time` to `time + step` to `tau`, `[n]`, N·m (N), with the sign of
    /// tau = M ddq + ... + side torque.
    ///
    /// - `q`, `dq`: `[n]`, state at `time`
    /// - `ddq`: `[n]`, acceleration in the step before
    fn add(&mut self, time: f64, step: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]);
}

/// Effects of the library that a [`Drive`] does not know, with their parameters.
#[derive(Debug)]
struct Effects {
    set: ParameterSet,
    /// Zero for what the drives do.
    parameters: Vec<f64>,
}

impl SideTorque for Effects {
    fn add(&mut self, _: f64, _: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.set.add_effect_torque(&self.parameters, &JointState { q, dq, ddq }, tau);
    }
}

/// Drives and side torque that together are the effects of `set` with these parameters: viscous and Coulomb friction
/// and rotor inertia are treated as those of a [`Drive`], stiffly; every other effect as a side torque.
///
/// # Panics
/// If `parameters` is not of the length of the set.
pub fn drives_from_parameters(set: &ParameterSet, parameters: &[f64]) -> (Vec<Drive>, Option<Box<dyn SideTorque>>) {
    assert_eq!(parameters.len(), set.len(), "every parameter of the set");
    let mut drives = vec![Drive::default(); set.dof()];
    let mut rest = parameters.to_vec();
    for (index, column) in set.effect_columns().iter().enumerate() {
        let value = &mut rest[set.inertial() + index];
        let drive = &mut drives[column.joint];
        match set.effects()[column.effect].name() {
            "viscous_friction" => drive.viscous_friction = *value,
            "coulomb_friction" => (drive.coulomb_friction, drive.static_friction) = ([*value; 2], [*value; 2]),
            "rotor_inertia" => drive.rotor_inertia = *value,
            _ => continue,
        }
        *value = 0.0;
    }
    let others = rest[set.inertial()..].iter().any(|value| *value != 0.0);
    let side = others.then(|| Box::new(Effects { set: set.clone(), parameters: rest }) as Box<dyn SideTorque>);
    (drives, side)
}
