//! The rows of a table, text or numbers, to the arrays of a recording.

use super::joints::ColumnSource;
use super::mapping::{Mapping, TimeSource};
use super::{ReadOptions, Rows};
use crate::calendar::{Moment, moment};
use crate::names::quoted;
use crate::{Channel, IssueKind, Layout, Recording, RecordingError, TimeUnit, Units};

/// What the columns of a table hold in one row.
pub(super) trait TableRow {
    /// Number of the line that holds it, from 1; the names stand in the first.
    fn line(&self) -> u64;

    /// A cell as text, for messages.
    fn text(&self, column: usize) -> String;

    /// The number in a cell; NaN if it is empty or says that there is none.
    fn number(&self, column: usize) -> Option<f64>;

    /// The date or the time of day in a cell, if there is one and no number.
    fn moment(&self, column: usize) -> Option<Moment>;

    /// The time in a cell that counts in `unit`, ns.
    fn time(&self, column: usize, unit: TimeUnit) -> Option<i64>;
}

/// A number in text; NaN if it is empty or says that there is none.
pub(super) fn number_of(text: &str) -> Option<f64> {
    match text {
        "" | "NA" | "N/A" | "n/a" | "null" | "None" | "-" => Some(f64::NAN),
        "true" | "True" | "TRUE" => Some(1.0),
        "false" | "False" | "FALSE" => Some(0.0),
        text => text.parse().ok(),
    }
}

/// The date or the time of day in text, if there is one and no number.
pub(super) fn moment_of(text: &str) -> Option<Moment> {
    if text.parse::<f64>().is_ok() { None } else { moment(text) }
}

/// Refuses options that no log could satisfy.
pub(super) fn check(path: &str, options: &ReadOptions) -> Result<(), RecordingError> {
    if let Some(joints) = &options.joints {
        crate::require_joint_list(path, joints)?;
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

/// What a table is called, and its columns.
#[derive(Clone, Copy)]
struct Names<'a> {
    path: &'a str,
    columns: &'a [String],
}

impl Names<'_> {
    /// Letters of a cell that a message shows.
    const SHOWN: usize = 40;

    fn not_a_number(&self, row: &impl TableRow, column: usize) -> RecordingError {
        RecordingError::NotANumber {
            path: self.path.into(),
            line: row.line(),
            column: self.columns[column].clone(),
            text: row.text(column).chars().take(Self::SHOWN).collect(),
        }
    }

    fn time(
        &self,
        row: &impl TableRow,
        column: usize,
        unit: TimeUnit,
    ) -> Result<i64, RecordingError> {
        row.time(column, unit).ok_or_else(|| self.not_a_time(row, column, unit.name()))
    }

    fn not_a_time(&self, row: &impl TableRow, column: usize, unit: &str) -> RecordingError {
        RecordingError::NotATime {
            path: self.path.into(),
            line: row.line(),
            column: self.columns[column].clone(),
            text: row.text(column).chars().take(Self::SHOWN).collect(),
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

    fn take(&mut self, row: &impl TableRow, names: Names<'_>) -> Result<(), RecordingError> {
        for ColumnSource { index, factor, .. } in &self.sources {
            self.values
                .push(row.number(*index).ok_or_else(|| names.not_a_number(row, *index))? * factor);
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
    fn take(&mut self, row: &impl TableRow, names: Names<'_>) -> Result<(), RecordingError> {
        if self.text {
            return Ok(());
        }
        match row.number(self.index) {
            Some(value) => {
                self.numeric |= !value.is_nan();
                self.values.push(value);
            }
            None if self.numeric => return Err(names.not_a_number(row, self.index)),
            None => {
                self.text = true;
                self.values = Vec::new();
            }
        }
        Ok(())
    }
}

/// The rows so far, as arrays.
pub(super) struct LogTable<'a> {
    names: Names<'a>,
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
    /// Data rows of the file so far, those of them whose time was read, and the times of the first
    /// and last of these.
    rows: usize,
    timed: usize,
    span: [i64; 2],
}

impl<'a> LogTable<'a> {
    pub(super) fn new(
        path: &'a str,
        columns: &'a [String],
        mapping: Mapping,
        options: &'a ReadOptions,
    ) -> Self {
        let Mapping { joints, clock, position, velocity, torque, notes, layout } = mapping;
        let mut used: Vec<usize> = match clock {
            TimeSource::Rate(_) => vec![],
            TimeSource::Column { index, .. } | TimeSource::Calendar { index, .. } => vec![index],
            TimeSource::Stamp { seconds, nanoseconds } => vec![seconds, nanoseconds],
        };
        let arrays = [Some(&position), velocity.as_ref(), torque.as_ref()];
        used.extend(arrays.into_iter().flatten().flatten().map(|source| source.index));
        let free =
            (0..columns.len()).filter(|index| !used.contains(index) && !columns[*index].is_empty());
        let channel =
            |index| ChannelColumn { index, values: Vec::new(), numeric: false, text: false };
        Self {
            names: Names { path, columns },
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

    /// Counts a row that is not among those chosen by their numbers. What it holds is nobody's
    /// concern: it may be what the choice is to leave out.
    pub(super) fn passes_over(&mut self) -> bool {
        self.rows += 1;
        matches!(&self.options.rows, Some(Rows::Numbers(numbers)) if !numbers.contains(&self.rows))
    }

    pub(super) fn take_row(&mut self, row: &impl TableRow) -> Result<(), RecordingError> {
        self.timed += 1;
        let time = self.time_of(row)?;
        self.span = [if self.timed == 1 { time } else { self.span[0] }, time];
        if !self.is_wanted(time) {
            return Ok(());
        }
        self.time.push(time);
        let names = self.names;
        self.position.take(row, names)?;
        self.velocity
            .iter_mut()
            .chain(&mut self.torque)
            .try_for_each(|array| array.take(row, names))?;
        self.channels.iter_mut().try_for_each(|channel| channel.take(row, names))?;
        self.require_room()
    }

    fn time_of(&mut self, row: &impl TableRow) -> Result<i64, RecordingError> {
        if let (1, TimeSource::Column { index, unit }) = (self.timed, self.clock) {
            self.clock = self.clock_of(row, index, unit);
        }
        match self.clock {
            TimeSource::Rate(rate) => Ok(((self.rows - 1) as f64 * 1e9 / rate).round() as i64),
            TimeSource::Column { index, unit } => {
                self.names.time(row, index, unit.unwrap_or(TimeUnit::Second))
            }
            TimeSource::Stamp { seconds, nanoseconds } => {
                let whole = self.names.time(row, seconds, TimeUnit::Second)?;
                Ok(whole.saturating_add(self.names.time(row, nanoseconds, TimeUnit::Nanosecond)?))
            }
            TimeSource::Calendar { index, midnights, before } => {
                let now = match row.moment(index) {
                    Some(Moment::Instant(now)) => return Ok(now),
                    Some(Moment::TimeOfDay(now)) => now,
                    None => {
                        return Err(self.names.not_a_time(row, index, "dates and times of day"));
                    }
                };
                // A clock that goes back by more than half a day has passed midnight.
                let midnights = midnights + i64::from(before - now > DAY / 2);
                self.clock = TimeSource::Calendar { index, midnights, before: now };
                Ok(midnights.saturating_mul(DAY).saturating_add(now))
            }
        }
    }

    /// What the first row tells of a time column.
    fn clock_of(
        &mut self,
        row: &impl TableRow,
        index: usize,
        unit: Option<TimeUnit>,
    ) -> TimeSource {
        if let Some(moment) = row.moment(index) {
            let before = if let Moment::TimeOfDay(now) = moment { now } else { 0 };
            return TimeSource::Calendar { index, midnights: 0, before };
        }
        let likely = unit.unwrap_or_else(|| TimeUnit::likely(row.number(index).unwrap_or(0.0)));
        if unit.is_none() && likely != TimeUnit::Second {
            self.notes.push(format!(
                "the column `{}` is taken for {likely} since 1970",
                self.names.columns[index]
            ));
        }
        self.layout.time = match unit {
            None => format!("{} in {likely} (assumed)", self.names.columns[index]),
            Some(unit) => format!("{} in {unit}", self.names.columns[index]),
        };
        TimeSource::Column { index, unit: Some(likely) }
    }

    /// Where the time comes from, in words.
    fn time_in_words(&self) -> String {
        let name = |index: usize| &self.names.columns[index];
        match self.clock {
            TimeSource::Rate(rate) => format!("counted at {rate} Hz"),
            TimeSource::Column { .. } => self.layout.time.clone(),
            TimeSource::Stamp { seconds, nanoseconds } => {
                format!("{} in s and {} in ns", name(seconds), name(nanoseconds))
            }
            TimeSource::Calendar { index, .. } => {
                format!("{} as dates or times of day", name(index))
            }
        }
    }

    fn is_wanted(&self, time: i64) -> bool {
        match &self.options.rows {
            None | Some(Rows::Numbers(_)) => true,
            Some(Rows::Seconds(seconds)) => seconds.contains(&crate::seconds(self.span[0], time)),
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
        Err(RecordingError::TooLarge { path: self.names.path.into(), limit })
    }

    pub(super) fn finish(mut self) -> Result<Recording, RecordingError> {
        if self.rows == 0 {
            return Err(RecordingError::NoRows { path: self.names.path.into() });
        }
        if let (Some(rows), true) = (&self.options.rows, self.time.is_empty()) {
            let duration = (self.timed > 0).then(|| crate::seconds(self.span[0], self.span[1]));
            let (path, rows) = (self.names.path.into(), rows.to_string());
            return Err(RecordingError::NoRowsChosen { path, rows, samples: self.rows, duration });
        }
        let layout = Layout { time: self.time_in_words(), ..self.layout.clone() };
        let mut accepted = self.options.accept.clone();
        accepted.extend(stated_by_caller(&self.options.units));
        let (text, numeric): (Vec<_>, Vec<_>) =
            self.channels.into_iter().partition(|channel| channel.text);
        let skipped: Vec<String> =
            text.iter().map(|channel| self.names.columns[channel.index].clone()).collect();
        if !skipped.is_empty() {
            self.notes.push(format!("skipped columns of text: {}", quoted(&skipped)));
        }
        let channel = |column: ChannelColumn| Channel {
            name: self.names.columns[column.index].clone(),
            values: column.values,
        };
        let recording = Recording::new(
            self.names.path,
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
