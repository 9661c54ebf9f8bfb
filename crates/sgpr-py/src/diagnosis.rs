//! Which effect a model lacks.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict, PyString};
use sgpr_core::diagnosis as core;
use sgpr_core::effects::{Effect, by_name};
use sgpr_core::model::{LogResidual, TorqueModel};
use sgpr_core::recording as logs;

use crate::compare::Comparison;
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid, warn};
use crate::log_set::{as_python, recordings};
use crate::model::Model;
use crate::progress::listen;
use crate::recording::Recording;
use crate::tables::figure;
use crate::user_effect::{UserEffect, known_effects, registered};

/// Finds out which physical effects a model lacks.
///
/// Every effect of the catalogue is tried at every joint: how much of the leftover torque does it
/// explain beyond what the parameters of the model can take up? What has evidence and lowers the
/// error on blocks of time that were left out is fitted together with all parameters, one effect
/// after the other, and each is checked again at the end.
///
/// Parameters
/// ----------
/// model : Model
///     As identified from `train`.
/// train : list of Recording or LogSet
///     Logs to learn from; the first is enough if it is long.
/// test : list of Recording or LogSet, optional
///     Unseen logs, only for the errors that are reported.
/// effects : list of str or Effect, optional
///     What to look for, by name or an effect of your own; all effects of the library by default.
/// add : list of str, optional
///     Effects to add by hand, without a search: ``torque_ripple@joint_2``, ``payload_change`` (the
///     whole arm), ``wrist_coupling@joint_6,joint_5`` (a joint, driven by another). They are
///     fitted, judged and reported like findings, and stay in ``diagnosis.model`` whatever comes
///     out.
/// progress : callable, optional
///     Called as ``progress(stage, done, total)``; what it raises stops the work, as Ctrl-C does.
/// ranked : callable, optional
///     Called with a list of dicts, the candidates as in diagnosis.json without their
///     probabilities, once all are ranked: long before the search ends, and also if it is stopped
///     after that. What it raises is raised at the end.
///
/// Returns
/// -------
/// Diagnosis
///
/// Raises
/// ------
/// SgprError
///     If the logs cannot be used, or an effect of `add` is not known or cannot act there.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify(robot, [log], effects=["viscous_friction", "rotor_inertia", "torque_offset"])
/// >>> diagnosis = sgpr.diagnose(model, [log], effects=["coulomb_friction"])
/// >>> diagnosis.findings[0].effect
/// 'coulomb_friction'
/// >>> better = model.add(diagnosis.findings[0])
#[pyfunction]
#[pyo3(signature = (model, train, test=None, *, effects=None, add=None, progress=None, ranked=None), text_signature = "(model, \
     train, test=(), *, effects=None, add=None, progress=None, ranked=None)")]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn diagnose(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    train: &Bound<'_, PyAny>,
    test: Option<&Bound<'_, PyAny>>,
    effects: Option<&Bound<'_, PyAny>>,
    add: Option<Vec<String>>,
    progress: Option<Py<PyAny>>,
    ranked: Option<Py<PyAny>>,
) -> PyResult<Diagnosis> {
    let train = Arc::new(recordings(train)?);
    let test = test.map(recordings).transpose()?.unwrap_or_default();
    let (catalogue, own) = catalogue(effects)?;
    let inner = model.get().inner.clone();
    let options = core::DiagnosisOptions::default()
        .with_catalogue(catalogue)
        .with_by_hand(add.unwrap_or_default());
    let refused = Mutex::new(None);
    let tell = |candidates: &[core::Finding]| {
        let Some(ranked) = &ranked else { return };
        let text = candidates.iter().map(core::Finding::to_json).collect::<Vec<_>>().join(",");
        let told = Python::attach(|py| {
            let candidates = py.import("json")?.call_method1("loads", (format!("[{text}]"),))?;
            ranked.call1(py, (candidates,))
        });
        if let Err(error) = told {
            *refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    };
    let result = listen(py, progress, |progress| {
        core::diagnose_with(&inner, &train, &test, &options, progress, &tell)
    });
    if let Some(error) = refused.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    for effect in own {
        if let Some(error) = effect.take_failure() {
            return Err(error);
        }
    }
    let result = result?;
    warn(py, &result.after.clock_notes(&test))?;
    Ok(Diagnosis { inner: Arc::new(result), before: inner, train, test: Arc::new(test) })
}

type Catalogue = (Vec<Arc<dyn Effect>>, Vec<UserEffect>);

fn catalogue(effects: Option<&Bound<'_, PyAny>>) -> PyResult<Catalogue> {
    let (mut catalogue, mut own) = (Vec::<Arc<dyn Effect>>::new(), Vec::new());
    let Some(given) = effects.filter(|given| !given.is_none()) else {
        return Ok((known_effects(), registered()));
    };
    if given.is_instance_of::<PyString>() {
        return Err(PyTypeError::new_err("effects: expected a list of names or Effect"));
    }
    for item in given.try_iter()? {
        let item = item?;
        if let Ok(effect) = item.cast::<UserEffect>() {
            let effect = effect.get().clone();
            own.push(effect.clone());
            catalogue.push(Arc::new(effect));
        } else if let Ok(name) = item.extract::<String>() {
            if let Some(effect) = registered().into_iter().find(|effect| effect.name() == name) {
                own.push(effect.clone());
                catalogue.push(Arc::new(effect));
            } else {
                catalogue.push(by_name(&name).map_err(IntoPyErr::into_py_err)?);
            }
        } else {
            return Err(PyTypeError::new_err(format!(
                "effects: got {}, expected names or Effect",
                item.repr()?
            )));
        }
    }
    Ok((catalogue, own))
}

/// What the residual of a comparison depends on, joint by joint: noise or structure, on which
/// variables, of which shape, since when.
///
/// Parameters
/// ----------
/// model : Model
///     The model that was compared.
/// comparison : Comparison
///     What `compare` returned for it.
///
/// Returns
/// -------
/// list of dict
///     With the keys of `structure` in diagnosis.json: "joint", "rmse", "whiteness" (probability
///     that noise is as far from white), "shares" ("state", "time", "noise"), "inputs", "shape",
///     "change", "dependence", "summary".
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify(sgpr.Robot.from_urdf("robot.urdf"), [log], effects=["viscous_friction"])
/// >>> structure = sgpr.residual_structure(model, sgpr.compare(model, [log]))
/// >>> structure[0]["joint"]
/// 'joint_1'
#[pyfunction]
pub fn residual_structure<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    comparison: &Bound<'py, Comparison>,
) -> PyResult<Bound<'py, PyAny>> {
    let model = model.get().inner.clone();
    let parts = comparison.get().parts(py);
    if parts.iter().any(|part| part.get().dof != model.robot().dof()) {
        return Err(invalid("comparison: it is of another robot than the model"));
    }
    let logs: Vec<&LogResidual> = parts.iter().map(|part| &part.get().inner).collect();
    let found = detached(py, || core::structure_of_logs(&model, &logs));
    of_joints(py, &found)
}

fn of_joints<'py>(py: Python<'py>, list: &[core::JointStructure]) -> PyResult<Bound<'py, PyAny>> {
    let text = list.iter().map(core::JointStructure::to_json).collect::<Vec<_>>().join(",");
    py.import("json")?.call_method1("loads", (format!("[{text}]"),))
}

/// What a diagnosis says.
///
/// `to_dict` has all of it, with the keys of diagnosis.json.
#[pyclass(module = "sgpr", frozen)]
pub struct Diagnosis {
    inner: Arc<core::Diagnosis>,
    /// The model that was diagnosed.
    before: Arc<TorqueModel>,
    train: Arc<Vec<logs::Recording>>,
    test: Arc<Vec<logs::Recording>>,
}

impl Diagnosis {
    fn wrapped(&self, list: &[core::Finding]) -> Vec<Finding> {
        let models = (self.before.clone(), Arc::new(self.inner.after.clone()));
        let finding = |inner: &core::Finding| Finding {
            inner: inner.clone(),
            train: self.train.clone(),
            models: models.clone(),
        };
        list.iter().map(finding).collect()
    }

    fn word(&self) -> &'static str {
        match self.inner.verdict {
            core::Verdict::EffectsFound => "effects_found",
            core::Verdict::NothingMissing => "nothing_missing",
            core::Verdict::UnexplainedStructure => "unexplained_structure",
        }
    }
}

#[pymethods]
impl Diagnosis {
    /// "effects_found", "nothing_missing" or "unexplained_structure".
    #[getter]
    fn verdict(&self) -> &'static str {
        self.word()
    }

    /// Probability that nothing material is missing.
    #[getter]
    fn probability_nothing_missing(&self) -> f64 {
        self.inner.probability_nothing_missing
    }

    /// Probability that something is missing that no known effect explains.
    #[getter]
    fn probability_unexplained(&self) -> f64 {
        self.inner.probability_unexplained
    }

    /// What the diagnosis stands behind, best first.
    #[getter]
    fn findings(&self) -> Vec<Finding> {
        self.wrapped(&self.inner.findings)
    }

    /// Every effect that was tested, best first.
    #[getter]
    fn candidates(&self) -> Vec<Finding> {
        self.wrapped(&self.inner.candidates)
    }

    /// Effects that these logs cannot show: name -> why.
    #[getter]
    fn not_testable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for entry in &self.inner.not_testable {
            dict.set_item(&entry.effect, &entry.why)?;
        }
        Ok(dict)
    }

    /// What the logs could have shown beside the findings, and from which size on: dicts with the
    /// keys of diagnosis.json.
    #[getter]
    fn detectable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.to_dict(py)?.get_item("detectable")
    }

    /// What unexplained structure depends on, in words.
    #[getter]
    fn unexplained(&self) -> Vec<String> {
        self.inner.unexplained.clone()
    }

    /// What the error of the model depends on, joint by joint: dicts with the keys of
    /// diagnosis.json.
    #[getter]
    fn structure<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        of_joints(py, &self.inner.structure)
    }

    /// The same with the findings: what is left.
    #[getter]
    fn left<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        of_joints(py, &self.inner.left)
    }

    /// Formulas for structure that no known effect explains: joint -> formula. Suggestions, not
    /// findings.
    #[getter]
    fn formulas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for formula in &self.inner.formulas {
            dict.set_item(&formula.joint, &formula.text)?;
        }
        Ok(dict)
    }

    /// The motion that would tell the findings from what imitates them: a recording without torque,
    /// with accelerations as channels; None if nothing imitates them.
    #[getter]
    fn next_motion(&self) -> Option<Recording> {
        let robot = self.inner.after.robot();
        self.inner.next_motion().map(|motion| motion.recording(robot, "next experiment").into())
    }

    /// Writes the motion of `next_motion`: a table (.csv, .csv.gz) of time, position, velocity and
    /// acceleration, or an MCAP file (.mcap) with one trajectory_msgs/msg/JointTrajectory message.
    ///
    /// Raises
    /// ------
    /// SgprError
    ///     If there is no such motion.
    fn save_next_motion(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let none = "there is no next experiment: nothing imitates the findings";
        let motion = self.inner.next_motion().ok_or_else(|| invalid(none))?;
        let robot = self.inner.after.robot();
        let mcap = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mcap"));
        let write = || {
            if mcap {
                motion.write_mcap(robot, "/joint_trajectory", &path)
            } else {
                motion.write_csv(robot, &path)
            }
        };
        detached(py, write).map_err(IntoPyErr::into_py_err)
    }

    /// The model with all findings, all parameters refitted; the model itself if there is none.
    #[getter]
    pub fn model(&self) -> Model {
        self.inner.after.clone().into()
    }

    /// All of it as plain data, with the keys of diagnosis.json.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("json")?.call_method1("loads", (self.inner.to_json(),))
    }

    /// A Plotly figure of the error of each joint, before and after each finding.
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_diagnosis", (slf,))
    }

    /// Writes the page of `sgpr diagnose`: the answer, where the model fails, what is missing, what
    /// is left.
    fn report(slf: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let py = slf.py();
        let own = slf.get();
        let wrapped = |recordings: &[logs::Recording]| -> PyResult<Vec<Py<Recording>>> {
            recordings
                .iter()
                .map(|recording| Py::new(py, Recording::from(recording.clone())))
                .collect()
        };
        let before = Model { inner: own.before.clone(), report: None };
        let arguments = (slf, path, before, wrapped(&own.train)?, wrapped(&own.test)?);
        py.import("sgpr._pages")?.call_method1("diagnosis_page", arguments).map(drop)
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("diagnosis_html", (slf,))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let Self { inner, before, train, test } = slf.get();
        let motions: Vec<_> = inner.next_experiment.iter().map(|one| &one.motion).collect();
        let motions =
            serde_json::to_string(&motions).map_err(|error| invalid(error.to_string()))?;
        let after = as_model(&Arc::new(inner.after.clone()));
        let parts =
            (inner.to_json(), motions, as_model(before), after, as_python(train), as_python(test));
        Ok((slf.get_type().getattr("_from_parts")?, parts))
    }

    #[staticmethod]
    fn _from_parts(
        text: &str,
        motions: &str,
        before: &Model,
        after: &Model,
        train: &Bound<'_, PyAny>,
        test: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let motions = serde_json::from_str(motions).map_err(|error| not_one(error.to_string()))?;
        let (before, after) = (before.inner.clone(), after.inner.as_ref().clone());
        let inner = core::Diagnosis::from_json(text, before.as_ref().clone(), after, motions)
            .map_err(not_one)?;
        let [train, test] = [train, test].map(recordings);
        Ok(Self { inner: Arc::new(inner), before, train: Arc::new(train?), test: Arc::new(test?) })
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let lines = slf.py().import("sgpr._views")?.call_method1("diagnosis_lines", (slf,))?;
        Ok(lines.extract::<Vec<String>>()?.join("\n"))
    }
}

/// Both models, and the logs, of what is pickled.
type Parts = (String, String, Model, Model, Vec<Recording>, Vec<Recording>);
type FindingParts = (String, Model, Model, Vec<Recording>);

fn as_model(model: &Arc<TorqueModel>) -> Model {
    Model { inner: model.clone(), report: None }
}

fn not_one(why: String) -> PyErr {
    invalid(format!("not what was pickled: {why}"))
}

fn describe(finding: &core::Finding) -> String {
    let at = if finding.joints.is_empty() {
        String::new()
    } else {
        format!(" at {}", finding.joints.join(", "))
    };
    format!("{}{at}, probability {:.2}", finding.effect, finding.probability)
}

/// An effect that the diagnosis stands behind, or one that was tested.
#[pyclass(module = "sgpr", frozen)]
pub struct Finding {
    inner: core::Finding,
    train: Arc<Vec<logs::Recording>>,
    /// Without and with what was found.
    models: (Arc<TorqueModel>, Arc<TorqueModel>),
}

impl Finding {
    /// The same, to be fitted to other logs.
    pub fn on(&self, train: &Bound<'_, PyAny>) -> PyResult<Self> {
        let models = self.models.clone();
        Ok(Self { inner: self.inner.clone(), train: Arc::new(recordings(train)?), models })
    }

    /// `model` with this effect on top.
    pub fn added_to(&self, py: Python<'_>, model: &Model) -> PyResult<Model> {
        if self.inner.terms.is_empty() {
            return Err(invalid(format!(
                "{}: only what was found can be added, not a mere candidate",
                self.inner.effect
            )));
        }
        let model = model.inner.clone();
        let added = detached(py, || core::add(&model, &[&self.inner], &self.train));
        added.map(Model::from).map_err(IntoPyErr::into_py_err)
    }
}

#[pymethods]
impl Model {
    /// This model with an effect on top of it, all parameters refitted. The line that `history`
    /// gains says what it brought.
    ///
    /// Parameters
    /// ----------
    /// finding : Finding or str
    ///     What `diagnose` found; or an effect by hand, ``torque_ripple@joint_2`` (`diagnose` with
    ///     ``add`` says more of it).
    /// train : list of Recording or LogSet, optional
    ///     Logs to fit to: for a finding those in which it was found; for an effect by hand they
    ///     must be given.
    #[pyo3(signature = (finding, train=None))]
    fn add(
        slf: &Bound<'_, Self>,
        finding: &Bound<'_, PyAny>,
        train: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = slf.py();
        match (finding.cast::<Finding>(), train) {
            (Ok(finding), None) => finding.get().added_to(py, slf.get()),
            (Ok(finding), Some(train)) => finding.get().on(train)?.added_to(py, slf.get()),
            (Err(_), Some(train)) => {
                let text = finding.extract::<String>().map_err(|_| {
                    PyTypeError::new_err(
                        "finding: expected a Finding, or text such as effect@joint",
                    )
                })?;
                let added = diagnose(py, slf, train, None, None, Some(vec![text]), None, None)?;
                Ok(added.model())
            }
            (Err(_), None) => {
                Err(invalid("train: an effect by hand is fitted to logs, which must be given"))
            }
        }
    }
}

#[pymethods]
impl Finding {
    /// Effect.
    #[getter]
    fn effect(&self) -> &str {
        &self.inner.effect
    }

    /// Names of its joints; none for an effect of the whole arm.
    #[getter]
    fn joints(&self) -> Vec<String> {
        self.inner.joints.clone()
    }

    /// Probability that it is there.
    #[getter]
    fn probability(&self) -> f64 {
        self.inner.probability
    }

    /// Log of the Bayes factor against the same model without it.
    #[getter]
    fn score(&self) -> f64 {
        self.inner.score
    }

    /// Name -> (value, standard deviation or None, unit).
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for parameter in &self.inner.parameters {
            dict.set_item(&parameter.name, (parameter.value, parameter.std, &parameter.unit))?;
        }
        Ok(dict)
    }

    /// Error per joint without it, on blocks of time that no fit has seen, N·m (N).
    #[getter]
    fn rmse_before(&self) -> core::ByJoint {
        self.inner.rmse_before.clone()
    }

    /// The same with it.
    #[getter]
    fn rmse_after(&self) -> core::ByJoint {
        self.inner.rmse_after.clone()
    }

    /// Largest fall of that error on a joint, percent of it; 0 for a candidate without evidence.
    #[getter]
    fn error_gained_percent(&self) -> f64 {
        self.inner.error_gained_percent
    }

    /// One sentence.
    #[getter]
    fn evidence(&self) -> &str {
        &self.inner.evidence
    }

    /// Effects that these logs tell from it badly.
    #[getter]
    fn confusable_with(&self) -> Vec<String> {
        self.inner.confusable_with.clone()
    }

    /// What would tell them apart.
    #[getter]
    fn separating_experiment(&self) -> &str {
        &self.inner.separating_experiment
    }

    /// A Plotly figure of the error of each joint without and with the effect.
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_finding", (slf,))
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("finding_html", (slf,))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, FindingParts)> {
        let Self { inner, train, models: (before, after) } = slf.get();
        let parts = (inner.to_json(), as_model(before), as_model(after), as_python(train));
        Ok((slf.get_type().getattr("_from_parts")?, parts))
    }

    #[staticmethod]
    fn _from_parts(
        text: &str,
        before: &Model,
        after: &Model,
        train: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let models = (before.inner.clone(), after.inner.clone());
        let inner = core::Finding::from_json(text, &models.0, &models.1).map_err(not_one)?;
        Ok(Self { inner, train: Arc::new(recordings(train)?), models })
    }

    fn __repr__(&self) -> String {
        let parameters = self.inner.parameters.iter().map(|p| {
            let spread = p.std.map_or(String::new(), |std| format!(" ± {}", figure(std)));
            format!("\n  {} = {}{spread} {}", p.name, figure(p.value), p.unit)
        });
        format!("Finding({}){}", describe(&self.inner), parameters.collect::<String>())
    }
}
