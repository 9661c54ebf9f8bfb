#[cfg(feature = "trajectories")]
use super::Context;
#[cfg(feature = "trajectories")]
use super::columns::link_regressor;
use super::columns::{link_columns, of_a_link};
use super::{
    About, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Site, StepState, Stepped,
    facts, written_once,
};

/// Wrong inertial parameters of a link in a fixed model. A refit of the base parameters absorbs
/// them.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section
/// 9.4.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkInertiaError;

const PARAMETERS: [EffectParameter; 10] = of_a_link(EffectParameter::signed("m", "kg", "kg"));

impl Effect for LinkInertiaError {
    facts! {
        name: "link_inertia_error",
        summary: "A link whose mass or inertia the model has wrong.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        reach: Reach::All,
        is_absorbed: true,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = Y_link(q, dq, ddq) (dm, dmx, ..., dIzz)",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 9.4.",
            signature: "shaped like gravity and inertia, on the joint and all before it",
            confusable: &["payload", "link_length_error"],
            experiment: "identify the parameters",
            excitation: "motion of all joints",
            origin: Origin::Arm,
            origin_reason: "the link has this inertia",
            ..About::default()
        }
    }

    #[cfg(feature = "trajectories")]
    fn trajectory_columns(
        &self,
        site: Site,
        context: &Context<'_>,
        _: &[f64],
        out: &mut [Vec<f64>],
    ) {
        let joint = site.joint().expect("at a joint");
        link_regressor(context, joint, |_| 1.0, out);
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    link_columns(input, site.joint().expect("at a joint"), S::constant(1.0), state, columns);
}
