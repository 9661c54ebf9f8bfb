use std::borrow::Cow;
use std::io::BufRead;
use std::path::Path;

use super::header;
use super::joints::ColumnSource;
use super::joints::expand;
use super::lines::{Lines, decoded};
use super::mapping::{Mapping, TimeSource};
use super::quantity::Quantity;
use super::{Columns, ReadOptions, Rows, source};
use crate::recording::calendar::{Moment, moment};
use crate::recording::decimal::nanoseconds;
use crate::recording::names::{counted, quoted};
use crate::recording::{self, Channel, IssueKind, Layout, Recording, RecordingError, TimeUnit, Units};

/// Reads a table. How columns are understood is told in the [module documentation](super).
///
/// Values are taken as they are; an empty cell and `nan` become NaN, to be found by
/// [`inspect`](crate::recording::inspect()). Numeric columns that belong to no joint become channels; text columns are
/// skipped. What was assumed or left out is in [`Recording::notes`].
///
/// # Errors
/// If the file is unreadable, empty, of another kind, too large, has no header, no rows, rows of unequal length, text in
/// a column of numbers; if time or joint columns are missing or can be understood in several ways; if an option
/// contradicts the file.
///
/// # Examples
/// ```no_run
/// use sgpr_core::recording::csv::{self, ReadOptions};
/// let recording = csv::read("log.csv.gz", &ReadOptions::default())?;
/// println!("{} joints at {:?} Hz", recording.dof(), recording.sample_rate_hz());
/// # Ok::<(), sgpr_core::recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    check(&name, options)?;
    let explain = |error| source::explain(&name, options.limit_bytes, error);

    let mut lines = Lines::new(source::open(path, options.limit_bytes)?);
    let header = lines.header(|cells| names_a_log(cells, options)).map_err(explain)?;
    let columns = header.columns(&name)?;
    let units = lines.units(|cells| are_units(cells, &columns, options)).map_err(explain)?.unwrap_or_default();
    let mut mapping = Mapping::new(&name, &columns, &units, options)?;
    if header.titles > 0 {
        mapping
            .notes
            .insert(0, format!("passed over {} above the names of the columns", counted(header.titles, "line")));
    }
    let mut table = LogTable::new(&name, &columns, mapping, options);
    while lines.next_row().map_err(explain)? {
        if table.passes_over() {
            continue;
        }
        table.take_row(TextRow::new(&name, &columns, &lines)?)?;
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

/// Whether cells are units: no numbers, and each that stands in a column of time or of a joint is a unit of it, or in
/// brackets.
fn are_units(cells: &[String], columns: &[String], options: &ReadOptions) -> bool {
    let is_number = |cell: &String| cell.parse::<f64>().is_ok() || moment(cell).is_some();
    if cells.len() != columns.len() || cells.iter().any(is_number) {
        return false;
    }
    let is_unit = |cell: &String| {
        let text = header::bracketed(cell).unwrap_or(cell);
        text.parse::<TimeUnit>().is_ok() || Quantity::ALL.iter().any(|quantity| quantity.unit(text).is_some())
    };
    let is_time = |name: &String| options.columns.time.as_ref() == Some(name) || header::time_unit(name).is_some();
    let of_time = cells.iter().zip(columns).find(|(_, name)| is_time(name)).map(|(cell, _)| cell);
    of_time.map_or_else(|| cells.iter().any(is_unit), is_unit)
}

/// Refuses options that no log could satisfy.
fn check(path: &str, options: &ReadOptions) -> Result<(), RecordingError> {
    if let Some(joints) = &options.joints {
        recording::require_joint_list(path, joints)?;
    }
    match options.sample_rate_hz {
        Some(rate) if !(rate.is_finite() && rate > 0.0) => Err(RecordingError::InvalidOption {
            option: "sample_rate_hz",
            value: rate.to_string(),
            expected: "a positive number of samples per second",
        }),
        _ => Ok(()),
    }
}

/// ns
const DAY: i64 = 86_400_000_000_000;

/// Findings on units that the caller has answered by stating the unit.
fn stated_by_caller(units: &Units) -> Vec<IssueKind> {
    let stated = [
        (units.position.is_some(), IssueKind::PositionInDegrees),
        (units.time.is_some(), IssueKind::UnlikelyRate),
        (units.torque.is_some(), IssueKind::TorqueScale),
    ];
    stated.into_iter().filter(|(is_stated, _)| *is_stated).map(|(_, kind)| kind).collect()
}

/// One row of text.
struct TextRow<'a> {
    path: &'a str,
    columns: &'a [String],
    line: u64,
    cells: Vec<Cow<'a, [u8]>>,
    decimal_comma: bool,
}

impl<'a> TextRow<'a> {
    fn new(path: &'a str, columns: &'a [String], lines: &'a Lines<impl BufRead>) -> Result<Self, RecordingError> {
        let (line, mut cells, decimal_comma) = (lines.number(), lines.cells(), lines.has_decimal_comma());
        // Some loggers end each row, but not the header, with a separator.
        if cells.len() == columns.len() + 1 && cells.last().is_some_and(|cell| cell.is_empty()) {
            cells.pop();
        }
        if cells.len() == columns.len() {
            return Ok(Self { path, columns, line, cells, decimal_comma });
        }
        Err(RecordingError::RowLength { path: path.into(), line, expected: columns.len(), found: cells.len() })
    }

    fn text(&self, column: usize) -> Cow<'_, str> {
        let text = String::from_utf8_lossy(&self.cells[column]);
        if self.decimal_comma && text.contains(',') { text.replacen(',', ".", 1).into() } else { text }
    }

    /// The number in a cell; NaN if it is empty or says that there is none.
    fn number(&self, column: usize) -> Option<f64> {
        let text = self.text(column);
        match text.as_ref() {
            "" | "NA" | "N/A" | "n/a" | "null" | "None" | "-" => Some(f64::NAN),
            "true" | "True" | "TRUE" => Some(1.0),
            "false" | "False" | "FALSE" => Some(0.0),
            text => text.parse().ok(),
        }
    }

    fn not_a_number(&self, column: usize) -> RecordingError {
        RecordingError::NotANumber {
            path: self.path.into(),
            line: self.line,
            column: self.columns[column].clone(),
            text: decoded(&self.cells[column]).chars().take(40).collect(),
        }
    }

    /// The date or the time of day in a cell, if there is one and no number.
    fn moment(&self, column: usize) -> Option<Moment> {
        let text = self.text(column);
        if text.parse::<f64>().is_ok() { None } else { moment(&text) }
    }

    /// The time in a cell, ns.
    fn time(&self, column: usize, unit: TimeUnit) -> Result<i64, RecordingError> {
        let text = self.text(column);
        nanoseconds(&text, unit.power_of_ten()).ok_or_else(|| self.not_a_time(column, unit.name()))
    }

    fn not_a_time(&self, column: usize, unit: &str) -> RecordingError {
        RecordingError::NotATime {
            path: self.path.into(),
            line: self.line,
            column: self.columns[column].clone(),
            text: decoded(&self.cells[column]).chars().take(40).collect(),
            unit: unit.into(),
        }
    }
}

/// One value per joint and sample.
struct Array {
    sources: Vec<ColumnSource>,
    /// Row-major.
    values: Vec<f64>,
}

impl Array {
    fn new(sources: Vec<ColumnSource>) -> Self {
        Self { sources, values: Vec::new() }
    }

    fn take(&mut self, row: &TextRow) -> Result<(), RecordingError> {
        for ColumnSource { index, factor, .. } in &self.sources {
            self.values.push(row.number(*index).ok_or_else(|| row.not_a_number(*index))? * factor);
        }
        Ok(())
    }
}

/// A column beside the joints.
struct ChannelColumn {
    index: usize,
    values: Vec<f64>,
    /// Whether there was a number.
    numeric: bool,
    /// Whether it turned out to hold text.
    text: bool,
}

impl ChannelColumn {
    /// A column that begins with text is text; text after numbers is an error.
    fn take(&mut self, row: &TextRow) -> Result<(), RecordingError> {
        match row.number(self.index) {
            _ if self.text => {}
            Some(value) => {
                self.numeric |= !value.is_nan();
                self.values.push(value);
            }
            None if self.numeric => return Err(row.not_a_number(self.index)),
            None => {
                self.text = true;
                self.values = Vec::new();
            }
        }
        Ok(())
    }
}

/// The rows so far, as arrays.
struct LogTable<'a> {
    path: &'a str,
    columns: &'a [String],
    options: &'a ReadOptions,
    joints: Vec<String>,
    clock: TimeSource,
    time: Vec<i64>,
    position: Array,
    velocity: Option<Array>,
    torque: Option<Array>,
    channels: Vec<ChannelColumn>,
    notes: Vec<String>,
    layout: Layout,
    /// Data rows of the file so far, those of them whose time was read, and the times of the first and last of these.
    rows: usize,
    timed: usize,
    span: [i64; 2],
}

impl<'a> LogTable<'a> {
    fn new(path: &'a str, columns: &'a [String], mapping: Mapping, options: &'a ReadOptions) -> Self {
        let Mapping { joints, clock, position, velocity, torque, notes, layout } = mapping;
        let mut used: Vec<usize> = match clock {
            TimeSource::Rate(_) => vec![],
            TimeSource::Column { index, .. } | TimeSource::Calendar { index, .. } => vec![index],
            TimeSource::Stamp { seconds, nanoseconds } => vec![seconds, nanoseconds],
        };
        let arrays = [Some(&position), velocity.as_ref(), torque.as_ref()];
        used.extend(arrays.into_iter().flatten().flatten().map(|source| source.index));
        let free = (0..columns.len()).filter(|index| !used.contains(index) && !columns[*index].is_empty());
        let channel = |index| ChannelColumn { index, values: Vec::new(), numeric: false, text: false };
        Self {
            path,
            columns,
            options,
            joints,
            clock,
            time: Vec::new(),
            position: Array::new(position),
            velocity: velocity.map(Array::new),
            torque: torque.map(Array::new),
            channels: free.map(channel).collect(),
            notes,
            layout,
            rows: 0,
            timed: 0,
            span: [0, 0],
        }
    }

    /// Counts a row that is not among those chosen by their numbers. What it holds is nobody's concern: it may be what
    /// the choice is to leave out.
    fn passes_over(&mut self) -> bool {
        self.rows += 1;
        matches!(&self.options.rows, Some(Rows::Numbers(numbers)) if !numbers.contains(&self.rows))
    }

    fn take_row(&mut self, row: TextRow) -> Result<(), RecordingError> {
        self.timed += 1;
        let time = self.time_of(&row)?;
        self.span = [if self.timed == 1 { time } else { self.span[0] }, time];
        if !self.is_wanted(time) {
            return Ok(());
        }
        self.time.push(time);
        self.position.take(&row)?;
        self.velocity.iter_mut().chain(&mut self.torque).try_for_each(|array| array.take(&row))?;
        self.channels.iter_mut().try_for_each(|channel| channel.take(&row))?;
        self.require_room()
    }

    fn time_of(&mut self, row: &TextRow) -> Result<i64, RecordingError> {
        if let (1, TimeSource::Column { index, unit }) = (self.timed, self.clock) {
            self.clock = self.clock_of(row, index, unit);
        }
        match self.clock {
            TimeSource::Rate(rate) => Ok(((self.rows - 1) as f64 * 1e9 / rate).round() as i64),
            TimeSource::Column { index, unit } => row.time(index, unit.unwrap_or(TimeUnit::Second)),
            TimeSource::Stamp { seconds, nanoseconds } => {
                let whole = row.time(seconds, TimeUnit::Second)?;
                Ok(whole.saturating_add(row.time(nanoseconds, TimeUnit::Nanosecond)?))
            }
            TimeSource::Calendar { index, midnights, before } => {
                let now = match row.moment(index) {
                    Some(Moment::Instant(now)) => return Ok(now),
                    Some(Moment::TimeOfDay(now)) => now,
                    None => return Err(row.not_a_time(index, "dates and times of day")),
                };
                // A clock that goes back by more than half a day has passed midnight.
                let midnights = midnights + i64::from(before - now > DAY / 2);
                self.clock = TimeSource::Calendar { index, midnights, before: now };
                Ok(midnights.saturating_mul(DAY).saturating_add(now))
            }
        }
    }

    /// What the first row tells of a time column.
    fn clock_of(&mut self, row: &TextRow, index: usize, unit: Option<TimeUnit>) -> TimeSource {
        if let Some(moment) = row.moment(index) {
            let before = if let Moment::TimeOfDay(now) = moment { now } else { 0 };
            return TimeSource::Calendar { index, midnights: 0, before };
        }
        let likely = unit.unwrap_or_else(|| TimeUnit::likely(row.number(index).unwrap_or(0.0)));
        if unit.is_none() && likely != TimeUnit::Second {
            self.notes.push(format!("the column `{}` is taken for {likely} since 1970", self.columns[index]));
        }
        self.layout.time = match unit {
            None => format!("{} in {likely} (assumed)", self.columns[index]),
            Some(unit) => format!("{} in {unit}", self.columns[index]),
        };
        TimeSource::Column { index, unit: Some(likely) }
    }

    /// Where the time comes from, in words.
    fn time_in_words(&self) -> String {
        let name = |index: usize| &self.columns[index];
        match self.clock {
            TimeSource::Rate(rate) => format!("counted at {rate} Hz"),
            TimeSource::Column { .. } => self.layout.time.clone(),
            TimeSource::Stamp { seconds, nanoseconds } => {
                format!("{} in s and {} in ns", name(seconds), name(nanoseconds))
            }
            TimeSource::Calendar { index, .. } => format!("{} as dates or times of day", name(index)),
        }
    }

    fn is_wanted(&self, time: i64) -> bool {
        match &self.options.rows {
            None | Some(Rows::Numbers(_)) => true,
            Some(Rows::Seconds(seconds)) => seconds.contains(&recording::seconds(self.span[0], time)),
        }
    }

    fn require_room(&self) -> Result<(), RecordingError> {
        let arrays = 1 + usize::from(self.velocity.is_some()) + usize::from(self.torque.is_some());
        let channels = self.channels.iter().filter(|channel| !channel.text).count();
        let row_bytes = 8 * (1 + arrays * self.joints.len() + channels);
        let limit = self.options.limit_bytes;
        if (self.time.len() * row_bytes) as u64 <= limit {
            return Ok(());
        }
        Err(RecordingError::TooLarge { path: self.path.into(), limit })
    }

    fn finish(mut self) -> Result<Recording, RecordingError> {
        if self.rows == 0 {
            return Err(RecordingError::NoRows { path: self.path.into() });
        }
        if let (Some(rows), true) = (&self.options.rows, self.time.is_empty()) {
            let duration = (self.timed > 0).then(|| recording::seconds(self.span[0], self.span[1]));
            let (path, rows) = (self.path.into(), rows.to_string());
            return Err(RecordingError::NoRowsChosen { path, rows, samples: self.rows, duration });
        }
        let layout = Layout { time: self.time_in_words(), ..self.layout.clone() };
        let mut accepted = self.options.accept.clone();
        accepted.extend(stated_by_caller(&self.options.units));
        let (text, numeric): (Vec<_>, Vec<_>) = self.channels.into_iter().partition(|channel| channel.text);
        let skipped: Vec<String> = text.iter().map(|channel| self.columns[channel.index].clone()).collect();
        if !skipped.is_empty() {
            self.notes.push(format!("skipped columns of text: {}", quoted(&skipped)));
        }
        let channel =
            |column: ChannelColumn| Channel { name: self.columns[column.index].clone(), values: column.values };
        let recording = Recording::new(
            self.path,
            self.joints,
            self.time,
            self.position.values,
            self.velocity.map(|array| array.values),
            self.torque.map(|array| array.values),
            numeric.into_iter().map(channel).collect(),
        )?;
        Ok(recording.with_notes(self.notes).with_layout(Some(layout)).accepting(&accepted))
    }
}
