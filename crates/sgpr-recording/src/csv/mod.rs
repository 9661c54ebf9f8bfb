//! Logs as tables: `.csv` and `.csv.gz`, or columns in memory ([`read_columns`]).
//!
//! The first line names the columns; lines above it that name none, such as a title, are passed
//! over. Comma, semicolon, tab and blanks separate them; after a semicolon, tab or blank a decimal
//! comma is understood too. Lines that begin with `#` are comments; one right above the numbers (as
//! NumPy and `rostopic` write) is the header if there is no other. A line of units may stand
//! between names and numbers. Text is UTF-8, UTF-16 or Latin-1.
//!
//! # Which column is what
//! Without further word, names like these are understood, with or without a unit at their end
//! (`_rad _deg _m _mm _rad_s _deg_s _m_s _rpm _Nm _mNm _N _A _mA _s _ms _us _ns`, also in brackets:
//! `q1 [deg]`):
//!
//! | time | position | velocity | torque | current |
//! |---|---|---|---|---|
//! | `t`, `t_s`, `time_ns`, `timestamp`, `header.stamp.sec` with `.nanosec` | `q1_rad`, `q_1`, `pos_1`, `joint_1_position`, `position.joint_1`, `shoulder_pan_joint_position` | `dq1_rad_s`, `qd_1`, `vel_1`, `joint_1/velocity` | `tau1_Nm`, `torque_1`, `effort_1`, `force_N` | `i1_A` |
//!
//! A name with a word that is none of these (`tau_des1_Nm`, `q_ref_m`) is no measurement: such
//! columns become channels. The unit of a column is the one in [`ReadOptions::units`], else the one
//! in which its name ends, whether its other words are understood or not, else that in the line of
//! units, else SI. Currents are torques only with [`ReadOptions::torque_constants`].
//!
//! Joints that are wanted by name are matched by name, else by the number their names end in, and
//! from names to numbers without further word only if [`ReadOptions::accept`] holds
//! [`IssueKind::JointsByOrder`] or a pattern with `{}` has said that joints are numbered in their
//! order. Velocities and torques carry the numbers of the positions. Where that leaves a choice, an
//! error says so. [`ReadOptions::columns`] overrules all of it. What was done is in
//! [`Recording::layout`](super::Recording::layout).
//!
//! A time column without a unit holds seconds, unless its first value is so large (10^11 and more)
//! that it can only be milliseconds, microseconds or nanoseconds since 1970, or a date with a time
//! (ISO 8601), or a time of day.

mod columns;
mod header;
mod joints;
mod lines;
mod mapping;
mod quantity;
mod read;
mod source;
mod table;
mod words;
mod write;

use std::fmt;
use std::ops::RangeInclusive;

use derive_setters::Setters;

#[cfg(feature = "parquet")]
pub(crate) use columns::seconds_text;
pub use columns::{NamedColumn, Values, read_columns};
pub use header::quantity_of_array;
pub use read::read;
pub use write::write;

/// Tables, also packed by gzip.
pub static FORMAT: Format = Format {
    name: "CSV",
    endings: &[".csv", ".csv.gz", ".txt", ".txt.gz", ".tsv", ".tsv.gz"],
    is_at: None,
    begins: |_, start| start.starts_with(b"\x1f\x8b"),
    read: Reader::Table(|path, options| read(path, options)),
};

use super::{Format, IssueKind, Reader, Units};

/// How to read a table.
///
/// ```
/// use sgpr_recording::csv::{Columns, ColumnMap, ReadOptions};
/// let columns = ColumnMap::default().with_torque(Some(Columns::Pattern("i{}_A".into())));
/// let options = ReadOptions::default().with_columns(columns).with_torque_constants(Some(vec![10.0, 10.7, 8.5]));
/// # let _ = options;
/// ```
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ReadOptions {
    /// Joints wanted, in order, e.g. those of the robot. `None`: those that the columns name.
    pub joints: Option<Vec<String>>,
    /// Columns named by the caller.
    pub columns: ColumnMap,
    /// Units, where the caller knows better than the column names.
    pub units: Units,
    /// N·m per A (N per A), one per joint: torque = constant · current. The current columns are
    /// those of `columns.torque`, else those named like `i1_A`.
    pub torque_constants: Option<Vec<f64>>,
    /// The same by the names of the joints, in the place of `torque_constants`: no order to
    /// mistake.
    pub named_torque_constants: Vec<(String, f64)>,
    /// Findings that the caller has looked at and takes as they are. Units in `units` count as
    /// looked at.
    pub accept: Vec<IssueKind>,
    /// Part of the log to read; all of it if `None`.
    pub rows: Option<Rows>,
    /// Rate of a log without time column (or whose time column is not to be used), Hz. The first
    /// row has time zero.
    pub sample_rate_hz: Option<f64>,
    /// Largest amount of unpacked text, and of numbers made of it, in bytes. A log beyond it is an
    /// error.
    pub limit_bytes: u64,
}

impl Default for ReadOptions {
    /// Everything automatic, at most 4 GiB.
    fn default() -> Self {
        Self {
            joints: None,
            columns: ColumnMap::default(),
            units: Units::default(),
            torque_constants: None,
            named_torque_constants: Vec::new(),
            accept: Vec::new(),
            rows: None,
            sample_rate_hz: None,
            limit_bytes: super::DEFAULT_LIMIT_BYTES,
        }
    }
}

impl ReadOptions {
    /// Whether torques are made of currents.
    fn has_torque_constants(&self) -> bool {
        self.torque_constants.is_some() || !self.named_torque_constants.is_empty()
    }
}

/// Columns named by the caller; automatic where `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ColumnMap {
    /// The time column.
    pub time: Option<String>,
    /// Position columns.
    pub position: Option<Columns>,
    /// Velocity columns.
    pub velocity: Option<Columns>,
    /// Torque columns; with [`ReadOptions::torque_constants`] the current columns.
    pub torque: Option<Columns>,
}

/// One column per joint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Columns {
    /// `{}` stands for the number of the joint, from 1, `{name}` for its name: `i{}_A`,
    /// `{name}/effort`.
    Pattern(String),
    /// Exact names, in joint order.
    Names(Vec<String>),
}

/// A part of a log.
#[derive(Clone, Debug, PartialEq)]
pub enum Rows {
    /// Data rows, counted from 1, both ends included. What the others hold is not looked at.
    Numbers(RangeInclusive<usize>),
    /// Seconds since the first row of the file, both ends included.
    Seconds(RangeInclusive<f64>),
}

impl fmt::Display for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Numbers(rows) => write!(f, "rows {} to {}", rows.start(), rows.end()),
            Self::Seconds(seconds) => write!(f, "seconds {} to {}", seconds.start(), seconds.end()),
        }
    }
}
