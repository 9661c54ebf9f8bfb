//! Changes that were asked for.

use sgpr_recording::{Channel, Recording, RecordingError, Repair, Resample, repair, split_at_gaps};

use super::{assert_close, message, names};

const MS: i64 = 1_000_000;

/// A joint at the given milliseconds; the position is the number of the sample.
fn log(milliseconds: &[i64]) -> Recording {
    let position: Vec<f64> = (0..milliseconds.len()).map(|k| k as f64).collect();
    let time = milliseconds.iter().map(|t| t * MS).collect();
    let channels = vec![Channel { name: "temperature".into(), values: position.clone() }];
    Recording::new("log", names(&["a"]), time, position.clone(), None, Some(position), channels)
        .expect("lengths fit")
}

fn one(recording: &Recording, request: &Repair) -> (Recording, Vec<String>) {
    let (mut parts, actions) = repair(recording, request).expect("repairable");
    assert_eq!(parts.len(), 1);
    (parts.remove(0), actions)
}

#[test]
fn nothing_is_done_unasked() {
    let broken = log(&[0, 5, 5, 3]);
    let (same, actions) = one(&broken, &Repair::default());
    assert_eq!(same, broken);
    assert!(actions.is_empty());
}

#[test]
fn sorting_keeps_the_order_of_equal_stamps() {
    let (sorted, actions) = one(&log(&[0, 5, 2, 5]), &Repair::default().with_sort(true));
    assert_eq!(sorted.position(), [0.0, 2.0, 1.0, 3.0]);
    assert_eq!(sorted.channels()[0].values, [0.0, 2.0, 1.0, 3.0]);
    assert_eq!(actions, ["log: sorted by time, 2 of 4 samples moved"]);
}

#[test]
fn duplicates_and_missing_values_are_dropped() {
    let mut position = vec![0.0, 1.0, f64::NAN, 3.0];
    let time = vec![0, 0, MS, 2 * MS];
    let broken = Recording::new("log", names(&["a"]), time, position.clone(), None, None, vec![])
        .expect("fits");
    let request = Repair::default().with_drop_duplicates(true).with_drop_not_finite(true);
    let (clean, actions) = one(&broken, &request);
    assert_eq!(clean.position(), [0.0, 3.0]);
    assert_eq!(
        actions,
        [
            "log: dropped 1 of 4 samples with the stamp of the one before",
            "log: dropped 1 of 3 samples with values that are not finite"
        ]
    );
    position.fill(f64::NAN);
    let broken =
        Recording::new("log", names(&["a"]), vec![0, 1, 2, 3], position, None, None, vec![])
            .expect("fits");
    let error = message(repair(&broken, &request));
    assert_eq!(
        error,
        "log: no sample is left after: dropped 4 of 4 samples with values that are not finite"
    );
}

#[test]
fn repeated_samples_are_dropped_only_in_motion() {
    let moving =
        |k: i64| if k < 50 { 0.0 } else { (k - 50 - i64::from(k % 10 == 0)) as f64 * 0.01 };
    let position: Vec<f64> = (0..100).map(moving).collect();
    let time = (0..100).map(|k| k * MS).collect();
    let log =
        Recording::new("log", names(&["a"]), time, position, None, None, vec![]).expect("fits");
    let (clean, actions) = one(&log, &Repair::default().with_drop_repeated(true));
    assert_eq!(clean.len(), 96);
    assert_eq!(actions, ["log: dropped 4 of 100 samples that repeat the one before"]);
}

#[test]
fn trimming() {
    let (part, actions) =
        one(&log(&[100, 110, 120, 130]), &Repair::default().with_trim(Some(0.01..=0.02)));
    assert_eq!(part.position(), [1.0, 2.0]);
    assert_eq!(actions, ["log: dropped 2 of 4 samples outside 0.01 to 0.02 s"]);
}

#[test]
fn cutting_at_gaps() {
    let gapped = log(&[0, 1, 2, 50, 51, 52, 53]);
    let (parts, actions) =
        repair(&gapped, &Repair::default().with_split_gaps(Some(0.01))).expect("sorted");
    assert_eq!(parts.iter().map(Recording::len).collect::<Vec<_>>(), [3, 4]);
    assert_eq!(actions, ["log: cut at 1 steps longer than 0.010000 s into 3, 4 samples"]);
    assert_eq!(split_at_gaps(&gapped, 5.0).len(), 2);
    assert_eq!(split_at_gaps(&gapped, 100.0).len(), 1);
}

#[test]
fn resampling_never_crosses_gaps() {
    let gapped = log(&[0, 2, 4, 50, 52, 54]);
    let request = Repair::default().with_resample(Some(Resample::Hz(1000.0)));
    let (parts, actions) = repair(&gapped, &request).expect("sorted");
    assert_eq!(parts.iter().map(Recording::len).collect::<Vec<_>>(), [5, 5]);
    assert_close(parts[0].position(), &[0.0, 0.5, 1.0, 1.5, 2.0], 1e-15);
    assert_close(parts[1].torque().expect("given"), &[3.0, 3.5, 4.0, 4.5, 5.0], 1e-15);
    assert_eq!(actions[1], "log: resampled from 6 to 10 samples at 1000.000000 Hz");
}

#[test]
fn resampling_to_the_median_rate() {
    let (even, actions) = one(
        &log(&[0, 10, 21, 30, 40, 50]),
        &Repair::default().with_resample(Some(Resample::MedianRate)),
    );
    assert_eq!(even.time(), [0, 10, 20, 30, 40, 50].map(|t| t * MS));
    assert_eq!(actions, ["log: resampled from 6 to 6 samples at 100.000000 Hz"]);
    assert_eq!(even.sample_rate_hz(), Some(100.0));
}

#[test]
fn a_sine_survives_uneven_sampling() {
    let time: Vec<i64> = (0..500).map(|k| k * 10 * MS + (k * 7919) % 4 * MS).collect();
    let position: Vec<f64> = time.iter().map(|t| (*t as f64 * 1e-9 * 3.0).sin()).collect();
    let log =
        Recording::new("log", names(&["a"]), time, position, None, None, vec![]).expect("fits");
    let (even, _) = one(&log, &Repair::default().with_resample(Some(Resample::Hz(100.0))));
    let expected: Vec<f64> = even.time().iter().map(|t| (*t as f64 * 1e-9 * 3.0).sin()).collect();
    // Cubic interpolation with steps h up to 13 ms: the error is of the order (3 h)^3 / 10 < 1e-5.
    assert_close(even.position(), &expected, 1e-5);
}

#[test]
fn slower_rates_come_with_a_warning() {
    let (_, actions) = one(
        &log(&[0, 1, 2, 3, 4, 5, 6]),
        &Repair::default().with_resample(Some(Resample::Hz(250.0))),
    );
    assert!(actions[0].contains("unless it was filtered away"), "{}", actions[0]);
}

#[test]
fn what_cannot_be_done() {
    let resample = |rate| Repair::default().with_resample(Some(Resample::Hz(rate)));
    let error =
        |log: &Recording, request: Repair| -> String { message::<_>(repair(log, &request)) };
    assert_eq!(
        error(&log(&[0, 5, 5, 9]), resample(100.0)),
        "log: the time does not increase at sample 2 (0.005 s after the start): repair with `sort` \
         and `drop_duplicates` first, or read the parts of a log that was restarted one by one \
         (`rows`)"
    );
    assert!(error(&log(&[0, 1]), resample(-1.0)).starts_with("resample = -1: a rate in Hz"));
    assert!(error(&log(&[0, 1]), resample(1e9)).contains("at most 1000 samples of each one"));
    assert!(
        error(&log(&[0, 1]), Repair::default().with_split_gaps(Some(0.0)))
            .starts_with("split_gaps = 0")
    );
    assert!(
        error(&log(&[0]), Repair::default().with_resample(Some(Resample::MedianRate)))
            .contains("no sample is left after: resampling of a single sample")
    );
}

#[test]
fn arrays_of_wrong_length() {
    let new = |velocity, channels| {
        Recording::new("log", names(&["a"]), vec![0], vec![0.0], velocity, None, channels)
    };
    let error: Result<_, RecordingError> = new(Some(vec![]), vec![]);
    assert_eq!(message(error), "log: `velocity`: got 0 values, expected 1");
    let channel = Channel { name: "x".into(), values: vec![1.0, 2.0] };
    assert_eq!(message(new(None, vec![channel])), "log: `x`: got 2 values, expected 1");
}

#[test]
fn a_sample_that_strayed_before_the_log_is_left_out() {
    let time: Vec<i64> = [0]
        .into_iter()
        .chain((0..100).map(|k| 1_700_000_000_000_000_000 + k * 10_000_000))
        .collect();
    let position: Vec<f64> = (0..101).map(f64::from).collect();
    let log =
        Recording::new("log", names(&["a"]), time, position, None, None, vec![]).expect("fits");
    for request in [
        Repair::default().with_resample(Some(Resample::MedianRate)),
        Repair::default().with_split_gaps(Some(1.0)),
    ] {
        let (parts, actions) = repair(&log, &request).expect("sorted");
        assert_eq!(parts.iter().map(Recording::len).collect::<Vec<_>>(), [100]);
        assert!(
            actions.iter().any(|action| action.contains("left out 1 samples in 1 stretches")),
            "{actions:?}"
        );
    }
}
