//! What is wrong, or worth knowing, about a log.

mod motion;
mod strays;
mod time;
mod values;

use std::str::FromStr;

use super::names::counted;
use super::{Recording, RecordingError};
pub(crate) use motion::{is_turn, usual_change};
pub(super) use strays::stray_samples;
pub use time::GAP_FACTOR;
pub use time::{MOST_JITTER, jitter};
pub use values::is_still;
pub(super) use values::{is_finite_row, repeated_samples};

/// Something found in a recording.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Issue {
    /// What it is.
    pub kind: IssueKind,
    /// How much it matters.
    pub severity: Severity,
    /// First occurrence, s since the first sample; `None` if it concerns the whole log.
    pub time: Option<f64>,
    /// The quantity concerned, e.g. `joint_1_position`; `None` if it concerns all.
    pub channel: Option<String>,
    /// Number of samples (or joints) concerned.
    pub count: usize,
    /// A sentence with numbers, and what to do.
    pub message: String,
}

impl Issue {
    /// Something that concerns all of a log.
    ///
    /// - `count`: samples (or joints) concerned
    pub fn of_log(kind: IssueKind, severity: Severity, count: usize, message: String) -> Self {
        Self { kind, severity, time: None, channel: None, count, message }
    }
}

/// Kinds of [`Issue`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum IssueKind {
    /// Values that are NaN or infinite.
    NotFinite,
    /// Values that no arm makes: positions beyond 1e9 rad (m) or 1e6 rad/s (m/s), torques beyond
    /// 1e15 N·m (N).
    Implausible,
    /// Stamps earlier than the one before.
    TimeBackwards,
    /// Stamps equal to the one before.
    DuplicateStamps,
    /// New stamp, but all values of the sample before, while the arm moves.
    RepeatedSamples,
    /// Long steps of the time.
    Gap,
    /// Steps of unequal length.
    IrregularSampling,
    /// Steps of a length that no control loop has.
    UnlikelyRate,
    /// A joint that does not move.
    StillJoint,
    /// A position that jumps from one sample to the next, as one that is wrapped to a turn does.
    PositionJump,
    /// A value that leaves those before and after it for a sample or a few.
    StraySample,
    /// Positions that look like degrees.
    PositionInDegrees,
    /// A velocity that is not the derivative of the position.
    VelocityMismatch,
    /// A velocity that is late or early.
    VelocityLag,
    /// A torque that is cut off at its largest value.
    ClippedTorque,
    /// A torque that stays at one value while its joint moves.
    FrozenTorque,
    /// Numbers that leave one end of 16 bits and come back at the other.
    Overflow,
    /// Positions that move in steps.
    EncoderStep,
    /// Columns that were given to joints in the order of their numbers, as no name told.
    JointsByOrder,
    /// Torques that are far from what gravity asks of the arm in the robot file.
    TorqueScale,
}

impl IssueKind {
    const NAMES: [(Self, &'static str); 20] = [
        (Self::NotFinite, "not_finite"),
        (Self::Implausible, "implausible"),
        (Self::TimeBackwards, "time_backwards"),
        (Self::DuplicateStamps, "duplicate_stamps"),
        (Self::RepeatedSamples, "repeated_samples"),
        (Self::Gap, "gap"),
        (Self::IrregularSampling, "irregular_sampling"),
        (Self::UnlikelyRate, "unlikely_rate"),
        (Self::StillJoint, "still_joint"),
        (Self::PositionJump, "position_jump"),
        (Self::StraySample, "stray_sample"),
        (Self::PositionInDegrees, "position_in_degrees"),
        (Self::VelocityMismatch, "velocity_mismatch"),
        (Self::VelocityLag, "velocity_lag"),
        (Self::ClippedTorque, "clipped_torque"),
        (Self::FrozenTorque, "frozen_torque"),
        (Self::Overflow, "overflow"),
        (Self::EncoderStep, "encoder_step"),
        (Self::JointsByOrder, "joints_by_order"),
        (Self::TorqueScale, "torque_scale"),
    ];

    /// Findings that an owner of a log can know to be right: units, orders and sizes that are only
    /// unlikely. What breaks the computation, such as values that are not finite, is not among
    /// them.
    pub const CONFIRMABLE: &'static [Self] = &[
        Self::JointsByOrder,
        Self::StraySample,
        Self::PositionInDegrees,
        Self::UnlikelyRate,
        Self::TorqueScale,
    ];

    /// Its name in files and Python: `position_in_degrees`.
    pub fn name(self) -> &'static str {
        let named = Self::NAMES.iter().find(|(kind, _)| *kind == self);
        named.map(|(_, name)| *name).expect("each kind has a name")
    }
}

impl FromStr for IssueKind {
    type Err = RecordingError;

    /// One of [`IssueKind::CONFIRMABLE`] by its name.
    fn from_str(text: &str) -> Result<Self, RecordingError> {
        let found = Self::CONFIRMABLE.iter().copied().find(|kind| kind.name() == text);
        found.ok_or_else(|| RecordingError::NotConfirmable {
            kind: text.into(),
            known: Self::CONFIRMABLE.iter().map(|kind| kind.name().to_string()).collect(),
        })
    }
}

/// How much an [`Issue`] matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Good to know.
    Note,
    /// Results may suffer.
    Warning,
    /// Nothing is computed before it is repaired, or confirmed if it is one of
    /// [`IssueKind::CONFIRMABLE`].
    Error,
}

impl Severity {
    /// What to do about it, in one word: `know`, `look` or `stop`.
    pub fn rank(self) -> &'static str {
        match self {
            Self::Note => "know",
            Self::Warning => "look",
            Self::Error => "stop",
        }
    }
}

/// Everything found in a recording: errors first, then warnings, then notes.
///
/// The rules, where they need numbers:
/// - a gap is a step longer than [`GAP_FACTOR`](super::GAP_FACTOR) median steps;
/// - sampling is irregular if more than 1 % of the steps are off the median by more than 10 %, and
///   too irregular to be differentiated if the steps of a stretch between gaps are off its median
///   by more than 2 % (root mean square);
/// - the unit of the time is in doubt below 10 µs and above 0.5 s from sample to sample, and above
///   0.05 s if no joint is faster than 0.01 rad/s (m/s);
/// - positions are degrees if half of the moving joints look so;
/// - samples that repeat the one before are errors if they are most of the log;
/// - a torque is frozen if it keeps one value for half a second, in which its joint moves by a
///   tenth of its range;
/// - numbers overflow if they jump across nine tenths of a range of 62,000 to 65,536 of their
///   smallest steps;
/// - a joint stands still if it moves less than 0.002 rad (m);
/// - a position jumps if it changes by more than 0.5 rad (m), at more than 50 rad/s (m/s) and by
///   more than ten times what nine of ten samples change by; jumps by a turn alone, give or take
///   what a joint moves in one step, are errors;
/// - a sample strays if it is five times as far from those before and after it as any other, for 10
///   ms or one sample and at most three: a position by more than twice its mean change from sample
///   to sample, a velocity or torque by more than all others range over;
/// - velocity and position are compared over stretches of at least ten samples and 0.1 s: the
///   change of the position against the integral of the velocity, which tells units and sign apart
///   from noise;
/// - the lag of the velocity is where its cross-correlation with the derivative of the position is
///   largest.
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{csv, inspect};
/// let recording = csv::read("log.csv", &csv::ReadOptions::default())?;
/// for issue in inspect(&recording) {
///     println!("{:?}: {}", issue.severity, issue.message);
/// }
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn inspect(recording: &Recording) -> Vec<Issue> {
    let mut issues = time::issues(recording);
    issues.extend(values::issues(recording));
    // Speeds say nothing before the unit of the time is right.
    let is_time_right = recording.accepted().contains(&IssueKind::UnlikelyRate)
        || issues.iter().all(|issue| issue.kind != IssueKind::UnlikelyRate);
    issues.extend(motion::issues(recording, is_time_right));
    sorted(recording, issues)
}

/// What nothing is computed with before somebody repairs, states or confirms it: the errors of
/// [`inspect`], without the work for others.
pub fn refusals(recording: &Recording) -> Vec<Issue> {
    let mut issues = time::issues(recording);
    issues.extend(values::errors(recording));
    let (clean, strays) = strays::taken_out(motion::without_faults(recording));
    issues.extend(motion::positions_in_degrees(&clean));
    issues.extend(strays);
    issues.extend(motion::wrapped_positions(&clean));
    let mut issues = sorted(recording, issues);
    issues.retain(|issue| issue.severity == Severity::Error);
    issues
}

/// Errors first; what is accepted is a note.
fn sorted(recording: &Recording, mut issues: Vec<Issue>) -> Vec<Issue> {
    for issue in issues.iter_mut().filter(|issue| recording.accepted().contains(&issue.kind)) {
        issue.severity = Severity::Note;
        issue.message += " (accepted)";
    }
    issues.sort_by_key(|issue| std::cmp::Reverse(issue.severity));
    issues
}

/// Share in percent, for messages.
fn percent(part: usize, whole: usize) -> String {
    let share = 100.0 * part as f64 / whole.max(1) as f64;
    if share >= 10.0 { format!("{share:.0} %") } else { format!("{share:.2} %") }
}

/// Four digits, for messages.
fn rounded(value: f64) -> String {
    format!("{value:.3e}")
        .parse::<f64>()
        .map_or_else(|_| value.to_string(), |value| value.to_string())
}

/// A length of time, for messages: milliseconds below a second.
fn duration(seconds: f64) -> String {
    if seconds.abs() < 1.0 { format!("{:.3} ms", seconds * 1e3) } else { format!("{seconds:.3} s") }
}
