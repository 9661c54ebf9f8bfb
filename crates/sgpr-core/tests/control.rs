//! What controllers make of a model: compensation without chatter, and torque from outside.
#![allow(missing_docs)]

#[path = "common/noise.rs"]
mod noise;

use noise::Noise;
use sgpr_core::control::{
    Compensation, CompensationOptions, MeasuredMotion, MomentumObserver, ObserverError,
    ObserverOptions,
};
use sgpr_core::dynamics::{Workspace, forward_dynamics, gravity_torque, rnea};
use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{Term, TorqueModel};
use sgpr_core::robot::{Robot, puma560, two_link};

fn model(robot: &Robot) -> TorqueModel {
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..3 * robot.dof()).map(|k| 0.4 + 0.1 * k as f64));
    TorqueModel::with_parameters(robot, &effects, parameters).expect("known effects")
}

#[test]
fn an_arm_that_is_wanted_to_stand_gets_gravity_and_a_reversal_does_not_jump() {
    let robot = puma560();
    let mut bristles = Term::new(
        by_name("presliding_friction").expect("of the library"),
        Site::Joint(1),
        vec![0.01],
    );
    bristles.coefficients = vec![3.0];
    let model = model(&robot).with_terms(vec![bristles], Some(0));
    let mut compensation =
        Compensation::new(&model, &CompensationOptions::default()).expect("streams");
    let q = [0.3, -0.4, 0.2, 0.9, 0.5, -0.1];
    let mut ws = Workspace::new(&robot);
    let gravity = gravity_torque(&robot, &mut ws, &q).to_vec();
    let mut of_speed =
        |speed: f64| compensation.torque(&q, &[0.0, speed, 0.0, 0.0, 0.0, 0.0]).expect("finite")[1];
    assert!((of_speed(0.0) - gravity[1]).abs() < 1e-12);
    // Share 0.8 of Fc + Fv dq + Dahl's force, in full above the transition, half of it in the
    // middle.
    let friction = |speed: f64| 0.8 * (0.5 * speed + 1.1 + 3.0);
    assert!(
        (of_speed(0.1) - gravity[1] - friction(0.1)).abs() < 1e-9,
        "{}",
        of_speed(0.1) - gravity[1]
    );
    assert!((of_speed(-0.1) - gravity[1] + friction(0.1)).abs() < 1e-9);
    assert!((of_speed(0.01) - gravity[1] - 0.5 * friction(0.01)).abs() < 1e-9);
    let mut last = of_speed(-0.05);
    for k in -499..=500 {
        let tau = of_speed(1e-4 * f64::from(k));
        assert!((tau - last).abs() < 0.02, "a jump of {} at {k}", tau - last);
        last = tau;
    }
    let limits = vec![0.5; 6];
    let options = CompensationOptions::default().with_limits(limits);
    let mut limited = Compensation::new(&model, &options).expect("streams");
    assert!(limited.torque(&q, &[1.0; 6]).expect("finite").iter().all(|tau| tau.abs() <= 0.5));
    for wrong in [
        CompensationOptions::default().with_friction(1.5),
        CompensationOptions::default().with_transition_speed(0.0),
        CompensationOptions::default().with_limits(vec![1.0; 5]),
    ] {
        assert!(Compensation::new(&model, &wrong).is_err());
    }
    assert!(
        limited.torque(&q, &[f64::NAN; 6]).is_err() && limited.torque(&q[1..], &[0.0; 6]).is_err()
    );
}

/// An arm under gravity without friction, moved by a torque of the drives and one from outside, by
/// small steps; what the observer says at the end of each period.
fn observed(robot: &Robot, outside: impl Fn(f64) -> Vec<f64>, seconds: f64) -> Vec<Vec<f64>> {
    const RATE_HZ: f64 = 500.0;
    const FINE: usize = 20;
    let n = robot.dof();
    let model = TorqueModel::nominal(robot);
    let options = ObserverOptions::default()
        .with_rate_hz(RATE_HZ)
        .with_bandwidth_hz(5.0)
        .with_deviation(vec![0.1; n]);
    let mut observer = MomentumObserver::new(&model, &options).expect("options");
    let mut ws = Workspace::new(robot);
    let (mut q, mut dq) = (vec![0.3; n], vec![0.0; n]);
    let mut all = Vec::new();
    for k in 0..(seconds * RATE_HZ) as usize {
        let t = k as f64 / RATE_HZ;
        let gravity = gravity_torque(robot, &mut ws, &q).to_vec();
        let tau: Vec<f64> =
            (0..n).map(|j| gravity[j] + 4.0 * (3.0 * t + j as f64).sin() - 0.5 * dq[j]).collect();
        all.push(observer.update(&q, &dq, &tau).expect("finite").to_vec());
        for fine in 0..FINE {
            let step = 1.0 / (RATE_HZ * FINE as f64);
            let push = outside(t + fine as f64 * step);
            let sum: Vec<f64> = tau.iter().zip(push).map(|(tau, push)| tau + push).collect();
            let ddq = forward_dynamics(robot, &mut ws, &q, &dq, &sum).to_vec();
            for joint in 0..n {
                dq[joint] += step * ddq[joint];
                q[joint] += step * dq[joint];
            }
        }
    }
    all
}

#[test]
fn a_push_is_followed_with_a_lag_of_first_order_and_nothing_is_seen_without_one() {
    let robot = two_link();
    let quiet = observed(&robot, |_| vec![0.0; 2], 2.0);
    // What is left is the torque of the drives taken as constant for a period.
    let largest = quiet.iter().flatten().fold(0.0f64, |largest, x| largest.max(x.abs()));
    assert!(largest < 0.1, "{largest}");
    let pushed = observed(&robot, |t| vec![0.0, if t >= 1.0 { 3.0 } else { 0.0 }], 2.0);
    for after in [0.02, 0.05, 0.1, 0.5] {
        let k = ((1.0 + after) * 500.0) as usize;
        let lag = 3.0 * (1.0 - (-std::f64::consts::TAU * 5.0 * after).exp());
        assert!((pushed[k][1] - lag).abs() < 0.25, "{after} s: {} of {lag}", pushed[k][1]);
        assert!(pushed[k][0].abs() < 0.25, "{after} s: {} at the other joint", pushed[k][0]);
    }
}

#[test]
fn thresholds_follow_from_the_rate_of_false_alarms() {
    let robot = two_link();
    let model = model(&robot);
    let options = ObserverOptions::default().with_deviation(vec![0.2, 0.4]);
    let at = |false_alarms_per_hour: f64| {
        let options = options.clone().with_false_alarms_per_hour(false_alarms_per_hour);
        MomentumObserver::new(&model, &options).expect("options").thresholds().to_vec()
    };
    let (often, seldom) = (at(100.0), at(0.01));
    assert!((often[1] - 2.0 * often[0]).abs() < 1e-12 && seldom[0] > often[0]);
    // 2 n f exp(-z²/2) crossings per second.
    let z = seldom[0] / 0.2;
    assert!((3600.0 * 2.0 * 2.0 * 2.0 * (-0.5 * z * z).exp() - 0.01).abs() < 1e-9);
    let mut observer = MomentumObserver::new(&model, &options).expect("options");
    assert!(observer.update(&[0.0; 2], &[0.0; 2], &[f64::NAN, 0.0]).is_err());
    assert!(observer.update(&[0.0; 2], &[0.0; 2], &[0.0]).is_err());
    let error =
        MomentumObserver::new(&model, &ObserverOptions::default()).expect_err("not identified");
    assert_eq!(error, ObserverError::NoDeviation);
    let fast = options.clone().with_bandwidth_hz(50.0);
    assert!(matches!(MomentumObserver::new(&model, &fast), Err(ObserverError::TooFast { .. })));
    let none = options.with_false_alarms_per_hour(0.0);
    assert!(
        MomentumObserver::new(&model, &none)
            .expect_err("none")
            .to_string()
            .contains("false_alarms_per_hour")
    );
}

const RATE_HZ: f64 = 100.0;

/// A log of two joints that swing slowly: positions, velocities, torques. Errors of the model last
/// for some seconds, and are of a standard deviation of `moving`, and of as many times that as
/// `rest` at rest, half of it at 0.05 rad/s.
fn swinging(seed: u64, samples: usize, moving: f64, rest: f64) -> [Vec<f64>; 3] {
    let (robot, mut noise) = (two_link(), Noise(seed));
    let mut ws = Workspace::new(&robot);
    let [mut all_q, mut all_dq, mut all_tau] = [vec![], vec![], vec![]];
    let (mut error, keep) = ([0.0; 2], 0.99_f64);
    for k in 0..samples {
        let t = k as f64 / RATE_HZ;
        let swing =
            |w: f64| [0.6 * (w * t).sin(), 0.6 * w * (w * t).cos(), -0.6 * w * w * (w * t).sin()];
        let [[q0, dq0, ddq0], [q1, dq1, ddq1]] = [swing(0.7), swing(1.1)];
        let (q, dq) = ([q0, q1], [dq0, dq1]);
        let tau = rnea(&robot, &mut ws, &q, &dq, &[ddq0, ddq1]);
        for joint in 0..2 {
            error[joint] = keep * error[joint] + (1.0 - keep * keep).sqrt() * noise.normal();
            let deviation =
                moving * (1.0 + rest * rest / (1.0 + (dq[joint] / 0.05).powi(2))).sqrt();
            all_tau.push(tau[joint] + deviation * error[joint]);
        }
        all_q.extend(q);
        all_dq.extend(dq);
    }
    [all_q, all_dq, all_tau]
}

fn measured([q, dq, tau]: &[Vec<f64>; 3]) -> MeasuredMotion<'_> {
    MeasuredMotion { rate_hz: RATE_HZ, q, dq, tau }
}

/// Share of the time with an alarm while joints move, and while one of them rests.
fn alarms(observer: &mut MomentumObserver, [q, dq, tau]: &[Vec<f64>; 3]) -> [f64; 2] {
    let (mut alarmed, mut all) = ([0.0; 2], [0.0; 2]);
    observer.reset();
    for ((q, dq), tau) in q.chunks(2).zip(dq.chunks(2)).zip(tau.chunks(2)) {
        observer.update(q, dq, tau).expect("finite");
        let rests = usize::from(dq.iter().any(|dq| dq.abs() < 0.05));
        all[rests] += 1.0;
        alarmed[rests] += f64::from(u8::from(observer.alarm().is_some()));
    }
    [alarmed[0] / all[0], alarmed[1] / all[1]]
}

#[test]
fn logs_without_contact_tell_the_errors_of_joints_that_move_and_that_rest() {
    let model = TorqueModel::nominal(&two_link());
    let options = ObserverOptions::default()
        .with_rate_hz(RATE_HZ)
        .with_false_alarms_per_hour(100.0)
        .with_deviation(vec![0.3; 2]);
    let even = || MomentumObserver::new(&model, &options).expect("options");
    let logs = [swinging(1, 60_000, 0.2, 8.0), swinging(2, 60_000, 0.2, 8.0)];
    let known: Vec<MeasuredMotion<'_>> = logs.iter().map(measured).collect();
    let mut observer = even().calibrated(&known).expect("good logs");
    for error in observer.errors() {
        assert!((error.moving / 0.2 - 1.0).abs() < 0.15, "{error:?}");
        assert!((error.resting / 1.6 - 1.0).abs() < 0.3, "{error:?}");
        assert!((error.speed / 0.05).ln().abs() < 0.7, "{error:?}");
    }
    // With one deviation alarms are those of rest; with both there are few.
    let unseen = swinging(3, 120_000, 0.2, 8.0);
    let [moving, resting] = alarms(&mut even(), &unseen);
    assert!(resting > 0.2 && resting > 5.0 * moving, "{moving} {resting}");
    let [moving, resting] = alarms(&mut observer, &unseen);
    assert!(moving < 2e-3 && resting < 2e-3, "{moving} {resting}");
    // Of errors that rest has no part in.
    let plain = swinging(4, 60_000, 0.2, 0.0);
    let observer = even().calibrated(&[measured(&plain)]).expect("a good log");
    for error in observer.errors() {
        assert!((error.moving / 0.2 - 1.0).abs() < 0.1 && error.resting < 0.1, "{error:?}");
    }
}

#[test]
fn logs_that_tell_nothing_are_refused() {
    let model = TorqueModel::nominal(&two_link());
    let options = ObserverOptions::default().with_deviation(vec![0.3; 2]);
    let refused = |logs: &[MeasuredMotion<'_>]| {
        let observer = MomentumObserver::new(&model, &options).expect("options");
        observer.calibrated(logs).expect_err("refused").to_string()
    };
    let log = swinging(1, 200, 0.2, 1.0);
    let good = measured(&log);
    assert!(refused(&[]).contains("got 0 samples"));
    assert!(
        refused(&[MeasuredMotion { rate_hz: 94.0, ..good }])
            .contains("log 0: 94.0 samples per second")
    );
    assert!(refused(&[MeasuredMotion { dq: &log[1][2..], ..good }]).contains("dq"));
    let bad = [&log[2][..399], &[f64::NAN]].concat();
    assert!(refused(&[MeasuredMotion { tau: &bad, ..good }]).contains("tau"));
    let zeros = vec![0.0; 400];
    let flat = TorqueModel::nominal(&two_link().with_gravity(sgpr_core::spatial::Vector3::ZERO));
    let observer = MomentumObserver::new(&flat, &options).expect("options");
    let still = MeasuredMotion { q: &zeros, dq: &zeros, tau: &zeros, ..good };
    assert!(matches!(
        observer.calibrated(&[still]),
        Err(ObserverError::FewSamples { found: 200, .. })
    ));
}

#[test]
fn in_32_bits_compensation_and_observer_say_the_same() {
    let robot = puma560();
    let mut bristles = Term::new(
        by_name("presliding_friction").expect("of the library"),
        Site::Joint(1),
        vec![0.01],
    );
    bristles.coefficients = vec![3.0];
    let model = model(&robot).with_terms(vec![bristles], Some(0));
    let options = CompensationOptions::default().with_limits(vec![30.0; 6]);
    let mut compensation = Compensation::new(&model, &options).expect("streams");
    let mut single_compensation = Compensation::single(&model, &options).expect("streams");
    let options = ObserverOptions::default().with_deviation(vec![0.5; 6]);
    let mut observer = MomentumObserver::new(&model, &options).expect("options");
    let mut single_observer = MomentumObserver::single(&model, &options).expect("options");
    let mut ws = Workspace::new(&robot);
    let mut alarms = 0;
    for k in 0..3000 {
        let t = 0.01 * f64::from(k);
        let of = |f: fn(f64) -> f64, factor: f64| -> [f64; 6] {
            std::array::from_fn(|joint| factor * f((0.9 + 0.2 * joint as f64) * t + joint as f64))
        };
        let single = |all: &[f64]| all.iter().map(|x| *x as f32).collect::<Vec<_>>();
        // A motion that 32 bits hold, so that what differs is the arithmetic.
        let double = |all: [f64; 6]| all.map(|x| f64::from(x as f32));
        let (q, dq) = (double(of(f64::sin, 0.7)), double(of(f64::cos, 0.8)));
        let mut tau: [f64; 6] = rnea(&robot, &mut ws, &q, &dq, &[0.0; 6]).try_into().expect("six");
        if k > 2000 {
            tau[2] += 40.0;
        }
        let tau = double(tau);
        let near = |own: &[f32], expected: &[f64]| {
            let largest = expected.iter().fold(1.0f64, |largest, x| largest.max(x.abs()));
            own.iter()
                .zip(expected)
                .all(|(own, expected)| (f64::from(*own) - expected).abs() < 2e-5 * largest)
        };
        let expected = compensation.torque(&q, &dq).expect("finite");
        let own = single_compensation.torque(&single(&q), &single(&dq)).expect("finite");
        assert!(near(own, expected), "sample {k}: {own:?} {expected:?}");
        let expected = observer.update(&q, &dq, &tau).expect("finite");
        let own = single_observer.update(&single(&q), &single(&dq), &single(&tau)).expect("finite");
        assert!(near(own, expected), "sample {k}: {own:?} {expected:?}");
        assert!(near(single_observer.thresholds(), observer.thresholds()));
        let joint = observer.alarm().map(|alarm| alarm.joint);
        assert_eq!(single_observer.alarm().map(|alarm| alarm.joint), joint);
        alarms += usize::from(joint.is_some());
    }
    assert!(alarms > 500, "{alarms}");
}
