use super::stepping::{DAHL_STATE, over_position, start_over_position};
use super::{About, Class, Constant, Effect, EffectParameter, Entry, Origin, facts, written_once};

/// Rubbing of a cable or hose: a Dahl element over the large angle zs.
///
/// Source: P. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18)-1 (1968).
#[derive(Clone, Copy, Debug)]
pub(super) struct CableHysteresis;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("Th", "N·m", "N")];

const CONSTANTS: [Constant; 1] =
    [Constant::logarithmic("zs", ["rad", "m"], [0.045, 1.0], &[0.1, 0.3])];

impl Effect for CableHysteresis {
    facts! {
        name: "cable_hysteresis",
        summary: "A cable or hose that rubs, with a loop over a large angle.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        has_memory: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = Th z, dz/dt = (sgn(dq) - z) |dq| / zs, zs = 0.05 to 0.8 rad",
            source: "P. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18)-1 (1968).",
            signature: "a loop over a large angle that does not depend on speed",
            confusable: &["cable_stiffness", "presliding_friction"],
            experiment: "nested loops of different amplitude",
            excitation: "reversals at different positions",
            origin: Origin::Arm,
            origin_reason: "the cable rubs in every motion",
            ..About::default()
        }
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        DAHL_STATE
    }

    written_once!(start: start_over_position);

    written_once!(advance: over_position);
}
