//! LZF, the filter that h5py has of its own. Written here, because `hdf5-reader` lacks it and the
//! crate `lzf` is given up by its authors.
//!
//! Source: M. Lehmann, LibLZF 3.6, `lzf_d.c`.

use hdf5_reader::FilterRegistry;
use hdf5_reader::error::Error;

/// Number of the filter among those that are registered with the HDF Group.
const NUMBER: u16 = 32000;
/// Where the filter is told the size of a chunk.
const CHUNK_BYTES: usize = 2;

/// Literal bytes come after a number below this one.
const LITERALS: usize = 1 << 5;
/// A length of which the rest is in the next byte.
const LONG: usize = 7;

/// - `limit`: most bytes of a chunk
pub(super) fn register(filters: &mut FilterRegistry, limit: usize) {
    filters.register(
        NUMBER,
        Box::new(move |filter, data, _| {
            let size = filter.client_data.get(CHUNK_BYTES).copied().unwrap_or_default() as usize;
            let wrong = || Error::DecompressionError("LZF data are damaged".into());
            unpacked(data, size.min(limit)).ok_or_else(wrong)
        }),
    );
}

/// What `data` unpack to; `None` if that is more than `most` bytes, or they are damaged.
fn unpacked(data: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut rest = data;
    while let Some((first, behind)) = rest.split_first() {
        let control = usize::from(*first);
        rest = behind;
        if control < LITERALS {
            let (literal, behind) = rest.split_at_checked(control + 1)?;
            bytes.extend_from_slice(literal);
            rest = behind;
        } else {
            let mut length = control >> 5;
            if length == LONG {
                let (more, behind) = rest.split_first()?;
                length += usize::from(*more);
                rest = behind;
            }
            let (low, behind) = rest.split_first()?;
            rest = behind;
            let distance = ((control & 31) << 8) + usize::from(*low) + 1;
            let start = bytes.len().checked_sub(distance)?;
            // It may reach into what it writes.
            for place in start..start + length + 2 {
                bytes.push(bytes[place]);
            }
        }
        if bytes.len() > most {
            return None;
        }
    }
    Some(bytes)
}
