/// Why a log could not be turned into motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// NaN or infinity.
    #[error(
        "{recording}: the {quantity} of `{joint}` is not a number {seconds:.3} s after the start; \
         drop or repair such samples (repair: drop_not_finite)"
    )]
    NotFinite {
        /// Recording.
        recording: String,
        /// Position or torque.
        quantity: &'static str,
        /// Joint.
        joint: String,
        /// Time since the start, s.
        seconds: f64,
    },
    /// A value that no arm makes.
    #[error(
        "{recording}: the {quantity} of `{joint}` is {value:.3e} {seconds:.3} s after the start; \
         {expected}"
    )]
    Implausible {
        /// Recording.
        recording: String,
        /// Position or torque.
        quantity: &'static str,
        /// Joint.
        joint: String,
        /// Time since the start, s.
        seconds: f64,
        /// The value, rad (m) or N·m (N).
        value: f64,
        /// What is possible, and what to check.
        expected: String,
    },
    /// Samples that come faster or slower than those of any arm's log.
    #[error(
        "{recording}: samples come every {period} s, where {} to {} s are possible; give the unit \
         of the time",
        periods[0],
        periods[1]
    )]
    Rate {
        /// Recording.
        recording: String,
        /// Median step, s.
        period: f64,
        /// Shortest and longest step, s.
        periods: [f64; 2],
    },
    /// Time stands still or runs backwards.
    #[error(
        "{recording}: time does not increase after sample {row}, {seconds:.3} s after the start; \
         sort or drop such samples (repair: sort, drop_duplicates), or read the parts of a log \
         that was restarted one by one (`rows`)"
    )]
    TimeNotIncreasing {
        /// Recording.
        recording: String,
        /// Sample before the fault, counted from one.
        row: usize,
        /// Its time since the start, s.
        seconds: f64,
    },
    /// Steps of time that differ too much for differences.
    #[error(
        "{recording}: samples come every {median_ms:.3} ms give or take {jitter_percent:.0} %, too \
         irregular to differentiate; resample first (resample: {rate_hz:.0} Hz)"
    )]
    Irregular {
        /// Recording.
        recording: String,
        /// Median step, ms.
        median_ms: f64,
        /// Root mean square deviation from it, percent.
        jitter_percent: f64,
        /// Rate to resample at, Hz.
        rate_hz: f64,
    },
    /// Shorter than the filter.
    #[error(
        "{recording}: {seconds:.2} s are too short for this filter, which needs {needed:.2} s; \
         record longer, or raise the cut-off"
    )]
    TooShort {
        /// Recording.
        recording: String,
        /// Its length, s.
        seconds: f64,
        /// Length needed, s.
        needed: f64,
    },
    /// Processing that cannot be done, by a file or by an option.
    #[error("{option} is {value}, which should be {expected}")]
    Processing {
        /// What is out of its range.
        option: &'static str,
        /// What it is.
        value: String,
        /// What it should be.
        expected: String,
    },
    /// A threshold of standstill that nothing exceeds.
    #[error(
        "standstill_speed = {speed}: no joint of the logs is faster than {fastest:.3} rad/s (m/s), \
         so all of them would count as standing; take less, or leave it to be chosen from the \
         noise"
    )]
    NothingMoves {
        /// The threshold asked for.
        speed: f64,
        /// Highest speed of any joint.
        fastest: f64,
    },
    /// No torque to learn from.
    #[error(
        "{recording}: there is no torque in this log: name its columns with `columns.torque`, and \
         for motor currents give `torque_constants`"
    )]
    NoTorque {
        /// Recording.
        recording: String,
    },
    /// Nothing to work on.
    #[error("no recording was given")]
    NoRecording,
    /// Recordings of different robots.
    #[error("{recording}: the joints are {found:?}, the robot's are {expected:?}")]
    Joints {
        /// Recording.
        recording: String,
        /// Its joints.
        found: Vec<String>,
        /// Joints of the robot.
        expected: Vec<String>,
    },
    /// Periods that do not fit the log.
    #[error("{recording}: {message}")]
    Period {
        /// Recording.
        recording: String,
        /// What is wrong and what would be right.
        message: String,
    },
    /// A filter that cannot be.
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
}
