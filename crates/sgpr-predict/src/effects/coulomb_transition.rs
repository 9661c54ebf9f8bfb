use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};

/// How dry friction changes sign at a reversal: over a range of speeds instead of at once. The
/// column is the difference of a line that ends at vc, clip(dq / vc, -1, 1), and sgn(dq).
///
/// Simulators regularise dry friction in this way, and lubricated contacts carry less at creeping
/// speed. A model with Coulomb friction has the effect already, with vc = 0: to leave that constant
/// frozen makes other effects of slow motion appear that are not there.
///
/// Source: D. Karnopp, Computer simulation of stick-slip friction in mechanical dynamic systems,
/// ASME J. Dyn. Syst. 107 (1985), on regularised friction.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoulombTransition;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("Fct", "N·m", "N")];

const CONSTANTS: [Constant; 1] = [Constant::logarithmic(
    "vc",
    ["rad/s", "m/s"],
    [0.001, 2.0],
    &[0.8, 0.4, 0.2, 0.1, 0.05, 0.025, 0.012, 0.006, 0.003],
)];

impl Effect for CoulombTransition {
    facts! {
        name: "coulomb_transition",
        summary: "Dry friction that changes sign over a range of speeds instead of at once.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
        refines: Some("coulomb_friction"),
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = Fct (clip(dq/vc, -1, 1) - sgn(dq)), beside Fc sgn(dq)",
            source: "D. Karnopp, Computer simulation of stick-slip friction in mechanical dynamic \
                 systems, ASME J. Dyn. Syst. 107 (1985).",
            signature: "friction that is too small at low speed",
            confusable: &["nonlinear_viscous_friction", "presliding_friction"],
            experiment: "constant speeds on a logarithmic grid",
            excitation: "slow motion and reversals",
            origin: Origin::Arm,
            origin_reason: "it is the shape of dry friction at low speed",
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
    let dq = input.dq[joint];
    columns[0] = (dq / constants[0]).clamp(S::constant(-1.0), S::constant(1.0)) - dq.sgn();
}
