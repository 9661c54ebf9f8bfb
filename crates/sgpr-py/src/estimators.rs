//! Words, numbers and dicts that say how parameters are estimated.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use sgpr_core::identification::{
    Consistency, Distance, ESTIMATORS, Estimator, LinkBounds, Method, ParameterBounds,
    PhysicalBounds, PriorWidth, Region,
};
use sgpr_core::model::Uncertainty;
use sgpr_core::signal::Differentiation;

use crate::convert::{choice, items, positive, vector3};
use crate::errors::invalid;

/// "wls", "irls:1.345", "rls:0.999"
pub fn method(text: &str) -> PyResult<Method> {
    text.parse().map_err(|_| {
        let choices =
            Method::choices().iter().map(|choice| format!("'{choice}'")).collect::<Vec<_>>();
        invalid(format!("method = '{text}': expected {}", choices.join(", ")))
    })
}

/// Estimators beyond least squares, for `method` of `identify`.
///
/// Returns
/// -------
/// list of dict
///     `name`, as `method` takes it; `title`, in words; `setting`, what the number in "name:number"
///     is, and `usual`, its value unless given, or None; `needs`: "factors", works on sums of logs,
///     too; "rows" of logs; "instruments" or the "controller".
///
/// Examples
/// --------
/// >>> [estimator["name"] for estimator in sgpr.estimators()]
/// ['irls', 'ridge', 'tls', 'iv', 'output_error', 'rls']
#[pyfunction]
pub fn estimators(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let dict = |estimator: &&Estimator| {
        let dict = PyDict::new(py);
        dict.set_item("name", estimator.name)?;
        dict.set_item("title", estimator.title)?;
        dict.set_item("setting", estimator.setting.map(|setting| setting.name))?;
        dict.set_item("usual", estimator.setting.map(|setting| setting.usual))?;
        dict.set_item("needs", estimator.needs.name())?;
        Ok(dict)
    };
    ESTIMATORS.iter().map(dict).collect()
}

/// "memory", "hac", "bootstrap", "bootstrap:500"
pub fn uncertainty(text: &str) -> PyResult<Uncertainty> {
    let wrong = || {
        invalid(format!(
            "uncertainty = '{text}': expected 'memory', 'hac', 'bootstrap' or \
             'bootstrap:REPLICATES'"
        ))
    };
    match text.split_once(':') {
        None if text == "memory" => Ok(Uncertainty::Memory),
        None if text == "hac" => Ok(Uncertainty::Hac),
        None if text == "bootstrap" => Ok(Uncertainty::Bootstrap { replicates: 500 }),
        Some(("bootstrap", count)) => match count.parse() {
            Ok(replicates @ 2..=100_000) => Ok(Uncertainty::Bootstrap { replicates }),
            _ => Err(wrong()),
        },
        _ => Err(wrong()),
    }
}

/// What `consistent`, `prior`, `prior_deviation` and `bounds` say together.
#[derive(Default)]
pub struct ConsistencyArguments {
    wanted: bool,
    cross_validated: bool,
    consistency: Consistency,
    given: Option<&'static str>,
    /// Width of the prior on any estimate, if it was given.
    width: Option<PriorWidth>,
    /// Whether no prior is wanted.
    bare: bool,
}

impl ConsistencyArguments {
    pub const OPTIONS: [&str; 4] = ["consistent", "prior", "prior_deviation", "bounds"];

    /// Takes an option of [`Self::OPTIONS`].
    pub fn take(&mut self, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        match key {
            "consistent" => self.wanted = value.extract()?,
            "prior" if value.is_none() => self.bare = true,
            "prior" => {
                let text: String = value.extract()?;
                let known = [("entropic", Distance::Entropic), ("euclidean", Distance::Euclidean)];
                self.consistency.prior.distance = choice(key, &text, &known)?;
                self.given = Some("prior");
            }
            "prior_deviation" => {
                if let Ok(word) = value.extract::<String>() {
                    self.cross_validated = choice(key, &word, &[("auto", true)])?;
                    self.width = Some(PriorWidth::Chosen);
                } else {
                    let deviation = positive(key, value.extract()?)?;
                    self.consistency.prior.relative_deviation = deviation;
                    self.width = Some(PriorWidth::Given(deviation));
                }
            }
            _ => {
                self.consistency.bounds = bounds(value)?;
                self.given = Some("bounds");
            }
        }
        Ok(())
    }

    /// The width of the prior on what the logs do not determine; none if no prior is wanted.
    pub fn prior(&self) -> PyResult<Option<PriorWidth>> {
        match (self.bare, self.width) {
            (true, Some(_)) if !self.wanted => {
                Err(invalid("prior_deviation: without a prior (prior=None) it has no meaning"))
            }
            (true, _) => Ok(None),
            (false, width) => Ok(Some(width.unwrap_or_default())),
        }
    }

    /// The settings, if consistency is wanted, and whether the data choose the strength of the
    /// pull.
    pub fn finish(self) -> PyResult<(Option<Consistency>, bool)> {
        match (self.wanted, self.given) {
            (true, _) => Ok((Some(self.consistency), self.cross_validated)),
            (false, None) => Ok((None, false)),
            (false, Some(option)) => {
                Err(invalid(format!("{option}: it belongs to consistent=True")))
            }
        }
    }
}

/// {"joint_2": {"mass": [1, 5], "box": [[...], [...]]}, "total_mass": [20, 30], "joint_2.Fv": [0,
/// None]}
fn bounds(value: &Bound<'_, PyAny>) -> PyResult<PhysicalBounds> {
    let mut bounds = PhysicalBounds::default();
    for (name, limits) in items("bounds", value)? {
        let label = format!("bounds['{name}']");
        if limits.is_instance_of::<PyDict>() {
            let mut link = LinkBounds::new(name);
            for (key, limit) in items(&label, &limits)? {
                let label = format!("{label}['{key}']");
                match key.as_str() {
                    "mass" => link.mass = Some(interval(&label, &limit)?),
                    "box" => {
                        let (lowest, highest) = pair(&label, &limit)?;
                        let (lowest, highest) =
                            (vector3(&label, &lowest)?, vector3(&label, &highest)?);
                        link.centre = Some(Region::Box { lowest, highest });
                    }
                    "ellipsoid" => {
                        let (centre, half_axes) = pair(&label, &limit)?;
                        let (centre, half_axes) =
                            (vector3(&label, &centre)?, vector3(&label, &half_axes)?);
                        link.centre = Some(Region::Ellipsoid { centre, half_axes });
                    }
                    _ => {
                        return Err(invalid(format!(
                            "{label}: known are 'mass', 'box' and 'ellipsoid'"
                        )));
                    }
                }
            }
            bounds.links.push(link);
        } else if name == "total_mass" {
            bounds.total_mass = Some(interval(&label, &limits)?);
        } else {
            let [lowest, highest] = interval(&label, &limits)?;
            let finite = |limit: f64| limit.is_finite().then_some(limit);
            bounds.parameters.push(
                ParameterBounds::new(name)
                    .with_lowest(finite(lowest))
                    .with_highest(finite(highest)),
            );
        }
    }
    Ok(bounds)
}

fn pair<'py>(
    label: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let both = (!value.is_instance_of::<PyString>()).then(|| value.try_iter().ok()).flatten();
    let both: Option<Vec<Bound<'py, PyAny>>> =
        both.and_then(|both| both.collect::<PyResult<_>>().ok());
    match both.as_deref() {
        Some([first, second]) => Ok((first.clone(), second.clone())),
        _ => Err(invalid(format!("{label}: expected two values"))),
    }
}

/// Two numbers; None is no limit.
fn interval(label: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; 2]> {
    let (low, high) = pair(label, value)?;
    let number = |limit: Bound<'_, PyAny>, none: f64| -> PyResult<f64> {
        if limit.is_none() {
            return Ok(none);
        }
        let number: f64 = limit
            .extract()
            .map_err(|_| invalid(format!("{label}: expected two numbers or None")))?;
        if number.is_nan() { Err(invalid(format!("{label}: NaN is no limit"))) } else { Ok(number) }
    };
    Ok([number(low, f64::NEG_INFINITY)?, number(high, f64::INFINITY)?])
}

/// What the user calls a way to differentiate.
pub fn differentiation_name(method: Differentiation) -> String {
    match method {
        Differentiation::Central { accuracy } => format!("central:{accuracy}"),
        Differentiation::SavitzkyGolay { window, degree } => {
            format!("savitzky_golay:{window}:{degree}")
        }
    }
}
