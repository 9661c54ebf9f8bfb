//! A torque of any shape that sessions have in common.

use std::sync::Arc;

use super::super::super::experiment::TermColumns;
use super::super::super::experiment::torque_of;
use super::Ready;
use crate::dynamics::{Workspace, gravity_torque};
use crate::identification::{Row, TrajectoryColumn};
use crate::motion::{Motion, MotionError};
use crate::robot::{Joint, JointKind, Robot};

/// Functions of a joint's position, speed and load, of which a torque of any shape is made.
pub(super) struct Shapes<'a> {
    robot: &'a Robot,
    /// Per joint: root mean square speed, and the range of a joint that slides.
    scales: Vec<(f64, [f64; 2])>,
}

/// Shares of the usual speed at which friction may have taken half of its turn.
const TURNS: [f64; 3] = [0.05, 0.2, 0.7];

/// Functions of each joint.
const SHAPES: usize = TURNS.len() + 4 + 8 + 1;

impl<'a> Shapes<'a> {
    pub fn new(robot: &'a Robot, logs: &[Ready]) -> Self {
        let n = robot.dof();
        let scale = |joint: usize| {
            let (mut squares, mut rows, mut range) = (0.0, 0, [f64::INFINITY, f64::NEG_INFINITY]);
            for motion in logs.iter().flat_map(|one| &one.experiment.motions) {
                for at in (joint..motion.q.len())
                    .step_by(n)
                    .filter(|at| motion.use_as[*at] == Row::Moving)
                {
                    squares += motion.dq[at] * motion.dq[at];
                    rows += 1;
                    range = [range[0].min(motion.q[at]), range[1].max(motion.q[at])];
                }
            }
            let speed = (squares / f64::max(rows as f64, 1.0)).sqrt();
            let slides = robot.joints()[joint].kind == JointKind::Prismatic && range[1] > range[0];
            // A joint that turns repeats itself after a turn, one that slides does not within twice
            // its range.
            let period = if slides {
                [range[0], 2.0 * (range[1] - range[0])]
            } else {
                [0.0, std::f64::consts::TAU]
            };
            (if speed > 0.0 { speed } else { 1.0 }, period)
        };
        Self { robot, scales: (0..n).map(scale).collect() }
    }

    /// Whether a column, counted over all joints, is friction of this one: what turns with the
    /// speed.
    pub fn is_friction(column: usize, joint: usize) -> bool {
        let even = TURNS.len() + 2..TURNS.len() + 8;
        column / SHAPES == joint && !even.contains(&(column % SHAPES))
    }

    pub fn parameters(&self) -> Vec<TrajectoryColumn> {
        let of = |joint: &Joint, index: usize, k: usize| {
            TrajectoryColumn::new(
                format!("{}.shape_{k}", joint.name),
                joint.kind.torque_unit(),
                Some(index),
                1.0,
            )
        };
        let joints = self.robot.joints().iter().enumerate();
        joints.flat_map(|(index, joint)| (0..SHAPES).map(move |k| of(joint, index, k))).collect()
    }

    pub fn columns(&self, motions: &[Arc<Motion>]) -> Result<TermColumns, MotionError> {
        let n = self.robot.dof();
        let mut ws = Workspace::new(self.robot);
        let mut of_motion = |motion: &Arc<Motion>| {
            let mut columns = vec![vec![0.0; motion.len()]; n * SHAPES];
            for sample in 0..motion.len() {
                let at = sample * n..(sample + 1) * n;
                let load = gravity_torque(self.robot, &mut ws, &motion.q[at.clone()]);
                for joint in 0..n {
                    let values = self.values(
                        joint,
                        motion.q[at.start + joint],
                        motion.dq[at.start + joint],
                        load[joint],
                    );
                    for (column, value) in columns[joint * SHAPES..].iter_mut().zip(values) {
                        column[sample] = value;
                    }
                }
            }
            columns
        };
        let values = motions.iter().map(&mut of_motion).collect();
        let tau = motions
            .iter()
            .map(|motion| torque_of(motion).map(<[f64]>::to_vec))
            .collect::<Result<_, _>>()?;
        Ok(TermColumns { tau, values, parameters: vec![], gains: vec![] })
    }

    fn values(&self, joint: usize, q: f64, dq: f64, load: f64) -> [f64; SHAPES] {
        let (speed, [zero, period]) = self.scales[joint];
        let (x, angle) = (dq / speed, std::f64::consts::TAU * (q - zero) / period);
        let turned = TURNS.map(|turn| (x / turn).tanh());
        let place = [angle.sin(), angle.cos(), (2.0 * angle).sin(), (2.0 * angle).cos()];
        let mut all = [0.0; SHAPES];
        let values = turned.into_iter().chain([x * x.abs(), x.powi(3), x.abs(), x * x]);
        let values = values
            .chain(place)
            .chain(place.map(|value| turned[0] * value))
            .chain([turned[0] * load.abs()]);
        all.iter_mut().zip(values).for_each(|(all, value)| *all = value);
        all
    }
}
