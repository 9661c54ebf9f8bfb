use super::context::after;
use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Scale, Site, StepState,
};
use crate::dynamics::{frame_pose, jacobian};
use crate::robot::Frame;
use crate::spatial::{Pose, Vector3};

/// A force on the origin of the last link between t0 and t1, constant in base axes (F), in axes of the link (f), or the
/// sum of both: tau = Jᵀ (F + R f).
///
/// Source: S. Haddadin, A. De Luca, A. Albu-Schäffer, Robot collisions: a survey on detection, isolation, and
/// identification, IEEE Trans. Robotics 33(6) (2017).
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
    fn name(&self) -> &str {
        "external_contact"
    }

    fn summary(&self) -> &str {
        "Something pushes against the arm for a while."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::ChangePoint,
            formula: "tau = Jᵀ (F + R f) for t0 < t < t1, F in base axes, f in axes of the last link",
            source: "S. Haddadin, A. De Luca, A. Albu-Schäffer, Robot collisions: a survey on detection, isolation, and identification, IEEE Trans. Robotics 33(6) (2017).",
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

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn constants(&self) -> &[Constant] {
        &CONSTANTS
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn reach(&self) -> Reach {
        Reach::All
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    fn steps(&self) -> bool {
        true
    }

    fn advance(
        &self,
        _: Site,
        constants: &[f64],
        input: &SampleInput<'_>,
        state: &mut StepState<'_>,
        columns: &mut [f64],
    ) {
        let n = input.robot.dof();
        let inside = |edge: f64| after(input.time, edge, input.rate_hz);
        let on = inside(constants[0]) * (1.0 - inside(constants[1]));
        if on <= 0.0 {
            return columns.fill(0.0);
        }
        let tip = Frame { name: String::new(), joint: Some(n - 1), pose: Pose::IDENTITY };
        let turn = frame_pose(input.robot, state.workspace, input.q, &tip).rotation;
        let jacobian = jacobian(input.robot, state.workspace, input.q, &tip);
        for joint in 0..n {
            let lever = Vector3::new(jacobian[joint], jacobian[n + joint], jacobian[2 * n + joint]);
            let in_tool = turn.transpose_mul(lever);
            let levers = [lever.x, lever.y, lever.z, in_tool.x, in_tool.y, in_tool.z];
            columns.chunks_exact_mut(n).zip(levers).for_each(|(column, lever)| column[joint] = on * lever);
        }
    }
}
