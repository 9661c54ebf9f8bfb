//! Time per call of a predictor for seven joints: without findings, and with five of them, two with a memory.
#![allow(missing_docs)]

use std::time::Instant;

use divan::{Bencher, black_box};
use sgpr_benches::{Fixture, findings, model};
use sgpr_core::model::{Predictor, StreamOptions, Term};

/// States of one measurement; its time is divided by this number.
const STATES: usize = 256;

/// Calls of each kind in turn, for the ratio.
const ROUNDS: usize = 400;

fn main() {
    divan::main();
    ratio();
}

fn predictor(fixture: &Fixture, findings: Vec<Term>) -> Predictor {
    let options = StreamOptions { rate_hz: Some(1000.0), ..StreamOptions::default() };
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
    bencher.counter(divan::counter::ItemsCount::new(STATES)).bench_local(|| pass(&fixture, &mut predictor));
}

#[divan::bench]
fn predictor_with_five_findings(bencher: Bencher) {
    let fixture = Fixture::new("panda_like", STATES);
    let mut predictor = predictor(&fixture, findings());
    bencher.counter(divan::counter::ItemsCount::new(STATES)).bench_local(|| pass(&fixture, &mut predictor));
}

/// Both in turn, so that whatever else the machine does befalls both; the median of the ratios.
fn ratio() {
    let fixture = Fixture::new("panda_like", STATES);
    let mut both = [vec![], findings()].map(|findings| predictor(&fixture, findings));
    let mut of_round = || {
        let [without, with] = both.each_mut().map(|predictor| {
            let start = Instant::now();
            pass(&fixture, predictor);
            start.elapsed().as_secs_f64() / STATES as f64
        });
        (with / without, with)
    };
    let mut rounds: Vec<(f64, f64)> = (0..ROUNDS).map(|_| of_round()).collect();
    rounds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, seconds) = rounds[ROUNDS / 2];
    println!("five findings: {ratio:.2} times the model without, {:.2} microseconds per call", 1e6 * seconds);
}
