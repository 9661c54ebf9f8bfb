//! Time of a whole identification from joint motion and torque: observation matrix, triangular factors, weighted least
//! squares.
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::Fixture;
use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{BaseParameters, LeastSquares, Method, Observation, ParameterSet};

fn main() {
    divan::main();
}

#[divan::bench(args = ["puma560", "panda_like"])]
fn identify_6006_samples(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, 6006);
    let set = ParameterSet::new(&fixture.robot, &["viscous_friction", "coulomb_friction"]).expect("known effects");
    let base = BaseParameters::new(&fixture.robot, &set);
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    let nominal = vec![0.0; base.rank()];
    bencher.bench_local(|| {
        let mut observation = Observation::new(&fixture.robot, &set, &base);
        observation.add_samples(samples, &fixture.tau, None).expect("finite data");
        let factors = observation.factors();
        black_box(LeastSquares::new(Method::Wls).solve(&factors, &base, &nominal).expect("enough data"))
    });
}

#[divan::bench(args = ["puma560", "panda_like"])]
fn observe_6006_samples(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, 6006);
    let set = ParameterSet::new(&fixture.robot, &["viscous_friction", "coulomb_friction"]).expect("known effects");
    let base = BaseParameters::new(&fixture.robot, &set);
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    bencher.bench_local(|| {
        let mut observation = Observation::new(&fixture.robot, &set, &base);
        observation.add_samples(samples, &fixture.tau, None).expect("finite data");
        black_box(observation.factors())
    });
}
