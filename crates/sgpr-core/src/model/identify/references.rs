//! The motion without noise: references of the controller, or simulated from them.

use std::sync::Arc;

use super::{Controller, IdentifyError, IdentifyOptions};
use crate::identification::{ClosedLoop, EstimatorNeeds};
use crate::model::experiment::select_joints;
use crate::motion::{Motion, Processing, stretches_of};
use crate::recording::Recording;
use crate::robot::Robot;

/// Motions of the instruments, sample by sample those of the recordings.
pub(super) fn instruments(
    robot: &Robot,
    options: &IdentifyOptions,
    processing: &Processing,
    motions: &[Arc<Motion>],
) -> Result<Vec<Arc<Motion>>, IdentifyError> {
    if options.instruments.is_empty() {
        return Ok(Vec::new());
    }
    let recordings = select_joints(robot, &options.instruments)?;
    let mut instruments = Vec::new();
    for recording in recordings.iter() {
        let as_controlled = reference_processing(processing, recording);
        let processing = if options.controller.is_some() { &as_controlled } else { processing };
        instruments.extend(stretches_of(recording, processing)?);
    }
    let (samples, wanted): (Vec<usize>, Vec<usize>) =
        (instruments.iter().map(|m| m.len()).collect(), motions.iter().map(|m| m.len()).collect());
    if samples != wanted {
        let (found, expected) = (samples.len(), wanted.len());
        return Err(IdentifyError::Instruments { found, samples, expected, wanted });
    }
    Ok(instruments)
}

/// Motion of a reference as a controller has it: without the log's filter, and slow where it is
/// slow, since it has no noise.
fn reference_processing(processing: &Processing, reference: &Recording) -> Processing {
    let cutoff_hz = reference
        .sample_rate_hz()
        .map_or(processing.cutoff_hz, |rate| processing.cutoff_hz.max(REFERENCE_BAND * rate));
    let standstill_speed = vec![0.0; processing.standstill_speed.len()];
    Processing { cutoff_hz, standstill_speed, turn_margin: 0.0, ..processing.clone() }
}

/// Band of a reference as a share of its sampling rate; half of it would be all.
const REFERENCE_BAND: f64 = 0.4;

/// Longest integration step of a simulated motion, s: dry friction that changes sign within it is
/// followed exactly enough.
const LONGEST_STEP: f64 = 2.5e-4;

pub(super) fn loops<'a>(
    robot: &Robot,
    options: &'a IdentifyOptions,
    references: &'a [Arc<Motion>],
) -> Result<Vec<ClosedLoop<'a>>, IdentifyError> {
    let Some(Controller { kp, kd }) = &options.controller else {
        return if options.method.needs() == EstimatorNeeds::Controller {
            Err(IdentifyError::NoController)
        } else {
            Ok(Vec::new())
        };
    };
    if references.is_empty() {
        return Err(IdentifyError::NoController);
    }
    if let Some(gains) = [kp, kd].into_iter().find(|gains| gains.len() != robot.dof()) {
        return Err(IdentifyError::Gains { found: gains.len(), joints: robot.dof() });
    }
    let of_motion = |reference: &'a Arc<Motion>| ClosedLoop {
        reference: reference.samples(),
        feed_forward: reference.tau.as_deref(),
        kp,
        kd,
        rate_hz: reference.rate_hz,
        steps: (1.0 / (reference.rate_hz * LONGEST_STEP)).ceil() as usize,
    };
    Ok(references.iter().map(of_motion).collect())
}
