//! What an identification must not depend on: the order of the logs, the names of joints, the units
//! that a log was written in, where its clock starts, and which way the axes of the joints point.
#![allow(missing_docs)]

mod common;

use common::data;
use proptest::prelude::*;
use proptest::test_runner::Config;
use sgpr_core::identification::{IRLS, Method};
use sgpr_core::model::{Comparison, IdentifyOptions, TorqueModel, compare, identify};
use sgpr_core::recording::csv::{self, ReadOptions};
use sgpr_core::recording::{PositionUnit, Recording, TimeUnit, TorqueUnit, Units, VelocityUnit};
use sgpr_core::robot::{Robot, UrdfOptions};

/// Rounding: the condition number of the equations, some hundreds, times that of the sums over
/// thousands of rows.
const ROUNDING: f64 = 1e-9;

fn robot() -> Robot {
    Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled")
}

fn read(name: &str) -> Recording {
    csv::read(data(&format!("demo/{name}.csv.gz")), &Default::default()).expect("bundled")
}

/// Parts of the bundled logs, with 4 s each.
fn train() -> Vec<Recording> {
    ["train_1", "train_2", "train_3"].map(|name| read(name).slice(500..1500)).to_vec()
}

fn options(method: Method) -> IdentifyOptions {
    let effects =
        ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    IdentifyOptions::default().with_effects(effects).with_method(method)
}

fn fitted(robot: &Robot, logs: &[Recording], method: Method) -> TorqueModel {
    identify(robot, logs, &options(method), &()).expect("good logs").0
}

fn methods() -> impl Strategy<Value = Method> {
    prop_oneof![Just(Method::Ols), Just(Method::Wls), Just(IRLS.with(1.345))]
}

/// Errors per joint on a log that no fit has seen.
fn errors(model: &TorqueModel) -> Vec<f64> {
    let Comparison { joints, .. } =
        compare(model, &[with_names(&read("test"), model.robot())], None).expect("a good log");
    joints.iter().map(|joint| joint.rmse).collect()
}

fn with_names(log: &Recording, robot: &Robot) -> Recording {
    log.clone().with_joint_names(robot.joint_names().map(String::from).collect()).expect("one each")
}

/// Values of base parameters and their deviations, the numbers of a fit.
fn numbers(model: &TorqueModel) -> Vec<[f64; 2]> {
    let fit = model.fit().expect("identified");
    fit.values
        .iter()
        .zip(&fit.standard_deviations)
        .map(|(value, deviation)| [*value, *deviation])
        .collect()
}

/// Whether two fits agree up to rounding, each number in units of its deviation or size.
fn same(a: &TorqueModel, b: &TorqueModel) -> Result<(), TestCaseError> {
    let (first, second) = (numbers(a), numbers(b));
    prop_assert_eq!(first.len(), second.len());
    for (k, ([value, deviation], [other, other_deviation])) in
        first.into_iter().zip(second).enumerate()
    {
        let name = &a.base().names()[k];
        let scale = value.abs() + deviation;
        prop_assert!((value - other).abs() <= ROUNDING * scale, "{}: {} {}", name, value, other);
        let apart = (deviation - other_deviation).abs();
        prop_assert!(
            apart <= 1e-6 * deviation,
            "deviation of {}: {} {}",
            name,
            deviation,
            other_deviation
        );
    }
    for (error, other) in errors(a).into_iter().zip(errors(b)) {
        prop_assert!((error - other).abs() <= ROUNDING * error, "{} {}", error, other);
    }
    Ok(())
}

/// The robot under other names.
fn renamed(robot: &Robot, names: &[String]) -> Robot {
    let joints = robot.joints().iter().zip(names).map(|(joint, name)| {
        let mut joint = joint.clone();
        joint.name.clone_from(name);
        joint
    });
    Robot::new(robot.name(), joints.collect(), robot.links().to_vec(), vec![], robot.gravity())
        .expect("other names")
}

/// The robot whose joints count the other way where `reversed`.
fn turned(robot: &Robot, reversed: &[bool]) -> Robot {
    let joints = robot.joints().iter().zip(reversed).map(|(joint, reversed)| {
        let mut joint = joint.clone();
        joint.axis = if *reversed { joint.axis * -1.0 } else { joint.axis };
        joint
    });
    Robot::new(robot.name(), joints.collect(), robot.links().to_vec(), vec![], robot.gravity())
        .expect("other axes")
}

fn turned_log(log: &Recording, reversed: &[bool]) -> Recording {
    let sign = |values: &[f64]| {
        let turn = |(value, reversed): (&f64, &bool)| if *reversed { -value } else { *value };
        values.iter().zip(reversed.iter().cycle()).map(turn).collect::<Vec<_>>()
    };
    let (names, time) = (log.joint_names().to_vec(), log.time().to_vec());
    let (velocity, torque) = (log.velocity().map(sign), log.torque().map(sign));
    Recording::new(log.source(), names, time, sign(log.position()), velocity, torque, vec![])
        .expect("one length")
}

fn shifted(log: &Recording, by: i64) -> Recording {
    let time = log.time().iter().map(|time| time + by).collect();
    let (position, velocity, torque) = (log.position().to_vec(), log.velocity(), log.torque());
    let names = log.joint_names().to_vec();
    let [velocity, torque] = [velocity, torque].map(|values| values.map(<[f64]>::to_vec));
    Recording::new(log.source(), names, time, position, velocity, torque, vec![])
        .expect("one length")
}

/// Written in other units, every digit of it, and read with these units named.
fn through_units(log: &Recording) -> Recording {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(log.source().rsplit('/').next().expect("a name"));
    let n = log.dof();
    let columns = |ending: &str| {
        (0..n).map(|joint| format!("{ending}_{}", joint + 1)).collect::<Vec<_>>().join(",")
    };
    let mut text = format!("t,{},{},{}\n", columns("q"), columns("dq"), columns("tau"));
    let (dq, tau) = (log.velocity().expect("logged"), log.torque().expect("logged"));
    for k in 0..log.len() {
        let row = k * n..(k + 1) * n;
        // Milliseconds have six digits after the point.
        text += &format!("{}.{:06}", log.time()[k] / 1_000_000, log.time()[k] % 1_000_000);
        let degrees = log.position()[row.clone()].iter().map(|q| q.to_degrees());
        let rpm = dq[row.clone()].iter().map(|dq| dq * 60.0 / std::f64::consts::TAU);
        let milli = tau[row].iter().map(|tau| 1e3 * tau);
        degrees.chain(rpm).chain(milli).for_each(|value| text += &format!(",{value}"));
        text.push('\n');
    }
    std::fs::write(&path, text).expect("writable");
    let units = Units::default()
        .with_time(Some(TimeUnit::Millisecond))
        .with_position(Some(PositionUnit::Degree))
        .with_velocity(Some(VelocityUnit::Rpm))
        .with_torque(Some(TorqueUnit::MillinewtonMetre));
    csv::read(&path, &ReadOptions::default().with_units(units)).expect("readable")
}

proptest! {
    #![proptest_config(Config { cases: 6, failure_persistence: None, ..Config::default() })]

    #[test]
    fn logs_are_a_set(order in Just(vec![0usize, 1, 2]).prop_shuffle(), method in methods()) {
        let (robot, logs) = (robot(), train());
        let shuffled: Vec<Recording> = order.iter().map(|k| logs[*k].clone()).collect();
        same(&fitted(&robot, &logs, method.clone()), &fitted(&robot, &shuffled, method))?;
    }

    #[test]
    fn names_of_joints_are_names(method in methods(), names in prop::collection::hash_set("\\PC{1,12}", 6)) {
        let (robot, logs) = (robot(), train());
        let names: Vec<String> = names.into_iter().collect();
        let other = renamed(&robot, &names);
        let other_logs: Vec<Recording> = logs.iter().map(|log| with_names(log, &other)).collect();
        same(&fitted(&robot, &logs, method.clone()), &fitted(&other, &other_logs, method))?;
    }

    #[test]
    fn clocks_may_start_anywhere(by in prop::num::i64::ANY, method in methods()) {
        let (robot, logs) = (robot(), train());
        // Half of the range: stamps stay numbers of 64 bits.
        let later: Vec<Recording> = logs.iter().map(|log| shifted(log, by / 2)).collect();
        same(&fitted(&robot, &logs, method.clone()), &fitted(&robot, &later, method))?;
    }

    #[test]
    fn axes_may_point_either_way(reversed in prop::collection::vec(any::<bool>(), 6), method in methods()) {
        let (robot, logs) = (robot(), train());
        let (other, test) = (turned(&robot, &reversed), turned_log(&read("test"), &reversed));
        let other_logs: Vec<Recording> = logs.iter().map(|log| turned_log(log, &reversed)).collect();
        // An error is a difference of torques, which rounding follows where a prior weighs its terms.
        let bare = options(method.clone()).with_prior(None);
        for (options, is_bare) in [(bare, true), (options(method), false)] {
            let fit = |robot, logs: &[Recording]| identify(robot, logs, &options, &()).expect("good logs").0;
            let found = [
                compare(&fit(&robot, &logs), &[read("test")], None).expect("a good log"),
                compare(&fit(&other, &other_logs), std::slice::from_ref(&test), None).expect("a good log"),
            ];
            for (one, other) in found[0].joints.iter().zip(&found[1].joints) {
                let size = if is_bare { one.rmse } else { one.rmse_zero };
                prop_assert!((one.rmse - other.rmse).abs() <= ROUNDING * size, "{:?} {:?}", one, other);
            }
        }
    }
}

#[test]
fn units_are_converted_without_loss() {
    let (robot, logs) = (robot(), train());
    let converted: Vec<Recording> = logs.iter().map(through_units).collect();
    for (log, converted) in logs.iter().zip(&converted) {
        assert_eq!(log.time(), converted.time());
    }
    same(&fitted(&robot, &logs, Method::Wls), &fitted(&robot, &converted, Method::Wls))
        .expect("the same");
}

#[test]
fn copies_and_overlaps_count_once() {
    let (robot, logs) = (robot(), train());
    let renamed = logs[0].clone().with_source("a copy");
    let overlap = logs[1].slice(logs[1].len() / 3..logs[1].len() / 2);
    let more: Vec<Recording> = logs.iter().cloned().chain([renamed, overlap]).collect();
    let fit =
        |logs: &[Recording]| identify(&robot, logs, &options(Method::Wls), &()).expect("good logs");
    let ((once, _), (again, report)) = (fit(&logs), fit(&more));
    assert_eq!(once.parameters(), again.parameters());
    assert_eq!(
        once.fit().expect("identified").covariance,
        again.fit().expect("identified").covariance
    );
    let said: Vec<&String> =
        report.warnings.iter().filter(|warning| warning.contains("would count twice")).collect();
    assert_eq!(said.len(), 2, "{:?}", report.warnings);
}

#[test]
fn every_motion_again_says_the_same_more_surely() {
    let (robot, logs) = (robot(), train());
    // The same motion, run again: other noise, which is too small to matter, so that no sample is
    // the same.
    let again = |log: &Recording, time: usize| {
        let scale = 1.0 + 1e-13 * time as f64;
        let tau = log.torque().expect("measured").iter().map(|tau| tau * scale).collect();
        let (names, time, q) =
            (log.joint_names().to_vec(), log.time().to_vec(), log.position().to_vec());
        let dq = log.velocity().map(<[f64]>::to_vec);
        Recording::new("again", names, time, q, dq, Some(tau), vec![])
            .expect("arrays of one length")
    };
    let times = |count: usize| -> Vec<Recording> {
        (0..count).flat_map(|time| logs.iter().map(move |log| again(log, time))).collect()
    };
    // Of fewer rows the parameters take a share that counts, and a prior counts less beside more.
    let bare = options(Method::Ols).with_prior(None);
    let [once, twice] =
        [8, 16].map(|count| identify(&robot, &times(count), &bare, &()).expect("good logs").0);
    for (k, ([value, deviation], [other, smaller])) in
        numbers(&once).into_iter().zip(numbers(&twice)).enumerate()
    {
        let name = &once.base().names()[k];
        assert!(
            (value - other).abs() <= ROUNDING * (value.abs() + deviation),
            "{name}: {value} {other}"
        );
        // Twice the rows of the same noise: a variance of half, but for the parameters that the
        // noise counts.
        assert!(
            (deviation / smaller / 2f64.sqrt() - 1.0).abs() < 0.05,
            "{name}: {deviation} {smaller}"
        );
    }
}
