//! Tables in memory, column by column, understood as tables of text are.

use std::borrow::Cow;

use super::ReadOptions;
use super::lines::{decoded, require_names};
use super::mapping::Mapping;
use super::read::are_units;
use super::table::{LogTable, TableRow, check, moment_of, number_of};
use crate::calendar::Moment;
use crate::decimal::nanoseconds;
use crate::{Recording, RecordingError, TimeUnit};

/// A column of a table in memory.
#[derive(Clone, Debug)]
pub struct NamedColumn<'a> {
    /// Its name, as it would stand above the numbers of a file.
    pub name: String,
    /// One value per row.
    pub values: Values<'a>,
}

/// The values of a column.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Values<'a> {
    /// Numbers; NaN where there is none.
    Numbers(Cow<'a, [f64]>),
    /// Whole numbers, exact.
    Integers(Cow<'a, [i64]>),
    /// Seconds, kept exactly as ns.
    Seconds(Cow<'a, [i64]>),
    /// Dates with times, as ns since 1970.
    Instants(Cow<'a, [i64]>),
    /// Text as it would stand in the cells of a file; empty where there is none.
    Texts(Vec<String>),
}

impl Values<'_> {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Integers(values) | Self::Seconds(values) | Self::Instants(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }
}

/// Reads a table in memory: what [`read`](super::read()) makes of a file with the same names and
/// numbers, without the text.
///
/// - `source`: what the table is called in messages
///
/// # Errors
/// As [`read`](super::read()).
///
/// # Panics
/// If the columns are not of one length.
///
/// # Examples
/// ```
/// use sgpr_recording::csv::{NamedColumn, ReadOptions, Values, read_columns};
/// let column = |name: &str, values: &'static [f64]| NamedColumn { name: name.into(), values: Values::Numbers(values.into()) };
/// let columns = [column("t_ms", &[0.0, 4.0]), column("q1_deg", &[0.0, 180.0])];
/// let recording = read_columns("table", &columns, &ReadOptions::default())?;
/// assert_eq!(recording.time(), [0, 4_000_000]);
/// assert_eq!(recording.position(), [0.0, std::f64::consts::PI]);
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read_columns(
    source: &str,
    columns: &[NamedColumn<'_>],
    options: &ReadOptions,
) -> Result<Recording, RecordingError> {
    let rows = columns.first().map_or(0, |column| column.values.rows());
    assert!(
        columns.iter().all(|column| column.values.rows() == rows),
        "one value per row in every column"
    );
    check(source, options)?;
    let names: Vec<String> =
        columns.iter().map(|column| decoded(column.name.as_bytes()).trim().to_string()).collect();
    require_names(source, &names)?;
    let row = |index| ColumnsRow { columns, index };
    // A line of units makes text of all columns.
    let is_text = |column: &NamedColumn<'_>| matches!(column.values, Values::Texts(_));
    let units = if rows > 0 && columns.iter().all(is_text) {
        let cells: Vec<String> =
            (0..columns.len()).map(|column| row(0).text(column).trim().to_string()).collect();
        are_units(&cells, &names, options).then_some(cells)
    } else {
        None
    };
    let mapping = Mapping::new(source, &names, units.as_deref().unwrap_or_default(), options)?;
    let mut table = LogTable::new(source, &names, mapping, options);
    for index in usize::from(units.is_some())..rows {
        if !table.passes_over() {
            table.take_row(&row(index))?;
        }
    }
    table.finish()
}

/// One row of columns.
#[derive(Clone, Copy)]
struct ColumnsRow<'a> {
    columns: &'a [NamedColumn<'a>],
    index: usize,
}

impl TableRow for ColumnsRow<'_> {
    fn line(&self) -> u64 {
        self.index as u64 + 2
    }

    fn text(&self, column: usize) -> String {
        match &self.columns[column].values {
            Values::Numbers(values) => format!("{:?}", values[self.index]),
            Values::Integers(values) => values[self.index].to_string(),
            Values::Seconds(values) => seconds_text(values[self.index]),
            Values::Instants(values) => {
                format!("{} s since 1970", seconds_text(values[self.index]))
            }
            Values::Texts(values) => values[self.index].clone(),
        }
    }

    fn number(&self, column: usize) -> Option<f64> {
        match &self.columns[column].values {
            Values::Numbers(values) => Some(values[self.index]),
            Values::Integers(values) => Some(values[self.index] as f64),
            Values::Seconds(values) => seconds_text(values[self.index]).parse().ok(),
            Values::Instants(_) => None,
            Values::Texts(values) => number_of(values[self.index].trim()),
        }
    }

    fn moment(&self, column: usize) -> Option<Moment> {
        match &self.columns[column].values {
            Values::Instants(values) => Some(Moment::Instant(values[self.index])),
            Values::Texts(values) => moment_of(values[self.index].trim()),
            _ => None,
        }
    }

    fn time(&self, column: usize, unit: TimeUnit) -> Option<i64> {
        let power = unit.power_of_ten();
        match &self.columns[column].values {
            Values::Numbers(values) => nanoseconds_of(values[self.index], power),
            Values::Integers(values) => unit.nanoseconds(values[self.index]),
            Values::Seconds(values) if unit == TimeUnit::Second => Some(values[self.index]),
            Values::Seconds(values) => nanoseconds(&seconds_text(values[self.index]), power),
            Values::Instants(_) => None,
            Values::Texts(values) => nanoseconds(values[self.index].trim(), power),
        }
    }
}

/// What the shortest decimal that is this number means as a time in units of 10^`power` ns, ns.
fn nanoseconds_of(value: f64, power: i32) -> Option<i64> {
    /// Decimals of fewer digits are told apart by their numbers: one that gives the number is its
    /// shortest.
    const TOLD_APART: f64 = 1e15;
    let unit = 10_f64.powi(power);
    let likely = (value * unit).round();
    if likely.abs() < TOLD_APART && likely / unit == value {
        return Some(likely as i64);
    }
    nanoseconds(&format!("{value:?}"), power)
}

/// ns as decimal seconds.
pub(crate) fn seconds_text(nanoseconds: i64) -> String {
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let size = nanoseconds.unsigned_abs();
    format!("{sign}{}.{:09}", size / 1_000_000_000, size % 1_000_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_the_time_that_its_decimals_say() {
        let mut value = 0.0_f64;
        for k in 0..200_000_u32 {
            // Decimals of milliseconds, sums that are none, and seconds since 1970.
            value += 0.004;
            for value in [f64::from(k) * 0.004, f64::from(k) / 250.0, value, 1.7e9 + value, -value]
            {
                for power in [0, 3, 6, 9] {
                    assert_eq!(
                        nanoseconds_of(value, power),
                        nanoseconds(&value.to_string(), power),
                        "{value:?}"
                    );
                }
            }
        }
        for value in [f64::NAN, f64::INFINITY, 1e300, 9.3e9] {
            assert_eq!(nanoseconds_of(value, 9), None, "{value}");
        }
    }
}
