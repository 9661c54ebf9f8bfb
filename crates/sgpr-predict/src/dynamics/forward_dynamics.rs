//! Forward dynamics by the articulated-body algorithm.

use super::body::Body;
use super::scratch::{Articulated, LoneNumber, OnOneSample, Scratch};
use super::workspace::Workspace;
use crate::robot::{Member, Robot};
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, Vector3};

/// Forward dynamics: the acceleration that `tau` makes, ddq = M(q)^-1 (tau - C(q, dq) dq - g(q)).
///
/// - `q`, `dq`, `tau`: `[n]`, rad, rad/s, N·m (m, m/s, N for prismatic joints)
/// - returns `[n]`, rad/s² (m/s²); not finite where a joint moves no inertia
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
///
/// Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), table 7.1; written with
/// accelerations of link origins instead of spatial ones.
pub fn forward_dynamics<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
    tau: &[f64],
) -> &'ws [f64] {
    accelerate(robot, ws, q, dq, tau, None)
}

/// [`forward_dynamics`] of an arm whose motors turn with the joints: `rotor_inertia` is added to
/// the diagonal of M.
///
/// - `rotor_inertia`: `[n]`, kg·m² at the joint (kg for prismatic joints)
///
/// # Panics
/// If a slice is not of length `robot.dof()`.
pub fn forward_dynamics_with_rotors<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
    tau: &[f64],
    rotor_inertia: &[f64],
) -> &'ws [f64] {
    assert_eq!(rotor_inertia.len(), robot.dof(), "one rotor inertia per joint");
    accelerate(robot, ws, q, dq, tau, Some(rotor_inertia))
}

fn accelerate<'ws>(
    robot: &Robot,
    ws: &'ws mut Workspace,
    q: &[f64],
    dq: &[f64],
    tau: &[f64],
    rotor_inertia: Option<&[f64]>,
) -> &'ws [f64] {
    let n = robot.dof();
    assert!(dq.len() == n && tau.len() == n, "one velocity and one torque per joint");
    let mut ddq = core::mem::take(&mut ws.ddq);
    ws.run(robot, q, ArticulatedBody { dq, tau, rotor_inertia, ddq: &mut ddq });
    ws.ddq = ddq;
    &ws.ddq
}

impl<T: Real<Constant = f64>> Articulated<T> {
    /// A single body in its present motion, joint acceleration aside.
    #[inline(always)]
    fn rigid(token: T::Token, link: &LinkInertia, w: Vector3<T>) -> Self {
        let h = Vector3::splat(token, link.first_moment);
        let inertia = Matrix3::splat(token, &link.inertia);
        let mut body = Self::zero(token);
        body.a = Matrix3::splat(token, &Matrix3::diagonal(link.mass, link.mass, link.mass));
        // B = -[h]x
        body.b = Matrix3::splat(token, &Matrix3::skew(-link.first_moment));
        body.d = inertia;
        body.force = w.cross(w.cross(h));
        body.moment = w.cross(inertia * w);
        body
    }
}

struct ArticulatedBody<'a> {
    dq: &'a [f64],
    tau: &'a [f64],
    rotor_inertia: Option<&'a [f64]>,
    ddq: &'a mut [f64],
}

impl OnOneSample for ArticulatedBody<'_> {
    #[inline(always)]
    fn run<T: LoneNumber>(self, robot: &Robot, scratch: &mut Scratch<T>) {
        let Scratch { bodies, articulated, .. } = scratch;
        for (k, body) in bodies.iter_mut().enumerate() {
            body.dq = T::splat((), self.dq[k]);
            body.ddq = T::zero(());
        }
        // Without gravity and joint accelerations the outward pass leaves, per joint, what the
        // parent's velocity adds.
        let members = &robot.chain().members;
        forward_velocity(members, bodies);
        for ((own, body), member) in articulated.iter_mut().zip(bodies.iter()).zip(members) {
            *own = Articulated::rigid((), &member.link, body.w);
        }
        for (index, member) in members.iter().enumerate().rev() {
            let axis = Vector3::splat((), member.axis);
            let (before, rest) = articulated.split_at_mut(index);
            let own = &mut rest[0];
            let (along, load);
            if member.is_rotation {
                own.unit_force = own.b * axis;
                own.unit_moment = own.d * axis;
                along = axis.dot(own.unit_moment);
                load = axis.dot(own.moment);
            } else {
                own.unit_force = own.a * axis;
                own.unit_moment = own.b.transpose_mul(axis);
                along = axis.dot(own.unit_force);
                load = axis.dot(own.force);
            }
            let rotor = T::splat((), self.rotor_inertia.map_or(0.0, |rotor| rotor[index]));
            own.inverse = (along + rotor).recip();
            own.torque = T::splat((), self.tau[index]) - load;
            if let Some(parent) = member.parent {
                let body = &bodies[index];
                before[parent].add_behind_joint(own, body);
            }
        }
        let minus_g = Vector3::splat((), robot.chain().minus_g);
        for (index, member) in members.iter().enumerate() {
            let (before, rest) = bodies.split_at_mut(index);
            let body = &mut rest[0];
            // `a` and `dw` hold the velocity terms; the accelerations are added to them.
            let (a, dw) = match member.parent {
                None => (body.rotation.transpose_mul(minus_g), Vector3::zero(())),
                Some(parent) => {
                    let parent = &before[parent];
                    let a = parent.dw.cross_add(body.position, parent.a);
                    (body.rotation.transpose_mul(a), body.rotation.transpose_mul(parent.dw))
                }
            };
            let own = &articulated[index];
            body.a = body.a + a;
            body.dw = body.dw + dw;
            let needed = own.unit_force.dot(body.a) + own.unit_moment.dot(body.dw);
            let ddq = (own.torque - needed) * own.inverse;
            let axis = Vector3::splat((), member.axis);
            if member.is_rotation {
                body.dw = axis.scale_add(ddq, body.dw);
            } else {
                body.a = axis.scale_add(ddq, body.a);
            }
            self.ddq[index] = ddq.value();
        }
    }
}

/// Poses, angular velocities, and in `a`, `dw` the acceleration that each link would have if its
/// parent had none.
#[inline(always)]
fn forward_velocity<T: LoneNumber>(members: &[Member], bodies: &mut [Body<T>]) {
    for (index, member) in members.iter().enumerate() {
        let (before, rest) = bodies.split_at_mut(index);
        let body = &mut rest[0];
        body.place((), member);
        let axis = Vector3::splat((), member.axis);
        let speed = axis * body.dq;
        let (w, a) = match member.parent {
            None => (Vector3::zero(()), Vector3::zero(())),
            Some(parent) => {
                let w = before[parent].w;
                let centripetal = w.cross(w.cross(body.position));
                (body.rotation.transpose_mul(w), body.rotation.transpose_mul(centripetal))
            }
        };
        if member.is_rotation {
            body.w = w + speed;
            body.dw = w.cross(speed);
            body.a = a;
        } else {
            body.w = w;
            body.dw = Vector3::zero(());
            body.a = (w + w).cross_add(speed, a);
        }
    }
}

impl<T: Real> Articulated<T> {
    /// Adds the inertia of a child as felt through its joint.
    #[inline(always)]
    fn add_behind_joint(&mut self, child: &Self, body: &Body<T>) {
        let (uf, um) = (child.unit_force, child.unit_moment);
        let (sf, sm) = (uf * child.inverse, um * child.inverse);
        // I - U Uᵀ / d: the joint yields along its axis.
        let a = child.a.minus_outer(sf, uf);
        let b = child.b.minus_outer(sf, um);
        let d = child.d.minus_outer(sm, um);
        // Velocity terms and the torque that is left.
        let (ca, cw) = (body.a, body.dw);
        let force = a * ca + b.mul_add(cw, sf.scale_add(child.torque, child.force));
        let moment = b.transpose_mul(ca) + d.mul_add(cw, sm.scale_add(child.torque, child.moment));

        let r = body.rotation;
        let p = body.position;
        let a = r * (a * r.transposed());
        let b = r * (b * r.transposed());
        let d = r * (d * r.transposed());
        // B' = B - A [p]x; D' = D - Bᵀ [p]x + [p]x B'
        let moved_b = minus_times_skew(b, &a, p);
        let moved_d = minus_times_skew(d, &b.transposed(), p);
        let [x, y, z] = moved_d.columns;
        let [bx, by, bz] = moved_b.columns;
        let moved_d =
            Matrix3::from_columns(p.cross_add(bx, x), p.cross_add(by, y), p.cross_add(bz, z));
        self.a = self.a + a;
        self.b = self.b + moved_b;
        self.d = self.d + moved_d;
        let force = r * force;
        self.force = self.force + force;
        self.moment = self.moment + p.cross_add(force, r * moment);
    }
}

/// `c - m [p]x`
#[inline(always)]
fn minus_times_skew<T: Real>(c: Matrix3<T>, m: &Matrix3<T>, p: Vector3<T>) -> Matrix3<T> {
    let ([mx, my, mz], [cx, cy, cz]) = (m.columns, c.columns);
    Matrix3::from_columns(
        my.scale_add(-p.z, mz.scale_add(p.y, cx)),
        mx.scale_add(p.z, mz.scale_add(-p.x, cy)),
        mx.scale_add(-p.y, my.scale_add(p.x, cz)),
    )
}
