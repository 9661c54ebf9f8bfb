use super::minimise::{Limits, SearchStatus, minimise};
use super::search::{Run, SubsetSearch, at_bounds, log_prior};
use super::subset::informative_points;
use super::{Compute, Covariance, Data, GpError, SearchOptions, SparseBound, SparseGaussianProcess};
use crate::progress::Progress;

/// How a sparse process is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseOptions {
    /// Budget: inducing points. Time grows with their square, memory for the data with their number.
    pub inducing: usize,
    /// Whether the inducing points are moved to where they say most, rather than kept where data points are.
    pub move_inducing: bool,
    /// Search for the hyperparameters.
    pub search: SearchOptions,
}

impl Default for SparseOptions {
    fn default() -> Self {
        Self { inducing: 500, move_inducing: false, search: SearchOptions::default() }
    }
}

/// What was chosen within the budget.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseReport {
    /// The covariance with the best hyperparameters.
    pub covariance: Covariance,
    /// Data points that the inducing points were taken from, the most informative first; fewer than asked for if no
    /// variance was left.
    pub chosen: Vec<usize>,
    /// Lower bound of the log marginal likelihood on all points, priors left out.
    pub bound: f64,
    /// How the search on all points ended.
    pub status: SearchStatus,
    /// Evaluations on all points.
    pub evaluations: usize,
    /// Evaluations of the exact likelihood on a subset.
    pub evaluations_on_subset: usize,
    /// Hyperparameters at a bound, by name.
    pub at_bounds: Vec<String>,
}

/// Fits a sparse process: hyperparameters by the exact likelihood of a random subset, the inducing points most informative
/// under them, then everything together by the bound on all points.
///
/// `progress` hears of every evaluation; when it asks to stop, the best so far is the result.
///
/// # Errors
/// If the covariance does not fit the data or has correlated noise, or not one evaluation was possible.
pub fn search_sparse(
    data: &Data,
    start: &Covariance,
    options: &SparseOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<(SparseGaussianProcess, SparseReport), GpError> {
    start.validate(data.inputs())?;
    if options.inducing == 0 {
        return Err(GpError::InducingPoints { found: 0, points: data.len() });
    }
    let bounds = options.search.bounds_for(data, start)?;
    let mut run = Run { start, options: &options.search, compute, progress, bounds: &bounds, jitter: 0.0 };
    let SubsetSearch { best, evaluations: evaluations_on_subset, .. } = run.on_subset(data)?;
    let kernel = start.with_theta(&best).signal;
    let chosen = informative_points(&kernel, data.x(), data.inputs(), options.inducing);
    let inducing = data.select(&chosen).x().to_vec();

    let bound = SparseBound::new(data, compute);
    let hyperparameters = best.len();
    let (mut lower, mut upper): (Vec<f64>, Vec<f64>) = bounds.iter().copied().unzip();
    let mut at = best;
    // Points move in units of the spread of their input, like the logarithms beside them.
    let spread = super::kernels::spreads(data.x(), data.inputs());
    let unit = |k: usize| spread[k % data.inputs()];
    if options.move_inducing {
        let range = |k: usize| {
            let column = data.x().iter().skip(k % data.inputs()).step_by(data.inputs());
            column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
        };
        let ranges: Vec<(f64, f64)> = (0..data.inputs()).map(range).collect();
        for (k, x) in inducing.iter().enumerate() {
            let (low, high) = ranges[k % data.inputs()];
            at.push(x / unit(k));
            lower.push(low / unit(k));
            upper.push(high / unit(k));
        }
    }
    let split = |at: &[f64]| -> (Covariance, Vec<f64>) {
        let (theta, points) = at.split_at(hyperparameters);
        let moved = points.iter().enumerate().map(|(k, x)| x * unit(k)).collect();
        (start.with_theta(theta), if points.is_empty() { inducing.clone() } else { moved })
    };
    let limits = Limits {
        evaluations: options.search.evaluations,
        gain: options.search.gain,
        gradient: 1e-5 * (data.len() as f64).sqrt(),
    };
    let mut done = 0;
    let mut evaluate = |at: &[f64]| {
        if done > 0 {
            progress.step("hyperparameters of the sparse process", done, limits.evaluations)?;
        }
        done += 1;
        let (covariance, points) = split(at);
        let (value, gradient) = bound.value_and_gradient(&covariance, &points)?;
        let mut gradient_at = gradient.theta;
        let prior = log_prior(&options.search.priors, &at[..hyperparameters], Some(&mut gradient_at));
        if options.move_inducing {
            gradient_at.extend(gradient.inducing.iter().enumerate().map(|(k, g)| g * unit(k)));
        }
        gradient_at.iter_mut().for_each(|g| *g = -*g);
        Ok((-value - prior, gradient_at))
    };
    let minimum = minimise(&at, &lower, &upper, limits, &mut evaluate)?;
    let (covariance, inducing) = split(&minimum.at);
    let gp = SparseGaussianProcess::fit(data, covariance.clone(), inducing, compute)?;
    let report = SparseReport {
        at_bounds: at_bounds(&covariance, &bounds),
        covariance,
        chosen,
        bound: gp.bound(),
        status: minimum.status,
        evaluations: minimum.evaluations,
        evaluations_on_subset,
    };
    Ok((gp, report))
}
