use super::{About, Context, Effect, EffectParameter, Entry, Site, sgn};

/// Friction that changes with the temperature T of the joint: tau = (T - 25 °C) (a1 dq + a0 sgn(dq)).
///
/// Source: A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended friction model to capture
/// load and temperature effects in robot joints, IEEE/RSJ IROS (2010).
#[derive(Clone, Copy, Debug)]
pub(super) struct TemperatureDependentFriction;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("a1", "N·m·s/(rad·K)", "N·s/(m·K)"), EffectParameter::signed("a0", "N·m/K", "N/K")];

impl Effect for TemperatureDependentFriction {
    fn name(&self) -> &str {
        "temperature_dependent_friction"
    }

    fn summary(&self) -> &str {
        "Friction that changes with the measured temperature."
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = (T - 25 °C) (a1 dq + a0 sgn(dq))",
            source: "A. C. Bittencourt, E. Wernholt, S. Sander-Tavallaey, T. Brogårdh, An extended friction model to capture load and temperature effects in robot joints, IEEE/RSJ IROS (2010).",
            signature: "shaped like friction, its size follows the temperature, the same at all positions",
            confusable: &["friction_warmup", "torque_offset_drift"],
            experiment: "a cold run, a warm run and a cold run",
            excitation: "a temperature that changes by five degrees",
            ..About::default()
        }
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn not_testable(&self, context: &Context<'_>) -> Option<String> {
        (0..context.dof())
            .all(|joint| context.temperature_celsius(joint).is_none())
            .then(|| "no temperature channel in the logs".into())
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        let Some(temperature) = context.temperature_celsius(joint) else { return };
        for (k, dq) in context.of_joint(context.dq, joint).enumerate() {
            out[0][k] = (temperature[k] - 25.0) * dq;
            out[1][k] = (temperature[k] - 25.0) * sgn(dq);
        }
    }
}
