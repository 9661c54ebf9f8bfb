//! Dynamics against values that three independent codes agree on.
#![allow(missing_docs)]

mod common;

use common::{ROBOTS, Reference, largest_difference};
use sgpr_core::dynamics::{
    BatchWorkspace, Samples, Workspace, bias_forces, forward_dynamics,
    forward_dynamics_with_rotors, frame_pose, gravity_torque, jacobian, kinetic_energy,
    mass_matrix, potential_energy, regressor, regressor_batch, rnea, rnea_batch,
};
use sgpr_core::robot::{DhConvention, Robot};
use sgpr_core::spatial::LinkInertia;

/// Relative to the largest torque of the robot, as the issue asks.
const TOLERANCE: f64 = 1e-12;

/// Calls `check(label, reference, robot)` for every reference robot, by every path.
fn for_each_robot(check: impl Fn(&str, &Reference, &Robot)) {
    for name in ROBOTS {
        let reference = Reference::load(name);
        for (path, robot) in reference.robots() {
            check(&format!("{name} from {path}"), &reference, &robot);
        }
    }
}

fn states(
    reference: &Reference,
    n: usize,
) -> impl Iterator<Item = (usize, &[f64], &[f64], &[f64])> {
    let rows = |key| reference.array(key).chunks_exact(n);
    rows("q")
        .zip(rows("dq"))
        .zip(rows("ddq"))
        .enumerate()
        .map(|(k, ((q, dq), ddq))| (k, q, dq, ddq))
}

#[test]
fn inverse_dynamics_agrees() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let tolerance = TOLERANCE * reference.max_abs_tau();
        for (k, q, dq, ddq) in states(reference, n) {
            let expected = |key| &reference.array(key)[k * n..(k + 1) * n];
            let check = |what: &str, tau: &[f64], expected: &[f64]| {
                let error = largest_difference(tau, expected);
                assert!(error < tolerance, "{label}, state {k}: {what} is off by {error:e}");
            };
            check("tau", rnea(robot, &mut ws, q, dq, ddq), expected("tau"));
            check("bias", bias_forces(robot, &mut ws, q, dq), expected("bias"));
            check("gravity", gravity_torque(robot, &mut ws, q), expected("gravity_torque"));
        }
    });
}

#[test]
fn mass_matrix_agrees() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let expected = reference.array("mass_matrix");
        let largest = expected.iter().fold(0.0f64, |largest, m| largest.max(m.abs()));
        for (k, q, ..) in states(reference, n) {
            let error = largest_difference(
                mass_matrix(robot, &mut ws, q),
                &expected[k * n * n..(k + 1) * n * n],
            );
            assert!(error < TOLERANCE * largest, "{label}, state {k}: {error:e}");
        }
    });
}

#[test]
fn forward_dynamics_agrees() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        for (k, q, dq, _) in states(reference, n) {
            let row = |key| &reference.array(key)[k * n..(k + 1) * n];
            let ddq = forward_dynamics(robot, &mut ws, q, dq, row("tau_fd")).to_vec();
            // Accelerations of light wrists reach thousands of rad/s²; in torque they are as exact
            // as the rest.
            let scale = row("qdd_fd").iter().fold(1.0f64, |largest, a| largest.max(a.abs()));
            let error = largest_difference(&ddq, row("qdd_fd"));
            assert!(error < 2e-12 * scale, "{label}, state {k}: {error:e} of {scale:e}");
            let back = rnea(robot, &mut ws, q, dq, &ddq);
            let error = largest_difference(back, row("tau_fd"));
            assert!(
                error < 10.0 * TOLERANCE * reference.max_abs_tau(),
                "{label}, state {k}: torque {error:e}"
            );
        }
    });
}

#[test]
fn rotors_add_to_the_diagonal_of_the_mass_matrix() {
    let reference = Reference::load("panda_like");
    let robot = reference.by_urdf();
    let mut ws = Workspace::new(&robot);
    let rotors = [0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05];
    for (k, q, dq, ddq) in states(&reference, 7).take(20) {
        let mut tau = rnea(&robot, &mut ws, q, dq, ddq).to_vec();
        for joint in 0..7 {
            tau[joint] += rotors[joint] * ddq[joint];
        }
        let found = forward_dynamics_with_rotors(&robot, &mut ws, q, dq, &tau, &rotors);
        assert!(largest_difference(found, ddq) < 1e-11, "state {k}");
    }
}

#[test]
fn regressor_agrees_and_multiplies_the_parameters_to_the_torque() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let parameters = robot.standard_parameters();
        let columns = 10 * n;
        let expected = reference.array("regressor_joint");
        let scale = expected.iter().fold(0.0f64, |largest, y| largest.max(y.abs()));
        for (k, q, dq, ddq) in states(reference, n) {
            let y = regressor(robot, &mut ws, q, dq, ddq);
            let error = largest_difference(y, &expected[k * n * columns..(k + 1) * n * columns]);
            assert!(error < TOLERANCE * scale, "{label}, state {k}: {error:e}");
            let tau: Vec<f64> = y.chunks_exact(columns).map(|row| dot(row, &parameters)).collect();
            let error = largest_difference(&tau, &reference.array("tau")[k * n..(k + 1) * n]);
            assert!(
                error < TOLERANCE * reference.max_abs_tau(),
                "{label}, state {k}: torque {error:e}"
            );
        }
    });
}

#[test]
fn parameters_agree_in_joint_frames_and_in_denavit_hartenberg_frames() {
    for_each_robot(|label, reference, robot| {
        let error =
            largest_difference(&robot.standard_parameters(), reference.array("params_joint"));
        assert!(error < 1e-14 * 30.0, "{label}: {error:e}");
    });
    for name in ROBOTS {
        let reference = Reference::load(name);
        let Some(rows) = reference.dh_rows() else { continue };
        let robot = reference.by_dh().expect("the table is there");
        let in_dh_frames = robot.links().iter().zip(&rows).flat_map(|(link, row)| {
            let frame = DhConvention::Standard.link_frame(row).inverse();
            link.expressed_in(&frame).standard_parameters()
        });
        let error =
            largest_difference(&in_dh_frames.collect::<Vec<_>>(), reference.array("params_dh"));
        assert!(error < 1e-13, "{name}: {error:e}");
    }
}

#[test]
fn modified_denavit_hartenberg_frames_are_the_urdf_joint_frames_of_the_panda() {
    let reference = Reference::load("panda_like");
    let dh = &reference.info["dh_modified"];
    let column =
        |key: &str| -> Vec<f64> { serde_json::from_value(dh[key].clone()).expect("a column") };
    let (a, alpha, d, theta) = (column("a"), column("alpha"), column("d"), column("theta"));
    let expected = reference.by_urdf();
    let rows: Vec<_> =
        (0..7).map(|i| sgpr_core::robot::DhRow::revolute(a[i], alpha[i], d[i], theta[i])).collect();
    let robot = Robot::from_dh("panda", DhConvention::Modified, &rows, None, expected.gravity())
        .expect("a valid table")
        .with_standard_parameters(&expected.standard_parameters());
    let mut ws = Workspace::new(&robot);
    for (k, q, dq, ddq) in states(&reference, 7) {
        let tau = rnea(&robot, &mut ws, q, dq, ddq);
        let error = largest_difference(tau, &reference.array("tau")[k * 7..(k + 1) * 7]);
        // The URDF prints its angles with a dozen digits.
        assert!(error < 1e-9, "state {k}: {error:e}");
    }
}

#[test]
fn poses_and_energies_agree() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let frame_name = reference.info["tool_frame"].as_str().expect("a name");
        // A table has no tool beyond its last frame.
        let frame = robot.frame(frame_name).expect("listed").clone();
        for (k, q, dq, _) in states(reference, n) {
            let pose = frame_pose(robot, &mut ws, q, &frame).to_matrix4();
            let error = largest_difference(
                pose.as_flattened(),
                &reference.array("tool_pose")[k * 16..(k + 1) * 16],
            );
            assert!(error < 1e-13, "{label}, state {k}: pose {error:e}");
            let kinetic = kinetic_energy(robot, &mut ws, q, dq);
            let expected = reference.array("kinetic")[k];
            assert!((kinetic - expected).abs() <= 1e-12 * expected.max(1.0), "{label}, state {k}");
            let potential = potential_energy(robot, &mut ws, q);
            let expected = reference.array("potential")[k];
            assert!(
                (potential - expected).abs() <= 1e-12 * expected.abs().max(10.0),
                "{label}, state {k}"
            );
        }
    });
}

#[test]
fn jacobian_is_the_derivative_of_the_pose() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let frame = robot
            .frame(reference.info["tool_frame"].as_str().expect("a name"))
            .expect("listed")
            .clone();
        let step = 1e-6;
        for (k, q, ..) in states(reference, n).skip(3).take(10) {
            let exact = jacobian(robot, &mut ws, q, &frame).to_vec();
            for joint in 0..n {
                let mut moved = q.to_vec();
                moved[joint] += step;
                let ahead = frame_pose(robot, &mut ws, &moved, &frame);
                moved[joint] -= 2.0 * step;
                let behind = frame_pose(robot, &mut ws, &moved, &frame);
                let linear = (ahead.translation - behind.translation) * (0.5 / step);
                // R(+) R(-)ᵀ is a turn by 2 step times the angular velocity.
                let turn = ahead.rotation * behind.rotation.transposed();
                let half = 0.25 / step;
                let angular = [
                    (turn.get(2, 1) - turn.get(1, 2)) * half,
                    (turn.get(0, 2) - turn.get(2, 0)) * half,
                    (turn.get(1, 0) - turn.get(0, 1)) * half,
                ];
                let numeric = linear.to_array().into_iter().chain(angular);
                for (row, value) in numeric.enumerate() {
                    let difference = (value - exact[row * n + joint]).abs();
                    assert!(
                        difference < 1e-8,
                        "{label}, state {k}, joint {joint}, row {row}: {difference:e}"
                    );
                }
            }
        }
    });
}

#[test]
fn batches_agree_with_single_samples_whatever_their_length() {
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let mut batch = BatchWorkspace::new(robot);
        // Lengths around the register width, so that idle lanes occur.
        for count in [1, 3, 7, 8, 9, 16, 21, 200] {
            let samples = Samples {
                q: &reference.array("q")[..count * n],
                dq: &reference.array("dq")[..count * n],
                ddq: &reference.array("ddq")[..count * n],
            };
            // Garbage in the outputs must not survive.
            let mut tau = vec![f64::NAN; count * n];
            rnea_batch(robot, &mut batch, samples, &mut tau);
            let error = largest_difference(&tau, &reference.array("tau")[..count * n]);
            assert!(
                error < TOLERANCE * reference.max_abs_tau(),
                "{label}, {count} samples: {error:e}"
            );
            let mut matrix = vec![f64::NAN; count * n * 10 * n];
            regressor_batch(robot, &mut batch, samples, &mut matrix);
            for (k, q, dq, ddq) in states(reference, n).take(count) {
                let y = regressor(robot, &mut ws, q, dq, ddq);
                let error = largest_difference(y, &matrix[k * n * 10 * n..(k + 1) * n * 10 * n]);
                assert!(error < 1e-11, "{label}, {count} samples, state {k}: {error:e}");
            }
        }
    });
}

#[test]
fn free_motion_agrees_with_an_adaptive_integrator() {
    // A fixed-step Runge-Kutta integration of our forward dynamics against DOP853 of Pinocchio's,
    // rtol 1e-13.
    for_each_robot(|label, reference, robot| {
        let n = robot.dof();
        let mut ws = Workspace::new(robot);
        let times = reference.array("free_t");
        let mut q = reference.array("free_q")[..n].to_vec();
        let mut dq = reference.array("free_dq")[..n].to_vec();
        let zero = vec![0.0; n];
        let steps = 400;
        for window in 0..times.len() - 1 {
            let h = (times[window + 1] - times[window]) / f64::from(steps);
            for _ in 0..steps {
                runge_kutta_step(&mut q, &mut dq, h, |q, dq| {
                    forward_dynamics(robot, &mut ws, q, dq, &zero).to_vec()
                });
            }
            let row = (window + 1) * n..(window + 2) * n;
            let error = largest_difference(&q, &reference.array("free_q")[row]);
            assert!(error < 2e-8, "{label}, t = {}: {error:e}", times[window + 1]);
        }
    });
}

fn runge_kutta_step(
    q: &mut [f64],
    dq: &mut [f64],
    h: f64,
    mut f: impl FnMut(&[f64], &[f64]) -> Vec<f64>,
) {
    let along = |x: &[f64], v: &[f64], h: f64| -> Vec<f64> {
        x.iter().zip(v).map(|(x, v)| x + h * v).collect()
    };
    let a1 = f(q, dq);
    let (v2, q2) = (along(dq, &a1, h / 2.0), along(q, dq, h / 2.0));
    let a2 = f(&q2, &v2);
    let (v3, q3) = (along(dq, &a2, h / 2.0), along(q, &v2, h / 2.0));
    let a3 = f(&q3, &v3);
    let (v4, q4) = (along(dq, &a3, h), along(q, &v3, h));
    let a4 = f(&q4, &v4);
    for k in 0..q.len() {
        q[k] += h / 6.0 * (dq[k] + 2.0 * v2[k] + 2.0 * v3[k] + v4[k]);
        dq[k] += h / 6.0 * (a1[k] + 2.0 * a2[k] + 2.0 * a3[k] + a4[k]);
    }
}

#[test]
fn identified_parameters_that_no_body_has_still_move_linearly() {
    // Base parameters are carried by some links only, often without mass; the torque must stay
    // linear in them.
    let reference = Reference::load("ur5e_like");
    let robot = reference.by_urdf();
    let mut parameters = robot.standard_parameters();
    for block in parameters.chunks_exact_mut(10) {
        block[0] = 0.0;
        block[6] -= 0.3;
    }
    let odd = robot.clone().with_standard_parameters(&parameters);
    assert_eq!(odd.standard_parameters(), parameters);
    assert_eq!(
        odd.links()[2],
        LinkInertia::from_standard_parameters(parameters[20..30].try_into().expect("ten"))
    );
    let mut ws = Workspace::new(&robot);
    for (_, q, dq, ddq) in states(&reference, 6).take(20) {
        let y = regressor(&robot, &mut ws, q, dq, ddq).to_vec();
        let tau: Vec<f64> = y.chunks_exact(60).map(|row| dot(row, &parameters)).collect();
        assert!(largest_difference(rnea(&odd, &mut ws, q, dq, ddq), &tau) < 1e-11);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
