//! Which column is the time, and which belong to which joint.

use super::header::{self, Label, Quantity};
use super::joints::{JointColumns, expand};
use super::{Columns, ReadOptions};
use crate::recording::names::quoted;
use crate::recording::part::ending_number;
use crate::recording::{RecordingError, TimeUnit};

/// Where the time comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Clock {
    /// A constant rate, Hz.
    Rate(f64),
    /// A column and its unit, if that is known.
    Column { index: usize, unit: Option<TimeUnit> },
    /// The two columns of a ROS time stamp.
    Stamp { seconds: usize, nanoseconds: usize },
}

/// A column and what one of its units is in SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Source {
    pub(super) index: usize,
    pub(super) factor: f64,
}

/// The columns of a log, understood.
#[derive(Debug)]
pub(super) struct Mapping {
    pub(super) joints: Vec<String>,
    pub(super) clock: Clock,
    pub(super) position: Vec<Source>,
    pub(super) velocity: Option<Vec<Source>>,
    pub(super) torque: Option<Vec<Source>>,
    pub(super) notes: Vec<String>,
}

impl Mapping {
    pub(super) fn new(path: &str, columns: &[String], options: &ReadOptions) -> Result<Self, RecordingError> {
        require_distinct(path, columns)?;
        let clock = clock(path, columns, options)?;
        let table = JointColumns::new(path, columns, options)?;
        let mapper = Mapper { table: &table, options };
        let units = &options.units;

        let position = mapper.find(Quantity::Position)?.ok_or_else(|| table.no_positions())?;
        let velocity = mapper.find(Quantity::Velocity)?;
        let mut notes: Vec<String> = mapper.note_on_numbers(&position).into_iter().collect();
        notes.extend(note_on_unused_time(columns, &clock));
        let torque = match &options.torque_constants {
            Some(constants) => {
                if table.of(Quantity::Torque).next().is_some() {
                    notes.push("torque is computed from the currents; torque columns are kept as channels".into());
                }
                Some(mapper.torque_from_current(constants)?)
            }
            None => {
                let unit = units.torque.map(|unit| unit.factor());
                mapper.find(Quantity::Torque)?.map(|columns| table.sources(columns, unit))
            }
        };
        Ok(Self {
            clock,
            position: table.sources(position, units.position.map(|unit| unit.factor())),
            velocity: velocity.map(|columns| table.sources(columns, units.velocity.map(|unit| unit.factor()))),
            torque,
            notes,
            joints: table.joints,
        })
    }
}

fn require_distinct(path: &str, columns: &[String]) -> Result<(), RecordingError> {
    let mut sorted: Vec<&String> = columns.iter().filter(|name| !name.is_empty()).collect();
    sorted.sort();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(RecordingError::DuplicateColumn { path: path.into(), column: pair[0].clone() }),
        None => Ok(()),
    }
}

/// The index of the column `column`.
fn require(path: &str, columns: &[String], column: &str) -> Result<usize, RecordingError> {
    columns.iter().position(|name| name == column).ok_or_else(|| RecordingError::UnknownColumn {
        path: path.into(),
        column: column.into(),
        columns: columns.to_vec(),
    })
}

fn clock(path: &str, columns: &[String], options: &ReadOptions) -> Result<Clock, RecordingError> {
    if let Some(rate) = options.sample_rate_hz {
        return Ok(Clock::Rate(rate));
    }
    let unit = |name: &str| options.units.time.or(header::time_unit(name).flatten());
    if let Some(name) = &options.columns.time {
        return Ok(Clock::Column { index: require(path, columns, name)?, unit: unit(name) });
    }
    if let Some(stamp) = stamp(columns) {
        return Ok(stamp);
    }
    match columns.iter().position(|name| header::time_unit(name).is_some()) {
        Some(index) => Ok(Clock::Column { index, unit: unit(&columns[index]) }),
        None => Err(RecordingError::NoTime { path: path.into(), columns: columns.to_vec() }),
    }
}

/// A rate given for a log that has a time of its own.
fn note_on_unused_time(columns: &[String], clock: &Clock) -> Option<String> {
    let name = columns.iter().find(|name| header::time_unit(name).is_some())?;
    matches!(clock, Clock::Rate(_)).then(|| format!("the time is counted by the rate given, not taken from `{name}`"))
}

/// The two columns of a ROS time stamp, if both are there.
fn stamp(columns: &[String]) -> Option<Clock> {
    let part = |wanted_stem: Option<&str>, of_seconds: bool| {
        columns.iter().enumerate().find_map(|(index, name)| {
            let (stem, unit) = header::stamp_part(name)?;
            let fits = wanted_stem.is_none_or(|wanted| wanted == stem) && (unit == TimeUnit::Second) == of_seconds;
            fits.then_some((index, stem))
        })
    };
    let (nanoseconds, stem) = part(None, false)?;
    let (seconds, _) = part(Some(stem), true)?;
    Some(Clock::Stamp { seconds, nanoseconds })
}

/// Finds one column per joint: those the caller names, else those whose names say so.
struct Mapper<'a> {
    table: &'a JointColumns<'a>,
    options: &'a ReadOptions,
}

impl Mapper<'_> {
    /// `None` if the log has no columns of this quantity.
    fn find(&self, quantity: Quantity) -> Result<Option<Vec<usize>>, RecordingError> {
        let columns = &self.options.columns;
        let (option, explicit) = match quantity {
            Quantity::Position => ("columns.position", &columns.position),
            Quantity::Velocity => ("columns.velocity", &columns.velocity),
            Quantity::Torque | Quantity::Current => ("columns.torque", &columns.torque),
        };
        match explicit {
            Some(explicit) => self.explicit(option, explicit).map(Some),
            None => self.table.by_name(quantity),
        }
    }

    fn explicit(&self, option: &'static str, columns: &Columns) -> Result<Vec<usize>, RecordingError> {
        let JointColumns { path, columns: known, joints, .. } = self.table;
        match columns {
            Columns::Names(names) if names.len() == joints.len() => {
                names.iter().map(|name| require(path, known, name)).collect()
            }
            Columns::Names(names) => {
                Err(RecordingError::EntriesPerJoint { option, expected: joints.len(), found: names.len() })
            }
            Columns::Pattern(pattern) => {
                let varies = pattern.contains("{}") || pattern.contains("{name}");
                if joints.len() > 1 && !varies {
                    let expected = "a pattern for several joints holds {} (number of the joint) or {name}";
                    return Err(RecordingError::InvalidOption { option, value: pattern.clone(), expected });
                }
                let numbered = joints.iter().enumerate();
                numbered.map(|(index, joint)| require(path, known, &expand(pattern, index + 1, joint))).collect()
            }
        }
    }

    fn torque_from_current(&self, constants: &[f64]) -> Result<Vec<Source>, RecordingError> {
        let (option, joints) = ("torque_constants", &self.table.joints);
        if constants.len() != joints.len() {
            return Err(RecordingError::EntriesPerJoint { option, expected: joints.len(), found: constants.len() });
        }
        if let Some(constant) = constants.iter().find(|constant| !constant.is_finite() || **constant == 0.0) {
            let (value, expected) = (constant.to_string(), "numbers other than zero, N·m per A");
            return Err(RecordingError::InvalidOption { option, value, expected });
        }
        let columns = self.find(Quantity::Current)?;
        let columns = columns.ok_or_else(|| self.table.incomplete(Quantity::Current, joints.clone()))?;
        let currents = self.table.sources(columns, None);
        let scaled = currents.into_iter().zip(constants);
        Ok(scaled.map(|(current, constant)| Source { factor: current.factor * constant, ..current }).collect())
    }

    /// Says which joint is which column if their names do not.
    fn note_on_numbers(&self, position: &[usize]) -> Option<String> {
        let JointColumns { columns, joints, meanings, .. } = self.table;
        let by_number = position.iter().zip(joints).any(|(&index, joint)| match &meanings[index] {
            Some(meaning) => matches!(meaning.label, Label::Number(number) if Some(number) != ending_number(joint)),
            None => false,
        });
        let names: Vec<String> = position.iter().map(|&index| columns[index].clone()).collect();
        let automatic = self.options.columns.position.is_none();
        (by_number && automatic)
            .then(|| format!("joints by number: {} are the columns {}", quoted(joints), quoted(&names)))
    }
}
