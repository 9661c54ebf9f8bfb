//! MATLAB files: those of versions 4 to 7 are read here, those of version 7.3 are
//! [HDF5 files](super::hdf5).
//!
//! Numbers, texts and cells of texts are read, also those in structures; complex numbers, sparse
//! matrices, arrays of structures, other cells and objects are left out, and named in a note. No
//! crate does that: `matfile` and `mat5` read no text, cells or structures, and `matrw` panics on
//! structures of SciPy and on most damaged files. Every length is compared with what is
//! there before anything is reserved.
//!
//! Source: MathWorks, MAT-File Format (R2024b): "Level 5 MAT-Files", "Level 4 MAT-Files".

mod element;
mod version_4;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::bytes::NumberKind;
use super::found::{ArrayFault, Found, OWN_BYTES};
use super::{ArrayContent, NamedArray};
use crate::csv::{ReadOptions, Values};
use crate::{Format, Reader, Recording, RecordingError};
use element::{Elements, MatrixHead, class, kind};

/// MATLAB files.
pub static FORMAT: Format = Format {
    name: "MATLAB",
    endings: &[".mat"],
    is_at: None,
    begins: |_, start| start.starts_with(b"MATLAB 5.0 MAT") || start.starts_with(b"MATLAB 7.3 MAT"),
    read: Reader::Table(|path, options| read(path, options)),
};

/// What messages call a file.
const A_FILE: &str = "a MATLAB file";

/// Where version 7.3 has the signature of HDF5: behind a header of its own, or first.
const HDF5_PLACES: [usize; 2] = [512, 0];

/// Bytes in front of the variables of version 5, of which the last four are version and order.
const HEADER: usize = 128;
const VERSION_5: u16 = 0x0100;

/// Structures in structures that are read; each calls itself for the next.
const MOST_NESTED: usize = 24;

/// Reads a MATLAB file. Which array is what is told in the [module documentation](super).
///
/// # Errors
/// If the file is unreadable, damaged or too large, or holds no arrays that make a log; as
/// [`csv::read_columns`](crate::csv::read_columns).
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{arrays::matlab, csv::ReadOptions};
/// let recording = matlab::read("log.mat", &ReadOptions::default())?;
/// println!("{} joints", recording.dof());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let unreadable = |source| RecordingError::Unreadable { path: name.clone(), source };
    let mut file = File::open(path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    let mut bytes = Vec::new();
    let beginning = HDF5_PLACES[0] + super::hdf5::SIGNATURE.len();
    (&mut file).take(beginning as u64).read_to_end(&mut bytes).map_err(unreadable)?;
    let is_hdf5 =
        |place: usize| bytes.get(place..).is_some_and(|b| b.starts_with(super::hdf5::SIGNATURE));
    if HDF5_PLACES.into_iter().any(is_hdf5) {
        return super::hdf5::read(path, options);
    }
    let limit = options.limit_bytes;
    if length > limit {
        return Err(RecordingError::TooLarge { path: name, limit });
    }
    file.take(limit).read_to_end(&mut bytes).map_err(unreadable)?;
    let found = arrays_of(&bytes, limit).map_err(|fault| fault.of(&name, A_FILE, limit))?;
    found.into_recording(&name, options)
}

/// The arrays of a file of version 4 to 7.
fn arrays_of(bytes: &[u8], limit: u64) -> Result<Found, ArrayFault> {
    let mut found = Found::new(limit);
    found.pay(bytes.len() as u64)?;
    // Version 5 begins with text, version 4 with a small number.
    if bytes.iter().take(4).any(|byte| *byte == 0) {
        version_4::variables(&mut found, bytes)?;
    } else {
        variables(&mut found, bytes)?;
    }
    Ok(found)
}

fn variables(found: &mut Found, bytes: &[u8]) -> Result<(), ArrayFault> {
    let (header, rest) =
        bytes.split_at_checked(HEADER).ok_or_else(|| ArrayFault::damaged("it has no header"))?;
    let (version, big_endian) = match header[HEADER - 4..] {
        [a, b, b'I', b'M'] => (u16::from_le_bytes([a, b]), false),
        [a, b, b'M', b'I'] => (u16::from_be_bytes([a, b]), true),
        _ => return Err(ArrayFault::damaged("its header tells no byte order")),
    };
    if version != VERSION_5 {
        return Err(ArrayFault::Damaged(format!(
            "version {version:#06x} of the format is not known"
        )));
    }
    let mut elements = Elements { rest, big_endian };
    while !elements.rest.is_empty() {
        match elements.next()? {
            (kind::MATRIX, rest) => matrix(found, Elements { rest, big_endian }, None, 0)?,
            (kind::PACKED, packed) => {
                let unpacked = unpacked(found, packed)?;
                let rest = Elements { rest: &unpacked, big_endian }.next_of(kind::MATRIX)?;
                matrix(found, Elements { rest, big_endian }, None, 0)?;
            }
            _ => {}
        }
    }
    Ok(())
}

/// What a variable was before it was packed, as far as there is room for it.
fn unpacked(found: &mut Found, packed: &[u8]) -> Result<Vec<u8>, ArrayFault> {
    let mut bytes = Vec::new();
    let most = found.left().saturating_add(1);
    ZlibDecoder::new(packed).take(most).read_to_end(&mut bytes).map_err(ArrayFault::damaged)?;
    found.pay(bytes.len() as u64)?;
    Ok(bytes)
}

/// Adds the arrays of a variable, or of a field of a structure, which is called as it is told.
fn matrix(
    found: &mut Found,
    mut body: Elements<'_>,
    name: Option<String>,
    depth: usize,
) -> Result<(), ArrayFault> {
    if body.rest.is_empty() {
        return Ok(());
    }
    let head = MatrixHead::new(&mut body)?;
    let name = name.unwrap_or_else(|| head.name.clone());
    // A variable without a name holds what belongs to the objects of the others.
    if name.is_empty() {
        return Ok(());
    }
    match head.class {
        class::STRUCTURE if head.count == 1 => return structure(found, body, &name, depth),
        class::STRUCTURE => found.skip(&name, "an array of structures"),
        class::CELL => match texts_of_cell(found, body, head.count)? {
            Some(texts) => return add(found, name, head.shape, Values::Texts(texts)),
            None => found.skip(&name, "a cell"),
        },
        class::TEXT => match texts(found, &mut body, &head)? {
            Some(texts) => return add(found, name, vec![texts.len()], Values::Texts(texts)),
            None => found.skip(&name, "text"),
        },
        class::SPARSE => found.skip(&name, "a sparse matrix"),
        class::DOUBLE..=class::UINT64 if head.is_complex => found.skip(&name, "complex numbers"),
        class::DOUBLE..=class::UINT64 => {
            let values = numbers(found, body, &name, &head)?;
            return add(found, name, head.shape, values);
        }
        _ => found.skip(&name, "an object"),
    }
    Ok(())
}

/// Adds an array whose values lie columns first.
fn add(
    found: &mut Found,
    name: String,
    shape: Vec<usize>,
    values: Values<'static>,
) -> Result<(), ArrayFault> {
    let mut array = NamedArray::columns_first(name, shape, ArrayContent::Values(values));
    array.squeeze();
    found.add(array)
}

/// Adds the fields of a structure as `structure.field`.
fn structure(
    found: &mut Found,
    mut body: Elements<'_>,
    name: &str,
    depth: usize,
) -> Result<(), ArrayFault> {
    if depth == MOST_NESTED {
        found.skip(name, "lies too deep in structures");
        return Ok(());
    }
    let (_, width) = body.next()?;
    let width = body.number(width)? as usize;
    let (_, fields) = body.next()?;
    if width == 0 && !fields.is_empty() {
        return Err(ArrayFault::Damaged(format!("the fields of `{name}` have no names")));
    }
    let big_endian = body.big_endian;
    for field in fields.chunks_exact(width.max(1)) {
        let rest = body.next_of(kind::MATRIX)?;
        let field = element::name_of(field);
        // Each name holds those of all structures around it.
        found.pay((name.len() + field.len()) as u64)?;
        let whole = format!("{name}.{field}");
        matrix(found, Elements { rest, big_endian }, Some(whole), depth + 1)?;
    }
    Ok(())
}

fn numbers(
    found: &mut Found,
    mut body: Elements<'_>,
    name: &str,
    head: &MatrixHead,
) -> Result<Values<'static>, ArrayFault> {
    let (kind, data) = body.next()?;
    let number = kind::number(kind, body.big_endian)
        .ok_or_else(|| ArrayFault::Damaged(format!("`{name}` holds numbers of no known type")))?;
    if head.count.checked_mul(number.size) != Some(data.len()) {
        let (count, there) = (head.count, data.len() / number.size);
        return Err(ArrayFault::Damaged(format!(
            "`{name}` should hold {count} numbers, not {there}"
        )));
    }
    found.pay(element::excess(data.len(), number.size))?;
    let values =
        number.values(data).ok_or_else(|| ArrayFault::damaged("a number of an unknown size"))?;
    // Whole numbers are packed as such, also where they are floats in MATLAB: a time of `0:9` is s.
    let is_float = matches!(head.class, class::DOUBLE | class::SINGLE);
    Ok(match values {
        Values::Integers(whole) if is_float && number.kind != NumberKind::Float => {
            Values::Numbers(whole.iter().map(|value| *value as f64).collect())
        }
        values => values,
    })
}

/// The rows of a matrix of letters; `None` of more than two dimensions.
fn texts(
    found: &mut Found,
    body: &mut Elements<'_>,
    head: &MatrixHead,
) -> Result<Option<Vec<String>>, ArrayFault> {
    let (kind, data) = body.next()?;
    let [rows, _] = head.shape[..] else { return Ok(None) };
    found.pay((data.len() as u64).saturating_mul(size_of::<char>() as u64))?;
    let letters = body.letters(kind, data)?;
    // Letters of two units of UTF-16 each cannot be told by their place.
    if rows > 1 && letters.len() != head.count {
        return Ok(None);
    }
    found.pay((rows.min(letters.len()) as u64).saturating_mul(OWN_BYTES))?;
    Ok(Some(rows_of(&letters, rows)))
}

/// The rows of a matrix of letters that lie columns first, without the spaces that make them of one
/// length.
fn rows_of(letters: &[char], rows: usize) -> Vec<String> {
    if letters.is_empty() {
        return Vec::new();
    }
    if rows <= 1 {
        return vec![letters.iter().collect()];
    }
    let row = |row| letters.iter().skip(row).step_by(rows).collect::<String>();
    (0..rows).map(|place| row(place).trim_end_matches(' ').to_string()).collect()
}

/// The members of a cell; `None` unless each is a text.
fn texts_of_cell(
    found: &mut Found,
    mut body: Elements<'_>,
    count: usize,
) -> Result<Option<Vec<String>>, ArrayFault> {
    let mut all = Vec::new();
    for _ in 0..count {
        let rest = body.next_of(kind::MATRIX)?;
        if rest.is_empty() {
            return Ok(None);
        }
        let mut member = Elements { rest, big_endian: body.big_endian };
        let head = MatrixHead::new(&mut member)?;
        if head.class != class::TEXT {
            return Ok(None);
        }
        let Some(mut texts) = texts(found, &mut member, &head)? else { return Ok(None) };
        if texts.len() > 1 {
            return Ok(None);
        }
        found.pay(OWN_BYTES)?;
        all.push(texts.pop().unwrap_or_default());
    }
    Ok(Some(all))
}
