#[cfg(feature = "trajectories")]
use crate::signal::{LowPass, Spectrum};

#[cfg(feature = "trajectories")]
use super::stepping::{ABOVE, WINDOW_S};
use super::stepping::{SMOOTH_DERIVATIVES_STATE, SmoothDerivatives};
use super::{
    About, Class, Constant, Effect, Entry, LinkSample, Needs, Origin, Reach, SampleInput, Site,
    StepState, Stepped, Streamed, facts, written_once,
};
#[cfg(feature = "trajectories")]
use super::{Context, LinkMotion};

/// Elastic transmission: the link lags behind the encoder on the motor side by the torque it takes,
/// q_link = q - c tau_rb, with the compliance c = 1 / k.
///
/// Source: M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. 109
/// (1987); a first-order (quasi-static) link motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointElasticity;

const CONSTANTS: [Constant; 1] =
    [Constant::neutral_at_zero("c", ["rad/(N·m)", "m/N"], [0.0, 0.1], 1e-6)];

impl Effect for JointElasticity {
    facts! {
        name: "joint_elasticity",
        summary: "A transmission that twists under load, so that the link is not where the motor's \
             encoder says.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        moves_links: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "q_link = q - c tau_rb, c = 1/k",
            source: "M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. \
                 109 (1987); a first-order (quasi-static) link motion.",
            signature: "on all joints inboard, follows the joint's torque and its second \
                 derivative",
            confusable: &["backlash", "encoder_offset", "link_flexibility"],
            experiment: "static poses with two payloads and a sensor on the link side, or fast \
                 motion near a third of the resonance",
            excitation: "accelerations and torques of the joint that change much",
            origin: Origin::Arm,
            origin_reason: "the link lies elsewhere than the encoder says, in control as in the \
                 log",
            ..About::default()
        }
    }

    #[cfg(feature = "trajectories")]
    fn link_motion(
        &self,
        site: Site,
        constants: &[f64],
        context: &Context<'_>,
        motion: &mut LinkMotion,
    ) {
        let joint = site.joint().expect("at a joint");
        let mut twist: Vec<f64> = context
            .of_joint(context.rigid_torque, joint)
            .map(|torque| -constants[0] * torque)
            .collect();
        smooth(&mut twist, context);
        motion.deflect(joint, &twist, context.rate_hz);
    }

    written_once!(advance_links: links);

    fn needs(&self) -> Needs {
        Needs { rate: true, ..Needs::default() }
    }

    fn streamed(&self) -> Streamed<'_> {
        Streamed::Nearly(
            "the twist is differentiated by a filter that looks back alone, with a cut-off that \
             follows from the speeds and accelerations so far",
        )
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        SMOOTH_DERIVATIVES_STATE
    }
}

fn links<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    links: &mut LinkSample<'_, S>,
) {
    let joint = site.joint().expect("at a joint");
    let twist = input.rigid_torque[joint] * -constants[0];
    links.q[joint] += twist;
    if !input.rate_hz.is_finite() {
        return;
    }
    let [velocity, acceleration] = SmoothDerivatives(state.hidden).advance(twist, input);
    links.dq[joint] += velocity;
    links.ddq[joint] += acceleration;
}

/// Takes out what lies far above the motion: the torque holds second derivatives of the position,
/// the link's motion those of the torque, and noise that is differentiated four times hides
/// everything. In a slow log the torque itself is mostly noise there: the speeds of all joints say
/// how fast the motion is.
#[cfg(feature = "trajectories")]
fn smooth(twist: &mut [f64], context: &Context<'_>) {
    const POWER: f64 = 0.995;
    let rate_hz = context.rate_hz;
    if !rate_hz.is_finite() {
        return;
    }
    let speeds =
        (0..context.dof()).map(|joint| context.of_joint(context.dq, joint).collect::<Vec<f64>>());
    let spectra =
        speeds.map(|speed| Spectrum::welch(&speed, rate_hz, (WINDOW_S * rate_hz) as usize));
    let bandwidth = spectra.reduce(Spectrum::with).map_or(0.0, |all| all.bandwidth_hz(POWER));
    let cutoff = ABOVE * bandwidth.max(1.0 / WINDOW_S);
    if let Ok(filter) = LowPass::butterworth(4, cutoff, rate_hz) {
        // A log too short for the filter stays as it is.
        let _ = filter.apply(twist, 1);
    }
}
