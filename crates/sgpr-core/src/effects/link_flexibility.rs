use super::{About, Class, Constant, Context, Effect, EffectParameter, Entry, Site};

/// Bending of a link as one mode, driven by the joint's acceleration: eta'' + 2 zeta w eta' + w² eta = ddq, tau = m
/// eta'', w = 2 pi f and zeta = 0.02.
///
/// Source: W. J. Book, Recursive Lagrangian dynamics of flexible manipulator arms, Int. J. Robotics Research 3(3)
/// (1984), reduced to one mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkFlexibility;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("m", "kg·m²", "kg")];

const CONSTANTS: [Constant; 1] = [Constant::logarithmic("f", ["Hz", "Hz"], [2.0, 25.0], &[4.0, 7.0, 12.0, 18.0])];

impl Effect for LinkFlexibility {
    fn name(&self) -> &str {
        "link_flexibility"
    }

    fn summary(&self) -> &str {
        "A link that rings after a jerk."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = m eta'', eta'' + 2 zeta w eta' + w² eta = ddq",
            source: "W. J. Book, Recursive Lagrangian dynamics of flexible manipulator arms, Int. J. Robotics Research 3(3) (1984), reduced to one mode.",
            signature: "narrow-band ringing after a jerk, its frequency falls with payload",
            confusable: &["joint_elasticity"],
            experiment: "a chirp through the resonance, or a knock on the arm",
            excitation: "motion with content near the resonance",
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

    fn has_memory(&self) -> bool {
        true
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, constants: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        if !context.rate_hz.is_finite() {
            return;
        }
        let (step, w, zeta) = (1.0 / context.rate_hz, std::f64::consts::TAU * constants[0], 0.02);
        let (mut eta, mut speed) = (0.0, 0.0);
        for (out, ddq) in out[0].iter_mut().zip(context.of_joint(context.ddq, joint)) {
            // Semi-implicit Euler: stable up to a third of the sampling rate.
            let acceleration = ddq - 2.0 * zeta * w * speed - w * w * eta;
            speed += step * acceleration;
            eta += step * speed;
            *out = acceleration;
        }
    }
}
