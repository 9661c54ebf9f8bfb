//! The parts of a diagnosis that tell why: what the error depends on, since when, a formula, what
//! to record next.
#![allow(missing_docs, clippy::unwrap_used)]

use std::sync::Arc;

use sgpr_core::diagnosis::{
    Diagnosis, DiagnosisOptions, Finding, JointStructure, Verdict, diagnose, structure_of_logs,
};
use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Context, Effect, EffectParameter, Entry, Site, by_name};
use sgpr_core::model::{IdentifyOptions, Term, TorqueModel, Trajectory, compare, identify};
use sgpr_core::recording::Recording;
use sgpr_core::robot::two_link;

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

/// Position, velocity and acceleration, `[samples, n]`.
type Motion = [Vec<f64>; 3];

/// Waves of both joints: (size, pulse, phase).
fn waves(seconds: f64, of_joint: [&[(f64, f64, f64)]; 2]) -> Motion {
    let mut motion: Motion = Default::default();
    for k in 0..(seconds * RATE) as usize {
        let t = k as f64 / RATE;
        for waves in of_joint {
            let sum = |f: &dyn Fn(f64, f64, f64) -> f64| {
                waves.iter().map(|(a, w, p)| f(*a, *w, *p)).sum::<f64>()
            };
            motion[0].push(sum(&|a, w, p| a * (w * t + p).sin()));
            motion[1].push(sum(&|a, w, p| a * w * (w * t + p).cos()));
            motion[2].push(sum(&|a, w, p| -a * w * w * (w * t + p).sin()));
        }
    }
    motion
}

/// A rich motion; `number` makes it another one.
fn rich(seconds: f64, number: usize) -> Motion {
    let turned = |joint: usize| {
        let phase = (joint + 2 * number) as f64;
        [(0.7, 0.9), (0.4, 2.3), (0.2, 4.1)]
            .map(|(size, pulse)| (size, pulse * (1.0 + 0.13 * phase), phase))
    };
    waves(seconds, [&turned(0), &turned(1)])
}

/// Viscous and Coulomb friction of both joints.
const FRICTION: [f64; 4] = [0.8, 1.0, 0.5, 0.6];

/// A log of the two-link arm with `friction` and `terms`.
fn log(friction: [f64; 4], terms: &[Term], motion: &Motion, start: f64, seed: u64) -> Recording {
    let robot = two_link();
    let mut parameters = robot.standard_parameters();
    parameters.extend(friction);
    let model = TorqueModel::with_parameters(&robot, &BASE, parameters)
        .unwrap()
        .with_terms(terms.to_vec(), Some(0));
    let [q, dq, ddq] = motion;
    let time: Vec<f64> = (0..q.len() / 2).map(|k| start + k as f64 / RATE).collect();
    let trajectory =
        Trajectory::of_samples(Samples { q, dq, ddq }).with_rate_hz(RATE).with_time(&time);
    let mut noise = Noise(12345 + seed);
    let tau = model
        .predict_trajectory(&trajectory)
        .into_iter()
        .map(|tau| tau + NOISE * noise.next())
        .collect();
    let q = q.iter().map(|q| q + 1e-6 * noise.next()).collect();
    let stamps = time.iter().map(|t| (t * 1e9).round() as i64).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new(format!("log {seed}"), names, stamps, q, None, Some(tau), vec![]).unwrap()
}

fn logs(terms: &[Term]) -> Vec<Recording> {
    (0..2)
        .map(|number| {
            log(FRICTION, terms, &rich(20.0, number), 20.0 * number as f64, number as u64)
        })
        .collect()
}

fn identified(train: &[Recording], effects: &[&str]) -> TorqueModel {
    let effects = effects.iter().map(|effect| (*effect).to_string()).collect();
    identify(&two_link(), train, &IdentifyOptions::default().with_effects(effects), &()).unwrap().0
}

fn diagnosed(train: &[Recording], effects: &[&str], look_for: &[&str]) -> Diagnosis {
    let mut options = DiagnosisOptions::default();
    if !look_for.is_empty() {
        options.catalogue = look_for.iter().map(|name| by_name(name).unwrap()).collect();
    }
    diagnose(&identified(train, effects), train, &[], &options, &()).unwrap()
}

fn of<'a>(list: &'a [JointStructure], joint: &str) -> &'a JointStructure {
    list.iter().find(|one| one.joint == joint).unwrap()
}

#[test]
fn what_the_error_depends_on_is_said() {
    // The model has no viscous friction; the robot has 1.0 N·m·s/rad at joint 2.
    let train = logs(&[]);
    let diagnosis = diagnosed(&train, &["coulomb_friction"], &["viscous_friction"]);
    let before = of(&diagnosis.structure, "joint_2");
    assert!(before.whiteness < 1e-6);
    assert!(before.shares.state > 0.9, "{:?}", before.shares);
    assert_eq!(before.inputs[0].variable, "speed of joint_2");
    assert!(before.shape.iter().any(|words| words == "odd in the speed"), "{:?}", before.shape);
    assert_eq!(before.change, None);
    for left in &diagnosis.left {
        assert!(left.whiteness > before.whiteness && !left.has_structure(), "{left:?}");
        assert!(
            (left.rmse / NOISE - 0.7).abs() < 0.1,
            "noise in a band of half of all frequencies: {}",
            left.rmse
        );
    }

    // The same from a comparison with a log that the model has not seen.
    let test = [log(FRICTION, &[], &rich(20.0, 2), 0.0, 2)];
    let comparison = compare(&diagnosis.before, &test, None).unwrap();
    let found = structure_of_logs(&diagnosis.before, &comparison.logs.iter().collect::<Vec<_>>());
    assert_eq!(of(&found, "joint_2").inputs[0].variable, "speed of joint_2");
    assert!(of(&found, "joint_2").shares.state > 0.8);
}

#[test]
fn a_change_is_dated() {
    let step = by_name("friction_step").unwrap();
    let mut term = Term::new(step.clone(), Site::Joint(1), vec![17.0]);
    term.coefficients = vec![0.6; step.parameters().len()];
    let diagnosis = diagnosed(&logs(&[term]), &BASE, &["friction_step"]);
    let change =
        of(&diagnosis.structure, "joint_2").change.clone().expect("friction grows at 17 s");
    assert!((change.time - 17.0).abs() < 0.5, "{change:?}");
    assert!(change.interval[0] <= 17.0 && change.interval[1] >= 17.0, "{change:?}");
    assert!(change.probability > 0.99 && change.end.is_none(), "{change:?}");
    assert_eq!(of(&diagnosis.left, "joint_2").change, None);
}

/// tau = a dq of the other joint · cos q: no effect of the catalogue.
#[derive(Debug)]
struct Cross;

const CROSS: [EffectParameter; 1] = [EffectParameter::signed("a", "N·m·s/rad", "N·s/m")];

impl Effect for Cross {
    fn name(&self) -> &str {
        "cross"
    }

    fn summary(&self) -> &str {
        "A torque by the speed of the other joint."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &CROSS
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
        let other = context.of_joint(context.dq, 1 - joint);
        for ((out, q), dq) in out[0].iter_mut().zip(context.of_joint(context.q, joint)).zip(other) {
            *out = dq * q.cos();
        }
    }
}

#[test]
fn a_formula_is_proposed_for_what_no_effect_explains() {
    let mut term = Term::new(Arc::new(Cross), Site::Joint(0), vec![]);
    term.coefficients = vec![0.9];
    let diagnosis = diagnosed(&logs(&[term]), &BASE, &["cable_stiffness", "stribeck_friction"]);
    assert_eq!(diagnosis.verdict, Verdict::UnexplainedStructure);
    let [formula] = &diagnosis.formulas[..] else { panic!("{:?}", diagnosis.formulas) };
    assert_eq!(formula.joint, "joint_1");
    let best = &formula.terms[0];
    assert_eq!(best.function, "cos q(joint_1) · dq(joint_2)");
    assert!((best.coefficient - 0.9).abs() < f64::max(0.045, 3.0 * best.std), "{best:?}");
    assert_eq!(best.unit, "N·m/(rad/s)");
    assert!(best.stability > 0.7 && formula.explained > 0.9, "{formula:?}");
}

#[test]
fn the_proposed_motion_tells_dry_friction_from_viscous() {
    // Joint 2 swings with one frequency, and its friction is a quarter of the noise: sgn(dq) and dq
    // look alike.
    let pair = ["viscous_friction", "coulomb_friction"];
    let swing = waves(14.0, [&[(0.7, 1.1, 0.3), (0.3, 2.9, 1.0)], &[(0.5, 3.0, 0.5)]]);
    for (truth, friction) in
        [(pair[0], [0.0, 0.0125, 0.0, 0.0]), (pair[1], [0.0, 0.0, 0.0, 0.0135])]
    {
        let train = [log(friction, &[], &swing, 0.0, 3)];
        let diagnosis = diagnosed(&train, &[], &pair);
        assert_eq!(diagnosis.verdict, Verdict::EffectsFound, "{truth}");
        let [next] = &diagnosis.next_experiment[..] else {
            panic!("{truth}: {:?}", diagnosis.findings)
        };
        assert!(
            pair.iter().all(|name| next.about.iter().any(|one| one == name)),
            "{:?}",
            next.about
        );
        assert!(next.separation_now < 12.0 && next.separation_expected > 20.0, "{next:?}");

        // Within what the logs show, from rest to rest.
        let motion = diagnosis.next_motion().unwrap();
        let largest =
            |values: &[f64]| values.iter().skip(1).step_by(2).map(|x| x.abs()).fold(0.0, f64::max);
        assert!(
            largest(&motion.q) < 0.51 && largest(&motion.dq) < 1.52 && largest(&motion.ddq) < 4.6
        );
        for end in [0, motion.len() - 1] {
            let rates =
                motion.dq[2 * end..2 * end + 2].iter().chain(&motion.ddq[2 * end..2 * end + 2]);
            assert!(rates.into_iter().all(|x| *x == 0.0));
        }

        // Recorded beside the log, it decides.
        let recorded = log(friction, &[], &[motion.q, motion.dq, motion.ddq], 60.0, 9);
        let all = [&train[..], &[recorded]].concat();
        let again = diagnosed(&all, &[], &pair);
        let score = |name: &str| {
            let of_joint_2 = |f: &&Finding| f.effect == name && f.joints == ["joint_2"];
            again.candidates.iter().find(of_joint_2).map_or(f64::NEG_INFINITY, |f| f.score)
        };
        let other = if truth == pair[0] { pair[1] } else { pair[0] };
        assert!(
            score(truth) > score(other) + 12.0,
            "{truth} {}, {other} {}",
            score(truth),
            score(other)
        );
        assert!(again.next_experiment.is_empty(), "{:?}", again.next_experiment);
    }
}

#[test]
fn the_proposed_motion_shows_a_spring_behind_an_offset() {
    // Joint 2 swings with one frequency: a spring looks like a rotor's inertia, which the model
    // has, and an offset.
    let swing = waves(14.0, [&[(0.7, 1.1, 0.3), (0.3, 2.9, 1.0)], &[(0.5, 3.0, 0.5)]]);
    let known = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut spring = Term::new(by_name("cable_stiffness").unwrap(), Site::Joint(1), vec![]);
    spring.coefficients = vec![0.9, 0.3];
    let terms = [spring];
    let train = [log(FRICTION, &terms, &swing, 0.0, 3)];
    let diagnosis = diagnosed(&train, &known, &["torque_offset", "cable_stiffness"]);
    assert_eq!(diagnosis.findings[0].effect, "torque_offset", "{:?}", diagnosis.findings);
    let [next] = &diagnosis.next_experiment[..] else { panic!("{:?}", diagnosis.findings) };
    assert!(
        next.about.contains(&"cable_stiffness".into()) && next.separation_now < 12.0,
        "{next:?}"
    );
    assert!(next.separation_expected > 24.0, "{next:?}");

    let motion = diagnosis.next_motion().unwrap();
    let recorded = log(FRICTION, &terms, &[motion.q, motion.dq, motion.ddq], 60.0, 9);
    let again = diagnosed(
        &[&train[..], &[recorded]].concat(),
        &known,
        &["torque_offset", "cable_stiffness"],
    );
    let [finding] = &again.findings[..] else { panic!("{:?}", again.findings) };
    assert_eq!(finding.effect, "cable_stiffness");
    let k = finding.parameters[0].value;
    assert!((k - 0.9).abs() < 0.09, "{k}");
}
