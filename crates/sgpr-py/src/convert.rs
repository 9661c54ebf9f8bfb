//! Between numpy arrays and slices: every shape check of what comes from Python.
//!
//! A contiguous array of float64 is borrowed, anything else that numpy makes an array of real
//! numbers is converted; a result is moved into its array, and what an object keeps is shown as a
//! read-only view of its memory.

use std::ops::Range;

use numpy::ndarray::{ArrayD, ArrayViewD, IxDyn};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::PyClass;
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::True;
use pyo3::types::{PyDict, PyString};
use sgpr_core::robot::Robot;

use crate::errors::invalid;

/// Real numbers given from Python, of any shape.
pub struct Numbers<'py> {
    name: String,
    array: PyReadonlyArrayDyn<'py, f64>,
}

impl<'py> Numbers<'py> {
    /// The argument `name` as contiguous float64, borrowed if it is that already.
    pub fn new(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = match value.cast::<PyArrayDyn<f64>>() {
            Ok(array) => array.clone(),
            Err(_) => converted(name, value)?,
        };
        let borrowed = borrow(name, &array)?;
        // A slice is given of columns one after the other, too.
        if borrowed.is_c_contiguous() && borrowed.as_slice().is_ok() {
            return Ok(Self { name: name.into(), array: borrowed });
        }
        drop(borrowed);
        Ok(Self { name: name.into(), array: borrow(name, &as_float64(array.as_any())?)? })
    }

    /// The numbers, row-major.
    pub fn values(&self) -> &[f64] {
        self.array.as_slice().expect("checked in `new`")
    }

    /// Lengths of the axes.
    pub fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    /// Refuses NaN and infinity, and says where they are.
    pub fn finite(self) -> PyResult<Self> {
        let Some(index) = self.values().iter().position(|value| !value.is_finite()) else {
            return Ok(self);
        };
        let value = self.values()[index];
        let place = match *self.shape() {
            [_, columns] => format!("{}[{}, {}]", self.name, index / columns, index % columns),
            _ => format!("{}[{index}]", self.name),
        };
        Err(invalid(format!("{place} is {value}: every value must be a finite number")))
    }

    /// Refuses any other shape.
    pub fn shaped(self, expected: &[usize]) -> PyResult<Self> {
        if self.shape() == expected {
            return Ok(self);
        }
        Err(self.wrong_shape(&shape_text(expected)))
    }

    /// An error that tells the shape that was expected.
    pub fn wrong_shape(&self, expected: &str) -> PyErr {
        invalid(format!("{}: got {}, expected {expected}", self.name, shape_text(self.shape())))
    }
}

fn borrow<'py>(
    name: &str,
    array: &Bound<'py, PyArrayDyn<f64>>,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    array.try_readonly().map_err(|_| invalid(format!("{name}: the array is being written to")))
}

/// What numpy makes of a list, a table or an array of other numbers.
fn converted<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let py = value.py();
    let array = py.import("numpy")?.call_method1("asarray", (value,)).map_err(|error| {
        let expected = "expected an array of real numbers";
        if error.is_instance_of::<pyo3::exceptions::PyValueError>(py) {
            invalid(format!("{name}: {expected} ({})", error.value(py)))
        } else {
            error
        }
    })?;
    if !matches!(kind_of(&array)?, 'f' | 'i' | 'u') {
        let dtype = array.getattr("dtype")?;
        return Err(invalid(format!(
            "{name}: got values of type {dtype}, expected an array of real numbers"
        )));
    }
    as_float64(&array)
}

/// An aligned, contiguous copy in float64.
fn as_float64<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let options = PyDict::new(array.py());
    options.set_item("dtype", "float64")?;
    options.set_item("order", "C")?;
    let copy = array.py().import("numpy")?.call_method("array", (array,), Some(&options))?;
    Ok(copy.cast_into::<PyArrayDyn<f64>>()?)
}

/// numpy's letter for what an array holds.
pub fn kind_of(array: &Bound<'_, PyAny>) -> PyResult<char> {
    array.getattr("dtype")?.getattr("kind")?.extract()
}

/// Joint quantities of one sample, `(n,)`, or of many, `(N, n)`.
pub struct Samples<'py> {
    numbers: Numbers<'py>,
    single: bool,
    count: usize,
}

impl<'py> Samples<'py> {
    /// The argument `name` for `n` joints; NaN and infinity are refused.
    pub fn new(name: &str, value: &Bound<'py, PyAny>, n: usize) -> PyResult<Self> {
        let numbers = Numbers::new(name, value)?;
        let (single, count) = match *numbers.shape() {
            [columns] if columns == n => (true, 1),
            [rows, columns] if columns == n => (false, rows),
            _ => return Err(numbers.wrong_shape(&format!("(N, {n}), or ({n},) for one sample"))),
        };
        Ok(Self { numbers: numbers.finite()?, single, count })
    }

    /// Several arguments with the same samples.
    pub fn together<const K: usize>(
        inputs: [(&str, &Bound<'py, PyAny>); K],
        n: usize,
    ) -> PyResult<[Self; K]> {
        let mut all: Vec<Self> = Vec::with_capacity(K);
        for (name, value) in inputs {
            let samples = Self::new(name, value, n)?;
            if let Some(first) =
                all.first().filter(|first| first.numbers.shape() != samples.numbers.shape())
            {
                let expected =
                    format!("{} as {}", shape_text(first.numbers.shape()), first.numbers.name);
                return Err(samples.numbers.wrong_shape(&expected));
            }
            all.push(samples);
        }
        Ok(all.try_into().unwrap_or_else(|_| unreachable!("one for each input")))
    }

    /// `[count, n]`, row-major.
    pub fn values(&self) -> &[f64] {
        self.numbers.values()
    }

    /// Number of samples.
    pub fn count(&self) -> usize {
        self.count
    }

    /// A result with `item` numbers per sample: of that shape for one sample, `(N, ...)` for many.
    pub fn result(
        &self,
        py: Python<'py>,
        item: &[usize],
        values: Vec<f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let mut shape = if self.single { vec![] } else { vec![self.count] };
        shape.extend_from_slice(item);
        array(py, &shape, values)
    }
}

/// `(100, 6)`, `(7,)`.
fn shape_text(shape: &[usize]) -> String {
    match shape {
        [length] => format!("({length},)"),
        shape => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Zeros to be filled; a `MemoryError` if there is no room for them.
pub fn zeros(lengths: &[usize]) -> PyResult<Vec<f64>> {
    /// Below this size a failure is not worth looking for.
    const LARGE: usize = 1 << 20;
    let total = lengths.iter().try_fold(1usize, |product, length| product.checked_mul(*length));
    let no_room =
        || PyMemoryError::new_err(format!("no room for an array of shape {}", shape_text(lengths)));
    let total = total.ok_or_else(no_room)?;
    if total > LARGE {
        // Room is asked for and given back: what `vec!` then takes comes zeroed from the system,
        // untouched.
        Vec::<f64>::new().try_reserve_exact(total).map_err(|_| no_room())?;
    }
    Ok(vec![0.0; total])
}

/// A new array of the numbers, moved.
pub fn array<'py, T: Element>(
    py: Python<'py>,
    shape: &[usize],
    values: Vec<T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let array =
        ArrayD::from_shape_vec(IxDyn(shape), values).map_err(|error| invalid(error.to_string()))?;
    Ok(PyArrayDyn::from_owned_array(py, array))
}

/// A read-only array over memory that `owner` keeps.
pub fn view<'py, C, T>(
    owner: &Bound<'py, C>,
    shape: &[usize],
    pick: impl FnOnce(&C) -> &[T],
) -> PyResult<Bound<'py, PyArrayDyn<T>>>
where
    C: PyClass<Frozen = True> + Sync,
    T: Element,
{
    let values = ArrayViewD::from_shape(IxDyn(shape), pick(owner.get()))
        .map_err(|error| invalid(error.to_string()))?;
    // SAFETY: the memory belongs to `owner`, which the array keeps alive; `owner` is frozen, so
    // nothing reallocates or changes it, and the array is made read-only before anyone sees it.
    let array = unsafe { PyArrayDyn::borrow_from_array(&values, owner.clone().into_any()) };
    array.getattr("flags")?.setattr("writeable", false)?;
    Ok(array)
}

/// Three finite numbers.
pub fn vector3(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    let numbers = Numbers::new(name, value)?.shaped(&[3])?.finite()?;
    Ok([numbers.values()[0], numbers.values()[1], numbers.values()[2]])
}

/// One of a few words.
pub fn choice<T: Copy>(name: &str, value: &str, known: &[(&str, T)]) -> PyResult<T> {
    let found = known.iter().find(|(word, _)| *word == value);
    found.map(|(_, meaning)| *meaning).ok_or_else(|| {
        let words: Vec<String> = known.iter().map(|(word, _)| format!("'{word}'")).collect();
        invalid(format!("{name} = '{value}': expected {}", words.join(" or ")))
    })
}

/// A number greater than zero.
pub fn positive(name: &str, value: f64) -> PyResult<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(invalid(format!("{name} = {value}: expected a number greater than zero")))
}

/// A finite number that is not negative.
pub fn not_negative(name: &str, value: f64) -> PyResult<f64> {
    if value >= 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(invalid(format!("{name} = {value}: expected a number that is not negative")))
}

/// A whole number in a range.
pub fn whole(name: &str, value: &Bound<'_, PyAny>, allowed: Range<usize>) -> PyResult<usize> {
    let number = value.extract::<i128>().map_err(|_| not_whole(name, value, &allowed))?;
    usize::try_from(number)
        .ok()
        .filter(|number| allowed.contains(number))
        .ok_or_else(|| not_whole(name, value, &allowed))
}

fn not_whole(name: &str, value: &Bound<'_, PyAny>, allowed: &Range<usize>) -> PyErr {
    let shown = value.repr().map_or_else(|_| "?".into(), |text| text.to_string());
    let range = match allowed.end {
        usize::MAX => format!("{} or more", allowed.start),
        end => format!("{} to {}", allowed.start, end - 1),
    };
    invalid(format!("{name} = {shown}: expected a whole number, {range}"))
}

/// The name of the type of a value, for messages.
fn type_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string())
}

/// Items of a mapping with text for keys.
pub fn items<'py>(
    name: &str,
    mapping: &Bound<'py, PyAny>,
) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
    let pairs = mapping.call_method0("items").map_err(|_| {
        let found = type_name(mapping);
        pyo3::exceptions::PyTypeError::new_err(format!("{name}: got {found}, expected a dict"))
    })?;
    pairs.try_iter()?.map(|pair| pair?.extract()).collect()
}

/// A list of texts; one text is not a list of letters.
pub fn texts(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    if value.is_instance_of::<PyString>() {
        return Err(pyo3::exceptions::PyTypeError::new_err(format!(
            "{name}: got a str, expected a list of str"
        )));
    }
    let wrong = |found: &Bound<'_, PyAny>, place: &str| {
        pyo3::exceptions::PyTypeError::new_err(format!(
            "{name}: got {}{place}, expected a list of str",
            type_name(found)
        ))
    };
    let each = value.try_iter().map_err(|_| wrong(value, ""))?;
    each.map(|text| text.and_then(|text| text.extract().map_err(|_| wrong(&text, " in it"))))
        .collect()
}

/// An unknown key, with those that are known.
pub fn unknown(what: &str, key: &str, known: &[&str]) -> PyErr {
    invalid(format!("{what}: there is no `{key}`; known are {}", known.join(", ")))
}

/// One finite number per joint.
pub fn per_joint(name: &str, value: &Bound<'_, PyAny>, robot: &Robot) -> PyResult<Vec<f64>> {
    Ok(Numbers::new(name, value)?.shaped(&[robot.dof()])?.finite()?.values().to_vec())
}

/// Gains of a controller that holds the arm: with the other sign it drives the joint away from
/// where it should be.
pub fn not_negative_gains(name: &str, gains: Vec<f64>) -> PyResult<Vec<f64>> {
    match gains.iter().find(|gain| **gain < 0.0) {
        Some(gain) => {
            Err(invalid(format!("{name} has {gain}: gains of a controller are zero or more")))
        }
        None => Ok(gains),
    }
}
