//! The text of a log: plain or gzip, never more of it than allowed.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::RecordingError;

/// Longest line that is read: a megabyte of text is some fifty thousand columns.
const LONGEST_LINE: usize = 1 << 20;

/// Beginnings of files that users take for CSV, what they are, and what to do.
const FOREIGN: [(&[u8], &str, &str); 5] = [
    (b"\x89MCAP", "an MCAP file", "read it with the MCAP reader"),
    (b"PK\x03\x04", "a zip archive or an Excel workbook", "save it as CSV"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", "unpack it or compress it with gzip"),
    (
        b"SQLite format 3",
        "an SQLite data base",
        "`read` reads a bag of ROS 2 if its name ends in .db3 (in Rust with the feature `bags`)",
    ),
    (
        b"#ROSBAG",
        "a ROS 1 bag",
        "`read` reads it if its name ends in .bag (in Rust with the feature `bags`)",
    ),
];

/// The same for files of tags.
const TAGS: [(&str, &str, &str); 4] = [
    ("<!doctype html", "a web page", "download the file itself, not the page that shows it"),
    ("<html", "a web page", "download the file itself, not the page that shows it"),
    ("<?xml", "an XML file", "give a table of numbers; a robot file is told by its end `.urdf`"),
    ("<robot", "a robot file", "give its name the end `.urdf`"),
];

/// Opens `path`, unpacking it if it begins like gzip.
pub(super) fn open(path: &Path, limit: u64) -> Result<BufReader<Bounded>, RecordingError> {
    let name = path.display().to_string();
    let unreadable = |source| RecordingError::Unreadable { path: name.clone(), source };
    let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(unreadable)?);
    let packed = file.fill_buf().map_err(unreadable)?.starts_with(b"\x1f\x8b");
    let bytes: Box<dyn BufRead> =
        if packed { Box::new(BufReader::new(MultiGzDecoder::new(file))) } else { Box::new(file) };
    let text =
        decoded(bytes).map_err(|error| unreadable(if packed { damaged(error) } else { error }))?;
    let bounded = Bounded { text, packed, left: limit, line: 1, line_length: 0 };
    let mut reader = BufReader::with_capacity(1 << 16, bounded);

    let start = reader.fill_buf().map_err(|error| explain(&name, limit, error))?;
    if start.is_empty() {
        return Err(RecordingError::Empty { path: name });
    }
    if let Some((_, found, advice)) = FOREIGN.iter().find(|(magic, ..)| start.starts_with(magic)) {
        return Err(RecordingError::WrongFormat { path: name, expected: "CSV", found, advice });
    }
    let beginning = start.trim_ascii_start();
    let begins_with = |tag: &str| {
        beginning.get(..tag.len()).is_some_and(|own| own.eq_ignore_ascii_case(tag.as_bytes()))
    };
    if let Some((_, found, advice)) = TAGS.iter().find(|(tag, ..)| begins_with(tag)) {
        return Err(RecordingError::WrongFormat { path: name, expected: "CSV", found, advice });
    }
    if start.contains(&0) {
        let (found, advice) = ("a binary file", "give a text file with one row per sample");
        return Err(RecordingError::WrongFormat { path: name, expected: "CSV", found, advice });
    }
    if start.starts_with(b"\xef\xbb\xbf") {
        reader.consume(3);
    }
    Ok(reader)
}

/// The cause of a failed read.
pub(super) fn explain(path: &str, limit: u64, error: io::Error) -> RecordingError {
    let path = path.to_string();
    match error.get_ref().and_then(|cause| cause.downcast_ref()) {
        Some(TooMuchText::Total) => RecordingError::TooLarge { path, limit },
        Some(TooMuchText::Line(line)) => {
            RecordingError::LongLine { path, line: *line, limit: LONGEST_LINE }
        }
        None => RecordingError::Unreadable { path, source: error },
    }
}

/// Too much text.
#[derive(Debug, thiserror::Error)]
enum TooMuchText {
    #[error("too much text")]
    Total,
    #[error("line {0} is too long")]
    Line(u64),
}

/// Text that fails beyond a total length or a line length.
pub(super) struct Bounded {
    text: Box<dyn Read>,
    packed: bool,
    left: u64,
    line: u64,
    line_length: usize,
}

impl Read for Bounded {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = match self.text.read(buffer) {
            Err(error) if self.packed && error.kind() != io::ErrorKind::Interrupted => {
                return Err(damaged(error));
            }
            result => result?,
        };
        self.left = self
            .left
            .checked_sub(count as u64)
            .ok_or_else(|| io::Error::other(TooMuchText::Total))?;
        for part in buffer[..count].split_inclusive(|&byte| byte == b'\n') {
            self.line_length += part.len();
            if self.line_length > LONGEST_LINE {
                return Err(io::Error::other(TooMuchText::Line(self.line)));
            }
            if part.ends_with(b"\n") {
                self.line += 1;
                self.line_length = 0;
            }
        }
        Ok(count)
    }
}

/// What a broken archive is called.
fn damaged(error: io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("the gzip data are truncated or damaged ({error})"))
}

/// `bytes` as UTF-8 if they begin with the mark of UTF-16, as spreadsheets write "Unicode text";
/// else as they are.
fn decoded(mut bytes: Box<dyn BufRead>) -> io::Result<Box<dyn Read>> {
    let unit = match bytes.fill_buf()? {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ => return Ok(Box::new(bytes)),
    };
    bytes.consume(2);
    Ok(Box::new(Utf16 { bytes, unit, text: io::Cursor::default() }))
}

struct Utf16 {
    bytes: Box<dyn BufRead>,
    unit: fn([u8; 2]) -> u16,
    text: io::Cursor<Vec<u8>>,
}

impl Utf16 {
    /// The next unit; half a one at the end is a sign of its own that no number holds.
    fn next(&mut self) -> io::Result<Option<u16>> {
        let mut pair = Vec::with_capacity(2);
        self.bytes.by_ref().take(2).read_to_end(&mut pair)?;
        Ok(match pair[..] {
            [first, second] => Some((self.unit)([first, second])),
            [_] => Some(char::REPLACEMENT_CHARACTER as u16),
            _ => None,
        })
    }
}

impl Read for Utf16 {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        const UNITS: usize = 1 << 14;
        if self.text.position() == self.text.get_ref().len() as u64 {
            let mut units = Vec::with_capacity(UNITS);
            // A character of two units stays whole.
            while units.len() < UNITS
                || units.last().is_some_and(|unit| (0xd800..0xdc00).contains(unit))
            {
                match self.next()? {
                    Some(unit) => units.push(unit),
                    None => break,
                }
            }
            self.text = io::Cursor::new(String::from_utf16_lossy(&units).into_bytes());
        }
        self.text.read(buffer)
    }
}
