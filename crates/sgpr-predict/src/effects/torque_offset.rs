use super::{
    About, Effect, EffectParameter, JointState, Origin, Role, Stepped, facts, written_once,
};

/// A constant torque: bias of a current sensor, an unbalanced spring, or Coulomb friction that
/// differs between the directions, from which it cannot be told apart while the joint moves.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
/// 12.4.2.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueOffset;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("tau0", "N·m", "N")];

impl Effect for TorqueOffset {
    facts! {
        name: "torque_offset",
        summary: "A torque that is always there, whatever the motion.",
        parameters: &PARAMETERS,
        role: Some(Role::Offset),
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = tau0",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 12.4.2.",
            signature: "constant",
            confusable: &["asymmetric_coulomb_friction", "spring_balancer"],
            experiment: "measure at rest with the drive holding, after approaches from both sides, \
                 or with the brake on",
            excitation: "any motion in which the gravity torque changes",
            origin: Origin::Measurement,
            origin_reason: "a constant is as a rule the zero of the current or torque sensor; \
                 where it is a spring, a hose or friction that differs by direction, keep it",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(_: usize, _: &JointState<'_, S>, out: &mut [S]) {
    out[0] = S::constant(1.0);
}
