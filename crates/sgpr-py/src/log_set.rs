//! The logs of one robot as a set.

use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use sgpr_core::recording as core;

use crate::detached::detached;
use crate::errors::warn;
use crate::recording::{Recording, require_usable};

/// The logs of one robot, every sample once: it goes wherever a list of recordings goes.
///
/// A log that is a copy of another, under whatever name, is left out; of logs that overlap, the
/// samples that a log before has are left out, as recorders write them that cut a stream into
/// files. Samples are the same if positions and torques of a run of at least fifty are the same
/// numbers. Lists of recordings are taken as such sets by all that learns from them or judges by
/// them, with the same results.
///
/// What filters and derivatives make of the logs is kept with the set, of the two ways of
/// processing that were asked for last: all that takes sets finds the motion of a log once, be it
/// `identify`, `compare`, `diagnose` or what learns. A set so takes up to four times the memory of
/// its logs.
///
/// Parameters
/// ----------
/// recordings : list of Recording
/// whole : bool, default False
///     Every log whole, whatever others hold of it: for predictions of each, not for figures over
///     all.
///
/// Warns
/// -----
/// UserWarning
///     If logs share samples; the sentences are in `notes`, too.
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> logs = sgpr.LogSet([log[:4000], log[4000:]])
/// >>> len(logs), logs.notes
/// (2, [])
/// >>> robot = sgpr.Robot.from_urdf("robot.urdf")
/// >>> model = sgpr.identify(robot, logs)
/// >>> before, after = sgpr.compare(robot, logs, processing=model), sgpr.compare(model, logs)
#[pyclass(module = "sgpr", frozen, sequence)]
pub struct LogSet {
    /// Of the core.
    pub inner: core::LogSet,
}

/// What was given as a set: one, or a list of recordings, of which those with an error are refused.
pub fn log_set(py: Python<'_>, given: &Bound<'_, PyAny>) -> PyResult<core::LogSet> {
    if let Ok(set) = given.cast::<LogSet>() {
        return Ok(set.get().inner.clone());
    }
    let recordings = recordings(given)?;
    Ok(detached(py, || core::LogSet::new(&recordings)))
}

/// The recordings that were given, in memory of their own; those with an error are refused.
pub fn recordings(given: &Bound<'_, PyAny>) -> PyResult<Vec<core::Recording>> {
    let wrong = |found: &Bound<'_, PyAny>| {
        let found = found.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
        let read = if found == "str" || found.ends_with("Path") {
            " (`sgpr.read` reads a file)"
        } else {
            ""
        };
        PyTypeError::new_err(format!(
            "recordings: got {found}, expected a list of Recording or a LogSet{read}"
        ))
    };
    // What it holds was looked at when it was made.
    if let Ok(set) = given.cast::<LogSet>() {
        return Ok(set.get().inner.to_vec());
    }
    if given.is_instance_of::<Recording>() {
        return Err(wrong(given));
    }
    let mut recordings = Vec::new();
    for item in given.try_iter().map_err(|_| wrong(given))? {
        let item = item?;
        let recording = item.cast::<Recording>().map_err(|_| wrong(&item))?.get().inner.clone();
        require_usable(&recording)?;
        recordings.push(recording);
    }
    Ok(recordings)
}

/// Recordings as Python has them.
pub fn as_python(list: &[core::Recording]) -> Vec<Recording> {
    list.iter().map(|recording| recording.clone().into()).collect()
}

#[pymethods]
impl LogSet {
    #[new]
    #[pyo3(signature = (recordings, *, whole=false))]
    fn new(py: Python<'_>, recordings: &Bound<'_, PyAny>, whole: bool) -> PyResult<Self> {
        let recordings = self::recordings(recordings)?;
        let make = if whole { core::LogSet::whole } else { core::LogSet::new };
        let inner = detached(py, || make(&recordings));
        warn(py, inner.notes())?;
        Ok(Self { inner })
    }

    /// The logs, and of overlapping ones the stretches that are their own.
    #[getter]
    fn logs(&self) -> Vec<Recording> {
        as_python(&self.inner)
    }

    /// For each of the logs the index of the one it is of, among those that were given.
    #[getter]
    fn origins(&self) -> Vec<usize> {
        self.inner.origins().to_vec()
    }

    /// What was left out, in sentences.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.inner.notes().to_vec()
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    fn __getitem__(&self, index: isize) -> PyResult<Recording> {
        let index = if index < 0 { index + self.inner.len() as isize } else { index };
        let found = usize::try_from(index).ok().and_then(|index| self.inner.get(index));
        found.map(|log| log.clone().into()).ok_or_else(|| {
            PyIndexError::new_err(format!("log {index} of a set of {}", self.inner.len()))
        })
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(PyTuple::new(py, as_python(&self.inner))?.try_iter()?.into_any())
    }

    /// Its logs make it again: no sample is in two of them. What was said of others is gone.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Vec<Recording>,))> {
        Ok((slf.get_type().getattr("_of")?, (as_python(&slf.get().inner),)))
    }

    #[staticmethod]
    fn _of(logs: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self { inner: core::LogSet::whole(&recordings(logs)?) })
    }

    fn __repr__(&self) -> String {
        let logs: Vec<String> = self
            .inner
            .iter()
            .map(|log| format!("\n  {}, {} samples", log.source(), log.len()))
            .collect();
        format!("LogSet of {} logs{}", logs.len(), logs.concat())
    }
}
