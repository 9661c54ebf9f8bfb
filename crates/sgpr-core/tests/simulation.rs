//! The simulator against other integrators, against energy, and against what dry friction is.
#![allow(missing_docs)]

mod common;

use common::{ROBOTS, Reference as ReferenceValues, data, largest_difference};
use sgpr_core::dynamics::{Workspace, gravity_torque, kinetic_energy, potential_energy};
use sgpr_core::effects::{Site, by_name, sgn};
use sgpr_core::identification::ParameterSet;
use sgpr_core::model::{Term, TorqueModel, Trajectory};
use sgpr_core::robot::{Robot, puma560, two_link};
use sgpr_core::simulation::*;
use sgpr_core::spatial::Vector3;

fn arm(robot: &Robot, drives: &[Drive], integrator: Integrator, step: f64) -> Simulator {
    Simulator::new(robot, drives, integrator, step).expect("valid drives")
}

fn without_drives(robot: &Robot) -> Vec<Drive> {
    vec![Drive::default(); robot.dof()]
}

/// PUMA with viscous and direction-dependent Coulomb friction, Stribeck and stiction.
fn puma_with_all_friction() -> Vec<Drive> {
    puma560_drives().into_iter().map(|drive| drive.with_stiction(1.5, 0.05)).collect()
}

const BOTH: [Integrator; 2] = [Integrator::SemiImplicitEuler, Integrator::RungeKutta4];

/// Where a motion ends after `time` without torque.
fn free_motion(
    robot: &Robot,
    start: (&[f64], &[f64]),
    integrator: Integrator,
    step: f64,
    time: f64,
) -> Vec<f64> {
    let mut simulator = arm(robot, &without_drives(robot), integrator, step).with_speed_limit(1e4);
    simulator.set_state(start.0, start.1).expect("finite");
    let tau = vec![0.0; robot.dof()];
    for _ in 0..(time / step).round() as usize {
        simulator.step(&tau).expect("stable");
    }
    simulator.q().to_vec()
}

#[test]
fn free_motion_agrees_with_an_adaptive_integrator() {
    for name in ROBOTS {
        let reference = ReferenceValues::load(name);
        for (path, robot) in reference.robots() {
            let n = robot.dof();
            let (q, dq) = (reference.array("free_q"), reference.array("free_dq"));
            let start = (&q[..n], &dq[..n]);
            let expected = &q[25 * n..];
            // Fourth order: the fastest wrist turns a hundred radians per second.
            let found = free_motion(&robot, start, Integrator::RungeKutta4, 5e-5, 0.5);
            let error = largest_difference(&found, expected);
            assert!(error < 2e-8, "{name} from {path}: {error:e}");
            // First order: half the step, half the error.
            let coarse = free_motion(&robot, start, Integrator::SemiImplicitEuler, 2e-5, 0.5);
            let fine = free_motion(&robot, start, Integrator::SemiImplicitEuler, 1e-5, 0.5);
            let (coarse, fine) =
                (largest_difference(&coarse, expected), largest_difference(&fine, expected));
            assert!(
                (1.6..2.6).contains(&(coarse / fine)),
                "{name} from {path}: {coarse:e} {fine:e}"
            );
        }
    }
}

#[test]
fn energy_is_conserved_without_friction() {
    for robot in [
        two_link(),
        ReferenceValues::load("ur5e_like").by_urdf(),
        ReferenceValues::load("scara").by_urdf(),
    ] {
        // A prismatic joint would fall for ever: only two seconds.
        let mut simulator = arm(&robot, &without_drives(&robot), Integrator::RungeKutta4, 1e-4);
        let n = robot.dof();
        let mut ws = Workspace::new(&robot);
        let mut energy = |simulator: &Simulator| {
            let kinetic = kinetic_energy(&robot, &mut ws, simulator.q(), simulator.dq());
            (kinetic + potential_energy(&robot, &mut ws, simulator.q()), kinetic)
        };
        simulator.set_state(&vec![0.4; n], &vec![0.3; n]).expect("finite");
        let (start, mut largest) = (energy(&simulator).0, 0.0f64);
        for _ in 0..20_000 {
            simulator.step(&vec![0.0; n]).expect("stable");
            largest = largest.max(energy(&simulator).1);
        }
        let drift = (energy(&simulator).0 - start).abs() / largest;
        assert!(drift < 1e-9, "{}: {drift:e}", robot.name());
    }
}

#[test]
fn a_driven_motion_agrees_with_mujoco() {
    let text =
        std::fs::read_to_string(data("reference/puma560_driven.json")).expect("bundled file");
    let reference: serde_json::Value = serde_json::from_str(&text).expect("valid JSON");
    let rows: Vec<Vec<f64>> = serde_json::from_value(reference["motion"].clone()).expect("rows");
    let robot = ReferenceValues::load("puma560").by_dh().expect("a DH robot");
    // MuJoCo has rotors and viscous friction, but no Coulomb friction here: its own is softened.
    let drives: Vec<Drive> = puma560_drives()
        .into_iter()
        .map(|drive| drive.with_coulomb_friction([0.0; 2]).with_static_friction([0.0; 2]))
        .collect();
    let mut simulator = arm(&robot, &drives, Integrator::RungeKutta4, 1e-4);
    simulator.set_state(&rows[0][..6], &rows[0][6..]).expect("finite");
    let amplitude = [30.0, 60.0, 25.0, 3.0, 2.0, 1.0];
    for step in 0..10_000 {
        if step % 500 == 0 {
            let row = &rows[step / 500];
            let error = largest_difference(simulator.q(), &row[..6]);
            let speed_error = largest_difference(simulator.dq(), &row[6..]);
            // Both are Runge-Kutta schemes with the torque held over the same steps.
            assert!(error < 1e-9 && speed_error < 1e-8, "step {step}: {error:e} {speed_error:e}");
        }
        let tau: Vec<f64> =
            (0..6).map(|i| amplitude[i] * ((i + 1) as f64 * step as f64 * 1e-4).sin()).collect();
        simulator.step(&tau).expect("stable");
    }
}

#[test]
fn friction_holds_the_arm_where_it_is_for_ever() {
    let robot = puma560();
    for integrator in BOTH {
        let mut simulator = arm(&robot, &puma_with_all_friction(), integrator, 1e-3);
        let q = [0.2, -1.1, 0.3, 0.5, -0.7, 0.1];
        simulator.set_state(&q, &[0.0; 6]).expect("finite");
        // Gravity compensated to 80 % of what friction would hold.
        let mut tau = gravity_torque(&robot, &mut Workspace::new(&robot), &q).to_vec();
        for (tau, drive) in tau.iter_mut().zip(puma_with_all_friction()) {
            *tau += 0.8 * drive.static_friction[0];
        }
        for _ in 0..10_000 {
            simulator.step(&tau).expect("stable");
        }
        assert_eq!(simulator.q(), q, "{integrator:?}: not a bit of creep");
        assert!(simulator.dq().iter().all(|v| *v == 0.0));
    }
}

#[test]
fn a_joint_breaks_away_at_its_static_friction_in_either_direction() {
    // Gravity along the axes: only friction is there.
    let robot = two_link().with_gravity(Vector3::new(0.0, 0.0, -9.81));
    let drive = Drive::default()
        .with_rotor_inertia(0.1)
        .with_viscous_friction(1.0)
        .with_coulomb_friction([2.0, 1.0])
        .with_static_friction([3.0, 1.6])
        .with_stribeck_velocity(0.02);
    for integrator in BOTH {
        for (push, moves) in [(2.99, false), (3.01, true), (-1.59, false), (-1.61, true)] {
            let mut simulator = arm(&robot, &[drive; 2], integrator, 1e-3);
            for _ in 0..200 {
                simulator.step(&[push, 0.0]).expect("stable");
            }
            assert_eq!(simulator.dq()[0] != 0.0, moves, "{integrator:?} {push}");
            // Once broken away, the friction is lower: it ends well above what a static balance
            // would leave.
            assert!(!moves || sgn(simulator.dq()[0]) == sgn(push));
        }
    }
}

#[test]
fn sliding_comes_to_rest_where_the_energy_is_used_up() {
    // A flywheel with Coulomb friction alone: it stops after I v² / (2 Fc).
    let robot =
        two_link().with_gravity(Vector3::new(0.0, 0.0, -9.81)).with_standard_parameters(&[0.0; 20]);
    let drive = Drive::default()
        .with_rotor_inertia(0.5)
        .with_coulomb_friction([2.0, 1.0])
        .with_static_friction([2.0, 1.0]);
    for (integrator, tolerance) in
        [(Integrator::SemiImplicitEuler, 2e-3), (Integrator::RungeKutta4, 1e-6)]
    {
        for (speed, friction) in [(1.5f64, 2.0), (-1.5, -1.0)] {
            let mut simulator = arm(&robot, &[drive; 2], integrator, 1e-3);
            simulator.set_state(&[0.0; 2], &[speed, 0.0]).expect("finite");
            for _ in 0..2000 {
                simulator.step(&[0.0; 2]).expect("stable");
            }
            let expected = 0.5 * speed * speed / (2.0 * friction);
            assert_eq!(simulator.dq()[0], 0.0);
            assert!(
                (simulator.q()[0] - expected).abs() < tolerance,
                "{integrator:?}: {}",
                simulator.q()[0] - expected
            );
        }
    }
}

#[test]
fn friction_far_stiffer_than_the_step_is_stable() {
    let robot = puma560();
    let drives: Vec<Drive> = puma_with_all_friction()
        .into_iter()
        .map(|drive| drive.with_viscous_friction(1e6))
        .collect();
    let mut simulator = arm(&robot, &drives, Integrator::SemiImplicitEuler, 1e-3);
    simulator.set_state(&[0.3; 6], &[2.0; 6]).expect("finite");
    for _ in 0..1000 {
        simulator.step(&[100.0; 6]).expect("stable");
    }
    assert!(simulator.dq().iter().all(|v| v.abs() < 1e-3), "{:?}", simulator.dq());
}

/// A sine per joint from rest, faded in.
struct Sines(usize);

impl Reference for Sines {
    fn dof(&self) -> usize {
        self.0
    }

    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        for joint in 0..self.0 {
            let w = 1.0 + 0.7 * joint as f64;
            let (sin, cos) = (w * time).sin_cos();
            q[joint] = 0.4 * (1.0 - cos);
            dq[joint] = 0.4 * w * sin;
            ddq[joint] = 0.4 * w * w * cos;
        }
    }
}

fn follow(
    integrator: Integrator,
    step: f64,
    controller: &mut dyn Controller,
    experiment: &Experiment,
) -> SimulationRecord {
    follow_with(&puma_with_all_friction(), integrator, step, controller, experiment)
}

fn follow_with(
    drives: &[Drive],
    integrator: Integrator,
    step: f64,
    controller: &mut dyn Controller,
    experiment: &Experiment,
) -> SimulationRecord {
    let mut simulator = arm(&puma560(), drives, integrator, step);
    simulate(&mut simulator, controller, &Sines(6), 2.0, experiment, &()).expect("stable")
}

fn feed_forward() -> FeedForward<RigidBody> {
    FeedForward::new(RigidBody::new(&puma560()), Gains::uniform(6, 500.0, 30.0))
}

#[test]
fn both_integrators_come_together_with_all_friction_on() {
    let experiment = Experiment::default();
    let truth = follow(Integrator::RungeKutta4, 1e-3 / 64.0, &mut feed_forward(), &experiment);
    let mut errors = Vec::new();
    for step in [1e-3, 2.5e-4, 6.25e-5] {
        let run = follow(Integrator::SemiImplicitEuler, step, &mut feed_forward(), &experiment);
        errors.push(largest_difference(&run.q, &truth.q));
    }
    assert!(
        errors[0] < 2e-3 && errors[1] < errors[0] / 2.0 && errors[2] < errors[1] / 2.0,
        "{errors:?}"
    );
}

#[test]
fn every_controller_follows_with_a_true_model() {
    let robot = puma560();
    // Without dry friction, which computed torque at a measured velocity of zero cannot compensate.
    let drives: Vec<Drive> = puma560_drives()
        .into_iter()
        .map(|drive| drive.with_coulomb_friction([0.0; 2]).with_static_friction([0.0; 2]))
        .collect();
    let model = || {
        let mut body = RigidBody::new(&robot);
        let drives = drives.clone();
        move |q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]| {
            body.add_torque(q, dq, ddq, tau);
            for (joint, drive) in drives.iter().enumerate() {
                tau[joint] += drive.rotor_inertia * ddq[joint] + drive.friction(dq[joint]);
            }
        }
    };
    let gains = Gains::uniform(6, 200.0, 20.0);
    let experiment = Experiment::default();
    let worst = |record: SimulationRecord| record.tracking_rmse().into_iter().fold(0.0, f64::max);
    let run = |controller: &mut dyn Controller| {
        worst(follow_with(&drives, Integrator::SemiImplicitEuler, 2.5e-4, controller, &experiment))
    };
    let forward = run(&mut FeedForward::new(model(), gains.clone()));
    let impedance = run(&mut JointImpedance::new(model(), gains.clone()));
    let computed = run(&mut ComputedTorque::new(model(), Gains::uniform(6, 400.0, 40.0)));
    let feedback = run(&mut Pd(gains));
    // What is left is the torque held over a millisecond.
    assert!(
        forward < 2e-3 && impedance < 2e-3 && computed < 2e-3,
        "{forward} {impedance} {computed}"
    );
    assert!(feedback > 20.0 * forward, "{feedback} without a model");
}

#[test]
fn a_soft_impedance_moves_joints_that_stand() {
    let robot = puma560();
    let drives = puma560_drives();
    let known = drives.clone();
    let mut body = RigidBody::new(&robot);
    let model = move |q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]| {
        body.add_torque(q, dq, ddq, tau);
        for (joint, drive) in known.iter().enumerate() {
            tau[joint] += drive.rotor_inertia * ddq[joint] + drive.friction(dq[joint]);
        }
    };
    // The spring alone would need an error of Fc / K, 2.5 rad at the first joint, before anything
    // moves.
    let mut soft = JointImpedance::new(model, Gains::uniform(6, 10.0, 2.0));
    let experiment = Experiment::default();
    let record =
        follow_with(&drives, Integrator::SemiImplicitEuler, 2.5e-4, &mut soft, &experiment);
    let errors = record.tracking_rmse();
    assert!(errors.iter().all(|error| *error < 0.05), "{errors:?}");
}

#[test]
fn noise_and_quantisation_are_what_was_asked_for_and_repeat_to_the_bit() {
    let experiment = Experiment::default()
        .with_sensors(
            Sensors::default()
                .with_position_resolution(vec![1e-4; 6])
                .with_torque_noise(vec![0.5; 6])
                .with_actuation_noise(vec![0.1; 6])
                .with_velocity(VelocitySensor::Difference),
        )
        .with_delay(1.5e-3)
        .with_seed(7);
    let run = |experiment: &Experiment| {
        follow(Integrator::SemiImplicitEuler, 2.5e-4, &mut feed_forward(), experiment)
    };
    let record = run(&experiment);
    assert_eq!(record, run(&experiment), "same inputs, same bits");
    assert_ne!(record, run(&experiment.with_seed(8)));
    for (measured, q) in record.q_measured.iter().zip(&record.q) {
        assert!((measured - q).abs() < 0.5e-4 + 1e-12);
        assert!((measured / 1e-4 - (measured / 1e-4).round()).abs() < 1e-6);
    }
    let squares: f64 =
        record.tau_measured.iter().zip(&record.tau).map(|(a, b)| (a - b) * (a - b)).sum();
    let deviation = (squares / record.tau.len() as f64).sqrt();
    assert!((deviation - 0.5).abs() < 0.02, "{deviation}");
}

/// Gives the time as torque.
struct Clock;

impl Controller for Clock {
    fn torque(&mut self, measured: &Measurement<'_>, _: &Setpoint<'_>, tau: &mut [f64]) {
        tau.fill(1.0 + measured.time);
    }
}

#[test]
fn a_delay_is_a_delay() {
    let robot = two_link();
    for (delay, whole) in [(0.0, 0.0), (1e-3, 1e-3), (5e-3, 5e-3), (2.5e-3, 3e-3)] {
        let mut simulator = arm(&robot, &two_link_drives(), Integrator::default(), 2.5e-4);
        let experiment = Experiment::default().with_delay(delay);
        let record = simulate(&mut simulator, &mut Clock, &Sines(2), 0.05, &experiment, &())
            .expect("stable");
        for (time, tau) in record.time.iter().zip(record.tau.chunks_exact(2)) {
            // At a control sample the torque of `whole` ago acts; in between, that of the sample
            // before.
            let expected = 1.0 + (*time as f64 * 1e-9 - whole).max(0.0);
            assert!(
                (tau[0] - expected).abs() < 1e-12,
                "delay {delay} at {time}: {} {expected}",
                tau[0]
            );
        }
    }
}

#[test]
fn an_experiment_goes_on_after_something_was_picked_up() {
    let robot = two_link();
    let mut parameters = robot.standard_parameters();
    // A kilogram at the tip, the origin of the last link frame.
    parameters[10] += 1.0;
    let loaded = robot.clone().with_standard_parameters(&parameters);
    let mut simulator = arm(&robot, &two_link_drives(), Integrator::default(), 2.5e-4);
    let mut controller = FeedForward::new(RigidBody::new(&robot), Gains::uniform(2, 300.0, 20.0));
    let experiment = Experiment::default();
    let mut run = |simulator: &mut Simulator| {
        simulate(simulator, &mut controller, &Sines(2), 1.0, &experiment, &()).expect("stable")
    };
    let before = run(&mut simulator);
    simulator.set_robot(&loaded);
    let after = run(&mut simulator);
    assert_eq!(after.time[0], 1_000_000_000);
    assert!(largest_difference(&before.q[before.q.len() - 2..], &after.q[..2]) < 5e-3, "no jump");
    assert!(after.tracking_rmse()[0] > 3.0 * before.tracking_rmse()[0], "the load is felt");
}

#[test]
fn effects_of_the_library_become_drives_and_side_torques() {
    let robot = two_link();
    let names = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
    let set = ParameterSet::new(&robot, &names).expect("known effects");
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..set.len() - set.inertial()).map(|k| 0.1 + 0.05 * k as f64));
    let (drives, side) = drives_from_parameters(&set, &parameters);
    let mut simulator = arm(&robot, &drives, Integrator::RungeKutta4, 1e-4);
    simulator = simulator.with_side_torque(side.expect("an offset is no drive"));
    simulator.set_state(&[0.1, 0.2], &[0.5, -0.4]).expect("finite");
    simulator.step(&[20.0, 5.0]).expect("stable");
    // The torque of that motion by the model itself.
    let mut predictor = sgpr_core::model::Predictor::new(
        &sgpr_core::model::TorqueModel::with_parameters(&robot, &names, parameters)
            .expect("known effects"),
    );
    let tau = predictor.torque(&[0.1, 0.2], &[0.5, -0.4], simulator.ddq());
    assert!(largest_difference(tau, &[20.0, 5.0]) < 1e-12, "{tau:?}");
}

#[test]
fn effects_at_single_joints_act_or_are_refused() {
    let robot = two_link();
    let names = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend([0.8, 0.6, 1.0, 0.9, 0.3, 0.2]);
    let model = TorqueModel::with_parameters(&robot, &names, parameters).expect("known effects");
    let term = |name: &str, site: Site, coefficients: &[f64]| {
        let effect = by_name(name).expect("of the library");
        let constants = effect.constants().iter().map(|constant| constant.grid[0]).collect();
        let mut term = Term::new(effect, site, constants);
        assert_eq!(term.coefficients.len(), coefficients.len(), "{name}");
        term.coefficients = coefficients.to_vec();
        term
    };
    let with = |terms: Vec<Term>| model.clone().with_terms(terms, Some(0));
    let known = with(vec![
        term("stribeck_friction", Site::Joint(0), &[0.7]),
        term("nonlinear_viscous_friction", Site::Joint(1), &[0.4]),
        term("load_dependent_friction", Site::Joint(1), &[0.02]),
    ]);
    let (drives, side) = drives_from_model(&known).expect("of motion and time alone");
    assert_eq!(drives[0].static_friction, [1.7; 2]);
    let mut simulator = arm(&robot, &drives, Integrator::RungeKutta4, 1e-4);
    simulator = side.into_iter().fold(simulator, Simulator::with_side_torque);
    simulator.set_state(&[0.1, 0.2], &[0.03, -0.4]).expect("finite");
    // Twice, so that the load is that of the acceleration.
    for _ in 0..2 {
        let (q, dq) = (simulator.q().to_vec(), simulator.dq().to_vec());
        simulator.step(&[20.0, 5.0]).expect("stable");
        let samples = sgpr_core::dynamics::Samples { q: &q, dq: &dq, ddq: simulator.ddq() };
        let tau = known.predict(samples);
        let plain = with(vec![]).predict(samples);
        assert!(
            largest_difference(&tau, &[20.0, 5.0]) < 0.1 * largest_difference(&plain, &[20.0, 5.0]),
            "{tau:?} {plain:?}"
        );
    }
    for (name, site, coefficients, reason) in [
        ("transmission_hysteresis", Site::Joint(0), &[1.0][..], "hidden state"),
        ("encoder_offset", Site::Joint(0), &[], "changes robot, motion or torque"),
        (
            "payload",
            Site::Arm,
            &[50.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 9.0],
            "as an inertia does",
        ),
    ] {
        let refused = drives_from_model(&with(vec![term(name, site, coefficients)]))
            .expect_err("cannot be followed");
        assert!(
            refused.to_string().contains(name) && refused.to_string().contains(reason),
            "{refused}"
        );
    }
}

#[test]
fn effects_with_a_loop_over_the_position_keep_their_state() {
    let robot = two_link();
    let model = TorqueModel::with_parameters(&robot, &[] as &[&str], robot.standard_parameters())
        .expect("valid");
    let of_joint = |name: &str, joint: usize, distance: f64| {
        let mut term =
            Term::new(by_name(name).expect("of the library"), Site::Joint(joint), vec![distance]);
        term.coefficients = vec![2.0];
        term
    };
    let terms =
        vec![of_joint("presliding_friction", 0, 0.01), of_joint("cable_hysteresis", 1, 0.2)];
    let known = model.clone().with_terms(terms, Some(0));
    let (drives, side) = drives_from_model(&known).expect("loops over the position");
    let mut simulator = arm(&robot, &drives, Integrator::SemiImplicitEuler, 1e-4);
    simulator = side.into_iter().fold(simulator, Simulator::with_side_torque);
    let (mut q, mut dq, mut ddq, mut time, mut applied) = (vec![], vec![], vec![], vec![], vec![]);
    for k in 0..30_000 {
        let t = 1e-4 * f64::from(k);
        let tau = [8.0 * (5.0 * t).sin(), 5.0 * (7.0 * t).cos()];
        q.extend_from_slice(simulator.q());
        dq.extend_from_slice(simulator.dq());
        time.push(t);
        simulator.step(&tau).expect("stable");
        ddq.extend_from_slice(simulator.ddq());
        applied.extend(tau);
    }
    let samples = sgpr_core::dynamics::Samples { q: &q, dq: &dq, ddq: &ddq };
    let trajectory = Trajectory::of_samples(samples).with_rate_hz(1e4).with_time(&time);
    let missed =
        |model: &TorqueModel| largest_difference(&model.predict_trajectory(&trajectory), &applied);
    let reverses =
        dq.chunks_exact(2).zip(dq[2..].chunks_exact(2)).filter(|(a, b)| a[0] * b[0] < 0.0).count();
    assert!(reverses > 3, "{reverses}");
    assert!(missed(&model) > 1.9 && missed(&known) < 0.02, "{} {}", missed(&model), missed(&known));
}

#[test]
fn bad_input_is_refused_with_names() {
    let robot = puma560();
    let drives = puma560_drives();
    let run = |controller: &mut dyn Controller, experiment: &Experiment| {
        let mut simulator = arm(&robot, &drives, Integrator::default(), 1e-3);
        let error =
            simulate(&mut simulator, controller, &Sines(6), 1.0, experiment, &()).expect_err("bad");
        (error.to_string(), error)
    };
    let experiment = Experiment::default();
    // Gains far beyond what sampling allows.
    let (message, error) = run(&mut Pd(Gains::uniform(6, 1e7, 1e5)), &experiment);
    assert!(
        matches!(error, SimulationError::Unstable { .. }) && message.contains("joint `joint_"),
        "{message}"
    );
    struct Broken;
    impl Controller for Broken {
        fn torque(&mut self, measured: &Measurement<'_>, _: &Setpoint<'_>, tau: &mut [f64]) {
            tau.fill(0.0);
            if measured.time > 0.1 {
                tau[2] = f64::NAN;
            }
        }
    }
    let (message, _) = run(&mut Broken, &experiment);
    assert_eq!(
        message,
        "the controller gives NaN for joint `joint_3` at 0.101000 s: a torque is a finite number"
    );
    let (message, _) = run(&mut Broken, &experiment.clone().with_control_period(1.3e-3));
    assert!(message.starts_with("control_period is 0.0013: a whole number of steps"), "{message}");
    let limits = Some(vec![1.0; 3]);
    let (message, _) = run(&mut Broken, &experiment.with_torque_limits(limits));
    assert_eq!(message, "torque limits: got 3 values for 6 joints: give one for each");

    let message = |drives: &[Drive]| {
        Simulator::new(&robot, drives, Integrator::default(), 1e-3).expect_err("bad").to_string()
    };
    assert!(message(&drives[..2]).starts_with("drives: got 2 values for 6 joints"));
    let mut negative = drives.clone();
    negative[4].viscous_friction = -1.0;
    assert!(message(&negative).contains("the viscous friction of joint `joint_5` is -1"));

    // A joint that moves nothing.
    let massless = two_link().with_standard_parameters(&[0.0; 20]);
    let error =
        arm(&massless, &without_drives(&massless), Integrator::default(), 1e-3).step(&[1.0; 2]);
    assert!(matches!(error, Err(SimulationError::NoInertia { .. })));
}

#[test]
fn a_run_stops_when_asked() {
    use sgpr_core::progress::{Interrupted, Progress};
    struct Stop;
    impl Progress for Stop {
        fn step(&self, _: &'static str, done: usize, _: usize) -> Result<(), Interrupted> {
            if done > 2000 { Err(Interrupted) } else { Ok(()) }
        }
    }
    let mut simulator = arm(&puma560(), &puma560_drives(), Integrator::default(), 2.5e-4);
    let error = simulate(
        &mut simulator,
        &mut feed_forward(),
        &Sines(6),
        5.0,
        &Experiment::default(),
        &Stop,
    );
    assert_eq!(error, Err(SimulationError::Interrupted(Interrupted)));
}
