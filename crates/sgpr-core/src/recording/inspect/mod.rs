//! What is wrong, or worth knowing, about a log.

mod motion;
mod time;
mod values;

use super::Recording;
pub(crate) use values::is_still;
pub(super) use values::{is_finite_row, repeated_samples};

/// Something found in a recording.
#[derive(Clone, Debug, PartialEq)]
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

/// Kinds of [`Issue`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
    /// Positions that look like degrees.
    PositionInDegrees,
    /// A velocity that is not the derivative of the position.
    VelocityMismatch,
    /// A velocity that is late or early.
    VelocityLag,
    /// A torque that is cut off at its largest value.
    ClippedTorque,
    /// Positions that move in steps.
    EncoderStep,
}

/// How much an [`Issue`] matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Good to know.
    Note,
    /// Results may suffer.
    Warning,
    /// Nothing can be computed before it is repaired.
    Error,
}

/// Everything found in a recording: errors first, then warnings, then notes.
///
/// The rules, where they need numbers:
/// - a gap is a step longer than [`GAP_FACTOR`](super::GAP_FACTOR) median steps;
/// - sampling is irregular if more than 1 % of the steps are off the median by more than 10 %;
/// - a joint stands still if it moves less than 0.002 rad (m);
/// - a position jumps if it changes by more than 0.5 rad (m), at more than 50 rad/s (m/s) and by more than ten times what
///   nine of ten samples change by;
/// - velocity and position are compared over stretches of at least ten samples and 0.1 s: the change of the position
///   against the integral of the velocity, which tells units and sign apart from noise;
/// - the lag of the velocity is where its cross-correlation with the derivative of the position is largest.
///
/// # Examples
/// ```no_run
/// use sgpr_core::recording::{csv, inspect};
/// let recording = csv::read("log.csv", &csv::ReadOptions::default())?;
/// for issue in inspect(&recording) {
///     println!("{:?}: {}", issue.severity, issue.message);
/// }
/// # Ok::<(), sgpr_core::recording::RecordingError>(())
/// ```
pub fn inspect(recording: &Recording) -> Vec<Issue> {
    let mut issues = time::issues(recording);
    issues.extend(values::issues(recording));
    issues.extend(motion::issues(recording));
    issues.sort_by_key(|issue| std::cmp::Reverse(issue.severity));
    issues
}

/// Share in percent, for messages.
fn percent(part: usize, whole: usize) -> String {
    let share = 100.0 * part as f64 / whole.max(1) as f64;
    if share >= 10.0 { format!("{share:.0} %") } else { format!("{share:.2} %") }
}

/// "1 gap", "2 gaps", for messages.
fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Milliseconds, for messages.
fn milliseconds(seconds: f64) -> String {
    format!("{:.3} ms", seconds * 1e3)
}
