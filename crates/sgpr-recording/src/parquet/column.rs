//! A column of numbers, times or lists.

use std::collections::BTreeSet;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, Decimal32Type, Decimal64Type, Decimal128Type, DurationMicrosecondType,
    DurationMillisecondType, DurationNanosecondType, DurationSecondType, Float16Type, Float32Type,
    Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, TimestampMicrosecondType,
    TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType, UInt8Type, UInt16Type,
    UInt32Type, UInt64Type,
};
use arrow_array::{Array as _, ArrayRef};
use arrow_schema::{ArrowError, DataType, TimeUnit};

use crate::RecordingError;
use crate::arrays::{ArrayContent, NamedArray};
use crate::csv::{NamedColumn, Values, seconds_text};

/// Whether a column holds a number or a time in each row.
pub(crate) fn is_number(kind: &DataType) -> bool {
    let is_decimal = matches!(
        kind,
        DataType::Decimal32(..) | DataType::Decimal64(..) | DataType::Decimal128(..)
    );
    let is_time = matches!(kind, DataType::Timestamp(..) | DataType::Duration(_));
    is_plain(kind) || is_decimal || is_time || *kind == DataType::Boolean
}

/// The same without times, decimals and truth values.
pub(crate) fn is_plain(kind: &DataType) -> bool {
    kind.is_integer() || kind.is_floating()
}

/// Whether a column holds a list of numbers in each row.
pub(crate) fn is_list(kind: &DataType) -> bool {
    match kind {
        DataType::List(field) | DataType::LargeList(field) | DataType::FixedSizeList(field, _) => {
            is_plain(field.data_type())
        }
        _ => false,
    }
}

/// A column, or some rows of it.
pub(crate) struct ParquetColumn {
    name: String,
    rows: usize,
    /// Of lists: whether each row has one, all of one length.
    even: bool,
    is_list: bool,
    values: Held,
    /// Rows without a value.
    holes: BTreeSet<usize>,
}

enum Held {
    Numbers(Vec<f64>),
    Integers(Vec<i64>),
    /// ns
    Times(Vec<i64>),
}

impl ParquetColumn {
    /// # Errors
    /// If a time is beyond what 64 bits of ns reach.
    pub(crate) fn new(name: &str, array: &ArrayRef) -> Result<Self, ArrowError> {
        let rows = array.len();
        let holes = |array: &ArrayRef| (0..array.len()).filter(|row| array.is_null(*row)).collect();
        let is_list = is_list(array.data_type());
        if !is_list {
            let (values, even) = (Held::new(array)?, true);
            return Ok(Self {
                name: name.into(),
                rows,
                even,
                is_list,
                values,
                holes: holes(array),
            });
        }
        let mut numbers = Vec::new();
        let mut length = None;
        let mut even = array.null_count() == 0;
        for row in (0..rows).filter(|row| !array.is_null(*row)) {
            let list = match array.data_type() {
                DataType::List(_) => array.as_list::<i32>().value(row),
                DataType::LargeList(_) => array.as_list::<i64>().value(row),
                _ => array.as_fixed_size_list().value(row),
            };
            even &= *length.get_or_insert(list.len()) == list.len();
            let values = Held::new(&list)?.into_numbers(&holes(&list));
            numbers.extend(values);
        }
        let (values, holes) = (Held::Numbers(numbers), BTreeSet::new());
        Ok(Self { name: name.into(), rows, even, is_list, values, holes })
    }

    pub(crate) fn is_list(&self) -> bool {
        self.is_list
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// The whole number in a row.
    pub(crate) fn integer(&self, row: usize) -> Option<i64> {
        match &self.values {
            Held::Integers(values) if !self.holes.contains(&row) => Some(values[row]),
            _ => None,
        }
    }

    /// Bytes of the values.
    pub(super) fn bytes(&self) -> u64 {
        8 * match &self.values {
            Held::Numbers(values) => values.len() as u64,
            Held::Integers(values) | Held::Times(values) => values.len() as u64,
        }
    }

    /// Puts the rows of `more` behind those of this column.
    pub(super) fn append(&mut self, more: Self) {
        let length = |column: &Self| column.bytes() / 8 * u64::from(column.rows > 0);
        // Of lists of one length: values per row agree.
        self.even &= more.even
            && (!self.is_list
                || length(self) * more.rows as u64 == length(&more) * self.rows as u64);
        self.holes.extend(more.holes.into_iter().map(|row| self.rows + row));
        self.rows += more.rows;
        self.values.append(more.values);
    }

    /// The column as tables have it; whole numbers and times with holes as text, in which both are
    /// exact.
    pub(crate) fn into_named(self) -> NamedColumn<'static> {
        let holes = &self.holes;
        let texts = |values: Vec<i64>, text: fn(i64) -> String| {
            let cell =
                |(row, value)| if holes.contains(&row) { String::new() } else { text(value) };
            Values::Texts(values.into_iter().enumerate().map(cell).collect())
        };
        let values = match self.values {
            values @ Held::Numbers(_) => Values::Numbers(values.into_numbers(holes).into()),
            Held::Integers(values) if holes.is_empty() => Values::Integers(values.into()),
            Held::Integers(values) => texts(values, |value| value.to_string()),
            Held::Times(values) if holes.is_empty() => Values::Seconds(values.into()),
            Held::Times(values) => texts(values, seconds_text),
        };
        NamedColumn { name: self.name, values }
    }

    /// The numbers of each row, and how many these are.
    ///
    /// - `path`: for messages
    ///
    /// # Errors
    /// If it holds lists of several lengths, or none in a row.
    pub(crate) fn into_rows(self, path: &str) -> Result<(usize, Vec<f64>), RecordingError> {
        if !self.even {
            let cause =
                format!("`{}` has samples of unequal length, or without numbers", self.name);
            return Err(RecordingError::NoLog { path: path.into(), cause });
        }
        let numbers = self.values.into_numbers(&self.holes);
        Ok((numbers.len().checked_div(self.rows).unwrap_or(0), numbers))
    }

    /// The column as an array with a row per sample.
    ///
    /// # Errors
    /// As [`ParquetColumn::into_rows`].
    pub(crate) fn into_array(self, path: &str) -> Result<NamedArray, RecordingError> {
        let (rows, holes) = (self.rows, !self.holes.is_empty());
        let exact = !holes || !matches!(self.values, Held::Integers(_));
        if !self.is_list && exact {
            let NamedColumn { name, values } = self.into_named();
            return Ok(NamedArray::new(name, vec![rows], ArrayContent::Values(values)));
        }
        let (name, is_list) = (self.name.clone(), self.is_list);
        let (width, numbers) = self.into_rows(path)?;
        let shape = if is_list { vec![rows, width] } else { vec![rows] };
        Ok(NamedArray::new(name, shape, ArrayContent::Values(Values::Numbers(numbers.into()))))
    }
}

impl Held {
    fn new(array: &ArrayRef) -> Result<Self, ArrowError> {
        fn raw<T: ArrowPrimitiveType>(array: &ArrayRef) -> &[T::Native] {
            array.as_primitive::<T>().values()
        }
        fn whole<T: ArrowPrimitiveType<Native: Into<i64>>>(array: &ArrayRef) -> Held {
            Held::Integers(raw::<T>(array).iter().map(|value| (*value).into()).collect())
        }
        fn decimal<T: ArrowPrimitiveType<Native: Into<i128>>>(array: &ArrayRef, scale: i8) -> Held {
            let power = 10_f64.powi(scale.into());
            let of = |value: &T::Native| Into::<i128>::into(*value) as f64 / power;
            Held::Numbers(raw::<T>(array).iter().map(of).collect())
        }
        let times = |values: &[i64], unit: TimeUnit| {
            let to_ns = match unit {
                TimeUnit::Second => 1_000_000_000,
                TimeUnit::Millisecond => 1_000_000,
                TimeUnit::Microsecond => 1_000,
                TimeUnit::Nanosecond => 1,
            };
            let exact = |(row, value): (usize, &i64)| {
                if array.is_null(row) { Some(0) } else { value.checked_mul(to_ns) }
            };
            let values: Option<Vec<i64>> = values.iter().enumerate().map(exact).collect();
            let too_far = || ArrowError::ComputeError("a time is not within 292 years".into());
            values.map(Held::Times).ok_or_else(too_far)
        };
        Ok(match array.data_type() {
            DataType::Boolean => {
                let bits = array.as_boolean();
                Self::Integers((0..bits.len()).map(|row| bits.value(row).into()).collect())
            }
            DataType::Int8 => whole::<Int8Type>(array),
            DataType::Int16 => whole::<Int16Type>(array),
            DataType::Int32 => whole::<Int32Type>(array),
            DataType::Int64 => whole::<Int64Type>(array),
            DataType::UInt8 => whole::<UInt8Type>(array),
            DataType::UInt16 => whole::<UInt16Type>(array),
            DataType::UInt32 => whole::<UInt32Type>(array),
            DataType::UInt64 => {
                let values = raw::<UInt64Type>(array);
                let signed: Result<Vec<i64>, _> =
                    values.iter().map(|v| i64::try_from(*v)).collect();
                signed.map_or_else(
                    |_| Self::Numbers(values.iter().map(|value| *value as f64).collect()),
                    Self::Integers,
                )
            }
            DataType::Float16 => Self::Numbers(
                raw::<Float16Type>(array).iter().map(|value| f64::from(*value)).collect(),
            ),
            DataType::Float32 => Self::Numbers(
                raw::<Float32Type>(array).iter().map(|value| f64::from(*value)).collect(),
            ),
            DataType::Float64 => Self::Numbers(raw::<Float64Type>(array).to_vec()),
            DataType::Decimal32(_, scale) => decimal::<Decimal32Type>(array, *scale),
            DataType::Decimal64(_, scale) => decimal::<Decimal64Type>(array, *scale),
            DataType::Decimal128(_, scale) => decimal::<Decimal128Type>(array, *scale),
            DataType::Timestamp(unit, _) => times(
                match unit {
                    TimeUnit::Second => raw::<TimestampSecondType>(array),
                    TimeUnit::Millisecond => raw::<TimestampMillisecondType>(array),
                    TimeUnit::Microsecond => raw::<TimestampMicrosecondType>(array),
                    TimeUnit::Nanosecond => raw::<TimestampNanosecondType>(array),
                },
                *unit,
            )?,
            DataType::Duration(unit) => times(
                match unit {
                    TimeUnit::Second => raw::<DurationSecondType>(array),
                    TimeUnit::Millisecond => raw::<DurationMillisecondType>(array),
                    TimeUnit::Microsecond => raw::<DurationMicrosecondType>(array),
                    TimeUnit::Nanosecond => raw::<DurationNanosecondType>(array),
                },
                *unit,
            )?,
            kind => return Err(ArrowError::NotYetImplemented(format!("numbers of {kind}"))),
        })
    }

    fn into_numbers(self, holes: &BTreeSet<usize>) -> Vec<f64> {
        let mut numbers = match self {
            Self::Numbers(values) => values,
            Self::Integers(values) | Self::Times(values) => {
                values.into_iter().map(|value| value as f64).collect()
            }
        };
        for row in holes {
            numbers[*row] = f64::NAN;
        }
        numbers
    }

    fn append(&mut self, more: Self) {
        match (&mut *self, more) {
            (Self::Numbers(values), more) => values.extend(more.into_numbers(&BTreeSet::new())),
            (Self::Integers(values), Self::Integers(more))
            | (Self::Times(values), Self::Times(more)) => values.extend(more),
            (Self::Integers(values) | Self::Times(values), more) => {
                let mut numbers: Vec<f64> = values.iter().map(|value| *value as f64).collect();
                numbers.extend(more.into_numbers(&BTreeSet::new()));
                *self = Self::Numbers(numbers);
            }
        }
    }
}
