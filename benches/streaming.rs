//! Time per call of a predictor for seven joints: without findings, and with five of them, two with
//! a memory. The ratio of both in turn, and the slowest of ten million calls, are what `make soak`
//! prints (`crates/sgpr-predict/tests/endurance.rs`).
#![allow(missing_docs)]

use divan::{Bencher, black_box};
use sgpr_benches::{Fixture, findings, model};
use sgpr_core::model::{Predictor, StreamOptions, Term};

/// States of one measurement; its time is divided by this number.
const STATES: usize = 256;

fn main() {
    divan::main();
}

fn predictor(fixture: &Fixture, findings: Vec<Term>) -> Predictor {
    let options = StreamOptions::default().with_rate_hz(Some(1000.0));
    model(fixture).with_terms(findings, Some(0)).predictor(&options).expect("streams")
}

fn pass(fixture: &Fixture, predictor: &mut Predictor) {
    for (q, dq, ddq, _) in fixture.states() {
        black_box(predictor.torque(q, dq, ddq)[0]);
    }
}

#[divan::bench]
fn predictor_without_findings(bencher: Bencher) {
    let fixture = Fixture::new("panda_like", STATES);
    let mut predictor = predictor(&fixture, vec![]);
    bencher
        .counter(divan::counter::ItemsCount::new(STATES))
        .bench_local(|| pass(&fixture, &mut predictor));
}

#[divan::bench]
fn predictor_with_five_findings(bencher: Bencher) {
    let fixture = Fixture::new("panda_like", STATES);
    let mut predictor = predictor(&fixture, findings());
    bencher
        .counter(divan::counter::ItemsCount::new(STATES))
        .bench_local(|| pass(&fixture, &mut predictor));
}
