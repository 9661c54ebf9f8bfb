use super::{About, Effect, EffectParameter, JointState, Origin, Stepped, facts, written_once};

/// Viscous friction that differs between the two directions: tau = Fva |dq| beside the viscous
/// friction Fv dq, so that it is Fv + Fva forwards and Fv - Fva backwards.
///
/// Source: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on
/// Nonlinear System Identification Benchmarks (2019), where a worn screw shows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct AsymmetricViscousFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("Fva", "N·m·s/rad", "N·s/m")];

impl Effect for AsymmetricViscousFriction {
    facts! {
        name: "asymmetric_viscous_friction",
        summary: "Viscous friction that is stronger in one direction than in the other.",
        parameters: &PARAMETERS,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Fva |dq|",
            source: "A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, \
                 Workshop on Nonlinear System Identification Benchmarks (2019), where a worn screw \
                 shows it.",
            signature: "even in the speed, grows with it, zero at rest",
            confusable: &["stribeck_friction", "torque_offset"],
            experiment: "equal times at the same speeds in both directions",
            excitation: "speeds of both signs that differ by a factor of three",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.dq[joint].abs();
}
