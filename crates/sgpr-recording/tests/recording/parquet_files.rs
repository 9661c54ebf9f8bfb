//! Parquet files and LeRobot data sets that PyArrow wrote (`data/recording/parquet`).

use std::path::{Path, PathBuf};

use sgpr_recording::csv::ReadOptions;
use sgpr_recording::{Recording, RecordingError, lerobot, parquet, read};

use crate::file;

const START: i64 = 1_700_000_000_123_456_789;
const PERIOD: i64 = 10_000_000;
const ROWS: usize = 30;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/recording/parquet").join(name)
}

fn log(name: &str) -> Recording {
    parquet::read(fixture(name), &ReadOptions::default()).expect("a log")
}

/// What `make_fixtures.py` writes: position, velocity and torque of a joint.
fn state(k: usize, joint: usize) -> [f64; 3] {
    let t = k as f64 * PERIOD as f64 * 1e-9;
    let angle = t + joint as f64;
    [angle.sin(), angle.cos(), 10.0 * (joint as f64 + 1.0) - t]
}

/// Of two joints, in rows. The sines of two mathematical libraries may differ in the last digit.
fn is(values: &[f64], quantity: usize, more: f64) {
    assert_eq!(values.len(), 2 * ROWS);
    for (place, value) in values.iter().enumerate() {
        let expected = state(place / 2, place % 2)[quantity] + more;
        assert!((value - expected).abs() < 1e-15 * expected.abs().max(1.0), "{place}: {value}");
    }
}

fn channel<'a>(log: &'a Recording, name: &str) -> &'a [f64] {
    &log.channel(name).expect("a channel").values
}

fn stamps(log: &Recording) -> bool {
    log.time().iter().copied().eq((0..ROWS as i64).map(|k| START + k * PERIOD))
}

#[test]
fn columns_of_every_type_are_exact() {
    let log = log("kinds.parquet");
    assert!(stamps(&log));
    is(log.position(), 0, 0.0);
    is(log.torque().expect("logged"), 2, 0.0);
    for k in 0..ROWS {
        assert_eq!(channel(&log, "float")[k], f64::from(state(k, 0)[1] as f32));
        assert_eq!(channel(&log, "half")[k], k as f64 / 4.0);
        assert_eq!(channel(&log, "decimal")[k], k as f64 / 100.0);
        assert_eq!(channel(&log, "large")[k], (u64::MAX - k as u64) as f64);
        assert_eq!(channel(&log, "enabled")[k], f64::from(u8::from(k % 3 == 0)));
        let whole = channel(&log, "whole")[k];
        assert!(if k == 3 { whole.is_nan() } else { whole == 1000.0 * k as f64 }, "{k}: {whole}");
    }
    assert_eq!(
        log.notes().last().map(String::as_str),
        Some("skipped columns that hold no numbers: note")
    );
}

#[test]
fn durations_are_times_and_holes_no_numbers() {
    let log = log("times.parquet");
    assert!(log.time().iter().copied().eq((0..ROWS as i64).map(|k| k * PERIOD)));
    let missing: Vec<usize> = (0..ROWS).filter(|k| log.position()[*k].is_nan()).collect();
    assert_eq!(missing, [2]);
}

#[test]
fn lists_are_rows() {
    let log = log("lists.parquet");
    assert!(stamps(&log));
    is(log.position(), 0, 0.0);
    is(log.velocity().expect("logged"), 1, 0.0);
    is(log.torque().expect("logged"), 2, 0.0);
    assert_eq!(channel(&log, "load")[5], state(5, 0)[2]);
    let error = parquet::read(fixture("uneven.parquet"), &ReadOptions::default());
    let error = error.expect_err("lists of several lengths").to_string();
    assert!(error.contains("`q` has samples of unequal length"), "{error}");
}

#[test]
fn pieces_make_the_whole() {
    let path = fixture("kinds.parquet");
    let whole = log("kinds.parquet");
    for samples in [1, 4, 7, 11, 100] {
        let pieces = parquet::pieces(&path, samples, &ReadOptions::default()).expect("a file");
        let pieces: Vec<Recording> = pieces.collect::<Result<_, _>>().expect("logs");
        let lengths: Vec<usize> = pieces.iter().map(Recording::len).collect();
        assert!(
            lengths[..lengths.len() - 1].iter().all(|length| *length == samples),
            "{lengths:?}"
        );
        let together = |of: fn(&Recording) -> &[f64]| pieces.iter().flat_map(of).copied().collect();
        let position: Vec<f64> = together(Recording::position);
        assert_eq!(position, whole.position());
        assert!(pieces.iter().flat_map(Recording::time).eq(whole.time()));
    }
    let error = parquet::pieces(&fixture("lists.parquet"), 5, &ReadOptions::default());
    let error = error.err().expect("lists have no pieces").to_string();
    assert!(error.contains("holds lists (position, velocity, effort)"), "{error}");
}

#[test]
fn episodes_of_a_data_set_are_logs() {
    let folder = fixture("lerobot");
    for (episode, offset) in [(0, 0.0), (1, 1.0)] {
        let log = read(folder.join(format!("episode_{episode}")), None).expect("an episode");
        assert_eq!(log.joint_names(), ["shoulder", "elbow"]);
        assert!(log.time().iter().copied().eq((0..ROWS as i64).map(|k| k * PERIOD)));
        is(log.position(), 0, offset);
        is(log.torque().expect("logged"), 2, 0.0);
        assert_eq!(channel(&log, "action command 2")[7], state(7, 1)[1]);
        assert!(log.notes().iter().any(|note| note.ends_with("no rows of numbers: task")));
    }
    for (path, said) in [
        (folder.clone(), "2 episodes; each is a log of its own, from"),
        (folder.join("episode_7"), "there is no episode 7"),
        (folder.join("data/chunk-000/file-000.parquet"), "2 episodes; each is a log"),
    ] {
        let error = read(&path, None).expect_err("no episode").to_string();
        assert!(error.contains(said), "{error}");
    }
    let error = lerobot::read(fixture("."), &ReadOptions::default()).expect_err("no data set");
    assert!(error.to_string().contains("no episode of a LeRobot data set"), "{error}");
}

#[test]
fn what_is_damaged_or_too_large_is_said() {
    let content = std::fs::read(fixture("kinds.parquet")).expect("a fixture");
    for length in [4, 100, content.len() / 2, content.len() - 1] {
        let (_folder, path) = file("log.parquet", &content[..length]);
        let error = read(&path, None).expect_err("truncated");
        assert!(matches!(error, RecordingError::Broken { .. }), "{error}");
        assert!(error.to_string().contains("not a Parquet file, or damaged: "), "{error}");
    }
    for name in ["kinds.parquet", "lists.parquet"] {
        let small = ReadOptions::default().with_limit_bytes(200);
        let error = parquet::read(fixture(name), &small).expect_err("more than that");
        assert!(matches!(error, RecordingError::TooLarge { limit: 200, .. }), "{error}");
    }
    let size = std::fs::metadata(fixture("many.parquet")).expect("a fixture").len();
    let large = ReadOptions::default().with_limit_bytes(1_000_000);
    let error = parquet::read(fixture("many.parquet"), &large).expect_err("16 MB of numbers");
    assert!(size < 10_000 && matches!(error, RecordingError::TooLarge { .. }), "{error}");
    let (_folder, path) = file("log", &content);
    assert_eq!(read(&path, None).expect("told by its beginning").len(), ROWS);
}
