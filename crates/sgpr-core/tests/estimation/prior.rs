//! Poor logs: what they do not determine stays with the robot file, and rich ones lose nothing.

use faer::Mat;
use faer::linalg::solvers::Solve;
use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{
    Equations, IRLS, IdentificationError, LeastSquares, LeftOut, Method, Observation,
    ParameterPrior, PriorWidth, RECURSIVE, estimate, estimate_with_prior,
};
use sgpr_core::model::{IdentifyError, IdentifyOptions, TorqueModel, compare, identify};
use sgpr_core::recording::Recording;
use sgpr_core::robot::{puma560, two_link};

use crate::arm::{Experiment, trajectory};
use crate::noise::Noise;

const EFFECTS: [&str; 4] =
    ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];

/// Parameters of the file, off by a tenth, friction unknown; all of the set.
fn nominal(experiment: &Experiment) -> Vec<f64> {
    let mut nominal: Vec<f64> = experiment.truth.iter().map(|value| 1.1 * value).collect();
    nominal[experiment.set.inertial()..].fill(0.0);
    nominal
}

#[test]
fn prior_rows_are_the_inverse_root_of_the_covariance() {
    let experiment = Experiment::new(500);
    let motion = experiment.run(&experiment.truth);
    let equations = Equations::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        vec![trajectory(&motion, &motion.tau)],
    );
    let factors = equations.factors().expect("good data");
    let nominal = nominal(&experiment);
    let prior = ParameterPrior::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        &nominal,
        &factors,
    );
    let rank = experiment.base.rank();
    let (rows, covariance) = (prior.rows(), prior.covariance());
    let p = rows.as_ref().subcols(0, rank);
    let identity = p * covariance.as_ref() * p.transpose();
    for i in 0..rank {
        for j in 0..rank {
            assert!(
                (identity[(i, j)] - f64::from(i == j)).abs() < 1e-9,
                "{i} {j}: {}",
                identity[(i, j)]
            );
        }
        let right: f64 = (0..rank).map(|k| rows[(i, k)] * prior.mean()[k]).sum();
        assert!((right - rows[(i, rank)]).abs() < 1e-9 * right.abs().max(1.0));
    }
    assert_eq!(prior.mean(), experiment.base.combine(&nominal));
    // A mass of the file is believed within its own size, and a first moment by its link's mass and
    // length.
    let wide = prior.clone().with_relative_deviation(3.0).covariance();
    assert!((0..rank).all(|k| wide[(k, k)] >= covariance[(k, k)]));
    // Friction levels stand alone, rotors of the first joint stand in a combination.
    let names: Vec<&str> =
        prior.non_negative().iter().map(|k| experiment.base.names()[*k].as_str()).collect();
    assert!(
        names.iter().any(|name| name.ends_with(".Fc"))
            && names.iter().any(|name| name.ends_with(".Fv"))
    );
}

#[test]
fn rich_logs_are_followed_by_every_estimator() {
    let experiment = Experiment::new(2000);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(11);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.3 * noise.normal()).collect();
    let nominal = nominal(&experiment);
    for method in [Method::Ols, Method::Wls, IRLS.method(), RECURSIVE.with(1.0)] {
        let rows = vec![trajectory(&motion, &tau)];
        let mut equations =
            Equations::new(&experiment.robot, &experiment.set, &experiment.base, rows);
        let factors = equations.factors().expect("good data");
        let prior = ParameterPrior::new(
            &experiment.robot,
            &experiment.set,
            &experiment.base,
            &nominal,
            &factors,
        );
        let bare =
            estimate(&method, &mut equations, &factors, prior.mean(), None).expect("good data");
        let held = estimate_with_prior(
            &method,
            &mut equations,
            &factors,
            &prior,
            PriorWidth::Chosen,
            None,
        )
        .expect("good data")
        .estimate;
        let pairs = held.values.iter().zip(&bare.values).zip(bare.standard_deviations());
        for (k, ((held, bare), deviation)) in pairs.enumerate() {
            assert!(
                (held - bare).abs() < 0.5 * deviation,
                "{} {k}: {held} {bare} ± {deviation}",
                method.name()
            );
        }
    }
}

#[test]
fn a_handful_of_rows_stays_near_the_file_and_does_better_than_it() {
    let experiment = Experiment::new(2000);
    let motion = experiment.run(&experiment.truth);
    let nominal = nominal(&experiment);
    let (q, dq, ddq, tau) = (&motion.q[..8], &motion.dq[..8], &motion.ddq[..8], &motion.tau[..8]);
    let few = sgpr_core::identification::Trajectory::new(Samples { q, dq, ddq }, tau);
    let equations = Equations::new(&experiment.robot, &experiment.set, &experiment.base, vec![few]);
    let factors = equations.factors().expect("good data");
    let prior = ParameterPrior::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        &nominal,
        &factors,
    );
    let fit = LeastSquares::new(Method::Wls);
    let bare = fit.solve(&factors, &experiment.base, prior.mean());
    assert!(matches!(bare, Err(IdentificationError::TooFewRows { .. })), "{bare:?}");
    let held =
        fit.solve_with_prior(&factors, &prior, PriorWidth::Chosen).expect("a prior").estimate;
    assert!(held.values.iter().all(|value| value.is_finite()));
    assert!(held.standard_deviations().iter().all(|deviation| deviation.is_finite()));
    let all = Equations::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        vec![trajectory(&motion, &motion.tau)],
    );
    let mut all = all;
    let mut squares = [0.0; 2];
    all.for_each(|equation| {
        for (square, values) in squares.iter_mut().zip([prior.mean(), &held.values]) {
            *square += equation.residual(values).powi(2);
        }
    })
    .expect("good data");
    assert!(squares[1] < squares[0], "{squares:?}");
    let wrong = fit
        .solve_with_prior(&factors, &prior, PriorWidth::Given(0.0))
        .expect_err("no width")
        .to_string();
    assert!(wrong.contains("between 1e-9 and 1e9"), "{wrong}");
    let width = |asked| {
        let held = fit.solve_with_prior(&factors, &prior, asked).expect("a prior");
        held.prior.relative_deviation()
    };
    let chosen = width(PriorWidth::Chosen);
    assert_eq!(width(PriorWidth::AtMost(0.5 * chosen)), 0.5 * chosen);
    assert_eq!(width(PriorWidth::AtMost(2.0 * chosen)), chosen);
}

/// Of few rows a fit leaves less than their noise, and of rows that it does not know more: the
/// product is the variance.
#[test]
fn residuals_with_and_without_a_row_have_the_noise_between_them() {
    const ROWS: usize = 30;
    const PARTS: usize = 10;
    let sigma = [0.5, 0.05];
    let experiment = Experiment::new(2400);
    let motion = experiment.run(&experiment.truth);
    let pick = |values: &[f64]| -> Vec<f64> {
        (0..ROWS).flat_map(|row| values[160 * row..160 * row + 2].iter().copied()).collect()
    };
    let (q, dq, ddq, tau) =
        (pick(&motion.q), pick(&motion.dq), pick(&motion.ddq), pick(&motion.tau));
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let mut noise = Noise(5);
    let (mut inside, mut outside, mut between) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    const TIMES: usize = 200;
    for _ in 0..TIMES {
        let tau: Vec<f64> =
            tau.iter().enumerate().map(|(k, tau)| tau + sigma[k % 2] * noise.normal()).collect();
        let log = sgpr_core::identification::Trajectory::new(samples, &tau);
        let (robot, set, base) = (&experiment.robot, &experiment.set, &experiment.base);
        let mut rows = Observation::in_parts(robot, set, base, PARTS);
        rows.add_to(&log, |sample| sample * PARTS / ROWS).expect("good data");
        let (factors, parts) = (rows.factors(), rows.parts());
        let prior = ParameterPrior::new(robot, set, base, &nominal(&experiment), &factors)
            .with_relative_deviation(30.0);
        let known = LeastSquares::new(Method::WlsKnown(sigma.to_vec()));
        let estimate = known.solve(&factors, base, prior.mean()).expect("good data");
        let error = LeftOut::new(&parts, |factor| sigma[factor.joint], base.rank()).error(&prior);
        for (factor, _) in factors.iter().zip(&estimate.noise) {
            let (joint, n) = (factor.joint, factor.columns.len());
            let r = factor.factor.as_ref();
            let rest = |i: usize| {
                r[(i, n)]
                    - (0..n).map(|k| r[(i, k)] * estimate.values[factor.columns[k]]).sum::<f64>()
            };
            let square = (0..=n).map(|i| rest(i).powi(2)).sum::<f64>() / factor.rows as f64;
            let without = error(joint).expect("rows").powi(2);
            inside[joint] += square / sigma[joint].powi(2) / TIMES as f64;
            outside[joint] += without / sigma[joint].powi(2) / TIMES as f64;
            between[joint] += (square * without).sqrt() / sigma[joint].powi(2) / TIMES as f64;
        }
    }
    println!("{inside:.2?} {outside:.2?} {between:.2?}");
    for joint in 0..2 {
        assert!(inside[joint] < 0.85 && outside[joint] > 1.15, "{joint}: {inside:?} {outside:?}");
        assert!((between[joint] - 1.0).abs() < 0.1, "{joint}: {between:?}");
    }
}

/// Position, speed and acceleration of a wave of a joint, of amplitude `a` and angular frequency
/// `w`.
fn wave(t: f64, joint: usize, h: i32, a: f64, w: f64) -> [f64; 3] {
    let phase = w * t + 1.3 * f64::from(h) * (joint + 1) as f64;
    [a * phase.sin(), a * w * phase.cos(), -a * w * w * phase.sin()]
}

/// What is logged 100 times a second of an arm along a motion, `[samples, n]` each.
///
/// - `noise`: of positions, rad, and of torques, N·m
fn recorded(
    truth: &TorqueModel,
    [q, dq, ddq]: [&[f64]; 3],
    noise: [f64; 2],
    seed: u64,
) -> Recording {
    let mut random = Noise(seed);
    let tau = truth.predict(Samples { q, dq, ddq });
    let tau = tau.iter().map(|tau| tau + noise[1] * random.normal()).collect();
    let robot = truth.robot();
    let time = (0..q.len() / robot.dof()).map(|k| k as i64 * 10_000_000).collect();
    let q = q.iter().map(|q| q + noise[0] * random.normal()).collect();
    let names = robot.joint_names().map(String::from).collect();
    Recording::new("simulated", names, time, q, None, Some(tau), vec![])
        .expect("arrays of one length")
}

/// A log of the two-link arm whose bodies are 15 % heavier than the file's, with friction, along
/// sums of sines; joints with `moves` false stand, those with `one_way` only go forwards.
fn log(seconds: usize, moves: [bool; 2], one_way: [bool; 2], seed: u64) -> Recording {
    let (robot, rate) = (two_link(), 100);
    let mut parameters: Vec<f64> =
        robot.standard_parameters().iter().map(|value| 1.15 * value).collect();
    parameters.extend([2.0, 1.0, 4.0, 2.0, 0.3, 0.1, 0.0, 0.0]);
    let truth = TorqueModel::with_parameters(&robot, &EFFECTS, parameters).expect("known effects");
    let (mut q, mut dq, mut ddq) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..seconds * rate {
        let t = k as f64 / rate as f64;
        for joint in 0..2 {
            let (mut value, mut speed, mut acceleration) = (0.3, 0.0, 0.0);
            for h in 1..=3 {
                let (a, w) = (0.6 / f64::from(h), 0.8 * f64::from(h) + 0.3 * joint as f64);
                let a = if one_way[joint] { 0.15 * a } else { a };
                let wave = wave(t, joint, h, a, w);
                value += wave[0];
                speed += wave[1];
                acceleration += wave[2];
            }
            if one_way[joint] {
                (value, speed) = (value + 0.4 * t, speed + 0.4);
            }
            let on = f64::from(moves[joint]);
            q.push(if moves[joint] { value } else { 0.3 });
            dq.push(on * speed);
            ddq.push(on * acceleration);
        }
    }
    recorded(&truth, [&q, &dq, &ddq], [1e-5, 0.2], seed)
}

fn options() -> IdentifyOptions {
    IdentifyOptions::default().with_effects(EFFECTS.map(String::from).to_vec())
}

#[test]
fn poor_logs_leave_no_model_worse_than_the_file() {
    let robot = two_link();
    let test = [log(20, [true; 2], [false; 2], 1)];
    let rich = identify(&robot, &test, &options(), &()).expect("a rich log").0;
    let error = |model: &TorqueModel| {
        compare(model, &test, rich.processing()).expect("a log").relative_error_percent
    };
    let file = error(&TorqueModel::nominal(&robot));
    let cases = [
        ("three seconds", log(3, [true; 2], [false; 2], 2), ""),
        ("the first joint only", log(10, [true, false], [false; 2], 3), "must move"),
        ("the second joint only", log(10, [false, true], [false; 2], 4), "must move"),
        ("the first joint one way", log(10, [true; 2], [true, false], 5), "must reverse"),
        ("the second joint one way", log(10, [true; 2], [false, true], 6), "must reverse"),
    ];
    for (case, log, advice) in cases {
        let (model, report) = identify(&robot, &[log], &options(), &()).expect("a usable model");
        let found = error(&model);
        assert!(found < 1.02 * file, "{case}: {found} %, file {file} %");
        assert!(
            advice.is_empty() || report.warnings.iter().any(|w| w.contains(advice)),
            "{case}: {:?}",
            report.warnings
        );
        let friction = model.parameter_set().names().iter().zip(model.parameters());
        let mut friction =
            friction.filter(|(name, _)| name.ends_with(".Fc") || name.ends_with(".Fv"));
        assert!(friction.all(|(_, value)| *value >= 0.0), "{case}");
    }
}

#[test]
fn a_log_without_motion_is_refused_and_says_what_to_record() {
    let still = log(5, [false; 2], [false; 2], 7);
    let error = identify(&two_link(), &[still], &options(), &()).expect_err("nothing moves");
    assert!(matches!(error, IdentifyError::Identification(IdentificationError::NoData)), "{error}");
    assert!(error.to_string().contains("record a motion"), "{error}");
}

#[test]
fn rich_logs_outweigh_the_prior_and_short_ones_do_not() {
    let robot = two_link();
    let of = |seconds, prior| {
        let log = [log(seconds, [true; 2], [false; 2], 8)];
        identify(&robot, &log, &options().with_prior(prior), &()).expect("a good log").0
    };
    // In standard deviations of the bare estimate.
    let moved = |seconds| {
        let [held, bare] = [Some(PriorWidth::Chosen), None].map(|prior| of(seconds, prior));
        let [held, bare] = [&held, &bare].map(|model| model.fit().expect("identified"));
        let pairs = held.values.iter().zip(&bare.values).zip(&bare.standard_deviations);
        pairs.map(|((held, bare), deviation)| (held - bare).abs() / deviation).fold(0.0, f64::max)
    };
    let (rich, short) = (moved(40), moved(2));
    println!("{rich:.4} and {short:.3} standard deviations");
    assert!(rich < 0.02 && short > 0.2, "{rich} {short}");
}

/// A log of a Puma 560 whose bodies are 15 % heavier than the file's, with friction at all joints,
/// along sums of sines.
///
/// - `shares`: of the motion of each joint
fn log_of_six_joints(shares: [f64; 6], seed: u64) -> Recording {
    let (robot, rate, samples) = (puma560(), 100, 2000);
    let mut parameters: Vec<f64> =
        robot.standard_parameters().iter().map(|value| 1.15 * value).collect();
    for value in [1.5, 1.0, 0.2, 0.0] {
        parameters.extend([4.0, 4.0, 2.0, 0.5, 0.5, 0.5].map(|share| share * value));
    }
    let truth = TorqueModel::with_parameters(&robot, &EFFECTS, parameters).expect("known effects");
    let (mut q, mut dq, mut ddq) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..samples {
        let t = k as f64 / rate as f64;
        for (joint, share) in shares.into_iter().enumerate() {
            let (mut value, mut speed, mut acceleration) = (0.3, 0.0, 0.0);
            for h in 1..=3 {
                let (a, w) = (0.6 * share / f64::from(h), 0.8 * f64::from(h) + 0.15 * joint as f64);
                let wave = wave(t, joint, h, a, w);
                value += wave[0];
                speed += wave[1];
                acceleration += wave[2];
            }
            q.push(value);
            dq.push(speed);
            ddq.push(acceleration);
        }
    }
    recorded(&truth, [&q, &dq, &ddq], [1e-6, 0.1], seed)
}

#[test]
fn a_joint_that_hardly_moves_is_held_though_the_others_are_rich() {
    let robot = puma560();
    let test = [log_of_six_joints([1.0; 6], 1)];
    let of = |share: f64, prior| {
        let logs = [log_of_six_joints([1.0, 1.0, 1.0, 1.0, share, 1.0], 2)];
        identify(&robot, &logs, &options().with_prior(prior), &()).expect("a usable model").0
    };
    let is_held =
        |model: &TorqueModel| model.fit().expect("identified").prior_standard_deviation.is_some();
    let rich = of(1.0, Some(PriorWidth::Chosen));
    assert!(!is_held(&rich));
    let error = |model: &TorqueModel| {
        compare(model, &test, rich.processing()).expect("a log").relative_error_percent
    };
    for share in [0.003, 0.01] {
        let (chosen, bare) = (of(share, Some(PriorWidth::Chosen)), of(share, None));
        assert!(is_held(&chosen) && !is_held(&bare), "{share}");
        let (held, bare) = (error(&chosen), error(&bare));
        assert!(held < 0.5 * bare, "{share} of the motion: {held} %, without a prior {bare} %");
    }
    // A joint that goes a thousandth of the way trembles and counts as held, with a prior and
    // without.
    let trembles = [Some(PriorWidth::Chosen), None].map(|prior| error(&of(0.0009, prior)));
    assert!(trembles.iter().all(|error| *error < 5.0), "{trembles:?}");
}

/// A log with a torque at the first joint that no model here has: a spring that stiffens.
fn with_spring(log: &Recording) -> Recording {
    let spring = |(k, tau): (usize, &f64)| match k % 2 {
        0 => tau + 40.0 * log.position()[k].powi(3),
        _ => *tau,
    };
    let tau = log.torque().expect("simulated").iter().enumerate().map(spring).collect();
    let (names, time) = (log.joint_names().to_vec(), log.time().to_vec());
    Recording::new("poor", names, time, log.position().to_vec(), None, Some(tau), vec![])
        .expect("arrays of one length")
}

#[test]
fn standard_deviations_of_short_logs_count_what_the_model_lacks() {
    let options = options().with_prior(Some(PriorWidth::Given(1.0)));
    let fit =
        |log: Recording| identify(&two_link(), &[log], &options, &()).expect("a usable model").0;
    let all = [true; 2];
    let short = |seed: u64| log(4, all, [false; 2], seed);
    let mut dispersions = [vec![], vec![]];
    let (mut hits, mut plain_hits, mut count) = (0, 0, 0);
    for seed in 20..30 {
        let truth = fit(short(seed));
        dispersions[0].push(truth.fit().expect("identified").dispersion);
        let lacks = fit(with_spring(&short(seed)));
        let dispersion = lacks.fit().expect("identified").dispersion;
        dispersions[1].push(dispersion);
        // Another motion, of which the log is not a part.
        let test =
            compare(&lacks, &[with_spring(&log(12, all, [false; 2], 99))], None).expect("a log");
        let found = &test.logs[0];
        let deviation = lacks.standard_deviation_of(&found.motion).expect("an arm");
        for k in (0..deviation.len()).step_by(40) {
            let error = (found.measured()[k] - found.predicted[k]).abs();
            hits += u32::from(error < 1.96 * deviation[k] + 0.4);
            plain_hits += u32::from(error < 1.96 * deviation[k] / dispersion + 0.4);
            count += 1;
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let [right, lacking] = dispersions.each_mut().map(median);
    println!("{right:.2} {lacking:.2}, {hits} and {plain_hits} of {count}");
    // Two joints of one short log are few to tell by.
    assert!(right < 2.0, "{right}");
    assert!(lacking > 1.5 * right, "{lacking}");
    assert!(hits > plain_hits);
}

/// The posterior mean by dense matrices, from what each joint's rows know in units of its own
/// noise.
#[test]
fn what_rows_know_is_counted_joint_by_joint() {
    let experiment = Experiment::new(500);
    let motion = experiment.run(&experiment.truth);
    let mut noise = Noise(17);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + noise.normal()).collect();
    let rows = vec![trajectory(&motion, &tau)];
    let mut equations = Equations::new(&experiment.robot, &experiment.set, &experiment.base, rows);
    let factors = equations.factors().expect("good data");
    let nominal = nominal(&experiment);
    let prior = ParameterPrior::new(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        &nominal,
        &factors,
    );
    // Rows of the first factor are worth a hundredth of as many independent ones.
    let mut memory = vec![1.0; factors.len()];
    memory[0] = 100.0;
    let bare =
        estimate(&Method::Wls, &mut equations, &factors, prior.mean(), None).expect("good data");
    let mut held = |memory: &[f64]| {
        let width = PriorWidth::Given(0.1);
        estimate_with_prior(&Method::Wls, &mut equations, &factors, &prior, width, Some(memory))
            .expect("good data")
    };
    let (forgets, remembers) = (held(&vec![1.0; factors.len()]), held(&memory));
    for ((after, before), memory) in remembers.levels.iter().zip(&forgets.levels).zip(&memory) {
        assert!((after / before - memory.sqrt()).abs() < 1e-9);
    }
    let rank = bare.values.len();
    let mut known = Mat::<f64>::zeros(rank, rank);
    for (factor, level) in factors.iter().zip(&remembers.levels) {
        let w = factor.factor.as_ref().subcols(0, factor.columns.len());
        let gram = w.transpose() * w;
        for (a, &i) in factor.columns.iter().enumerate() {
            for (b, &j) in factor.columns.iter().enumerate() {
                known[(i, j)] += gram[(a, b)] / level.powi(2);
            }
        }
    }
    let column = |values: &[f64]| Mat::from_fn(rank, 1, |i, _| values[i]);
    let believed =
        remembers.prior.covariance().partial_piv_lu().solve(Mat::<f64>::identity(rank, rank));
    let all = (&known + &believed).partial_piv_lu();
    let mut expected = column(prior.mean());
    for _ in 0..2 {
        expected = all.solve(&known * column(&bare.values) + &believed * &expected);
    }
    let pairs = remembers.estimate.values.iter().zip(remembers.estimate.standard_deviations());
    for (k, (value, deviation)) in pairs.enumerate() {
        assert!(
            (value - expected[(k, 0)]).abs() < 1e-6 * deviation,
            "{k}: {value} {}",
            expected[(k, 0)]
        );
    }
}
