//! Formats of logs, of which each is a module of its own, and which one a file has.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::csv::ReadOptions;
use crate::mcap::McapOptions;
use crate::{FORMATS, Recording, RecordingError};

/// A format of logs.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Format {
    /// Its name.
    pub name: &'static str,
    /// What names of its files end with, in small letters.
    pub endings: &'static [&'static str],
    /// Whether a path is one by where it is, whatever its name.
    pub(crate) is_at: Option<fn(&Path) -> bool>,
    /// Whether a path whose name does not tell is one, by its beginning.
    pub(crate) begins: fn(&Path, &[u8]) -> bool,
    /// Reads a file.
    pub read: Reader,
}

/// How files of a format are read, and with which options.
#[derive(Clone, Copy, Debug)]
pub enum Reader {
    /// Tables or arrays.
    Table(fn(&Path, &ReadOptions) -> Result<Recording, RecordingError>),
    /// Messages on topics.
    Topics(fn(&Path, &McapOptions) -> Result<Recording, RecordingError>),
}

/// Bytes at the beginning of a file that tell its format.
const BEGINNING: u64 = 16;

/// Reads a log of any of [`FORMATS`], told by the name of the file or else by how it begins.
///
/// - `joints`: those wanted, in order; all if `None`. What else may be asked for depends on the
///   format: [`Format::read`].
///
/// # Errors
/// If neither name nor beginning tell the format; as the reader of the format.
///
/// # Examples
/// ```no_run
/// let recording = sgpr_recording::read("log.csv.gz", None)?;
/// println!("{} joints at {:?} Hz", recording.dof(), recording.sample_rate_hz());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(
    path: impl AsRef<Path>,
    joints: Option<Vec<String>>,
) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    match Format::of(path)?.read {
        Reader::Table(read) => read(path, &ReadOptions::default().with_joints(joints)),
        Reader::Topics(read) => read(path, &McapOptions::default().with_joints(joints)),
    }
}

/// Refuses what may keep a reader waiting for ever, or give other bytes the second time.
///
/// # Errors
/// If it is neither a file nor a folder; what is not there is left to the reader.
pub(crate) fn require_file(path: &Path) -> Result<(), RecordingError> {
    match path.metadata() {
        Ok(kind) if !kind.is_file() && !kind.is_dir() => Err(RecordingError::WrongFormat {
            path: path.display().to_string(),
            expected: "a file",
            found: "a pipe or a device",
            advice: "write what comes out of it to a file",
        }),
        _ => Ok(()),
    }
}

impl Format {
    /// The format of a file or folder, by its name or else by how it begins.
    ///
    /// # Errors
    /// If neither tells it, or there is no such file; if it is a pipe or a device.
    pub fn of(path: impl AsRef<Path>) -> Result<&'static Self, RecordingError> {
        let path = path.as_ref();
        let is_at = |format: &&&Self| format.is_at.is_some_and(|is_at| is_at(path));
        if let Some(format) = FORMATS.iter().find(is_at) {
            return Ok(format);
        }
        if path.is_dir() {
            let of_folder = FORMATS.iter().find(|format| (format.begins)(path, &[])).copied();
            let path = path.display().to_string();
            return of_folder.ok_or(RecordingError::UnknownFolder { path });
        }
        require_file(path)?;
        let name =
            path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        let by_name = FORMATS
            .iter()
            .find(|format| format.endings.iter().any(|ending| name.ends_with(ending)));
        if let Some(format) = by_name {
            return Ok(format);
        }
        let unreadable =
            |source| RecordingError::Unreadable { path: path.display().to_string(), source };
        let mut start = Vec::new();
        let file = File::open(path).map_err(unreadable)?;
        file.take(BEGINNING).read_to_end(&mut start).map_err(unreadable)?;
        FORMATS.iter().find(|format| (format.begins)(path, &start)).copied().ok_or_else(|| {
            RecordingError::UnknownFormat {
                path: path.display().to_string(),
                known: FORMATS
                    .iter()
                    .flat_map(|format| format.endings)
                    .copied()
                    .collect::<Vec<_>>()
                    .join(", "),
            }
        })
    }
}
