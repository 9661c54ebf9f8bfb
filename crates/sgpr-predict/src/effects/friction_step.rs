use super::columns::after;
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Friction that changes at a time t0: a brake that drags, a damaged seal, fresh grease.
///
/// Source: A. C. Bittencourt, P. Axelsson, Modeling and experiment design for identification of
/// wear in a robot joint, IEEE/ASME Trans. Mechatronics 19(5) (2014), for friction as the sign of
/// wear.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrictionStep;

const PARAMETERS: [EffectParameter; 2] = [
    EffectParameter::signed("a0", "N·m", "N"),
    EffectParameter::signed("a1", "N·m·s/rad", "N·s/m"),
];

const CONSTANTS: [Constant; 1] =
    [Constant::new("t0", ["s", "s"], [f64::NEG_INFINITY, f64::INFINITY], Scale::Time, &[])];

impl Effect for FrictionStep {
    facts! {
        name: "friction_step",
        summary: "Friction that changes from one moment on.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::ChangePoint,
            formula: "tau = (a0 sgn(dq) + a1 dq) for t > t0",
            source: "A. C. Bittencourt, P. Axelsson, Modeling and experiment design for \
                 identification of wear in a robot joint, IEEE/ASME Trans. Mechatronics 19(5) \
                 (2014), for friction as the sign of wear.",
            signature: "shaped like friction, from one moment on",
            confusable: &["payload_change", "friction_warmup"],
            experiment: "repeat the identical motion before and after",
            excitation: "the joint moves in both directions before and after, on one clock",
            depends_on_time: true,
            origin: Origin::Arm,
            origin_reason: "what changed stays changed: to a controller the change lies in the \
                 past",
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
    let dq = input.dq[site.joint().expect("at a joint")];
    let on = after::<S>(input.time, constants[0], input.rate_hz);
    columns[0] = on * dq.sgn();
    columns[1] = on * dq;
}
