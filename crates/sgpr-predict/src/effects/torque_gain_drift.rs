use super::{
    About, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState, Stepped, facts,
    written_once,
};

/// A torque constant that drifts while magnets and sensors warm up: tau = e (t / 100 s) tau_hat.
///
/// Source: T. Sebastian, Temperature effects on torque production and efficiency of PM motors, IEEE
/// Trans. Industry Applications 31(2) (1995).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueGainDrift;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("e", "1", "1")];

impl Effect for TorqueGainDrift {
    facts! {
        name: "torque_gain_drift",
        summary: "A torque scale that drifts with time.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        follows_torque: true,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = e (t/100 s) tau_hat",
            source: "T. Sebastian, Temperature effects on torque production and efficiency of PM \
                 motors, IEEE Trans. Industry Applications 31(2) (1995).",
            signature: "shaped like gravity and friction together, slowly growing",
            confusable: &["friction_warmup", "torque_gain_error"],
            experiment: "a cold run and a warm run with the same motion",
            excitation: "logs over minutes on one clock",
            depends_on_time: true,
            origin: Origin::Measurement,
            origin_reason: "the scale of the log drifts, not the torque that the arm needs",
            ..About::default()
        }
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
    let torque = input.torque[site.joint().expect("at a joint")];
    let time = S::since(input.time, 0.0);
    columns[0] = if time.is_known() { time / 100.0 * torque } else { S::zero(()) };
}
