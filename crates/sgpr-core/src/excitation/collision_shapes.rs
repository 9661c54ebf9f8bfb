//! Capsules around the collision shapes of a robot file.

use std::path::Path;

use urdf_rs::Geometry;

use super::{Capsule, ExcitationError, Surroundings};
use crate::robot::Robot;
use crate::spatial::{Matrix3, Pose, Vector3};

impl Surroundings {
    /// Links as capsules around the `<collision>` shapes of the URDF file that the robot was read
    /// from. Nothing around it yet.
    ///
    /// A sphere and a capsule are taken as they are; a cylinder gets round ends, a box the capsule
    /// along its longest edge through all its corners, so that the shape lies within. Shapes of
    /// links that are fixed to a moving link move with it, those of the base stay.
    ///
    /// # Errors
    /// If the file cannot be read, is not the robot's, has a mesh, or has no shape on a moving
    /// link.
    pub fn from_urdf(robot: &Robot, path: impl AsRef<Path>) -> Result<Self, ExcitationError> {
        let name = path.as_ref().display().to_string();
        let text = std::fs::read_to_string(&path).map_err(|error| ExcitationError::Shapes {
            path: name.clone(),
            message: error.to_string(),
        })?;
        Self::from_urdf_text(robot, &text, &name)
    }

    /// As [`Self::from_urdf`], from text; `origin` names it in messages.
    ///
    /// # Errors
    /// As [`Self::from_urdf`].
    pub fn from_urdf_text(
        robot: &Robot,
        text: &str,
        origin: &str,
    ) -> Result<Self, ExcitationError> {
        let refuse = |message: String| ExcitationError::Shapes { path: origin.into(), message };
        let urdf = urdf_rs::read_from_string(text).map_err(|error| refuse(error.to_string()))?;
        let mut capsules = Vec::new();
        for link in &urdf.links {
            let frame = robot.frame(&link.name).map_err(|error| refuse(error.to_string()))?;
            for collision in &link.collision {
                let (half, radius) = capsule(&collision.geometry).map_err(|what| {
                    refuse(format!(
                        "the collision shape of link `{}` is {what}: give `link_radius` for \
                         capsules from joint to joint",
                        link.name
                    ))
                })?;
                let pose = placement(&frame.pose, &collision.origin);
                let ends = [-half, half].map(|end| pose.transform_point(end));
                if !ends.iter().all(|end| end.to_array().iter().all(|x| x.is_finite()))
                    || !radius.is_finite()
                {
                    return Err(refuse(format!(
                        "the collision shape of link `{}` is not finite",
                        link.name
                    )));
                }
                capsules.push(Capsule { joint: frame.joint, ends, radius });
            }
        }
        if capsules.iter().all(|capsule| capsule.joint.is_none()) {
            let message = "no moving link has a collision shape: give `link_radius` for capsules \
                 from joint to joint";
            return Err(refuse(message.into()));
        }
        Ok(Self {
            capsules,
            floor: None,
            blocks: vec![],
            self_collision: false,
            clearance: 0.0,
            tip_speed: None,
        })
    }
}

/// Half the segment of the capsule that holds a shape, in the shape's axes, and its radius.
fn capsule(geometry: &Geometry) -> Result<(Vector3<f64>, f64), &'static str> {
    let along_z = |half: f64| Vector3::new(0.0, 0.0, half);
    match geometry {
        Geometry::Sphere { radius } => Ok((Vector3::ZERO, *radius)),
        Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
            Ok((along_z(0.5 * length), *radius))
        }
        Geometry::Box { size } => {
            let longest = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three edges");
            let mut half = [0.0; 3];
            half[longest] = 0.5 * size[longest];
            let others = (0..3).filter(|&k| k != longest).map(|k| size[k] * size[k]).sum::<f64>();
            Ok((Vector3::new(half[0], half[1], half[2]), 0.5 * others.sqrt()))
        }
        Geometry::Mesh { .. } => Err("a mesh, which is not read"),
    }
}

/// Pose of a shape in the frame of the joint that moves it.
fn placement(link: &Pose, origin: &urdf_rs::Pose) -> Pose {
    *link * Pose::new(Matrix3::from_roll_pitch_yaw(*origin.rpy), Vector3::from(*origin.xyz))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Workspace, forward_kinematics};
    use crate::robot::UrdfOptions;

    fn arm(shapes: [&str; 3]) -> String {
        let inertial = r#"<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"#;
        let link =
            |name: &str, shape: &str| format!(r#"<link name="{name}">{inertial}{shape}</link>"#);
        let joint = |name: &str, kind: &str, parent: &str, child: &str, origin: &str| {
            format!(
                r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{origin}
                <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="9"/></joint>"#
            )
        };
        format!(
            r#"<robot name="arm">{}{}{}{}{}</robot>"#,
            link("base", shapes[0]),
            link("upper", shapes[1]),
            link("tool", shapes[2]),
            joint("shoulder", "revolute", "base", "upper", r#"<origin xyz="0 0 0.5"/>"#),
            joint(
                "mount",
                "fixed",
                "upper",
                "tool",
                r#"<origin xyz="1 0 0" rpy="0 1.5707963267948966 0"/>"#
            ),
        )
    }

    const CYLINDER: &str = r#"<collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.1" length="0.4"/></geometry></collision>"#;
    const BOX: &str = r#"<collision><origin xyz="0.5 0 0"/><geometry><box size="1.0 0.06 0.08"/></geometry></collision>"#;
    const SPHERE: &str = r#"<collision><origin xyz="0 0 0.3"/><geometry><sphere radius="0.07"/></geometry></collision>"#;

    #[test]
    fn every_shape_lies_within_its_capsule() {
        let text = arm([CYLINDER, BOX, SPHERE]);
        let robot = Robot::from_urdf_text(&text, "arm", &UrdfOptions::default()).expect("an arm");
        let cell = Surroundings::from_urdf_text(&robot, &text, "arm").expect("shapes");
        let [base, upper, tool] = &cell.capsules[..] else { panic!("three shapes") };
        assert_eq!([base.joint, upper.joint, tool.joint], [None, Some(0), Some(0)]);
        assert!((base.ends[0].z, base.ends[1].z) == (0.0, 0.4) && base.radius == 0.1);
        // The corners of the box, by distance from the segment from (0, 0, 0) to (1, 0, 0).
        let corner = 0.03f64.hypot(0.04);
        assert!((upper.radius - corner).abs() < 1e-15);
        assert!(
            upper.ends[0].norm() < 1e-15
                && (upper.ends[1] + -Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-15
        );
        // The tool's z axis points along x: 0.3 m in front of the mount; both ends are the centre.
        let mut ws = Workspace::new(&robot);
        let pose = forward_kinematics(&robot, &mut ws, &[0.0])[0];
        for end in tool.ends {
            let at = pose.transform_point(end);
            assert!((at + -Vector3::new(1.3, 0.0, 0.5)).norm() < 1e-12, "{at:?}");
        }
    }

    #[test]
    fn what_is_no_simple_shape_is_refused_by_name() {
        let mesh = r#"<collision><geometry><mesh filename="link.stl"/></geometry></collision>"#;
        for (shapes, words) in
            [([CYLINDER, mesh, ""], "`upper` is a mesh"), ([CYLINDER, "", ""], "no moving link")]
        {
            let text = arm(shapes);
            let robot =
                Robot::from_urdf_text(&text, "arm", &UrdfOptions::default()).expect("an arm");
            let error = Surroundings::from_urdf_text(&robot, &text, "arm")
                .expect_err("refused")
                .to_string();
            assert!(error.contains(words) && error.contains("arm: "), "{error}");
        }
        let text = arm([CYLINDER, BOX, SPHERE]);
        let other = crate::robot::puma560();
        assert!(Surroundings::from_urdf_text(&other, &text, "arm").is_err());
    }
}
