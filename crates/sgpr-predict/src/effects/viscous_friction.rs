use super::{
    About, Effect, EffectParameter, JointState, Origin, Role, Stepped, facts, written_once,
};

/// Viscous friction tau = Fv dq.
///
/// Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools
/// and compensation methods for the control of machines with friction, Automatica 30(7) (1994).
#[derive(Clone, Copy, Debug)]
pub(super) struct ViscousFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("Fv", "N·m·s/rad", "N·s/m")];

impl Effect for ViscousFriction {
    facts! {
        name: "viscous_friction",
        summary: "Friction that grows in proportion to the speed.",
        parameters: &PARAMETERS,
        role: Some(Role::ViscousFriction),
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Fv dq",
            source: "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, \
                 analysis tools and compensation methods for the control of machines with \
                 friction, Automatica 30(7) (1994).",
            signature: "odd in the speed and proportional to it",
            confusable: &[
                "nonlinear_viscous_friction",
                "torque_gain_error",
                "temperature_dependent_friction",
            ],
            experiment: "speed steps in both directions at one temperature",
            excitation: "speeds of both signs that differ by a factor of three",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.dq[joint];
}
