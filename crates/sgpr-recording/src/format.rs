//! Formats of logs, of which each is a module of its own, and which one a file has.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::{FORMATS, Recording, RecordingError};

/// A format of logs.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Format {
    /// Its name.
    pub name: &'static str,
    /// What names of its files end with, in small letters.
    pub endings: &'static [&'static str],
    /// What its files begin with, if that tells them.
    pub beginning: Option<&'static [u8]>,
    /// Reads a file with the usual options, all joints if none are wanted.
    pub(crate) read: fn(&Path, Option<Vec<String>>) -> Result<Recording, RecordingError>,
}

/// Reads a log of any of [`FORMATS`], told by the name of the file or else by how it begins.
///
/// - `joints`: those wanted, in order; all if `None`. The readers of a format ([`csv`](crate::csv),
///   [`mcap`](crate::mcap)) have its options.
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
    (format_of(path)?.read)(path, joints)
}

fn format_of(path: &Path) -> Result<&'static Format, RecordingError> {
    let name =
        path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    let by_name =
        FORMATS.iter().find(|format| format.endings.iter().any(|ending| name.ends_with(ending)));
    if let Some(format) = by_name {
        return Ok(format);
    }
    let unreadable =
        |source| RecordingError::Unreadable { path: path.display().to_string(), source };
    let longest =
        FORMATS.iter().filter_map(|format| format.beginning).map(<[u8]>::len).max().unwrap_or(0);
    let mut start = Vec::new();
    File::open(path)
        .map_err(unreadable)?
        .take(longest as u64)
        .read_to_end(&mut start)
        .map_err(unreadable)?;
    let begins =
        |format: &&&Format| format.beginning.is_some_and(|beginning| start.starts_with(beginning));
    FORMATS.iter().find(begins).copied().ok_or_else(|| RecordingError::UnknownFormat {
        path: path.display().to_string(),
        known: FORMATS
            .iter()
            .flat_map(|format| format.endings)
            .copied()
            .collect::<Vec<_>>()
            .join(", "),
    })
}
