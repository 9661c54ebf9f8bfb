use alloc::vec::Vec;

use super::machine::{Machine, Positions};
use super::scratch::OnOneSample;
use crate::robot::Robot;
use crate::spatial::{PARAMETERS_PER_LINK, Pose};

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
        assert_eq!(
            self.dof,
            robot.dof(),
            "the workspace was made for a robot with another number of joints"
        );
        assert_eq!(q.len(), self.dof, "one position per joint");
        let Self { machine, sin, cos, .. } = self;
        machine.run(robot, Positions { q, sin, cos }, algorithm);
    }
}
