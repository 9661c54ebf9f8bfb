//! The torque model: made, read, kept, used.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyKeyError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use sgpr_core::diagnosis::parameters_of;
use sgpr_core::export::{self, ExportOptions};
use sgpr_core::identification::{KeptOut, ParameterSet};
use sgpr_core::model::{self as core, BaseParameter, StreamOptions, Term, TorqueModel};
use sgpr_core::motion::Processing as CoreProcessing;
use sgpr_core::recording as logs;

use crate::convert::{Numbers, Samples, array, texts, view};
use crate::detached::detached;
use crate::dynamics::motion;
use crate::errors::{IntoPyErr, invalid};
use crate::estimators::differentiation_name;
use crate::identification_report::IdentificationReport;
use crate::log_residual::LogResidual;
use crate::log_set::LogSet;
use crate::recording::Recording;
use crate::robot::{Robot, urdf_options};
use crate::tables::{figure, html_table};
use crate::user_effect::known_effects;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Torque model of an arm: tau = rigid body(q, dq, ddq) + effects(q, dq, ddq). Never changes.
///
/// Made by `identify` from logs, by `Model.nominal` from a robot file, by `Model.from_parameters`,
/// or read by `load`.
///
/// Examples
/// --------
/// >>> model = sgpr.Model.nominal(sgpr.robots.puma560())
/// >>> model.predict(np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6))).shape
/// (3, 6)
/// >>> model.save("puma.sgpr")
/// >>> bool(np.array_equal(sgpr.load("puma.sgpr").all_parameters, model.all_parameters))
/// True
#[pyclass(module = "sgpr", frozen)]
pub struct Model {
    /// Of the core.
    pub inner: Arc<TorqueModel>,
    /// Only with the model that `identify` returned.
    pub report: Option<Py<IdentificationReport>>,
}

impl From<TorqueModel> for Model {
    fn from(inner: TorqueModel) -> Self {
        Self { inner: Arc::new(inner), report: None }
    }
}

impl Model {
    /// The torque at the samples of each log, `(N, n)`, and if wished its standard deviation; NaN
    /// where stretches are too short.
    fn predict_logs<'py>(
        &self,
        py: Python<'py>,
        logs: logs::LogSet,
        return_std: bool,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let found = detached(py, || core::predict(&self.inner, logs, return_std));
        let n = self.inner.robot().dof();
        let arrays = |values: Vec<f64>| array(py, &[values.len() / n, n], values);
        let of_log = |log: core::LogPrediction| {
            let torque = arrays(log.torque)?;
            match log.standard_deviation {
                None => Ok(torque.into_any()),
                Some(deviation) => Ok((torque, arrays(deviation)?).into_pyobject(py)?.into_any()),
            }
        };
        found.map_err(IntoPyErr::into_py_err)?.into_iter().map(of_log).collect()
    }

    /// A model, and how its identification went.
    pub fn with_report(
        py: Python<'_>,
        model: core::TorqueModel,
        report: core::IdentificationReport,
    ) -> PyResult<Self> {
        let report = Py::new(py, IdentificationReport::new(py, report)?)?;
        Ok(Self { inner: Arc::new(model), report: Some(report) })
    }
}

#[pymethods]
impl Model {
    /// The model that the robot file describes: its inertias, and its damping and friction where
    /// given.
    #[staticmethod]
    fn nominal(py: Python<'_>, robot: &Bound<'_, Robot>) -> Self {
        let robot = &robot.get().inner;
        detached(py, || TorqueModel::nominal(robot)).into()
    }

    /// A model with given parameters: ten per link, then those of `effects`, in the order of
    /// `all_parameter_names`.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> friction = [0.5, 0.3]  # N·m·s/rad
    /// >>> parameters = np.concatenate([robot.standard_parameters, friction])
    /// >>> model = sgpr.Model.from_parameters(robot, parameters, effects=["viscous_friction"])
    /// >>> model.all_parameter_names[-2:]
    /// ['joint_1.Fv', 'joint_2.Fv']
    #[staticmethod]
    #[pyo3(signature = (robot, parameters, effects=None), text_signature = "(robot, parameters, \
         effects=())")]
    fn from_parameters(
        robot: &Bound<'_, Robot>,
        parameters: &Bound<'_, PyAny>,
        effects: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let robot = &robot.get().inner;
        let effects = effects.map(|names| texts("effects", names)).transpose()?.unwrap_or_default();
        let set = ParameterSet::new(robot, &effects).map_err(IntoPyErr::into_py_err)?;
        let numbers = Numbers::new("parameters", parameters)?.shaped(&[set.len()])?.finite()?;
        let model = TorqueModel::with_parameters(robot, &effects, numbers.values().to_vec());
        model.map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// The robot with the inertias of its file.
    #[getter]
    fn robot(&self) -> Robot {
        self.inner.robot().clone().into()
    }

    /// The robot with the inertias of the model. They make the right torque; single ones may be
    /// such as no body has.
    #[getter]
    fn identified_robot(&self) -> Robot {
        self.inner.identified_robot().clone().into()
    }

    /// Effects beside the rigid body that are at every joint; see `terms` for the others.
    #[getter]
    fn effects(&self) -> Vec<String> {
        self.inner
            .parameter_set()
            .effects()
            .iter()
            .map(|effect| effect.name().to_string())
            .collect()
    }

    /// Effects at single sites, with constants and parameters: "effect", "joints", and "parameters"
    /// by name as (value, standard deviation or None, unit).
    #[getter]
    fn terms<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let robot = self.inner.robot();
        let of_term = |term: &Term| {
            let (dict, parameters) = (PyDict::new(py), PyDict::new(py));
            for parameter in parameters_of(term, robot) {
                parameters
                    .set_item(&parameter.name, (parameter.value, parameter.std, &parameter.unit))?;
            }
            let joint = term.site.joint().map(|joint| robot.joints()[joint].name.clone());
            dict.set_item("effect", term.effect.name())?;
            dict.set_item("joints", Vec::from_iter(joint))?;
            dict.set_item("parameters", parameters)?;
            Ok(dict)
        };
        self.inner.terms().iter().map(of_term).collect()
    }

    /// The base parameters: values, standard deviations, units.
    #[getter]
    fn parameters(&self) -> Parameters {
        Parameters {
            rows: self.inner.base_parameters(),
            covariance: self.inner.fit().map(|fit| fit.covariance.clone()),
            model: self.inner.clone(),
        }
    }

    /// Values of all parameters: ten per link, then those of the effects. Where motion reveals only
    /// a combination, one parameter stands for it and the others keep their values of the robot
    /// file.
    #[getter]
    fn all_parameters<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &[slf.get().inner.parameters().len()], |model| model.inner.parameters())
    }

    /// Names of all parameters: "joint_2.Ixx", "joint_2.Fv".
    #[getter]
    fn all_parameter_names(&self) -> Vec<String> {
        self.inner.parameter_set().names().to_vec()
    }

    /// How logs are processed for this model, or None if it was not identified.
    #[getter]
    fn processing(&self) -> Option<Processing> {
        self.inner.processing().cloned().map(Processing::from)
    }

    /// What the identification says, or None: "method"; per joint "noise" (N·m), "rows" and
    /// "correlation" (rows that carry as much as one); "dispersion", by what standard deviations
    /// are larger than noise makes them; "half_interval_95", half the interval of 95 % of what
    /// uncertain parameters make, in their standard deviations; "prior_standard_deviation", that of
    /// the robot file's bodies, in shares of their values, where the file holds what the logs do
    /// not determine, else None; "condition", "scaled_condition"; "undetermined" base parameters.
    #[getter]
    fn fit<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(fit) = self.inner.fit() else { return Ok(None) };
        let dict = PyDict::new(py);
        dict.set_item("method", &fit.method)?;
        dict.set_item("noise", array(py, &[fit.noise.len()], fit.noise.clone())?)?;
        let rows = fit.rows.iter().map(|rows| *rows as i64).collect();
        dict.set_item("rows", array::<i64>(py, &[fit.rows.len()], rows)?)?;
        dict.set_item(
            "correlation",
            array(py, &[fit.correlation.len()], fit.correlation.clone())?,
        )?;
        dict.set_item("dispersion", fit.dispersion)?;
        dict.set_item("half_interval_95", fit.half_interval_95)?;
        dict.set_item("prior_standard_deviation", fit.prior_standard_deviation)?;
        dict.set_item("condition", fit.condition)?;
        dict.set_item("scaled_condition", fit.scaled_condition)?;
        dict.set_item("undetermined", &fit.undetermined)?;
        Ok(Some(dict))
    }

    /// How the identification went; only on the model that `identify` returned, not on one that was
    /// read from a file.
    #[getter]
    fn report(&self, py: Python<'_>) -> Option<Py<IdentificationReport>> {
        self.report.as_ref().map(|report| report.clone_ref(py))
    }

    /// Logs that the model was fitted to.
    #[getter]
    fn logs(&self) -> Vec<String> {
        self.inner.provenance().logs.clone()
    }

    /// What was done to get the model, one sentence each.
    #[getter]
    fn history(&self) -> Vec<String> {
        self.inner.provenance().history.clone()
    }

    /// How its logs were read, as `sgpr.read` and `Recording.repair` take it; None if nobody noted
    /// it.
    #[getter]
    fn reading<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let text = self.inner.provenance().reading.as_ref();
        text.map(|text| py.import("json")?.call_method1("loads", (text,))).transpose()
    }

    /// The same model with a note on how its logs were read, for `reading`; what JSON can hold.
    ///
    /// Examples
    /// --------
    /// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
    /// >>> model.with_reading({"units": {"position": "deg"}}).reading
    /// {'units': {'position': 'deg'}}
    fn with_reading(&self, py: Python<'_>, reading: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let dumps =
            |reading| py.import("json")?.call_method1("dumps", (reading,))?.extract::<String>();
        let text = reading.map(dumps).transpose()?;
        let inner = Arc::new(self.inner.as_ref().clone().with_reading(text));
        Ok(Self { inner, report: self.report.as_ref().map(|report| report.clone_ref(py)) })
    }

    /// Version of the library that made the model.
    #[getter]
    fn library_version(&self) -> &str {
        &self.inner.provenance().library_version
    }

    /// This model and an error model on top of it: the parameters of both added. Also written
    /// `model + error`.
    ///
    /// Examples
    /// --------
    /// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
    /// >>> bool(np.array_equal((model + model).all_parameters, 2 * model.all_parameters))
    /// True
    fn plus(&self, error: &Bound<'_, Self>) -> PyResult<Self> {
        let error = &error.get().inner;
        let names =
            |model: &TorqueModel| model.robot().joint_names().map(String::from).collect::<Vec<_>>();
        let (own, others) = (names(&self.inner), names(error));
        if own != others {
            let message = format!(
                "models of different robots: joints {}, and {}",
                own.join(", "),
                others.join(", ")
            );
            return Err(invalid(message));
        }
        Ok(self.inner.plus(error).into())
    }

    fn __add__(&self, error: &Bound<'_, Self>) -> PyResult<Self> {
        self.plus(error)
    }

    /// Torque that a motion needs.
    ///
    /// Parameters
    /// ----------
    /// q : array of shape (N, n) or (n,), or Recording or LogSet
    ///     rad (m for prismatic joints). A recording is processed as `compare` does; NaN stands
    ///     where it is too short for that. A set gives a list, an item for each of its logs.
    /// dq, ddq : array of the shape of q
    ///     rad/s, rad/s² (m for prismatic joints); not with a recording.
    /// return_std : bool, default False
    ///     Whether to return the standard deviation too that the uncertainty of the parameters
    ///     makes; the noise of a single torque, `fit["noise"]`, comes on top of it.
    ///
    /// Returns
    /// -------
    /// array of the shape of q, or two
    ///     N·m (N).
    #[pyo3(signature = (q, dq=None, ddq=None, *, return_std=false))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: Option<&Bound<'py, PyAny>>,
        ddq: Option<&Bound<'py, PyAny>>,
        return_std: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = self.inner.robot().dof();
        let (dq, ddq) = match (q.cast::<Recording>(), dq, ddq) {
            (Ok(log), None, None) => {
                let log = std::slice::from_ref(&log.get().inner);
                let mut found = self.predict_logs(py, logs::LogSet::whole(log), return_std)?;
                return Ok(found.swap_remove(0));
            }
            (Err(_), None, None) if q.is_instance_of::<LogSet>() => {
                let set = q.cast::<LogSet>()?.get().inner.clone();
                return self.predict_logs(py, set, return_std)?.into_pyobject(py);
            }
            (Err(_), Some(dq), Some(ddq)) => (dq, ddq),
            (Ok(_), ..) => {
                return Err(invalid(
                    "predict: a recording brings its motion along: give no dq and ddq",
                ));
            }
            (Err(_), ..) => {
                return Err(invalid("predict: give q, dq and ddq, or a recording or LogSet"));
            }
        };
        let samples = Samples::together([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
        let motion = motion(&samples);
        let tau = detached(py, || self.inner.predict(motion));
        let tau = samples[0].result(py, &[n], tau)?;
        if !return_std {
            return Ok(tau.into_any());
        }
        let deviation = detached(py, || self.inner.standard_deviation(motion))
            .map_err(IntoPyErr::into_py_err)?;
        let deviation = samples[0].result(py, &[n], deviation)?;
        Ok((tau, deviation).into_pyobject(py)?.into_any())
    }

    /// Standard deviation of the torque along a log of `sgpr.compare`, which the uncertainty of the
    /// parameters makes, effects with memory, time or constants included.
    ///
    /// Parameters
    /// ----------
    /// log : LogResidual
    ///     One of `Comparison.logs`.
    ///
    /// Returns
    /// -------
    /// array of shape (N, n)
    ///     N·m (N).
    fn standard_deviation<'py>(
        &self,
        py: Python<'py>,
        log: PyRef<'_, LogResidual>,
    ) -> PyResult<Array<'py>> {
        let n = self.inner.robot().dof();
        let motion = &log.inner.motion;
        if log.dof != n {
            return Err(invalid(format!("the log has {} joints, the model {n}", log.dof)));
        }
        let deviation = detached(py, || self.inner.standard_deviation_of(motion))
            .map_err(IntoPyErr::into_py_err)?;
        array(py, &[motion.len(), n], deviation)
    }

    /// The proof that every link is a body, or None if consistency was not asked for: "links" with
    /// "joint", "mass" (kg), "centre" (m), "smallest_eigenvalue" of the pseudo-inertia,
    /// "relative_eigenvalue" in units of the link's size, and "principal_moments" (kg·m²); "active"
    /// limits; "cost", what consistency adds to the residual in standard deviations of the fit;
    /// "residual_percent", how much larger the weighted residual is than without limits (zero if
    /// noise explains it); "prices", the share of that cost that would be gone without one "limit",
    /// dearest first; "stages", the "residual_percent" that is left without a "limit" and those
    /// before; "kept_out", errors on parts of the logs predicted from the others,
    /// "unconstrained_percent" and "consistent_percent" of the torque, or None if noise explains
    /// the cost; "prior_deviation", the relative deviation of the robot file's values; "seconds" in
    /// the solver.
    #[getter]
    fn certificate<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(certificate) = self.inner.fit().and_then(|fit| fit.consistency.as_ref()) else {
            return Ok(None);
        };
        let mut links = Vec::new();
        for link in &certificate.links {
            let dict = PyDict::new(py);
            dict.set_item("joint", &link.joint)?;
            dict.set_item("mass", link.mass)?;
            dict.set_item("centre", link.centre)?;
            dict.set_item("smallest_eigenvalue", link.smallest_eigenvalue)?;
            dict.set_item("relative_eigenvalue", link.relative_eigenvalue)?;
            dict.set_item("principal_moments", link.principal_moments)?;
            links.push(dict);
        }
        let dict = PyDict::new(py);
        dict.set_item("links", links)?;
        dict.set_item("active", &certificate.active)?;
        dict.set_item("cost", certificate.cost)?;
        dict.set_item("seconds", certificate.seconds)?;
        let prices = certificate
            .prices
            .iter()
            .map(|price| of_limit(py, &price.limit, ("share", price.share)));
        dict.set_item("prices", prices.collect::<PyResult<Vec<_>>>()?)?;
        dict.set_item("residual_percent", certificate.residual_percent)?;
        let stages = certificate.stages.iter();
        let stages = stages
            .map(|stage| of_limit(py, &stage.limit, ("residual_percent", stage.residual_percent)));
        dict.set_item("stages", stages.collect::<PyResult<Vec<_>>>()?)?;
        let kept_out = certificate.kept_out.map(|errors| {
            let KeptOut { unconstrained_percent, consistent_percent, .. } = errors;
            let named = [
                ("unconstrained_percent", unconstrained_percent),
                ("consistent_percent", consistent_percent),
            ];
            named.into_py_dict(py)
        });
        dict.set_item("kept_out", kept_out.transpose()?)?;
        dict.set_item("prior_deviation", certificate.prior_deviation)?;
        Ok(Some(dict))
    }

    /// Writes the robot with the inertias of this model as URDF, and with its viscous and Coulomb
    /// friction as damping and friction in `<dynamics>`: the file `source`, from which the robot
    /// was read, everything else as it was.
    ///
    /// URDF has no place for rotor inertia, torque offset and other effects. `<dynamics>` of a
    /// joint stays as it is where the model has no such friction.
    ///
    /// Parameters
    /// ----------
    /// source, path : str or os.PathLike
    ///     The file that the robot was read from, and the one to write.
    /// locked : dict of str to float, optional
    ///     As given to `Robot.from_urdf`.
    ///
    /// Raises
    /// ------
    /// RobotError
    ///     If a link of the model is no body; identify with `consistent=True`.
    #[pyo3(signature = (source, path, *, locked=None))]
    fn write_urdf(
        &self,
        py: Python<'_>,
        source: PathBuf,
        path: PathBuf,
        locked: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let robot = self.inner.robot_for_urdf();
        let mut options = urdf_options(None, locked, None)?;
        options.joints = Some(robot.joint_names().map(String::from).collect());
        detached(py, || robot.write_urdf(source, path, &options)).map_err(IntoPyErr::into_py_err)
    }

    /// The model as MJCF for MuJoCo: the tree with its inertias, and rotor inertia, viscous and
    /// Coulomb friction as armature, damping and frictionloss.
    ///
    /// Raises
    /// ------
    /// RobotError
    ///     If a link of the model is no body; identify with `consistent=True`.
    ///
    /// Examples
    /// --------
    /// >>> sgpr.Model.nominal(sgpr.robots.two_link()).to_mjcf().splitlines()[0]
    /// '<mujoco model="two_link">'
    fn to_mjcf(&self) -> PyResult<String> {
        self.inner.to_mjcf().map_err(IntoPyErr::into_py_err)
    }

    /// The model one sample after the other, for a control loop: hidden states, times and delays
    /// are carried from call to call.
    ///
    /// Parameters
    /// ----------
    /// rate_hz : float, optional
    ///     Rate of the calls. Effects of time, delays, lags, elastic joints and play, and links
    ///     that ring need it.
    /// purpose : {"expected_measurement", "feed_forward"}
    ///     "expected_measurement" is all of the model, what the log would show, and what `predict`
    ///     and `compare` look at: the default. "feed_forward" is what the arm needs, for a
    ///     controller: without errors of the measurement (gain, delay, lag, limit, offset and their
    ///     drift) and without what was there for a while (contact, payload change). The page of
    ///     each effect in docs/effects says which it is, and why.
    /// keep : list of str, optional
    ///     Names of effects that a feed-forward torque holds all the same: ["torque_offset"] if the
    ///     offset is a spring or a hose.
    ///
    /// Returns
    /// -------
    /// Predictor
    ///
    /// Examples
    /// --------
    /// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
    /// >>> predictor = model.predictor(rate_hz=250.0, purpose="feed_forward")
    /// >>> predictor.torque(np.zeros(2), np.zeros(2), np.zeros(2))
    /// array([19.62 ,  4.905])
    #[pyo3(signature = (*, rate_hz=None, purpose="expected_measurement", keep=None))]
    fn predictor(
        &self,
        py: Python<'_>,
        rate_hz: Option<f64>,
        purpose: &str,
        keep: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Predictor> {
        let stream = stream_options(rate_hz, purpose, keep)?;
        let inner =
            detached(py, || self.inner.predictor(&stream)).map_err(IntoPyErr::into_py_err)?;
        Ok(Predictor { inner: Mutex::new(inner), dof: self.inner.robot().dof(), stream })
    }

    /// Writes the model as one source file that needs no library, for a controller; it is complete
    /// or not there.
    ///
    /// The file holds the robot unrolled into its formulas, the effects with their hidden states in
    /// one structure, and functions to reset it and to get the torque of the next sample. The
    /// torque is that of `predictor` with the same options, called once per period (compared over
    /// all effects of the library, to 1e-12 of the largest torque).
    ///
    /// Parameters
    /// ----------
    /// language : {"c", "rust"}
    ///     C99 to include in C or C++ (needs `math.h` alone), or a Rust module.
    /// path : str or Path
    ///     The file; its folder is made if need be.
    /// precision : {"double", "single"}
    ///     Width of its numbers: 64 bits, or 32 for processors that compute with no others (to 2e-6
    ///     of the largest torque, motion and torque in 32 bits). Times of the session have 64 bits
    ///     in both.
    /// name : str, optional
    ///     What names in a C file begin with, after `sgpr_`; by default the robot's name.
    /// rate_hz, purpose, keep
    ///     As in `predictor`; the purpose is "feed_forward" by default.
    ///
    /// Raises
    /// ------
    /// SgprError
    ///     If the model cannot be streamed, or has an effect that is a Python function.
    ///
    /// Examples
    /// --------
    /// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
    /// >>> model.export("c", "arm.h", name="arm")
    /// >>> from pathlib import Path
    /// >>> "int sgpr_arm_torque(" in Path("arm.h").read_text()
    /// True
    #[pyo3(signature = (language, path, *, precision="double", name=None, rate_hz=None, purpose="feed_forward", keep=None))]
    #[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
    fn export(
        &self,
        py: Python<'_>,
        language: &str,
        path: PathBuf,
        precision: &str,
        name: Option<String>,
        rate_hz: Option<f64>,
        purpose: &str,
        keep: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let language = language.parse().map_err(IntoPyErr::into_py_err)?;
        let precision = export::precision(precision).map_err(IntoPyErr::into_py_err)?;
        let options = ExportOptions::new(language)
            .with_precision(precision)
            .with_name(name)
            .with_stream(stream_options(rate_hz, purpose, keep)?);
        py.import("sgpr._files")?.call_method1("make_folder_of", (&path,))?;
        detached(py, || self.inner.export_to(path, &options)).map_err(IntoPyErr::into_py_err)
    }

    /// Writes the model to a file, whose folder is made if need be; the file is complete or not
    /// there. `load` reads it back to the bit.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.import("sgpr._files")?.call_method1("make_folder_of", (&path,))?;
        detached(py, || self.inner.save(path)).map_err(IntoPyErr::into_py_err)
    }

    /// A Plotly figure of measured and predicted torque of logs, joint by joint.
    ///
    /// Examples
    /// --------
    /// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    /// >>> figure = sgpr.identify(robot, [log]).plot([log])
    /// >>> len(figure.data)
    /// 12
    fn plot<'py>(
        slf: &Bound<'py, Self>,
        recordings: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_model", (slf, recordings))
    }

    /// Writes the page of `sgpr compare` for these logs: errors, what they depend on, measured and
    /// predicted torque.
    ///
    /// Examples
    /// --------
    /// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    /// >>> sgpr.identify(robot, [log]).save_report("out/page.html", [log])
    fn save_report(
        slf: &Bound<'_, Self>,
        path: PathBuf,
        recordings: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        slf.py()
            .import("sgpr._pages")?
            .call_method1("model_page", (slf, path, recordings))
            .map(drop)
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("model_html", (slf,))
    }

    /// The content of the file that `save` writes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.inner.to_bytes())
    }

    /// The model of which `data` is the file; `origin` names it in messages.
    ///
    /// Examples
    /// --------
    /// >>> model = sgpr.Model.nominal(sgpr.robots.two_link())
    /// >>> sgpr.Model.from_bytes(model.to_bytes()).robot.name
    /// 'two_link'
    #[staticmethod]
    #[pyo3(signature = (data, *, origin="bytes"))]
    fn from_bytes(data: &[u8], origin: &str) -> PyResult<Self> {
        TorqueModel::from_bytes_with(data, origin, &known_effects())
            .map(Self::from)
            .map_err(IntoPyErr::into_py_err)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((slf.get_type().getattr("from_bytes")?, (slf.get().to_bytes(slf.py()),)))
    }

    fn __repr__(&self) -> String {
        let model = &self.inner;
        let mut effects = self.effects();
        effects.extend(model.terms().iter().map(|term| match term.site.joint() {
            Some(joint) => {
                format!("{} at {}", term.effect.name(), model.robot().joints()[joint].name)
            }
            None => term.effect.name().to_string(),
        }));
        let effects = if effects.is_empty() { "no effects".into() } else { effects.join(", ") };
        let mut text = format!(
            "Model of '{}', {} joints, {} base parameters\n  {effects}",
            model.robot().name(),
            model.robot().dof(),
            model.base().rank(),
        );
        for line in &model.provenance().history {
            text += &format!("\n  {line}");
        }
        text
    }
}

/// A limit and what a certificate says of it.
fn of_limit<'py>(
    py: Python<'py>,
    limit: &str,
    (name, value): (&str, f64),
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("limit", limit)?;
    dict.set_item(name, value)?;
    Ok(dict)
}

/// Reads a model file. Safe with files from strangers: nothing in them is run. A model with an
/// effect of your own is read if the effect was given to `register_effect`.
///
/// Raises
/// ------
/// ModelFileError
///     If the file is no model, damaged, or of a later version.
/// OSError
///     If the file cannot be read.
///
/// Examples
/// --------
/// >>> sgpr.Model.nominal(sgpr.robots.two_link()).save("two_link.sgpr")
/// >>> sgpr.load("two_link.sgpr").robot.dof
/// 2
#[pyfunction]
pub fn load(py: Python<'_>, path: PathBuf) -> PyResult<Model> {
    detached(py, || TorqueModel::load_with(path, &known_effects()))
        .map(Model::from)
        .map_err(IntoPyErr::into_py_err)
}

/// One base parameter of a model.
#[pyclass(module = "sgpr", frozen, get_all)]
pub struct Parameter {
    /// Parameter that stands for the combination.
    name: String,
    /// The combination of parameters.
    expression: String,
    /// Unit.
    unit: &'static str,
    /// Value in the model.
    value: f64,
    /// Standard deviation; infinite if the motion does not determine it, None for a model that was
    /// not identified.
    standard_deviation: Option<f64>,
    /// The same in percent of the value.
    relative_standard_deviation: Option<f64>,
    /// Value that the robot file gives.
    nominal: f64,
}

impl Parameter {
    const FIELDS: [&str; 7] = [
        "name",
        "expression",
        "unit",
        "value",
        "standard_deviation",
        "relative_standard_deviation",
        "nominal",
    ];
}

impl From<&BaseParameter> for Parameter {
    fn from(row: &BaseParameter) -> Self {
        let BaseParameter { name, expression, unit, value, standard_deviation, nominal, .. } =
            row.clone();
        let relative_standard_deviation =
            standard_deviation.map(|deviation| 100.0 * deviation / value.abs());
        Self {
            name,
            expression,
            unit,
            value,
            standard_deviation,
            relative_standard_deviation,
            nominal,
        }
    }
}

#[pymethods]
impl Parameter {
    /// What `dataclasses.asdict` and pandas read of a row.
    #[classattr]
    fn __dataclass_fields__(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        let row = py
            .import("dataclasses")?
            .call_method1("make_dataclass", ("Parameter", Self::FIELDS))?;
        row.getattr("__dataclass_fields__")
    }

    fn __repr__(&self) -> String {
        let spread = self
            .standard_deviation
            .map_or(String::new(), |deviation| format!(" ± {}", figure(deviation)));
        format!("Parameter({} = {}{spread} {})", self.name, figure(self.value), self.unit)
    }
}

/// Base parameters of a model: a sequence of `Parameter`, with the columns as arrays.
///
/// Examples
/// --------
/// >>> parameters = sgpr.Model.nominal(sgpr.robots.two_link()).parameters
/// >>> len(parameters), parameters[0].name, parameters["joint_2.mx"].value
/// (6, 'joint_1.mx', 0.5)
///
/// `pandas.DataFrame(parameters)` has a row for each.
#[pyclass(module = "sgpr", frozen, sequence)]
pub struct Parameters {
    rows: Vec<BaseParameter>,
    covariance: Option<Vec<f64>>,
    model: Arc<TorqueModel>,
}

impl Parameters {
    fn column<'py>(
        &self,
        py: Python<'py>,
        select: fn(&BaseParameter) -> f64,
    ) -> PyResult<Array<'py>> {
        array(py, &[self.rows.len()], self.rows.iter().map(select).collect())
    }
}

#[pymethods]
impl Parameters {
    /// Names: the parameter that stands for each combination.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.rows.iter().map(|row| row.name.clone()).collect()
    }

    /// The combinations.
    #[getter]
    fn expressions(&self) -> Vec<String> {
        self.rows.iter().map(|row| row.expression.clone()).collect()
    }

    /// Units.
    #[getter]
    fn units(&self) -> Vec<&'static str> {
        self.rows.iter().map(|row| row.unit).collect()
    }

    /// Values, (rank,).
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |row| row.value)
    }

    /// Standard deviations, (rank,); infinite where the motion says nothing, NaN for a model that
    /// was not identified.
    #[getter]
    fn standard_deviations<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |row| row.standard_deviation.unwrap_or(f64::NAN))
    }

    /// Values that the robot file gives, (rank,).
    #[getter]
    fn nominal<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.column(py, |row| row.nominal)
    }

    /// Covariance of the estimates, (rank, rank), or None for a model that was not identified.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        let rank = self.rows.len();
        self.covariance.as_ref().map(|values| array(py, &[rank, rank], values.clone())).transpose()
    }

    fn __len__(&self) -> usize {
        self.rows.len()
    }

    fn __getitem__(&self, key: &Bound<'_, PyAny>) -> PyResult<Parameter> {
        if let Ok(name) = key.extract::<String>() {
            let row = self.rows.iter().find(|row| row.name == name);
            let close = || sgpr_core::names::suggestion(&name, &self.names());
            return row
                .map(Parameter::from)
                .ok_or_else(|| PyKeyError::new_err(format!("{name}{}", close())));
        }
        let length = self.rows.len() as isize;
        let index: isize = key
            .extract()
            .map_err(|_| PyTypeError::new_err("parameters are counted from 0 or known by name"))?;
        let place = if index < 0 { index + length } else { index };
        let row = usize::try_from(place).ok().and_then(|place| self.rows.get(place));
        row.map(Parameter::from)
            .ok_or_else(|| PyIndexError::new_err(format!("{index} of {length} parameters")))
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rows: Vec<Parameter> = self.rows.iter().map(Parameter::from).collect();
        rows.into_pyobject(py)?.call_method0("__iter__")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Model,))> {
        let of_model = py.import("operator")?.call_method1("attrgetter", ("parameters",))?;
        Ok((of_model, (Model { inner: self.model.clone(), report: None },)))
    }

    /// One dict per parameter, with the attributes of `Parameter`.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let describe = |row: &BaseParameter| {
            let parameter = Parameter::from(row);
            let dict = PyDict::new(py);
            dict.set_item("name", &parameter.name)?;
            dict.set_item("expression", &parameter.expression)?;
            dict.set_item("unit", parameter.unit)?;
            dict.set_item("value", parameter.value)?;
            dict.set_item("standard_deviation", parameter.standard_deviation)?;
            dict.set_item("relative_standard_deviation", parameter.relative_standard_deviation)?;
            dict.set_item("nominal", parameter.nominal)?;
            Ok(dict)
        };
        self.rows.iter().map(describe).collect()
    }

    fn __repr__(&self) -> String {
        let width = self.rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0);
        let mut text =
            format!("{:width$} {:>12} {:>10} {:>12}  unit", "parameter", "value", "std", "nominal");
        for row in &self.rows {
            let spread = row.standard_deviation.map_or("-".into(), figure);
            let (value, nominal) = (figure(row.value), figure(row.nominal));
            text += &format!(
                "\n{:width$} {value:>12} {spread:>10} {nominal:>12}  {}",
                row.name, row.unit
            );
        }
        text
    }

    fn _repr_html_(&self) -> String {
        let cells = self.rows.iter().map(|row| {
            let spread = row.standard_deviation.map_or("-".into(), figure);
            vec![
                row.expression.clone(),
                figure(row.value),
                spread,
                figure(row.nominal),
                row.unit.to_string(),
            ]
        });
        html_table(&["parameter", "value", "standard deviation", "nominal", "unit"], cells)
    }
}

/// What is done to every log before it is compared with a model, with all choices made.
#[pyclass(module = "sgpr", frozen)]
pub struct Processing {
    /// Of the core.
    pub inner: CoreProcessing,
}

impl From<CoreProcessing> for Processing {
    fn from(inner: CoreProcessing) -> Self {
        Self { inner }
    }
}

#[pymethods]
impl Processing {
    /// Cut-off of the position filter, Hz.
    #[getter]
    fn cutoff_hz(&self) -> f64 {
        self.inner.cutoff_hz
    }

    /// Order of the filters (of one pass).
    #[getter]
    fn order(&self) -> usize {
        self.inner.order
    }

    /// How derivatives are taken: "central:6", "savitzky_golay:11:3".
    #[getter]
    fn differentiation(&self) -> String {
        differentiation_name(self.inner.differentiation)
    }

    /// Cut-off of both sides of the equation, Hz; None if they are not filtered.
    #[getter]
    fn torque_cutoff_hz(&self) -> Option<f64> {
        self.inner.torque_cutoff_hz
    }

    /// Every how many rows of the equation are taken.
    #[getter]
    fn decimation(&self) -> usize {
        self.inner.decimation
    }

    /// Periods of the cut-off about turns and rests of a joint in which its rows do not count.
    #[getter]
    fn turn_margin(&self) -> f64 {
        self.inner.turn_margin
    }

    /// Speed below which each joint counts as standing, (n,), rad/s (m/s).
    #[getter]
    fn standstill_speed<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &[slf.get().inner.standstill_speed.len()], |processing| {
            &processing.inner.standstill_speed
        })
    }

    /// Samples at one sampling rate by which the filters reach over the end of a piece of a log, to
    /// fifteen digits.
    fn reach(&self, rate_hz: f64) -> PyResult<usize> {
        self.inner
            .reach(crate::convert::positive("rate_hz", rate_hz)?)
            .map_err(IntoPyErr::into_py_err)
    }

    /// Torques in the band of the equations, the torque of a log through their filter, forwards and
    /// backwards: what errors are counted in.
    ///
    /// Parameters
    /// ----------
    /// torque : array_like, (N,) or (N, n)
    ///     Of one stretch without gaps, N·m (N).
    /// rate_hz : float
    ///     Its sampling rate, Hz.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     As large as `torque`.
    ///
    /// Raises
    /// ------
    /// SgprError
    ///     If the stretch is shorter than the filter, or the rate cannot hold its cut-off.
    fn in_band<'py>(
        &self,
        py: Python<'py>,
        torque: &Bound<'py, PyAny>,
        rate_hz: f64,
    ) -> PyResult<Array<'py>> {
        let rate_hz = crate::convert::positive("rate_hz", rate_hz)?;
        let torque = Numbers::new("torque", torque)?.finite()?;
        let shape = torque.shape().to_vec();
        let columns = match shape[..] {
            [_] => 1,
            [_, columns] if columns > 0 => columns,
            _ => return Err(invalid(format!("torque: got {shape:?}, expected (N,) or (N, n)"))),
        };
        let mut values = torque.values().to_vec();
        let filtered = detached(py, || self.inner.in_band(&mut values, columns, rate_hz));
        filtered.map_err(IntoPyErr::into_py_err)?;
        array(py, &shape, values)
    }

    /// The processing that `to_json` wrote.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        CoreProcessing::from_json(text).map(Self::from).map_err(invalid)
    }

    /// The processing as text.
    fn to_json(&self) -> String {
        self.inner.to_json()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_json")?, (slf.get().to_json(),)))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.inner == other.inner
    }

    fn __repr__(&self) -> String {
        let band =
            self.inner.torque_cutoff_hz.map_or("unfiltered".into(), |hz| format!("{hz:.2} Hz"));
        format!(
            "Processing(position {:.2} Hz, order {}, {}; equation {band}, every {} rows)",
            self.inner.cutoff_hz,
            self.inner.order,
            self.differentiation(),
            self.inner.decimation
        )
    }
}

/// Position and speed of `dof` joints at which a predictor starts; `None` for rest at the next
/// sample.
///
/// - `time`: that of the session at the next sample, s, which must be finite
pub fn start_of_stream(
    dof: usize,
    q: Option<&Bound<'_, PyAny>>,
    dq: Option<&Bound<'_, PyAny>>,
    time: f64,
) -> PyResult<Option<(Vec<f64>, Vec<f64>)>> {
    if !time.is_finite() {
        return Err(invalid(format!("time: got {time}, expected a finite number")));
    }
    let one = |name, value| {
        Ok::<_, PyErr>(Numbers::new(name, value)?.shaped(&[dof])?.finite()?.values().to_vec())
    };
    let q = q.map(|q| one("q", q)).transpose()?;
    let dq = dq.map(|dq| one("dq", dq)).transpose()?;
    match (q, dq) {
        (None, None) => Ok(None),
        (None, Some(_)) => {
            Err(invalid("reset: a speed needs the position that goes with it: give q"))
        }
        (Some(q), dq) => Ok(Some((q, dq.unwrap_or_else(|| vec![0.0; dof])))),
    }
}

/// Temperatures of `dof` joints, °C, of one number for all or one for each.
pub fn temperatures(dof: usize, celsius: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    match celsius.extract::<f64>() {
        Ok(one) => Ok(vec![one; dof]),
        Err(_) => Ok(Numbers::new("celsius", celsius)?.shaped(&[dof])?.values().to_vec()),
    }
}

/// How a model is streamed, from the keywords of `predictor`.
pub fn stream_options(
    rate_hz: Option<f64>,
    purpose: &str,
    keep: Option<&Bound<'_, PyAny>>,
) -> PyResult<StreamOptions> {
    let purpose =
        purpose.parse().map_err(|error: core::UnknownPurpose| invalid(error.to_string()))?;
    let keep = keep.map(|names| texts("keep", names)).transpose()?.unwrap_or_default();
    Ok(StreamOptions::default().with_rate_hz(rate_hz).with_purpose(purpose).with_keep(keep))
}

/// One sample after the other, for a control loop. One per thread.
///
/// Effects with a memory carry it from call to call: after `reset` the torques are those of a
/// trajectory that starts at rest at the first sample. A call allocates nothing but the array it
/// returns, and not even that with `out`; effects of your own are the exception: they are called
/// with arrays of one row.
///
/// Not causal along a trajectory, and therefore only nearly the same here: elastic joints and play
/// (their link motion is differentiated from the samples before), a delay of less than a period,
/// and a torque that is logged early, which is that of the motion extrapolated by that time.
/// docs/effects says for each effect how it is streamed.
///
/// Examples
/// --------
/// >>> predictor = sgpr.Model.nominal(sgpr.robots.two_link()).predictor()
/// >>> q, dq, ddq, tau = np.zeros(2), np.zeros(2), np.zeros(2), np.empty(2)
/// >>> predictor.torque(q, dq, ddq, out=tau) is tau
/// True
/// >>> tau
/// array([19.62 ,  4.905])
#[pyclass(module = "sgpr", frozen)]
pub struct Predictor {
    inner: Mutex<core::Predictor>,
    dof: usize,
    stream: StreamOptions,
}

#[pymethods]
impl Predictor {
    /// What the torque is for: "expected_measurement" or "feed_forward".
    #[getter]
    fn purpose(&self) -> &'static str {
        self.stream.purpose.name()
    }

    /// Rate of the calls, Hz; None if it was not given.
    #[getter]
    fn rate_hz(&self) -> Option<f64> {
        self.stream.rate_hz
    }

    /// Time of the session at the last sample, s; at the next one, if that is the first since a
    /// reset.
    #[getter]
    fn time(&self) -> f64 {
        self.lock().time()
    }

    /// Forgets all samples.
    ///
    /// Parameters
    /// ----------
    /// q, dq : array of shape (n,), optional
    ///     Where the arm is, and how fast: hidden states are those after a long motion at this
    ///     speed, those of rest for a joint without speed. By default all start at rest at the next
    ///     sample.
    /// time : float
    ///     Time of the session at the next sample, s, for effects of time: zero is the start of the
    ///     model's first log.
    ///
    /// Examples
    /// --------
    /// >>> predictor = sgpr.Model.nominal(sgpr.robots.two_link()).predictor(rate_hz=100.0)
    /// >>> predictor.reset(q=np.array([0.1, 0.2]), time=12.0)
    /// >>> predictor.time
    /// 12.0
    #[pyo3(signature = (q=None, dq=None, *, time=0.0))]
    fn reset(
        &self,
        q: Option<&Bound<'_, PyAny>>,
        dq: Option<&Bound<'_, PyAny>>,
        time: f64,
    ) -> PyResult<()> {
        let start = start_of_stream(self.dof, q, dq, time)?;
        let mut predictor = self.lock();
        match start {
            None => predictor.reset(),
            Some((q, dq)) => predictor.reset_at(&q, &dq).map_err(IntoPyErr::into_py_err)?,
        }
        predictor.set_time(time).map_err(IntoPyErr::into_py_err)
    }

    /// Sets the temperature of the joints, for friction that depends on it.
    ///
    /// Parameters
    /// ----------
    /// celsius : float or array of shape (n,)
    ///     °C; one for all joints, or one for each.
    fn set_temperature(&self, celsius: &Bound<'_, PyAny>) -> PyResult<()> {
        let all = temperatures(self.dof, celsius)?;
        self.lock().set_temperature(&all).map_err(IntoPyErr::into_py_err)
    }

    /// Torque at the next sample, (n,), N·m (N), in `out` if given; moves the hidden states on by
    /// one step.
    ///
    /// Parameters
    /// ----------
    /// q, dq, ddq : array of shape (n,)
    ///     rad, rad/s, rad/s² (m for prismatic joints).
    /// out : array of shape (n,), float64, optional
    ///     Contiguous and writeable; may be one of the inputs.
    /// step : float, optional
    ///     Time since the last sample, s: for irregular calls and pauses. By default one period.
    ///
    /// Raises
    /// ------
    /// SgprError
    ///     If an array has another shape or holds a number that is not finite, or a temperature is
    ///     missing. The hidden states stay as they are.
    #[pyo3(signature = (q, dq, ddq, out=None, *, step=None))]
    fn torque<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        out: Option<Bound<'py, PyAny>>,
        step: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let py = q.py();
        let of_numbers = |out: Bound<'py, PyAny>| {
            out.cast_into::<PyArray1<f64>>()
                .map_err(|_| PyTypeError::new_err("out: expected an array (n,) of float64"))
        };
        let out = out.map(of_numbers).transpose()?;
        if let Some(out) = &out {
            // Before anything moves on.
            if out.shape() != [self.dof] {
                return Err(invalid(format!(
                    "out: got ({},), expected ({},)",
                    out.len(),
                    self.dof
                )));
            }
            if !out.is_contiguous() {
                return Err(invalid("out: expected a contiguous array"));
            }
        }
        let one = |name, value| Numbers::new(name, value)?.shaped(&[self.dof])?.finite();
        let (q, dq, ddq) = (one("q", q)?, one("dq", dq)?, one("ddq", ddq)?);
        let mut predictor = self.lock();
        let tau = match step {
            None => predictor.try_torque(q.values(), dq.values(), ddq.values()),
            Some(step) => predictor.torque_after(step, q.values(), dq.values(), ddq.values()),
        }
        .map_err(IntoPyErr::into_py_err)?;
        // The inputs are let go: one of them may be `out`.
        drop((q, dq, ddq));
        let Some(out) = out else { return Ok(PyArray1::from_slice(py, tau)) };
        {
            let mut target =
                out.try_readwrite().map_err(|error| invalid(format!("out: {error}")))?;
            let target =
                target.as_slice_mut().map_err(|_| invalid("out: expected a contiguous array"))?;
            target.copy_from_slice(tau);
        }
        Ok(out)
    }

    fn __repr__(&self) -> String {
        format!("Predictor for {} joints, {}", self.dof, self.purpose())
    }
}

impl Predictor {
    fn lock(&self) -> MutexGuard<'_, core::Predictor> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
