//! HDF5 files, among them MATLAB files of version 7.3.
//!
//! Numbers and texts of all groups are read. What holds something else, or is stored in a way that
//! `hdf5-reader` (0.12.1) cannot read, is left out, and named in a note. What that crate would read
//! wrong or without limit is guarded here.

mod attributes;
mod lzf;
mod stored;

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::messages::datatype::{StringPadding, StringSize, VarLenKind};
use hdf5_reader::{ByteOrder, Dataset, Datatype, FilterRegistry, Hdf5File, OpenOptions};

use super::bytes::{NumberKind, StoredNumber};
use super::found::{ArrayFault, Found, OWN_BYTES};
use super::held::count;
use super::{ArrayContent, NamedArray, with_unit};
use crate::csv::{ReadOptions, Values};
use crate::guarded::guarded;
use crate::{Format, Reader, Recording, RecordingError};
use attributes::Attributes;

/// HDF5 files.
pub static FORMAT: Format = Format {
    name: "HDF5",
    endings: &[".h5", ".hdf5"],
    is_at: None,
    begins: |_, start| start.starts_with(SIGNATURE),
    read: Reader::Table(|path, options| read(path, options)),
};

pub(super) const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";

/// What messages call a file.
const A_FILE: &str = "an HDF5 file";

/// Groups in groups that are read; each calls itself for the next.
const MOST_NESTED: usize = 32;

/// Largest description of one object; attributes that are larger lie elsewhere.
const MOST_HEADER_BYTES: usize = 4 << 20;

/// Unpacked pieces that are kept for the next read; but each array is read once.
const CACHE_BYTES: usize = 0;

/// Groups of MATLAB files that hold what cells and objects refer to, under names without meaning.
const OF_MATLAB: [&str; 2] = ["#refs#", "#subsystem#"];

/// Reads an HDF5 file. Which array is what is told in the [module documentation](super); the
/// attribute `units` or `unit` of an array tells its unit.
///
/// # Errors
/// If the file is unreadable, damaged or too large, or holds no arrays that make a log; as
/// [`csv::read_columns`](crate::csv::read_columns).
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{arrays::hdf5, csv::ReadOptions};
/// let recording = hdf5::read("log.h5", &ReadOptions::default())?;
/// println!("{} joints", recording.dof());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    // What the system says of a path, before the crate calls it a damaged file.
    let length = readable(path)
        .map_err(|source| RecordingError::Unreadable { path: name.clone(), source })?;
    let limit = options.limit_bytes;
    // In builds that look for overflow a product of lengths that no memory has is a panic.
    let found = guarded(&name, A_FILE, || {
        arrays_of(path, length, limit).map_err(|fault| fault.of(&name, A_FILE, limit))
    })?;
    found.into_recording(&name, options)
}

/// The length of a file that can be read; a folder can only be opened.
fn readable(path: &Path) -> io::Result<u64> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    file.take(1).read_to_end(&mut Vec::new())?;
    Ok(length)
}

/// - `length`: of the file, bytes
fn arrays_of(path: &Path, length: u64, limit: u64) -> Result<Found, ArrayFault> {
    let file = Hdf5File::open_with_options(path, options(limit)).map_err(ArrayFault::damaged)?;
    // What is missing at the end may be numbers, which the crate does not tell from none.
    if length < file.superblock().eof_address {
        return Err(ArrayFault::damaged("it ends early"));
    }
    let root = file.root_group().map_err(ArrayFault::damaged)?;
    let mut walk = Walk { file, found: Found::new(limit), seen: HashSet::new() };
    walk.group(&root, "", 0)?;
    walk.found.unless_lost()
}

/// How the crate reads. Other files that this one names are not looked for.
fn options(limit: u64) -> OpenOptions {
    let limit = usize::try_from(limit).unwrap_or(usize::MAX);
    let mut filters = FilterRegistry::new();
    lzf::register(&mut filters, limit);
    OpenOptions::default()
        .with_chunk_cache_bytes(CACHE_BYTES)
        .with_filter_registry(filters)
        .with_max_chunk_bytes(limit)
        .with_max_read_bytes(limit)
        .with_max_object_header_bytes(MOST_HEADER_BYTES)
}

/// The way through the groups of a file.
struct Walk {
    file: Hdf5File,
    found: Found,
    /// Addresses of what was visited. Links lead to one thing on many ways, also from within: 2^24
    /// in a file of 25 groups.
    seen: HashSet<u64>,
}

impl Walk {
    /// Adds the arrays of a group and those in it; `name` ends in a dot, unless it is empty.
    fn group(&mut self, group: &Group, name: &str, depth: usize) -> Result<(), ArrayFault> {
        if !self.seen.insert(group.address()) {
            return Ok(());
        }
        if depth > MOST_NESTED {
            self.found.skip(name.trim_end_matches('.'), "lies too deep in groups");
            return Ok(());
        }
        let (groups, datasets) = match group.member_names() {
            Ok(names) => names,
            Err(error) => {
                let group = if name.is_empty() { "/" } else { name.trim_end_matches('.') };
                self.found.lose(group, &error);
                return Ok(());
            }
        };
        for own in datasets {
            if self.found.is_full() {
                return Ok(());
            }
            let whole = format!("{name}{own}");
            self.found.pay(whole.len() as u64)?;
            match group.dataset(&own) {
                Ok(dataset) => self.dataset(&dataset, whole)?,
                Err(error) => self.refused(&whole, error)?,
            }
        }
        for own in groups.iter().filter(|own| !OF_MATLAB.contains(&own.as_str())) {
            let whole = format!("{name}{own}");
            self.found.pay(whole.len() as u64)?;
            match group.group(own) {
                Ok(group) => self.group(&group, &format!("{whole}."), depth + 1)?,
                Err(error) => self.refused(&whole, error)?,
            }
        }
        Ok(())
    }

    /// Leaves out what the crate does not know, and fails for what is damaged.
    fn refused(&mut self, name: &str, error: Error) -> Result<(), ArrayFault> {
        match cause(&error) {
            Error::ResourceLimit(_) => Err(ArrayFault::TooLarge),
            Error::UnsupportedFilter(_)
            | Error::UnsupportedEncoding(_)
            | Error::UnsupportedLayoutClass(_)
            | Error::UnsupportedLayoutVersion(_)
            | Error::UnsupportedChunkIndexType(_)
            | Error::UnsupportedDatatypeClass(_) => {
                self.found.skip(name, error);
                Ok(())
            }
            _ => Err(ArrayFault::Damaged(format!("`{name}`: {error}"))),
        }
    }

    fn dataset(&mut self, dataset: &Dataset, name: String) -> Result<(), ArrayFault> {
        if !self.seen.insert(dataset.address()) {
            return Ok(());
        }
        let attributes = Attributes::of(dataset);
        if attributes.is_empty {
            return Ok(());
        }
        let Some(element) = StoredElement::of(dataset) else {
            self.found.skip(&name, "neither numbers nor text");
            return Ok(());
        };
        if let Some(why) = stored::misread(&self.file, dataset) {
            self.found.skip(&name, why);
            return Ok(());
        }
        let lengths = dataset.shape().iter().map(|length| usize::try_from(*length));
        let Ok(shape) = lengths.collect::<Result<Vec<_>, _>>() else {
            return Err(ArrayFault::TooLarge);
        };
        self.found.pay(element.bytes(dataset))?;
        let texts = attributes.texts(&shape);
        self.found.pay(texts.unwrap_or(0) as u64 * OWN_BYTES)?;
        let piece = stored::old_piece(&self.file, dataset);
        let data = match piece.unwrap_or_else(|| dataset.read_raw_bytes()) {
            Ok(data) => data,
            Err(error) => return self.refused(&name, error),
        };
        let values = match element {
            StoredElement::StoredNumber(number) => number.values(&data),
            StoredElement::Text(width, padding) => {
                let texts = data.chunks_exact(width).map(|text| text_of(text, padding));
                Some(Values::Texts(texts.collect()))
            }
            StoredElement::Linked => Some(Values::Texts(self.linked(dataset, &data, &name)?)),
        };
        // Of a data set without dimensions and without a value, too.
        let Some(values) = values.filter(|values| values.rows() == count(&shape)) else {
            self.found.skip(&name, "no values that could be read");
            return Ok(());
        };
        let name = with_unit(name, attributes.unit.as_deref());
        let is_turned = attributes.is_of_matlab && shape.len() == 2;
        let mut array = match (values, texts) {
            (Values::Integers(letters), Some(rows)) => {
                let texts = (0..rows).map(|row| row_of(&letters, rows, row));
                NamedArray::new(
                    name,
                    vec![rows],
                    ArrayContent::Values(Values::Texts(texts.collect())),
                )
            }
            (values, _) => NamedArray::new(name, shape, ArrayContent::Values(values)),
        };
        if is_turned {
            array.transpose();
        }
        array.squeeze();
        self.found.add(array)
    }

    /// The texts that an array of references refers to.
    fn linked(
        &mut self,
        dataset: &Dataset,
        data: &[u8],
        name: &str,
    ) -> Result<Vec<String>, ArrayFault> {
        let mut texts = Vec::new();
        for reference in data.chunks_exact(dataset.vlen_reference_size()) {
            // Many references may lead to one long text: each is paid.
            self.found.pay(u64::from(attributes::length_of_text(reference)))?;
            let text = dataset
                .resolve_vlen_reference_bytes(reference, 1)
                .map_err(|error| ArrayFault::Damaged(format!("`{name}`: {error}")))?;
            texts.push(text_of(&text, StringPadding::NullTerminate));
        }
        Ok(texts)
    }
}

/// The error without the names of the objects that it came through.
fn cause(mut error: &Error) -> &Error {
    while let Error::Context { source, .. } = error {
        error = source;
    }
    error
}

/// A text of MATLAB: letters in UTF-16, of which each row has every `rows`-th.
fn row_of(letters: &[i64], rows: usize, row: usize) -> String {
    let units = letters.iter().skip(row).step_by(rows);
    let units = units.map(|unit| u16::try_from(*unit).unwrap_or(u16::MAX));
    let text: String = char::decode_utf16(units)
        .map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER))
        .collect();
    // Rows are made equally long with spaces.
    if rows == 1 { text } else { text.trim_end_matches(' ').to_string() }
}

/// A text that ends at a zero or where its room ends: UTF-8, or else Latin-1.
fn text_of(bytes: &[u8], padding: StringPadding) -> String {
    let text = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
    let text = match std::str::from_utf8(text) {
        Ok(text) => text.to_string(),
        Err(_) => text.iter().map(|byte| char::from(*byte)).collect(),
    };
    match padding {
        StringPadding::SpacePad => text.trim_end_matches(' ').to_string(),
        _ => text,
    }
}

/// What an array consists of.
enum StoredElement {
    StoredNumber(StoredNumber),
    /// Texts in so much room each.
    Text(usize, StringPadding),
    /// References to texts.
    Linked,
}

impl StoredElement {
    /// `None` of what is not read.
    fn of(dataset: &Dataset) -> Option<Self> {
        let mut kind = dataset.dtype();
        // Truth values are an enumeration.
        while let Datatype::Enum { base, .. } = kind {
            kind = base;
        }
        let number = |kind, size: &u8, order: &ByteOrder| {
            let (size, big_endian) = (usize::from(*size), *order == ByteOrder::BigEndian);
            matches!(size, 1 | 2 | 4 | 8).then_some(Self::StoredNumber(StoredNumber {
                kind,
                size,
                big_endian,
            }))
        };
        match kind {
            Datatype::FloatingPoint { size, byte_order } => {
                number(NumberKind::Float, size, byte_order)
            }
            Datatype::FixedPoint { size, signed, byte_order } => number(
                if *signed { NumberKind::Signed } else { NumberKind::Unsigned },
                size,
                byte_order,
            ),
            Datatype::String { size: StringSize::Fixed(width), padding, .. } if *width > 0 => {
                Some(Self::Text(*width as usize, *padding))
            }
            Datatype::String { size: StringSize::Variable, .. }
            | Datatype::VarLen { kind: VarLenKind::String, .. } => Some(Self::Linked),
            _ => None,
        }
    }

    /// Memory for the values of an array and for their bytes in the file, whichever is more; texts
    /// take both.
    fn bytes(&self, dataset: &Dataset) -> u64 {
        let raw = dataset.raw_byte_len().map_or(u64::MAX, |bytes| bytes as u64);
        let count = dataset.num_elements().unwrap_or(u64::MAX);
        match self {
            Self::StoredNumber(_) => raw.max(count.saturating_mul(size_of::<f64>() as u64)),
            _ => raw.saturating_add(count.saturating_mul(OWN_BYTES)),
        }
    }
}
