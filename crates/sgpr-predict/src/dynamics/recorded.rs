//! The recursions over expressions: what code for one robot is made from.

use super::body::{Body, forward_pass};
use super::regressor::regressor_kernel;
use super::rnea::rnea_kernel;
use super::workspace::Scratch;
use crate::expression::Expr;
use crate::robot::Robot;
use crate::simd::{Number, Real};
use crate::spatial::{PARAMETERS_PER_LINK, Pose};

/// As [`super::Workspace`], for expressions.
#[derive(Debug)]
pub struct RecordedWorkspace {
    scratch: Scratch<Expr>,
    regressor: Vec<Expr>,
    poses: Vec<Pose<Expr>>,
}

impl RecordedWorkspace {
    pub(crate) fn new(robot: &Robot) -> Self {
        let n = robot.dof();
        Self {
            scratch: Scratch::new((), n),
            regressor: vec![Expr::zero(()); n * n * PARAMETERS_PER_LINK],
            poses: Vec::with_capacity(n),
        }
    }

    /// As [`super::rnea`].
    pub(crate) fn rnea(&mut self, robot: &Robot, motion: [&[Expr]; 3], tau: &mut [Expr]) {
        self.set(motion);
        rnea_kernel((), robot, &mut self.scratch.bodies);
        tau.iter_mut().zip(&self.scratch.bodies).for_each(|(tau, body)| *tau = body.tau);
    }

    /// As [`super::regressor`].
    pub(crate) fn regressor(&mut self, robot: &Robot, motion: [&[Expr]; 3]) -> &[Expr] {
        self.set(motion);
        let (n, matrix) = (robot.dof(), &mut self.regressor);
        let Scratch { bodies, axes, .. } = &mut self.scratch;
        regressor_kernel((), robot, bodies, axes, |joint, link, block| {
            matrix[(joint * n + link) * PARAMETERS_PER_LINK..][..PARAMETERS_PER_LINK].copy_from_slice(&block);
        });
        &self.regressor
    }

    /// As [`super::forward_kinematics`].
    pub(crate) fn forward_kinematics(&mut self, robot: &Robot, q: &[Expr]) -> &[Pose<Expr>] {
        self.set([q; 3]);
        forward_pass((), robot, &mut self.scratch.bodies);
        self.poses.clear();
        for (joint, Body { rotation, position, .. }) in robot.joints().iter().zip(&self.scratch.bodies) {
            let own = Pose::new(*rotation, *position);
            self.poses.push(joint.parent.map_or(own, |parent| self.poses[parent] * own));
        }
        &self.poses
    }

    fn set(&mut self, [q, dq, ddq]: [&[Expr]; 3]) {
        for (k, body) in self.scratch.bodies.iter_mut().enumerate() {
            (body.q, body.dq, body.ddq) = (q[k], dq[k], ddq[k]);
            (body.sin, body.cos) = q[k].sin_cos();
        }
    }
}
