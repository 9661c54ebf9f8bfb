use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Needs, Origin, SampleInput, Site,
    StepState, Stepped, facts, written_once,
};

/// Bending of a link as one mode, driven by the joint's acceleration: eta'' + 2 zeta w eta' + w²
/// eta = ddq, tau = m eta'', w = 2 pi f and zeta = 0.02.
///
/// Source: W. J. Book, Recursive Lagrangian dynamics of flexible manipulator arms, Int. J. Robotics
/// Research 3(3) (1984), reduced to one mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkFlexibility;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("m", "kg·m²", "kg")];

const CONSTANTS: [Constant; 1] =
    [Constant::logarithmic("f", ["Hz", "Hz"], [2.0, 25.0], &[4.0, 7.0, 12.0, 18.0])];

/// Damping ratio of the mode.
const DAMPING: f64 = 0.02;

impl Effect for LinkFlexibility {
    facts! {
        name: "link_flexibility",
        summary: "A link that rings after a jerk.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        has_memory: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = m eta'', eta'' + 2 zeta w eta' + w² eta = ddq",
            source: "W. J. Book, Recursive Lagrangian dynamics of flexible manipulator arms, Int. \
                 J. Robotics Research 3(3) (1984), reduced to one mode.",
            signature: "narrow-band ringing after a jerk, its frequency falls with payload",
            confusable: &["joint_elasticity"],
            experiment: "a chirp through the resonance, or a knock on the arm",
            excitation: "motion with content near the resonance",
            origin: Origin::Arm,
            origin_reason: "the link rings in every motion",
            ..About::default()
        }
    }

    fn needs(&self) -> Needs {
        Needs { rate: true, ..Needs::default() }
    }

    fn state_len(&self, _: &[f64], _: f64) -> usize {
        2
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let joint = site.joint().expect("at a joint");
    if !input.rate_hz.is_finite() {
        return columns.fill(S::zero(()));
    }
    let (step, w) = (1.0 / input.rate_hz, core::f64::consts::TAU * constants[0]);
    let [eta, speed] = state.hidden else { unreachable!("one mode has two numbers") };
    // Semi-implicit Euler: stable up to a third of the sampling rate.
    let acceleration = input.ddq[joint] - *speed * (2.0 * DAMPING * w) - *eta * (w * w);
    *speed += acceleration * step;
    *eta += *speed * step;
    columns[0] = acceleration;
}
