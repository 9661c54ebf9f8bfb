//! State of one link in the recursions, and the outward recursion that they share.
#![allow(missing_docs, reason = "shared with the rooms that run the recursion, and hidden")]

use crate::robot::{Joint, Robot, Turn};
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, Vector3};

/// Everything the recursions keep of a link; vectors in the link's own frame.
#[derive(Clone, Copy, Debug)]
pub struct Body<T> {
    /// Joint position, its sine and cosine, velocity and acceleration.
    pub q: T,
    pub sin: T,
    pub cos: T,
    pub dq: T,
    pub ddq: T,
    /// Pose in the parent link's frame.
    pub rotation: Matrix3<T>,
    pub position: Vector3<T>,
    /// Angular velocity and acceleration; acceleration of the origin, gravity included as an upward acceleration.
    pub w: Vector3<T>,
    pub dw: Vector3<T>,
    pub a: Vector3<T>,
    /// Force and moment about the origin that the joint transmits.
    pub force: Vector3<T>,
    pub moment: Vector3<T>,
    /// Joint torque.
    pub tau: T,
}

impl<T: Real> Body<T> {
    pub fn zero(token: T::Token) -> Self {
        let scalar = T::zero(token);
        let vector = Vector3::zero(token);
        let matrix = Matrix3::splat(token, &Matrix3::ZERO);
        Self {
            q: scalar,
            sin: scalar,
            cos: scalar,
            dq: scalar,
            ddq: scalar,
            rotation: matrix,
            position: vector,
            w: vector,
            dw: vector,
            a: vector,
            force: vector,
            moment: vector,
            tau: scalar,
        }
    }

    /// Pose from the joint position.
    #[inline(always)]
    pub fn place(&mut self, token: T::Token, joint: &Joint, turn: &Turn) {
        let translation = Vector3::splat(token, joint.placement.translation);
        if turn.about_z {
            // constant = [0 0 z], sine = [y -x 0], cosine = [x y 0]: most joints, and half of the arithmetic.
            let [x, y, _] = turn.cosine.columns.map(
                #[inline(always)]
                |column| Vector3::splat(token, column),
            );
            let z = Vector3::splat(token, turn.constant.columns[2]);
            self.rotation =
                Matrix3::from_columns(x.scale_add(self.cos, y * self.sin), y.scale_add(self.cos, x * -self.sin), z);
            self.position = translation;
        } else if joint.kind.is_rotation() {
            let constant = Matrix3::splat(token, &turn.constant);
            let sine = Matrix3::splat(token, &turn.sine);
            let cosine = Matrix3::splat(token, &turn.cosine);
            self.rotation = cosine.scale_add(self.cos, sine.scale_add(self.sin, constant));
            self.position = translation;
        } else {
            self.rotation = Matrix3::splat(token, &turn.constant);
            self.position = Vector3::splat(token, turn.slide).scale_add(self.q, translation);
        }
    }

    /// Pose and motion from the joint and the parent's motion (Luh, Walker, Paul (1980), outward iteration).
    #[inline(always)]
    pub fn advance(&mut self, token: T::Token, joint: &Joint, turn: &Turn, parent: Option<&Self>, minus_g: Vector3<T>) {
        self.place(token, joint, turn);
        let (w, dw, a) = match parent {
            None => {
                let zero = Vector3::zero(token);
                (zero, zero, self.rotation.transpose_mul(minus_g))
            }
            Some(parent) => {
                let p = self.position;
                let centripetal = parent.w.cross(parent.w.cross(p));
                let a = parent.dw.cross_add(p, parent.a + centripetal);
                (
                    self.rotation.transpose_mul(parent.w),
                    self.rotation.transpose_mul(parent.dw),
                    self.rotation.transpose_mul(a),
                )
            }
        };
        let axis = Vector3::splat(token, joint.axis);
        let speed = axis * self.dq;
        if joint.kind.is_rotation() {
            self.w = w + speed;
            self.dw = w.cross_add(speed, axis.scale_add(self.ddq, dw));
            self.a = a;
        } else {
            self.w = w;
            self.dw = dw;
            self.a = (w + w).cross_add(speed, axis.scale_add(self.ddq, a));
        }
    }

    /// Force and moment about the origin that move `link` as the body moves.
    #[inline(always)]
    pub fn inertial_wrench(&self, token: T::Token, link: &LinkInertia) -> (Vector3<T>, Vector3<T>) {
        let h = Vector3::splat(token, link.first_moment);
        let inertia = Matrix3::splat(token, &link.inertia);
        let force = self.w.cross_add(self.w.cross(h), self.a * T::splat(token, link.mass));
        let force = self.dw.cross_add(h, force);
        let moment = inertia.mul_add(self.dw, h.cross(self.a));
        let moment = self.w.cross_add(inertia * self.w, moment);
        (force, moment)
    }
}

/// Share of a wrench that the joint's drive has to carry: its torque, or its force if it slides.
#[inline(always)]
pub(crate) fn along_axis<T: Real>(
    token: T::Token,
    joint: &Joint,
    turn: &Turn,
    force: Vector3<T>,
    moment: Vector3<T>,
) -> T {
    if turn.about_z {
        return moment.z;
    }
    let axis = Vector3::splat(token, joint.axis);
    axis.dot(if joint.kind.is_rotation() { moment } else { force })
}

/// Outward iteration over all links.
#[inline(always)]
pub(crate) fn forward_pass<T: Real>(token: T::Token, robot: &Robot, bodies: &mut [Body<T>]) {
    let minus_g = Vector3::splat(token, -robot.gravity());
    for (index, (joint, turn)) in robot.joints().iter().zip(robot.turns()).enumerate() {
        let (before, rest) = bodies.split_at_mut(index);
        let parent = joint.parent.map(|parent| &before[parent]);
        rest[0].advance(token, joint, turn, parent, minus_g);
    }
}
