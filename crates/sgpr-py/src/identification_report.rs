//! How an identification went.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::identification::Essential;
use sgpr_core::model as core;
use sgpr_core::signal::CutoffChoice as CoreChoice;

use crate::convert::{array, view};

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// How an identification went, beside the model.
#[pyclass(module = "sgpr", frozen)]
pub struct IdentificationReport {
    samples: usize,
    singular_values: Vec<f64>,
    warnings: Vec<String>,
    cutoff_choices: Vec<Py<CutoffChoice>>,
    essential: Option<Essential>,
    forecast: Option<core::Forecast>,
}

impl IdentificationReport {
    /// Of the core.
    pub fn new(py: Python<'_>, report: core::IdentificationReport) -> PyResult<Self> {
        let core::IdentificationReport {
            cutoff_choices,
            singular_values,
            warnings,
            samples,
            essential,
            forecast,
            ..
        } = report;
        let cutoff_choices =
            cutoff_choices.into_iter().map(|inner| Py::new(py, CutoffChoice { inner }));
        Ok(Self {
            samples,
            singular_values,
            warnings,
            cutoff_choices: cutoff_choices.collect::<PyResult<_>>()?,
            essential,
            forecast,
        })
    }
}

#[pymethods]
impl IdentificationReport {
    /// Samples in the logs.
    #[getter]
    fn samples(&self) -> usize {
        self.samples
    }

    /// Singular values of the observation matrix, largest first.
    #[getter]
    fn singular_values<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &[slf.get().singular_values.len()], |report| &report.singular_values)
    }

    /// Sentences that the user should read.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The spectra and the cut-off that they suggest, for each log.
    #[getter]
    fn cutoff_choices(&self, py: Python<'_>) -> Vec<Py<CutoffChoice>> {
        self.cutoff_choices.iter().map(|choice| choice.clone_ref(py)).collect()
    }

    /// Which base parameters the data support, or None if that was not asked for: indices "kept"
    /// and "dropped", least missed first; "rise" of the squared residual when each went, and its
    /// "limit", in units of the variance; "validation", the error on data kept out of the fit with
    /// 0, 1, 2, ... dropped, relative to none.
    #[getter]
    fn essential<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(found) = &self.essential else { return Ok(None) };
        let dict = PyDict::new(py);
        dict.set_item("kept", found.kept.clone())?;
        dict.set_item("dropped", found.dropped.iter().map(|gone| gone.base).collect::<Vec<_>>())?;
        dict.set_item("rise", found.dropped.iter().map(|gone| gone.rise).collect::<Vec<_>>())?;
        dict.set_item("limit", found.dropped.iter().map(|gone| gone.limit).collect::<Vec<_>>())?;
        dict.set_item("validation", found.validation.clone())?;
        Ok(Some(dict))
    }

    /// How much data is enough, or None if that was not asked for.
    ///
    /// Parameters that are not known exactly make the torque of other motion uncertain: motion in
    /// which every joint has a position, speed and acceleration that it had in the logs, or on the
    /// way back, each joint at another time. "standard_deviation", `[k, n]`, is that standard
    /// deviation, N·m (N), after "seconds", `[k]`, of logs: those that there are, then 2, 4, 8 and
    /// 16 times as long. It is enough if it is a third of "noise", `[n]`, what the model leaves of
    /// the torque: then it adds a twentieth to the error. "seconds_to_go" of such motion are needed
    /// for that, None if sixteen times the logs are not enough for some joint, whose "enough_at" is
    /// None, too; "advice" says which motion would free parameters that the logs do not show.
    ///
    /// What the model has no law for is not in it, and a few seconds of motion say little of what
    /// is not in them: on three real arms eight of ten joints were off by 0.3 to 3 times what was
    /// said.
    #[getter]
    fn forecast<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.forecast.as_ref().map(|found| forecast_dict(py, found)).transpose()
    }

    fn __repr__(&self) -> String {
        let warnings: Vec<String> =
            self.warnings.iter().map(|warning| format!("\n  {warning}")).collect();
        format!(
            "IdentificationReport, {} samples, {} warnings{}",
            self.samples,
            warnings.len(),
            warnings.concat()
        )
    }
}

/// A forecast of how surely torque is predicted after more logs.
pub fn forecast_dict<'py>(py: Python<'py>, found: &core::Forecast) -> PyResult<Bound<'py, PyDict>> {
    let (dict, n) = (PyDict::new(py), found.noise.len());
    let enough: Vec<Option<f64>> = (0..n).map(|joint| found.enough_at(joint)).collect();
    dict.set_item("seconds", array(py, &[found.seconds.len()], found.seconds.clone())?)?;
    dict.set_item(
        "standard_deviation",
        array(py, &[found.seconds.len(), n], found.deviation.concat())?,
    )?;
    dict.set_item("noise", array(py, &[n], found.noise.clone())?)?;
    dict.set_item("enough_at", enough)?;
    dict.set_item("seconds_to_go", found.seconds_to_go())?;
    dict.set_item("advice", found.advice.clone())?;
    Ok(dict)
}

/// The cut-off that the spectra of a log suggest.
#[pyclass(module = "sgpr", frozen)]
pub struct CutoffChoice {
    inner: CoreChoice,
}

#[pymethods]
impl CutoffChoice {
    /// The cut-off for all joints, Hz: the highest of theirs.
    #[getter]
    fn cutoff_hz(&self) -> f64 {
        self.inner.cutoff_hz
    }

    /// Where the spectrum of each joint's acceleration is lowest, between motion and noise, (n,),
    /// Hz; zero for a joint whose motion cannot be seen: it is held, or moves at constant speed.
    #[getter]
    fn joint_hz<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &[slf.get().inner.joint_hz.len()], |choice| &choice.inner.joint_hz)
    }

    /// Standard deviation of the white noise of each joint's position, (n,), rad (m).
    #[getter]
    fn noise<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &[slf.get().inner.noise.len()], |choice| &choice.inner.noise)
    }

    /// Frequencies of the spectra, (F,), Hz.
    #[getter]
    fn frequency_hz<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let frequencies =
            self.inner.spectra.first().map_or(vec![], |spectrum| spectrum.frequency_hz.clone());
        array(py, &[frequencies.len()], frequencies)
    }

    /// Power spectral density of each joint's position, (n, F), rad²/Hz (m²/Hz).
    #[getter]
    fn density<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let spectra = &self.inner.spectra;
        let length = spectra.first().map_or(0, |spectrum| spectrum.density.len());
        let densities =
            spectra.iter().flat_map(|spectrum| spectrum.density.iter().copied()).collect();
        array(py, &[spectra.len(), length], densities)
    }

    fn __repr__(&self) -> String {
        format!("CutoffChoice({:.2} Hz)", self.inner.cutoff_hz)
    }
}
