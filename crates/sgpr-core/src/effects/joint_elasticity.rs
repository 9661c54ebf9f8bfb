use crate::signal::{LowPass, Spectrum};

use super::{About, Class, Constant, Context, Effect, Entry, LinkMotion, Reach, Site};

/// Elastic transmission: the link lags behind the encoder on the motor side by the torque it takes, q_link = q - c
/// tau_rb, with the compliance c = 1 / k.
///
/// Source: M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. 109 (1987); a first-order
/// (quasi-static) link motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointElasticity;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("c", ["rad/(N·m)", "m/N"], [0.0, 0.1], 1e-6)];

impl Effect for JointElasticity {
    fn name(&self) -> &str {
        "joint_elasticity"
    }

    fn summary(&self) -> &str {
        "A transmission that twists under load, so that the link is not where the motor's encoder says."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "q_link = q - c tau_rb, c = 1/k",
            source: "M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. 109 (1987); a first-order (quasi-static) link motion.",
            signature: "on all joints inboard, follows the joint's torque and its second derivative",
            confusable: &["backlash", "encoder_offset", "link_flexibility"],
            experiment: "static poses with two payloads and a sensor on the link side, or fast motion near a third of the resonance",
            excitation: "accelerations and torques of the joint that change much",
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

    fn moves_links(&self) -> bool {
        true
    }

    fn link_motion(&self, site: Site, constants: &[f64], context: &Context<'_>, motion: &mut LinkMotion) {
        let joint = site.joint().expect("at a joint");
        let mut twist: Vec<f64> =
            context.of_joint(context.rigid_torque, joint).map(|torque| -constants[0] * torque).collect();
        smooth(&mut twist, context.rate_hz);
        motion.deflect(joint, &twist, context.rate_hz);
    }
}

/// Takes out what lies far above the motion: the torque holds second derivatives of the position, the link's motion those
/// of the torque, and noise that is differentiated four times hides everything.
fn smooth(twist: &mut [f64], rate_hz: f64) {
    const WINDOW_S: f64 = 4.0;
    const POWER: f64 = 0.995;
    const ABOVE: f64 = 3.0;
    if !rate_hz.is_finite() {
        return;
    }
    let bandwidth = Spectrum::welch(twist, rate_hz, (WINDOW_S * rate_hz) as usize).bandwidth_hz(POWER);
    let cutoff = ABOVE * bandwidth.max(1.0 / WINDOW_S);
    if let Ok(filter) = LowPass::butterworth(4, cutoff, rate_hz) {
        // A log too short for the filter stays as it is.
        let _ = filter.apply(twist, 1);
    }
}
