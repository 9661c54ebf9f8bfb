//! What a controller makes of a model.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::PyArray1;
use pyo3::prelude::*;
use sgpr_core::control as core;

use crate::convert::Numbers;
use crate::detached::detached;
use crate::errors::IntoPyErr;
use crate::model::{Model, stream_options};

type Array<'py> = Bound<'py, PyArray1<f64>>;

fn list(name: &'static str, values: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<f64>> {
    values.map_or(Ok(Vec::new()), |values| Ok(Numbers::new(name, values)?.finite()?.values().to_vec()))
}

/// Torque from outside, from positions, velocities and the torque of the drives, without accelerations: the momentum
/// observer of De Luca and Mattone (ICRA 2003). One per thread.
///
/// It follows torque from outside with a first-order lag of its bandwidth. An alarm is a torque that the model's errors
/// do not explain: beyond as many standard deviations as normal errors cross by `false_alarms_per_hour`. Errors of real
/// models have longer tails, at reversals above all: measure the false alarms on a log without contact
/// (docs/controllers.md).
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
    #[pyo3(signature = (model, *, rate_hz, bandwidth_hz=2.0, false_alarms_per_hour=1.0, deviation=None))]
    fn new(
        py: Python<'_>,
        model: &Model,
        rate_hz: f64,
        bandwidth_hz: f64,
        false_alarms_per_hour: f64,
        deviation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let deviation = list("deviation", deviation)?;
        let options = core::ObserverOptions { rate_hz, bandwidth_hz, false_alarms_per_hour, deviation };
        let inner = detached(py, || core::MomentumObserver::new(&*model.inner, &options));
        let inner = inner.map_err(IntoPyErr::into_py_err)?;
        Ok(Self { inner: Mutex::new(inner), dof: model.inner.robot().dof() })
    }

    /// Torque beyond which there is an alarm, (n,), N·m (N).
    #[getter]
    fn thresholds<'py>(&self, py: Python<'py>) -> Array<'py> {
        PyArray1::from_slice(py, self.lock().thresholds())
    }

    /// Torque from outside at the last sample, (n,), N·m (N).
    #[getter]
    fn external_torque<'py>(&self, py: Python<'py>) -> Array<'py> {
        PyArray1::from_slice(py, self.lock().external_torque())
    }

    /// Index of the joint that is farthest beyond its threshold, its torque and its threshold; None if none is.
    #[getter]
    fn alarm(&self) -> Option<(usize, f64, f64)> {
        self.lock().alarm().map(|core::Alarm { joint, torque, threshold }| (joint, torque, threshold))
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

/// The torque that holds an arm where it is and overcomes its friction in the direction of the wanted velocity: gravity of
/// the measured position, friction of the wanted velocity, so that nothing chatters at rest. One per thread.
///
/// Parameters
/// ----------
/// model : Model
/// friction : float
///     Share of the friction that is compensated, 0 to 1.
/// transition_speed : float
///     Speed at which friction is compensated in full, rad/s (m/s); below it the share falls in a line.
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
        let options = core::CompensationOptions { friction, transition_speed, limits, stream };
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
    fn torque<'py>(&self, q: &Bound<'py, PyAny>, wanted_dq: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (at, speed) = (one("q", q)?, one("wanted_dq", wanted_dq)?);
        let mut compensation = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let tau = compensation.torque(at.values(), speed.values()).map_err(IntoPyErr::into_py_err)?;
        Ok(PyArray1::from_slice(q.py(), tau))
    }
}
