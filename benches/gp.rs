//! Gaussian processes: one likelihood with its gradient against the arithmetic floor, and
//! predictions.
//!
//! The floor is n³ floating-point operations (Cholesky n³/3, inverse 2n³/3) at the rate of a matrix
//! product measured in the same run.
#![allow(missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use sgpr_core::gp::{
    Compute, Covariance, Data, GaussianProcess, GpPredictor, Kernel, Likelihood, Precision,
    PredictorOptions, Shape, shared_predictor,
};

fn main() {
    // `cargo bench --bench gp -- predictions` leaves the likelihood out.
    if !std::env::args().any(|argument| argument == "predictions") {
        for (n, d) in [(2002, 6), (6006, 18)] {
            floor(n, d);
        }
    }
    let exact = |n, d| {
        GaussianProcess::fit(data(n, d), covariance(d), &Compute::default()).expect("enough memory")
    };
    let (small, large) = (exact(2002, 6), exact(6006, 18));
    let of_joint = |joint: usize| {
        let scales: Vec<f64> =
            (0..18).map(|m| 1.0 + 0.1 * m as f64 + 0.05 * joint as f64).collect();
        let kernel = Kernel::ard(Shape::SquaredExponential, &scales).scaled(1.0 + joint as f64);
        GaussianProcess::fit(data(6006, 18), Covariance::new(kernel, 0.01), &Compute::default())
            .expect("enough memory")
    };
    let joints: Vec<GaussianProcess> = (0..6).map(of_joint).collect();
    reading::<f64, 16>("reading n²/2 numbers, n = 2002, Double", 2002 * 2002 / 2);
    reading::<f32, 32>("reading n²/2 numbers, n = 2002, Single", 2002 * 2002 / 2);
    reading::<f32, 32>("reading six times 6006 points, d = 18, Single", 6 * 6006 * 18);
    for precision in [Precision::Double, Precision::Single] {
        shared(
            "six kernels over the same points",
            &joints.iter().collect::<Vec<_>>(),
            precision,
            18,
        );
        shared("one kernel for six joints", &[&joints[0]; 6], precision, 18);
        for precision in [(precision, false), (precision, true)] {
            latency("mean of six joints, n = 6006 each, d = 18", &large, precision, Some(0), 6, 18);
            latency("mean, n = 2002, d = 6", &small, precision, Some(0), 1, 6);
            latency("mean and variance, n = 2002, d = 6", &small, precision, None, 1, 6);
            latency(
                "the same from 150 combinations of the measurements",
                &small,
                precision,
                Some(150),
                1,
                6,
            );
            latency(
                "mean and variance, n = 6006, d = 18, from 150 combinations",
                &large,
                precision,
                Some(150),
                1,
                18,
            );
        }
    }
}

/// Means of processes over the same points.
fn shared(what: &str, processes: &[&GaussianProcess], precision: Precision, d: usize) {
    let mut predictor = shared_predictor(processes, precision).expect("the same points");
    let mut x = vec![0.0; d];
    let mut query = |k: usize| {
        x.iter_mut().enumerate().for_each(|(m, x)| *x = (0.37 * (k * d + m) as f64).sin());
        seconds(|| {
            black_box(predictor.means(&x));
        })
    };
    for k in 0..200 {
        query(k);
    }
    let mut times: Vec<f64> = (0..3000).map(query).collect();
    times.sort_by(f64::total_cmp);
    println!(
        "means of six joints, {what}, n = 6006, d = {d}, {precision:?}: least {:.1}, median {:.1}, \
         p99 {:.1} microseconds, error {:.1e}",
        1e6 * times[0],
        1e6 * times[1500],
        1e6 * times[2970],
        predictor.error()
    );
}

/// Median and 99th percentile of one query after the other, each joint with a process of its own.
fn latency(
    what: &str,
    gp: &GaussianProcess,
    (precision, compact): (Precision, bool),
    variance_rank: Option<usize>,
    joints: usize,
    d: usize,
) {
    let options = PredictorOptions::default()
        .with_precision(precision)
        .with_variance_rank(variance_rank)
        .with_compact(compact);
    let mut predictors: Vec<GpPredictor> =
        (0..joints).map(|_| gp.predictor(options).expect("enough memory")).collect();
    let mut x = vec![0.0; d];
    let mut query = |k: usize| {
        x.iter_mut().enumerate().for_each(|(m, x)| *x = (0.37 * (k * d + m) as f64).sin());
        seconds(|| {
            for predictor in &mut predictors {
                if variance_rank == Some(0) {
                    black_box(predictor.mean(&x));
                } else {
                    black_box(predictor.mean_and_variance(&x));
                }
            }
        })
    };
    for k in 0..200 {
        query(k);
    }
    let mut times: Vec<f64> = (0..3000).map(query).collect();
    times.sort_by(f64::total_cmp);
    println!(
        "{what}, {precision:?}{}: least {:.1}, median {:.1}, p99 {:.1} microseconds, error {:.1e}, \
         of the variance {:.1e}",
        if compact { ", compact" } else { "" },
        1e6 * times[0],
        1e6 * times[1500],
        1e6 * times[2970],
        predictors[0].error(),
        predictors[0].variance_error()
    );
}

/// Time to read so many numbers once, as many sums at a time as stay in registers: what a
/// prediction from all of them cannot be much faster than.
fn reading<T: Copy + Default + std::ops::Add<Output = T>, const SUMS: usize>(
    what: &str,
    count: usize,
) {
    let numbers = vec![T::default(); count];
    let mut times: Vec<f64> = (0..1000)
        .map(|_| {
            seconds(|| {
                let mut sums = [T::default(); SUMS];
                for block in numbers.as_chunks::<SUMS>().0 {
                    for (sum, number) in sums.iter_mut().zip(block) {
                        *sum = *sum + *number;
                    }
                }
                black_box(sums);
            })
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{what}: least {:.1}, median {:.1} microseconds", 1e6 * times[0], 1e6 * times[500]);
}

/// Points on a smooth path, as those of a log are, with a smooth function on them.
fn data(n: usize, d: usize) -> Data {
    let x: Vec<f64> = (0..n)
        .flat_map(|i| {
            (0..d).map(move |m| (0.01 * i as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin())
        })
        .collect();
    let y = (0..n).map(|i| (3.0 * x[i * d]).sin() + x[i * d + 1] * x[i * d + 2]);
    let y =
        y.enumerate().map(|(i, y)| y + 0.05 * ((i * 7919 % 1000) as f64 / 500.0 - 1.0)).collect();
    Data::new(x, d, y, 1).expect("finite data")
}

fn covariance(d: usize) -> Covariance {
    let scales: Vec<f64> = (0..d).map(|m| 1.0 + 0.1 * m as f64).collect();
    Covariance::new(Kernel::ard(Shape::SquaredExponential, &scales).scaled(1.0), 0.01)
}

fn seconds(mut work: impl FnMut()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

fn floor(n: usize, d: usize) {
    let size = 2048;
    let a = Mat::from_fn(size, size, |i, j| ((i * 31 + j * 17) % 101) as f64 / 101.0);
    let mut product = Mat::zeros(size, size);
    let mut gemm = || seconds(|| matmul(product.as_mut(), Accum::Replace, &a, &a, 1.0, Par::Seq));
    let data = data(n, d);
    let covariance = covariance(d);
    let mut likelihood = Likelihood::new(&data, &Compute::default()).expect("enough memory");
    let (mut best_gemm, mut best) = (f64::INFINITY, f64::INFINITY);
    // In turns, so that both see the same machine.
    for _ in 0..5 {
        for _ in 0..4 {
            best_gemm = best_gemm.min(gemm());
        }
        best = best.min(seconds(|| {
            black_box(likelihood.value_and_gradient(&covariance).expect("well-conditioned"));
        }));
    }
    let rate = 2.0 * (size as f64).powi(3) / best_gemm;
    let floor = (n as f64).powi(3) / rate;
    println!(
        "likelihood with gradient, n = {n}, d = {d}: {best:.3} s, floor {floor:.3} s at {:.1} \
         GFLOP/s, ratio {:.3}",
        rate * 1e-9,
        best / floor
    );
}
