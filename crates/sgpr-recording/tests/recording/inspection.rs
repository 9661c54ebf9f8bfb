//! What is found in logs that are made to have it.

use sgpr_recording::{
    Channel, Issue, IssueKind, Recording, Repair, Resample, Severity, inspect, refusals, repair,
};

use super::names;

const MS: i64 = 1_000_000;

/// Two joints that swing, 20 s at 100 Hz.
struct Log {
    time: Vec<i64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    torque: Vec<f64>,
}

impl Log {
    fn new() -> Self {
        Self::with_time((0..2000).map(|k| k * 10 * MS).collect())
    }

    fn with_time(time: Vec<i64>) -> Self {
        let values = |f: fn(f64, f64) -> f64| -> Vec<f64> {
            let seconds = time.iter().map(|t| *t as f64 * 1e-9);
            seconds.flat_map(|t| [f(t, 1.0), f(t, 1.7)]).collect()
        };
        let position = values(|t, w| (w * t).sin() + 0.3 * (3.1 * w * t).cos());
        let velocity = values(|t, w| w * (w * t).cos() - 0.93 * w * (3.1 * w * t).sin());
        let torque = values(|t, w| 5.0 * (w * t + 0.4).sin());
        Self { time, position, velocity, torque }
    }

    fn recording(&self) -> Recording {
        let (velocity, torque) = (Some(self.velocity.clone()), Some(self.torque.clone()));
        let joints = names(&["a", "b"]);
        Recording::new(
            "log",
            joints,
            self.time.clone(),
            self.position.clone(),
            velocity,
            torque,
            vec![],
        )
        .expect("fits")
    }

    fn issues(&self) -> Vec<Issue> {
        inspect(&self.recording())
    }

    /// The only issue.
    fn issue(&self) -> Issue {
        let mut issues = self.issues();
        assert_eq!(issues.len(), 1, "{issues:#?}");
        issues.remove(0)
    }
}

fn kinds(issues: &[Issue]) -> Vec<IssueKind> {
    issues.iter().map(|issue| issue.kind).collect()
}

#[test]
fn a_clean_log() {
    assert_eq!(Log::new().issues(), []);
}

#[test]
fn values_that_are_not_finite() {
    let mut log = Log::new();
    log.velocity[2 * 100 + 1] = f64::NAN;
    log.velocity[2 * 300 + 1] = f64::INFINITY;
    let issue = log.issue();
    assert_eq!(
        (issue.kind, issue.severity, issue.count),
        (IssueKind::NotFinite, Severity::Warning, 2)
    );
    assert_eq!((issue.time, issue.channel.as_deref()), (Some(1.0), Some("b_velocity")));
    assert_eq!(
        issue.message,
        "`b_velocity` is missing or not finite in 2 samples (0.10 %), first in sample 100: drop \
         these samples (repair: drop_not_finite)"
    );
}

#[test]
fn positions_and_torques_must_be_finite() {
    for array in 0..2 {
        let mut log = Log::new();
        [&mut log.position, &mut log.torque][array][201] = f64::NAN;
        assert_eq!(
            (log.issue().kind, log.issue().severity),
            (IssueKind::NotFinite, Severity::Error)
        );
    }
}

#[test]
fn gaps_in_channels_are_only_notes() {
    let channels = vec![Channel { name: "temperature".into(), values: vec![f64::NAN, 1.0] }];
    let log =
        Recording::new("log", names(&["a"]), vec![0, MS], vec![0.0, 1.0], None, None, channels)
            .expect("fits");
    assert!(inspect(&log).iter().all(|issue| issue.severity == Severity::Note));
}

#[test]
fn time_that_runs_backwards() {
    let mut log = Log::new();
    log.time.swap(700, 701);
    let issues = log.issues();
    assert_eq!(kinds(&issues), [IssueKind::TimeBackwards]);
    assert_eq!(
        (issues[0].severity, issues[0].time, issues[0].count),
        (Severity::Error, Some(7.0), 1)
    );
    assert!(
        issues[0]
            .message
            .starts_with("the time runs backwards 1 time, first by 10.000 ms at sample 701: sort")
    );
}

#[test]
fn equal_stamps() {
    let mut log = Log::new();
    log.time[500] = log.time[499];
    let issue = log.issue();
    assert_eq!(
        (issue.kind, issue.severity, issue.count),
        (IssueKind::DuplicateStamps, Severity::Error, 1)
    );
}

#[test]
fn a_clock_of_whole_seconds() {
    let log = Log { time: (0..2000).map(|k| k / 100 * 1000 * MS).collect(), ..Log::new() };
    let issue = log.issue();
    assert_eq!(
        (issue.kind, issue.severity, issue.count),
        (IssueKind::DuplicateStamps, Severity::Error, 1980)
    );
    assert!(
        issue.message.contains("a resolution of 1.000 s")
            && issue.message.contains("`sample_rate_hz`"),
        "{issue:?}"
    );
    assert_eq!(kinds(&refusals(&log.recording())), [IssueKind::DuplicateStamps]);
    // A logger that writes each sample three times has another remedy.
    let (mut log, each) = (Log::new(), Log::new());
    for k in 0..2000 {
        log.time[k] = each.time[k / 3];
        for (values, of_each) in
            [(&mut log.position, &each.position), (&mut log.velocity, &each.velocity)]
        {
            values[2 * k..2 * k + 2].copy_from_slice(&of_each[k / 3 * 2..k / 3 * 2 + 2]);
        }
    }
    let found = log
        .issues()
        .into_iter()
        .find(|issue| issue.kind == IssueKind::DuplicateStamps)
        .expect("found");
    assert!(found.message.contains("(repair: drop_duplicates)"), "{found:?}");
}

#[test]
fn repeated_samples() {
    let mut log = Log::new();
    for k in (100..2000).step_by(16) {
        for values in [&mut log.position, &mut log.velocity, &mut log.torque] {
            values.copy_within(2 * k - 2..2 * k, 2 * k);
        }
    }
    let issues = log.issues();
    assert_eq!(kinds(&issues), [IssueKind::RepeatedSamples]);
    // Of 119, some may fall on a turn of both joints.
    assert!((115..=119).contains(&issues[0].count) && issues[0].time == Some(1.0), "{issues:?}");
    assert!(
        issues[0].message.contains("repeat all values of the one before"),
        "{}",
        issues[0].message
    );
}

#[test]
fn samples_that_are_held() {
    let mut log = Log::new();
    for values in [&mut log.position, &mut log.velocity, &mut log.torque] {
        let held = values.clone();
        (0..2000).for_each(|k| {
            values[2 * k..2 * k + 2].copy_from_slice(&held[k / 4 * 8..k / 4 * 8 + 2])
        });
    }
    let silent = refusals(&log.recording());
    assert_eq!(kinds(&silent), [IssueKind::RepeatedSamples]);
    // At turns of both joints some stay, as an arm may well rest there.
    let request =
        Repair::default().with_drop_repeated(true).with_resample(Some(Resample::MedianRate));
    let (parts, _) = repair(&log.recording(), &request).expect("a log");
    assert_eq!(refusals(&parts[0]), []);
}

#[test]
fn an_arm_at_rest_does_not_repeat_samples() {
    let mut log = Log::new();
    for values in [&mut log.position, &mut log.velocity, &mut log.torque] {
        let last = [values[2000], values[2001]];
        values[2000..].chunks_mut(2).for_each(|row| row.copy_from_slice(&last));
    }
    let repeated = |issue: &&Issue| issue.kind == IssueKind::RepeatedSamples;
    let issues = log.issues();
    assert!(issues.iter().filter(repeated).all(|issue| issue.count < 10), "{issues:#?}");
}

#[test]
fn long_steps() {
    let mut log = Log::new();
    log.time[1000..].iter_mut().for_each(|time| *time += 500 * MS);
    let issues = log.issues();
    let gap = issues.iter().find(|issue| issue.kind == IssueKind::Gap).expect("found");
    assert_eq!((gap.count, gap.time), (1, Some(10.5)));
    assert!(gap.message.starts_with(
        "1 gap, the longest of 510.000 ms (a gap is a step longer than 5 median steps of 10.000 ms)"
    ));
}

#[test]
fn irregular_steps() {
    let log = Log::with_time(
        (0..2000).map(|k| k * 10 * MS + if k % 3 == 0 { 4 * MS } else { 0 }).collect(),
    );
    let issue = log.issue();
    assert_eq!((issue.kind, issue.severity), (IssueKind::IrregularSampling, Severity::Error));
    assert!(
        issue.message.contains("1 % to 99 % of the steps 6.000 ms to 14.000 ms"),
        "{}",
        issue.message
    );
    assert!(
        issue
            .message
            .contains("67 % of the steps are off by more than 10 %, 0.00 % by more than 50 %")
    );
    assert!(
        issue
            .message
            .ends_with("too irregular to differentiate, resample first (resample: 100 Hz)")
    );
}

#[test]
fn a_time_in_the_wrong_unit() {
    let log = Log::with_time((0..2000).map(|k| k * 10_000 * 1000 * MS).collect());
    let issues = log.issues();
    let issue = issues
        .iter()
        .find(|issue| issue.kind == IssueKind::UnlikelyRate)
        .expect("hours from sample to sample");
    assert_eq!(issue.severity, Severity::Error);
    assert_eq!(
        issue.message,
        "the median step is 10000 s, and no joint is faster than 2.1e-4 rad/s (m/s): if the log is \
         not that slow, give the unit of the time with `units.time`; if it is, confirm it (accept: \
         unlikely_rate)"
    );
    assert_eq!(kinds(&refusals(&log.recording())), [IssueKind::UnlikelyRate]);
    let accepted = log.recording().accepting(&[IssueKind::UnlikelyRate]);
    assert_eq!(refusals(&accepted), []);
    assert!(
        inspect(&accepted).iter().all(|issue| issue.severity < Severity::Error),
        "{:?}",
        inspect(&accepted)
    );
    // Milliseconds of a fast log are no long steps, but then no joint moves.
    let mut log = Log::with_time((0..2000).map(|k| k * 100 * MS).collect());
    log.position.iter_mut().for_each(|q| *q *= 1e-3);
    log.velocity.iter_mut().for_each(|dq| *dq *= 1e-3);
    assert!(kinds(&log.issues()).contains(&IssueKind::UnlikelyRate));
    let log = Log::with_time((0..2000).map(|k| k * 100 * MS).collect());
    assert!(!kinds(&log.issues()).contains(&IssueKind::UnlikelyRate));
    // What steps say of velocities waits until the unit of the time is known.
    let mut log = Log::new();
    log.time.iter_mut().for_each(|time| *time *= 1000);
    assert_eq!(kinds(&log.issues()), [IssueKind::UnlikelyRate]);
}

#[test]
fn a_position_that_is_wrapped_to_a_turn() {
    let mut log = Log::new();
    log.position
        .iter_mut()
        .step_by(2)
        .for_each(|q| *q -= if *q > 0.8 { std::f64::consts::TAU } else { 0.0 });
    let issues = log.issues();
    let issue =
        issues.iter().find(|issue| issue.kind == IssueKind::PositionJump).expect("it jumps");
    assert_eq!((issue.severity, issue.channel.as_deref()), (Severity::Error, Some("a_position")));
    assert!(issue.message.starts_with("`a_position` jumps by a full turn "), "{}", issue.message);
    assert!(
        issue.message.ends_with(" after the start: unwrap it (repair: unwrap)"),
        "{}",
        issue.message
    );
    assert_eq!(kinds(&refusals(&log.recording())), [IssueKind::PositionJump]);
    let request = Repair::default().with_unwrap(true);
    let (parts, actions) = repair(&log.recording(), &request).expect("a log");
    let whole = Log::new().recording();
    assert!(parts[0].position().iter().zip(whole.position()).all(|(a, b)| (a - b).abs() < 1e-12));
    assert!(actions[0].ends_with("jumps by a full turn"), "{actions:?}");
    let mut log = Log::new();
    log.position.iter_mut().skip(2001).step_by(2).for_each(|q| *q += 1.0);
    let issues = log.issues();
    let issue =
        issues.iter().find(|issue| issue.kind == IssueKind::PositionJump).expect("it jumps");
    assert_eq!((issue.channel.as_deref(), issue.count), (Some("b_position"), 1));
    assert!(issue.message.contains("jumps 1 time, first by 0.985 rad"), "{}", issue.message);
    assert!(
        issue.message.contains("within 10.000 ms 10.000 s after the start"),
        "{}",
        issue.message
    );
    // What differs from a turn by more than the joint moves is none, and is not taken back as one.
    let mut log = Log::new();
    log.position
        .iter_mut()
        .step_by(2)
        .for_each(|q| *q -= if *q > 0.8 { std::f64::consts::TAU + 0.3 } else { 0.0 });
    let issues = log.issues();
    let issue =
        issues.iter().find(|issue| issue.kind == IssueKind::PositionJump).expect("it jumps");
    assert!(
        issue.severity == Severity::Warning && !issue.message.contains("turn"),
        "{}",
        issue.message
    );
    let (parts, _) = repair(&log.recording(), &request).expect("a log");
    assert_eq!(parts[0].position(), log.position);
}

#[test]
fn samples_that_stray_are_told_and_replaced() {
    let request = Repair::default().with_replace_strays(true);
    // A position beyond all turns is no unit, and one that is near is as bad: its derivatives are
    // not.
    for by in [999.0, -0.3] {
        let mut log = Log::new();
        log.position[1000] += by;
        log.velocity.clear();
        let joints = names(&["a", "b"]);
        let recording =
            Recording::new("log", joints, log.time, log.position, None, Some(log.torque), vec![])
                .expect("fits");
        let found = refusals(&recording);
        assert_eq!(kinds(&found), [IssueKind::StraySample]);
        assert_eq!((found[0].channel.as_deref(), found[0].count), (Some("a_position"), 1));
        assert!(
            found[0].message.contains("strays in 1 sample, first 5.000 s after the start"),
            "{}",
            found[0].message
        );
        assert_eq!(kinds(&inspect(&recording)), [IssueKind::StraySample]);
        let (parts, actions) = repair(&recording, &request).expect("a log");
        assert_eq!(
            actions,
            ["log: replaced 1 of 2000 samples that stray by what lies between the others"]
        );
        assert_eq!(refusals(&parts[0]), []);
        let furthest =
            parts[0].position().iter().zip(Log::new().position).map(|(new, old)| (new - old).abs());
        assert!(furthest.fold(0.0, f64::max) < 1e-4);
        assert_eq!(refusals(&recording.clone().accepting(&[IssueKind::StraySample])), []);
    }
    // Of the torque, at the end of the log, and in more places than one.
    let mut log = Log::new();
    [(300, 40.0), (1000, -60.0), (1999, 200.0)]
        .iter()
        .for_each(|(sample, by)| log.torque[2 * sample + 1] += by);
    let issue = log.issue();
    assert_eq!(
        (issue.kind, issue.severity, issue.count),
        (IssueKind::StraySample, Severity::Error, 3)
    );
    assert_eq!((issue.channel.as_deref(), issue.time), (Some("b_torque"), Some(3.0)));
    let (parts, actions) = repair(&log.recording(), &request).expect("a log");
    assert!(actions[0].ends_with(
        "replaced 2 of 2000 samples that stray by what lies between the others, and dropped 1 \
             at the ends"
    ));
    assert_eq!((parts[0].len(), refusals(&parts[0])), (1999, vec![]));
    // Of the velocity, which models do not learn from.
    let mut log = Log::new();
    log.velocity[1000] = -50.0;
    assert_eq!(
        (log.issue().kind, log.issue().severity),
        (IssueKind::StraySample, Severity::Warning)
    );
}

#[test]
fn what_comes_again_or_stays_does_not_stray() {
    // Knocks that are not alone, a step of the torque, an encoder that counts one step to and fro,
    // the start of a motion.
    let mut log = Log::new();
    (0..10).for_each(|k| log.torque[400 * k + 100] += 8.0 + 2.0 * k as f64);
    log.torque.iter_mut().skip(2001).step_by(2).for_each(|tau| *tau += 50.0);
    assert_eq!(log.issues(), []);
    let mut log = Log::new();
    log.position.iter_mut().step_by(2).for_each(|q| *q = 0.3);
    log.velocity.iter_mut().step_by(2).for_each(|v| *v = 0.0);
    log.position[1000] += 0.001;
    assert_eq!(kinds(&log.issues()), [IssueKind::StillJoint]);
    let mut log = Log::new();
    for sample in 0..2000 {
        let beyond = (sample as f64 - 1990.0).max(0.0);
        log.position[2 * sample] = 0.01 * beyond * beyond;
        log.velocity[2 * sample] = 2.0 * beyond;
    }
    assert_eq!(refusals(&log.recording()), []);
}

#[test]
fn numbers_that_overflow() {
    let wrapped =
        |value: f64, step: f64| ((value / step).round() + 32768.0).rem_euclid(65536.0) - 32768.0;
    let mut log = Log::new();
    // 16 bits of 0.1 mN·m reach to 3.2768 N·m, of the 5 N·m that there are.
    log.torque.iter_mut().step_by(2).for_each(|tau| *tau = 1e-4 * wrapped(*tau, 1e-4));
    let silent = refusals(&log.recording());
    assert_eq!(kinds(&silent), [IssueKind::Overflow]);
    assert_eq!(silent[0].channel.as_deref(), Some("a_torque"));
    assert!(silent[0].message.contains("65536 steps of 1.000e-4"), "{}", silent[0].message);
    // The same range in the same steps without a passage from end to end.
    let mut log = Log::new();
    log.torque.iter_mut().step_by(2).for_each(|tau| *tau = 1e-4 * (*tau * 0.65536e4).round());
    assert_eq!(log.issues(), []);
    let mut log = Log::new();
    log.position.iter_mut().step_by(2).for_each(|q| *q = 3e-5 * wrapped(*q, 3e-5));
    assert!(kinds(&refusals(&log.recording())).contains(&IssueKind::Overflow));
}

#[test]
fn a_joint_that_does_not_move() {
    let mut log = Log::new();
    log.position.iter_mut().skip(1).step_by(2).for_each(|q| *q = 0.7);
    let issue = log.issue();
    assert_eq!((issue.kind, issue.channel.as_deref()), (IssueKind::StillJoint, Some("b_position")));
    assert!(issue.message.starts_with("1 of 2 joints moves less than 0.002 rad (m): `b`"));
    log.position.fill(0.0);
    assert!(log.issues()[0].message.starts_with("the arm stands still"));
}

#[test]
fn positions_in_degrees() {
    let mut log = Log::new();
    log.position.iter_mut().for_each(|q| *q = q.to_degrees());
    let issues = log.issues();
    assert_eq!(kinds(&issues), [IssueKind::PositionInDegrees; 2]);
    assert!(
        issues[0].message.contains("changes 57.3 times as fast as the velocity says"),
        "{}",
        issues[0].message
    );
    assert_eq!(issues[0].severity, Severity::Error);
    assert_eq!(kinds(&refusals(&log.recording())), [IssueKind::PositionInDegrees; 2]);
    let accepted = log.recording().accepting(&[IssueKind::PositionInDegrees]);
    assert_eq!(refusals(&accepted), []);
    assert!(!issues[0].message.contains("other joints"), "{}", issues[0].message);
    // One of two: a unit for all would be as wrong.
    let mut one = Log::new();
    one.position.iter_mut().step_by(2).for_each(|q| *q = q.to_degrees());
    let issue = one.issue();
    assert_eq!((issue.kind, issue.severity), (IssueKind::PositionInDegrees, Severity::Error));
    assert!(issue.message.contains("other joints do not look so"), "{}", issue.message);
    // Both in degrees: only the range tells.
    log.velocity.iter_mut().for_each(|dq| *dq = dq.to_degrees());
    let issues = log.issues();
    assert_eq!(kinds(&issues), [IssueKind::PositionInDegrees; 2]);
    assert!(issues[0].message.contains("turns if it were rad"), "{}", issues[0].message);
}

#[test]
fn positions_in_milliradians_or_counts() {
    // Both arms of the log move over less than 4 rad: 4000 mrad are eleven turns in degrees, which
    // no joint does.
    for (factor, text) in
        [(1e3, "looks like milliradians"), (1e5, "looks like counts of an encoder")]
    {
        let mut log = Log::new();
        log.position.iter_mut().for_each(|q| *q *= factor);
        log.velocity.iter_mut().for_each(|dq| *dq *= factor);
        let issues = refusals(&log.recording());
        assert!(issues.iter().any(|issue| issue.message.contains(text)), "{issues:?}");
        assert!(
            issues.iter().all(|issue| !issue.message.contains("looks like degrees")),
            "{issues:?}"
        );
    }
}

#[test]
fn velocities_in_other_units() {
    for (factor, text) in [
        (180.0 / std::f64::consts::PI, "looks like deg/s"),
        (60.0 / std::f64::consts::TAU, "looks like rpm"),
        (2.0, "check units and gear ratio"),
        (-1.0, "has the opposite sign"),
    ] {
        let mut log = Log::new();
        log.velocity.iter_mut().skip(1).step_by(2).for_each(|dq| *dq *= factor);
        let issue = log.issue();
        assert_eq!(
            (issue.kind, issue.channel.as_deref()),
            (IssueKind::VelocityMismatch, Some("b_velocity"))
        );
        assert!(issue.message.contains(text), "{}", issue.message);
    }
}

#[test]
fn velocities_of_other_joints() {
    let mut log = Log::new();
    log.velocity.chunks_mut(2).for_each(|row| row.swap(0, 1));
    let issues = log.issues();
    assert_eq!(kinds(&issues), [IssueKind::VelocityMismatch; 2]);
    assert!(issues[0].message.contains("is not the derivative of the position"));
}

#[test]
fn velocities_that_are_late() {
    let mut log = Log::new();
    let early = Log::with_time(log.time.iter().map(|time| time - 13 * MS).collect());
    log.velocity = early.velocity;
    let issue = log.issue();
    assert_eq!(issue.kind, IssueKind::VelocityLag);
    assert!(
        issue.message.starts_with("the velocity is 13.0") && issue.message.contains("ms late"),
        "{}",
        issue.message
    );
}

#[test]
fn clipped_torques() {
    let mut log = Log::new();
    log.torque.iter_mut().step_by(2).for_each(|tau| *tau = tau.clamp(-4.0, 4.0));
    let issue = log.issue();
    assert_eq!((issue.kind, issue.severity), (IssueKind::ClippedTorque, Severity::Warning));
    assert!(issue.message.contains("(-4 or 4)"), "{}", issue.message);
    assert!(issue.count > 500);
    let mut log = Log::new();
    log.torque.iter_mut().skip(1000).step_by(2).take(10).for_each(|tau| *tau = 9.0);
    let issue = log.issue();
    assert_eq!(
        (issue.kind, issue.severity, issue.count),
        (IssueKind::ClippedTorque, Severity::Note, 10)
    );
}

#[test]
fn torques_that_are_not_measured() {
    let mut log = Log::new();
    log.torque.iter_mut().skip(3001).step_by(2).for_each(|tau| *tau = 0.0);
    let issue = log.issue();
    assert_eq!((issue.kind, issue.channel.as_deref()), (IssueKind::FrozenTorque, Some("b_torque")));
    assert!(
        issue.severity == Severity::Warning && issue.time == Some(15.0) && issue.count == 500,
        "{issue:?}"
    );
    // Nothing is clipped where nothing changes.
    log.torque.iter_mut().skip(1).step_by(2).for_each(|tau| *tau = 0.0);
    assert_eq!((log.issue().kind, log.issue().count), (IssueKind::FrozenTorque, 2000));
    // A joint that rests may well have one torque.
    let mut log = Log::new();
    for values in [&mut log.position, &mut log.velocity, &mut log.torque] {
        let last = values[3001];
        values.iter_mut().skip(3001).step_by(2).for_each(|value| *value = last);
    }
    assert!(!kinds(&log.issues()).contains(&IssueKind::FrozenTorque), "{:?}", log.issues());
}

#[test]
fn encoder_steps() {
    let mut log = Log::new();
    let step = 0.004;
    log.position.iter_mut().for_each(|q| *q = (*q / step).round() * step);
    let issue = log.issue();
    assert_eq!((issue.kind, issue.count), (IssueKind::EncoderStep, 2));
    assert!(issue.message.contains("`a` 4.000e-3"), "{}", issue.message);
}

#[test]
fn small_logs_are_no_problem() {
    for samples in 0..6 {
        let time: Vec<i64> = (0..samples).map(|k| k * 10 * MS).collect();
        let log = Log::with_time(time);
        assert!(log.issues().iter().all(|issue| issue.severity < Severity::Error));
    }
    let time = vec![i64::MIN, i64::MAX, 0, 0];
    let log = Log::with_time(time);
    assert!(!log.issues().is_empty());
}

#[test]
fn rate_and_duration() {
    let log = Log::new().recording();
    assert_eq!((log.sample_rate_hz(), log.duration()), (Some(100.0), 19.99));
    assert_eq!(log.time_seconds()[..2], [0.0, 0.01]);
    assert_eq!(log.slice(0..1).sample_rate_hz(), None);
}
