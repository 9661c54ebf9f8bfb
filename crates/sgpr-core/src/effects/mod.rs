//! Physical effects beside the rigid body: what else the drive has to overcome.
//!
//! One effect is one file and one line in [`registry`]. An effect that enters the torque linearly gives columns of the
//! observation matrix; its parameters are identified together with the inertial ones.

mod asymmetric_viscous_friction;
mod coulomb_friction;
mod rotor_inertia;
mod torque_offset;
mod viscous_friction;

use std::fmt::Debug;
use std::sync::Arc;

use crate::robot::JointKind;

/// A physical effect, linear in its parameters.
pub trait Effect: Send + Sync + Debug {
    /// Name in files, column labels and on the command line: `viscous_friction`.
    fn name(&self) -> &str;

    /// One sentence for a person.
    fn summary(&self) -> &str;

    /// The parameters that one joint has.
    fn parameters(&self) -> &[EffectParameter];

    /// Derivative of the joint's torque by each parameter.
    ///
    /// - `out`: one number per parameter
    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]);
}

/// A parameter of an effect at one joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EffectParameter {
    /// Symbol, as in `joint_2.Fv`.
    pub symbol: &'static str,
    /// Unit at a rotating joint.
    pub unit: &'static str,
    /// Unit at a sliding joint.
    pub sliding_unit: &'static str,
    /// Whether physics forbids negative values.
    pub non_negative: bool,
}

impl EffectParameter {
    /// Unit at a joint of this kind.
    pub fn unit_at(&self, kind: JointKind) -> &'static str {
        if kind.is_rotation() { self.unit } else { self.sliding_unit }
    }
}

/// Motion of all joints at one sample.
#[derive(Clone, Copy, Debug)]
pub struct JointState<'a> {
    /// Positions, rad (m).
    pub q: &'a [f64],
    /// Velocities, rad/s (m/s).
    pub dq: &'a [f64],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a [f64],
}

/// All effects that come with the library, in the order of their columns.
pub fn registry() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(viscous_friction::ViscousFriction),
        Arc::new(coulomb_friction::CoulombFriction),
        Arc::new(asymmetric_viscous_friction::AsymmetricViscousFriction),
        Arc::new(rotor_inertia::RotorInertia),
        Arc::new(torque_offset::TorqueOffset),
    ]
}

/// The effect `name`.
///
/// # Errors
/// If there is none; the message lists those that exist.
pub fn by_name(name: &str) -> Result<Arc<dyn Effect>, UnknownEffect> {
    let all = registry();
    let known = all.iter().map(|effect| effect.name().to_string()).collect();
    let found = all.into_iter().find(|effect| effect.name() == name);
    found.ok_or_else(|| UnknownEffect { name: name.into(), known })
}

/// An effect name that the library does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no effect `{name}`; known are {}", known.join(", "))]
pub struct UnknownEffect {
    /// Requested name.
    pub name: String,
    /// Names to choose from.
    pub known: Vec<String>,
}

/// Sign of `x`, zero at zero (`f64::signum` is one there).
#[inline]
pub fn sgn(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every effect is asked the same questions.
    #[test]
    fn every_effect_keeps_the_contract() {
        for effect in registry() {
            let name = effect.name();
            assert!(name.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{name}");
            assert!(effect.summary().ends_with('.'), "{name}: a sentence ends with a stop");
            assert!(!effect.parameters().is_empty(), "{name}");
            assert_eq!(by_name(name).expect("registered").name(), name);

            let mut out = vec![f64::NAN; effect.parameters().len()];
            let columns = |q: f64, dq: f64, ddq: f64, out: &mut [f64]| {
                let state = JointState { q: &[0.3, q], dq: &[0.1, dq], ddq: &[0.7, ddq] };
                effect.columns(1, &state, out);
                assert!(out.iter().all(|c| c.is_finite()), "{name} at dq = {dq}");
            };
            for dq in [-2.0, -1e-12, 0.0, 1e-12, 2.0] {
                columns(0.5, dq, -1.0, &mut out);
            }
            // At rest with nothing accelerating, only an offset acts.
            columns(0.0, 0.0, 0.0, &mut out);
            assert_eq!(out.iter().any(|c| *c != 0.0), name == "torque_offset", "{name}");
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let message = by_name("stiction").expect_err("not there").to_string();
        assert!(message.contains("`stiction`") && message.contains("coulomb_friction"), "{message}");
    }
}
