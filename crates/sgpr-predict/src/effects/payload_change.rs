use alloc::vec::Vec;

#[cfg(feature = "trajectories")]
use super::Context;
#[cfg(feature = "trajectories")]
use super::columns::link_regressor;
use super::columns::{after, link_columns, of_a_link};
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Scale,
    Site, StepState, Stepped, facts, written_once,
};

/// A load that is taken up or put down at a time t0: ten inertial parameters of the last link for
/// t > t0.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
/// 9.5, with a change point.
#[derive(Clone, Copy, Debug)]
pub(super) struct PayloadChange;

const PARAMETERS: [EffectParameter; 10] = of_a_link(EffectParameter::positive("m", "kg", "kg"));

const CONSTANTS: [Constant; 1] =
    [Constant::new("t0", ["s", "s"], [f64::NEG_INFINITY, f64::INFINITY], Scale::Time, &[])];

impl Effect for PayloadChange {
    facts! {
        name: "payload_change",
        summary: "A load taken up or put down at some moment.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        reach: Reach::All,
        is_body: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::ChangePoint,
            formula: "tau = Y_last(q, dq, ddq) (m, mx, ..., Izz) for t > t0",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 9.5, with a change point.",
            signature: "shaped like gravity on all joints, from one moment on",
            confusable: &["torque_offset_drift", "external_contact", "friction_step"],
            experiment: "more poses after the change",
            excitation: "different poses before and after, on one clock",
            depends_on_time: true,
            origin: Origin::Temporary,
            origin_reason: "the load was taken up or put down during the logs; what is carried now \
                 is for the user to say",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    #[cfg(feature = "trajectories")]
    fn trajectory_columns(
        &self,
        _: Site,
        context: &Context<'_>,
        constants: &[f64],
        out: &mut [Vec<f64>],
    ) {
        let last = context.dof() - 1;
        link_regressor(
            context,
            last,
            |k| after(context.time[k], constants[0], context.rate_hz),
            out,
        );
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    _: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let on = after::<S>(input.time, constants[0], input.rate_hz);
    link_columns(input, input.robot.dof() - 1, on, state, columns);
}
