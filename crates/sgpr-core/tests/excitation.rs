//! Excitation trajectories against the published ones, and against their limits.
#![allow(missing_docs)]

#[path = "common/noise.rs"]
mod noise;

use std::time::Instant;

use noise::Noise;
use sgpr_core::dynamics::{Samples, Workspace, forward_kinematics, jacobian, regressor};
use sgpr_core::excitation::*;
use sgpr_core::identification::{
    BaseParameters, LeastSquares, Method, Observation, ParameterSet, Trajectory as Equations,
};
use sgpr_core::model::TorqueModel;
use sgpr_core::progress::{Interrupted, Progress};
use sgpr_core::robot::{Robot, puma560, two_link};
use sgpr_core::simulation::Reference;
use sgpr_core::spatial::Vector3;

/// S. Krishnamoorthi, MSc thesis, TU Delft (2018), table C-1: a_1 .. a_4 and b_1 .. b_4 of the
/// PUMA 560.
const PUMA: [[f64; 24]; 2] = [
    [
        0.88, 1.20, 0.0008, -0.28, -0.09, -1.44, //
        0.26, -0.13, 0.0006, 0.41, -0.026, 0.19, //
        -0.54, 0.41, 0.066, -0.88, -0.86, 0.26, //
        -0.76, 0.21, 0.11, -0.99, -0.22, -1.0,
    ],
    [
        -0.57, 0.27, -0.63, 0.24, 0.75, 0.091, //
        0.26, 0.28, -0.30, -0.067, 0.74, 1.33, //
        0.23, -1.89, 0.56, 0.92, 0.20, 1.08, //
        0.11, -0.29, 0.17, 0.44, -0.44, -0.54,
    ],
];

/// The same, table C-2: a_1 .. a_3 and b_1 .. b_3 of the two-link arm.
const TWO_LINK: [[f64; 6]; 2] = [
    [0.15, -0.25, -2.80e-5, -6.59e-5, -0.21, 0.22],
    [8.96e-5, 0.00021, 0.0648, 0.029, -5.04e-5, -0.00011],
];

const FRICTION: [&str; 2] = ["viscous_friction", "coulomb_friction"];

/// The four criteria of the thesis.
const CRITERIA: [Criterion; 4] = [
    Criterion::Condition,
    Criterion::FrobeniusCondition,
    Criterion::SumOfConditions,
    Criterion::DOptimality,
];

/// The two-link arm of the thesis, level: gravity does no work, four base parameters.
fn level_two_link() -> Robot {
    two_link().with_gravity(Vector3::new(0.0, 0.0, -9.81))
}

struct Case {
    robot: Robot,
    set: ParameterSet,
    base: BaseParameters,
    limits: MotionLimits,
    published: Trajectory,
}

impl Case {
    fn new(robot: Robot, effects: &[&str], acceleration: f64, [a, b]: [&[f64]; 2]) -> Self {
        let set = ParameterSet::new(&robot, effects).expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let limits =
            MotionLimits::of_robot(&robot, &vec![acceleration; robot.dof()]).expect("limits");
        let published = Trajectory::fourier(0.1, robot.dof(), a, b).expect("amplitudes");
        Self { robot, set, base, limits, published }
    }

    fn puma(effects: &[&str]) -> Self {
        Self::new(puma560(), effects, 6.0, [&PUMA[0], &PUMA[1]])
    }

    fn two_link(effects: &[&str]) -> Self {
        Self::new(level_two_link(), effects, 2.0, [&TWO_LINK[0], &TWO_LINK[1]])
    }

    fn options(&self, criterion: Criterion) -> ExciteOptions {
        ExciteOptions::new(self.published.basis().clone(), self.limits.clone())
            .with_criterion(criterion)
            .with_starts(2)
            .with_evaluations(900)
            .with_threads(2)
    }

    fn report(&self, motion: &Trajectory) -> ExcitationReport {
        evaluate(
            &self.robot,
            &self.set,
            &self.base,
            None,
            &motion.samples(60.0, motion.duration()),
            None,
        )
        .expect("samples")
    }

    fn optimise(&self, options: &ExciteOptions) -> Excitation {
        optimise(&self.robot, &self.set, &self.base, options, &()).expect("feasible limits")
    }
}

fn value(criterion: Criterion, report: &ExcitationReport) -> f64 {
    match criterion {
        Criterion::Condition => report.condition,
        Criterion::FrobeniusCondition => report.frobenius_condition,
        Criterion::SumOfConditions => report.sum_of_conditions(),
        Criterion::DOptimality => -report.log_determinant,
        _ => unreachable!("not in this test"),
    }
}

/// Every limit over continuous time: a grid that is a hundred times finer than what the search saw,
/// and rest at the ends.
fn assert_within_limits(case: &Case, found: &Excitation) {
    assert!(found.utilisation <= 1.0 && found.utilisation > 0.99, "{}", found.utilisation);
    let motion = &found.trajectory;
    let n = case.robot.dof();
    let samples = motion.samples(2000.0, motion.duration());
    for (index, ((q, dq), ddq)) in samples.q.iter().zip(&samples.dq).zip(&samples.ddq).enumerate() {
        let joint = index % n;
        let [low, high] = case.limits.position[joint];
        assert!(*q >= low - 1e-6 && *q <= high + 1e-6);
        assert!(dq.abs() <= case.limits.velocity[joint] + 1e-6);
        assert!(ddq.abs() <= case.limits.acceleration[joint] + 1e-6);
    }
    for time in [0.0, motion.duration()] {
        let mut state = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let [q, dq, ddq] = &mut state;
        motion.sample(time, q, dq, ddq);
        assert!(state.iter().flatten().all(|value| value.abs() < 1e-12), "{state:?}");
    }
}

#[test]
fn published_amplitudes_are_beaten_under_the_same_limits() {
    // The six-axis arm with two criteria only: the others are as good, see `sgpr reproduce thesis`.
    let few = [Criterion::Condition, Criterion::SumOfConditions];
    let cases = [
        (Case::two_link(&FRICTION), &CRITERIA[..]),
        (Case::two_link(&[]), &CRITERIA),
        (Case::puma(&FRICTION), &few),
    ];
    for (case, criteria) in cases {
        let published = case.report(&case.published);
        for &criterion in criteria {
            let clock = Instant::now();
            let starts = if case.robot.dof() == 2 { 2 } else { 1 };
            let found = case.optimise(&case.options(criterion).with_starts(starts));
            assert_within_limits(&case, &found);
            let (before, after) =
                (value(criterion, &published), value(criterion, &case.report(&found.trajectory)));
            println!(
                "{} {} friction, {}: published {before:.3}, found {after:.3} ({:?}), {:.1} s",
                case.robot.name(),
                if case.base.rank() == 4 { "without" } else { "with" },
                criterion.name(),
                found.values,
                clock.elapsed().as_secs_f64()
            );
            assert!(after < before, "{}: {before} {after}", criterion.name());
        }
    }
}

#[test]
fn the_report_is_that_of_the_regressor() {
    let case = Case::two_link(&[]);
    let samples = case.published.samples(20.0, 10.0);
    let mut ws = Workspace::new(&case.robot);
    let rows: Vec<Vec<f64>> = (0..samples.len())
        .flat_map(|k| {
            let at = 2 * k..2 * k + 2;
            let y = regressor(
                &case.robot,
                &mut ws,
                &samples.q[at.clone()],
                &samples.dq[at.clone()],
                &samples.ddq[at],
            );
            let pick =
                |row: &[f64]| case.base.independent().iter().map(|&k| row[k]).collect::<Vec<_>>();
            y.chunks_exact(20).map(pick).collect::<Vec<_>>()
        })
        .collect();
    let report =
        evaluate(&case.robot, &case.set, &case.base, None, &samples, None).expect("samples");
    let energy: f64 = rows.iter().flatten().map(|x| x * x).sum();
    let squares: f64 = report.singular_values.iter().map(|s| s * s).sum();
    assert!((energy - squares).abs() < 1e-9 * energy, "{energy} {squares}");
    assert_eq!((report.rank, report.link_conditions.len()), (4, 2));
    assert!(report.frobenius_condition >= report.condition);
}

#[test]
fn torque_limits_are_kept_and_cost_excitation() {
    let case = Case::puma(&FRICTION);
    let mut options = case.options(Criterion::DOptimality).with_starts(1).with_evaluations(150);
    let mut parameters = case.robot.standard_parameters();
    parameters.extend([1.0; 12]);
    options.parameters = Some(parameters.clone());
    // Hanging: the arm's weight alone takes no torque.
    options.start = Some(vec![0.0, -1.57, 0.0, 0.0, 0.0, 0.0]);
    let free = case.optimise(&options);
    let limits: Vec<f64> = free.peaks.torque.iter().map(|peak| 0.8 * peak).collect();
    options.limits.torque = Some(limits.clone());
    let found = case.optimise(&options);
    assert!(found.utilisation <= 1.0 && found.value > free.value);
    assert!(
        free.tightest.contains("joint `") && !free.tightest.starts_with("torque"),
        "{}",
        free.tightest
    );
    assert!(found.tightest.contains("joint `"), "{}", found.tightest);
    let model = sgpr_core::model::TorqueModel::with_parameters(&case.robot, &FRICTION, parameters)
        .expect("effects");
    let samples = found.trajectory.samples(2000.0, 10.0);
    let motion = sgpr_core::dynamics::Samples { q: &samples.q, dq: &samples.dq, ddq: &samples.ddq };
    for (index, tau) in model.predict(motion).iter().enumerate() {
        assert!(tau.abs() <= limits[index % 6] + 1e-6, "joint {}: {tau}", index % 6 + 1);
    }
}

#[test]
fn the_arm_stays_clear_of_its_surroundings() {
    let case = Case::puma(&FRICTION);
    let mut cell = Surroundings::skeleton(&case.robot, 0.05);
    cell.floor = Some(-0.5);
    cell.blocks = vec![Block { low: [0.7, -0.2, 0.3], high: [1.0, 0.2, 0.8] }];
    cell.self_collision = true;
    cell.clearance = 0.02;
    let tip = case.robot.frames().last().expect("a tool frame").clone();
    cell.tip_speed = Some((tip.clone(), 1.2));
    let mut options = case.options(Criterion::Condition).with_starts(1).with_evaluations(150);
    let free = case.optimise(&options).trajectory;
    options.surroundings = Some(cell);
    let found = case.optimise(&options);
    assert!(found.utilisation <= 1.0 && found.value.is_finite());

    // Lowest point and tool speed, by kinematics alone.
    let mut ws = Workspace::new(&case.robot);
    let mut extremes = |motion: &Trajectory| {
        let samples = motion.samples(500.0, 10.0);
        let (mut lowest, mut fastest) = (f64::INFINITY, 0.0f64);
        for (q, dq) in samples.q.chunks_exact(6).zip(samples.dq.chunks_exact(6)) {
            for pose in forward_kinematics(&case.robot, &mut ws, q) {
                lowest = lowest.min(pose.translation.z);
            }
            let j = jacobian(&case.robot, &mut ws, q, &tip);
            let speed = (0..3)
                .map(|row| (0..6).map(|k| j[row * 6 + k] * dq[k]).sum::<f64>().powi(2))
                .sum::<f64>();
            fastest = fastest.max(speed.sqrt());
        }
        (lowest, fastest)
    };
    let ((_, free_speed), (lowest, speed)) = (extremes(&free), extremes(&found.trajectory));
    assert!(lowest > -0.5 + 0.07 - 1e-6, "{lowest}");
    assert!(speed <= 1.2 + 1e-6 && free_speed > 1.2, "{speed} {free_speed}");
}

#[test]
fn a_limit_that_forbids_to_move_is_named() {
    let case = Case::two_link(&FRICTION);
    let refused = |change: fn(&mut ExciteOptions, &Case)| {
        let mut options = case.options(Criterion::Condition).with_starts(1).with_evaluations(20);
        change(&mut options, &case);
        let (set, base) = (&case.set, &case.base);
        optimise(&case.robot, set, base, &options, &()).expect_err("nothing can move").to_string()
    };
    let message = refused(|options, case| {
        let mut cell = Surroundings::skeleton(&case.robot, 0.05);
        cell.tip_speed = Some((case.robot.frames().last().expect("a tool frame").clone(), 1e-9));
        options.surroundings = Some(cell);
    });
    assert!(message.contains("speed of the tip"), "{message}");
    let message = refused(|options, _| options.limits.velocity.fill(1e-9));
    assert!(message.contains("speed of joint"), "{message}");
}

#[test]
fn every_basis_and_criterion_gives_a_motion() {
    let case = Case::two_link(&FRICTION);
    for basis in [
        Basis::BSpline { duration: 10.0, control_points: 14 },
        Basis::PointToPoint { duration: 10.0, points: 8 },
        Basis::Fourier { fundamental_hz: 0.1, harmonics: 3..=6 },
    ] {
        for criterion in Criterion::ALL {
            let options = case
                .options(criterion)
                .with_basis(basis.clone())
                .with_starts(1)
                .with_evaluations(60);
            let found = case.optimise(&options);
            assert!(found.value.is_finite() && found.report.rank == 8, "{basis:?} {criterion:?}");
            assert_within_limits(&case, &found);
        }
    }
}

/// Columns of a dead zone jump with the direction of motion, those of cogging have many optima.
#[test]
fn motions_for_nonlinear_effects_are_better_for_them_than_motions_without() {
    let case = Case::two_link(&["viscous_friction"]);
    for name in ["stribeck_friction", "backlash", "cogging_torque"] {
        let effect = sgpr_core::effects::by_name(name).expect("of the library");
        let terms = nominal_terms(&case.robot, &effect, 10.0).expect("shown by a motion");
        let parameters = [case.robot.standard_parameters(), vec![0.0; 2]].concat();
        let nominal =
            NominalEffects::new(&case.robot, &case.set, &case.base, &parameters, terms, 10.0);
        let judge = |motion: &Trajectory| {
            let samples = motion.samples(100.0, 10.0);
            evaluate(&case.robot, &case.set, &case.base, Some(&nominal), &samples, None)
                .expect("samples")
        };
        let options = case.options(Criterion::DOptimality).with_starts(1).with_evaluations(100);
        let plain = case.optimise(&options);
        let found =
            case.optimise(&options.with_evaluations(200).with_nominal(Some(nominal.clone())));
        assert_within_limits(&case, &found);
        let (before, after) = (judge(&plain.trajectory), judge(&found.trajectory));
        println!(
            "{name}: {} {:.2} {:.2}",
            nominal.len(),
            before.log_determinant,
            after.log_determinant
        );
        let least = if name == "stribeck_friction" { 0.5 } else { -0.2 };
        assert!(after.log_determinant > before.log_determinant + least, "{name}");
        assert_eq!(after.rank, case.base.rank() + nominal.len());
    }
}

/// The torque of the PUMA 560 knows neither where its first joint, upright, has its zero, nor the
/// last one, about which the last link is symmetric; and of a tilt of the base about two axes it
/// shows both.
#[test]
fn constants_that_change_no_torque_are_hidden() {
    let case = Case::puma(&["viscous_friction"]);
    let nominal = |robot: &Robot, name: &str| {
        let effect = sgpr_core::effects::by_name(name).expect("of the library");
        let terms = nominal_terms(robot, &effect, 10.0).expect("shown by a motion");
        let parameters = [robot.standard_parameters(), vec![1.0; 6]].concat();
        NominalEffects::new(
            robot,
            &case.set,
            &BaseParameters::new(robot, &case.set),
            &parameters,
            terms,
            10.0,
        )
    };
    let offsets = nominal(&case.robot, "encoder_offset");
    assert_eq!(offsets.hidden(), ["joint_1.d (encoder_offset)", "joint_6.d (encoder_offset)"]);
    assert!(nominal(&case.robot, "base_tilt").hidden().is_empty());
    assert!(nominal(&case.robot, "link_flexibility").hidden().is_empty(), "modes of 12 Hz");
    assert!(
        nominal(&case.robot, "link_inertia_error").is_empty(),
        "that is what base parameters are"
    );
    let motion = random_motion(
        &case.robot,
        &Basis::fourier(0.1, 4),
        &MotionLimits::of_robot(&case.robot, &[6.0; 6]).expect("limits"),
        &[0.0; 6],
        1,
    );
    let samples = motion.expect("within limits").samples(100.0, 10.0);
    // All gains and all masses larger together change nothing; without the gain of the joint that
    // carries most the others are told.
    let gains = nominal(&case.robot, "torque_gain_error");
    assert_eq!(gains.hidden(), ["joint_2.e (torque_gain_error)"]);
    let report = evaluate(&case.robot, &case.set, &case.base, Some(&gains), &samples, None)
        .expect("samples");
    assert!(report.rank == 47 && report.not_told_apart.is_empty(), "{report:?}");
    let report = evaluate(&case.robot, &case.set, &case.base, Some(&offsets), &samples, None)
        .expect("samples");
    assert_eq!((report.rank, report.singular_values.len()), (46, 46));
    assert!(report.not_told_apart.is_empty());
}

/// A motion of the second joint alone says little of the other links, and which of them is named.
#[test]
fn parameters_that_a_motion_confuses_are_named() {
    let case = Case::two_link(&["viscous_friction"]);
    let mut samples =
        case.optimise(&case.options(Criterion::Condition).with_starts(1).with_evaluations(40));
    let mut still = samples.trajectory.samples(100.0, 10.0);
    assert!(samples.report.not_told_apart.is_empty());
    for values in [&mut still.q, &mut still.dq, &mut still.ddq] {
        values.iter_mut().step_by(2).for_each(|value| *value = 0.0);
    }
    samples.report =
        evaluate(&case.robot, &case.set, &case.base, None, &still, None).expect("samples");
    let report = samples.report;
    assert!(report.rank < case.base.rank());
    assert!(
        report.not_told_apart.contains(&"joint_1.Fv".to_string()),
        "{:?}",
        report.not_told_apart
    );
    assert!(
        !report.not_told_apart.contains(&"joint_2.Fv".to_string()),
        "{:?}",
        report.not_told_apart
    );
}

#[test]
fn the_result_depends_on_the_seed_and_on_nothing_else() {
    let case = Case::two_link(&FRICTION);
    let run = |threads: usize, seed: u64| {
        let options = case
            .options(Criterion::Condition)
            .with_starts(3)
            .with_evaluations(60)
            .with_threads(threads)
            .with_seed(seed);
        case.optimise(&options).trajectory
    };
    assert_eq!(run(1, 3), run(3, 3));
    assert_ne!(run(1, 3), run(1, 4));
}

#[test]
fn an_interrupted_search_gives_its_best_so_far() {
    struct Stop;
    impl Progress for Stop {
        fn step(&self, _: &'static str, done: usize, _: usize) -> Result<(), Interrupted> {
            if done > 40 { Err(Interrupted) } else { Ok(()) }
        }
    }
    let case = Case::puma(&FRICTION);
    let options = case.options(Criterion::Condition).with_starts(100).with_evaluations(1000);
    let found = optimise(&case.robot, &case.set, &case.base, &options, &Stop).expect("a motion");
    assert_eq!(found.status, Status::Interrupted);
    assert!(found.value.is_finite() && found.utilisation <= 1.0);
}

/// The forecast against the scatter of identifications from noisy samples, two a second.
#[test]
fn the_forecast_is_what_identifications_scatter_by() {
    let case = Case::new(two_link(), &FRICTION, 6.0, TWO_LINK.each_ref().map(|values| &values[..]));
    let noise = [0.4, 0.1];
    let mut parameters = case.robot.standard_parameters();
    parameters.extend([0.3, 0.2, 0.5, 0.4]);
    let forecast =
        forecast(&case.robot, &case.set, &case.base, &case.published, &parameters, Some(&noise))
            .expect("fits");
    assert_eq!(forecast.noise, noise);
    assert_eq!(forecast.seconds, [10.0, 20.0, 40.0, 80.0, 160.0]);
    // Sixteen repetitions, sampled where the last one was not.
    let recorded = case.published.samples(2.0 * 160.0 / 159.0, 160.0);
    let true_model =
        TorqueModel::with_parameters(&case.robot, &FRICTION, parameters).expect("known effects");
    let motion = Samples { q: &recorded.q, dq: &recorded.dq, ddq: &recorded.ddq };
    let exact = true_model.predict(motion);
    let mut random = Noise(5);
    let states: Vec<[Vec<f64>; 3]> = (0..300)
        .map(|_| {
            let mut state = [vec![], vec![], vec![]];
            for joint in 0..2 {
                let at = ((random.uniform() * recorded.len() as f64) as usize) * 2 + joint;
                let direction = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
                let values = [recorded.q[at], direction * recorded.dq[at], recorded.ddq[at]];
                state.iter_mut().zip(values).for_each(|(all, value)| all.push(value));
            }
            state
        })
        .collect();
    let mut squares = [0.0; 2];
    const TRIALS: usize = 60;
    for _ in 0..TRIALS {
        let tau: Vec<f64> =
            exact.iter().enumerate().map(|(k, tau)| tau + noise[k % 2] * random.normal()).collect();
        let mut observation = Observation::new(&case.robot, &case.set, &case.base);
        observation.add(&Equations::new(motion, &tau)).expect("a motion");
        let solver = LeastSquares::new(Method::WlsKnown(noise.to_vec()));
        let nominal = vec![0.0; case.base.rank()];
        let found = solver.solve(&observation.factors(), &case.base, &nominal).expect("excited");
        let all = case.base.expand(&found.values, true_model.parameters());
        let model =
            TorqueModel::with_parameters(&case.robot, &FRICTION, all).expect("known effects");
        for [q, dq, ddq] in &states {
            let at = Samples { q, dq, ddq };
            for (square, (a, b)) in
                squares.iter_mut().zip(model.predict(at).iter().zip(true_model.predict(at)))
            {
                *square += (a - b).powi(2);
            }
        }
    }
    for (joint, square) in squares.iter().enumerate() {
        let scatter = (square / (TRIALS * states.len()) as f64).sqrt();
        let said = forecast.deviation[4][joint];
        assert!((scatter / said - 1.0).abs() < 0.2, "joint {joint}: {scatter} {said}");
    }
}

#[test]
fn bad_input_is_refused_with_names() {
    let case = Case::puma(&FRICTION);
    let message = |change: &dyn Fn(&mut ExciteOptions)| {
        let mut options = case.options(Criterion::Condition);
        change(&mut options);
        optimise(&case.robot, &case.set, &case.base, &options, &()).expect_err("bad").to_string()
    };
    let infeasible =
        message(&|options| options.limits.torque = Some(vec![50.0, 20.0, 50.0, 5.0, 5.0, 5.0]));
    assert!(infeasible.contains("torque of joint `joint_2` against gravity is"), "{infeasible}");
    let outside = message(&|options| options.start = Some(vec![0.0, 0.0, 0.9, 0.0, 0.0, 0.0]));
    assert!(outside.contains("position of joint `joint_3` is 0.9"), "{outside}");
    let negative = message(&|options| options.limits.velocity[3] = -1.0);
    assert_eq!(
        negative,
        "the speed limit of joint `joint_4` is -1: a limit is finite and above zero"
    );
    let short = message(&|options| options.limits.acceleration.truncate(2));
    assert_eq!(short, "acceleration limits: got 2 values for 6 joints: give one for each");
    let basis = message(&|options| options.basis = Basis::fourier(0.0, 4));
    assert!(basis.starts_with("fundamental_hz is 0"), "{basis}");
    let low = message(&|options| {
        let mut cell = Surroundings::skeleton(&case.robot, 0.1);
        cell.floor = Some(0.0);
        options.surroundings = Some(cell);
    });
    assert!(
        low.contains("distance of the link of joint `joint_") && low.contains("from the floor"),
        "{low}"
    );
    let turned = message(&|options| {
        let mut cell = Surroundings::skeleton(&case.robot, 0.1);
        cell.blocks = vec![Block { low: [0.6, 0.0, 0.0], high: [0.5, 1.0, 1.0] }];
        options.surroundings = Some(cell);
    });
    assert_eq!(turned, "highest corner of a box is 0.5: a number above that of the lowest corner");
    let robot = two_link().with_standard_parameters(&[0.0; 20]);
    assert!(
        MotionLimits::of_robot(&robot, &[1.0])
            .expect_err("short")
            .to_string()
            .contains("got 1 value for 2 joints")
    );
}
