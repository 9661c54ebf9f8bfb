use super::context::dahl;
use super::{About, Class, Constant, Context, Effect, EffectParameter, Entry, Scale, Site};

/// Loop between torque and angle of a gear: the torque lost in the gear follows the direction in which the load
/// torque changes, over the scale ts, as a Dahl element driven by the load.
///
/// Source: M. Ruderman, F. Hoffmann, T. Bertram, Modeling and identification of elastic robot joints with hysteresis
/// and backlash, IEEE Trans. Industrial Electronics 56(10) (2009).
#[derive(Clone, Copy, Debug)]
pub(super) struct TransmissionHysteresis;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("Th", "N·m", "N")];

const CONSTANTS: [Constant; 1] = [Constant::new("ts", ["N·m", "N"], [0.02, 2.0], Scale::Torque, &[0.1, 0.5])];

impl Effect for TransmissionHysteresis {
    fn name(&self) -> &str {
        "transmission_hysteresis"
    }

    fn summary(&self) -> &str {
        "A loop between the torque of the gear and its twist."
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::HiddenState,
            formula: "tau = Th z, dz = (sgn(dtau_rb) - z) |dtau_rb| / ts",
            source: "M. Ruderman, F. Hoffmann, T. Bertram, Modeling and identification of elastic robot joints with hysteresis and backlash, IEEE Trans. Industrial Electronics 56(10) (2009).",
            signature: "a loop over the load torque that does not depend on speed",
            confusable: &["presliding_friction", "joint_elasticity", "rotor_inertia"],
            experiment: "output locked, slow ramps of torque",
            excitation: "a load torque that rises and falls often",
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

    fn follows_torque(&self) -> bool {
        true
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, constants: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().expect("at a joint");
        dahl(context.of_joint(context.rigid_torque, joint), constants[0], &mut out[0]);
    }
}
