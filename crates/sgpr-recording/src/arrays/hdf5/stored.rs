//! Arrays that `hdf5-reader` (0.12) would read wrong without an error.

use hdf5_reader::error::Error;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::layout::{ChunkIndexing, DataLayout};
use hdf5_reader::{Dataset, Hdf5File};

/// Flag of a type whose bytes lie as those of a VAX.
const OF_A_VAX: u8 = 1 << 6;

/// Where the properties of a type begin in its bytes.
const PROPERTIES: usize = 8;

/// Why the crate would take the numbers of an array for others.
pub(super) fn misread(file: &Hdf5File, dataset: &Dataset) -> Option<&'static str> {
    if !has_usual_numbers(dataset) {
        Some("numbers of unusual bits")
    } else if has_shifted_chunks(file, dataset) {
        Some("chunks of an array that could grow, but not without end")
    } else {
        None
    }
}

/// Whether numbers fill their bytes, and floats are those of IEEE 754: the crate looks at nothing
/// but their size.
fn has_usual_numbers(dataset: &Dataset) -> bool {
    const INTEGER: u8 = 0;
    const FLOAT: u8 = 1;
    // A type that is shared between arrays has no bytes here.
    let Ok(raw) = dataset.raw_datatype() else { return true };
    let (Some([class, flags, ..]), Some(properties)) =
        (raw.first_chunk::<PROPERTIES>(), raw.get(PROPERTIES..))
    else {
        return true;
    };
    let bits = |size: u8| [0, 0, size.wrapping_mul(8), 0];
    let size = raw[4];
    // Offset and number of bits; exponent: place, bits; mantissa: place, bits; bias.
    match class & 0x0f {
        INTEGER => properties.starts_with(&bits(size)),
        FLOAT if flags & OF_A_VAX != 0 => false,
        FLOAT => match size {
            2 => properties.starts_with(&[0, 0, 16, 0, 10, 5, 0, 10, 15, 0, 0, 0]),
            4 => properties.starts_with(&[0, 0, 32, 0, 23, 8, 0, 23, 127, 0, 0, 0]),
            8 => properties.starts_with(&[0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0]),
            _ => true,
        },
        _ => true,
    }
}

/// Whether the crate would take chunks for others: where an index is of the kind "fixed array" or
/// "implicit", they are numbered over the largest shape that the array may have, and the crate
/// numbers them over the present one. Both are the same while no dimension but the first has room
/// for more chunks.
fn has_shifted_chunks(file: &Hdf5File, dataset: &Dataset) -> bool {
    let (Some(most), Some(chunks)) = (dataset.max_dims(), dataset.chunks()) else { return false };
    let has_more_room =
        most.iter().zip(dataset.shape()).zip(&chunks).skip(1).any(|((most, length), chunk)| {
            let chunk = u64::from(*chunk).max(1);
            most.div_ceil(chunk) != length.div_ceil(chunk)
        });
    let is_shifted = |message: &HdfMessage| match message {
        HdfMessage::DataLayout(layout) => is_numbered_over_largest(&layout.layout),
        _ => false,
    };
    has_more_room
        && file
            .get_or_parse_header(dataset.address())
            .map_or(true, |header| header.messages.iter().any(is_shifted))
}

fn is_numbered_over_largest(layout: &DataLayout) -> bool {
    let DataLayout::Chunked { chunk_indexing, .. } = layout else { return false };
    matches!(chunk_indexing, Some(ChunkIndexing::FixedArray { .. } | ChunkIndexing::Implicit))
}

/// The bytes of an array in one piece whose layout is described in version 2, as by MATLAB 7.4. The
/// crate reads what follows the reserved bytes from two bytes too early, and takes the numbers for
/// damage, or for zeros where their bytes are a multiple of 2^16. `None` of all other arrays.
///
/// Source: HDF5 File Format Specification 3.0, IV.A.2.i: five reserved bytes in versions 1 and 2.
pub(super) fn old_piece(file: &Hdf5File, dataset: &Dataset) -> Option<Result<Vec<u8>, Error>> {
    let header = file.get_or_parse_header(dataset.address()).ok()?;
    let (address, size) = header.messages.iter().find_map(|message| match message {
        HdfMessage::DataLayout(layout) => match layout.layout {
            DataLayout::Contiguous { address, size } => Some((address, size)),
            _ => None,
        },
        _ => None,
    })?;
    let length = dataset.raw_byte_len().ok()?;
    let lengths = dataset.shape().iter().copied().chain([dataset.raw_element_size().ok()? as u64]);
    // Two bytes too early, the low half of a length stands where its high half is looked for.
    let mut above = 0;
    let misread = lengths.fold(1_u64, |product, length| {
        let shifted = (length & 0xffff) << 16 | above;
        above = length >> 16 & 0xffff;
        product.wrapping_mul(shifted)
    });
    if address & 0xffff != 0 || size != misread || size == length as u64 {
        return None;
    }
    Some(file.storage().read_range(address >> 16, length).map(|bytes| bytes.as_ref().to_vec()))
}
