use alloc::string::String;

use super::{
    About, Context, Effect, EffectParameter, Entry, Needs, Origin, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};

/// Friction that changes with the temperature T of the joint: tau = (T - 25 °C) (a1 dq + a0
/// sgn(dq)).
///
/// Source: A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended friction
/// model to capture load and temperature effects in robot joints, IEEE/RSJ IROS (2010).
#[derive(Clone, Copy, Debug)]
pub(super) struct TemperatureDependentFriction;

const PARAMETERS: [EffectParameter; 2] = [
    EffectParameter::signed("a1", "N·m·s/(rad·K)", "N·s/(m·K)"),
    EffectParameter::signed("a0", "N·m/K", "N/K"),
];

impl Effect for TemperatureDependentFriction {
    facts! {
        name: "temperature_dependent_friction",
        summary: "Friction that changes with the measured temperature.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = (T - 25 °C) (a1 dq + a0 sgn(dq))",
            source: "A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended \
                 friction model to capture load and temperature effects in robot joints, IEEE/RSJ \
                 IROS (2010).",
            signature: "shaped like friction, its size follows the temperature, the same at all \
                 positions",
            confusable: &["friction_warmup", "torque_offset_drift"],
            experiment: "a cold run, a warm run and a cold run",
            excitation: "a temperature that changes by five degrees",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it at the present temperature",
            ..About::default()
        }
    }

    fn needs(&self) -> Needs {
        Needs { temperature: true, ..Needs::default() }
    }

    fn not_testable(&self, context: &Context<'_>) -> Option<String> {
        (0..context.dof())
            .all(|joint| context.temperature_celsius(joint).is_none())
            .then(|| "no temperature channel in the logs".into())
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let joint = site.joint().expect("at a joint");
    let (dq, temperature) = (input.dq[joint], input.temperature_celsius[joint]);
    if !temperature.is_known() {
        return columns.fill(S::zero(()));
    }
    columns[0] = (temperature - 25.0) * dq;
    columns[1] = (temperature - 25.0) * dq.sgn();
}
