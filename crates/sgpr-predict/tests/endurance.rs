//! A predictor of seven joints with five findings, two of them with a memory: nanoseconds per call,
//! beside the model without findings; how long the slowest of a thousand calls take; and that
//! millions of calls take no memory.
//!
//! `make soak` makes ten million calls, `make test` a few. It counts for the whole process: no test
//! harness runs beside it. Times are printed and not asserted: other work on the machine is in
//! them.
#![allow(missing_docs)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::f64::consts::FRAC_PI_2;
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use sgpr_predict::effects::{Site, by_name};
use sgpr_predict::model::{StreamedModel, Term};
use sgpr_predict::robot::{DhConvention, DhRow, Robot, STANDARD_GRAVITY};
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
const JOINTS: usize = 7;
/// Samples of a motion, which is then begun again.
const SAMPLES: usize = 8192;
/// Calls of one measurement; its time is divided by this number.
const BATCH: usize = 256;

type Sample = [[f64; JOINTS]; 3];

/// An arm like a Franka Panda: its table of joints, bodies of about its masses.
fn arm() -> Robot {
    let body = |a, alpha, d, mass: f64, centre: [f64; 3]| {
        let inertia =
            [[0.02 * mass, 0.001, 0.0], [0.001, 0.025 * mass, 0.0], [0.0, 0.0, 0.01 * mass]];
        DhRow::revolute(a, alpha, d, 0.0).with_body(mass, centre, inertia)
    };
    let rows = [
        body(0.0, 0.0, 0.333, 4.9, [0.0, -0.03, -0.1]),
        body(0.0, -FRAC_PI_2, 0.0, 0.65, [0.0, -0.07, 0.03]),
        body(0.0, FRAC_PI_2, 0.316, 3.2, [0.03, 0.04, -0.07]),
        body(0.0825, FRAC_PI_2, 0.0, 3.6, [-0.05, 0.1, 0.03]),
        body(-0.0825, -FRAC_PI_2, 0.384, 1.2, [-0.01, 0.04, -0.04]),
        body(0.0, FRAC_PI_2, 0.0, 1.7, [0.06, -0.01, -0.01]),
        body(0.088, FRAC_PI_2, 0.107, 0.7, [0.01, 0.0, 0.06]),
    ];
    Robot::from_dh("arm", DhConvention::Modified, &rows, None, STANDARD_GRAVITY)
        .expect("a valid table")
}

fn findings() -> Vec<Term> {
    let all = [
        ("presliding_friction", 1, vec![0.01]),
        ("cable_hysteresis", 4, vec![0.1]),
        ("stribeck_friction", 2, vec![0.1]),
        ("torque_ripple", 0, vec![12.0]),
        ("load_dependent_friction", 3, vec![]),
    ];
    let term = |(name, joint, constants): (&str, usize, Vec<f64>)| {
        let mut term =
            Term::new(by_name(name).expect("of the library"), Site::Joint(joint), constants);
        term.coefficients.fill(0.2);
        term
    };
    all.into_iter().map(term).collect()
}

fn predictor(findings: Vec<Term>) -> Predictor {
    let robot = arm();
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..effects.len() * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let model = StreamedModel::with_parameters(&robot, &effects, parameters)
        .expect("known")
        .with_terms(findings);
    model.predictor(&StreamOptions::default().with_rate_hz(Some(RATE_HZ))).expect("streams")
}

fn motion() -> Vec<Sample> {
    let sample = |k: usize| {
        let mut sample = [[0.0; JOINTS]; 3];
        for joint in 0..JOINTS {
            let rate = 1.0 + 0.3 * joint as f64;
            let (sine, cosine) = (rate * k as f64 / RATE_HZ).sin_cos();
            [sample[0][joint], sample[1][joint], sample[2][joint]] =
                [sine, rate * cosine, -rate * rate * sine];
        }
        sample
    };
    (0..SAMPLES).map(sample).collect()
}

/// Nanoseconds per call with findings, and the ratio to those without, both in turn so that
/// whatever else the machine does befalls both; medians of many rounds.
fn with_and_without(motion: &[Sample], rounds: usize) -> [f64; 2] {
    let mut both = [findings(), vec![]].map(predictor);
    let mut times: Vec<[f64; 2]> = (0..rounds)
        .map(|round| {
            let batch = &motion[round * BATCH % (SAMPLES - BATCH)..][..BATCH];
            both.each_mut().map(|predictor| {
                let start = Instant::now();
                batch.iter().for_each(|[q, dq, ddq]| {
                    black_box(predictor.torque(q, dq, ddq)[0]);
                });
                start.elapsed().as_secs_f64() * 1e9 / BATCH as f64
            })
        })
        .collect();
    let mut median = |key: fn(&[f64; 2]) -> f64| {
        times.sort_by(|a, b| key(a).total_cmp(&key(b)));
        key(&times[rounds / 2])
    };
    [median(|[with, _]| *with), median(|[with, without]| with / without)]
}

/// Number of calls that took so many nanoseconds; the last of them also what took longer.
struct Times(Vec<usize>);

impl Times {
    /// In memory that is there from the start, as the system counts it.
    fn new() -> Self {
        let mut counts = vec![1; 100_000];
        counts.fill(0);
        Self(black_box(counts))
    }

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

/// Memory of the process that is not on disk, kB, where the system tells.
fn resident_kb() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status
        .lines()
        .find_map(|line| line.strip_prefix("RssAnon:"))?
        .trim()
        .strip_suffix("kB")?
        .trim()
        .parse()
        .ok()
}

fn load() -> String {
    let words = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let cores = std::thread::available_parallelism().map_or(0, |cores| cores.get());
    format!("load {} on {cores} cores", words.split_whitespace().next().unwrap_or("unknown"))
}

fn main() {
    let calls: usize =
        std::env::var("SGPR_SOAK_CALLS").ok().and_then(|text| text.parse().ok()).unwrap_or(20_000);
    let motion = motion();
    let [nanoseconds, ratio] = with_and_without(&motion, (calls / 10_000).clamp(20, 1000));
    println!(
        "seven joints, five findings: {nanoseconds:.0} ns a call, {ratio:.2} times the model \
         without ({})",
        load()
    );

    let mut predictor = predictor(findings());
    let mut times = Times::new();
    let mut sum = 0.0;
    // What is read for the first time is there.
    let resident = resident_kb().map(|_| resident_kb());
    let before = MEMORY.0.load(Ordering::Relaxed);
    for [q, dq, ddq] in motion.iter().cycle().take(calls) {
        let start = Instant::now();
        sum += black_box(predictor.torque(q, dq, ddq))[0];
        times.count(start.elapsed().as_nanos());
    }
    let allocations = MEMORY.0.load(Ordering::Relaxed) - before;
    let grown = resident.flatten().and_then(|before| Some(resident_kb()?.saturating_sub(before)));
    assert!(sum.is_finite());
    assert_eq!(allocations, 0, "{calls} calls of a predictor");
    assert!(
        grown.is_none_or(|grown| grown <= 64),
        "{calls} calls of a predictor: {grown:?} kB more"
    );
    let [median, tail] = [0.5, 0.999].map(|share| times.quantile(share));
    println!(
        "endurance: {calls} calls without an allocation, {} kB more; with a look at the clock \
         median {median} ns, 99.9 % within {tail} ns, {:.1} times as long",
        grown.map_or("unknown".into(), |grown| grown.to_string()),
        tail as f64 / median.max(1) as f64
    );
}
