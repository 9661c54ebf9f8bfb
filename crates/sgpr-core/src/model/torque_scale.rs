//! Whether torques are of the size that the weight of the arm asks for.

use std::f64::consts::PI;

use crate::dynamics::{Workspace, gravity_torque};
use crate::recording::{Issue, IssueKind, Recording, RecordingError, Severity};
use crate::robot::{Joint, Robot};
use sgpr_numeric::internal::Random;

use super::select_joints;

/// Robot files, friction and inertia make torques differ from those of gravity by a factor of ten,
/// a wrong unit by a thousand: between them, in the geometric mean, lies the limit.
const LIMIT: f64 = 100.0;

/// Joints that bear at least this share of the largest weight are looked at.
const LOADED: f64 = 0.1;

/// Most samples that are looked at.
const SAMPLES: usize = 1000;

/// Poses of the arm that tell what it usually bears.
const POSES: usize = 100;

/// Says so if the torques of a log are a hundred times what gravity asks of the arm in the robot
/// file, or a hundredth: then they are in another unit, or motor currents, or the masses of the
/// file are no masses.
///
/// Nothing is said of a log without torque, of an arm without weight, and where
/// [`IssueKind::TorqueScale`] is accepted.
///
/// # Errors
/// If the recording lacks a joint of the robot.
pub fn torque_scale(robot: &Robot, recording: &Recording) -> Result<Option<Issue>, RecordingError> {
    let own = select_joints(robot, std::slice::from_ref(recording))?;
    let recording = &own[0];
    let n = robot.dof();
    let Some(torque) = recording.torque() else { return Ok(None) };
    // What no arm makes at all has a message of its own.
    if recording.accepted().contains(&IssueKind::TorqueScale) || recording.implausible().is_some() {
        return Ok(None);
    }
    let mut workspace = Workspace::new(robot);
    let (mut weight, mut measured, mut count) = (vec![0.0; n], vec![0.0; n], 0.0);
    for sample in (0..recording.len()).step_by(recording.len().div_ceil(SAMPLES).max(1)) {
        let row = sample * n..(sample + 1) * n;
        let (q, tau) = (&recording.position()[row.clone()], &torque[row]);
        if !q.iter().chain(tau).all(|value| value.is_finite()) {
            continue;
        }
        count += 1.0;
        for (joint, gravity) in gravity_torque(robot, &mut workspace, q).iter().enumerate() {
            weight[joint] += gravity * gravity;
            measured[joint] += tau[joint] * tau[joint];
        }
    }
    // Where an arm bears little, as upright, friction is many times its weight.
    for (weight, usual) in weight.iter_mut().zip(usual_weight(robot, &mut workspace)) {
        *weight = weight.max(LOADED * LOADED * count * usual);
    }
    let largest = weight.iter().copied().fold(0.0, f64::max);
    let loaded: Vec<usize> = (0..n)
        .filter(|&joint| weight[joint] > 0.0 && weight[joint] >= LOADED * LOADED * largest)
        .collect();
    let mut factors: Vec<f64> =
        loaded.iter().map(|&joint| (measured[joint] / weight[joint]).sqrt()).collect();
    factors.sort_by(f64::total_cmp);
    // Of most joints: a single one in another unit is named by identification.
    let count = factors.len();
    let usual = if count == 0 {
        1.0
    } else {
        factors[(count - 1) / 2].max(1.0) * factors[count / 2].min(1.0)
    };
    if usual == 0.0 || (1.0 / LIMIT..LIMIT).contains(&usual) {
        return Ok(None);
    }
    let factor = (loaded.iter().map(|&j| measured[j]).sum::<f64>()
        / loaded.iter().map(|&j| weight[j]).sum::<f64>())
    .sqrt();
    let size =
        if (1.0..1e6).contains(&factor) { format!("{factor:.0}") } else { format!("{factor:.2e}") };
    let message = format!(
        "the torques are {size} times what gravity asks of the arm in the robot file: give their \
         unit with `units.torque` (mNm, kNm), make torques of motor currents with \
         `torque_constants`, or correct the masses of the robot file; if all is right, confirm it \
         (accept: torque_scale)"
    );
    Ok(Some(Issue::of_log(IssueKind::TorqueScale, Severity::Error, loaded.len(), message)))
}

/// Mean square of the torque of gravity at each joint over poses of the whole range, (N·m)² (N²).
fn usual_weight(robot: &Robot, workspace: &mut Workspace) -> Vec<f64> {
    let mut random = Random::new(1);
    let mut mean = vec![0.0; robot.dof()];
    for _ in 0..POSES {
        let angle = |joint: &Joint| {
            let [low, high] =
                joint.limits.position.unwrap_or([-PI, PI]).map(|end| end.clamp(-PI, PI));
            low + (high - low) * random.uniform()
        };
        let q: Vec<f64> = robot.joints().iter().map(angle).collect();
        let gravity = gravity_torque(robot, workspace, &q);
        mean.iter_mut()
            .zip(gravity)
            .for_each(|(mean, torque)| *mean += torque * torque / POSES as f64);
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::two_link;

    #[test]
    fn friction_of_an_arm_that_hangs_down_is_no_unit() {
        let names = vec!["joint_1".into(), "joint_2".into()];
        let log = |unit: f64| {
            let position =
                (0..100).flat_map(|k| [-0.5 * PI + 1e-4 * f64::from(k % 7), 0.0]).collect();
            let torque = (0..100)
                .flat_map(|k| [0.9, 0.4].map(|x| unit * x * f64::from(1 - 2 * (k % 2))))
                .collect();
            let time = (0..100).map(|k| 10_000_000 * k).collect();
            Recording::new("log", names.clone(), time, position, None, Some(torque), vec![])
                .expect("fits")
        };
        let robot = two_link();
        assert_eq!(torque_scale(&robot, &log(1.0)).expect("joints"), None);
        let issue = torque_scale(&robot, &log(1e4)).expect("joints").expect("far too large");
        assert_eq!(issue.kind, IssueKind::TorqueScale);
    }
}
