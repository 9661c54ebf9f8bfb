//! A log of a million samples through the normal way of identifying: time, memory above the data,
//! estimates against the truth.
//!
//! `cargo run --release --package benches --bin million [SAMPLES]`

use std::time::Instant;

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, Par};
use sgpr_benches::{Fixture, Uniform};
use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{BaseParameters, ParameterSet};
use sgpr_core::model::{IdentifyOptions, TorqueModel, identify};
use sgpr_core::recording::Recording;
use sgpr_core::robot::Robot;

const RATE_HZ: f64 = 1000.0;

/// Standard deviation of the torque noise, as a share of the root mean square torque of the joint.
const NOISE: f64 = 0.02;

fn main() {
    let samples = std::env::args()
        .nth(1)
        .map_or(1_000_000, |text| text.parse().expect("a number of samples"));
    let robot = Fixture::new("panda_like", 0).robot;
    let options = IdentifyOptions::default();
    let truth = truth(&robot, &options.effects);
    let recordings = [simulate(&truth, samples)];
    let data = memory("VmRSS");
    let above = (memory("VmHWM") - data).max(0.0);
    println!(
        "data: {samples} samples of {} joints, {data:.0} MB with the program (at most {above:.0} \
         MB more so far)",
        robot.dof()
    );

    let start = Instant::now();
    let (model, report) = identify(&robot, &recordings, &options, &()).expect("a good log");
    let seconds = start.elapsed().as_secs_f64();
    let peak = memory("VmHWM");

    let fit = model.fit().expect("identified");
    let processing = model.processing().expect("identified");
    println!(
        "identified {} base parameters of {} in {seconds:.2} s; memory above the data: {:.0} MB",
        fit.values.len(),
        model.parameters().len(),
        peak - data
    );
    println!(
        "position filtered at {:.1} Hz, every {}th row taken",
        processing.cutoff_hz, processing.decimation
    );
    report.warnings.iter().for_each(|warning| println!("warning: {warning}"));

    // Rows of joint j times its columns squared: multiplications and additions of the lower
    // triangle of the Gram matrix, and as many again for the rows times the inverse of the first
    // factor.
    let widths = widths(&model);
    let gram: f64 = fit
        .rows
        .iter()
        .zip(&widths)
        .map(|(rows, width)| *rows as f64 * (width * width) as f64)
        .sum();
    let all: f64 = widths.iter().map(|width| samples as f64 * (width * width) as f64).sum();
    println!("columns per joint, torque included: {widths:?}; rows {:?}", fit.rows);
    println!(
        "rows x columns^2: {:.2} GFLOP of the rows taken, {:.2} GFLOP of all samples",
        gram * 1e-9,
        all * 1e-9
    );
    println!(
        "rate: {:.2} GFLOP/s of all samples; faer's symmetric product: {:.1} GFLOP/s",
        all * 1e-9 / seconds,
        peak_rate(&widths)
    );

    let expected = model.base().combine(truth.parameters());
    let deviations = fit.values.iter().zip(&expected).zip(&fit.standard_deviations);
    let normalised: Vec<f64> =
        deviations.map(|((found, expected), std)| (found - expected) / std).collect();
    let square = normalised.iter().map(|d| d * d).sum::<f64>() / normalised.len() as f64;
    let largest = normalised.iter().fold(0.0f64, |largest, d| largest.max(d.abs()));
    println!(
        "errors in their standard deviations: {:.2} root mean square, {largest:.2} at most",
        square.sqrt()
    );
    assert!(square.sqrt() < 2.0 && largest < 6.0, "the truth is missed");
}

/// Memory of this process that is in use, MB; zero where the system does not tell.
fn memory(entry: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix(entry)?.strip_prefix(':')?.strip_suffix("kB"));
    line.and_then(|text| text.trim().parse::<f64>().ok()).unwrap_or(0.0) * 1024e-6
}

/// The robot with friction, rotors and offsets.
fn truth(robot: &Robot, effects: &[String]) -> TorqueModel {
    let set = ParameterSet::new(robot, effects).expect("known effects");
    let mut parameters = robot.standard_parameters();
    parameters.extend(set.effect_columns().iter().map(|column| {
        match set.effects()[column.effect].name() {
            "viscous_friction" => 3.0 - 0.3 * column.joint as f64,
            "coulomb_friction" => 2.0 - 0.2 * column.joint as f64,
            "rotor_inertia" => 0.6 - 0.07 * column.joint as f64,
            _ => 0.1 * (column.joint as f64 - 3.0),
        }
    }));
    TorqueModel::with_parameters(robot, effects, parameters).expect("known effects")
}

/// All joints on sums of ten sines below 1.5 Hz, the torque with white noise.
fn simulate(truth: &TorqueModel, samples: usize) -> Recording {
    let n = truth.robot().dof();
    let mut random = Uniform(7);
    let mut sines = || {
        (0..10)
            .map(|h| (0.14 * f64::from(h + 1), 3.0 * random.next(), 0.2 * random.next()))
            .collect()
    };
    let sines: Vec<Vec<(f64, f64, f64)>> = (0..n).map(|_| sines()).collect();
    let mut q = Vec::with_capacity(samples * n);
    let mut tau = Vec::with_capacity(samples * n);
    for first in (0..samples).step_by(10_000) {
        let (mut dq, mut ddq) = (vec![], vec![]);
        for k in first..(first + 10_000).min(samples) {
            let t = k as f64 / RATE_HZ;
            for joint in &sines {
                let mut state = [0.0; 3];
                for (hz, phase, amplitude) in joint {
                    let w = std::f64::consts::TAU * hz;
                    let (sin, cos) = (w * t + phase).sin_cos();
                    state[0] += amplitude * sin;
                    state[1] += amplitude * w * cos;
                    state[2] -= amplitude * w * w * sin;
                }
                q.push(state[0]);
                dq.push(state[1]);
                ddq.push(state[2]);
            }
        }
        tau.extend(truth.predict(Samples { q: &q[first * n..], dq: &dq, ddq: &ddq }));
    }
    for joint in 0..n {
        let square: f64 = tau.iter().skip(joint).step_by(n).map(|tau| tau * tau).sum();
        let level = NOISE * (square / samples as f64).sqrt();
        // The sum of twelve uniform numbers is as good as normal here; each has the variance 1/3 on
        // [-1, 1).
        let mut normal = || (0..12).map(|_| random.next()).sum::<f64>() / 2.0;
        tau.iter_mut().skip(joint).step_by(n).for_each(|tau| *tau += level * normal());
    }
    let names = truth.robot().joint_names().map(String::from).collect();
    let time = (0..samples as i64).map(|k| k * 1_000_000).collect();
    Recording::new("a million samples", names, time, q, None, Some(tau), vec![])
        .expect("arrays of one length")
}

/// Columns in the rows of each joint, the torque included.
fn widths(model: &TorqueModel) -> Vec<usize> {
    let (robot, set): (_, &ParameterSet) = (model.robot(), model.parameter_set());
    let base: &BaseParameters = model.base();
    let stands_at = |joint: usize, parameter: usize| match parameter.checked_sub(set.inertial()) {
        None => robot.carries(joint, parameter / 10),
        Some(effect) => set.effect_columns()[effect].joint == joint,
    };
    (0..robot.dof())
        .map(|joint| {
            1 + base.independent().iter().filter(|parameter| stands_at(joint, **parameter)).count()
        })
        .collect()
}

/// GFLOP/s of W'W on blocks as the identification has them, on one core: columns squared times
/// rows.
fn peak_rate(widths: &[usize]) -> f64 {
    let (rows, columns) = (512, widths[0]);
    let block = Mat::from_fn(rows, columns, |i, j| ((i * 7 + j * 13) % 17) as f64);
    let mut gram = Mat::<f64>::zeros(columns, columns);
    let mut best = f64::INFINITY;
    for _ in 0..2000 {
        let start = Instant::now();
        matmul(
            gram.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Add,
            block.transpose(),
            BlockStructure::Rectangular,
            block.as_ref(),
            BlockStructure::Rectangular,
            1e-6,
            Par::Seq,
        );
        best = best.min(start.elapsed().as_secs_f64());
    }
    (rows * columns * columns) as f64 * 1e-9 / best
}
