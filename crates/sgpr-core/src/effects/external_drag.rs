use super::{About, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Site, StepState};
use crate::dynamics::jacobian;
use crate::robot::Frame;
use crate::spatial::Pose;

/// Drag of water or air on the arm, taken at the origin of the last link: tau = c Jᵀ v |v|.
///
/// Source: T. I. Fossen, Marine Control Systems (2002), quadratic drag.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExternalDrag;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("c", "N·s²/m²", "N·s²/m²")];

impl Effect for ExternalDrag {
    fn name(&self) -> &str {
        "external_drag"
    }

    fn summary(&self) -> &str {
        "Drag of the fluid around the arm."
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

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
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

    fn advance(&self, _: Site, _: &[f64], input: &SampleInput<'_>, state: &mut StepState<'_>, columns: &mut [f64]) {
        let n = input.robot.dof();
        let tip = Frame { name: String::new(), joint: Some(n - 1), pose: Pose::IDENTITY };
        let jacobian = jacobian(input.robot, state.workspace, input.q, &tip);
        let speed = |row: usize| (0..n).map(|joint| jacobian[row * n + joint] * input.dq[joint]).sum::<f64>();
        let v = [speed(0), speed(1), speed(2)];
        let size = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        for (joint, column) in columns.iter_mut().enumerate() {
            *column = (0..3).map(|row| jacobian[row * n + joint] * v[row] * size).sum();
        }
    }
}
