//! Logs of moving robot arms: reading, checking, repairing, writing.
//!
//! A [`Recording`] is one trajectory as it was logged. Readers ([`csv`], [`mcap`]; with the feature
//! `formats` also of ROS bags, NumPy, MATLAB, HDF5 and Parquet files) convert units at the border,
//! check nothing away and repair nothing: what is wrong with a log is found by [`inspect`], and
//! changed only by [`repair`].

#![warn(clippy::too_many_lines)]
#![forbid(unsafe_code)]

#[cfg(any(feature = "numpy", feature = "matlab", feature = "hdf5", feature = "parquet"))]
pub mod arrays;
#[cfg(feature = "bags")]
pub mod bags;
mod calendar;
pub mod csv;
mod decimal;
mod derived;
mod error;
mod format;
#[cfg(any(feature = "hdf5", feature = "parquet"))]
mod guarded;
mod inspect;
mod layout;
#[cfg(feature = "parquet")]
pub mod lerobot;
mod log_set;
pub mod mcap;
mod names;
#[cfg(feature = "parquet")]
pub mod parquet;
mod part;
mod plausible;
mod repair;
mod repetition;
mod resample;
mod statistics;
mod units;

use std::any::Any;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::Arc;

use tempfile::NamedTempFile;

use derived::Derived;
pub use error::RecordingError;
pub use format::{Format, Reader, read};
pub use inspect::{GAP_FACTOR, Issue, IssueKind, Severity, inspect, refusals};
pub use layout::{ColumnLayout, JointLayout, Layout};
pub use log_set::{LogSet, shared_samples};
pub use part::split_at_gaps;
use plausible::Implausible;
pub use repair::{Repair, Resample, repair};
pub use repetition::repeated_share;
pub use sgpr_predict::effects::Channel;
pub use units::{PositionUnit, TimeUnit, TorqueUnit, Units, VelocityUnit};

/// What `sgpr-core` takes of this crate beside its interface. No part of that: it changes without
/// notice, and so do methods that the documentation does not list.
#[doc(hidden)]
pub mod internal {
    pub use crate::inspect::{MOST_JITTER, is_still, jitter};
    pub use crate::part::stretches;
    pub use crate::plausible::{Implausible, PERIODS, SMALLEST_TORQUE};
    pub use crate::seconds;
}

/// All formats of logs that are read here.
pub static FORMATS: &[&Format] = &[
    &csv::FORMAT,
    &mcap::FORMAT,
    #[cfg(feature = "bags")]
    &bags::FORMAT,
    #[cfg(feature = "numpy")]
    &arrays::numpy::FORMAT,
    #[cfg(feature = "matlab")]
    &arrays::matlab::FORMAT,
    #[cfg(feature = "hdf5")]
    &arrays::hdf5::FORMAT,
    #[cfg(feature = "parquet")]
    &parquet::FORMAT,
    #[cfg(feature = "parquet")]
    &lerobot::FORMAT,
];

/// Largest amount of unpacked data that readers take unless told otherwise.
const DEFAULT_LIMIT_BYTES: u64 = 4 << 30;

/// One trajectory as it was logged. Samples are rows, joints are columns; SI units; time in integer
/// nanoseconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    source: String,
    joint_names: Vec<String>,
    // Shared by clones: logs are long.
    time: Arc<Vec<i64>>,
    position: Arc<Vec<f64>>,
    velocity: Option<Arc<Vec<f64>>>,
    torque: Option<Arc<Vec<f64>>>,
    channels: Vec<Channel>,
    notes: Vec<String>,
    layout: Option<Layout>,
    accepted: Vec<IssueKind>,
    kept: Derived,
}

impl Recording {
    /// A recording from its parts.
    ///
    /// - `source`: where it comes from, for messages
    /// - `time`: `[samples]`, ns
    /// - `position`: `[samples, n]`, rad (m)
    /// - `velocity`: `[samples, n]`, rad/s (m/s), if it was logged
    /// - `torque`: `[samples, n]`, N·m (N), if it was logged
    ///
    /// # Errors
    /// If an array has another length. The values may be anything: see [`inspect`].
    pub fn new(
        source: impl Into<String>,
        joint_names: Vec<String>,
        time: Vec<i64>,
        position: Vec<f64>,
        velocity: Option<Vec<f64>>,
        torque: Option<Vec<f64>>,
        channels: Vec<Channel>,
    ) -> Result<Self, RecordingError> {
        let source = source.into();
        let expected = time.len() * joint_names.len();
        let arrays = [
            ("position", Some(&position)),
            ("velocity", velocity.as_ref()),
            ("torque", torque.as_ref()),
        ];
        for (name, values) in arrays {
            if let Some(values) = values.filter(|values| values.len() != expected) {
                return Err(RecordingError::Length {
                    recording: source,
                    array: name.into(),
                    expected,
                    found: values.len(),
                });
            }
        }
        if let Some(channel) = channels.iter().find(|channel| channel.values.len() != time.len()) {
            let (array, found) = (channel.name.clone(), channel.values.len());
            return Err(RecordingError::Length {
                recording: source,
                array,
                expected: time.len(),
                found,
            });
        }
        Ok(Self {
            source,
            joint_names,
            time: Arc::new(time),
            position: Arc::new(position),
            velocity: velocity.map(Arc::new),
            torque: torque.map(Arc::new),
            channels,
            notes: Vec::new(),
            layout: None,
            accepted: Vec::new(),
            kept: Derived::default(),
        })
    }

    fn with_notes(mut self, notes: Vec<String>) -> Self {
        self.notes = notes;
        self
    }

    /// The same recording from another source.
    #[must_use]
    pub fn with_source(mut self, source: impl Into<String>) -> Self {
        self.source = source.into();
        self.kept = Derived::default();
        self
    }

    /// The same recording with one more note, see [`Recording::notes`].
    #[must_use]
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The same recording with a record of how it was read.
    #[must_use]
    pub fn with_layout(mut self, layout: Option<Layout>) -> Self {
        self.layout = layout;
        self
    }

    /// The same recording with findings that its owner has looked at and takes as they are:
    /// [`inspect`] makes notes of them.
    #[must_use]
    pub fn accepting(mut self, kinds: &[IssueKind]) -> Self {
        self.accepted.extend(kinds);
        self.accepted.sort_unstable();
        self.accepted.dedup();
        self
    }

    /// The same recording with other names for its joints, in column order.
    ///
    /// # Errors
    /// If there is not one name per joint, or a name occurs twice.
    pub fn with_joint_names(mut self, names: Vec<String>) -> Result<Self, RecordingError> {
        if names.len() != self.dof() {
            let (option, expected, found) = ("joints", self.dof(), names.len());
            return Err(RecordingError::EntriesPerJoint { option, expected, found });
        }
        require_joint_list(&self.source, &names)?;
        self.layout = self.layout.map(|layout| layout.renamed(&names));
        self.joint_names = names;
        self.kept = Derived::default();
        Ok(self)
    }

    /// Where the recording comes from.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Names of the joints, in column order.
    pub fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    /// Number of joints n.
    pub fn dof(&self) -> usize {
        self.joint_names.len()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time stamps, ns.
    pub fn time(&self) -> &[i64] {
        &self.time
    }

    /// Positions, `[samples, n]`, rad (m).
    pub fn position(&self) -> &[f64] {
        &self.position
    }

    /// Velocities, `[samples, n]`, rad/s (m/s), if logged.
    pub fn velocity(&self) -> Option<&[f64]> {
        self.velocity.as_deref().map(Vec::as_slice)
    }

    /// Torques, `[samples, n]`, N·m (N), if logged.
    pub fn torque(&self) -> Option<&[f64]> {
        self.torque.as_deref().map(Vec::as_slice)
    }

    /// Everything else that was logged with the joints.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The channel `name`.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.name == name)
    }

    /// Channels of the first name of each pair under the second.
    #[cfg(any(feature = "numpy", feature = "matlab", feature = "hdf5", feature = "parquet"))]
    fn rename_channels(&mut self, names: &[(String, String)]) {
        for channel in &mut self.channels {
            if let Some((_, name)) = names.iter().find(|(old, _)| *old == channel.name) {
                channel.name.clone_from(name);
            }
        }
    }

    /// What the reader assumed or left out, in sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Which column became what in which unit, if a reader of tables made the recording.
    pub fn layout(&self) -> Option<&Layout> {
        self.layout.as_ref()
    }

    /// Findings that are taken as they are, see [`Recording::accepting`].
    pub fn accepted(&self) -> &[IssueKind] {
        &self.accepted
    }

    /// A number that recordings with the same joints, times and values share, whatever their
    /// source, and others do not: two recordings with one hash are copies. Channels do not count.
    ///
    /// Source: FNV-1a of 128 bits (Fowler, Noll, Vo; RFC 9923).
    pub fn content_hash(&self) -> u128 {
        const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
        const OFFSET: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
        let fold = |hash: u128, byte: u8| (hash ^ u128::from(byte)).wrapping_mul(PRIME);
        // A name ends in a byte that no text holds, and the name of an array stands before it: a
        // torque is no velocity.
        let text = |hash: u128, text: &str| text.bytes().chain([0xff]).fold(hash, fold);
        let mut hash = self.joint_names.iter().fold(OFFSET, |hash, name| text(hash, name));
        hash = self.time.iter().flat_map(|time| time.to_le_bytes()).fold(hash, fold);
        for (name, values) in self.arrays() {
            hash = values
                .iter()
                .flat_map(|value| value.to_bits().to_le_bytes())
                .fold(text(hash, name), fold);
        }
        hash
    }

    /// Time since the first sample, `[samples]`, s.
    pub fn time_seconds(&self) -> Vec<f64> {
        let start = self.time.first().copied().unwrap_or_default();
        self.time.iter().map(|&time| seconds(start, time)).collect()
    }

    /// Time from the first to the last sample, s.
    pub fn duration(&self) -> f64 {
        match self.time[..] {
            [first, .., last] => seconds(first, last),
            _ => 0.0,
        }
    }

    /// One over the median period, Hz; `None` with fewer than two samples or a time that stands
    /// still.
    pub fn sample_rate_hz(&self) -> Option<f64> {
        let period = self.median_period();
        (period > 0.0).then(|| 1.0 / period)
    }

    /// Median step of the time, s; NaN with fewer than two samples.
    fn median_period(&self) -> f64 {
        statistics::median(&mut self.steps())
    }

    /// Steps of the time, `[samples - 1]`, s.
    fn steps(&self) -> Vec<f64> {
        self.time.windows(2).map(|pair| seconds(pair[0], pair[1])).collect()
    }

    /// The same log, of which nothing is kept that is made from it on.
    #[doc(hidden)]
    #[must_use]
    pub fn apart(&self) -> Self {
        Self { kept: Derived::default(), ..self.clone() }
    }

    /// What `make` makes of the log; if it is one of a [`LogSet`], what was made before of it or of
    /// its joints and `fits`.
    ///
    /// - `fits`: has to know what it is made with, the joints among it
    #[doc(hidden)]
    pub fn keeping<T: Any + Send + Sync, E>(
        &self,
        fits: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        self.kept.or_make(fits, make)
    }

    /// The arrays that are there, with their names.
    fn arrays(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        let arrays = [
            ("position", Some(self.position())),
            ("velocity", self.velocity()),
            ("torque", self.torque()),
        ];
        arrays.into_iter().filter_map(|(name, values)| Some((name, values?)))
    }
}

/// Writes a file whole or not at all.
fn write_file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut NamedTempFile>) -> io::Result<()>,
) -> Result<(), RecordingError> {
    let unwritable =
        |source| RecordingError::Unwritable { path: path.display().to_string(), source };
    sgpr_predict::internal::atomic_file::write(path, fill).map_err(unwritable)
}

/// Seconds from one time stamp to another.
pub fn seconds(from: i64, to: i64) -> f64 {
    match to.checked_sub(from) {
        Some(step) => step as f64 / 1e9,
        None => (i128::from(to) - i128::from(from)) as f64 / 1e9,
    }
}

/// Joint names as a caller may ask for them: at least one, none twice.
fn require_joint_list(recording: &str, joints: &[String]) -> Result<(), RecordingError> {
    if joints.is_empty() {
        let (option, expected) = ("joints", "at least one joint");
        return Err(RecordingError::InvalidOption { option, value: "[]".into(), expected });
    }
    match joints.iter().enumerate().find(|(index, joint)| joints[..*index].contains(joint)) {
        Some((_, joint)) => Err(RecordingError::DuplicateJoint {
            recording: recording.into(),
            joint: joint.clone(),
        }),
        None => Ok(()),
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
