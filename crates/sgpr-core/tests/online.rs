//! Models that learn while the arm runs.
#![allow(missing_docs)]

use sgpr_core::dynamics::{Workspace, rnea};
use sgpr_core::gp::{Compute, Covariance, Data, GaussianProcess, Kernel, Shape};
use sgpr_core::online::*;
use sgpr_core::robot::{Robot, puma560};
use sgpr_core::simulation::*;

/// Numbers in [0, 1) from SplitMix64.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The updated factor against one computed from nothing, by the exact process of the library.
#[test]
fn points_that_come_and_go_leave_the_exact_process() {
    for shape in [Shape::SquaredExponential, Shape::Matern32] {
        let kernel = Kernel::ard(shape, &[0.7, 1.1]).scaled(2.5);
        let budget =
            Budget::default().with_points(40).with_novelty(0.05).with_refresh(0).with_memory(300);
        let mut online =
            OnlineGaussianProcess::new(kernel.clone(), 2, 2, 1e-3, budget).expect("valid");
        let mut random = Uniform(3);
        for step in 0..1000 {
            let x = [4.0 * random.next(), 4.0 * random.next()];
            online
                .add(&x, &[x[0].sin() * x[1], x[1].cos() + 0.001 * f64::from(step)])
                .expect("finite");
            if step % 37 == 0 {
                online.remove((random.next() * online.len() as f64) as usize);
            }
            assert!(online.len() <= 40);
        }
        assert!(online.len() > 20, "only {} points", online.len());
        let data = Data::new(online.x().to_vec(), 2, online.y().to_vec(), 2).expect("finite");
        let exact = GaussianProcess::fit(data, Covariance::new(kernel, 1e-3), &Compute::default())
            .expect("definite");
        for _ in 0..50 {
            let x = [4.0 * random.next(), 4.0 * random.next()];
            let expected = exact.predict(&x, true).expect("finite");
            let (mean, variance) = online.mean_and_variance(&x);
            // A condition number of 40 * 2.5 / 1e-3 = 1e5, a thousand updates.
            for (found, expected) in mean.iter().zip(&expected.mean) {
                assert!((found - expected).abs() < 1e-8, "{found} {expected}");
            }
            assert!(
                (variance - expected.variance[0]).abs() < 1e-9,
                "{variance} {}",
                expected.variance[0]
            );
        }
    }
}

#[test]
fn a_function_that_changes_is_followed() {
    let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 0.5);
    let budget = Budget::default().with_novelty(1e-3);
    let mut gp = OnlineGaussianProcess::new(kernel, 1, 1, 1e-3, budget).expect("valid");
    for offset in [0.0, 5.0] {
        for k in 0..400 {
            let x = f64::from(k % 100) * 0.06;
            gp.add(&[x], &[x.sin() + offset]).expect("finite");
        }
        let worst = (0..60)
            .map(|k| 0.1 * f64::from(k))
            .map(|x| (gp.mean(&[x])[0] - x.sin() - offset).abs());
        let worst = worst.fold(0.0, f64::max);
        // A share of the largest value, six; a value that stayed would be wrong by five.
        assert!(worst < 0.3, "{worst}");
    }
    // Away from all that was measured lately nothing is left.
    for _ in 0..3000 {
        gp.add(&[100.0], &[0.0]).expect("finite");
    }
    assert!(gp.len() == 1 && gp.mean(&[1.0])[0].abs() < 1e-12);
}

const HELD: [f64; 10] = [2.0, 0.04, -0.06, 0.3, 0.06, 0.001, 0.055, -0.006, 0.009, 0.012];

/// Without noise the recursion ends at what is held, and without a payload at nothing.
#[test]
fn a_payload_is_recovered() {
    let robot = puma560();
    for held in [HELD, [0.0; 10]] {
        let loaded = PickUp::new(1.0, 5, held).loaded(&robot);
        let options = PayloadOptions::new(vec![1e-4; 6]).with_memory(2.0);
        let mut tracker = PayloadTracker::new(&robot, &options).expect("valid");
        let (mut ws, mut other) = (Workspace::new(&robot), Workspace::new(&loaded));
        for k in 0..4000 {
            let time = 1e-3 * f64::from(k);
            let wave =
                |j: usize, phase: f64, size: f64| size * (time * (2.0 + j as f64) + phase).sin();
            let of = |phase, size| -> Vec<f64> { (0..6).map(|j| wave(j, phase, size)).collect() };
            let (q, dq, ddq) = (of(0.0, 1.0), of(1.0, 2.0), of(2.0, 8.0));
            let full = rnea(&loaded, &mut other, &q, &dq, &ddq).to_vec();
            let residual: Vec<f64> = full
                .iter()
                .zip(rnea(&robot, &mut ws, &q, &dq, &ddq))
                .map(|(full, arm)| full - arm)
                .collect();
            tracker.update(1e-3, [&q, &dq, &ddq], &residual, &[true; 6], 1.0);
        }
        let deviations = tracker.standard_deviations();
        for (k, (found, held)) in tracker.parameters().iter().zip(held).enumerate() {
            // The prior (mass 5 ± kg) pulls by its share of the information, far below the noise.
            assert!((found - held).abs() < 1e-4, "{k}: {found} {held}");
            assert!(deviations[k] < 1e-3, "{k}: {}", deviations[k]);
        }
    }
}

struct Waves;

impl Reference for Waves {
    fn dof(&self) -> usize {
        6
    }

    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        let middle = [0.0, -1.2, 0.3, 0.2, 0.4, 0.0];
        for j in 0..6 {
            // Each joint swings twice, so that none of them ever stands for long.
            let (w, v) = (2.2 + 0.37 * j as f64, 3.9 - 0.29 * j as f64);
            let (a, b) = (0.35, 0.12);
            q[j] = middle[j] + a * (1.0 - (w * time).cos()) - b * (1.0 - (v * time).cos());
            dq[j] = a * w * (w * time).sin() - b * v * (v * time).sin();
            ddq[j] = a * w * w * (w * time).cos() - b * v * v * (v * time).cos();
        }
    }
}

fn drives() -> Vec<Drive> {
    puma560_drives().into_iter().map(|drive| drive.with_stiction(1.05, 0.05)).collect()
}

/// What an identification would have found: the rigid body, rotors, viscous and dry friction in
/// both directions.
fn known(robot: &Robot) -> Box<dyn InverseDynamics> {
    let mut body = RigidBody::new(robot);
    let drives = drives();
    Box::new(move |q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]| {
        body.add_torque(q, dq, ddq, tau);
        for (j, drive) in drives.iter().enumerate() {
            tau[j] += drive.rotor_inertia * ddq[j] + drive.friction(dq[j]);
        }
    })
}

fn options(payload: bool, process: bool) -> OnlineOptions {
    let noise = vec![1.0, 1.0, 0.5, 0.1, 0.1, 0.1];
    OnlineOptions::default()
        .with_payload(payload.then(|| PayloadOptions::new(noise)))
        .with_process(process.then(Budget::default))
}

const PICK_UP: f64 = 3.0;

/// Norm of the position error over all joints, sample by sample, rad.
fn errors(payload: bool, process: bool) -> (Vec<f64>, AdaptiveFeedForward) {
    let robot = puma560();
    let mut arm = Simulator::new(&robot, &drives(), Integrator::default(), 2.5e-4).expect("valid");
    let model = OnlineModel::new(&robot, known(&robot), &options(payload, process)).expect("valid");
    let mut controller = AdaptiveFeedForward::new(model, Gains::uniform(6, 75.0, 5.0));
    let sensors = Sensors::default().with_position_resolution(vec![1e-5; 6]);
    let experiment = Experiment::default().with_sensors(sensors);
    let pick_up = PickUp::new(PICK_UP, 5, HELD);
    let record =
        simulate_pick_up(&mut arm, &mut controller, &Waves, 8.0, &experiment, &pick_up, &())
            .expect("stable");
    assert_eq!(record.len(), 8000);
    let pairs = record.q_wanted.chunks_exact(6).zip(record.q.chunks_exact(6));
    let norm = |(wanted, q): (&[f64], &[f64])| {
        wanted.iter().zip(q).map(|(w, q)| (w - q) * (w - q)).sum::<f64>().sqrt()
    };
    (pairs.map(norm).collect(), controller)
}

fn rms(errors: &[f64], from: f64, to: f64) -> f64 {
    let part = &errors[(1000.0 * from) as usize..(1000.0 * to) as usize];
    (part.iter().map(|e| e * e).sum::<f64>() / part.len() as f64).sqrt()
}

#[test]
fn tracking_recovers_within_a_second_of_a_pick_up() {
    let (plain, _) = errors(false, false);
    let before = rms(&plain, 1.0, PICK_UP);
    let lost = rms(&plain, PICK_UP + 1.0, 8.0);
    println!("no adaptation: {before:.4} before, {lost:.4} after the pick-up");
    for (payload, process) in [(true, false), (true, true), (false, true)] {
        let (errors, controller) = errors(payload, process);
        let (own, recovered) = (rms(&errors, 1.0, PICK_UP), rms(&errors, PICK_UP + 1.0, 8.0));
        println!(
            "payload {payload}, process {process}: {own:.4} before, {recovered:.4} from a second \
             after on"
        );
        let last = errors
            .iter()
            .rposition(|error| *error > 0.1 * lost)
            .map_or(PICK_UP, |last| last as f64 / 1000.0);
        println!(
            "  below a tenth of what is lost without adaptation {:.2} s after",
            last - PICK_UP
        );
        assert!(!payload || last - PICK_UP < 1.0);
        if let Some(tracker) = controller.model().payload() {
            println!(
                "  mass {:.3} ± {:.3}",
                tracker.parameters()[0],
                tracker.standard_deviations()[0]
            );
            assert!((tracker.parameters()[0] - HELD[0]).abs() < 0.2);
        }
        assert!(lost > 5.0 * before, "the payload matters: {lost} {before}");
        // Half of the error of a process alone is the motion that it has not seen yet.
        let goal = if payload { 0.1 } else { 0.4 };
        assert!(recovered < goal * lost, "{recovered} of {lost}");
        assert!(own < 5.0 * before, "where nothing has changed nothing is learned: {own} {before}");
    }
}

#[test]
fn wrong_use_is_told() {
    let robot = puma560();
    let payload = |options: PayloadOptions| {
        PayloadTracker::new(&robot, &options).expect_err("wrong").to_string()
    };
    assert!(payload(PayloadOptions::new(vec![1.0; 5])).contains("noise: got 5 values, expected 6"));
    let link = PayloadOptions::new(vec![1.0; 6]).with_link(Some(6));
    assert!(payload(link).contains("links 0 to 5"));
    let memory = PayloadOptions::new(vec![1.0; 6]).with_memory(0.0);
    assert!(payload(memory).contains("memory is 0"));
    let mut model = OnlineModel::new(&robot, known(&robot), &options(true, true)).expect("valid");
    let wrong = model
        .update(&[0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0], &[0.0; 6])
        .expect_err("no number")
        .to_string();
    assert!(wrong.contains("q: value 1 is NaN"), "{wrong}");
    let budget = Budget::default().with_points(0);
    assert!(OnlineGaussianProcess::new(process_kernel(2), 6, 2, 0.01, budget).is_err());
    assert!(OnlineGaussianProcess::new(process_kernel(2), 3, 2, 0.01, Budget::default()).is_err());
}

#[test]
fn a_pick_up_outside_of_the_experiment_is_refused() {
    let robot = puma560();
    let mut arm = Simulator::new(&robot, &drives(), Integrator::default(), 2.5e-4).expect("valid");
    let mut controller = Pd(Gains::uniform(6, 75.0, 5.0));
    for time in [0.0, 2.0, 0.50005] {
        let pick_up = PickUp::new(time, 5, HELD);
        let run = simulate_pick_up(
            &mut arm,
            &mut controller,
            &Waves,
            1.0,
            &Experiment::default(),
            &pick_up,
            &(),
        );
        assert!(run.expect_err("refused").to_string().contains("time of the pick-up"));
    }
}
