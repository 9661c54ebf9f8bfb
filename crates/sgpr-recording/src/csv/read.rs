use std::borrow::Cow;
use std::io::BufRead;
use std::path::Path;

use super::header;
use super::joints::expand;
use super::lines::{Lines, decoded};
use super::mapping::Mapping;
use super::quantity::Quantity;
use super::table::{LogTable, TableRow, check, moment_of, number_of};
use super::{Columns, ReadOptions, source};
use crate::calendar::{Moment, moment};
use crate::decimal::nanoseconds;
use crate::names::counted;
use crate::{Recording, RecordingError, TimeUnit};

/// Reads a table. How columns are understood is told in the [module documentation](super).
///
/// Values are taken as they are; an empty cell and `nan` become NaN, to be found by
/// [`inspect`](crate::inspect()). Numeric columns that belong to no joint become channels; text
/// columns are skipped. What was assumed or left out is in [`Recording::notes`].
///
/// # Errors
/// If the file is unreadable, empty, of another kind, too large, has no header, no rows, rows of
/// unequal length, text in a column of numbers; if time or joint columns are missing or can be
/// understood in several ways; if an option contradicts the file.
///
/// # Examples
/// ```no_run
/// use sgpr_recording::csv::{self, ReadOptions};
/// let recording = csv::read("log.csv.gz", &ReadOptions::default())?;
/// println!("{} joints at {:?} Hz", recording.dof(), recording.sample_rate_hz());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    check(&name, options)?;
    let explain = |error| source::explain(&name, options.limit_bytes, error);

    let mut lines = Lines::new(source::open(path, options.limit_bytes)?);
    let header = lines.header(|cells| names_a_log(cells, options)).map_err(explain)?;
    let columns = header.columns(&name)?;
    let units = lines
        .units(|cells| are_units(cells, &columns, options))
        .map_err(explain)?
        .unwrap_or_default();
    let mut mapping = Mapping::new(&name, &columns, &units, options)?;
    if header.titles > 0 {
        mapping.notes.insert(
            0,
            format!(
                "passed over {} above the names of the columns",
                counted(header.titles, "line")
            ),
        );
    }
    let mut table = LogTable::new(&name, &columns, mapping, options);
    while lines.next_row().map_err(explain)? {
        if table.passes_over() {
            continue;
        }
        table.take_row(&TextRow::new(&name, columns.len(), &lines)?)?;
    }
    table.finish()
}

/// Whether cells name the columns of a log: a time, unless it is counted, and a position.
fn names_a_log(cells: &[String], options: &ReadOptions) -> bool {
    let is_stamp = |cell: &String| header::stamp_part(cell).is_some();
    let is_time = |cell: &String| header::time_unit(cell).is_some() || is_stamp(cell);
    let has_time = match &options.columns.time {
        Some(name) => cells.contains(name),
        None => options.sample_rate_hz.is_some() || cells.iter().any(is_time),
    };
    let joints = options.joints.as_deref();
    let is_position_of = |cell: &String, joints: Option<&[String]>| {
        header::meaning(cell, joints).is_some_and(|meaning| meaning.quantity == Quantity::Position)
    };
    // Joints of other names make it a log, too: what to do about them is said later.
    let is_position = |cell: &String| is_position_of(cell, joints) || is_position_of(cell, None);
    let first_joint = joints.and_then(<[String]>::first).map_or("", String::as_str);
    let has_position = match &options.columns.position {
        Some(Columns::Names(names)) => names.iter().any(|name| cells.contains(name)),
        Some(Columns::Pattern(pattern)) => cells.contains(&expand(pattern, 1, first_joint)),
        None => cells.iter().any(is_position),
    };
    has_time && has_position
}

/// Whether cells are units: no numbers, and each that stands in a column of time or of a joint is a
/// unit of it, or in brackets.
pub(super) fn are_units(cells: &[String], columns: &[String], options: &ReadOptions) -> bool {
    let is_number = |cell: &String| cell.parse::<f64>().is_ok() || moment(cell).is_some();
    if cells.len() != columns.len() || cells.iter().any(is_number) {
        return false;
    }
    let is_unit = |cell: &String| {
        let text = header::bracketed(cell).unwrap_or(cell);
        text.parse::<TimeUnit>().is_ok()
            || Quantity::ALL.iter().any(|quantity| quantity.unit(text).is_some())
    };
    let is_time = |name: &String| {
        options.columns.time.as_ref() == Some(name) || header::time_unit(name).is_some()
    };
    let of_time = cells.iter().zip(columns).find(|(_, name)| is_time(name)).map(|(cell, _)| cell);
    of_time.map_or_else(|| cells.iter().any(is_unit), is_unit)
}

/// One row of text.
struct TextRow<'a> {
    line: u64,
    cells: Vec<Cow<'a, [u8]>>,
    decimal_comma: bool,
}

impl<'a> TextRow<'a> {
    fn new(
        path: &str,
        columns: usize,
        lines: &'a Lines<impl BufRead>,
    ) -> Result<Self, RecordingError> {
        let (line, mut cells, decimal_comma) =
            (lines.number(), lines.cells(), lines.has_decimal_comma());
        // Some loggers end each row, but not the header, with a separator.
        if cells.len() == columns + 1 && cells.last().is_some_and(|cell| cell.is_empty()) {
            cells.pop();
        }
        if cells.len() == columns {
            return Ok(Self { line, cells, decimal_comma });
        }
        Err(RecordingError::RowLength {
            path: path.into(),
            line,
            expected: columns,
            found: cells.len(),
        })
    }

    fn cell(&self, column: usize) -> Cow<'_, str> {
        let text = String::from_utf8_lossy(&self.cells[column]);
        if self.decimal_comma && text.contains(',') {
            text.replacen(',', ".", 1).into()
        } else {
            text
        }
    }
}

impl TableRow for TextRow<'_> {
    fn line(&self) -> u64 {
        self.line
    }

    fn text(&self, column: usize) -> String {
        decoded(&self.cells[column]).into_owned()
    }

    fn number(&self, column: usize) -> Option<f64> {
        number_of(&self.cell(column))
    }

    fn moment(&self, column: usize) -> Option<Moment> {
        moment_of(&self.cell(column))
    }

    fn time(&self, column: usize, unit: TimeUnit) -> Option<i64> {
        nanoseconds(&self.cell(column), unit.power_of_ten())
    }
}
