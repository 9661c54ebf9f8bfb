//! Robots from the Unified Robot Description Format.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use urdf_rs::JointType;

use super::urdf_fault::{first_fault, line_at};
use super::{Frame, Joint, JointKind, Limits, Robot, RobotError, STANDARD_GRAVITY};
use crate::spatial::{LinkInertia, Matrix3, Pose, Vector3};

/// Larger files are not robot descriptions (meshes live in files of their own).
const LARGEST_FILE: u64 = 64 << 20;

/// Elements inside of elements; a URDF has some ten. The parser calls itself for each and would use
/// up the stack.
const DEEPEST_ELEMENT: usize = 100;

/// Most attributes of an element: the XML reader compares each with all before it.
const MOST_ATTRIBUTES: usize = 100;

/// What to make of a URDF.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct UrdfOptions {
    /// Joints that move, base to tip; all movable ones that are not in `locked` if `None`. The
    /// others are locked.
    pub joints: Option<Vec<String>>,
    /// Position (rad, m) of locked joints; zero for those that are locked and not named.
    pub locked: HashMap<String, f64>,
    /// Gravity in base axes, m/s².
    pub gravity: Vector3<f64>,
}

impl UrdfOptions {
    setters! {
        with_joints(joints: Option<Vec<String>>),
        with_locked(locked: HashMap<String, f64>),
        with_gravity(gravity: Vector3<f64>),
    }
}

impl Default for UrdfOptions {
    fn default() -> Self {
        Self { joints: None, locked: HashMap::new(), gravity: STANDARD_GRAVITY }
    }
}

impl Robot {
    /// Reads a URDF file.
    ///
    /// Links behind fixed or locked joints are merged into the link that carries them, with their
    /// inertia; what is rigidly attached to the base does not count. Every URDF link becomes a
    /// [`Frame`]. `<dynamics>` is kept in the joint and does not enter the rigid-body dynamics. A
    /// joint that mimics another is locked unless `joints` names it, and [`Robot::warnings`] says
    /// so.
    ///
    /// # Errors
    /// If the file is not a URDF, is not a tree, has joints of unsupported type or numbers that
    /// cannot be, or if `options` names a joint that it lacks.
    ///
    /// # Examples
    /// ```no_run
    /// use sgpr_predict::robot::{Robot, UrdfOptions};
    /// let robot = Robot::from_urdf("ur10e.urdf", &UrdfOptions::default())?;
    /// assert_eq!(robot.dof(), 6);
    /// # Ok::<(), sgpr_predict::robot::RobotError>(())
    /// ```
    pub fn from_urdf(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Self, RobotError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let unreadable = |source| RobotError::Unreadable { path: name.clone(), source };
        let content = crate::limited_file::read(path, LARGEST_FILE).map_err(unreadable)?;
        let too_large =
            |bytes| RobotError::TooLarge { path: name.clone(), bytes, limit: LARGEST_FILE };
        let text =
            String::from_utf8(content.map_err(too_large)?).map_err(|_| RobotError::Malformed {
                path: name.clone(),
                message: "it is not text in UTF-8; save it as that if it is a robot description"
                    .into(),
            })?;
        Self::from_urdf_text(&text, &name, options)
    }

    /// As [`Robot::from_urdf`], from text; `origin` names it in messages.
    ///
    /// # Errors
    /// As [`Robot::from_urdf`].
    pub fn from_urdf_text(
        text: &str,
        origin: &str,
        options: &UrdfOptions,
    ) -> Result<Self, RobotError> {
        if is_xacro(text) {
            return Err(RobotError::Xacro { path: origin.into() });
        }
        let malformed = |message: String| RobotError::Malformed { path: origin.into(), message };
        require_robot(text).map_err(malformed)?;
        let urdf = urdf_rs::read_from_string(text).map_err(|error| {
            malformed(
                first_fault(text).unwrap_or_else(|| error.to_string().replace("custom: ", "")),
            )
        })?;
        let build = || {
            let tree = Tree::new(&urdf)?;
            tree.merge(&tree.choose(options)?, options)
        };
        build()
            .map_err(|source| RobotError::InFile { path: origin.into(), source: Box::new(source) })
    }
}

/// Whether macros are left in it. What xacro has expanded keeps comments, which may hold some.
fn is_xacro(text: &str) -> bool {
    let mut rest = text;
    loop {
        let (outside, comment) = rest.split_once("<!--").unwrap_or((rest, ""));
        if outside.contains("<xacro:") || outside.contains("${") {
            return true;
        }
        let Some((_, after)) = comment.split_once("-->") else { return false };
        rest = after;
    }
}

/// The body that each URDF link gets when `robot` is written back: that of the moving link for the
/// link that a moving joint carries, none for the links fixed to it; links that keep theirs are not
/// in the map.
pub(super) fn inertias_at_urdf_links(
    robot: &Robot,
    text: &str,
    origin: &str,
    options: &UrdfOptions,
) -> Result<HashMap<String, Option<LinkInertia>>, RobotError> {
    let read = Robot::from_urdf_text(text, origin, options)?;
    if !read.joint_names().eq(robot.joint_names()) {
        let moving: Vec<&str> = robot.joint_names().collect();
        return Err(RobotError::Malformed {
            path: origin.into(),
            message: format!("its moving joints are not those of the robot, {}", moving.join(", ")),
        });
    }
    let urdf = urdf_rs::read_from_string(text).map_err(|error| RobotError::Malformed {
        path: origin.into(),
        message: error.to_string(),
    })?;
    let tree = Tree::new(&urdf)?;
    let mut bodies: HashMap<String, Option<LinkInertia>> = HashMap::new();
    let mut carried = robot.links().to_vec();
    let mut behind_locked: HashSet<&str> = HashSet::new();
    let inertials: HashMap<&str, &urdf_rs::Inertial> =
        urdf.links.iter().map(|link| (link.name.as_str(), &link.inertial)).collect();
    for joint in tree.joints() {
        let child = joint.child.link.as_str();
        if robot.joint_index(&joint.name).is_some() {
            continue;
        }
        let locked = joint.joint_type != JointType::Fixed
            || behind_locked.contains(joint.parent.link.as_str());
        let frame = read.frame(child)?;
        let Some(body) = frame.joint else { continue };
        if locked {
            behind_locked.insert(child);
            carried[body] = carried[body]
                .minus(link_inertia(child, inertials[child])?.expressed_in(&frame.pose));
        } else {
            bodies.insert(child.into(), None);
        }
    }
    for joint in tree.joints() {
        if let Some(index) = robot.joint_index(&joint.name) {
            bodies.insert(joint.child.link.clone(), Some(carried[index]));
        }
    }
    Ok(bodies)
}

/// The links and joints of a URDF, checked to be a tree and ordered from base to tips.
struct Tree<'a> {
    urdf: &'a urdf_rs::Robot,
    /// Joints in depth-first order of the file: index into `urdf.joints`.
    order: Vec<usize>,
    root: &'a str,
}

impl<'a> Tree<'a> {
    fn new(urdf: &'a urdf_rs::Robot) -> Result<Self, RobotError> {
        require_unique(urdf.links.iter().map(|link| link.name.as_str()))?;
        require_unique(urdf.joints.iter().map(|joint| joint.name.as_str()))?;

        // Joint that carries each link.
        let mut carrier: HashMap<&str, Option<&str>> =
            urdf.links.iter().map(|link| (link.name.as_str(), None)).collect();
        let mut children: HashMap<&str, Vec<usize>> = HashMap::new();
        for (index, joint) in urdf.joints.iter().enumerate() {
            let unknown = |link: &str| RobotError::UnknownLink {
                joint: joint.name.clone(),
                link: link.into(),
            };
            if !carrier.contains_key(joint.parent.link.as_str()) {
                return Err(unknown(&joint.parent.link));
            }
            let carried_by = carrier
                .get_mut(joint.child.link.as_str())
                .ok_or_else(|| unknown(&joint.child.link))?;
            if let Some(first) = carried_by.replace(&joint.name) {
                return Err(RobotError::TwoParents {
                    link: joint.child.link.clone(),
                    first: first.into(),
                    second: joint.name.clone(),
                });
            }
            children.entry(&joint.parent.link).or_default().push(index);
        }

        let links = || urdf.links.iter().map(|link| link.name.as_str());
        let roots: Vec<&str> = links().filter(|link| carrier[link].is_none()).collect();
        let root = match roots[..] {
            [root] => root,
            [] if urdf.links.is_empty() => {
                return Err(RobotError::NoMovableJoint { robot: urdf.name.clone() });
            }
            [] => {
                return Err(RobotError::Cycle { links: links().map(String::from).collect() });
            }
            _ => {
                return Err(RobotError::SeveralRoots {
                    roots: roots.into_iter().map(String::from).collect(),
                });
            }
        };

        let mut order = Vec::with_capacity(urdf.joints.len());
        let mut pending: Vec<usize> =
            children.get(root).into_iter().flatten().rev().copied().collect();
        while let Some(index) = pending.pop() {
            order.push(index);
            let child = urdf.joints[index].child.link.as_str();
            pending.extend(children.get(child).into_iter().flatten().rev());
        }
        if order.len() < urdf.joints.len() {
            let reached: HashSet<&str> =
                order.iter().map(|&index| urdf.joints[index].child.link.as_str()).collect();
            let links = links()
                .filter(|link| *link != root && !reached.contains(link))
                .map(String::from)
                .collect();
            return Err(RobotError::Cycle { links });
        }
        Ok(Self { urdf, order, root })
    }

    fn joints(&self) -> impl Iterator<Item = &'a urdf_rs::Joint> {
        self.order.iter().map(|&index| &self.urdf.joints[index])
    }

    /// Names of the joints that move: those asked for, or all.
    fn choose(&self, options: &UrdfOptions) -> Result<HashSet<&'a str>, RobotError> {
        let movable: Vec<&urdf_rs::Joint> =
            self.joints().filter(|joint| joint.joint_type != JointType::Fixed).collect();
        let supported = [JointType::Revolute, JointType::Continuous, JointType::Prismatic];
        if let Some(joint) = movable.iter().find(|joint| !supported.contains(&joint.joint_type)) {
            let kind = format!("{:?}", joint.joint_type).to_lowercase();
            return Err(RobotError::UnsupportedJoint { joint: joint.name.clone(), kind });
        }
        if let Some((name, _)) = options.locked.iter().find(|(_, position)| !position.is_finite()) {
            return Err(RobotError::NotFinite { element: name.clone() });
        }
        let Some(requested) = &options.joints else {
            // A joint that mimics another has no motion of its own.
            let is_free = |joint: &&&urdf_rs::Joint| {
                joint.mimic.is_none() && !options.locked.contains_key(&joint.name)
            };
            return Ok(movable.iter().filter(is_free).map(|joint| joint.name.as_str()).collect());
        };
        if let Some(joint) = requested.iter().find(|name| options.locked.contains_key(*name)) {
            return Err(RobotError::LockedAndMoving { joint: joint.clone() });
        }
        require_unique(requested.iter().map(String::as_str))?;
        let wanted: HashSet<&str> = requested.iter().map(String::as_str).collect();
        let names = movable.iter().map(|joint| joint.name.as_str());
        let expected: Vec<&str> = names.clone().filter(|name| wanted.contains(name)).collect();
        if let Some(joint) = requested.iter().find(|name| !expected.contains(&name.as_str())) {
            let (robot, joint, movable) =
                (self.urdf.name.clone(), joint.clone(), names.map(String::from).collect());
            return Err(if self.joints().any(|other| other.name == joint) {
                RobotError::FixedJoint { robot, joint, movable }
            } else {
                RobotError::UnknownJoint { robot, joint, movable }
            });
        }
        if expected != *requested {
            return Err(RobotError::JointOrder {
                expected: expected.into_iter().map(String::from).collect(),
            });
        }
        Ok(expected.into_iter().collect())
    }

    /// Folds fixed and locked joints away.
    fn merge(&self, moving: &HashSet<&str>, options: &UrdfOptions) -> Result<Robot, RobotError> {
        // Where each URDF link sits: on which moving joint, and where in its link frame.
        let mut place: HashMap<&str, (Option<usize>, Pose)> = HashMap::new();
        place.insert(self.root, (None, Pose::IDENTITY));
        let mut frames = vec![Frame { name: self.root.into(), joint: None, pose: Pose::IDENTITY }];
        let mut joints: Vec<Joint> = Vec::new();
        let mut links: Vec<LinkInertia> = Vec::new();
        let inertials: HashMap<&str, &urdf_rs::Inertial> =
            self.urdf.links.iter().map(|link| (link.name.as_str(), &link.inertial)).collect();

        for joint in self.joints() {
            let (parent, parent_pose) = place[joint.parent.link.as_str()];
            let placement = parent_pose * pose(&joint.name, &joint.origin)?;
            let child = joint.child.link.as_str();
            let at = if moving.contains(joint.name.as_str()) {
                joints.push(convert(joint, parent, placement)?);
                links.push(LinkInertia::ZERO);
                (Some(joints.len() - 1), Pose::IDENTITY)
            } else {
                let position = options.locked.get(&joint.name).copied().unwrap_or(0.0);
                (parent, placement * locked_pose(joint, position)?)
            };
            place.insert(child, at);
            frames.push(Frame { name: child.into(), joint: at.0, pose: at.1 });
            if let (Some(body), pose) = at {
                let own = link_inertia(child, inertials[child])?;
                links[body] = links[body] + own.expressed_in(&pose);
            }
        }
        if let Some(name) =
            options.locked.keys().find(|name| !self.joints().any(|joint| joint.name == **name))
        {
            let movable = self.joints().filter(|joint| joint.joint_type != JointType::Fixed);
            return Err(RobotError::UnknownJoint {
                robot: self.urdf.name.clone(),
                joint: name.clone(),
                movable: movable.map(|joint| joint.name.clone()).collect(),
            });
        }
        let robot = Robot::new(self.urdf.name.clone(), joints, links, frames, options.gravity)?;
        Ok(robot.with_notes(self.standing_mimics(options)))
    }

    /// Sentences on joints that follow others in the file and stand in the model, although nobody
    /// said that they should.
    fn standing_mimics(&self, options: &UrdfOptions) -> Vec<String> {
        if options.joints.is_some() {
            return Vec::new();
        }
        let unasked = self.joints().filter(|joint| !options.locked.contains_key(&joint.name));
        let followers = unasked.filter_map(|joint| Some((joint, joint.mimic.as_ref()?)));
        followers
            .map(|(joint, leader)| {
                format!(
                    "`{}` mimics `{}` and is no joint of this model: its links are fixed at \
                     position 0, so what their own motion adds to the torque is missing. Give the \
                     position where it stands (`locked`), or name the joints that move (`joints`), \
                     it among them, if the logs have it",
                    joint.name, leader.joint
                )
            })
            .collect()
    }
}

/// Refuses what is no XML, begins with another element than a robot, is nested deeper than
/// [`DEEPEST_ELEMENT`], or has tags of more than [`MOST_ATTRIBUTES`].
fn require_robot(text: &str) -> Result<(), String> {
    use quick_xml::events::Event;
    let mut reader = quick_xml::Reader::from_str(text);
    let mut depth = 0;
    let line = |position: u64| line_at(text, position);
    loop {
        match reader.read_event() {
            Ok(Event::Start(element) | Event::Empty(element))
                if depth == 0 && element.name().as_ref() != b"robot" =>
            {
                let found = String::from_utf8_lossy(element.name().as_ref()).into_owned();
                return Err(format!("the outermost element is <{found}>, expected <robot>"));
            }
            Ok(Event::Start(element) | Event::Empty(element))
                if attributes(&element) > MOST_ATTRIBUTES =>
            {
                let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
                let line = line(reader.buffer_position());
                return Err(format!(
                    "line {line}: <{name}> has more than {MOST_ATTRIBUTES} attributes: no element \
                     of a URDF has a tenth of that"
                ));
            }
            Ok(Event::Start(_)) => depth += 1,
            Ok(Event::End(_)) => depth -= 1,
            Ok(Event::Eof) => return Ok(()),
            Ok(_) => {}
            Err(error) => return Err(format!("line {}: {error}", line(reader.error_position()))),
        }
        if depth > DEEPEST_ELEMENT {
            let line = line(reader.buffer_position());
            return Err(format!(
                "line {line}: elements are nested more than {DEEPEST_ELEMENT} deep"
            ));
        }
    }
}

/// At least as many as the tag has: signs of equality.
fn attributes(tag: &[u8]) -> usize {
    tag.iter().filter(|byte| **byte == b'=').count()
}

fn require_unique<'a>(names: impl Iterator<Item = &'a str>) -> Result<(), RobotError> {
    let mut seen = HashSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(RobotError::DuplicateName { name: name.into() });
        }
    }
    Ok(())
}

fn pose(element: &str, origin: &urdf_rs::Pose) -> Result<Pose, RobotError> {
    let pose = Pose::new(Matrix3::from_roll_pitch_yaw(*origin.rpy), Vector3::from(*origin.xyz));
    super::require_finite_pose(element, &pose)?;
    Ok(pose)
}

fn convert(
    joint: &urdf_rs::Joint,
    parent: Option<usize>,
    placement: Pose,
) -> Result<Joint, RobotError> {
    let kind = match joint.joint_type {
        JointType::Revolute => JointKind::Revolute,
        JointType::Continuous => JointKind::Continuous,
        _ => JointKind::Prismatic,
    };
    // URDF writes zeros for limits that it does not know.
    let limit = &joint.limit;
    let positive = |value: f64| (value > 0.0).then_some(value);
    let bounded = kind != JointKind::Continuous && limit.lower < limit.upper;
    let (damping, friction) =
        joint.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
    Ok(Joint {
        name: joint.name.clone(),
        kind,
        parent,
        placement,
        axis: super::unit_axis(&joint.name, Vector3::from(*joint.axis.xyz))?,
        limits: Limits {
            position: bounded.then_some([limit.lower, limit.upper]),
            velocity: positive(limit.velocity),
            effort: positive(limit.effort),
        },
        damping,
        friction,
    })
}

fn locked_pose(joint: &urdf_rs::Joint, position: f64) -> Result<Pose, RobotError> {
    if joint.joint_type == JointType::Fixed || position == 0.0 {
        return Ok(Pose::IDENTITY);
    }
    let axis = super::unit_axis(&joint.name, Vector3::from(*joint.axis.xyz))?;
    Ok(match joint.joint_type {
        JointType::Prismatic => Pose::from_translation(axis * position),
        _ => Pose::from_rotation(Matrix3::rotation(axis, position)),
    })
}

fn link_inertia(link: &str, inertial: &urdf_rs::Inertial) -> Result<LinkInertia, RobotError> {
    let mass = inertial.mass.value;
    let i = &inertial.inertia;
    if [mass, i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz].iter().any(|value| !value.is_finite()) {
        return Err(RobotError::NotFinite { element: link.into() });
    }
    if mass < 0.0 {
        return Err(RobotError::NegativeMass { link: link.into(), mass });
    }
    let at_centre =
        Matrix3::from_rows([[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]]);
    let body = LinkInertia::from_centre_of_mass(mass, Vector3::ZERO, at_centre);
    Ok(body.expressed_in(&pose(link, &inertial.origin)?))
}
