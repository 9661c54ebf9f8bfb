use alloc::vec::Vec;

use super::columns::{after, tip_levers};
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Scale,
    Site, StepState, Stepped, facts, written_once,
};
use crate::spatial::Vector3;

/// A force on the origin of the last link between t0 and t1, constant in base axes (F), in axes of
/// the link (f), or the sum of both: tau = Jᵀ (F + R f).
///
/// Source: S. Haddadin, A. De Luca, A. Albu-Schäffer, Robot collisions: a survey on detection,
/// isolation, and identification, IEEE Trans. Robotics 33(6) (2017).
#[derive(Clone, Copy, Debug)]
pub(super) struct ExternalContact;

const PARAMETERS: [EffectParameter; 6] = [
    EffectParameter::signed("Fx", "N", "N"),
    EffectParameter::signed("Fy", "N", "N"),
    EffectParameter::signed("Fz", "N", "N"),
    EffectParameter::signed("fx", "N", "N"),
    EffectParameter::signed("fy", "N", "N"),
    EffectParameter::signed("fz", "N", "N"),
];

const CONSTANTS: [Constant; 2] = [
    Constant::new("t0", ["s", "s"], [f64::NEG_INFINITY, f64::INFINITY], Scale::Time, &[]),
    Constant::new("t1", ["s", "s"], [f64::NEG_INFINITY, f64::INFINITY], Scale::Time, &[]),
];

impl Effect for ExternalContact {
    facts! {
        name: "external_contact",
        summary: "Something pushes against the arm for a while.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        reach: Reach::All,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::ChangePoint,
            formula: "tau = Jᵀ (F + R f) for t0 < t < t1, F in base axes, f in axes of the last \
                 link",
            source: "S. Haddadin, A. De Luca, A. Albu-Schäffer, Robot collisions: a survey on \
                 detection, isolation, and identification, IEEE Trans. Robotics 33(6) (2017).",
            signature: "in the pattern of the Jacobian over the joints, for a limited time",
            confusable: &["payload_change"],
            experiment: "repeat the motion",
            excitation: "the motion goes on before and after, on one clock",
            depends_on_time: true,
            origin: Origin::Temporary,
            origin_reason: "something pushed for a while during the logs",
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
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let n = input.robot.dof();
    let inside = |edge: f64| after::<S>(input.time, edge, input.rate_hz);
    let on = inside(constants[0]) * (-inside(constants[1]) + 1.0);
    columns.fill(S::zero(()));
    if on.is_surely_zero() {
        return;
    }
    let (forces, moments) = columns.split_at_mut(3 * n);
    let turn = tip_levers(input, state, |joint, lever| {
        let parts = [lever.x, lever.y, lever.z];
        forces.chunks_exact_mut(n).zip(parts).for_each(|(column, part)| column[joint] = part);
    });
    for joint in 0..n {
        let [x, y, z] = [0, 1, 2].map(|axis| forces[axis * n + joint]);
        let in_tool = turn.transpose_mul(Vector3::new(x, y, z));
        let parts = [in_tool.x, in_tool.y, in_tool.z];
        moments.chunks_exact_mut(n).zip(parts).for_each(|(column, part)| column[joint] = part);
    }
    columns.iter_mut().for_each(|value| *value = on * *value);
}
