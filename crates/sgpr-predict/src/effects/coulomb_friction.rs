use super::{
    About, Effect, EffectParameter, JointState, Origin, Role, Stepped, facts, written_once,
};

/// Coulomb friction tau = Fc sgn(dq), with sgn(0) = 0.
///
/// Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools
/// and compensation methods for the control of machines with friction, Automatica 30(7) (1994).
#[derive(Clone, Copy, Debug)]
pub(super) struct CoulombFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("Fc", "N·m", "N")];

impl Effect for CoulombFriction {
    facts! {
        name: "coulomb_friction",
        summary: "Dry friction of one size at every speed, against the motion.",
        parameters: &PARAMETERS,
        role: Some(Role::DryFriction),
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Fc sgn(dq)",
            source: "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, \
                 analysis tools and compensation methods for the control of machines with \
                 friction, Automatica 30(7) (1994).",
            signature: "odd in the speed, the same at every speed, steps at reversals",
            confusable: &["presliding_friction", "stribeck_friction", "load_dependent_friction"],
            experiment: "constant speeds in both directions, at three speeds or more",
            excitation: "reversals of the joint",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.dq[joint].sgn();
}
