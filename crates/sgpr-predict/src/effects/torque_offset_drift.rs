use super::{
    About, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState, Stepped, facts,
    written_once,
};

/// An offset that drifts with the time of the session: tau = d1 t + d2 t², t in hundreds of
/// seconds.
///
/// Source: common for strain-gauge and current sensors; K. Hoffmann, An Introduction to
/// Measurements using Strain Gages (1989).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueOffsetDrift;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("d1", "N·m", "N"), EffectParameter::signed("d2", "N·m", "N")];

impl Effect for TorqueOffsetDrift {
    facts! {
        name: "torque_offset_drift",
        summary: "A torque offset that drifts with time.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = d1 (t/100 s) + d2 (t/100 s)²",
            source: "common for strain-gauge and current sensors; K. Hoffmann, An Introduction to \
                 Measurements using Strain Gages (1989).",
            signature: "depends on time alone",
            confusable: &["payload_change", "friction_warmup"],
            experiment: "return to the same static poses every minute",
            excitation: "logs over minutes on one clock",
            depends_on_time: true,
            origin: Origin::Measurement,
            origin_reason: "an offset that drifts is that of a sensor, and drifts differently in \
                 the next session",
            ..About::default()
        }
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    _: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let time = S::since(input.time, 0.0);
    if !time.is_known() {
        return columns.fill(S::zero(()));
    }
    columns[0] = time / 100.0;
    columns[1] = columns[0].squared();
}
