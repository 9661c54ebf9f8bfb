use super::{
    About, Effect, EffectParameter, JointState, Origin, Role, Stepped, facts, written_once,
};

/// Inertia of the motor's rotor, felt at the joint: tau = Ia ddq, Ia = gear ratio² times motor
/// inertia. The gyroscopic terms of the rotor, smaller by the gear ratio, are left out.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
/// 9.4.4.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotorInertia;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("Ia", "kg·m²", "kg")];

impl Effect for RotorInertia {
    facts! {
        name: "rotor_inertia",
        summary: "Inertia of the fast-turning rotor, multiplied by the square of the gear ratio.",
        parameters: &PARAMETERS,
        role: Some(Role::RotorInertia),
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Ia ddq",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 9.4.4.",
            signature: "odd in the acceleration, on its own joint only",
            confusable: &["transmission_hysteresis", "cable_stiffness"],
            experiment: "the same path at a sixth of the speed",
            excitation: "accelerations that are not proportional to the position",
            origin: Origin::Arm,
            origin_reason: "the drive accelerates its own rotor",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.ddq[joint];
}
