use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;

use crate::names::counted;

/// Why a robot could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The file could not be read.
    #[cfg(feature = "files")]
    #[error("{path}: {source}")]
    Unreadable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written; an older file of that name is untouched.
    #[cfg(feature = "files")]
    #[error("{path} cannot be written: {source}")]
    Unwritable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Larger than any robot description.
    #[error("{path}: {bytes} bytes are too many for a robot description (at most {limit})")]
    TooLarge {
        /// File.
        path: String,
        /// Its size.
        bytes: u64,
        /// Largest size that is read.
        limit: u64,
    },
    /// Not a URDF.
    #[error("{path}: not a URDF: {message}")]
    Malformed {
        /// File.
        path: String,
        /// What the parser said.
        message: String,
    },
    /// A macro file instead of its expansion.
    #[error("{path}: this is a xacro file; expand it first: xacro {path} > robot.urdf")]
    Xacro {
        /// File.
        path: String,
    },
    /// What the file says makes no robot, or not the one that was asked for.
    #[error("{path}: {source}")]
    InFile {
        /// File.
        path: String,
        /// What is wrong with it.
        source: Box<RobotError>,
    },
    /// A joint names a link that does not exist.
    #[error("joint `{joint}` refers to the link `{link}`, which the robot does not have")]
    UnknownLink {
        /// Joint.
        joint: String,
        /// Link.
        link: String,
    },
    /// Two joints carry one link.
    #[error(
        "the link `{link}` is carried by the joints `{first}` and `{second}`: closed chains are \
         not supported"
    )]
    TwoParents {
        /// Link.
        link: String,
        /// One joint.
        first: String,
        /// The other.
        second: String,
    },
    /// The joints form a ring.
    #[error("the links {} form a closed loop: a robot is a tree", quoted(links))]
    Cycle {
        /// Links in the loop.
        links: Vec<String>,
    },
    /// More than one link has no parent.
    #[error("the links {} all have no parent: a robot has one base link", quoted(roots))]
    SeveralRoots {
        /// Links without parent.
        roots: Vec<String>,
    },
    /// A joint type that moves in more than one direction.
    #[error(
        "joint `{joint}` is {kind}; revolute, continuous, prismatic and fixed joints are supported"
    )]
    UnsupportedJoint {
        /// Joint.
        joint: String,
        /// Its type.
        kind: String,
    },
    /// An axis without direction.
    #[error("the axis of joint `{joint}` has no direction: give a vector other than zero")]
    ZeroAxis {
        /// Joint.
        joint: String,
    },
    /// NaN or infinity.
    #[error("`{element}` has a value that is not a finite number")]
    NotFinite {
        /// Joint, link or field.
        element: String,
    },
    /// A length, mass or inertia that no arm has.
    #[error("`{element}` has the value {value:e} in SI units, which no arm has: check the units")]
    Implausible {
        /// Joint, link or field.
        element: String,
        /// The value.
        value: f64,
    },
    /// A mass below zero.
    #[error("the link of `{link}` has the mass {mass} kg: a mass is not negative")]
    NegativeMass {
        /// Link or joint.
        link: String,
        /// Its mass.
        mass: f64,
    },
    /// An inertia matrix that differs from its transpose.
    #[error("the inertia of the link of `{link}` is not symmetric: check its off-diagonal entries")]
    AsymmetricInertia {
        /// Joint that carries the link.
        link: String,
    },
    /// A name that occurs twice.
    #[error("the name `{name}` occurs twice: links have names of their own, and so have joints")]
    DuplicateName {
        /// Name.
        name: String,
    },
    /// A requested joint that is not there.
    #[error(
        "the robot `{robot}` has no joint `{joint}`; its movable joints are {}",
        quoted(movable)
    )]
    UnknownJoint {
        /// Robot.
        robot: String,
        /// Requested joint.
        joint: String,
        /// Joints to choose from.
        movable: Vec<String>,
    },
    /// A requested joint that cannot move.
    #[error("joint `{joint}` is fixed; the movable joints of `{robot}` are {}", quoted(movable))]
    FixedJoint {
        /// Robot.
        robot: String,
        /// Requested joint.
        joint: String,
        /// Joints to choose from.
        movable: Vec<String>,
    },
    /// A joint in both lists.
    #[error(
        "joint `{joint}` is to move and to be locked, which it cannot both: take it out of \
         `joints` or of `locked`"
    )]
    LockedAndMoving {
        /// Requested joint.
        joint: String,
    },
    /// Joints requested in an order other than the robot's.
    #[error("list the joints from base to tip, {}: arrays follow this order", quoted(expected))]
    JointOrder {
        /// Requested joints in the robot's order.
        expected: Vec<String>,
    },
    /// Nothing to move.
    #[error("the robot `{robot}` has no movable joint")]
    NoMovableJoint {
        /// Robot.
        robot: String,
    },
    /// A frame that does not exist.
    #[error("there is no frame `{frame}`; the robot has {}", quoted(known))]
    UnknownFrame {
        /// Requested frame.
        frame: String,
        /// Frames to choose from.
        known: Vec<String>,
    },
    /// Parameters that no body has cannot be written to a file of bodies.
    #[error(
        "the link of `{link}` (mass {mass} kg, smallest eigenvalue of its pseudo-inertia \
         {eigenvalue:.3e}) is no body: identify with physical consistency before writing a robot \
         file"
    )]
    NotABody {
        /// Link or joint.
        link: String,
        /// Its mass.
        mass: f64,
        /// Its smallest eigenvalue.
        eigenvalue: f64,
    },
    /// One inertia per joint is needed.
    #[error("got {} for {}: each joint carries one link", counted(*found, "link"), counted(*expected, "joint"))]
    LinkCount {
        /// Joints.
        expected: usize,
        /// Links.
        found: usize,
    },
    /// One name per joint is needed.
    #[error("got {} for {}: give every joint a name, or none", counted(*found, "name"), counted(*expected, "joint"))]
    NameCount {
        /// Joints.
        expected: usize,
        /// Names.
        found: usize,
    },
    /// More joints than any arm has.
    #[error(
        "{found} movable joints are too many (at most {limit}): list those that move (joints) and \
         lock the others"
    )]
    TooManyJoints {
        /// Joints.
        found: usize,
        /// Most joints that a robot may have.
        limit: usize,
    },
    /// A frame on a joint that is not there.
    #[error(
        "the frame `{frame}` is on joint number {joint}, counted from zero, but there are {joints} \
         joints"
    )]
    FrameOnNoJoint {
        /// Frame.
        frame: String,
        /// Index of the joint.
        joint: usize,
        /// Number of joints.
        joints: usize,
    },
    /// Joints must be listed from base to tip.
    #[error("joint `{joint}` comes before the joint that carries it: list joints from base to tip")]
    ParentAfterChild {
        /// Joint.
        joint: String,
    },
}

fn quoted(names: &[String]) -> String {
    match names {
        [] => "none".into(),
        names => names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "),
    }
}
