use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, Role, SampleInput, Site,
    StepState, Stepped, facts, written_once,
};

/// Friction that falls from its breakaway level Fs to the Coulomb level Fc as the lubricant builds
/// up: tau = (Fs - Fc) sgn(dq) exp(-(dq / vs)²), beside Coulomb friction.
///
/// Source: R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, Z. VDI 46
/// (1902); form of C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, IEEE TAC 40(3)
/// (1995).
#[derive(Clone, Copy, Debug)]
pub(super) struct StribeckFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("dFs", "N·m", "N")];

const CONSTANTS: [Constant; 1] = [Constant::logarithmic(
    "vs",
    ["rad/s", "m/s"],
    [0.004, 0.6],
    &[0.01, 0.02, 0.04, 0.08, 0.16, 0.3],
)];

impl Effect for StribeckFriction {
    facts! {
        name: "stribeck_friction",
        summary: "Dry friction that is larger at creeping speed than in motion.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        role: Some(Role::Stribeck),
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = dFs sgn(dq) exp(-(dq/vs)²), dFs = Fs - Fc",
            source: "R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, Z. \
                 VDI 46 (1902); form of C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, \
                 IEEE TAC 40(3) (1995).",
            signature: "odd in the speed, only at low speed",
            confusable: &[
                "presliding_friction",
                "quadratic_viscous_friction",
                "nonlinear_viscous_friction",
            ],
            experiment: "slow sweeps from a tenth of the speed below which friction rises (vs) to \
                 three times it, and runs at the highest speed",
            excitation: "slow motion: speeds around vs for a tenth of the time",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it at creeping speed",
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
    let dq = input.dq[site.joint().expect("at a joint")];
    columns[0] = dq.sgn() * (-(dq / constants[0]).squared()).exp();
}
