//! An update of a model that learns allocates nothing. It counts for the whole process: no test
//! harness runs beside it.
#![allow(missing_docs)]

use std::alloc::System;

use cap::Cap;
use sgpr_core::online::{Budget, OnlineModel, OnlineOptions, PayloadOptions};
use sgpr_core::robot::puma560;
use sgpr_core::simulation::{InverseDynamics, RigidBody};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

fn main() {
    let robot = puma560();
    let options = OnlineOptions::default()
        .with_payload(Some(PayloadOptions::new(vec![1.0; 6])))
        // Every sample is new: the budget is used up, and the oldest point goes each time.
        .with_process(Some(Budget::default().with_novelty(0.0)));
    let mut model =
        OnlineModel::new(&robot, Box::new(RigidBody::new(&robot)), &options).expect("valid");
    let (mut q, mut tau, zero) = ([0.0; 6], [0.0; 6], [0.0; 6]);
    let before = MEMORY.total_allocated();
    for k in 0..500 {
        let time = 1e-3 * f64::from(k);
        q.iter_mut().enumerate().for_each(|(j, q)| *q = (time * (2.0 + j as f64)).sin());
        model.update(&q, &tau).expect("finite");
        tau.fill(0.0);
        model.add_torque(&q, &zero, &zero, &mut tau);
    }
    assert_eq!(MEMORY.total_allocated(), before);
    assert_eq!(model.process().map_or(0, |process| process.len()), 100);
}
