//! An effect that is a Python function.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::effects::{About, Context, Effect, EffectParameter, Entry, Site};

use crate::convert::texts;
use crate::errors::invalid;

/// An effect of your own, to be looked for by `diagnose` like those of the library.
///
/// Parameters
/// ----------
/// name : str
///     Its name in results.
/// function : callable
///     ``function(joint, q, dq, ddq)`` with the joint's number and arrays of shape (N, n) in rad, rad/s, rad/s² (m);
///     returns what the torque of that joint changes by per unit of each parameter: (N,) or (N, number of parameters).
/// parameters : list of str
///     Symbols of the parameters that are fitted.
/// summary : str, optional
///     One sentence for a person.
/// unit : str, optional
///     Unit of the parameters.
///
/// Examples
/// --------
/// >>> def column(joint, q, dq, ddq):
/// ...     return np.tanh(dq[:, joint] / 0.1)
/// >>> smooth = sgpr.Effect("smooth_friction", column, ["a"], unit="N·m")
/// >>> smooth.name
/// 'smooth_friction'
#[pyclass(name = "Effect", module = "sgpr", frozen)]
#[derive(Clone)]
pub struct UserEffect {
    name: String,
    summary: String,
    parameters: Vec<EffectParameter>,
    function: Arc<Py<PyAny>>,
    failure: Arc<Mutex<Option<PyErr>>>,
}

impl fmt::Debug for UserEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Effect({})", self.name)
    }
}

#[pymethods]
impl UserEffect {
    #[new]
    #[pyo3(signature = (name, function, parameters, *, summary=None, unit=""))]
    fn new(
        name: String,
        function: Py<PyAny>,
        parameters: &Bound<'_, PyAny>,
        summary: Option<String>,
        unit: &str,
    ) -> PyResult<Self> {
        if sgpr_core::effects::by_name(&name).is_ok() {
            return Err(invalid(format!("name: the library has an effect `{name}` already")));
        }
        let symbols = texts("parameters", parameters)?;
        if symbols.is_empty() {
            return Err(invalid("parameters: an effect has at least one"));
        }
        // The catalogue's names live as long as the program; so do those of the few effects that a user makes.
        let keep = |text: &str| -> &'static str { Box::leak(text.to_string().into_boxed_str()) };
        let unit = keep(unit);
        let parameters = symbols.iter().map(|symbol| EffectParameter::signed(keep(symbol), unit, unit)).collect();
        let summary = summary.unwrap_or_else(|| format!("Effect of the user: {name}."));
        Ok(Self { name, summary, parameters, function: Arc::new(function), failure: Arc::default() })
    }

    /// Its name in results.
    #[getter(name)]
    fn py_name(&self) -> &str {
        &self.name
    }

    fn __repr__(&self) -> String {
        format!("{self:?}")
    }
}

impl UserEffect {
    /// What the function raised, if it did.
    pub fn failure(&self) -> Option<PyErr> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn call(&self, joint: usize, context: &Context<'_>, out: &mut [Vec<f64>]) -> PyResult<()> {
        Python::attach(|py| {
            let (samples, n, width) = (context.len(), context.dof(), out.len());
            let array = |values: &[f64]| -> PyResult<Bound<'_, PyAny>> {
                let rows: Vec<Vec<f64>> = values.chunks_exact(n).map(<[f64]>::to_vec).collect();
                Ok(PyArray2::from_vec2(py, &rows).map_err(|error| invalid(error.to_string()))?.into_any())
            };
            let given = (joint, array(context.q)?, array(context.dq)?, array(context.ddq)?);
            let result = self.function.bind(py).call1(given)?;
            let kwargs = PyDict::new(py);
            kwargs.set_item("dtype", "float64")?;
            let result = py.import("numpy")?.call_method("asarray", (result,), Some(&kwargs))?;
            let columns: PyReadonlyArrayDyn<'_, f64> = result.extract()?;
            let shape = columns.shape().to_vec();
            if shape != [samples, width] && !(width == 1 && shape == [samples]) {
                return Err(invalid(format!("{}: got {shape:?}, expected ({samples}, {width})", self.name)));
            }
            for (index, value) in columns.as_array().iter().enumerate() {
                if !value.is_finite() {
                    return Err(invalid(format!("{}: a value in row {} is not finite", self.name, index / width)));
                }
                out[index % width][index / width] = *value;
            }
            Ok(())
        })
    }
}

impl Effect for UserEffect {
    fn name(&self) -> &str {
        &self.name
    }

    fn summary(&self) -> &str {
        &self.summary
    }

    fn about(&self) -> About<'_> {
        About { formula: "a function of the user", ..About::default() }
    }

    fn parameters(&self) -> &[EffectParameter] {
        &self.parameters
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn trajectory_columns(&self, site: Site, context: &Context<'_>, _: &[f64], out: &mut [Vec<f64>]) {
        let joint = site.joint().unwrap_or_default();
        if let Err(error) = self.call(joint, context, out) {
            out.iter_mut().for_each(|column| column.fill(0.0));
            self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }
}
