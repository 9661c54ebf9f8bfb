//! How often a log is filtered and differentiated by what is asked of it, room after room.

use crate::diagnosis::{DiagnosisOptions, diagnose};
use crate::dynamics::Samples;
use crate::model::{
    IdentifyOptions, SemiParametricOptions, TorqueModel, compare, cutoff_influence, fit_rest,
    fit_semi_parametric, identify, screen,
};
use crate::motion::times_conditioned;
use crate::recording::{LogSet, Recording};
use crate::robot::{Robot, two_link};
use sgpr_numeric::internal::Random;

/// Ten seconds of an arm with friction that is not in its file.
fn log(robot: &Robot, source: &str, seed: u64) -> Recording {
    let (rate_hz, samples) = (200.0, 2000);
    let truth = TorqueModel::with_parameters(robot, &["viscous_friction", "coulomb_friction"], {
        let mut parameters = robot.standard_parameters();
        parameters.extend([1.0, 2.0, 0.7, 1.2]);
        parameters
    });
    let truth = truth.expect("effects of the library");
    let mut random = Random::new(seed);
    let [mut q, mut dq, mut ddq] = [const { Vec::new() }; 3];
    for time in (0..samples).map(|k| k as f64 / rate_hz) {
        for joint in 0..2 {
            let (mut at, mut speed, mut change) = (0.0, 0.0, 0.0);
            for wave in 1..4 {
                let w = 1.1 * wave as f64 + 0.37 * (joint + seed as usize) as f64;
                let (sine, cosine) = (w * time).sin_cos();
                (at, speed, change) =
                    (at + 0.4 * sine, speed + 0.4 * w * cosine, change - 0.4 * w * w * sine);
            }
            q.push(at);
            dq.push(speed);
            ddq.push(change);
        }
    }
    let mut tau = truth.predict(Samples { q: &q, dq: &dq, ddq: &ddq });
    tau.iter_mut().for_each(|tau| *tau += 0.05 * random.normal());
    q.iter_mut().for_each(|q| *q += 1e-6 * random.normal());
    let time = (0..samples as i64).map(|k| 5_000_000 * k + 20_000_000_000 * seed as i64).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new(source, names, time, q, None, Some(tau), vec![]).expect("whole samples")
}

/// Times that each log was conditioned by now.
fn counts(sources: [&str; 3]) -> [usize; 3] {
    sources.map(times_conditioned)
}

/// What the command `identify` asks with unseen logs: four more cut-offs, and six comparisons.
#[test]
fn identification_and_comparisons_condition_a_log_once_for_each_processing() {
    let (robot, sources) = (two_link(), ["identify one", "identify two", "identify unseen"]);
    let [one, two, unseen] = [0, 1, 2].map(|k| log(&robot, sources[k], k as u64));
    let (train, test) = (LogSet::whole(&[one, two]), LogSet::new(&[unseen]));
    let options = IdentifyOptions::default();
    let (model, _) = identify(&robot, &train, &options, &()).expect("good logs");
    let others = cutoff_influence(&robot, &train, &options, &model, &()).expect("good logs");
    assert_eq!(others.len(), 4);
    screen(&model, &train).expect("good logs");
    let (nominal, processing) = (TorqueModel::nominal(&robot), model.processing());
    for model in [&nominal, &model].into_iter().chain(others.iter().map(|other| &other.model)) {
        compare(model, &test, processing).expect("good logs");
    }
    // The four cut-offs are looked at once.
    assert_eq!(counts(sources), [5, 5, 1]);
}

#[test]
fn a_diagnosis_conditions_a_log_once_for_each_processing() {
    let (robot, sources) = (two_link(), ["diagnose one", "diagnose two", "diagnose unseen"]);
    let [one, two, unseen] = [0, 1, 2].map(|k| log(&robot, sources[k], k as u64));
    let (train, test) = (LogSet::whole(&[one, two]), LogSet::new(&[unseen]));
    let options =
        IdentifyOptions { effects: vec!["viscous_friction".into()], ..IdentifyOptions::default() };
    let (model, _) = identify(&robot, &train, &options, &()).expect("good logs");
    let found =
        diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).expect("good logs");
    assert!(!found.findings.is_empty());
    compare(&model, &test, model.processing()).expect("good logs");
    compare(&found.after, &test, None).expect("good logs");
    assert_eq!(counts(sources), [1, 1, 1]);
}

#[test]
fn processes_condition_a_log_once() {
    let (robot, sources) = (two_link(), ["learn one", "learn two", "learn unseen"]);
    let [one, two, unseen] = [0, 1, 2].map(|k| log(&robot, sources[k], k as u64));
    let (train, test) = (LogSet::whole(&[one, two]), LogSet::new(&[unseen]));
    let options = SemiParametricOptions { points: 20, ..SemiParametricOptions::default() };
    let (model, _) = identify(&robot, &train, &IdentifyOptions::default(), &()).expect("good logs");
    let learned = fit_rest(&model, &train, &options, &()).expect("good logs");
    compare(&model, &test, model.processing()).expect("good logs");
    learned.compare(&test).expect("good logs");
    assert_eq!(counts(sources), [1, 1, 1]);
    let alone = [log(&robot, "learn alone", 7), log(&robot, "learn alone, too", 8)];
    fit_semi_parametric(&robot, &alone, &options, &()).expect("good logs");
    assert_eq!(times_conditioned("learn alone"), 1);
}
