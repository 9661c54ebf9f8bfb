use super::columns::harmonic;
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Ripple of gear or motor over the position: tau = a cos(n q) + b sin(n q), n periods per turn of
/// the joint.
///
/// Source: H.-J. Kircanski, A. A. Goldenberg, An experimental study of nonlinear stiffness,
/// hysteresis, and friction effects in robot joints with harmonic drives, Int. J. Robotics Research
/// 16(2) (1997); P. S. Gandhi, F. Ghorbel, IEEE TCST (2002).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueRipple;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("a", "N·m", "N"), EffectParameter::signed("b", "N·m", "N")];

const CONSTANTS: [Constant; 1] =
    [Constant::new("n", ["1/rev", "rad/m"], [3.5, 400.0], Scale::Order, &[])];

impl Effect for TorqueRipple {
    facts! {
        name: "torque_ripple",
        summary: "A torque that repeats many times per turn of the joint.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = a cos(n q) + b sin(n q)",
            source: "H.-J. Kircanski, A. A. Goldenberg, An experimental study of nonlinear \
                 stiffness, hysteresis, and friction effects in robot joints with harmonic drives, \
                 Int. J. Robotics Research 16(2) (1997); P. S. Gandhi, F. Ghorbel, IEEE TCST \
                 (2002).",
            signature: "periodic in the position, its size does not depend on speed",
            confusable: &["cogging_torque", "kinematic_error"],
            experiment: "very slow constant speed, then twice of it: the order stays, the \
                 frequency moves",
            excitation: "slow passes over many periods",
            origin: Origin::Arm,
            origin_reason: "the gear needs it at the same positions again",
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
    harmonic(input, site, constants[0], columns);
}
