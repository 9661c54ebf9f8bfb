//! How well a streamed model predicts the torque of logs.

use super::compare::compare_set;
use super::{
    Comparison, IdentifyError, Predictor, SemiParametricError, SemiParametricModel, StreamOptions,
    TorqueModel, given_or_chosen, select_joints,
};
use crate::dynamics::Samples;
use crate::effects::Context;
use crate::gp::PredictorOptions;
use crate::motion::{Motion, Processing};
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;
use crate::signal::LowPass;

/// The motion that a streamed model is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamedMotion {
    /// The motion of the log as it is compared with a model: filtered without delay, which needs
    /// samples that come later.
    Filtered,
    /// The positions as logged, through the same filter in one pass and differentiated from the
    /// samples before: what a controller knows that measures positions alone. The filter makes it
    /// late.
    Causal,
}

/// Compares what a model says one sample after the other with logs, processed as `processing` says,
/// by default as the model was identified. Logs and figures are those of [`crate::model::compare`],
/// and the torque is what a log would show.
///
/// # Errors
/// As [`crate::model::compare`]; if the model cannot be streamed.
pub fn compare_streaming(
    model: &TorqueModel,
    logs: impl Into<LogSet>,
    processing: Option<&Processing>,
    motion: StreamedMotion,
) -> Result<Comparison, IdentifyError> {
    let set = logs.into();
    let given = processing.or(model.processing());
    let chosen = given_or_chosen(given, &select_joints(model.robot(), &set)?)?;
    let predict = |stretch: &Motion, log: &Recording| {
        let mut predictor = model.predictor(&at_rate(stretch))?;
        streamed(&mut predictor, model, stretch, &StreamedLog { log, processing: &chosen, motion })
    };
    compare_set(model, &predict, &set, Some(&chosen))
}

impl SemiParametricModel {
    /// As [`compare_streaming`].
    ///
    /// # Errors
    /// As [`compare_streaming`].
    pub fn compare_streaming(
        &self,
        logs: impl Into<LogSet>,
        motion: StreamedMotion,
    ) -> Result<Comparison, SemiParametricError> {
        let (physics, set) = (self.physics(), logs.into());
        let logs = select_joints(physics.robot(), &set).map_err(IdentifyError::from)?;
        let chosen = given_or_chosen(physics.processing(), &logs).map_err(IdentifyError::from)?;
        let mean = PredictorOptions::default().with_variance_rank(Some(0));
        let predict = |stretch: &Motion, log: &Recording| {
            let source = StreamedLog { log, processing: &chosen, motion };
            let mut predictor = self.predictor(mean, &at_rate(stretch))?;
            Ok::<_, SemiParametricError>(streamed(&mut predictor, physics, stretch, &source)?)
        };
        compare_set(physics, &predict, &set, Some(&chosen))
    }
}

fn at_rate(stretch: &Motion) -> StreamOptions {
    StreamOptions::default().with_rate_hz(Some(stretch.rate_hz))
}

/// Where the motion comes from.
struct StreamedLog<'a> {
    log: &'a Recording,
    processing: &'a Processing,
    motion: StreamedMotion,
}

/// Torques along a stretch of a log, `[samples, n]`.
fn streamed(
    predictor: &mut Predictor,
    model: &TorqueModel,
    stretch: &Motion,
    source: &StreamedLog<'_>,
) -> Result<Vec<f64>, IdentifyError> {
    let n = model.robot().dof();
    let time = model.time_of(stretch);
    predictor.set_time(time.first().copied().unwrap_or_default())?;
    let causal = match source.motion {
        StreamedMotion::Filtered => None,
        StreamedMotion::Causal => Some(causal_motion(source, stretch, n)?),
    };
    let [q, dq, ddq] =
        causal.as_ref().map_or([&stretch.q, &stretch.dq, &stretch.ddq], |own| own.each_ref());
    let temperatures = temperatures(model.robot(), stretch);
    let mut celsius = vec![0.0; n];
    let mut tau = Vec::with_capacity(q.len());
    for k in 0..stretch.len() {
        if let Some(temperatures) = &temperatures {
            celsius.iter_mut().zip(temperatures).for_each(|(value, channel)| *value = channel[k]);
            predictor.set_temperature(&celsius)?;
        }
        let row = k * n..(k + 1) * n;
        tau.extend_from_slice(predictor.try_torque(
            &q[row.clone()],
            &dq[row.clone()],
            &ddq[row],
        )?);
    }
    Ok(tau)
}

/// The channel of each joint's temperature, if there is one for every joint.
fn temperatures<'a>(robot: &'a Robot, stretch: &'a Motion) -> Option<Vec<&'a [f64]>> {
    let samples = Samples { q: &stretch.q, dq: &stretch.dq, ddq: &stretch.ddq };
    let context =
        Context::new(robot, stretch.rate_hz, &[], samples).with_channels(&stretch.channels);
    (0..robot.dof()).map(|joint| context.temperature_celsius(joint)).collect()
}

/// Position, velocity and acceleration, `[samples, n]`, from the logged positions up to each
/// sample.
fn causal_motion(
    source: &StreamedLog<'_>,
    stretch: &Motion,
    n: usize,
) -> Result<[Vec<f64>; 3], IdentifyError> {
    let StreamedLog { log, processing, .. } = source;
    let first = stretch.time.first().copied().unwrap_or_default();
    let at = log.time().binary_search(&first).expect("a stretch is made of rows of its recording");
    let mut q = log.position()[at * n..(at + stretch.len()) * n].to_vec();
    LowPass::butterworth(processing.order, processing.cutoff_hz, stretch.rate_hz)?
        .apply_forwards(&mut q, n);
    let (mut dq, mut ddq) = (vec![0.0; q.len()], vec![0.0; q.len()]);
    for k in 2 * n..q.len() {
        let (now, last, before) = (q[k], q[k - n], q[k - 2 * n]);
        dq[k] = (1.5 * now - 2.0 * last + 0.5 * before) * stretch.rate_hz;
        ddq[k] = (now - 2.0 * last + before) * stretch.rate_hz * stretch.rate_hz;
        if dq[k].abs() < processing.standstill_speed[k % n] {
            (dq[k], ddq[k]) = (0.0, 0.0);
        }
    }
    Ok([q, dq, ddq])
}
