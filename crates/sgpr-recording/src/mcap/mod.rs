//! Logs in MCAP files: ROS 2 bags and logs of programs that write JSON. A folder with one MCAP
//! file, as ROS 2 makes it, is read as that file.
//!
//! # What is understood
//! - `sensor_msgs/msg/JointState` in CDR, either byte order; velocities and efforts may be missing.
//!   SI units, as ROS asks. The same of ROS 1, encoding `ros1`.
//! - JSON messages: objects like a JointState
//!   (`{"header": {"stamp": {"sec": .., "nanosec": ..}}, "name": [..], "position": [..], "velocity": [..], "effort": [..]}`)
//!   or without names (`{"t": .., "q": [..], "dq": [..], "tau": [..]}`). Numbers are doubles:
//!   stamps finer than those belong into `sec` and `nanosec`.
//! - Other numbers become channels: `std_msgs/msg/Float64` (`Float32`, `Float64MultiArray`),
//!   `sensor_msgs/msg/Temperature`, and every numeric field of JSON messages (`topic/field`).
//!
//! Other topics are skipped and listed in [`Recording::notes`](super::Recording::notes).
//!
//! # Joints
//! Each joint is found by name, wherever it stands in a message. Joints on several topics, or in
//! messages of one topic that take turns (an arm and its gripper), are merged: the samples are
//! those of the topic with the most messages; the other joints are interpolated linearly between
//! their messages, which changes nothing where stamps are equal. Samples for which a joint has no
//! message on both sides within five of its median steps are left out. If several topics carry the
//! same joint, the caller chooses with [`McapOptions::topics`]; the others become channels
//! `topic/joint/position`.
//!
//! Channels have at each sample the last value received; NaN before the first.
//!
//! # Time
//! The stamps in the message headers, or if those of a topic are all zero the log times; or always
//! the log times. Samples are in the order of their log times.
//!
//! # Damaged files
//! A truncated or damaged file is an error that says where, or with [`McapOptions::recover`] a
//! note: then all messages that are intact are read. Checksums of chunks and of the data section
//! are verified where the file has them.

mod assemble;
pub(crate) mod bytes;
mod cdr;
pub(crate) mod chunk;
mod collect;
mod file;
mod joint_trajectory;
pub(crate) mod message;
pub(crate) mod scan;
mod write;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use derive_setters::Setters;

pub use joint_trajectory::write_joint_trajectory;
pub use write::write;

use super::{Format, Reader, Recording, RecordingError, require_joint_list};
use scan::{Allowance, Message, Scan};

/// How to read an MCAP file.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct McapOptions {
    /// Joints wanted, in order, e.g. those of the robot. `None`: all that are logged, in order of
    /// appearance.
    pub joints: Option<Vec<String>>,
    /// Names of the wanted joints in the log, if they differ from `joints`; in the same order.
    pub logged_names: Option<Vec<String>>,
    /// Topics with the joint states wanted. `None`: all with wanted joints.
    pub topics: Option<Vec<String>>,
    /// Where the time comes from.
    pub clock: Clock,
    /// Whether to take what is intact of a truncated or damaged file.
    pub recover: bool,
    /// Largest amount of unpacked data, and of numbers made of it, in bytes. A log beyond it is an
    /// error.
    pub limit_bytes: u64,
}

impl Default for McapOptions {
    /// Everything automatic, header stamps, no recovery, at most 4 GiB.
    fn default() -> Self {
        Self {
            joints: None,
            logged_names: None,
            topics: None,
            clock: Clock::HeaderStamp,
            recover: false,
            limit_bytes: super::DEFAULT_LIMIT_BYTES,
        }
    }
}

/// MCAP files.
pub static FORMAT: Format = Format {
    name: "MCAP",
    endings: &[".mcap"],
    is_at: None,
    begins: |path, start| start.starts_with(b"\x89MCAP") || only_file(path).is_some(),
    read: Reader::Topics(|path, options| read(path, options)),
};

/// The time of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// When the values were measured, as the message says; log time for topics without stamps.
    HeaderStamp,
    /// When the message was recorded.
    LogTime,
}

/// More entries of a folder are not looked through: no bag has so many files.
const MOST_ENTRIES: usize = 10_000;

/// The MCAP file of a folder that holds one and no other file of a bag.
fn only_file(folder: &Path) -> Option<PathBuf> {
    let entries = folder.read_dir().ok()?.take(MOST_ENTRIES);
    let mut parts =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_part(path));
    let (first, second) = (parts.next()?, parts.next());
    let is_mcap = first.extension().is_some_and(|ending| ending == "mcap");
    (second.is_none() && is_mcap && first.is_file()).then_some(first)
}

/// Whether a file is a part of a bag of ROS 2 by its name.
pub(crate) fn is_part(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    [".mcap", ".db3"].iter().any(|ending| name.trim_end_matches(".zstd").ends_with(ending))
}

/// Reads an MCAP file. What is understood is told in the [module documentation](self).
///
/// Memory: about three times `limit_bytes` at most; in practice the numbers and one chunk.
///
/// # Errors
/// If the file is unreadable, of another kind, truncated, damaged or too large; if a message does
/// not follow its schema; if there are no joint states, not the wanted joints or topics, or several
/// topics carry one joint.
///
/// # Examples
/// ```no_run
/// use sgpr_recording::mcap::{self, McapOptions};
/// let options = McapOptions::default().with_topics(Some(vec!["/joint_states".into()]));
/// let recording = mcap::read("bag.mcap", &options)?;
/// println!("{} samples of {:?}", recording.len(), recording.joint_names());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &McapOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let path = only_file(path).map_or(Cow::Borrowed(path), Cow::Owned);
    let name = path.display().to_string();
    recording_of(&name, options, |allowance, take| {
        scan::scan(&path, &name, allowance, options.recover, take)
    })
}

/// What takes each message.
pub(crate) type Take<'a> = &'a mut dyn FnMut(Message) -> Result<(), RecordingError>;

/// The recording of the messages that `scan` hands on.
///
/// - `path`: for messages
pub(crate) fn recording_of(
    path: &str,
    options: &McapOptions,
    scan: impl FnOnce(&mut Allowance, Take) -> Result<Scan, RecordingError>,
) -> Result<Recording, RecordingError> {
    check(path, options)?;
    let mut collector = collect::Collector::new(path, options);
    let mut allowance = Allowance::new(path, options.limit_bytes);
    let scan = scan(&mut allowance, &mut |message| collector.take(message))?;
    if let Some(error) = scan.damage {
        if !options.recover {
            return Err(error);
        }
        collector
            .notes
            .push(format!("recovered {} messages from a damaged file ({error})", scan.messages));
    }
    collector.finish();
    assemble::assemble(path, &scan.topics, collector, options)
}

/// Refuses options that no log could satisfy.
fn check(path: &str, options: &McapOptions) -> Result<(), RecordingError> {
    for list in [&options.joints, &options.logged_names].into_iter().flatten() {
        require_joint_list(path, list)?;
    }
    if options.topics.as_ref().is_some_and(Vec::is_empty) {
        let (option, expected) = ("topics", "one topic at least; without it all are read");
        return Err(RecordingError::InvalidOption { option, value: "empty".into(), expected });
    }
    match (&options.joints, &options.logged_names) {
        (Some(joints), Some(logged)) if joints.len() != logged.len() => {
            let (option, expected, found) = ("logged_names", joints.len(), logged.len());
            Err(RecordingError::EntriesPerJoint { option, expected, found })
        }
        _ => Ok(()),
    }
}
