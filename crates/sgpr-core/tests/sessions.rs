//! What changed between sessions, on the bundled logs of a closed-loop simulation by another
//! program whose arm has effects that the model lacks.
#![allow(missing_docs)]

mod common;

use common::data;
use sgpr_core::dynamics::{Workspace, rnea};
use sgpr_core::model::{SessionCause, SessionComparison, SessionTest, compare, compare_sessions};
use sgpr_core::recording::{Recording, csv};
use sgpr_core::robot::{Robot, UrdfOptions};
use sgpr_core::spatial::PARAMETERS_PER_LINK;

const EFFECTS: [&str; 4] =
    ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];

fn robot() -> Robot {
    Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled")
}

fn logs() -> Vec<Recording> {
    let read = |name: &str| {
        csv::read(data(&format!("demo/{name}.csv.gz")), &Default::default()).expect("bundled")
    };
    ["train_1", "train_2", "train_3", "test"].map(read).to_vec()
}

fn sessions(robot: &Robot, sessions: &[(&str, Vec<Recording>)]) -> SessionComparison {
    let given: Vec<(String, Vec<Recording>)> =
        sessions.iter().map(|(name, logs)| (name.to_string(), logs.clone())).collect();
    compare_sessions(robot, &given, &EFFECTS.map(String::from), &Default::default(), &())
        .expect("two sessions")
}

/// Central differences.
fn derivative(values: &[f64], time: &[f64], n: usize) -> Vec<f64> {
    let last = time.len() - 1;
    let of = |k: usize| {
        let (before, after) = ((k / n).saturating_sub(1), (k / n + 1).min(last));
        (values[after * n + k % n] - values[before * n + k % n]) / (time[after] - time[before])
    };
    (0..values.len()).map(of).collect()
}

/// The log with other torque: from the torque, speed and number of a joint.
fn with_torque(log: &Recording, change: impl Fn(usize, f64, f64) -> f64) -> Recording {
    let n = log.dof();
    let speed = derivative(log.position(), &log.time_seconds(), n);
    let torque = log.torque().expect("has torque").iter().enumerate();
    let torque = torque.map(|(k, tau)| change(k % n, *tau, speed[k])).collect();
    let (names, stamps) = (log.joint_names().to_vec(), log.time().to_vec());
    let velocity = log.velocity().map(<[f64]>::to_vec);
    Recording::new(
        format!("{} changed", log.source()),
        names,
        stamps,
        log.position().to_vec(),
        velocity,
        Some(torque),
        vec![],
    )
    .expect("fits")
}

fn changed(found: &SessionComparison) -> Vec<SessionCause> {
    found.tests.iter().filter(|test| test.changed).map(|test| test.cause).collect()
}

fn test_of(found: &SessionComparison, cause: SessionCause) -> &SessionTest {
    found.tests.iter().find(|test| test.cause == cause).expect("tested")
}

#[test]
fn sessions_of_an_arm_that_did_not_change_are_alike() {
    let (robot, logs) = (robot(), logs());
    let pick = |numbers: &[usize]| numbers.iter().map(|k| logs[*k].clone()).collect::<Vec<_>>();
    for [first, second] in
        [[&[0, 1][..], &[2, 3]], [&[0, 2], &[1, 3]], [&[0, 3], &[1, 2]], [&[0], &[1]], [&[2], &[3]]]
    {
        let found = sessions(&robot, &[("monday", pick(first)), ("tuesday", pick(second))]);
        for test in found.tests.iter().filter(|test| test.chance < 0.01) {
            println!("{first:?} {second:?} {test:?}");
        }
        assert_eq!(changed(&found), vec![], "{first:?} {second:?} {:?}", found.sentences());
        assert_eq!(found.models[0].parameters(), found.models[1].parameters());
    }
}

#[test]
fn friction_that_grew_is_found_at_its_joint_and_by_how_much() {
    let (robot, logs) = (robot(), logs());
    let base = sessions(&robot, &[("a", logs[..2].to_vec()), ("b", logs[2..].to_vec())]);
    for joint in 0..robot.dof() {
        let of = |symbol: &str| {
            let name = format!("{}.{symbol}", robot.joints()[joint].name);
            let names = base.models[0].parameter_set().names();
            base.models[0].parameters()
                [names.iter().position(|other| *other == name).expect("a parameter")]
        };
        let (dry, viscous) = (of("Fc"), of("Fv"));
        let grown = |log: &Recording| {
            with_torque(log, |k, tau, dq| {
                if k == joint { tau + 0.18 * (dry * dq.signum() + viscous * dq) } else { tau }
            })
        };
        let later = vec![grown(&logs[2]), grown(&logs[3])];
        let found = sessions(&robot, &[("monday", logs[..2].to_vec()), ("tuesday", later.clone())]);
        println!("{joint} {:?}", found.sentences());
        let cause = SessionCause::Friction { joint };
        assert_eq!(changed(&found), vec![cause], "{joint}: {:?}", found.sentences());
        let friction = test_of(&found, cause);
        let change = friction.values[1] / friction.values[0] - 1.0;
        assert!((change - 0.18).abs() < 0.03, "{friction:?}");
        // The model of the session predicts it, that of the other one does not.
        let error = |session: usize| {
            compare(&found.models[session], &later, None).expect("a good log").joints[joint].rmse
        };
        assert!(error(1) < error(0), "{} {}", error(1), error(0));
    }
}

#[test]
fn an_offset_a_gain_and_a_tool_are_told_apart() {
    let (robot, logs) = (robot(), logs());
    let n = robot.dof();
    let first = logs[..2].to_vec();
    let offset: Vec<Recording> = logs[2..]
        .iter()
        .map(|log| with_torque(log, |k, tau, _| if k == 1 { tau + 1.5 } else { tau }))
        .collect();
    let found = sessions(&robot, &[("monday", first.clone()), ("tuesday", offset)]);
    assert_eq!(changed(&found), vec![SessionCause::Offset { joint: 1 }], "{:?}", found.sentences());
    assert!(
        found.sentences()[0].contains("torque offset of joint_2 is 1."),
        "{:?}",
        found.sentences()
    );

    let scaled: Vec<Recording> = logs[2..]
        .iter()
        .map(|log| with_torque(log, |k, tau, _| if k == 1 { 1.05 * tau } else { tau }))
        .collect();
    let found = sessions(&robot, &[("monday", first.clone()), ("tuesday", scaled)]);
    assert_eq!(changed(&found), vec![SessionCause::Gain { joint: 1 }], "{:?}", found.sentences());
    let gain = test_of(&found, SessionCause::Gain { joint: 1 });
    assert!((gain.values[1] / gain.values[0] - 1.05).abs() < 0.01, "{gain:?}");

    // A load of a kilogram a little away from the flange.
    let mut heavier = robot.standard_parameters();
    let last = (n - 1) * PARAMETERS_PER_LINK;
    for (k, value) in [1.0, 0.0, 0.0, 0.05].into_iter().enumerate() {
        heavier[last + k] += value;
    }
    let loaded = robot.clone().with_standard_parameters(&heavier);
    let with_load = |log: &Recording| {
        let (mut with, mut without) = (Workspace::new(&loaded), Workspace::new(&robot));
        let time = log.time_seconds();
        let dq = derivative(log.position(), &time, n);
        let ddq = derivative(&dq, &time, n);
        let rows = log.position().chunks_exact(n).zip(dq.chunks_exact(n)).zip(ddq.chunks_exact(n));
        let added: Vec<f64> = rows
            .flat_map(|((q, dq), ddq)| {
                let heavy = rnea(&loaded, &mut with, q, dq, ddq).to_vec();
                let light = rnea(&robot, &mut without, q, dq, ddq);
                heavy.iter().zip(light).map(|(a, b)| a - b).collect::<Vec<_>>()
            })
            .collect();
        let torque: Vec<f64> =
            log.torque().expect("has torque").iter().zip(&added).map(|(a, b)| a + b).collect();
        let (names, stamps) = (log.joint_names().to_vec(), log.time().to_vec());
        let velocity = log.velocity().map(<[f64]>::to_vec);
        Recording::new(
            "loaded",
            names,
            stamps,
            log.position().to_vec(),
            velocity,
            Some(torque),
            vec![],
        )
        .expect("fits")
    };
    let found = sessions(
        &robot,
        &[("empty", first), ("loaded", logs[2..].iter().map(with_load).collect())],
    );
    println!("{:?}", found.sentences());
    assert_eq!(changed(&found).first(), Some(&SessionCause::Tool), "{:?}", found.sentences());
    let mass = test_of(&found, SessionCause::Tool);
    assert!((mass.values[1] - mass.values[0] - 1.0).abs() < 0.05, "{mass:?}");
}

#[test]
fn a_torque_with_the_other_sign_is_named_with_its_session() {
    let (robot, logs) = (robot(), logs());
    let ask = |given: &[(String, Vec<Recording>)]| {
        let found =
            compare_sessions(&robot, given, &EFFECTS.map(String::from), &Default::default(), &());
        found.expect_err("no gain of a drive").to_string()
    };
    let negated = |log: &Recording, joint: usize| {
        with_torque(log, |k, tau, _| if k == joint { -tau } else { tau })
    };
    for joint in 0..robot.dof() {
        let said = ask(&[
            ("monday".into(), logs[..2].to_vec()),
            ("tuesday".into(), logs[2..].iter().map(|log| negated(log, joint)).collect()),
        ]);
        let name = &robot.joints()[joint].name;
        assert!(
            said.contains(&format!("the torque of {name} has the other sign in `tuesday`,")),
            "{said}"
        );
        assert_eq!(said.matches("has the other sign").count(), 1, "{said}");
    }
    // The first session is the wrong one, of three; and all joints at once.
    let said = ask(&[
        ("monday".into(), vec![negated(&logs[0], 1)]),
        ("tuesday".into(), vec![logs[1].clone()]),
        ("friday".into(), logs[2..].to_vec()),
    ]);
    assert!(said.contains("the torque of joint_2 has the other sign in `monday`,"), "{said}");
    let all = |log: &Recording| with_torque(log, |_, tau, _| -tau);
    let said =
        ask(&[("monday".into(), vec![logs[0].clone()]), ("tuesday".into(), vec![all(&logs[1])])]);
    assert_eq!(said.matches("has the other sign in `tuesday`,").count(), robot.dof(), "{said}");
}

#[test]
fn torques_of_another_sign_or_unit_are_answered_or_refused() {
    let (robot, logs) = (robot(), logs());
    for (joints, factor) in [(1..2, -1.0), (1..2, 1e-30), (0..6, -1.0), (0..6, 1e-30), (0..6, 1e9)]
    {
        let other = with_torque(
            &logs[1],
            |joint, tau, _| if joints.contains(&joint) { factor * tau } else { tau },
        );
        let given =
            [("monday".to_string(), vec![logs[0].clone()]), ("tuesday".to_string(), vec![other])];
        let found =
            compare_sessions(&robot, &given, &EFFECTS.map(String::from), &Default::default(), &());
        match found {
            Ok(found) => assert_ne!(changed(&found), vec![], "{joints:?} {factor}"),
            Err(error) => assert!(error.to_string().len() > 30, "{error}"),
        }
    }
}
