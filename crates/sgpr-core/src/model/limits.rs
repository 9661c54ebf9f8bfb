//! Logs beside the limits of the robot file: torques that the drive could not exceed, positions
//! that the joint cannot have.

use crate::identification::Finding;
use crate::recording::Recording;
use crate::robot::Robot;

/// From this share of its limit on, a torque is at the limit.
const AT_LIMIT: f64 = 0.995;
/// Positions may leave their limits by this share of the range.
const MARGIN: f64 = 0.02;
/// Shares of the samples that are worth a message, and that a wrong unit would reach.
const FEW: f64 = 0.001;
const MOST: f64 = 0.5;

/// What logs hold that the robot file rules out.
///
/// - `recordings`: with the joints of the robot, in their order
pub(super) fn beyond_limits(robot: &Robot, recordings: &[Recording]) -> Vec<Finding> {
    let joints = 0..robot.dof();
    let saturated = joints.clone().filter_map(|joint| saturated(robot, recordings, joint));
    saturated.chain(joints.filter_map(|joint| outside(robot, recordings, joint))).collect()
}

fn saturated(robot: &Robot, recordings: &[Recording], joint: usize) -> Option<Finding> {
    let found = &robot.joints()[joint];
    let limit = found.limits.effort.filter(|limit| *limit > 0.0)?;
    let torques = || {
        let arrays = recordings.iter().filter_map(Recording::torque);
        arrays.flat_map(move |torque| torque.iter().skip(joint).step_by(robot.dof()))
    };
    let share = share(torques().map(|torque| torque.abs() >= AT_LIMIT * limit));
    let (joint, unit) = (found.name.clone(), found.kind.torque_unit());
    (share > FEW).then_some(Finding::Saturated { joint, limit, unit, share })
}

fn outside(robot: &Robot, recordings: &[Recording], joint: usize) -> Option<Finding> {
    let found = &robot.joints()[joint];
    let limits = found.limits.position.filter(|[low, high]| low < high)?;
    let [low, high] = limits;
    let margin = MARGIN * (high - low);
    let positions =
        || recordings.iter().flat_map(|log| log.position().iter().skip(joint).step_by(robot.dof()));
    let share_of = |factor: f64| {
        share(positions().map(|position| {
            let position = factor * position;
            position < low - margin || position > high + margin
        }))
    };
    let (share, as_degrees) = (share_of(1.0), share_of(1f64.to_radians()));
    let (name, unit) = (found.name.clone(), found.kind.position_unit());
    let in_degrees = unit == "rad" && share > MOST && as_degrees <= FEW;
    (share > FEW).then_some(Finding::Outside { joint: name, limits, unit, share, in_degrees })
}

/// Share of what is true; 0 of nothing.
fn share(all: impl Iterator<Item = bool>) -> f64 {
    let (mut count, mut total) = (0usize, 0usize);
    for is_true in all {
        count += usize::from(is_true);
        total += 1;
    }
    count as f64 / total.max(1) as f64
}
