//! What controllers make of a model: compensation without chatter, and torque from outside.
#![allow(missing_docs)]

use sgpr_core::control::{Compensation, CompensationOptions, MomentumObserver, ObserverError, ObserverOptions};
use sgpr_core::dynamics::{Workspace, forward_dynamics, gravity_torque};
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
    let mut bristles = Term::new(by_name("presliding_friction").expect("of the library"), Site::Joint(1), vec![0.01]);
    bristles.coefficients = vec![3.0];
    let model = model(&robot).with_terms(vec![bristles], Some(0));
    let mut compensation = Compensation::new(&model, &CompensationOptions::default()).expect("streams");
    let q = [0.3, -0.4, 0.2, 0.9, 0.5, -0.1];
    let mut ws = Workspace::new(&robot);
    let gravity = gravity_torque(&robot, &mut ws, &q).to_vec();
    let mut of_speed = |speed: f64| compensation.torque(&q, &[0.0, speed, 0.0, 0.0, 0.0, 0.0]).expect("finite")[1];
    assert!((of_speed(0.0) - gravity[1]).abs() < 1e-12);
    // Share 0.8 of Fc + Fv dq + Dahl's force, in full above the transition, half of it in the middle.
    let friction = |speed: f64| 0.8 * (0.5 * speed + 1.1 + 3.0);
    assert!((of_speed(0.1) - gravity[1] - friction(0.1)).abs() < 1e-9, "{}", of_speed(0.1) - gravity[1]);
    assert!((of_speed(-0.1) - gravity[1] + friction(0.1)).abs() < 1e-9);
    assert!((of_speed(0.01) - gravity[1] - 0.5 * friction(0.01)).abs() < 1e-9);
    let mut last = of_speed(-0.05);
    for k in -499..=500 {
        let tau = of_speed(1e-4 * f64::from(k));
        assert!((tau - last).abs() < 0.02, "a jump of {} at {k}", tau - last);
        last = tau;
    }
    let limits = vec![0.5; 6];
    let options = CompensationOptions { limits, ..CompensationOptions::default() };
    let mut limited = Compensation::new(&model, &options).expect("streams");
    assert!(limited.torque(&q, &[1.0; 6]).expect("finite").iter().all(|tau| tau.abs() <= 0.5));
    for wrong in [
        CompensationOptions { friction: 1.5, ..CompensationOptions::default() },
        CompensationOptions { transition_speed: 0.0, ..CompensationOptions::default() },
        CompensationOptions { limits: vec![1.0; 5], ..CompensationOptions::default() },
    ] {
        assert!(Compensation::new(&model, &wrong).is_err());
    }
    assert!(limited.torque(&q, &[f64::NAN; 6]).is_err() && limited.torque(&q[1..], &[0.0; 6]).is_err());
}

/// An arm under gravity without friction, moved by a torque of the drives and one from outside, by small steps; what the
/// observer says at the end of each period.
fn observed(robot: &Robot, outside: impl Fn(f64) -> Vec<f64>, seconds: f64) -> Vec<Vec<f64>> {
    const RATE_HZ: f64 = 500.0;
    const FINE: usize = 20;
    let n = robot.dof();
    let model = TorqueModel::nominal(robot);
    let options =
        ObserverOptions { rate_hz: RATE_HZ, bandwidth_hz: 5.0, deviation: vec![0.1; n], ..ObserverOptions::default() };
    let mut observer = MomentumObserver::new(&model, &options).expect("options");
    let mut ws = Workspace::new(robot);
    let (mut q, mut dq) = (vec![0.3; n], vec![0.0; n]);
    let mut all = Vec::new();
    for k in 0..(seconds * RATE_HZ) as usize {
        let t = k as f64 / RATE_HZ;
        let gravity = gravity_torque(robot, &mut ws, &q).to_vec();
        let tau: Vec<f64> = (0..n).map(|j| gravity[j] + 4.0 * (3.0 * t + j as f64).sin() - 0.5 * dq[j]).collect();
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
    let options = ObserverOptions { deviation: vec![0.2, 0.4], ..ObserverOptions::default() };
    let at = |false_alarms_per_hour: f64| {
        let options = ObserverOptions { false_alarms_per_hour, ..options.clone() };
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
    let error = MomentumObserver::new(&model, &ObserverOptions::default()).expect_err("not identified");
    assert_eq!(error, ObserverError::NoDeviation);
    let fast = ObserverOptions { bandwidth_hz: 50.0, ..options.clone() };
    assert!(matches!(MomentumObserver::new(&model, &fast), Err(ObserverError::TooFast { .. })));
    let none = ObserverOptions { false_alarms_per_hour: 0.0, ..options };
    assert!(MomentumObserver::new(&model, &none).expect_err("none").to_string().contains("false_alarms_per_hour"));
}
