//! Diagnosis through the public interface: what was hidden is found, what is not there is not.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use common::hidden_case;
use sgpr_core::diagnosis::{DiagnosisError, DiagnosisOptions, Finding, Verdict, add, diagnose};
use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Context, Effect, EffectParameter, Entry, Site, by_name, sgn};
use sgpr_core::model::{
    IdentificationReport, IdentifyOptions, Term, TorqueModel, Trajectory, compare, identify,
};
use sgpr_core::progress::{Interrupted, Progress};
use sgpr_core::recording::Recording;
use sgpr_core::robot::{Robot, puma560, two_link};

const RATE: f64 = 100.0;
const BASE: [&str; 2] = ["viscous_friction", "coulomb_friction"];
const NOISE: f64 = 0.05;

/// Uniform numbers between -1 and 1 (Park and Miller (1988)), scaled to unit variance.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0 * 48271 % 2_147_483_647;
        (self.0 as f64 / 1_073_741_823.5 - 1.0) * 3f64.sqrt()
    }
}

/// A log of the two-link arm with friction and `terms`; `number` counts logs on one clock.
fn log(terms: &[Term], number: usize, seconds: f64) -> Recording {
    log_of(&two_link(), &[0.8, 1.0, 0.5, 0.6], NOISE, terms, (number, seconds))
}

/// The same of any arm, with its parameters of friction.
fn log_of(
    robot: &Robot,
    friction: &[f64],
    level: f64,
    terms: &[Term],
    (number, seconds): (usize, f64),
) -> Recording {
    let n = robot.dof();
    let parameters = [&robot.standard_parameters(), friction].concat();
    let model = TorqueModel::with_parameters(robot, &BASE, parameters)
        .unwrap()
        .with_terms(terms.to_vec(), Some(0));
    let samples = (seconds * RATE) as usize;
    let (mut q, mut dq, mut ddq, mut time) = (vec![], vec![], vec![], vec![]);
    for k in 0..samples {
        let t = k as f64 / RATE;
        time.push(number as f64 * seconds + t);
        for joint in 0..n {
            let phase = (joint + n * number) as f64;
            let waves = [(0.7, 0.9), (0.4, 2.3), (0.2, 4.1)]
                .map(|(size, pulse)| (size, pulse * (1.0 + 0.13 * phase)));
            let sum =
                |f: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, w)| f(*a, *w)).sum::<f64>();
            q.push(sum(&|a, w| a * (w * t + phase).sin()));
            dq.push(sum(&|a, w| a * w * (w * t + phase).cos()));
            ddq.push(sum(&|a, w| -a * w * w * (w * t + phase).sin()));
        }
    }
    let trajectory = Trajectory::of_samples(Samples { q: &q, dq: &dq, ddq: &ddq })
        .with_rate_hz(RATE)
        .with_time(&time);
    let mut noise = Noise(12345 + number as u64);
    let tau = model
        .predict_trajectory(&trajectory)
        .into_iter()
        .map(|tau| tau + level * noise.next())
        .collect();
    let q = q.into_iter().map(|q| q + 1e-6 * noise.next()).collect();
    let stamps = time.iter().map(|t| (t * 1e9).round() as i64).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new(format!("log {number}"), names, stamps, q, None, Some(tau), vec![]).unwrap()
}

fn logs(terms: &[Term]) -> (Vec<Recording>, Vec<Recording>) {
    ((0..2).map(|number| log(terms, number, 20.0)).collect(), vec![log(terms, 2, 20.0)])
}

fn identified(train: &[Recording]) -> TorqueModel {
    identified_on(&two_link(), train)
}

fn identified_on(robot: &Robot, train: &[Recording]) -> TorqueModel {
    identified_with_report(robot, train).0
}

fn identified_with_report(
    robot: &Robot,
    train: &[Recording],
) -> (TorqueModel, IdentificationReport) {
    let options = IdentifyOptions::default().with_effects(BASE.map(String::from).to_vec());
    identify(robot, train, &options, &()).unwrap()
}

fn hidden(name: &str, joint: usize, constants: &[f64], coefficients: &[f64]) -> Term {
    let mut term = Term::new(by_name(name).unwrap(), Site::Joint(joint), constants.to_vec());
    term.coefficients = coefficients.to_vec();
    term
}

#[test]
fn a_hidden_stribeck_curve_is_found_and_closes_the_error() {
    let (train, test) = logs(&[hidden("stribeck_friction", 1, &[0.1], &[1.0])]);
    let model = identified(&train);
    let diagnosis = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();

    assert_eq!(diagnosis.verdict, Verdict::EffectsFound);
    assert_eq!(diagnosis.findings.len(), 1, "{:?}", diagnosis.findings);
    let finding = &diagnosis.findings[0];
    assert_eq!(
        (finding.effect.as_str(), &finding.joints[..]),
        ("stribeck_friction", &["joint_2".to_string()][..])
    );
    let value = |name: &str| finding.parameters.iter().find(|p| p.name == name).unwrap().value;
    // Within ten percent of what was put in.
    assert!((value("joint_2.vs") - 0.1).abs() < 0.01, "{}", value("joint_2.vs"));
    assert!((value("joint_2.dFs") - 1.0).abs() < 0.1, "{}", value("joint_2.dFs"));
    assert!(finding.probability > 0.9);
    assert!(finding.rmse_after["joint_2"] < finding.rmse_before["joint_2"]);
    let errors = &diagnosis.joints["joint_2"];
    // Of what is not noise, nineteen twentieths.
    assert!(errors.rmse_after - NOISE < 0.05 * (errors.rmse_before - NOISE), "{errors:?}");

    let added = add(&model, &[finding], &train).unwrap();
    let after = compare(&added, &test, None).unwrap();
    assert!((after.joints[1].rmse_full_band - errors.rmse_after).abs() < 0.01 * errors.rmse_after);
    assert!(added.provenance().history.last().unwrap().contains("stribeck_friction"));

    let again = TorqueModel::from_bytes(&added.to_bytes(), "memory").unwrap();
    assert_eq!(compare(&again, &test, None).unwrap().joints, after.joints);
    // What is in the model is not found again.
    let next = diagnose(&added, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    assert_eq!(next.verdict, Verdict::NothingMissing, "{:?}", next.findings);
}

#[test]
fn a_wrong_length_is_found_although_base_parameters_take_nearly_all_of_it_up() {
    let robot = puma560();
    let wrong = hidden("link_length_error", 4, &[-0.04, 0.03, 0.01], &[]);
    let log =
        |number| log_of(&robot, &[1.0; 12], 0.003, std::slice::from_ref(&wrong), (number, 20.0));
    let (train, test) = ([log(0), log(1)], [log(2)]);
    let model = identified_on(&robot, &train);
    let diagnosis = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> =
        diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["link_length_error"]);
    let value = |name: &str| {
        diagnosis.findings[0].parameters.iter().find(|p| p.name == name).unwrap().value
    };
    assert!((value("joint_5.dx") + 0.04).abs() < 0.004, "{}", value("joint_5.dx"));
    let errors = &diagnosis.joints["joint_4"];
    assert!(errors.rmse_after < 0.9 * errors.rmse_before, "{errors:?}");
}

#[test]
fn a_delay_of_less_than_a_sample_is_said_where_it_matters() {
    let diagnosed = |delay_s: f64| {
        let term = Term::new(by_name("torque_delay").unwrap(), Site::Arm, vec![delay_s]);
        let (train, test) = logs(&[term]);
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap()
    };
    let found = diagnosed(0.4 / RATE);
    assert_eq!(
        found.findings.iter().map(|f| f.effect.as_str()).collect::<Vec<_>>(),
        ["torque_delay"]
    );
    let delay = found.findings[0].parameters[0].value;
    assert!((delay - 0.4 / RATE).abs() < 0.04 / RATE, "{delay}");
    let found = diagnosed(0.08 / RATE);
    assert_eq!(
        found.findings.iter().map(|f| f.effect.as_str()).collect::<Vec<_>>(),
        ["torque_delay"]
    );
    // Seen, but next to nothing of the error.
    let silent = diagnosed(0.02 / RATE);
    assert_eq!(silent.verdict, Verdict::NothingMissing, "{:?}", silent.findings);
    // A person who adds it has it.
    let (train, _) =
        logs(&[Term::new(by_name("torque_delay").unwrap(), Site::Arm, vec![0.02 / RATE])]);
    let options = DiagnosisOptions::default().with_by_hand(vec!["torque_delay".into()]);
    let added = diagnose(&identified(&train), &train, &[], &options, &()).unwrap();
    assert_eq!(
        added.findings.iter().map(|f| f.effect.as_str()).collect::<Vec<_>>(),
        ["torque_delay"]
    );
    assert!(added.after.terms().iter().any(|term| term.effect.name() == "torque_delay"));
}

#[test]
fn a_spring_between_two_pins_is_not_taken_for_a_linear_one() {
    // A linear spring has all but a three-hundredth of the evidence.
    let (train, test) = logs(&[hidden("spring_balancer", 1, &[-2.3, 0.75], &[1.0, -6.6])]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<(&str, &str)> =
        diagnosis.findings.iter().map(|f| (f.effect.as_str(), f.joints[0].as_str())).collect();
    assert_eq!(found, [("spring_balancer", "joint_2")]);
}

#[test]
fn friction_of_creeping_speeds_alone_is_more_than_a_wrong_sign_near_reversals() {
    let speed = 0.006;
    let (train, test) = logs(&[hidden("stribeck_friction", 1, &[speed], &[1.0])]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> = diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    assert_eq!(found, ["stribeck_friction"]);
    let fitted = diagnosis.findings[0].parameters.iter().find(|p| p.name == "joint_2.vs").unwrap();
    assert!((fitted.value / speed - 1.0).abs() < 0.2, "{fitted:?}");
}

#[test]
fn a_narrow_place_of_much_friction_is_found_as_narrow_as_it_is() {
    let (place, width) = (0.1, 0.03);
    let (train, test) =
        logs(&[hidden("position_dependent_friction", 1, &[place, width], &[1.0, 0.0, 0.0])]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> = diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    assert_eq!(found, ["position_dependent_friction"]);
    let [qc, w] = ["joint_2.qc", "joint_2.w"].map(|name| {
        diagnosis.findings[0].parameters.iter().find(|p| p.name == name).unwrap().value
    });
    assert!((qc - place).abs() < 0.1 * width && (w / width - 1.0).abs() < 0.1, "{qc} {w}");
}

#[test]
fn a_change_between_two_logs_may_be_anywhere_between_them() {
    let step = [hidden("friction_step", 1, &[33.0], &[0.3, 0.4])];
    let train = [log(&step, 0, 20.0), log(&step, 2, 20.0)];
    let diagnosis = diagnose(
        &identified(&train),
        &train,
        &[log(&step, 3, 20.0)],
        &DiagnosisOptions::default(),
        &(),
    )
    .unwrap();
    let finding = &diagnosis.findings[0];
    assert_eq!(finding.effect, "friction_step");
    let time = finding.parameters.iter().find(|p| p.name == "joint_2.t0").unwrap();
    assert!((time.value - 30.0).abs() < 0.5 && (time.std.unwrap() - 5.0).abs() < 0.3, "{time:?}");
}

#[test]
fn a_wrong_link_length_makes_no_other_joint_worse() {
    let Some((robot, train, test)) = hidden_case("dev19") else { return };
    let effects =
        ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    let (model, _) =
        identify(&robot, &train, &IdentifyOptions::default().with_effects(effects), &()).unwrap();
    let diagnosis = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    assert_eq!(diagnosis.findings[0].effect, "link_length_error");
    let change = |joint: &str| {
        diagnosis.joints[joint].rmse_after / diagnosis.joints[joint].rmse_before - 1.0
    };
    assert!(change("joint_3") < -0.05, "{}", change("joint_3"));
    // A finer form of friction that hedges between the signs of a few samples cost joint 6 a tenth.
    assert!(diagnosis.joints.keys().all(|joint| change(joint) < 0.02), "{:?}", diagnosis.joints);
}

#[test]
fn a_spring_that_pushes_away_is_said_where_it_matters_much() {
    let found = |stiffness: f64| -> Vec<(String, f64)> {
        let (train, test) = logs(&[hidden("cable_stiffness", 1, &[], &[stiffness, 0.0])]);
        let diagnosis =
            diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &())
                .unwrap();
        let says_so = |evidence: &str| {
            evidence.contains("opposite of what such a part has") == (stiffness < 0.0)
        };
        assert!(
            diagnosis.findings.iter().all(|f| says_so(&f.evidence)),
            "{:?}",
            diagnosis.findings
        );
        diagnosis.findings.iter().map(|f| (f.effect.clone(), f.parameters[0].value)).collect()
    };
    let strong = found(-40.0 * NOISE);
    assert_eq!(
        strong.iter().map(|(effect, _)| effect.as_str()).collect::<Vec<_>>(),
        ["cable_stiffness"]
    );
    assert!((strong[0].1 / (-40.0 * NOISE) - 1.0).abs() < 0.1, "{strong:?}");
    // So little is a finding only where the hose pulls back: what pushes may be noise of the
    // acceleration.
    let is_hose = |(effect, _): &(String, f64)| effect == "cable_stiffness";
    assert!(found(0.4 * NOISE).iter().all(is_hose) && !found(0.4 * NOISE).is_empty());
    assert!(!found(-0.4 * NOISE).iter().any(is_hose), "{:?}", found(-0.4 * NOISE));
}

#[test]
fn nothing_hidden_is_nothing_found_and_the_same_bytes_twice() {
    let (train, test) = logs(&[]);
    let model = identified(&train);
    let run = || diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let diagnosis = run();
    assert_eq!(diagnosis.verdict, Verdict::NothingMissing, "{:?}", diagnosis.findings);
    assert!(diagnosis.probability_nothing_missing > 0.8);
    assert_eq!(diagnosis.to_json(), run().to_json());
    let untestable: Vec<&str> =
        diagnosis.not_testable.iter().map(|entry| entry.effect.as_str()).collect();
    assert!(
        untestable.contains(&"temperature_dependent_friction"),
        "no temperature was logged: {untestable:?}"
    );
}

#[test]
fn what_logs_could_have_shown_is_found_from_that_size_on_and_not_below() {
    let diagnosed = |terms: &[Term]| {
        let (train, test) = logs(terms);
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap()
    };
    let clean = diagnosed(&[]);
    let cases = [
        ("quadratic_viscous_friction", "joint_2"),
        ("torque_offset", "joint_1"),
        ("position_dependent_friction", "joint_2"),
        ("cable_stiffness", "joint_1"),
        ("asymmetric_viscous_friction", "joint_1"),
    ];
    for (effect, joint) in cases {
        let entry =
            clean.detectable.iter().find(|d| d.effect == effect && d.joints == [joint]).unwrap();
        let apart = entry.told_apart_from.unwrap();
        assert!(
            entry.visible > 0.0 && entry.visible <= 1.0 && apart >= entry.seen_from,
            "{entry:?}"
        );
        let constants: Vec<f64> = entry.constants.iter().map(|c| c.value).collect();
        let with = |size: f64| {
            let term = hidden(effect, usize::from(joint == "joint_2"), &constants, &[size]);
            // Other linear parameters of the effect are zero.
            let missing = term.effect.parameters().len() - 1;
            diagnosed(&[term.with_coefficients([vec![size], vec![0.0; missing]].concat())])
        };
        let found = with(2.0 * apart);
        let first = found.findings.first().map(|f| (f.effect.as_str(), f.joints[0].as_str()));
        assert_eq!(first, Some((effect, joint)), "{entry:?}");
        let silent = with(0.4 * entry.seen_from);
        assert_eq!(silent.findings.len(), 0, "{entry:?} {:?}", silent.findings);
    }
}

/// tau = a f(q, dq), an effect of the user's own.
struct Own(&'static str, fn(f64, f64) -> f64);

const TEETH: Own = Own("teeth", |q, _| sgn((3.0 * q).sin()));

/// Outside of the catalogue: parts of it look like friction that depends on direction, or on
/// position.
const EVEN_DRAG: Own = Own("even_drag", |q, dq| dq * dq * (1.9 * q).cos());

const AMPLITUDE: [EffectParameter; 1] = [EffectParameter::signed("a", "N·m", "N")];

impl std::fmt::Debug for Own {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(self.0)
    }
}

impl Own {
    fn at(self, joint: usize, amplitude: f64) -> Term {
        let mut term = Term::new(Arc::new(self), Site::Joint(joint), vec![]);
        term.coefficients = vec![amplitude];
        term
    }
}

impl Effect for Own {
    fn name(&self) -> &str {
        self.0
    }

    fn summary(&self) -> &str {
        "A torque that depends on the state of its joint."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &AMPLITUDE
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn trajectory_columns(
        &self,
        site: Site,
        context: &Context<'_>,
        _: &[f64],
        out: &mut [Vec<f64>],
    ) {
        let joint = site.joint().expect("at a joint");
        let states = context.of_joint(context.q, joint).zip(context.of_joint(context.dq, joint));
        for (out, (q, dq)) in out[0].iter_mut().zip(states) {
            *out = self.1(q, dq);
        }
    }
}

#[test]
fn an_effect_of_the_users_own_takes_part() {
    let (train, test) = logs(&[TEETH.at(0, 0.5)]);
    let mut options = DiagnosisOptions::default();
    options.catalogue.push(Arc::new(TEETH));
    let diagnosis = diagnose(&identified(&train), &train, &test, &options, &()).unwrap();
    let finding = &diagnosis.findings[0];
    assert_eq!(
        (finding.effect.as_str(), &finding.joints[..]),
        ("teeth", &["joint_1".to_string()][..])
    );
    assert!((finding.parameters[0].value - 0.5).abs() < 0.05);
}

/// The same log with the clock started anew.
fn restarted(log: &Recording) -> Recording {
    let stamps = log.time().iter().map(|stamp| stamp - log.time()[0]).collect();
    let names = log.joint_names().to_vec();
    let torque = log.torque().map(<[f64]>::to_vec);
    Recording::new(log.source(), names, stamps, log.position().to_vec(), None, torque, vec![])
        .unwrap()
}

#[test]
fn logs_without_a_common_clock_do() {
    let terms = [
        hidden("stribeck_friction", 1, &[0.1], &[1.0]),
        hidden("asymmetric_viscous_friction", 0, &[], &[0.3]),
    ];
    let (train, test) = logs(&terms);
    let train: Vec<Recording> = train.iter().map(restarted).collect();
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let mut found: Vec<&str> =
        diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
    found.sort_unstable();
    assert_eq!(found, ["asymmetric_viscous_friction", "stribeck_friction"]);
}

/// A contact with hundreds of times the evidence is right to one percent only, but not there most
/// of the time.
#[test]
fn a_weak_effect_is_found_beside_a_strong_contact() {
    let mut contact = Term::new(by_name("external_contact").unwrap(), Site::Arm, vec![12.0, 16.0]);
    contact.coefficients = vec![20.0, -15.0, 0.0, 0.0, 0.0, 0.0];
    let (train, test) = logs(&[contact, hidden("asymmetric_viscous_friction", 0, &[], &[0.3])]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> =
        diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["external_contact", "asymmetric_viscous_friction"]);
    let drag = &diagnosis.findings[1].parameters[0];
    assert!((drag.value - 0.3).abs() < 3.0 * drag.std.unwrap(), "{drag:?}");
}

/// Effects that imitate a torque from outside of the catalogue are no findings; in a catalogue that
/// has it, it is one.
#[test]
fn a_load_is_no_noise_to_what_is_weak_beside_it() {
    let load = [8.0, 1.0, 0.5, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.3];
    let mut payload = Term::new(by_name("payload_change").unwrap(), Site::Arm, vec![21.0]);
    payload.coefficients = load.to_vec();
    let weak = hidden("asymmetric_viscous_friction", 1, &[], &[0.05]);
    let (train, test) = logs(&[payload, weak]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> = diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    assert_eq!(found, ["payload_change", "asymmetric_viscous_friction"]);
}

#[test]
fn a_ripple_is_no_noise_to_what_is_weak_beside_it() {
    let mut ripple = hidden("torque_ripple", 0, &[17.0], &[]);
    ripple.coefficients = vec![1.5, 2.0];
    let weak = hidden("asymmetric_viscous_friction", 0, &[], &[0.06]);
    let (train, test) = logs(&[ripple, weak]);
    let diagnosis =
        diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> = diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    assert_eq!(found, ["torque_ripple", "asymmetric_viscous_friction"]);
}

#[test]
fn a_constant_torque_beside_a_wrong_gain_is_no_spring() {
    // Before the gain is right, a torque that grows with the position explains more of what it
    // leaves.
    let robot = puma560();
    let terms =
        [hidden("torque_gain_error", 4, &[-0.25], &[]), hidden("torque_offset", 3, &[], &[0.16])];
    let log = |number| log_of(&robot, &[0.3; 12], 0.0003, &terms, (number, 20.0));
    let (train, test) = ([log(0), log(1)], [log(2)]);
    let diagnosis =
        diagnose(&identified_on(&robot, &train), &train, &test, &DiagnosisOptions::default(), &())
            .unwrap();
    let mut found: Vec<&str> = diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    found.sort_unstable();
    assert_eq!(found, ["torque_gain_error", "torque_offset"]);
}

#[test]
fn gains_that_are_the_same_torque_share_their_probability() {
    // With 1.2 times the torque at one joint all parameters that it shares with the other are 1.2
    // times as large: only the robot's file says which.
    for (joint, [own, other]) in
        [["joint_1", "joint_2"], ["joint_2", "joint_1"]].into_iter().enumerate()
    {
        let (train, test) = logs(&[hidden("torque_gain_error", joint, &[0.2], &[])]);
        let diagnosis =
            diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &())
                .unwrap();
        let [finding] = &diagnosis.findings[..] else { panic!("{:?}", diagnosis.findings) };
        assert_eq!(
            (finding.effect.as_str(), finding.joints[0].as_str()),
            ("torque_gain_error", own)
        );
        assert!(
            finding.confusable_with.contains(&format!("torque_gain_error@{other}")),
            "{finding:?}"
        );
        assert!((0.4..0.5 + 1e-9).contains(&finding.probability), "{}", finding.probability);
        assert!(finding.evidence.contains("cannot tell"), "{}", finding.evidence);
    }
}

#[test]
fn forms_of_one_law_that_logs_cannot_tell_apart_share_one_probability() {
    // Coulomb friction, and forms of it with more freedom: that change with time or position.
    let Some((robot, train, test)) = hidden_case("dev02") else { return };
    let effects = ["viscous_friction", "rotor_inertia"].map(String::from).to_vec();
    let (model, _) =
        identify(&robot, &train, &IdentifyOptions::default().with_effects(effects), &()).unwrap();
    let diagnosis = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let [finding] = &diagnosis.findings[..] else { panic!("{:?}", diagnosis.findings) };
    assert_eq!(
        (finding.effect.as_str(), finding.joints[0].as_str()),
        ("coulomb_friction", "joint_1")
    );
    assert!(finding.probability > 0.9, "{finding:?}");
    assert!(
        finding.evidence.contains("these logs cannot tell which it is"),
        "{}",
        finding.evidence
    );
}

#[test]
fn what_no_effect_explains_is_said_and_is_found_once_the_catalogue_has_it() {
    let (train, test) = logs(&[EVEN_DRAG.at(0, 0.3)]);
    let model = identified(&train);
    let mut options = DiagnosisOptions::default();
    let diagnosis = diagnose(&model, &train, &test, &options, &()).unwrap();
    assert_eq!(diagnosis.verdict, Verdict::UnexplainedStructure, "{:?}", diagnosis.findings);
    assert!(diagnosis.findings.is_empty() && diagnosis.probability_unexplained > 0.8);
    assert!(
        diagnosis.unexplained[0].starts_with("joint_1: torque that depends on speed, position")
    );

    options.catalogue.push(Arc::new(EVEN_DRAG));
    let diagnosis = diagnose(&model, &train, &test, &options, &()).unwrap();
    assert_eq!(diagnosis.verdict, Verdict::EffectsFound);
    assert_eq!(diagnosis.findings.len(), 1, "{:?}", diagnosis.findings);
    assert_eq!(diagnosis.findings[0].effect, "even_drag");
    assert!((diagnosis.findings[0].parameters[0].value - 0.3).abs() < 0.03);
}

#[test]
fn an_effect_stays_where_a_law_that_no_effect_explains_is_beside_it() {
    // Beside that law a spring between two pins is as good as a linear one.
    let effects = [
        (hidden("stribeck_friction", 0, &[0.1], &[1.5]), "stribeck_friction"),
        (hidden("spring_balancer", 0, &[0.5, 0.5], &[0.0, 6.0]), "cable_stiffness"),
    ];
    for (effect, name) in effects {
        let (train, test) = logs(&[effect, EVEN_DRAG.at(0, 0.3)]);
        let diagnosis =
            diagnose(&identified(&train), &train, &test, &DiagnosisOptions::default(), &())
                .unwrap();
        let found: Vec<&str> =
            diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(found, [name]);
        assert!(diagnosis.probability_unexplained > 0.8);
    }
}

#[test]
fn a_change_between_logs_is_told_from_a_law_of_the_state_by_whole_logs() {
    // Functions of the state tell logs apart, too, and here is one that no effect explains.
    let terms = [hidden("friction_step", 0, &[60.0], &[0.05, 0.15]), EVEN_DRAG.at(0, 0.02)];
    let train: Vec<Recording> = (0..6).map(|number| log(&terms, number, 20.0)).collect();
    let diagnosis =
        diagnose(&identified(&train), &train, &[], &DiagnosisOptions::default(), &()).unwrap();
    let found: Vec<&str> =
        diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
    assert_eq!(found, ["friction_step"]);
    assert!(diagnosis.probability_unexplained > 0.8);
}

#[test]
fn too_little_data_is_said() {
    let (train, test) = logs(&[]);
    let model = identified(&train);
    let short = [log(&[], 0, 1.5)];
    let error = diagnose(&model, &short, &test, &DiagnosisOptions::default(), &()).unwrap_err();
    assert!(matches!(error, DiagnosisError::TooShort { .. }), "{error}");
}

#[test]
fn logs_that_no_model_of_one_arm_explains_are_told() {
    // The joints of one log in another order.
    let swapped = |log: &Recording| {
        let swap = |values: &[f64]| values.chunks(2).flat_map(|row| [row[1], row[0]]).collect();
        let (names, time) = (log.joint_names().to_vec(), log.time().to_vec());
        let torque = Some(swap(log.torque().unwrap()));
        Recording::new("swapped", names, time, swap(log.position()), None, torque, vec![]).unwrap()
    };
    let told = |train: &[Recording]| {
        let (model, report) = identified_with_report(&two_link(), train);
        let told = report.findings.iter().find(|finding| finding.name() == "logs_apart");
        (model, told.map(ToString::to_string))
    };
    let train = [0, 1, 2].map(|number| log(&[], number, 20.0));
    assert_eq!(told(&train).1, None);
    let train = [train[0].clone(), train[1].clone(), swapped(&train[2])];
    let (model, told) = told(&train);
    assert!(
        told.as_ref().is_some_and(|told| told.contains("they agree best without swapped")),
        "{told:?}"
    );
    let error = diagnose(&model, &train, &[], &DiagnosisOptions::default(), &()).unwrap_err();
    let DiagnosisError::LogsApart { left: [alone, together], odd, .. } = error else {
        panic!("{error}")
    };
    assert!(odd == "swapped" && together > 5.0 * alone, "{odd} {alone} {together}");
    // A load that comes with one of the logs is no other arm.
    let mut load = Term::new(by_name("payload_change").unwrap(), Site::Arm, vec![39.0]);
    load.coefficients = [&[1.0, 0.2, 0.0, 0.0][..], &[0.0; 6]].concat();
    let train: Vec<Recording> =
        (0..3).map(|number| log(std::slice::from_ref(&load), number, 20.0)).collect();
    let diagnosis =
        diagnose(&identified(&train), &train, &[], &DiagnosisOptions::default(), &()).unwrap();
    assert_eq!(diagnosis.findings[0].effect, "payload_change");
}

/// Stops at the third step.
#[derive(Default)]
struct Impatient(AtomicUsize);

impl Progress for Impatient {
    fn step(&self, _: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        if self.0.fetch_add(1, Ordering::Relaxed) < 3 { Ok(()) } else { Err(Interrupted) }
    }
}

#[test]
fn it_stops_on_request() {
    let (train, test) = logs(&[]);
    let model = identified(&train);
    let error =
        diagnose(&model, &train, &test, &DiagnosisOptions::default(), &Impatient::default())
            .unwrap_err();
    assert!(matches!(error, DiagnosisError::Interrupted(_)), "{error}");
}

/// The weight of a slide that lies level shows nowhere, and its mass is as good a rotor: what the
/// model has twice, or the file has a placeholder for, must not change what is found.
#[test]
fn a_level_slide_with_a_placeholder_mass_has_its_offset_and_its_friction() {
    let slide = |mass: f64| {
        let text = format!(
            r#"<robot name="slide"><link name="base"/><link name="table"><inertial><mass value="{mass}"/>
            <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
            <joint name="slide" type="prismatic"><parent link="base"/><child link="table"/><axis xyz="1 0 0"/>
            <limit lower="-2" upper="2" velocity="9" effort="900"/></joint></robot>"#
        );
        Robot::from_urdf_text(&text, "slide.urdf", &Default::default()).expect("a slide")
    };
    let offset = hidden("torque_offset", 0, &[], &[-3.0]);
    let asymmetric = hidden("asymmetric_viscous_friction", 0, &[], &[-5.0]);
    let terms = [offset, asymmetric];
    let train: Vec<Recording> =
        (0..2).map(|k| log_of(&slide(95.0), &[200.0, 20.0], 1.0, &terms, (k, 20.0))).collect();
    let model = |effects: &[&str]| {
        let effects = effects.iter().map(ToString::to_string).collect();
        identify(&slide(1.0), &train, &IdentifyOptions::default().with_effects(effects), &())
            .unwrap()
            .0
    };
    for rotor in [None, Some("rotor_inertia")] {
        let effects: Vec<&str> = ["viscous_friction", "coulomb_friction", "torque_offset"]
            .into_iter()
            .chain(rotor)
            .collect();
        let diagnosis =
            diagnose(&model(&effects), &train, &[], &DiagnosisOptions::default(), &()).unwrap();
        let found: Vec<&str> =
            diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
        assert_eq!(found, ["asymmetric_viscous_friction"], "{effects:?}");
        let value =
            diagnosis.findings[0].parameters.iter().find(|own| own.name.ends_with("Fva")).unwrap();
        assert!(
            (value.value + 5.0).abs() < 4.0 * value.std.unwrap_or(0.0),
            "{effects:?}: {value:?}"
        );
    }
}

#[test]
fn what_a_person_adds_is_fitted_and_judged_and_stays() {
    let (train, test) = logs(&[hidden("cable_stiffness", 1, &[], &[1.5, 0.2])]);
    let model = identified(&train);
    let by_hand = |text: &str| {
        let options = DiagnosisOptions::default().with_by_hand(vec![text.into()]);
        diagnose(&model, &train, &test, &options, &())
    };
    let right = by_hand("cable_stiffness@joint_2").unwrap();
    let [finding] = &right.findings[..] else { panic!("{:?}", right.findings) };
    let searched = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).unwrap();
    let stiffness = |finding: &sgpr_core::diagnosis::Finding| finding.parameters[0].value;
    assert!(
        (stiffness(finding) / stiffness(&searched.findings[0]) - 1.0).abs() < 1e-6,
        "{finding:?}"
    );
    assert!(
        finding.probability > 0.95
            && right.joints["joint_2"].rmse_after < 0.5 * right.joints["joint_2"].rmse_before
    );
    // Where nothing is, it is added all the same, and the probability says so.
    let wrong = by_hand("torque_ripple@joint_1").unwrap();
    assert!(
        wrong.findings.len() == 1 && wrong.findings[0].probability < 0.5,
        "{:?}",
        wrong.findings
    );
    assert_eq!(wrong.after.terms().len(), model.terms().len() + 1);
    for (text, reason) in [
        ("cable_stifness@joint_2", "there is no effect `cable_stifness`"),
        (
            "cable_stiffness@joint_9",
            "there is no joint `joint_9`; the joints are `joint_1`, `joint_2`",
        ),
        ("cable_stiffness", "it acts at a joint"),
        ("payload_change@joint_1", "it acts on the whole arm"),
        ("viscous_friction@joint_1", "the model has it at every joint"),
    ] {
        let message = by_hand(text).expect_err("cannot be added").to_string();
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn a_finding_is_written_in_full_words_and_read_in_those_of_before() {
    let text = r#"{"effect": "torque_ripple", "joints": ["joint_1"], "probability": 0.9, "score": 12.0,
        "parameters": [{"name": "joint_1.Ts", "value": 0.4, "std": 0.02, "unit": "N·m"}], "rmse_before": {},
        "rmse_after": {}, "evidence": "", "confusable_with": [], "separating_experiment": ""}"#;
    let model = TorqueModel::nominal(&two_link());
    let found = Finding::from_json(text, &model, &model).expect("a finding of version 1");
    assert_eq!(found.parameters[0].std, Some(0.02));
    let written = found.to_json();
    assert!(
        written.contains(r#""standard_deviation":0.02"#) && !written.contains(r#""std""#),
        "{written}"
    );
    let again = Finding::from_json(&written, &model, &model).expect("just written");
    assert_eq!(again.parameters, found.parameters);
}
