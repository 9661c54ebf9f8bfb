use alloc::vec::Vec;

use super::body::Body;
use crate::robot::Robot;
#[cfg(feature = "simd")]
use crate::simd::Fused;
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, Vector3};

/// Scratch of the recursions for numbers of type `T`.
#[derive(Debug)]
pub(crate) struct Scratch<T: Real> {
    pub bodies: Vec<Body<T>>,
    /// `[i * n + j]`: axis of joint j as angular and linear motion of link i's origin, in link i's
    /// frame.
    pub axes: Vec<[Vector3<T>; 2]>,
    /// Inertia of everything that a joint carries.
    pub composite: Vec<LinkInertia<T>>,
    pub articulated: Vec<Articulated<T>>,
}

impl<T: Real> Scratch<T> {
    pub fn new(token: T::Token, dof: usize) -> Self {
        let zero = Vector3::zero(token);
        let massless =
            LinkInertia { mass: T::zero(token), first_moment: zero, inertia: Matrix3::zero(token) };
        Self {
            bodies: vec![Body::zero(token); dof],
            axes: vec![[zero, zero]; dof * dof],
            composite: vec![massless; dof],
            articulated: vec![Articulated::zero(token); dof],
        }
    }
}

/// A number that stands for itself.
pub(super) trait LoneNumber: Real<Token = (), Constant = f64> {
    fn value(self) -> f64;
}

impl LoneNumber for f64 {
    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
}

#[cfg(feature = "simd")]
impl LoneNumber for Fused {
    #[inline(always)]
    fn value(self) -> f64 {
        self.0
    }
}

/// A recursion over one sample; `run` is compiled once for every instruction set.
pub(super) trait OnOneSample {
    fn run<T: LoneNumber>(self, robot: &Robot, scratch: &mut Scratch<T>);
}

/// Inertia of a link with everything behind it hanging on free joints: force = A a + B dw +
/// `force`, moment = Bᵀ a + D dw + `moment`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Articulated<T> {
    pub a: Matrix3<T>,
    pub b: Matrix3<T>,
    pub d: Matrix3<T>,
    pub force: Vector3<T>,
    pub moment: Vector3<T>,
    /// What a unit acceleration of the joint needs: force, moment, and its share along the axis
    /// (inverted).
    pub unit_force: Vector3<T>,
    pub unit_moment: Vector3<T>,
    pub inverse: T,
    /// Torque left for accelerating the joint.
    pub torque: T,
}

impl<T: Real> Articulated<T> {
    pub fn zero(token: T::Token) -> Self {
        let vector = Vector3::zero(token);
        let matrix = Matrix3::zero(token);
        Self {
            a: matrix,
            b: matrix,
            d: matrix,
            force: vector,
            moment: vector,
            unit_force: vector,
            unit_moment: vector,
            inverse: T::zero(token),
            torque: T::zero(token),
        }
    }
}
