//! Torques that were low-passed before they were logged.

use std::sync::Arc;

use crate::effects::Role;
use crate::identification::{Finding, role_of};
use crate::model::TorqueModel;
use crate::model::experiment::torque_of;
use crate::motion::{Motion, MotionError, Processing};
use crate::signal::Spectrum;

/// Bands in which torques are compared, so many to the octave, and so many octaves below the
/// cut-off.
const BANDS_PER_OCTAVE: usize = 4;
const OCTAVES: usize = 5;

/// Longest window of a spectrum, s, and how many of them a log has at least.
const WINDOW: f64 = 8.0;
const WINDOWS: usize = 4;

/// Torques end where they are half of what the model asks for: a filter of second order that runs
/// forward and backward leaves half at its cut-off.
const HALF: f64 = 0.5;

/// At the end of the band less than this is left of what inertia and gravity ask for. Real arms
/// whose torques do not end have 0.6 and more there, as friction and noise come to it.
const LITTLE: f64 = 0.25;

/// Both sides can be compared up to this share of the end: a filter of second order that ran
/// forward and backward leaves four fifths there, and of what it takes the standard deviations know
/// nothing.
const COMPARED: f64 = 0.7;

/// Whether the torques along `motions` end within the band of `processing` although their motion
/// goes on.
///
/// A low-pass before the log takes from the torque what the motion asks for at high frequencies:
/// its share of the model's torque, by bands, falls and does not come back. Rows above say nothing
/// of the arm, and nothing new: what is left there remembers as long as the filter did. Friction
/// that jumps is in the model where the arm's is smooth: whether torques end is judged beside
/// inertia and gravity, too, and where beside the whole model.
///
/// # Errors
/// If a recording has no torque.
pub(super) fn torque_end(
    model: &TorqueModel,
    motions: &[Arc<Motion>],
    processing: &Processing,
) -> Result<Option<Finding>, MotionError> {
    let Some(band) = processing.torque_cutoff_hz else { return Ok(None) };
    let ends = |shares: &[(f64, f64)]| shares.last().is_some_and(|(_, last)| *last < LITTLE);
    let shares = shares_by_band(model, motions, band)?;
    if !ends(&shares) || !ends(&shares_by_band(&smooth_part(model), motions, band)?) {
        return Ok(None);
    }
    // Between the last band with more than half and the one above it.
    let Some(above) = shares.iter().rposition(|(_, share)| *share >= HALF) else { return Ok(None) };
    let [(low, much), (high, little)] = [shares[above], shares[above + 1]];
    let along = (much / HALF).ln() / (much / little.max(f64::MIN_POSITIVE)).ln();
    let hz = low * (high / low).powf(along);
    Ok(Some(Finding::TorqueEnds { hz, band_hz: band, compared_hz: COMPARED * hz }))
}

/// Amplitude of the measured torque as a share of the model's, median of the joints, by bands below
/// `highest` Hz, each with its middle in Hz.
fn shares_by_band(
    model: &TorqueModel,
    motions: &[Arc<Motion>],
    highest: f64,
) -> Result<Vec<(f64, f64)>, MotionError> {
    let n = model.robot.dof();
    let edge = |k: usize| highest * (k as f64 / BANDS_PER_OCTAVE as f64 - OCTAVES as f64).exp2();
    let bands = OCTAVES * BANDS_PER_OCTAVE;
    // By joint and band: power measured, and of the model.
    let mut power = vec![[0.0; 2]; n * bands];
    for motion in motions {
        let window = ((WINDOW * motion.rate_hz) as usize).min(motion.len() / WINDOWS);
        let predicted = model.predict_motion(motion);
        for (side, torque) in [torque_of(motion)?, &predicted].into_iter().enumerate() {
            for joint in 0..n {
                let signal: Vec<f64> = torque.iter().skip(joint).step_by(n).copied().collect();
                let spectrum = Spectrum::welch(&signal, motion.rate_hz, window);
                for (hz, density) in spectrum.frequency_hz.iter().zip(&spectrum.density) {
                    if let Some(k) = (0..bands).find(|&k| (edge(k)..edge(k + 1)).contains(hz)) {
                        power[joint * bands + k][side] += density;
                    }
                }
            }
        }
    }
    let share = |k: usize| -> Option<f64> {
        let of_joints =
            (0..n).map(|joint| power[joint * bands + k]).filter(|[_, model]| *model > 0.0);
        let mut shares: Vec<f64> =
            of_joints.map(|[measured, model]| (measured / model).sqrt()).collect();
        shares.sort_by(f64::total_cmp);
        shares.get(shares.len() / 2).copied()
    };
    Ok((0..bands).filter_map(|k| Some(((edge(k) * edge(k + 1)).sqrt(), share(k)?))).collect())
}

/// The model without friction, offsets and terms.
fn smooth_part(model: &TorqueModel) -> TorqueModel {
    let mut smooth = model.without_terms();
    let counts =
        |k: usize| k < model.set.inertial() || role_of(&model.set, k) == Some(Role::RotorInertia);
    let pairs = model.parameters.iter().enumerate();
    smooth.set_parameters(pairs.map(|(k, value)| if counts(k) { *value } else { 0.0 }).collect());
    smooth
}
