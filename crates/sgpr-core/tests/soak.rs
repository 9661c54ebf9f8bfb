//! Work that is done again and again takes no more memory the millionth time than the second. It
//! counts for the whole process: no test harness runs beside it. `make soak` does it often, `make
//! test` a few times.
#![allow(missing_docs)]

mod common;

use std::alloc::System;
use std::hint::black_box;

use cap::Cap;
use common::data;
use sgpr_core::model::{IdentifyOptions, Predictor, TorqueModel, compare, identify};
use sgpr_core::recording::{Recording, csv};
use sgpr_core::robot::{Robot, UrdfOptions};

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, usize::MAX);

fn times(name: &str, few: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(few)
}

/// Memory that is held before and after `count` times `work`, from the second time on: what is set
/// up once is set up then.
fn held(count: usize, mut work: impl FnMut(usize)) -> [usize; 2] {
    work(0);
    work(1);
    let before = MEMORY.allocated();
    (2..count).for_each(&mut work);
    [before, MEMORY.allocated()]
}

fn predictions(model: &TorqueModel, calls: usize) {
    let n = model.robot().dof();
    let mut predictor = Predictor::new(model);
    let (mut q, mut dq, mut ddq) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut sum = 0.0;
    let [before, after] = held(calls, |call| {
        let time = 1e-3 * call as f64;
        for joint in 0..n {
            let rate = 1.0 + 0.3 * joint as f64;
            (q[joint], dq[joint], ddq[joint]) = (
                (rate * time).sin(),
                rate * (rate * time).cos(),
                -rate * rate * (rate * time).sin(),
            );
        }
        sum += black_box(predictor.torque(&q, &dq, &ddq))[0];
    });
    assert!(sum.is_finite());
    assert_eq!(before, after, "{calls} calls of a predictor");
}

fn identifications(robot: &Robot, log: &Recording, test: &Recording, fits: usize) {
    let effects =
        ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    let options = IdentifyOptions::default().with_effects(effects);
    let mut bytes: Option<Vec<u8>> = None;
    let [before, after] = held(fits, |_| {
        let model =
            identify(robot, std::slice::from_ref(log), &options, &()).expect("a good log").0;
        let again = TorqueModel::from_bytes(&model.to_bytes(), "soak").expect("just written");
        black_box(compare(&again, std::slice::from_ref(test), None).expect("a good log"));
        let own = model.to_bytes();
        assert!(
            *bytes.get_or_insert_with(|| own.clone()) == own,
            "the same logs make another model"
        );
    });
    assert_eq!(before, after, "{fits} identifications");
}

fn main() {
    let robot =
        Robot::from_urdf(data("demo/robot.urdf"), &UrdfOptions::default()).expect("bundled");
    let read = |name: &str| {
        csv::read(data(&format!("demo/{name}.csv.gz")), &Default::default()).expect("bundled")
    };
    let (log, test) = (read("train_1").slice(500..1500), read("test").slice(500..1500));
    let options = IdentifyOptions::default().with_effects(vec!["viscous_friction".into()]);
    let model = identify(&robot, std::slice::from_ref(&log), &options, &()).expect("a good log").0;
    let (calls, fits) = (times("SGPR_SOAK_CALLS", 10_000), times("SGPR_SOAK_FITS", 4));
    predictions(&model, calls);
    identifications(&robot, &log, &test, fits);
    println!(
        "soak: {calls} predictions and {fits} identifications hold no more memory at their end"
    );
}
