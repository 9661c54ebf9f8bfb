use super::{Effect, EffectParameter, JointState, sgn};

/// Coulomb friction tau = Fc sgn(dq), with sgn(0) = 0.
///
/// Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation
/// methods for the control of machines with friction, Automatica 30(7) (1994).
#[derive(Clone, Copy, Debug)]
pub(super) struct CoulombFriction;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter { symbol: "Fc", unit: "N·m", sliding_unit: "N", non_negative: true }];

impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn summary(&self) -> &str {
        "Dry friction of one size at every speed, against the motion."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        out[0] = sgn(state.dq[joint]);
    }
}
