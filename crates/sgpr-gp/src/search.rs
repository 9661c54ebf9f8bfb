use derive_setters::Setters;
use faer::MatRef;

use super::kernels::spreads;
use super::minimise::{Minimum, SearchStatus, StoppingCriteria, minimise};
use super::{Compute, Covariance, Data, GpError, Kernel, Likelihood};
use sgpr_numeric::internal::Random;
use sgpr_numeric::progress::{Interrupted, Progress};

/// How hyperparameters are searched for.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct SearchOptions {
    /// Starts: the given covariance, and others around it.
    pub starts: usize,
    /// Points of the random subset on which all starts are tried; only the best goes on to all
    /// points.
    pub subset: usize,
    /// Evaluations of the likelihood, for each start and for the last search.
    pub evaluations: usize,
    /// Gain of a step, relative to the likelihood, at which a search ends.
    pub gain: f64,
    /// Bounds of theta; by default from the spread of the data.
    pub bounds: Option<Vec<(f64, f64)>>,
    /// Weak prior on theta: (mean, standard deviation) of a normal distribution, or none. Keeps a
    /// noise variance from running to zero where the data do not speak against it.
    pub priors: Vec<Option<(f64, f64)>>,
    /// Linear terms with unknown coefficients beside the process, `[points, terms]`, row-major;
    /// empty for none.
    pub terms: Vec<f64>,
    /// Seed of the subset and of the other starts.
    pub seed: u64,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            starts: 3,
            subset: 500,
            evaluations: 100,
            gain: 1e-9,
            bounds: None,
            priors: vec![],
            terms: vec![],
            seed: 0,
        }
    }
}

impl SearchOptions {
    /// Bounds of theta, given or from the data.
    pub(super) fn bounds_for(
        &self,
        data: &Data,
        start: &Covariance,
    ) -> Result<Vec<(f64, f64)>, GpError> {
        let bounds = self.bounds.clone().unwrap_or_else(|| data.bounds(start));
        let expected = start.theta().len();
        let points = data.len();
        if !self.terms.len().is_multiple_of(points) {
            let expected = self.terms.len().next_multiple_of(points);
            return Err(GpError::Shape {
                what: "the linear terms",
                found: self.terms.len(),
                expected,
            });
        }
        for (what, found) in [("the bounds", bounds.len()), ("the priors", self.priors.len())] {
            if found != expected && !(what == "the priors" && found == 0) {
                return Err(GpError::Shape { what, found, expected });
            }
        }
        Ok(bounds)
    }
}

/// What a search found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SearchReport {
    /// The covariance with the best hyperparameters.
    pub covariance: Covariance,
    /// Its log marginal likelihood on all points, priors left out.
    pub log_marginal_likelihood: f64,
    /// How the last search ended.
    pub status: SearchStatus,
    /// Evaluations on all points.
    pub evaluations: usize,
    /// Evaluations on the subset.
    pub evaluations_on_subset: usize,
    /// Objective that each start reached on the points it was tried on.
    pub starts: Vec<f64>,
    /// Hyperparameters at a bound, by name.
    pub at_bounds: Vec<String>,
    /// Largest jitter that was needed.
    pub jitter: f64,
}

/// Searches for the hyperparameters with the largest log marginal likelihood (plus the priors, if
/// there are).
///
/// `progress` hears of every evaluation; when it asks to stop, the best so far is the result.
///
/// # Errors
/// If the covariance does not fit the data, there are too many points, or not one evaluation was
/// possible.
pub fn search(
    data: &Data,
    start: &Covariance,
    options: &SearchOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<SearchReport, GpError> {
    start.validate(data.inputs())?;
    compute.check(data.len(), 1)?;
    let bounds = options.bounds_for(data, start)?;
    let mut run = SearchRun {
        start,
        options,
        compute,
        progress,
        bounds: &bounds,
        jitter: 0.0,
        stopped: false,
    };
    let SubsetSearch { best, starts, evaluations: evaluations_on_subset } = run.on_subset(data)?;
    let minimum = run.search(data, &options.terms, &best, "hyperparameters")?;
    let covariance = start.with_theta(&minimum.at);
    Ok(SearchReport {
        log_marginal_likelihood: -minimum.value - log_prior(&options.priors, &minimum.at, None),
        at_bounds: at_bounds(&covariance, &bounds),
        covariance,
        status: minimum.status,
        evaluations: minimum.evaluations,
        evaluations_on_subset,
        starts,
        jitter: run.jitter,
    })
}

/// Names of the hyperparameters that stand at a bound.
pub(super) fn at_bounds(covariance: &Covariance, bounds: &[(f64, f64)]) -> Vec<String> {
    let near = |value: f64, bound: f64| (value - bound).abs() < 1e-6;
    let at_bound = |(t, (low, high)): (&f64, &(f64, f64))| near(*t, *low) || near(*t, *high);
    let theta = covariance.theta();
    let flags = theta.iter().zip(bounds).map(at_bound);
    covariance
        .names()
        .into_iter()
        .zip(flags)
        .filter(|(_, at_bound)| *at_bound)
        .map(|(name, _)| name)
        .collect()
}

/// A search under way.
pub(super) struct SearchRun<'a> {
    pub start: &'a Covariance,
    pub options: &'a SearchOptions,
    pub compute: &'a Compute,
    pub progress: &'a dyn Progress,
    pub bounds: &'a [(f64, f64)],
    pub jitter: f64,
    /// The listener asked to stop: what follows is evaluated once.
    pub stopped: bool,
}

/// What the starts came to.
pub(super) struct SubsetSearch {
    pub best: Vec<f64>,
    pub starts: Vec<f64>,
    pub evaluations: usize,
}

impl SearchRun<'_> {
    /// Tries all starts on a random subset of the points, unless there is but one start and few
    /// points.
    pub fn on_subset(&mut self, data: &Data) -> Result<SubsetSearch, GpError> {
        let Self { options, start, .. } = *self;
        let theta = start.theta();
        let mut found = SubsetSearch { best: theta.clone(), starts: vec![], evaluations: 0 };
        if options.starts <= 1 && data.len() <= 2 * options.subset {
            return Ok(found);
        }
        let mut random = Random::new(options.seed);
        let mut around =
            |theta: &[f64]| theta.iter().map(|t| t + 3.0 * (random.uniform() - 0.5)).collect();
        let others: Vec<Vec<f64>> = (1..options.starts).map(|_| around(&theta)).collect();
        let chosen = random.choose(options.subset.max(2), data.len());
        let subset = data.select(&chosen);
        let width = options.terms.len() / data.len();
        let terms: Vec<f64> = chosen
            .iter()
            .flat_map(|&k| &options.terms[k * width..(k + 1) * width])
            .copied()
            .collect();
        let mut best_value = f64::INFINITY;
        for theta in std::iter::once(&theta).chain(&others) {
            let minimum = match self.search(&subset, &terms, theta, "hyperparameters on a subset") {
                Ok(minimum) => minimum,
                // A start far off may not be computable; the given one must be.
                Err(GpError::NotPositiveDefinite { .. }) if !found.starts.is_empty() => continue,
                Err(error) => return Err(error),
            };
            found.starts.push(-minimum.value);
            found.evaluations += minimum.evaluations;
            if minimum.value < best_value {
                (best_value, found.best) = (minimum.value, minimum.at);
            }
            if minimum.status == SearchStatus::Stopped {
                break;
            }
        }
        Ok(found)
    }

    /// - `terms`: `[points, terms]`, row-major; empty for none
    pub fn search(
        &mut self,
        data: &Data,
        terms: &[f64],
        theta: &[f64],
        stage: &'static str,
    ) -> Result<Minimum, GpError> {
        let mut likelihood = match terms.len() / data.len() {
            0 => Likelihood::new(data, self.compute)?,
            width => Likelihood::beside(
                data,
                MatRef::from_row_major_slice(terms, data.len(), width),
                self.compute,
            )?,
        };
        let (lower, upper): (Vec<f64>, Vec<f64>) = self.bounds.iter().copied().unzip();
        // The gradient grows with the number of points.
        let limits = StoppingCriteria {
            evaluations: self.options.evaluations,
            gain: self.options.gain,
            gradient: 1e-5 * (data.len() as f64).sqrt(),
        };
        let (mut done, mut jitter) = (0, self.jitter);
        let mut evaluate = |theta: &[f64]| {
            // The first evaluation always is, so that there is something to keep.
            if done > 0 {
                if self.stopped {
                    return Err(Interrupted.into());
                }
                self.progress.step(stage, done, self.options.evaluations)?;
            }
            done += 1;
            let (value, mut gradient) =
                likelihood.value_and_gradient(&self.start.with_theta(theta))?;
            jitter = f64::max(jitter, likelihood.jitter());
            let prior = log_prior(&self.options.priors, theta, Some(&mut gradient));
            gradient.iter_mut().for_each(|g| *g = -*g);
            Ok((-value - prior, gradient))
        };
        let minimum = minimise(theta, &lower, &upper, limits, &mut evaluate)?;
        self.jitter = jitter;
        self.stopped |= minimum.status == SearchStatus::Stopped;
        Ok(minimum)
    }
}

/// Log density of the priors up to a constant; adds its derivatives.
pub(super) fn log_prior(
    priors: &[Option<(f64, f64)>],
    theta: &[f64],
    mut gradient: Option<&mut Vec<f64>>,
) -> f64 {
    let mut sum = 0.0;
    for (k, (prior, theta)) in priors.iter().zip(theta).enumerate() {
        if let Some((mean, deviation)) = prior {
            let z = (theta - mean) / deviation;
            sum -= 0.5 * z * z;
            if let Some(gradient) = &mut gradient {
                gradient[k] -= z / deviation;
            }
        }
    }
    sum
}

impl Data {
    /// Bounds of theta of a covariance of these data: length scales from a thousandth of the spread
    /// of their inputs to a thousand times it, variances from a millionth of the mean square of y
    /// to ten thousand times it, the noise variance from 1e-8 of it.
    pub fn bounds(&self, covariance: &Covariance) -> Vec<(f64, f64)> {
        let spread = spreads(self.x(), self.inputs());
        let scale = match self.mean_square() {
            0.0 => 1.0,
            scale => scale,
        };
        let mut bounds = Vec::new();
        add_bounds(&covariance.kernel(), &spread, scale, &mut bounds);
        bounds.push((1e-8 * scale, 10.0 * scale));
        bounds.into_iter().map(|(low, high): (f64, f64)| (low.ln(), high.ln())).collect()
    }
}

fn add_bounds(kernel: &Kernel, spread: &[f64], scale: f64, bounds: &mut Vec<(f64, f64)>) {
    match kernel {
        Kernel::Stationary(leaf) => {
            let of = |inputs: &[super::Input]| {
                let (low, high) = inputs.iter().fold((f64::INFINITY, 0.0), |(low, high), input| {
                    (f64::min(low, spread[input.index]), f64::max(high, spread[input.index]))
                });
                (1e-3 * low, 1e3 * high)
            };
            if leaf.length_scales.len() == 1 {
                bounds.push(of(&leaf.inputs));
            } else {
                bounds.extend(leaf.inputs.iter().map(|input| of(std::slice::from_ref(input))));
            }
            if let super::Shape::RationalQuadratic { .. } = leaf.shape {
                bounds.push((1e-2, 1e3));
            }
        }
        Kernel::Scaled { kernel, .. } => {
            bounds.push((1e-6 * scale, 1e4 * scale));
            add_bounds(kernel, spread, scale, bounds);
        }
        Kernel::Sum(parts) => parts.iter().for_each(|part| add_bounds(part, spread, scale, bounds)),
        // Variances of further factors have no unit.
        Kernel::Product(parts) => {
            for (k, part) in parts.iter().enumerate() {
                add_bounds(part, spread, if k == 0 { scale } else { 1.0 }, bounds);
            }
        }
    }
}
