//! What a model predicts along logs, at their own samples.

use super::experiment::{given_or_chosen, select_joints};
use super::{IdentifyError, TorqueModel};
use crate::motion::{MotionError, stretches_of};
use crate::recording::{LogSet, Recording};

/// Predicted torque along a log, `[samples of the log, n]`, N·m (N); NaN at samples of stretches that
/// are too short for the filters.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LogPrediction {
    /// Torque.
    pub torque: Vec<f64>,
    /// Its standard deviation by what is not known of the parameters, if it was asked for.
    pub standard_deviation: Option<Vec<f64>>,
}

/// Predicts the torque along each log, processed as the model was identified. Logs need no torque.
///
/// - `logs`: a [`LogSet`], or recordings; the motion in a set is kept with it, as for
///   [`compare`](super::compare())
/// - `deviations`: whether standard deviations are wanted, too
///
/// # Errors
/// If there is no log, one lacks a joint or cannot be differentiated.
pub fn predict(
    model: &TorqueModel,
    logs: impl Into<LogSet>,
    deviations: bool,
) -> Result<Vec<LogPrediction>, IdentifyError> {
    let set = logs.into();
    if set.is_empty() {
        return Err(MotionError::NoRecording.into());
    }
    let recordings = select_joints(model.robot(), &set)?;
    let processing = given_or_chosen(model.processing(), &recordings)?;
    let n = model.robot().dof();
    let of_log = |log: &Recording| {
        let nothing = vec![f64::NAN; log.len() * n];
        let mut torque = nothing.clone();
        let mut deviation = deviations.then_some(nothing);
        for motion in stretches_of(log, &processing)? {
            // Stamps increase, as the filters have asked.
            let first = motion.time.first().and_then(|time| log.time().binary_search(time).ok());
            let Some(first) = first else { continue };
            let rows = first * n..(first + motion.len()) * n;
            torque[rows.clone()].copy_from_slice(&model.predict_motion(&motion));
            if let Some(deviation) = &mut deviation {
                deviation[rows].copy_from_slice(&model.standard_deviation_of(&motion)?);
            }
        }
        Ok(LogPrediction { torque, standard_deviation: deviation })
    };
    recordings.iter().map(of_log).collect()
}
