//! The process of one joint: which inputs, which hyperparameters, and whether it helps on motion
//! that it has not seen.

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::all_rows::{self, EvidenceParts, SeenByAll, see_all};
use super::process::Process;
use super::rows::{LeftOutRows, ResidualRows, SHORTEST_MEMORY, Unseen, longest_memory};
use super::{Inputs, SemiParametricOptions};
use crate::gp::{
    Calibration, Compute, Covariance, Data, GaussianProcess, GpError, Inference, Kernel,
    SearchOptions, SearchStatus, informative_points, search,
};
use crate::identification::Judgement;
use crate::intervals::{HALF_INTERVAL_95, place_of_share};
use crate::progress::Progress;

/// How one selection of inputs did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Candidate {
    /// What the process looked at.
    pub inputs: Inputs,
    /// How it was computed.
    pub inference: Inference,
    /// Root mean square residual of the parts of the logs that were left out, by physics and
    /// process without them, N·m (N).
    pub rmse: f64,
    /// Log marginal likelihood of the points that its hyperparameters are from.
    pub log_marginal_likelihood: f64,
    /// How the search for its hyperparameters ended.
    pub status: SearchStatus,
}

/// What was learned for a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointReport {
    /// Rows of the residual, before thinning.
    pub rows: usize,
    /// Points of the process.
    pub points: usize,
    /// How the process is computed: with all rows as its points, with the most informative ones, or
    /// with all rows seen through inducing points.
    pub inference: Inference,
    /// Root mean square residual that the physics leaves, N·m (N).
    pub physics_rmse: f64,
    /// The same of parts of the logs that were left out in turn, by physics identified without
    /// them, N·m (N); of one or two logs by the same physics, unless the mean is
    /// [`super::Mean::Joint`].
    pub physics_rmse_left_out: f64,
    /// Every selection that was tried.
    pub candidates: Vec<Candidate>,
    /// The one that was chosen; none if no process predicted stretches left out better than the
    /// physics alone.
    pub chosen: Option<Inputs>,
    /// What standard deviations of process and noise are multiplied by so that 68 % of the errors
    /// on parts left out fall within one. What uncertain parameters bring is added as it is: a part
    /// says little of other motions.
    pub calibration: f64,
    /// What they are multiplied by to give the half of the interval that 95 % of the errors fall
    /// into: 1.96 times the above for errors with a normal distribution, more for errors with heavy
    /// tails.
    pub calibration_95: f64,
}

/// The process of one joint, if it has one.
#[derive(Clone, Debug)]
pub(super) struct JointProcess {
    pub gp: Option<Process>,
    /// Variance of the measurement about the signal, N²·m² (N²), before calibration.
    pub noise_variance: f64,
    pub report: JointReport,
    /// Rows that are its points; empty for a model from a file, or if it has seen all rows.
    pub points: Vec<usize>,
    /// What all rows say, if it has seen them through inducing points; empty for a model from a
    /// file.
    pub evidence: EvidenceParts,
}

/// A process must save at least this share of the sizes and squares of errors at what was left out,
/// and one that has seen all rows this share of the squares that one of some rows leaves.
const GAIN: f64 = 0.05;

/// So many rows per point are many: of fewer, the most informative points say nearly all, and the
/// parts of short logs that are left out are too few to tell the two apart.
const MANY: usize = 10;

/// Fewer rows are not worth a process.
pub(super) const FEWEST: usize = 20;

impl JointProcess {
    /// Tries the selections of inputs and keeps the best, if it is good enough.
    pub fn fit(
        joint: usize,
        n: usize,
        rows: &ResidualRows,
        unseen: &Unseen,
        options: &SemiParametricOptions,
        compute: &Compute,
        progress: &dyn Progress,
    ) -> Result<Self, GpError> {
        let Alone { mut report, mean_square } = Alone::new(rows, unseen);
        if report.rows < FEWEST || mean_square == 0.0 {
            return Ok(Self::without(report, mean_square));
        }
        let mut best: Option<Learned> = None;
        let data = Data::new(rows.x.clone(), 3 * n + 1, rows.residual.clone(), 1)?;
        let longest_memory = longest_memory(rows, &unseen.parts);
        let selections = options.inputs.map_or_else(|| distinct(n), |inputs| vec![inputs]);
        let mut stopped = false;
        for inputs in selections {
            if progress.step("residual", report.candidates.len(), Inputs::EVERY.len()).is_err() {
                stopped = true;
                break;
            }
            let columns = inputs.columns(joint, n);
            let FoundProcess { gp, points, status } = process(
                columns,
                &data,
                rows.terms.as_ref(),
                longest_memory,
                options,
                compute,
                progress,
            )?;
            let learned = Learned::new(gp, points, rows, unseen, (inputs, status), compute)?;
            report.candidates.push(learned.candidate.clone());
            let gain = |learned: &Learned| learned.nearby.gain + learned.elsewhere.gain;
            if best.as_ref().is_none_or(|best| gain(&learned) > gain(best)) {
                best = Some(learned);
            }
        }
        let Some(best) = best else { return Ok(Self::without(report, mean_square)) };
        let best = if stopped {
            best
        } else {
            let inducing = |signal: &Kernel| inducing_points(signal, &data, options.points);
            best.or_of_all_rows(inducing, rows, unseen, options, &mut report, compute)?
        };
        if options.inputs.is_none() {
            let columns = best.candidate.inputs.columns(joint, n);
            let learn = |data: &Data, terms: Option<&Mat<f64>>| {
                process(columns.clone(), data, terms, longest_memory, options, compute, progress)
            };
            if !best.saves() || !(stopped || saves_in_other_half(learn, rows, unseen)?) {
                return Ok(Self::without(report, mean_square));
            }
        }
        Self::with(best, report, rows, unseen, compute)
    }

    /// A joint without a process.
    pub fn without(report: JointReport, mean_square: f64) -> Self {
        Self {
            gp: None,
            noise_variance: mean_square,
            report,
            points: vec![],
            evidence: EvidenceParts::default(),
        }
    }

    /// A joint with a process.
    pub fn with(
        learned: Learned,
        mut report: JointReport,
        rows: &ResidualRows,
        unseen: &Unseen,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let Learned { process, points, evidence, mut errors, candidate, .. } = learned;
        errors.extend(match &process {
            Process::Exact(gp) => errors_left_out(gp, &points, rows, &unseen.anew, compute)?,
            Process::Sparse(sparse) => all_rows::errors_left_out(
                sparse,
                &evidence,
                rows,
                (&unseen.anew, 1 + unseen.parts.len()),
            )?,
        });
        report.chosen = Some(candidate.inputs);
        report.inference = candidate.inference;
        report.points = process.len();
        (report.calibration, report.calibration_95) = calibration(&errors, unseen.parts.len());
        let noise_variance = process.covariance().total_noise_variance();
        Ok(Self { gp: Some(process), noise_variance, report, points, evidence })
    }
}

/// A process that may become that of a joint.
pub(super) struct Learned {
    pub process: Process,
    /// As in [`JointProcess`].
    pub points: Vec<usize>,
    pub evidence: EvidenceParts,
    /// Error and variance of every row, part by part.
    pub errors: Vec<(f64, f64)>,
    pub candidate: Candidate,
    /// Parts, against the physics alone.
    pub nearby: Judgement,
    /// Runs of half of the parts, against the physics alone.
    pub elsewhere: Judgement,
}

impl Learned {
    /// - `found`: the inputs of the process, and how the search for its hyperparameters ended
    pub fn new(
        gp: GaussianProcess,
        points: Vec<usize>,
        rows: &ResidualRows,
        unseen: &Unseen,
        found: (Inputs, SearchStatus),
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let errors = errors_left_out(&gp, &points, rows, &unseen.parts, compute)?;
        let nearby = judge(&errors, &unseen.parts);
        let of_runs = errors_left_out(&gp, &points, rows, &unseen.runs, compute)?;
        let elsewhere = judge(&of_runs, &unseen.runs).of_independent(unseen.independent_runs());
        let all = points.len() == rows.residual.len();
        let candidate = Candidate {
            inputs: found.0,
            inference: if all {
                Inference::Exact
            } else {
                Inference::Subset { points: points.len() }
            },
            rmse: rmse_of(&errors),
            log_marginal_likelihood: gp.log_marginal_likelihood(),
            status: found.1,
        };
        Ok(Self {
            process: Process::Exact(gp),
            points,
            evidence: EvidenceParts::default(),
            errors,
            candidate,
            nearby,
            elsewhere,
        })
    }

    /// Whether parts and runs that were left out are predicted better than by the physics alone.
    pub fn saves(&self) -> bool {
        saves(&self.nearby) && saves(&self.elsewhere)
    }

    /// This process, or one that has seen all rows through inducing points if that saves [`GAIN`]
    /// of the squared errors at parts left out; unless rows are few for the points, or the options
    /// say which.
    ///
    /// - `inducing`: [`inducing_points`], asked for the signal of this process if they are wanted
    pub fn or_of_all_rows(
        self,
        inducing: impl FnOnce(&Kernel) -> Vec<f64>,
        rows: &ResidualRows,
        unseen: &Unseen,
        options: &SemiParametricOptions,
        report: &mut JointReport,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        let Process::Exact(gp) = &self.process else { return Ok(self) };
        let few = rows.residual.len() < MANY * self.points.len();
        if self.candidate.inference == Inference::Exact || !options.sparse.unwrap_or(!few) {
            return Ok(self);
        }
        let inducing = inducing(&gp.covariance().signal);
        let seen = see_all(gp, &self.points, &inducing, rows, unseen, compute)?;
        let Some(SeenByAll { process, errors, evidence }) = seen else { return Ok(self) };
        let inference = Inference::Sparse { inducing: process.len() };
        let candidate = Candidate { inference, rmse: rmse_of(&errors), ..self.candidate.clone() };
        report.candidates.push(candidate.clone());
        let better = candidate.rmse.powi(2) < (1.0 - GAIN) * self.candidate.rmse.powi(2);
        let nearby = judge(&errors, &unseen.parts);
        let other = Self {
            process,
            points: vec![],
            evidence,
            errors,
            candidate,
            nearby,
            elsewhere: self.elsewhere,
        };
        Ok(if options.sparse == Some(true) || better { other } else { self })
    }
}

/// At most `count` points of `data` through which all of them may be seen, `[points, inputs]`,
/// row-major.
pub(super) fn inducing_points(signal: &Kernel, data: &Data, count: usize) -> Vec<f64> {
    data.select(&informative_points(signal, data.x(), data.inputs(), count)).x().to_vec()
}

/// What the physics alone leaves over at a joint.
pub(super) struct Alone {
    /// Without candidates.
    pub report: JointReport,
    /// Of the residual.
    pub mean_square: f64,
}

impl Alone {
    pub fn new(rows: &ResidualRows, unseen: &Unseen) -> Self {
        let count = rows.residual.len();
        let mean_square = rows.residual.iter().map(|r| r * r).sum::<f64>() / count.max(1) as f64;
        let errors = |part: &LeftOutRows| -> Vec<(f64, f64)> {
            let errors = part.measured().zip(&part.variance);
            errors.map(|(error, variance)| (error, mean_square + variance)).collect()
        };
        let physics: Vec<(f64, f64)> = unseen.parts.iter().flat_map(errors).collect();
        let both: Vec<(f64, f64)> = unseen.parts_and_anew().flat_map(errors).collect();
        let enough = count >= FEWEST && mean_square > 0.0;
        let (calibration, calibration_95) =
            if enough { calibration(&both, unseen.parts.len()) } else { (1.0, HALF_INTERVAL_95) };
        let report = JointReport {
            rows: count,
            points: 0,
            inference: Inference::Exact,
            physics_rmse: mean_square.sqrt(),
            physics_rmse_left_out: if enough { rmse_of(&physics) } else { mean_square.sqrt() },
            candidates: vec![],
            chosen: None,
            calibration,
            calibration_95,
        };
        Self { report, mean_square }
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
pub(super) struct FoundProcess {
    pub gp: GaussianProcess,
    pub points: Vec<usize>,
    pub status: SearchStatus,
}

/// A process over `columns` of x with searched hyperparameters.
///
/// Where linear parameters are estimated together with it, they are unknown to the search: what
/// least squares leaves over lacks all that they could explain in its place.
///
/// - `terms`: derivatives by the linear parameters, `[rows, unknowns]`
/// - `longest_memory`: of the errors, s
pub(super) fn process(
    columns: Vec<usize>,
    data: &Data,
    terms: Option<&Mat<f64>>,
    longest_memory: f64,
    options: &SemiParametricOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<FoundProcess, GpError> {
    let (width, mean_square) = (data.inputs(), data.mean_square());
    let scales = vec![1.0; columns.len()];
    let kernel = match options.ard {
        true => Kernel::ard(options.shape, &scales),
        false => Kernel::isotropic(options.shape, columns.len(), 1.0),
    };
    let kernel = kernel.on(&columns).scaled(1.0).fitted_to(data.x(), width, 0.5 * mean_square);
    let memory =
        Kernel::isotropic(crate::gp::Shape::Exponential, 1, MEMORY.min(0.5 * longest_memory));
    let memory = memory.on(&[width - 1]).scaled(0.25 * mean_square);
    let start = Covariance::new(kernel, 0.25 * mean_square).with_correlated_noise(memory);
    let points = thin(&start.signal, data, options.points);
    let data = data.select(&points);

    // Wide, so that data rule where they speak: they keep length scales from running off and noise
    // from vanishing.
    let names = start.names();
    let theta = start.theta();
    let prior = |(name, theta): (&String, &f64)| match name.as_str() {
        name if name.starts_with("correlated_noise") => None,
        name if name.starts_with("length_scale") => Some((*theta, 1.5)),
        _ => Some((*theta, 2.0)),
    };
    let search_options = SearchOptions::default()
        .with_starts(options.starts)
        .with_bounds(Some(
            names
                .iter()
                .zip(&theta)
                .map(|(name, theta)| bounds(name, *theta, longest_memory))
                .collect(),
        ))
        .with_priors(names.iter().zip(&theta).map(prior).collect())
        .with_evaluations(options.evaluations)
        .with_gain(1e-7)
        .with_terms(terms.map_or_else(Vec::new, |terms| {
            points.iter().flat_map(|&k| terms.row(k).iter().copied()).collect()
        }));
    let found = search(&data, &start, &search_options, compute, progress)?;
    Ok(FoundProcess {
        gp: GaussianProcess::fit(data, found.covariance, compute)?,
        points,
        status: found.status,
    })
}

/// Time over which neighbouring errors are first taken to be alike, s.
const MEMORY: f64 = 0.2;

/// Bounds of the logarithm of a hyperparameter whose search starts at `theta`.
fn bounds(name: &str, theta: f64, longest_memory: f64) -> (f64, f64) {
    match name {
        // Its name ends with the column of the time.
        name if name.starts_with("correlated_noise.length_scale") => {
            (SHORTEST_MEMORY.ln(), longest_memory.ln())
        }
        name if name.starts_with("length_scale") => (theta - 4.0, theta + 7.0),
        "mixture" => (-4.0, 7.0),
        // It starts at half of the mean square of what is left over. A process that may be larger
        // than that where nothing is known explains the logs by what goes on straight in other
        // motions.
        "signal_variance" => (theta - 8.0, theta + 2.0_f64.ln()),
        _ => (theta - 8.0, theta + 3.0),
    }
}

/// At most `count` points: those that say most about the others, then, when these say it all, some
/// in between.
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

/// Errors at parts that were left out, of the physics alone and of physics and process: their sizes
/// or their squares, of which the process saves less beyond the standard error. That has to show in
/// the many small errors and in the few large ones.
///
/// - `errors`: of physics and process, part by part
pub(super) fn judge(errors: &[(f64, f64)], left_out: &[LeftOutRows]) -> Judgement {
    let mut errors = errors.iter().map(|(error, _)| *error);
    let sums = left_out
        .iter()
        .map(|part| [sums(part.measured()), sums(errors.by_ref().take(part.part.len()))]);
    less_certain_first(sums)[0]
}

/// What a second model saves of the sizes of errors and of their squares, that first of which it
/// saves less beyond the standard error.
///
/// - `sums`: [`sums`] of each part, of both models
fn less_certain_first(sums: impl Iterator<Item = [[f64; 2]; 2]>) -> [Judgement; 2] {
    let (sizes, squares): (Vec<_>, Vec<_>) =
        sums.map(|[before, after]| ((before[0], after[0]), (before[1], after[1]))).unzip();
    let (sizes, squares) = (Judgement::of(&sizes), Judgement::of(&squares));
    let certain = |judged: &Judgement| judged.gain - judged.standard_error;
    if certain(&sizes) < certain(&squares) { [sizes, squares] } else { [squares, sizes] }
}

/// Whether a process whose hyperparameters, too, are from one half of the logs predicts the other
/// half better than the physics alone, and the other way round. Those from all logs know which
/// inputs matter in what is left out of the residual: along a path that no log shows others may.
/// Errors must be smaller in size and square, the surer of the two for certain, as two halves tell
/// little of what few large errors make.
///
/// - `learn`: a process of some rows with their derivatives by linear parameters, if these are
///   estimated together with it
fn saves_in_other_half(
    learn: impl Fn(&Data, Option<&Mat<f64>>) -> Result<FoundProcess, GpError>,
    rows: &ResidualRows,
    unseen: &Unseen,
) -> Result<bool, GpError> {
    let count = rows.residual.len();
    let width = rows.x.len() / count;
    let (mut before, mut after) = (vec![0.0; count], vec![0.0; count]);
    let runs = &unseen.runs;
    for half in [&runs[0], &runs[runs.len() / 2]] {
        let others: Vec<usize> =
            (0..count).filter(|row| half.part.binary_search(row).is_err()).collect();
        let y = others.iter().map(|&row| half.residual[row]).collect();
        let data = Data::new(rows.at(&others, width), width, y, 1)?;
        let terms = rows
            .terms
            .as_ref()
            .map(|all| Mat::from_fn(others.len(), all.ncols(), |i, k| all[(others[i], k)]));
        let learned = Process::Exact(learn(&data, terms.as_ref())?.gp);
        for ((&row, measured), (error, _)) in
            half.part.iter().zip(half.measured()).zip(learned.errors(rows, half)?)
        {
            (before[row], after[row]) = (measured, error);
        }
    }
    let of_part = |part: &LeftOutRows| {
        [&before, &after].map(|errors| sums(part.part.iter().map(|&row| errors[row])))
    };
    let judged = less_certain_first(unseen.parts.iter().map(of_part));
    Ok(judged.iter().all(|judged| judged.gain > 0.0) && saves(&judged[1]))
}

/// Of the sizes of errors, and of their squares.
fn sums(errors: impl Iterator<Item = f64>) -> [f64; 2] {
    errors
        .fold([0.0, 0.0], |[sizes, squares], error| [sizes + error.abs(), squares + error * error])
}

/// Whether errors are smaller by [`GAIN`], and by more than the standard error: one part may have
/// it all while others lose.
pub(super) fn saves(judged: &Judgement) -> bool {
    judged.gain > GAIN && judged.is_better()
}

fn rmse_of(errors: &[(f64, f64)]) -> f64 {
    (errors.iter().map(|(error, _)| error * error).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

/// Error and variance of every row, predicted by physics and process that have not seen the part
/// around it.
fn errors_left_out(
    gp: &GaussianProcess,
    points: &[usize],
    rows: &ResidualRows,
    left_out: &[LeftOutRows],
    compute: &Compute,
) -> Result<Vec<(f64, f64)>, GpError> {
    let width = gp.data().inputs();
    let mut all = Vec::with_capacity(rows.residual.len());
    for left_out in left_out {
        let others: Vec<usize> = (0..points.len())
            .filter(|&k| left_out.part.binary_search(&points[k]).is_err())
            .collect();
        if others.is_empty() {
            let prior = gp.covariance().signal.variance() + gp.covariance().total_noise_variance();
            let spread = left_out.measured().zip(&left_out.variance);
            all.extend(spread.map(|(residual, variance)| (residual, prior + variance)));
            continue;
        }
        let y = others.iter().map(|&k| left_out.residual[points[k]]).collect();
        let data = Data::new(gp.data().select(&others).x().to_vec(), width, y, 1)?;
        let process = Process::Exact(GaussianProcess::fit(data, gp.covariance().clone(), compute)?);
        all.extend(process.errors(rows, left_out)?);
    }
    Ok(all)
}

/// What standard deviations have to be multiplied by so that 68 % and 95 % of the errors fall
/// within: the quantiles of the errors in standard deviations. Errors of a part have much in
/// common, so their quantiles are those of few observations, and a new log differs from them as
/// they do from each other: by a factor of sqrt(1 + 1 / parts) on their spread.
pub(super) fn calibration(errors: &[(f64, f64)], parts: usize) -> (f64, f64) {
    let count = errors.len();
    let rank = |share: f64| place_of_share(share, count);
    let wider = (1.0 + 1.0 / parts as f64).sqrt();
    let of_errors = || Calibration::of(errors.iter().copied(), rank, wider);
    let Calibration { deviation, half_interval_95, .. } =
        if count > 0 { of_errors() } else { Calibration::NORMAL };
    (deviation, half_interval_95)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gp::Shape;

    #[test]
    fn the_memory_of_errors_has_bounds_of_its_own() {
        let kernel = |shape| Kernel::isotropic(shape, 1, 1.0);
        let memory = kernel(Shape::Exponential).on(&[3]).scaled(1.0);
        let covariance =
            Covariance::new(kernel(Shape::SquaredExponential).on(&[0]).scaled(1.0), 0.1);
        let names = covariance.with_correlated_noise(memory).names();
        let of = |start: &str| {
            let name = names.iter().find(|name| name.starts_with(start)).expect("a hyperparameter");
            bounds(name, 0.0, 0.3)
        };
        assert_eq!(of("correlated_noise.length_scale"), (SHORTEST_MEMORY.ln(), 0.3_f64.ln()));
        assert_eq!(of("length_scale"), (-4.0, 7.0));
        assert_eq!(of("signal_variance"), (-8.0, 2.0_f64.ln()));
        assert_eq!(of("correlated_noise.signal_variance"), (-8.0, 3.0));
        assert_eq!(of("noise_variance"), (-8.0, 3.0));
    }

    #[test]
    fn a_process_has_to_hold_in_the_half_that_its_hyperparameters_have_not_seen() {
        // A joint that goes back and forth at 40 rows a second, eight parts; errors by a law of its
        // position.
        let rows = |law: fn(f64, f64) -> f64| {
            let (mut x, mut residual) = (vec![], vec![]);
            let mut random = sgpr_numeric::internal::Random::new(8);
            for k in 0..320 {
                let time = 0.025 * f64::from(k);
                let q = (4.0 * time).sin();
                x.extend([q, 4.0 * (4.0 * time).cos(), -16.0 * q, time]);
                residual.push(law(q, time) + 0.02 * random.normal());
            }
            ResidualRows { x, residual, source: (0..320).map(|k| (0, k)).collect(), terms: None }
        };
        let saves = |rows: &ResidualRows| {
            let left_out = |of: &[usize]| {
                let part: Vec<usize> =
                    of.iter().flat_map(|part| 40 * part..40 * (part + 1)).collect();
                LeftOutRows {
                    variance: vec![0.0; part.len()],
                    part,
                    residual: rows.residual.clone(),
                }
            };
            let runs = (0..8).map(|first| {
                let mut run = crate::identification::half_run(first, 8);
                run.sort_unstable();
                left_out(&run)
            });
            let parts = (0..8).map(|part| left_out(&[part]));
            let unseen = Unseen { parts: parts.collect(), runs: runs.collect(), anew: vec![] };
            let options = SemiParametricOptions::default();
            let learn = |data: &Data, terms: Option<&Mat<f64>>| {
                process(vec![0], data, terms, 0.05, &options, &options.compute, &())
            };
            saves_in_other_half(learn, rows, &unseen).expect("good rows")
        };
        assert!(saves(&rows(|q, _| (3.0 * q).sin())));
        assert!(!saves(&rows(|q, time| if time < 4.0 {
            (3.0 * q).sin()
        } else {
            -(3.0 * q).sin()
        })));
        // Neither does it help where nothing is to be learned.
        assert!(!saves(&rows(|_, _| 0.0)));
    }
}
