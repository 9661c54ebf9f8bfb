//! Logs of real arms. They are not part of the repository: `SGPR_DATA` names their folder; without
//! it the tests are skipped.

use std::path::{Path, PathBuf};

use sgpr_recording::csv::{self, ReadOptions, Rows};
use sgpr_recording::{IssueKind, Recording, Repair, Resample, inspect, repair};

#[path = "../../../sgpr-core/tests/common/outside.rs"]
mod outside;

/// The folder of the robots' folders, if the logs are there.
fn folder() -> Option<PathBuf> {
    outside::outside("real/panda")?.parent().map(PathBuf::from)
}

fn read(folder: &Path, name: &str, options: &ReadOptions) -> Recording {
    csv::read(folder.join(name), options).expect("a readable log")
}

fn kinds(log: &Recording) -> Vec<IssueKind> {
    inspect(log).into_iter().map(|issue| issue.kind).collect()
}

#[test]
fn panda() {
    let Some(folder) = folder() else { return };
    let log = read(&folder, "panda/train_0_14s.csv", &ReadOptions::default());
    assert_eq!((log.dof(), log.len(), log.time()[1]), (7, 13_778, 1_743_910));
    assert!(log.velocity().is_some() && log.torque().is_some() && log.channels().is_empty());
    let issues = inspect(&log);
    let issue = |kind| issues.iter().find(|issue| issue.kind == kind).expect("found");
    let share = issue(IssueKind::RepeatedSamples).count as f64 / log.len() as f64;
    assert!((0.04..0.07).contains(&share), "{share}");
    assert!(issue(IssueKind::VelocityLag).message.starts_with("the velocity is 5."));
    assert_eq!(issue(IssueKind::Gap).count, 2);
    assert!(kinds(&log).contains(&IssueKind::IrregularSampling));

    let request =
        Repair::default().with_drop_repeated(true).with_resample(Some(Resample::Hz(1000.0)));
    let (parts, actions) = repair(&log, &request).expect("sorted");
    assert!((2..10).contains(&parts.len()) && actions.len() == 3, "{actions:?}");
    for part in &parts {
        assert!(!kinds(part).contains(&IssueKind::IrregularSampling));
    }
    let later = read(&folder, "panda/test_14_21s.csv", &ReadOptions::default());
    assert_eq!(later.time()[0], 14_000_000_000);
}

#[test]
fn ur10e() {
    let Some(folder) = folder() else { return };
    let joints = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];
    let options = ReadOptions::default()
        .with_joints(Some(joints.map(|name| format!("{name}_joint")).to_vec()))
        .with_accept(vec![IssueKind::JointsByOrder])
        .with_torque_constants(Some(vec![10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]))
        .with_rows(Some(Rows::Numbers(635..=3510)));
    let log = read(&folder, "ur10e/excitation_30s_12harm.csv", &options);
    assert_eq!((log.dof(), log.len(), log.channels().len()), (6, 2876, 12));
    assert!(log.channel("tau_des1_Nm").is_some());
    let whole = read(&folder, "ur10e/excitation_30s_12harm.csv", &ReadOptions::default());
    assert!(whole.torque().is_none());
    let current = whole.channel("i2_A").expect("kept").values[634];
    assert!((log.torque().expect("computed")[1] - 10.6956 * current).abs() < 1e-12);
    assert!(kinds(&log).contains(&IssueKind::IrregularSampling));
}

#[test]
fn baxter_and_kuka() {
    let Some(folder) = folder() else { return };
    for name in ["baxter/traj01.csv", "kuka_lwr/traj01.csv"] {
        let log = read(&folder, name, &ReadOptions::default());
        assert_eq!(log.dof(), 7);
        assert!((log.sample_rate_hz().expect("samples") - 100.0).abs() < 1e-9);
        assert!(log.velocity().is_some() && log.torque().is_some());
        assert!(kinds(&log).contains(&IssueKind::VelocityLag));
    }
    let baxter = read(&folder, "baxter/traj01.csv", &ReadOptions::default());
    assert!(kinds(&baxter).contains(&IssueKind::EncoderStep));
}

#[test]
fn emps() {
    let Some(folder) = folder() else { return };
    let options = ReadOptions::default().with_joints(Some(vec!["carriage".into()]));
    let log = read(&folder, "emps/train.csv", &options);
    assert_eq!((log.joint_names(), log.len()), (&["carriage".to_string()][..], 24_841));
    assert_eq!(log.time()[1], 1_000_024);
    assert!((log.torque().expect("force")[0] - 89.234_432).abs() < 1e-12);
    let channels: Vec<&str> = log.channels().iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(channels, ["q_ref_m", "vir_V", "pulse_raw"]);
    assert_eq!(kinds(&log), []);
}
