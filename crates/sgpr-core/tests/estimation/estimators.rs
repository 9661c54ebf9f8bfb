//! Every estimator on the same data: they agree where there is no noise, and each does what it is
//! for where there is some.

use sgpr_core::identification::{
    ESTIMATORS, Equations, Estimate, INSTRUMENTAL_VARIABLES, IRLS, IdentificationError,
    JointFactor, Method, OUTPUT_ERROR, RECURSIVE, RIDGE, Row, SimulatedMotion, TOTAL_LEAST_SQUARES,
    estimate, residual_correlation,
};

use crate::arm::{Experiment, largest_difference, trajectory};
use crate::noise::Noise;

fn every_method() -> Vec<Method> {
    let beyond = ESTIMATORS.iter().map(|estimator| estimator.method());
    let plain = [Method::Ols, Method::Wls, Method::WlsKnown(vec![2.0, 1.0]), RECURSIVE.with(0.999)];
    plain.into_iter().chain(beyond).collect()
}

#[test]
fn every_choice_is_a_method() {
    assert!(Method::choices().contains(&"irls:THRESHOLD".into()), "{:?}", Method::choices());
    for choice in Method::choices() {
        let (name, with_setting) =
            choice.split_once(':').map_or((&*choice, false), |(name, _)| (name, true));
        let text = if with_setting { format!("{name}:0.25") } else { choice.clone() };
        let method: Method = text.parse().expect("a choice");
        assert_eq!(method.name(), name);
        assert!(
            !with_setting || matches!(method, Method::By(_, setting) if setting == 0.25),
            "{method:?}"
        );
    }
    assert_eq!("rls".parse(), Ok(RECURSIVE.with(1.0)));
    for text in ["", "lasso", "wls:2", "iv:1", "irls:", "irls:x"] {
        let error = text.parse::<Method>().expect_err("no method").to_string();
        assert!(
            error.contains(&format!("`{text}`")) && error.contains("tls:RELATIVE_NOISE"),
            "{error}"
        );
    }
}

#[test]
fn without_noise_all_agree() {
    let experiment = Experiment::new(2000);
    let motion = experiment.run(&experiment.truth);
    let expected = experiment.expected();
    for method in every_method() {
        let estimate = experiment.estimate(&method, &motion, &motion.tau).expect("good data");
        let error = largest_difference(&estimate.values, &expected);
        assert!(error < 1e-9, "{}: {error:e}", method.name());
        assert_eq!(estimate.covariance.nrows(), expected.len());
        assert!(
            estimate.standard_deviations().iter().all(|deviation| *deviation < 1e-3),
            "{}",
            method.name()
        );
    }
}

#[test]
fn a_few_rows_at_rest_do_not_take_over() {
    let experiment = Experiment::new(2000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(5);
    let mut tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.2 * noise.normal()).collect();
    let mut rows = vec![Row::Moving; tau.len()];
    for k in [100, 101, 900, 901, 1500] {
        // Held by dry friction, with any torque.
        rows[2 * k] = Row::Resting;
        tau[2 * k] += 3.0;
    }
    let trajectory = trajectory(&motion, &tau).with_use_as(Some(&rows));
    for method in [Method::Wls, IRLS.method()] {
        let mut equations =
            Equations::new(&experiment.robot, &experiment.set, &experiment.base, vec![trajectory]);
        let factors = equations.factors().expect("good data");
        let found = estimate(&method, &mut equations, &factors, &experiment.nominal(), None)
            .expect("good data");
        let error = largest_difference(&found.values, &experiment.expected());
        assert!(error < 0.1, "{}: {error}", method.name());
    }
}

#[test]
fn huber_is_not_moved_by_a_few_wrong_torques() {
    let experiment = Experiment::new(3000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(3);
    let mut outlier = |k: usize| 0.1 * noise.normal() + if k % 23 == 4 { 8.0 } else { 0.0 };
    let tau: Vec<f64> = motion.tau.iter().enumerate().map(|(k, tau)| tau + outlier(k)).collect();
    let expected = experiment.expected();
    let robust = experiment.estimate(&IRLS.method(), &motion, &tau).expect("good data");
    let plain = experiment.estimate(&Method::Wls, &motion, &tau).expect("good data");
    let (robust_error, plain_error) = (
        largest_difference(&robust.values, &expected),
        largest_difference(&plain.values, &expected),
    );
    assert!(robust_error < 0.25 * plain_error, "{robust_error} {plain_error}");
    assert!(robust.noise.iter().all(|noise| (noise - 0.1).abs() < 0.02), "{:?}", robust.noise);
    for ((value, expected), deviation) in
        robust.values.iter().zip(&expected).zip(robust.standard_deviations())
    {
        assert!((value - expected).abs() < 5.0 * deviation, "{value} {expected} {deviation}");
    }
}

#[test]
fn a_log_that_the_model_describes_badly_does_not_pull_the_parameters() {
    let experiment = Experiment::new(3000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(29);
    let calm: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.05 * noise.normal()).collect();
    // What the parameters cannot describe, but can imitate in part: in the second log, not in the
    // first.
    let lacking: Vec<f64> =
        motion.tau.iter().zip(&motion.q).map(|(tau, q)| tau + 3.0 * (5.0 * q).sin()).collect();
    let expected = experiment.expected();
    let found = |logs: &[&[f64]]| {
        let trajectories = logs.iter().map(|tau| trajectory(&motion, tau)).collect();
        let mut equations =
            Equations::new(&experiment.robot, &experiment.set, &experiment.base, trajectories);
        let factors = equations.factors().expect("good data");
        solve(&IRLS.method(), &mut equations, &factors, &experiment.nominal())
    };
    let error = |logs: &[&[f64]]| largest_difference(&found(logs).values, &expected);
    let (alone, bad, both) = (error(&[&calm]), error(&[&lacking]), error(&[&calm, &lacking]));
    assert!(bad > 30.0 * alone, "{bad} {alone}");
    // One scale for both logs would leave a good part of the error of the second.
    assert!(both < 0.1 * bad, "{both} {bad} {alone}");
    // The same log twice is one log.
    let twice = largest_difference(&found(&[&calm, &calm]).values, &found(&[&calm]).values);
    assert!(twice < 1e-6, "{twice}");
}

#[test]
fn a_narrow_prior_stays_at_the_robot_file_and_a_wide_one_is_weighted_least_squares() {
    let experiment = Experiment::new(1000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(5);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + noise.normal()).collect();
    let solve =
        |method: Method| experiment.estimate(&method, &motion, &tau).expect("good data").values;
    let narrow = solve(RIDGE.with(1e-7));
    let (set, base, nominal) = (&experiment.set, &experiment.base, experiment.nominal());
    let mut free = 0;
    for (k, value) in narrow.iter().enumerate() {
        let effect = |parameter: usize| parameter >= set.inertial();
        let own = base.independent()[k];
        if effect(own) || base.combination(k).iter().any(|(parameter, _)| effect(*parameter)) {
            free += 1;
        } else {
            assert!(
                (value - nominal[k]).abs() < 1e-5,
                "{}: {value} {}",
                base.names()[k],
                nominal[k]
            );
        }
    }
    assert!((4..narrow.len()).contains(&free), "{free}");
    // The robot file says nothing of friction, so nothing draws it to zero: with the right bodies
    // it is what it is.
    let mut bodies = experiment.truth.clone();
    bodies[set.inertial()..].fill(0.0);
    let mut equations =
        Equations::new(&experiment.robot, set, base, vec![trajectory(&motion, &tau)]);
    let factors = equations.factors().expect("good data");
    let method = RIDGE.with(1e-3);
    let found = estimate(&method, &mut equations, &factors, &base.combine(&bodies), None)
        .expect("good data");
    for (k, expected) in experiment.expected().iter().enumerate() {
        if base.independent()[k] >= set.inertial() {
            let (value, deviation) = (found.values[k], found.standard_deviations()[k]);
            assert!(
                (value - expected).abs() < 4.0 * deviation,
                "{}: {value} {expected}",
                base.names()[k]
            );
            assert!(value / expected > 0.5, "{}: {value} {expected}", base.names()[k]);
        }
    }
    let wide = solve(RIDGE.with(1e7));
    assert!(largest_difference(&wide, &solve(Method::Wls)) < 1e-6);
}

#[test]
fn noise_in_the_positions_biases_least_squares_and_neither_instruments_nor_output_error() {
    let experiment = Experiment::new(6000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(11);
    let mut noisy = motion.clone();
    noisy.ddq.iter_mut().for_each(|ddq| *ddq += 2.0 * noise.normal());
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.5 * noise.normal()).collect();
    let expected = experiment.expected();
    let distance = |method: Method| {
        let estimate = experiment.estimate(&method, &noisy, &tau).expect("good data");
        let deviations = estimate.standard_deviations();
        let error = estimate
            .values
            .iter()
            .zip(&expected)
            .zip(&deviations)
            .map(|((a, b), s)| ((a - b) / s).abs());
        error.fold(0.0, f64::max)
    };
    let (plain, instruments, output) = (
        distance(Method::Wls),
        distance(INSTRUMENTAL_VARIABLES.method()),
        distance(OUTPUT_ERROR.method()),
    );
    assert!(plain > 8.0, "least squares is {plain} standard deviations off");
    assert!(instruments < 4.0 && output < 4.0, "{instruments} {output}");
}

#[test]
fn forgetting_follows_a_payload_that_is_picked_up() {
    let experiment = Experiment::new(4000);
    let motion = experiment.run(&experiment.truth);
    let mut loaded = experiment.truth.clone();
    // A point mass of 0.5 kg at the tip, one metre out.
    loaded[10] += 0.5;
    let (before, after) = (experiment.expected(), experiment.base.combine(&loaded));
    let later = experiment.run(&loaded);
    let join = |a: &[f64], b: &[f64]| [a, b].concat();
    let mut noise = Noise(13);
    let both = SimulatedMotion {
        q: join(&motion.q, &later.q),
        dq: join(&motion.dq, &later.dq),
        ddq: join(&motion.ddq, &later.ddq),
        tau: join(&motion.tau, &later.tau)
            .into_iter()
            .map(|tau| tau + 1e-3 * noise.normal())
            .collect(),
    };
    let estimate = |method: Method| {
        let mut equations = Equations::new(
            &experiment.robot,
            &experiment.set,
            &experiment.base,
            vec![trajectory(&both, &both.tau)],
        );
        let factors = equations.factors().expect("good data");
        solve(&method, &mut equations, &factors, &experiment.nominal())
    };
    let forgetful = estimate(RECURSIVE.with(0.99));
    let elephant = estimate(RECURSIVE.with(1.0));
    assert!(largest_difference(&before, &after) > 0.4);
    let error = largest_difference(&forgetful.values, &after);
    assert!(error < 0.05, "{:?} {after:?}", forgetful.values);
    assert!(largest_difference(&elephant.values, &after) > 0.05);
    assert!(largest_difference(&elephant.values, &estimate(Method::Wls).values) < 0.2);
}

fn solve(
    method: &Method,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    nominal: &[f64],
) -> Estimate {
    estimate(method, equations, factors, nominal, None).expect("good data")
}

#[test]
fn a_controller_that_does_not_hold_the_arm_is_named() {
    let mut experiment = Experiment::new(300);
    let motion = experiment.run(&experiment.truth);
    experiment.kp = [-400.0, -300.0];
    experiment.kd = [-40.0, -30.0];
    let refused = experiment
        .estimate(&OUTPUT_ERROR.method(), &motion, &motion.tau)
        .expect_err("no arm is held");
    assert_eq!(refused, IdentificationError::Diverged { trajectory: 0 });
    assert!(refused.to_string().contains("sign and unit of the gains"), "{refused}");
}

#[test]
fn settings_out_of_range_and_missing_things_are_named() {
    let experiment = Experiment::new(300);
    let motion = experiment.run(&experiment.truth);
    let message = |method: Method| {
        experiment.estimate(&method, &motion, &motion.tau).expect_err("refused").to_string()
    };
    assert!(message(IRLS.with(-1.0)).contains("threshold"));
    assert!(message(IRLS.with(1e-300)).contains("threshold"));
    for relative_deviation in [f64::NAN, 0.0, 1e-160, 1e160] {
        assert!(
            message(RIDGE.with(relative_deviation)).contains("prior: it is between 1e-9 and 1e9")
        );
    }
    assert!(message(TOTAL_LEAST_SQUARES.with(2.0)).contains("noise of the columns"));
    assert!(message(RECURSIVE.with(1.5)).contains("forgetting"));
    let mut equations = Equations::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        vec![trajectory(&motion, &motion.tau)],
    );
    let factors = equations.factors().expect("good data");
    for (method, word) in
        [(INSTRUMENTAL_VARIABLES.method(), "instruments"), (OUTPUT_ERROR.method(), "controller")]
    {
        let error = estimate(&method, &mut equations, &factors, &experiment.nominal(), None)
            .expect_err("refused");
        assert!(error.to_string().contains(word), "{error}");
    }
    let correlation =
        residual_correlation(&mut equations, &factors, &experiment.expected()).expect("good data");
    assert_eq!(correlation.len(), factors.len());
}
