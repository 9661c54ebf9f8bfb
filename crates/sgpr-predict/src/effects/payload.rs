use alloc::vec::Vec;

#[cfg(feature = "trajectories")]
use super::Context;
#[cfg(feature = "trajectories")]
use super::columns::link_regressor;
use super::columns::{link_columns, of_a_link};
use super::{
    About, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Site, StepState, Stepped,
    facts, written_once,
};

/// A body fixed to the last link: ten inertial parameters. A refit of the base parameters absorbs
/// it whole; against a fixed model it shows.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
/// 9.5; M. Gautier, S. Briot, Global identification of joint drive gains and dynamic parameters of
/// robots, ASME J. Dyn. Syst. 136(5) (2014).
#[derive(Clone, Copy, Debug)]
pub(super) struct PayloadBody;

const PARAMETERS: [EffectParameter; 10] = of_a_link(EffectParameter::positive("m", "kg", "kg"));

impl Effect for PayloadBody {
    facts! {
        name: "payload",
        summary: "A load that the model does not know, there all the time.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        reach: Reach::All,
        is_absorbed: true,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Y_last(q, dq, ddq) (m, mx, ..., Izz)",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 9.5; M. Gautier, S. Briot, Global identification of joint drive gains and \
                 dynamic parameters of robots, ASME J. Dyn. Syst. 136(5) (2014).",
            signature: "shaped like gravity and inertia on all joints",
            confusable: &["link_inertia_error", "payload_change"],
            experiment: "a run without the load",
            excitation: "poses in which the load's gravity differs",
            origin: Origin::Arm,
            origin_reason: "the load was there all the time, and is taken to stay",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    #[cfg(feature = "trajectories")]
    fn trajectory_columns(&self, _: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let last = context.dof() - 1;
        link_regressor(context, last, |_| 1.0, out);
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    _: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    link_columns(input, input.robot.dof() - 1, S::constant(1.0), state, columns);
}
