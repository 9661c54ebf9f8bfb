//! State of one link in the recursions, and the outward recursion that they share.
#![allow(missing_docs, reason = "shared with the rooms that run the recursion, and hidden")]

use crate::robot::{Chain, Member};
use crate::simd::Real;
use crate::spatial::{Matrix3, Vector3};

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
    /// Angular velocity and acceleration; acceleration of the origin, gravity included as an upward
    /// acceleration.
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
        let matrix = Matrix3::zero(token);
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
    pub(crate) fn place(&mut self, token: T::Token, member: &Member<T::Constant>) {
        let translation = Vector3::splat(token, member.translation);
        if member.about_z {
            // constant = [0 0 z], sine = [y -x 0], cosine = [x y 0]: most joints, and half of the
            // arithmetic. One by one: a closure given to `map` would be compiled without the
            // instruction set, and pass registers by memory.
            let [x, y, _] = member.cosine.columns;
            let [x, y] = [Vector3::splat(token, x), Vector3::splat(token, y)];
            let z = Vector3::splat(token, member.constant.columns[2]);
            self.rotation = Matrix3::from_columns(
                x.scale_add(self.cos, y * self.sin),
                y.scale_add(self.cos, x * -self.sin),
                z,
            );
            self.position = translation;
        } else if member.is_rotation {
            let constant = Matrix3::splat(token, &member.constant);
            let sine = Matrix3::splat(token, &member.sine);
            let cosine = Matrix3::splat(token, &member.cosine);
            self.rotation = cosine.scale_add(self.cos, sine.scale_add(self.sin, constant));
            self.position = translation;
        } else {
            self.rotation = Matrix3::splat(token, &member.constant);
            self.position = Vector3::splat(token, member.slide).scale_add(self.q, translation);
        }
    }

    /// Pose and motion from the joint and the parent's motion (Luh, Walker, Paul (1980), outward
    /// iteration).
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        token: T::Token,
        member: &Member<T::Constant>,
        parent: Option<&Self>,
        minus_g: Vector3<T>,
    ) {
        self.place(token, member);
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
        let axis = Vector3::splat(token, member.axis);
        let speed = axis * self.dq;
        if member.is_rotation {
            self.w = w + speed;
            self.dw = w.cross_add(speed, axis.scale_add(self.ddq, dw));
            self.a = a;
        } else {
            self.w = w;
            self.dw = dw;
            self.a = (w + w).cross_add(speed, axis.scale_add(self.ddq, a));
        }
    }

    /// Force and moment about the origin that move the link as the body moves.
    #[inline(always)]
    pub(crate) fn inertial_wrench(
        &self,
        token: T::Token,
        member: &Member<T::Constant>,
    ) -> (Vector3<T>, Vector3<T>) {
        let link = &member.link;
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
    member: &Member<T::Constant>,
    force: Vector3<T>,
    moment: Vector3<T>,
) -> T {
    if member.about_z {
        return moment.z;
    }
    let axis = Vector3::splat(token, member.axis);
    axis.dot(if member.is_rotation { moment } else { force })
}

/// Outward iteration over all links.
#[inline(always)]
pub(crate) fn forward_pass<T: Real>(
    token: T::Token,
    chain: &Chain<T::Constant>,
    bodies: &mut [Body<T>],
) {
    let minus_g = Vector3::splat(token, chain.minus_g);
    for (index, member) in chain.members.iter().enumerate() {
        let (before, rest) = bodies.split_at_mut(index);
        let parent = member.parent.map(|parent| &before[parent]);
        rest[0].advance(token, member, parent, minus_g);
    }
}
