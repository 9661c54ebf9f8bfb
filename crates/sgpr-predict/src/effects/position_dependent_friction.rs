use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Friction of an eccentric bearing or a tight spot: tau = sgn(dq) (b exp(-((q - qc) / w)² / 2) +
/// a1 cos q + a2 sin q).
///
/// Source: M. R. Popovic, A. A. Goldenberg, Modeling of friction
/// using spectral analysis, IEEE Trans. Robotics and Automation 14(1) (1998).
#[derive(Clone, Copy, Debug)]
pub(super) struct PositionDependentFriction;

const PARAMETERS: [EffectParameter; 3] = [
    EffectParameter::signed("b", "N·m", "N"),
    EffectParameter::signed("a1", "N·m", "N"),
    EffectParameter::signed("a2", "N·m", "N"),
];

const CONSTANTS: [Constant; 2] = [
    Constant::new(
        "qc",
        ["rad", "m"],
        [0.0, 1.0],
        Scale::Position,
        &[0.08, 0.2, 0.32, 0.44, 0.56, 0.68, 0.8, 0.92],
    ),
    Constant::new("w", ["rad", "m"], [0.008, 0.5], Scale::PositionWidth, &[0.05, 0.12]),
];

impl Effect for PositionDependentFriction {
    facts! {
        name: "position_dependent_friction",
        summary: "Friction that is larger at some positions than at others.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = sgn(dq) (b exp(-((q - qc)/w)²/2) + a1 cos q + a2 sin q)",
            source: "M. R. Popovic, A. A. Goldenberg, Modeling of friction using spectral \
                 analysis, IEEE Trans. Robotics and Automation 14(1) (1998).",
            signature: "odd in the speed, its size follows the position",
            confusable: &["load_dependent_friction", "torque_ripple"],
            experiment: "slow sweeps over the whole range in both directions, at two loads",
            excitation: "passes over every position in both directions",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every pass over the position",
            ..About::default()
        }
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let joint = site.joint().expect("at a joint");
    let (q, direction) = (input.q[joint], input.dq[joint].sgn());
    columns[0] = direction * (((q - constants[0]) / constants[1]).squared() * -0.5).exp();
    let (sine, cosine) = q.sin_cos();
    columns[1] = direction * cosine;
    columns[2] = direction * sine;
}
