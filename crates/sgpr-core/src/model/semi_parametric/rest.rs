//! The process of one joint: which inputs, which hyperparameters, and whether it helps on motion that it has not seen.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{Inputs, SemiParametricOptions};
use crate::gp::{
    Compute, Covariance, Data, GaussianProcess, GpError, Kernel, SearchOptions, SearchStatus, informative_points,
    search,
};
use crate::progress::Progress;

/// Residual of a joint at the samples in which it moves.
pub(super) struct Rows {
    /// `[rows, 3 n + 1]`: q, dq, ddq, time (s); logs lie far apart in time.
    pub x: Vec<f64>,
    /// Measured minus predicted in the band of the model, N·m (N).
    pub residual: Vec<f64>,
    /// Recording stretch and sample of each.
    pub source: Vec<(usize, usize)>,
}

impl Rows {
    /// What is left out in turn: whole stretches of the logs if there are enough of them, else equal parts.
    fn blocks(&self) -> Vec<Range<usize>> {
        let count = self.residual.len();
        let mut edges = vec![0];
        edges.extend((1..count).filter(|&k| self.source[k].0 != self.source[k - 1].0));
        if edges.len() < FEWEST_LOGS {
            edges = (0..BLOCKS).map(|block| block * count / BLOCKS).collect();
        }
        let ends = edges[1..].iter().copied().chain([count]);
        edges.iter().copied().zip(ends).map(|(first, end)| first..end).filter(|block| !block.is_empty()).collect()
    }
}

/// How one selection of inputs did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// What the process looked at.
    pub inputs: Inputs,
    /// Root mean square residual of stretches of the logs that were left out, N·m (N).
    pub rmse: f64,
    /// Log marginal likelihood.
    pub log_marginal_likelihood: f64,
    /// How the search for its hyperparameters ended.
    pub status: SearchStatus,
}

/// What was learned for a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointReport {
    /// Rows of the residual, before thinning.
    pub rows: usize,
    /// Points of the process.
    pub points: usize,
    /// Root mean square residual that the physics leaves, N·m (N).
    pub physics_rmse: f64,
    /// Every selection that was tried.
    pub candidates: Vec<Candidate>,
    /// The one that was chosen; none if no process predicted stretches left out better than the physics alone.
    pub chosen: Option<Inputs>,
    /// What standard deviations are multiplied by so that they hold on stretches left out.
    pub calibration: f64,
}

/// The process of one joint, if it has one.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    pub gp: Option<GaussianProcess>,
    /// Variance of the measurement about the signal, N²·m² (N²), before calibration.
    pub noise_variance: f64,
    pub report: JointReport,
    /// Rows that are its points; empty for a model from a file.
    pub points: Vec<usize>,
}

/// Parts that are left out in turn ...
const BLOCKS: usize = 8;

/// ... unless there are this many logs.
const FEWEST_LOGS: usize = 3;

/// A process must explain at least this share of the mean square residual of stretches left out.
const GAIN: f64 = 0.05;

/// Fewer rows are not worth a process.
const FEWEST: usize = 20;

impl Rest {
    /// Tries the selections of inputs and keeps the best, if it is good enough.
    pub fn fit(
        joint: usize,
        n: usize,
        rows: &Rows,
        options: &SemiParametricOptions,
        compute: &Compute,
        progress: &dyn Progress,
    ) -> Result<Self, GpError> {
        let count = rows.residual.len();
        let mean_square = rows.residual.iter().map(|r| r * r).sum::<f64>() / count.max(1) as f64;
        let mut report = JointReport {
            rows: count,
            points: 0,
            physics_rmse: mean_square.sqrt(),
            candidates: vec![],
            chosen: None,
            calibration: 1.0,
        };
        if count < FEWEST || mean_square == 0.0 {
            return Ok(Self { gp: None, noise_variance: mean_square, report, points: vec![] });
        }
        let physics: Vec<(f64, f64)> = rows.residual.iter().map(|r| (*r, mean_square)).collect();
        report.calibration = calibration(&physics);
        let mut best = None;
        let mut lowest = if options.inputs.is_some() { f64::INFINITY } else { (1.0 - GAIN) * mean_square };
        let selections = options.inputs.map_or_else(|| distinct(n), |inputs| vec![inputs]);
        for inputs in selections {
            if progress.step("rest", report.candidates.len(), Inputs::EVERY.len()).is_err() {
                break;
            }
            let Found { gp, points, status } =
                process(inputs.columns(joint, n), n, rows, mean_square, options, compute, progress)?;
            let left_out = leave_stretches_out(&gp, rows, 3 * n + 1, compute)?;
            let loss = left_out.iter().map(|(error, _)| error * error).sum::<f64>() / count as f64;
            report.candidates.push(Candidate {
                inputs,
                rmse: loss.sqrt(),
                log_marginal_likelihood: gp.log_marginal_likelihood(),
                status,
            });
            if loss < lowest {
                lowest = loss;
                report.chosen = Some(inputs);
                best = Some((gp, points, left_out));
            }
        }
        let Some((gp, points, left_out)) = best else {
            return Ok(Self { gp: None, noise_variance: mean_square, report, points: vec![] });
        };
        report.calibration = calibration(&left_out);
        report.points = gp.data().len();
        Ok(Self { noise_variance: gp.covariance().total_noise_variance(), gp: Some(gp), report, points })
    }
}

/// Selections of inputs that differ for a robot of `n` joints.
fn distinct(n: usize) -> Vec<Inputs> {
    let mut seen = Vec::new();
    let differs = |inputs: &Inputs| {
        let columns = inputs.columns(0, n);
        let new = !seen.contains(&columns);
        seen.push(columns);
        new
    };
    Inputs::EVERY.into_iter().filter(differs).collect()
}

/// A process, the rows that are its points, and how the search went.
struct Found {
    gp: GaussianProcess,
    points: Vec<usize>,
    status: SearchStatus,
}

/// A process over `columns` of x with searched hyperparameters.
fn process(
    columns: Vec<usize>,
    n: usize,
    rows: &Rows,
    mean_square: f64,
    options: &SemiParametricOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<Found, GpError> {
    let width = 3 * n + 1;
    let scales = vec![1.0; columns.len()];
    let kernel = match options.ard {
        true => Kernel::ard(options.shape, &scales),
        false => Kernel::isotropic(options.shape, columns.len(), 1.0),
    };
    let kernel = kernel.on(&columns).scaled(1.0).fitted_to(&rows.x, width, 0.5 * mean_square);
    let memory =
        Kernel::isotropic(crate::gp::Shape::Exponential, 1, MEMORY).on(&[width - 1]).scaled(0.25 * mean_square);
    let start = Covariance::new(kernel, 0.25 * mean_square).with_correlated_noise(memory);
    let data = Data::new(rows.x.clone(), width, rows.residual.clone(), 1)?;
    let points = thin(&start.signal, &data, options.points);
    let data = data.select(&points);

    // Wide, so that data rule where they speak: they keep length scales from running off and noise from vanishing.
    let names = start.names();
    let theta = start.theta();
    let prior = |(name, theta): (&String, &f64)| match name.as_str() {
        name if name.starts_with("correlated_noise") => None,
        name if name.starts_with("length_scale") => Some((*theta, 1.5)),
        _ => Some((*theta, 2.0)),
    };
    let bound = |(name, theta): (&String, &f64)| match name.as_str() {
        "correlated_noise.length_scale" => (SHORTEST_MEMORY.ln(), LONGEST_MEMORY.ln()),
        name if name.starts_with("length_scale") => (theta - 4.0, theta + 7.0),
        "mixture" => (-4.0, 7.0),
        _ => (theta - 8.0, theta + 3.0),
    };
    let search_options = SearchOptions {
        starts: options.starts,
        bounds: Some(names.iter().zip(&theta).map(bound).collect()),
        priors: names.iter().zip(&theta).map(prior).collect(),
        evaluations: options.evaluations,
        gain: 1e-7,
        ..SearchOptions::default()
    };
    let found = search(&data, &start, &search_options, compute, progress)?;
    Ok(Found { gp: GaussianProcess::fit(data, found.covariance, compute)?, points, status: found.status })
}

/// Time over which neighbouring errors are first taken to be alike, and its bounds, s.
const MEMORY: f64 = 0.2;
const SHORTEST_MEMORY: f64 = 0.005;
const LONGEST_MEMORY: f64 = 5.0;

/// At most `count` points: those that say most about the others, then, when these say it all, some in between.
fn thin(kernel: &Kernel, data: &Data, count: usize) -> Vec<usize> {
    if data.len() <= count {
        return (0..data.len()).collect();
    }
    let mut chosen = informative_points(kernel, data.x(), data.inputs(), count);
    let mut taken = vec![false; data.len()];
    chosen.iter().for_each(|&k| taken[k] = true);
    let free: Vec<usize> = (0..data.len()).filter(|&k| !taken[k]).collect();
    let missing = count - chosen.len();
    chosen.extend((0..missing).map(|k| free[k * free.len() / missing]));
    chosen.sort_unstable();
    chosen
}

/// Error and variance of every row, predicted by a process that has not seen the stretch around it.
fn leave_stretches_out(
    gp: &GaussianProcess,
    rows: &Rows,
    width: usize,
    compute: &Compute,
) -> Result<Vec<(f64, f64)>, GpError> {
    let time = |x: &[f64]| x[width - 1];
    let mut all = Vec::with_capacity(rows.residual.len());
    for Range { start: first, end } in rows.blocks() {
        let x = &rows.x[first * width..end * width];
        let (from, to) = (time(x), time(&x[(end - first - 1) * width..]));
        let known = gp.data().x().chunks_exact(width).enumerate();
        let others: Vec<usize> = known.filter(|(_, x)| time(x) < from || time(x) > to).map(|(k, _)| k).collect();
        let noise = gp.covariance().total_noise_variance();
        let error = |residual: &f64, mean: f64, variance: f64| (residual - mean, variance + noise);
        if others.is_empty() {
            all.extend(rows.residual[first..end].iter().map(|r| error(r, 0.0, gp.covariance().signal.variance())));
            continue;
        }
        let without = GaussianProcess::fit(gp.data().select(&others), gp.covariance().clone(), compute)?;
        let predicted = without.predict(x, true)?;
        let predictions = predicted.mean.iter().zip(&predicted.variance);
        all.extend(rows.residual[first..end].iter().zip(predictions).map(|(r, (m, v))| error(r, *m, *v)));
    }
    Ok(all)
}

/// What standard deviations have to be multiplied by: between what makes 68 % and what makes 95 % of the errors fall within
/// one and within two.
fn calibration(errors: &[(f64, f64)]) -> f64 {
    let mut ratios: Vec<f64> = errors.iter().map(|(error, variance)| error.abs() / variance.sqrt()).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let quantile = |share: f64| ratios[((share * ratios.len() as f64) as usize).min(ratios.len() - 1)];
    (quantile(0.682_689) * quantile(0.954_5) / 2.0).sqrt()
}
