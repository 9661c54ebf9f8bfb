//! Robot files whose bodies, lengths and masses no arm has, with the logs of an arm.

use proptest::prelude::*;
use proptest::test_runner::Config;
use sgpr_core::diagnosis::{DiagnosisOptions, diagnose};
use sgpr_core::identification::Method;
use sgpr_core::robot::{DhConvention, DhRow, Robot};
use sgpr_core::spatial::Vector3;

use crate::logs::{log, options, requests, through_identification, understandable};

/// Mass, centre of mass, and inertia xx, yy, zz, xy, xz, yz of a link.
type Body = [f64; 10];

/// The link of the arm that made the logs: 1 kg in its middle, a point.
const LINK: Body = [1.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Two links of a plane arm, if the library takes them as a robot.
fn arm(bodies: [Body; 2], lengths: [f64; 2], gravity: f64) -> Result<Robot, String> {
    let rows: Vec<DhRow> = (0..2)
        .map(|k| {
            let [mass, x, y, z, xx, yy, zz, xy, xz, yz] = bodies[k];
            let inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            DhRow::revolute(lengths[k], 0.0, 0.0, 0.0).with_body(mass, [x, y, z], inertia)
        })
        .collect();
    let gravity = Vector3::new(0.0, gravity, 0.0);
    Robot::from_dh("arm", DhConvention::Standard, &rows, None, gravity)
        .map_err(|error| understandable(&error))
}

/// Robots that a file may hold: placeholders, nothing at all, sizes that fit no arm.
fn odd() -> Vec<(&'static str, Result<Robot, String>)> {
    let all = |value: f64| [[value; 10]; 2];
    let with = |place: usize, value: f64| {
        let mut changed = LINK;
        changed[place] = value;
        [LINK, changed]
    };
    let lengths = [1.0; 2];
    vec![
        ("no bodies", arm(all(0.0), lengths, -9.81)),
        ("no bodies and no gravity", arm(all(0.0), lengths, 0.0)),
        ("no lengths", arm([LINK; 2], [0.0; 2], -9.81)),
        ("nothing", arm(all(0.0), [0.0; 2], 0.0)),
        ("a last link of nothing", arm([LINK, [0.0; 10]], lengths, -9.81)),
        (
            "masses alone",
            arm([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]; 2], lengths, -9.81),
        ),
        ("ones everywhere", arm(all(1.0), lengths, -9.81)),
        ("a mass of 1e-30", arm(with(0, 1e-30), lengths, -9.81)),
        ("a mass of 1e-300", arm(with(0, 1e-300), lengths, -9.81)),
        ("a mass of 1e12", arm(with(0, 1e12), lengths, -9.81)),
        ("a mass of 1e300", arm(with(0, 1e300), lengths, -9.81)),
        ("a negative mass", arm(with(0, -1.0), lengths, -9.81)),
        ("a centre of mass 1e9 m away", arm(with(1, 1e9), lengths, -9.81)),
        ("an inertia of 1e20", arm(with(6, 1e20), lengths, -9.81)),
        ("an inertia below zero", arm(with(6, -5.0), lengths, -9.81)),
        ("links of 1e-9 m", arm([LINK; 2], [1e-9; 2], -9.81)),
        ("links of 1e6 m", arm([LINK; 2], [1e6; 2], -9.81)),
        ("links of 1e150 m", arm([LINK; 2], [1e150; 2], -9.81)),
        ("a gravity of 1e-300", arm([LINK; 2], lengths, 1e-300)),
        ("a gravity of 1e6", arm([LINK; 2], lengths, 1e6)),
        ("a gravity of 1e200", arm([LINK; 2], lengths, 1e200)),
    ]
}

#[test]
fn identification_answers_or_says_what_is_wrong_with_the_robot() {
    let logs = [log(0.0), log(1.0)];
    for (name, robot) in odd() {
        let Ok(robot) = robot else { continue };
        for options in requests() {
            let found = through_identification(&robot, &logs, &options);
            println!("{name}: {:?} {:?}", options.method, found.err());
        }
    }
}

#[test]
fn a_diagnosis_answers_or_says_what_is_wrong_with_the_robot() {
    let (train, test) = ([log(0.0), log(1.0)], [log(2.0)]);
    for (name, robot) in odd() {
        let Ok(robot) = robot else { continue };
        let Ok(model) = through_identification(&robot, &train, &options(Method::Wls)) else {
            continue;
        };
        let found = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &());
        println!(
            "{name}: {:?}",
            found.map(|found| found.verdict).map_err(|error| understandable(&error))
        );
    }
}

fn any_value() -> impl Strategy<Value = f64> {
    let size =
        (1.0..10.0, -320i32..309).prop_map(|(digits, exponent)| digits * 10f64.powi(exponent));
    let near = (1.0..10.0, -6i32..4).prop_map(|(digits, exponent)| digits * 10f64.powi(exponent));
    let sign = prop_oneof![3 => Just(1.0), 1 => Just(-1.0)];
    (sign, prop_oneof![1 => Just(0.0), 2 => size, 4 => near]).prop_map(|(sign, value)| sign * value)
}

fn any_body() -> impl Strategy<Value = Body> {
    let changes = prop::collection::vec((0..10usize, any_value()), 0..4);
    changes.prop_map(|changes| {
        changes.into_iter().fold(LINK, |mut body, (place, value)| {
            body[place] = value;
            body
        })
    })
}

proptest! {
    #![proptest_config(Config { cases: crate::cases(24), failure_persistence: None, ..Config::default() })]

    #[test]
    fn any_robot_is_answered_or_refused(
        bodies in prop::array::uniform2(any_body()),
        lengths in prop::array::uniform2(prop_oneof![3 => Just(1.0), 1 => any_value()]),
        gravity in prop_oneof![3 => Just(-9.81), 1 => any_value()],
        options in prop::sample::select(requests()),
    ) {
        if let Ok(robot) = arm(bodies, lengths, gravity) {
            let _ = through_identification(&robot, &[log(0.0), log(1.0)], &options);
        }
    }
}
