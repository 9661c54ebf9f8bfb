//! Effects with constants, identified with everything else: they come out as they were put in, and
//! bodies stay bodies.

use sgpr_core::diagnosis::{DiagnosisOptions, add, diagnose};
use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Entry, Site, by_name, registry};
use sgpr_core::identification::{
    self, BaseParameters, Consistency, Equations, LinkBounds, OUTPUT_ERROR, ParameterSet,
    PhysicalBounds,
};
use sgpr_core::model::{
    Controller, IdentifyError, IdentifyOptions, Term, TorqueModel, Trajectory, compare, identify,
};
use sgpr_core::motion::{Conditioning, Motion};
use sgpr_core::recording::{Channel, Recording};
use sgpr_core::robot::{Robot, two_link};

use crate::noise::Noise;

const RATE: f64 = 100.0;
/// Effect, site, constants, coefficients, and by which share the constants may be off.
type Case = (&'static str, Site, &'static [f64], &'static [f64], f64);

const FRICTION: [&str; 2] = ["viscous_friction", "coulomb_friction"];

fn put_in(name: &str, site: Site, constants: &[f64], coefficients: &[f64]) -> Term {
    let mut term =
        Term::new(by_name(name).expect("an effect of the library"), site, constants.to_vec());
    term.coefficients = coefficients.to_vec();
    term
}

/// A log of the two-link arm with friction and `terms`, torque noise of standard deviation `noise`.
fn log(robot: &Robot, terms: &[Term], seconds: f64, phase: f64, noise: f64) -> Recording {
    log_with(robot, terms, seconds, phase, noise, &mut Noise(11))
}

fn log_with(
    robot: &Robot,
    terms: &[Term],
    seconds: f64,
    phase: f64,
    noise: f64,
    random: &mut Noise,
) -> Recording {
    let mut parameters = robot.standard_parameters();
    parameters.extend([0.8, 1.0, 0.5, 0.6]);
    let model =
        TorqueModel::with_parameters(robot, &FRICTION, parameters).expect("effects of the library");
    let model = model.with_terms(terms.to_vec(), Some(0));
    let (mut q, mut dq, mut ddq, mut time) = (vec![], vec![], vec![], vec![]);
    for k in 0..(seconds * RATE) as usize {
        let t = k as f64 / RATE;
        time.push(t);
        for joint in 0..2 {
            let shift = phase + joint as f64;
            let waves = [(0.7, 0.9), (0.4, 2.3), (0.2, 4.1)]
                .map(|(size, pulse)| (size, pulse * (1.0 + 0.13 * shift)));
            let sum =
                |f: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, w)| f(*a, *w)).sum::<f64>();
            q.push(sum(&|a, w| a * (w * t + shift).sin()));
            dq.push(sum(&|a, w| a * w * (w * t + shift).cos()));
            ddq.push(sum(&|a, w| -a * w * w * (w * t + shift).sin()));
        }
    }
    let temperature =
        Channel { name: "temperature".into(), values: time.iter().map(|t| 20.0 + t).collect() };
    let channels = vec![temperature];
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let torque = model.predict_trajectory(
        &Trajectory::of_samples(samples)
            .with_rate_hz(RATE)
            .with_time(&time)
            .with_channels(&channels),
    );
    let tau = torque.into_iter().map(|tau| tau + noise * random.normal()).collect();
    let stamps = time.iter().map(|t| (t * 1e9).round() as i64).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new("simulated", names, stamps, q, None, Some(tau), channels).expect("a log")
}

fn options(more: &[&str]) -> IdentifyOptions {
    IdentifyOptions::default()
        .with_effects(FRICTION.iter().chain(more).map(|name| name.to_string()).collect())
        .with_conditioning(Conditioning::default().with_cutoff_hz(Some(12.0)))
}

#[test]
fn constants_come_out_as_they_were_put_in() {
    let robot = two_link();
    let second = Site::Joint(1);
    // Filters round reversals off.
    let cases: [Case; 8] = [
        ("cable_hysteresis", second, &[0.3], &[1.5], 0.05),
        ("stribeck_friction", second, &[0.2], &[1.0], 0.1),
        ("torque_ripple", second, &[7.0], &[0.4, 0.3], 0.02),
        ("torque_gain_error", second, &[0.1], &[], 0.05),
        // Amperes that are taken for newton metres, by a drive of another size.
        ("torque_gain_error", second, &[1.2], &[], 0.05),
        ("torque_gain_error", second, &[-0.5], &[], 0.05),
        ("torque_delay", Site::Arm, &[0.02], &[], 0.1),
        ("joint_elasticity", second, &[0.002], &[], 0.1),
    ];
    for (name, site, constants, coefficients, tolerance) in cases {
        let term = put_in(name, site, constants, coefficients);
        let logs = [log(&robot, std::slice::from_ref(&term), 20.0, 0.0, 1e-3)];
        let place = if site == Site::Arm { name.to_string() } else { format!("{name}@joint_2") };
        let (model, _) = identify(&robot, &logs, &options(&[&place]), &()).expect("good data");
        let found = model.terms();
        assert_eq!(found.len(), 1, "{name}");
        assert_eq!((found[0].effect.name(), found[0].site), (name, site));
        for (value, truth) in found[0].constants.iter().zip(constants) {
            assert!(
                (value - truth).abs() < tolerance * truth.abs(),
                "{name}: {:?}, {constants:?}",
                found[0].constants
            );
        }
        for (value, truth) in found[0].coefficients.iter().zip(coefficients) {
            assert!(
                (value - truth).abs() < 0.1 * truth.abs(),
                "{name}: {:?}, {coefficients:?}",
                found[0].coefficients
            );
        }
        assert!(
            found[0].constant_deviations.iter().all(|deviation| *deviation > 0.0),
            "{name}: {:?}",
            found[0]
        );
        let error = |model: &TorqueModel| {
            let other = [log(&robot, std::slice::from_ref(&term), 20.0, 0.7, 0.0)];
            compare(model, &other, None).expect("a log").relative_error_percent
        };
        let (plain, _) = identify(&robot, &logs, &options(&[]), &()).expect("good data");
        assert!(
            error(&model) < 0.3 * error(&plain),
            "{name}: {} of {}",
            error(&model),
            error(&plain)
        );
        let again = TorqueModel::from_bytes(&model.to_bytes(), "memory").expect("a model");
        assert_eq!(error(&again), error(&model));
    }
}

/// Share of the samples of joint 2, on another motion and over many experiments, that lie within
/// 1.96 standard deviations of the truth: with the covariance of all estimates, and with that of
/// the base parameters alone.
fn coverage(terms: &[Term], noise: f64, experiments: usize) -> [f64; 2] {
    let robot = two_link();
    let names: Vec<String> =
        terms.iter().map(|term| format!("{}@joint_2", term.effect.name())).collect();
    let options = options(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let (first, _) = identify(&robot, &[log(&robot, terms, 12.0, 0.0, noise)], &options, &())
        .expect("good data");
    let truth = [log(&robot, terms, 12.0, 0.4, 0.0)];
    let truth = compare(&TorqueModel::nominal(&robot), &truth, first.processing()).expect("a log");
    let (expected, motion) = (truth.logs[0].measured(), &truth.logs[0].motion);
    let mut random = Noise(41);
    let (mut hits, mut count) = ([0u32; 2], 0u32);
    for _ in 0..experiments {
        let train = [log_with(&robot, terms, 12.0, 0.0, noise, &mut random)];
        let (model, _) = identify(&robot, &train, &options, &()).expect("good data");
        let kept = TorqueModel::from_bytes(&model.to_bytes(), "memory").expect("a model");
        let (predicted, deviation) =
            (model.predict_motion(motion), kept.standard_deviation_of(motion).expect("an arm"));
        assert_eq!(deviation, model.standard_deviation_of(motion).expect("an arm"));
        let of_base = deviation_of_base(&model, motion);
        // Every tenth sample.
        for k in (1..expected.len()).step_by(20) {
            let error = (predicted[k] - expected[k]).abs();
            hits[0] += u32::from(error < 1.96 * deviation[k]);
            hits[1] += u32::from(error < 1.96 * of_base[k]);
            count += 1;
        }
    }
    hits.map(|hits| f64::from(hits) / f64::from(count))
}

/// sqrt(y C yᵀ) with the rows y and the covariance C of the base parameters, `[samples * n]`.
fn deviation_of_base(model: &TorqueModel, motion: &Motion) -> Vec<f64> {
    let (robot, fit) = (model.robot(), model.fit().expect("just identified"));
    let set = ParameterSet::new(robot, &FRICTION).expect("effects of the library");
    let base = BaseParameters::new(robot, &set);
    let zeros = vec![0.0; motion.q.len()];
    let rows = identification::Trajectory::new(motion.samples(), &zeros);
    let (rank, dof) = (base.rank(), robot.dof());
    let mut deviation = zeros.clone();
    let mut equations = Equations::new(robot, &set, &base, vec![rows]);
    let visited = equations.for_each(|equation| {
        let pairs = || equation.columns.iter().zip(equation.row);
        let products = pairs()
            .flat_map(|(i, a)| pairs().map(move |(j, b)| a * b * fit.covariance[i * rank + j]));
        deviation[equation.sample * dof + equation.joint] = products.sum::<f64>().sqrt();
    });
    visited.expect("finite samples");
    deviation
}

#[test]
fn bands_of_the_torque_know_of_effects_and_their_constants() {
    // What is not known of Stribeck friction is not known of Coulomb friction either, whose
    // deviation covers for it (so it is with hysteresis); a ripple is nothing that base parameters
    // could take for theirs.
    let cases: [(&str, &[f64], &[f64], f64); 2] =
        [("stribeck_friction", &[0.3], &[1.5], 0.96), ("torque_ripple", &[7.0], &[0.4, 0.3], 0.9)];
    for (name, constants, coefficients, most) in cases {
        let [all, base] =
            coverage(&[put_in(name, Site::Joint(1), constants, coefficients)], 0.5, 50);
        println!("{name}: bands cover {all:.3}, without what is not known of the effect {base:.3}");
        // Errors along one motion go together: fifty experiments of some twenty parameters.
        assert!((0.93..0.975).contains(&all) && base < all.min(most), "{name}: {all} {base}");
    }
}

#[test]
fn bands_of_the_torque_know_of_a_scale_beside_other_effects() {
    for gain in [-0.4, 0.9] {
        let scale = put_in("torque_gain_error", Site::Joint(1), &[gain], &[]);
        let friction = put_in("stribeck_friction", Site::Joint(1), &[0.3], &[1.5]);
        let [all, _] = coverage(&[scale, friction], 0.5, 50);
        println!("gain {gain}: bands cover {all:.3}");
        assert!((0.93..0.975).contains(&all), "gain {gain}: {all}");
    }
}

#[test]
fn every_effect_of_the_torque_can_be_identified() {
    let robot = two_link();
    let logs = [log(&robot, &[], 12.0, 0.0, 0.02)];
    let error =
        |model: &TorqueModel| compare(model, &logs, None).expect("a log").relative_error_percent;
    let (plain, _) = identify(&robot, &logs, &options(&[]), &()).expect("good data");
    let mut worse = Vec::new();
    for effect in registry().iter().filter(|effect| effect.entry() != Entry::Gate) {
        let (model, _) = identify(&robot, &logs, &options(&[effect.name()]), &())
            .unwrap_or_else(|error| panic!("{}: {error}", effect.name()));
        // More freedom, which noise fills a little.
        if error(&model) > 1.01 * error(&plain) {
            worse.push((effect.name().to_string(), error(&model)));
        }
    }
    assert!(worse.is_empty(), "{worse:?} after {}", error(&plain));
    let gate = identify(&robot, &logs, &options(&["time_base_error"]), &())
        .expect_err("no effect of the torque");
    assert!(matches!(gate, IdentifyError::NotTestable { .. }), "{gate}");
}

#[test]
fn a_consistent_arm_with_a_cable_stays_one_when_an_effect_is_added() {
    let robot = two_link();
    let cable = [put_in("cable_hysteresis", Site::Joint(1), &[0.3], &[1.5])];
    let (train, test) =
        ([log(&robot, &cable, 30.0, 0.0, 0.05)], [log(&robot, &cable, 20.0, 0.7, 0.05)]);
    let joint = robot.joint_names().next().expect("a joint").to_string();
    let links = vec![LinkBounds::new(joint).with_mass(Some([0.1, f64::INFINITY]))];
    let bounds = PhysicalBounds::default().with_links(links);
    let consistency = Some(Consistency::default().with_bounds(bounds.clone()));
    let (model, _) =
        identify(&robot, &train, &options(&[]).with_consistency(consistency), &()).expect("an arm");
    let model = TorqueModel::from_bytes(&model.to_bytes(), "memory").expect("a model");
    let certificate =
        |model: &TorqueModel| model.fit().and_then(|fit| fit.consistency.clone()).expect("bodies");
    assert_eq!(certificate(&model).bounds, bounds);

    let diagnosis =
        diagnose(&model, &train, &test, &DiagnosisOptions::default(), &()).expect("good data");
    let finding = diagnosis.findings.iter().find(|finding| finding.effect == "cable_hysteresis");
    let added = add(&model, &[finding.expect("what was hidden")], &train).expect("good data");
    assert!(certificate(&added).links.iter().all(|link| link.relative_eigenvalue > 0.0));
    assert_eq!(certificate(&added).bounds, bounds);
    let term = &added.terms()[0];
    assert!(
        (term.constants[0] - 0.3).abs() < 0.05 && (term.coefficients[0] - 1.5).abs() < 0.2,
        "{term:?}"
    );
    let error =
        |model: &TorqueModel| compare(model, &test, None).expect("a log").relative_error_percent;
    assert!(error(&added) < 0.5 * error(&model), "{} of {}", error(&added), error(&model));
    assert!(
        added.provenance().history.last().is_some_and(|line| line.contains("cable_hysteresis"))
    );
}

#[test]
fn what_cannot_be_is_said() {
    let robot = two_link();
    let logs = [log(&robot, &[], 6.0, 0.0, 0.02)];
    let failed = |options: &IdentifyOptions| {
        identify(&robot, &logs, options, &()).expect_err("it cannot be")
    };
    let nowhere = failed(&options(&["cable_hysteresis@elbow"]));
    assert!(nowhere.to_string().contains("joint_2"), "{nowhere}");
    let whole = failed(&options(&["base_tilt@joint_1"]));
    assert!(whole.to_string().contains("whole arm"), "{whole}");
    let simulated = failed(
        &options(&["stribeck_friction"])
            .with_method(OUTPUT_ERROR.method())
            .with_controller(Some(Controller { kp: vec![1.0; 2], kd: vec![1.0; 2] })),
    );
    assert!(matches!(simulated, IdentifyError::NotSimulated { .. }), "{simulated}");
    let names = robot.joint_names().map(String::from).collect();
    let tau = logs[0].torque().map(<[f64]>::to_vec);
    let cold = [Recording::new(
        "no temperature",
        names,
        logs[0].time().to_vec(),
        logs[0].position().to_vec(),
        None,
        tau,
        vec![],
    )
    .expect("a log")];
    let cold = identify(&robot, &cold, &options(&["temperature_dependent_friction"]), &())
        .expect_err("no temperature");
    assert!(matches!(cold, IdentifyError::NotTestable { .. }), "{cold}");
}
