use super::{About, Effect, EffectParameter, JointState, Origin, Stepped, facts, written_once};

/// Drag that grows with the square of the speed: churning of oil, flow through an orifice.
///
/// Source: H. E. Merritt, Hydraulic Control Systems (1967), for the orifice; B. Armstrong-Hélouvry,
/// P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation methods for
/// the control of machines with friction, Automatica 30(7) (1994).
#[derive(Clone, Copy, Debug)]
pub(super) struct QuadraticViscousFriction;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter::positive("c2", "N·m·s²/rad²", "N·s²/m²")];

impl Effect for QuadraticViscousFriction {
    facts! {
        name: "quadratic_viscous_friction",
        summary: "Friction that grows with the square of the speed.",
        parameters: &PARAMETERS,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = c dq |dq|",
            source: "H. E. Merritt, Hydraulic Control Systems (1967), for the orifice; B. \
                 Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis \
                 tools and compensation methods for the control of machines with friction, \
                 Automatica 30(7) (1994).",
            signature: "odd in the speed, quadratic",
            confusable: &["stribeck_friction", "nonlinear_viscous_friction"],
            experiment: "constant speeds that differ by a factor of five and include the highest",
            excitation: "speeds that differ by a factor of five",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
            ..About::default()
        }
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.dq[joint] * state.dq[joint].abs();
}
