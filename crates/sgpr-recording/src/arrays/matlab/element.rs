//! The elements that a MATLAB file of version 5 is made of.

use crate::arrays::bytes::{NumberKind, StoredNumber, each};
use crate::arrays::found::ArrayFault;
use crate::arrays::held::count;

/// Types of elements.
pub(super) mod kind {
    use super::{NumberKind, StoredNumber};

    pub(in super::super) const MATRIX: u32 = 14;
    pub(in super::super) const PACKED: u32 = 15;

    /// Numbers of a type.
    pub(in super::super) fn number(kind: u32, big_endian: bool) -> Option<StoredNumber> {
        let (kind, size) = match kind {
            1 => (NumberKind::Signed, 1),
            2 => (NumberKind::Unsigned, 1),
            3 => (NumberKind::Signed, 2),
            4 => (NumberKind::Unsigned, 2),
            5 => (NumberKind::Signed, 4),
            6 => (NumberKind::Unsigned, 4),
            7 => (NumberKind::Float, 4),
            9 => (NumberKind::Float, 8),
            12 => (NumberKind::Signed, 8),
            13 => (NumberKind::Unsigned, 8),
            _ => return None,
        };
        Some(StoredNumber { kind, size, big_endian })
    }
}

/// Classes of arrays.
pub(super) mod class {
    pub(in super::super) const CELL: u32 = 1;
    pub(in super::super) const STRUCTURE: u32 = 2;
    pub(in super::super) const TEXT: u32 = 4;
    pub(in super::super) const SPARSE: u32 = 5;
    pub(in super::super) const DOUBLE: u32 = 6;
    pub(in super::super) const SINGLE: u32 = 7;
    pub(in super::super) const UINT64: u32 = 15;
    pub(super) const OPAQUE: u32 = 17;
}

/// Flag of arrays of complex numbers, beside the class.
const COMPLEX: u32 = 0x0800;

/// Most bytes of an element that lies in its own tag.
const SMALL: usize = 4;
/// What elements begin on a multiple of.
const ALIGNMENT: usize = 8;
const TAG: usize = 8;

/// NumPy's own limit is as high, MATLAB writes as many as an array has.
const MOST_DIMENSIONS: usize = 32;

/// Elements one behind the other, of which each says its type and its length.
pub(super) struct Elements<'a> {
    pub(super) rest: &'a [u8],
    pub(super) big_endian: bool,
}

impl<'a> Elements<'a> {
    /// Type and content of the next element.
    pub(super) fn next(&mut self) -> Result<(u32, &'a [u8]), ArrayFault> {
        let early = || ArrayFault::damaged("it ends early");
        let (tag, content) = self.rest.split_at_checked(TAG).ok_or_else(early)?;
        let first = self.number(tag)?;
        if first >> 16 != 0 {
            let (kind, length) = (first & 0xffff, (first >> 16) as usize);
            if length > SMALL {
                return Err(ArrayFault::damaged("an element is longer than its tag"));
            }
            self.rest = content;
            return Ok((kind, &tag[TAG - SMALL..][..length]));
        }
        let length = self.number(&tag[TAG - SMALL..])? as usize;
        let (data, rest) = content.split_at_checked(length).ok_or_else(early)?;
        // The last one of a file may end without padding, packed ones have none.
        let padding =
            if first == kind::PACKED { 0 } else { length.next_multiple_of(ALIGNMENT) - length };
        self.rest = &rest[padding.min(rest.len())..];
        Ok((first, data))
    }

    /// Content of the next element, which is of this type.
    pub(super) fn next_of(&mut self, kind: u32) -> Result<&'a [u8], ArrayFault> {
        match self.next()? {
            (own, data) if own == kind => Ok(data),
            (own, _) => {
                Err(ArrayFault::Damaged(format!("an element of type {own} where {kind} is")))
            }
        }
    }

    /// The first whole number of an element.
    pub(super) fn number(&self, data: &[u8]) -> Result<u32, ArrayFault> {
        let bytes =
            data.first_chunk().ok_or_else(|| ArrayFault::damaged("an element is too short"))?;
        Ok(if self.big_endian { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) })
    }

    /// Letters of a type: bytes, UTF-8, UTF-16 or UTF-32.
    pub(super) fn letters(&self, kind: u32, data: &[u8]) -> Result<Vec<char>, ArrayFault> {
        let big_endian = self.big_endian;
        Ok(match kind {
            1 | 2 => data.iter().map(|byte| char::from(*byte)).collect(),
            16 => String::from_utf8_lossy(data).chars().collect(),
            4 | 17 => utf_16(each(data, big_endian, u16::from_le_bytes)),
            18 => each(data, big_endian, |bytes| letter(u32::from_le_bytes(bytes))),
            _ => return Err(ArrayFault::damaged("a text of no known type")),
        })
    }
}

fn utf_16(units: Vec<u16>) -> Vec<char> {
    let letters = char::decode_utf16(units);
    letters.map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// A letter of its number.
pub(super) fn letter(number: u32) -> char {
    char::from_u32(number).unwrap_or(char::REPLACEMENT_CHARACTER)
}

/// A name that may end in zeros.
pub(super) fn name_of(bytes: &[u8]) -> String {
    let name = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(name).into_owned()
}

/// What numbers of `size` bytes take more of memory, where each has eight, than of the file.
pub(super) fn excess(bytes: usize, size: usize) -> u64 {
    (bytes / size * (size_of::<f64>() - size)) as u64
}

/// What stands in front of the values of an array.
pub(super) struct MatrixHead {
    pub(super) class: u32,
    pub(super) is_complex: bool,
    /// Of objects none.
    pub(super) shape: Vec<usize>,
    /// Number of values.
    pub(super) count: usize,
    pub(super) name: String,
}

impl MatrixHead {
    pub(super) fn new(body: &mut Elements<'_>) -> Result<Self, ArrayFault> {
        let (_, flags) = body.next()?;
        let flags = body.number(flags)?;
        let class = flags & 0xff;
        let shape = if class == class::OPAQUE { Vec::new() } else { shape_of(body)? };
        let (_, name) = body.next()?;
        Ok(Self {
            class,
            is_complex: flags & COMPLEX != 0,
            count: count(&shape),
            shape,
            name: name_of(name),
        })
    }
}

fn shape_of(body: &mut Elements<'_>) -> Result<Vec<usize>, ArrayFault> {
    let wrong = || ArrayFault::damaged("an array without sensible dimensions");
    let (_, data) = body.next()?;
    let lengths = each(data, body.big_endian, i32::from_le_bytes);
    if !(2..=MOST_DIMENSIONS).contains(&lengths.len()) {
        return Err(wrong());
    }
    lengths.into_iter().map(|length| usize::try_from(length).map_err(|_| wrong())).collect()
}
