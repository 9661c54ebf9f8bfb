//! Model against measurement.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArrayDyn;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pythonize::{depythonize, pythonize};
use sgpr_core::identification::Row;
use sgpr_core::model::{self as core, TorqueModel};
use sgpr_core::motion::{self, Motion};
use sgpr_core::recording::{self as logs, Channel};

use crate::convert::{Numbers, array};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid, warn};
use crate::log_residual::LogResidual;
use crate::log_set::{LogSet, as_python, log_set, recordings};
use crate::model::{Model, Processing};
use crate::recording::Recording;
use crate::robot::Robot;
use crate::tables::{figure, html_table};

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Compares a model with recordings, best with logs that no fit has seen.
///
/// Parameters
/// ----------
/// model : Model or Robot
///     A robot stands for the model that its file describes.
/// recordings : list of Recording or LogSet
///     Samples that two of them share count once. A set keeps its filtered motion for whatever
///     looks at it next.
/// processing : Model or Processing, optional
///     How the logs are processed: by default as the model was identified, else as is chosen from
///     the logs. Give the same to compare two models in the same band.
///
/// Returns
/// -------
/// Comparison
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify(robot, [log])
/// >>> before = sgpr.compare(robot, [log], processing=model)
/// >>> after = sgpr.compare(model, [log])
/// >>> bool(np.all(after.rmse < before.rmse))
/// True
#[pyfunction]
#[pyo3(signature = (model, recordings, *, processing=None))]
pub fn compare(
    py: Python<'_>,
    model: &Bound<'_, PyAny>,
    recordings: &Bound<'_, PyAny>,
    processing: Option<&Bound<'_, PyAny>>,
) -> PyResult<Comparison> {
    let model = match (model.cast::<Model>(), model.cast::<Robot>()) {
        (Ok(model), _) => model.get().inner.clone(),
        (_, Ok(robot)) => Arc::new(TorqueModel::nominal(&robot.get().inner)),
        _ => return Err(wrong_type("model", model, "Model or Robot")),
    };
    let processing = processing.map(processing_of).transpose()?.flatten();
    let dof = model.robot().dof();
    if let Some(other) =
        processing.as_ref().map(|one| one.standstill_speed.len()).filter(|other| *other != dof)
    {
        return Err(invalid(format!("processing: it is for {other} joints, the model has {dof}")));
    }
    let logs = log_set(py, recordings)?;
    let comparison = detached(py, || core::compare(&model, &logs, processing.as_ref()))
        .map_err(IntoPyErr::into_py_err)?;
    let of = Compared { model, logs };
    // A set told what it left out when it was made.
    let told = if recordings.is_instance_of::<LogSet>() {
        of.model.clock_notes(&of.logs)
    } else {
        of.notes()
    };
    warn(py, &told)?;
    Comparison::new(py, comparison, of)
}

pub fn processing_of(given: &Bound<'_, PyAny>) -> PyResult<Option<sgpr_core::motion::Processing>> {
    match (given.cast::<Model>(), given.cast::<Processing>()) {
        (Ok(model), _) => Ok(model.get().inner.processing().cloned()),
        (_, Ok(processing)) => Ok(Some(processing.get().inner.clone())),
        _ => Err(wrong_type("processing", given, "Model or Processing")),
    }
}

pub fn wrong_type(name: &str, given: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let found = given.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: got {found}, expected {expected}"))
}

/// How well a model predicts the torque of some logs.
///
/// Figures are in the band of the model, over the samples at which a joint moves; while a joint
/// stands, dry friction holds it with any torque, and no model can say which: the `with_rests`
/// figures count those samples too.
#[pyclass(module = "sgpr", frozen)]
pub struct Comparison {
    joints: Vec<core::JointComparison>,
    relative_error_percent: f64,
    relative_error_with_rests_percent: f64,
    logs: Vec<Py<LogResidual>>,
    of: Compared,
}

/// What was compared: the model, of one with processes its physics, and the logs.
#[derive(Clone)]
pub struct Compared {
    pub model: Arc<TorqueModel>,
    pub logs: logs::LogSet,
}

impl Compared {
    fn notes(&self) -> Vec<String> {
        [self.logs.notes(), &self.model.clock_notes(&self.logs)].concat()
    }
}

impl Comparison {
    /// As the core made it.
    pub fn new(py: Python<'_>, comparison: core::Comparison, of: Compared) -> PyResult<Self> {
        let core::Comparison {
            joints,
            relative_error_percent,
            relative_error_with_rests_percent,
            logs,
            ..
        } = comparison;
        let dof = joints.len();
        let logs = logs
            .into_iter()
            .map(|inner| Py::new(py, LogResidual { inner, dof }))
            .collect::<PyResult<_>>()?;
        Ok(Self { joints, relative_error_percent, relative_error_with_rests_percent, logs, of })
    }

    /// The stretches of every log.
    pub fn parts(&self, py: Python<'_>) -> Vec<Py<LogResidual>> {
        self.logs.iter().map(|log| log.clone_ref(py)).collect()
    }

    fn column<'py>(
        &self,
        py: Python<'py>,
        select: fn(&core::JointComparison) -> f64,
    ) -> PyResult<Array<'py>> {
        array(py, &[self.joints.len()], self.joints.iter().map(select).collect())
    }

    fn rows(&self) -> impl Iterator<Item = Vec<String>> {
        self.joints.iter().map(|joint| {
            let percent = |value: f64| format!("{value:.2}");
            vec![
                joint.joint.clone(),
                figure(joint.rmse),
                percent(joint.fit_percent),
                format!("{:.4}", joint.r2),
                percent(joint.relative_error_percent),
                joint.unit.to_string(),
            ]
        })
    }
}

const HEAD: [&str; 6] = ["joint", "rmse", "fit %", "R²", "relative error %", "unit"];

#[pymethods]
impl Comparison {
    /// Joint by joint.
    #[getter]
    fn joints(&self) -> Vec<JointComparison> {
        self.joints.iter().cloned().map(JointComparison::from).collect()
    }

    /// |residual| / |torque| over all joints while they move, percent.
    #[getter]
    fn relative_error_percent(&self) -> f64 {
        self.relative_error_percent
    }

    /// The same with the samples at which they stand, percent.
    #[getter]
    fn relative_error_with_rests_percent(&self) -> f64 {
        self.relative_error_with_rests_percent
    }

    /// What the reader should know: samples that logs share, which count once; logs that effects of
    /// time take as ones after the session of the model.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.of.notes()
    }

    /// Measured and predicted torque of every stretch of every log.
    #[getter]
    fn logs(&self, py: Python<'_>) -> Vec<Py<LogResidual>> {
        self.parts(py)
    }

    /// Root mean square of measured minus predicted, (n,), N·m (N).
    #[getter]
    fn rmse<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |joint| joint.rmse)
    }

    /// 100 (1 - |residual| / |measured - its mean|), (n,), percent.
    #[getter]
    fn fit_percent<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |joint| joint.fit_percent)
    }

    /// Share of the variance that is explained, (n,).
    #[getter]
    fn r2<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |joint| joint.r2)
    }

    /// The figures, ready for JSON; None where there is no number (a joint that never moves).
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let finite = |value: f64| value.is_finite().then_some(value);
        let mut joints = Vec::new();
        for joint in self.joints.iter().cloned() {
            let dict = PyDict::new(py);
            dict.set_item("joint", joint.joint)?;
            dict.set_item("unit", joint.unit)?;
            dict.set_item("samples", joint.samples)?;
            dict.set_item("rmse", finite(joint.rmse))?;
            dict.set_item("fit_percent", finite(joint.fit_percent))?;
            dict.set_item("r2", finite(joint.r2))?;
            dict.set_item("relative_error_percent", finite(joint.relative_error_percent))?;
            dict.set_item("largest_error", finite(joint.largest_error))?;
            dict.set_item("largest_error_log", joint.largest_error_log)?;
            dict.set_item("largest_error_time", finite(joint.largest_error_time))?;
            dict.set_item("rmse_zero", finite(joint.rmse_zero))?;
            dict.set_item("rmse_gravity", finite(joint.rmse_gravity))?;
            dict.set_item("rmse_full_band", finite(joint.rmse_full_band))?;
            dict.set_item("rmse_with_rests", finite(joint.rmse_with_rests))?;
            dict.set_item(
                "relative_error_with_rests_percent",
                finite(joint.relative_error_with_rests_percent),
            )?;
            joints.push(dict);
        }
        let dict = PyDict::new(py);
        dict.set_item("joints", joints)?;
        dict.set_item("relative_error_percent", finite(self.relative_error_percent))?;
        dict.set_item(
            "relative_error_with_rests_percent",
            finite(self.relative_error_with_rests_percent),
        )?;
        Ok(dict)
    }

    /// A Plotly figure of measured and predicted torque, joint by joint.
    ///
    /// Examples
    /// --------
    /// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    /// >>> len(sgpr.compare(robot, [log]).plot().data)
    /// 12
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_found", (slf,))
    }

    /// Writes the page of `sgpr compare`: errors joint by joint, torques, and what is left over
    /// anything.
    ///
    /// Parameters
    /// ----------
    /// path : path
    ///     Of the HTML file, which needs no other; complete or not there.
    fn report(slf: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let Compared { model, logs } = slf.get().of.clone();
        let arguments = (slf, path, Model { inner: model, report: None }, as_python(&logs));
        slf.py().import("sgpr._pages")?.call_method1("comparison_page", arguments).map(drop)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let py = slf.py();
        let own = slf.get();
        let of = (Model { inner: own.of.model.clone(), report: None }, as_python(&own.of.logs));
        let joints = pythonize(py, &own.joints)?;
        let errors = (own.relative_error_percent, own.relative_error_with_rests_percent);
        let logs = own.logs.iter().map(|log| log_parts(log.bind(py))).collect::<PyResult<_>>()?;
        Ok((slf.get_type().getattr("_from_parts")?, (joints, errors, logs, of)))
    }

    #[staticmethod]
    fn _from_parts(
        py: Python<'_>,
        joints: &Bound<'_, PyAny>,
        errors: (f64, f64),
        logs: Vec<Bound<'_, PyDict>>,
        of: (PyRef<'_, Model>, Bound<'_, PyAny>),
    ) -> PyResult<Self> {
        let (model, recordings) = of;
        let of = Compared {
            model: model.inner.clone(),
            logs: logs::LogSet::whole(&self::recordings(&recordings)?),
        };
        let joints: Vec<core::JointComparison> = depythonize(joints)?;
        let dof = joints.len();
        let residual =
            |log: &Bound<'_, PyDict>| Py::new(py, LogResidual { inner: log_of(log, dof)?, dof });
        let logs = logs.iter().map(residual).collect::<PyResult<_>>()?;
        Ok(Self {
            joints,
            relative_error_percent: errors.0,
            relative_error_with_rests_percent: errors.1,
            logs,
            of,
        })
    }

    fn __repr__(&self) -> String {
        let width =
            self.joints.iter().map(|joint| joint.joint.chars().count()).max().unwrap_or(0).max(5);
        let line = |cells: &[String]| {
            let numbers = cells[1..5]
                .iter()
                .zip([10, 8, 7, 17])
                .map(|(cell, width)| format!(" {cell:>width$}"));
            format!("{:width$}{}  {}", cells[0], numbers.collect::<String>(), cells[5])
        };
        let mut text = line(&HEAD.map(String::from));
        for row in self.rows() {
            text += "\n";
            text += &line(&row);
        }
        text + &format!("\nrelative error of all joints {:.2} %", self.relative_error_percent)
    }

    fn _repr_html_(&self) -> String {
        html_table(&HEAD, self.rows())
    }
}

/// What builds a comparison again.
type Parts<'py> = (Bound<'py, PyAny>, (f64, f64), Vec<Bound<'py, PyDict>>, (Model, Vec<Recording>));
fn log_parts<'py>(log: &Bound<'py, LogResidual>) -> PyResult<Bound<'py, PyDict>> {
    let py = log.py();
    let inner = &log.get().inner;
    let flat = |values: &[f64]| array(py, &[values.len()], values.to_vec());
    let dict = PyDict::new(py);
    let motion = &inner.motion;
    dict.set_item("source", inner.source())?;
    dict.set_item("time", array(py, &[inner.time().len()], inner.time().to_vec())?)?;
    dict.set_item("predicted", flat(&inner.predicted)?)?;
    dict.set_item("processing", inner.processing().to_json())?;
    dict.set_item("rate_hz", motion.rate_hz)?;
    for (name, values) in [("q", &motion.q), ("dq", &motion.dq), ("ddq", &motion.ddq)] {
        dict.set_item(name, flat(values)?)?;
    }
    dict.set_item("tau", motion.tau.as_deref().map(flat).transpose()?)?;
    dict.set_item("inner", array(py, &[motion.inner.len()], motion.inner.clone())?)?;
    let use_as: Vec<u8> = motion.use_as.iter().map(|row| row_number(*row)).collect();
    dict.set_item("use_as", array(py, &[use_as.len()], use_as)?)?;
    let channels = PyDict::new(py);
    for channel in &motion.channels {
        channels.set_item(&channel.name, flat(&channel.values)?)?;
    }
    dict.set_item("channels", channels)?;
    Ok(dict)
}

/// What `log_parts` made a dict of; arrays of other lengths are refused.
fn log_of(dict: &Bound<'_, PyDict>, dof: usize) -> PyResult<core::LogResidual> {
    let item = |name: &str| {
        dict.get_item(name)?.ok_or_else(|| invalid(format!("a comparison without `{name}`")))
    };
    let time: Vec<i64> = item("time")?.extract()?;
    let samples = time.len();
    let numbers = |name: &str| -> PyResult<Vec<f64>> {
        Ok(Numbers::new(name, &item(name)?)?.shaped(&[samples * dof])?.values().to_vec())
    };
    let flags = |name: &str, length: usize| -> PyResult<Vec<bool>> {
        let values: Vec<bool> = item(name)?.extract()?;
        if values.len() == length {
            Ok(values)
        } else {
            Err(invalid(format!("a comparison with a damaged `{name}`")))
        }
    };
    let rows: Vec<u8> = item("use_as")?.extract()?;
    if rows.len() != samples * dof {
        return Err(invalid("a comparison with a damaged `use_as`"));
    }
    let mut channels = Vec::new();
    for (name, values) in item("channels")?.cast_into::<PyDict>()?.iter() {
        let values = Numbers::new("channels", &values)?.shaped(&[samples])?.values().to_vec();
        channels.push(Channel { name: name.extract()?, values });
    }
    let tau = if item("tau")?.is_none() { None } else { Some(numbers("tau")?) };
    let mut motion = Motion::default();
    motion.source = item("source")?.extract()?;
    motion.rate_hz = item("rate_hz")?.extract()?;
    motion.time = time;
    [motion.q, motion.dq, motion.ddq] = [numbers("q")?, numbers("dq")?, numbers("ddq")?];
    motion.tau = tau;
    motion.channels = channels;
    motion.inner = flags("inner", samples)?;
    motion.use_as = rows.into_iter().map(row_of).collect();
    let processing = motion::Processing::from_json(&item("processing")?.extract::<String>()?)
        .map_err(invalid)?;
    core::LogResidual::new(motion, numbers("predicted")?, &processing)
        .map_err(IntoPyErr::into_py_err)
}

fn row_number(row: Row) -> u8 {
    match row {
        Row::Skip => 0,
        Row::Moving => 1,
        Row::Resting => 2,
    }
}

fn row_of(number: u8) -> Row {
    match number {
        1 => Row::Moving,
        2 => Row::Resting,
        _ => Row::Skip,
    }
}

/// How well a model predicts the torque of one joint.
#[pyclass(module = "sgpr", frozen, get_all)]
pub struct JointComparison {
    /// Joint.
    joint: String,
    /// Unit of the torque.
    unit: String,
    /// Samples counted.
    samples: usize,
    /// Root mean square of measured minus predicted, N·m (N).
    rmse: f64,
    /// 100 (1 - |residual| / |measured - its mean|), percent.
    fit_percent: f64,
    /// Share of the variance that is explained.
    r2: f64,
    /// |residual| / |measured|, percent.
    relative_error_percent: f64,
    /// Largest absolute residual, N·m (N) ...
    largest_error: f64,
    /// ... the log where it is ...
    largest_error_log: String,
    /// ... and when, s since the start of the log.
    largest_error_time: f64,
    /// What predicting no torque at all would leave, N·m (N).
    rmse_zero: f64,
    /// What predicting the model's gravity torque alone would leave, N·m (N).
    rmse_gravity: f64,
    /// Root mean square residual against the torque as logged, N·m (N).
    rmse_full_band: f64,
    /// Root mean square residual with the samples at which the joint stands, N·m (N).
    rmse_with_rests: f64,
    /// |residual| / |measured| with the samples at which the joint stands, percent.
    relative_error_with_rests_percent: f64,
}

impl From<core::JointComparison> for JointComparison {
    fn from(joint: core::JointComparison) -> Self {
        Self {
            joint: joint.joint,
            unit: joint.unit,
            samples: joint.samples,
            rmse: joint.rmse,
            fit_percent: joint.fit_percent,
            r2: joint.r2,
            relative_error_percent: joint.relative_error_percent,
            largest_error: joint.largest_error,
            largest_error_log: joint.largest_error_log,
            largest_error_time: joint.largest_error_time,
            rmse_zero: joint.rmse_zero,
            rmse_gravity: joint.rmse_gravity,
            rmse_full_band: joint.rmse_full_band,
            rmse_with_rests: joint.rmse_with_rests,
            relative_error_with_rests_percent: joint.relative_error_with_rests_percent,
        }
    }
}

#[pymethods]
impl JointComparison {
    fn __repr__(&self) -> String {
        format!(
            "JointComparison({}: rmse {} {}, fit {:.2} %, R² {:.4})",
            self.joint,
            figure(self.rmse),
            self.unit,
            self.fit_percent,
            self.r2
        )
    }
}
