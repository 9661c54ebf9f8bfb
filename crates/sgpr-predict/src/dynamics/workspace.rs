use alloc::vec::Vec;

use super::body::Body;
use super::forward_dynamics::Articulated;
use super::machine::{Machine, Positions};
use crate::robot::Robot;
#[cfg(feature = "simd")]
use crate::simd::Fused;
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, PARAMETERS_PER_LINK, Pose, Vector3};

/// Every buffer that dynamics of one sample needs; made once for a robot, reused for every call.
///
/// One workspace per thread. A function never relies on what an earlier call left behind.
#[derive(Debug)]
pub struct Workspace {
    dof: usize,
    machine: Machine,
    sin: Vec<f64>,
    cos: Vec<f64>,
    pub(super) tau: Vec<f64>,
    pub(super) ddq: Vec<f64>,
    /// Only blocks on a path from the base are ever written: the others stay zero.
    pub(super) regressor: Vec<f64>,
    pub(super) mass_matrix: Vec<f64>,
    pub(super) poses: Vec<Pose>,
    pub(super) jacobian: Vec<f64>,
}

impl Workspace {
    /// The only place that allocates.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.dof();
        Self {
            dof: n,
            machine: Machine::new(n),
            sin: vec![0.0; n],
            cos: vec![0.0; n],
            tau: vec![0.0; n],
            ddq: vec![0.0; n],
            regressor: vec![0.0; n * n * PARAMETERS_PER_LINK],
            mass_matrix: vec![0.0; n * n],
            poses: vec![Pose::IDENTITY; n],
            jacobian: vec![0.0; 6 * n],
        }
    }

    /// Runs `algorithm` with the joint positions set, compiled for this machine.
    #[inline(always)]
    pub(super) fn run<A: OnOneSample>(&mut self, robot: &Robot, q: &[f64], algorithm: A) {
        assert_eq!(self.dof, robot.dof(), "the workspace was made for a robot with another number of joints");
        assert_eq!(q.len(), self.dof, "one position per joint");
        let Self { machine, sin, cos, .. } = self;
        machine.run(robot, Positions { q, sin, cos }, algorithm);
    }
}

/// Scratch of the recursions for numbers of type `T`.
#[derive(Debug)]
pub(crate) struct Scratch<T: Real> {
    pub bodies: Vec<Body<T>>,
    /// `[i * n + j]`: axis of joint j as angular and linear motion of link i's origin, in link i's frame.
    pub axes: Vec<[Vector3<T>; 2]>,
    /// Inertia of everything that a joint carries.
    pub composite: Vec<LinkInertia<T>>,
    pub articulated: Vec<Articulated<T>>,
}

impl<T: Real> Scratch<T> {
    pub fn new(token: T::Token, dof: usize) -> Self {
        let zero = Vector3::zero(token);
        let massless = LinkInertia { mass: T::zero(token), first_moment: zero, inertia: Matrix3::zero(token) };
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
