use alloc::vec::Vec;

use super::columns::tip_levers;
use super::{
    About, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Site, StepState, Stepped,
    facts, written_once,
};
use crate::spatial::Vector3;

/// Drag of water or air on the arm, taken at the origin of the last link: tau = c Jᵀ v |v|.
///
/// Source: T. I. Fossen, Marine Control Systems (2002), quadratic drag.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExternalDrag;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("c", "N·s²/m²", "N·s²/m²")];

impl Effect for ExternalDrag {
    facts! {
        name: "external_drag",
        summary: "Drag of the fluid around the arm.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        reach: Reach::All,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = c Jᵀ v |v|",
            source: "T. I. Fossen, Marine Control Systems (2002), quadratic drag.",
            signature: "grows with the square of the tip's speed, over all joints together",
            confusable: &["quadratic_viscous_friction"],
            experiment: "the same motion in air",
            excitation: "fast motion of several joints",
            origin: Origin::Arm,
            origin_reason: "the arm moves through the fluid",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
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
    let mut v = Vector3::zero(());
    tip_levers(input, state, |joint, lever| v = v + lever * input.dq[joint]);
    let along = v * v.dot(v).sqrt();
    columns.fill(S::zero(()));
    tip_levers(input, state, |joint, lever| columns[joint] = lever.dot(along));
}
