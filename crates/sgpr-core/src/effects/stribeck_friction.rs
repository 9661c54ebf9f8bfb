use super::{About, Class, Constant, Context, Effect, EffectParameter, Entry, Site, sgn};

/// Friction that falls from its breakaway level Fs to the Coulomb level Fc as the lubricant builds up: tau = (Fs -
/// Fc) sgn(dq) exp(-(dq / vs)²), beside Coulomb friction.
///
/// Source: R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, Z. VDI 46 (1902); form of C.
/// Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE TAC 40(3) (1995).
#[derive(Clone, Copy, Debug)]
pub(super) struct StribeckFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("dFs", "N·m", "N")];

const CONSTANTS: [Constant; 1] =
    [Constant::logarithmic("vs", ["rad/s", "m/s"], [0.004, 0.6], &[0.01, 0.02, 0.04, 0.08, 0.16, 0.3])];

impl Effect for StribeckFriction {
    fn name(&self) -> &str {
        "stribeck_friction"
    }

    fn summary(&self) -> &str {
        "Dry friction that is larger at creeping speed than in motion."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = dFs sgn(dq) exp(-(dq/vs)²), dFs = Fs - Fc",
            source: "R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, Z. VDI 46 (1902); form of C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE TAC 40(3) (1995).",
            signature: "odd in the speed, only below vs",
            confusable: &["presliding_friction", "quadratic_viscous_friction", "nonlinear_viscous_friction"],
            experiment: "slow sweeps from a tenth of vs to three times vs, and runs at the highest speed",
            excitation: "slow motion: speeds around vs for a tenth of the time",
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

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, constants: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        for (out, dq) in out[0].iter_mut().zip(context.of_joint(context.dq, joint)) {
            *out = sgn(dq) * (-(dq / constants[0]).powi(2)).exp();
        }
    }
}
