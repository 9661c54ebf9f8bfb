//! Model against measurement, on logs that no fit has seen.

use super::TorqueModel;
use super::experiment::{band_filter, select_joints, torque_of};
use super::identify::{IdentifyError, motions};
use crate::dynamics::{Workspace, gravity_torque};
use crate::identification::Row;
use crate::motion::{Motion, MotionError, Processing};
use crate::recording::Recording;

/// How well a model predicts the torque of some logs.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Joint by joint.
    pub joints: Vec<JointComparison>,
    /// |residual| / |torque| over all joints while they move, percent.
    pub relative_error_percent: f64,
    /// The same with the samples at which they stand, percent.
    pub relative_error_with_rests_percent: f64,
    /// Measured and predicted torque of every log.
    pub logs: Vec<LogResidual>,
}

/// How well a model predicts the torque of one joint.
///
/// Figures are in the band of the model, both torques passed through the filter that the model was identified with, over
/// the samples at which the joint moves and which are not at the end of a log. While a joint stands, dry friction holds
/// it with any torque up to the Coulomb level, and no model can say which; the `with_rests` figure counts those samples
/// too. The `full_band` figure uses the torque as it was logged.
#[derive(Clone, Debug, PartialEq)]
pub struct JointComparison {
    /// Joint.
    pub joint: String,
    /// Unit of the torque.
    pub unit: &'static str,
    /// Samples counted.
    pub samples: usize,
    /// Root mean square of measured minus predicted, N·m (N).
    pub rmse: f64,
    /// 100 (1 - |residual| / |measured - its mean|), percent.
    pub fit_percent: f64,
    /// Share of the variance that is explained.
    pub r2: f64,
    /// |residual| / |measured|, percent.
    pub relative_error_percent: f64,
    /// Largest absolute residual, N·m (N) ...
    pub largest_error: f64,
    /// ... the log where it is ...
    pub largest_error_log: String,
    /// ... and when, s since the start of the log.
    pub largest_error_time: f64,
    /// What predicting no torque at all would leave, N·m (N).
    pub rmse_zero: f64,
    /// What predicting the model's gravity torque alone would leave, N·m (N).
    pub rmse_gravity: f64,
    /// Root mean square residual against the torque as logged, N·m (N).
    pub rmse_full_band: f64,
    /// Root mean square residual with the samples at which the joint stands, N·m (N).
    pub rmse_with_rests: f64,
    /// |residual| / |measured| with the samples at which the joint stands, percent.
    pub relative_error_with_rests_percent: f64,
}

/// Torques of one stretch of a log, `[samples, n]`, row-major, N·m (N).
#[derive(Clone, Debug, PartialEq)]
pub struct LogResidual {
    /// Log.
    pub source: String,
    /// Time stamps, ns.
    pub time: Vec<i64>,
    /// As logged.
    pub measured: Vec<f64>,
    /// By the model.
    pub predicted: Vec<f64>,
    /// Measured, in the band of the model.
    pub measured_in_band: Vec<f64>,
    /// Predicted, in the band of the model.
    pub predicted_in_band: Vec<f64>,
    /// Which of them count, `[samples, n]`.
    pub counted: Vec<bool>,
    /// Joint motion that was predicted from: positions, velocities, accelerations.
    pub motion: Motion,
}

/// Compares `model` with recordings, processed as `processing` says, by default as the model was identified.
///
/// # Errors
/// If a recording lacks a joint or torque, or cannot be differentiated.
pub fn compare(
    model: &TorqueModel,
    recordings: &[Recording],
    processing: Option<&Processing>,
) -> Result<Comparison, IdentifyError> {
    compare_by(model, &|motion| Ok(model.predict_motion(motion)), recordings, processing)
}

/// Compares what `predict` says; the gravity torque and the processing are those of `model`.
pub(super) fn compare_by<E: From<IdentifyError>>(
    model: &TorqueModel,
    predict: &dyn Fn(&Motion) -> Result<Vec<f64>, E>,
    recordings: &[Recording],
    processing: Option<&Processing>,
) -> Result<Comparison, E> {
    if recordings.is_empty() {
        return Err(IdentifyError::from(MotionError::NoRecording).into());
    }
    let recordings = select_joints(model.robot(), recordings).map_err(IdentifyError::from)?;
    let chosen;
    let processing = match processing.or(model.processing()) {
        Some(processing) => processing,
        None => {
            chosen = Processing::choose(&recordings, &Default::default()).map_err(IdentifyError::from)?.0;
            &chosen
        }
    };
    let n = model.robot().dof();
    let mut sums = vec![Sums::default(); n];
    let mut logs = Vec::new();
    for motion in motions(&recordings, processing).map_err(IdentifyError::from)? {
        let predicted = predict(&motion)?;
        let log = residual(n, motion, predicted, processing)?;
        let gravity = gravity(model, &log.motion);
        for (k, counted) in log.counted.iter().enumerate() {
            if log.motion.inner[k / n] {
                sums[k % n].add_any(&log, k);
            }
            if *counted {
                let seconds = (log.time[k / n] - log.time[0]) as f64 * 1e-9;
                sums[k % n].add(&log, k, gravity[k], seconds);
            }
        }
        logs.push(log);
    }
    let joints: Vec<JointComparison> =
        model.robot().joints().iter().zip(&sums).map(|(joint, sums)| sums.comparison(joint)).collect();
    let total = |select: fn(&Sums) -> f64| sums.iter().map(select).sum::<f64>();
    let relative_error_percent = 100.0 * (total(|s| s.residual) / total(|s| s.measured)).sqrt();
    let relative_error_with_rests_percent = 100.0 * (total(|s| s.any_residual) / total(|s| s.any_measured)).sqrt();
    Ok(Comparison { joints, relative_error_percent, relative_error_with_rests_percent, logs })
}

/// Measured and `predicted` torque of `n` joints.
pub(super) fn residual(
    n: usize,
    motion: Motion,
    predicted: Vec<f64>,
    processing: &Processing,
) -> Result<LogResidual, IdentifyError> {
    let measured = torque_of(&motion)?.to_vec();
    let (mut measured_in_band, mut predicted_in_band) = (measured.clone(), predicted.clone());
    if let Some(filter) = band_filter(processing, motion.rate_hz)? {
        filter.apply(&mut measured_in_band, n)?;
        filter.apply(&mut predicted_in_band, n)?;
    }
    Ok(LogResidual {
        source: motion.source.clone(),
        time: motion.time.clone(),
        counted: motion.use_as.iter().map(|row| *row == Row::Moving).collect(),
        measured,
        predicted,
        measured_in_band,
        predicted_in_band,
        motion,
    })
}

fn gravity(model: &TorqueModel, motion: &Motion) -> Vec<f64> {
    let robot = model.identified_robot();
    let mut ws = Workspace::new(robot);
    motion.q.chunks_exact(robot.dof()).flat_map(|q| gravity_torque(robot, &mut ws, q).to_vec()).collect()
}

/// Sums over the samples of a joint.
#[derive(Clone, Debug, Default)]
struct Sums {
    count: f64,
    /// Of squares, except `mean`.
    residual: f64,
    measured: f64,
    mean: f64,
    against_gravity: f64,
    full_band: f64,
    any_count: f64,
    any_residual: f64,
    any_measured: f64,
    largest: f64,
    largest_log: String,
    largest_time: f64,
}

impl Sums {
    /// A sample at which the joint moves or stands.
    fn add_any(&mut self, log: &LogResidual, k: usize) {
        self.any_count += 1.0;
        self.any_residual += (log.measured_in_band[k] - log.predicted_in_band[k]).powi(2);
        self.any_measured += log.measured_in_band[k].powi(2);
    }

    fn add(&mut self, log: &LogResidual, k: usize, gravity: f64, seconds: f64) {
        let measured = log.measured_in_band[k];
        let residual = measured - log.predicted_in_band[k];
        self.count += 1.0;
        self.residual += residual * residual;
        self.measured += measured * measured;
        self.mean += measured;
        self.against_gravity += (measured - gravity).powi(2);
        self.full_band += (log.measured[k] - log.predicted[k]).powi(2);
        if residual.abs() > self.largest {
            self.largest = residual.abs();
            self.largest_log.clone_from(&log.source);
            self.largest_time = seconds;
        }
    }

    fn comparison(&self, joint: &crate::robot::Joint) -> JointComparison {
        let count = self.count.max(1.0);
        let variance = self.measured - self.mean * self.mean / count;
        JointComparison {
            joint: joint.name.clone(),
            unit: joint.kind.torque_unit(),
            samples: self.count as usize,
            rmse: (self.residual / count).sqrt(),
            fit_percent: 100.0 * (1.0 - (self.residual / variance).sqrt()),
            r2: 1.0 - self.residual / variance,
            relative_error_percent: 100.0 * (self.residual / self.measured).sqrt(),
            largest_error: self.largest,
            largest_error_log: self.largest_log.clone(),
            largest_error_time: self.largest_time,
            rmse_zero: (self.measured / count).sqrt(),
            rmse_gravity: (self.against_gravity / count).sqrt(),
            rmse_full_band: (self.full_band / count).sqrt(),
            rmse_with_rests: (self.any_residual / self.any_count.max(1.0)).sqrt(),
            relative_error_with_rests_percent: 100.0 * (self.any_residual / self.any_measured).sqrt(),
        }
    }
}
