use super::stepping::{DAHL_STATE, over_position, start_over_position};
use super::{About, Class, Constant, Effect, EffectParameter, Entry, Origin, facts, written_once};

/// Dry friction with bristles that bend before they slide (Dahl): z follows sgn(dq) over the
/// distance zs, dz = (sgn(dq) - z) |dq| / zs dt, tau = Fc z. Where the model has Coulomb friction
/// too, this takes its place. Initial stiffness Fc / zs.
///
/// Source: P. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18)-1 (1968).
#[derive(Clone, Copy, Debug)]
pub(super) struct PreslidingFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("Fc", "N·m", "N")];

const CONSTANTS: [Constant; 1] = [Constant::logarithmic(
    "zs",
    ["rad", "m"],
    [3e-4, 0.045],
    &[1e-3, 2.5e-3, 6e-3, 1.5e-2, 3.5e-2],
)];

impl Effect for PreslidingFriction {
    facts! {
        name: "presliding_friction",
        summary: "Dry friction that needs some distance to build up after each reversal.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        has_memory: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = Fc z, dz/dt = (sgn(dq) - z) |dq| / zs",
            source: "P. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18)-1 (1968).",
            signature: "only over a short distance after each reversal, a loop over the position, \
                 the same at every speed",
            confusable: &["torque_delay", "stribeck_friction", "cable_hysteresis"],
            experiment: "small reversals of one to ten times the distance over which it builds up \
                 (zs), at two speeds",
            excitation: "many reversals",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it after every reversal",
            ..About::default()
        }
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        DAHL_STATE
    }

    written_once!(start: start_over_position);

    written_once!(advance: over_position);
}
