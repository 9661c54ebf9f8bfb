//! Physics and what it leaves over, on the bundled logs of a closed-loop simulation by another program.
#![allow(missing_docs)]

mod common;

use std::sync::atomic::{AtomicUsize, Ordering};

use common::{data, largest_difference};
use sgpr_core::dynamics::Samples;
use sgpr_core::gp::{Compute, Precision, PredictorOptions};
use sgpr_core::model::{
    IdentifyOptions, Inputs, Mean, SemiParametricError, SemiParametricModel, SemiParametricOptions,
    SemiParametricPredictor, Start, TorqueModel, compare, fit_semi_parametric, identify,
};
use sgpr_core::progress::{Interrupted, Progress};
use sgpr_core::recording::{Recording, csv};
use sgpr_core::robot::{Robot, UrdfOptions};

fn robot() -> Robot {
    Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled")
}

fn read(name: &str) -> Recording {
    csv::read(data(&format!("demo/{name}.csv.gz")), &Default::default()).expect("bundled")
}

fn train() -> Vec<Recording> {
    ["train_1", "train_2", "train_3"].map(read).to_vec()
}

/// Physics without friction, small processes.
fn options() -> SemiParametricOptions {
    let identify = IdentifyOptions { effects: vec!["rotor_inertia".into()], ..IdentifyOptions::default() };
    let compute = Compute { threads: 2, ..Compute::default() };
    SemiParametricOptions { identify, points: 120, evaluations: 20, compute, ..SemiParametricOptions::default() }
}

fn fit(options: &SemiParametricOptions) -> SemiParametricModel {
    fit_semi_parametric(&robot(), &train(), options, &()).expect("good logs")
}

#[test]
fn what_the_physics_lacks_is_learned_and_what_it_has_is_left_alone() {
    let test = [read("test")];
    let model = fit(&options());
    let (before, after) = (compare(model.physics(), &test, None).expect("good"), model.compare(&test).expect("good"));
    for ((before, after), report) in before.joints.iter().zip(&after.joints).zip(model.reports()) {
        assert!(after.rmse < 0.6 * before.rmse, "{}: {} {}", after.joint, before.rmse, after.rmse);
        assert!(report.chosen.is_some() && report.points <= 120 && report.rows > 120);
        assert!(report.candidates.iter().all(|candidate| candidate.rmse > 0.0));
    }
    let score = model.score(&test).expect("good");
    // Smooth functions of 120 points follow the jump of dry friction within limits.
    assert!(score > 0.8 && !model.stopped(), "{score}");

    // Far from the data the physics is alone, and it is said.
    let far = [40.0; 6];
    let samples = Samples { q: &far, dq: &far, ddq: &far };
    let prediction = model.predict(samples, true).expect("finite");
    assert!(largest_difference(&prediction.tau, &model.physics().predict(samples)) < 1e-6);
    assert!(prediction.novelty.iter().all(|novelty| *novelty > 0.95));

    // With friction in the physics little is left, and the processes do no harm.
    let mut full = options();
    full.identify.effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    let model = fit(&full);
    let (before, after) = (compare(model.physics(), &test, None).expect("good"), model.compare(&test).expect("good"));
    assert!(after.relative_error_percent < 1.01 * before.relative_error_percent);
    let coverage = model.coverage(&test).expect("good");
    let mean = |select: fn(&sgpr_core::model::Coverage) -> f64| coverage.iter().map(select).sum::<f64>() / 6.0;
    assert!((mean(|c| c.percent_68) - 68.0).abs() < 10.0, "{coverage:?}");
    assert!((mean(|c| c.percent_95) - 95.0).abs() < 4.0, "{coverage:?}");
}

#[test]
fn a_model_read_back_and_a_predictor_say_the_same() {
    let test = read("test");
    let (q, dq) = (&test.position()[..600], &test.velocity().expect("logged")[..600]);
    let samples = Samples { q, dq, ddq: dq };
    for mean in [Mean::Physics, Mean::Joint, Mean::Zero] {
        let model = fit(&SemiParametricOptions { mean, inputs: Some(Inputs::OwnJoint), ..options() });
        let prediction = model.predict(samples, true).expect("finite");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("model.sgpr");
        model.save(&path).expect("writable");
        let back = SemiParametricModel::load(&path).expect("just written");
        assert_eq!(back.predict(samples, true).expect("finite"), prediction);
        assert_eq!((back.mean(), back.reports()), (mean, model.reports()));
        assert_eq!(back.to_bytes(), model.to_bytes());
        assert!(TorqueModel::load(&path).expect_err("another kind").to_string().contains("semi-parametric"));

        let every = PredictorOptions { variance_points: None, ..PredictorOptions::default() };
        let single = PredictorOptions { precision: Precision::Single, ..PredictorOptions::default() };
        let mut exact = SemiParametricPredictor::new(&back, every).expect("small");
        let mut fast = SemiParametricPredictor::new(&back, single).expect("small");
        for k in (0..600).step_by(60) {
            let (q, dq, tau) = (&q[k..k + 6], &dq[k..k + 6], &prediction.tau[k..k + 6]);
            assert!(largest_difference(fast.torque(q, dq, dq), tau) < 1e-3);
            let (found, deviation) = exact.torque_and_deviation(q, dq, dq);
            assert!(largest_difference(found, tau) < 1e-9);
            if mean != Mean::Joint {
                assert!(largest_difference(deviation, &prediction.standard_deviation[k..k + 6]) < 1e-9);
            }
        }
    }
}

#[test]
fn estimating_the_physics_together_with_the_rest_changes_it_within_its_spread() {
    let mut options = SemiParametricOptions { inputs: Some(Inputs::OwnVelocity), ..options() };
    options.identify.effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    let test = [read("test")];
    let fixed = fit(&options);
    let joint = fit(&SemiParametricOptions { mean: Mean::Joint, ..options });
    let (a, b) = (fixed.compare(&test).expect("good"), joint.compare(&test).expect("good"));
    assert!(
        b.relative_error_percent < 1.2 * a.relative_error_percent,
        "{} {}",
        b.relative_error_percent,
        a.relative_error_percent
    );
    let fits = (fixed.physics().fit().expect("identified"), joint.physics().fit().expect("identified"));
    assert_eq!((fits.0.method.as_str(), fits.1.method.as_str()), ("wls", "gls"));
    assert!(fits.1.standard_deviations.iter().all(|deviation| *deviation > 0.0));
    // The uncertain physics makes predictions less sure far from the data, where parameters are multiplied by much.
    let q = [0.3; 6];
    let (slow, fast) = ([0.1; 6], [80.0; 6]);
    let deviation = |model: &SemiParametricModel, ddq: &[f64]| {
        model.predict(Samples { q: &q, dq: &slow, ddq }, true).expect("finite").standard_deviation
    };
    for (calm, wild) in deviation(&joint, &slow).iter().zip(deviation(&joint, &fast)) {
        assert!(wild > *calm);
    }
    assert!(largest_difference(&deviation(&fixed, &slow), &deviation(&fixed, &fast)) < 1e-12);
}

#[test]
fn the_error_of_an_internal_model_is_learned_from_its_feedback_torque() {
    // Case 2 of the thesis: the internal model is the robot file; what it leaves over stands in the logs.
    let internal = TorqueModel::nominal(&robot());
    let (model, _) = identify(&robot(), &train(), &options().identify, &()).expect("good logs");
    let processing = model.processing().expect("identified");
    let feedback = |recording: &Recording| {
        let motion = sgpr_core::motion::Motion::from_recording(recording, processing).expect("a good log").remove(0);
        let mut tau = internal.predict(motion.samples());
        tau.iter_mut().zip(recording.torque().expect("logged")).for_each(|(left, all)| *left = all - *left);
        let names = recording.joint_names().to_vec();
        Recording::new(
            "feedback",
            names,
            recording.time().to_vec(),
            recording.position().to_vec(),
            None,
            Some(tau),
            vec![],
        )
        .expect("a log")
    };
    let mut options = SemiParametricOptions { inputs: Some(Inputs::OwnVelocity), ..options() };
    options.identify.start = Start::Zero;
    let train: Vec<Recording> = train().iter().map(feedback).collect();
    let error = fit_semi_parametric(&robot(), &train, &options, &()).expect("good logs");
    let test = [feedback(&read("test"))];
    let before = compare(error.physics(), &test, None).expect("good");
    let after = error.compare(&test).expect("good");
    for (before, after) in before.joints.iter().zip(&after.joints) {
        assert!(after.rmse < 0.6 * before.rmse, "{after:?} {before:?}");
    }
}

/// Asks to stop after some steps.
struct StopAfter(AtomicUsize, &'static str);

impl Progress for StopAfter {
    fn step(&self, stage: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        if stage == self.1 && self.0.fetch_sub(1, Ordering::Relaxed) == 1 { Err(Interrupted) } else { Ok(()) }
    }
}

#[test]
fn stopping_leaves_what_there_is_and_a_budget_is_checked() {
    let stop = StopAfter(AtomicUsize::new(2), "processes");
    let model = fit_semi_parametric(&robot(), &train(), &options(), &stop).expect("the physics is there");
    assert!(model.stopped() && model.reports().len() == 6);
    assert!(model.score(&[read("test")]).expect("good").is_finite());
    let stop = StopAfter(AtomicUsize::new(1), "observe");
    let error = fit_semi_parametric(&robot(), &train(), &options(), &stop).expect_err("nothing is there");
    assert!(error.to_string().contains("stopped on request"));
    let none = SemiParametricOptions { points: 1, ..options() };
    let error = fit_semi_parametric(&robot(), &train(), &none, &()).expect_err("no budget");
    assert!(matches!(error, SemiParametricError::Budget { points: 1, .. }));
}

#[test]
fn damaged_and_hostile_files_are_refused() {
    let model = fit(&SemiParametricOptions { inputs: Some(Inputs::OwnVelocity), points: 20, ..options() });
    let good = model.to_bytes();
    let message = |bytes: &[u8]| SemiParametricModel::from_bytes(bytes, "x.sgpr").expect_err("damaged").to_string();
    let replace = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = good.windows(from.len()).position(|window| window == from.as_bytes()).expect("there");
        let mut bytes = good.clone();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        message(&bytes)
    };
    assert!(message(b"").contains("x.sgpr: not a torque model"));
    assert!(message(&good[..good.len() - 9]).contains("not a torque model"));
    assert!(message(&TorqueModel::nominal(&robot()).to_bytes()).contains("its head says `sgpr torque model`"));
    assert!(replace("\\\"version\\\":1,", "\\\"version\\\":9,").contains("up to 1: update"));
    assert!(replace("joint_2.residual", "joint_2.residua1").contains("`joint_2.residual` is missing"));
    assert!(replace("{\\\"index\\\":7,", "{\\\"index\\\":77").contains("not a torque model"));
    // Every truncation and many flipped bits: an error or a model, never a panic.
    for length in (0..good.len()).step_by(997) {
        message(&good[..length]);
    }
    for at in (0..good.len()).step_by(331) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        let _ = SemiParametricModel::from_bytes(&bytes, "x.sgpr");
    }
}
