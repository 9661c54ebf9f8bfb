use super::{About, Effect, EffectParameter, JointState, Origin, Stepped, facts, written_once};

/// Spring of a hose or dress pack: tau = k (q - q0), written k q + tau0.
///
/// Source: G. Gilardi, I. Sharf, Literature survey of contact dynamics modelling, Mech. Mach.
/// Theory 37 (2002), for linear elastic elements; the use for dress packs is common practice.
#[derive(Clone, Copy, Debug)]
pub(super) struct CableStiffness;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("k", "N·m/rad", "N/m"), EffectParameter::signed("tau0", "N·m", "N")];

impl Effect for CableStiffness {
    facts! {
        name: "cable_stiffness",
        summary: "A cable or hose that pulls the joint towards one position.",
        parameters: &PARAMETERS,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = k q + tau0, tau0 = -k q0",
            source: "G. Gilardi, I. Sharf, Literature survey of contact dynamics modelling, Mech. \
                 Mach. Theory 37 (2002), for linear elastic elements; the use for dress packs is \
                 common practice.",
            signature: "monotone in the joint's own position, the same in both directions",
            confusable: &["rotor_inertia", "spring_balancer", "cable_hysteresis"],
            experiment: "a slow sweep over the whole range in both directions",
            excitation: "a position range in which gravity is no straight line",
            origin: Origin::Arm,
            origin_reason: "the cable pulls on the joint",
            ..About::default()
        }
    }

    /// A hose pulls back. What pushes away a little may be noise of the acceleration, which makes
    /// the inertia too small.
    fn is_plausible(&self, coefficients: &[f64]) -> bool {
        coefficients[0] >= 0.0
    }

    written_once!(columns: columns);
}

fn columns<S: Stepped>(joint: usize, state: &JointState<'_, S>, out: &mut [S]) {
    out[0] = state.q[joint];
    out[1] = S::constant(1.0);
}
