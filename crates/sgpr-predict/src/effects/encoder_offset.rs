use super::{
    About, Class, Constant, Effect, Entry, LinkSample, Origin, Reach, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};
#[cfg(feature = "trajectories")]
use super::{Context, LinkMotion};

/// A joint whose zero is off: q_link = q + d. A refit turns the inertial parameters and absorbs
/// nearly all of it.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section 11,
/// geometric calibration.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncoderOffset;

const CONSTANTS: [Constant; 1] = [Constant::neutral_at_zero("d", ["rad", "m"], [-0.3, 0.3], 1e-4)];

impl Effect for EncoderOffset {
    facts! {
        name: "encoder_offset",
        summary: "A joint whose zero position is off.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        moves_links: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "q_link = q + d",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 11, geometric calibration.",
            signature: "a turn of the gravity torques",
            confusable: &["link_inertia_error", "joint_elasticity"],
            experiment: "the same motion with a known payload; static poses to both sides",
            excitation: "a known payload",
            origin: Origin::Arm,
            origin_reason: "the controller closes its loop over the same encoder",
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
        motion.q.iter_mut().skip(joint).step_by(context.dof()).for_each(|q| *q += constants[0]);
    }

    written_once!(advance_links: links);
}

fn links<S: Stepped>(
    site: Site,
    constants: &[f64],
    _: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    links: &mut LinkSample<'_, S>,
) {
    links.q[site.joint().expect("at a joint")] += S::constant(constants[0]);
}
