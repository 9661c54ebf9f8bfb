use super::{About, Class, Constant, Effect, Entry, Origin, Site, Stepped, facts, written_once};

/// A torque constant or drive gain that is off: the log shows (1 + e) times the torque of the
/// joint.
///
/// Source: M. Gautier, S. Briot, Global identification of joint drive gains and dynamic parameters
/// of robots, ASME J. Dyn. Syst. 136(5) (2014).
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueGainError;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("e", ["1", "1"], [-0.6, 1.5], 1e-4)];

impl Effect for TorqueGainError {
    facts! {
        name: "torque_gain_error",
        summary: "A torque that is logged on a wrong scale.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "tau_log = (1 + e) tau",
            source: "M. Gautier, S. Briot, Global identification of joint drive gains and dynamic \
                 parameters of robots, ASME J. Dyn. Syst. 136(5) (2014).",
            signature: "follows the whole torque of the joint",
            confusable: &["link_inertia_error", "torque_gain_drift"],
            experiment: "the same motion with a known payload",
            excitation: "inertial coupling with other joints, or a known payload",
            origin: Origin::Measurement,
            origin_reason: "the log has the torque on a wrong scale; the arm needs the true one",
            ..About::default()
        }
    }

    fn transmit(
        &self,
        site: Site,
        constants: &[f64],
        joint: usize,
        _: f64,
        values: &mut [f64],
        _: usize,
    ) {
        if site.joint() == Some(joint) {
            values.iter_mut().for_each(|value| *value *= 1.0 + constants[0]);
        }
    }

    written_once!(advance_transmitted: transmitted);
}

fn transmitted<S: Stepped>(
    site: Site,
    constants: &[f64],
    joint: usize,
    _: f64,
    _: &mut [S],
    torque: S,
) -> S {
    if site.joint() == Some(joint) { torque * (1.0 + constants[0]) } else { torque }
}
