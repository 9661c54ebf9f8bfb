//! Where the links and frames are, and how they move with the joints.

use super::workspace::Workspace;
use crate::robot::{Frame, Joint, Robot};
use crate::spatial::{Matrix3, Pose, Vector3};

/// Forward kinematics: pose of every link frame in the base frame.
///
/// - `q`: `[n]`, rad (m for prismatic joints)
/// - returns `[n]`
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
pub fn forward_kinematics<'ws>(robot: &Robot, ws: &'ws mut Workspace, q: &[f64]) -> &'ws [Pose] {
    assert_eq!(q.len(), robot.dof(), "one position per joint");
    for (index, joint) in robot.joints().iter().enumerate() {
        let parent = joint.parent.map_or(Pose::IDENTITY, |parent| ws.poses[parent]);
        ws.poses[index] = parent * joint.placement * motion(joint, q[index]);
    }
    &ws.poses
}

/// Pose of `frame` in the base frame.
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
pub fn frame_pose(robot: &Robot, ws: &mut Workspace, q: &[f64], frame: &Frame) -> Pose {
    let poses = forward_kinematics(robot, ws, q);
    frame.joint.map_or(Pose::IDENTITY, |joint| poses[joint]) * frame.pose
}

/// Jacobian of `frame`: velocity of its origin (rows 0-2) and its angular velocity (rows 3-5), in
/// base axes, per joint velocity. A force F and moment N on the arm at the frame need the joint
/// torque -Jᵀ (F, N).
///
/// - `q`: `[n]`, rad (m for prismatic joints)
/// - returns `[6, n]`, row-major
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
pub fn jacobian<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    frame: &Frame,
) -> &'ws [f64] {
    let n = robot.dof();
    let point = frame_pose(robot, ws, q, frame).translation;
    ws.jacobian.fill(0.0);
    for &index in frame.joint.map_or(&[][..], |joint| robot.path(joint)) {
        let joint = &robot.joints()[index];
        let pose = ws.poses[index];
        let axis = pose.rotation * joint.axis;
        let (linear, angular) = if joint.kind.is_rotation() {
            (axis.cross(point - pose.translation), axis)
        } else {
            (axis, Vector3::ZERO)
        };
        let column = linear.to_array().into_iter().chain(angular.to_array());
        for (row, value) in column.enumerate() {
            ws.jacobian[row * n + index] = value;
        }
    }
    &ws.jacobian
}

/// The joint's own motion.
fn motion(joint: &Joint, q: f64) -> Pose {
    if joint.kind.is_rotation() {
        Pose::from_rotation(Matrix3::rotation(joint.axis, q))
    } else {
        Pose::from_translation(joint.axis * q)
    }
}
