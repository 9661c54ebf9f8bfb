//! Keyword arguments of functions that take many.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use crate::errors::invalid;

/// What a caller gave by name. `None` stands for the default, whatever it is.
pub struct Keywords<'a, 'py> {
    given: Option<&'a Bound<'py, PyDict>>,
}

impl<'a, 'py> Keywords<'a, 'py> {
    /// Refuses names that are not among the known ones.
    pub fn new(given: Option<&'a Bound<'py, PyDict>>, known: &[&str]) -> PyResult<Self> {
        for name in given.into_iter().flat_map(|given| given.keys()) {
            let name: String = name.extract()?;
            if !known.contains(&name.as_str()) {
                let known = known.join(", ");
                let message =
                    format!("got an unexpected keyword argument '{name}'; options are {known}");
                return Err(PyTypeError::new_err(message));
            }
        }
        Ok(Self { given })
    }

    /// All that was given, in the order of the caller; what is `None` too.
    pub fn all(
        &self,
    ) -> impl Iterator<Item = (Bound<'py, PyAny>, Bound<'py, PyAny>)> + use<'a, 'py> {
        self.given.into_iter().flatten()
    }

    pub fn get(&self, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let value = self.given.map(|given| given.get_item(name)).transpose()?.flatten();
        Ok(value.filter(|value| !value.is_none()))
    }

    /// A value that Python's own rules make a `T`.
    pub fn extract<T>(&self, name: &str) -> PyResult<Option<T>>
    where
        T: for<'b> FromPyObject<'b, 'py, Error = PyErr>,
    {
        let Some(value) = self.get(name)? else { return Ok(None) };
        let shown = value.repr()?;
        let named =
            |error: PyErr| invalid(format!("{name} = {shown}: {}", error.value(value.py())));
        value.extract().map(Some).map_err(named)
    }

    pub fn number(&self, name: &str) -> PyResult<Option<f64>> {
        self.get(name)?.map(|value| number(name, &value)).transpose()
    }

    pub fn word(&self, name: &str) -> PyResult<Option<String>> {
        self.get(name)?.map(|value| word(name, &value)).transpose()
    }
}

pub fn word(name: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    match value.cast::<PyString>() {
        Ok(text) => Ok(text.to_string()),
        Err(_) => Err(invalid(format!("{name} = {}: expected a word", value.repr()?))),
    }
}

pub fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| match value.repr() {
        Ok(shown) => invalid(format!("{name} = {shown}: expected a number")),
        Err(error) => error,
    })
}
