//! Inverse dynamics by the recursive Newton-Euler algorithm.

use super::body::{Body, along_axis, forward_pass};
use super::scratch::{LoneNumber, OnOneSample, Scratch};
use super::workspace::Workspace;
use crate::robot::{Chain, Robot};
use crate::simd::Real;

/// Inverse dynamics tau = M(q) ddq + C(q, dq) dq + g(q), rigid body only.
///
/// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
/// - returns `[n]`, N·m (N)
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
///
/// # Examples
/// ```
/// use sgpr_predict::{dynamics::{Workspace, rnea}, robot::two_link};
/// let robot = two_link();
/// let mut ws = Workspace::new(&robot);
/// // Stretched out level: 1 kg at 0.5 m and 1 kg at 1.5 m.
/// let tau = rnea(&robot, &mut ws, &[0.0; 2], &[0.0; 2], &[0.0; 2]);
/// assert!((tau[0] - 9.81 * 2.0).abs() < 1e-12 && (tau[1] - 9.81 * 0.5).abs() < 1e-12);
/// ```
///
/// Source: J. Y. S. Luh, M. W. Walker, R. P. C. Paul, On-line computational scheme for mechanical
/// manipulators, J. Dyn. Sys. Meas. Control 102 (1980); on joint axes in link frames.
pub fn rnea<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> &'ws [f64] {
    let n = robot.dof();
    assert!(dq.len() == n && ddq.len() == n, "one velocity and one acceleration per joint");
    inverse_dynamics(robot, ws, q, Some(dq), Some(ddq))
}

/// Bias forces C(q, dq) dq + g(q): the torque of a motion without acceleration.
///
/// - `q`, `dq`: `[n]`, rad, rad/s (m for prismatic joints)
/// - returns `[n]`, N·m (N)
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
pub fn bias_forces<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
) -> &'ws [f64] {
    assert_eq!(dq.len(), robot.dof(), "one velocity per joint");
    inverse_dynamics(robot, ws, q, Some(dq), None)
}

/// Gravity torque g(q): what holds the arm still.
///
/// - `q`: `[n]`, rad (m for prismatic joints)
/// - returns `[n]`, N·m (N)
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
pub fn gravity_torque<'ws>(robot: &Robot, ws: &'ws mut Workspace, q: &[f64]) -> &'ws [f64] {
    inverse_dynamics(robot, ws, q, None, None)
}

fn inverse_dynamics<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: Option<&[f64]>,
    ddq: Option<&[f64]>,
) -> &'ws [f64] {
    let mut tau = core::mem::take(&mut ws.tau);
    ws.run(robot, q, NewtonEuler { dq, ddq, tau: &mut tau });
    ws.tau = tau;
    &ws.tau
}

struct NewtonEuler<'a> {
    dq: Option<&'a [f64]>,
    ddq: Option<&'a [f64]>,
    tau: &'a mut [f64],
}

impl OnOneSample for NewtonEuler<'_> {
    #[inline(always)]
    fn run<T: LoneNumber>(self, robot: &Robot, scratch: &mut Scratch<T>) {
        for (k, body) in scratch.bodies.iter_mut().enumerate() {
            body.dq = T::splat((), self.dq.map_or(0.0, |dq| dq[k]));
            body.ddq = T::splat((), self.ddq.map_or(0.0, |ddq| ddq[k]));
        }
        rnea_kernel((), robot.chain(), &mut scratch.bodies);
        for (tau, body) in self.tau.iter_mut().zip(&scratch.bodies) {
            *tau = body.tau.value();
        }
    }
}

/// Joint torques from joint motions, both in `bodies`.
#[inline(always)]
pub(crate) fn rnea_kernel<T: Real>(
    token: T::Token,
    chain: &Chain<T::Constant>,
    bodies: &mut [Body<T>],
) {
    forward_pass(token, chain, bodies);
    for (body, member) in bodies.iter_mut().zip(&chain.members) {
        (body.force, body.moment) = body.inertial_wrench(token, member);
    }
    for (index, member) in chain.members.iter().enumerate().rev() {
        let (before, rest) = bodies.split_at_mut(index);
        let body = &mut rest[0];
        body.tau = along_axis(token, member, body.force, body.moment);
        if let Some(parent) = member.parent {
            let parent = &mut before[parent];
            let force = body.rotation * body.force;
            parent.force = parent.force + force;
            let moment = body.rotation.mul_add(body.moment, parent.moment);
            parent.moment = body.position.cross_add(force, moment);
        }
    }
}
