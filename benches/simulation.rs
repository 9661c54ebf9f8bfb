//! Time per simulation step: PUMA 560 with all its friction, control at 1 kHz, steps at 4 kHz; the
//! peer is `peers/mujoco_step.c`.
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::Sines;
use sgpr_core::robot::puma560;
use sgpr_core::simulation::{
    Drive, Experiment, FeedForward, Gains, Integrator, RigidBody, Simulator, puma560_drives,
    simulate,
};

fn main() {
    divan::main();
}

const STEPS: usize = 4000;

fn bench(bencher: Bencher, drives: &[Drive], integrator: Integrator, experiment: &Experiment) {
    let robot = puma560();
    bencher.counter(divan::counter::ItemsCount::new(STEPS)).bench_local(|| {
        let mut arm = Simulator::new(&robot, drives, integrator, 2.5e-4).expect("valid drives");
        let mut controller =
            FeedForward::new(RigidBody::new(&robot), Gains::uniform(6, 300.0, 10.0));
        black_box(
            simulate(&mut arm, &mut controller, &Sines, 1.0, experiment, &()).expect("stable"),
        )
    });
}

fn with_stiction() -> Vec<Drive> {
    puma560_drives().into_iter().map(|drive| drive.with_stiction(1.3, 0.05)).collect()
}

#[divan::bench]
fn euler_all_friction(bencher: Bencher) {
    bench(bencher, &with_stiction(), Integrator::SemiImplicitEuler, &Experiment::default());
}

#[divan::bench]
fn euler_coulomb(bencher: Bencher) {
    bench(bencher, &puma560_drives(), Integrator::SemiImplicitEuler, &Experiment::default());
}

#[divan::bench]
fn runge_kutta_all_friction(bencher: Bencher) {
    bench(bencher, &with_stiction(), Integrator::RungeKutta4, &Experiment::default());
}
