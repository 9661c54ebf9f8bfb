use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};

/// Friction of a cold gear that fades while the arm works: tau = exp(-t / tw) (a1 dq + a0 sgn(dq)),
/// t the time of the session.
///
/// Source: A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended friction
/// model to capture load and temperature effects in robot joints, IEEE/RSJ IROS (2010), with an
/// exponential in the place of the measured temperature.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrictionWarmup;

const PARAMETERS: [EffectParameter; 2] = [
    EffectParameter::signed("a1", "N·m·s/rad", "N·s/m"),
    EffectParameter::signed("a0", "N·m", "N"),
];

const CONSTANTS: [Constant; 1] =
    [Constant::logarithmic("tw", ["s", "s"], [3.0, 7200.0], &[8.0, 20.0, 60.0, 300.0])];

impl Effect for FrictionWarmup {
    facts! {
        name: "friction_warmup",
        summary: "Friction that fades while the gear warms up.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = exp(-t/tw) (a1 dq + a0 sgn(dq))",
            source: "A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended \
                 friction model to capture load and temperature effects in robot joints, IEEE/RSJ \
                 IROS (2010), with an exponential in the place of the measured temperature.",
            signature: "shaped like friction, its size falls with time, the same at all positions",
            confusable: &["friction_step", "torque_gain_drift", "temperature_dependent_friction"],
            experiment: "a cold run, a warm run and a cold run",
            excitation: "logs over the time of the warm-up, on one clock",
            depends_on_time: true,
            origin: Origin::Arm,
            origin_reason: "the gear is cold at the start of every session; the clock says how \
                 cold",
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
    let time = S::since(input.time, 0.0);
    if !time.is_known() {
        return columns.fill(S::zero(()));
    }
    let dq = input.dq[site.joint().expect("at a joint")];
    let cold = (-time / constants[0]).exp();
    columns[0] = cold * dq;
    columns[1] = cold * dq.sgn();
}
