//! Logs.

use proptest::prelude::*;
use proptest::test_runner::Config;
use sgpr_core::diagnosis::{DiagnosisOptions, diagnose};
use sgpr_core::dynamics::{BatchWorkspace, Samples, rnea_batch};
use sgpr_core::identification::{
    Consistency, ESTIMATORS, EstimatorNeeds, Method, RECURSIVE, RIDGE, TOTAL_LEAST_SQUARES,
};
use sgpr_core::model::{
    IdentifyOptions, SemiParametricOptions, TorqueModel, Uncertainty, compare, fit_semi_parametric,
    identify, screen,
};
use sgpr_core::recording::{IssueKind, Recording, Repair, Severity, inspect, repair};
use sgpr_core::robot::{Robot, two_link};

/// ns
const PERIOD: i64 = 10_000_000;
const SAMPLES: usize = 1000;

/// A log of the two-link arm with viscous and Coulomb friction; logs of another `phase` move
/// otherwise.
pub(crate) fn log(phase: f64) -> Recording {
    let robot = two_link();
    let n = robot.dof();
    let (mut q, mut dq, mut ddq) = (vec![], vec![], vec![]);
    for k in 0..SAMPLES {
        let t = k as f64 * PERIOD as f64 * 1e-9;
        for joint in 0..n {
            let wave = |w: f64, a: f64| {
                let angle = w * t + phase + joint as f64;
                [a * angle.sin(), a * w * angle.cos(), -a * w * w * angle.sin()]
            };
            let (slow, fast) = (wave(1.9 + joint as f64, 0.8), wave(5.3, 0.2));
            q.push(slow[0] + fast[0]);
            dq.push(slow[1] + fast[1]);
            ddq.push(slow[2] + fast[2]);
        }
    }
    let mut tau = vec![0.0; q.len()];
    rnea_batch(
        &robot,
        &mut BatchWorkspace::new(&robot),
        Samples { q: &q, dq: &dq, ddq: &ddq },
        &mut tau,
    );
    // Noise from the digits of a logistic map.
    let mut state = 0.3 + 0.01 * phase;
    for (tau, dq) in tau.iter_mut().zip(&dq) {
        state = 3.99 * state * (1.0 - state);
        *tau += 0.4 * dq + 0.7 * dq.signum() + 0.1 * (state - 0.5);
    }
    let names = robot.joint_names().map(String::from).collect();
    let time = (0..SAMPLES as i64).map(|k| k * PERIOD).collect();
    Recording::new(format!("log_{phase}"), names, time, q, Some(dq), Some(tau), vec![])
        .expect("one length")
}

/// What is done to position, torque and time of a log.
#[derive(Clone, Debug)]
enum Change {
    ScaleTorque(f64),
    ScaleTorqueOf(usize, f64),
    ScalePosition(f64),
    ShiftPosition(f64),
    /// At some samples.
    PositionSpikes(f64),
    TorqueSpikes(f64),
    /// From sample to sample.
    AlternatePosition(f64),
    Constant(f64),
    /// One joint does not move.
    Still(usize),
    /// ns
    Period(i64),
    /// Of the clock in the middle, ns.
    Jump(i64),
    /// First and last stamp as far apart as they can be.
    WholeClock,
}

impl Change {
    fn apply(&self, log: &Recording) -> Recording {
        let (mut time, mut q) = (log.time().to_vec(), log.position().to_vec());
        let mut tau = log.torque().expect("logged").to_vec();
        let n = log.dof();
        match *self {
            Self::ScaleTorque(factor) => tau.iter_mut().for_each(|tau| *tau *= factor),
            Self::ScaleTorqueOf(joint, factor) => {
                tau.iter_mut().skip(joint).step_by(n).for_each(|tau| *tau *= factor)
            }
            Self::ScalePosition(factor) => q.iter_mut().for_each(|q| *q *= factor),
            Self::ShiftPosition(shift) => q.iter_mut().for_each(|q| *q += shift),
            Self::PositionSpikes(value) => q.iter_mut().step_by(211).for_each(|q| *q = value),
            Self::TorqueSpikes(value) => tau.iter_mut().step_by(211).for_each(|tau| *tau = value),
            Self::AlternatePosition(value) => {
                q.iter_mut()
                    .enumerate()
                    .for_each(|(k, q)| *q = if (k / n).is_multiple_of(2) { value } else { -value });
            }
            Self::Constant(value) => q.iter_mut().for_each(|q| *q = value),
            Self::Still(joint) => q.iter_mut().skip(joint).step_by(n).for_each(|q| *q = 0.3),
            Self::Period(period) => {
                time.iter_mut().enumerate().for_each(|(k, t)| *t = k as i64 * period)
            }
            Self::Jump(step) => {
                time.iter_mut().skip(SAMPLES / 2).for_each(|t| *t = t.saturating_add(step))
            }
            Self::WholeClock => {
                time.iter_mut().for_each(|t| *t += i64::MIN);
                time.iter_mut()
                    .skip(SAMPLES / 2)
                    .for_each(|t| *t = i64::MAX - (SAMPLES as i64 * PERIOD) + (*t - i64::MIN));
            }
        }
        let names = log.joint_names().to_vec();
        Recording::new(log.source(), names, time, q, None, Some(tau), vec![]).expect("one length")
    }
}

fn methods() -> Vec<Method> {
    let alone = ESTIMATORS.iter().filter(|estimator| estimator.needs < EstimatorNeeds::Instruments);
    let stronger = [Method::Ols, Method::Wls, RIDGE.with(0.3), TOTAL_LEAST_SQUARES.with(0.01)];
    stronger.into_iter().chain(alone.map(|estimator| estimator.method())).collect()
}

pub(crate) fn options(method: Method) -> IdentifyOptions {
    let effects = ["viscous_friction", "coulomb_friction"].map(String::from).to_vec();
    IdentifyOptions::default().with_effects(effects).with_method(method)
}

/// Ways to identify.
pub(crate) fn requests() -> Vec<IdentifyOptions> {
    let with_uncertainty = |uncertainty| options(Method::Wls).with_uncertainty(uncertainty);
    let consistent = |cross_validated_prior| {
        options(Method::Wls)
            .with_consistency(Some(Consistency::default()))
            .with_cross_validated_prior(cross_validated_prior)
    };
    let mut all: Vec<IdentifyOptions> = methods().into_iter().map(options).collect();
    all.push(options(Method::Wls).with_prior(None));
    all.push(options(Method::Wls).with_essential(true));
    all.push(options(Method::Wls).with_forecast(true));
    all.extend([consistent(false), consistent(true)]);
    all.extend([Uncertainty::Hac, Uncertainty::Bootstrap { replicates: 20 }].map(with_uncertainty));
    // Hardly more rows than parameters.
    for method in [Method::Wls, RECURSIVE.with(0.9)] {
        let mut few = with_uncertainty(Uncertainty::Hac);
        few.conditioning.decimation = Some(250);
        all.push(few.with_method(method));
    }
    all
}

/// An error tells the log, or the option, and what to do.
pub(crate) fn understandable(error: &impl std::fmt::Display) -> String {
    let text = error.to_string();
    assert!(text.len() > 30 && !text.contains("should not happen"), "{text}");
    text
}

/// Identification, its screening and comparison; a model has numbers for parameters.
pub(crate) fn through_identification(
    robot: &Robot,
    logs: &[Recording],
    options: &IdentifyOptions,
) -> Result<TorqueModel, String> {
    logs.iter().for_each(|log| drop(inspect(log)));
    let (model, _) = identify(robot, logs, options, &()).map_err(|error| understandable(&error))?;
    assert!(model.parameters().iter().all(|value| value.is_finite()), "{:?}", model.parameters());
    let compared = compare(&model, logs, None).map_err(|error| understandable(&error))?;
    assert!(compared.joints.iter().all(|joint| !joint.rmse.is_infinite()), "{:?}", compared.joints);
    screen(&model, logs).map_err(|error| understandable(&error))?;
    Ok(model)
}

/// What the review of hostile input found to end in a panic, or not to end.
fn found_before() -> Vec<Change> {
    use Change::*;
    vec![
        ScaleTorque(1e300),
        ScaleTorqueOf(1, 1e200),
        ScaleTorque(1e-310),
        ScaleTorqueOf(0, 1e-310),
        ScalePosition(1e150),
        AlternatePosition(f64::MAX),
        AlternatePosition(1e8),
        PositionSpikes(1e300),
        TorqueSpikes(1e300),
        Period(100_000_000_000),
        Period(1),
        Jump(1_000_000_000_000_000_000),
        WholeClock,
    ]
}

/// What is odd and possible.
fn odd() -> Vec<Change> {
    use Change::*;
    vec![
        ScaleTorque(1e12),
        ScaleTorque(1e-12),
        ScaleTorqueOf(1, 1e9),
        ScaleTorqueOf(1, 0.0),
        ScalePosition(1e-150),
        ScalePosition(1e-310),
        ShiftPosition(1e8),
        PositionSpikes(1e8),
        PositionSpikes(5e3),
        TorqueSpikes(1e14),
        Constant(1.0),
        Still(0),
        Still(1),
        Period(9_000_000_000),
        Jump(20_000_000_000_000),
    ]
}

#[test]
fn identification_answers_or_says_what_is_wrong() {
    let robot = two_link();
    for change in found_before().iter().chain(&odd()) {
        let logs = [change.apply(&log(0.0)), change.apply(&log(1.0))];
        println!(
            "{change:?}: {:?}",
            through_identification(&robot, &logs, &options(Method::Wls)).err()
        );
    }
}

#[test]
fn values_that_no_arm_makes_are_named() {
    let robot = two_link();
    let error = |change: &Change| {
        through_identification(&robot, &[change.apply(&log(0.0))], &options(Method::Wls))
    };
    for (change, named) in [
        (Change::ScaleTorque(1e300), ["the torque of `joint_1` is", "give the unit of the torque"]),
        (
            Change::ScalePosition(1e150),
            ["the position of `joint_2` is", "give the unit of the position"],
        ),
        (Change::PositionSpikes(1e8), ["the position of `joint_1` is", "drop such samples"]),
        (
            Change::Period(100_000_000_000),
            ["samples come every 100 s", "give the unit of the time"],
        ),
        (Change::Period(1), ["samples come every 0.000000001 s", "give the unit of the time"]),
    ] {
        let text = error(&change).expect_err("no arm makes it");
        assert!(
            named.iter().all(|named| text.contains(named)) && text.starts_with("log_0: "),
            "{text}"
        );
    }
    let issues = inspect(&Change::ScaleTorque(1e300).apply(&log(0.0)));
    assert!(
        issues[0].kind == IssueKind::Implausible && issues[0].severity == Severity::Error,
        "{:?}",
        issues[0]
    );
}

#[test]
fn an_arm_of_which_one_joint_stands_still_has_an_answer_from_every_estimator() {
    let robot = two_link();
    for options in requests() {
        for joint in 0..2 {
            let found =
                through_identification(&robot, &[Change::Still(joint).apply(&log(0.0))], &options);
            let few = options.conditioning.decimation.is_some();
            assert!(few || found.is_ok(), "{:?} {joint}: {found:?}", options.method);
        }
    }
}

#[test]
fn what_makes_the_robot_file_next_to_nothing_has_an_answer_or_is_refused() {
    let robot = two_link();
    for change in [Change::Period(1001), Change::ScaleTorqueOf(0, -4.9e-27)] {
        let log = change.apply(&Change::Still(1).apply(&log(0.0)));
        for options in requests() {
            println!(
                "{:?}: {:?}",
                options.method,
                through_identification(&robot, std::slice::from_ref(&log), &options).err()
            );
        }
    }
    let tiny = Change::ScaleTorque(9.999999999999999e-33)
        .apply(&Change::ScalePosition(3.885143517485852e-76).apply(&log(0.0)));
    println!(
        "{:?}",
        through_identification(&robot, &[tiny], &options(Method::Wls).with_prior(None)).err()
    );
}

#[test]
fn every_estimator_answers_or_says_what_is_wrong() {
    let robot = two_link();
    for options in requests() {
        for change in found_before().iter().chain(&odd()) {
            let logs = [change.apply(&log(0.0))];
            println!(
                "{:?} {change:?}: {:?}",
                options.method,
                through_identification(&robot, &logs, &options).err()
            );
        }
    }
}

#[test]
fn a_diagnosis_answers_or_says_what_is_wrong() {
    let robot = two_link();
    let (train, test) = ([log(0.0), log(1.0)], [log(2.0)]);
    let model = through_identification(&robot, &train, &options(Method::Wls)).expect("a good log");
    for change in found_before().iter().chain(&odd()) {
        let logs = [change.apply(&train[0]), change.apply(&train[1])];
        let found = diagnose(&model, &logs, &test, &DiagnosisOptions::default(), &());
        println!(
            "{change:?}: {:?}",
            found.map(|found| found.verdict).map_err(|error| understandable(&error))
        );
    }
}

#[test]
fn learning_answers_or_says_what_is_wrong() {
    let robot = two_link();
    for change in found_before().iter().chain(&odd()) {
        let logs = [change.apply(&log(0.0)), change.apply(&log(1.0))];
        let options =
            SemiParametricOptions::default().with_points(50).with_identify(options(Method::Wls));
        let found = fit_semi_parametric(&robot, &logs, &options, &())
            .map_err(|error| understandable(&error));
        println!("{change:?}: {:?}", found.err());
    }
}

fn any_value() -> impl Strategy<Value = f64> {
    let sign = prop_oneof![Just(1.0), Just(-1.0)];
    (sign, 1.0..10.0, -320i32..309)
        .prop_map(|(sign, digits, exponent)| sign * digits * 10f64.powi(exponent))
}

fn any_change() -> impl Strategy<Value = Change> {
    use Change::*;
    prop_oneof![
        any_value().prop_map(ScaleTorque),
        (0usize..2, any_value()).prop_map(|(joint, factor)| ScaleTorqueOf(joint, factor)),
        any_value().prop_map(ScalePosition),
        any_value().prop_map(ShiftPosition),
        any_value().prop_map(PositionSpikes),
        any_value().prop_map(TorqueSpikes),
        any_value().prop_map(AlternatePosition),
        any_value().prop_map(Constant),
        (0usize..2).prop_map(Still),
        (0u32..18).prop_map(|exponent| Period(10i64.pow(exponent) / 1000 + 1)),
        (0u32..19, prop_oneof![Just(1), Just(-1)])
            .prop_map(|(exponent, sign)| Jump(sign * 10i64.pow(exponent))),
    ]
}

proptest! {
    #![proptest_config(Config { cases: crate::cases(24), failure_persistence: None, ..Config::default() })]

    #[test]
    fn any_values_are_answered_or_refused(
        changes in prop::collection::vec(any_change(), 1..3),
        options in prop::sample::select(requests()),
    ) {
        let robot = two_link();
        let changed = changes.iter().fold(log(0.0), |log, change| change.apply(&log));
        let request = Repair::default().with_sort(true).with_drop_duplicates(true).with_drop_not_finite(true);
        let logs = repair(&changed, &request).map_or_else(|_| vec![changed.clone()], |(parts, _)| parts);
        let _ = through_identification(&robot, &logs, &options);
    }
}
