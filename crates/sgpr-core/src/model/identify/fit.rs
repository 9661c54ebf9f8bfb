//! From logs to a model, stage by stage: set up, observe, estimate, leave out or hold, and write
//! down.

use std::sync::Arc;

use faer::Mat;

use super::notes::{
    cost_note, cross_validation_note, dearest_joint, describe, dispersed, essential_note,
};
use super::references::{instruments, loops};
use super::source::{Logs, PARTS, Source, SourceFactors};
use super::{FitOutcome, Given, IdentifyError, IdentifyOptions, Start, Uncertainty};
use crate::identification::{
    BaseParameters, Consistency, ConsistentParameters, Costs, Dispersion, Equations, Essential,
    Estimate, EstimatorNeeds, Finding, Forecast, Held, IdentificationError, JointFactor, KeptOut,
    LeastSquares, LeftOut, ParameterPrior, ParameterSet, PriorWidth, block_bootstrap,
    essential_parameters, estimate, hac_covariance, nearest_load, screen_factors, screen_logs,
    screen_scale, stack, stacked, torque_sizes, weakest_good_deviation,
};
use crate::linalg::{Matrix, symmetric_eigen};
use crate::model::experiment::Experiment;
use crate::model::torque_model::{Certificate, Fit, nominal_parameters};
use crate::model::variable_projection::{self, Placed, TermFit};
use crate::model::{Term, TorqueModel, held};
use crate::motion::{Motion, Processing};
use crate::progress::Progress;
use crate::recording::Recording;
use crate::robot::Robot;

/// Times that joints are weighted anew by the residual of the consistent parameters.
const REWEIGHTINGS: usize = 3;

/// Squares of consistency's cost per parameter that noise explains.
const CHANCE: f64 = 0.25;

/// A model of recordings, how its fit went, and the motion in them.
pub(super) fn fit(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    processing: &Processing,
    given: Given,
    progress: &dyn Progress,
) -> Result<(TorqueModel, FitOutcome, Vec<Arc<Motion>>), IdentifyError> {
    let (of_state, others) = variable_projection::split(robot, &options.effects)?;
    let set = ParameterSet::new(robot, &of_state)?;
    let mut start = match options.start {
        Start::RobotFile => nominal_parameters(robot, &set),
        Start::Zero => vec![0.0; set.len()],
    };
    require_one_arm(options)?;
    let experiment = Experiment::new(recordings, processing)?;
    require_simulated(options, &others)?;
    let mut model = TorqueModel::from_parameters(robot.clone(), set.clone(), start.clone(), vec![]);
    let terms = TermFit::new(robot, &experiment, processing, given.clock)?;
    if !given.terms.is_empty() {
        model = terms.fitted(model.with_terms(given.terms, terms.clock), progress)?;
    }
    if !others.is_empty() {
        model = terms.with_effects(model, &others, progress)?;
    }
    let columns = terms.columns(&model)?;
    let set = set.with_trajectory_columns(columns.parameters.clone());
    start.resize(set.len(), 0.0);
    let base = BaseParameters::new(robot, &set);
    let references = instruments(robot, options, processing, &experiment.motions)?;
    let loops = loops(robot, options, &references)?;
    // Simulated instruments take the place of the reference that they are simulated from.
    let references = if loops.is_empty() { &references[..] } else { &[] };
    let trajectories = experiment.trajectories_with(references, &loops, Some(&columns))?;

    let source = Logs {
        robot,
        processing,
        experiment: &experiment,
        terms: &terms,
        set: &set,
        base: &base,
        trajectories: &trajectories,
    };
    let setup = Setup {
        robot,
        options,
        processing,
        source: &source,
        set: &set,
        base: &base,
        nominal: base.combine(&start),
        start: &start,
    };
    let mut equations = Equations::new(robot, &set, &base, trajectories.clone());
    let outcome = setup.fit(&mut model, &mut equations, progress)?;
    model.provenance.logs =
        recordings.iter().map(|recording| recording.source().to_string()).collect();
    let span =
        |recording: &Recording| Some([*recording.time().first()?, *recording.time().last()?]);
    model.provenance.spans = recordings.iter().filter_map(span).collect();
    Ok((model, outcome, experiment.motions))
}

pub(in crate::model) fn require_one_arm(options: &IdentifyOptions) -> Result<(), IdentifyError> {
    if options.consistency.is_some() && options.start == Start::Zero {
        return Err(IdentifyError::ConsistentError);
    }
    if options.consistency.is_some() && options.essential {
        return Err(IdentifyError::ConsistentAndEssential);
    }
    Ok(())
}

fn require_simulated(options: &IdentifyOptions, others: &[Placed]) -> Result<(), IdentifyError> {
    if !others.is_empty()
        && (options.controller.is_some() || options.method.needs() == EstimatorNeeds::Controller)
    {
        let effects = others.iter().map(|(effect, _)| effect.name().into()).collect();
        return Err(IdentifyError::NotSimulated { effects });
    }
    Ok(())
}

/// What is identified, from what, and how.
pub(in crate::model) struct Setup<'a> {
    pub robot: &'a Robot,
    pub options: &'a IdentifyOptions,
    pub processing: &'a Processing,
    pub source: &'a dyn Source,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    /// Values of all parameters that those keep which the motion does not determine, and the base
    /// parameters of them.
    pub start: &'a [f64],
    pub nominal: Vec<f64>,
}

/// The logs as triangular factors.
struct Observed {
    factors: Vec<JointFactor>,
    /// Of consecutive parts of all logs, one after the other.
    parts: Vec<Vec<JointFactor>>,
    /// Of each log, with its name; none of a single one.
    logs: Vec<(String, Vec<JointFactor>)>,
    /// Per factor: rows that carry as much as one independent row.
    correlation: Vec<f64>,
}

/// Base parameters, and what the user should know of them.
struct Estimated {
    estimate: Estimate,
    held: Option<Held>,
    /// Width of the prior of rich logs.
    weak: Option<f64>,
    dispersion: Dispersion,
    forecast: Option<Forecast>,
    notes: Vec<String>,
}

impl Setup<'_> {
    /// Sets parameters and fit of `model`.
    ///
    /// - `equations`: single rows, for methods that look at them; without trajectories where the
    ///   source knows none
    pub fn fit(
        &self,
        model: &mut TorqueModel,
        equations: &mut Equations<'_>,
        progress: &dyn Progress,
    ) -> Result<FitOutcome, IdentifyError> {
        let (mut data, prior) = self.observe(model, progress)?;
        let mut found = self.estimate(prior, equations, &mut data)?;
        let findings = self.screen(&data, &found.estimate);
        let essential = self.leave_out(&data, &mut found)?;
        self.keep_loads_bodies(model.terms(), &mut found.estimate);
        let certificate = self.hold(model, &mut data, &mut found)?;
        self.write_down(model, &data, &found, certificate)?;
        let Estimated { estimate, forecast, notes, .. } = found;
        Ok(FitOutcome { estimate, essential, forecast, notes, findings })
    }

    /// Brings the logs to triangular factors; `model` takes a first solution of them.
    fn observe(
        &self,
        model: &mut TorqueModel,
        progress: &dyn Progress,
    ) -> Result<(Observed, Option<(ParameterPrior, PriorWidth)>), IdentifyError> {
        let options = self.options;
        let SourceFactors { parts, logs } =
            self.source.factors(if options.prior.is_some() { PARTS } else { 1 }, progress)?;
        let mut factors = match &parts[..] {
            [all] => all.clone(),
            parts => stacked(parts.iter().flatten()),
        };
        if options.prior.is_some() {
            held::leave_out_joints_at_rest(&mut factors);
        }
        let prior = options.prior.map(|width| {
            let prior = ParameterPrior::new(self.robot, self.set, self.base, self.start, &factors);
            (if options.start == Start::Zero { prior.of_an_error() } else { prior }, width)
        });
        // The residual of a first solution tells how much the noise remembers: the estimates stay,
        // their spread grows.
        let first = LeastSquares::new(options.method.clone());
        let first = match &prior {
            Some((prior, _)) if first.has_few_rows(&factors, self.base.rank()) => {
                first.solve_with_prior(&factors, prior, PriorWidth::Given(1.0))?.estimate
            }
            _ => first.solve(&factors, self.base, &self.nominal)?,
        };
        model.set_all_parameters(&self.base.expand(&first.values, self.start));
        let correlation = self.source.correlation(model, &factors)?;
        Ok((Observed { factors, parts, logs, correlation }, prior))
    }

    /// The base parameters by the method and the prior of the options, with their covariance.
    fn estimate(
        &self,
        prior: Option<(ParameterPrior, PriorWidth)>,
        equations: &mut Equations<'_>,
        data: &mut Observed,
    ) -> Result<Estimated, IdentifyError> {
        let options = self.options;
        let Observed { factors, parts, correlation, .. } = data;
        let extents = &self.source.extents();
        let (robot, set, base) = (self.robot, self.set, self.base);
        if let Some((prior, _)) = prior.as_ref().filter(|_| options.method.reweights()) {
            let task = held::Task { robot, set, base, factors, parts, extents };
            // Noise is a matter of the logs, however wide a prior is wished for: under a wide one
            // parts that are left out are missed by what the others do not know.
            let first =
                task.solve(&options.method, equations, (prior, PriorWidth::Chosen), correlation)?;
            let noise = task.noise(&first);
            factors.iter_mut().zip(noise).for_each(|(factor, noise)| factor.least_noise = noise);
        }
        let task = held::Task { robot, set, base, factors, parts, extents };
        let held::HeldEstimate { mut estimate, held, weak, dispersion, mut notes } = match prior {
            None => held::HeldEstimate {
                estimate: estimate(
                    &options.method,
                    equations,
                    factors,
                    &self.nominal,
                    Some(correlation),
                )?,
                held: None,
                weak: None,
                dispersion: Dispersion::NONE,
                notes: vec![],
            },
            Some(prior) => {
                let kept = options.start == Start::RobotFile;
                task.estimate(&options.method, equations, prior, correlation, kept)?
            }
        };
        set_uncertainty(options, equations, (factors, correlation), &mut estimate, held.as_ref())?;
        *estimate.covariance *= faer::Scale(dispersion.deviation.powi(2));
        let mut forecast = None;
        if options.forecast
            && let Some(states) = self.source.states()?
        {
            let noise = per_joint(factors, &estimate.noise, self.robot.dof());
            forecast =
                Some(task.forecast(&estimate, held.as_ref(), dispersion.deviation, noise, states));
        }
        notes.append(&mut estimate.notes);
        Ok(Estimated { estimate, held, weak, dispersion, forecast, notes })
    }

    /// What speaks against the logs.
    fn screen(
        &self,
        Observed { factors, logs, .. }: &Observed,
        estimate: &Estimate,
    ) -> Vec<Finding> {
        let joints: Vec<String> = self.robot.joint_names().map(String::from).collect();
        let mut findings = screen_factors(self.set, self.base, &joints, factors, estimate);
        if self.options.start == Start::RobotFile {
            findings.extend(screen_scale(self.set, self.base, &self.nominal, factors));
        }
        findings.extend(screen_logs(logs, self.base, &self.nominal));
        findings
    }

    /// Leaves out what the data do not support, if that was asked for.
    fn leave_out(
        &self,
        data: &Observed,
        found: &mut Estimated,
    ) -> Result<Option<Essential>, IdentifyError> {
        if !self.options.essential {
            return Ok(None);
        }
        let estimate = &mut found.estimate;
        let folds = self.source.folds()?;
        let essential =
            essential_parameters(&folds, self.base.rank(), noise_of(&data.factors, estimate))?;
        found.notes.push(essential_note(&essential, self.base));
        estimate.values.clone_from(&essential.values);
        estimate.covariance.clone_from(&essential.covariance);
        if found.held.is_none() && counts_memory(self.options) {
            estimate.widen_for_few_rows(&data.factors, &data.correlation);
        }
        Ok(Some(essential))
    }

    /// Moves the loads that the terms take up or put down to the bodies nearest to them, and all
    /// other parameters with them: to what is likeliest, given these bodies.
    fn keep_loads_bodies(&self, terms: &[Term], estimate: &mut Estimate) {
        let mut first = self.set.len() - self.set.trajectory_columns().len();
        for term in terms {
            let own = first..first + term.effect.parameters().len();
            first = own.end;
            if !term.effect.is_body() {
                continue;
            }
            let index =
                |parameter| self.base.independent().iter().position(|kept| *kept == parameter);
            let Some(own) = own.map(index).collect::<Option<Vec<usize>>>() else { continue };
            let values: Vec<f64> = own.iter().map(|k| estimate.values[*k]).collect();
            let Some(&values) = values.first_chunk() else { continue };
            let spread =
                Mat::from_fn(own.len(), own.len(), |i, j| estimate.covariance[(own[i], own[j])]);
            let body = match nearest_load(&values, &spread, self.robot.length()) {
                Ok(body) => body,
                Err(error) => {
                    estimate
                        .notes
                        .push(format!("the load of `{}` is no body: {error}", term.effect.name()));
                    continue;
                }
            };
            let steps: Vec<f64> =
                body.parameters.iter().zip(values).map(|(body, value)| body - value).collect();
            follow(estimate, &own, &steps);
        }
    }

    /// Sets all parameters of `model`: to those that keep physics and limits, if that was asked
    /// for.
    fn hold(
        &self,
        model: &mut TorqueModel,
        data: &mut Observed,
        found: &mut Estimated,
    ) -> Result<Option<Certificate>, IdentifyError> {
        let Some(consistency) = &self.options.consistency else {
            model.set_all_parameters(&self.base.expand(&found.estimate.values, self.start));
            return Ok(None);
        };
        let mut consistency = consistency.clone();
        let torque = torque_sizes(&data.factors, self.robot.dof());
        if self.options.cross_validated_prior {
            let folds = self.source.folds()?;
            let parts =
                LeftOut::new(&folds, noise_of(&data.factors, &found.estimate), self.base.rank());
            let scores = consistency
                .cross_validate(self.robot, self.set, self.base, &parts, self.start, &torque)?;
            // None is best where the logs leave no error to count in.
            if let Some(deviation) = weakest_good_deviation(&scores) {
                consistency.prior.relative_deviation = deviation;
                found.notes.push(cross_validation_note(deviation, &scores));
            }
        }
        let (consistent, whitened) =
            self.solve_consistent(&consistency, &torque, model, data, found)?;
        let (costs, kept_out) =
            self.price(&consistency, &torque, (&consistent, &whitened), data, found)?;
        model.set_all_parameters(&consistent.parameters);
        found.estimate.values.clone_from(&consistent.base);
        found.notes.extend(consistent.notes.iter().cloned());
        Ok(Some(Certificate::new(consistent, costs, kept_out, consistency)))
    }

    /// Consistent parameters, and the equations that they solve.
    ///
    /// - `torque`: as in [`Consistency::solve`]
    fn solve_consistent(
        &self,
        consistency: &Consistency,
        torque: &[f64],
        model: &mut TorqueModel,
        data: &mut Observed,
        Estimated { estimate, held, .. }: &Estimated,
    ) -> Result<(ConsistentParameters, Matrix), IdentifyError> {
        let solve = |whitened: &Matrix| {
            consistency.solve(self.robot, self.set, self.base, whitened, self.start, torque)
        };
        // What the prior holds it holds here, too, beside rows that count as they did there.
        let mut whitened = match held {
            Some(held) => held.prior.beside(&held.data).into(),
            None => estimate.whitened.clone(),
        };
        let mut found = solve(&whitened)?;
        for _ in 0..if self.options.method.reweights() { REWEIGHTINGS } else { 0 } {
            // What transforms make depends on the parameters.
            model.set_all_parameters(&found.parameters);
            let anew = self.source.anew(model)?;
            let changed = anew.is_some();
            if let Some(factors) = anew {
                data.factors = factors;
            }
            whitened = match held {
                None => estimate.whitened_at(&data.factors, &found.base, &data.correlation).into(),
                Some(held) if changed => {
                    held.prior.beside(&stack(&data.factors, found.base.len(), &held.levels)).into()
                }
                Some(_) => break,
            };
            found = solve(&whitened)?;
        }
        Ok((found, whitened))
    }

    /// What the limits cost, and where the motion is new if that is more than chance.
    fn price(
        &self,
        consistency: &Consistency,
        torque: &[f64],
        (consistent, whitened): (&ConsistentParameters, &Matrix),
        data: &Observed,
        Estimated { estimate, notes, .. }: &mut Estimated,
    ) -> Result<(Costs, Option<KeptOut>), IdentifyError> {
        let (robot, set, base) = (self.robot, self.set, self.base);
        let costs = consistency.costs(robot, set, base, whitened, self.start, torque)?;
        let mut kept_out = None;
        // Least squares leaves one unit of variance per parameter to chance; a limit can take at
        // most as much of it.
        if consistent.cost.powi(2) > CHANCE {
            let folds = self.source.folds()?;
            let parts = LeftOut::new(&folds, noise_of(&data.factors, estimate), base.rank());
            // A part that the solver gives up on is no reason to lose the model.
            kept_out = consistency.kept_out(robot, set, base, &parts, self.start, torque).ok();
            let dearest = dearest_joint(robot, &data.factors, estimate, &consistent.base);
            notes.extend(cost_note(&costs, kept_out, &dearest));
        }
        Ok((costs, kept_out))
    }

    /// Fit and history of `model`.
    fn write_down(
        &self,
        model: &mut TorqueModel,
        Observed { factors, correlation, .. }: &Observed,
        Estimated { estimate, held, weak, dispersion, .. }: &Estimated,
        consistency: Option<Certificate>,
    ) -> Result<(), IdentifyError> {
        let (options, dof, rank) = (self.options, self.robot.dof(), model.base.rank());
        let joint = self.source.joint_covariance(model, &estimate.covariance)?;
        let covariance = Mat::from_fn(rank, rank, |i, j| joint[(i, j)]);
        let deviations: Vec<f64> = (0..rank).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect();
        let names = model.base.names();
        let undecided = held.as_ref().map_or(vec![], |held| held.prior.undecided(&held.data));
        let prior = held.as_ref().map(|held| &held.prior);
        let history = describe(options, self.processing, factors, (prior, *weak))
            + &dispersed(dispersion.deviation);
        model.provenance.history = vec![history];
        model.fit = Some(Fit {
            method: options.method.name().into(),
            covariance: row_major(&covariance),
            covariance_with_terms: if model.terms.is_empty() { vec![] } else { row_major(&joint) },
            noise: per_joint(factors, &estimate.noise, dof),
            rows: (0..dof).map(|joint| rows_of(factors, joint)).collect(),
            correlation: per_joint(factors, correlation, dof),
            dispersion: dispersion.deviation,
            half_interval_95: dispersion.half_interval_95,
            prior: options.prior,
            prior_standard_deviation: prior.map(ParameterPrior::relative_deviation),
            values: estimate.values[..rank].to_vec(),
            condition: estimate.excitation.condition,
            scaled_condition: estimate.excitation.scaled_condition,
            undetermined: (0..rank)
                .filter(|&k| deviations[k].is_infinite() || undecided.contains(&k))
                .map(|k| names[k].clone())
                .collect(),
            standard_deviations: deviations,
            consistency,
        });
        model.processing = Some(self.processing.clone());
        Ok(())
    }
}

/// Moves some parameters by `steps`, and all others to where they are likeliest then.
fn follow(estimate: &mut Estimate, moved: &[usize], steps: &[f64]) {
    let known: Vec<usize> =
        (0..estimate.values.len()).filter(|&k| estimate.covariance[(k, k)].is_finite()).collect();
    let is_known: Vec<(usize, f64)> = moved
        .iter()
        .copied()
        .zip(steps.iter().copied())
        .filter(|(k, _)| known.contains(k))
        .collect();
    let deviations: Vec<f64> =
        is_known.iter().map(|(k, _)| estimate.covariance[(*k, *k)].sqrt()).collect();
    let scaled = Mat::from_fn(is_known.len(), is_known.len(), |i, j| {
        estimate.covariance[(is_known[i].0, is_known[j].0)]
            / (deviations[i] * deviations[j]).max(f64::MIN_POSITIVE)
    });
    let (values, vectors) = symmetric_eigen(scaled.as_ref());
    let step = Mat::from_fn(is_known.len(), 1, |i, _| {
        is_known[i].1 / deviations[i].max(f64::MIN_POSITIVE)
    });
    let mut along = vectors.transpose() * step;
    let largest = values.iter().copied().fold(0.0, f64::max);
    for (k, value) in values.iter().enumerate() {
        // Directions with less of the variance than the digits hold do not move the others.
        along[(k, 0)] *= if *value > 1e-12 * largest { value.recip() } else { 0.0 };
    }
    let pulled = &vectors * along;
    for &k in known.iter().filter(|k| !moved.contains(k)) {
        let pull = |(i, (own, _)): (usize, &(usize, f64))| {
            estimate.covariance[(k, *own)] * pulled[(i, 0)] / deviations[i].max(f64::MIN_POSITIVE)
        };
        estimate.values[k] += is_known.iter().enumerate().map(pull).sum::<f64>();
    }
    moved.iter().zip(steps).for_each(|(k, step)| estimate.values[*k] += step);
}

/// Whether the covariance counts how much the residual of each joint remembers.
fn counts_memory(options: &IdentifyOptions) -> bool {
    options.uncertainty == Uncertainty::Memory && !options.method.counts_memory()
}

/// Sets the covariance as the options ask for it.
fn set_uncertainty(
    options: &IdentifyOptions,
    equations: &mut Equations<'_>,
    (factors, correlation): (&[JointFactor], &[f64]),
    estimate: &mut Estimate,
    held: Option<&Held>,
) -> Result<(), IdentificationError> {
    let undetermined = |estimate: &Estimate| -> Vec<usize> {
        (0..estimate.values.len()).filter(|&k| estimate.covariance[(k, k)].is_infinite()).collect()
    };
    let before = undetermined(estimate);
    let mut covariance = match options.uncertainty {
        Uncertainty::Memory if held.is_none() && counts_memory(options) => {
            estimate.widen_for_few_rows(factors, correlation);
            return Ok(());
        }
        // Under a prior what left-out parts show is counted.
        Uncertainty::Memory => return Ok(()),
        // The deviations of instrumental variables take residuals as they are already.
        Uncertainty::Hac if options.method.counts_memory() => return Ok(()),
        Uncertainty::Hac => hac_covariance(equations, factors, estimate, None)?,
        Uncertainty::Bootstrap { replicates } => {
            block_bootstrap(equations, factors, estimate, replicates.max(2), None)?.covariance()
        }
    };
    before.into_iter().for_each(|k| covariance[(k, k)] = f64::INFINITY);
    match held {
        None => estimate.covariance = covariance,
        Some(held) => held.prior.hold_covariance(estimate, &held.data, &covariance),
    }
    Ok(())
}

/// Noise level of the rows that a part of the data has in common with one of `factors`.
fn noise_of<'a>(
    factors: &'a [JointFactor],
    estimate: &'a Estimate,
) -> impl Fn(&JointFactor) -> f64 + 'a {
    |part| {
        let same =
            |factor: &&JointFactor| factor.joint == part.joint && factor.resting == part.resting;
        let index = factors.iter().position(|factor| same(&factor));
        index.map_or(f64::INFINITY, |index| estimate.weights[index] * estimate.unit)
    }
}

fn row_major(matrix: &Mat<f64>) -> Vec<f64> {
    matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect()
}

/// The figure of each joint in motion; of the joint at rest if it never moves, zero if it has no
/// row.
fn per_joint(factors: &[JointFactor], figures: &[f64], joints: usize) -> Vec<f64> {
    let of = |joint: usize| {
        factors.iter().position(|factor| factor.joint == joint).map_or(0.0, |index| figures[index])
    };
    (0..joints).map(of).collect()
}

fn rows_of(factors: &[JointFactor], joint: usize) -> usize {
    factors.iter().filter(|factor| factor.joint == joint).map(|factor| factor.rows).sum()
}
