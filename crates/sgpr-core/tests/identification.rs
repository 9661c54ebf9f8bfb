//! Base parameters and least squares against tables, dense algebra and simulated truth.
#![allow(missing_docs)]

mod common;

use common::{ROBOTS, Reference, largest_difference};
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
use sgpr_core::dynamics::{BatchWorkspace, Samples, Workspace, regressor, rnea_batch};
use sgpr_core::effects::JointState;
use sgpr_core::identification::{
    BaseParameters, IdentificationError, LeastSquares, Method, Observation, ParameterClass,
    ParameterSet, Trajectory,
};
use sgpr_core::robot::{Robot, puma560, two_link};
use sgpr_core::signal::LowPass;
use sgpr_core::spatial::Vector3;

const ALL: [&str; 4] = ["viscous_friction", "coulomb_friction", "torque_offset", "rotor_inertia"];

#[test]
fn ranks_agree_with_the_reference_for_every_set_of_columns() {
    let sets: [(&str, &[&str]); 5] = [
        ("inertial", &[]),
        ("inertial+viscous+coulomb", &["viscous_friction", "coulomb_friction"]),
        (
            "inertial+viscous+coulomb+offset",
            &["viscous_friction", "coulomb_friction", "torque_offset"],
        ),
        ("inertial+rotor_inertia", &["rotor_inertia"]),
        ("inertial+rotor_inertia+viscous+coulomb+offset", &ALL),
    ];
    for name in ROBOTS {
        let reference = Reference::load(name);
        for (path, robot) in reference.robots() {
            for (label, effects) in sets {
                let set = ParameterSet::new(&robot, effects).expect("known effects");
                let expected = &reference.info["ranks"][label];
                assert_eq!(set.len() as u64, expected["columns"].as_u64().expect("a number"));
                let rank = BaseParameters::new(&robot, &set).rank() as u64;
                assert_eq!(
                    rank,
                    expected["rank"].as_u64().expect("a number"),
                    "{name} from {path}: {label}"
                );
            }
        }
    }
}

#[test]
fn classes_of_standard_parameters_agree_with_the_reference() {
    for name in ROBOTS {
        let reference = Reference::load(name);
        let robot = reference.by_urdf();
        let set = ParameterSet::new(&robot, &[] as &[&str]).expect("no effects");
        let base = BaseParameters::new(&robot, &set);
        let classes: Vec<u64> = base
            .classes()
            .iter()
            .map(|class| match class {
                ParameterClass::Invisible => 0,
                ParameterClass::Alone => 1,
                ParameterClass::Combined => 2,
            })
            .collect();
        let expected: Vec<u64> =
            serde_json::from_value(reference.info["parameter_class"].clone()).expect("classes");
        assert_eq!(classes, expected, "{name}");
    }
}

#[test]
fn the_two_link_arm_has_six_base_parameters_upright_and_four_lying() {
    let set = ParameterSet::new(&two_link(), &[] as &[&str]).expect("no effects");
    let expressions = |robot: &Robot| BaseParameters::new(robot, &set).expressions();
    assert_eq!(
        expressions(&two_link()),
        [
            "joint_1.mx + joint_2.m",
            "joint_1.my",
            "joint_1.Izz + joint_2.m",
            "joint_2.mx",
            "joint_2.my",
            "joint_2.Izz"
        ]
    );
    let lying = two_link().with_gravity(Vector3::new(0.0, 0.0, -9.81));
    assert_eq!(
        expressions(&lying),
        ["joint_1.Izz + joint_2.m", "joint_2.mx", "joint_2.my", "joint_2.Izz"]
    );
}

#[test]
fn rotor_inertia_of_the_first_joint_is_grouped_with_its_izz() {
    let robot = puma560();
    let set = ParameterSet::new(&robot, &["rotor_inertia"]).expect("a known effect");
    let base = BaseParameters::new(&robot, &set);
    let first = base.names().iter().position(|name| name == "joint_1.Izz").expect("kept");
    assert!(base.expression(first).contains("+ joint_1.Ia"), "{}", base.expression(first));
    assert!(!base.names().contains(&"joint_1.Ia".to_string()));
}

#[test]
fn base_parameters_give_the_torque_of_the_parameters_they_combine() {
    for name in ROBOTS {
        let reference = Reference::load(name);
        let robot = reference.by_urdf();
        let n = robot.dof();
        let set = ParameterSet::new(&robot, &ALL).expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let mut parameters = robot.standard_parameters();
        parameters.extend((0..set.len() - set.inertial()).map(|k| 0.1 + 0.03 * k as f64));
        let values = base.combine(&parameters);
        // From zero: what does not stand for a combination is zero, and the torque must be the
        // same.
        let sparse = base.expand(&values, &vec![0.0; set.len()]);
        assert!(sparse.iter().filter(|value| **value != 0.0).count() <= base.rank());
        assert!(largest_difference(&base.combine(&sparse), &values) < 1e-12);
        // From the parameters themselves nothing changes.
        assert!(largest_difference(&base.expand(&values, &parameters), &parameters) < 1e-12);
        let mut ws = Workspace::new(&robot);
        for k in 0..50 {
            let row = k * n..(k + 1) * n;
            let (q, dq, ddq) = (
                &reference.array("q")[row.clone()],
                &reference.array("dq")[row.clone()],
                &reference.array("ddq")[row],
            );
            let tau = |parameters: &[f64], ws: &mut Workspace| -> Vec<f64> {
                let y = regressor(&robot, ws, q, dq, ddq);
                let mut tau: Vec<f64> =
                    y.chunks_exact(10 * n).map(|row| dot(row, &parameters[..10 * n])).collect();
                set.add_effect_torque(parameters, &JointState { q, dq, ddq }, &mut tau);
                tau
            };
            let (full, combined) = (tau(&parameters, &mut ws), tau(&sparse, &mut ws));
            assert!(largest_difference(&full, &combined) < 1e-10, "{name}, state {k}");
        }
        // B as a matrix says the same.
        let matrix = base.matrix();
        let product: Vec<f64> =
            matrix.chunks_exact(set.len()).map(|row| dot(row, &parameters)).collect();
        assert!(largest_difference(&product, &values) < 1e-12);
    }
}

/// Smooth motion of all joints at 250 Hz with sums of sines, and its exact derivatives.
struct Motion {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
}

impl Motion {
    fn new(n: usize, samples: usize) -> Self {
        let mut motion = Self { q: vec![], dq: vec![], ddq: vec![] };
        for k in 0..samples {
            let t = k as f64 / 250.0;
            for joint in 0..n {
                let (mut q, mut dq, mut ddq) = (0.0, 0.0, 0.0);
                for h in 1..=4 {
                    let w = 0.7 * h as f64 + 0.13 * joint as f64;
                    let a = 0.6 / h as f64;
                    let phase = 1.7 * (h * (joint + 1)) as f64;
                    q += a * (w * t + phase).sin();
                    dq += a * w * (w * t + phase).cos();
                    ddq -= a * w * w * (w * t + phase).sin();
                }
                motion.q.push(q);
                motion.dq.push(dq);
                motion.ddq.push(ddq);
            }
        }
        motion
    }

    fn samples(&self) -> Samples<'_> {
        Samples { q: &self.q, dq: &self.dq, ddq: &self.ddq }
    }
}

/// The PUMA with friction and rotors, its motion and its torque.
struct Experiment {
    robot: Robot,
    set: ParameterSet,
    base: BaseParameters,
    truth: Vec<f64>,
    motion: Motion,
    tau: Vec<f64>,
}

impl Experiment {
    fn new(samples: usize) -> Self {
        let robot = puma560();
        let n = robot.dof();
        let set = ParameterSet::new(&robot, &ALL).expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let mut truth = robot.standard_parameters();
        truth.extend((0..set.len() - set.inertial()).map(|k| 0.2 + 0.05 * k as f64));
        let motion = Motion::new(n, samples);
        let mut tau = vec![0.0; samples * n];
        rnea_batch(&robot, &mut BatchWorkspace::new(&robot), motion.samples(), &mut tau);
        for (k, tau) in tau.chunks_exact_mut(n).enumerate() {
            let row = k * n..(k + 1) * n;
            let state = JointState {
                q: &motion.q[row.clone()],
                dq: &motion.dq[row.clone()],
                ddq: &motion.ddq[row],
            };
            set.add_effect_torque(&truth, &state, tau);
        }
        Self { robot, set, base, truth, motion, tau }
    }

    /// Every row of W with every base column, and the torque, from the regressor of single samples.
    fn dense(&self, tau: &[f64]) -> (Mat<f64>, Mat<f64>) {
        let n = self.robot.dof();
        let samples = tau.len() / n;
        let mut ws = Workspace::new(&self.robot);
        let mut w = Mat::<f64>::zeros(samples * n, self.base.rank());
        let mut effects = vec![0.0; self.set.effect_columns_per_joint()];
        for k in 0..samples {
            let row = k * n..(k + 1) * n;
            let (q, dq, ddq) =
                (&self.motion.q[row.clone()], &self.motion.dq[row.clone()], &self.motion.ddq[row]);
            let y = regressor(&self.robot, &mut ws, q, dq, ddq).to_vec();
            for joint in 0..n {
                self.set.effect_row(joint, &JointState { q, dq, ddq }, &mut effects);
                let own = self.set.effect_parameters_of(joint);
                for (column, &parameter) in self.base.independent().iter().enumerate() {
                    w[(k * n + joint, column)] = if parameter < self.set.inertial() {
                        y[joint * self.set.inertial() + parameter]
                    } else {
                        own.iter().position(|p| *p == parameter).map_or(0.0, |index| effects[index])
                    };
                }
            }
        }
        (w, Mat::from_fn(samples * n, 1, |row, _| tau[row]))
    }

    fn nominal(&self) -> Vec<f64> {
        vec![0.0; self.base.rank()]
    }
}

#[test]
fn noise_free_data_give_the_parameters_back_filtered_or_not() {
    let experiment = Experiment::new(6000);
    let expected = experiment.base.combine(&experiment.truth);
    let filter = LowPass::butterworth(4, 10.0, 250.0).expect("a valid filter");
    for (label, filtered, method) in [
        ("OLS", false, Method::Ols),
        ("WLS", false, Method::Wls),
        ("OLS, filtered", true, Method::Ols),
        ("WLS, filtered", true, Method::Wls),
        ("known noise", false, Method::WlsKnown(vec![3.0, 1.0, 1.0, 0.1, 0.1, 0.1])),
    ] {
        let mut observation =
            Observation::new(&experiment.robot, &experiment.set, &experiment.base);
        let added = if filtered {
            observation.add_trajectory(
                experiment.motion.samples(),
                &experiment.tau,
                None,
                &filter,
                5,
            )
        } else {
            observation.add_samples(experiment.motion.samples(), &experiment.tau, None)
        };
        added.expect("good data");
        let estimate = LeastSquares::new(method)
            .solve(&observation.factors(), &experiment.base, &experiment.nominal())
            .expect("enough data");
        let error = largest_difference(&estimate.values, &expected);
        assert!(error < 1e-9, "{label}: {error:e}");
        assert!(estimate.excitation.unexcited.is_empty());
        assert!(estimate.excitation.condition > 1.0 && estimate.excitation.condition < 1e4);
    }
}

#[test]
fn weighted_least_squares_agrees_with_dense_algebra() {
    let experiment = Experiment::new(800);
    let (n, unknowns) = (6, experiment.base.rank());
    let mut tau = experiment.tau.clone();
    let mut noise = Noise(3);
    tau.iter_mut().enumerate().for_each(|(k, tau)| *tau += (0.3 + (k % n) as f64) * noise.next());
    let weights = [0.3, 1.3, 2.3, 3.3, 4.3, 5.3];

    let (mut w, mut b) = experiment.dense(&tau);
    for row in 0..w.nrows() {
        let noise = weights[row % n];
        (0..unknowns).for_each(|column| w[(row, column)] /= noise);
        b[(row, 0)] /= noise;
    }
    let expected = w.qr().solve_lstsq(&b);

    let mut observation = Observation::new(&experiment.robot, &experiment.set, &experiment.base);
    observation.add_samples(experiment.motion.samples(), &tau, None).expect("good data");
    let estimate = LeastSquares::new(Method::WlsKnown(weights.to_vec()))
        .solve(&observation.factors(), &experiment.base, &experiment.nominal())
        .expect("enough data");
    for k in 0..unknowns {
        let error = (estimate.values[k] - expected[(k, 0)]).abs();
        assert!(error < 1e-7 * (1.0 + expected[(k, 0)].abs()), "{k}: {error:e}");
    }
    // The residual of each joint, and from it the covariance.
    for joint in 0..n {
        let residual: f64 = (0..800)
            .map(|k| {
                let row = k * n + joint;
                let fit: f64 = (0..unknowns).map(|j| w[(row, j)] * expected[(j, 0)]).sum();
                ((b[(row, 0)] - fit) * weights[joint]).powi(2)
            })
            .sum();
        let freedom = 800.0 * (1.0 - unknowns as f64 / 4800.0);
        assert!((estimate.noise[joint] / (residual / freedom).sqrt() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_factors_of_the_joints_are_those_of_dense_rows() {
    // The rows of a single joint are rank deficient, and the first seconds of a smooth motion
    // nearly so.
    let experiment = Experiment::new(1300);
    let mut observation = Observation::new(&experiment.robot, &experiment.set, &experiment.base);
    observation.add_samples(experiment.motion.samples(), &experiment.tau, None).expect("good data");
    let (w, b) = experiment.dense(&experiment.tau);
    for (joint, found) in observation.factors().iter().enumerate() {
        let k = found.columns.len();
        let entry = |row: usize, column: usize| {
            let row = 6 * row + joint;
            if column < k { w[(row, found.columns[column])] } else { b[(row, 0)] }
        };
        let dense = Mat::from_fn(1300, k + 1, entry);
        let (expected, gram) =
            (dense.transpose() * &dense, found.factor.transpose() * found.factor.as_ref());
        for i in 0..=k {
            for j in 0..=k {
                let error = (gram[(i, j)] - expected[(i, j)]).abs()
                    / (expected[(i, i)] * expected[(j, j)]).sqrt();
                assert!(error < 1e-10, "joint {joint}, entry {i} {j}: {error:e}");
            }
        }
    }
}

#[test]
fn standard_deviations_are_those_of_repeated_experiments() {
    let experiment = Experiment::new(1500);
    let n = 6;
    let truth = experiment.base.combine(&experiment.truth);
    let level = [2.0, 3.0, 1.0, 0.1, 0.1, 0.05];
    let trials = 60;
    for method in [Method::Ols, Method::Wls] {
        let mut normalised = 0.0;
        for trial in 0..trials {
            let mut noise = Noise(100 + trial);
            let mut tau = experiment.tau.clone();
            tau.iter_mut().enumerate().for_each(|(k, tau)| *tau += level[k % n] * noise.next());
            let mut observation =
                Observation::new(&experiment.robot, &experiment.set, &experiment.base);
            observation.add_samples(experiment.motion.samples(), &tau, None).expect("good data");
            let estimate = LeastSquares::new(method.clone())
                .solve(&observation.factors(), &experiment.base, &experiment.nominal())
                .expect("enough data");
            let deviation = estimate.standard_deviations();
            for k in 0..truth.len() {
                normalised += ((estimate.values[k] - truth[k]) / deviation[k]).powi(2);
            }
            // Under OLS what the noisy joints do to the parameters shows in the residual of the
            // quiet ones.
            for joint in (0..n).filter(|_| method == Method::Wls) {
                assert!((estimate.noise[joint] / level[joint] - 1.0).abs() < 0.1, "joint {joint}");
            }
        }
        // Mean square of the errors in units of their standard deviation: one, within the noise of
        // 60 experiments.
        let mean = normalised / (trials as f64 * truth.len() as f64);
        assert!((mean - 1.0).abs() < 0.1, "{method:?}: {mean}");
    }
}

#[test]
fn filtering_in_pieces_is_filtering_the_whole() {
    // Long enough that a trajectory is cut (the width of the PUMA's rows is some 200 numbers).
    let experiment = Experiment::new(120_000);
    let filter = LowPass::butterworth(4, 6.0, 250.0).expect("a valid filter");
    let mut observation = Observation::new(&experiment.robot, &experiment.set, &experiment.base);
    observation
        .add_trajectory(experiment.motion.samples(), &experiment.tau, None, &filter, 4)
        .expect("good data");
    let factors = observation.factors();
    // The torque column of the factor holds the sum of squares of the filtered torque.
    for (joint, factor) in factors.iter().enumerate() {
        let mut tau: Vec<f64> = experiment.tau.iter().skip(joint).step_by(6).copied().collect();
        filter.apply(&mut tau, 1).expect("long enough");
        let expected: f64 = tau.iter().step_by(4).map(|tau| tau * tau).sum();
        let last = factor.factor.ncols() - 1;
        let found = factor.factor.col(last).norm_l2().powi(2);
        assert_eq!(factor.rows, 30_000);
        assert!((found / expected - 1.0).abs() < 1e-12, "joint {joint}");
    }
}

#[test]
fn motion_that_excites_too_little_is_named_and_leaves_nominal_values() {
    let experiment = Experiment::new(2000);
    let mut motion = Motion::new(6, 2000);
    // The last joint never moves.
    for values in [&mut motion.dq, &mut motion.ddq, &mut motion.q] {
        values.iter_mut().skip(5).step_by(6).for_each(|value| *value = 0.0);
    }
    let mut tau = vec![0.0; 2000 * 6];
    rnea_batch(
        &experiment.robot,
        &mut BatchWorkspace::new(&experiment.robot),
        motion.samples(),
        &mut tau,
    );
    let mut observation = Observation::new(&experiment.robot, &experiment.set, &experiment.base);
    observation.add_samples(motion.samples(), &tau, None).expect("good data");
    let nominal: Vec<f64> = (0..experiment.base.rank()).map(|k| 0.01 * k as f64).collect();
    let estimate = LeastSquares::new(Method::Wls)
        .solve(&observation.factors(), &experiment.base, &nominal)
        .expect("enough data");
    let index = |name: &str| {
        experiment.base.names().iter().position(|other| other == name).expect("a base parameter")
    };
    let named: Vec<usize> =
        estimate.excitation.unexcited.iter().flat_map(|d| d.shares.iter().map(|s| s.0)).collect();
    for name in ["joint_6.Fv", "joint_6.Fc"] {
        assert!(named.contains(&index(name)), "{name} is not excited");
        assert_eq!(estimate.values[index(name)], nominal[index(name)]);
        assert!(estimate.standard_deviations()[index(name)].is_infinite());
    }
    assert!(!named.contains(&index("joint_2.Fv")));
    assert!(estimate.excitation.condition > 1e12);
}

#[test]
fn bad_data_are_refused_with_the_place() {
    let experiment = Experiment::new(300);
    let mut observation = Observation::new(&experiment.robot, &experiment.set, &experiment.base);
    let mut tau = experiment.tau.clone();
    tau[6 * 17 + 2] = f64::NAN;
    let error = observation.add_samples(experiment.motion.samples(), &tau, None).expect_err("NaN");
    assert_eq!(
        error.to_string(),
        "sample 17: torque of joint 2 is NaN; find and repair such samples first"
    );

    let solve = |observation: &Observation, method| {
        let factors = observation.factors();
        LeastSquares::new(method).solve(&factors, &experiment.base, &experiment.nominal())
    };
    let message = solve(&observation, Method::Wls).expect_err("nothing was added").to_string();
    assert!(message.contains("no usable sample"), "{message}");
    let few = Samples {
        q: &experiment.motion.q[..30],
        dq: &experiment.motion.dq[..30],
        ddq: &experiment.motion.ddq[..30],
    };
    observation.add_samples(few, &experiment.tau[..30], None).expect("good data");
    let message = solve(&observation, Method::Ols).expect_err("30 rows").to_string();
    assert!(message.contains("30 rows for 58 parameters"), "{message}");
    observation.add_samples(experiment.motion.samples(), &experiment.tau, None).expect("good data");
    let message = solve(&observation, Method::WlsKnown(vec![1.0, 0.0, 1.0, 1.0, 1.0, 1.0]))
        .expect_err("zero")
        .to_string();
    assert!(message.contains("joint 2 is given as 0"), "{message}");
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Gaussian noise from a linear congruential generator (Knuth) by Box and Muller.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
    }
}

#[test]
fn rounded_angles_of_a_robot_file_do_not_show_in_the_expressions() {
    // The angles of this file are rounded to nine digits.
    let robot =
        Robot::from_urdf(common::data("demo/robot.urdf"), &Default::default()).expect("bundled");
    let set = ParameterSet::new(&robot, &["viscous_friction", "rotor_inertia"])
        .expect("effects of the library");
    let base = BaseParameters::new(&robot, &set);
    let friction = base.names().iter().position(|name| name == "joint_3.Fv").expect("identifiable");
    assert_eq!(base.expression(friction), "joint_3.Fv");
    let parameter = set.names().iter().position(|name| name == "joint_3.Fv").expect("in the set");
    assert_eq!(base.classes()[parameter], ParameterClass::Alone);
}

#[test]
fn the_recursion_without_data_finds_the_subspace_of_random_motion() {
    for name in ROBOTS {
        for (path, robot) in Reference::load(name).robots() {
            for effects in [&[][..], &ALL[..]] {
                let set = ParameterSet::new(&robot, effects).expect("known effects");
                let (exact, random) =
                    (BaseParameters::by_recursion(&robot, &set), BaseParameters::new(&robot, &set));
                assert_eq!(exact.independent(), random.independent(), "{name} by {path}");
                let difference = largest_difference(&exact.matrix(), &random.matrix());
                assert!(difference < 1e-8, "{name} by {path}: {difference:e}");
            }
        }
    }
}

#[test]
fn the_recursion_counts_as_the_thesis_does() {
    let rank = |robot: &Robot| {
        let set = ParameterSet::new(robot, &[] as &[&str]).expect("no effects");
        BaseParameters::by_recursion(robot, &set).rank()
    };
    assert_eq!(rank(&puma560()), 36);
    let arm = two_link();
    assert_eq!(rank(&arm), 6);
    assert_eq!(rank(&arm.with_gravity(Vector3::ZERO)), 4);
}

#[test]
fn equations_whose_squares_overflow_are_refused_with_their_place() {
    let robot = two_link();
    let effects: [&str; 0] = [];
    let set = ParameterSet::new(&robot, &effects).expect("no effect is unknown");
    let base = BaseParameters::new(&robot, &set);
    let [q, dq, ddq] = [0.3, 0.7, 1.1]
        .map(|size| (0..40).map(|k| size * f64::from(k).sin()).collect::<Vec<f64>>());
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let mut tau = vec![1.0; 40];
    tau[15] = 1e160;
    let mut observation = Observation::new(&robot, &set, &base);
    let error =
        observation.add(&Trajectory::new(samples, &tau)).expect_err("its square is infinite");
    assert_eq!(error, IdentificationError::TooLarge { sample: 7, joint: 1, value: 1e160 });
    assert!(error.to_string().contains("1e160"), "{error}");
}
