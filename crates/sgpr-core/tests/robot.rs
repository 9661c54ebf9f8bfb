//! Robots from URDF files and Denavit-Hartenberg tables: what is read, and what is said of files
//! that cannot be used.
#![allow(missing_docs)]

mod common;

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::fmt::Write;

use common::largest_difference;
use proptest::prelude::*;
use sgpr_core::dynamics::{Workspace, frame_pose, gravity_torque, mass_matrix};
use sgpr_core::robot::{
    DhConvention, DhRow, Frame, Joint, JointKind, Limits, Robot, RobotError, STANDARD_GRAVITY,
    UrdfOptions, puma560, two_link,
};
use sgpr_core::spatial::{LinkInertia, Matrix3, Pose, Vector3};

/// Numbers here are of the order of one and go through some tens of operations.
const TOLERANCE: f64 = 1e-13;

fn robot(body: &str) -> String {
    format!("<robot name=\"arm\">{body}</robot>")
}

/// A link with its inertia about the centre of mass (`xx yy zz`), and more inside of `<inertial>`'s
/// `<origin>`.
fn link(name: &str, mass: f64, centre: &str, inertia: [f64; 3]) -> String {
    let [xx, yy, zz] = inertia;
    format!(
        "<link name=\"{name}\"><inertial><mass value=\"{mass}\"/><origin {centre}/><inertia \
         ixx=\"{xx}\" ixy=\"0\" ixz=\"0\" iyy=\"{yy}\" iyz=\"0\" izz=\"{zz}\"/></inertial></link>"
    )
}

/// A joint named after its child.
fn joint(kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!(
        "<joint name=\"to_{child}\" type=\"{kind}\"><parent link=\"{parent}\"/><child \
         link=\"{child}\"/>{more}</joint>"
    )
}

fn read(body: &str) -> Robot {
    read_with(body, &UrdfOptions::default()).expect("a valid robot")
}

fn read_with(body: &str, options: &UrdfOptions) -> Result<Robot, RobotError> {
    Robot::from_urdf_text(&robot(body), "arm.urdf", options)
}

/// What a user sees of a file that cannot be used.
fn message(body: &str) -> String {
    read_with(body, &UrdfOptions::default()).expect_err("a bad robot").to_string()
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

const BASE: &str = "<link name=\"base\"/>";

/// base - to_one (revolute z) - one - to_two (revolute z, at 1 m) - two
fn planar(last: &str) -> String {
    [
        BASE,
        &link("one", 1.0, "xyz=\"0.5 0 0\"", [0.0, 0.0, 0.1]),
        &link("two", 2.0, "xyz=\"0.1 0 0\"", [0.0, 0.0, 0.3]),
        &joint("revolute", "base", "one", "<axis xyz=\"0 0 1\"/>"),
        &joint(
            last,
            "one",
            "two",
            "<origin xyz=\"1 0 0\" rpy=\"0 0 1.5707963267948966\"/><axis xyz=\"0 0 1\"/>",
        ),
    ]
    .concat()
}

#[test]
fn kinds_limits_and_friction_are_kept() {
    let arm = read(
        &[
            BASE,
            "<link name=\"a\"/><link name=\"b\"/><link name=\"c\"/>",
            &joint(
                "revolute",
                "base",
                "a",
                "<axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"2\" velocity=\"3\" \
                 effort=\"40\"/><dynamics damping=\"0.5\" friction=\"0.25\"/>",
            ),
            &joint(
                "continuous",
                "a",
                "b",
                "<axis xyz=\"0 1 0\"/><limit lower=\"-1\" upper=\"1\" velocity=\"3\" \
                 effort=\"0\"/>",
            ),
            // Without axis: x, as URDF has it.
            &joint(
                "prismatic",
                "b",
                "c",
                "<limit lower=\"0\" upper=\"0\" velocity=\"0\" \
                 effort=\"0\"/>",
            ),
        ]
        .concat(),
    );
    let [a, b, c] = arm.joints() else { panic!("three joints") };
    assert_eq!(
        [a.kind, b.kind, c.kind],
        [JointKind::Revolute, JointKind::Continuous, JointKind::Prismatic]
    );
    assert_eq!(
        a.limits,
        Limits::default()
            .with_position(Some([-1.0, 2.0]))
            .with_velocity(Some(3.0))
            .with_effort(Some(40.0)),
        "what the file says"
    );
    assert_eq!(
        b.limits,
        Limits::default().with_velocity(Some(3.0)),
        "continuous joints have no end"
    );
    assert_eq!(c.limits, Limits::default(), "zeros are what URDF writes for unknown limits");
    assert_eq!((a.damping, a.friction, b.damping), (0.5, 0.25, 0.0));
    assert_eq!(c.axis, Vector3::new(1.0, 0.0, 0.0));
    assert_eq!((c.kind.position_unit(), c.kind.torque_unit()), ("m", "N"));
    assert_eq!(arm.name(), "arm");
}

#[test]
fn infinite_limits_are_no_limits() {
    let limit = "<axis xyz=\"0 0 1\"/><limit lower=\"-inf\" upper=\"inf\" velocity=\"inf\" \
         effort=\"inf\"/>";
    let arm = read(&[BASE, "<link name=\"a\"/>", &joint("revolute", "base", "a", limit)].concat());
    assert_eq!(arm.joints()[0].limits, Limits::default());
    // Infinity has no place in JSON: the robot could not be read back.
    let text = serde_json::to_string(&arm).expect("plain data");
    assert_eq!(serde_json::from_str::<Robot>(&text).expect("just written"), arm);
}

#[test]
fn bodies_behind_fixed_and_locked_joints_are_merged_with_their_inertia() {
    let fixed = read(&planar("fixed"));
    // Locked at zero, and turned by as much as the joint's own frame is.
    let lock = |position: f64| {
        UrdfOptions::default()
            .with_joints(Some(vec!["to_one".into()]))
            .with_locked(HashMap::from([("to_two".into(), position)]))
    };
    let g = Vector3::new(0.0, -9.81, 0.0);
    for (arm, angle) in [
        (fixed, FRAC_PI_2),
        (read_with(&planar("revolute"), &lock(0.0)).expect("valid"), FRAC_PI_2),
        (read_with(&planar("continuous"), &lock(-FRAC_PI_4)).expect("valid"), FRAC_PI_4),
    ] {
        assert_eq!(arm.dof(), 1);
        let arm = arm.with_gravity(g);
        let mut ws = Workspace::new(&arm);
        // The second body's centre of mass on the first, which is a pendulum of two masses.
        let (x, y) = (1.0 + 0.1 * angle.cos(), 0.1 * angle.sin());
        let inertia = 0.1 + 1.0 * 0.25 + 0.3 + 2.0 * (x * x + y * y);
        for q in [0.0, 0.7, -2.0] {
            let torque =
                9.81 * (1.0 * 0.5 * f64::cos(q) + 2.0 * (x * f64::cos(q) - y * f64::sin(q)));
            assert!((gravity_torque(&arm, &mut ws, &[q])[0] - torque).abs() < 1e-12, "{q}");
            assert!((mass_matrix(&arm, &mut ws, &[q])[0] - inertia).abs() < 1e-12, "{q}");
        }
        // The link is still there as a frame.
        let pose = frame_pose(&arm, &mut ws, &[0.0], arm.frame("two").expect("a link of the file"));
        let expected = [angle.cos(), angle.sin(), 0.0];
        assert!(largest_difference(&pose.rotation.columns[0].to_array(), &expected) < TOLERANCE);
        assert!(largest_difference(&pose.translation.to_array(), &[1.0, 0.0, 0.0]) < TOLERANCE);
    }
}

#[test]
fn a_locked_slide_moves_the_body_along_its_axis() {
    let body = [
        BASE,
        "<link name=\"one\"/>",
        &link("two", 2.0, "xyz=\"0 0 0\"", [0.0; 3]),
        &joint("revolute", "base", "one", "<axis xyz=\"0 0 1\"/>"),
        // The axis has the length two: half a metre stays half a metre.
        &joint("prismatic", "one", "two", "<axis xyz=\"2 0 0\"/>"),
    ]
    .concat();
    let options = UrdfOptions::default()
        .with_joints(Some(vec!["to_one".into()]))
        .with_locked(HashMap::from([("to_two".into(), 0.5)]));
    let arm = read_with(&body, &options).expect("valid");
    assert!(
        (mass_matrix(&arm, &mut Workspace::new(&arm), &[0.3])[0] - 2.0 * 0.25).abs() < TOLERANCE
    );
}

#[test]
fn what_is_fixed_to_the_base_does_not_count() {
    let heavy = link("column", 500.0, "xyz=\"0 0 1\"", [9.0; 3]);
    let body = [
        BASE,
        &heavy,
        &link("one", 1.0, "xyz=\"0.5 0 0\"", [0.0, 0.0, 0.1]),
        &joint("fixed", "base", "column", "<origin xyz=\"0 0 2\"/>"),
        &joint("revolute", "column", "one", "<origin xyz=\"0 0 1\"/><axis xyz=\"0 0 1\"/>"),
    ]
    .concat();
    let arm = read(&body);
    assert_eq!(arm.links()[0].mass, 1.0);
    assert_eq!(arm.joints()[0].parent, None);
    assert!(
        (arm.joints()[0].placement.translation.z - 3.0).abs() < TOLERANCE,
        "the column is three metres high"
    );
    assert_eq!(arm.frame("column").expect("a link").joint, None);
}

#[test]
fn inertial_frames_may_be_turned() {
    // R = Rz(yaw) Ry(pitch) Rx(roll), written out (Craig, Introduction to Robotics, eq. 2.64).
    let (roll, pitch, yaw) = (0.3f64, -0.4f64, 1.1f64);
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    let r = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ];
    let (mass, c, principal) = (3.0, [0.1, -0.2, 0.3], [0.04, 0.05, 0.06]);
    let centre = format!("xyz=\"0.1 -0.2 0.3\" rpy=\"{roll} {pitch} {yaw}\"");
    let arm = read(
        &[BASE, &link("one", mass, &centre, principal), &joint("continuous", "base", "one", "")]
            .concat(),
    );
    // I = R diag R' + m (c'c 1 - c c')
    let entry = |i: usize, j: usize| {
        let turned: f64 = (0..3).map(|k| r[i][k] * principal[k] * r[j][k]).sum();
        let square: f64 = c.iter().map(|x| x * x).sum();
        turned + mass * (if i == j { square } else { 0.0 } - c[i] * c[j])
    };
    let expected = [
        mass,
        mass * c[0],
        mass * c[1],
        mass * c[2],
        entry(0, 0),
        entry(0, 1),
        entry(1, 1),
        entry(0, 2),
        entry(1, 2),
        entry(2, 2),
    ];
    assert!(largest_difference(&arm.standard_parameters(), &expected) < TOLERANCE);
}

#[test]
fn axes_need_no_unit_length() {
    let body = |axis: &str| {
        let one = link("one", 2.0, "xyz=\"0 0 0\"", [0.2, 0.3, 0.5]);
        [BASE, &one, &joint("revolute", "base", "one", &format!("<axis xyz=\"{axis}\"/>"))].concat()
    };
    for axis in ["0 3 4", "0 0.6 0.8", "0 3e-5 4e-5", "0 3e7 4e7"] {
        let arm = read(&body(axis));
        let inertia = mass_matrix(&arm, &mut Workspace::new(&arm), &[0.4])[0];
        // a' I a with a = (0, 0.6, 0.8)
        assert!((inertia - (0.36 * 0.3 + 0.64 * 0.5)).abs() < TOLERANCE, "{axis}: {inertia}");
    }
    assert_says(
        &message(&body("0 0 0")),
        &["arm.urdf", "the axis of joint `to_one`", "other than zero"],
    );
    assert_says(&message(&body("NaN 0 0")), &["arm.urdf", "the axis of joint `to_one`"]);
}

#[test]
fn branches_do_not_feel_each_other() {
    // A carriage of 5 kg with two fingers that slide against each other: kinetic energy by hand.
    let arm = read(
        &[
            BASE,
            &link("hand", 5.0, "xyz=\"0 0 0\"", [0.0; 3]),
            &link("left", 0.2, "xyz=\"0 0 0\"", [0.0; 3]),
            &link("right", 0.3, "xyz=\"0 0 0\"", [0.0; 3]),
            &joint("prismatic", "base", "hand", "<axis xyz=\"1 0 0\"/>"),
            &joint("prismatic", "hand", "left", "<axis xyz=\"1 0 0\"/>"),
            &joint("prismatic", "hand", "right", "<axis xyz=\"-1 0 0\"/>"),
        ]
        .concat(),
    );
    assert_eq!(
        arm.joints().iter().map(|joint| joint.parent).collect::<Vec<_>>(),
        [None, Some(0), Some(0)]
    );
    let expected = [5.5, 0.2, -0.3, 0.2, 0.2, 0.0, -0.3, 0.0, 0.3];
    assert!(
        largest_difference(
            mass_matrix(&arm, &mut Workspace::new(&arm), &[0.1, 0.2, 0.3]),
            &expected
        ) < TOLERANCE
    );
    assert!(arm.carries(0, 2) && !arm.carries(1, 2) && arm.path(2) == [0, 2]);
}

#[test]
fn frames_without_mass_carry_what_is_behind_them() {
    let arm = read(
        &[
            BASE,
            "<link name=\"empty\"/>",
            &link("tool", 2.0, "xyz=\"0.5 0 0\"", [0.0; 3]),
            &joint("revolute", "base", "empty", "<axis xyz=\"0 0 1\"/>"),
            &joint("fixed", "empty", "tool", "<origin xyz=\"0.5 0 0\"/>"),
        ]
        .concat(),
    );
    assert!(
        (mass_matrix(&arm, &mut Workspace::new(&arm), &[0.0])[0] - 2.0).abs() < TOLERANCE,
        "2 kg at 1 m"
    );
    assert!(arm.warnings().is_empty(), "{:?}", arm.warnings());
    assert_says(
        &arm.frame("flange").expect_err("no such frame").to_string(),
        &["no frame `flange`", "`base`, `empty`, `tool`"],
    );
}

#[test]
fn what_is_strange_but_possible_is_a_warning() {
    let zero_mass =
        [BASE, "<link name=\"one\"/>", &joint("continuous", "base", "one", "")].concat();
    let warnings = read(&zero_mass).warnings();
    assert_eq!(warnings.len(), 1);
    assert_says(&warnings[0], &["`to_one`", "no mass", "rotor inertia"]);
    // A plate has Izz = Ixx + Iyy, and nothing has more.
    let body = |zz: f64| {
        [
            BASE,
            &link("one", 1.0, "xyz=\"0 0 0\"", [1.0, 1.0, zz]),
            &joint("continuous", "base", "one", ""),
        ]
        .concat()
    };
    assert!(read(&body(2.0)).warnings().is_empty());
    assert_says(
        &read(&body(2.001)).warnings()[0],
        &["`to_one`", "no real body", "triangle inequality"],
    );
}

#[test]
fn joints_are_chosen_by_name() {
    let choose = |names: &[&str]| {
        let joints = Some(names.iter().map(|name| (*name).into()).collect());
        let options = UrdfOptions::default().with_joints(joints);
        let body =
            planar("revolute") + "<link name=\"tool\"/>" + &joint("fixed", "two", "tool", "");
        read_with(&body, &options)
    };
    let names = |robot: &Robot| robot.joint_names().map(String::from).collect::<Vec<_>>();
    assert_eq!(names(&choose(&["to_one", "to_two"]).expect("valid")), ["to_one", "to_two"]);
    let second = choose(&["to_two"]).expect("valid");
    assert_eq!((names(&second), second.joints()[0].parent), (vec!["to_two".into()], None));
    let message = |names: &[&str]| choose(names).expect_err("invalid").to_string();
    assert_says(
        &message(&["to_three"]),
        &["arm.urdf", "no joint `to_three`", "`to_one`, `to_two`"],
    );
    assert_says(&message(&["to_two", "to_one"]), &["from base to tip", "`to_one`, `to_two`"]);
    assert_says(&message(&["to_one", "to_one"]), &["`to_one` occurs twice"]);
    assert_says(
        &message(&["to_one", "to_tool"]),
        &["joint `to_tool` is fixed", "`to_one`, `to_two`"],
    );
    assert_says(&message(&[]), &["`arm` has no movable joint"]);
    assert_eq!(second.joint_index("to_two"), Some(0));
    assert_eq!(second.joint_index("to_one"), None);

    let locked = HashMap::from([("to_too".to_string(), 0.1)]);
    let options = UrdfOptions::default().with_locked(locked);
    let message =
        read_with(&planar("revolute"), &options).expect_err("a slip of the pen").to_string();
    assert_says(&message, &["no joint `to_too`", "`to_one`, `to_two`"]);
}

#[test]
fn a_lock_that_cannot_be_is_refused() {
    let lock = |joint: &str, position: f64| {
        let joints = Some(vec!["to_one".to_string()]);
        let options = UrdfOptions::default()
            .with_joints(joints)
            .with_locked(HashMap::from([(joint.into(), position)]));
        read_with(&planar("revolute"), &options).expect_err("invalid").to_string()
    };
    assert_says(&lock("to_two", f64::NAN), &["`to_two`", "not a finite number"]);
    // A joint cannot both move and stand.
    assert_says(&lock("to_one", 0.3), &["`to_one`", "both"]);
}

#[test]
fn mimicking_joints_stand_unless_they_are_asked_for() {
    let body = planar("revolute").replace(
        "<joint name=\"to_two\" type=\"revolute\">",
        "<joint name=\"to_two\" type=\"revolute\"><mimic joint=\"to_one\"/>",
    );
    let arm = read(&body);
    assert_eq!(arm.dof(), 1);
    let warnings = arm.warnings();
    assert_says(&warnings[0], &["`to_two` mimics `to_one`", "position 0", "`locked`", "`joints`"]);
    let text = serde_json::to_string(&arm).expect("plain data");
    assert_eq!(serde_json::from_str::<Robot>(&text).expect("the same robot").warnings(), warnings);
    let joints = Some(vec!["to_one".into(), "to_two".into()]);
    let both = read_with(&body, &UrdfOptions::default().with_joints(joints)).expect("valid");
    assert_eq!(both.dof(), 2);
    // Who says where it stands, or which joints move, knows.
    let locked = UrdfOptions::default().with_locked([("to_two".to_string(), 0.3)].into());
    let one = UrdfOptions::default().with_joints(Some(vec!["to_one".into()]));
    for silent in
        [both, read_with(&body, &locked).expect("valid"), read_with(&body, &one).expect("valid")]
    {
        assert!(!silent.warnings().iter().any(|text| text.contains("mimics")));
    }
}

#[test]
fn gravity_is_the_callers() {
    let moon = Vector3::new(0.0, 1.62, 0.0);
    let options = UrdfOptions::default().with_gravity(moon);
    let arm = read_with(&planar("fixed"), &options).expect("valid");
    assert_eq!(arm.gravity(), moon);
    let torque = gravity_torque(&arm, &mut Workspace::new(&arm), &[0.0])[0];
    assert!((torque + 1.62 * (0.5 + 2.0)).abs() < TOLERANCE, "pushed the other way: {torque}");
    assert_eq!(read(&planar("fixed")).gravity(), STANDARD_GRAVITY);
    let options = UrdfOptions::default().with_gravity(Vector3::new(0.0, 0.0, f64::INFINITY));
    assert_says(
        &read_with(&planar("fixed"), &options).expect_err("infinite").to_string(),
        &["`gravity`", "finite"],
    );
    let options = UrdfOptions::default().with_gravity(Vector3::new(0.0, 0.0, 1e160));
    let text =
        read_with(&planar("fixed"), &options).expect_err("its square is infinite").to_string();
    assert_says(&text, &["`gravity`", "1e160", "check the units"]);
}

#[test]
fn friction_that_no_arm_has_is_refused() {
    for dynamics in ["damping=\"1e160\"", "friction=\"-1e160\""] {
        let turns = format!("<axis xyz=\"0 0 1\"/><dynamics {dynamics}/>");
        let text = [BASE, "<link name=\"a\"/>", &joint("continuous", "base", "a", &turns)].concat();
        assert_says(&message(&text), &["arm.urdf", "`to_a`", "1e160", "check the units"]);
    }
}

#[test]
fn tags_with_more_attributes_than_any_element_has_are_refused() {
    // The XML reader compares each attribute with all before it (RUSTSEC-2026-0194): 80,000 took it
    // six seconds.
    let tag = |count: usize| (0..count).map(|k| format!(" a{k}=\"\"")).collect::<String>();
    let body = |count| {
        [BASE, "\n<link name=\"a\"", &tag(count), "/>", &joint("continuous", "base", "a", "")]
            .concat()
    };
    assert_eq!(read(&body(50)).dof(), 1);
    assert_says(
        &message(&body(80_000)),
        &["arm.urdf", "line 2", "<link>", "more than 100 attributes"],
    );
}

#[test]
fn the_fault_of_a_long_file_is_found_at_once() {
    let links: String = (0..200_000).map(|k| format!("<link name=\"l{k}\"/>\n")).collect();
    let start = std::time::Instant::now();
    let text = message(
        &(links + "<link name=\"last\"><inertial><mass value=\"heavy\"/></inertial></link>"),
    );
    assert_says(&text, &["arm.urdf", "line 200001", "link `last`", "heavy", "expected a number"]);
    // Lines counted anew for each element took minutes.
    assert!(start.elapsed() < std::time::Duration::from_secs(20), "{:?}", start.elapsed());
}

#[test]
fn numbers_that_stand_for_infinity_are_no_limits() {
    let limit = "<axis xyz=\"0 0 1\"/><limit lower=\"-1e16\" upper=\"1e16\" velocity=\"1e308\" \
         effort=\"1e10\"/>";
    let arm = read(&[BASE, "<link name=\"a\"/>", &joint("revolute", "base", "a", limit)].concat());
    assert_eq!(arm.joints()[0].limits, Limits::default());
}

#[test]
fn joints_that_make_no_tree_are_named() {
    let links = "<link name=\"a\"/><link name=\"b\"/><link name=\"c\"/>";
    let says = |joints: &[String], parts: &[&str]| {
        let text = message(&(links.to_string() + &joints.concat()));
        assert_says(&text, &["arm.urdf"]);
        assert_says(&text, parts);
    };
    let turn = |parent: &str, child: &str| joint("continuous", parent, child, "");
    says(
        &[turn("a", "b"), turn("b", "c"), turn("c", "a")],
        &["`a`, `b`, `c`", "closed loop", "a tree"],
    );
    says(&[turn("b", "c"), turn("c", "b")], &["`b`, `c`", "closed loop"]);
    says(&[turn("a", "a")], &["`b`, `c`", "one base link"]);
    says(&[turn("a", "b")], &["`a`, `c` all have no parent", "one base link"]);
    says(
        &[turn("a", "c"), turn("b", "c").replace("to_c", "other")],
        &["`c`", "`to_c` and `other`", "closed chains"],
    );
    says(&[turn("a", "d")], &["`to_d`", "link `d`, which the robot does not have"]);
    says(&[turn("d", "a")], &["`to_a`", "link `d`"]);
    says(&[turn("a", "b"), turn("a", "b")], &["`to_b` occurs twice"]);
    assert_says(
        &message("<link name=\"a\"/><link name=\"a\"/>"),
        &["arm.urdf", "`a` occurs twice"],
    );
    assert_says(&message(BASE), &["arm.urdf", "`arm` has no movable joint"]);
    assert_says(&message(""), &["arm.urdf", "`arm` has no movable joint"]);
    // Names may be anything, also nothing.
    let nameless = "<link name=\"\"/><link name=\"b\"/><joint name=\"\" \
         type=\"continuous\"><parent link=\"\"/><child link=\"b\"/></joint>";
    assert_eq!(read(nameless).dof(), 1);
}

#[test]
fn joints_of_other_kinds_are_named() {
    for kind in ["floating", "planar"] {
        let text = message(&[BASE, "<link name=\"a\"/>", &joint(kind, "base", "a", "")].concat());
        assert_says(
            &text,
            &["arm.urdf", "`to_a`", kind, "revolute, continuous, prismatic and fixed"],
        );
    }
    let text = message(&[BASE, "<link name=\"a\"/>", &joint("hinge", "base", "a", "")].concat());
    assert_says(&text, &["arm.urdf", "not a URDF", "hinge"]);
}

#[test]
fn numbers_that_cannot_be_are_named() {
    let with = |mass: f64, centre: &str, inertia: [f64; 3]| {
        message(
            &[BASE, &link("one", mass, centre, inertia), &joint("continuous", "base", "one", "")]
                .concat(),
        )
    };
    let at_origin = "xyz=\"0 0 0\"";
    assert_says(
        &with(-1.5, at_origin, [1.0; 3]),
        &["arm.urdf", "`one`", "-1.5 kg", "not negative"],
    );
    assert_says(
        &with(f64::NAN, at_origin, [1.0; 3]),
        &["arm.urdf", "`one`", "not a finite number"],
    );
    assert_says(
        &with(1.0, at_origin, [1.0, f64::INFINITY, 1.0]),
        &["arm.urdf", "`one`", "not a finite number"],
    );
    assert_says(
        &with(1.0, "xyz=\"0 inf 0\"", [1.0; 3]),
        &["arm.urdf", "`one`", "not a finite number"],
    );
    assert_says(
        &with(1e308, "xyz=\"1e10 0 0\"", [1.0; 3]),
        &["arm.urdf", "`one`", "1e10", "check the units"],
    );
    assert_says(
        &with(1e200, at_origin, [1.0; 3]),
        &["arm.urdf", "`to_one`", "1e200", "check the units"],
    );
    let placed = |more: &str| {
        message(&[BASE, "<link name=\"one\"/>", &joint("continuous", "base", "one", more)].concat())
    };
    assert_says(
        &placed("<origin xyz=\"0 0 1e12\"/>"),
        &["arm.urdf", "`to_one`", "1e12", "check the units"],
    );
    assert_says(
        &placed("<origin xyz=\"0 0 nan\"/>"),
        &["arm.urdf", "`to_one`", "not a finite number"],
    );
    assert_says(
        &placed("<origin rpy=\"0 inf 0\"/>"),
        &["arm.urdf", "`to_one`", "not a finite number"],
    );
    assert_says(
        &placed("<dynamics damping=\"nan\"/>"),
        &["arm.urdf", "`to_one`", "not a finite number"],
    );
    let says = |more: &str, parts: &[&str]| {
        assert_says(&placed(more), &[&["arm.urdf: not a URDF: line 1, "], parts].concat())
    };
    says(
        "<origin xyz=\"0 0\"/>",
        &["joint `to_one`", "the origin has xyz=\"0 0\", expected 3 numbers"],
    );
    says(
        "<origin xyz=\"0 0 up\"/>",
        &["joint `to_one`", "the origin has xyz=\"0 0 up\", expected 3 numbers"],
    );
    says(
        "<limit velocity=\"1\" effort=\"0,4\"/>",
        &["joint `to_one`", "the limit has effort=\"0,4\", expected a number"],
    );
    says(
        "<limit effort=\"4\"/>",
        &["joint `to_one`", "the limit lacks velocity, expected a number"],
    );
    let text =
        message("<link name=\"base\"/>\n<link name=\"one\"><inertial>\n<mass/></inertial></link>");
    assert_says(
        &text,
        &["arm.urdf", "line 3, link `one`: the mass lacks value, expected a number"],
    );
    let text = message("<link name=\"one\"><inertial>\n<mass value=\"1\"/></inertial></link>");
    assert_says(&text, &["arm.urdf", "line 2, link `one`: the inertial lacks its inertia"]);
}

#[test]
fn files_of_another_kind() {
    let message = |text: &str| {
        Robot::from_urdf_text(text, "arm.urdf", &UrdfOptions::default())
            .expect_err("not a robot")
            .to_string()
    };
    for text in
        ["", "joint,position\n1,2\n", "{\"robot\": 1}", "<robot name=\"x\"", "\u{0}\u{1}\u{2}"]
    {
        assert_says(&message(text), &["arm.urdf: not a URDF"]);
    }
    assert_says(
        &message("<mujoco><worldbody/></mujoco>"),
        &["arm.urdf: not a URDF: the outermost element is <mujoco>, expected <robot>"],
    );
    let xacro = "<robot name=\"x\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><xacro:include \
         filename=\"a\"/></robot>";
    assert_says(&message(xacro), &["arm.urdf", "xacro file", "xacro arm.urdf > robot.urdf"]);
    assert_says(
        &message("<robot name=\"x\"><link name=\"${prefix}base\"/></robot>"),
        &["expand it first"],
    );
    // What xacro made keeps comments with macros of the file that it was made from.
    let parts = [
        link("one", 1.0, "", [1.0; 3]),
        link("two", 1.0, "", [1.0; 3]),
        joint("continuous", "one", "two", ""),
    ];
    let expanded = read(&format!(
        "<!-- <origin rpy=\"${{pi}} 0 0\"/> -->{}<!-- <xacro:wheel/> -->",
        parts.concat()
    ));
    assert_eq!(expanded.dof(), 1);
    let left = robot("<!-- expanded --><link name=\"${prefix}base\"/>");
    assert_says(&message(&left), &["expand it first"]);
    // A link without name is not a link.
    assert_says(
        &message("<robot name=\"x\">\n<link/></robot>"),
        &["arm.urdf: not a URDF: line 2: a link has no name"],
    );
}

#[test]
fn files_that_cannot_be_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let message = |path: &std::path::Path| {
        Robot::from_urdf(path, &UrdfOptions::default()).expect_err("not a robot").to_string()
    };
    assert_says(&message(&folder.path().join("absent.urdf")), &["absent.urdf", "No such file"]);
    assert_says(&message(folder.path()), &[&folder.path().display().to_string()]);
    let path = folder.path().join("packed.urdf");
    std::fs::write(&path, [0x1f, 0x8b, 0xff, 0xfe]).expect("writable");
    assert_says(&message(&path), &["packed.urdf", "UTF-8"]);
    // Ten gigabytes of nothing: refused before memory is taken.
    let path = folder.path().join("huge.urdf");
    std::fs::File::create(&path)
        .and_then(|file| file.set_len(10_000_000_000))
        .expect("a sparse file");
    assert_says(&message(&path), &["huge.urdf", "10000000000 bytes", "67108864"]);
    // And a good one.
    let path = folder.path().join("arm.urdf");
    std::fs::write(&path, robot(&planar("revolute"))).expect("writable");
    assert_eq!(Robot::from_urdf(&path, &UrdfOptions::default()).expect("valid").dof(), 2);
}

#[test]
fn deep_nesting_and_long_chains_do_no_harm() {
    let depth = 100_000;
    let text = robot(&("<a>".repeat(depth) + &"</a>".repeat(depth)));
    let deep = Robot::from_urdf_text(&text, "deep.urdf", &UrdfOptions::default())
        .expect_err("no robot")
        .to_string();
    assert_says(&deep, &["deep.urdf"]);

    let chain = |kind: &str, count: usize| {
        let mut body = String::from("<link name=\"l0\"/>");
        for k in 1..=count {
            let (parent, child) = (format!("l{}", k - 1), format!("l{k}"));
            let more = "<origin xyz=\"0 0 0.001\"/>";
            write!(body, "<link name=\"{child}\"/>{}", joint(kind, &parent, &child, more))
                .expect("memory");
        }
        body
    };
    assert_says(
        &message(&chain("continuous", 3000)),
        &["arm.urdf", "3000 movable joints", "at most 100", "lock"],
    );
    // Fixed frames may be many.
    let body =
        chain("fixed", 3000) + "<link name=\"tip\"/>" + &joint("continuous", "l3000", "tip", "");
    let arm = read(&body);
    assert_eq!((arm.dof(), arm.frames().len()), (1, 3002));
    assert!((arm.joints()[0].placement.translation.z - 3.0).abs() < 1e-9);
    let options = UrdfOptions::default().with_joints(Some(vec!["to_l7".into()]));
    assert_eq!(read_with(&chain("continuous", 3000), &options).expect("one joint").dof(), 1);
}

#[test]
fn a_robot_written_down_and_read_back_is_the_same() {
    let turned = [
        BASE,
        &link("one", 1.0, "xyz=\"0.1 0.2 0.3\" rpy=\"0.1 0.2 0.3\"", [0.1, 0.2, 0.25]),
        &joint(
            "revolute",
            "base",
            "one",
            "<origin xyz=\"0.3 0.1 0.7\" rpy=\"1.1 0.3 -2\"/><axis xyz=\"1 2 3\"/><limit \
             lower=\"-1\" upper=\"2\" velocity=\"3\" effort=\"40\"/><dynamics damping=\"0.1\" \
             friction=\"0.7\"/>",
        ),
    ]
    .concat();
    for robot in [puma560(), two_link(), read(&turned), read(&planar("prismatic"))] {
        let text = serde_json::to_string(&robot).expect("plain data");
        let back: Robot = serde_json::from_str(&text).expect("just written");
        assert_eq!(back, robot, "to the bit");
    }
    // What was written may have been changed since.
    let text = serde_json::to_string(&puma560()).expect("plain data");
    let message = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        serde_json::from_str::<Robot>(&text.replacen(from, to, 1)).expect_err("damaged").to_string()
    };
    assert_says(&message("\"parent\":0", "\"parent\":5"), &["`joint_2`", "base to tip"]);
    assert_says(&message("\"joint\":5", "\"joint\":6"), &["`tool`", "joint number 6", "6 joints"]);
    assert_says(&message("\"joint_2\"", "\"joint_1\""), &["`joint_1` occurs twice"]);
    assert_says(
        &message("\"axis\":[0.0,0.0,1.0]", "\"axis\":[0.0,0.0,0.0]"),
        &["axis of joint `joint_1`"],
    );
}

#[test]
fn robots_from_parts_are_checked() {
    let joint = |name: &str, parent: Option<usize>| {
        Joint::new(name, JointKind::Revolute).with_parent(parent)
    };
    let new = |joints: Vec<Joint>, links: usize, frame: Option<usize>| {
        let frames = vec![Frame { name: "tool".into(), joint: frame, pose: Pose::IDENTITY }];
        Robot::new("parts", joints, vec![LinkInertia::ZERO; links], frames, STANDARD_GRAVITY)
            .map_err(|e| e.to_string())
    };
    new(vec![joint("a", None), joint("b", Some(0))], 2, Some(1)).expect("valid");
    let message = |joints, links, frame| new(joints, links, frame).expect_err("invalid");
    assert_says(&message(vec![joint("a", None)], 2, None), &["got 2 links for 1 joint"]);
    assert_says(
        &message(vec![joint("a", Some(1)), joint("b", None)], 2, None),
        &["`a`", "base to tip"],
    );
    assert_says(&message(vec![joint("a", Some(0))], 1, None), &["`a`", "base to tip"]);
    assert_says(&message(vec![joint("a", None)], 1, Some(1)), &["`tool`", "joint number 1"]);
    assert_says(&message(vec![], 0, None), &["`parts` has no movable joint"]);
    let rough = joint("a", None).with_friction(f64::NAN);
    assert_says(&message(vec![rough], 1, None), &["`a`", "not a finite number"]);
    let many = (0..101).map(|k| joint(&format!("j{k}"), None)).collect();
    assert_says(&message(many, 101, None), &["101 movable joints", "at most 100"]);
}

#[test]
fn tables_are_checked() {
    let row = DhRow::revolute(0.5, 0.1, 0.2, 0.3);
    for convention in [DhConvention::Standard, DhConvention::Modified] {
        let make = |rows: &[DhRow], names: Option<&[String]>| {
            Robot::from_dh("table", convention, rows, names, STANDARD_GRAVITY)
                .map_err(|error| error.to_string())
        };
        assert_eq!(
            make(&[row.clone(), row.clone()], None)
                .expect("valid")
                .joint_names()
                .collect::<Vec<_>>(),
            ["joint_1", "joint_2"]
        );
        let message = |rows: &[DhRow], names| make(rows, names).expect_err("invalid");
        assert_says(&message(&[], None), &["`table` has no movable joint"]);
        let names = ["a".to_string(), "a".to_string()];
        assert_says(&message(&[row.clone(), row.clone()], Some(&names)), &["`a` occurs twice"]);
        assert_says(
            &message(std::slice::from_ref(&row), Some(&names)),
            &["got 2 names for 1 joint"],
        );
        let light = row.clone().with_body(-1.0, [0.0; 3], [[0.0; 3]; 3]);
        assert_says(&message(&[light], None), &["`joint_1`", "-1 kg"]);
        for bad in [
            row.clone().with_a(f64::NAN),
            row.clone().with_alpha(f64::INFINITY),
            row.clone().with_d(f64::NAN),
            row.clone().with_theta(f64::NAN),
            row.clone().with_mass(f64::INFINITY),
            row.clone().with_inertia([[f64::NAN; 3]; 3]),
            row.clone().with_body(1.0, [0.0, f64::NAN, 0.0], [[0.0; 3]; 3]),
        ] {
            assert_says(&message(std::slice::from_ref(&bad), None), &["not a finite number"]);
            assert_says(&message(&[row.clone(), bad, row.clone()], None), &["not a finite number"]);
        }
        let typo = [[1.0, 0.1, 0.0], [-0.1, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let text = message(&[row.clone().with_body(1.0, [0.0; 3], typo)], None);
        assert_says(&text, &["link of `joint_1`", "not symmetric"]);
    }
}

#[test]
fn a_sliding_row_moves_along_z() {
    // Standard: Rz(theta) Tz(d + q) Tx(a) Rx(alpha); the tool is the last frame.
    let row = DhRow::prismatic(0.5, 0.2, 0.1, 0.7).with_body(2.0, [0.0; 3], [[0.0; 3]; 3]);
    let arm = Robot::from_dh("slide", DhConvention::Standard, &[row], None, STANDARD_GRAVITY)
        .expect("valid");
    let mut ws = Workspace::new(&arm);
    let tool = frame_pose(&arm, &mut ws, &[0.25], arm.frame("tool").expect("made"));
    let expected = [0.5 * 0.7f64.cos(), 0.5 * 0.7f64.sin(), 0.35];
    assert!(largest_difference(&tool.translation.to_array(), &expected) < TOLERANCE);
    assert!((mass_matrix(&arm, &mut ws, &[0.25])[0] - 2.0).abs() < TOLERANCE);
    assert!((gravity_torque(&arm, &mut ws, &[0.25])[0] - 2.0 * 9.81).abs() < 1e-12);
    assert_eq!(arm.joints()[0].kind, JointKind::Prismatic);
}

#[test]
fn a_table_with_theta_half_a_turn_is_not_mirrored() {
    let row = |theta| DhRow::revolute(1.0, 0.0, 0.0, theta);
    let arm = |theta| {
        Robot::from_dh(
            "arm",
            DhConvention::Modified,
            &[row(theta), row(0.0)],
            None,
            STANDARD_GRAVITY,
        )
        .expect("valid")
    };
    // Craig: the second axis is one metre along x of the first frame, which is turned by theta.
    let turned = arm(PI);
    let pose = frame_pose(
        &turned,
        &mut Workspace::new(&turned),
        &[0.0, 0.0],
        turned.frame("tool").expect("made"),
    );
    assert!(
        largest_difference(&pose.translation.to_array(), &[0.0, 0.0, 0.0]) < TOLERANCE,
        "there and back"
    );
    let r = Matrix3::rotation(Vector3::new(0.0, 0.0, 1.0), PI);
    assert!((pose.rotation.get(0, 0) - r.get(0, 0)).abs() < TOLERANCE);
}

/// As many files as `SGPR_FUZZ_CASES` says; `make fuzz` says many.
fn cases() -> ProptestConfig {
    let cases = std::env::var("SGPR_FUZZ_CASES").ok().and_then(|text| text.parse().ok());
    ProptestConfig::with_cases(cases.unwrap_or(200))
}

proptest! {
    #![proptest_config(cases())]

    /// Whatever is done to a file: a robot or an error, in bounded time, never a panic.
    #[test]
    fn damaged_files(changes in proptest::collection::vec((0.0..1.0f64, any::<u8>(), 0u8..3), 1..6)) {
        let mut bytes = robot(&planar("revolute")).into_bytes();
        for (place, value, how) in changes {
            let at = (place * bytes.len() as f64) as usize;
            match how {
                0 => bytes[at] = value & 0x7f,
                1 => bytes.insert(at, value & 0x7f),
                _ => { bytes.remove(at); }
            }
        }
        let text = String::from_utf8(bytes).expect("ASCII");
        if let Ok(robot) = Robot::from_urdf_text(&text, "x", &UrdfOptions::default()) {
            let mut ws = Workspace::new(&robot);
            let q = vec![0.1; robot.dof()];
            assert_eq!(mass_matrix(&robot, &mut ws, &q).len(), q.len() * q.len());
        }
    }
}
