use super::{About, Effect, EffectParameter, JointState, Origin, Stepped, facts, written_once};

/// Coulomb friction that differs between the directions, Fc + dFc forwards and Fc - dFc backwards:
/// tau = dFc
/// |sgn(dq)| beside Fc sgn(dq). While the joint moves this is a constant torque.
///
/// Source: M. Gautier, Dynamic identification of robots with power model, IEEE ICRA (1997); the
/// alias follows from the formula.
#[derive(Clone, Copy, Debug)]
pub(super) struct AsymmetricCoulombFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("dFc", "N·m", "N")];

impl Effect for AsymmetricCoulombFriction {
    facts! {
        name: "asymmetric_coulomb_friction",
        summary: "Dry friction that is stronger in one direction than in the other.",
        parameters: &PARAMETERS,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = dFc |sgn(dq)|",
            source: "M. Gautier, Dynamic identification of robots with power model, IEEE ICRA \
                 (1997); the alias follows from the formula.",
            signature: "constant while the joint moves",
            confusable: &["torque_offset"],
            experiment: "measure at rest with the drive holding, after approaches from both sides, \
                 or with the brake on",
            excitation: "rests between motions in both directions",
            alias_of: Some("torque_offset"),
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.dq[joint].sgn().abs();
}
