use super::{
    About, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState, Stepped, facts,
    written_once,
};

/// Friction of a gear that grows with the torque it carries: tau = mu |tau_load| sgn(dq), tau_load
/// the torque of the rigid body.
///
/// Source: P. Hamon, M. Gautier, P. Garrec, A. Janot, Dynamic identification of robot with a
/// load-dependent joint friction model, IEEE/ASME AIM (2010).
#[derive(Clone, Copy, Debug)]
pub(super) struct LoadDependentFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("mu", "1", "1")];

impl Effect for LoadDependentFriction {
    facts! {
        name: "load_dependent_friction",
        summary: "Friction that grows with the load of the gear.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        follows_torque: true,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = mu |tau_rb| sgn(dq)",
            source: "P. Hamon, M. Gautier, P. Garrec, A. Janot, Dynamic identification of robot \
                 with a load-dependent joint friction model, IEEE/ASME AIM (2010).",
            signature: "odd in the speed, its size follows gravity and inertia torque",
            confusable: &["position_dependent_friction", "coulomb_friction"],
            experiment: "the same motion with a known payload",
            excitation: "a load torque that changes by a factor of three",
            origin: Origin::Arm,
            origin_reason: "the drive overcomes it in every motion under load",
            ..About::default()
        }
    }

    written_once!(advance: law);
}

fn law<S: Stepped>(
    site: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    _: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let joint = site.joint().expect("at a joint");
    columns[0] = input.dq[joint].sgn() * input.rigid_torque[joint].abs();
}
