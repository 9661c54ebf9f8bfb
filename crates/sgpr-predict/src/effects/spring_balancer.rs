use alloc::vec::Vec;

use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// A spring between a pin on the arm and one on the base, at distances with the ratio r from the
/// axis: with the length l = sqrt(1 + r² - 2 r cos(q - q0)) in units of the longer distance, tau =
/// -(s1 - s0 / l) sin(q - q0), written with free signs; a spring of zero free length is gravity,
/// which absorbs s1.
///
/// Source: geometry of a spring between two pins; G. Endo et al., A passive weight compensation
/// mechanism with a non-circular pulley and a spring, IEEE ICRA (2010), for its use.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpringBalancer;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("s1", "N·m", "N"), EffectParameter::signed("s0", "N·m", "N")];

const CONSTANTS: [Constant; 2] = [
    Constant::new(
        "q0",
        ["rad", "rad"],
        [-3.2, 3.2],
        Scale::Linear(0.4),
        &[-2.7, -1.8, -0.9, 0.0, 0.9, 1.8, 2.7],
    ),
    Constant::new("r", ["1", "1"], [0.15, 0.95], Scale::Linear(0.2), &[0.3, 0.7]),
];

impl Effect for SpringBalancer {
    facts! {
        name: "spring_balancer",
        summary: "A spring or balancer that carries part of the gravity load.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = s1 sin(q - q0) + s0 sin(q - q0) / sqrt(1 + r² - 2 r cos(q - q0))",
            source: "geometry of a spring between two pins; G. Endo et al., A passive weight \
                 compensation mechanism with a non-circular pulley and a spring, IEEE ICRA (2010), \
                 for its use.",
            signature: "depends on the joint's own position alone, strong, mostly at joint 2 or 3",
            confusable: &["cable_stiffness", "torque_offset"],
            experiment: "static poses over the whole range, with and without payload",
            excitation: "slow motion over the whole range",
            origin: Origin::Arm,
            origin_reason: "the balancer pulls on the joint",
            ..About::default()
        }
    }

    fn sites(&self, robot: &crate::robot::Robot) -> Vec<Site> {
        (0..robot.dof())
            .filter(|&joint| robot.joints()[joint].kind.is_rotation())
            .map(Site::Joint)
            .collect()
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let (q0, r) = (constants[0], constants[1]);
    let (sine, cosine) = (input.q[site.joint().expect("at a joint")] - q0).sin_cos();
    columns[0] = sine;
    columns[1] = sine / (-cosine * (2.0 * r) + (1.0 + r * r)).sqrt();
}
