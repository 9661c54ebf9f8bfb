//! The robot: joints, links, limits. Immutable; computations keep their state in a
//! [`Workspace`](crate::dynamics::Workspace).
//!
//! A [`Robot`] comes from a URDF file (`Robot::from_urdf`, with the feature `files`), from a
//! Denavit-Hartenberg table ([`Robot::from_dh`]) or ready-made ([`puma560`], [`two_link`]).
//! Conventions are in `docs/conventions.md`.

mod chain;
mod description;
mod dh;
mod error;
mod fingerprint;
mod ready_made;
#[cfg(feature = "files")]
mod urdf;
#[cfg(feature = "files")]
mod urdf_fault;
#[cfg(feature = "files")]
mod write;

use alloc::string::String;
use alloc::vec::Vec;
use serde::{Deserialize, Serialize};

#[doc(hidden)]
pub use chain::Chain;
pub(crate) use chain::Member;
pub use dh::{DhConvention, DhRow};
pub use error::RobotError;
pub use ready_made::{puma560, two_link};
#[cfg(feature = "files")]
pub use urdf::UrdfOptions;
#[cfg(feature = "files")]
pub use write::JointDynamics;

#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::spatial::{
    LinkInertia, Matrix3, PARAMETERS_PER_LINK, Pose, STANDARD_PARAMETER_NAMES, Vector3,
};

/// Gravity that a robot has unless told otherwise, m/s², base axes.
pub const STANDARD_GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// Largest length, mass, inertia, friction, gravity or limit in SI units: no arm comes near, and
/// products of such numbers stay finite.
pub const LARGEST_VALUE: f64 = 1e9;

/// Most movable joints of a robot: several arms with hands have fewer.
const MOST_JOINTS: usize = 100;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Rotation within limits; position in rad.
    Revolute,
    /// Rotation without limits; position in rad.
    Continuous,
    /// Translation; position in m.
    Prismatic,
}

impl JointKind {
    /// Whether the joint turns.
    pub fn is_rotation(self) -> bool {
        self != Self::Prismatic
    }

    /// Unit of the joint position.
    pub fn position_unit(self) -> &'static str {
        if self.is_rotation() { "rad" } else { "m" }
    }

    /// Unit of the joint torque or force.
    pub fn torque_unit(self) -> &'static str {
        if self.is_rotation() { "N·m" } else { "N" }
    }
}

/// What a joint may do; `None` where the robot file is silent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Limits {
    /// Lowest and highest position, rad (m).
    pub position: Option<[f64; 2]>,
    /// Highest speed, rad/s (m/s).
    pub velocity: Option<f64>,
    /// Highest torque, N·m (N).
    pub effort: Option<f64>,
}

impl Limits {
    setters! {
        with_position(position: Option<[f64; 2]>),
        with_velocity(velocity: Option<f64>),
        with_effort(effort: Option<f64>),
    }
}

impl Limits {
    /// The same limits, with those that limit nothing left out: infinite ones, those that stand for
    /// them (1e10, 1e308), and none.
    fn finite(self) -> Self {
        let finite = |value: &f64| value.abs() <= LARGEST_VALUE;
        Self {
            position: self.position.filter(|range| range.iter().all(finite)),
            velocity: self.velocity.filter(finite),
            effort: self.effort.filter(finite),
        }
    }
}

/// A movable joint and the place of its link.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Joint {
    /// Name, unique in the robot.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Index of the joint that carries it, `None` for the base.
    pub parent: Option<usize>,
    /// Joint frame at position zero, in the parent's link frame.
    pub placement: Pose,
    /// Unit vector of the axis, in the joint frame.
    pub axis: Vector3<f64>,
    /// Limits.
    pub limits: Limits,
    /// Viscous friction of the robot file, N·m·s/rad; not part of the rigid-body dynamics.
    pub damping: f64,
    /// Coulomb friction of the robot file, N·m; not part of the rigid-body dynamics.
    pub friction: f64,
}

impl Joint {
    setters! {
        with_name(name: String),
        with_kind(kind: JointKind),
        with_parent(parent: Option<usize>),
        with_placement(placement: Pose),
        with_axis(axis: Vector3<f64>),
        with_limits(limits: Limits),
        with_damping(damping: f64),
        with_friction(friction: f64),
    }
}

impl Joint {
    /// A joint on the base that turns or slides along z, without limits and friction.
    pub fn new(name: impl Into<String>, kind: JointKind) -> Self {
        Self {
            name: name.into(),
            kind,
            parent: None,
            placement: Pose::IDENTITY,
            axis: Vector3::new(0.0, 0.0, 1.0),
            limits: Limits::default(),
            damping: 0.0,
            friction: 0.0,
        }
    }
}

/// A named frame fixed to a link or to the base: a URDF link, a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Name.
    pub name: String,
    /// Joint whose link carries it, `None` for the base.
    pub joint: Option<usize>,
    /// Its place in that link's frame.
    pub pose: Pose,
}

/// A robot arm (a tree of rigid links) on a fixed base.
///
/// Joint `i` carries link `i`, whose frame moves with the joint and coincides with the joint frame
/// at position zero. Parents come before children.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "description::RobotDescription", into = "description::RobotDescription")]
pub struct Robot {
    name: String,
    joints: Vec<Joint>,
    links: Vec<LinkInertia>,
    frames: Vec<Frame>,
    gravity: Vector3<f64>,
    /// What was assumed when the robot was read.
    notes: Vec<String>,
    /// Joints, links and gravity as the recursions need them.
    chain: Chain,
    /// Blocks `joint * n + link` of the regressor that are always zero.
    zero_blocks: Vec<usize>,
}

impl Robot {
    /// A robot from its parts; `links[i]` is carried by `joints[i]`.
    ///
    /// # Errors
    /// If there is no joint, a joint's parent does not come before it, an axis has no direction, a
    /// number is not finite, a mass is negative, an inertia is not symmetric, a name occurs twice,
    /// a frame is on no joint, or there are more than a hundred joints.
    pub fn new(
        name: impl Into<String>,
        mut joints: Vec<Joint>,
        mut links: Vec<LinkInertia>,
        frames: Vec<Frame>,
        gravity: Vector3<f64>,
    ) -> Result<Self, RobotError> {
        let name = name.into();
        if joints.is_empty() {
            return Err(RobotError::NoMovableJoint { robot: name });
        }
        if joints.len() != links.len() {
            return Err(RobotError::LinkCount { expected: joints.len(), found: links.len() });
        }
        if joints.len() > MOST_JOINTS {
            return Err(RobotError::TooManyJoints { found: joints.len(), limit: MOST_JOINTS });
        }
        for frame in &frames {
            require_finite_pose(&frame.name, &frame.pose)?;
            if let Some(joint) = frame.joint.filter(|joint| *joint >= joints.len()) {
                return Err(RobotError::FrameOnNoJoint {
                    frame: frame.name.clone(),
                    joint,
                    joints: joints.len(),
                });
            }
        }
        let mut paths: Vec<Vec<usize>> = Vec::with_capacity(joints.len());
        for (index, joint) in joints.iter_mut().enumerate() {
            joint.axis = unit_axis(&joint.name, joint.axis)?;
            joint.limits = joint.limits.finite();
            require_finite_pose(&joint.name, &joint.placement)?;
            require_plausible(&joint.name, &[joint.damping, joint.friction])?;
            let mut path = match joint.parent {
                None => Vec::new(),
                Some(parent) if parent < index => paths[parent].clone(),
                Some(_) => return Err(RobotError::ParentAfterChild { joint: joint.name.clone() }),
            };
            path.push(index);
            paths.push(path);
        }
        for (index, joint) in joints.iter().enumerate() {
            if joints[..index].iter().any(|other| other.name == joint.name) {
                return Err(RobotError::DuplicateName { name: joint.name.clone() });
            }
        }
        for (joint, link) in joints.iter().zip(&mut links) {
            require_plausible(&joint.name, &link.standard_parameters())?;
            if link.mass < 0.0 {
                return Err(RobotError::NegativeMass { link: joint.name.clone(), mass: link.mass });
            }
            if !is_symmetric(&link.inertia) {
                return Err(RobotError::AsymmetricInertia { link: joint.name.clone() });
            }
            // Turning an inertia leaves its two triangles different by rounding; ten numbers
            // describe a link.
            *link = LinkInertia::from_standard_parameters(&link.standard_parameters());
        }
        require_plausible("gravity", &gravity.to_array())?;
        let n = joints.len();
        let zero_blocks =
            (0..n * n).filter(|block| !paths[block % n].contains(&(block / n))).collect();
        let members =
            joints.iter().zip(&links).map(|(joint, link)| Member::new(joint, *link)).collect();
        let chain = Chain { members, minus_g: -gravity, paths };
        Ok(Self { name, joints, links, frames, gravity, notes: Vec::new(), chain, zero_blocks })
    }

    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of joints n.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Length of the stretched arm between the frames of its first and its last joint, m; infinite
    /// for a single joint.
    pub fn length(&self) -> f64 {
        let travel = |joint: &Joint| match (joint.kind, joint.limits.position) {
            (JointKind::Prismatic, Some([low, high])) => low.abs().max(high.abs()),
            _ => 0.0,
        };
        let from_parent = |joint: &Joint| {
            joint.parent.map(|_| joint.placement.translation.norm() + travel(joint))
        };
        let length: f64 = self.joints.iter().filter_map(from_parent).sum();
        if length > 0.0 { length } else { f64::INFINITY }
    }

    /// Joints, base to tip; this order is the order of every array.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Names of the joints, in order.
    pub fn joint_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.joints.iter().map(|joint| joint.name.as_str())
    }

    /// Index of the joint `name`.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Inertia of each joint's link.
    pub fn links(&self) -> &[LinkInertia] {
        &self.links
    }

    /// Frames that have names.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// The frame `name`.
    ///
    /// # Errors
    /// If there is none; the message lists those that exist.
    pub fn frame(&self, name: &str) -> Result<&Frame, RobotError> {
        self.frames.iter().find(|frame| frame.name == name).ok_or_else(|| {
            RobotError::UnknownFrame {
                frame: name.into(),
                known: self.frames.iter().map(|frame| frame.name.clone()).collect(),
            }
        })
    }

    /// Gravitational acceleration in base axes, m/s².
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }

    /// The same robot under another gravity, m/s² in base axes.
    #[must_use]
    pub fn with_gravity(mut self, gravity: Vector3<f64>) -> Self {
        self.gravity = gravity;
        self.chain.minus_g = -gravity;
        self
    }

    /// The same robot with the frame of `joint` moved by `shift`, m, in its parent's axes.
    ///
    /// # Panics
    /// If there is no such joint.
    #[must_use]
    pub fn with_placement_moved(mut self, joint: usize, shift: Vector3<f64>) -> Self {
        let placement = &mut self.joints[joint].placement;
        placement.translation = placement.translation + shift;
        self.chain.members[joint].translation = placement.translation;
        self
    }

    /// The ten parameters of every link, `[10 n]`: m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
    /// about the link frame's origin, links in joint order.
    pub fn standard_parameters(&self) -> Vec<f64> {
        self.links.iter().flat_map(LinkInertia::standard_parameters).collect()
    }

    /// Names of the standard parameters, `[10 n]`: `joint_2.Ixx`.
    pub fn standard_parameter_names(&self) -> Vec<String> {
        self.joints
            .iter()
            .flat_map(|joint| STANDARD_PARAMETER_NAMES.map(|name| format!("{}.{name}", joint.name)))
            .collect()
    }

    fn with_notes(mut self, notes: Vec<String>) -> Self {
        self.notes = notes;
        self
    }

    /// The same kinematics with other inertias. Any values are allowed, also identified ones that
    /// no single body has.
    ///
    /// # Panics
    /// If `parameters` is not of length `10 n`.
    #[must_use]
    pub fn with_standard_parameters(mut self, parameters: &[f64]) -> Self {
        assert_eq!(parameters.len(), PARAMETERS_PER_LINK * self.dof(), "ten parameters per joint");
        let members = self.chain.members.iter_mut();
        for ((link, member), values) in
            self.links.iter_mut().zip(members).zip(parameters.as_chunks().0)
        {
            *link = LinkInertia::from_standard_parameters(values);
            member.link = *link;
        }
        self
    }

    /// The same for parameters that a user gives.
    ///
    /// # Errors
    /// If one is not finite, or larger than any arm has it.
    ///
    /// # Panics
    /// If `parameters` is not of length `10 n`.
    pub fn try_with_standard_parameters(self, parameters: &[f64]) -> Result<Self, RobotError> {
        for (name, value) in self.standard_parameter_names().iter().zip(parameters) {
            require_plausible(name, &[*value])?;
        }
        Ok(self.with_standard_parameters(parameters))
    }

    /// For what does not change the geometry: friction.
    #[doc(hidden)]
    pub fn joint_mut(&mut self, joint: usize) -> &mut Joint {
        &mut self.joints[joint]
    }

    /// Joints from the base to `joint`, itself last.
    pub fn path(&self, joint: usize) -> &[usize] {
        self.chain.path(joint)
    }

    /// Whether the torque of `joint` depends on the inertia of the link carried by `other`.
    pub fn carries(&self, joint: usize, other: usize) -> bool {
        self.chain.path(other).contains(&joint)
    }

    /// Blocks `joint * n + link` of the regressor where the joint does not carry the link.
    #[cfg(feature = "simd")]
    pub(crate) fn zero_blocks(&self) -> &[usize] {
        &self.zero_blocks
    }

    /// The same robot without the rounding errors of right angles: entries of rotations that are
    /// zero or one but for them are so.
    #[doc(hidden)]
    pub fn with_exact_right_angles(mut self) -> Self {
        let exact = |x: f64| if (x - x.round()).abs() < 1e-15 { x.round() } else { x };
        for joint in &mut self.joints {
            let rows = joint.placement.rotation.to_rows();
            joint.placement.rotation = Matrix3::from_rows(rows.map(|row| row.map(exact)));
        }
        for ((member, joint), link) in
            self.chain.members.iter_mut().zip(&self.joints).zip(&self.links)
        {
            *member = Member::new(joint, *link);
        }
        self
    }

    /// What the recursions need of the robot.
    #[doc(hidden)]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    #[cfg(feature = "files")]
    /// What a careful reader would want to know about this robot: joints that the file lets follow
    /// others and that stand here, links without mass at the tip, inertias that no body can have.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = self.notes.clone();
        for (index, (joint, link)) in self.joints.iter().zip(&self.links).enumerate() {
            let is_leaf = !self.joints.iter().any(|other| other.parent == Some(index));
            if is_leaf && link.mass == 0.0 {
                warnings.push(format!(
                    "the link of `{}` has no mass and carries nothing: forward dynamics needs a \
                     rotor inertia there",
                    joint.name
                ));
            }
            let scale = link.mass
                + link.inertia.get(0, 0)
                + link.inertia.get(1, 1)
                + link.inertia.get(2, 2);
            if link.smallest_pseudo_inertia_eigenvalue() < -1e-9 * scale {
                warnings.push(format!(
                    "the inertia of the link of `{}` belongs to no real body (it breaks the \
                     triangle inequality)",
                    joint.name
                ));
            }
        }
        warnings
    }
}

fn unit_axis(joint: &str, axis: Vector3<f64>) -> Result<Vector3<f64>, RobotError> {
    let norm = axis.norm();
    if !norm.is_finite() || norm < 1e-9 {
        return Err(RobotError::ZeroAxis { joint: joint.into() });
    }
    // What is a unit vector to rounding stays as it is, so that a robot read back is the same to
    // the bit.
    if (norm - 1.0).abs() <= 4.0 * f64::EPSILON {
        return Ok(axis);
    }
    Ok(axis * (1.0 / norm))
}

fn is_symmetric(inertia: &Matrix3<f64>) -> bool {
    let scale: f64 = (0..3).map(|k| inertia.get(k, k).abs()).sum();
    let pairs = [(0, 1), (0, 2), (1, 2)];
    pairs.iter().all(|&(row, column)| {
        (inertia.get(row, column) - inertia.get(column, row)).abs() <= 1e-9 * scale
    })
}

fn require_finite_pose(element: &str, pose: &Pose) -> Result<(), RobotError> {
    require_plausible(element, pose.to_matrix4().as_flattened())
}

/// Refuses what is not finite, and what is so large that products of it are not.
fn require_plausible(element: &str, values: &[f64]) -> Result<(), RobotError> {
    if values.iter().any(|value| !value.is_finite()) {
        return Err(RobotError::NotFinite { element: element.into() });
    }
    match values.iter().find(|value| value.abs() > LARGEST_VALUE) {
        Some(&value) => Err(RobotError::Implausible { element: element.into(), value }),
        None => Ok(()),
    }
}
