//! What `run.py` compares with the peers: one line `name value` per measurement, nanoseconds,
//! fastest of many batches.
//!
//! Usage: `peers ROBOT.urdf` for the dynamics; `peers ROBOT.urdf SAMPLES` with a file of
//! little-endian numbers, per sample q, dq, ddq, tau, for a whole identification.

use std::hint::black_box;
use std::time::Instant;

use sgpr_benches::{Fixture, State};
use sgpr_core::dynamics::{
    BatchWorkspace, Samples, Workspace, forward_dynamics, mass_matrix, regressor, regressor_batch,
    rnea, rnea_batch,
};
use sgpr_core::identification::{
    BaseParameters, Estimate, LeastSquares, Method, Observation, ParameterSet,
};
use sgpr_core::robot::{Robot, UrdfOptions};

const STATES: usize = 256;
const BATCHES: usize = 400;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let urdf = arguments.next().expect("a robot file");
    let robot = Robot::from_urdf(urdf, &UrdfOptions::default()).expect("a valid robot");
    match arguments.next() {
        None => dynamics(robot),
        Some(samples) => identification(&robot, &samples),
    }
}

/// Fastest of `batches` runs of `work`, ns, per one of its `count` calls.
fn fastest(batches: usize, count: usize, mut work: impl FnMut()) -> f64 {
    let run = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_nanos() as f64 / count as f64
    };
    (0..batches).map(run).fold(f64::INFINITY, f64::min)
}

fn dynamics(robot: Robot) {
    let fixture = Fixture::of(robot, STATES);
    let robot = &fixture.robot;
    let mut ws = Workspace::new(robot);
    let mut single = |name: &str, call: &dyn Fn(&mut Workspace, State<'_>) -> f64| {
        let time = fastest(BATCHES, STATES, || {
            for state in fixture.states() {
                black_box(call(&mut ws, state));
            }
        });
        println!("{name} {time:.1}");
    };
    single("rnea", &|ws, (q, dq, ddq, _)| rnea(robot, ws, q, dq, ddq)[0]);
    single("aba", &|ws, (q, dq, _, tau)| forward_dynamics(robot, ws, q, dq, tau)[0]);
    single("crba", &|ws, (q, ..)| mass_matrix(robot, ws, q)[0]);
    single("regressor", &|ws, (q, dq, ddq, _)| regressor(robot, ws, q, dq, ddq)[0]);

    let n = robot.dof();
    let mut batch = BatchWorkspace::new(robot);
    let (rows, mut tau) = (STATES * n, vec![0.0; STATES * n]);
    let samples =
        Samples { q: &fixture.q[..rows], dq: &fixture.dq[..rows], ddq: &fixture.ddq[..rows] };
    let time = fastest(BATCHES, STATES, || {
        rnea_batch(robot, &mut batch, black_box(samples), &mut tau);
        black_box(tau[0]);
    });
    println!("rnea_batch {time:.1}");

    // One matrix that stays in the second-level cache, one for the cache that cores share, one
    // beyond it.
    for (name, megabytes) in
        [("regressor_batch_1MB", 1), ("regressor_batch_16MB", 16), ("regressor_batch_1GB", 1024)]
    {
        let count = (megabytes << 20) / (n * n * 10 * size_of::<f64>());
        let fixture = Fixture::of(robot.clone(), count);
        let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
        let mut matrix = vec![1.0; count * n * n * 10];
        let time = fastest((BATCHES / megabytes).max(5), count, || {
            regressor_batch(robot, &mut batch, black_box(samples), &mut matrix);
            black_box(matrix[0]);
        });
        println!("{name} {time:.1}");
        // What it takes to fill as much memory with zeros.
        let time = fastest((BATCHES / megabytes).max(5), count, || {
            matrix.fill(0.0);
            black_box(matrix[0]);
        });
        println!("{name}_fill {time:.1}");
    }
}

fn identification(robot: &Robot, path: &str) {
    let bytes = std::fs::read(path).expect("a file of samples");
    let numbers: Vec<f64> =
        bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let n = robot.dof();
    let column = |index: usize| -> Vec<f64> {
        numbers.chunks_exact(4 * n).flat_map(|row| row[index * n..][..n].to_vec()).collect()
    };
    let (q, dq, ddq, tau) = (column(0), column(1), column(2), column(3));
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let mut estimate: Option<Estimate> = None;
    let time = fastest(30, 1, || {
        let set = ParameterSet::new(robot, &["viscous_friction", "coulomb_friction"])
            .expect("known effects");
        let base = BaseParameters::new(robot, &set);
        let mut observation = Observation::new(robot, &set, &base);
        observation.add_samples(samples, &tau, None).expect("finite data");
        let nominal = vec![0.0; base.rank()];
        estimate = Some(
            LeastSquares::new(Method::Wls)
                .solve(&observation.factors(), &base, &nominal)
                .expect("enough"),
        );
    });
    println!("identification {time:.0}");
    let estimate = estimate.expect("just made");
    println!("rank {}", estimate.values.len());
    for (joint, noise) in estimate.noise.iter().enumerate() {
        println!("noise_{joint} {noise:.12e}");
    }
}
