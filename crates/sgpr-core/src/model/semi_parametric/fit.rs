use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use faer::Mat;

use super::super::IdentifyError;
use super::super::compare::LogResidual;
use super::super::experiment::select_joints;
use super::super::torque_model::TorqueModel;
use super::basis::{self, ParameterBasis};
use super::joint_process::{Alone, JointProcess, JointReport, calibration, judge, saves};
use super::left_out::left_out;
use super::process::{Process, ProcessTerms};
use super::rows::{LeftOutRows, ResidualRows, Unseen};
use super::shared::{SELECTIONS, fit_shared};
use super::{
    Inputs, Mean, SemiParametricError, SemiParametricModel, SemiParametricOptions, identify,
};
use crate::gp::{Compute, GaussianProcess, GpError};
use crate::identification::{Dispersion, Judgement};
use crate::motion::{Processing, all_stretches};
use crate::progress::{Interrupted, Progress};
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;

/// A process of more points would be slow to use and could not be read back.
pub(super) const MOST_POINTS: usize = 20_000;

/// Fits a semi-parametric model: the physics, then a process for each joint, the joints in
/// parallel.
///
/// `progress` hears of the logs and of every selection of inputs; when it asks to stop after the
/// physics is there, the processes found so far are the result, and
/// [`SemiParametricModel::stopped`] says so.
///
/// # Errors
/// As [`identify`], or if the processes need more memory than allowed.
pub fn fit_semi_parametric(
    robot: &Robot,
    recordings: &[Recording],
    options: &SemiParametricOptions,
    progress: &dyn Progress,
) -> Result<SemiParametricModel, SemiParametricError> {
    check(options)?;
    let set = LogSet::whole(recordings);
    let (physics, report) = match options.mean {
        Mean::Zero => (nothing(robot, &set, options)?, None),
        Mean::Physics | Mean::Joint => {
            let (physics, report) = identify(robot, &set, &options.identify, progress)?;
            (physics, Some(Arc::new(report)))
        }
    };
    Ok(SemiParametricModel { report, ..learn(physics, &set, options, progress)? })
}

/// The same on top of physics that is there already, such as the model that a diagnosis has found
/// the effects for: `physics` predicts with all its effects, hidden states and transforms included,
/// and the processes learn the residual.
///
/// The options of the identification are not used, except for how logs are processed if `physics`
/// was not identified. `recordings` are best those that `physics` was identified from: what it
/// leaves over there is learned.
///
/// # Errors
/// As [`fit_semi_parametric`], or if the options ask for no physics.
pub fn fit_rest(
    physics: &TorqueModel,
    recordings: &[Recording],
    options: &SemiParametricOptions,
    progress: &dyn Progress,
) -> Result<SemiParametricModel, SemiParametricError> {
    check(options)?;
    if options.mean == Mean::Zero {
        return Err(SemiParametricError::PhysicsGiven);
    }
    let mut physics = physics.clone();
    if physics.processing.is_none() {
        let recordings = select_joints(physics.robot(), recordings).map_err(IdentifyError::from)?;
        let chosen = Processing::choose(&recordings, &options.identify.conditioning)
            .map_err(IdentifyError::from)?;
        physics.processing = Some(chosen.0);
    }
    for recording in recordings {
        let source = recording.source().to_string();
        if !physics.provenance.logs.contains(&source) {
            physics.provenance.logs.push(source);
        }
    }
    learn(physics, recordings, options, progress)
}

fn check(options: &SemiParametricOptions) -> Result<(), SemiParametricError> {
    if !(2..=MOST_POINTS).contains(&options.points) {
        return Err(SemiParametricError::Budget { points: options.points, most: MOST_POINTS });
    }
    if let Some(inputs) =
        options.inputs.filter(|inputs| options.shared && !SELECTIONS.contains(inputs))
    {
        return Err(SemiParametricError::NotShared { inputs: inputs.name() });
    }
    Ok(())
}

/// Learns what `physics` leaves over.
fn learn(
    physics: TorqueModel,
    recordings: &[Recording],
    options: &SemiParametricOptions,
    progress: &dyn Progress,
) -> Result<SemiParametricModel, SemiParametricError> {
    let robot = physics.robot().clone();
    let processing = physics.processing().expect("set with the model").clone();
    let set = LogSet::new(recordings);
    let recordings = set.logs();
    let recordings = select_joints(&robot, recordings).map_err(IdentifyError::from)?;
    let mut logs = Vec::new();
    for motion in all_stretches(&recordings, &processing).map_err(IdentifyError::from)? {
        let predicted = physics.predict_motion(&motion);
        logs.push(LogResidual::new(motion, predicted, &processing)?);
    }
    let mut rows: Vec<ResidualRows> =
        (0..robot.dof()).map(|joint| rows_of(&logs, joint, &processing)).collect();
    if options.mean == Mean::Joint {
        for (joint, rows) in rows.iter_mut().enumerate() {
            rows.terms = Some(basis::matrix(&physics, &logs, joint, rows, &processing)?);
        }
    }
    let unseen = left_out(&physics, &logs, &rows, &processing, options.mean)?;
    let (joints, stopped) = fit_joints(&rows, &unseen, options, progress)?;
    let mean = options.mean;
    let mut model = SemiParametricModel {
        physics,
        mean,
        joints,
        basis: None,
        identified: None,
        report: None,
        stopped,
    };
    if options.mean == Mean::Joint {
        let lost = keep_what_gains(&mut model, &rows, &unseen, &options.compute)?;
        let terms = basis::terms(&model.joints, &rows);
        let identified = model.physics.clone();
        estimate_again(&mut model, &rows, terms)?;
        if lost && model.joints.iter().any(|residual| residual.gp.is_some()) {
            model.identified = Some(identified);
        }
    }
    if options.mean == Mean::Physics {
        model.basis = ParameterBasis::of_physics(&model.physics);
    }
    let learned = model.joints.iter().filter(|residual| residual.gp.is_some()).count();
    model.physics.provenance.history.push(format!(
        "{} process of {learned} of {} joints on what is left over, at most {} points each",
        options.shape.name().replace('_', " "),
        robot.dof(),
        options.points
    ));
    Ok(model)
}

/// A model without torque, with the processing of the logs.
fn nothing(
    robot: &Robot,
    recordings: &[Recording],
    options: &SemiParametricOptions,
) -> Result<TorqueModel, IdentifyError> {
    let recordings = select_joints(robot, recordings)?;
    let parameters = vec![0.0; robot.standard_parameters().len()];
    let mut model = TorqueModel::with_parameters(robot, &[] as &[&str], parameters)?;
    model.processing = Some(Processing::choose(&recordings, &options.identify.conditioning)?.0);
    model.provenance.history = vec!["no physics".into()];
    model.provenance.logs =
        recordings.iter().map(|recording| recording.source().to_string()).collect();
    Ok(model)
}

/// Time between logs, s: more than any error is remembered.
const APART: f64 = 1e3;

/// Rows of a joint: the samples that count, as many per second as the identification takes.
fn rows_of(logs: &[LogResidual], joint: usize, processing: &Processing) -> ResidualRows {
    let mut rows = ResidualRows { x: vec![], residual: vec![], source: vec![], terms: None };
    let mut start = 0.0;
    for (index, log) in logs.iter().enumerate() {
        let (n, time, in_band) = (log.dof(), log.time(), log.in_band(joint));
        let seconds = |k: usize| (time[k] - time[0]) as f64 * 1e-9;
        for k in
            (0..time.len()).step_by(processing.decimation).filter(|k| log.counts(k * n + joint))
        {
            let sample: Range<usize> = k * n..(k + 1) * n;
            for part in [&log.motion.q, &log.motion.dq, &log.motion.ddq] {
                rows.x.extend_from_slice(&part[sample.clone()]);
            }
            rows.x.push(start + seconds(k));
            rows.residual.push(in_band.residual(k));
            rows.source.push((index, k));
        }
        start += seconds(time.len() - 1) + APART;
    }
    rows
}

/// Hears for a worker whether the caller wants to go on.
struct Relay<'a> {
    stopped: &'a AtomicBool,
    done: &'a AtomicUsize,
}

impl Progress for Relay<'_> {
    fn step(&self, stage: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        if stage == "residual" {
            self.done.fetch_add(1, Ordering::Relaxed);
        }
        if self.stopped.load(Ordering::Relaxed) { Err(Interrupted) } else { Ok(()) }
    }
}

/// The processes, and whether the listener stopped them. Only the calling thread talks to the
/// listener.
fn fit_joints(
    rows: &[ResidualRows],
    unseen: &[Unseen],
    options: &SemiParametricOptions,
    progress: &dyn Progress,
) -> Result<(Vec<JointProcess>, bool), GpError> {
    let n = rows.len();
    // Each joint computes on one thread; together they compute on all.
    let workers = if options.shared { 1 } else { options.compute.threads.clamp(1, n) };
    let compute = match options.shared {
        true => options.compute,
        false => Compute::default()
            .with_threads(1)
            .with_memory_limit(options.compute.memory_limit / workers as u64),
    };
    let (stopped, done, next) = (AtomicBool::new(false), AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || {
        crate::threads::prepare();
        let relay = Relay { stopped: &stopped, done: &done };
        let mut found = Vec::new();
        if options.shared {
            return match fit_shared(rows, unseen, options, &compute, &relay) {
                Ok(residuals) => residuals
                    .into_iter()
                    .enumerate()
                    .map(|(joint, residual)| (joint, Ok(residual)))
                    .collect(),
                Err(error) => vec![(0, Err(error))],
            };
        }
        loop {
            let joint = next.fetch_add(1, Ordering::Relaxed);
            if joint >= n {
                return found;
            }
            found.push((
                joint,
                JointProcess::fit(
                    joint,
                    n,
                    &rows[joint],
                    &unseen[joint],
                    options,
                    &compute,
                    &relay,
                ),
            ));
        }
    };
    let selections = if options.shared { SELECTIONS.len() } else { Inputs::EVERY.len() };
    let total = n * if options.inputs.is_some() { 1 } else { selections };
    let found = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        while !workers.iter().all(std::thread::ScopedJoinHandle::is_finished) {
            if progress.step("processes", done.load(Ordering::Relaxed).min(total), total).is_err() {
                stopped.store(true, Ordering::Relaxed);
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<_>>| {
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        workers.into_iter().flat_map(join).collect::<Vec<_>>()
    });
    let mut joints: Vec<Option<JointProcess>> = (0..n).map(|_| None).collect();
    for (joint, residual) in found {
        joints[joint] = Some(residual?);
    }
    let joints = joints
        .into_iter()
        .map(|residual| residual.expect("every joint was taken by a worker"))
        .collect();
    Ok((joints, stopped.into_inner()))
}

/// Leaves joints to the identified physics until all others gain for certain: physics and
/// processes, estimated together without a part of the logs, predict it better than the identified
/// physics without it. One joint goes at a time, the one that loses most: as long as its process is
/// there, parameters that it shares with others are wrong for these, too.
///
/// Returns whether a joint has lost its process.
fn keep_what_gains(
    model: &mut SemiParametricModel,
    rows: &[ResidualRows],
    unseen: &[Unseen],
    compute: &Compute,
) -> Result<bool, SemiParametricError> {
    let mut lost = false;
    loop {
        let errors = errors_of_parts(model, rows, unseen, compute)?;
        let joints = model.joints.iter().enumerate().filter(|(_, residual)| residual.gp.is_some());
        let judged =
            joints.map(|(joint, _)| (joint, judge_together(&errors[joint], &unseen[joint].parts)));
        let uncertain = judged.filter(|(_, judged)| !judged.as_ref().is_some_and(saves));
        let gain =
            |judged: &Option<Judgement>| judged.map_or(f64::NEG_INFINITY, |judged| judged.gain);
        let Some((joint, _)) = uncertain.min_by(|(_, a), (_, b)| gain(a).total_cmp(&gain(b)))
        else {
            for (joint, residual) in
                model.joints.iter_mut().enumerate().filter(|(_, residual)| residual.gp.is_some())
            {
                (residual.report.calibration, residual.report.calibration_95) =
                    calibration(&errors[joint], unseen[joint].parts.len());
            }
            return Ok(lost);
        };
        lost = true;
        let Alone { report, mean_square, .. } = Alone::new(&rows[joint], &unseen[joint]);
        let candidates = std::mem::take(&mut model.joints[joint].report.candidates);
        model.joints[joint] =
            JointProcess::without(JointReport { candidates, ..report }, mean_square);
    }
}

/// Parts that were left out, by physics and processes estimated together without them, against the
/// physics alone; none if nothing was seen beside a part.
///
/// - `errors`: of [`errors_of_parts`]
fn judge_together(errors: &[(f64, f64)], left_out: &[LeftOutRows]) -> Option<Judgement> {
    let rows: usize = left_out.iter().map(|part| part.part.len()).sum();
    (errors.len() == rows).then(|| judge(errors, left_out))
}

/// For each joint with a process: error and variance at the rows of parts that were left out in
/// turn, of physics and processes estimated together without the part.
fn errors_of_parts(
    model: &SemiParametricModel,
    rows: &[ResidualRows],
    unseen: &[Unseen],
    compute: &Compute,
) -> Result<Vec<Vec<(f64, f64)>>, SemiParametricError> {
    let mut errors = vec![Vec::new(); rows.len()];
    for index in 0..unseen[0].parts.len() {
        let part = |joint: usize| &unseen[joint].parts[index].part;
        let is_in = |joint: usize, row: usize| part(joint).binary_search(&row).is_ok();
        let mut together = NormalEquations::new(model);
        let mut processes = Vec::with_capacity(rows.len());
        for (joint, residual) in model.joints.iter().enumerate() {
            let found = residual
                .gp
                .as_ref()
                .map(|gp| without_part(gp, residual, &rows[joint], part(joint), index, compute));
            processes.push(match found {
                Some(found) => found?,
                None => {
                    let others: Vec<usize> =
                        (0..rows[joint].residual.len()).filter(|row| !is_in(joint, *row)).collect();
                    let (matrix, residual) = at_rows(&rows[joint], &others);
                    together.add_rows(joint, &matrix, &residual);
                    None
                }
            });
            if let Some((gp, terms)) = processes.last().expect("just there") {
                together.add(gp.normal_equations(terms));
            }
        }
        let together = together.solution();
        for (joint, process) in processes.into_iter().enumerate() {
            let Some((gp, terms)) = process else { continue };
            let gp = gp.without(&terms, &together)?;
            let part = part(joint);
            let predicted = gp.predict(&rows[joint].at(part, gp.inputs()), true)?;
            let (matrix, residual) = at_rows(&rows[joint], part);
            let explained = &matrix * &together;
            let noise = gp.covariance().total_noise_variance();
            for (i, residual) in residual.iter().enumerate() {
                let error = residual - explained[(i, 0)] - predicted.mean[i];
                errors[joint].push((error, predicted.variance[i] + noise));
            }
        }
    }
    Ok(errors)
}

/// The process of a joint that has not seen a part of the logs, and the linear terms as it sees
/// them; none if it has seen nothing else.
fn without_part(
    gp: &Process,
    residual: &JointProcess,
    rows: &ResidualRows,
    part: &[usize],
    index: usize,
    compute: &Compute,
) -> Result<Option<(Process, ProcessTerms)>, GpError> {
    match gp {
        Process::Exact(gp) => {
            let is_other = |k: &usize| part.binary_search(&residual.points[*k]).is_err();
            let others: Vec<usize> = (0..residual.points.len()).filter(is_other).collect();
            if others.is_empty() {
                return Ok(None);
            }
            let points: Vec<usize> = others.iter().map(|&k| residual.points[k]).collect();
            let terms =
                ProcessTerms::at_rows(rows.terms.as_ref().expect("with the mean `joint`"), &points);
            let gp =
                GaussianProcess::fit(gp.data().select(&others), gp.covariance().clone(), compute)?;
            Ok(Some((Process::Exact(gp), terms)))
        }
        Process::Sparse(sparse) => {
            let evidence = residual.evidence.without(Some(index));
            let terms = residual.evidence.terms(&evidence);
            Ok(Some((Process::Sparse(sparse.having_seen(&evidence, 0)?), terms)))
        }
    }
}

/// Regressor and residual at some rows.
fn at_rows(rows: &ResidualRows, chosen: &[usize]) -> (Mat<f64>, Vec<f64>) {
    let terms = rows.terms.as_ref().expect("with the mean `joint`");
    let matrix = Mat::from_fn(chosen.len(), terms.ncols(), |i, k| terms[(chosen[i], k)]);
    (matrix, chosen.iter().map(|&row| rows.residual[row]).collect())
}

/// Normal equations of the linear parameters, with the covariances of the processes.
struct NormalEquations<'a> {
    model: &'a SemiParametricModel,
    information: Mat<f64>,
    projection: Mat<f64>,
}

impl<'a> NormalEquations<'a> {
    fn new(model: &'a SemiParametricModel) -> Self {
        let unknowns = basis::unknowns(&model.physics);
        Self {
            model,
            information: Mat::zeros(unknowns, unknowns),
            projection: Mat::zeros(unknowns, 1),
        }
    }

    /// Change of the parameters, a column.
    fn solution(&self) -> Mat<f64> {
        let (change, _) = basis::solve(&self.information, &self.projection);
        Mat::from_fn(change.len(), 1, |k, _| change[k])
    }

    /// Adds information and projection.
    fn add(&mut self, (information, projection): (Mat<f64>, Mat<f64>)) {
        self.information += information;
        self.projection += projection;
    }

    /// Adds rows of a joint without a process: white errors, with the weight of rows that repeat
    /// each other.
    fn add_rows(&mut self, joint: usize, matrix: &Mat<f64>, residual: &[f64]) {
        let fit = self.model.physics.fit.as_ref();
        let correlation = fit.and_then(|fit| fit.correlation.get(joint)).copied().unwrap_or(1.0);
        let squares: f64 = residual.iter().map(|residual| residual * residual).sum();
        let variance = squares / residual.len().max(1) as f64 * correlation;
        let weighted = matrix * faer::Scale(if variance > 0.0 { 1.0 / variance } else { 0.0 });
        let residual = Mat::from_fn(residual.len(), 1, |i, _| residual[i]);
        self.add((matrix.transpose() * &weighted, weighted.transpose() * residual));
    }
}

/// Generalised least squares: the linear parameters and the processes together, hyperparameters as
/// they are. Without any process the parameters stay as they were identified.
///
/// Source: GPML eqs. 2.41 and 2.42, without a prior.
fn estimate_again(
    model: &mut SemiParametricModel,
    rows: &[ResidualRows],
    terms: Vec<ProcessTerms>,
) -> Result<(), SemiParametricError> {
    let rank = model.physics.base.rank();
    let mut equations = NormalEquations::new(model);
    for (joint, (residual, terms)) in model.joints.iter().zip(&terms).enumerate() {
        match &residual.gp {
            Some(gp) => equations.add(gp.normal_equations(terms)),
            None => equations.add_rows(joint, &terms.matrix, &rows[joint].residual),
        }
    }
    let (change, covariance) = basis::solve(&equations.information, &equations.projection);
    if model.joints.iter().all(|residual| residual.gp.is_none()) {
        model.basis = Some(ParameterBasis::new(covariance, vec![None; rows.len()], &model.joints));
        return Ok(());
    }
    let base = model.physics.base.clone();
    let before = base.combine(model.physics.parameters());
    let values: Vec<f64> =
        before.iter().zip(&change).map(|(value, change)| value + change).collect();
    let parameters = base.expand(&values, model.physics.parameters());
    model.physics.set_parameters(parameters);
    let mut at = rank;
    for term in &mut model.physics.terms {
        for (value, deviation) in term.coefficients.iter_mut().zip(&mut term.coefficient_deviations)
        {
            *value += change[at];
            *deviation = covariance[(at, at)].sqrt();
            at += 1;
        }
    }
    if let Some(fit) = &mut model.physics.fit {
        fit.method = "gls".into();
        fit.dispersion = Dispersion::NONE.deviation;
        fit.half_interval_95 = Dispersion::NONE.half_interval_95;
        for k in 0..rank {
            if fit.standard_deviations[k].is_finite() {
                fit.standard_deviations[k] = covariance[(k, k)].sqrt();
            }
        }
        fit.covariance = (0..rank * rank).map(|k| covariance[(k / rank, k % rank)]).collect();
        // The constants are those of the physics alone.
        fit.covariance_with_terms.clear();
        fit.values = values;
    }
    let change = Mat::from_fn(change.len(), 1, |k, _| change[k]);
    for (residual, terms) in model.joints.iter_mut().zip(&terms) {
        if let Some(gp) = &mut residual.gp {
            *gp = gp.without(terms, &change)?;
        }
    }
    let rows = model
        .joints
        .iter()
        .zip(terms)
        .map(|(residual, terms)| residual.gp.is_some().then_some(terms.matrix))
        .collect();
    model.basis = Some(ParameterBasis::new(covariance, rows, &model.joints));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight parts of ten rows at which the physics errs by one, and errors of physics and process
    /// at them.
    fn judged(errors: [f64; 8]) -> Judgement {
        let part = |index: usize| LeftOutRows {
            part: (10 * index..10 * index + 10).collect(),
            residual: vec![-1.0; 80],
            variance: vec![0.0; 10],
        };
        let mut left_out: Vec<LeftOutRows> = (0..8).map(part).collect();
        // A part in which the joint does not move says nothing.
        left_out
            .insert(3, LeftOutRows { part: vec![], residual: vec![-1.0; 80], variance: vec![] });
        let errors: Vec<(f64, f64)> = errors.iter().flat_map(|error| [(*error, 1.0); 10]).collect();
        assert!(judge_together(&errors[1..], &left_out).is_none());
        judge_together(&errors, &left_out).expect("all parts")
    }

    #[test]
    fn a_gain_is_certain_if_the_parts_agree() {
        let certain = |errors| saves(&judged(errors));
        assert!(certain([0.5; 8]));
        assert!((judged([0.5; 8]).gain - 0.5).abs() < 1e-12);
        assert!(certain([0.3, 0.6, 0.9, 0.4, -1.1, 0.5, 0.2, 0.8]));
        // Less than a twentieth, however even.
        assert!(!certain([0.96; 8]));
        // A tenth of the sizes and 0.58 of the eight squares, from one part; others lose.
        let one = [0.0, 1.0, 1.05, 1.1, -1.0, 1.05, 0.95, 1.05];
        assert!((judged(one).gain - 0.58 / 8.0).abs() < 1e-12 && !certain(one));
        assert!(!certain([1.5; 8]));
    }

    #[test]
    fn what_is_saved_shows_in_small_errors_and_in_large_ones() {
        // Parts of ten rows at which the physics errs by one nine times and by ten once.
        let measured: Vec<f64> =
            (0..80).map(|row| if row % 10 == 9 { 10.0 } else { 1.0 }).collect();
        let part = |index: usize| LeftOutRows {
            part: (10 * index..10 * index + 10).collect(),
            residual: measured.clone(),
            variance: vec![0.0; 10],
        };
        let left_out: Vec<LeftOutRows> = (0..8).map(part).collect();
        let judged = |small: f64, large: f64| {
            let of_row = |row: usize| (if row % 10 == 9 { large } else { small }, 1.0);
            judge_together(&(0..80).map(of_row).collect::<Vec<_>>(), &left_out).expect("all parts")
        };
        // Of the sizes (9 + 10) a third is gone, the squares (9 + 100) are more by a twentieth.
        assert!(
            (judged(0.2, 10.7).gain + 5.85 / 109.0).abs() < 1e-12 && !saves(&judged(0.2, 10.7))
        );
        // A third of the squares is gone, the sizes are more.
        assert!((judged(1.4, 7.0).gain + 0.6 / 19.0).abs() < 1e-12 && !saves(&judged(1.4, 7.0)));
        assert!(saves(&judged(0.8, 8.0)));
    }
}
