//! Payloads and drive gains.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::identification as estimation;
use sgpr_core::identification::{GainEstimator, GainOptions, PayloadOptions};
use sgpr_core::model as core;
use sgpr_core::spatial::{PARAMETERS_PER_LINK, STANDARD_PARAMETER_NAMES, STANDARD_PARAMETER_UNITS};

use crate::convert::{Numbers, array, choice, items, unknown};
use crate::errors::invalid;
use crate::identification::Arguments;
use crate::log_set::recordings;
use crate::model::Model;
use crate::progress::listen;
use crate::robot::Robot;
use crate::tables::figure;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// What hangs on a link, in the frame of that link.
#[pyclass(module = "sgpr", frozen)]
pub struct Payload {
    inner: estimation::Payload,
    link: String,
}

#[pymethods]
impl Payload {
    /// Joint that carries the link that holds it.
    #[getter]
    fn link(&self) -> &str {
        &self.link
    }

    /// Mass, kg.
    #[getter]
    fn mass(&self) -> f64 {
        self.inner.mass()
    }

    /// Standard deviation of the mass, kg.
    #[getter]
    fn mass_deviation(&self) -> f64 {
        self.inner.standard_deviations()[0]
    }

    /// Centre of mass, (3,), m.
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[3], self.inner.centre().to_vec())
    }

    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, (10,), about the origin of the link frame.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[PARAMETERS_PER_LINK], self.inner.parameters.to_vec())
    }

    /// Their standard deviations, (10,); infinite where the motion says nothing.
    #[getter]
    fn standard_deviations<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[PARAMETERS_PER_LINK], self.inner.standard_deviations().to_vec())
    }

    /// Their covariance, (10, 10).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let n = PARAMETERS_PER_LINK;
        array(py, &[n, n], (0..n * n).map(|k| self.inner.covariance[(k / n, k % n)]).collect())
    }

    /// Name, unit, value and standard deviation of each parameter.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let deviations = self.inner.standard_deviations();
        let row = |k: usize| {
            let dict = PyDict::new(py);
            dict.set_item("name", STANDARD_PARAMETER_NAMES[k])?;
            dict.set_item("unit", STANDARD_PARAMETER_UNITS[k])?;
            dict.set_item("value", self.inner.parameters[k])?;
            dict.set_item("standard_deviation", deviations[k])?;
            Ok(dict)
        };
        (0..PARAMETERS_PER_LINK).map(row).collect()
    }

    fn __repr__(&self) -> String {
        let (mass, spread) = (figure(self.mass()), figure(self.mass_deviation()));
        let [x, y, z] = self.inner.centre().map(figure);
        format!("Payload({mass} ± {spread} kg at ({x}, {y}, {z}) m on '{}')", self.link)
    }
}

/// Gains of all drives.
#[pyclass(module = "sgpr", frozen)]
pub struct DriveGains {
    inner: estimation::DriveGains,
}

#[pymethods]
impl DriveGains {
    /// What to multiply the logged torques or currents by, (n,).
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.inner.gains.len()], self.inner.gains.clone())
    }

    /// Standard deviations of the gains, (n,).
    #[getter]
    fn standard_deviations<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.inner.gains.len()], self.inner.standard_deviations.clone())
    }

    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz of the payload, (10,), known ones as given.
    #[getter]
    fn payload<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[PARAMETERS_PER_LINK], self.inner.payload.to_vec())
    }

    fn __repr__(&self) -> String {
        let pairs = self.inner.gains.iter().zip(&self.inner.standard_deviations);
        let gains: Vec<String> = pairs
            .map(|(gain, spread)| format!("{} ± {}", figure(*gain), figure(*spread)))
            .collect();
        format!("DriveGains({})", gains.join(", "))
    }
}

/// Index of the link that holds the payload: the last one if none is named.
fn link_of(robot: &Robot, link: Option<&str>) -> PyResult<usize> {
    match link {
        None => Ok(robot.inner.dof() - 1),
        Some(name) => robot.inner.joint_index(name).ok_or_else(|| {
            let known: Vec<&str> = robot.inner.joint_names().collect();
            invalid(format!("link = '{name}': expected one of the joints {}", known.join(", ")))
        }),
    }
}

/// Refuses options of `identify` that would change nothing.
fn without(options: Option<&Bound<'_, PyDict>>, meaningless: &[&str]) -> PyResult<()> {
    for (key, value) in options.into_iter().flatten() {
        let key: String = key.extract()?;
        if meaningless.contains(&key.as_str()) && !value.is_none() {
            return Err(invalid(format!(
                "{key}: has no meaning here; all logs are taken at once, by one method"
            )));
        }
    }
    Ok(())
}

/// Options of `identify` that say how its parameters are estimated.
const ESTIMATION: [&str; 8] =
    ["method", "noise", "essential", "uncertainty", "start", "instruments", "kp", "kd"];

/// Options of `identify` that say which bodies links may be.
const BODIES: [&str; 3] = ["prior", "prior_deviation", "bounds"];

/// Identifies a payload from recordings without and with it.
///
/// Arm and payload are estimated from all recordings together, so the covariance of the payload
/// knows what is not known of the arm.
///
/// Parameters
/// ----------
/// robot : Robot
/// unloaded, loaded : list of Recording or LogSet
///     Without and with the payload; the motions need not be the same.
/// link : str, optional
///     Joint whose link holds it; the last one by default.
/// friction_may_change : bool, default False
///     Whether friction and offsets may differ between the two.
/// consistent : bool, default True
///     Whether the payload is to be a body.
/// **options
///     `effects` and conditioning as in `identify`; what says how its parameters are estimated is
///     refused.
///
/// Returns
/// -------
/// Payload
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> nothing = sgpr.identify_payload(robot, [log], [log], consistent=False)
/// >>> bool(abs(nothing.mass) < 1e-6)
/// True
#[pyfunction]
#[pyo3(signature = (robot, unloaded, loaded, *, link=None, friction_may_change=false, consistent=true, **options),
    text_signature = "(robot, unloaded, loaded, *, link=None, friction_may_change=False, \
         consistent=True, **options)")]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn identify_payload(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    unloaded: &Bound<'_, PyAny>,
    loaded: &Bound<'_, PyAny>,
    link: Option<&str>,
    friction_may_change: bool,
    consistent: bool,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Payload> {
    without(options, &ESTIMATION)?;
    without(options, &BODIES)?;
    let Arguments { options, progress } = Arguments::new(robot.get(), options)?;
    let (unloaded, loaded) = (recordings(unloaded)?, recordings(loaded)?);
    let index = link_of(robot.get(), link)?;
    let payload = PayloadOptions::new(index)
        .with_friction_may_change(friction_may_change)
        .with_consistent(consistent);
    let robot = &robot.get().inner;
    let inner = listen(py, progress, |progress| {
        core::identify_payload(robot, &unloaded, &loaded, &options, &payload, progress)
    })?;
    Ok(Payload { inner, link: robot.joints()[index].name.clone() })
}

/// Identifies the gains of all drives from recordings without and with a payload of which something
/// is known.
///
/// Parameters
/// ----------
/// robot : Robot
/// unloaded, loaded : list of Recording or LogSet
///     Their torques are currents, or currents times constants that are in doubt.
/// payload : dict of str to float
///     What is known of it, about the origin of the frame of the link that holds it: {"m": 2.805},
///     and any of mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
/// link : str, optional
///     Joint whose link holds it; the last one by default.
/// estimator : {"maximum_likelihood", "total_least_squares", "least_squares"}
///     Noise in the currents, which is what there is: total least squares with each drive's errors
///     in its own current, and so two names of one estimator; or least squares of torques, in use
///     in the literature, which noise draws to zero.
/// lowest : array of shape (n,), optional
///     Lower bounds of the gains, for least squares, and with `consistent`.
/// **options
///     `effects` and conditioning as in `identify`; `consistent`, `prior`, `prior_deviation` and
///     `bounds` too: links and payload are then bodies.
///
/// Returns
/// -------
/// DriveGains
///
/// Raises
/// ------
/// IdentificationError
///     If a joint hardly feels the payload.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> sgpr.identify_drive_gains(robot, [log], [log], payload={})
/// Traceback (most recent call last):
/// sgpr.IdentificationError: nothing is known of the payload: gains need at least its mass, or its first moment
#[pyfunction]
#[pyo3(signature = (robot, unloaded, loaded, *, payload, link=None, estimator="maximum_likelihood", lowest=None, **options),
    text_signature = "(robot, unloaded, loaded, *, payload, link=None, \
         estimator='maximum_likelihood', lowest=None, **options)")]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn identify_drive_gains(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    unloaded: &Bound<'_, PyAny>,
    loaded: &Bound<'_, PyAny>,
    payload: &Bound<'_, PyAny>,
    link: Option<&str>,
    estimator: &str,
    lowest: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<DriveGains> {
    without(options, &ESTIMATION)?;
    let Arguments { mut options, progress } = Arguments::new(robot.get(), options)?;
    let (unloaded, loaded) = (recordings(unloaded)?, recordings(loaded)?);
    let index = link_of(robot.get(), link)?;
    let mut known = [None; PARAMETERS_PER_LINK];
    for (name, value) in items("payload", payload)? {
        let position = STANDARD_PARAMETER_NAMES.iter().position(|known| *known == name);
        let position =
            position.ok_or_else(|| unknown("payload", &name, &STANDARD_PARAMETER_NAMES))?;
        let value: f64 = value
            .extract()
            .map_err(|_| invalid(format!("payload['{name}']: expected a number")))?;
        if !value.is_finite() {
            return Err(invalid(format!("payload['{name}'] is {value}: expected a finite number")));
        }
        known[position] = Some(value);
    }
    let estimators = [
        ("maximum_likelihood", GainEstimator::MaximumLikelihood),
        ("total_least_squares", GainEstimator::MaximumLikelihood),
        ("least_squares", GainEstimator::LeastSquares),
    ];
    let estimator = choice("estimator", estimator, &estimators)?;
    let robot = &robot.get().inner;
    let lowest = match lowest {
        None => Vec::new(),
        Some(lowest) => {
            Numbers::new("lowest", lowest)?.shaped(&[robot.dof()])?.finite()?.values().to_vec()
        }
    };
    let gains = GainOptions::new(index, known)
        .with_estimator(estimator)
        .with_lowest(lowest)
        .with_consistency(options.consistency.take());
    let inner = listen(py, progress, |progress| {
        core::identify_drive_gains(robot, &unloaded, &loaded, &options, &gains, progress)
    })?;
    Ok(DriveGains { inner })
}

/// What is suspicious in the recordings that a model was identified from.
///
/// Torques that are negated, in another unit or late; rows far off the model; moments on which the
/// estimate hangs; combinations of parameters that the motion hardly excites.
///
/// Parameters
/// ----------
/// model : Model
///     As `identify` returned it.
/// recordings : list of Recording or LogSet
///
/// Returns
/// -------
/// list of str
///     Sentences; empty if nothing is suspicious, and for a model that was not identified.
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify(sgpr.Robot.from_urdf("robot.urdf"), [log])
/// >>> any("negated" in finding for finding in sgpr.screen(model, [log]))
/// False
#[pyfunction]
pub fn screen(
    py: Python<'_>,
    model: &Bound<'_, Model>,
    recordings: &Bound<'_, PyAny>,
) -> PyResult<Vec<String>> {
    let recordings = self::recordings(recordings)?;
    let model = &model.get().inner;
    let findings = listen(py, None, |_| core::screen(model, &recordings))?;
    Ok(findings.iter().map(ToString::to_string).collect())
}
