//! Physics and what it leaves over. The estimator with scikit-learn's interface is written in
//! Python.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use sgpr_core::model::{
    self as core, Inputs, Mean, Predictor, SemiParametricError, SemiParametricOptions,
};
use sgpr_core::recording::LogSet;

use crate::compare::{Compared, Comparison};
use crate::convert::{Numbers, Samples, array, choice, whole};
use crate::detached::detached;
use crate::dynamics::motion;
use crate::errors::{IntoPyErr, invalid};
use crate::gp::{predictor_options, shape, status_name};
use crate::identification::Arguments;
use crate::log_set::{log_set, recordings};
use crate::model::{Model, start_of_stream, stream_options, temperatures};
use crate::progress::listen_and_keep;
use crate::robot::Robot;
use crate::user_effect::known_effects;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// A fitted semi-parametric model; `sgpr.SemiParametricModel` makes and holds it.
#[pyclass(module = "sgpr._sgpr", frozen)]
pub struct FittedSemiParametric {
    pub(crate) inner: Arc<core::SemiParametricModel>,
}

impl FittedSemiParametric {
    fn compared(&self, logs: LogSet) -> Compared {
        Compared { model: Arc::new(self.inner.physics().clone()), logs }
    }
}

/// Fits a model, on top of physics if it is given; returns it and what stopped the work, if
/// anything did.
#[pyfunction]
#[pyo3(signature = (robot, recordings, *, physics, mean, kernel, ard, inputs, shared, points, sparse, starts, max_evaluations, n_jobs, options))]
#[expect(clippy::too_many_arguments, reason = "one for each Python keyword")]
pub fn fit_semi_parametric(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recordings: &Bound<'_, PyAny>,
    physics: Option<&Bound<'_, Model>>,
    mean: &str,
    kernel: &str,
    ard: bool,
    inputs: Option<&str>,
    shared: bool,
    points: &Bound<'_, PyAny>,
    sparse: Option<bool>,
    starts: &Bound<'_, PyAny>,
    max_evaluations: &Bound<'_, PyAny>,
    n_jobs: &Bound<'_, PyAny>,
    options: &Bound<'_, PyDict>,
) -> PyResult<(FittedSemiParametric, Option<PyErr>)> {
    let Arguments { options: identify, progress } = Arguments::new(robot.get(), Some(options))?;
    let known = Inputs::NAMED.map(|inputs| (inputs.name(), inputs));
    let mut options = SemiParametricOptions::default()
        .with_identify(identify)
        .with_mean(choice(
            "mean",
            mean,
            &[("physics", Mean::Physics), ("joint", Mean::Joint), ("zero", Mean::Zero)],
        )?)
        .with_shape(shape(kernel)?)
        .with_ard(ard)
        .with_inputs(inputs.map(|name| choice("inputs", name, &known)).transpose()?)
        .with_shared(shared)
        .with_points(whole("points", points, 2..20_001)?)
        .with_sparse(sparse)
        .with_starts(whole("starts", starts, 1..1001)?)
        .with_evaluations(whole("max_evaluations", max_evaluations, 1..usize::MAX)?);
    options.compute.threads = whole("n_jobs", n_jobs, 1..1025)?;
    let recordings = self::recordings(recordings)?;
    let robot = &robot.get().inner;
    let physics = physics.map(|model| &model.get().inner);
    if let Some(physics) =
        physics.filter(|physics| !physics.robot().joint_names().eq(robot.joint_names()))
    {
        let names = physics.robot().joint_names().collect::<Vec<_>>().join(", ");
        return Err(invalid(format!(
            "physics: it is of a robot with the joints {names}: give the robot of the model"
        )));
    }
    let work = |progress: &dyn sgpr_core::progress::Progress| match physics {
        Some(physics) => core::fit_rest(physics, &recordings, &options, progress),
        None => core::fit_semi_parametric(robot, &recordings, &options, progress),
    };
    let (model, stopped) = listen_and_keep::<_, SemiParametricError>(py, progress, work)?;
    Ok((FittedSemiParametric { inner: Arc::new(model) }, stopped))
}

#[pymethods]
impl FittedSemiParametric {
    /// Reads a file that `save` wrote.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = detached(py, || core::SemiParametricModel::load_with(path, &known_effects()))
            .map_err(IntoPyErr::into_py_err)?;
        Ok(Self { inner: Arc::new(model) })
    }

    /// Writes the model to a file; the file is complete or not there.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        detached(py, || self.inner.save(path)).map_err(IntoPyErr::into_py_err)
    }

    /// The physics, with the report of its identification if that went before.
    #[getter]
    fn physics(&self, py: Python<'_>) -> PyResult<Model> {
        let physics = self.inner.physics().clone();
        match self.inner.report() {
            Some(report) => Model::with_report(py, physics, report.clone()),
            None => Ok(Model::from(physics)),
        }
    }

    /// The physics whose residual the processes learn.
    #[getter]
    fn mean(&self) -> &'static str {
        match self.inner.mean() {
            Mean::Physics => "physics",
            Mean::Joint => "joint",
            Mean::Zero => "zero",
        }
    }

    /// Whether the search for the processes was stopped before its end.
    #[getter]
    fn stopped(&self) -> bool {
        self.inner.stopped()
    }

    /// Torque, and if asked for its standard deviation, half its interval of 95 % and the novelty
    /// of the samples.
    #[pyo3(signature = (q, dq, ddq, with_std))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        with_std: bool,
    ) -> PyResult<(Array<'py>, Option<[Array<'py>; 3]>)> {
        let n = self.inner.physics().robot().dof();
        let samples = Samples::together([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
        let motion = motion(&samples);
        let prediction = detached(py, || self.inner.predict(motion, with_std))
            .map_err(IntoPyErr::into_py_err)?;
        let result = |values| samples[0].result(py, &[n], values);
        let tau = result(prediction.tau)?;
        if !with_std {
            return Ok((tau, None));
        }
        let spread = [prediction.standard_deviation, prediction.interval_95, prediction.novelty];
        let [deviation, interval, novelty] = spread.map(result);
        Ok((tau, Some([deviation?, interval?, novelty?])))
    }

    /// Compares with recordings, as `sgpr.compare` does.
    fn compare(&self, py: Python<'_>, recordings: &Bound<'_, PyAny>) -> PyResult<Comparison> {
        let logs = log_set(py, recordings)?;
        let comparison =
            detached(py, || self.inner.compare(&logs)).map_err(IntoPyErr::into_py_err)?;
        Comparison::new(py, comparison, self.compared(logs))
    }

    /// The same, and for each of the comparison's logs the standard deviation, half the interval of
    /// 95 % and the novelty of the predictions.
    fn compare_with_spread<'py>(
        &self,
        py: Python<'py>,
        recordings: &Bound<'py, PyAny>,
    ) -> PyResult<(Comparison, Vec<[Array<'py>; 3]>)> {
        let logs = log_set(py, recordings)?;
        let found = detached(py, || self.inner.compare_with_spread(&logs));
        let (comparison, predictions) = found.map_err(IntoPyErr::into_py_err)?;
        let n = self.inner.physics().robot().dof();
        let spread = |prediction: core::TorquePrediction| -> PyResult<[Array<'py>; 3]> {
            let result = |values: Vec<f64>| array(py, &[values.len() / n, n], values);
            let core::TorquePrediction { standard_deviation, interval_95, novelty, .. } =
                prediction;
            Ok([result(standard_deviation)?, result(interval_95)?, result(novelty)?])
        };
        let spreads = predictions.into_iter().map(spread).collect::<PyResult<_>>()?;
        Ok((Comparison::new(py, comparison, self.compared(logs))?, spreads))
    }

    /// Mean over joints of the share of the variance that is explained.
    fn score(&self, py: Python<'_>, recordings: &Bound<'_, PyAny>) -> PyResult<f64> {
        let logs = log_set(py, recordings)?;
        detached(py, || self.inner.score(&logs)).map_err(IntoPyErr::into_py_err)
    }

    /// One dict per joint: how many measurements fall within their predicted intervals.
    fn coverage<'py>(
        &self,
        py: Python<'py>,
        recordings: &Bound<'py, PyAny>,
        following: bool,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let logs = log_set(py, recordings)?;
        let rows = detached(py, || self.inner.coverage(&logs, following))
            .map_err(IntoPyErr::into_py_err)?;
        let describe = |row: core::Coverage| {
            let dict = PyDict::new(py);
            dict.set_item("joint", row.joint)?;
            dict.set_item("samples", row.samples)?;
            dict.set_item("percent_68", row.percent_68)?;
            dict.set_item("percent_95", row.percent_95)?;
            dict.set_item("half_width_68", row.half_width_68)?;
            dict.set_item("half_width_95", row.half_width_95)?;
            Ok(dict)
        };
        rows.into_iter().map(describe).collect()
    }

    /// One dict per joint: what was tried, chosen and learned.
    #[getter]
    fn reports<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let names: Vec<String> =
            self.inner.physics().robot().joint_names().map(String::from).collect();
        let describe = |(joint, (name, report)): (usize, (String, &core::JointReport))| {
            let candidates = report.candidates.iter().map(|candidate| {
                let dict = PyDict::new(py);
                dict.set_item("inputs", candidate.inputs.name())?;
                dict.set_item("inference", candidate.inference.name())?;
                dict.set_item("rmse", candidate.rmse)?;
                dict.set_item("log_marginal_likelihood", candidate.log_marginal_likelihood)?;
                dict.set_item("status", status_name(candidate.status))?;
                Ok(dict)
            });
            let dict = PyDict::new(py);
            dict.set_item("joint", name)?;
            dict.set_item("rows", report.rows)?;
            dict.set_item("points", report.points)?;
            dict.set_item("inference", report.inference.name())?;
            dict.set_item("physics_rmse", report.physics_rmse)?;
            dict.set_item("inputs", report.chosen.map(Inputs::name))?;
            dict.set_item("calibration", report.calibration)?;
            dict.set_item("calibration_95", report.calibration_95)?;
            dict.set_item("physics_rmse_left_out", report.physics_rmse_left_out)?;
            dict.set_item("candidates", candidates.collect::<PyResult<Vec<_>>>()?)?;
            let hyperparameters = PyDict::new(py);
            for (name, value) in self.inner.hyperparameters(joint).unwrap_or_default() {
                hyperparameters.set_item(name, value)?;
            }
            dict.set_item("hyperparameters", hyperparameters)?;
            Ok(dict)
        };
        names.into_iter().zip(self.inner.reports()).enumerate().map(describe).collect()
    }

    /// One sample after the other.
    ///
    /// - `numbers`: single precision, rank of the variance, whether compact
    /// - `stream`: rate, purpose, what to keep
    fn predictor(
        &self,
        py: Python<'_>,
        numbers: (bool, Option<usize>, bool),
        stream: (Option<f64>, String, Vec<String>),
    ) -> PyResult<SemiParametricPredictor> {
        let (single, variance_rank, compact) = numbers;
        let options = predictor_options(single, variance_rank, compact);
        let (rate_hz, purpose, keep) = stream;
        let stream = stream_options(rate_hz, &purpose, None)?.with_keep(keep);
        let inner = detached(py, || self.inner.predictor(options, &stream));
        Ok(SemiParametricPredictor {
            inner: Mutex::new(inner.map_err(IntoPyErr::into_py_err)?),
            dof: self.inner.physics().robot().dof(),
            with_variance: variance_rank != Some(0),
            purpose: stream.purpose.name(),
        })
    }

    /// The content of the file that `save` writes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.inner.to_bytes())
    }

    /// The model of which `data` is the file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        let model = detached(py, || {
            core::SemiParametricModel::from_bytes_with(data, "bytes", &known_effects())
        });
        Ok(Self { inner: Arc::new(model.map_err(IntoPyErr::into_py_err)?) })
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((slf.get_type().getattr("from_bytes")?, (slf.get().to_bytes(slf.py()),)))
    }
}

/// Torque of one sample after the other, for a control loop: physics and processes. One per thread.
#[pyclass(module = "sgpr", frozen)]
pub struct SemiParametricPredictor {
    inner: Mutex<Predictor>,
    dof: usize,
    with_variance: bool,
    purpose: &'static str,
}

#[pymethods]
impl SemiParametricPredictor {
    /// What the torque is for: "expected_measurement" or "feed_forward".
    #[getter]
    fn purpose(&self) -> &'static str {
        self.purpose
    }

    /// Share of the variance of each joint's process that the logs have not explained, (n,), at the
    /// last call of `torque_and_std`: from 0 at a point of the logs to 1 far from all, 0 for a
    /// joint without a process. Above 0.95 the torque is that of the physics.
    #[getter]
    fn novelty<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        array(py, &[self.dof], predictor.novelty().to_vec())
    }

    /// Forgets all samples, as `Predictor.reset`.
    #[pyo3(signature = (q=None, dq=None, *, time=0.0))]
    fn reset(
        &self,
        q: Option<&Bound<'_, PyAny>>,
        dq: Option<&Bound<'_, PyAny>>,
        time: f64,
    ) -> PyResult<()> {
        let start = start_of_stream(self.dof, q, dq, time)?;
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        match start {
            None => predictor.reset(),
            Some((q, dq)) => predictor.reset_at(&q, &dq).map_err(IntoPyErr::into_py_err)?,
        }
        predictor.set_time(time).map_err(IntoPyErr::into_py_err)
    }

    /// Sets the temperature of the joints, as `Predictor.set_temperature`.
    fn set_temperature(&self, celsius: &Bound<'_, PyAny>) -> PyResult<()> {
        let all = temperatures(self.dof, celsius)?;
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        predictor.set_temperature(&all).map_err(IntoPyErr::into_py_err)
    }

    /// Torque that the motion needs, (n,), N·m (N).
    fn torque<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (q, dq, ddq) = (one("q", q)?, one("dq", dq)?, one("ddq", ddq)?);
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let tau = predictor
            .try_torque(q.values(), dq.values(), ddq.values())
            .map_err(IntoPyErr::into_py_err)?
            .to_vec();
        array(py, &[self.dof], tau)
    }

    /// Torque and the standard deviation of its measurement, (n,) each, N·m (N).
    fn torque_and_std<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        if !self.with_variance {
            return Err(invalid("the predictor was made without variance: give variance_rank"));
        }
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (q, dq, ddq) = (one("q", q)?, one("dq", dq)?, one("ddq", ddq)?);
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let both = predictor.torque_and_deviation(q.values(), dq.values(), ddq.values());
        let (tau, deviation) = both.map_err(IntoPyErr::into_py_err)?;
        let (tau, deviation) = (tau.to_vec(), deviation.to_vec());
        Ok((array(py, &[self.dof], tau)?, array(py, &[self.dof], deviation)?))
    }

    fn __repr__(&self) -> String {
        format!("SemiParametricPredictor for {} joints", self.dof)
    }
}

/// What an `sgpr.SemiParametricModel` holds, if it is one.
pub fn semi_parametric<'py>(
    item: &Bound<'py, PyAny>,
) -> PyResult<Option<Bound<'py, FittedSemiParametric>>> {
    if item.get_type().name()? != "SemiParametricModel" {
        return Ok(None);
    }
    match item.getattr_opt("_fitted")? {
        Some(fitted) => Ok(Some(fitted.cast_into::<FittedSemiParametric>()?)),
        None => Err(invalid("model: this SemiParametricModel is not fitted yet; call `fit` first")),
    }
}
