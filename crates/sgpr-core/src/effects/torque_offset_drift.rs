use super::{About, Context, Effect, EffectParameter, Entry, Site};

/// An offset that drifts with the time of the session: tau = d1 t + d2 t², t in hundreds of seconds.
///
/// Source: common for strain-gauge and current sensors; K. Hoffmann, An Introduction to Measurements using Strain
/// Gages (1989).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueOffsetDrift;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("d1", "N·m", "N"), EffectParameter::signed("d2", "N·m", "N")];

impl Effect for TorqueOffsetDrift {
    fn name(&self) -> &str {
        "torque_offset_drift"
    }

    fn summary(&self) -> &str {
        "A torque offset that drifts with time."
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = d1 (t/100 s) + d2 (t/100 s)²",
            source: "common for strain-gauge and current sensors; K. Hoffmann, An Introduction to Measurements using Strain Gages (1989).",
            signature: "depends on time alone",
            confusable: &["payload_change", "friction_warmup"],
            experiment: "return to the same static poses every minute",
            excitation: "logs over minutes on one clock",
            depends_on_time: true,
            ..About::default()
        }
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let _ = site;
        for (k, t) in context.time.iter().enumerate() {
            out[0][k] = t / 100.0;
            out[1][k] = (t / 100.0).powi(2);
        }
    }
}
