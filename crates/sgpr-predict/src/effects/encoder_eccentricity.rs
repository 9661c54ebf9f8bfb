use alloc::vec::Vec;

use super::{
    About, Class, Constant, Effect, Entry, LinkSample, Origin, Reach, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};
#[cfg(feature = "trajectories")]
use super::{Context, LinkMotion};

/// An encoder disc that sits off centre: q_link = q + e1 cos q + e2 sin q.
///
/// Source: H. Heidenhain, Encoders for servo drives (1999), eccentricity of the graduation.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncoderEccentricity;

const CONSTANTS: [Constant; 2] = [
    Constant::neutral_at_zero("e1", ["rad", "m"], [-0.03, 0.03], 1e-4),
    Constant::neutral_at_zero("e2", ["rad", "m"], [-0.03, 0.03], 1e-4),
];

impl Effect for EncoderEccentricity {
    facts! {
        name: "encoder_eccentricity",
        summary: "An encoder that errs once per turn.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        moves_links: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "q_link = q + e1 cos q + e2 sin q",
            source: "H. Heidenhain, Encoders for servo drives (1999), eccentricity of the \
                 graduation.",
            signature: "once per turn",
            confusable: &["position_dependent_friction", "encoder_offset"],
            experiment: "sweeps over whole turns",
            excitation: "whole turns of the joint",
            origin: Origin::Arm,
            origin_reason: "the controller closes its loop over the same encoder",
            ..About::default()
        }
    }

    fn sites(&self, robot: &crate::robot::Robot) -> Vec<Site> {
        (0..robot.dof())
            .filter(|&joint| robot.joints()[joint].kind.is_rotation())
            .map(Site::Joint)
            .collect()
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
        for k in 0..context.len() {
            let (at, state) = (k * context.dof() + joint, context.state(k));
            let (q, dq, ddq) = (state.q[joint], state.dq[joint], state.ddq[joint]);
            let (sine, cosine) = q.sin_cos();
            let slope = constants[1] * cosine - constants[0] * sine;
            motion.q[at] += constants[0] * cosine + constants[1] * sine;
            motion.dq[at] += slope * dq;
            motion.ddq[at] += slope * ddq - (constants[0] * cosine + constants[1] * sine) * dq * dq;
        }
    }

    written_once!(advance_links: links);
}

fn links<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    links: &mut LinkSample<'_, S>,
) {
    let joint = site.joint().expect("at a joint");
    let (q, dq, ddq) = (input.q[joint], input.dq[joint], input.ddq[joint]);
    let (sine, cosine) = q.sin_cos();
    let slope = cosine * constants[1] - sine * constants[0];
    let error = cosine * constants[0] + sine * constants[1];
    links.q[joint] += error;
    links.dq[joint] += slope * dq;
    links.ddq[joint] += slope * ddq - error * dq * dq;
}
