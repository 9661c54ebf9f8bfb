//! How a robot is written into a model file.

use alloc::string::String;
use alloc::vec::Vec;

use serde::{Deserialize, Serialize};

use super::{Frame, Joint, JointKind, Limits, Robot, RobotError};
use crate::spatial::{LinkInertia, Matrix3, PARAMETERS_PER_LINK, Pose, Vector3};

/// A robot as plain data; numbers survive the round trip through JSON bit by bit.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct RobotDescription {
    name: String,
    gravity: [f64; 3],
    joints: Vec<JointDescription>,
    frames: Vec<FrameDescription>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
}

impl RobotDescription {
    /// The text of what dynamics depends on: joints, links and gravity.
    pub(super) fn dynamics_json(self) -> String {
        let bare = Self { name: String::new(), frames: Vec::new(), notes: Vec::new(), ..self };
        serde_json::to_string(&bare).expect("plain data")
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct JointDescription {
    name: String,
    kind: JointKind,
    parent: Option<usize>,
    placement: PoseDescription,
    axis: [f64; 3],
    limits: Limits,
    damping: f64,
    friction: f64,
    link: [f64; PARAMETERS_PER_LINK],
}

#[derive(Debug, Serialize, Deserialize)]
struct FrameDescription {
    name: String,
    joint: Option<usize>,
    pose: PoseDescription,
}

#[derive(Debug, Serialize, Deserialize)]
struct PoseDescription {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

impl From<&Pose> for PoseDescription {
    fn from(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.to_rows(), translation: pose.translation.to_array() }
    }
}

impl From<PoseDescription> for Pose {
    fn from(pose: PoseDescription) -> Self {
        Self::new(Matrix3::from_rows(pose.rotation), Vector3::from(pose.translation))
    }
}

impl From<Robot> for RobotDescription {
    fn from(robot: Robot) -> Self {
        let joint = |(joint, link): (&Joint, &LinkInertia)| JointDescription {
            name: joint.name.clone(),
            kind: joint.kind,
            parent: joint.parent,
            placement: (&joint.placement).into(),
            axis: joint.axis.to_array(),
            limits: joint.limits,
            damping: joint.damping,
            friction: joint.friction,
            link: link.standard_parameters(),
        };
        let frame = |frame: &Frame| FrameDescription {
            name: frame.name.clone(),
            joint: frame.joint,
            pose: (&frame.pose).into(),
        };
        Self {
            name: robot.name().into(),
            gravity: robot.gravity().to_array(),
            joints: robot.joints().iter().zip(robot.links()).map(joint).collect(),
            frames: robot.frames().iter().map(frame).collect(),
            notes: robot.notes,
        }
    }
}

impl TryFrom<RobotDescription> for Robot {
    type Error = RobotError;

    fn try_from(description: RobotDescription) -> Result<Self, RobotError> {
        let RobotDescription { name, gravity, joints, frames, notes } = description;
        let links =
            joints.iter().map(|joint| LinkInertia::from_standard_parameters(&joint.link)).collect();
        let joints = joints.into_iter().map(|joint| Joint {
            name: joint.name,
            kind: joint.kind,
            parent: joint.parent,
            placement: joint.placement.into(),
            axis: joint.axis.into(),
            limits: joint.limits,
            damping: joint.damping,
            friction: joint.friction,
        });
        let frames = frames.into_iter().map(|frame| Frame {
            name: frame.name,
            joint: frame.joint,
            pose: frame.pose.into(),
        });
        Ok(Self::new(name, joints.collect(), links, frames.collect(), gravity.into())?
            .with_notes(notes))
    }
}
