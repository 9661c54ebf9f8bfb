//! An identified model with what has changed since on top.

use alloc::boxed::Box;
use alloc::vec::Vec;

use super::error::{require, require_positive};
use super::{
    Budget, MotionFilter, OnlineError, OnlineGaussianProcess, PayloadOptions, PayloadTracker,
};
use crate::control::InverseDynamics;
use crate::gp::{Kernel, Shape};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::model::StreamedModel;
use crate::robot::Robot;
use crate::stream::{Purpose, StreamOptions};

/// What an [`OnlineModel`] follows, and how fast.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OnlineOptions {
    /// Time between updates, s.
    pub period: f64,
    /// Cut-off of the filters, Hz.
    pub cutoff_hz: f64,
    /// Below this speed a joint stands, and its residual says nothing: dry friction holds it, rad/s
    /// (m/s).
    pub standstill_speed: f64,
    /// The payload, if one is tracked.
    pub payload: Option<PayloadOptions>,
    /// Budget of the process on what is left over, if there is one.
    pub process: Option<Budget>,
    /// Variance of the noise that the process expects, of that of what it learns.
    pub process_noise: f64,
}

impl OnlineOptions {
    setters! {
        with_period(period: f64),
        with_cutoff_hz(cutoff_hz: f64),
        with_standstill_speed(standstill_speed: f64),
        with_payload(payload: Option<PayloadOptions>),
        with_process(process: Option<Budget>),
        with_process_noise(process_noise: f64),
    }
}

impl Default for OnlineOptions {
    /// 1 kHz, 10 Hz, nothing followed.
    fn default() -> Self {
        Self {
            period: 1e-3,
            cutoff_hz: 10.0,
            standstill_speed: 0.02,
            payload: None,
            process: None,
            process_noise: 0.01,
        }
    }
}

/// tau = model + payload + process: the model as it was identified, the payload and the process as
/// the last samples say. An update allocates nothing if the model does not.
///
/// The process looks at all positions, velocities and accelerations, and learns what model and
/// payload leave over; where no point is near it says nothing.
pub struct OnlineModel {
    model: Box<dyn InverseDynamics>,
    /// The model along the measured motion, where it has a memory.
    measured: Option<Box<dyn InverseDynamics>>,
    filter: MotionFilter,
    period: f64,
    payload: Option<PayloadTracker>,
    process: Option<OnlineGaussianProcess>,
    residual: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl core::fmt::Debug for OnlineModel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("OnlineModel")
            .field("payload", &self.payload)
            .field("process", &self.process)
            .finish()
    }
}

/// Kernel of a process over x = [q, dq, ddq] of `dof` joints: squared exponential, length scales of
/// 0.3 rad, 0.6 rad/s and 3 rad/s² times the square root of the number of joints, a variance of
/// one.
pub fn process_kernel(dof: usize) -> Kernel {
    let root = (dof as f64).sqrt();
    let scales: Vec<f64> =
        [0.3, 0.6, 3.0].iter().flat_map(|scale| vec![root * scale; dof]).collect();
    Kernel::ard(Shape::SquaredExponential, &scales)
}

impl OnlineModel {
    /// The only place that allocates.
    ///
    /// # Errors
    /// If an option has no meaning.
    pub fn new(
        robot: &Robot,
        model: Box<dyn InverseDynamics>,
        options: &OnlineOptions,
    ) -> Result<Self, OnlineError> {
        let n = robot.dof();
        require_positive("process_noise", options.process_noise)?;
        let payload = options
            .payload
            .as_ref()
            .map(|payload| PayloadTracker::new(robot, payload))
            .transpose()?;
        let process = options.process.map(|budget| {
            OnlineGaussianProcess::new(process_kernel(n), 3 * n, n, options.process_noise, budget)
        });
        Ok(Self {
            model,
            measured: None,
            filter: MotionFilter::new(
                n,
                options.period,
                options.cutoff_hz,
                options.standstill_speed,
            )?,
            period: options.period,
            payload,
            process: process.transpose()?,
            residual: vec![0.0; n],
            x: vec![0.0; 3 * n],
            y: vec![0.0; n],
        })
    }

    /// On top of a model of which friction has a memory, lags or delays: one that follows the
    /// measured motion says what is left over, and one that follows the motion that is asked for
    /// gives the torque.
    ///
    /// - `stream`: purpose of that torque, and effects to keep; the rate is that of the options
    ///
    /// # Errors
    /// If an option has no meaning, or the model cannot be streamed.
    pub fn of(
        model: &StreamedModel,
        stream: &StreamOptions,
        options: &OnlineOptions,
    ) -> Result<Self, OnlineError> {
        require_positive("period", options.period)?;
        let asked = StreamOptions { rate_hz: Some(1.0 / options.period), ..stream.clone() };
        let measured = StreamOptions {
            purpose: Purpose::ExpectedMeasurement,
            keep: Vec::new(),
            ..asked.clone()
        };
        let online = Self::new(model.robot(), Box::new(model.predictor(&asked)?), options)?;
        Ok(online.with_measured(Box::new(model.predictor(&measured)?)))
    }

    /// The same with another model that says what is left over: one that is asked for the measured
    /// motion only, so that what it remembers is of that motion.
    #[must_use]
    pub fn with_measured(mut self, model: Box<dyn InverseDynamics>) -> Self {
        self.measured = Some(model);
        self
    }

    /// One sample, a period after the one before.
    ///
    /// - `q`: measured positions, `[n]`, rad (m)
    /// - `tau`: torque of the drives since the sample before, `[n]`, N·m (N)
    ///
    /// # Errors
    /// If a slice is not of length n or a value not finite; the model stays as it is then.
    pub fn update(&mut self, q: &[f64], tau: &[f64]) -> Result<(), OnlineError> {
        let Self { model, measured, filter, payload, process, residual, x, y, .. } = self;
        filter.update(q, tau)?;
        let n = residual.len();
        let moving = filter.moving();
        let motion = [filter.q(), filter.dq(), filter.ddq()];
        let [fq, fdq, fddq] = motion;
        residual.fill(0.0);
        // What remembers the motion has to see all of it.
        match measured {
            Some(measured) => measured.add_torque(fq, fdq, fddq, residual),
            None if moving.contains(&true) => model.add_torque(fq, fdq, fddq, residual),
            None => {}
        }
        if !moving.contains(&true) {
            return Ok(());
        }
        residual
            .iter_mut()
            .zip(filter.tau())
            .for_each(|(residual, tau)| *residual = tau - *residual);
        if let Some(payload) = payload {
            payload.update(
                self.period,
                motion,
                residual,
                moving,
                filter.samples_per_independent_sample(),
            );
        }
        let Some(process) = process else { return Ok(()) };
        for (k, part) in motion.into_iter().enumerate() {
            x[k * n..(k + 1) * n].copy_from_slice(part);
        }
        if let Some(payload) = payload {
            y.fill(0.0);
            payload.add_torque(fq, fdq, fddq, y);
            residual.iter_mut().zip(&*y).for_each(|(residual, held)| *residual -= held);
        }
        // A joint that stands says nothing: what is known of it stays.
        y.copy_from_slice(process.mean(x));
        for j in (0..n).filter(|&j| moving[j]) {
            y[j] = residual[j];
        }
        process.add(x, y)
    }

    /// Torque that the motion needs, model, payload and process, `[n]`, N·m (N).
    ///
    /// # Errors
    /// If a slice is not of length n or a value not finite.
    pub fn torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Result<&[f64], OnlineError> {
        let n = self.y.len();
        for (what, values) in [("q", q), ("dq", dq), ("ddq", ddq)] {
            require(what, values, n)?;
        }
        let mut tau = core::mem::take(&mut self.y);
        tau.fill(0.0);
        self.add_torque(q, dq, ddq, &mut tau);
        self.y = tau;
        Ok(&self.y)
    }

    /// The payload, if one is tracked.
    pub fn payload(&self) -> Option<&PayloadTracker> {
        self.payload.as_ref()
    }

    /// The process, if there is one.
    pub fn process(&self) -> Option<&OnlineGaussianProcess> {
        self.process.as_ref()
    }
}

impl InverseDynamics for OnlineModel {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.model.add_torque(q, dq, ddq, tau);
        if let Some(payload) = &mut self.payload {
            payload.add_torque(q, dq, ddq, tau);
        }
        if let Some(process) = &mut self.process {
            let n = tau.len();
            for (k, part) in [q, dq, ddq].into_iter().enumerate() {
                self.x[k * n..(k + 1) * n].copy_from_slice(part);
            }
            tau.iter_mut().zip(process.mean(&self.x)).for_each(|(tau, mean)| *tau += mean);
        }
    }
}
