//! Which column is the time, and which belong to which joint.

use super::header;
use super::joints::{ColumnSource, JointColumns, QuantityColumns, expand};
use super::quantity::{Label, Quantity, StatedUnit};
use super::{Columns, ReadOptions};
use crate::names::{quoted, suggestion};
use crate::part::ending_number;
use crate::{ColumnLayout, JointLayout, Layout, RecordingError, TimeUnit};

/// Where the time comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum TimeSource {
    /// A constant rate, Hz.
    Rate(f64),
    /// A column and its unit, if that is known.
    Column { index: usize, unit: Option<TimeUnit> },
    /// The two columns of a ROS time stamp.
    Stamp { seconds: usize, nanoseconds: usize },
    /// A column of dates with times, or of times of day: `midnights` passed up to the one before,
    /// ns of that one.
    Calendar { index: usize, midnights: i64, before: i64 },
}

/// The columns of a log, understood.
#[derive(Debug)]
pub(super) struct Mapping {
    pub(super) joints: Vec<String>,
    pub(super) clock: TimeSource,
    pub(super) position: Vec<ColumnSource>,
    pub(super) velocity: Option<Vec<ColumnSource>>,
    pub(super) torque: Option<Vec<ColumnSource>>,
    pub(super) notes: Vec<String>,
    pub(super) layout: Layout,
}

impl Mapping {
    /// - `line_of_units`: cells of a line of units below the names; empty if there is none
    pub(super) fn new(
        path: &str,
        columns: &[String],
        line_of_units: &[String],
        options: &ReadOptions,
    ) -> Result<Self, RecordingError> {
        require_distinct(path, columns)?;
        let clock = clock(path, columns, line_of_units, options)?;
        let table = JointColumns::new(path, columns, line_of_units, options)?;
        let mapper = Mapper { table: &table, options };
        let units = &options.units;

        let found = mapper.find(Quantity::Position, None)?.ok_or_else(|| table.no_positions())?;
        let agreed = found.numbers.as_deref();
        let velocity = mapper.find(Quantity::Velocity, agreed)?;
        let mut notes: Vec<String> = mapper.note_on_numbers(&found.columns).into_iter().collect();
        notes.extend(note_on_unused_time(columns, &clock));
        let torque = if options.has_torque_constants() {
            if table.of(Quantity::Torque).next().is_some() {
                notes.push(
                    "torque is computed from the currents; torque columns are kept as channels"
                        .into(),
                );
            }
            Some(mapper.torque_from_current(agreed)?)
        } else {
            mapper.torque(agreed)?
        };
        if torque.is_none() {
            notes.extend(mapper.note_on_currents());
        }
        let position = table.sources(
            Quantity::Position,
            found.columns,
            units.position.map(StatedUnit::from),
        )?;
        let of_velocity = |found: QuantityColumns| {
            table.sources(Quantity::Velocity, found.columns, units.velocity.map(StatedUnit::from))
        };
        let velocity = velocity.map(of_velocity).transpose()?;
        let arrays = Arrays {
            position: &position,
            velocity: velocity.as_deref(),
            torque: torque.as_deref(),
        };
        let layout =
            Layout { by_order: table.by_order.get(), ..arrays.layout(&table.joints, columns) };
        Ok(Self { clock, position, velocity, torque, notes, layout, joints: table.joints })
    }
}

/// The columns of the joints, by quantity.
struct Arrays<'a> {
    position: &'a [ColumnSource],
    velocity: Option<&'a [ColumnSource]>,
    torque: Option<&'a [ColumnSource]>,
}

impl Arrays<'_> {
    /// The layout without its time, which the rows tell.
    fn layout(&self, joints: &[String], columns: &[String]) -> Layout {
        let column = |quantity: Quantity, source: &ColumnSource| {
            let assumed =
                if source.constant.is_some() { Quantity::Current } else { quantity }.usual_unit();
            ColumnLayout {
                column: columns[source.index].clone(),
                unit: source.unit.map_or(assumed, |unit| unit.name).into(),
                stated: source.unit.is_some(),
                torque_constant: source.constant,
            }
        };
        let joint = |(place, joint): (usize, &String)| JointLayout {
            joint: joint.clone(),
            position: column(Quantity::Position, &self.position[place]),
            velocity: self.velocity.map(|sources| column(Quantity::Velocity, &sources[place])),
            torque: self.torque.map(|sources| column(Quantity::Torque, &sources[place])),
        };
        Layout {
            time: String::new(),
            joints: joints.iter().enumerate().map(joint).collect(),
            by_order: false,
        }
    }
}

fn require_distinct(path: &str, columns: &[String]) -> Result<(), RecordingError> {
    let mut sorted: Vec<&String> = columns.iter().filter(|name| !name.is_empty()).collect();
    sorted.sort();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => {
            Err(RecordingError::DuplicateColumn { path: path.into(), column: pair[0].clone() })
        }
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

fn clock(
    path: &str,
    columns: &[String],
    line_of_units: &[String],
    options: &ReadOptions,
) -> Result<TimeSource, RecordingError> {
    if let Some(rate) = options.sample_rate_hz {
        return Ok(TimeSource::Rate(rate));
    }
    let unit = |index: usize| {
        let name = &columns[index];
        let of_name =
            || header::time_unit(name).flatten().or_else(|| header::bracketed(name)?.parse().ok());
        let of_line = || {
            line_of_units
                .get(index)
                .and_then(|cell| header::bracketed(cell).unwrap_or(cell).parse().ok())
        };
        options.units.time.or_else(of_name).or_else(of_line)
    };
    if let Some(name) = &options.columns.time {
        let index = require(path, columns, name)?;
        return Ok(TimeSource::Column { index, unit: unit(index) });
    }
    if let Some(stamp) = stamp(columns) {
        return Ok(stamp);
    }
    match columns.iter().position(|name| header::time_unit(name).is_some()) {
        Some(index) => Ok(TimeSource::Column { index, unit: unit(index) }),
        None => Err(RecordingError::NoTime { path: path.into(), columns: columns.to_vec() }),
    }
}

/// A rate given for a log that has a time of its own.
fn note_on_unused_time(columns: &[String], clock: &TimeSource) -> Option<String> {
    let name = columns.iter().find(|name| header::time_unit(name).is_some())?;
    matches!(clock, TimeSource::Rate(_))
        .then(|| format!("the time is counted by the rate given, not taken from `{name}`"))
}

/// The two columns of a ROS time stamp, if both are there.
fn stamp(columns: &[String]) -> Option<TimeSource> {
    let part = |wanted_stem: Option<&str>, of_seconds: bool| {
        columns.iter().enumerate().find_map(|(index, name)| {
            let (stem, unit) = header::stamp_part(name)?;
            let fits = wanted_stem.is_none_or(|wanted| wanted == stem)
                && (unit == TimeUnit::Second) == of_seconds;
            fits.then_some((index, stem))
        })
    };
    let (nanoseconds, stem) = part(None, false)?;
    let (seconds, _) = part(Some(stem), true)?;
    Some(TimeSource::Stamp { seconds, nanoseconds })
}

/// Finds one column per joint: those the caller names, else those whose names say so.
struct Mapper<'a> {
    table: &'a JointColumns<'a>,
    options: &'a ReadOptions,
}

impl Mapper<'_> {
    /// `None` if the log has no columns of this quantity.
    ///
    /// - `agreed`: the numbers of the joints in the columns of their positions
    fn find(
        &self,
        quantity: Quantity,
        agreed: Option<&[u32]>,
    ) -> Result<Option<QuantityColumns>, RecordingError> {
        let columns = &self.options.columns;
        let (option, explicit) = match quantity {
            Quantity::Position => ("columns.position", &columns.position),
            Quantity::Velocity => ("columns.velocity", &columns.velocity),
            Quantity::Torque | Quantity::Current => ("columns.torque", &columns.torque),
        };
        match explicit {
            Some(explicit) => self.explicit(option, explicit).map(Some),
            None => self.table.by_name(quantity, agreed),
        }
    }

    fn explicit(
        &self,
        option: &'static str,
        columns: &Columns,
    ) -> Result<QuantityColumns, RecordingError> {
        let JointColumns { path, columns: known, joints, .. } = self.table;
        match columns {
            Columns::Names(names) if names.len() == joints.len() => {
                let found = names
                    .iter()
                    .map(|name| require(path, known, name))
                    .collect::<Result<_, _>>()?;
                Ok(QuantityColumns { columns: found, numbers: None })
            }
            Columns::Names(names) => Err(RecordingError::EntriesPerJoint {
                option,
                expected: joints.len(),
                found: names.len(),
            }),
            Columns::Pattern(pattern) => {
                let varies = pattern.contains("{}") || pattern.contains("{name}");
                if joints.len() > 1 && !varies {
                    let expected =
                        "a pattern for several joints holds {} (number of the joint) or {name}";
                    return Err(RecordingError::InvalidOption {
                        option,
                        value: pattern.clone(),
                        expected,
                    });
                }
                let place = |(index, joint): (usize, &String)| {
                    require(path, known, &expand(pattern, index + 1, joint))
                };
                let found = joints.iter().enumerate().map(place).collect::<Result<_, _>>()?;
                let numbers = pattern.contains("{}").then(|| (1u32..).take(joints.len()).collect());
                Ok(QuantityColumns { columns: found, numbers })
            }
        }
    }

    fn torque(&self, agreed: Option<&[u32]>) -> Result<Option<Vec<ColumnSource>>, RecordingError> {
        let Some(QuantityColumns { columns, .. }) = self.find(Quantity::Torque, agreed)? else {
            return Ok(None);
        };
        let given = self.options.units.torque.map(StatedUnit::from);
        if given.is_none() && self.table.are_currents(&columns) {
            let columns = columns.iter().map(|&index| self.table.columns[index].clone()).collect();
            return Err(RecordingError::CurrentsAsTorques {
                path: self.table.path.into(),
                columns,
            });
        }
        self.table.sources(Quantity::Torque, columns, given).map(Some)
    }

    fn torque_from_current(
        &self,
        agreed: Option<&[u32]>,
    ) -> Result<Vec<ColumnSource>, RecordingError> {
        self.check_constants()?;
        let columns = self.find(Quantity::Current, agreed)?;
        let found = columns
            .ok_or_else(|| self.table.incomplete(Quantity::Current, self.table.joints.clone()))?;
        let constants = self.constants(found.numbers.is_some())?;
        let currents = self.table.sources(Quantity::Current, found.columns, None)?;
        let scaled = |(current, constant): (ColumnSource, f64)| ColumnSource {
            factor: current.factor * constant,
            constant: Some(constant),
            ..current
        };
        Ok(currents.into_iter().zip(constants).map(scaled).collect())
    }

    /// Refuses torque constants that no columns could use.
    fn check_constants(&self) -> Result<(), RecordingError> {
        let (option, joints) = ("torque_constants", &self.table.joints);
        let (listed, named) =
            (&self.options.torque_constants, &self.options.named_torque_constants);
        if let Some(constants) = listed.as_ref().filter(|constants| constants.len() != joints.len())
        {
            return Err(RecordingError::EntriesPerJoint {
                option,
                expected: joints.len(),
                found: constants.len(),
            });
        }
        let mut values = listed.iter().flatten().chain(named.iter().map(|(_, constant)| constant));
        match values.find(|constant| !constant.is_finite() || **constant == 0.0) {
            Some(constant) => {
                let (value, expected) =
                    (constant.to_string(), "numbers other than zero, N·m per A");
                Err(RecordingError::InvalidOption { option, value, expected })
            }
            None => Ok(()),
        }
    }

    /// N·m per A, one per joint.
    ///
    /// - `are_numbered`: whether the numbers of columns tell the order of the joints
    fn constants(&self, are_numbered: bool) -> Result<Vec<f64>, RecordingError> {
        let joints = &self.table.joints;
        let named = &self.options.named_torque_constants;
        match &self.options.torque_constants {
            Some(constants) => {
                let ordered = self.options.joints.is_some() || are_numbered || joints.len() == 1;
                if !ordered && self.options.columns.torque.is_none() {
                    let path = self.table.path.into();
                    return Err(RecordingError::ConstantsByOrder { path, joints: joints.clone() });
                }
                Ok(constants.clone())
            }
            None => {
                if let Some((name, _)) = named.iter().find(|(name, _)| !joints.contains(name)) {
                    let (recording, known) = (self.table.path.into(), joints.clone());
                    return Err(RecordingError::UnknownJoint {
                        recording,
                        joint: name.clone(),
                        known,
                    });
                }
                let of_joint = |joint: &String| {
                    let found =
                        named.iter().find(|(name, _)| name == joint).map(|(_, constant)| *constant);
                    found.ok_or_else(|| RecordingError::NoConstant {
                        path: self.table.path.into(),
                        joint: joint.clone(),
                        hint: suggestion(
                            joint,
                            &named.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>(),
                        ),
                    })
                };
                joints.iter().map(of_joint).collect()
            }
        }
    }

    /// Motor currents that nobody made torques of.
    fn note_on_currents(&self) -> Option<String> {
        let columns = &self.table.columns;
        let currents: Vec<String> =
            self.table.of(Quantity::Current).map(|(index, _)| columns[index].clone()).collect();
        (!currents.is_empty()).then(|| {
            format!(
                "there is no torque, but motor currents ({}): give `torque_constants`, N·m per A, \
                 to make torques of them",
                quoted(&currents)
            )
        })
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
        (by_number && automatic).then(|| {
            format!("joints by number: {} are the columns {}", quoted(joints), quoted(&names))
        })
    }
}
