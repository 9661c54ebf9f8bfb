//! What is suspicious in the rows of logs.

use super::IdentifyError;
use crate::identification::{
    Equations, Finding, LeastSquares, Method, screen_delays, screen_factors, screen_rows,
};
use crate::model::TorqueModel;
use crate::model::correlation::correlation;
use crate::model::experiment::{Experiment, TermColumns, select_joints, torque_of};
use crate::motion::Processing;
use crate::recording::Recording;

/// What is suspicious in recordings from which `model` was identified, the rows of the data
/// included: torques that are late, outliers, times on which everything hangs.
///
/// # Errors
/// As [`identify`](super::identify).
pub fn screen(
    model: &TorqueModel,
    recordings: &[Recording],
) -> Result<Vec<Finding>, IdentifyError> {
    let Some(processing) = &model.processing else { return Ok(Vec::new()) };
    let (robot, set, base) = (&model.robot, &model.set, &model.base);
    let recordings = select_joints(robot, recordings)?;
    let experiment = Experiment::new(&recordings, processing)?;
    // What the terms make is no matter of the rigid body.
    let mut tau = Vec::with_capacity(experiment.motions.len());
    for motion in &experiment.motions {
        let (whole, own) =
            (model.predict_motion(motion), model.without_terms().predict(motion.samples()));
        let torques = torque_of(motion)?.iter().zip(whole.iter().zip(&own));
        tau.push(torques.map(|(tau, (whole, own))| tau - (whole - own)).collect());
    }
    let columns = TermColumns {
        tau,
        values: vec![vec![]; experiment.motions.len()],
        parameters: vec![],
        gains: vec![],
    };
    let equations =
        Equations::new(robot, set, base, experiment.trajectories_with(&[], &[], Some(&columns))?);
    let factors = equations.factors()?;
    let memory = correlation(model, &experiment.motions, processing, &factors)?;
    let estimate = LeastSquares { method: Method::Wls, correlation: Some(memory) };
    let estimate = estimate.solve(&factors, base, &base.combine(&model.parameters))?;
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    let mut findings = screen_factors(set, base, &joints, &factors, &estimate);
    // Dry friction near turns looks like a torque at another time, and like outliers, as do the
    // ends of a log.
    let calm = Processing { turn_margin: processing.turn_margin.max(1.0), ..processing.clone() };
    let rows = experiment.calm_rows(&calm);
    let mut trajectories = experiment.trajectories_with(&[], &[], Some(&columns))?;
    trajectories
        .iter_mut()
        .zip(&rows)
        .for_each(|(trajectory, rows)| trajectory.use_as = Some(rows));
    let mut equations = Equations::new(robot, set, base, trajectories);
    findings.extend(screen_rows(
        &mut equations,
        &joints,
        &experiment.rates_hz(),
        &factors,
        &estimate,
    )?);
    findings.extend(screen_delays(&equations, &joints, &experiment.rates_hz())?);
    Ok(findings)
}
