//! What a controller makes of a model.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArrayDyn};
use pyo3::prelude::*;
use sgpr_core::control as core;
use sgpr_core::recording::Recording;

use crate::convert::{Numbers, array};
use crate::detached::detached;
use crate::errors::{IntoPyErr, SgprError};
use crate::log_set::recordings;
use crate::model::{Model, stream_options};

type Array<'py> = Bound<'py, PyArray1<f64>>;

/// A log as the observer takes it.
fn motion(log: &Recording, dof: usize) -> PyResult<core::MeasuredMotion<'_>> {
    let wrong =
        |what: String| SgprError::new_err(format!("without_contact: {}: {what}", log.source()));
    if log.dof() != dof {
        return Err(wrong(format!("got {} joints, expected {dof}", log.dof())));
    }
    let dq = log.velocity().ok_or_else(|| wrong("it has no velocity".into()))?;
    let tau = log.torque().ok_or_else(|| wrong("it has no torque".into()))?;
    let rate_hz = log.sample_rate_hz().unwrap_or_default();
    Ok(core::MeasuredMotion { rate_hz, q: log.position(), dq, tau })
}

fn list(name: &'static str, values: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<f64>> {
    values.map_or(Ok(Vec::new()), |values| {
        Ok(Numbers::new(name, values)?.finite()?.values().to_vec())
    })
}

/// Torque from outside, from positions, velocities and the torque of the drives, without
/// accelerations: the momentum observer of De Luca and Mattone (ICRA 2003). One per thread.
///
/// It follows torque from outside with a first-order lag of its bandwidth. An alarm is a torque
/// that the model's errors do not explain: beyond as many standard deviations as normal errors
/// cross by `false_alarms_per_hour`. Errors of real models are some times as large at rest and
/// where a joint turns back, because dry friction then has any value: give logs without contact,
/// which tell both (docs/controllers.md).
///
/// Parameters
/// ----------
/// model : Model
/// rate_hz : float
///     Rate of the calls.
/// bandwidth_hz : float
///     At most a tenth of the rate.
/// false_alarms_per_hour : float
///     Of the whole arm.
/// deviation : array of shape (n,), optional
///     Standard deviation of the model's torque per joint, N·m (N); by default that of the fit.
/// without_contact : list of Recording or LogSet, optional
///     Logs at `rate_hz` with velocity and torque, those of the fit or better others, of motions
///     such as it will see. Thresholds then come from what the observer says along them, and are
///     those of a moving joint or of one that rests.
///
/// Examples
/// --------
/// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
/// >>> observer = sgpr.MomentumObserver(model, rate_hz=500.0, bandwidth_hz=5.0, deviation=[0.2, 0.1])
/// >>> at_rest = np.zeros(2)
/// >>> for _ in range(500):
/// ...     external = observer.update(at_rest, at_rest, np.array([19.62, 2.905]))
/// >>> external.round(3)
/// array([0., 2.])
/// >>> observer.alarm[0]
/// 1
#[pyclass(module = "sgpr", frozen)]
pub struct MomentumObserver {
    inner: Mutex<core::MomentumObserver>,
    dof: usize,
}

#[pymethods]
impl MomentumObserver {
    #[new]
    #[pyo3(signature = (model, *, rate_hz, bandwidth_hz=2.0, false_alarms_per_hour=1.0, deviation=None,
        without_contact=None))]
    fn new(
        py: Python<'_>,
        model: &Model,
        rate_hz: f64,
        bandwidth_hz: f64,
        false_alarms_per_hour: f64,
        deviation: Option<&Bound<'_, PyAny>>,
        without_contact: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let deviation = list("deviation", deviation)?;
        let dof = model.inner.robot().dof();
        let mut options = core::ObserverOptions::default()
            .with_rate_hz(rate_hz)
            .with_bandwidth_hz(bandwidth_hz)
            .with_false_alarms_per_hour(false_alarms_per_hour)
            .with_deviation(deviation);
        let logs = without_contact.map(recordings).transpose()?;
        if logs.is_some() && options.deviation.is_empty() {
            // Whatever the fit says, the logs say it better.
            options.deviation = vec![1.0; dof];
        }
        let inner = detached(py, || -> PyResult<core::MomentumObserver> {
            let observer = core::MomentumObserver::new(&*model.inner, &options)
                .map_err(IntoPyErr::into_py_err)?;
            let Some(logs) = &logs else { return Ok(observer) };
            let logs = logs.iter().map(|log| motion(log, dof)).collect::<PyResult<Vec<_>>>()?;
            observer.calibrated(&logs).map_err(IntoPyErr::into_py_err)
        })?;
        Ok(Self { inner: Mutex::new(inner), dof })
    }

    /// Standard deviation of the model's error at each joint, (n, 3): while it moves and what rest
    /// adds, N·m (N), and the speed at which half of the variance of rest is left, rad/s (m/s).
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let observer = self.lock();
        let rows =
            observer.errors().iter().flat_map(|error| [error.moving, error.resting, error.speed]);
        array(py, &[self.dof, 3], rows.collect())
    }

    /// Torque beyond which there is an alarm at the last sample, (n,), N·m (N).
    #[getter]
    fn thresholds<'py>(&self, py: Python<'py>) -> Array<'py> {
        PyArray1::from_slice(py, self.lock().thresholds())
    }

    /// Torque from outside at the last sample, (n,), N·m (N).
    #[getter]
    fn external_torque<'py>(&self, py: Python<'py>) -> Array<'py> {
        PyArray1::from_slice(py, self.lock().external_torque())
    }

    /// Index of the joint that is farthest beyond its threshold, its torque and its threshold; None
    /// if none is.
    #[getter]
    fn alarm(&self) -> Option<(usize, f64, f64)> {
        self.lock()
            .alarm()
            .map(|core::Alarm { joint, torque, threshold, .. }| (joint, torque, threshold))
    }

    /// Forgets all samples.
    fn reset(&self) {
        self.lock().reset();
    }

    /// Torque from outside at the next sample, (n,), N·m (N): positive along the joint's axis.
    ///
    /// Parameters
    /// ----------
    /// q, dq, tau : array of shape (n,)
    ///     Measured positions, velocities and torques of the drives: rad, rad/s, N·m (m, m/s, N).
    fn update<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (at, speed, torque) = (one("q", q)?, one("dq", dq)?, one("tau", tau)?);
        let mut observer = self.lock();
        let external = observer.update(at.values(), speed.values(), torque.values());
        Ok(PyArray1::from_slice(q.py(), external.map_err(IntoPyErr::into_py_err)?))
    }
}

impl MomentumObserver {
    fn lock(&self) -> MutexGuard<'_, core::MomentumObserver> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The torque that holds an arm where it is and overcomes its friction in the direction of the
/// wanted velocity: gravity of the measured position, friction of the wanted velocity, so that
/// nothing chatters at rest. One per thread.
///
/// Parameters
/// ----------
/// model : Model
/// friction : float
///     Share of the friction that is compensated, 0 to 1.
/// transition_speed : float
///     Speed at which friction is compensated in full, rad/s (m/s); below it the share falls in a
///     line.
/// limits : array of shape (n,), optional
///     Largest torque of each joint, N·m (N).
/// rate_hz, keep
///     As in `Model.predictor`.
///
/// Examples
/// --------
/// >>> compensation = sgpr.Compensation(sgpr.Model.nominal(sgpr.robots.two_link()))
/// >>> compensation.torque(np.zeros(2), np.zeros(2))
/// array([19.62 ,  4.905])
#[pyclass(module = "sgpr", frozen)]
pub struct Compensation {
    inner: Mutex<core::Compensation>,
    dof: usize,
}

#[pymethods]
impl Compensation {
    #[new]
    #[pyo3(signature = (model, *, friction=0.8, transition_speed=0.02, limits=None, rate_hz=None, keep=None))]
    fn new(
        py: Python<'_>,
        model: &Model,
        friction: f64,
        transition_speed: f64,
        limits: Option<&Bound<'_, PyAny>>,
        rate_hz: Option<f64>,
        keep: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let stream = stream_options(rate_hz, "feed_forward", keep)?;
        let limits = list("limits", limits)?;
        let options = core::CompensationOptions::default()
            .with_friction(friction)
            .with_transition_speed(transition_speed)
            .with_limits(limits)
            .with_stream(stream);
        let inner = detached(py, || core::Compensation::new(&*model.inner, &options));
        let inner = inner.map_err(IntoPyErr::into_py_err)?;
        Ok(Self { inner: Mutex::new(inner), dof: model.inner.robot().dof() })
    }

    /// Torque of the next sample, (n,), N·m (N).
    ///
    /// Parameters
    /// ----------
    /// q : array of shape (n,)
    ///     Measured positions, rad (m).
    /// wanted_dq : array of shape (n,)
    ///     Wanted velocities, rad/s (m/s).
    fn torque<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        wanted_dq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (at, speed) = (one("q", q)?, one("wanted_dq", wanted_dq)?);
        let mut compensation = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let tau =
            compensation.torque(at.values(), speed.values()).map_err(IntoPyErr::into_py_err)?;
        Ok(PyArray1::from_slice(q.py(), tau))
    }
}
