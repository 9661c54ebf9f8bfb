//! A predictor, sample by sample, beside logs.

use std::sync::Arc;

use pyo3::prelude::*;
use sgpr_core::model::{self as core, StreamedMotion};

use crate::compare::{Compared, Comparison, processing_of, wrong_type};
use crate::detached::detached;
use crate::errors::IntoPyErr;
use crate::log_set::log_set;
use crate::model::Model;
use crate::semi_parametric::semi_parametric;

/// Compares what a predictor says one sample after the other with recordings: the torques of
/// `Model.predictor(rate_hz=..., purpose="expected_measurement")`, reset at the start of every
/// stretch.
///
/// Parameters
/// ----------
/// model : Model or SemiParametricModel
/// recordings : list of Recording or LogSet
/// processing : Model or Processing, optional
///     As for `compare`; not for a SemiParametricModel.
/// causal : bool
///     The predictor is given positions as logged through the filter in one pass, and their
///     differences from the samples before: what a controller knows that measures positions alone.
///     The filter makes the motion late. By default it is given the motion of `compare`, filtered
///     without delay, which needs samples that come later.
///
/// Returns
/// -------
/// Comparison
///     In the same band and over the same samples as that of `compare`.
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify(sgpr.Robot.from_urdf("robot.urdf"), [log])
/// >>> streamed, batch = sgpr.compare_streaming(model, [log]), sgpr.compare(model, [log])
/// >>> bool(np.allclose(streamed.rmse, batch.rmse))
/// True
#[pyfunction]
#[pyo3(signature = (model, recordings, *, processing=None, causal=false))]
pub fn compare_streaming(
    py: Python<'_>,
    model: &Bound<'_, PyAny>,
    recordings: &Bound<'_, PyAny>,
    processing: Option<&Bound<'_, PyAny>>,
    causal: bool,
) -> PyResult<Comparison> {
    let motion = if causal { StreamedMotion::Causal } else { StreamedMotion::Filtered };
    let processing = processing.map(processing_of).transpose()?.flatten();
    let logs = log_set(py, recordings)?;
    let (comparison, model) = if let Ok(model) = model.cast::<Model>() {
        let model = model.get().inner.clone();
        let found =
            detached(py, || core::compare_streaming(&model, &logs, processing.as_ref(), motion));
        (found.map_err(IntoPyErr::into_py_err)?, model)
    } else if let Some(fitted) = semi_parametric(model)? {
        let fitted = fitted.get().inner.clone();
        let found = detached(py, || fitted.compare_streaming(&logs, motion));
        (found.map_err(IntoPyErr::into_py_err)?, Arc::new(fitted.physics().clone()))
    } else {
        return Err(wrong_type("model", model, "Model or SemiParametricModel"));
    };
    Comparison::new(py, comparison, Compared { model, logs })
}
