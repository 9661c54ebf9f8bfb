use super::{
    About, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState, Stepped, facts,
    written_once,
};

/// Dead band of the drive: a current that is lost near zero and must be added in the direction of
/// the torque.
///
/// Source: G. Tao, P. V. Kokotović, Adaptive Control of Systems with Actuator and Sensor
/// Nonlinearities (1996).
#[derive(Clone, Copy, Debug)]
pub(super) struct FrictionDeadBand;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("d", "N·m", "N")];

impl Effect for FrictionDeadBand {
    facts! {
        name: "friction_dead_band",
        summary: "A small torque that the drive loses around zero, in the direction of the torque.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        follows_torque: true,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = d sgn(tau)",
            source: "G. Tao, P. V. Kokotović, Adaptive Control of Systems with Actuator and Sensor \
                 Nonlinearities (1996).",
            signature: "odd in the torque, not in the speed",
            confusable: &["coulomb_friction", "torque_gain_error"],
            experiment: "poses in which the joint is held and driven back",
            excitation: "torque and speed of unlike signs for part of the time",
            origin: Origin::Arm,
            origin_reason: "what the drive loses must be added",
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
    columns[0] = input.torque[site.joint().expect("at a joint")].sgn();
}
