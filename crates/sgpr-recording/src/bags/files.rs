//! The files of a bag.

use std::collections::{BTreeSet, HashSet};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::broken;
use crate::RecordingError;
use crate::format::require_file;
use crate::mcap::is_part;
use crate::mcap::scan::Allowance;

/// More files, or entries of a folder, are no log.
const MOST_FILES: usize = 10_000;

/// Longest description of a bag that is read; names of files stand at its beginning.
const LONGEST_METADATA: u64 = 16 << 20;

const METADATA: &str = "metadata.yaml";

/// What names of packed files end with.
pub(super) const PACKED: &str = "zstd";

/// How messages, or files of a bag of ROS 2, begin that are packed.
pub(super) const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd";

/// How a bag of ROS 1 begins.
pub(super) const ROS1: &[u8] = b"#ROSBAG V2.0\n";

const SQLITE: &[u8] = b"SQLite format 3\0";

/// What a file is by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BagKind {
    Ros1,
    Sqlite,
    Mcap,
    /// A packed file of a bag of ROS 2.
    Zstd,
    Other,
}

impl BagKind {
    pub(super) fn of(start: &[u8]) -> Self {
        let kinds = [
            (ROS1, Self::Ros1),
            (SQLITE, Self::Sqlite),
            (mcap::MAGIC, Self::Mcap),
            (ZSTD, Self::Zstd),
        ];
        let own = kinds.into_iter().find(|(magic, _)| start.starts_with(magic));
        own.map_or(Self::Other, |(_, kind)| kind)
    }
}

/// What a file is.
pub(super) fn kind(path: &Path) -> Result<BagKind, RecordingError> {
    let mut start = Vec::new();
    let longest = SQLITE.len() as u64;
    open(path)?.take(longest).read_to_end(&mut start).map_err(unreadable(path))?;
    Ok(BagKind::of(&start))
}

/// Opens a file, but no pipe or device in its place.
pub(super) fn open(path: &Path) -> Result<File, RecordingError> {
    require_file(path)?;
    File::open(path).map_err(unreadable(path))
}

fn unreadable(path: &Path) -> impl Fn(io::Error) -> RecordingError + '_ {
    |source| RecordingError::Unreadable { path: path.display().to_string(), source }
}

/// Whether a path is the folder of a bag.
pub(super) fn is_bag(path: &Path) -> bool {
    path.is_dir()
        && (path.join(METADATA).is_file() || parts(path).is_ok_and(|parts| !parts.is_empty()))
}

/// The files of a bag, which may be one itself.
pub(super) fn of(path: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    let listed = listed(path);
    if !listed.is_empty() {
        return Ok(listed);
    }
    let parts = parts(path)?;
    let bags: BTreeSet<String> = parts.iter().map(|part| bag_of(part)).collect();
    let name = path.display().to_string();
    match bags.len() {
        0 => Err(broken(&name, "a folder without .db3 and .mcap files".into())),
        1 => Ok(parts),
        count => {
            let some: Vec<String> = bags.into_iter().take(3).collect();
            let (some, more) = (some.join(", "), if count > 3 { ", ..." } else { "" });
            let cause = format!(
                "without {METADATA}, its files are of {count} bags ({some}{more}): read them one by \
                 one"
            );
            Err(RecordingError::NoLog { path: name, cause })
        }
    }
}

/// The files that the description of a bag lists; none without one.
///
/// Source: rosbag2 writes the list as lines `- name` below `relative_file_paths:`; a description of
/// another shape counts as none.
fn listed(folder: &Path) -> Vec<PathBuf> {
    let mut text = Vec::new();
    if let Ok(file) = open(&folder.join(METADATA)) {
        // What cannot be read is as what is not there.
        let _ = file.take(LONGEST_METADATA).read_to_end(&mut text);
    }
    let text = String::from_utf8_lossy(&text);
    let names = text
        .lines()
        .map(str::trim)
        .skip_while(|line| *line != "relative_file_paths:")
        .skip(1)
        .map_while(|line| line.strip_prefix("- "))
        .map(|name| name.trim().trim_matches(['"', '\'']));
    // Of old bags the names have a folder in front; nothing outside of the folder is read.
    let files = names.filter_map(|name| Some(folder.join(Path::new(name).file_name()?)));
    let mut known = HashSet::new();
    files.filter(|file| known.insert(file.clone())).take(MOST_FILES).collect()
}

/// Files in a folder that are named as parts of a bag.
fn parts(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let entries = folder.read_dir().map_err(unreadable(folder))?.take(MOST_FILES);
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut parts: Vec<PathBuf> = paths.filter(|path| is_part(path) && path.is_file()).collect();
    parts.sort();
    Ok(parts)
}

/// The bag of a part by its name: `log` of `log_3.db3.zstd`.
fn bag_of(part: &Path) -> String {
    let name = part.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split(".db3").next().and_then(|stem| stem.split(".mcap").next());
    let stem = stem.unwrap_or_default();
    let whole = stem.trim_end_matches(|letter: char| letter.is_ascii_digit());
    whole.strip_suffix('_').unwrap_or(stem).into()
}

/// A copy of a packed file, and why it is not whole.
///
/// # Errors
/// If it is larger than allowed, or there is no room for it.
pub(super) fn unpack(
    path: &Path,
    allowance: &Allowance,
) -> Result<(NamedTempFile, Option<String>), RecordingError> {
    let mut copy = NamedTempFile::new().map_err(unreadable(path))?;
    let mut packed = zstd::Decoder::new(open(path)?).map_err(unreadable(path))?;
    let most = allowance.left.saturating_add(1);
    match io::copy(&mut packed.by_ref().take(most), &mut copy) {
        Ok(bytes) => allowance.require(bytes).map(|()| (copy, None)),
        Err(error) => Ok((copy, Some(format!("the file cannot be unpacked: {error}")))),
    }
}
