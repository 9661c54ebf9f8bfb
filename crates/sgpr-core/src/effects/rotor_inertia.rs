use super::{Effect, EffectParameter, JointState};

/// Inertia of the motor's rotor, felt at the joint: tau = Ia ddq, Ia = gear ratio² times motor inertia.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section 9.4.4; the gyroscopic
/// terms of the rotor, smaller by the gear ratio, are left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotorInertia;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter { symbol: "Ia", unit: "kg·m²", sliding_unit: "kg", non_negative: true }];

impl Effect for RotorInertia {
    fn name(&self) -> &str {
        "rotor_inertia"
    }

    fn summary(&self) -> &str {
        "Inertia of the fast-turning rotor, multiplied by the square of the gear ratio."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        out[0] = state.ddq[joint];
    }
}
