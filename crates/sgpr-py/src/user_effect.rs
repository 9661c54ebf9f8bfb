//! An effect that is a Python function.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::effects::{
    About, Constant, Context, Effect, EffectParameter, Entry, Needs, Scale, Site, registry,
};

use crate::convert::texts;
use crate::errors::invalid;

/// An effect of your own, to be looked for by `diagnose` like those of the library.
///
/// Parameters
/// ----------
/// name : str
///     Its name in results.
/// function : callable
///     ``function(joint, q, dq, ddq)`` with the joint's number and arrays of shape (N, n) in rad,
///     rad/s, rad/s² (m); returns what the torque of that joint changes by per unit of each
///     parameter: (N,) or (N, number of parameters). Constants come as keywords, channels as the
///     keyword `channels`, a dict of arrays.
/// parameters : list of str
///     Symbols of the parameters that are fitted; the torque is linear in them.
/// constants : dict, optional
///     Constants that enter nonlinearly: symbol -> (lowest, highest) or (lowest, highest, unit).
///     They are searched within these bounds, in their logarithm if the lowest is above zero.
/// channels : list of str, optional
///     What the function needs beside the motion: "time" (N,) in s, "load" (N, n), the torque of
///     the model without effects at single joints, in N·m (N), or the name of a channel of the logs
///     (N,). Logs that lack one cannot test the effect.
/// summary : str, optional
///     One sentence for a person.
/// unit : str, optional
///     Unit of the parameters.
///
/// Notes
/// -----
/// A predictor (`Model.predictor`) calls the function with arrays of one row, sample by
/// sample; that takes memory. A function whose value in a row depends on other rows (a difference,
/// a filter, a mean) cannot be streamed, and the predictor is refused; so is one that needs a
/// channel other than "time" and "load".
///
/// Examples
/// --------
/// >>> def column(joint, q, dq, ddq, v):
/// ...     return np.tanh(dq[:, joint] / v)
/// >>> smooth = sgpr.Effect("smooth_friction", column, ["a"], constants={"v": (0.01, 1.0, "rad/s")}, unit="N·m")
/// >>> smooth.name
/// 'smooth_friction'
#[pyclass(name = "Effect", module = "sgpr", frozen)]
#[derive(Clone)]
pub struct UserEffect {
    name: String,
    summary: String,
    parameters: Vec<EffectParameter>,
    constants: Vec<Constant>,
    channels: Vec<String>,
    function: Arc<Py<PyAny>>,
    failure: Arc<Mutex<Option<PyErr>>>,
}

impl fmt::Debug for UserEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Effect({})", self.name)
    }
}

/// Effects that files may name.
static REGISTERED: Mutex<Vec<UserEffect>> = Mutex::new(Vec::new());

/// Makes an effect of your own known: files of models that have it are read, and `diagnose` looks
/// for it by default.
///
/// Parameters
/// ----------
/// effect : Effect
///     Takes the place of one of the same name that was registered before.
///
/// Examples
/// --------
/// >>> spring = sgpr.Effect("my_spring", lambda joint, q, dq, ddq: q[:, joint], ["k"], unit="N·m/rad")
/// >>> sgpr.register_effect(spring)
#[pyfunction]
pub fn register_effect(effect: &Bound<'_, UserEffect>) {
    let mut all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    all.retain(|known| known.name != effect.get().name);
    all.push(effect.get().clone());
}

/// Takes back what `register_effect` said of an effect.
///
/// Parameters
/// ----------
/// effect : Effect
///     The effect, or another of its name; nothing happens if there is none.
///
/// Examples
/// --------
/// >>> spring = sgpr.Effect("my_spring", lambda joint, q, dq, ddq: q[:, joint], ["k"], unit="N·m/rad")
/// >>> sgpr.unregister_effect(spring)
#[pyfunction]
pub fn unregister_effect(effect: &Bound<'_, UserEffect>) {
    let mut all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    all.retain(|known| known.name != effect.get().name);
}

/// The effects that were registered.
pub fn registered() -> Vec<UserEffect> {
    REGISTERED.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// All effects that files may name: the library's and those registered.
pub fn known_effects() -> Vec<Arc<dyn Effect>> {
    let own = registered().into_iter().map(|effect| Arc::new(effect) as Arc<dyn Effect>);
    registry().into_iter().chain(own).collect()
}

/// Names that the call of a function has for itself.
const TAKEN: [&str; 5] = ["joint", "q", "dq", "ddq", "channels"];

/// Shares of the range from which a search starts.
const STARTS: [f64; 4] = [0.125, 0.375, 0.625, 0.875];

/// The catalogue's names live as long as the program; so do those of the few effects that a user
/// makes.
fn keep(text: &str) -> &'static str {
    Box::leak(text.to_string().into_boxed_str())
}

fn constant(symbol: &str, given: &Bound<'_, PyAny>) -> PyResult<Constant> {
    let wrong = || {
        invalid(format!("constants: `{symbol}` needs (lowest, highest) or (lowest, highest, unit)"))
    };
    let (low, high, unit) = match given.extract::<(f64, f64)>() {
        Ok((low, high)) => (low, high, String::new()),
        Err(_) => given.extract::<(f64, f64, String)>().map_err(|_| wrong())?,
    };
    if TAKEN.contains(&symbol) {
        return Err(invalid(format!(
            "constants: `{symbol}` is an argument of the function already"
        )));
    }
    if !(low.is_finite() && high.is_finite() && low < high) {
        return Err(invalid(format!(
            "constants: `{symbol}` got {low} to {high}, expected a lowest below a highest value"
        )));
    }
    let unit = keep(&unit);
    let (scale, at): (Scale, &dyn Fn(f64) -> f64) = if low > 0.0 {
        (Scale::Logarithmic, &|share: f64| low * (high / low).powf(share))
    } else {
        (Scale::Linear(0.1 * (high - low)), &|share: f64| low + share * (high - low))
    };
    let grid: &'static [f64] = Box::leak(STARTS.map(at).to_vec().into_boxed_slice());
    Ok(Constant::new(keep(symbol), [unit, unit], [low, high], scale, grid))
}

#[pymethods]
impl UserEffect {
    #[new]
    #[pyo3(signature = (name, function, parameters, *, constants=None, channels=None, summary=None, unit=""))]
    fn new(
        name: String,
        function: Py<PyAny>,
        parameters: &Bound<'_, PyAny>,
        constants: Option<&Bound<'_, PyDict>>,
        channels: Option<&Bound<'_, PyAny>>,
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
        let unit = keep(unit);
        let parameters = symbols
            .iter()
            .map(|symbol| EffectParameter::signed(keep(symbol), unit, unit))
            .collect();
        let given = constants.map(|dict| dict.iter().collect::<Vec<_>>()).unwrap_or_default();
        let constants =
            given.iter().map(|(symbol, bounds)| constant(&symbol.extract::<String>()?, bounds));
        let summary = summary.unwrap_or_else(|| format!("Effect of the user: {name}."));
        Ok(Self {
            name,
            summary,
            parameters,
            constants: constants.collect::<PyResult<_>>()?,
            channels: channels
                .map(|names| texts("channels", names))
                .transpose()?
                .unwrap_or_default(),
            function: Arc::new(function),
            failure: Arc::default(),
        })
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
    pub fn take_failure(&self) -> Option<PyErr> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Values of a channel, and whether they are a column per joint.
    fn channel<'a>(name: &str, context: &Context<'a>) -> Option<(&'a [f64], bool)> {
        match name {
            "time" => (!context.time.is_empty()).then_some((context.time, false)),
            "load" => Some((context.torque, true)),
            _ => context
                .channels
                .iter()
                .find(|own| own.name == name)
                .map(|own| (own.values.as_slice(), false)),
        }
    }

    fn call(
        &self,
        joint: usize,
        context: &Context<'_>,
        constants: &[f64],
        out: &mut [Vec<f64>],
    ) -> PyResult<()> {
        Python::attach(|py| {
            let (samples, n, width) = (context.len(), context.dof(), out.len());
            let array = |values: &[f64]| -> PyResult<Bound<'_, PyAny>> {
                let rows: Vec<Vec<f64>> = values.chunks_exact(n).map(<[f64]>::to_vec).collect();
                Ok(PyArray2::from_vec2(py, &rows)
                    .map_err(|error| invalid(error.to_string()))?
                    .into_any())
            };
            let given = (joint, array(context.q)?, array(context.dq)?, array(context.ddq)?);
            let keywords = PyDict::new(py);
            for (constant, value) in self.constants.iter().zip(constants) {
                keywords.set_item(constant.symbol, value)?;
            }
            if !self.channels.is_empty() {
                let channels = PyDict::new(py);
                for name in &self.channels {
                    let missing = || {
                        invalid(format!("{}: the trajectory has no channel `{name}`", self.name))
                    };
                    let (values, of_joints) = Self::channel(name, context).ok_or_else(missing)?;
                    let values = if of_joints {
                        array(values)?
                    } else {
                        PyArray1::from_slice(py, values).into_any()
                    };
                    channels.set_item(name, values)?;
                }
                keywords.set_item("channels", channels)?;
            }
            let result =
                self.function.bind(py).call(given, Some(&keywords)).inspect_err(|error| {
                    // What the function raises stays what it is, and says where it comes from.
                    let _ = error.value(py).call_method1(
                        "add_note",
                        (format!("in the formula of the effect `{}`", self.name),),
                    );
                })?;
            let kwargs = PyDict::new(py);
            kwargs.set_item("dtype", "float64")?;
            let result = py.import("numpy")?.call_method("asarray", (result,), Some(&kwargs))?;
            let columns: PyReadonlyArrayDyn<'_, f64> = result.extract()?;
            let shape = columns.shape().to_vec();
            if shape != [samples, width] && !(width == 1 && shape == [samples]) {
                return Err(invalid(format!(
                    "{}: got {shape:?}, expected ({samples}, {width})",
                    self.name
                )));
            }
            for (index, value) in columns.as_array().iter().enumerate() {
                if !value.is_finite() {
                    return Err(invalid(format!(
                        "{}: a value in row {} is not finite",
                        self.name,
                        index / width
                    )));
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
        let depends_on_time = self.channels.iter().any(|name| name == "time");
        About::default()
            .with_formula("a function of the user")
            .with_origin_reason("a torque of the arm, as far as the user says")
            .with_depends_on_time(depends_on_time)
    }

    fn constants(&self) -> &[Constant] {
        &self.constants
    }

    fn grids_span_ranges(&self) -> bool {
        true
    }

    fn follows_torque(&self) -> bool {
        self.channels.iter().any(|name| name == "load")
    }

    fn needs(&self) -> Needs {
        let of_log = |name: &&String| !["time", "load"].contains(&name.as_str());
        Needs::default()
            .with_time(self.about().depends_on_time)
            .with_channels(self.channels.iter().filter(of_log).cloned().collect())
    }

    fn failure(&self) -> Option<String> {
        self.failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take()
            .map(|error| error.to_string())
    }

    fn not_testable(&self, context: &Context<'_>) -> Option<String> {
        let missing = self.channels.iter().find(|name| Self::channel(name, context).is_none())?;
        Some(match missing.as_str() {
            "time" => {
                "the logs do not share a clock: their times overlap, or span more than four hours"
                    .into()
            }
            name => format!("no channel `{name}` in the logs"),
        })
    }

    fn parameters(&self) -> &[EffectParameter] {
        &self.parameters
    }

    fn entry(&self) -> Entry {
        Entry::Trajectory
    }

    fn trajectory_columns(
        &self,
        site: Site,
        context: &Context<'_>,
        constants: &[f64],
        out: &mut [Vec<f64>],
    ) {
        let joint = site.joint().unwrap_or_default();
        if let Err(error) = self.call(joint, context, constants, out) {
            out.iter_mut().for_each(|column| column.fill(0.0));
            self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }
}
