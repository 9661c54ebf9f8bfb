use alloc::vec::Vec;
use core::f64::consts::TAU;

use super::JointError;
use super::joint_error::{Rest, Seen};
use crate::dynamics::{Workspace, rnea};
use crate::effects::Role;
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::model::StreamedModel;
use crate::robot::Robot;
use crate::spatial::Vector3;
use crate::stream::{Predictor, StreamError, StreamOptions};

/// How torque from outside is observed.
#[derive(Clone, Debug, PartialEq)]
pub struct ObserverOptions {
    /// Rate of the calls, Hz.
    pub rate_hz: f64,
    /// Bandwidth of the observer, Hz: it follows torque from outside with a first-order lag.
    pub bandwidth_hz: f64,
    /// False alarms of the whole arm that are accepted per hour, if the model's errors are normal.
    pub false_alarms_per_hour: f64,
    /// Standard deviation of the model's torque per joint, `[n]`, N·m (N), where it is known better than from the fit, as
    /// from a log without contact; empty for that of the fit.
    pub deviation: Vec<f64>,
}

impl Default for ObserverOptions {
    fn default() -> Self {
        Self { rate_hz: 100.0, bandwidth_hz: 2.0, false_alarms_per_hour: 1.0, deviation: Vec::new() }
    }
}

/// Why there is no observer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObserverError {
    /// A number that is none.
    #[error("{name}: got {found}, expected a finite number above zero")]
    Option {
        /// The option.
        name: &'static str,
        /// Its value.
        found: f64,
    },
    /// An observer that is faster than its samples.
    #[error("bandwidth_hz: got {found} Hz, expected at most a tenth of the rate of {rate_hz} Hz")]
    TooFast {
        /// The bandwidth.
        found: f64,
        /// The rate.
        rate_hz: f64,
    },
    /// A model of which nobody knows how good it is.
    #[error("the model was not identified from logs: give the standard deviation of its torque (`deviation`)")]
    NoDeviation,
    /// A log of another rate than the observer.
    #[error("log {log}: {found:.1} samples per second, expected {rate_hz} as the observer: resample it")]
    LogRate {
        /// Index of the log.
        log: usize,
        /// Its rate, Hz.
        found: f64,
        /// That of the observer, Hz.
        rate_hz: f64,
    },
    /// Logs that say too little of the model's errors.
    #[error("logs without contact: got {found} samples, expected at least {expected} with an error at every joint")]
    FewSamples {
        /// How many samples there are.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
    /// A sample or a model that a predictor refuses.
    #[error(transparent)]
    Stream(#[from] StreamError),
}

/// A log without contact, for [`MomentumObserver::calibrated`].
#[derive(Clone, Copy, Debug)]
pub struct MeasuredMotion<'a> {
    /// Samples per second.
    pub rate_hz: f64,
    /// Positions, `[samples, n]`, rad (m).
    pub q: &'a [f64],
    /// Velocities, `[samples, n]`, rad/s (m/s).
    pub dq: &'a [f64],
    /// Torques of the drives, `[samples, n]`, N·m (N).
    pub tau: &'a [f64],
}

/// Least number of samples of logs without contact.
const FEWEST: usize = 100;

/// Torque from outside that is larger than the model's errors explain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alarm {
    /// Index of the joint whose torque is farthest beyond its threshold.
    pub joint: usize,
    /// That torque, N·m (N).
    pub torque: f64,
    /// Its threshold, N·m (N).
    pub threshold: f64,
}

/// Torque from outside from positions, velocities and the torque of the drives, without accelerations: what changes the
/// momentum p = M(q) dq, rotors included, beside the drives and the model,
///
/// r = K (p - p0 - ∫ (tau - h(q, dq) + dM/dt dq + r) dt),
///
/// where h is the model's torque without acceleration: gravity, friction with its memory, centrifugal and Coriolis torque.
/// r follows the torque from outside with a first-order lag 1/K.
///
/// An alarm is a torque beyond z standard deviations of the model's error. A normal process of bandwidth f crosses ±z 2 f
/// exp(-z²/2) times per second, so that z follows from the false alarms per hour that are accepted.
///
/// Errors of real models are not those of one normal process: at rest and where a joint turns back they are some times
/// as large, because dry friction then has any value. [`Self::calibrated`] takes both from logs without contact
/// ([`JointError`]); without it there are false alarms at reversals.
///
/// Inertia that depends on single joints' findings (`wrist_coupling`, `kinematic_error`) is not in the momentum.
///
/// Source: A. De Luca, R. Mattone, Actuator failure detection and isolation using generalized momenta, ICRA (2003);
/// S. O. Rice, Mathematical analysis of random noise, Bell Syst. Tech. J. 23 (1944), for the crossings.
#[derive(Debug)]
pub struct MomentumObserver {
    predictor: Predictor,
    /// Without gravity, so that its torque of an acceleration at rest is M(q) times it.
    weightless: Robot,
    rotor_inertia: Vec<f64>,
    ws: Workspace,
    gain: f64,
    step: f64,
    z: f64,
    errors: Vec<JointError>,
    rests: Vec<Rest>,
    /// At the last sample.
    thresholds: Vec<f64>,
    integral: Vec<f64>,
    external: Vec<f64>,
    /// Before the first sample there is no momentum to start from.
    started: bool,
    room: Room,
}

/// Arrays of `[n]`.
#[derive(Debug)]
struct Room {
    zeros: Vec<f64>,
    q: Vec<f64>,
    momentum: Vec<f64>,
    /// dM/dt dq.
    change: Vec<f64>,
}

impl MomentumObserver {
    /// # Errors
    /// If an option is none, the model cannot be streamed, or nobody knows how good it is.
    pub fn new(model: impl Into<StreamedModel>, options: &ObserverOptions) -> Result<Self, ObserverError> {
        let model = &model.into();
        let ObserverOptions { rate_hz, bandwidth_hz, false_alarms_per_hour, .. } = *options;
        let numbers =
            [("rate_hz", rate_hz), ("bandwidth_hz", bandwidth_hz), ("false_alarms_per_hour", false_alarms_per_hour)];
        for (name, found) in numbers {
            if !(found.is_finite() && found > 0.0) {
                return Err(ObserverError::Option { name, found });
            }
        }
        if bandwidth_hz > 0.1 * rate_hz {
            return Err(ObserverError::TooFast { found: bandwidth_hz, rate_hz });
        }
        let n = model.robot().dof();
        let deviation = deviation(model, options)?;
        let crossings_per_hour = 3600.0 * 2.0 * n as f64 * bandwidth_hz;
        let z = f64::sqrt(2.0 * f64::ln((crossings_per_hour / false_alarms_per_hour).max(1.0)));
        let stream = StreamOptions { rate_hz: Some(rate_hz), ..StreamOptions::default() };
        let zeros = || vec![0.0; n];
        Ok(Self {
            predictor: model.predictor(&stream)?,
            weightless: model.robot().clone().with_gravity(Vector3::ZERO),
            rotor_inertia: rotor_inertia(model),
            ws: Workspace::new(model.robot()),
            gain: TAU * bandwidth_hz,
            step: 1.0 / rate_hz,
            z,
            errors: deviation.iter().map(|deviation| JointError::even(*deviation)).collect(),
            rests: vec![Rest::default(); n],
            thresholds: deviation.iter().map(|deviation| z * deviation).collect(),
            integral: zeros(),
            external: zeros(),
            started: false,
            room: Room { zeros: zeros(), q: zeros(), momentum: zeros(), change: zeros() },
        })
    }

    /// The same with thresholds from what it says along logs without contact, those of the fit or better others, of
    /// motions such as it will see: the standard deviation of each joint's error while it moves and at rest. It forgets
    /// all samples.
    ///
    /// # Errors
    /// If a log has another rate than the observer (by more than a hundredth), arrays of different lengths or a number
    /// that is not finite, or the logs have too few samples.
    pub fn calibrated(mut self, logs: &[MeasuredMotion<'_>]) -> Result<Self, ObserverError> {
        let n = self.external.len();
        let mut seen: Vec<Vec<Seen>> = (0..n).map(|_| Vec::new()).collect();
        let rate_hz = 1.0 / self.step;
        for (index, log) in logs.iter().enumerate() {
            let same_rate = (log.rate_hz / rate_hz - 1.0).abs() < 0.01;
            if !same_rate {
                return Err(ObserverError::LogRate { log: index, found: log.rate_hz, rate_hz });
            }
            for (name, values) in [("dq", log.dq), ("tau", log.tau)] {
                if values.len() != log.q.len() {
                    return Err(StreamError::Length { name, found: values.len(), expected: log.q.len() }.into());
                }
            }
            self.reset();
            seen.iter_mut().for_each(|joint| joint.push(Seen { error: Vec::new(), speed: Vec::new() }));
            for ((q, dq), tau) in log.q.chunks(n).zip(log.dq.chunks(n)).zip(log.tau.chunks(n)) {
                let external = self.update(q, dq, tau)?;
                for ((joint, external), dq) in seen.iter_mut().zip(external).zip(dq) {
                    joint[index].error.push(*external);
                    joint[index].speed.push(*dq);
                }
            }
        }
        let found: usize = logs.iter().map(|log| log.q.len() / n).sum();
        let few = ObserverError::FewSamples { found, expected: FEWEST };
        if found < FEWEST {
            return Err(few);
        }
        let blend = self.blend();
        let fit = |joint: &Vec<Seen>| JointError::fit(joint, blend).ok_or_else(|| few.clone());
        self.errors = seen.iter().map(fit).collect::<Result<_, _>>()?;
        self.reset();
        Ok(self)
    }

    /// The standard deviations of the model's error, one per joint.
    pub fn errors(&self) -> &[JointError] {
        &self.errors
    }

    /// Share of a new sample in what the observer says.
    fn blend(&self) -> f64 {
        self.gain * self.step / (1.0 + self.gain * self.step)
    }

    /// Torque beyond which there is an alarm at the last sample, that of a moving arm before the first, `[n]`, N·m (N).
    pub fn thresholds(&self) -> &[f64] {
        &self.thresholds
    }

    /// Torque from outside at the last sample, `[n]`, N·m (N): positive along the joint's axis.
    pub fn external_torque(&self) -> &[f64] {
        &self.external
    }

    /// The joint that is farthest beyond its threshold at the last sample, if one is.
    pub fn alarm(&self) -> Option<Alarm> {
        let all = self.external.iter().zip(&self.thresholds).enumerate();
        let beyond = all.filter(|(_, (torque, threshold))| torque.abs() > **threshold);
        let worst = beyond.max_by(|(_, a), (_, b)| (a.0.abs() / a.1).total_cmp(&(b.0.abs() / b.1)));
        worst.map(|(joint, (torque, threshold))| Alarm { joint, torque: *torque, threshold: *threshold })
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        self.predictor.reset();
        self.integral.fill(0.0);
        self.external.fill(0.0);
        self.rests.fill(Rest::default());
        self.thresholds.iter_mut().zip(&self.errors).for_each(|(own, error)| *own = self.z * error.moving);
        self.started = false;
    }

    /// Torque from outside at the next sample, `[n]`, N·m (N).
    ///
    /// - `q`, `dq`: measured, `[n]`, rad, rad/s (m, m/s)
    /// - `tau`: torque of the drives as their log shows it, `[n]`, N·m (N)
    ///
    /// # Errors
    /// If there is not one finite number per joint; then nothing changes.
    pub fn update(&mut self, q: &[f64], dq: &[f64], tau: &[f64]) -> Result<&[f64], StreamError> {
        let n = self.external.len();
        if tau.len() != n {
            return Err(StreamError::Length { name: "tau", found: tau.len(), expected: n });
        }
        if let Some(joint) = tau.iter().position(|value| !value.is_finite()) {
            return Err(StreamError::NotFinite { name: "tau", joint, value: tau[joint] });
        }
        let needed = self.predictor.try_torque(q, dq, &self.room.zeros)?;
        let room = &mut self.room;
        momentum_change(&self.weightless, &mut self.ws, q, dq, room);
        room.momentum.copy_from_slice(rnea(&self.weightless, &mut self.ws, q, &room.zeros, dq));
        for joint in 0..n {
            let momentum = room.momentum[joint] + self.rotor_inertia[joint] * dq[joint];
            if !self.started {
                self.integral[joint] = momentum;
            } else {
                // The torque from outside enters at this sample, so that the lag is stable at any gain.
                let known = (tau[joint] - needed[joint] + room.change[joint]) * self.step;
                self.integral[joint] += known;
                let error = momentum - self.integral[joint];
                self.external[joint] = self.gain * error / (1.0 + self.gain * self.step);
                self.integral[joint] += self.external[joint] * self.step;
            }
        }
        self.started = true;
        let blend = self.blend();
        for (((threshold, error), rest), dq) in
            self.thresholds.iter_mut().zip(&self.errors).zip(&mut self.rests).zip(dq)
        {
            *threshold = self.z * error.deviation(rest.next(error, *dq, blend));
        }
        Ok(&self.external)
    }
}

/// dM/dt dq, from the momentum of this velocity a little before and after along the motion.
fn momentum_change(robot: &Robot, ws: &mut Workspace, q: &[f64], dq: &[f64], room: &mut Room) {
    /// s. The error is of the order of its square times three derivatives of the momentum: some 1e-9 N·m.
    const STEP: f64 = 1e-5;
    room.change.fill(0.0);
    for side in [1.0, -1.0] {
        room.q.iter_mut().zip(q.iter().zip(dq)).for_each(|(at, (q, dq))| *at = q + side * STEP * dq);
        let momentum = rnea(robot, ws, &room.q, &room.zeros, dq);
        room.change.iter_mut().zip(momentum).for_each(|(change, p)| *change += side * p / (2.0 * STEP));
    }
}

fn rotor_inertia(model: &StreamedModel) -> Vec<f64> {
    let (set, mut inertia) = (model.parameter_set(), vec![0.0; model.robot().dof()]);
    for (column, value) in set.effect_columns().iter().zip(&model.parameters()[set.inertial()..]) {
        if set.effects()[column.effect].role() == Some(Role::RotorInertia) {
            inertia[column.joint] += value;
        }
    }
    inertia
}

/// Standard deviation of the model's torque per joint.
fn deviation(model: &StreamedModel, options: &ObserverOptions) -> Result<Vec<f64>, ObserverError> {
    if options.deviation.is_empty() {
        let noise = model.noise().to_vec();
        return if noise.is_empty() { Err(ObserverError::NoDeviation) } else { Ok(noise) };
    }
    let (found, expected) = (options.deviation.len(), model.robot().dof());
    if found != expected {
        return Err(StreamError::Length { name: "deviation", found, expected }.into());
    }
    match options.deviation.iter().find(|value| !(value.is_finite() && **value > 0.0)) {
        Some(found) => Err(ObserverError::Option { name: "deviation", found: *found }),
        None => Ok(options.deviation.clone()),
    }
}
