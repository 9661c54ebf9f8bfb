//! Millions of calls of a predictor with findings: not one allocation, and how long the slowest of a thousand calls take.
//!
//! `make soak` makes ten million calls, `make test` a few. It counts for the whole process: no test harness runs beside it.
#![allow(missing_docs)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use sgpr_predict::effects::{Site, by_name};
use sgpr_predict::model::{StreamedModel, Term};
use sgpr_predict::robot::puma560;
use sgpr_predict::stream::{Predictor, StreamOptions};

/// The system's memory, with the number of times that it was asked for some.
struct Counted(AtomicUsize);

// SAFETY: the system's allocator does all.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.0.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller says.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller says.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static MEMORY: Counted = Counted(AtomicUsize::new(0));

const RATE_HZ: f64 = 1000.0;

fn predictor() -> Predictor {
    let robot = puma560();
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..3 * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let terms = [
        ("presliding_friction", Site::Joint(1), vec![0.01]),
        ("cable_hysteresis", Site::Joint(4), vec![0.1]),
        ("stribeck_friction", Site::Joint(2), vec![0.1]),
        ("torque_ripple", Site::Joint(0), vec![12.0]),
        ("load_dependent_friction", Site::Joint(3), vec![]),
    ];
    let terms = terms.map(|(name, site, constants)| {
        let mut term = Term::new(by_name(name).expect("of the library"), site, constants);
        term.coefficients.fill(0.2);
        term
    });
    let model = StreamedModel::with_parameters(&robot, &effects, parameters).expect("known").with_terms(terms.into());
    model.predictor(&StreamOptions { rate_hz: Some(RATE_HZ), ..StreamOptions::default() }).expect("streams")
}

/// Number of calls that took so many nanoseconds; the last of them also what took longer.
struct Times(Vec<usize>);

impl Times {
    fn count(&mut self, nanoseconds: u128) {
        let last = self.0.len() - 1;
        self.0[usize::try_from(nanoseconds).unwrap_or(last).min(last)] += 1;
    }

    /// Nanoseconds within which this share of the calls was done.
    fn quantile(&self, share: f64) -> usize {
        let wanted = (share * self.0.iter().sum::<usize>() as f64) as usize;
        let mut done = 0;
        let reached = |count: &usize| {
            done += count;
            done > wanted
        };
        self.0.iter().position(reached).unwrap_or(self.0.len() - 1)
    }
}

fn main() {
    let calls: usize = std::env::var("SGPR_SOAK_CALLS").ok().and_then(|text| text.parse().ok()).unwrap_or(20_000);
    let mut predictor = predictor();
    let (mut q, mut dq, mut ddq) = ([0.0; 6], [0.0; 6], [0.0; 6]);
    let mut times = Times(vec![0; 100_000]);
    let mut sum = 0.0;
    let before = MEMORY.0.load(Ordering::Relaxed);
    for call in 0..calls {
        let time = call as f64 / RATE_HZ;
        for joint in 0..6 {
            let rate = 1.0 + 0.3 * joint as f64;
            let (sine, cosine) = (rate * time).sin_cos();
            (q[joint], dq[joint], ddq[joint]) = (sine, rate * cosine, -rate * rate * sine);
        }
        let start = Instant::now();
        sum += black_box(predictor.torque(&q, &dq, &ddq))[0];
        times.count(start.elapsed().as_nanos());
    }
    let allocations = MEMORY.0.load(Ordering::Relaxed) - before;
    assert!(sum.is_finite());
    assert_eq!(allocations, 0, "{calls} calls of a predictor");
    let [median, tail] = [0.5, 0.999].map(|share| times.quantile(share));
    println!(
        "endurance: {calls} calls without an allocation; median {median} ns, 99.9 % within {tail} ns, {:.1} times as long",
        tail as f64 / median.max(1) as f64
    );
}
