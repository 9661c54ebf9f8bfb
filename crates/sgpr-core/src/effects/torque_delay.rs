use super::context::shift;
use super::{About, Class, Constant, Effect, Entry, Reach, Site};

/// Torques that are logged late: tau_log(t) = tau(t - d), one delay for all joints.
///
/// Source: common in logged data; M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method, IEEE
/// TCST 21(2) (2013), section on time shifts.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueDelay;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("d", ["s", "s"], [-0.06, 0.06], 5e-4)];

impl Effect for TorqueDelay {
    fn name(&self) -> &str {
        "torque_delay"
    }

    fn summary(&self) -> &str {
        "The torque is logged later than the motion."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "tau_log(t) = tau(t - d)",
            source: "common in logged data; M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method, IEEE TCST 21(2) (2013), section on time shifts.",
            signature: "the derivative of the torque, spikes at every reversal, grows with speed",
            confusable: &["actuator_lag", "presliding_friction"],
            experiment: "the same path at two speeds: a delay scales with speed, presliding with distance",
            excitation: "fast motion with reversals",
            ..About::default()
        }
    }

    fn parameters(&self) -> &[super::EffectParameter] {
        &[]
    }

    fn constants(&self) -> &[Constant] {
        &CONSTANTS
    }

    fn entry(&self) -> Entry {
        Entry::Transform
    }

    fn reach(&self) -> Reach {
        Reach::All
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    fn transmit(&self, _: Site, constants: &[f64], _: usize, rate_hz: f64, values: &mut [f64], width: usize) {
        if rate_hz.is_finite() {
            shift(values, width, constants[0] * rate_hz);
        }
    }
}
