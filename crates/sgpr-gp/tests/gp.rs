//! Gaussian processes against scikit-learn, SciPy and finite differences (`data/reference/gp`).
#![allow(missing_docs)]

#[path = "../../sgpr-core/tests/common/difference.rs"]
mod difference;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use difference::largest_difference;
use sgpr_gp::progress::{Interrupted, Progress};
use sgpr_gp::{
    Compute, Covariance, Data, GaussianProcess, GpError, Kernel, Likelihood, Precision,
    PredictorOptions, SearchOptions, SearchStatus, Shape, SparseBound, SparseGaussianProcess,
    SparseOptions, informative_points, search, search_sparse, shared_predictor,
};

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data").join(path)
}

pub fn reference() -> serde_json::Value {
    let text = std::fs::read_to_string(data("reference/gp/reference.json")).expect("bundled");
    serde_json::from_str(&text).expect("valid JSON")
}

pub fn numbers(value: &serde_json::Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).expect("numbers")
}

/// The kernel of a case, and where its theta stands in scikit-learn's.
fn case(name: &str) -> (Kernel, Vec<usize>) {
    let shape = |name: &str| match name {
        name if name.starts_with("squared") => Shape::SquaredExponential,
        name if name.starts_with("exponential") => Shape::Exponential,
        name if name.starts_with("matern32") => Shape::Matern32,
        name if name.starts_with("matern52") => Shape::Matern52,
        _ => Shape::RationalQuadratic { mixture: 0.6 },
    };
    let ard = |shape| Kernel::ard(shape, &[0.7, 1.3, 4.0]);
    match name {
        "sum" => {
            let second = Kernel::isotropic(Shape::Matern32, 3, 2.0).scaled(0.4);
            (ard(Shape::SquaredExponential).scaled(1.7).plus(second), (0..6).collect())
        }
        "product" => {
            let second = Kernel::isotropic(Shape::Matern52, 3, 2.0);
            (ard(Shape::SquaredExponential).scaled(1.7).times(second), (0..5).collect())
        }
        name if name.ends_with("ard") => (ard(shape(name)).scaled(1.7), (0..4).collect()),
        "rational_quadratic_isotropic" => {
            (Kernel::isotropic(shape(name), 3, 0.9).scaled(1.7), vec![0, 2, 1])
        }
        name => (Kernel::isotropic(shape(name), 3, 0.9).scaled(1.7), vec![0, 1]),
    }
}

pub fn reference_data(reference: &serde_json::Value) -> Data {
    Data::new(numbers(&reference["x"]), 3, numbers(&reference["y"]), 1).expect("good data")
}

#[test]
fn likelihood_gradient_and_predictions_are_those_of_scikit_learn() {
    let reference = reference();
    let (data, noise) =
        (reference_data(&reference), reference["noise"].as_f64().expect("a number"));
    for (name, expected) in reference["cases"].as_object().expect("cases") {
        let (kernel, order) = case(name);
        let theta = numbers(&expected["theta"]);
        let theta: Vec<f64> = order.iter().map(|k| theta[*k]).collect();
        assert!(largest_difference(&kernel.theta(), &theta) < 1e-14, "{name}");
        let covariance = Covariance::new(kernel, noise);
        let mut likelihood = Likelihood::new(&data, &Compute::default()).expect("small");
        let (value, gradient) =
            likelihood.value_and_gradient(&covariance).expect("well-conditioned");
        let scale = 1.0 + expected["log_marginal_likelihood"].as_f64().expect("a number").abs();
        assert!(
            (value - expected["log_marginal_likelihood"].as_f64().expect("a number")).abs()
                < 1e-10 * scale,
            "{name}"
        );
        let expected_gradient = numbers(&expected["gradient"]);
        for (k, position) in order.iter().enumerate() {
            assert!(
                (gradient[k] - expected_gradient[*position]).abs() < 1e-9 * scale,
                "{name} {k}: {gradient:?}"
            );
        }
        let gp = GaussianProcess::fit(data.clone(), covariance, &Compute::default())
            .expect("well-conditioned");
        assert_eq!(gp.jitter(), 0.0);
        let prediction = gp.predict(&numbers(&reference["x_new"]), true).expect("good points");
        assert!(
            largest_difference(&prediction.mean, &numbers(&expected["mean"])) < 1e-10,
            "{name}"
        );
        assert!(
            largest_difference(&prediction.variance, &numbers(&expected["variance"])) < 1e-10,
            "{name}"
        );
    }
}

/// A kernel with everything in it.
fn rich_kernel() -> Kernel {
    let angles = Kernel::ard(Shape::SquaredExponential, &[0.8, 1.1])
        .on(&[0, 1])
        .with_period(0, 6.3)
        .scaled(0.7);
    let speeds = Kernel::isotropic(Shape::Matern32, 2, 1.2).on(&[2, 1]);
    let rational = Kernel::ard(Shape::RationalQuadratic { mixture: 0.8 }, &[0.9, 1.4]).on(&[1, 2]);
    let rough = Kernel::isotropic(Shape::Exponential, 1, 2.0).on(&[0]).scaled(0.4);
    let product =
        Kernel::isotropic(Shape::Matern52, 3, 1.9).with_period(2, 5.0).times(rational).scaled(0.3);
    angles.times(speeds).plus(rough).plus(product)
}

/// Beside linear terms, log p is that of the data in directions that the terms cannot reach.
#[test]
fn the_likelihood_beside_linear_terms_is_that_of_what_they_cannot_explain() {
    let reference = reference();
    let data = reference_data(&reference);
    let (n, terms) = (data.len(), 4);
    // The third is the sum of the first two.
    let value = |i: usize, k: usize| {
        let x = &data.x()[3 * i..3 * i + 3];
        [x[0], 200.0 * x[1].cos(), x[0] + 200.0 * x[1].cos(), 1.0][k]
    };
    let h = faer::Mat::from_fn(n, terms, value);
    let covariance = Covariance::new(rich_kernel(), 0.02);
    let mut likelihood = Likelihood::beside(&data, h.as_ref(), &Compute::default()).expect("small");
    let (found, gradient) = likelihood.value_and_gradient(&covariance).expect("well-conditioned");

    // Directions without terms: eigenvectors of the projection on their complement.
    let svd = h.thin_svd().expect("finite");
    let rank = (0..terms).filter(|&k| svd.S()[k] > 1e-9 * svd.S()[0]).count();
    assert_eq!(rank, 3);
    let used = svd.U().subcols(0, rank);
    let projection = faer::Mat::<f64>::identity(n, n) - used * used.transpose();
    let eigen = projection.self_adjoint_eigen(faer::Side::Lower).expect("finite");
    let free = eigen.U().subcols(rank, n - rank);
    let k = faer::Mat::from_fn(n, n, |i, j| {
        let noise = if i == j { covariance.noise_variance } else { 0.0 };
        covariance.signal.value(&data.x()[3 * i..3 * i + 3], &data.x()[3 * j..3 * j + 3]) + noise
    });
    let reduced = free.transpose() * k * free;
    let y = free.transpose() * faer::Mat::from_fn(n, 1, |i, _| data.y()[i]);
    let llt = reduced.llt(faer::Side::Lower).expect("positive definite");
    let fit = (y.transpose() * faer::linalg::solvers::Solve::solve(&llt, &y))[(0, 0)];
    let log_root: f64 = (0..n - rank).map(|i| llt.L()[(i, i)].ln()).sum();
    let expected = -0.5 * fit - log_root - 0.5 * (n - rank) as f64 * std::f64::consts::TAU.ln();
    assert!((found - expected).abs() < 1e-8 * expected.abs(), "{found} {expected}");

    check_gradient(&mut likelihood, &covariance, found, &gradient);
}

/// The gradient of a likelihood is that of finite differences.
fn check_gradient(
    likelihood: &mut Likelihood<'_>,
    covariance: &Covariance,
    value: f64,
    gradient: &[f64],
) {
    let theta = covariance.theta();
    for k in 0..theta.len() {
        let step = 1e-5;
        let mut at = |sign: f64| {
            let mut theta = theta.clone();
            theta[k] += sign * step;
            likelihood.value(&covariance.with_theta(&theta)).expect("well-conditioned")
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * step);
        // Rounding of the value over the step, truncation with its square.
        assert!(
            (gradient[k] - difference).abs() < 1e-6 * (1.0 + value.abs()),
            "{k}: {} {difference}",
            gradient[k]
        );
    }
}

#[test]
fn gradients_are_those_of_finite_differences() {
    let reference = reference();
    let one = reference_data(&reference);
    // Two outputs, a duplicate row, and correlated noise.
    let mut x = one.x()[..150].to_vec();
    x.extend_from_slice(&one.x()[..3]);
    let y = (0..102).map(|k| (0.37 * f64::from(k)).sin()).collect();
    let data = Data::new(x, 3, y, 2).expect("good data");
    let covariance = Covariance::new(rich_kernel(), 0.02)
        .with_correlated_noise(Kernel::isotropic(Shape::Exponential, 1, 0.3).on(&[1]).scaled(0.05));
    let mut likelihood = Likelihood::new(&data, &Compute::default()).expect("small");
    let theta = covariance.theta();
    assert_eq!((theta.len(), covariance.names().len()), (14, 14));
    let (value, gradient) = likelihood.value_and_gradient(&covariance).expect("well-conditioned");
    assert!((value - likelihood.value(&covariance).expect("again")).abs() < 1e-12 * value.abs());
    check_gradient(&mut likelihood, &covariance, value, &gradient);
    let compute = Compute::default().with_threads(2);
    let parallel = Likelihood::new(&data, &compute)
        .expect("small")
        .value_and_gradient(&covariance)
        .expect("same");
    assert!(largest_difference(&gradient, &parallel.1) < 1e-10 * (1.0 + value.abs()));
}

#[test]
fn a_likelihood_in_the_memory_of_another_is_the_same() {
    let data = |n: i32| {
        let x = (0..n).map(|k| (0.71 * f64::from(k)).sin()).collect();
        Data::new(x, 1, (0..n).map(|k| (0.3 * f64::from(k)).cos()).collect(), 1).expect("good data")
    };
    let covariance =
        |scale| Covariance::new(Kernel::isotropic(Shape::Matern52, 1, scale).scaled(1.0), 0.1);
    let compute = Compute::default();
    for first in [40, 70] {
        let before = data(first);
        let mut used = Likelihood::new(&before, &compute).expect("small");
        used.value_and_gradient(&covariance(0.3)).expect("well-conditioned");
        let data = data(70);
        let mut again =
            Likelihood::with_memory(&data, &compute, Some(used.into_memory())).expect("small");
        let expected =
            Likelihood::new(&data, &compute).expect("small").value_and_gradient(&covariance(0.8));
        let expected = expected.expect("well-conditioned");
        assert_eq!(again.value_and_gradient(&covariance(0.8)).expect("well-conditioned"), expected);
    }
}

#[test]
fn plain_and_vectorised_kernels_agree_and_a_period_is_one() {
    let kernel = rich_kernel();
    let data = Data::new(vec![0.3, -0.4, 0.9], 3, vec![1.0], 1).expect("one point");
    let gp = GaussianProcess::fit(data, Covariance::new(kernel.clone(), 0.1), &Compute::default())
        .expect("one point");
    let here = [1.1, 0.2, -0.7];
    let found = gp.predict(&here, true).expect("a point");
    let cross = kernel.value(&here, &[0.3, -0.4, 0.9]);
    assert!((found.mean[0] - cross / (kernel.variance() + 0.1)).abs() < 1e-14);
    assert!(
        (found.variance[0] - kernel.variance() + cross * cross / (kernel.variance() + 0.1)).abs()
            < 1e-14
    );
    let periodic = Kernel::isotropic(Shape::Matern32, 1, 0.5).with_period(0, 2.0);
    assert!((periodic.value(&[0.1], &[0.1 + 6.0]) - 1.0).abs() < 1e-12);
}

#[test]
fn leaving_a_point_out_is_fitting_without_it() {
    let reference = reference();
    let data = reference_data(&reference);
    let covariance = Covariance::new(case("matern52_ard").0, 0.01);
    let gp = GaussianProcess::fit(data.clone(), covariance.clone(), &Compute::default())
        .expect("good data");
    let all = gp.leave_one_out();
    let mut density = 0.0;
    for i in 0..data.len() {
        let others: Vec<usize> = (0..data.len()).filter(|k| *k != i).collect();
        let without =
            GaussianProcess::fit(data.select(&others), covariance.clone(), &Compute::default())
                .expect("good");
        let prediction = without.predict(&data.x()[3 * i..3 * i + 3], true).expect("a point");
        assert!((prediction.mean[0] - all.mean[i]).abs() < 1e-9);
        let variance = prediction.variance[0] + 0.01;
        assert!((variance - all.variance[i]).abs() < 1e-9);
        let error = data.y()[i] - prediction.mean[0];
        density -= 0.5 * ((std::f64::consts::TAU * variance).ln() + error * error / variance);
    }
    assert!((density - all.log_predictive_density).abs() < 1e-7);
}

/// The noise variance within the bounds that the reference was searched in.
fn reference_bounds(covariance: &Covariance) -> Vec<(f64, f64)> {
    let mut bounds = vec![(1e-2f64.ln(), 1e3f64.ln()); covariance.theta().len()];
    bounds[0] = (1e-3f64.ln(), 1e3f64.ln());
    *bounds.last_mut().expect("the noise") = (1e-6f64.ln(), 10f64.ln());
    bounds
}

#[test]
fn the_search_reaches_the_best_of_twenty_starts_of_scipy() {
    let reference = reference();
    let data = reference_data(&reference);
    for (name, expected) in reference["optima"].as_object().expect("optima") {
        let kernel = match name.as_str() {
            "squared_exponential_isotropic" => Kernel::isotropic(Shape::SquaredExponential, 3, 1.0),
            "squared_exponential_ard" => Kernel::ard(Shape::SquaredExponential, &[1.0; 3]),
            _ => Kernel::ard(Shape::Matern52, &[1.0; 3]),
        };
        let start = Covariance::new(kernel.scaled(1.0), 1e-2);
        let bounds = reference_bounds(&start);
        let options = SearchOptions::default().with_bounds(Some(bounds.clone())).with_subset(50);
        let found = search(&data, &start, &options, &Compute::default(), &()).expect("good data");
        let value = expected["log_marginal_likelihood"].as_f64().expect("a number");
        assert!((found.log_marginal_likelihood - value).abs() < 1e-3, "{name}: {found:?}, {value}");
        assert_eq!((found.status, found.starts.len()), (SearchStatus::Converged, 3), "{name}");

        // Stationary, or pressed against a bound, which is named.
        let mut likelihood = Likelihood::new(&data, &Compute::default()).expect("small");
        let (again, gradient) =
            likelihood.value_and_gradient(&found.covariance).expect("an optimum");
        assert!((again - found.log_marginal_likelihood).abs() < 1e-9);
        for (k, theta) in found.covariance.theta().iter().enumerate() {
            let (low, high) = bounds[k];
            let bound = (theta - low).abs() < 1e-6 || (theta - high).abs() < 1e-6;
            let outward = if (theta - low).abs() < 1e-6 { -gradient[k] } else { gradient[k] };
            assert!(
                if bound { outward > -1e-3 } else { gradient[k].abs() < 1e-2 },
                "{name} {k}: {gradient:?}"
            );
            assert_eq!(bound, found.at_bounds.contains(&found.covariance.names()[k]), "{name} {k}");
        }
    }
}

/// Asks to stop after some steps.
struct StopAfter(AtomicUsize);

impl Progress for StopAfter {
    fn step(&self, _: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        let left = self.0.load(Ordering::Relaxed);
        self.0.store(left.saturating_sub(1), Ordering::Relaxed);
        if left == 0 { Err(Interrupted) } else { Ok(()) }
    }
}

#[test]
fn a_stopped_search_keeps_the_best_so_far_and_a_prior_keeps_the_noise_up() {
    let reference = reference();
    let data = reference_data(&reference);
    let start =
        Covariance::new(Kernel::ard(Shape::SquaredExponential, &[1.0; 3]).scaled(1.0), 1e-2);
    let before = Likelihood::new(&data, &Compute::default())
        .expect("small")
        .value(&start)
        .expect("good start");
    let options = SearchOptions::default().with_starts(1);
    let stop = StopAfter(AtomicUsize::new(6));
    let stopped =
        search(&data, &start, &options, &Compute::default(), &stop).expect("seven evaluations");
    assert_eq!((stopped.status, stopped.evaluations), (SearchStatus::Stopped, 8));
    assert!(stopped.log_marginal_likelihood > before);

    // Interpolation of noise-free data: the likelihood wants no noise at all, the prior does.
    let x: Vec<f64> = (0..25).map(|k| 0.2 * f64::from(k)).collect();
    let smooth =
        Data::new(x.clone(), 1, x.iter().map(|x| x.sin()).collect(), 1).expect("good data");
    let start =
        Covariance::new(Kernel::isotropic(Shape::SquaredExponential, 1, 1.0).scaled(1.0), 1e-3);
    let free = search(&smooth, &start, &options, &Compute::default(), &()).expect("good data");
    let priors = vec![None, None, Some((1e-3f64.ln(), 0.5))];
    let held = search(&smooth, &start, &options.with_priors(priors), &Compute::default(), &())
        .expect("good data");
    assert!(free.covariance.noise_variance < 1e-6, "{free:?}");
    assert!(held.covariance.noise_variance > 1e-5, "{held:?}");
}

/// The same kernel twice: with everything that a derivative by a location has to pass.
fn sparse_case() -> (Data, Covariance, Vec<f64>) {
    let reference = reference();
    let one = reference_data(&reference);
    let y = (0..2 * one.len()).map(|k| (0.37 * k as f64).sin()).collect();
    let data = Data::new(one.x().to_vec(), 3, y, 2).expect("good data");
    let inducing = data.select(&[3, 8, 15, 22, 40, 41, 60]).x().iter().map(|x| x + 0.05).collect();
    (data, Covariance::new(rich_kernel(), 0.03), inducing)
}

#[test]
fn gradients_of_the_sparse_bound_are_those_of_finite_differences() {
    let (data, covariance, inducing) = sparse_case();
    let bound = SparseBound::new(&data, &Compute::default());
    let (value, gradient) = bound.value_and_gradient(&covariance, &inducing).expect("good");
    assert!(
        (value - bound.value(&covariance, &inducing).expect("again")).abs() < 1e-10 * value.abs()
    );
    let theta = covariance.theta();
    let step = 1e-5;
    // Rounding of the value, through the condition of the inducing points, over the step.
    let tolerance = 1e-5 * (1.0 + value.abs());
    for k in 0..theta.len() {
        let at = |sign: f64| {
            let mut theta = theta.clone();
            theta[k] += sign * step;
            bound.value(&covariance.with_theta(&theta), &inducing).expect("good")
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * step);
        assert!(
            (gradient.theta[k] - difference).abs() < tolerance,
            "{k}: {} {difference}",
            gradient.theta[k]
        );
    }
    for k in 0..inducing.len() {
        let at = |sign: f64| {
            let mut inducing = inducing.clone();
            inducing[k] += sign * step;
            bound.value(&covariance, &inducing).expect("good")
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * step);
        assert!(
            (gradient.inducing[k] - difference).abs() < tolerance,
            "{k}: {} {difference}",
            gradient.inducing[k]
        );
    }
    let parallel = SparseBound::new(&data, &Compute::default().with_threads(2));
    let parallel = parallel.value_and_gradient(&covariance, &inducing).expect("good");
    assert!(largest_difference(&gradient.theta, &parallel.1.theta) < tolerance);
}

#[test]
fn a_sparse_process_with_all_points_is_the_exact_one_and_with_fewer_a_bound() {
    let reference = reference();
    let data = reference_data(&reference);
    let covariance = Covariance::new(case("matern32_ard").0, 0.01);
    let exact = GaussianProcess::fit(data.clone(), covariance.clone(), &Compute::default())
        .expect("good data");
    let all = SparseGaussianProcess::fit(
        &data,
        covariance.clone(),
        data.x().to_vec(),
        &Compute::default(),
    );
    let all = all.expect("good data");
    // The jitter of the inducing points is a millionth of the variance.
    assert!((all.bound() - exact.log_marginal_likelihood()).abs() < 0.02, "{}", all.bound());
    assert!(all.bound() < exact.log_marginal_likelihood());
    let x = numbers(&reference["x_new"]);
    let (expected, found) =
        (exact.predict(&x, true).expect("good"), all.predict(&x, true).expect("good"));
    assert!(largest_difference(&found.mean, &expected.mean) < 1e-3);
    assert!(largest_difference(&found.variance, &expected.variance) < 1e-4);
    let mut last = f64::NEG_INFINITY;
    for count in [5, 20, 50, 70] {
        let chosen = informative_points(&covariance.signal, data.x(), 3, count);
        let inducing = data.select(&chosen).x().to_vec();
        let bound = SparseBound::new(&data, &Compute::default())
            .value(&covariance, &inducing)
            .expect("good");
        assert!(bound > last && bound <= exact.log_marginal_likelihood(), "{count}: {bound}");
        last = bound;
    }
}

#[test]
fn leaving_a_point_out_of_a_sparse_process_is_fitting_without_it() {
    let (data, covariance, inducing) = sparse_case();
    let fit = |data: &Data| {
        SparseGaussianProcess::fit(data, covariance.clone(), inducing.clone(), &Compute::default())
    };
    let all = fit(&data).expect("good").leave_one_out(&data).expect("the data");
    for i in 0..data.len() {
        let others: Vec<usize> = (0..data.len()).filter(|k| *k != i).collect();
        let without = fit(&data.select(&others)).expect("good");
        let prediction = without.predict(&data.x()[3 * i..3 * i + 3], true).expect("a point");
        assert!(largest_difference(&prediction.mean, &all.mean[2 * i..2 * i + 2]) < 1e-8, "{i}");
        assert!(
            (prediction.variance[0] + covariance.noise_variance - all.variance[i]).abs() < 1e-8,
            "{i}"
        );
    }
}

#[test]
fn intervals_are_as_wide_as_errors_of_points_left_out_say() {
    // Evenly spread, without any order: multiples of the golden section and of sqrt(2).
    let spread = |factor: f64| move |k: i32| (factor * f64::from(k)).fract();
    let x: Vec<f64> = (0..1500).map(spread(0.618_033_988_75)).map(|u| 6.0 * u).collect();
    // Laplace's distribution with the variance of the noise that the process knows, 0.09.
    let size = 0.3 / 2f64.sqrt();
    let error = |u: f64| -size * (u - 0.5).signum() * (1.0 - 2.0 * (u - 0.5).abs()).max(1e-9).ln();
    let errors = (0..1500).map(spread(2f64.sqrt())).map(error);
    let y = x.iter().zip(errors).map(|(x, error)| x.sin() + error).collect();
    let data = Data::new(x, 1, y, 1).expect("finite");
    let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 1.5).scaled(1.0);
    let gp = GaussianProcess::fit(data.clone(), Covariance::new(kernel, 0.09), &Compute::default())
        .expect("good");
    let factors = gp.leave_one_out().calibration(&data)[0];
    // |error| has an exponential distribution.
    let quantile = |share: f64| -size * (1.0 - share).ln() / 0.3;
    assert!((factors.deviation - quantile(0.682_689)).abs() < 0.02, "{factors:?}");
    assert!((factors.half_interval_95 - quantile(0.95)).abs() < 0.05, "{factors:?}");
    let few = data.select(&(0..50).collect::<Vec<_>>());
    let gp = GaussianProcess::fit(few.clone(), gp.covariance().clone(), &Compute::default())
        .expect("good");
    let factors = gp.leave_one_out().calibration(&few)[0];
    assert_eq!((factors.deviation, factors.half_interval_95), (1.0, 1.96));
}

#[test]
fn a_sparse_search_keeps_to_its_budget_and_moving_the_points_gains() {
    let x: Vec<f64> = (0..3000).map(|k| 0.005 * f64::from(k)).collect();
    let y = x
        .iter()
        .enumerate()
        .map(|(k, x)| x.sin() + 0.1 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0))
        .collect();
    let data = Data::new(x, 1, y, 1).expect("good data");
    let start =
        Covariance::new(Kernel::isotropic(Shape::SquaredExponential, 1, 0.5).scaled(0.5), 0.1);
    let search = SearchOptions::default().with_starts(1).with_subset(200);
    let options =
        SparseOptions::default().with_inducing(9).with_move_inducing(false).with_search(search);
    let run = |options: &SparseOptions| {
        search_sparse(&data, &start, options, &Compute::default(), &()).expect("good")
    };
    let (gp, report) = run(&options);
    assert!(report.chosen.len() <= 9 && gp.inducing().len() == report.chosen.len());
    assert_eq!((gp.bound(), report.status), (report.bound, SearchStatus::Converged));
    // The noise is uniform between -0.1 and 0.1.
    assert!((gp.covariance().noise_variance / (0.01 / 3.0) - 1.0).abs() < 0.1, "{report:?}");
    let (moved, _) = run(&options.clone().with_move_inducing(true));
    assert!(moved.bound() >= gp.bound() - 1e-6, "{} {}", moved.bound(), gp.bound());
    let at = [1.0, 4.0, 7.7];
    let prediction = moved.predict(&at, true).expect("good");
    for (k, x) in at.iter().enumerate() {
        assert!((prediction.mean[k] - x.sin()).abs() < 0.02);
    }

    let none =
        search_sparse(&data, &start, &options.clone().with_inducing(0), &Compute::default(), &());
    assert!(matches!(none, Err(GpError::InducingPoints { found: 0, points: 3000 })));
    let correlated =
        start.clone().with_correlated_noise(Kernel::isotropic(Shape::Exponential, 1, 1.0));
    let error = SparseBound::new(&data, &Compute::default())
        .value(&correlated, &[0.0])
        .expect_err("not possible");
    assert!(error.to_string().contains("correlated noise"));
}

#[test]
fn a_sparse_search_learns_within_few_evaluations() {
    // Of eighteen inputs two matter.
    let (count, inputs) = (20_000, 18);
    let x: Vec<f64> = (0..count)
        .flat_map(|i| {
            (0..inputs)
                .map(move |m| (0.01 * f64::from(i) * (1.0 + 0.137 * m as f64) + m as f64).sin())
        })
        .collect();
    let truth = |x: &[f64]| (2.0 * x[0]).sin() + x[1] * x[1];
    let y = x
        .chunks_exact(inputs)
        .enumerate()
        .map(|(k, x)| truth(x) + 0.1 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0));
    let data = Data::new(x.clone(), inputs, y.collect(), 1).expect("good data");
    let kernel =
        Kernel::ard(Shape::SquaredExponential, &[1.0; 18]).scaled(1.0).fitted_to(&x, inputs, 1.0);
    let start = Covariance::new(kernel, 0.01);
    let search = SearchOptions::default().with_starts(1).with_subset(200).with_evaluations(3);
    let options =
        SparseOptions::default().with_inducing(30).with_move_inducing(false).with_search(search);
    let (gp, report) =
        search_sparse(&data, &start, &options, &Compute::default(), &()).expect("good");
    assert!(report.evaluations <= 3, "{report:?}");
    let at: Vec<f64> =
        (0..500).flat_map(|k| x[(k * 39 + 5) * inputs..][..inputs].to_vec()).collect();
    let predicted = gp.predict(&at, false).expect("good").mean;
    let truths: Vec<f64> = at.chunks_exact(inputs).map(truth).collect();
    let mean = truths.iter().sum::<f64>() / truths.len() as f64;
    let share =
        truths.iter().zip(&predicted).map(|(truth, mean)| (truth - mean).powi(2)).sum::<f64>()
            / truths.iter().map(|truth| (truth - mean).powi(2)).sum::<f64>();
    assert!(share < 0.05, "{share} {report:?}");
}

#[test]
fn bad_input_is_an_error_that_says_what_to_do() {
    let kernel = || Kernel::isotropic(Shape::SquaredExponential, 2, 1.0).scaled(1.0);
    let message = |error: GpError| error.to_string();
    assert_eq!(Data::new(vec![], 2, vec![], 1), Err(GpError::Empty));
    assert!(
        message(Data::new(vec![0.0; 5], 2, vec![0.0; 2], 1).expect_err("odd"))
            .contains("5 numbers where 6")
    );
    assert!(
        message(Data::new(vec![0.0; 6], 2, vec![0.0; 2], 1).expect_err("few"))
            .contains("2 numbers where 3")
    );
    let nan = Data::new(vec![0.0, f64::NAN, 1.0, 1.0], 2, vec![0.0; 2], 1).expect_err("NaN");
    assert!(message(nan).contains("row 0, column 1 is NaN"));

    let data = Data::new(vec![0.5; 6], 2, vec![1.0; 3], 1).expect("three times the same point");
    let fit = |covariance| GaussianProcess::fit(data.clone(), covariance, &Compute::default());
    // Duplicates without noise need jitter, and it is told.
    let gp = fit(Covariance::new(kernel(), 0.0)).expect("jitter helps");
    assert!(gp.jitter() > 0.0 && gp.jitter() <= 1e-4);
    assert!((gp.predict(&[0.5, 0.5], true).expect("a point").mean[0] - 1.0).abs() < 1e-4);
    assert!(
        message(fit(Covariance::new(kernel().on(&[0, 7]), 0.1)).expect_err("no input 7"))
            .contains("input 7")
    );
    assert!(
        message(fit(Covariance::new(kernel().scaled(-1.0), 0.1)).expect_err("negative"))
            .contains("signal_variance")
    );
    assert!(
        message(fit(Covariance::new(kernel(), f64::NAN)).expect_err("NaN"))
            .contains("noise_variance is NaN")
    );
    assert!(fit(Covariance::new(Kernel::Sum(vec![]), 0.1)).is_err());
    assert!(matches!(
        gp.predict(&[0.0; 3], false),
        Err(GpError::Shape { found: 3, expected: 4, .. })
    ));
    assert!(matches!(gp.predict(&[0.0, f64::INFINITY], false), Err(GpError::NotFinite { .. })));

    // A million points: refused before memory is taken, with the alternative named.
    let many = Data::new(vec![0.0; 1_000_000], 1, vec![0.0; 1_000_000], 1).expect("good data");
    let one = Kernel::isotropic(Shape::SquaredExponential, 1, 1.0);
    let error = GaussianProcess::fit(many.clone(), Covariance::new(one, 0.1), &Compute::default())
        .expect_err("large");
    assert!(
        message(error).contains("8000.0 GB")
            && Likelihood::new(&many, &Compute::default()).is_err()
    );

    // Huge and tiny scales, constant outputs, one point.
    let x: Vec<f64> = (0..40).map(|k| 1e9 * f64::from(k)).collect();
    let far = Data::new(x, 1, vec![1e-9; 40], 1).expect("good data");
    let scaled =
        Kernel::isotropic(Shape::Matern32, 1, 1.0).fitted_to(far.x(), 1, far.mean_square());
    let gp = GaussianProcess::fit(far, Covariance::new(scaled, 1e-22), &Compute::default())
        .expect("scaled");
    assert!((gp.predict(&[5e9], false).expect("a point").mean[0] / 1e-9 - 1.0).abs() < 1e-3);
}

#[test]
fn processes_over_the_same_points_are_asked_together() {
    // Not a whole number of tiles or of pairs of registers; inputs that a kernel does not look at.
    let (n, d) = (2 * 256 + 43, 5);
    let x: Vec<f64> =
        (0..n * d).map(|k| (0.7 * k as f64 + (0.01 * k as f64).cos()).sin()).collect();
    let process = |joint: usize| {
        let shape = [Shape::SquaredExponential, Shape::Matern52, Shape::Exponential][joint % 3];
        let inputs = [vec![0, 1, 2, 3, 4], vec![joint % d], vec![4, 2]]
            [joint % 3 * usize::from(joint > 2)]
        .clone();
        let scales: Vec<f64> = (0..inputs.len()).map(|m| 0.5 + 0.1 * (m + joint) as f64).collect();
        let kernel = Kernel::ard(shape, &scales).on(&inputs).scaled(1.0 + joint as f64);
        let y = (0..n).map(|i| (x[i * d] * (1.0 + joint as f64)).sin() + x[i * d + 2]).collect();
        let data = Data::new(x.clone(), d, y, 1).expect("good data");
        GaussianProcess::fit(data, Covariance::new(kernel, 0.01), &Compute::default())
            .expect("good data")
    };
    let mut all: Vec<GaussianProcess> = (0..7).map(process).collect();
    // The last one has the kernel of the first, in other units.
    let first = all[0].covariance().clone().in_units_of(3.0);
    let y = (0..n).map(|i| 3.0 * (x[i * d] * 2.0).cos()).collect();
    let data = Data::new(x.clone(), d, y, 1).expect("good data");
    all.push(GaussianProcess::fit(data, first, &Compute::default()).expect("good data"));
    for count in 1..=all.len() {
        let processes: Vec<&GaussianProcess> = all.iter().take(count).collect();
        let mut double = shared_predictor(&processes, Precision::Double).expect("the same points");
        let mut single = shared_predictor(&processes, Precision::Single).expect("the same points");
        assert!(
            double.error() == 0.0 && single.error() > 0.0 && single.error() < 1e-2,
            "{}",
            single.error()
        );
        for query in [&x[..d], &[0.3, -0.2, 0.1, 0.9, -0.4]] {
            let expected =
                processes.iter().map(|gp| gp.predict(query, false).expect("finite").mean[0]);
            let expected: Vec<f64> = expected.collect();
            // Weights are up to the signal over the noise times the points: rounding of the sums.
            assert!(largest_difference(double.means(query), &expected) < 1e-9);
            assert!(largest_difference(single.means(query), &expected) < 1e-2);
        }
    }
    let periodic = Kernel::ard(Shape::Matern52, &[1.0; 5]).with_period(0, 2.0).scaled(1.0);
    let other = Data::new(x.clone(), d, vec![1.0; n], 1).expect("good data");
    let other = GaussianProcess::fit(other, Covariance::new(periodic, 0.1), &Compute::default())
        .expect("good data");
    assert!(
        shared_predictor(&[&all[0], &other], Precision::Double).is_none(),
        "a kernel of another kind"
    );
    let fewer = all[0].data().select(&[0, 1, 2]);
    let fewer = GaussianProcess::fit(fewer, all[0].covariance().clone(), &Compute::default())
        .expect("good data");
    assert!(shared_predictor(&[&all[0], &fewer], Precision::Double).is_none(), "other points");
    assert!(shared_predictor(&[], Precision::Double).is_none());
}

#[test]
fn a_variance_of_lower_rank_is_never_too_small_and_says_how_close_it_is() {
    // A log: neighbours are near-duplicates.
    let wave = |k: usize, m: usize| (0.01 * k as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin();
    let x: Vec<f64> = (0..800).flat_map(|k| (0..3).map(move |m| wave(k, m))).collect();
    let y = (0..800).map(|k| wave(k, 0) * wave(k, 1)).collect();
    let kernel = Kernel::ard(Shape::SquaredExponential, &[0.5, 0.7, 0.9]).scaled(1.5);
    let drift = Kernel::isotropic(Shape::Exponential, 1, 0.3).on(&[2]).scaled(0.02);
    let covariance = Covariance::new(kernel, 0.01).with_correlated_noise(drift);
    let data = Data::new(x, 3, y, 1).expect("good data");
    let gp = GaussianProcess::fit(data, covariance, &Compute::default()).expect("small");
    let queries: Vec<f64> =
        (0..300).flat_map(|k| (0..3).map(move |m| 1.3 * wave(7 * k, 2 * m + 1))).collect();
    let exact = gp.predict(&queries, true).expect("finite");
    let mut before = f64::INFINITY;
    for (rank, precision) in
        [(20, Precision::Double), (160, Precision::Double), (160, Precision::Single)]
    {
        let options =
            PredictorOptions::default().with_precision(precision).with_variance_rank(Some(rank));
        let mut predictor = gp.predictor(options).expect("small");
        let rounding = if precision == Precision::Single { 1e-4 } else { 1e-9 };
        let mut excess: f64 = 0.0;
        for (x, variance) in queries.chunks_exact(3).zip(&exact.variance) {
            let own = predictor.mean_and_variance(x).1;
            assert!(own >= variance - rounding, "{own} below {variance}");
            excess = excess.max(own - variance);
        }
        println!(
            "rank {rank}, {precision:?}: excess {excess:.2e}, stated {:.2e}",
            predictor.variance_error()
        );
        assert!(predictor.variance_error() > 0.0 && predictor.variance_error() < 1.5);
        if precision == Precision::Double {
            assert!(excess < before, "of higher rank, less excess");
            before = excess;
        }
    }
    // A fifth of the number of measurements is enough for a log: the deviation of a measurement is
    // within 1 %.
    assert!(before < 0.01 * 2.0 * 0.01, "{before}");
    let all = gp.predictor(PredictorOptions::default().with_variance_rank(None)).expect("small");
    assert_eq!((all.error(), all.variance_error()), (0.0, 0.0));
}

#[test]
fn the_mean_alone_is_the_mean_of_any_number_of_points() {
    let wave = |k: usize, m: usize| (0.037 * k as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin();
    let shapes =
        ["squared_exponential", "exponential", "matern32", "matern52", "rational_quadratic"];
    for (shape, n) in
        shapes.into_iter().zip([1, 63, 64, 65, 300]).chain([("squared_exponential", 257)])
    {
        let x: Vec<f64> =
            (0..n).flat_map(|k| (0..3).map(move |m| 2.0 * wave(k, m) + 5.0)).collect();
        let y = (0..n).map(|k| wave(k, 0) * wave(k, 1) + 0.1 * wave(31 * k, 2)).collect();
        let kernel =
            Kernel::ard(Shape::by_name(shape).expect("a name"), &[0.9, 0.7, 1.3]).scaled(1.5);
        let data = Data::new(x, 3, y, 1).expect("good data");
        let gp = GaussianProcess::fit(data, Covariance::new(kernel, 0.01), &Compute::default())
            .expect("small");
        let queries: Vec<f64> =
            (0..60).flat_map(|k| (0..3).map(move |m| 2.2 * wave(7 * k, 2 * m + 1) + 5.0)).collect();
        let exact = gp.predict(&queries, false).expect("finite").mean;
        for (precision, compact) in [
            (Precision::Double, false),
            (Precision::Single, false),
            (Precision::Double, true),
            (Precision::Single, true),
        ] {
            let options = PredictorOptions::default()
                .with_precision(precision)
                .with_variance_rank(None)
                .with_compact(compact);
            let mut predictor = gp.predictor(options).expect("small");
            // What is stated is measured at other points; in double precision only rounding is
            // left. Of a rough kernel the distance to a close point counts, which is the root of
            // what rounding leaves of a difference of squares.
            let allowed = 1e-12 + 4.0 * predictor.error();
            assert!(
                allowed < if compact { 1e-2 } else { 2e-4 },
                "{shape} {precision:?} {compact} {allowed}"
            );
            for (x, mean) in queries.chunks_exact(3).zip(&exact) {
                let alone = predictor.mean(x)[0];
                assert!(
                    (alone - mean).abs() < allowed,
                    "{shape} {precision:?} {compact}: {alone} {mean} {allowed}"
                );
                let with_variance = predictor.mean_and_variance(x).0[0];
                assert!(
                    (alone - with_variance).abs() < 1e-12 + predictor.error(),
                    "{alone} {with_variance}"
                );
            }
        }
    }
}

#[test]
fn a_compact_predictor_is_as_close_as_it_says() {
    let wave = |k: usize, m: usize| (0.01 * k as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin();
    let x: Vec<f64> = (0..900)
        .flat_map(|k| (0..4).map(move |m| 10f64.powi(m as i32) * wave(k, m) + 3.0))
        .collect();
    let y = (0..900).map(|k| wave(k, 0) * wave(k, 1) + 0.1 * wave(31 * k, 2)).collect();
    let kernel = Kernel::ard(Shape::SquaredExponential, &[0.5, 7.0, 90.0]).scaled(1.5);
    // The last input is one that only noise looks at: it keeps its digits.
    let drift = Kernel::isotropic(Shape::Exponential, 1, 100.0).on(&[3]).scaled(0.02);
    let covariance = Covariance::new(kernel.clone(), 0.01).with_correlated_noise(drift);
    let data = Data::new(x, 4, y, 1).expect("good data");
    let gp = GaussianProcess::fit(data.clone(), covariance, &Compute::default()).expect("small");
    let queries: Vec<f64> = (0..400)
        .flat_map(|k| {
            (0..4).map(move |m| 10f64.powi(m as i32) * 1.1 * wave(7 * k, 2 * m + 1) + 3.0)
        })
        .collect();
    let exact = gp.predict(&queries, true).expect("finite");
    // Two percent of the standard deviation of the noise, half a percent of its variance.
    let (of_mean, of_variance) = (2e-3, 5e-5);
    for precision in [Precision::Double, Precision::Single] {
        let options = PredictorOptions::default()
            .with_precision(precision)
            .with_variance_rank(None)
            .with_compact(true);
        let mut predictor = gp.predictor(options).expect("small");
        let (mut mean_error, mut variance_error) = (0.0, 0.0);
        for ((x, mean), variance) in queries.chunks_exact(4).zip(&exact.mean).zip(&exact.variance) {
            let (own_mean, own_variance) = predictor.mean_and_variance(x);
            mean_error = f64::max(mean_error, (own_mean[0] - mean).abs());
            variance_error = f64::max(variance_error, (own_variance - variance).abs());
        }
        let stated = (predictor.error(), predictor.variance_error());
        println!(
            "{precision:?}: mean {mean_error:.1e}, variance {variance_error:.1e}, stated {stated:?}"
        );
        assert!(
            stated.0 > 0.0 && mean_error < 3.0 * stated.0 && mean_error < of_mean,
            "{precision:?} {mean_error}"
        );
        assert!(stated.1 > 0.0 && variance_error < 3.0 * stated.1 && variance_error < of_variance);
    }
    let turning = Covariance::new(kernel.with_period(1, 2.0), 0.01);
    let gp = GaussianProcess::fit(data, turning, &Compute::default()).expect("small");
    let compact = PredictorOptions::default().with_compact(true);
    let error = gp.predictor(compact).expect_err("no grid for a cosine");
    assert!(error.to_string().contains("periodic input"), "{error}");
}
