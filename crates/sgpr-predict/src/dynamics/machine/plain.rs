use super::{OnOneSample, Positions, Robot, Scratch, run_on};
#[cfg(not(feature = "std"))]
use crate::math::Float;

/// What every machine can do.
#[derive(Debug)]
pub(in super::super) struct Machine(Scratch<f64>);

impl Machine {
    pub fn new(dof: usize) -> Self {
        Self(Scratch::new((), dof))
    }

    /// Runs `algorithm` with the joint positions set.
    #[inline(always)]
    pub fn run(&mut self, robot: &Robot, at: Positions<'_>, algorithm: impl OnOneSample) {
        for ((q, sin), cos) in at.q.iter().zip(&mut *at.sin).zip(&mut *at.cos) {
            (*sin, *cos) = q.sin_cos();
        }
        run_on(robot, &mut self.0, &at, algorithm);
    }
}
