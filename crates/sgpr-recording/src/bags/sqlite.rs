//! The messages of an SQLite file of a bag of ROS 2.
//!
//! Source: rosbag2_storage_sqlite3, <https://github.com/ros2/rosbag2>, schemas 1 to 4: the tables
//! `topics` and `messages` are the same in all of them as far as they are needed here.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;
use std::rc::Rc;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};
use zstd::zstd_safe::DCtx;

use super::broken;
use super::files::ZSTD;
use crate::RecordingError;
use crate::mcap::Take;
use crate::mcap::message::MessageFormat;
use crate::mcap::scan::{Allowance, Message, Scan, Topic};

/// A row takes at least that many bytes of the file: its place in the page, its number, and the
/// header of its record.
const SMALLEST_ROW: u64 = 6;

/// Why a data base was not read to its end.
enum Stop {
    /// What is wrong with it.
    Damage(String),
    TooLarge,
    Error(RecordingError),
}

impl From<rusqlite::Error> for Stop {
    fn from(error: rusqlite::Error) -> Self {
        match error.sqlite_error_code() {
            Some(ErrorCode::TooBig) => Self::TooLarge,
            _ => Self::Damage(error.to_string()),
        }
    }
}

/// Hands each message of the file that is understood to `take`. Stops at the first damage unless
/// `recover`; then messages that are broken are left out.
///
/// Memory: one message, packed and unpacked, each at most as large as is allowed.
///
/// - `name`: of the file, for messages
pub(super) fn scan(
    path: &Path,
    name: &str,
    allowance: &mut Allowance,
    recover: bool,
    take: Take,
) -> Result<Scan, RecordingError> {
    let unreadable = |source| RecordingError::Unreadable { path: name.into(), source };
    let most = path.metadata().map_err(unreadable)?.len() / SMALLEST_ROW;
    let topics = HashMap::new();
    let mut reader =
        BaseReader { allowance, recover, take, most, topics, messages: 0, fault: None };
    match reader.read(path) {
        Ok(()) => {}
        Err(Stop::Damage(cause)) => reader.fault = reader.fault.or(Some(cause)),
        Err(Stop::TooLarge) => return Err(reader.allowance.exceeded()),
        Err(Stop::Error(error)) => return Err(error),
    }
    // A file without the messages that are elsewhere may look damaged.
    let fault = unwritten(path, name).or(reader.fault);
    let messages = reader.messages;
    let hint =
        if messages > 0 { "; set `recover` to take the messages that are intact" } else { "" };
    let damage = fault.map(|cause| broken(name, format!("{cause}{hint}")));
    let mut topics: Vec<(i64, Rc<Topic>)> = reader.topics.into_iter().collect();
    topics.sort_by_key(|(id, _)| *id);
    let topics = topics.into_iter().map(|(_, topic)| topic).collect();
    Ok(Scan { topics, messages, damage })
}

/// What is missing because the recorder was stopped before SQLite moved it into the file.
fn unwritten(path: &Path, name: &str) -> Option<String> {
    let mut journal = path.as_os_str().to_owned();
    journal.push("-wal");
    let waiting = Path::new(&journal).metadata().is_ok_and(|journal| journal.len() > 0);
    waiting.then(|| {
        format!(
            "the recorder was stopped, and messages may still be in {name}-wal: `sqlite3 {name} \
             .tables` moves them into the file"
        )
    })
}

/// Opens a file that may be anything and writes nothing beside it.
fn open(path: &Path, limit: u64) -> rusqlite::Result<Connection> {
    let mut address = String::from("file:");
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'.' | b'-' | b'_' => {
                address.push(char::from(*byte));
            }
            // Also `/`: two of them at the beginning would be followed by the name of a machine.
            other => address.push_str(&format!("%{other:02x}")),
        }
    }
    // No locks and no journal, which need files beside this one.
    address.push_str("?immutable=1");
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
        | OpenFlags::SQLITE_OPEN_URI
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let base = Connection::open_with_flags(address, flags)?;
    // No value is larger, whatever a row claims.
    base.set_limit(Limit::SQLITE_LIMIT_LENGTH, i32::try_from(limit).unwrap_or(i32::MAX))?;
    // Nothing that the file brings along is run: no functions, views, triggers.
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
    // Pages are checked when they are loaded; a file that is mapped and then shortened ends the
    // program.
    base.execute_batch("PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0;")?;
    Ok(base)
}

/// Refuses a data base whose rows do not stand in it: those of views, virtual tables and generated
/// columns may take any time and memory.
fn require_tables(base: &Connection) -> Result<(), Stop> {
    let tables: i64 = base.query_row(
        "SELECT count(*) FROM pragma_table_list AS list
         WHERE schema = 'main' AND type = 'table' AND name IN ('topics', 'messages')
         AND NOT EXISTS (SELECT 1 FROM pragma_table_xinfo(list.name) WHERE hidden <> 0)",
        [],
        |row| row.get(0),
    )?;
    if tables == 2 {
        Ok(())
    } else {
        Err(Stop::Damage("an SQLite file without the tables `topics` and `messages`".into()))
    }
}

/// Reads topics, then messages.
struct BaseReader<'a> {
    allowance: &'a mut Allowance,
    recover: bool,
    take: Take<'a>,
    /// Rows that the file has room for: more can only come of pages that are read again and again.
    most: u64,
    /// Topics by their number.
    topics: HashMap<i64, Rc<Topic>>,
    messages: u64,
    /// The first message that is broken.
    fault: Option<String>,
}

impl BaseReader<'_> {
    fn read(&mut self, path: &Path) -> Result<(), Stop> {
        let base = open(path, self.allowance.limit)?;
        require_tables(&base)?;
        self.read_topics(&base)?;
        self.read_messages(&base)
    }

    fn read_topics(&mut self, base: &Connection) -> Result<(), Stop> {
        // Not by an index, which need not say what its table says.
        let mut statement =
            base.prepare("SELECT id, name, type, serialization_format FROM topics NOT INDEXED")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            if self.topics.len() as u64 >= self.most {
                return Err(Stop::Damage("more topics than fit into the file".into()));
            }
            let topic = Topic { name: row.get(1)?, encoding: row.get(3)?, schema: row.get(2)? };
            let bytes = topic.name.len() + topic.schema.len() + topic.encoding.len();
            self.allowance.spend(bytes).map_err(Stop::Error)?;
            let id = row.get(0)?;
            if self.topics.insert(id, Rc::new(topic)).is_some() {
                return Err(Stop::Damage(format!("the topic {id} occurs twice")));
            }
        }
        Ok(())
    }

    /// Hands on the messages in the order of the file; the collector sorts them.
    fn read_messages(&mut self, base: &Connection) -> Result<(), Stop> {
        let understood = self.topics.iter().filter(|(_, topic)| MessageFormat::of(topic).is_ok());
        let understood: Vec<String> = understood.map(|(id, _)| id.to_string()).collect();
        // Of other topics it is only told that there are messages: they may be pictures.
        let mut statement = base.prepare(&format!(
            "SELECT topic_id, timestamp, CASE WHEN topic_id IN ({}) THEN data END
             FROM messages NOT INDEXED",
            understood.join(", ")
        ))?;
        let mut rows = statement.query([])?;
        // One for all: to make one takes longer than to unpack a message.
        let mut unpacker = DCtx::create();
        let mut count = 0;
        while let Some(row) = rows.next()? {
            count += 1;
            if count > self.most {
                return Err(Stop::Damage("more messages than fit into the file".into()));
            }
            match self.take_message(row, &mut unpacker) {
                Err(Stop::Damage(cause)) if self.recover => {
                    self.fault.get_or_insert(cause);
                    unpacker = DCtx::create();
                }
                result => result?,
            }
        }
        Ok(())
    }

    fn take_message(&mut self, row: &Row, unpacker: &mut DCtx<'static>) -> Result<(), Stop> {
        let (id, time): (i64, i64) = (row.get(0)?, row.get(1)?);
        let unknown = || Stop::Damage(format!("a message on the unknown topic {id}"));
        let topic = self.topics.get(&id).ok_or_else(unknown)?;
        let early = |_| Stop::Damage(format!("a message at the time {time} ns"));
        let log_time = u64::try_from(time).map_err(early)?;
        let stored = match row.get_ref(2)? {
            ValueRef::Blob(data) => data,
            ValueRef::Null => &[],
            _ => return Err(Stop::Damage("a message that is no blob".into())),
        };
        // Packed ones count too: the pages of one message may be those of many others.
        self.allowance.spend(stored.len()).map_err(Stop::Error)?;
        let mut data = Cow::Borrowed(stored);
        if stored.starts_with(ZSTD) {
            data = unpack(stored, unpacker, self.allowance.left.saturating_add(1))?.into();
            self.allowance.spend(data.len()).map_err(Stop::Error)?;
        }
        self.messages += 1;
        (self.take)(Message { topic, log_time, data: &data }).map_err(Stop::Error)
    }
}

/// - `most`: bytes that are unpacked
fn unpack(packed: &[u8], unpacker: &mut DCtx<'static>, most: u64) -> Result<Vec<u8>, Stop> {
    let mut bytes = Vec::new();
    zstd::Decoder::with_context(packed, unpacker)
        .take(most)
        .read_to_end(&mut bytes)
        .map_err(|error| Stop::Damage(format!("a message cannot be unpacked: {error}")))?;
    Ok(bytes)
}
