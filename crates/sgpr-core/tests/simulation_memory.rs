//! A simulation step allocates nothing. It counts for the whole process: no test harness runs
//! beside it.
#![allow(missing_docs)]

use std::alloc::System;

use cap::Cap;
use sgpr_core::robot::puma560;
use sgpr_core::simulation::{
    Controller, FeedForward, Gains, Integrator, Measurement, RigidBody, Setpoint, Simulator,
    puma560_drives,
};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

fn main() {
    let robot = puma560();
    let drives: Vec<_> =
        puma560_drives().into_iter().map(|drive| drive.with_stiction(1.5, 0.05)).collect();
    let mut controller = FeedForward::new(RigidBody::new(&robot), Gains::uniform(6, 300.0, 10.0));
    for integrator in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
        let mut arm = Simulator::new(&robot, &drives, integrator, 1e-3).expect("valid drives");
        let (mut tau, zero) = ([0.0; 6], [0.0; 6]);
        let before = MEMORY.total_allocated();
        for step in 0..500 {
            let q = [0.3 * (0.01 * f64::from(step)).sin(); 6];
            let measured = Measurement { time: arm.time(), q: arm.q(), dq: arm.dq() };
            controller.torque(&measured, &Setpoint { q: &q, dq: &zero, ddq: &zero }, &mut tau);
            arm.step(&tau).expect("stable");
        }
        assert_eq!(MEMORY.total_allocated(), before, "{integrator:?}");
    }
}
