use super::{Effect, EffectParameter, JointState};

/// Viscous friction tau = Fv dq.
///
/// Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation
/// methods for the control of machines with friction, Automatica 30(7) (1994).
#[derive(Clone, Copy, Debug)]
pub(super) struct ViscousFriction;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter { symbol: "Fv", unit: "N·m·s/rad", sliding_unit: "N·s/m", non_negative: true }];

impl Effect for ViscousFriction {
    fn name(&self) -> &str {
        "viscous_friction"
    }

    fn summary(&self) -> &str {
        "Friction that grows in proportion to the speed."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        out[0] = state.dq[joint];
    }
}
