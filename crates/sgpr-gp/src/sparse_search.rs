use derive_setters::Setters;

use super::minimise::{SearchStatus, StoppingCriteria, minimise};
use super::search::{SearchRun, SubsetSearch, at_bounds, log_prior};
use super::subset::informative_points;
use super::{
    Compute, Covariance, Data, GpError, SearchOptions, SparseBound, SparseGaussianProcess,
};
use sgpr_numeric::internal::Random;
use sgpr_numeric::progress::{Interrupted, Progress};

/// How a sparse process is fitted.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct SparseOptions {
    /// Budget: inducing points. Time grows with their square, memory for the data with their
    /// number.
    pub inducing: usize,
    /// Whether the inducing points are moved to where they say most, rather than kept where data
    /// points are.
    pub move_inducing: bool,
    /// Search for the hyperparameters.
    pub search: SearchOptions,
}

impl Default for SparseOptions {
    fn default() -> Self {
        Self { inducing: 500, move_inducing: true, search: SearchOptions::default() }
    }
}

/// What was chosen within the budget.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SparseReport {
    /// The covariance with the best hyperparameters.
    pub covariance: Covariance,
    /// Data points that the inducing points were taken from, the most informative first; fewer than
    /// asked for if no variance was left.
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

/// Points of the larger subset, at most: more tell the hyperparameters no better than the bound
/// then does.
const LARGEST_SUBSET: usize = 2000;

/// Fits a sparse process: hyperparameters by the exact likelihood of a random subset, the inducing
/// points most informative under them, then everything together by the bound on all points.
///
/// The subset is large enough for its evaluations to cost what those on all points do, and is
/// searched to the end however few of these are allowed: from hyperparameters that say nothing yet,
/// the bound leads to a process that takes everything for noise.
///
/// `progress` hears of every evaluation; when it asks to stop, the best so far is the result.
///
/// # Errors
/// If the covariance does not fit the data or has correlated noise, or not one evaluation was
/// possible.
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
    let on_subsets = SearchOptions {
        evaluations: options.search.evaluations.max(SearchOptions::default().evaluations),
        ..options.search.clone()
    };
    let run = SearchRun {
        start,
        options: &on_subsets,
        compute,
        progress,
        bounds: &bounds,
        jitter: 0.0,
        stopped: false,
    };
    let OnSubsets { best, evaluations: evaluations_on_subset, stopped } =
        search_subsets(run, data, options.inducing)?;
    let chosen = informative_points(
        &start.with_theta(&best).signal,
        data.x(),
        data.inputs(),
        options.inducing,
    );
    let unknowns = Unknowns {
        start,
        hyperparameters: best.len(),
        inducing: data.select(&chosen).x().to_vec(),
        spread: super::kernels::spreads(data.x(), data.inputs()),
        moves: options.move_inducing,
    };
    let [at, lower, upper] = unknowns.begin(best, &bounds, data);

    let bound = SparseBound::new(data, compute);
    // The search works on the bound per point: its first step is along the gradient, and as long,
    // and that of a million points would end in a corner of the bounds.
    let points = data.len() as f64;
    let limits = StoppingCriteria {
        evaluations: options.search.evaluations,
        gain: options.search.gain,
        gradient: 1e-5 / points.sqrt(),
    };
    let mut done = 0;
    let mut evaluate = |at: &[f64]| {
        if done > 0 {
            if stopped {
                return Err(Interrupted.into());
            }
            progress.step("hyperparameters of the sparse process", done, limits.evaluations)?;
        }
        done += 1;
        let (covariance, inducing) = unknowns.split(at);
        let (value, gradient) = bound.value_and_gradient(&covariance, &inducing)?;
        let mut gradient_at = gradient.theta;
        let prior = log_prior(
            &options.search.priors,
            &at[..unknowns.hyperparameters],
            Some(&mut gradient_at),
        );
        if options.move_inducing {
            gradient_at
                .extend(gradient.inducing.iter().enumerate().map(|(k, g)| g * unknowns.unit(k)));
        }
        gradient_at.iter_mut().for_each(|g| *g /= -points);
        Ok((-(value + prior) / points, gradient_at))
    };
    let minimum = minimise(&at, &lower, &upper, limits, &mut evaluate)?;
    let (covariance, inducing) = unknowns.split(&minimum.at);
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

/// Hyperparameters by the exact likelihood of subsets.
struct OnSubsets {
    best: Vec<f64>,
    evaluations: usize,
    /// Whether the listener asked to stop.
    stopped: bool,
}

/// Searches a small subset from all starts, then a larger one, whose evaluations cost what those on
/// all points do.
fn search_subsets(
    mut run: SearchRun<'_>,
    data: &Data,
    inducing: usize,
) -> Result<OnSubsets, GpError> {
    let SubsetSearch { mut best, mut evaluations, .. } = run.on_subset(data)?;
    let inducing = inducing as f64;
    let affordable =
        ((3.0 * data.len() as f64 * inducing * inducing).cbrt() as usize).min(LARGEST_SUBSET);
    if (run.options.subset + 1..data.len()).contains(&affordable) && !run.stopped {
        let chosen = Random::new(run.options.seed).choose(affordable, data.len());
        let minimum =
            run.search(&data.select(&chosen), &[], &best, "hyperparameters on a larger subset")?;
        evaluations += minimum.evaluations;
        best = minimum.at;
    }
    Ok(OnSubsets { best, evaluations, stopped: run.stopped })
}

/// What the search on all points steps in: hyperparameters, then the coordinates of the inducing
/// points if these move.
struct Unknowns<'a> {
    start: &'a Covariance,
    hyperparameters: usize,
    /// Where the inducing points start, `[points, inputs]`, row-major.
    inducing: Vec<f64>,
    /// Per input. Points move in units of it, like the logarithms beside them.
    spread: Vec<f64>,
    moves: bool,
}

impl Unknowns<'_> {
    fn unit(&self, coordinate: usize) -> f64 {
        self.spread[coordinate % self.spread.len()]
    }

    /// Start, lower and upper bounds.
    fn begin(
        &self,
        hyperparameters: Vec<f64>,
        bounds: &[(f64, f64)],
        data: &Data,
    ) -> [Vec<f64>; 3] {
        let (mut lower, mut upper): (Vec<f64>, Vec<f64>) = bounds.iter().copied().unzip();
        let mut at = hyperparameters;
        if self.moves {
            let range = |k: usize| {
                let column = data.x().iter().skip(k % data.inputs()).step_by(data.inputs());
                column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                    (low.min(*x), high.max(*x))
                })
            };
            let ranges: Vec<(f64, f64)> = (0..data.inputs()).map(range).collect();
            for (k, x) in self.inducing.iter().enumerate() {
                let (low, high) = ranges[k % data.inputs()];
                at.push(x / self.unit(k));
                lower.push(low / self.unit(k));
                upper.push(high / self.unit(k));
            }
        }
        [at, lower, upper]
    }

    /// Covariance and inducing points.
    fn split(&self, at: &[f64]) -> (Covariance, Vec<f64>) {
        let (theta, points) = at.split_at(self.hyperparameters);
        let moved = points.iter().enumerate().map(|(k, x)| x * self.unit(k)).collect();
        (
            self.start.with_theta(theta),
            if points.is_empty() { self.inducing.clone() } else { moved },
        )
    }
}
