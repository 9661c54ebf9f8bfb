//! Whether results hinge on the cut-off of the filter.

use rayon::prelude::*;

use super::fit::fit;
use super::{Given, IdentifyError, IdentifyOptions, set_of};
use crate::model::TorqueModel;
use crate::model::experiment::select_joints;
use crate::motion::Processing;
use crate::progress::Progress;
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;

/// What another cut-off would have made of the same logs.
#[derive(Clone, Debug)]
#[non_exhaustive]
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

/// Repeats the identification with cut-offs around the one that was used: results must not hinge on
/// it.
///
/// # Errors
/// As [`identify`](super::identify).
pub fn cutoff_influence(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    model: &TorqueModel,
    progress: &dyn Progress,
) -> Result<Vec<CutoffInfluence>, IdentifyError> {
    let set = set_of(recordings, options);
    let recordings = select_joints(robot, set.as_ref().map_or(recordings, LogSet::logs))?;
    // Nothing else looks at their motion in these bands.
    let apart: Vec<Recording> = recordings.iter().map(Recording::apart).collect();
    let (Some(processing), Some(reference)) = (&model.processing, &model.fit) else {
        return Ok(vec![]);
    };
    // The pull that the data chose stays what it was.
    let mut options = options.clone();
    options.cross_validated_prior = false;
    let chosen = reference.consistency.as_ref().and_then(|certificate| certificate.prior_deviation);
    if let (Some(consistency), Some(deviation)) = (&mut options.consistency, chosen) {
        consistency.prior.relative_deviation = deviation;
    }
    let options = &options;
    /// Fits between two words to the listener.
    const AT_ONCE: usize = 2;
    let factors = [0.5, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::SQRT_2, 2.0];
    let at = |factor: &f64| -> Result<Option<CutoffInfluence>, IdentifyError> {
        let mut conditioning = options.conditioning.clone();
        conditioning.cutoff_hz = Some(factor * processing.cutoff_hz);
        let Ok((processing, _)) = Processing::choose(&recordings, &conditioning) else {
            return Ok(None);
        };
        let other = match fit(robot, &apart, options, &processing, Given::default(), &()) {
            Ok((model, ..)) => model,
            // Twice the cut-off can lie beyond what the sampling rate holds.
            Err(IdentifyError::Signal(_) | IdentifyError::Motion(_)) => return Ok(None),
            Err(error) => return Err(error),
        };
        let values = &other.fit.as_ref().expect("just fitted").values;
        let changes = values.iter().zip(&reference.values).zip(&reference.standard_deviations);
        let changes: Vec<f64> = changes
            .filter(|(_, deviation)| deviation.is_finite() && **deviation > 0.0)
            .map(|((new, old), deviation)| (new - old).abs() / deviation)
            .collect();
        Ok(Some(CutoffInfluence {
            cutoff_hz: processing.cutoff_hz,
            largest_change: changes.iter().fold(0.0, |largest, change| largest.max(*change)),
            typical_change: (changes.iter().map(|c| c * c).sum::<f64>()
                / changes.len().max(1) as f64)
                .sqrt(),
            model: other,
        }))
    };
    let mut influences = Vec::new();
    for (index, some) in factors.chunks(AT_ONCE).enumerate() {
        progress.step("other cut-offs", AT_ONCE * index, factors.len())?;
        for influence in some.par_iter().map(at).collect::<Vec<_>>() {
            influences.extend(influence?);
        }
    }
    Ok(influences)
}
