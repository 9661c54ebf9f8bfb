//! What a motion has to keep within.

use derive_setters::Setters;

use super::ExcitationError;
use crate::robot::{Joint, Robot};

/// Limits of a motion; every list `[n]`.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct MotionLimits {
    /// Lowest and highest position, rad (m) (thesis eq. 3-7).
    pub position: Vec<[f64; 2]>,
    /// Highest speed, rad/s (m/s) (thesis eq. 3-8).
    pub velocity: Vec<f64>,
    /// Highest acceleration, rad/s² (m/s²) (thesis eq. 3-9).
    pub acceleration: Vec<f64>,
    /// Highest torque, N·m (N); no limit if `None`.
    pub torque: Option<Vec<f64>>,
}

impl MotionLimits {
    /// Position and speed limits of the robot, torque limits where the robot has one for every
    /// joint.
    ///
    /// - `acceleration`: `[n]`, rad/s² (m/s²); robot files do not know it
    ///
    /// # Errors
    /// If the robot is silent about a position or speed limit, or a limit leaves no room.
    pub fn of_robot(robot: &Robot, acceleration: &[f64]) -> Result<Self, ExcitationError> {
        Self::of_robot_or(robot, acceleration, None, None)
    }

    /// As [`Self::of_robot`], with these limits of positions and speeds in the place of the
    /// robot's.
    ///
    /// # Errors
    /// As [`Self::of_robot`].
    pub fn of_robot_or(
        robot: &Robot,
        acceleration: &[f64],
        position: Option<Vec<[f64; 2]>>,
        velocity: Option<Vec<f64>>,
    ) -> Result<Self, ExcitationError> {
        let missing = |joint: &Joint, quantity, option| {
            let joint = joint.name.clone();
            ExcitationError::NoLimit { joint, quantity, option }
        };
        let joints = || robot.joints().iter();
        let positions = || {
            joints()
                .map(|j| j.limits.position.ok_or_else(|| missing(j, "position", "position_range")))
        };
        let speeds = || {
            joints().map(|j| j.limits.velocity.ok_or_else(|| missing(j, "speed", "max_velocity")))
        };
        // A file that writes zero effort means that it does not know.
        let known = |effort: f64| (effort > 0.0).then_some(effort);
        let limits = Self {
            position: position.map_or_else(|| positions().collect(), Ok)?,
            velocity: velocity.map_or_else(|| speeds().collect(), Ok)?,
            acceleration: acceleration.to_vec(),
            torque: joints().map(|joint| joint.limits.effort.and_then(known)).collect(),
        };
        limits.require_valid(robot)?;
        Ok(limits)
    }

    /// Refuses lists of another length than the joints, and limits that leave no room.
    pub(super) fn require_valid(&self, robot: &Robot) -> Result<(), ExcitationError> {
        let torque = self.torque.as_deref().unwrap_or_default();
        let lists = [
            ("speed", &self.velocity[..]),
            ("acceleration", &self.acceleration),
            ("torque", torque),
        ];
        let lengths = [("position limits", self.position.len())].into_iter().chain([
            ("speed limits", self.velocity.len()),
            ("acceleration limits", self.acceleration.len()),
            ("torque limits", self.torque.as_ref().map_or(robot.dof(), Vec::len)),
        ]);
        for (what, found) in lengths {
            if found != robot.dof() {
                return Err(ExcitationError::Length { what, expected: robot.dof(), found });
            }
        }
        for (quantity, list) in lists {
            for (joint, &value) in robot.joint_names().zip(list) {
                if !(value > 0.0 && value.is_finite()) {
                    return Err(ExcitationError::InvalidLimit {
                        joint: joint.into(),
                        quantity,
                        value,
                    });
                }
            }
        }
        for (joint, &[low, high]) in robot.joint_names().zip(&self.position) {
            if !(low < high && low.is_finite() && high.is_finite()) {
                return Err(ExcitationError::EmptyRange { joint: joint.into(), low, high });
            }
        }
        Ok(())
    }

    /// The middle of the range where zero is outside it, else zero: where a motion starts unless
    /// told otherwise, `[n]`.
    pub fn default_start(&self) -> Vec<f64> {
        let inside =
            |[low, high]: [f64; 2]| if low < 0.0 && high > 0.0 { 0.0 } else { 0.5 * (low + high) };
        self.position.iter().copied().map(inside).collect()
    }

    /// Position beside the middle of the range, as a share of half the range: at a limit ±1.
    #[inline]
    pub(super) fn position_share(&self, joint: usize, q: f64) -> f64 {
        let [low, high] = self.position[joint];
        (q - 0.5 * (low + high)) / (0.5 * (high - low))
    }
}
