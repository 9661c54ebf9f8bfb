//! An MCAP file as a sequence of records.
//!
//! The readers of the `mcap` crate (0.26) are made for files that one trusts: a wrong length makes
//! them reserve up to 4 GiB or panic. Here every length is compared with what is there before
//! anything is reserved.
//!
//! Source: MCAP format specification, <https://mcap.dev/spec>.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::Crc;
use mcap::records::op;

use super::bytes::MessageFault;
use crate::RecordingError;

/// Opcode and length in front of each record.
const RECORD_HEAD: u64 = 9;

/// The next thing in a file.
pub(super) enum FilePart {
    Record {
        opcode: u8,
        body: Vec<u8>,
        byte: u64,
    },
    /// The file ends inside this record.
    Partial {
        opcode: u8,
        body: Vec<u8>,
        byte: u64,
    },
    /// A checksum that does not fit.
    Wrong {
        byte: u64,
        cause: MessageFault,
    },
    End,
}

/// The file as a sequence of records.
pub(super) struct RecordFile {
    reader: BufReader<File>,
    offset: u64,
    length: u64,
    /// Of everything read so far.
    checksum: Crc,
}

impl RecordFile {
    /// - `name`: of the file, for messages
    pub(super) fn open(path: &Path, name: &str) -> Result<Self, RecordingError> {
        let unreadable = |source| RecordingError::Unreadable { path: name.into(), source };
        let file = File::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let mut reader = BufReader::with_capacity(1 << 16, file);
        let start = reader.fill_buf().map_err(unreadable)?;
        let wrong = |found, advice| RecordingError::WrongFormat {
            path: name.into(),
            expected: "MCAP",
            found,
            advice,
        };
        if start.is_empty() {
            return Err(RecordingError::Empty { path: name.into() });
        }
        if start.starts_with(b"SQLite format 3") {
            return Err(wrong(
                "an SQLite bag of ROS 2",
                "`read` reads it if its name ends in .db3 (in Rust with the feature `bags`)",
            ));
        }
        if start.starts_with(b"#ROSBAG") {
            return Err(wrong(
                "a ROS 1 bag",
                "`read` reads it if its name ends in .bag (in Rust with the feature `bags`)",
            ));
        }
        if start.len() < mcap::MAGIC.len() && mcap::MAGIC.starts_with(start) {
            return Err(RecordingError::Truncated { path: name.into(), byte: 0, messages: 0 });
        }
        if !start.starts_with(mcap::MAGIC) {
            return Err(wrong(
                "a file of another kind",
                "MCAP files begin with the bytes 89 4d 43 41 50",
            ));
        }
        let mut file = Self { reader, offset: 0, length, checksum: Crc::new() };
        file.take(mcap::MAGIC.len() as u64).map_err(unreadable)?;
        Ok(file)
    }

    /// Reads `count` bytes, or what is left.
    fn take(&mut self, count: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        (&mut self.reader).take(count).read_to_end(&mut bytes)?;
        self.checksum.update(&bytes);
        self.offset += bytes.len() as u64;
        Ok(bytes)
    }

    fn skip(&mut self, count: u64) -> io::Result<()> {
        let mut left = count;
        while left > 0 {
            let part = self.take(left.min(1 << 16))?;
            if part.is_empty() {
                return Ok(());
            }
            left -= part.len() as u64;
        }
        Ok(())
    }

    pub(super) fn next(&mut self, path: &str, limit: u64) -> Result<FilePart, RecordingError> {
        let unreadable = |source| RecordingError::Unreadable { path: path.into(), source };
        loop {
            let (byte, before) = (self.offset, self.checksum.sum());
            let head = self.take(RECORD_HEAD).map_err(unreadable)?;
            let Ok([opcode, length @ ..]) = <[u8; RECORD_HEAD as usize]>::try_from(head) else {
                return Ok(FilePart::Partial { opcode: 0, body: Vec::new(), byte });
            };
            let length = u64::from_le_bytes(length);
            let whole = length <= self.length.saturating_sub(self.offset);
            match opcode {
                op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK => {
                    let there = length.min(self.length.saturating_sub(self.offset));
                    if there > limit {
                        return Err(RecordingError::TooLarge { path: path.into(), limit });
                    }
                    let body = self.take(there).map_err(unreadable)?;
                    let whole = whole && body.len() as u64 == length;
                    return Ok(if whole {
                        FilePart::Record { opcode, body, byte }
                    } else {
                        FilePart::Partial { opcode, body, byte }
                    });
                }
                _ if !whole => return Ok(FilePart::Partial { opcode: 0, body: Vec::new(), byte }),
                op::DATA_END if length >= 4 => {
                    let body = self.take(length.min(64)).map_err(unreadable)?;
                    self.skip(length - body.len() as u64).map_err(unreadable)?;
                    let stored = u32::from_le_bytes([body[0], body[1], body[2], body[3]]);
                    if stored != 0 && stored != before {
                        let cause = format!(
                            "checksum of the data {before:08x}, the file says {stored:08x}"
                        );
                        return Ok(FilePart::Wrong { byte, cause });
                    }
                }
                op::FOOTER => {
                    self.skip(length).map_err(unreadable)?;
                    let byte = self.offset;
                    let end = self.take(mcap::MAGIC.len() as u64).map_err(unreadable)?;
                    let ends = end == mcap::MAGIC;
                    return Ok(if ends {
                        FilePart::End
                    } else {
                        FilePart::Partial { opcode: 0, body: Vec::new(), byte }
                    });
                }
                _ => self.skip(length).map_err(unreadable)?,
            }
        }
    }
}
