use super::{About, Context, Effect, EffectParameter, Entry, Site};

/// A torque constant that drifts while magnets and sensors warm up: tau = e (t / 100 s) tau_hat.
///
/// Source: T. Sebastian, Temperature effects on torque production and efficiency of PM motors, IEEE Trans. Industry
/// Applications 31(2) (1995).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueGainDrift;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("e", "1", "1")];

impl Effect for TorqueGainDrift {
    fn name(&self) -> &str {
        "torque_gain_drift"
    }

    fn summary(&self) -> &str {
        "A torque scale that drifts with time."
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = e (t/100 s) tau_hat",
            source: "T. Sebastian, Temperature effects on torque production and efficiency of PM motors, IEEE Trans. Industry Applications 31(2) (1995).",
            signature: "shaped like gravity and friction together, slowly growing",
            confusable: &["friction_warmup", "torque_gain_error"],
            experiment: "a cold run and a warm run with the same motion",
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

    fn follows_torque(&self) -> bool {
        true
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        for ((out, torque), t) in out[0].iter_mut().zip(context.of_joint(context.torque, joint)).zip(context.time) {
            *out = t / 100.0 * torque;
        }
    }
}
