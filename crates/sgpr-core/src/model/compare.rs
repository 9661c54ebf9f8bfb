//! Model against measurement, on logs that no fit has seen.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::experiment::{given_or_chosen, select_joints, torque_of};
use super::{IdentifyError, TorqueModel};
use crate::dynamics::{Workspace, gravity_torque};
use crate::identification::Row;
use crate::motion::{Motion, MotionError, Processing, stretches_of};
use crate::recording::{LogSet, Recording};
use crate::signal::LowPass;

/// How well a model predicts the torque of some logs.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
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
/// Figures are in the band of the model, both torques passed through the filter that the model was
/// identified with, over the samples at which the joint moves and which are not at the end of a
/// log. While a joint stands, dry friction holds it with any torque up to the Coulomb level, and no
/// model can say which; the `with_rests` figure counts those samples too. The `full_band` figure
/// uses the torque as it was logged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointComparison {
    /// Joint.
    pub joint: String,
    /// Unit of the torque.
    pub unit: String,
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

/// Measured and predicted torque of one stretch of a log. Arrays are `[samples, n]`, row-major, N·m
/// (N).
///
/// What passed the filter of the equations is made from what did not when it is asked for, as it is
/// as large.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LogResidual {
    /// By the model.
    pub predicted: Vec<f64>,
    /// Joint motion that was predicted from, and the torque as logged; shared by all that were
    /// compared with one [`LogSet`].
    pub motion: Arc<Motion>,
    processing: Processing,
    filter: Option<LowPass>,
}

/// Torques of one joint in the band of a model, `[samples]`, N·m (N).
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct InBand {
    /// As logged.
    pub measured: Vec<f64>,
    /// By the model.
    pub predicted: Vec<f64>,
}

impl InBand {
    /// Measured minus predicted at a sample.
    pub fn residual(&self, sample: usize) -> f64 {
        self.measured[sample] - self.predicted[sample]
    }
}

impl LogResidual {
    /// Of a motion and what a model says of its torque.
    ///
    /// - `predicted`: `[samples, n]`
    ///
    /// # Errors
    /// If the torque was not logged, or the stretch is shorter than the filter of the equations.
    ///
    /// # Panics
    /// If `predicted` is not as long as the motion.
    pub fn new(
        motion: impl Into<Arc<Motion>>,
        predicted: Vec<f64>,
        processing: &Processing,
    ) -> Result<Self, IdentifyError> {
        let motion = motion.into();
        assert_eq!(
            torque_of(&motion)?.len(),
            predicted.len(),
            "a torque of every joint at every sample"
        );
        let filter = processing.band_filter(motion.rate_hz)?;
        if let Some(filter) = &filter {
            filter.check_length(motion.len())?;
        }
        Ok(Self { predicted, motion, processing: processing.clone(), filter })
    }

    /// Log.
    pub fn source(&self) -> &str {
        &self.motion.source
    }

    /// Time stamps, ns.
    pub fn time(&self) -> &[i64] {
        &self.motion.time
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.predicted.len() / self.motion.len().max(1)
    }

    /// Torque as logged.
    pub fn measured(&self) -> &[f64] {
        torque_of(&self.motion).expect("checked when it was made")
    }

    /// How the log was processed.
    pub fn processing(&self) -> &Processing {
        &self.processing
    }

    /// Whether an entry of the arrays counts: the joint moves, and the ends of the stretch are far.
    pub fn counts(&self, entry: usize) -> bool {
        self.motion.use_as[entry] == Row::Moving
    }

    /// Measured and predicted torque of a joint in the band of the model.
    pub fn in_band(&self, joint: usize) -> InBand {
        let n = self.dof();
        let torques = self.measured()[joint..].iter().zip(&self.predicted[joint..]).step_by(n);
        let pairs = torques.map(|(measured, predicted)| (*measured, *predicted));
        let Some(filter) = &self.filter else {
            let (measured, predicted) = pairs.unzip();
            return InBand { measured, predicted };
        };
        let mut both: Vec<f64> = pairs.flat_map(|(m, p)| [m, p]).collect();
        filter.apply(&mut both, 2).expect("checked when it was made");
        let (measured, predicted) = both.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip();
        InBand { measured, predicted }
    }

    /// Measured torque of all joints in the band of the model.
    pub fn measured_in_band(&self) -> Vec<f64> {
        self.filtered(self.measured())
    }

    /// Predicted torque of all joints in the band of the model.
    pub fn predicted_in_band(&self) -> Vec<f64> {
        self.filtered(&self.predicted)
    }

    fn filtered(&self, values: &[f64]) -> Vec<f64> {
        let mut values = values.to_vec();
        if let Some(filter) = &self.filter {
            filter.apply(&mut values, self.dof()).expect("checked when it was made");
        }
        values
    }
}

/// Compares `model` with logs, processed as `processing` says, by default as the model was
/// identified.
///
/// - `logs`: a [`LogSet`], or recordings (`&[Recording]`, `&Vec<Recording>`), of which one is made:
///   samples that two of them share count once. The motion in a set is kept with it, so that
///   another model is compared without the filters.
///
/// # Errors
/// If a recording lacks a joint or torque, or cannot be differentiated.
pub fn compare(
    model: &TorqueModel,
    logs: impl Into<LogSet>,
    processing: Option<&Processing>,
) -> Result<Comparison, IdentifyError> {
    compare_set(model, &|motion, _| Ok(model.predict_motion(motion)), &logs.into(), processing)
}

/// Compares what `predict` says of recordings as they are.
pub(super) fn compare_by<E: From<IdentifyError>>(
    model: &TorqueModel,
    predict: &impl Fn(&Motion, &Recording) -> Result<Vec<f64>, E>,
    recordings: &[Recording],
    processing: Option<&Processing>,
) -> Result<Comparison, E> {
    compare_set(model, predict, &LogSet::whole(recordings), processing)
}

/// Compares what `predict` says; the gravity torque and the processing are those of `model`.
pub(super) fn compare_set<E: From<IdentifyError>>(
    model: &TorqueModel,
    predict: &impl Fn(&Motion, &Recording) -> Result<Vec<f64>, E>,
    set: &LogSet,
    processing: Option<&Processing>,
) -> Result<Comparison, E> {
    if set.is_empty() {
        return Err(IdentifyError::from(MotionError::NoRecording).into());
    }
    let recordings = select_joints(model.robot(), set).map_err(IdentifyError::from)?;
    let processing = &given_or_chosen(processing.or(model.processing()), &recordings)
        .map_err(IdentifyError::from)?;
    let n = model.robot().dof();
    let mut sums = vec![ErrorSums::default(); n];
    let mut logs = Vec::new();
    for recording in recordings.iter() {
        for motion in stretches_of(recording, processing).map_err(IdentifyError::from)? {
            let predicted = predict(&motion, recording)?;
            let log = LogResidual::new(motion, predicted, processing)?;
            let gravity = gravity(model, &log.motion);
            sums.iter_mut().enumerate().for_each(|(joint, sums)| sums.add(&log, joint, &gravity));
            logs.push(log);
        }
    }
    let joints: Vec<JointComparison> = model
        .robot()
        .joints()
        .iter()
        .zip(&sums)
        .map(|(joint, sums)| sums.comparison(joint))
        .collect();
    let total = |select: fn(&ErrorSums) -> f64| sums.iter().map(select).sum::<f64>();
    let relative_error_percent = 100.0 * (total(|s| s.residual) / total(|s| s.measured)).sqrt();
    let relative_error_with_rests_percent =
        100.0 * (total(|s| s.any_residual) / total(|s| s.any_measured)).sqrt();
    Ok(Comparison { joints, relative_error_percent, relative_error_with_rests_percent, logs })
}

/// Gravity torque of the model, `[samples, n]`; a figure to compare with, so 32 bits are enough.
fn gravity(model: &TorqueModel, motion: &Motion) -> Vec<f32> {
    let robot = model.identified_robot();
    let mut ws = Workspace::new(robot);
    let mut torque = Vec::with_capacity(motion.q.len());
    motion.q.chunks_exact(robot.dof()).for_each(|q| {
        torque.extend(gravity_torque(robot, &mut ws, q).iter().map(|tau| *tau as f32))
    });
    torque
}

/// Sums over the samples of a joint.
#[derive(Clone, Debug, Default)]
struct ErrorSums {
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

impl ErrorSums {
    /// The samples of a joint.
    ///
    /// - `gravity`: torque of the model, `[samples, n]`
    fn add(&mut self, log: &LogResidual, joint: usize, gravity: &[f32]) {
        let (n, start) = (log.dof(), log.time()[0]);
        let in_band = log.in_band(joint);
        for sample in (0..log.motion.len()).filter(|sample| log.motion.inner[*sample]) {
            let (entry, measured, residual) =
                (sample * n + joint, in_band.measured[sample], in_band.residual(sample));
            self.any_count += 1.0;
            self.any_residual += residual.powi(2);
            self.any_measured += measured.powi(2);
            if !log.counts(entry) {
                continue;
            }
            self.count += 1.0;
            self.residual += residual * residual;
            self.measured += measured * measured;
            self.mean += measured;
            self.against_gravity += (measured - f64::from(gravity[entry])).powi(2);
            self.full_band += (log.measured()[entry] - log.predicted[entry]).powi(2);
            if residual.abs() > self.largest {
                self.largest = residual.abs();
                log.source().clone_into(&mut self.largest_log);
                self.largest_time = (log.time()[sample] - start) as f64 * 1e-9;
            }
        }
    }

    fn comparison(&self, joint: &crate::robot::Joint) -> JointComparison {
        let count = self.count.max(1.0);
        let variance = self.measured - self.mean * self.mean / count;
        JointComparison {
            joint: joint.name.clone(),
            unit: joint.kind.torque_unit().into(),
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
            relative_error_with_rests_percent: 100.0
                * (self.any_residual / self.any_measured).sqrt(),
        }
    }
}
