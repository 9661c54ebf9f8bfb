//! Bags of ROS: those of ROS 1, and those of ROS 2 in SQLite or in several files.
//!
//! Messages, joints, time and damaged files are understood as those of [`mcap`], with the same
//! options.
//!
//! # What is read
//! - ROS 1: files of version 2.0, plain or packed by bz2 or lz4. The index at the end is not
//!   needed: a bag that was never finished is a damaged file, to be read with
//!   [`McapOptions::recover`].
//! - ROS 2: the folder of a bag, or a file of it, in SQLite or MCAP; messages or files may be
//!   packed by zstd. Files are those of `metadata.yaml`, or all if the recorder was stopped before
//!   it wrote that. Of topics that are not understood no message is loaded.

mod files;
mod ros1;
mod sqlite;

use std::collections::HashSet;
use std::path::Path;

use crate::mcap::scan::{Allowance, Scan};
use crate::mcap::{self, McapOptions, Take, recording_of};
use crate::{Format, Reader, Recording, RecordingError};
use files::{BagKind, PACKED};

/// Bags of ROS 1 and ROS 2.
pub static FORMAT: Format = Format {
    name: "ROS bag",
    endings: &[".bag", ".db3"],
    is_at: None,
    begins: |path, start| {
        let is_packed = || path.extension().is_some_and(|ending| ending == PACKED);
        match BagKind::of(start) {
            BagKind::Ros1 | BagKind::Sqlite => true,
            BagKind::Zstd => is_packed(),
            BagKind::Mcap | BagKind::Other => files::is_bag(path),
        }
    },
    read: Reader::Topics(|path, options| read(path, options)),
};

/// Reads a bag, which is a file or a folder. What is understood is told in the
/// [module documentation](self).
///
/// Memory: as [`mcap::read`], which takes a packed chunk or message for its chunk. A file that is
/// packed as a whole is unpacked into a temporary file of at most `limit_bytes`.
///
/// # Errors
/// If the path is no bag, but another file, a folder of several bags, a pipe or a device; as
/// [`mcap::read`].
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{bags, mcap::McapOptions};
/// let options = McapOptions::default().with_topics(Some(vec!["/joint_states".into()]));
/// let recording = bags::read("log.bag", &options)?;
/// println!("{} samples of {:?}", recording.len(), recording.joint_names());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &McapOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    recording_of(&path.display().to_string(), options, |allowance, take| {
        scan(path, allowance, options.recover, take)
    })
}

/// Hands on the messages of all files of a bag.
fn scan(
    path: &Path,
    allowance: &mut Allowance,
    recover: bool,
    take: Take,
) -> Result<Scan, RecordingError> {
    let mut all = Scan::default();
    let mut known = HashSet::new();
    for file in files::of(path)? {
        let part = scan_file(&file, allowance, recover, take)?;
        // Several connections may have one topic, and so may files.
        all.topics.extend(part.topics.into_iter().filter(|topic| known.insert(topic.clone())));
        all.messages += part.messages;
        all.damage = all.damage.or(part.damage);
        if all.damage.is_some() && !recover {
            break;
        }
    }
    match all.damage {
        // Nothing that could be recovered.
        Some(error) if all.topics.is_empty() => Err(error),
        damage => Ok(Scan { damage, ..all }),
    }
}

fn scan_file(
    path: &Path,
    allowance: &mut Allowance,
    recover: bool,
    take: Take,
) -> Result<Scan, RecordingError> {
    let name = path.display().to_string();
    if files::kind(path)? != BagKind::Zstd {
        return scan_unpacked(path, &name, allowance, recover, take);
    }
    let (copy, fault) = files::unpack(path, allowance)?;
    let damage = fault.map(|cause| broken(&name, cause));
    if damage.is_some() && !recover {
        return Ok(Scan { damage, ..Scan::default() });
    }
    let scan = scan_unpacked(copy.path(), &name, allowance, recover, take)?;
    Ok(Scan { damage: damage.or(scan.damage), ..scan })
}

/// - `name`: for messages, as `path` may be a copy
fn scan_unpacked(
    path: &Path,
    name: &str,
    allowance: &mut Allowance,
    recover: bool,
    take: Take,
) -> Result<Scan, RecordingError> {
    match files::kind(path)? {
        BagKind::Ros1 => ros1::scan(path, name, allowance, recover, take),
        BagKind::Sqlite => sqlite::scan(path, name, allowance, recover, take),
        BagKind::Mcap => mcap::scan::scan(path, name, allowance, recover, take),
        BagKind::Zstd | BagKind::Other => {
            let cause = "it begins neither with `#ROSBAG V2.0` nor as an SQLite or MCAP file";
            Ok(Scan { damage: Some(broken(name, cause.into())), ..Scan::default() })
        }
    }
}

fn broken(path: &str, cause: String) -> RecordingError {
    RecordingError::Broken { path: path.into(), format: "a ROS bag", cause }
}
