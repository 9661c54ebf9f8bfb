//! Motion that is found once in a log for all that look at it.

use std::sync::Arc;

use super::{Motion, MotionError, Processing};
use crate::recording::Recording;

/// The motion in a log, and what it was made with.
struct Conditioned {
    joints: Vec<String>,
    processing: Processing,
    stretches: Vec<Arc<Motion>>,
}

/// The stretches of a log, processed; those found before if the log is one of a
/// [`LogSet`](crate::recording::LogSet).
///
/// # Errors
/// As [`Motion::from_recording`].
pub(crate) fn stretches_of(
    recording: &Recording,
    processing: &Processing,
) -> Result<Vec<Arc<Motion>>, MotionError> {
    let fits = |known: &Conditioned| {
        known.joints == recording.joint_names() && known.processing == *processing
    };
    let conditioned = recording.keeping(fits, || {
        Ok::<_, MotionError>(Conditioned {
            joints: recording.joint_names().to_vec(),
            processing: processing.clone(),
            stretches: Motion::from_recording(recording, processing)?
                .into_iter()
                .map(Arc::new)
                .collect(),
        })
    })?;
    Ok(conditioned.stretches.clone())
}

/// The stretches of all `recordings`, one log after the other.
///
/// # Errors
/// As [`Motion::from_recording`].
pub(crate) fn all_stretches(
    recordings: &[Recording],
    processing: &Processing,
) -> Result<Vec<Arc<Motion>>, MotionError> {
    let of_each = recordings.iter().map(|recording| stretches_of(recording, processing));
    Ok(of_each.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}
