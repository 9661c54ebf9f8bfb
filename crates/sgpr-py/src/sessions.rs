//! What changed between sessions of one arm.

use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::model::{self as core, SessionCause, SessionTest};
use sgpr_core::recording::Recording;

use crate::convert::array;
use crate::errors::{invalid, warn};
use crate::identification::Arguments;
use crate::log_set::recordings;
use crate::model::Model;
use crate::progress::listen;
use crate::robot::Robot;

/// What sessions of one arm have in common, and what changed between them.
///
/// Made by `compare_sessions`; never changes.
#[pyclass(module = "sgpr", frozen)]
pub struct SessionComparison {
    inner: core::SessionComparison,
}

#[pymethods]
impl SessionComparison {
    /// Names of the sessions.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.inner.names.clone()
    }

    /// What changed, a sentence each; or that nothing did.
    #[getter]
    fn sentences(&self) -> Vec<String> {
        self.inner.sentences()
    }

    /// All that the logs can test: "cause" ("tool", "friction", "offset" or "gain"), "joint" (None
    /// for the tool), "values" and "standard_deviations" of each session with their "unit",
    /// "chance" (the probability that chance makes sessions differ as much), "saved_percent" and
    /// "saved_percent_standard_error" (by how much values of its own for each session lower the
    /// error on parts that were left out, squared), "changed".
    #[getter]
    fn tests<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let robot = self.inner.models[0].robot();
        let of = |test: &SessionTest| {
            let (cause, joint) = match test.cause {
                SessionCause::Tool => ("tool", None),
                SessionCause::Friction { joint } => ("friction", Some(joint)),
                SessionCause::Offset { joint } => ("offset", Some(joint)),
                SessionCause::Gain { joint } => ("gain", Some(joint)),
            };
            let count = test.values.len();
            let dict = PyDict::new(py);
            dict.set_item("cause", cause)?;
            dict.set_item("joint", joint.map(|joint| &robot.joints()[joint].name))?;
            dict.set_item("unit", test.unit)?;
            dict.set_item("values", array(py, &[count], test.values.clone())?)?;
            dict.set_item("standard_deviations", array(py, &[count], test.deviations.clone())?)?;
            dict.set_item("chance", test.chance)?;
            dict.set_item("saved_percent", 100.0 * test.judgement.gain)?;
            dict.set_item("saved_percent_standard_error", 100.0 * test.judgement.standard_error)?;
            dict.set_item("changed", test.changed)?;
            Ok(dict)
        };
        self.inner.tests.iter().map(of).collect()
    }

    /// The model of a session: all is common to the sessions but what changed. A gain that changed
    /// is not in it.
    fn model(&self, name: &str) -> PyResult<Model> {
        let Some(session) = self.inner.names.iter().position(|other| other == name) else {
            return Err(invalid(format!(
                "name: got '{name}', the sessions are {}",
                self.inner.names.join(", ")
            )));
        };
        Ok(Model { inner: Arc::new(self.inner.models[session].clone()), report: None })
    }

    fn __repr__(&self) -> String {
        format!(
            "SessionComparison of {}: {}",
            self.inner.names.join(", "),
            self.inner.sentences().join("; ")
        )
    }
}

/// What changed between sessions of one robot: friction, offset and gain of each joint, and what
/// the last link carries.
///
/// All other parameters are common to the sessions. Beside the effects there is a torque of any
/// smooth shape in each joint's position, speed and load, common as well, so that what the model
/// lacks does not look like a change where sessions move differently. Something changed if sessions
/// differ by more than parts of two seconds of one session do, and if values of each session's own
/// predict parts that were left out better.
///
/// Parameters
/// ----------
/// robot : Robot
/// sessions : dict of str to list of Recording or LogSet
///     Logs of each session; changes are told against the first one.
/// **options
///     As those of `identify`: `effects`, each a linear function of the present motion and at every
///     joint, `cutoff_hz`, `filter_order`, `differentiation`, `torque_band`, `decimation`,
///     `standstill_speed`, `turn_margin`, `progress`.
///
/// Returns
/// -------
/// SessionComparison
///
/// Raises
/// ------
/// IdentificationError
///     If there are fewer than two sessions, one of them has fewer than three parts of two seconds
///     in motion, or an effect has constants or a memory.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> halves = {"before": [log.between(0, 10)], "after": [log.between(10, 20)]}
/// >>> sgpr.compare_sessions(robot, halves).sentences
/// ['nothing changed between the sessions that these logs can show']
#[pyfunction]
#[pyo3(signature = (robot, sessions, **options), text_signature = "(robot, sessions, **options)")]
pub fn compare_sessions(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    sessions: &Bound<'_, PyDict>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<SessionComparison> {
    let Arguments { options, progress } = Arguments::of_equations(robot.get(), options)?;
    let given: Vec<(String, Vec<Recording>)> = sessions
        .iter()
        .map(|(name, logs)| Ok((name.extract::<String>()?, recordings(&logs)?)))
        .collect::<PyResult<_>>()?;
    let robot = &robot.get().inner;
    let inner = listen(py, progress, |progress| {
        core::compare_sessions(robot, &given, &options.effects, &options.conditioning, progress)
    })?;
    warn(py, &inner.notes)?;
    Ok(SessionComparison { inner })
}
