//! Models that learn while the arm runs.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use sgpr_core::online as core;
use sgpr_core::online::{Budget, OnlineOptions, PayloadOptions};

use crate::convert::{Numbers, array, per_joint, positive, whole};
use crate::errors::{IntoPyErr, invalid};
use crate::gp::Kernel;
use crate::model::Model;
use crate::robot::Robot;
use crate::simulation::models;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// An identified model that follows what changes while the arm runs: a payload picked up, and a
/// rest.
///
/// tau = model + payload + process. The ten inertial parameters of what a link holds are estimated
/// recursively, with a memory that fades towards "none"; a Gaussian process with a budget of points
/// learns what is left over. Call `update` once per control period, then `torque` for the
/// feed-forward.
///
/// Parameters
/// ----------
/// robot : Robot
/// model : Robot, Model, SemiParametricModel or list of them, optional
///     What is known of the arm without a payload; the rigid body of `robot` by default.
/// payload, process : bool
///     What is followed.
/// link : str, optional
///     Joint whose link holds the payload; the last one by default.
/// mass, radius : float
///     How heavy payloads are, kg, and how far from the link frame, m.
/// memory : float
///     Time over which old samples fade to a third, s.
/// noise : array of shape (n,), optional
///     Standard deviation of what the model leaves over without a payload, N·m; that of the
///     identification by default.
/// points : int
///     Budget of the process.
/// novelty : float
///     A sample of which the points leave less than this share of the variance unexplained is at a
///     known place: it takes the place of the point most like it once that is 0.1 s old. Any other
///     takes a new place, or that of the oldest.
/// process_memory : float
///     Time after which a point is forgotten, s.
/// period : float
///     Time between updates, s.
/// cutoff_hz : float
///     Of the filters.
/// standstill_speed : float
///     rad/s; the residual of a joint that stands says nothing.
///
/// Examples
/// --------
/// >>> robot = sgpr.robots.two_link()
/// >>> online = sgpr.OnlineModel(robot, noise=[1.0, 0.5], process=False)
/// >>> online.update([0.1, 0.2], [0.0, 0.0])
/// >>> online.payload.shape, online.torque([0.1, 0.2], [0.0, 0.0], [0.0, 0.0]).shape
/// ((10,), (2,))
#[pyclass(module = "sgpr", frozen)]
pub struct OnlineModel {
    inner: Mutex<core::OnlineModel>,
    dof: usize,
}

impl OnlineModel {
    fn lock(&self) -> MutexGuard<'_, core::OnlineModel> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl OnlineModel {
    #[new]
    #[pyo3(signature = (robot, model=None, *, payload=true, process=true, link=None, mass=5.0, radius=0.2, memory=0.3,
        noise=None, points=None, novelty=0.03, process_memory=2.0, period=1e-3, cutoff_hz=10.0, standstill_speed=0.02),
        text_signature = "(robot, model=None, *, payload=True, process=True, link=None, mass=5.0, \
             radius=0.2, memory=0.3, noise=None, points=100, novelty=0.03, process_memory=2.0, \
             period=0.001, cutoff_hz=10.0, standstill_speed=0.02)")]
    #[expect(clippy::too_many_arguments, reason = "one for each Python keyword")]
    fn new(
        robot: &Bound<'_, Robot>,
        model: Option<&Bound<'_, PyAny>>,
        payload: bool,
        process: bool,
        link: Option<&str>,
        mass: f64,
        radius: f64,
        memory: f64,
        noise: Option<&Bound<'_, PyAny>>,
        points: Option<&Bound<'_, PyAny>>,
        novelty: f64,
        process_memory: f64,
        period: f64,
        cutoff_hz: f64,
        standstill_speed: f64,
    ) -> PyResult<Self> {
        let arm = &robot.get().inner;
        let link = match link {
            None => None,
            Some(name) => Some(arm.joint_index(name).ok_or_else(|| {
                let known = arm.joint_names().collect::<Vec<_>>().join(", ");
                invalid(format!("link: the robot has no joint `{name}`; it has {known}"))
            })?),
        };
        let payload = match payload {
            false => None,
            true => Some(
                PayloadOptions::new(self::noise(noise, model, arm)?)
                    .with_link(link)
                    .with_mass(mass)
                    .with_radius(radius)
                    .with_memory(memory),
            ),
        };
        let points =
            points.map_or(Ok(Budget::default().points), |value| whole("points", value, 1..2001))?;
        let period = positive("period", period)?;
        let samples = |seconds: f64| (seconds / period).round() as u64;
        let budget = Budget::default()
            .with_points(points)
            .with_novelty(novelty)
            .with_refresh(samples(0.1))
            .with_memory(samples(positive("process_memory", process_memory)?));
        let options = OnlineOptions::default()
            .with_period(period)
            .with_cutoff_hz(cutoff_hz)
            .with_standstill_speed(standstill_speed)
            .with_payload(payload)
            .with_process(process.then_some(budget));
        let known = Box::new(models(model, arm, period)?);
        let inner = core::OnlineModel::new(arm, known, &options).map_err(IntoPyErr::into_py_err)?;
        // What remembers the measured motion is not to see the wanted one.
        let inner = inner.with_measured(Box::new(models(model, arm, period)?));
        Ok(Self { inner: Mutex::new(inner), dof: arm.dof() })
    }

    /// Takes one sample, a period after the one before.
    ///
    /// Parameters
    /// ----------
    /// q : array of shape (n,)
    ///     Measured positions, rad (m).
    /// tau : array of shape (n,)
    ///     Torque of the drives since the sample before, N·m (N).
    fn update(&self, q: &Bound<'_, PyAny>, tau: &Bound<'_, PyAny>) -> PyResult<()> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (q, tau) = (one("q", q)?, one("tau", tau)?);
        self.lock().update(q.values(), tau.values()).map_err(IntoPyErr::into_py_err)
    }

    /// Torque that the motion needs as far as is known now, (n,), N·m (N).
    fn torque<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (q, dq, ddq) = (one("q", q)?, one("dq", dq)?, one("ddq", ddq)?);
        let mut inner = self.lock();
        let tau = inner
            .torque(q.values(), dq.values(), ddq.values())
            .map_err(IntoPyErr::into_py_err)?
            .to_vec();
        array(py, &[self.dof], tau)
    }

    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz of what the link holds, (10,); None if it is not
    /// followed.
    #[getter]
    fn payload<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        self.lock()
            .payload()
            .map(|payload| array(py, &[10], payload.parameters().to_vec()))
            .transpose()
    }

    /// Standard deviations of the payload's parameters, (10,); None if it is not followed.
    #[getter]
    fn payload_std<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        self.lock()
            .payload()
            .map(|payload| array(py, &[10], payload.standard_deviations().to_vec()))
            .transpose()
    }

    /// Points of the process at the moment.
    #[getter]
    fn points(&self) -> usize {
        self.lock().process().map_or(0, core::OnlineGaussianProcess::len)
    }

    fn __repr__(&self) -> String {
        format!("OnlineModel of {} joints, {} points", self.dof, self.points())
    }
}

/// As given, else as the model was identified.
fn noise(
    given: Option<&Bound<'_, PyAny>>,
    model: Option<&Bound<'_, PyAny>>,
    arm: &sgpr_core::robot::Robot,
) -> PyResult<Vec<f64>> {
    if let Some(value) = given {
        return per_joint("noise", value, arm);
    }
    let identified = model.and_then(|model| model.cast::<Model>().ok());
    let fitted = identified.and_then(|model| model.get().inner.fit().map(|fit| fit.noise.clone()));
    fitted.ok_or_else(|| {
        invalid(
            "noise: the model was not identified here; give what it leaves over without a payload, \
             one N·m per joint",
        )
    })
}

/// A Gaussian process whose points come and go: the Cholesky factor is updated, not computed again.
///
/// Hyperparameters stay as they are given. A measurement replaces the point most like it, or the
/// oldest one once the budget is used up, so that what changes is followed.
///
/// Parameters
/// ----------
/// kernel : Kernel
///     With its hyperparameters.
/// inputs, outputs : int
/// noise_variance : float
/// points : int
///     Budget.
/// novelty : float
///     As in `OnlineModel`.
/// refresh, memory : int
///     Measurements after which a point at a known place is replaced, and after which any point is
///     forgotten.
///
/// Examples
/// --------
/// >>> kernel = sgpr.Kernel("squared_exponential", [0], 0.5)
/// >>> gp = sgpr.OnlineGaussianProcess(kernel, 1, noise_variance=1e-4, points=20, novelty=1e-3)
/// >>> for x in np.linspace(0.0, 3.0, 50):
/// ...     gp.add([x], [np.sin(x)])
/// >>> bool(abs(gp.predict([1.0])[0] - np.sin(1.0)) < 0.1), len(gp) <= 20
/// (True, True)
#[pyclass(module = "sgpr", frozen)]
pub struct OnlineGaussianProcess {
    inner: Mutex<core::OnlineGaussianProcess>,
    inputs: usize,
    outputs: usize,
}

impl OnlineGaussianProcess {
    fn lock(&self) -> MutexGuard<'_, core::OnlineGaussianProcess> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl OnlineGaussianProcess {
    #[new]
    #[pyo3(signature = (kernel, inputs, outputs=1, *, noise_variance=0.01, points=100, novelty=0.03, refresh=100, memory=2000))]
    #[expect(clippy::too_many_arguments, reason = "one for each Python keyword")]
    fn new(
        kernel: &Bound<'_, Kernel>,
        inputs: usize,
        outputs: usize,
        noise_variance: f64,
        points: usize,
        novelty: f64,
        refresh: u64,
        memory: u64,
    ) -> PyResult<Self> {
        if inputs == 0 || outputs == 0 {
            return Err(invalid("inputs, outputs: at least one of each"));
        }
        let kernel = kernel.get().inner.clone();
        let budget = Budget::default()
            .with_points(points)
            .with_novelty(novelty)
            .with_refresh(refresh)
            .with_memory(memory);
        let inner =
            core::OnlineGaussianProcess::new(kernel, inputs, outputs, noise_variance, budget);
        Ok(Self { inner: Mutex::new(inner.map_err(IntoPyErr::into_py_err)?), inputs, outputs })
    }

    /// Takes a measurement.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (inputs,)
    /// y : array of shape (outputs,)
    fn add(&self, x: &Bound<'_, PyAny>, y: &Bound<'_, PyAny>) -> PyResult<()> {
        let x = Numbers::new("x", x)?.shaped(&[self.inputs])?.finite()?;
        let y = Numbers::new("y", y)?.shaped(&[self.outputs])?.finite()?;
        self.lock().add(x.values(), y.values()).map_err(IntoPyErr::into_py_err)
    }

    /// Mean at a point.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (inputs,)
    /// return_std : bool
    ///     Whether the standard deviation of what is learned there is returned, too.
    ///
    /// Returns
    /// -------
    /// mean : array of shape (outputs,)
    /// std : float
    ///     If asked for; the same for all outputs.
    #[pyo3(signature = (x, return_std=false))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        return_std: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let x = Numbers::new("x", x)?.shaped(&[self.inputs])?.finite()?;
        let mut inner = self.lock();
        let (mean, variance) = inner.mean_and_variance(x.values());
        let mean = array(py, &[self.outputs], mean.to_vec())?;
        match return_std {
            true => Ok((mean, variance.sqrt()).into_pyobject(py)?.into_any()),
            false => Ok(mean.into_any()),
        }
    }

    fn __len__(&self) -> usize {
        self.lock().len()
    }

    fn __repr__(&self) -> String {
        format!("OnlineGaussianProcess of {} inputs, {} points", self.inputs, self.lock().len())
    }
}
