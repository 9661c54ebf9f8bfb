//! The messages of a bag of ROS 1.
//!
//! The readers of the `rosbag` crate (0.6) are made for bags that one trusts: they map the file,
//! panic if the header points beyond it, and reserve as much as a chunk claims. Here chunks are
//! read in the order of the file, and the index at its end is not needed.
//!
//! Source: Bag format 2.0, <https://wiki.ros.org/Bags/Format/2.0>.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::rc::Rc;

use super::{broken, files};
use crate::RecordingError;
use crate::mcap::Take;
use crate::mcap::bytes::{Bytes, MessageFault};
use crate::mcap::chunk::Chunk;
use crate::mcap::message::ROS1;
use crate::mcap::scan::{Allowance, Damage, Message, Scan, Topic};

/// What a record is.
mod op {
    pub(super) const MESSAGE: u8 = 2;
    pub(super) const BAG: u8 = 3;
    pub(super) const CHUNK: u8 = 5;
    pub(super) const CONNECTION: u8 = 7;
}

/// Hands each message of the file to `take`. Stops at the first damage unless `recover`; then what
/// follows is read too, as far as it can be told apart.
///
/// Memory: one record of the file and, unpacked, one chunk, each at most as large as is allowed.
///
/// - `name`: of the file, for messages
pub(super) fn scan(
    path: &Path,
    name: &str,
    allowance: &mut Allowance,
    recover: bool,
    take: Take,
) -> Result<Scan, RecordingError> {
    let mut reader = BagReader::open(path, name, allowance, recover, take)?;
    if recover {
        reader.read_connections()?;
    }
    while let Some(record) = reader.next()? {
        reader.record(&record)?;
        // A file that others shorten meanwhile has no end to arrive at.
        if !record.whole || (reader.damage.is_some() && !recover) {
            break;
        }
    }
    if reader.announced.is_none_or(|announced| reader.chunks < announced) {
        // Cut between two records; or never finished, as the header announces no chunks then.
        let byte = reader.byte;
        reader.damage.get_or_insert(Damage::Truncated { byte });
    }
    let messages = reader.messages;
    let damage = reader.damage.map(|damage| match damage {
        damage if !reader.listed.is_empty() => damage.error(name, messages),
        Damage::Truncated { byte } => {
            broken(name, format!("what begins at byte {byte} is incomplete"))
        }
        Damage::Corrupt { cause, .. } => broken(name, cause),
    });
    Ok(Scan { topics: reader.listed, messages, damage })
}

/// A record of the file.
struct BagRecord {
    byte: u64,
    header: Vec<u8>,
    data: Vec<u8>,
    /// Whether the file has all of it.
    whole: bool,
}

/// Understands records, of the file and of its chunks.
struct BagReader<'a> {
    path: &'a str,
    file: BufReader<File>,
    byte: u64,
    length: u64,
    allowance: &'a mut Allowance,
    recover: bool,
    take: Take<'a>,
    topics: HashMap<u32, Rc<Topic>>,
    /// All topics, in order of appearance.
    listed: Vec<Rc<Topic>>,
    messages: u64,
    chunks: u64,
    /// Chunks that the header announces.
    announced: Option<u64>,
    damage: Option<Damage>,
}

impl<'a> BagReader<'a> {
    fn open(
        path: &Path,
        name: &'a str,
        allowance: &'a mut Allowance,
        recover: bool,
        take: Take<'a>,
    ) -> Result<Self, RecordingError> {
        let unreadable = |source| RecordingError::Unreadable { path: name.into(), source };
        let file = files::open(path)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let mut reader = Self {
            path: name,
            file: BufReader::with_capacity(1 << 16, file),
            byte: 0,
            length,
            allowance,
            recover,
            take,
            topics: HashMap::new(),
            listed: Vec::new(),
            messages: 0,
            chunks: 0,
            announced: None,
            damage: None,
        };
        reader.rewind().map_err(unreadable)?;
        Ok(reader)
    }

    /// Goes to the first record.
    fn rewind(&mut self) -> io::Result<()> {
        self.byte = files::ROS1.len() as u64;
        self.file.seek(SeekFrom::Start(self.byte)).map(drop)
    }

    /// Reads `count` bytes, or what is left.
    fn bytes(&mut self, count: u64) -> Result<Vec<u8>, RecordingError> {
        let unreadable = |source| RecordingError::Unreadable { path: self.path.into(), source };
        // Grows with what is there: what a record claims is never reserved.
        let mut bytes = Vec::new();
        (&mut self.file).take(count).read_to_end(&mut bytes).map_err(unreadable)?;
        self.byte += bytes.len() as u64;
        Ok(bytes)
    }

    /// A length and as many bytes, and whether the file has them all.
    fn part(&mut self) -> Result<(Vec<u8>, bool), RecordingError> {
        let Ok(length) = <[u8; 4]>::try_from(self.bytes(4)?) else {
            return Ok((Vec::new(), false));
        };
        let length = u64::from(u32::from_le_bytes(length));
        if length.min(self.length.saturating_sub(self.byte)) > self.allowance.limit {
            return Err(self.allowance.exceeded());
        }
        let bytes = self.bytes(length)?;
        let whole = bytes.len() as u64 == length;
        Ok((bytes, whole))
    }

    /// The next record of the file; `None` at its end.
    fn next(&mut self) -> Result<Option<BagRecord>, RecordingError> {
        let byte = self.byte;
        if byte >= self.length {
            return Ok(None);
        }
        let (header, header_is_whole) = self.part()?;
        let (data, data_is_whole) = self.part()?;
        Ok(Some(BagRecord { byte, header, data, whole: header_is_whole && data_is_whole }))
    }

    /// Reads connections outside of chunks, as the index at the end of the file repeats them: the
    /// chunk that holds the first ones may be lost.
    fn read_connections(&mut self) -> Result<(), RecordingError> {
        while let Some(record) = self.next()? {
            if !record.whole {
                break;
            }
            if opcode(&record.header) == Ok(op::CONNECTION) {
                // What is wrong with it is found when it is read in its turn.
                let _ = self.connection(&record.header, &record.data);
            }
        }
        self.rewind()
            .map_err(|source| RecordingError::Unreadable { path: self.path.into(), source })
    }

    fn corrupt(&mut self, byte: u64, cause: MessageFault) {
        self.damage.get_or_insert(Damage::Corrupt { byte, cause });
    }

    fn record(&mut self, record: &BagRecord) -> Result<(), RecordingError> {
        let &BagRecord { byte, ref header, ref data, whole } = record;
        if !whole {
            self.damage.get_or_insert(Damage::Truncated { byte });
        }
        match opcode(header) {
            Ok(op::CHUNK) => return self.chunk(header, data, byte, whole),
            Ok(op::BAG) if whole => {
                if let Err(cause) = self.bag(header) {
                    self.corrupt(byte, cause);
                }
            }
            Ok(op) if whole => return self.small_record(op, header, data, byte),
            Ok(_) => {}
            Err(cause) => self.corrupt(byte, cause),
        }
        Ok(())
    }

    /// The header of the file.
    fn bag(&mut self, header: &[u8]) -> Result<(), MessageFault> {
        if let Some(encryptor) = field(header, "encryptor")?.filter(|name| !name.is_empty()) {
            return Err(format!("the bag is encrypted ({})", text(encryptor)));
        }
        let index = needed(header, "index_pos")?.u64()?;
        let chunks = needed(header, "chunk_count")?.u32()?;
        // An index that nobody wrote, or that was cut off.
        self.announced = (index != 0 && index <= self.length).then_some(chunks.into());
        Ok(())
    }

    /// A record of the file or of the chunk that begins at `byte`.
    fn small_record(
        &mut self,
        op: u8,
        header: &[u8],
        data: &[u8],
        byte: u64,
    ) -> Result<(), RecordingError> {
        match op {
            op::MESSAGE => match self.message_head(header) {
                Ok((topic, log_time)) => {
                    self.messages += 1;
                    return (self.take)(Message { topic: &topic, log_time, data });
                }
                Err(cause) => self.corrupt(byte, cause),
            },
            op::CONNECTION => {
                if let Err(cause) = self.connection(header, data) {
                    self.corrupt(byte, cause);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Topic and log time (ns) of a message.
    fn message_head(&self, header: &[u8]) -> Result<(Rc<Topic>, u64), MessageFault> {
        let connection = needed(header, "conn")?.u32()?;
        let mut time = needed(header, "time")?;
        let (seconds, nanoseconds) = (u64::from(time.u32()?), u64::from(time.u32()?));
        let unknown = || format!("a message on the unknown connection {connection}");
        let topic = self.topics.get(&connection).ok_or_else(unknown)?;
        Ok((topic.clone(), seconds * 1_000_000_000 + nanoseconds))
    }

    fn connection(&mut self, header: &[u8], data: &[u8]) -> Result<(), MessageFault> {
        let connection = needed(header, "conn")?.u32()?;
        if let Entry::Vacant(place) = self.topics.entry(connection) {
            let name = text(needed(header, "topic")?.rest());
            let schema = text(needed(data, "type")?.rest());
            let topic = Rc::new(Topic { name, encoding: ROS1.into(), schema });
            self.listed.push(place.insert(topic).clone());
        }
        Ok(())
    }

    fn chunk(
        &mut self,
        header: &[u8],
        packed: &[u8],
        byte: u64,
        whole: bool,
    ) -> Result<(), RecordingError> {
        self.chunks += 1;
        let chunk = match chunk(header, packed) {
            Ok(chunk) => chunk,
            Err(cause) => {
                self.corrupt(byte, cause);
                return Ok(());
            }
        };
        self.allowance.require(chunk.size)?;
        let (records, fault) = chunk.unpack();
        self.allowance.spend(records.len())?;
        if let Some(cause) = fault {
            self.corrupt(byte, cause);
            if whole && !self.recover {
                return Ok(());
            }
        }
        let mut bytes = Bytes::new(&records, true);
        while bytes.left() > 0 {
            match record_of_chunk(&mut bytes) {
                Ok((op, header, data)) => self.small_record(op, header, data, byte)?,
                Err(cause) => {
                    self.corrupt(byte, format!("a record of the chunk: {cause}"));
                    break;
                }
            }
        }
        Ok(())
    }
}

fn chunk<'a>(header: &[u8], packed: &'a [u8]) -> Result<Chunk<'a>, MessageFault> {
    let size = needed(header, "size")?.u32()?.into();
    let compression = match needed(header, "compression")?.rest() {
        b"none" => String::new(),
        other => text(other),
    };
    Ok(Chunk { size, checksum: 0, compression, packed })
}

/// Opcode, header and data of a record.
fn record_of_chunk<'a>(bytes: &mut Bytes<'a>) -> Result<(u8, &'a [u8], &'a [u8]), MessageFault> {
    let length = bytes.length(1)?;
    let header = bytes.take(length)?;
    let length = bytes.length(1)?;
    let data = bytes.take(length)?;
    Ok((opcode(header)?, header, data))
}

/// A field of a header, which is `name=value` after its length.
fn field<'a>(header: &'a [u8], name: &str) -> Result<Option<&'a [u8]>, MessageFault> {
    let mut bytes = Bytes::new(header, true);
    while bytes.left() > 0 {
        let length = bytes.length(1)?;
        if let Some([b'=', value @ ..]) = bytes.take(length)?.strip_prefix(name.as_bytes()) {
            return Ok(Some(value));
        }
    }
    Ok(None)
}

fn needed<'a>(header: &'a [u8], name: &str) -> Result<Bytes<'a>, MessageFault> {
    let value = field(header, name)?.ok_or_else(|| format!("a record without `{name}`"))?;
    Ok(Bytes::new(value, true))
}

fn opcode(header: &[u8]) -> Result<u8, MessageFault> {
    Ok(needed(header, "op")?.take(1)?[0])
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
