use alloc::vec::Vec;
use core::f64::consts::TAU;

use super::JointError;
use super::joint_error::{ContactFree, RestShare};
use crate::dynamics::Momentum;
use crate::effects::Role;
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::model::StreamedModel;
use crate::simd::Real;
use crate::stream::{Plain, Predictor, StreamError, StreamOptions};

/// How torque from outside is observed.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ObserverOptions {
    /// Rate of the calls, Hz.
    pub rate_hz: f64,
    /// Bandwidth of the observer, Hz: it follows torque from outside with a first-order lag.
    pub bandwidth_hz: f64,
    /// False alarms of the whole arm that are accepted per hour, if the model's errors are normal.
    pub false_alarms_per_hour: f64,
    /// Standard deviation of the model's torque per joint, `[n]`, N·m (N), where it is known better
    /// than from the fit, as from a log without contact; empty for that of the fit.
    pub deviation: Vec<f64>,
}

impl ObserverOptions {
    setters! {
        with_rate_hz(rate_hz: f64),
        with_bandwidth_hz(bandwidth_hz: f64),
        with_false_alarms_per_hour(false_alarms_per_hour: f64),
        with_deviation(deviation: Vec<f64>),
    }
}

impl Default for ObserverOptions {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            bandwidth_hz: 2.0,
            false_alarms_per_hour: 1.0,
            deviation: Vec::new(),
        }
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
    #[error(
        "the model was not identified from logs: give the standard deviation of its torque \
         (`deviation`)"
    )]
    NoDeviation,
    /// A log of another rate than the observer.
    #[error(
        "log {log}: {found:.1} samples per second, expected {rate_hz} as the observer: resample it"
    )]
    LogRate {
        /// Index of the log.
        log: usize,
        /// Its rate, Hz.
        found: f64,
        /// That of the observer, Hz.
        rate_hz: f64,
    },
    /// Logs that say too little of the model's errors.
    #[error(
        "logs without contact: got {found} samples, expected at least {expected} with an error at \
         every joint"
    )]
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
#[non_exhaustive]
pub struct Alarm<F = f64> {
    /// Index of the joint whose torque is farthest beyond its threshold.
    pub joint: usize,
    /// That torque, N·m (N).
    pub torque: F,
    /// Its threshold, N·m (N).
    pub threshold: F,
}

/// Torque from outside from positions, velocities and the torque of the drives, without
/// accelerations: what changes the momentum p = M(q) dq, rotors included, beside the drives and the
/// model,
///
/// r = K (p - p0 - ∫ (tau - h(q, dq) + dM/dt dq + r) dt),
///
/// where h is the model's torque without acceleration: gravity, friction with its memory,
/// centrifugal and Coriolis torque. r follows the torque from outside with a first-order lag 1/K.
///
/// An alarm is a torque beyond z standard deviations of the model's error. A normal process of
/// bandwidth f crosses ±z 2 f exp(-z²/2) times per second, so that z follows from the false alarms
/// per hour that are accepted.
///
/// Errors of real models are not those of one normal process: at rest and where a joint turns back
/// they are some times as large, because dry friction then has any value. [`Self::calibrated`]
/// takes both from logs without contact ([`JointError`]); without it there are false alarms at
/// reversals.
///
/// Inertia that depends on single joints' findings (`wrist_coupling`, `kinematic_error`) is not in
/// the momentum.
///
/// Source: A. De Luca, R. Mattone, Actuator failure detection and isolation using generalized
/// momenta, ICRA (2003); S. O. Rice, Mathematical analysis of random noise, Bell Syst. Tech. J. 23
/// (1944), for the crossings.
#[derive(Debug)]
pub struct MomentumObserver<F: Plain = f64> {
    predictor: Predictor<F>,
    momentum: Momentum<F::Number>,
    rotor_inertia: Vec<f64>,
    gain: f64,
    step: f64,
    z: f64,
    errors: Vec<JointError>,
    rests: Vec<RestShare<F::Number>>,
    /// At the last sample.
    thresholds: Vec<F>,
    integral: Vec<F::Number>,
    zeros: Vec<F>,
    external: Vec<F>,
    /// Before the first sample there is no momentum to start from.
    started: bool,
    room: ObserverBuffers<F::Number>,
}

/// Arrays of `[n]`.
#[derive(Debug)]
struct ObserverBuffers<S> {
    q: Vec<S>,
    dq: Vec<S>,
    momentum: Vec<S>,
    /// dM/dt dq.
    change: Vec<S>,
}

impl MomentumObserver {
    /// # Errors
    /// If an option is none, the model cannot be streamed, or nobody knows how good it is.
    pub fn new(
        model: impl Into<StreamedModel>,
        options: &ObserverOptions,
    ) -> Result<Self, ObserverError> {
        Self::of(&model.into(), options)
    }
}

impl MomentumObserver<f32> {
    /// The same in 32 bits ([`StreamedModel::single_predictor`]).
    ///
    /// # Errors
    /// As [`MomentumObserver::new`]; if an effect is not written over numbers of 32 bits.
    pub fn single(
        model: impl Into<StreamedModel>,
        options: &ObserverOptions,
    ) -> Result<Self, ObserverError> {
        Self::of(&model.into(), options)
    }
}

impl<F: Plain> MomentumObserver<F> {
    fn of(model: &StreamedModel, options: &ObserverOptions) -> Result<Self, ObserverError> {
        let ObserverOptions { rate_hz, bandwidth_hz, false_alarms_per_hour, .. } = *options;
        let numbers = [
            ("rate_hz", rate_hz),
            ("bandwidth_hz", bandwidth_hz),
            ("false_alarms_per_hour", false_alarms_per_hour),
        ];
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
        let numbers = || vec![F::Number::zero(()); n];
        Ok(Self {
            predictor: model.predictor_in(&stream)?,
            momentum: Momentum::new(model.robot()),
            rotor_inertia: rotor_inertia(model),
            gain: TAU * bandwidth_hz,
            step: 1.0 / rate_hz,
            z,
            errors: deviation.iter().map(|deviation| JointError::even(*deviation)).collect(),
            rests: vec![RestShare::default(); n],
            thresholds: deviation.iter().map(|deviation| F::of_f64(z * deviation)).collect(),
            integral: numbers(),
            zeros: vec![F::default(); n],
            external: vec![F::default(); n],
            started: false,
            room: ObserverBuffers {
                q: numbers(),
                dq: numbers(),
                momentum: numbers(),
                change: numbers(),
            },
        })
    }

    /// The same with thresholds from what it says along logs without contact, those of the fit or
    /// better others, of motions such as it will see: the standard deviation of each joint's error
    /// while it moves and at rest. It forgets all samples.
    ///
    /// # Errors
    /// If a log has another rate than the observer (by more than a hundredth), arrays of different
    /// lengths or a number that is not finite, or the logs have too few samples.
    pub fn calibrated(mut self, logs: &[MeasuredMotion<'_>]) -> Result<Self, ObserverError> {
        let n = self.external.len();
        let mut seen: Vec<Vec<ContactFree>> = (0..n).map(|_| Vec::new()).collect();
        let rate_hz = 1.0 / self.step;
        for (index, log) in logs.iter().enumerate() {
            let same_rate = (log.rate_hz / rate_hz - 1.0).abs() < 0.01;
            if !same_rate {
                return Err(ObserverError::LogRate { log: index, found: log.rate_hz, rate_hz });
            }
            for (name, values) in [("dq", log.dq), ("tau", log.tau)] {
                if values.len() != log.q.len() {
                    return Err(StreamError::Length {
                        name,
                        found: values.len(),
                        expected: log.q.len(),
                    }
                    .into());
                }
            }
            self.reset();
            seen.iter_mut()
                .for_each(|joint| joint.push(ContactFree { error: Vec::new(), speed: Vec::new() }));
            let [mut q, mut dq, mut tau] = [const { Vec::new() }; 3];
            for k in (0..log.q.len()).step_by(n) {
                for (own, given) in
                    [&mut q, &mut dq, &mut tau].into_iter().zip([log.q, log.dq, log.tau])
                {
                    own.clear();
                    own.extend(
                        given[k..(k + n).min(given.len())].iter().map(|value| F::of_f64(*value)),
                    );
                }
                let external = self.update(&q, &dq, &tau)?;
                for ((joint, external), dq) in seen.iter_mut().zip(external).zip(&dq) {
                    joint[index].error.push((*external).into());
                    joint[index].speed.push((*dq).into());
                }
            }
        }
        let found: usize = logs.iter().map(|log| log.q.len() / n).sum();
        let few = ObserverError::FewSamples { found, expected: FEWEST };
        if found < FEWEST {
            return Err(few);
        }
        let blend = self.blend();
        let fit =
            |joint: &Vec<ContactFree>| JointError::fit(joint, blend).ok_or_else(|| few.clone());
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

    /// Torque beyond which there is an alarm at the last sample, that of a moving arm before the
    /// first, `[n]`, N·m (N).
    pub fn thresholds(&self) -> &[F] {
        &self.thresholds
    }

    /// Torque from outside at the last sample, `[n]`, N·m (N): positive along the joint's axis.
    pub fn external_torque(&self) -> &[F] {
        &self.external
    }

    /// The joint that is farthest beyond its threshold at the last sample, if one is.
    pub fn alarm(&self) -> Option<Alarm<F>> {
        let all = self.external.iter().zip(&self.thresholds).enumerate();
        let ratio = |torque: F, threshold: F| torque.into().abs() / threshold.into();
        let ratios = all.map(|(joint, (torque, threshold))| (ratio(*torque, *threshold), joint));
        let beyond = ratios.filter(|(ratio, _)| *ratio > 1.0);
        let (_, joint) = beyond.max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Alarm { joint, torque: self.external[joint], threshold: self.thresholds[joint] })
    }

    /// Forgets all samples.
    pub fn reset(&mut self) {
        self.predictor.reset();
        self.integral.fill(F::Number::zero(()));
        self.external.fill(F::default());
        self.rests.fill(RestShare::default());
        self.thresholds
            .iter_mut()
            .zip(&self.errors)
            .for_each(|(own, error)| *own = F::of_f64(self.z * error.moving));
        self.started = false;
    }

    /// Torque from outside at the next sample, `[n]`, N·m (N).
    ///
    /// - `q`, `dq`: measured, `[n]`, rad, rad/s (m, m/s)
    /// - `tau`: torque of the drives as their log shows it, `[n]`, N·m (N)
    ///
    /// # Errors
    /// If there is not one finite number per joint; then nothing changes.
    pub fn update(&mut self, q: &[F], dq: &[F], tau: &[F]) -> Result<&[F], StreamError> {
        let n = self.external.len();
        if tau.len() != n {
            return Err(StreamError::Length { name: "tau", found: tau.len(), expected: n });
        }
        if let Some(joint) = tau.iter().position(|value| !(*value).into().is_finite()) {
            return Err(StreamError::NotFinite { name: "tau", joint, value: tau[joint].into() });
        }
        let blend = self.blend();
        let needed = self.predictor.try_torque(q, dq, &self.zeros)?;
        let room = &mut self.room;
        room.q.iter_mut().zip(q).for_each(|(own, q)| *own = q.number());
        room.dq.iter_mut().zip(dq).for_each(|(own, dq)| *own = dq.number());
        self.momentum.run(&room.q, &room.dq, &mut room.momentum, &mut room.change);
        for joint in 0..n {
            let momentum = room.momentum[joint] + room.dq[joint] * self.rotor_inertia[joint];
            if !self.started {
                self.integral[joint] = momentum;
            } else {
                // The torque from outside enters at this sample, so that the lag is stable at any
                // gain.
                let known =
                    (tau[joint].number() - needed[joint].number() + room.change[joint]) * self.step;
                self.integral[joint] += known;
                let error = momentum - self.integral[joint];
                let external = error * (self.gain / (1.0 + self.gain * self.step));
                self.external[joint] = F::of(external);
                self.integral[joint] += external * self.step;
            }
        }
        self.started = true;
        for (((threshold, error), rest), dq) in
            self.thresholds.iter_mut().zip(&self.errors).zip(&mut self.rests).zip(&room.dq)
        {
            *threshold = F::of(error.deviation(rest.next(error, *dq, blend)) * self.z);
        }
        Ok(&self.external)
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
