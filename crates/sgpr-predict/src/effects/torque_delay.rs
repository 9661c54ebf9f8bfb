use alloc::vec::Vec;

use super::columns::shift;
use super::stepping::Delay;
use super::{
    About, Class, Constant, Effect, Entry, Needs, Origin, Reach, Site, Stepped, Streamed, facts,
    written_once,
};

/// Torques that are logged late: tau_log(t) = tau(t - d), one delay for all joints.
///
/// Source: common in logged data; M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output
/// error method, IEEE TCST 21(2) (2013), section on time shifts.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueDelay;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("d", ["s", "s"], [-0.06, 0.06], 5e-4)];

impl Effect for TorqueDelay {
    facts! {
        name: "torque_delay",
        summary: "The torque is logged later than the motion.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "tau_log(t) = tau(t - d)",
            source: "common in logged data; M. Gautier, A. Janot, P.-O. Vandanjon, A new \
                 closed-loop output error method, IEEE TCST 21(2) (2013), section on time shifts.",
            signature: "the derivative of the torque, spikes at every reversal, grows with speed",
            confusable: &["actuator_lag", "presliding_friction"],
            experiment: "the same path at two speeds: a delay scales with speed, presliding with \
                 distance",
            excitation: "fast motion with reversals",
            origin: Origin::Measurement,
            origin_reason: "the torque is late in the log, not in the arm",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    fn transmit(
        &self,
        _: Site,
        constants: &[f64],
        _: usize,
        rate_hz: f64,
        values: &mut [f64],
        width: usize,
    ) {
        if rate_hz.is_finite() {
            shift(values, width, constants[0] * rate_hz);
        }
    }

    fn needs(&self) -> Needs {
        Needs { rate: true, ..Needs::default() }
    }

    fn streamed(&self) -> Streamed<'_> {
        Streamed::Nearly(
            "a delay below one period is interpolated from the four newest samples; a torque that \
             is logged early is that of the motion extrapolated by that time",
        )
    }

    fn lead(&self, constants: &[f64]) -> f64 {
        (-constants[0]).max(0.0)
    }

    fn state_len(&self, constants: &[f64], rate_hz: f64) -> usize {
        Delay::len(constants[0], rate_hz)
    }

    written_once!(start_transmitted: start_transmitted);

    written_once!(advance_transmitted: transmitted);
}

fn start_transmitted<S: Stepped>(torque: S, hidden: &mut [S]) {
    S::start_delay(hidden, torque);
}

fn transmitted<S: Stepped>(
    _: Site,
    constants: &[f64],
    _: usize,
    rate_hz: f64,
    hidden: &mut [S],
    torque: S,
) -> S {
    if rate_hz.is_finite() && constants[0] > 0.0 {
        S::delayed(hidden, torque, constants[0], 1.0 / rate_hz)
    } else {
        torque
    }
}
