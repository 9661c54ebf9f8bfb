//! The messages of an MCAP file, with their topics.

use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

use flate2::Crc;
use mcap::records::op;

use super::bytes::{Bytes, MessageFault};
use super::chunk::Chunk;
use super::file::{FilePart, RecordFile};
use crate::RecordingError;

/// A channel: messages of one kind on one topic.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(crate) struct Topic {
    pub(crate) name: String,
    /// How messages are encoded: `cdr`, `ros1`, `json`, ...
    pub(crate) encoding: String,
    /// Name of their schema; empty if there is none.
    pub(crate) schema: String,
}

/// One message.
pub(crate) struct Message<'a> {
    pub(crate) topic: &'a Rc<Topic>,
    /// ns
    pub(crate) log_time: u64,
    pub(crate) data: &'a [u8],
}

/// How many bytes may still be unpacked.
pub(crate) struct Allowance {
    path: String,
    pub(crate) limit: u64,
    pub(crate) left: u64,
}

impl Allowance {
    /// - `path`: for messages
    pub(crate) fn new(path: &str, limit: u64) -> Self {
        Self { path: path.into(), limit, left: limit }
    }

    /// # Errors
    /// If so many are not left.
    pub(crate) fn require(&self, bytes: u64) -> Result<(), RecordingError> {
        if bytes > self.left { Err(self.exceeded()) } else { Ok(()) }
    }

    /// # Errors
    /// As [`Allowance::require`].
    pub(crate) fn spend(&mut self, bytes: usize) -> Result<(), RecordingError> {
        self.left = self.left.checked_sub(bytes as u64).ok_or_else(|| self.exceeded())?;
        Ok(())
    }

    pub(crate) fn exceeded(&self) -> RecordingError {
        RecordingError::TooLarge { path: self.path.clone(), limit: self.limit }
    }
}

/// Why reading stopped early, or left something out.
#[derive(Debug)]
pub(crate) enum Damage {
    Truncated { byte: u64 },
    Corrupt { byte: u64, cause: MessageFault },
}

impl Damage {
    /// - `messages`: those that are readable
    pub(crate) fn error(self, path: &str, messages: u64) -> RecordingError {
        let path = path.to_string();
        match self {
            Self::Truncated { byte } => RecordingError::Truncated { path, byte, messages },
            Self::Corrupt { byte, cause } => RecordingError::Damaged { path, byte, cause },
        }
    }
}

/// What a scan found besides messages.
#[derive(Default)]
pub(crate) struct Scan {
    pub(crate) topics: Vec<Rc<Topic>>,
    pub(crate) messages: u64,
    /// The first damage.
    pub(crate) damage: Option<RecordingError>,
}

/// Hands each message of the file to `take`. Stops at the first damage unless `recover`; then what
/// follows is read too, as far as it can be told apart.
///
/// Memory: one record of the file and, unpacked, one chunk, each at most as large as is allowed.
///
/// - `name`: of the file, for messages
pub(crate) fn scan(
    path: &Path,
    name: &str,
    allowance: &mut Allowance,
    recover: bool,
    take: impl FnMut(Message) -> Result<(), RecordingError>,
) -> Result<Scan, RecordingError> {
    let mut file = RecordFile::open(path, name)?;
    let limit = allowance.limit;
    let mut reader = MessageReader {
        path: name,
        allowance,
        recover,
        take,
        schemas: HashMap::new(),
        topics: HashMap::new(),
        listed: Vec::new(),
        messages: 0,
        damage: None,
    };
    if recover {
        reader.read_definitions(RecordFile::open(path, name)?)?;
    }
    while reader.damage.is_none() || recover {
        match file.next(name, limit)? {
            FilePart::Record { opcode, body, byte } => reader.record(opcode, &body, byte, true)?,
            FilePart::Partial { opcode, body, byte } => {
                reader.record(opcode, &body, byte, false)?;
                reader.damage.get_or_insert(Damage::Truncated { byte });
                break;
            }
            FilePart::Wrong { byte, cause } => {
                reader.damage.get_or_insert(Damage::Corrupt { byte, cause });
            }
            FilePart::End => break,
        }
    }
    let messages = reader.messages;
    let damage = reader.damage.map(|damage| damage.error(name, messages));
    Ok(Scan { topics: reader.listed, messages, damage })
}

/// Understands records, of the file and of its chunks.
struct MessageReader<'a, F> {
    path: &'a str,
    allowance: &'a mut Allowance,
    recover: bool,
    take: F,
    schemas: HashMap<u16, String>,
    topics: HashMap<u16, Rc<Topic>>,
    /// All topics, in order of appearance.
    listed: Vec<Rc<Topic>>,
    messages: u64,
    damage: Option<Damage>,
}

impl<F: FnMut(Message) -> Result<(), RecordingError>> MessageReader<'_, F> {
    /// Reads schemas and channels outside of chunks, as the summary at the end of the file repeats
    /// them: the chunk that holds the first ones may be lost.
    fn read_definitions(&mut self, mut file: RecordFile) -> Result<(), RecordingError> {
        loop {
            match file.next(self.path, self.allowance.limit)? {
                FilePart::Record { opcode: opcode @ (op::SCHEMA | op::CHANNEL), body, byte } => {
                    self.small_record(opcode, &body, byte)?;
                }
                FilePart::Record { .. } | FilePart::Wrong { .. } => {}
                FilePart::Partial { .. } | FilePart::End => break,
            }
        }
        self.damage = None;
        Ok(())
    }

    fn corrupt(&mut self, byte: u64, cause: MessageFault) {
        self.damage.get_or_insert(Damage::Corrupt { byte, cause });
    }

    /// A record that begins at `byte` of the file; the file ends inside it if not `whole`.
    fn record(
        &mut self,
        opcode: u8,
        body: &[u8],
        byte: u64,
        whole: bool,
    ) -> Result<(), RecordingError> {
        match opcode {
            op::CHUNK => self.chunk(body, byte, whole),
            op::SCHEMA | op::CHANNEL | op::MESSAGE if whole => {
                self.small_record(opcode, body, byte)
            }
            _ => Ok(()),
        }
    }

    fn small_record(&mut self, opcode: u8, body: &[u8], byte: u64) -> Result<(), RecordingError> {
        let bytes = Bytes::new(body, true);
        let result = match opcode {
            op::SCHEMA => self.schema(bytes),
            op::CHANNEL => self.channel(bytes),
            _ => return self.message(bytes, byte),
        };
        if let Err(cause) = result {
            self.corrupt(byte, format!("a schema or channel that cannot be understood ({cause})"));
        }
        Ok(())
    }

    fn schema(&mut self, mut bytes: Bytes) -> Result<(), MessageFault> {
        let (id, name) = (bytes.u16()?, bytes.text()?);
        self.schemas.insert(id, name.into_owned());
        Ok(())
    }

    fn channel(&mut self, mut bytes: Bytes) -> Result<(), MessageFault> {
        let (id, schema, name, encoding) =
            (bytes.u16()?, bytes.u16()?, bytes.text()?, bytes.text()?);
        if !self.topics.contains_key(&id) {
            let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
            let topic =
                Rc::new(Topic { name: name.into_owned(), encoding: encoding.into_owned(), schema });
            self.topics.insert(id, topic.clone());
            self.listed.push(topic);
        }
        Ok(())
    }

    fn message(&mut self, mut bytes: Bytes, byte: u64) -> Result<(), RecordingError> {
        let head = (|| {
            let (channel, _sequence, log_time, _publish_time) =
                (bytes.u16()?, bytes.u32()?, bytes.u64()?, bytes.u64()?);
            Ok::<_, MessageFault>((channel, log_time))
        })();
        let (channel, log_time) = match head {
            Ok(head) => head,
            Err(cause) => {
                self.corrupt(byte, format!("a message that cannot be understood ({cause})"));
                return Ok(());
            }
        };
        let Some(topic) = self.topics.get(&channel) else {
            self.corrupt(byte, format!("a message on the unknown channel {channel}"));
            return Ok(());
        };
        self.messages += 1;
        (self.take)(Message { topic, log_time, data: bytes.rest() })
    }

    fn chunk(&mut self, body: &[u8], byte: u64, whole: bool) -> Result<(), RecordingError> {
        let chunk = match Chunk::parse(body, whole) {
            Ok(chunk) => chunk,
            Err(cause) => {
                if whole {
                    self.corrupt(byte, cause);
                }
                return Ok(());
            }
        };
        self.allowance.require(chunk.size)?;
        let (records, fault) = chunk.unpack();
        self.allowance.spend(records.len())?;
        if let (Some(cause), true) = (fault, whole) {
            self.corrupt(byte, cause);
            if !self.recover {
                return Ok(());
            }
        } else if whole && chunk.checksum != 0 {
            let mut checksum = Crc::new();
            checksum.update(&records);
            let (found, stored) = (checksum.sum(), chunk.checksum);
            if found != stored {
                // Any of its messages may be the wrong one: all are left out.
                self.corrupt(
                    byte,
                    format!("checksum of the chunk {found:08x}, the file says {stored:08x}"),
                );
                return Ok(());
            }
        }
        self.records_of_chunk(&records, byte, whole)
    }

    fn records_of_chunk(
        &mut self,
        records: &[u8],
        byte: u64,
        whole: bool,
    ) -> Result<(), RecordingError> {
        let mut bytes = Bytes::new(records, true);
        while bytes.left() > 0 {
            let record = (|| {
                let opcode = bytes.take(1)?[0];
                let length = usize::try_from(bytes.u64()?)
                    .map_err(|_| MessageFault::from("a record without end"))?;
                Ok::<_, MessageFault>((opcode, bytes.take(length)?))
            })();
            match record {
                Ok((opcode, body)) if opcode != op::CHUNK => {
                    self.record(opcode, body, byte, true)?
                }
                Ok(_) => self.corrupt(byte, "a chunk inside a chunk".into()),
                Err(cause) => {
                    if whole {
                        self.corrupt(byte, format!("a record reaches beyond its chunk ({cause})"));
                    }
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}
