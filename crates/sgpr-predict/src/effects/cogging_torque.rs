use super::columns::harmonic;
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Cogging of the motor: its rotor prefers the slots, tau = a cos(n q) + b sin(n q), n the common
/// multiple of slots and poles times the gear ratio. Joint data cannot tell it from ripple of the
/// gear.
///
/// Source: N. Bianchi, S. Bolognani, Design techniques for reducing the cogging torque in
/// surface-mounted PM motors, IEEE Trans. Industry Applications 38(5) (2002).
#[derive(Clone, Copy, Debug)]
pub(super) struct CoggingTorque;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("a", "N·m", "N"), EffectParameter::signed("b", "N·m", "N")];

const CONSTANTS: [Constant; 1] =
    [Constant::new("n", ["1/rev", "rad/m"], [3.5, 400.0], Scale::Order, &[])];

impl Effect for CoggingTorque {
    facts! {
        name: "cogging_torque",
        summary: "The motor's rotor prefers certain angles.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = a cos(n q) + b sin(n q), n = lcm(slots, poles) gear ratio",
            source: "N. Bianchi, S. Bolognani, Design techniques for reducing the cogging torque \
                 in surface-mounted PM motors, IEEE Trans. Industry Applications 38(5) (2002).",
            signature: "periodic in the motor's angle, there without load too",
            confusable: &["torque_ripple"],
            experiment: "turn the drive without load: ripple of the gear goes away, cogging stays",
            excitation: "slow passes over many periods",
            alias_of: Some("torque_ripple"),
            origin: Origin::Arm,
            origin_reason: "the rotor prefers the same angles again",
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
