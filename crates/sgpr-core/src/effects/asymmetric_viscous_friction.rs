use super::{Effect, EffectParameter, JointState};

/// Viscous friction that differs between the two directions: tau = c |dq| beside the viscous friction Fv dq, so that it
/// is Fv + c forwards and Fv - c backwards.
///
/// Source: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear System
/// Identification Benchmarks (2019), where a worn screw shows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct AsymmetricViscousFriction;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter { symbol: "Fva", unit: "N·m·s/rad", sliding_unit: "N·s/m", non_negative: false }];

impl Effect for AsymmetricViscousFriction {
    fn name(&self) -> &str {
        "asymmetric_viscous_friction"
    }

    fn summary(&self) -> &str {
        "Viscous friction that is stronger in one direction than in the other."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        out[0] = state.dq[joint].abs();
    }
}
