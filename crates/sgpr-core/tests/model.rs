//! The main job on the bundled logs of a closed-loop simulation by another program.
#![allow(missing_docs)]

mod common;

use std::sync::Arc;

use common::{data, largest_difference};
use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{Finding, Method};
use sgpr_core::model::{
    IdentificationReport, IdentifyError, IdentifyOptions, Predictor, Start, StreamedMotion,
    TorqueModel, compare, compare_streaming, cutoff_influence, identify, predict, screen,
};
use sgpr_core::motion::{MotionError, TorqueBand, average_periods};
use sgpr_core::recording::{LogSet, Recording, csv};
use sgpr_core::robot::{Robot, UrdfOptions, two_link};
use sgpr_core::signal::LowPass;
use sgpr_core::spatial::Vector3;

fn robot() -> Robot {
    Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled")
}

fn read(name: &str) -> Recording {
    csv::read(data(&format!("demo/{name}.csv.gz")), &Default::default()).expect("bundled")
}

fn train() -> Vec<Recording> {
    ["train_1", "train_2", "train_3"].map(read).to_vec()
}

fn options() -> IdentifyOptions {
    let effects =
        ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    IdentifyOptions::default().with_effects(effects)
}

#[test]
fn identification_beats_the_robot_file_on_a_log_it_has_not_seen() {
    let (robot, train, test) = (robot(), train(), [read("test")]);
    let (model, report) = identify(&robot, &train, &options(), &()).expect("good logs");
    assert_eq!(report.samples, 15_000);
    let identified = compare(&model, &test, None).expect("a good log");
    let nominal =
        compare(&TorqueModel::nominal(&robot), &test, model.processing()).expect("a good log");
    for (after, before) in identified.joints.iter().zip(&nominal.joints) {
        assert!(after.rmse < 0.5 * before.rmse, "{}: {} {}", after.joint, after.rmse, before.rmse);
        assert!(after.fit_percent > 85.0 && after.r2 > 0.98, "{after:?}");
        assert!(after.rmse < after.rmse_gravity && after.rmse_gravity < 1.5 * after.rmse_zero);
        assert!(after.largest_error >= after.rmse && after.samples > 4000);
        assert!(after.largest_error_time > 0.0 && after.largest_error_time < 20.0);
    }
    // What a plain least-squares fit by the makers of the case leaves, rests counted.
    let plain = [1.140874, 0.992573, 0.867673, 0.196868, 0.106579, 0.019552];
    for (joint, plain) in identified.joints.iter().zip(plain) {
        assert!(joint.rmse_with_rests < plain, "{joint:?}");
    }
    assert!(identified.relative_error_percent < 3.0, "{}", identified.relative_error_percent);
}

#[test]
fn a_model_read_back_predicts_the_same_bits() {
    let (robot, train, test) = (robot(), train(), read("test"));
    let (model, _) = identify(&robot, &train[..1], &options(), &()).expect("good logs");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model.sgpr");
    model.save(&path).expect("writable");
    let back = TorqueModel::load(&path).expect("just written");
    let q = test.position();
    let dq = test.velocity().expect("logged");
    let samples = Samples { q, dq, ddq: dq };
    let (a, b) = (model.predict(samples), back.predict(samples));
    assert!(a.iter().zip(&b).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert_eq!(back.fit(), model.fit());
    assert_eq!(back.processing(), model.processing());
    assert_eq!(back.provenance(), model.provenance());
    assert_eq!(back.robot(), model.robot());
    assert_eq!(back.to_bytes(), model.to_bytes(), "the same model gives the same bytes");
    // The head is for people.
    let bytes = std::fs::read(&path).expect("readable");
    let head = String::from_utf8_lossy(&bytes[..8000]);
    assert!(
        head.contains("sgpr torque model")
            && head.contains("joint_2.Ixx")
            && head.contains("weighted least squares")
    );
}

#[test]
fn damaged_and_hostile_model_files_are_refused() {
    let model = TorqueModel::nominal(&robot());
    let good = model.to_bytes();
    let message =
        |bytes: &[u8]| TorqueModel::from_bytes(bytes, "x.sgpr").expect_err("damaged").to_string();
    assert_eq!(message(b""), "x.sgpr: not a torque model, or damaged: the file is empty");
    for other in [&b"t,q_1"[..], b"t,q_1,q_2,tau_1,tau_2\n"] {
        assert!(message(other).contains("it does not begin as the files do"));
    }
    assert!(message(&good[..100]).contains("it ends before its header does"));
    assert!(message(&good[..good.len() - 9]).contains("not a torque model"));
    // A head that claims ten gigabytes.
    let mut claims = good.clone();
    claims[..8].copy_from_slice(&10_000_000_000u64.to_le_bytes());
    assert!(message(&claims).contains("not a torque model"));
    let text = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let text = String::from_utf8_lossy(&good).into_owned();
        assert!(text.contains(from), "{from}");
        let at =
            good.windows(from.len()).position(|window| window == from.as_bytes()).expect("there");
        let mut bytes = good.clone();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        message(&bytes)
    };
    assert!(text("version\\\":1,", "version\\\":9,").contains("up to 1: update"));
    assert!(
        text("sgpr torque model", "another kind of!!")
            .contains("its head says `another kind of!!`")
    );
    assert!(text("joint_3.Ixx", "joint_3.Ixz").contains("not those of its robot"));
    // Not a number among the parameters.
    let mut nan = good.clone();
    let last = nan.len() - 8;
    nan[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    assert!(message(&nan).contains("joint_6.Izz is NaN"), "{}", message(&nan));
    // Every truncation and many flipped bits: an error or a model, never a panic.
    for length in (0..good.len()).step_by(97) {
        assert!(TorqueModel::from_bytes(&good[..length], "x").is_err());
    }
    for at in (0..good.len()).step_by(61) {
        let mut bytes = good.clone();
        bytes[at] ^= 0x15;
        let _ = TorqueModel::from_bytes(&bytes, "x");
    }
}

#[test]
fn the_predictor_agrees_with_batches() {
    let (model, _) = identify(&robot(), &train()[..1], &options(), &()).expect("good logs");
    let test = read("test");
    let (q, dq) = (&test.position()[..600], &test.velocity().expect("logged")[..600]);
    let tau = model.predict(Samples { q, dq, ddq: dq });
    let mut predictor = Predictor::new(&model);
    for k in 0..100 {
        let row = k * 6..(k + 1) * 6;
        let one = predictor.torque(&q[row.clone()], &dq[row.clone()], &dq[row.clone()]);
        assert!(largest_difference(one, &tau[row]) < 1e-11);
    }
}

#[test]
fn another_cutoff_changes_little_and_the_influence_is_told() {
    let (robot, train) = (robot(), train());
    let (model, _) = identify(&robot, &train, &options(), &()).expect("good logs");
    let influences = cutoff_influence(&robot, &train, &options(), &model, &()).expect("good logs");
    assert!(influences.len() >= 3);
    let chosen = model.processing().expect("identified").cutoff_hz;
    let test = [read("test")];
    let reference = compare(&model, &test, None).expect("a good log").relative_error_percent;
    for influence in &influences {
        assert!(influence.cutoff_hz != chosen && influence.typical_change > 0.0);
        assert!(influence.largest_change >= influence.typical_change);
        let other = compare(&influence.model, &test, model.processing())
            .expect("a good log")
            .relative_error_percent;
        assert!(
            other < 1.5 * reference,
            "{} Hz: {other} % instead of {reference} %",
            influence.cutoff_hz
        );
    }
    // A log that overlaps another counts once here, too, as in the identification itself.
    let again: Vec<Recording> = [&train[..], &[train[0].slice(0..2500)]].concat();
    let (model, _) = identify(&robot, &again, &options(), &()).expect("good logs");
    let of_set = cutoff_influence(&robot, &again, &options(), &model, &()).expect("good logs");
    for (one, other) in influences.iter().zip(&of_set) {
        assert_eq!((one.cutoff_hz, one.largest_change), (other.cutoff_hz, other.largest_change));
    }
}

/// Recording of the two-link arm, lying flat, following sums of sines with the torque
/// `tau(t, q, dq, ddq)`.
fn two_link_recording(robot: &Robot, seconds: f64, model: &TorqueModel) -> Recording {
    let rate = 200.0;
    let samples = (seconds * rate) as usize;
    let (mut q, mut dq, mut ddq) = (vec![], vec![], vec![]);
    for k in 0..samples {
        let t = k as f64 / rate;
        for joint in 0..2 {
            let (mut position, mut velocity, mut acceleration) = (0.0, 0.0, 0.0);
            for h in 1..=4 {
                let w = std::f64::consts::TAU * 0.25 * f64::from(h);
                let (a, phase) = (0.5 / f64::from(h), f64::from(h) + 2.0 * joint as f64);
                position += a * (w * t + phase).sin();
                velocity += a * w * (w * t + phase).cos();
                acceleration -= a * w * w * (w * t + phase).sin();
            }
            q.push(position);
            dq.push(velocity);
            ddq.push(acceleration);
        }
    }
    let tau = model.predict(Samples { q: &q, dq: &dq, ddq: &ddq });
    let time = (0..samples).map(|k| (k as f64 / rate * 1e9).round() as i64).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new("two_link", names, time, q, None, Some(tau), vec![])
        .expect("arrays of one length")
}

#[test]
fn the_error_of_an_internal_model_is_identified_from_its_feedback_torque() {
    // The thesis's case 2: the robot has the base parameters [1.25, -0.5, 0, 0.5] (joint frames:
    // +0.5), the internal model is wrong by [1, -1, 1, 1]; the feedback torque is what the internal
    // model leaves over.
    let robot = two_link().with_gravity(Vector3::new(0.0, 0.0, -9.81));
    let truth = TorqueModel::nominal(&robot);
    let mut wrong = robot.standard_parameters();
    // Base parameters are joint_1.Izz + joint_2.m, joint_2.mx, joint_2.my, joint_2.Izz.
    for (index, error) in [(9, 1.0), (11, -1.0), (12, 1.0), (19, 1.0)] {
        wrong[index] += error;
    }
    let internal = TorqueModel::with_parameters(&robot, &[] as &[&str], wrong).expect("no effects");
    let whole = two_link_recording(&robot, 12.0, &truth);
    let by_internal = two_link_recording(&robot, 12.0, &internal);
    let feedback: Vec<f64> = whole
        .torque()
        .expect("made")
        .iter()
        .zip(by_internal.torque().expect("made"))
        .map(|(whole, internal)| whole - internal)
        .collect();
    let log = Recording::new(
        "feedback",
        whole.joint_names().to_vec(),
        whole.time().to_vec(),
        whole.position().to_vec(),
        None,
        Some(feedback),
        vec![],
    )
    .expect("arrays of one length");
    let mut options = IdentifyOptions::default().with_effects(vec![]).with_start(Start::Zero);
    options.conditioning.cutoff_hz = Some(15.0);
    let (error, _) = identify(&robot, &[log], &options, &()).expect("a good log");
    assert_eq!(error.base().names(), ["joint_1.Izz", "joint_2.mx", "joint_2.my", "joint_2.Izz"]);
    let found: Vec<f64> = error.base_parameters().iter().map(|parameter| parameter.value).collect();
    assert!(largest_difference(&found, &[-1.0, 1.0, -1.0, -1.0]) < 1e-3, "{found:?}");
    // On top of the internal model it is the robot.
    let corrected = internal.plus(&error);
    let comparison = compare(&corrected, &[whole], error.processing()).expect("a good log");
    assert!(comparison.relative_error_percent < 0.1, "{}", comparison.relative_error_percent);
    assert!(
        corrected
            .provenance()
            .history
            .iter()
            .any(|line| line.contains("error of an internal model"))
    );
}

#[test]
fn periods_are_averaged_with_their_spread() {
    let robot = two_link();
    let model = TorqueModel::nominal(&robot);
    // Fundamental 0.25 Hz: ten periods of 4 s, 800 samples.
    let clean = two_link_recording(&robot, 40.0, &model);
    let mut state = 7u64;
    let mut noise = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    // Uniform noise on [-a, a] has the standard deviation a / sqrt(3).
    let tau: Vec<f64> = clean
        .torque()
        .expect("made")
        .iter()
        .enumerate()
        .map(|(k, t)| t + [0.3, 0.6][k % 2] * noise())
        .collect();
    let noisy = Recording::new(
        "noisy",
        clean.joint_names().to_vec(),
        clean.time().to_vec(),
        clean.position().to_vec(),
        None,
        Some(tau),
        vec![],
    )
    .expect("arrays of one length");
    let average = average_periods(&noisy, 4.0, 2).expect("ten periods");
    assert_eq!((average.periods, average.recording.len()), (8, 800));
    for (found, half_width) in average.torque_noise.iter().zip([0.3, 0.6]) {
        assert!((found / (half_width / 3f64.sqrt()) - 1.0).abs() < 0.03, "{found}");
    }
    assert!(average.position_noise.iter().all(|noise| *noise < 1e-12));
    let expected = &clean.torque().expect("made")[..1600];
    let error = average.recording.torque().expect("kept").iter().zip(expected);
    let rms = (error.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 1600.0).sqrt();
    assert!(rms < 0.3 / 8f64.sqrt(), "{rms}");

    let message =
        |period, skip| average_periods(&noisy, period, skip).expect_err("impossible").to_string();
    assert!(message(4.0013, 0).contains("800.26 samples"), "{}", message(4.0013, 0));
    assert!(message(4.0, 9).contains("leave 1: an average needs two"), "{}", message(4.0, 9));
    assert!(message(-1.0, 0).contains("a period of -1 s is none"));
}

/// Of time, positions, torques and joint names.
type Change<'a> = &'a dyn Fn(&mut Vec<i64>, &mut Vec<f64>, &mut Option<Vec<f64>>, &mut Vec<String>);

#[test]
fn logs_that_cannot_be_used_are_refused_with_advice() {
    let (robot, log) = (robot(), read("train_1"));
    let message = |recordings: &[Recording]| {
        identify(&robot, recordings, &options(), &()).expect_err("bad").to_string()
    };
    let changed = |change: Change<'_>| {
        let mut names = log.joint_names().to_vec();
        let (mut time, mut q, mut tau) =
            (log.time().to_vec(), log.position().to_vec(), log.torque().map(<[f64]>::to_vec));
        change(&mut time, &mut q, &mut tau, &mut names);
        [Recording::new("log.csv", names, time, q, None, tau, vec![])
            .expect("arrays of one length")]
    };
    assert!(message(&[]).contains("no recording"));
    let text = message(&changed(&|_, q, _, _| q[6 * 100 + 2] = f64::NAN));
    assert!(
        text.contains("log.csv: the position of `joint_3` is not a number 0.400 s after the start"),
        "{text}"
    );
    let text = message(&changed(&|time, _, _, _| time.swap(50, 51)));
    assert!(
        text.contains("time does not increase after sample 51") && text.contains("sort"),
        "{text}"
    );
    let text = message(&changed(&|time, _, _, _| {
        time.iter_mut().enumerate().for_each(|(k, t)| *t += i64::from(k % 2 == 0) * 1_000_000);
    }));
    assert!(text.contains("too irregular to differentiate") && text.contains("resample"), "{text}");
    let text = message(&changed(&|_, _, tau, _| *tau = None));
    assert!(text.contains("no torque in this log") && text.contains("torque_constants"), "{text}");
    let text = message(&changed(&|_, _, _, names| names[3] = "wrist".into()));
    assert!(text.contains("joint_4"), "{text}");
    let text = message(&[log.slice(0..30)]);
    assert!(text.contains("too short for this filter"), "{text}");
    let mut high = options();
    high.conditioning.cutoff_hz = Some(400.0);
    let text = identify(&robot, std::slice::from_ref(&log), &high, &())
        .expect_err("above Nyquist")
        .to_string();
    assert!(text.contains("between 2.5e-3 and 125 Hz"), "{text}");
    let mut unknown = options();
    unknown.effects.push("stiction".into());
    assert!(
        identify(&robot, &[log], &unknown, &())
            .expect_err("unknown")
            .to_string()
            .contains("`stiction`")
    );
}

#[test]
fn a_joint_without_measured_torque_is_named() {
    let silent = |log: &Recording| {
        let mut torque = log.torque().expect("logged").to_vec();
        torque.iter_mut().skip(2).step_by(6).for_each(|tau| *tau = 0.0);
        let (joints, time) = (log.joint_names().to_vec(), log.time().to_vec());
        let velocity = log.velocity().map(<[f64]>::to_vec);
        Recording::new("log", joints, time, log.position().to_vec(), velocity, Some(torque), vec![])
            .expect("fits")
    };
    let train = train();
    let all_silent: Vec<Recording> = train.iter().map(silent).collect();
    let error = identify(&robot(), &all_silent, &options(), &()).expect_err("no torque");
    assert!(matches!(&error, IdentifyError::NoTorque { joint } if joint == "joint_3"), "{error}");
    assert!(error.to_string().contains("`joint_3` is zero in every sample"), "{error}");
    identify(&robot(), &[silent(&train[0]), train[1].clone()], &options(), &())
        .expect("one log has it");
}

/// What is found in the first log after its positions and torques were changed; torques come some
/// samples late.
fn found_in(change: impl Fn(usize, &mut f64, &mut f64), late: isize) -> Vec<Finding> {
    let (robot, log) = (robot(), read("train_1"));
    let (mut q, tau) = (log.position().to_vec(), log.torque().expect("logged"));
    let samples = log.len() as isize;
    let from = |k: usize| (k as isize - late).clamp(0, samples - 1) as usize;
    let mut tau: Vec<f64> =
        (0..log.len()).flat_map(|k| tau[6 * from(k)..6 * from(k) + 6].to_vec()).collect();
    q.iter_mut().zip(&mut tau).enumerate().for_each(|(index, (q, tau))| change(index % 6, q, tau));
    let (joints, time) = (log.joint_names().to_vec(), log.time().to_vec());
    let log = Recording::new("log", joints, time, q, None, Some(tau), vec![]).expect("fits");
    let (model, _) =
        identify(&robot, std::slice::from_ref(&log), &options(), &()).expect("good logs");
    screen(&model, &[log])
        .expect("good logs")
        .into_iter()
        .filter(|f| !matches!(f, Finding::Outliers { .. }))
        .collect()
}

#[test]
fn mistakes_in_logs_are_named_and_good_logs_pass() {
    assert_eq!(found_in(|_, _, _| {}, 0), []);
    let names =
        |joints: &[usize]| joints.iter().map(|joint| format!("joint_{joint}")).collect::<Vec<_>>();
    for wrong in [&[3][..], &[2, 3], &[1], &[2, 4, 6], &[1, 2, 3, 5]] {
        let found = found_in(
            |joint, _, tau| *tau *= if wrong.contains(&(joint + 1)) { -1.0 } else { 1.0 },
            0,
        );
        let negated: Vec<Finding> =
            names(wrong).into_iter().map(|joint| Finding::Negated { joint }).collect();
        assert_eq!(found, negated);
    }
    for (wrong, right) in [(0.2, 5.0), (1000.0, 0.001)] {
        let found = found_in(|joint, _, tau| *tau *= if joint == 1 { wrong } else { 1.0 }, 0);
        let [Finding::Scaled { joint, factor }] = &found[..] else { panic!("{found:?}") };
        assert!(joint == "joint_2" && (factor / right - 1.0_f64).abs() < 0.1, "{found:?}");
    }
    // A position with the wrong sign is another arm, in which friction would drive the joint.
    let found = found_in(|joint, q, _| *q *= if joint == 2 { -1.0 } else { 1.0 }, 0);
    assert_eq!(found, [Finding::Driven { joint: "joint_3".into() }]);
    assert!(
        found[0].to_string().contains("the torque or the position of joint_3 looks negated"),
        "{}",
        found[0]
    );
    for (samples, seconds) in [(3, 0.012), (-3, -0.012), (10, 0.040)] {
        let found = found_in(|_, _, _| {}, samples);
        let [Finding::AllLate { seconds: named, .. }] = found[..] else { panic!("{found:?}") };
        assert!((named - seconds).abs() < 0.003, "{named} {seconds}");
    }
}

/// The training logs with torques that a filter has passed over, forward and backward, if there is
/// one.
fn low_passed(cutoff_hz: Option<f64>) -> Vec<Recording> {
    let filtered = |log: &Recording| {
        let mut tau = log.torque().expect("logged").to_vec();
        if let Some(hz) = cutoff_hz {
            LowPass::butterworth(2, hz, 250.0)
                .and_then(|filter| filter.apply(&mut tau, 6))
                .expect("below Nyquist");
        }
        let (joints, time) = (log.joint_names().to_vec(), log.time().to_vec());
        Recording::new("log", joints, time, log.position().to_vec(), None, Some(tau), vec![])
            .expect("fits")
    };
    train().iter().map(filtered).collect()
}

#[test]
fn torques_that_end_early_are_named_with_a_band_in_which_they_can_be_compared() {
    let (robot, options) = (robot(), options());
    let end = |report: &IdentificationReport| {
        report.findings.iter().find_map(|finding| match finding {
            Finding::TorqueEnds { hz, compared_hz, .. } => Some((*hz, *compared_hz)),
            _ => None,
        })
    };
    let (raw, report) = identify(&robot, &low_passed(None), &options, &()).expect("good logs");
    assert_eq!(end(&report), None);
    // Judged by torques that no filter has touched.
    let error = |model: &TorqueModel| {
        compare(model, &[read("test")], raw.processing())
            .expect("a good log")
            .relative_error_percent
    };
    for cutoff_hz in [1.5, 2.5] {
        let logs = low_passed(Some(cutoff_hz));
        let (whole, report) = identify(&robot, &logs, &options, &()).expect("good logs");
        let (hz, compared_hz) = end(&report).expect("the torques end");
        assert!((hz / cutoff_hz - 1.0).abs() < 0.5 && compared_hz < hz, "{hz} for {cutoff_hz} Hz");
        let mut given = options.clone();
        given.conditioning.torque_band = TorqueBand::Hz(compared_hz);
        let (below, report) = identify(&robot, &logs, &given, &()).expect("good logs");
        assert_eq!(end(&report), None, "nothing ends in this band");
        let [raw, below, whole] = [&raw, &below, &whole].map(error);
        assert!(
            raw < below && below < whole && below < 1.1 * raw,
            "{cutoff_hz} Hz: {raw} {below} {whole}"
        );
    }
}

#[test]
fn torques_in_another_unit_than_the_robot_file_are_named() {
    let (robot, log) = (robot(), read("train_1"));
    let tau = log.torque().expect("logged").iter().map(|tau| 1000.0 * tau).collect();
    let (joints, time) = (log.joint_names().to_vec(), log.time().to_vec());
    let log = Recording::new("log", joints, time, log.position().to_vec(), None, Some(tau), vec![])
        .expect("fits");
    let (_, report) = identify(&robot, &[log], &options(), &()).expect("good logs");
    assert!(
        report.warnings.iter().any(|text| text.contains("times what the masses")),
        "{:?}",
        report.warnings
    );
    let (_, report) = identify(&robot, &train(), &options(), &()).expect("good logs");
    assert!(
        !report.warnings.iter().any(|text| text.contains("times what the masses")),
        "{:?}",
        report.warnings
    );
}

#[test]
fn nothing_is_compared_with_nothing() {
    let (model, _) = identify(&robot(), &train()[..1], &options(), &()).expect("good logs");
    let error = compare(&model, &[], None).expect_err("no log");
    assert!(matches!(error, IdentifyError::Motion(MotionError::NoRecording)), "{error}");
}

#[test]
fn a_set_of_logs_is_conditioned_once_and_says_what_its_list_says() {
    let (robot, [train, test]) = (robot(), ["train_1", "test"].map(read));
    let half = train.len() / 2;
    // The second shares a quarter of the log with the first.
    let list = [train.slice(0..half), train.slice(half / 2..train.len())];
    let set = LogSet::new(&list);
    assert_eq!((set.len(), set.notes().len()), (2, 1));
    let [model, of_list] = [&set[..], &list[..]]
        .map(|logs| identify(&robot, logs, &options(), &()).expect("good logs").0);
    assert_eq!(model.parameters(), of_list.parameters());

    let nominal = TorqueModel::nominal(&robot);
    let own = compare(&model, &set, None).expect("good logs");
    assert_eq!(own, compare(&model, &list, None).expect("good logs"));
    let total: usize = own.logs.iter().map(|log| log.motion.len()).sum();
    assert_eq!(total, train.len(), "every sample once");
    let before = compare(&nominal, &set, model.processing()).expect("good logs");
    assert_eq!(before, compare(&nominal, &list, model.processing()).expect("good logs"));
    let streamed =
        compare_streaming(&model, set.clone(), None, StreamedMotion::Filtered).expect("good logs");
    for others in [&before, &streamed] {
        let pairs = own.logs.iter().zip(&others.logs);
        assert!(
            pairs.clone().all(|(a, b)| Arc::ptr_eq(&a.motion, &b.motion)),
            "the motion of the set, clones included"
        );
    }
    let predicted = predict(&model, &set, true).expect("good logs");
    assert_eq!(predicted.len(), own.logs.len());
    for (log, found) in own.logs.iter().zip(&predicted) {
        assert_eq!(log.predicted, found.torque);
        let deviation = model.standard_deviation_of(&log.motion).expect("a model of logs");
        assert_eq!(Some(deviation), found.standard_deviation);
    }
    // Processed otherwise, it is another motion.
    let hz = 0.5 * model.processing().expect("identified").cutoff_hz;
    let mut slower = model.processing().expect("identified").clone();
    slower.cutoff_hz = hz;
    let other = compare(&model, &set, Some(&slower)).expect("good logs");
    assert!(!Arc::ptr_eq(&other.logs[0].motion, &own.logs[0].motion));
    assert_eq!(other, compare(&model, &list, Some(&slower)).expect("good logs"));

    // Logs that share nothing: each counts as it is, whichever way they are given.
    let apart = [train, test];
    let whole = compare(&model, LogSet::whole(&apart), None).expect("good logs");
    assert_eq!(whole, compare(&model, &apart, None).expect("good logs"));
    let copies = [apart[1].clone(), apart[1].clone()];
    assert_eq!(compare(&model, &copies, None).expect("good logs").logs.len(), 1);
    assert_eq!(compare(&model, LogSet::whole(&copies), None).expect("good logs").logs.len(), 2);
}

#[test]
fn a_joint_that_never_moves_is_named() {
    let (robot, log) = (robot(), read("train_1"));
    let mut q = log.position().to_vec();
    q.iter_mut().skip(5).step_by(6).for_each(|q| *q = 0.3);
    let still = Recording::new(
        "still",
        log.joint_names().to_vec(),
        log.time().to_vec(),
        q,
        None,
        log.torque().map(<[f64]>::to_vec),
        vec![],
    )
    .expect("arrays of one length");
    let still = [still];
    let (model, report) = identify(&robot, &still, &options(), &()).expect("the others move");
    let fit = model.fit().expect("identified");
    assert!(fit.undetermined.contains(&"joint_6.Fc".to_string()), "{:?}", fit.undetermined);
    assert!(
        report.warnings.iter().any(|w| w.contains("does not excite") && w.contains("joint_6.Fv")),
        "{:?}",
        report.warnings
    );
    let index = model
        .base()
        .names()
        .iter()
        .position(|name| name == "joint_6.Fv")
        .expect("a base parameter");
    let (value, deviation) = (fit.values[index], fit.standard_deviations[index]);
    // It stays at the robot file's, which is none, but for rounding of what the prior solves for.
    assert!(
        deviation.is_finite() && value.abs() < 1e-9 * deviation,
        "the prior holds it: {value} ± {deviation}"
    );
    assert!(
        report.warnings.iter().any(|w| w.contains("`joint_6` must move")),
        "{:?}",
        report.warnings
    );
    let bare = options().with_prior(None);
    let (model, report) = identify(&robot, &still, &bare, &()).expect("the others move");
    let fit = model.fit().expect("identified");
    assert!(
        report.warnings.iter().any(|w| w.contains("does not excite") && w.contains("joint_6.Fv"))
    );
    assert!(fit.standard_deviations[index].is_infinite());
    // And such a model can be kept.
    let back = TorqueModel::from_bytes(&model.to_bytes(), "memory").expect("valid");
    assert!(back.fit().expect("kept").standard_deviations[index].is_infinite());
}

#[test]
fn gaps_cut_a_log_and_nothing_is_filtered_across_them() {
    let (robot, log) = (robot(), read("train_1"));
    // The same log with half a second missing in the middle, and the two halves as two logs.
    let keep: Vec<usize> = (0..log.len()).filter(|k| !(2400..2525).contains(k)).collect();
    let pick = |values: &[f64]| {
        keep.iter().flat_map(|k| values[6 * k..6 * k + 6].to_vec()).collect::<Vec<_>>()
    };
    let gap = Recording::new(
        "gap",
        log.joint_names().to_vec(),
        keep.iter().map(|&k| log.time()[k]).collect(),
        pick(log.position()),
        None,
        Some(pick(log.torque().expect("logged"))),
        vec![],
    )
    .expect("arrays of one length");
    let mut options = options();
    options.conditioning.cutoff_hz = Some(10.0);
    options.conditioning.standstill_speed = Some(0.005);
    let halves = [log.slice(0..2400), log.slice(2525..log.len())];
    let (one, _) = identify(&robot, std::slice::from_ref(&gap), &options, &()).expect("good logs");
    let (two, _) = identify(&robot, &halves, &options, &()).expect("good logs");
    // Equations are the same; what holds the parameters is told by fifths of each log, of one log
    // here, of two there.
    let unseen =
        [&one, &two].map(|model| compare(model, &[read("test")], None).expect("a good log"));
    let [one, two] = unseen.map(|found| found.relative_error_percent);
    println!("{one:.3} and {two:.3} % of the torque");
    assert!((one / two - 1.0).abs() < 0.1, "{one} {two}");
    options.prior = None;
    let bare = |logs: &[Recording]| identify(&robot, logs, &options, &()).expect("good logs").0;
    let (one, two) = (bare(&[gap]), bare(&halves));
    assert!(largest_difference(one.parameters(), two.parameters()) < 1e-9);
}

#[test]
fn known_noise_and_an_unfiltered_band_are_possible() {
    let (robot, train) = (robot(), train());
    let mut options = options();
    options.method = Method::WlsKnown(vec![0.34, 0.54, 0.2, 0.023, 0.017, 0.011]);
    options.conditioning.torque_band = TorqueBand::Full;
    let (model, _) = identify(&robot, &train, &options, &()).expect("good logs");
    assert_eq!(model.processing().expect("identified").decimation, 1);
    let error = compare(&model, &[read("test")], None).expect("a good log");
    assert!(error.relative_error_percent < 4.0, "{}", error.relative_error_percent);
    options.method = Method::WlsKnown(vec![0.34, 0.54, -0.2, 0.023, 0.017, 0.011]);
    assert!(matches!(
        identify(&robot, &train, &options, &()),
        Err(IdentifyError::Identification(_))
    ));
    options.conditioning.decimation = Some(0);
    options.method = Method::Ols;
    identify(&robot, &train, &options, &()).expect("no decimation is a decimation by one");
    let empty = Recording::new(
        "empty",
        robot.joint_names().map(String::from).collect(),
        vec![],
        vec![],
        None,
        None,
        vec![],
    );
    let result = identify(&robot, &[empty.expect("no samples")], &options, &());
    assert!(
        matches!(
            result,
            Err(IdentifyError::Motion(MotionError::TooShort { .. } | MotionError::NoRecording))
        ),
        "{result:?}"
    );
}
