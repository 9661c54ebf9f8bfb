use alloc::vec::Vec;

use super::columns::lag;
use super::stepping::{LAG_STATE, Lag};
use super::{
    About, Class, Constant, Effect, Entry, Needs, Origin, Reach, Site, Stepped, facts, written_once,
};

/// A torque loop of first order: what is logged follows the torque with the time constant T.
///
/// Source: P. Corke, Robotics, Vision and Control (2011), section 9.1, motor current loop.
#[derive(Clone, Copy, Debug)]
pub(super) struct ActuatorLag;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("T", ["s", "s"], [0.0, 0.06], 5e-4)];

impl Effect for ActuatorLag {
    facts! {
        name: "actuator_lag",
        summary: "The logged torque follows the real one with a lag.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "T dtau_log/dt + tau_log = tau",
            source: "P. Corke, Robotics, Vision and Control (2011), section 9.1, motor current \
                 loop.",
            signature: "like a delay at low frequency, steps are rounded",
            confusable: &["torque_delay"],
            experiment: "steps and chirps of the command",
            excitation: "fast motion with reversals",
            origin: Origin::Measurement,
            origin_reason: "the log trails the torque; the arm needs it at once",
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
        if rate_hz.is_finite() && constants[0] > 0.0 {
            lag(values, width, constants[0] * rate_hz);
        }
    }

    fn needs(&self) -> Needs {
        Needs { rate: true, ..Needs::default() }
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        LAG_STATE
    }

    written_once!(start_transmitted: start_transmitted);

    written_once!(advance_transmitted: transmitted);
}

fn start_transmitted<S: Stepped>(torque: S, hidden: &mut [S]) {
    Lag(hidden).start(torque);
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
        Lag(hidden).advance(torque, S::constant(constants[0] * rate_hz))
    } else {
        torque
    }
}
