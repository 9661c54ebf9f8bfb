//! The main job: from a robot and logs to a model.

use faer::Mat;

use super::correlation::correlation;
use super::experiment::{Columns, Experiment, require_torque, select_joints, torque_of};
use super::limits::beyond_limits;
use super::torque_model::{Certificate, Fit, nominal_parameters};
use super::variable_projection::{self, TermFit};
use super::{IdentifyError, Term, TorqueModel, held};
use crate::identification::{
    BaseParameters, ClosedLoop, Consistency, Costs, Dispersion, Equations, Essential, Estimate, Finding, Forecast,
    Held, IdentificationError, JointFactor, KeptOut, LeastSquares, Method, Observation, ParameterPrior, ParameterSet,
    PriorWidth, Row, Trajectory, block_bootstrap, essential_parameters, estimate, hac_covariance, residual_norm,
    screen_delays, screen_factors, screen_rows, screen_scale, torque_sizes, weakest_good_deviation,
};
use crate::motion::{Conditioning, Motion, Processing};
use crate::progress::Progress;
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;
use crate::signal::CutoffChoice;

/// What to identify, and how.
#[derive(Clone, Debug)]
pub struct IdentifyOptions {
    /// Names of effects beside the rigid body, any that change the torque, at all joints or at one: `cable_stiffness`,
    /// `cable_hysteresis@joint_4`. Their constants are fitted by variable projection.
    pub effects: Vec<String>,
    /// The estimator.
    pub method: Method,
    /// Physics and limits that the full set of parameters keeps; none if `None`.
    pub consistency: Option<Consistency>,
    /// Whether the data choose how strong the pull toward the robot file is ([`Consistency::cross_validate`]).
    pub cross_validated_prior: bool,
    /// Whether parameters that the data do not support are left out.
    pub essential: bool,
    /// Where standard deviations come from.
    pub uncertainty: Uncertainty,
    /// The same motions without noise, simulated or the references, for instrumental variables; the references of the
    /// controller, if there is one.
    pub instruments: Vec<Recording>,
    /// The controller, for output error and for simulated instruments.
    pub controller: Option<Controller>,
    /// What is done to the logs.
    pub conditioning: Conditioning,
    /// Values that parameters keep where the motion does not determine them.
    pub start: Start,
    /// What holds parameters that the logs determine worse than the robot file does ([`ParameterPrior`]): the width of the
    /// prior; the bare estimate if `None`. With it a joint that the robot file predicts better on parts of the logs that
    /// were left out keeps the file.
    pub prior: Option<PriorWidth>,
    /// Whether the report says how much data is enough ([`Forecast`]).
    pub forecast: bool,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
        Self {
            effects: effects.map(String::from).to_vec(),
            method: Method::Wls,
            consistency: None,
            cross_validated_prior: false,
            essential: false,
            uncertainty: Uncertainty::Memory,
            instruments: Vec::new(),
            controller: None,
            conditioning: Conditioning::default(),
            start: Start::RobotFile,
            prior: Some(PriorWidth::Chosen),
            forecast: false,
        }
    }
}

/// Where the standard deviations of the estimates come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uncertainty {
    /// The scatter and the memory of each joint's residual, joints taken as independent.
    Memory,
    /// The residuals as they are, over time and between joints ([`hac_covariance`]).
    Hac,
    /// Experiments made of blocks of this one ([`block_bootstrap`]).
    Bootstrap {
        /// How many.
        replicates: usize,
    },
}

/// tau = torque of the reference's recording + kp (reference - q) + kd (its speed - dq), at the joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// `[n]`, N·m/rad (N/m).
    pub kp: Vec<f64>,
    /// `[n]`, N·m·s/rad (N·s/m).
    pub kd: Vec<f64>,
}

/// What the parameters are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The robot file: the torque of the log is the whole torque.
    RobotFile,
    /// Zero: the torque of the log is what an internal model leaves over, its feedback torque, and the result is the
    /// error of the internal model (thesis eqs. 4-18 to 4-20), to be added with [`TorqueModel::plus`].
    Zero,
}

/// How the identification went, beside the model.
#[derive(Clone, Debug)]
pub struct IdentificationReport {
    /// Per log: the spectra and the cut-off that they suggest.
    pub cutoff_choices: Vec<CutoffChoice>,
    /// Largest first.
    pub singular_values: Vec<f64>,
    /// Sentences that the user should read.
    pub warnings: Vec<String>,
    /// What speaks against the logs; each is among the warnings.
    pub findings: Vec<Finding>,
    /// Samples in the logs, and equations per joint taken from them.
    pub samples: usize,
    /// Which base parameters the data support, if that was asked for.
    pub essential: Option<Essential>,
    /// How much data is enough, if that was asked for.
    pub forecast: Option<Forecast>,
}

/// Identifies the torque model of `robot` from recordings.
///
/// The joints of each recording are picked by the names of the robot's joints. Samples that two recordings share count once
/// ([`LogSet`]), and a warning says so. `progress` hears of every log; `&()` for
/// silence.
///
/// # Errors
/// If a recording lacks a joint or torque, cannot be differentiated, or holds too little; each message names the
/// recording and says what to do.
pub fn identify(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: &dyn Progress,
) -> Result<(TorqueModel, IdentificationReport), IdentifyError> {
    // Instruments go with the recordings sample by sample.
    let set = options.instruments.is_empty().then(|| LogSet::new(recordings));
    let (recordings, said) = set.as_ref().map_or((recordings, &[][..]), |set| (set.logs(), set.notes()));
    let recordings = select_joints(robot, recordings)?;
    require_torque(robot, &recordings)?;
    let (processing, cutoff_choices) = Processing::choose(&recordings, &options.conditioning)?;
    let (model, Outcome { estimate, essential, forecast, notes, mut findings }) =
        fit(robot, &recordings, options, &processing, Given::default(), progress)?;
    findings.extend(beyond_limits(robot, &recordings));
    let found = findings.iter().map(ToString::to_string);
    let mut report = IdentificationReport {
        cutoff_choices,
        singular_values: estimate.excitation.singular_values,
        warnings: robot.warnings().into_iter().chain(said.iter().cloned()).chain(notes).chain(found).collect(),
        findings,
        samples: recordings.iter().map(Recording::len).sum(),
        essential,
        forecast,
    };
    warn(&mut report, &model);
    Ok((model, report))
}

/// `model` with these terms, everything fitted again under physical consistency.
///
/// # Errors
/// As [`identify`].
pub(crate) fn identify_again(
    model: &TorqueModel,
    given: Given,
    consistency: Option<&Consistency>,
    recordings: &[Recording],
) -> Result<TorqueModel, IdentifyError> {
    let recordings = select_joints(&model.robot, recordings)?;
    let processing = match &model.processing {
        Some(processing) => processing.clone(),
        None => Processing::choose(&recordings, &Conditioning::default())?.0,
    };
    let options = IdentifyOptions {
        effects: model.set.effects().iter().map(|effect| effect.name().into()).collect(),
        consistency: consistency.cloned(),
        ..IdentifyOptions::default()
    };
    let (mut again, _) = fit(&model.robot, &recordings, &options, &processing, given, &())?;
    again.provenance.history = model.provenance.history.clone();
    Ok(again)
}

/// Terms that a fit starts with.
#[derive(Default)]
pub(crate) struct Given {
    pub terms: Vec<Term>,
    /// Start of their clock, ns.
    pub clock: Option<i64>,
}

/// What a fit gives beside the model.
struct Outcome {
    estimate: Estimate,
    essential: Option<Essential>,
    forecast: Option<Forecast>,
    notes: Vec<String>,
    findings: Vec<Finding>,
}

fn fit(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    processing: &Processing,
    given: Given,
    progress: &dyn Progress,
) -> Result<(TorqueModel, Outcome), IdentifyError> {
    let (of_state, others) = variable_projection::split(robot, &options.effects)?;
    let mut set = ParameterSet::new(robot, &of_state)?;
    let mut start = match options.start {
        Start::RobotFile => nominal_parameters(robot, &set),
        Start::Zero => vec![0.0; set.len()],
    };
    if options.consistency.is_some() && options.start == Start::Zero {
        return Err(IdentifyError::ConsistentError);
    }
    if options.consistency.is_some() && options.essential {
        return Err(IdentifyError::ConsistentAndEssential);
    }
    let experiment = Experiment::new(recordings, processing)?;
    let motions = &experiment.motions;
    if !others.is_empty() && (options.controller.is_some() || options.method == Method::OutputError) {
        let effects = others.iter().map(|(effect, _)| effect.name().into()).collect();
        return Err(IdentifyError::NotSimulated { effects });
    }
    let mut model = TorqueModel::from_parameters(robot.clone(), set.clone(), start.clone(), vec![]);
    let terms = TermFit::new(robot, &experiment, processing, given.clock)?;
    if !given.terms.is_empty() {
        model = terms.fitted(model.with_terms(given.terms, terms.clock), progress)?;
    }
    if !others.is_empty() {
        model = terms.with_effects(model, &others, progress)?;
    }
    let columns = terms.columns(&model)?;
    set = set.with_trajectory_columns(columns.parameters.clone());
    start.resize(set.len(), 0.0);
    let base = BaseParameters::new(robot, &set);
    let instruments = instruments(robot, options, processing, motions)?;
    let loops = loops(robot, options, &instruments)?;
    // Simulated instruments take the place of the reference that they are simulated from.
    let given = if loops.is_empty() { &instruments[..] } else { &[] };
    let trajectories = experiment.trajectories_with(given, &loops, Some(&columns))?;
    let parts = if options.prior.is_some() { FOLDS } else { 1 };
    let samples = trajectories.iter().map(|trajectory| trajectory.samples.count(robot.dof())).sum();
    let mut observation = Observation::in_parts(robot, &set, &base, parts, samples);
    for (done, index) in order_of_logs(motions).into_iter().enumerate() {
        progress.step("observe", done, trajectories.len())?;
        observation.add(&trajectories[index])?;
    }
    progress.step("observe", trajectories.len(), trajectories.len())?;
    let (mut factors, parts) = (observation.factors(), observation.parts());
    let nominal = base.combine(&start);
    if options.prior.is_some() {
        held::leave_out_joints_at_rest(&mut factors);
    }
    let prior = options.prior.map(|width| {
        let prior = ParameterPrior::new(robot, &set, &base, &start, &factors);
        (if options.start == Start::Zero { prior.of_an_error() } else { prior }, width)
    });
    // The residual of a first solution tells how much the noise remembers: the estimates stay, their spread grows.
    let first = LeastSquares::new(options.method.clone());
    let first = match &prior {
        Some((prior, _)) if first.has_few_rows(&factors, base.rank()) => {
            first.solve_with_prior(&factors, prior, PriorWidth::Given(1.0))?.estimate
        }
        _ => first.solve(&factors, &base, &nominal)?,
    };
    model.set_all_parameters(&base.expand(&first.values, &start));
    let correlation = correlation(&model, motions, processing, &factors)?;
    let mut equations = Equations::new(robot, &set, &base, trajectories);
    let mut notes = Vec::new();
    let mut dispersion = Dispersion::NONE;
    let (mut estimate, held) = match prior {
        None => (estimate(&options.method, &mut equations, &factors, &nominal, Some(&correlation))?, None),
        Some((prior, width)) => {
            let task = held::Task { robot, set: &set, base: &base, factors: &factors, parts: &parts, motions };
            let kept = options.start == Start::RobotFile;
            let found = task.estimate(&options.method, &mut equations, (prior, width), &correlation, kept)?;
            notes.extend(found.notes);
            dispersion = found.dispersion;
            (found.estimate, found.held)
        }
    };
    set_uncertainty(options, &mut equations, &factors, &mut estimate, held.as_ref())?;
    estimate.covariance *= faer::Scale(dispersion.deviation.powi(2));
    let mut forecast = None;
    if options.forecast {
        let task = held::Task { robot, set: &set, base: &base, factors: &factors, parts: &parts, motions };
        let noise = per_joint(&factors, &estimate.noise, robot.dof());
        forecast = Some(task.forecast(&estimate, held.as_ref(), dispersion.deviation, noise)?);
    }
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    notes.append(&mut estimate.notes);
    let mut findings = screen_factors(&set, &base, &joints, &factors, &estimate);
    if options.start == Start::RobotFile {
        findings.extend(screen_scale(&set, &base, &nominal, &factors));
    }
    let mut essential = None;
    if options.essential {
        let found = self::essential(robot, &set, &base, equations.trajectories(), &factors, &estimate)?;
        notes.push(essential_note(&found, &base));
        estimate.values.clone_from(&found.values);
        estimate.covariance.clone_from(&found.covariance);
        essential = Some(found);
    }
    let consistent = match &options.consistency {
        None => None,
        Some(consistency) => {
            let mut consistency = consistency.clone();
            let torque = torque_sizes(&factors, robot.dof());
            if options.cross_validated_prior {
                let folds = folds(robot, &set, &base, equations.trajectories())?;
                let noise = noise_of(&factors, &estimate);
                let scores = consistency.cross_validate(robot, &set, &base, &folds, noise, &start, &torque)?;
                // None is best where the logs leave no error to count in.
                if let Some(deviation) = weakest_good_deviation(&scores) {
                    consistency.prior.relative_deviation = deviation;
                    notes.push(cross_validation_note(deviation, &scores));
                }
            }
            let solve = |whitened: &Mat<f64>| consistency.solve(robot, &set, &base, whitened, &start, &torque);
            // What the prior holds it holds here, too.
            let holding = |whitened: Mat<f64>| match &held {
                Some(held) => held.prior.beside(&whitened),
                None => whitened,
            };
            let mut whitened = holding(estimate.whitened.clone());
            let mut found = solve(&whitened)?;
            for _ in 0..if options.method.reweights() { REWEIGHTINGS } else { 0 } {
                if model.terms().iter().any(Term::is_transform) {
                    // What transforms make depends on the parameters.
                    model.set_all_parameters(&found.parameters);
                    let columns = terms.columns(&model)?;
                    factors = variable_projection::factors(robot, &set, &base, &experiment, &columns)?;
                }
                whitened = holding(estimate.whitened_at(&factors, &found.base, &correlation));
                found = solve(&whitened)?;
            }
            let costs = consistency.costs(robot, &set, &base, &whitened, &start, &torque)?;
            let mut kept_out = None;
            // Least squares leaves one unit of variance per parameter to chance; a limit can take at most as much of it.
            if found.cost.powi(2) > CHANCE {
                let folds = folds(robot, &set, &base, equations.trajectories())?;
                let noise = noise_of(&factors, &estimate);
                // A part that the solver gives up on is no reason to lose the model.
                kept_out = consistency.kept_out(robot, &set, &base, &folds, noise, &start, &torque).ok();
                notes.extend(cost_note(&costs, kept_out, &dearest_joint(robot, &factors, &estimate, &found.base)));
            }
            Some((found, costs, kept_out, consistency))
        }
    };
    match &consistent {
        None => model.set_all_parameters(&base.expand(&estimate.values, &start)),
        Some((consistent, ..)) => {
            model.set_all_parameters(&consistent.parameters);
            estimate.values.clone_from(&consistent.base);
            notes.extend(consistent.notes.iter().cloned());
        }
    }

    let rank = model.base.rank();
    let joint = terms.joint_covariance(&mut model, &estimate.covariance)?;
    let covariance = Mat::from_fn(rank, rank, |i, j| joint[(i, j)]);
    let deviations: Vec<f64> = (0..rank).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect();
    let names = model.base.names();
    let undecided = held.as_ref().map_or(vec![], |held| held.prior.undecided(&held.data));
    let prior = held.as_ref().map(|held| &held.prior);
    model.provenance.history = vec![describe(options, processing, &factors, prior) + &dispersed(dispersion.deviation)];
    model.fit = Some(Fit {
        method: options.method.name().into(),
        covariance: row_major(&covariance),
        covariance_with_terms: if model.terms.is_empty() { vec![] } else { row_major(&joint) },
        noise: per_joint(&factors, &estimate.noise, robot.dof()),
        rows: (0..robot.dof()).map(|joint| rows_of(&factors, joint)).collect(),
        correlation: per_joint(&factors, &correlation, robot.dof()),
        dispersion: dispersion.deviation,
        half_interval_95: dispersion.half_interval_95,
        values: estimate.values[..rank].to_vec(),
        condition: estimate.excitation.condition,
        scaled_condition: estimate.excitation.scaled_condition,
        undetermined: (0..rank)
            .filter(|&k| deviations[k].is_infinite() || undecided.contains(&k))
            .map(|k| names[k].clone())
            .collect(),
        standard_deviations: deviations,
        consistency: consistent.map(|(found, costs, kept_out, of)| Certificate::new(found, costs, kept_out, of)),
    });
    model.processing = Some(processing.clone());
    model.provenance.logs = recordings.iter().map(|recording| recording.source().to_string()).collect();
    Ok((model, Outcome { estimate, essential, forecast, notes, findings }))
}

/// Indices of motions in an order in which that of the logs does not show: by the torque that a log
/// begins with, then by that of all of it; stretches of a log stay one after the other.
///
/// Parts of the data go by it, and what is decided by parts that are left out.
fn order_of_logs(motions: &[Motion]) -> Vec<usize> {
    let square = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
    let mut keys: Vec<[f64; 2]> = Vec::with_capacity(motions.len());
    for (index, motion) in motions.iter().enumerate() {
        let goes_on = |before: &Motion| before.source == motion.source && before.time.last() < motion.time.first();
        let tau = motion.tau.as_deref().unwrap_or_default();
        let dof = motion.use_as.len() / motion.len().max(1);
        keys.push(match index.checked_sub(1) {
            Some(before) if goes_on(&motions[before]) => keys[before],
            _ => [square(&tau[..dof.min(tau.len())]), square(tau)],
        });
    }
    let mut order: Vec<usize> = (0..motions.len()).collect();
    let by_key = |a: &[f64; 2], b: &[f64; 2]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]));
    order.sort_by(|a, b| by_key(&keys[*a], &keys[*b]));
    order
}

/// Sets the covariance as the options ask for it.
fn set_uncertainty(
    options: &IdentifyOptions,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &mut Estimate,
    held: Option<&Held>,
) -> Result<(), IdentificationError> {
    let undetermined = |estimate: &Estimate| -> Vec<usize> {
        (0..estimate.values.len()).filter(|&k| estimate.covariance[(k, k)].is_infinite()).collect()
    };
    let before = undetermined(estimate);
    let mut covariance = match options.uncertainty {
        Uncertainty::Memory => return Ok(()),
        // The deviations of instrumental variables take residuals as they are already.
        Uncertainty::Hac if options.method == Method::InstrumentalVariables => return Ok(()),
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

/// Motions of the instruments, sample by sample those of the recordings.
fn instruments(
    robot: &Robot,
    options: &IdentifyOptions,
    processing: &Processing,
    motions: &[Motion],
) -> Result<Vec<Motion>, IdentifyError> {
    if options.instruments.is_empty() {
        return Ok(Vec::new());
    }
    let recordings = select_joints(robot, &options.instruments)?;
    let mut instruments = Vec::new();
    for recording in recordings.iter() {
        let as_controlled = reference_processing(processing, recording);
        let processing = if options.controller.is_some() { &as_controlled } else { processing };
        instruments.extend(Motion::from_recording(recording, processing)?);
    }
    let (samples, wanted): (Vec<usize>, Vec<usize>) =
        (instruments.iter().map(Motion::len).collect(), motions.iter().map(Motion::len).collect());
    if samples != wanted {
        let (found, expected) = (samples.len(), wanted.len());
        return Err(IdentifyError::Instruments { found, samples, expected, wanted });
    }
    Ok(instruments)
}

/// Motion of a reference as a controller has it: without the log's filter, and slow where it is slow, since it has no noise.
fn reference_processing(processing: &Processing, reference: &Recording) -> Processing {
    let cutoff_hz =
        reference.sample_rate_hz().map_or(processing.cutoff_hz, |rate| processing.cutoff_hz.max(REFERENCE_BAND * rate));
    let standstill_speed = vec![0.0; processing.standstill_speed.len()];
    Processing { cutoff_hz, standstill_speed, turn_margin: 0.0, ..processing.clone() }
}

/// Band of a reference as a share of its sampling rate; half of it would be all.
const REFERENCE_BAND: f64 = 0.4;

/// Longest integration step of a simulated motion, s: dry friction that changes sign within it is followed exactly enough.
const LONGEST_STEP: f64 = 2.5e-4;

fn loops<'a>(
    robot: &Robot,
    options: &'a IdentifyOptions,
    references: &'a [Motion],
) -> Result<Vec<ClosedLoop<'a>>, IdentifyError> {
    let Some(Controller { kp, kd }) = &options.controller else {
        return if options.method == Method::OutputError { Err(IdentifyError::NoController) } else { Ok(Vec::new()) };
    };
    if references.is_empty() {
        return Err(IdentifyError::NoController);
    }
    if let Some(gains) = [kp, kd].into_iter().find(|gains| gains.len() != robot.dof()) {
        return Err(IdentifyError::Gains { found: gains.len(), joints: robot.dof() });
    }
    let of_motion = |reference: &'a Motion| ClosedLoop {
        reference: reference.samples(),
        feed_forward: reference.tau.as_deref(),
        kp,
        kd,
        rate_hz: reference.rate_hz,
        steps: (1.0 / (reference.rate_hz * LONGEST_STEP)).ceil() as usize,
    };
    Ok(references.iter().map(of_motion).collect())
}

/// Times that joints are weighted anew by the residual of the consistent parameters.
const REWEIGHTINGS: usize = 3;

/// Squares of consistency's cost per parameter that noise explains.
const CHANCE: f64 = 0.25;

/// Parts of the data, each of which is predicted from the others.
const FOLDS: usize = 5;

fn essential(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    trajectories: &[Trajectory<'_>],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Result<Essential, IdentificationError> {
    let folds = folds(robot, set, base, trajectories)?;
    essential_parameters(&folds, base.rank(), noise_of(factors, estimate))
}

/// Noise level of the rows that a part of the data has in common with one of `factors`.
fn noise_of<'a>(factors: &'a [JointFactor], estimate: &'a Estimate) -> impl Fn(&JointFactor) -> f64 + 'a {
    |part| {
        let same = |factor: &&JointFactor| factor.joint == part.joint && factor.resting == part.resting;
        let index = factors.iter().position(|factor| same(&factor));
        index.map_or(f64::INFINITY, |index| estimate.weights[index] * estimate.unit)
    }
}

/// Factors of consecutive parts of all trajectories.
fn folds(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    trajectories: &[Trajectory<'_>],
) -> Result<Vec<Vec<JointFactor>>, IdentificationError> {
    let n = robot.dof();
    let mut folds = Vec::new();
    for fold in 0..FOLDS {
        let mut observation = Observation::new(robot, set, base);
        for trajectory in trajectories {
            let count = trajectory.samples.count(n);
            let part = fold * count / FOLDS * n..(fold + 1) * count / FOLDS * n;
            let row = |k: usize| {
                let row = trajectory.use_as.map_or(Row::Moving, |use_as| use_as[k]);
                if part.contains(&k) { row } else { Row::Skip }
            };
            let use_as: Vec<Row> = (0..count * n).map(row).collect();
            observation.add(&Trajectory { use_as: Some(&use_as), ..*trajectory })?;
        }
        folds.push(observation.factors());
    }
    Ok(folds)
}

fn cross_validation_note(chosen: f64, scores: &[(f64, f64)]) -> String {
    let scores: Vec<String> = scores.iter().map(|(deviation, error)| format!("{deviation}: {error:.3}")).collect();
    format!(
        "the robot file's values are taken to be right within {chosen} times their size: the weakest pull with which parts \
         of the logs are predicted from the others as well as with any (error by relative deviation: {})",
        scores.join(", ")
    )
}

/// Sentences on what the limits cost, which of them, and whether that costs where the motion is new.
fn cost_note(costs: &Costs, kept_out: Option<KeptOut>, joint: &str) -> Option<String> {
    let stages: Vec<String> =
        costs.stages.iter().map(|stage| format!("{} ({:.1} %)", stage.limit, stage.residual_percent)).collect();
    let kept_out = kept_out.map(|KeptOut { unconstrained_percent, consistent_percent }| {
        format!(
            ". Parts of the logs predicted from the others: error {consistent_percent:.2} % of the torque with the limits, \
             {unconstrained_percent:.2} % without: {}",
            if consistent_percent <= unconstrained_percent {
                "where the motion is new they cost nothing"
            } else {
                "they cost where the motion is new, too"
            }
        )
    });
    let given = match &costs.given[..] {
        [] => String::new(),
        limits => format!(" Check what you set: {}.", limits.join(", ")),
    };
    (!stages.is_empty()).then(|| {
        format!(
            "consistency costs more than noise explains: the weighted residual is {:.1} % larger than without limits, most at \
             {joint}. Limits left out one after the other, and what is left of that: {}.{given} Limits of \
             physics are not wrong: look there for an effect that the model lacks (a cable, a spring, a sensor), which inertias \
             that no body has and negative friction imitate{}",
            costs.residual_percent,
            stages.join("; "),
            kept_out.unwrap_or_default()
        )
    })
}

/// The joint whose residual the limits raise most, with the residual before and after.
fn dearest_joint(robot: &Robot, factors: &[JointFactor], estimate: &Estimate, consistent: &[f64]) -> String {
    let moving = factors.iter().zip(&estimate.weights).filter(|(factor, _)| !factor.resting && factor.rows > 0);
    let norms = moving.map(|(factor, weight)| {
        let [before, after] = [&estimate.values[..], consistent].map(|base| residual_norm(factor, base));
        (factor, before, after, (after.powi(2) - before.powi(2)) / weight.powi(2))
    });
    norms.max_by(|a, b| a.3.total_cmp(&b.3)).map_or_else(String::new, |(factor, before, after, _)| {
        let joint = &robot.joints()[factor.joint];
        let rows = (factor.rows as f64).sqrt();
        let unit = joint.kind.torque_unit();
        format!("{} ({:.3} to {:.3} {unit})", joint.name, before / rows, after / rows)
    })
}

fn essential_note(essential: &Essential, base: &BaseParameters) -> String {
    let Some(last) = essential.dropped.last() else {
        return format!("the data support all {} base parameters", base.rank());
    };
    let names: Vec<&str> = essential.dropped.iter().map(|dropped| base.names()[dropped.base].as_str()).collect();
    let change = 100.0 * (essential.validation[names.len()] - 1.0);
    format!(
        "{} of {} base parameters are not supported by the data and are left out: {}; that raises the squared residual by \
         {:.1} of its variance ({:.1} are chance), and the error on data kept out of the fit changes by {change:+.2} %",
        names.len(),
        base.rank(),
        names.join(", "),
        last.rise,
        last.limit
    )
}

/// What is suspicious in recordings from which `model` was identified, the rows of the data included: torques that are
/// late, outliers, times on which everything hangs.
///
/// # Errors
/// As [`identify`].
pub fn screen(model: &TorqueModel, recordings: &[Recording]) -> Result<Vec<Finding>, IdentifyError> {
    let Some(processing) = &model.processing else { return Ok(Vec::new()) };
    let (robot, set, base) = (&model.robot, &model.set, &model.base);
    let recordings = select_joints(robot, recordings)?;
    let experiment = Experiment::new(&recordings, processing)?;
    // What the terms make is no matter of the rigid body.
    let mut tau = Vec::with_capacity(experiment.motions.len());
    for motion in &experiment.motions {
        let (whole, own) = (model.predict_motion(motion), model.without_terms().predict(motion.samples()));
        let torques = torque_of(motion)?.iter().zip(whole.iter().zip(&own));
        tau.push(torques.map(|(tau, (whole, own))| tau - (whole - own)).collect());
    }
    let columns = Columns { tau, values: vec![vec![]; experiment.motions.len()], parameters: vec![] };
    let equations = Equations::new(robot, set, base, experiment.trajectories_with(&[], &[], Some(&columns))?);
    let factors = equations.factors()?;
    let memory = correlation(model, &experiment.motions, processing, &factors)?;
    let estimate = LeastSquares { method: Method::Wls, correlation: Some(memory) };
    let estimate = estimate.solve(&factors, base, &base.combine(&model.parameters))?;
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    let mut findings = screen_factors(set, base, &joints, &factors, &estimate);
    // Dry friction near turns looks like a torque at another time, and like outliers, as do the ends of a log.
    let calm = Processing { turn_margin: processing.turn_margin.max(1.0), ..processing.clone() };
    let calm = Experiment::new(&recordings, &calm)?.settled();
    let mut equations = Equations::new(robot, set, base, calm.trajectories_with(&[], &[], Some(&columns))?);
    findings.extend(screen_rows(&mut equations, &joints, &calm.rates_hz(), &factors, &estimate)?);
    findings.extend(screen_delays(&equations, &joints, &calm.rates_hz())?);
    Ok(findings)
}

fn row_major(matrix: &Mat<f64>) -> Vec<f64> {
    matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect()
}

/// The figure of each joint in motion; of the joint at rest if it never moves, zero if it has no row.
fn per_joint(factors: &[JointFactor], figures: &[f64], joints: usize) -> Vec<f64> {
    let of = |joint: usize| factors.iter().position(|factor| factor.joint == joint).map_or(0.0, |index| figures[index]);
    (0..joints).map(of).collect()
}

fn rows_of(factors: &[JointFactor], joint: usize) -> usize {
    factors.iter().filter(|factor| factor.joint == joint).map(|factor| factor.rows).sum()
}

fn dispersed(dispersion: f64) -> String {
    if dispersion == 1.0 {
        return String::new();
    }
    format!(
        "; standard deviations are {dispersion:.2} times those of the noise, because parts of the logs predict the others \
         so much worse"
    )
}

fn describe(
    options: &IdentifyOptions,
    processing: &Processing,
    factors: &[JointFactor],
    prior: Option<&ParameterPrior>,
) -> String {
    let what = match options.start {
        Start::RobotFile => "identified",
        Start::Zero => "identified as the error of an internal model",
    };
    let mut method = options.method.title().to_string();
    if options.consistency.is_some() {
        method += " under physical consistency";
    }
    let band = match processing.torque_cutoff_hz {
        Some(hz) => format!("both sides filtered at {hz:.2} Hz, one row of {} taken", processing.decimation),
        None => "both sides unfiltered".into(),
    };
    let effects = if options.effects.is_empty() { "no effects".into() } else { options.effects.join(", ") };
    let rows: usize = factors.iter().map(|factor| factor.rows).sum();
    let hz = processing.cutoff_hz;
    let prior = prior.map_or(String::new(), |prior| {
        format!(
            "; what the logs do not determine is held by the robot file, right within {} times the size of a link, and by \
             friction within {} times the torque that the file leaves",
            prior.relative_deviation(),
            prior.effect_scale()
        )
    });
    format!("{what} by {method} from {rows} rows with {effects}; position filtered at {hz:.2} Hz, {band}{prior}")
}

fn warn(report: &mut IdentificationReport, model: &TorqueModel) {
    let Some(fit) = &model.fit else { return };
    let bare = fit.standard_deviations.iter().any(|deviation| deviation.is_infinite());
    if bare && !fit.undetermined.is_empty() {
        report.warnings.push(format!(
            "the motion does not excite {} of {} base parameters: {}; they keep their values of the robot file. Record a \
             motion that moves these joints, fast and slow, in both directions",
            fit.undetermined.len(),
            model.base.rank(),
            fit.undetermined.join(", ")
        ));
    }
    let uncertain: Vec<&str> = model
        .base
        .names()
        .iter()
        .enumerate()
        .filter(|(k, _)| fit.standard_deviations[*k].is_finite() && fit.standard_deviations[*k] > fit.values[*k].abs())
        .map(|(_, name)| name.as_str())
        .collect();
    if !uncertain.is_empty() {
        let parameters = if uncertain.len() == 1 { "base parameter is" } else { "base parameters are" };
        report.warnings.push(format!(
            "{} {parameters} smaller than their standard deviation: {}",
            uncertain.len(),
            uncertain.join(", ")
        ));
    }
}

/// What another cut-off would have made of the same logs.
#[derive(Clone, Debug)]
pub struct CutoffInfluence {
    /// Cut-off, Hz.
    pub cutoff_hz: f64,
    /// Largest change of a base parameter, in its standard deviations.
    pub largest_change: f64,
    /// Root mean square change of the base parameters, in their standard deviations.
    pub typical_change: f64,
    /// The model that results.
    pub model: TorqueModel,
}

/// Repeats the identification with cut-offs around the one that was used: results must not hinge on it.
///
/// # Errors
/// As [`identify`].
pub fn cutoff_influence(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    model: &TorqueModel,
    progress: &dyn Progress,
) -> Result<Vec<CutoffInfluence>, IdentifyError> {
    let recordings = select_joints(robot, recordings)?;
    let (Some(processing), Some(reference)) = (&model.processing, &model.fit) else { return Ok(vec![]) };
    // The pull that the data chose stays what it was.
    let mut options = options.clone();
    options.cross_validated_prior = false;
    let chosen = reference.consistency.as_ref().and_then(|certificate| certificate.prior_deviation);
    if let (Some(consistency), Some(deviation)) = (&mut options.consistency, chosen) {
        consistency.prior.relative_deviation = deviation;
    }
    let options = &options;
    let mut influences = Vec::new();
    let factors = [0.5, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::SQRT_2, 2.0];
    for (index, factor) in factors.into_iter().enumerate() {
        progress.step("other cut-offs", index, factors.len())?;
        let mut conditioning = options.conditioning.clone();
        conditioning.cutoff_hz = Some(factor * processing.cutoff_hz);
        let Ok((processing, _)) = Processing::choose(&recordings, &conditioning) else { continue };
        let other = match fit(robot, &recordings, options, &processing, Given::default(), &()) {
            Ok((model, _)) => model,
            // Twice the cut-off can lie beyond what the sampling rate holds.
            Err(IdentifyError::Signal(_) | IdentifyError::Motion(_)) => continue,
            Err(error) => return Err(error),
        };
        let values = &other.fit.as_ref().expect("just fitted").values;
        let changes = values.iter().zip(&reference.values).zip(&reference.standard_deviations);
        let changes: Vec<f64> = changes
            .filter(|(_, deviation)| deviation.is_finite() && **deviation > 0.0)
            .map(|((new, old), deviation)| (new - old).abs() / deviation)
            .collect();
        influences.push(CutoffInfluence {
            cutoff_hz: processing.cutoff_hz,
            largest_change: changes.iter().fold(0.0, |largest, change| largest.max(*change)),
            typical_change: (changes.iter().map(|c| c * c).sum::<f64>() / changes.len().max(1) as f64).sqrt(),
            model: other,
        });
    }
    Ok(influences)
}
