//! Time of a whole identification from joint motion and torque: observation matrix, triangular
//! factors, weighted least squares; and of making it consistent, which does not see the samples.
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::{Fixture, Uniform};
use sgpr_core::dynamics::{BatchWorkspace, Samples, rnea_batch};
use sgpr_core::identification::{
    BaseParameters, Consistency, Distance, LeastSquares, Method, Observation, ParameterSet, Prior,
};

fn main() {
    divan::main();
}

#[divan::bench(args = ["puma560", "panda_like"])]
fn identify_6006_samples(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, 6006);
    let set = ParameterSet::new(&fixture.robot, &["viscous_friction", "coulomb_friction"])
        .expect("known effects");
    let base = BaseParameters::new(&fixture.robot, &set);
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    let nominal = vec![0.0; base.rank()];
    bencher.bench_local(|| {
        let mut observation = Observation::new(&fixture.robot, &set, &base);
        observation.add_samples(samples, &fixture.tau, None).expect("finite data");
        let factors = observation.factors();
        black_box(
            LeastSquares::new(Method::Wls).solve(&factors, &base, &nominal).expect("enough data"),
        )
    });
}

#[divan::bench(args = ["puma560", "panda_like"])]
fn observe_6006_samples(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, 6006);
    let set = ParameterSet::new(&fixture.robot, &["viscous_friction", "coulomb_friction"])
        .expect("known effects");
    let base = BaseParameters::new(&fixture.robot, &set);
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    bencher.bench_local(|| {
        let mut observation = Observation::new(&fixture.robot, &set, &base);
        observation.add_samples(samples, &fixture.tau, None).expect("finite data");
        black_box(observation.factors())
    });
}

/// The semidefinite program alone, on noise that pushes links out of the cone of bodies.
#[divan::bench(args = ["entropic", "euclidean"])]
fn consistent_7_links(bencher: Bencher, distance: &str) {
    let mut fixture = Fixture::new("panda_like", 2000);
    let set = ParameterSet::new(
        &fixture.robot,
        &["viscous_friction", "coulomb_friction", "torque_offset"],
    );
    let set = set.expect("known effects");
    let base = BaseParameters::new(&fixture.robot, &set);
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    rnea_batch(&fixture.robot, &mut BatchWorkspace::new(&fixture.robot), samples, &mut fixture.tau);
    let mut noise = Uniform(7);
    let friction = |dq: &f64| dq + dq.signum();
    fixture
        .tau
        .iter_mut()
        .zip(&fixture.dq)
        .for_each(|(tau, dq)| *tau += friction(dq) + 5.0 * noise.next());
    let mut observation = Observation::new(&fixture.robot, &set, &base);
    observation.add_samples(samples, &fixture.tau, None).expect("finite data");
    let mut nominal: Vec<f64> =
        fixture.robot.standard_parameters().iter().map(|value| 1.2 * value).collect();
    nominal.resize(set.len(), 0.0);
    let fit = LeastSquares::new(Method::Wls).solve(
        &observation.factors(),
        &base,
        &base.combine(&nominal),
    );
    let whitened = fit.expect("enough data").whitened;
    let distance = if distance == "entropic" { Distance::Entropic } else { Distance::Euclidean };
    let consistency = Consistency::default().with_prior(Prior::default().with_distance(distance));
    let torque = [20.0; 7];
    bencher.bench_local(|| {
        let found = consistency.solve(&fixture.robot, &set, &base, &whitened, &nominal, &torque);
        black_box(found.expect("an arm"))
    });
}
