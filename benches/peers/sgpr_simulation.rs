//! Nanoseconds per simulation step of the PUMA 560: PD control at 1 kHz, steps at 4 kHz, fastest of
//! many batches; as `mujoco_step.c` does it, friction by friction.

use std::time::Instant;

use sgpr_benches::Sines;
use sgpr_core::robot::puma560;
use sgpr_core::simulation::{
    Drive, Experiment, FeedForward, Gains, Integrator, Pd, RigidBody, Simulator, puma560_drives,
    simulate,
};

const STEPS: usize = 4000;
const BATCHES: usize = 40;

/// Fastest time per step, everything that an experiment records included.
fn nanoseconds(drives: &[Drive], feed_forward: bool) -> f64 {
    let robot = puma560();
    let gains = Gains::uniform(6, 300.0, 10.0);
    let mut best = f64::INFINITY;
    for _ in 0..BATCHES {
        let mut arm = Simulator::new(&robot, drives, Integrator::SemiImplicitEuler, 2.5e-4)
            .expect("valid drives");
        let (mut pd, mut law) =
            (Pd(gains.clone()), FeedForward::new(RigidBody::new(&robot), gains.clone()));
        let start = Instant::now();
        let duration = STEPS as f64 * 2.5e-4;
        let controller: &mut dyn sgpr_core::simulation::Controller =
            if feed_forward { &mut law } else { &mut pd };
        simulate(&mut arm, controller, &Sines, duration, &Experiment::default(), &())
            .expect("stable");
        best = best.min(start.elapsed().as_secs_f64() / STEPS as f64 * 1e9);
    }
    best
}

fn main() {
    let dry: Vec<Drive> = puma560_drives();
    let viscous: Vec<Drive> = dry
        .iter()
        .map(|drive| drive.with_coulomb_friction([0.0; 2]).with_static_friction([0.0; 2]))
        .collect();
    let all: Vec<Drive> = dry.iter().map(|drive| drive.with_stiction(1.3, 0.05)).collect();
    let step = 2.5e-4 * 1e9;
    for (name, drives, feed_forward) in [
        ("viscous friction", &viscous, false),
        ("viscous and Coulomb friction", &dry, false),
        ("all friction", &all, false),
        ("all friction, model feed-forward", &all, true),
    ] {
        let each = nanoseconds(drives, feed_forward);
        println!("{name}: {each:.0} ns per step, {:.0} times real time", step / each);
    }
}
