//! Mechanical energy of the rigid body.

use super::kinematics::forward_kinematics;
use super::mass_matrix::mass_matrix;
use super::workspace::Workspace;
use crate::robot::Robot;

/// Kinetic energy dqᵀ M(q) dq / 2, J.
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
pub fn kinetic_energy(robot: &Robot, ws: &mut Workspace, q: &[f64], dq: &[f64]) -> f64 {
    let n = robot.dof();
    assert_eq!(dq.len(), n, "one velocity per joint");
    let matrix = mass_matrix(robot, ws, q);
    let rows = matrix.chunks_exact(n).zip(dq);
    0.5 * rows.map(|(row, v)| v * row.iter().zip(dq).map(|(m, v)| m * v).sum::<f64>()).sum::<f64>()
}

/// Potential energy -sum m g · c of the moving links, J; zero at the base origin.
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
pub fn potential_energy(robot: &Robot, ws: &mut Workspace, q: &[f64]) -> f64 {
    let gravity = robot.gravity();
    let poses = forward_kinematics(robot, ws, q);
    let moment = |(pose, link): (&crate::spatial::Pose, &crate::spatial::LinkInertia)| {
        gravity.dot(pose.rotation * link.first_moment + pose.translation * link.mass)
    };
    -poses.iter().zip(robot.links()).map(moment).sum::<f64>()
}
