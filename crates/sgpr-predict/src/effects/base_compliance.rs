use alloc::vec::Vec;

use super::{
    About, Context, Effect, EffectParameter, Entry, Origin, Reach, SampleInput, Site, StepState,
    Stepped, facts, written_once,
};
use crate::dynamics::{Workspace, forward_kinematics, gravity_torque};
use crate::spatial::Vector3;

/// A mount that gives way: the base leans by c times the static moment on it, about x and y, and
/// gravity leans with it.
///
/// Source: common for mobile bases; A. De Luca, W. Book, Robots with flexible elements, Springer
/// Handbook of Robotics (2008).
#[derive(Clone, Copy, Debug)]
pub(super) struct BaseCompliance;

const PARAMETERS: [EffectParameter; 2] = [
    EffectParameter::signed("cx", "rad/(N·m)", "rad/(N·m)"),
    EffectParameter::signed("cy", "rad/(N·m)", "rad/(N·m)"),
];

impl Effect for BaseCompliance {
    facts! {
        name: "base_compliance",
        summary: "The base leans under the arm's weight.",
        parameters: &PARAMETERS,
        entry: Entry::Trajectory,
        reach: Reach::All,
    }

    fn about(&self) -> About<'_> {
        About {
            formula: "tau = d tau / d lean · (cx Mx, cy My), M the static moment on the base",
            source: "common for mobile bases; A. De Luca, W. Book, Robots with flexible elements, \
                 Springer Handbook of Robotics (2008).",
            signature: "like a tilt that follows the reach of the arm",
            confusable: &["base_tilt"],
            experiment: "the same poses fast and slow",
            excitation: "poses that reach out in different directions",
            origin: Origin::Arm,
            origin_reason: "the base leans under every pose",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    fn trajectory_columns(&self, _: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let (n, g) = (context.dof(), context.robot.gravity());
        let mut ws = Workspace::new(context.robot);
        // Gravity torque is linear in gravity: a lean about x by a small angle adds -x × g.
        let lean = |axis: Vector3<f64>| context.robot.clone().with_gravity(-(axis.cross(g)));
        let leaning = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0)].map(lean);
        for k in 0..context.len() {
            let q = context.state(k).q;
            let poses = forward_kinematics(context.robot, &mut ws, q);
            let mut moment = Vector3::ZERO;
            for (pose, link) in poses.iter().zip(context.robot.links()) {
                let first = pose.rotation * link.first_moment + pose.translation * link.mass;
                moment = moment + first.cross(g);
            }
            for ((out, robot), moment) in out.iter_mut().zip(&leaning).zip([moment.x, moment.y]) {
                let torque = gravity_torque(robot, &mut ws, q);
                out[k * n..(k + 1) * n]
                    .iter_mut()
                    .zip(torque)
                    .for_each(|(out, torque)| *out = moment * torque);
            }
        }
    }

    written_once!(advance: law);
}

/// The gravity torque is linear in gravity: that of a lean is the moment of the links' weights in
/// the gravity that the lean adds, about each joint's axis.
fn law<S: Stepped>(
    _: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let (robot, n, g) = (input.robot, input.robot.dof(), input.robot.gravity());
    let poses = S::forward_kinematics(robot, state.workspace, input.q);
    let splat = |v: Vector3<f64>| Vector3::constant(v);
    let first = |link: usize| {
        let (pose, link) = (&poses[link], &robot.links()[link]);
        pose.rotation * splat(link.first_moment) + pose.translation * S::constant(link.mass)
    };
    let moment =
        (0..n).fold(Vector3::zero(()), |moment, link| moment + first(link).cross(splat(g)));
    let axes = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0)];
    for (column, (axis, moment)) in
        columns.chunks_exact_mut(n).zip(axes.into_iter().zip([moment.x, moment.y]))
    {
        let lean = splat(-(axis.cross(g)));
        column.fill(S::zero(()));
        for link in 0..n {
            let (first, mass) = (first(link), S::constant(robot.links()[link].mass));
            for &carrier in robot.path(link) {
                let (joint, pose) = (&robot.joints()[carrier], &poses[carrier]);
                let axis = pose.rotation * splat(joint.axis);
                let weight = if joint.kind.is_rotation() {
                    axis.dot((first - pose.translation * mass).cross(lean))
                } else {
                    mass * axis.dot(lean)
                };
                column[carrier] -= moment * weight;
            }
        }
    }
}
