//! Chunks of an MCAP file, or of a bag of ROS 1: records, packed or not.

use std::io::{self, Read};

use super::bytes::{Bytes, MessageFault};

/// A chunk: records, packed or not.
pub(crate) struct Chunk<'a> {
    /// Unpacked length that it claims.
    pub(crate) size: u64,
    /// Of the unpacked bytes; 0 if there is none.
    pub(crate) checksum: u32,
    pub(crate) compression: String,
    pub(crate) packed: &'a [u8],
}

impl<'a> Chunk<'a> {
    pub(super) fn parse(body: &'a [u8], whole: bool) -> Result<Self, MessageFault> {
        let mut bytes = Bytes::new(body, true);
        bytes.take(16)?; // first and last time
        let (size, checksum) = (bytes.u64()?, bytes.u32()?);
        let compression = bytes.text()?.into_owned();
        let length = bytes.u64()?;
        if whole && length > bytes.left() as u64 {
            return Err(format!(
                "a chunk claims {length} packed bytes, but its record has {}",
                bytes.left()
            ));
        }
        let there = usize::try_from(length).unwrap_or(usize::MAX).min(bytes.left());
        Ok(Self { size, checksum, compression, packed: &bytes.rest()[..there] })
    }

    /// The unpacked bytes, as many as could be had and never more than claimed, and why they are
    /// not all.
    pub(crate) fn unpack(&self) -> (Vec<u8>, Option<MessageFault>) {
        let mut records = Vec::new();
        let result = match self.compression.as_str() {
            "" => (&mut &self.packed[..]).take(self.size).read_to_end(&mut records),
            "zstd" => zstd::stream::read::Decoder::with_buffer(self.packed)
                .and_then(|unpacked| unpacked.take(self.size).read_to_end(&mut records)),
            "lz4" => lz4::Decoder::new(self.packed)
                .and_then(|unpacked| unpacked.take(self.size).read_to_end(&mut records)),
            #[cfg(feature = "bags")]
            "bz2" => bzip2::bufread::BzDecoder::new(self.packed)
                .take(self.size)
                .read_to_end(&mut records),
            other => Err(io::Error::other(format!("the compression `{other}` is not supported"))),
        };
        let fault = match result {
            Err(error) => Some(format!("a chunk cannot be unpacked: {error}")),
            Ok(_) if (records.len() as u64) < self.size => {
                Some(format!("a chunk claims {} bytes and holds {}", self.size, records.len()))
            }
            Ok(_) => None,
        };
        (records, fault)
    }
}
