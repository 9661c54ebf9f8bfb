use super::stepping::{DAHL_STATE, Dahl};
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Loop between torque and angle of a gear: the torque lost in the gear follows the direction in
/// which the load torque changes, over the scale ts, as a Dahl element driven by the load.
///
/// Source: M. Ruderman, F. Hoffmann, T. Bertram, Modeling and identification of elastic robot
/// joints with hysteresis and backlash, IEEE Trans. Industrial Electronics 56(10) (2009).
#[derive(Clone, Copy, Debug)]
pub(super) struct TransmissionHysteresis;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("Th", "N·m", "N")];

const CONSTANTS: [Constant; 1] =
    [Constant::new("ts", ["N·m", "N"], [0.02, 2.0], Scale::Torque, &[0.1, 0.5])];

impl Effect for TransmissionHysteresis {
    facts! {
        name: "transmission_hysteresis",
        summary: "A loop between the torque of the gear and its twist.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        has_memory: true,
        follows_torque: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = Th z, dz = (sgn(dtau_rb) - z) |dtau_rb| / ts",
            source: "M. Ruderman, F. Hoffmann, T. Bertram, Modeling and identification of elastic \
                 robot joints with hysteresis and backlash, IEEE Trans. Industrial Electronics \
                 56(10) (2009).",
            signature: "a loop over the load torque that does not depend on speed",
            confusable: &["presliding_friction", "joint_elasticity", "rotor_inertia"],
            experiment: "output locked, slow ramps of torque",
            excitation: "a load torque that rises and falls often",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it whenever the load changes",
            ..About::default()
        }
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        DAHL_STATE
    }

    written_once!(start: start);

    written_once!(advance: law);
}

fn start<S: Stepped>(
    site: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
) {
    let joint = site.joint().expect("at a joint");
    Dahl(state.hidden).start(input.rigid_torque[joint], S::zero(()));
}

fn law<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let x = input.rigid_torque[site.joint().expect("at a joint")];
    columns[0] = Dahl(state.hidden).advance(x, constants[0]);
}
