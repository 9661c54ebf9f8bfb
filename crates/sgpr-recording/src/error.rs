use super::names::{counted, patterns, quoted, suggestion};

/// Why a log could not be read, changed or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Unreadable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written; what was there before is untouched.
    #[error("{path}: cannot write: {source}")]
    Unwritable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Nothing in the file.
    #[error("{path}: the file is empty")]
    Empty {
        /// File.
        path: String,
    },
    /// A file of another kind.
    #[error("{path}: this is {found}, not {expected}: {advice}")]
    WrongFormat {
        /// File.
        path: String,
        /// What should have been there.
        expected: &'static str,
        /// What is there.
        found: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// Neither name nor content tell what the file is.
    #[error("{path}: neither name nor content tell the format; understood are {known}")]
    UnknownFormat {
        /// File.
        path: String,
        /// What names of logs end with.
        known: String,
    },
    /// A folder that is no log.
    #[error(
        "{path}: neither a ROS 2 bag (metadata.yaml, or one MCAP file) nor a LeRobot data set \
         (meta/info.json)"
    )]
    UnknownFolder {
        /// Folder.
        path: String,
    },
    /// A file that is not what its name or beginning says, or damaged.
    #[error("{path}: not {format}, or damaged: {cause}")]
    Broken {
        /// File.
        path: String,
        /// What it should be.
        format: &'static str,
        /// What is wrong.
        cause: String,
    },
    /// What is there does not make a log.
    #[error("{path}: {cause}")]
    NoLog {
        /// File.
        path: String,
        /// What is wrong, and what to do.
        cause: String,
    },
    /// More data than the caller allows.
    #[error(
        "{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes` \
         or read a part of the log"
    )]
    TooLarge {
        /// File.
        path: String,
        /// Largest number of bytes that is read.
        limit: u64,
    },
    /// A line that no log has.
    #[error("{path}:{line}: the line is longer than {limit} bytes: is this a CSV file?")]
    LongLine {
        /// File.
        path: String,
        /// Line, from 1.
        line: u64,
        /// Longest line that is read.
        limit: usize,
    },
    /// More columns than any log has.
    #[error(
        "{path}: {found} columns (at most {limit} are read): is this a CSV file with one row per \
         sample?"
    )]
    TooManyColumns {
        /// File.
        path: String,
        /// Columns.
        found: usize,
        /// Largest number that is read.
        limit: usize,
    },
    /// Numbers where the names of the columns should be.
    #[error(
        "{path}:1: the first line holds numbers ({first_line}): begin with a line of column names, \
         e.g. t,q_1,dq_1,tau_1"
    )]
    NoHeader {
        /// File.
        path: String,
        /// Its beginning.
        first_line: String,
    },
    /// A header and nothing else.
    #[error("{path}: there are column names but no data rows")]
    NoRows {
        /// File.
        path: String,
    },
    /// The chosen part of the log is empty.
    #[error(
        "{path}: no sample lies within the chosen {rows}; the log has {samples} rows{}",
        duration.map_or_else(String::new, |seconds| format!(" and lasts {seconds} s"))
    )]
    NoRowsChosen {
        /// File.
        path: String,
        /// What was chosen.
        rows: String,
        /// Rows of the log.
        samples: usize,
        /// Length of the log, s; `None` if no time was read.
        duration: Option<f64>,
    },
    /// A row with too few or too many cells.
    #[error(
        "{path}:{line}: {found} cells, but the header names {expected} columns: mend the line, or \
         read the rows before or behind it alone (`rows`)"
    )]
    RowLength {
        /// File.
        path: String,
        /// Line, from 1.
        line: u64,
        /// Number of columns.
        expected: usize,
        /// Number of cells.
        found: usize,
    },
    /// Text in a column of numbers.
    #[error(
        "{path}:{line}: column `{column}`: `{text}` is not a number{}",
        why_no_number(column, text)
    )]
    NotANumber {
        /// File.
        path: String,
        /// Line, from 1.
        line: u64,
        /// Column.
        column: String,
        /// What is there.
        text: String,
    },
    /// A time stamp that cannot be one.
    #[error(
        "{path}:{line}: column `{column}`: `{text}` is not a time in {unit}{}",
        why_no_time(column, text)
    )]
    NotATime {
        /// File.
        path: String,
        /// Line, from 1.
        line: u64,
        /// Column.
        column: String,
        /// What is there.
        text: String,
        /// Unit of the column.
        unit: String,
    },
    /// A log without time.
    #[error(
        "{path}: no time column among {}; name it with `columns.time`, or give `sample_rate_hz` \
         for a log of constant rate",
        quoted(columns)
    )]
    NoTime {
        /// File.
        path: String,
        /// Columns found.
        columns: Vec<String>,
    },
    /// No column was understood as a joint position.
    #[error(
        "{path}: no joint positions among the columns {}; say which they are with \
         `columns.position`, as a pattern ({}, where {{}} is the number of the joint; \
         `{{name}}_position`) or as a list of columns",
        quoted(columns),
        patterns(unknown)
    )]
    NoPositions {
        /// File.
        path: String,
        /// Columns found.
        columns: Vec<String>,
        /// Those of them that are nothing that the names of columns tell.
        unknown: Vec<String>,
    },
    /// The log has joints, but others than those wanted.
    #[error(
        "{path}: the log has the joints {}, not {}: name its columns in the order of the robot \
         with `columns.position`, such as position={}, and those of velocity and torque alike",
        quoted(found),
        quoted(joints),
        columns.join(",")
    )]
    OtherJoints {
        /// File.
        path: String,
        /// Joints wanted.
        joints: Vec<String>,
        /// Joints of the log.
        found: Vec<String>,
        /// Their columns.
        columns: Vec<String>,
    },
    /// Some joints have a column of this quantity and others none.
    #[error(
        "{path}: no {quantity} column for {}; the columns are {}; say which they are with \
         `columns.{quantity}`, or name the joints wanted with `joints`",
        quoted(missing),
        quoted(columns)
    )]
    IncompleteColumns {
        /// File.
        path: String,
        /// `position`, `velocity` or `torque`.
        quantity: &'static str,
        /// Joints without column.
        missing: Vec<String>,
        /// Columns found.
        columns: Vec<String>,
    },
    /// Fewer numbered columns of this quantity than joints, and no number tells which joint has
    /// none.
    #[error(
        "{path}: got {} of {quantity} ({}) for {} ({}): say which joint each of them belongs to \
         with `columns.{quantity}`, or name the joints that the log has with `joints`",
        counted(columns.len(), "column"),
        quoted(columns),
        counted(joints.len(), "joint"),
        quoted(joints)
    )]
    FewerColumns {
        /// File.
        path: String,
        /// `position`, `velocity` or `torque`.
        quantity: &'static str,
        /// Its numbered columns.
        columns: Vec<String>,
        /// Joints wanted.
        joints: Vec<String>,
    },
    /// Several columns could be meant.
    #[error(
        "{path}: the {quantity} of joint `{joint}` could be any of {}: say which with \
         `columns.{quantity}`",
        quoted(candidates)
    )]
    AmbiguousColumn {
        /// File.
        path: String,
        /// `position`, `velocity` or `torque`.
        quantity: &'static str,
        /// Joint.
        joint: String,
        /// Columns that fit.
        candidates: Vec<String>,
    },
    /// Joint numbers that can be counted in two ways.
    #[error(
        "{path}: the columns {} count joints from 0 and there are more of them than the joints {}: \
         say which are meant with `columns.{quantity}`",
        quoted(candidates),
        quoted(joints)
    )]
    AmbiguousNumbers {
        /// File.
        path: String,
        /// `position`, `velocity` or `torque`.
        quantity: &'static str,
        /// Joints wanted.
        joints: Vec<String>,
        /// Numbered columns.
        candidates: Vec<String>,
    },
    /// Columns of one quantity that carry other numbers than those of the positions.
    #[error(
        "{path}: the {quantity} columns {} are numbered otherwise than the position columns {}: \
         say which belong to which joint with `columns.{quantity}`",
        quoted(columns),
        quoted(positions)
    )]
    NumbersDiffer {
        /// File.
        path: String,
        /// `velocity` or `torque`.
        quantity: &'static str,
        /// Its numbered columns.
        columns: Vec<String>,
        /// Numbered columns of positions.
        positions: Vec<String>,
    },
    /// Joints with names and columns with numbers, and nothing that tells which is which.
    #[error(
        "{recording}: no name tells which of the joints {} is which of the columns {}: if the \
         columns are numbered in the order of the joints, confirm it with \
         `accept=[\"joints_by_order\"]`; else name them with `columns.position`",
        quoted(joints),
        quoted(columns)
    )]
    JointsByOrder {
        /// File or recording.
        recording: String,
        /// Joints wanted.
        joints: Vec<String>,
        /// Numbered columns.
        columns: Vec<String>,
    },
    /// Constants in the order of joints whose order nobody has told.
    #[error(
        "{path}: torque constants come in the order of the robot's joints, but only the log tells \
         the joints here ({}): name the joints in order with `joints`, or the joint of each \
         constant ({}=...)",
        quoted(joints),
        joints[0]
    )]
    ConstantsByOrder {
        /// File.
        path: String,
        /// Joints in the order of their columns.
        joints: Vec<String>,
    },
    /// A joint without a torque constant.
    #[error("{path}: there is no torque constant for joint `{joint}`{hint}")]
    NoConstant {
        /// File.
        path: String,
        /// Joint.
        joint: String,
        /// A name that may have been meant.
        hint: String,
    },
    /// Motor currents named as torques.
    #[error(
        "{path}: the columns {} hold motor currents in A, not torques: give `torque_constants`, \
         N·m per A; or, if they are torques, their unit with `units.torque`",
        quoted(columns)
    )]
    CurrentsAsTorques {
        /// File.
        path: String,
        /// Columns.
        columns: Vec<String>,
    },
    /// A unit in the name of a column, or in the line of units, that is not known.
    #[error(
        "{path}: column `{column}`: `{unit}` is no known unit of {quantity}: give the unit with \
         `units.{quantity}`{}",
        if *quantity == "torque" { ", or what one of it is in N·m with `torque_constants`" } else { "" }
    )]
    ColumnUnit {
        /// File.
        path: String,
        /// Column.
        column: String,
        /// `position`, `velocity` or `torque`.
        quantity: &'static str,
        /// What is there.
        unit: String,
    },
    /// A column the caller named is not there.
    #[error(
        "{path}: there is no column `{column}`{}; the columns are {}",
        suggestion(column, columns),
        quoted(columns)
    )]
    UnknownColumn {
        /// File.
        path: String,
        /// Requested column.
        column: String,
        /// Columns found.
        columns: Vec<String>,
    },
    /// Two columns of one name.
    #[error("{path}: the column name `{column}` occurs twice")]
    DuplicateColumn {
        /// File.
        path: String,
        /// Column.
        column: String,
    },
    /// One entry per joint is needed.
    #[error(
        "{option}: got {} for {}: give one for each, in joint order",
        counted(*found, "value"),
        counted(*expected, "joint")
    )]
    EntriesPerJoint {
        /// Option of the caller.
        option: &'static str,
        /// Joints.
        expected: usize,
        /// Entries.
        found: usize,
    },
    /// An option with a value that cannot be.
    #[error("{option} = {value}: {expected}")]
    InvalidOption {
        /// Option of the caller.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it should be.
        expected: &'static str,
    },
    /// Units that nobody can have meant.
    #[error("{recording}: {finding}")]
    Doubtful {
        /// File or recording.
        recording: String,
        /// What looks wrong, and what to do.
        finding: String,
    },
    /// A finding that cannot be taken as it is.
    #[error(
        "accept: `{kind}` cannot be confirmed{}; what can be are {}",
        suggestion(kind, known),
        quoted(known)
    )]
    NotConfirmable {
        /// What was given.
        kind: String,
        /// Names to choose from.
        known: Vec<String>,
    },
    /// A unit that is not known.
    #[error("`{unit}` is no unit of {quantity}; known are {}", quoted(known))]
    UnknownUnit {
        /// Position, velocity, torque or time.
        quantity: String,
        /// What was given.
        unit: String,
        /// Units to choose from.
        known: Vec<String>,
    },
    /// An array that does not fit the others.
    #[error("{recording}: `{array}`: got {}, expected {expected}", counted(*found, "value"))]
    Length {
        /// Recording.
        recording: String,
        /// Array.
        array: String,
        /// Samples times joints.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A requested joint that is not in the log.
    #[error(
        "{recording}: there is no joint `{joint}`{}; the joints are {}",
        suggestion(joint, known),
        quoted(known)
    )]
    UnknownJoint {
        /// File or recording.
        recording: String,
        /// Requested joint.
        joint: String,
        /// Joints to choose from.
        known: Vec<String>,
    },
    /// A joint that occurs twice.
    #[error("{recording}: the joint `{joint}` occurs twice")]
    DuplicateJoint {
        /// File or recording.
        recording: String,
        /// Joint.
        joint: String,
    },
    /// Time that does not run forward, where it must.
    #[error(
        "{recording}: the time does not increase at sample {sample} ({seconds} s after the start): \
         repair with `sort` and `drop_duplicates` first, or read the parts of a log that was \
         restarted one by one (`rows`)"
    )]
    UnsortedTime {
        /// Recording.
        recording: String,
        /// First sample whose stamp is not later than the one before.
        sample: usize,
        /// Its time since the first sample, s.
        seconds: f64,
    },
    /// A repair that removed everything.
    #[error("{recording}: no sample is left after: {action}")]
    NothingLeft {
        /// Recording.
        recording: String,
        /// The last thing done.
        action: String,
    },
    /// A file that ends before its end.
    #[error(
        "{path}: the file is truncated: what begins at byte {byte} is incomplete; {messages} \
         messages are readable: set `recover` to take them"
    )]
    Truncated {
        /// File.
        path: String,
        /// Where the incomplete record begins, or should.
        byte: u64,
        /// Messages up to the end.
        messages: u64,
    },
    /// A file that is damaged.
    #[error(
        "{path}: damaged at byte {byte}: {cause}; set `recover` to take the messages that are \
         intact"
    )]
    Damaged {
        /// File.
        path: String,
        /// Where the record with the damage begins.
        byte: u64,
        /// What is wrong.
        cause: String,
    },
    /// A message that does not follow its schema.
    #[error("{path}: topic `{topic}`, message {index}: {cause}")]
    Message {
        /// File.
        path: String,
        /// Topic.
        topic: String,
        /// Number of the message on this topic, from 1.
        index: u64,
        /// What is wrong.
        cause: String,
    },
    /// No topic with joint states.
    #[error(
        "{path}: no topic with joint states (sensor_msgs/msg/JointState, or JSON with `position` \
         or `q`); the topics are {}",
        quoted(topics)
    )]
    NoJointStates {
        /// File.
        path: String,
        /// Topics with their schemas.
        topics: Vec<String>,
    },
    /// A requested topic that is not in the file.
    #[error(
        "{path}: there is no topic `{topic}` with joint states{}; topics with joint states are {}",
        suggestion(topic, known),
        quoted(known)
    )]
    UnknownTopic {
        /// File.
        path: String,
        /// Requested topic.
        topic: String,
        /// Topics to choose from.
        known: Vec<String>,
    },
    /// Several topics carry one joint.
    #[error(
        "{path}: the joint `{joint}` is on the topics {}: choose with `topics`",
        quoted(topics)
    )]
    AmbiguousTopics {
        /// File.
        path: String,
        /// Joint.
        joint: String,
        /// Topics that carry it.
        topics: Vec<String>,
    },
    /// Topics that never overlap in time.
    #[error(
        "{path}: the topics {} have no time in common: read them one by one with `topics`",
        quoted(topics)
    )]
    NoCommonTime {
        /// File.
        path: String,
        /// Topics to be merged.
        topics: Vec<String>,
    },
    /// A time stamp that ROS 2 messages cannot hold.
    #[error("{recording}: the time {nanoseconds} ns does not fit a ROS 2 time stamp (0 to 2^31 s)")]
    StampRange {
        /// Recording.
        recording: String,
        /// Time stamp, ns.
        nanoseconds: i64,
    },
}

const NAMES_AGAIN: &str = " (the names of the columns come again here, as where logs were put \
     together: read the parts one by one, `rows`)";

/// What may be wrong with a cell that holds no number.
fn why_no_number(column: &str, text: &str) -> &'static str {
    if text == column { NAMES_AGAIN } else { why_not_read(text).unwrap_or_default() }
}

/// What other programs write that is no number.
fn why_not_read(text: &str) -> Option<&'static str> {
    let mut groups =
        text.trim_start_matches(['-', '+']).split(['.', ',', '\'', '\u{a0}', '\u{202f}', ' ']);
    let is_digits =
        |group: &str| !group.is_empty() && group.bytes().all(|byte| byte.is_ascii_digit());
    let first = groups.next().is_some_and(|group| group.len() <= 3 && is_digits(group));
    let rest: Vec<&str> = groups.collect();
    let thousands = rest.len() >= 2 && rest[..rest.len() - 1].iter().all(|group| group.len() == 3);
    if first && thousands && rest.iter().all(|group| is_digits(group)) {
        Some(" (it has a separator of thousands: export the numbers without)")
    } else if text.starts_with('#') {
        Some(
            " (a spreadsheet has no value there: take the row out, or write `nan` there and drop \
             such samples (repair: drop_not_finite))",
        )
    } else {
        None
    }
}

/// What may be wrong with a cell that holds no time.
fn why_no_time(column: &str, text: &str) -> &'static str {
    match text.parse::<f64>() {
        Err(_) if text == column => NAMES_AGAIN,
        Ok(_) => " (64 bits of nanoseconds reach 292 years)",
        Err(_) if text.is_empty() => "",
        Err(_) if why_not_read(text).is_some() => why_not_read(text).unwrap_or_default(),
        Err(_) => {
            " (times are numbers, ISO 8601 such as 2026-03-03T09:15:00.000Z, or times of day such \
             as 09:15:00.000; a line of units is understood right below the names)"
        }
    }
}
