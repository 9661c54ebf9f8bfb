use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Position error of a gear, e = A sin(n q + p), n periods per turn: the inertia behind it is
/// shaken by e'', tau = d²/dt² (a cos(n q) + b sin(n q)).
///
/// Source: T. D. Tuttle, W. P. Seering, A nonlinear model of a harmonic drive gear transmission,
/// IEEE Trans. Robotics and Automation 12(3) (1996).
#[derive(Clone, Copy, Debug)]
pub(super) struct KinematicError;

const PARAMETERS: [EffectParameter; 2] =
    [EffectParameter::signed("a", "kg·m²", "kg"), EffectParameter::signed("b", "kg·m²", "kg")];

const CONSTANTS: [Constant; 1] =
    [Constant::new("n", ["1/rev", "rad/m"], [3.5, 400.0], Scale::Order, &[])];

impl Effect for KinematicError {
    facts! {
        name: "kinematic_error",
        summary: "A gear whose output runs ahead and behind many times per turn.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = d²/dt² (a cos(n q) + b sin(n q))",
            source: "T. D. Tuttle, W. P. Seering, A nonlinear model of a harmonic drive gear \
                 transmission, IEEE Trans. Robotics and Automation 12(3) (1996).",
            signature: "periodic in the position, grows with the square of the speed",
            confusable: &["torque_ripple"],
            experiment: "two speeds: ripple keeps its size, a kinematic error grows",
            excitation: "passes over many periods at different speeds",
            origin: Origin::Arm,
            origin_reason: "the gear accelerates the link in the same way again",
            ..About::default()
        }
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
    let joint = site.joint().expect("at a joint");
    let n = constants[0];
    let (sine, cosine) = (input.q[joint] * n).sin_cos();
    let (square, ddq) = (input.dq[joint].squared() * n, input.ddq[joint]);
    columns[0] = -(square * cosine + ddq * sine);
    columns[1] = ddq * cosine - square * sine;
}
