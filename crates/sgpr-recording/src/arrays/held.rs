//! One array of a file.

use std::borrow::Cow;

use crate::csv::{NamedColumn, Values};

/// An array by its name.
pub(crate) struct NamedArray {
    pub(super) name: String,
    /// Row-major.
    pub(super) shape: Vec<usize>,
    pub(super) content: ArrayContent,
}

/// What an array holds.
pub(crate) enum ArrayContent {
    /// Something that can be a column.
    Values(Values<'static>),
    /// Something else, in a word.
    #[cfg_attr(not(feature = "numpy"), allow(dead_code, reason = "others leave out such arrays"))]
    Other(String),
}

impl NamedArray {
    /// # Panics
    /// If there are not as many values as the shape says.
    pub(crate) fn new(name: impl Into<String>, shape: Vec<usize>, content: ArrayContent) -> Self {
        let name = name.into();
        if let ArrayContent::Values(values) = &content {
            assert_eq!(values.rows(), count(&shape), "{name}: values of the shape");
        }
        Self { name, shape, content }
    }

    /// An array of values that lie columns first: the first index runs fastest.
    ///
    /// # Panics
    /// As [`NamedArray::new`].
    #[cfg(any(feature = "matlab", feature = "numpy"))]
    pub(super) fn columns_first(
        name: impl Into<String>,
        mut shape: Vec<usize>,
        content: ArrayContent,
    ) -> Self {
        shape.reverse();
        let mut array = Self::new(name, shape, content);
        array.transpose();
        array
    }

    /// Number of values.
    pub(super) fn len(&self) -> usize {
        count(&self.shape)
    }

    pub(super) fn shape_text(&self) -> String {
        shape_text(&self.shape)
    }

    pub(super) fn kind(&self) -> &str {
        match &self.content {
            ArrayContent::Values(Values::Numbers(_)) => "float64",
            ArrayContent::Values(Values::Integers(_)) => "int64",
            ArrayContent::Values(Values::Seconds(_)) => "durations",
            ArrayContent::Values(Values::Instants(_)) => "dates",
            ArrayContent::Values(Values::Texts(_)) => "text",
            ArrayContent::Other(kind) => kind,
        }
    }

    pub(super) fn is_number(&self) -> bool {
        matches!(self.content, ArrayContent::Values(Values::Numbers(_) | Values::Integers(_)))
    }

    pub(super) fn is_time(&self) -> bool {
        matches!(self.content, ArrayContent::Values(Values::Seconds(_) | Values::Instants(_)))
    }

    #[cfg(any(feature = "hdf5", feature = "matlab", feature = "parquet"))]
    pub(super) fn is_text(&self) -> bool {
        self.texts().is_some()
    }

    pub(super) fn texts(&self) -> Option<&[String]> {
        match &self.content {
            ArrayContent::Values(Values::Texts(texts)) => Some(texts),
            _ => None,
        }
    }

    /// Without lengths of one; one length at least.
    pub(super) fn squeeze(&mut self) {
        self.shape.retain(|length| *length != 1);
        if self.shape.is_empty() {
            self.shape.push(1);
        }
    }

    /// Whole numbers as times of so many ns, unless the name says a unit.
    pub(super) fn integers_are_nanoseconds(&mut self) {
        let says_none = ["t", "time"].contains(&self.name.as_str());
        if let ArrayContent::Values(Values::Integers(values)) = &mut self.content
            && says_none
        {
            self.content = ArrayContent::Values(Values::Seconds(std::mem::take(values)));
        }
    }

    /// Axes in reverse order: rows and columns exchanged.
    pub(super) fn transpose(&mut self) {
        let shape: Vec<usize> = self.shape.iter().rev().copied().collect();
        if let ArrayContent::Values(values) = &self.content
            && shape.len() > 1
        {
            let places = (0..self.len()).map(|place| place_in_reverse(place, &shape));
            self.content = ArrayContent::Values(picked(values, places));
        }
        self.shape = shape;
    }

    /// A column of an array of rows.
    pub(super) fn column(&self, k: usize) -> Option<NamedColumn<'static>> {
        let ArrayContent::Values(values) = &self.content else { return None };
        let [rows, columns] = self.shape[..] else { return None };
        let values = picked(values, (0..rows).map(|row| row * columns + k));
        Some(NamedColumn { name: super::called(&self.name, k), values })
    }

    pub(super) fn into_column(self) -> Option<NamedColumn<'static>> {
        match self.content {
            ArrayContent::Values(values) => Some(NamedColumn { name: self.name, values }),
            ArrayContent::Other(_) => None,
        }
    }
}

/// A shape as Python writes it: `(50, 3)`, `(50,)`.
pub(super) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [length] => format!("({length},)"),
        _ => {
            let lengths: Vec<String> = shape.iter().map(usize::to_string).collect();
            format!("({})", lengths.join(", "))
        }
    }
}

/// Number of values of an array of this shape; the largest there is, if more.
pub(super) fn count(shape: &[usize]) -> usize {
    if shape.contains(&0) {
        return 0;
    }
    shape.iter().fold(1, |count, length| count.saturating_mul(*length))
}

/// Where a value lies while the first index of this shape still runs fastest.
fn place_in_reverse(mut place: usize, shape: &[usize]) -> usize {
    let (mut reverse, mut values) = (0, count(shape));
    for length in shape.iter().rev() {
        values /= length;
        reverse += place % length * values;
        place /= length;
    }
    reverse
}

/// The values at these places.
fn picked(values: &Values<'_>, places: impl Iterator<Item = usize>) -> Values<'static> {
    fn of<T: Copy>(values: &[T], places: impl Iterator<Item = usize>) -> Cow<'static, [T]> {
        places.map(|place| values[place]).collect()
    }
    match values {
        Values::Numbers(values) => Values::Numbers(of(values, places)),
        Values::Integers(values) => Values::Integers(of(values, places)),
        Values::Seconds(values) => Values::Seconds(of(values, places)),
        Values::Instants(values) => Values::Instants(of(values, places)),
        Values::Texts(values) => Values::Texts(places.map(|place| values[place].clone()).collect()),
    }
}

/// Without the structures or groups around them, where no other array is then called the same.
#[cfg(any(feature = "hdf5", feature = "matlab", feature = "parquet"))]
pub(super) fn with_short_names(mut arrays: Vec<NamedArray>) -> Vec<NamedArray> {
    let short: Vec<String> = arrays
        .iter()
        .map(|NamedArray { name, .. }| {
            let before_unit = name.find(" [").unwrap_or(name.len());
            name[name[..before_unit].rfind('.').map_or(0, |dot| dot + 1)..].to_string()
        })
        .collect();
    let mut uses = std::collections::HashMap::new();
    for name in &short {
        *uses.entry(name.clone()).or_insert(0) += 1;
    }
    for (array, own) in arrays.iter_mut().zip(short) {
        if uses[&own] == 1 {
            array.name = own;
        }
    }
    arrays
}
