use super::{Effect, EffectParameter, JointState};

/// A constant torque: bias of a current sensor, an unbalanced spring, or Coulomb friction that differs between the
/// directions, from which it cannot be told apart while the joint moves.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section 12.4.2.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueOffset;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter { symbol: "tau0", unit: "N·m", sliding_unit: "N", non_negative: false }];

impl Effect for TorqueOffset {
    fn name(&self) -> &str {
        "torque_offset"
    }

    fn summary(&self) -> &str {
        "A torque that is always there, whatever the motion."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, _: usize, _: &JointState<'_>, out: &mut [f64]) {
        out[0] = 1.0;
    }
}
