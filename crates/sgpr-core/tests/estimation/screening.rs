//! Mistakes that logs are made with are recognised, and a good log passes.

use sgpr_core::identification::{
    Equations, Finding, LeastSquares, Method, screen_delays, screen_factors, screen_rows,
    screen_scale,
};

use crate::arm::{Experiment, RATE, trajectory};
use crate::noise::Noise;

/// What is found in a log that was spoilt; torques come `shifts` samples late.
fn findings(spoil: impl Fn(usize, usize, f64) -> f64, shifts: [usize; 2]) -> Vec<Finding> {
    let experiment = Experiment::new(4000);
    let motion = experiment.run(&experiment.truth);
    let mut random = Noise(29);
    let clean: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.1 * random.normal()).collect();
    let late = |k: usize, joint: usize| clean[(k - shifts[joint].min(k)) * 2 + joint];
    let tau: Vec<f64> = (0..clean.len())
        .map(|index| spoil(index / 2, index % 2, late(index / 2, index % 2)))
        .collect();
    let (robot, set, base) = (&experiment.robot, &experiment.set, &experiment.base);
    let mut equations = Equations::new(robot, set, base, vec![trajectory(&motion, &tau)]);
    let factors = equations.factors().expect("good data");
    let estimate = LeastSquares::new(Method::Wls)
        .solve(&factors, base, &experiment.nominal())
        .expect("good data");
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    let mut findings = screen_factors(set, base, &joints, &factors, &estimate);
    findings.extend(screen_scale(set, base, &experiment.nominal(), &factors));
    findings.extend(
        screen_rows(&mut equations, &joints, &[RATE], &factors, &estimate).expect("good data"),
    );
    findings.extend(screen_delays(&equations, &joints, &[RATE]).expect("good data"));
    findings
}

#[test]
fn a_good_log_passes() {
    assert_eq!(findings(|_, _, tau| tau, [0, 0]), []);
}

#[test]
fn a_negated_torque_is_named() {
    let found = findings(|_, joint, tau| if joint == 1 { -tau } else { tau }, [0, 0]);
    assert_eq!(found[0], Finding::Negated { joint: "joint_2".into() });
    assert!(found[0].to_string().contains("joint_2 looks negated"));
}

#[test]
fn torques_that_are_all_negated_would_make_friction_drive() {
    assert_eq!(findings(|_, _, tau| -tau, [0, 0])[0], Finding::AllNegated);
}

#[test]
fn a_torque_in_another_unit_is_named_with_its_factor() {
    let found = findings(|_, joint, tau| if joint == 1 { 1000.0 * tau } else { tau }, [0, 0]);
    let Finding::Scaled { joint, factor } = &found[0] else { panic!("{found:?}") };
    // The other joint's parameters may be scaled just as well: what is certain is the ratio.
    let right = joint == "joint_2" && (factor * 1000.0 - 1.0).abs() < 0.05;
    let other = joint == "joint_1" && (factor / 1000.0 - 1.0).abs() < 0.05;
    assert!(right || other, "{found:?}");
}

#[test]
fn a_gain_that_is_off_by_two_is_named() {
    for gain in [0.5, 2.0] {
        let found = findings(|_, joint, tau| if joint == 0 { gain * tau } else { tau }, [0, 0]);
        let Some(Finding::Scaled { joint, factor }) = found.first() else {
            panic!("{gain}: {found:?}")
        };
        // What is certain is the ratio of the two.
        let ratio = if joint == "joint_1" { factor * gain } else { factor / gain };
        assert!((ratio - 1.0).abs() < 0.1, "{gain}: {found:?}");
    }
}

#[test]
fn a_late_torque_is_named_with_its_delay() {
    for samples in [4, 11, 26] {
        let found = findings(|_, _, tau| tau, [0, samples]);
        let late: Vec<_> = found
            .iter()
            .filter_map(|finding| match finding {
                Finding::Late { joint, seconds, .. } => Some((joint.as_str(), *seconds)),
                _ => None,
            })
            .collect();
        assert_eq!(late.len(), 1, "{found:?}");
        assert_eq!(late[0].0, "joint_2");
        assert!(
            (late[0].1 - samples as f64 / RATE).abs() < 0.5 / RATE,
            "{samples}: {}",
            late[0].1 * RATE
        );
    }
}

#[test]
fn torques_that_are_all_late_have_one_clock() {
    for samples in [3, 20] {
        let found = findings(|_, _, tau| tau, [samples, samples]);
        let late: Vec<_> = found
            .iter()
            .filter(|finding| matches!(finding, Finding::AllLate { .. } | Finding::Late { .. }))
            .collect();
        let [Finding::AllLate { seconds, gain }] = late[..] else { panic!("{found:?}") };
        assert!(
            (seconds - samples as f64 / RATE).abs() < 0.5 / RATE,
            "{samples}: {}",
            seconds * RATE
        );
        assert!(*gain > 0.4, "{gain}");
        assert!(late[0].to_string().contains("ms after their motion"));
    }
}

#[test]
fn torques_that_are_all_in_another_unit_are_told_from_the_robot_file() {
    for factor in [1000.0, 0.1] {
        let found = findings(|_, _, tau| factor * tau, [0, 0]);
        let [Finding::AllScaled { factor: named }] = found[..] else { panic!("{found:?}") };
        // The robot file is a tenth too heavy.
        assert!((1.1 * named / factor - 1.0).abs() < 0.05, "{named}");
    }
}

#[test]
fn a_spike_is_found_where_it_is() {
    let found =
        findings(|k, joint, tau| if k == 1234 && joint == 0 { tau + 50.0 } else { tau }, [0, 0]);
    let [Finding::Outliers { joint, count: 1, worst: (0, 1234), .. }] = &found[..] else {
        panic!("{found:?}")
    };
    assert_eq!(joint, "joint_1");
}
