//! Gaussian processes: one likelihood with its gradient against the arithmetic floor, and predictions.
//!
//! The floor is n³ floating-point operations (Cholesky n³/3, inverse 2n³/3) at the rate of a matrix product measured in
//! the same run.
#![allow(missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use sgpr_core::gp::{Compute, Covariance, Data, Kernel, Likelihood, Shape};

fn main() {
    for (n, d) in [(2002, 6), (6006, 18)] {
        floor(n, d);
    }
}

/// Points on a smooth path, as those of a log are, with a smooth function on them.
fn data(n: usize, d: usize) -> Data {
    let x: Vec<f64> = (0..n)
        .flat_map(|i| (0..d).map(move |m| (0.01 * i as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin()))
        .collect();
    let y = (0..n).map(|i| (3.0 * x[i * d]).sin() + x[i * d + 1] * x[i * d + 2]);
    let y = y.enumerate().map(|(i, y)| y + 0.05 * ((i * 7919 % 1000) as f64 / 500.0 - 1.0)).collect();
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
        "likelihood with gradient, n = {n}, d = {d}: {best:.3} s, floor {floor:.3} s at {:.1} GFLOP/s, ratio {:.3}",
        rate * 1e-9,
        best / floor
    );
}
