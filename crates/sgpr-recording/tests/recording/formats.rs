//! Files whose format is told by their name or their beginning.

use std::path::Path;

use sgpr_recording::mcap::McapOptions;
use sgpr_recording::{Recording, RecordingError, csv, mcap, read};

fn log() -> Recording {
    let time = (0..50).map(|k| 1_000_000_000 + k * 10_000_000).collect();
    let position: Vec<f64> = (0..100).map(|k| (0.1 * f64::from(k)).sin()).collect();
    let torque = position.iter().map(|q| 3.0 * q).collect();
    let names = vec!["shoulder".into(), "elbow".into()];
    Recording::new("log", names, time, position, None, Some(torque), vec![]).expect("one length")
}

fn same(found: &Recording, joints: &[&str]) {
    let log = log();
    assert_eq!(found.joint_names(), joints);
    for (column, joint) in joints.iter().enumerate() {
        let own =
            log.joint_names().iter().position(|name| name == joint).expect("a joint of the log");
        let of = |recording: &Recording, column: usize| -> Vec<f64> {
            recording.position().iter().skip(column).step_by(recording.dof()).copied().collect()
        };
        assert_eq!(of(found, column), of(&log, own));
    }
    assert_eq!(found.len(), log.len());
}

#[test]
fn name_or_beginning_tell_the_format() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let write_csv = |path: &Path| csv::write(path, &log()).expect("a writable folder");
    let write_mcap =
        |path: &Path| mcap::write(path, &[("/joint_states", &log())]).expect("a writable folder");
    for name in ["log.csv", "LOG.TXT", "log.csv.gz"] {
        write_csv(&at(name));
        same(&read(at(name), None).expect("a table"), &["shoulder", "elbow"]);
    }
    write_mcap(&at("log.mcap"));
    write_mcap(&at("log"));
    for name in ["log.mcap", "log"] {
        same(&read(at(name), None).expect("a bag"), &["shoulder", "elbow"]);
        same(&read(at(name), Some(vec!["elbow".into()])).expect("a bag"), &["elbow"]);
    }
    same(&read(at("log.csv"), Some(vec!["elbow".into()])).expect("a table"), &["elbow"]);
}

#[test]
fn a_folder_with_one_mcap_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = read(folder.path(), None).expect_err("no log").to_string();
    let folders = "neither a ROS 2 bag (metadata.yaml, or one MCAP file) nor a LeRobot data set \
                   (meta/info.json)";
    assert!(text.ends_with(folders), "{text}");
    let path = folder.path().join("bag_0.mcap");
    mcap::write(&path, &[("/joint_states", &log())]).expect("a writable folder");
    std::fs::write(folder.path().join("metadata.yaml"), "").expect("a writable folder");
    let found = read(folder.path(), None).expect("a bag");
    same(&found, &["shoulder", "elbow"]);
    assert_eq!(found.source(), path.display().to_string());
    // Two of them are more than MCAP.
    std::fs::copy(&path, folder.path().join("bag_1.mcap")).expect("a writable folder");
    let result = mcap::read(folder.path(), &McapOptions::default());
    assert!(matches!(result, Err(RecordingError::Unreadable { .. })));
}

#[cfg(unix)]
#[test]
fn pipes_are_not_waited_for() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["log.csv", "log"] {
        let path = folder.path().join(name);
        let made = std::process::Command::new("mkfifo").arg(&path).status();
        assert!(made.is_ok_and(|status| status.success()));
        let text = read(path, None).expect_err("no file").to_string();
        assert!(text.ends_with("not a file: write what comes out of it to a file"), "{text}");
    }
}

#[test]
fn what_is_no_log_is_told_with_what_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("notes.docx");
    std::fs::write(&path, "PK").expect("a writable folder");
    let error = read(&path, None).expect_err("no log");
    assert!(matches!(error, RecordingError::UnknownFormat { .. }), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("notes.docx") && text.contains(".csv") && text.contains(".mcap"),
        "{text}"
    );
    let missing = read(folder.path().join("none"), None).expect_err("no file");
    assert!(matches!(missing, RecordingError::Unreadable { .. }), "{missing}");
}
