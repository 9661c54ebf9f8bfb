use super::{
    About, Class, Constant, Effect, EffectParameter, Entry, Origin, SampleInput, Scale, Site,
    StepState, Stepped, facts, written_once,
};

/// Viscous friction whose growth slows down with speed, as shear-thinning grease shows: tau = c
/// sgn(dq) |dq|^a with a below one.
///
/// Source: A. Harnoy, B. Friedland, H. Rachoor, Modeling and simulation of elastic and friction
/// forces in lubricated bearings, Wear 172 (1994); A. C. Bittencourt, S. Gunnarsson, Static
/// friction in a robot joint, ASME J. Dyn. Syst. 134(5) (2012).
#[derive(Clone, Copy, Debug)]
pub(super) struct NonlinearViscousFriction;

const PARAMETERS: [EffectParameter; 1] =
    [EffectParameter::signed("cn", "N·m·(s/rad)^a", "N·(s/m)^a")];

const CONSTANTS: [Constant; 1] =
    [Constant::new("a", ["1", "1"], [0.2, 0.85], Scale::Linear(0.1), &[0.35, 0.5, 0.7])];

impl Effect for NonlinearViscousFriction {
    facts! {
        name: "nonlinear_viscous_friction",
        summary: "Viscous friction that grows less than in proportion to the speed.",
        parameters: &PARAMETERS,
        constants: &CONSTANTS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Nonlinear,
            formula: "tau = c sgn(dq) |dq|^a, 0.2 < a < 0.85",
            source: "A. Harnoy, B. Friedland, H. Rachoor, Modeling and simulation of elastic and \
                 friction forces in lubricated bearings, Wear 172 (1994); A. C. Bittencourt, S. \
                 Gunnarsson, Static friction in a robot joint, ASME J. Dyn. Syst. 134(5) (2012).",
            signature: "odd in the speed, curved",
            confusable: &[
                "stribeck_friction",
                "quadratic_viscous_friction",
                "temperature_dependent_friction",
            ],
            experiment: "constant speeds on a logarithmic grid",
            excitation: "speeds that differ by a factor of ten",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion",
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
    columns[0] = dq.sgn() * dq.abs().powf(constants[0]);
}
