//! After set-up the dynamics and the predictor take no memory, as a control loop needs it.
//!
//! It counts for the whole process, so that no test harness may run beside it.
#![allow(missing_docs)]

mod common;

use std::alloc::System;
use std::hint::black_box;

use cap::Cap;
use common::{ROBOTS, Reference, data};
use sgpr_core::dynamics::{
    BatchWorkspace, Samples, Workspace, bias_forces, forward_dynamics,
    forward_dynamics_with_rotors, forward_kinematics, frame_pose, gravity_torque, jacobian,
    kinetic_energy, mass_matrix, potential_energy, regressor, regressor_batch, rnea, rnea_batch,
};
use sgpr_core::effects::{Entry, Site, by_name, registry};
use sgpr_core::gp::{
    Compute, Covariance, Data, GaussianProcess, Kernel, Precision, PredictorOptions, Shape,
};
use sgpr_core::model::{
    Inputs, Mean, Predictor, Purpose, SemiParametricOptions, StreamOptions, Term, TorqueModel,
    fit_semi_parametric,
};
use sgpr_core::recording::csv;
use sgpr_core::robot::{Robot, UrdfOptions};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

/// A routine that may keep to its workspace: of q, dq, ddq and tau it returns one number.
type Call<'a> = &'a mut dyn FnMut(&mut Workspace, &[f64], &[f64], &[f64], &[f64]) -> f64;

/// Bytes taken by `work`, whether given back or not.
fn bytes_taken(work: impl FnOnce()) -> usize {
    let before = MEMORY.total_allocated();
    work();
    MEMORY.total_allocated() - before
}

/// A count that does not end with a whole register, so that the remainder is looked at too.
const SAMPLES: usize = 37;

fn check(name: &str, robot: &Robot) {
    let n = robot.dof();
    let numbers =
        |scale: f64| (0..SAMPLES * n).map(|k| scale * (k as f64 * 0.7).sin()).collect::<Vec<_>>();
    let (q, dq, ddq, tau) = (numbers(2.0), numbers(1.0), numbers(5.0), numbers(20.0));
    let rotors = vec![0.1; n];
    let frame = robot.frames().last().expect("a frame");
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let (mut torque, mut matrix) = (vec![0.0; SAMPLES * n], vec![0.0; SAMPLES * n * 10 * n]);
    let mut ws = Workspace::new(robot);
    let mut batch = BatchWorkspace::new(robot);
    let of_state: Vec<_> =
        registry().into_iter().filter(|effect| effect.entry() == Entry::State).collect();
    let effects: Vec<String> = of_state.iter().map(|effect| effect.name().to_string()).collect();
    let effect_parameters =
        of_state.iter().map(|effect| effect.parameters().len() * n).sum::<usize>();
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..effect_parameters).map(|k| 0.1 * k as f64));
    let model = TorqueModel::with_parameters(robot, &effects, parameters).expect("known effects");
    let mut predictor = Predictor::new(&model);

    let mut none = |what: &str, call: Call<'_>| {
        let taken = bytes_taken(|| {
            for k in 0..SAMPLES {
                let row = k * n..(k + 1) * n;
                black_box(call(
                    &mut ws,
                    &q[row.clone()],
                    &dq[row.clone()],
                    &ddq[row.clone()],
                    &tau[row],
                ));
            }
        });
        assert_eq!(taken, 0, "{name}: {what} takes memory");
    };
    none("rnea", &mut |ws, q, dq, ddq, _| rnea(robot, ws, q, dq, ddq)[0]);
    none("bias_forces", &mut |ws, q, dq, _, _| bias_forces(robot, ws, q, dq)[0]);
    none("gravity_torque", &mut |ws, q, _, _, _| gravity_torque(robot, ws, q)[0]);
    none("regressor", &mut |ws, q, dq, ddq, _| regressor(robot, ws, q, dq, ddq)[0]);
    none("mass_matrix", &mut |ws, q, _, _, _| mass_matrix(robot, ws, q)[0]);
    none("forward_dynamics", &mut |ws, q, dq, _, tau| forward_dynamics(robot, ws, q, dq, tau)[0]);
    none("forward_dynamics_with_rotors", &mut |ws, q, dq, _, tau| {
        forward_dynamics_with_rotors(robot, ws, q, dq, tau, &rotors)[0]
    });
    none("forward_kinematics", &mut |ws, q, _, _, _| {
        forward_kinematics(robot, ws, q)[0].translation.x
    });
    none("frame_pose", &mut |ws, q, _, _, _| frame_pose(robot, ws, q, frame).translation.x);
    none("jacobian", &mut |ws, q, _, _, _| jacobian(robot, ws, q, frame)[0]);
    none("kinetic_energy", &mut |ws, q, dq, _, _| kinetic_energy(robot, ws, q, dq));
    none("potential_energy", &mut |ws, q, _, _, _| potential_energy(robot, ws, q));
    none("Predictor::torque", &mut |_, q, dq, ddq, _| predictor.torque(q, dq, ddq)[0]);
    // Beyond 1e5 rad sines take another path.
    none("rnea far away", &mut |ws, _, dq, ddq, _| {
        let far = [1e6; 16];
        rnea(robot, ws, &far[..n], dq, ddq)[0]
    });

    let taken = bytes_taken(|| rnea_batch(robot, &mut batch, samples, &mut torque));
    assert_eq!(taken, 0, "{name}: rnea_batch takes memory");
    let taken = bytes_taken(|| regressor_batch(robot, &mut batch, samples, &mut matrix));
    assert_eq!(taken, 0, "{name}: regressor_batch takes memory");
    assert!(torque.iter().chain(&matrix).all(|value| value.is_finite()));
    assert!(torque.iter().any(|value| *value != 0.0), "the work was done");
}

/// Seven joints with findings of all kinds, two and more of them with a memory.
fn check_findings() {
    let robot = Reference::load("panda_like").by_urdf();
    let n = robot.dof();
    assert_eq!(n, 7);
    let term = |name: &str, site: Site, constants: &[f64]| {
        let mut term = Term::new(by_name(name).expect("of the library"), site, constants.to_vec());
        term.coefficients.fill(0.3);
        term
    };
    let usual = vec![
        term("presliding_friction", Site::Joint(1), &[0.01]),
        term("cable_hysteresis", Site::Joint(0), &[0.2]),
        term("stribeck_friction", Site::Joint(2), &[0.05]),
        term("load_dependent_friction", Site::Joint(3), &[]),
        term("torque_ripple", Site::Joint(4), &[30.0]),
    ];
    // Every effect of the library at once, and all transforms.
    let every =
        registry().into_iter().filter(|effect| effect.entry() != Entry::Gate).map(|effect| {
            let site = effect.sites(&robot)[0];
            let constants: Vec<f64> =
                effect.constants().iter().map(|c| c.low.max(0.01).min(c.high)).collect();
            let mut term = Term::new(effect, site, constants);
            term.coefficients.fill(0.3);
            term
        });
    for (name, terms) in [("five findings", usual), ("every effect", every.collect())] {
        let model = TorqueModel::nominal(&robot).with_terms(terms, Some(0));
        for purpose in Purpose::ALL {
            let options = StreamOptions::default()
                .with_rate_hz(Some(1000.0))
                .with_purpose(purpose)
                .with_keep(vec![]);
            let mut predictor = model.predictor(&options).expect("streams");
            predictor.set_temperature(&vec![40.0; n]).expect("finite");
            let taken = bytes_taken(|| {
                predictor.reset_at(&[0.1; 7], &[0.0; 7]).expect("finite");
                for k in 0..SAMPLES {
                    let sample = [0.1 + 0.003 * k as f64; 7];
                    assert!(
                        predictor
                            .torque(&sample, &sample, &sample)
                            .iter()
                            .all(|tau| tau.is_finite()),
                        "{name}"
                    );
                    black_box(
                        predictor.torque_after(0.0013, &sample, &sample, &sample).expect("good")[0],
                    );
                }
                predictor.reset();
            });
            assert_eq!(taken, 0, "{name}, {purpose}");
        }
    }
}

/// A process of three outputs over four inputs.
fn process(compact: bool) -> GaussianProcess {
    let x: Vec<f64> = (0..4 * 90).map(|k| (0.37 * f64::from(k)).sin()).collect();
    let y = (0..3 * 90).map(|k| (0.11 * f64::from(k)).cos()).collect();
    let smooth = Kernel::ard(Shape::SquaredExponential, &[1.0; 4]);
    // A compact predictor has no periodic inputs.
    let smooth = if compact { smooth } else { smooth.with_period(0, 2.0) };
    let kernel = smooth.scaled(1.0).plus(Kernel::isotropic(
        Shape::RationalQuadratic { mixture: 1.0 },
        4,
        2.0,
    ));
    let data = Data::new(x, 4, y, 3).expect("good data");
    GaussianProcess::fit(data, Covariance::new(kernel, 0.1), &Compute::default())
        .expect("good data")
}

/// Precisions, compact and not.
const PRECISIONS: [(Precision, bool); 4] = [
    (Precision::Double, false),
    (Precision::Single, false),
    (Precision::Double, true),
    (Precision::Single, true),
];

fn check_processes() {
    fn sendable(_: &impl Send) {}
    for (precision, compact) in PRECISIONS {
        let gp = process(compact);
        for variance_rank in [None, Some(0), Some(40)] {
            let options = PredictorOptions::default()
                .with_precision(precision)
                .with_variance_rank(variance_rank)
                .with_compact(compact);
            let mut predictor = gp.predictor(options).expect("small");
            sendable(&predictor);
            let taken = bytes_taken(|| {
                for k in 0..SAMPLES {
                    let x = [0.1 * k as f64, 0.3, -0.2, 0.7];
                    black_box(predictor.mean(&x)[2]);
                    if variance_rank != Some(0) {
                        black_box(predictor.mean_and_variance(&x).1);
                    }
                }
            });
            assert_eq!(taken, 0, "GpPredictor, {options:?}");
        }
    }
}

/// The arm of the demo with small processes, each joint its own or all one kernel.
fn check_semi_parametric() {
    let robot =
        Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled");
    let log = csv::read(data("demo/train_1.csv.gz"), &Default::default()).expect("bundled");
    let kinds =
        [(false, Mean::Physics), (true, Mean::Physics), (false, Mean::Joint), (true, Mean::Joint)];
    for ((shared, mean), sparse) in
        kinds.into_iter().flat_map(|kind| [(kind, Some(false)), (kind, Some(true))])
    {
        let options = SemiParametricOptions::default()
            .with_shared(shared)
            .with_mean(mean)
            .with_sparse(sparse)
            .with_inputs(Some(Inputs::Velocities))
            .with_points(40)
            .with_evaluations(5);
        let model = fit_semi_parametric(&robot, std::slice::from_ref(&log), &options, &())
            .expect("a good log");
        for (precision, compact) in PRECISIONS {
            for variance_rank in [None, Some(0), Some(20)] {
                let options = PredictorOptions::default()
                    .with_precision(precision)
                    .with_variance_rank(variance_rank)
                    .with_compact(compact);
                let mut predictor =
                    model.predictor(options, &StreamOptions::default()).expect("small");
                let taken = bytes_taken(|| {
                    for k in 0..SAMPLES {
                        let q = [0.1 * k as f64, 0.3, -0.2, 0.7, 0.0, 0.1];
                        black_box(predictor.torque(&q, &q, &q)[2]);
                        if variance_rank != Some(0) {
                            black_box(
                                predictor.torque_and_deviation(&q, &q, &q).expect("finite").1[2],
                            );
                        }
                    }
                });
                assert_eq!(taken, 0, "shared {shared}, {mean:?}, sparse {sparse:?}, {options:?}");
            }
        }
    }
}

fn main() {
    // The count sees what it should: eight bytes, and the set-up itself.
    let taken = bytes_taken(|| drop(black_box(Box::new(black_box(1.0)))));
    assert_eq!(taken, 8);
    for name in ROBOTS {
        let robot = Reference::load(name).by_urdf();
        let taken = bytes_taken(|| drop(black_box(Workspace::new(&robot))));
        assert!(taken > 1000, "{name}: a workspace of {taken} bytes");
        check(name, &robot);
    }
    check_findings();
    check_processes();
    check_semi_parametric();
}
