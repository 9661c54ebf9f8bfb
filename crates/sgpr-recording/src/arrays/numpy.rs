//! NumPy archives, `.npz`. Nothing in them is run, and sizes are known before memory is taken.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use py_literal::Value;
use zip::ZipArchive;
use zip::result::ZipError;

use super::bytes::{NumberKind, StoredNumber, each};
use super::held::shape_text;
use super::{ArrayContent, NamedArray, recording_of};
use crate::csv::{ReadOptions, Values};
use crate::{Format, Reader, Recording, RecordingError, TimeUnit};

/// NumPy archives.
pub static FORMAT: Format = Format {
    name: "NumPy archive",
    endings: &[".npz"],
    is_at: None,
    begins: |path, start| start.starts_with(b"PK\x03\x04") && holds_arrays(path),
    read: Reader::Table(|path, options| read(path, options)),
};

const ENDING: &str = ".npy";

/// Longest description of an array that is read, and the brackets in it; NumPy's own are shorter.
const LONGEST_HEADER: usize = 10_000;
const MOST_BRACKETS: usize = 100;

/// Reads a NumPy archive. Which array is what is told in the [module documentation](super).
///
/// # Errors
/// If the file is unreadable, no archive of arrays, damaged or too large, or holds Python objects;
/// as [`csv::read_columns`](crate::csv::read_columns).
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{arrays::numpy, csv::ReadOptions};
/// let recording = numpy::read("log.npz", &ReadOptions::default())?;
/// println!("{} joints", recording.dof());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let file = File::open(path)
        .map_err(|source| RecordingError::Unreadable { path: name.clone(), source })?;
    let damaged = |error: ZipError| damaged(&name, &error);
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(damaged)?;
    let mut members = Vec::new();
    let mut total = 0_u64;
    for place in 0..archive.len() {
        let member = archive.by_index_raw(place).map_err(damaged)?;
        if let Some(array) = String::from_utf8_lossy(member.name_raw()).strip_suffix(ENDING) {
            total = total.saturating_add(member.size());
            members.push((place, array.to_string()));
        }
    }
    if total > options.limit_bytes {
        return Err(RecordingError::TooLarge { path: name, limit: options.limit_bytes });
    }
    let mut arrays = Vec::with_capacity(members.len());
    for (place, array) in members {
        let mut member = archive.by_index(place).map_err(|error| match error {
            ZipError::UnsupportedArchive(_) => RecordingError::NoLog {
                path: name.clone(),
                cause: format!("`{array}` is packed as NumPy packs nothing: save it with NumPy"),
            },
            error => damaged(error),
        })?;
        let size = member.size();
        let mut bytes = Vec::new();
        // The size is believed only as far as there are data.
        (&mut member).take(size).read_to_end(&mut bytes).map_err(|error| damaged(error.into()))?;
        let read = array_of(&array, &bytes);
        arrays.push(read.map_err(|cause| RecordingError::NoLog {
            path: name.clone(),
            cause: format!("`{array}`{cause}"),
        })?);
    }
    recording_of(&name, arrays, options)
}

fn damaged(path: &str, error: &dyn std::fmt::Display) -> RecordingError {
    let (path, format) = (path.into(), "a NumPy archive");
    RecordingError::Broken { path, format, cause: error.to_string() }
}

/// Whether an archive holds arrays.
fn holds_arrays(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    ZipArchive::new(BufReader::new(file))
        .is_ok_and(|archive| archive.file_names_raw().any(|name| name.ends_with(ENDING.as_bytes())))
}

/// An array from the bytes of its file; what is wrong with it follows its name.
fn array_of(name: &str, bytes: &[u8]) -> Result<NamedArray, String> {
    let ArrayHeader { element, fortran, shape, data } = ArrayHeader::new(bytes)?;
    let Some(element) = element else {
        return Ok(NamedArray::new(name, shape, ArrayContent::Other("records".into())));
    };
    if element.kind == 'O' {
        return Err(" holds Python objects, which could run code: save numbers only".into());
    }
    let expected = shape
        .iter()
        .try_fold(element.size as u128, |size, length| size.checked_mul(*length as u128))
        .unwrap_or(u128::MAX);
    if expected != data.len() as u128 {
        let (shape, found) = (shape_text(&shape), data.len());
        return Err(format!(" should hold {expected} bytes for {shape}, there are {found}"));
    }
    let content = match element.values(data) {
        Some(values) => ArrayContent::Values(values),
        None => ArrayContent::Other(element.text),
    };
    Ok(if fortran {
        NamedArray::columns_first(name, shape, content)
    } else {
        NamedArray::new(name, shape, content)
    })
}

/// What stands before the numbers of an array.
///
/// NumPy Enhancement Proposal 1.
struct ArrayHeader<'a> {
    /// `None`: records.
    element: Option<ElementType>,
    fortran: bool,
    shape: Vec<usize>,
    data: &'a [u8],
}

impl<'a> ArrayHeader<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let no_array = || ": not an array of NumPy, or damaged".to_string();
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(no_array)?;
        let (length, rest) = match rest {
            [1, 0, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
            [2 | 3, 0, a, b, c, d, rest @ ..] => {
                (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest)
            }
            [major, minor, ..] => {
                return Err(format!(": version {major}.{minor} of the format is not known"));
            }
            _ => return Err(no_array()),
        };
        let (text, data) = rest.split_at_checked(length).ok_or_else(no_array)?;
        let text = std::str::from_utf8(text).map_err(|_| no_array())?;
        // The parser calls itself for each bracket.
        if length > LONGEST_HEADER || text.matches(['(', '[', '{']).count() > MOST_BRACKETS {
            return Err(": its description is longer than any of NumPy".into());
        }
        let header: Value = text.trim().parse().map_err(|_| no_array())?;
        let entries = header.as_dict().ok_or_else(no_array)?;
        let entry = |name: &str| {
            let found =
                entries.iter().find(|(key, _)| key.as_string().is_some_and(|key| key == name));
            found.map(|(_, value)| value).ok_or_else(no_array)
        };
        let shape = match entry("shape")? {
            Value::Tuple(lengths) | Value::List(lengths) => lengths
                .iter()
                .map(|length| length.as_integer().and_then(|length| usize::try_from(length).ok()))
                .collect::<Option<Vec<usize>>>()
                .ok_or_else(no_array)?,
            _ => return Err(no_array()),
        };
        Ok(Self {
            element: entry("descr")?
                .as_string()
                .map_or(Some(None), |text| ElementType::new(text).map(Some))
                .ok_or_else(no_array)?,
            fortran: entry("fortran_order")?.as_boolean().ok_or_else(no_array)?,
            shape,
            data,
        })
    }
}

/// The type of an array's elements, such as `<f8`.
struct ElementType {
    text: String,
    kind: char,
    big_endian: bool,
    /// Bytes.
    size: usize,
    /// Of times.
    unit: Option<String>,
}

impl ElementType {
    /// Of a description such as `<f8`, `|b1`, `<U5`, `<M8[ns]`.
    fn new(text: &str) -> Option<Self> {
        let rest = text.trim_start_matches(['<', '>', '=', '|']);
        let kind = rest.chars().next().filter(char::is_ascii)?;
        let (size, unit) = match rest[1..].split_once('[') {
            Some((size, unit)) => (size, Some(unit.trim_end_matches(']').to_string())),
            None => (&rest[1..], None),
        };
        let size: usize = if kind == 'O' { 0 } else { size.parse().ok()? };
        let width = if kind == 'U' { 4 } else { 1 };
        Some(Self {
            text: rest.into(),
            kind,
            big_endian: text.starts_with('>'),
            size: size.checked_mul(width)?,
            unit,
        })
    }

    /// The values, row-major or as they lie; `None` if they can be no column.
    fn values(&self, data: &[u8]) -> Option<Values<'static>> {
        let big_endian = self.big_endian;
        let number = |kind| StoredNumber { kind, size: self.size, big_endian }.values(data);
        match (self.kind, self.size) {
            ('f', _) => number(NumberKind::Float),
            ('i', _) => number(NumberKind::Signed),
            ('u', _) => number(NumberKind::Unsigned),
            ('b', 1) => {
                Some(Values::Integers(data.iter().map(|byte| i64::from(*byte != 0)).collect()))
            }
            ('m' | 'M', 8) => {
                let unit: TimeUnit = self.unit.as_deref()?.parse().ok()?;
                let times: Option<Vec<i64>> = each(data, big_endian, i64::from_le_bytes)
                    .into_iter()
                    .map(|time| unit.nanoseconds(time))
                    .collect();
                let times = times?.into();
                Some(if self.kind == 'm' {
                    Values::Seconds(times)
                } else {
                    Values::Instants(times)
                })
            }
            // Of texts without room for a letter a header can tell any number.
            ('U', size @ 1..) => {
                let text = |bytes| text_of(each(bytes, big_endian, u32::from_le_bytes));
                Some(Values::Texts(data.chunks_exact(size).map(text).collect()))
            }
            _ => None,
        }
    }
}

/// A text that is filled up with zeros.
fn text_of(letters: Vec<u32>) -> String {
    let end = letters.iter().rposition(|letter| *letter != 0).map_or(0, |at| at + 1);
    let letter = |letter: &u32| char::from_u32(*letter).unwrap_or(char::REPLACEMENT_CHARACTER);
    letters[..end].iter().map(letter).collect()
}
