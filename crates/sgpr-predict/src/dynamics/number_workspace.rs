//! The recursions over any number: of 32 bits, or an expression from which code for one robot is
//! made.

use alloc::vec::Vec;

use super::body::{Body, forward_pass};
use super::regressor::regressor_kernel;
use super::rnea::rnea_kernel;
use super::scratch::Scratch;
use crate::robot::{Chain, Robot};
use crate::simd::Number;
use crate::spatial::{PARAMETERS_PER_LINK, Pose};

/// As [`super::Workspace`], for other numbers.
#[derive(Debug)]
pub struct NumberWorkspace<T: Number> {
    chain: Chain<T::Constant>,
    scratch: Scratch<T>,
    regressor: Vec<T>,
    poses: Vec<Pose<T>>,
}

impl<T: Number> NumberWorkspace<T> {
    pub(crate) fn new(robot: &Robot) -> Self {
        let n = robot.dof();
        Self {
            chain: robot.chain().of::<T>(),
            scratch: Scratch::new((), n),
            regressor: vec![T::zero(()); n * n * PARAMETERS_PER_LINK],
            poses: Vec::with_capacity(n),
        }
    }

    /// As [`super::rnea`].
    pub(crate) fn rnea(&mut self, motion: [&[T]; 3], tau: &mut [T]) {
        self.set(motion);
        rnea_kernel((), &self.chain, &mut self.scratch.bodies);
        tau.iter_mut().zip(&self.scratch.bodies).for_each(|(tau, body)| *tau = body.tau);
    }

    /// As [`super::regressor`].
    pub(crate) fn regressor(&mut self, motion: [&[T]; 3]) -> &[T] {
        self.set(motion);
        let (n, matrix) = (motion[0].len(), &mut self.regressor);
        let Scratch { bodies, axes, .. } = &mut self.scratch;
        regressor_kernel((), &self.chain, bodies, axes, |joint, link, block| {
            matrix[(joint * n + link) * PARAMETERS_PER_LINK..][..PARAMETERS_PER_LINK]
                .copy_from_slice(&block);
        });
        &self.regressor
    }

    /// As [`super::forward_kinematics`].
    pub(crate) fn forward_kinematics(&mut self, q: &[T]) -> &[Pose<T>] {
        self.set([q; 3]);
        forward_pass((), &self.chain, &mut self.scratch.bodies);
        self.poses.clear();
        for (member, Body { rotation, position, .. }) in
            self.chain.members.iter().zip(&self.scratch.bodies)
        {
            let own = Pose::new(*rotation, *position);
            self.poses.push(member.parent.map_or(own, |parent| self.poses[parent] * own));
        }
        &self.poses
    }

    fn set(&mut self, [q, dq, ddq]: [&[T]; 3]) {
        for (k, body) in self.scratch.bodies.iter_mut().enumerate() {
            (body.q, body.dq, body.ddq) = (q[k], dq[k], ddq[k]);
            (body.sin, body.cos) = q[k].sin_cos();
        }
    }
}
