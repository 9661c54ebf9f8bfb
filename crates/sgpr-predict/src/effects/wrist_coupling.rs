use alloc::vec::Vec;

use super::{
    About, Effect, EffectParameter, Entry, Origin, SampleInput, Site, StepState, Stepped, facts,
    written_once,
};

/// One motor of the wrist drives two joints, so that the torque of a joint depends on the motion of
/// its neighbour: tau_j = Ia ddq_o + Fv dq_o + Fc sgn(dq_o) + Fs sgn(dq_j + dq_o).
///
/// Source: M. Gautier, Dynamic identification of robots with power model, IEEE ICRA (1997), coupled
/// wrist of the Stäubli RX-90; W. Khalil, E. Dombre, Modeling, Identification and Control of Robots
/// (2002), section 9.
#[derive(Clone, Copy, Debug)]
pub(super) struct WristCoupling;

const PARAMETERS: [EffectParameter; 4] = [
    EffectParameter::signed("Iac", "kg·m²", "kg"),
    EffectParameter::signed("Fvc", "N·m·s/rad", "N·s/m"),
    EffectParameter::signed("Fcc", "N·m", "N"),
    EffectParameter::signed("Fsc", "N·m", "N"),
];

impl Effect for WristCoupling {
    facts! {
        name: "wrist_coupling",
        summary: "A wrist joint that feels inertia and friction of its neighbour's motor.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau_j = Ia ddq_o + Fv dq_o + Fc sgn(dq_o) + Fs sgn(dq_j + dq_o)",
            source: "M. Gautier, Dynamic identification of robots with power model, IEEE ICRA \
                 (1997), coupled wrist of the Stäubli RX-90; W. Khalil, E. Dombre, Modeling, \
                 Identification and Control of Robots (2002), section 9.",
            signature: "the residual of a joint follows speed and acceleration of its neighbour",
            confusable: &["rotor_inertia", "friction_dead_band"],
            experiment: "move one wrist joint at a time",
            excitation: "both wrist joints move, not in step",
            origin: Origin::Arm,
            origin_reason: "the joint is coupled with its neighbour in every motion",
            ..About::default()
        }
    }

    /// Neighbours among the last three joints of an arm that has a wrist.
    fn sites(&self, robot: &crate::robot::Robot) -> Vec<Site> {
        let n = robot.dof();
        if n < 5 {
            return vec![];
        }
        (n - 3..n - 1)
            .flat_map(|joint| [Site::Pair(joint, joint + 1), Site::Pair(joint + 1, joint)])
            .collect()
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
    let Site::Pair(joint, other) = site else { unreachable!("at a pair of joints") };
    columns[0] = input.ddq[other];
    columns[1] = input.dq[other];
    columns[2] = input.dq[other].sgn();
    columns[3] = (input.dq[joint] + input.dq[other]).sgn();
}
