use super::{About, Context, Effect, EffectParameter, Entry, Site, sgn};

/// Friction of a gear that grows with the torque it carries: tau = mu |tau_load| sgn(dq), tau_load the torque of the
/// rigid body.
///
/// Source: P. Hamon, M. Gautier, P. Garrec, A. Janot, Dynamic identification of robot with a load-dependent joint
/// friction model, IEEE/ASME AIM (2010).
#[derive(Clone, Copy, Debug)]
pub(super) struct LoadDependentFriction;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::positive("mu", "1", "1")];

impl Effect for LoadDependentFriction {
    fn name(&self) -> &str {
        "load_dependent_friction"
    }

    fn summary(&self) -> &str {
        "Friction that grows with the load of the gear."
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = mu |tau_rb| sgn(dq)",
            source: "P. Hamon, M. Gautier, P. Garrec, A. Janot, Dynamic identification of robot with a load-dependent joint friction model, IEEE/ASME AIM (2010).",
            signature: "odd in the speed, its size follows gravity and inertia torque",
            confusable: &["position_dependent_friction", "coulomb_friction"],
            experiment: "the same motion with a known payload",
            excitation: "a load torque that changes by a factor of three",
            ..About::default()
        }
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn follows_torque(&self) -> bool {
        true
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        let load = context.of_joint(context.rigid_torque, joint);
        for ((out, dq), load) in out[0].iter_mut().zip(context.of_joint(context.dq, joint)).zip(load) {
            *out = sgn(dq) * load.abs();
        }
    }
}
