//! The main job: from a robot and logs to a model.

use std::borrow::Cow;

use super::TorqueModel;
use super::torque_model::{Fit, nominal_parameters};
use crate::effects::UnknownEffect;
use crate::identification::{
    BaseParameters, IdentificationError, JointFactor, LeastSquares, Method, Observation, ParameterSet, Row,
};
use crate::motion::{Conditioning, Motion, MotionError, Processing};
use crate::progress::{Interrupted, Progress};
use crate::recording::{Recording, RecordingError};
use crate::robot::Robot;
use crate::signal::{CutoffChoice, LowPass, SignalError};

/// What to identify, and how.
#[derive(Clone, Debug)]
pub struct IdentifyOptions {
    /// Names of effects beside the rigid body.
    pub effects: Vec<String>,
    /// Weights of least squares.
    pub method: Method,
    /// What is done to the logs.
    pub conditioning: Conditioning,
    /// Values that parameters keep where the motion does not determine them.
    pub start: Start,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
        Self {
            effects: effects.map(String::from).to_vec(),
            method: Method::Wls,
            conditioning: Conditioning::default(),
            start: Start::RobotFile,
        }
    }
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

/// Why a model could not be identified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// A log does not have the robot's joints, or cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A log cannot be turned into motion.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The parameters cannot be estimated.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// An effect that the library does not have.
    #[error(transparent)]
    Effect(#[from] UnknownEffect),
    /// A filter that cannot be.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The listener stopped the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
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
    /// Samples in the logs, and equations per joint taken from them.
    pub samples: usize,
}

/// Identifies the torque model of `robot` from recordings.
///
/// The joints of each recording are picked by the names of the robot's joints. `progress` hears of every log; `&()` for
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
    let recordings = select_joints(robot, recordings)?;
    let (processing, cutoff_choices) = Processing::choose(&recordings, &options.conditioning)?;
    let (model, excitation) = fit(robot, &recordings, options, &processing, progress)?;
    let mut report = IdentificationReport {
        cutoff_choices,
        singular_values: excitation.singular_values.clone(),
        warnings: robot.warnings(),
        samples: recordings.iter().map(Recording::len).sum(),
    };
    warn(&mut report, &model);
    Ok((model, report))
}

/// The recordings with the robot's joints, in its order.
pub(crate) fn select_joints<'a>(
    robot: &Robot,
    recordings: &'a [Recording],
) -> Result<Cow<'a, [Recording]>, RecordingError> {
    if recordings.iter().all(|recording| robot.joint_names().eq(recording.joint_names().iter().map(String::as_str))) {
        return Ok(Cow::Borrowed(recordings));
    }
    let names: Vec<String> = robot.joint_names().map(String::from).collect();
    recordings.iter().map(|recording| recording.select(&names)).collect::<Result<_, _>>().map(Cow::Owned)
}

fn fit(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    processing: &Processing,
    progress: &dyn Progress,
) -> Result<(TorqueModel, crate::identification::Excitation), IdentifyError> {
    let set = ParameterSet::new(robot, &options.effects)?;
    let base = BaseParameters::new(robot, &set);
    let start = match options.start {
        Start::RobotFile => nominal_parameters(robot, &set),
        Start::Zero => vec![0.0; set.len()],
    };
    let motions = motions(recordings, processing)?;
    let mut observation = Observation::new(robot, &set, &base);
    for (index, motion) in motions.iter().enumerate() {
        progress.step("observe", index, motions.len())?;
        let tau = torque_of(motion)?;
        let use_as = Some(&motion.use_as[..]);
        match band_filter(processing, motion.rate_hz)? {
            Some(filter) => {
                observation.add_trajectory(motion.samples(), tau, use_as, &filter, processing.decimation)?;
            }
            None => observation.add_samples(motion.samples(), tau, use_as)?,
        }
    }
    progress.step("observe", motions.len(), motions.len())?;
    let factors = observation.factors();
    let nominal = base.combine(&start);
    let mut least_squares = LeastSquares::new(options.method.clone());
    let mut model = TorqueModel::from_parameters(robot.clone(), set, start.clone(), vec![]);
    // The residual of a first solution tells how much the noise remembers: the estimates stay, their spread grows.
    let first = least_squares.solve(&factors, &base, &nominal)?;
    model.set_parameters(base.expand(&first.values, &start));
    let correlation = correlation(&model, &motions, processing, &factors)?;
    least_squares.correlation = Some(correlation.clone());
    let estimate = least_squares.solve(&factors, &base, &nominal)?;
    model.set_parameters(base.expand(&estimate.values, &start));

    let names = model.base.names();
    let deviations = estimate.standard_deviations();
    let rank = base.rank();
    model.provenance.history = vec![describe(options, processing, &factors)];
    model.fit = Some(Fit {
        method: match options.method {
            Method::Ols => "ols".into(),
            Method::Wls => "wls".into(),
            Method::WlsKnown(_) => "wls_known_noise".into(),
        },
        covariance: (0..rank * rank).map(|k| estimate.covariance[(k / rank, k % rank)]).collect(),
        noise: per_joint(&factors, &estimate.noise, robot.dof()),
        rows: (0..robot.dof()).map(|joint| rows_of(&factors, joint)).collect(),
        correlation: per_joint(&factors, &correlation, robot.dof()),
        values: estimate.values,
        condition: estimate.excitation.condition,
        scaled_condition: estimate.excitation.scaled_condition,
        undetermined: names
            .iter()
            .zip(&deviations)
            .filter(|(_, std)| std.is_infinite())
            .map(|(name, _)| name.clone())
            .collect(),
        standard_deviations: deviations,
    });
    model.processing = Some(processing.clone());
    model.provenance.logs = recordings.iter().map(|recording| recording.source().to_string()).collect();
    Ok((model, estimate.excitation))
}

/// The figure of each joint in motion; of the joint at rest if it never moves, zero if it has no row.
fn per_joint(factors: &[JointFactor], figures: &[f64], joints: usize) -> Vec<f64> {
    let of = |joint: usize| factors.iter().position(|factor| factor.joint == joint).map_or(0.0, |index| figures[index]);
    (0..joints).map(of).collect()
}

fn rows_of(factors: &[JointFactor], joint: usize) -> usize {
    factors.iter().filter(|factor| factor.joint == joint).map(|factor| factor.rows).sum()
}

fn describe(options: &IdentifyOptions, processing: &Processing, factors: &[JointFactor]) -> String {
    let what = match options.start {
        Start::RobotFile => "identified",
        Start::Zero => "identified as the error of an internal model",
    };
    let method = match options.method {
        Method::Ols => "ordinary least squares",
        Method::Wls => "weighted least squares",
        Method::WlsKnown(_) => "least squares weighted by known noise",
    };
    let band = match processing.torque_cutoff_hz {
        Some(hz) => format!("both sides filtered at {hz:.2} Hz, every {}th row taken", processing.decimation),
        None => "both sides unfiltered".into(),
    };
    let effects = if options.effects.is_empty() { "no effects".into() } else { options.effects.join(", ") };
    let rows: usize = factors.iter().map(|factor| factor.rows).sum();
    let hz = processing.cutoff_hz;
    format!("{what} by {method} from {rows} rows with {effects}; position filtered at {hz:.2} Hz, {band}")
}

/// Every stretch of every recording.
pub(crate) fn motions(recordings: &[Recording], processing: &Processing) -> Result<Vec<Motion>, MotionError> {
    let mut motions = Vec::new();
    for recording in recordings {
        motions.extend(Motion::from_recording(recording, processing)?);
    }
    Ok(motions)
}

pub(crate) fn torque_of(motion: &Motion) -> Result<&[f64], MotionError> {
    motion.tau.as_deref().ok_or_else(|| MotionError::NoTorque { recording: motion.source.clone() })
}

/// The filter on both sides of the equation, if there is one.
pub(super) fn band_filter(processing: &Processing, rate_hz: f64) -> Result<Option<LowPass>, SignalError> {
    processing.torque_cutoff_hz.map(|hz| LowPass::butterworth(processing.order, hz, rate_hz)).transpose()
}

/// Per factor: how many rows carry as much as one independent row, 1 + 2 sum of the autocorrelation of the residual up to
/// where it drowns in its own noise.
///
/// Source: G. V. Bayley, J. M. Hammersley, The effective number of independent observations in an autocorrelated time
/// series, Suppl. J. R. Stat. Soc. 8(2) (1946).
fn correlation(
    model: &TorqueModel,
    motions: &[Motion],
    processing: &Processing,
    factors: &[JointFactor],
) -> Result<Vec<f64>, IdentifyError> {
    let n = model.robot.dof();
    let mut residuals = Vec::with_capacity(motions.len());
    for motion in motions {
        let mut residual = torque_of(motion)?.to_vec();
        residual.iter_mut().zip(model.predict_motion(motion)).for_each(|(tau, predicted)| *tau -= predicted);
        if let Some(filter) = band_filter(processing, motion.rate_hz)? {
            filter.apply(&mut residual, n)?;
        }
        residuals.push(residual);
    }
    let series = |factor: &JointFactor| -> Vec<Series> {
        let wanted = if factor.resting { Row::Resting } else { Row::Moving };
        let of_motion = |(motion, residual): (&Motion, &Vec<f64>)| {
            let rows = (factor.joint..residual.len()).step_by(n * processing.decimation);
            Series::new(rows.map(|row| (motion.use_as[row] == wanted).then_some(residual[row])))
        };
        motions.iter().zip(&residuals).map(of_motion).collect()
    };
    Ok(factors.iter().map(|factor| rows_per_independent_row(&series(factor))).collect())
}

/// Numbers of which some are missing.
struct Series {
    /// Zero where missing.
    values: Vec<f64>,
    present: Vec<bool>,
}

impl Series {
    fn new(values: impl Iterator<Item = Option<f64>>) -> Self {
        let (values, present) = values.map(|value| (value.unwrap_or(0.0), value.is_some())).unzip();
        Self { values, present }
    }

    /// Sum and number of the products of values that are `lag` apart.
    fn products(&self, lag: usize) -> (f64, usize) {
        let Self { values, present } = self;
        if lag >= values.len() {
            return (0.0, 0);
        }
        let pairs = present.iter().zip(&present[lag..]);
        (sum_of_products(values, &values[lag..]), pairs.map(|(a, b)| usize::from(*a & *b)).sum())
    }
}

/// In eight sums, so that the additions need not wait for each other.
fn sum_of_products(a: &[f64], b: &[f64]) -> f64 {
    let length = a.len().min(b.len());
    let ((a, rest_of_a), (b, rest_of_b)) = (a[..length].as_chunks::<8>(), b[..length].as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + rest_of_a.iter().zip(rest_of_b).map(|(a, b)| a * b).sum::<f64>()
}

/// Longest memory that is looked at, in rows.
const LONGEST_LAG: usize = 500;

fn rows_per_independent_row(series: &[Series]) -> f64 {
    let products = |lag: usize| {
        let parts = series.iter().map(|series| series.products(lag));
        let (sum, count) = parts.fold((0.0, 0), |(sum, count), (s, c)| (sum + s, count + c));
        let count = f64::max(count as f64, 1.0);
        (sum / count, count)
    };
    let (variance, _) = products(0);
    let mut sum = 1.0;
    for lag in 1..=LONGEST_LAG {
        let (mean, count) = products(lag);
        let correlation = mean / variance;
        // A series without rows or without residual has the correlation 0 / 0.
        if correlation.is_nan() || correlation <= 2.0 / count.sqrt() {
            break;
        }
        sum += 2.0 * correlation;
    }
    sum
}

fn warn(report: &mut IdentificationReport, model: &TorqueModel) {
    let Some(fit) = &model.fit else { return };
    if !fit.undetermined.is_empty() {
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
        report.warnings.push(format!(
            "{} base parameters are smaller than their standard deviation: {}",
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
    let mut influences = Vec::new();
    let factors = [0.5, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::SQRT_2, 2.0];
    for (index, factor) in factors.into_iter().enumerate() {
        progress.step("other cut-offs", index, factors.len())?;
        let mut conditioning = options.conditioning.clone();
        conditioning.cutoff_hz = Some(factor * processing.cutoff_hz);
        let Ok((processing, _)) = Processing::choose(&recordings, &conditioning) else { continue };
        let other = match fit(robot, &recordings, options, &processing, &()) {
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
