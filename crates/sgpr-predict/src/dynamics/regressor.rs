//! The matrix that the inertial parameters multiply.

use super::body::{Body, forward_pass};
use super::scratch::{LoneNumber, OnOneSample, Scratch};
use super::workspace::Workspace;
use crate::robot::{Chain, Robot};
use crate::simd::Real;
use crate::spatial::{PARAMETERS_PER_LINK, Vector3};

/// Joint-torque regressor Y(q, dq, ddq), so that tau = Y * standard_parameters (rigid body only).
///
/// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
/// - returns `[n, 10 n]`, row-major, N·m per parameter unit, columns as in the conventions
///
/// The block of joint j and link i is zero unless joint j carries link i.
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
///
/// Source: C. G. Atkeson, C. H. An, J. M. Hollerbach, Estimation of inertial parameters of
/// manipulator loads and links, IJRR 5(3) (1986), eqs. 7-13: each link's wrench is linear in its
/// ten parameters; here it is projected on the axes of the joints that carry the link, by virtual
/// work. Checked against `rnea`.
pub fn regressor<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> &'ws [f64] {
    let n = robot.dof();
    assert!(dq.len() == n && ddq.len() == n, "one velocity and one acceleration per joint");
    let mut matrix = core::mem::take(&mut ws.regressor);
    ws.run(robot, q, Regressor { dq, ddq, matrix: &mut matrix });
    ws.regressor = matrix;
    &ws.regressor
}

struct Regressor<'a> {
    dq: &'a [f64],
    ddq: &'a [f64],
    matrix: &'a mut [f64],
}

impl OnOneSample for Regressor<'_> {
    #[inline(always)]
    fn run<T: LoneNumber>(self, robot: &Robot, scratch: &mut Scratch<T>) {
        for (k, body) in scratch.bodies.iter_mut().enumerate() {
            body.dq = T::splat((), self.dq[k]);
            body.ddq = T::splat((), self.ddq[k]);
        }
        let n = robot.dof();
        let matrix = self.matrix;
        regressor_kernel(
            (),
            robot.chain(),
            &mut scratch.bodies,
            &mut scratch.axes,
            #[inline(always)]
            |joint, link, block| {
                let start = (joint * n + link) * PARAMETERS_PER_LINK;
                let target = &mut matrix[start..start + PARAMETERS_PER_LINK];
                for (entry, value) in target.iter_mut().zip(block) {
                    *entry = value.value();
                }
            },
        );
    }
}

/// Calls `emit(joint, link, block)` for every pair where the joint carries the link.
#[inline(always)]
pub fn regressor_kernel<T: Real>(
    token: T::Token,
    chain: &Chain<T::Constant>,
    bodies: &mut [Body<T>],
    axes: &mut [[Vector3<T>; 2]],
    mut emit: impl FnMut(usize, usize, [T; PARAMETERS_PER_LINK]),
) {
    let n = chain.members.len();
    forward_pass(token, chain, bodies);
    for (link, member) in chain.members.iter().enumerate() {
        let body = &bodies[link];
        let wrench = LinkWrench::of(body);
        let (before, own) = axes.split_at_mut(link * n);
        if let Some(parent) = member.parent {
            // The axes seen by the parent link, carried over to this link's origin and frame.
            for &carrier in chain.path(parent) {
                let [turning, sliding] = before[parent * n + carrier];
                let sliding = turning.cross_add(body.position, sliding);
                let axis =
                    [body.rotation.transpose_mul(turning), body.rotation.transpose_mul(sliding)];
                own[carrier] = axis;
                emit(carrier, link, wrench.project(axis));
            }
        }
        let axis = Vector3::splat(token, member.axis);
        let zero = Vector3::zero(token);
        if member.is_rotation {
            own[link] = [axis, zero];
            emit(link, link, wrench.project_turning(T::zero(token), axis));
        } else {
            own[link] = [zero, axis];
            emit(link, link, wrench.project([zero, axis]));
        }
    }
}

/// Force B h + m a and moment h x a + I dw + w x I w of a link as linear maps of its parameters.
struct LinkWrench<T> {
    a: Vector3<T>,
    w: Vector3<T>,
    dw: Vector3<T>,
    /// Columns of B = [dw]x + [w]x [w]x.
    b: [Vector3<T>; 3],
}

#[inline(always)]
fn minus_squares<T: Real>(u: T, v: T) -> T {
    u.neg_mul_add(u, -(v * v))
}

/// e1 d2 + e2 d1 + g1 w2 + g2 w1: what a product of inertia is multiplied by.
#[inline(always)]
fn mixed<T: Real>(e: (T, T), d: (T, T), g: (T, T), w: (T, T)) -> T {
    e.0.mul_add(d.1, e.1.mul_add(d.0, g.0.mul_add(w.1, g.1 * w.0)))
}

impl<T: Real> LinkWrench<T> {
    #[inline(always)]
    fn of(body: &Body<T>) -> Self {
        let (w, dw) = (body.w, body.dw);
        let (xy, xz, yz) = (w.x * w.y, w.x * w.z, w.y * w.z);
        Self {
            a: body.a,
            w,
            dw,
            b: [
                Vector3::new(minus_squares(w.y, w.z), xy + dw.z, xz - dw.y),
                Vector3::new(xy - dw.z, minus_squares(w.x, w.z), yz + dw.x),
                Vector3::new(xz + dw.y, yz - dw.x, minus_squares(w.x, w.y)),
            ],
        }
    }

    /// Derivative of `turning · moment + sliding · force` by the ten parameters.
    #[inline(always)]
    fn project(&self, [turning, sliding]: [Vector3<T>; 2]) -> [T; PARAMETERS_PER_LINK] {
        let mut block = self.project_turning(sliding.dot(self.a), turning);
        for (entry, column) in block[1..4].iter_mut().zip(self.b) {
            *entry = *entry + sliding.dot(column);
        }
        block
    }

    /// Derivative of `turning · moment`, with `mass` in the place of the mass, which makes no
    /// moment.
    #[inline(always)]
    fn project_turning(&self, mass: T, turning: Vector3<T>) -> [T; PARAMETERS_PER_LINK] {
        let (e, w, dw) = (turning, self.w, self.dw);
        let first = self.a.cross(e);
        // e · (w x I w) = (e x w) · I w
        let g = e.cross(w);
        [
            mass,
            first.x,
            first.y,
            first.z,
            e.x.mul_add(dw.x, g.x * w.x),
            mixed((e.x, e.y), (dw.x, dw.y), (g.x, g.y), (w.x, w.y)),
            e.y.mul_add(dw.y, g.y * w.y),
            mixed((e.x, e.z), (dw.x, dw.z), (g.x, g.z), (w.x, w.z)),
            mixed((e.y, e.z), (dw.y, dw.z), (g.y, g.z), (w.y, w.z)),
            e.z.mul_add(dw.z, g.z * w.z),
        ]
    }
}
