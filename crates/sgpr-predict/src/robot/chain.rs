use alloc::vec::Vec;

use super::Joint;
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, Vector3};

/// What the recursions need of a robot, in the numbers that they compute with.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct Chain<C = f64> {
    /// Joints with their links, parents before children.
    pub(crate) members: Vec<Member<C>>,
    /// Acceleration upwards that stands for gravity, m/s², base axes.
    pub(crate) minus_g: Vector3<C>,
    /// For each joint the joints between base and it, itself last.
    pub(super) paths: Vec<Vec<usize>>,
}

/// A joint and the link that it carries. A joint's rotation is R(q) = constant + sin(q) sine +
/// cos(q) cosine, with the placement multiplied in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Member<C = f64> {
    pub parent: Option<usize>,
    pub is_rotation: bool,
    /// Whether the joint turns about the z axis of its frame.
    pub about_z: bool,
    /// In the joint's frame.
    pub axis: Vector3<C>,
    /// Origin of the joint's frame in the parent's.
    pub translation: Vector3<C>,
    pub constant: Matrix3<C>,
    pub sine: Matrix3<C>,
    pub cosine: Matrix3<C>,
    /// Axis of a prismatic joint in the parent's frame; zero for a rotation.
    pub slide: Vector3<C>,
    pub link: LinkInertia<C>,
}

impl Member {
    /// Rodrigues' formula R = a aᵀ + sin(q) [a]x + cos(q) (1 - a aᵀ).
    pub(super) fn new(joint: &Joint, link: LinkInertia) -> Self {
        let placement = joint.placement.rotation;
        let is_rotation = joint.kind.is_rotation();
        let along = Matrix3::outer(joint.axis, joint.axis);
        let turning =
            |matrix: Matrix3<f64>| if is_rotation { placement * matrix } else { Matrix3::ZERO };
        Self {
            parent: joint.parent,
            is_rotation,
            about_z: is_rotation && joint.axis == Vector3::new(0.0, 0.0, 1.0),
            axis: joint.axis,
            translation: joint.placement.translation,
            constant: if is_rotation { placement * along } else { placement },
            sine: turning(Matrix3::skew(joint.axis)),
            cosine: turning(Matrix3::IDENTITY + along.scaled(-1.0)),
            slide: if is_rotation { Vector3::ZERO } else { placement * joint.axis },
            link,
        }
    }
}

impl Chain {
    /// The same for recursions over another number.
    pub(crate) fn of<T: Real>(&self) -> Chain<T::Constant> {
        let vector = |v: Vector3<f64>| v.map(T::rounded);
        let matrix = |m: &Matrix3<f64>| m.map(T::rounded);
        let member = |own: &Member| Member {
            parent: own.parent,
            is_rotation: own.is_rotation,
            about_z: own.about_z,
            axis: vector(own.axis),
            translation: vector(own.translation),
            constant: matrix(&own.constant),
            sine: matrix(&own.sine),
            cosine: matrix(&own.cosine),
            slide: vector(own.slide),
            link: LinkInertia {
                mass: T::rounded(own.link.mass),
                first_moment: vector(own.link.first_moment),
                inertia: matrix(&own.link.inertia),
            },
        };
        Chain {
            members: self.members.iter().map(member).collect(),
            minus_g: vector(self.minus_g),
            paths: self.paths.clone(),
        }
    }
}

impl<C> Chain<C> {
    /// Joints from the base to `joint`, itself last.
    pub(crate) fn path(&self, joint: usize) -> &[usize] {
        &self.paths[joint]
    }
}
