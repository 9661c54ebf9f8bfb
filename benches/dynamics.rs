//! Time per call of the dynamics, per robot; the batch times are per sample.
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::{Fixture, ROBOTS, State};
use sgpr_core::dynamics::{
    BatchWorkspace, Samples, Workspace, forward_dynamics, mass_matrix, regressor, regressor_batch,
    rnea, rnea_batch,
};
use sgpr_core::robot::Robot;

fn main() {
    divan::main();
}

/// States of one measurement of single calls; its time is divided by this number.
const STATES: usize = 256;
/// Samples of a batch, few enough that the results stay in the second-level cache, as they do when
/// a log is identified.
const BATCH: usize = 128;

/// Time of `call` for every state in turn.
fn bench_states(
    bencher: Bencher,
    robot: &str,
    call: impl Fn(&Robot, &mut Workspace, State<'_>) -> f64,
) {
    let fixture = Fixture::new(robot, STATES);
    let mut ws = Workspace::new(&fixture.robot);
    bencher.counter(divan::counter::ItemsCount::new(STATES)).bench_local(|| {
        for state in fixture.states() {
            black_box(call(&fixture.robot, &mut ws, state));
        }
    });
}

#[divan::bench(args = ROBOTS)]
fn rnea_single(bencher: Bencher, robot: &str) {
    bench_states(bencher, robot, |robot, ws, (q, dq, ddq, _)| rnea(robot, ws, q, dq, ddq)[0]);
}

#[divan::bench(args = ROBOTS)]
fn aba_single(bencher: Bencher, robot: &str) {
    bench_states(bencher, robot, |robot, ws, (q, dq, _, tau)| {
        forward_dynamics(robot, ws, q, dq, tau)[0]
    });
}

#[divan::bench(args = ROBOTS)]
fn crba_single(bencher: Bencher, robot: &str) {
    bench_states(bencher, robot, |robot, ws, (q, ..)| mass_matrix(robot, ws, q)[0]);
}

#[divan::bench(args = ROBOTS)]
fn regressor_single(bencher: Bencher, robot: &str) {
    bench_states(bencher, robot, |robot, ws, (q, dq, ddq, _)| regressor(robot, ws, q, dq, ddq)[0]);
}

#[divan::bench(args = ROBOTS)]
fn rnea_per_batch(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, BATCH);
    let mut ws = BatchWorkspace::new(&fixture.robot);
    let mut tau = vec![0.0; fixture.q.len()];
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    bencher.counter(divan::counter::ItemsCount::new(BATCH)).bench_local(|| {
        rnea_batch(&fixture.robot, &mut ws, black_box(samples), &mut tau);
        black_box(tau[0])
    });
}

#[divan::bench(args = ROBOTS)]
fn regressor_per_batch(bencher: Bencher, robot: &str) {
    let fixture = Fixture::new(robot, BATCH);
    let n = fixture.robot.dof();
    let mut ws = BatchWorkspace::new(&fixture.robot);
    let mut matrix = vec![0.0; BATCH * n * 10 * n];
    let samples = Samples { q: &fixture.q, dq: &fixture.dq, ddq: &fixture.ddq };
    bencher.counter(divan::counter::ItemsCount::new(BATCH)).bench_local(|| {
        regressor_batch(&fixture.robot, &mut ws, black_box(samples), &mut matrix);
        black_box(matrix[0])
    });
}
