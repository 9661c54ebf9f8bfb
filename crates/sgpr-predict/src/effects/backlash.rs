use super::fitting::SMALLEST_TORQUE;
use super::stepping::{SMOOTH_DERIVATIVES_STATE, SmoothDerivatives};
use super::{
    About, Class, Constant, Effect, Entry, LinkSample, Needs, Origin, Reach, SampleInput, Site,
    StepState, Stepped, Streamed, facts, written_once,
};
#[cfg(feature = "trajectories")]
use super::{Context, LinkMotion};

/// Play b between the flanks of the gear: the link lies half of it to either side of the encoder,
/// depending on the sign of the torque, with a soft transition of a twentieth of the joint's
/// torque.
///
/// Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash - a survey,
/// Automatica 38 (2002).
#[derive(Clone, Copy, Debug)]
pub(super) struct Backlash;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("b", ["rad", "m"], [0.0, 0.03], 1e-5)];

impl Effect for Backlash {
    facts! {
        name: "backlash",
        summary: "Play of the gear: the link jumps when the torque changes sign.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        moves_links: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "q_link = q - b/2 tanh(tau_rb / ts)",
            source: "M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash - a \
                 survey, Automatica 38 (2002).",
            signature: "jumps when the transmitted torque changes sign",
            confusable: &["joint_elasticity", "presliding_friction"],
            experiment: "motion that crosses zero torque slowly in both directions, with a sensor \
                 on the link side",
            excitation: "zero crossings of the joint's torque",
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
        let scale = (0.05 * context.rms(context.rigid_torque, joint)).max(SMALLEST_TORQUE);
        let side = |torque: f64| -0.5 * constants[0] * (torque / scale).tanh();
        let play: Vec<f64> = context.of_joint(context.rigid_torque, joint).map(side).collect();
        motion.deflect(joint, &play, context.rate_hz);
    }

    written_once!(advance_links: links);

    fn needs(&self) -> Needs {
        Needs { rate: true, ..Needs::default() }
    }

    fn streamed(&self) -> Streamed<'_> {
        Streamed::Nearly(
            "the size of the joint's torque is that of the samples so far, and the torque is \
             differentiated by a filter that looks back alone",
        )
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        2 + SMOOTH_DERIVATIVES_STATE
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
    let (seen, derivatives) = state.hidden.split_at_mut(2);
    let torque = input.rigid_torque[joint];
    let [mean_square, count] = seen else { unreachable!("two numbers") };
    *count = *count + 1.0;
    *mean_square += (torque * torque - *mean_square) / *count;
    let scale = (mean_square.sqrt() * 0.05).max(S::constant(SMALLEST_TORQUE));
    let side = (torque / scale).tanh();
    links.q[joint] -= side * (0.5 * constants[0]);
    if !input.rate_hz.is_finite() {
        return;
    }
    let [first, second] = SmoothDerivatives(derivatives).advance(torque, input).map(|x| x / scale);
    let slope = -(side * side) + 1.0;
    let velocity = slope * (-0.5 * constants[0]) * first;
    let acceleration = slope * (-0.5 * constants[0]) * (second - side * 2.0 * first * first);
    // Between two samples the link crosses the play at most.
    let within = |x: S, most: f64| x.clamp(S::constant(-most), S::constant(most));
    let most = constants[0].abs() * input.rate_hz;
    links.dq[joint] += within(velocity, most);
    links.ddq[joint] += within(acceleration, most * input.rate_hz);
}
