//! Payloads and drive gains from recordings with and without a load.

use super::experiment::{Experiment, require_torque, select_joints};
use super::torque_model::nominal_parameters;
use super::{IdentifyError, IdentifyOptions};
use crate::identification::{
    self as estimation, BaseParameters, DriveGains, Equations, GainOptions, JointFactor,
    ParameterSet, Payload, PayloadOptions, residual_correlation,
};
use crate::motion::Processing;
use crate::progress::Progress;
use crate::recording::Recording;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// A payload from recordings without and with it: both at once, by weighted least squares.
///
/// - `options`: effects and conditioning as for [`identify`](super::identify()); its method does
///   not matter
///
/// # Errors
/// As [`identify`](super::identify()).
pub fn identify_payload(
    robot: &Robot,
    unloaded: &[Recording],
    loaded: &[Recording],
    options: &IdentifyOptions,
    payload: &PayloadOptions,
    progress: &dyn Progress,
) -> Result<Payload, IdentifyError> {
    let mut pair = Pair::new(robot, unloaded, loaded, options, progress)?;
    let estimate = |pair: &Pair, correlation: Option<&[f64]>| {
        let factors = [&pair.factors[0][..], &pair.factors[1][..]];
        estimation::identify_payload(
            &pair.set,
            &pair.base,
            factors,
            &pair.nominal,
            correlation,
            payload,
        )
    };
    let first = estimate(&pair, None)?;
    let ones = vec![1.0; robot.dof()];
    let correlation =
        pair.correlation(robot, &first.base, &first.parameters, payload.link, &ones)?;
    Ok(estimate(&pair, Some(&correlation))?)
}

/// Gains of all drives from recordings without and with a payload of which something is known.
///
/// The torques in the recordings are currents, or currents times constants that are in doubt; the
/// gains are what to multiply them by.
///
/// # Errors
/// As [`identify`](super::identify()), and if the payload moves a joint too little to tell its
/// gain.
pub fn identify_drive_gains(
    robot: &Robot,
    unloaded: &[Recording],
    loaded: &[Recording],
    options: &IdentifyOptions,
    gains: &GainOptions,
    progress: &dyn Progress,
) -> Result<DriveGains, IdentifyError> {
    let mut pair = Pair::new(robot, unloaded, loaded, options, progress)?;
    let estimate = |pair: &Pair, correlation: Option<&[f64]>| {
        let factors = [&pair.factors[0][..], &pair.factors[1][..]];
        estimation::identify_drive_gains(robot, &pair.set, &pair.base, factors, correlation, gains)
    };
    let first = estimate(&pair, None)?;
    let correlation =
        pair.correlation(robot, &first.base, &first.payload, gains.link, &first.gains)?;
    Ok(estimate(&pair, Some(&correlation))?)
}

/// Factors of both sets of recordings.
struct Pair {
    set: ParameterSet,
    base: BaseParameters,
    nominal: Vec<f64>,
    experiments: [Experiment; 2],
    factors: [Vec<JointFactor>; 2],
}

impl Pair {
    fn new(
        robot: &Robot,
        unloaded: &[Recording],
        loaded: &[Recording],
        options: &IdentifyOptions,
        progress: &dyn Progress,
    ) -> Result<Self, IdentifyError> {
        let set = ParameterSet::new(robot, &options.effects)?;
        let base = BaseParameters::new(robot, &set);
        let nominal = base.combine(&nominal_parameters(robot, &set));
        let (unloaded, loaded) = (select_joints(robot, unloaded)?, select_joints(robot, loaded)?);
        let all: Vec<Recording> = unloaded.iter().chain(loaded.iter()).cloned().collect();
        let (processing, _) = Processing::choose(&all, &options.conditioning)?;
        let mut experiments = Vec::new();
        let mut factors = Vec::new();
        for (index, recordings) in [&unloaded[..], &loaded[..]].into_iter().enumerate() {
            require_torque(robot, recordings)?;
            progress.step("observe", index, 2)?;
            let experiment = Experiment::new(recordings, &processing)?;
            factors.push(
                Equations::new(robot, &set, &base, experiment.trajectories(&[], &[])?).factors()?,
            );
            experiments.push(experiment);
        }
        progress.step("observe", 2, 2)?;
        let both = "one for each set of recordings";
        let experiments = experiments.try_into().unwrap_or_else(|_| unreachable!("{both}"));
        let factors = factors.try_into().unwrap_or_else(|_| unreachable!("{both}"));
        Ok(Self { set, base, nominal, experiments, factors })
    }

    /// Rows that carry as much as one independent row, per factor without and with the payload.
    ///
    /// - `gains`: `[n]`, what to multiply the torques of the recordings by
    fn correlation(
        &mut self,
        robot: &Robot,
        base: &[f64],
        payload: &[f64; PARAMETERS_PER_LINK],
        link: usize,
        gains: &[f64],
    ) -> Result<Vec<f64>, IdentifyError> {
        let mut added = vec![0.0; self.set.len()];
        added[link * PARAMETERS_PER_LINK..][..PARAMETERS_PER_LINK].copy_from_slice(payload);
        let loaded: Vec<f64> =
            base.iter().zip(self.base.combine(&added)).map(|(arm, load)| arm + load).collect();
        let mut correlation = Vec::new();
        for ((experiment, factors), base) in
            self.experiments.iter().zip(&self.factors).zip([base, &loaded])
        {
            let columns = experiment.with_gains(gains)?;
            let trajectories = experiment.trajectories_with(&[], &[], Some(&columns))?;
            let mut equations = Equations::new(robot, &self.set, &self.base, trajectories);
            correlation.extend(residual_correlation(&mut equations, factors, base)?);
        }
        Ok(correlation)
    }
}
