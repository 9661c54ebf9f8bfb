//! Torques of a log beside those of a model.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use sgpr_core::model as core;

use crate::convert::{array, view};
use crate::detached::detached;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Torques of one stretch of a log. Arrays are (N, n) unless said otherwise, read-only.
#[pyclass(module = "sgpr", frozen)]
pub struct LogResidual {
    /// Of the core.
    pub inner: core::LogResidual,
    /// Number of joints.
    pub dof: usize,
}

fn rows<'py, T: numpy::Element>(
    log: &Bound<'py, LogResidual>,
    pick: impl FnOnce(&LogResidual) -> &[T],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    view(log, &[log.get().inner.time().len(), log.get().dof], pick)
}

impl LogResidual {
    /// A read-only array, (N, n), of its own memory.
    fn made<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        values: Vec<T>,
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let made = array(py, &[self.inner.time().len(), self.dof], values)?;
        made.getattr("flags")?.setattr("writeable", false)?;
        Ok(made)
    }
}

#[pymethods]
impl LogResidual {
    /// Log.
    #[getter]
    fn source(&self) -> &str {
        self.inner.source()
    }

    /// Time stamps, (N,), ns.
    #[getter]
    fn time_ns<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArrayDyn<i64>>> {
        view(slf, &[slf.get().inner.time().len()], |log| log.inner.time())
    }

    /// Time since the first sample of the stretch, (N,), s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let time = self.inner.time();
        let start = time.first().copied().unwrap_or_default();
        array(py, &[time.len()], time.iter().map(|stamp| (stamp - start) as f64 * 1e-9).collect())
    }

    /// Torque as logged, N·m (N).
    #[getter]
    fn measured<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        rows(slf, |log| log.inner.measured())
    }

    /// Torque by the model, N·m (N).
    #[getter]
    fn predicted<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        rows(slf, |log| &log.inner.predicted)
    }

    /// Measured, in the band of the model: filtered when it is asked for.
    #[getter]
    fn measured_in_band<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.made(py, detached(py, || self.inner.measured_in_band()))
    }

    /// Predicted, in the band of the model: filtered when it is asked for.
    #[getter]
    fn predicted_in_band<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.made(py, detached(py, || self.inner.predicted_in_band()))
    }

    /// Which of them count: the joint moves, and the ends of the stretch are far.
    #[getter]
    fn counted<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
        self.made(
            py,
            (0..self.inner.predicted.len()).map(|entry| self.inner.counts(entry)).collect(),
        )
    }

    /// Sampling rate of the stretch, Hz.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.inner.motion.rate_hz
    }

    /// Filtered positions, rad (m).
    #[getter]
    fn q<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        rows(slf, |log| &log.inner.motion.q)
    }

    /// Their first derivative; zero while a joint rests.
    #[getter]
    fn dq<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        rows(slf, |log| &log.inner.motion.dq)
    }

    /// Their second derivative; zero while a joint rests.
    #[getter]
    fn ddq<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        rows(slf, |log| &log.inner.motion.ddq)
    }

    fn __repr__(&self) -> String {
        format!("LogResidual('{}', {} samples)", self.inner.source(), self.inner.time().len())
    }
}
