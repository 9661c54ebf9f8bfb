//! Time per update of a model that learns while the arm runs, PUMA 560: payload and process, and
//! the torque after it.
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::Sines;
use sgpr_core::online::{Budget, OnlineModel, OnlineOptions, PayloadOptions};
use sgpr_core::robot::puma560;
use sgpr_core::simulation::{InverseDynamics, Reference, RigidBody};

fn main() {
    divan::main();
}

const SAMPLES: usize = 2000;

fn bench(bencher: Bencher, payload: bool, points: Option<usize>) {
    let robot = puma560();
    let options = OnlineOptions::default()
        .with_payload(payload.then(|| PayloadOptions::new(vec![1.0; 6])))
        // Every sample is new, so that the budget is used and the oldest point goes: the dearest
        // update.
        .with_process(points.map(|points| Budget::default().with_points(points).with_novelty(0.0)));
    let mut model =
        OnlineModel::new(&robot, Box::new(RigidBody::new(&robot)), &options).expect("valid");
    let (mut q, mut dq, mut ddq, mut tau) = ([0.0; 6], [0.0; 6], [0.0; 6], [0.0; 6]);
    let mut sample = 0;
    bencher.counter(divan::counter::ItemsCount::new(SAMPLES)).bench_local(|| {
        for _ in 0..SAMPLES {
            Sines.sample(1e-3 * f64::from(sample), &mut q, &mut dq, &mut ddq);
            sample += 1;
            model.update(&q, &tau).expect("finite");
            tau.fill(0.0);
            model.add_torque(&q, &dq, &ddq, &mut tau);
        }
        black_box(tau)
    });
}

#[divan::bench]
fn payload(bencher: Bencher) {
    bench(bencher, true, None);
}

#[divan::bench(args = [50, 100, 200])]
fn payload_and_process(bencher: Bencher, points: usize) {
    bench(bencher, true, Some(points));
}
