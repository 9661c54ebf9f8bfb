//! Bags written by the Python package `rosbags` (`data/recording/bags/make_fixtures.py`), and files
//! that are damaged or lie.

use std::fs;
use std::io::Read as _;
use std::path::PathBuf;

use rusqlite::Connection;
use sgpr_recording::mcap::{self, Clock, McapOptions};
use sgpr_recording::{Format, Recording, RecordingError, bags};
use tempfile::TempDir;

use super::{file, fixture, message, names};

const START: i64 = 1_700_000_000_000_000_007;
const DELAY: i64 = 1_000_000;

const BAGS: [&str; 9] = [
    "plain.bag",
    "bz2.bag",
    "lz4.bag",
    "sqlite",
    "sqlite/sqlite.db3",
    "packed_messages",
    "packed_file",
    "packed_file/packed_file.db3.zstd",
    "several",
];

fn bag(name: &str) -> PathBuf {
    fixture("bags").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    fs::read(bag(name)).expect("a fixture")
}

/// Joints of the fixtures in the order of `states.csv`.
fn in_order() -> McapOptions {
    McapOptions::default().with_joints(Some(names(&["shoulder", "elbow", "wrist_1"])))
}

fn recovering() -> McapOptions {
    in_order().with_recover(true)
}

fn read(content: impl AsRef<[u8]>, options: &McapOptions) -> Result<Recording, RecordingError> {
    let (_folder, path) = file("log.bag", content);
    bags::read(path, options)
}

/// The message of an error, with the folder of the file cut away.
fn error(content: impl AsRef<[u8]>) -> String {
    let text = message(read(content, &in_order()));
    text[text.find("log.bag").expect("the file is named")..].to_string()
}

/// Time and numbers of `states.csv`, which were written with the bags.
fn expected() -> (Vec<i64>, [Vec<f64>; 3]) {
    let text = fs::read_to_string(bag("states.csv")).expect("a fixture");
    let (mut time, mut arrays) = (Vec::new(), [const { Vec::new() }; 3]);
    for line in text.lines().skip(1) {
        let (stamp, numbers) = line.split_once(',').expect("columns");
        time.push(stamp.parse().expect("ns"));
        let numbers: Vec<f64> = numbers.split(',').map(|cell| cell.parse().expect("f64")).collect();
        for (array, values) in arrays.iter_mut().zip(numbers.chunks(3)) {
            array.extend(values);
        }
    }
    (time, arrays)
}

fn assert_is_whole(log: &Recording) {
    let (time, [q, dq, tau]) = expected();
    assert_eq!(log.time(), time);
    assert_eq!(log.position(), q);
    assert_eq!(log.velocity(), Some(&dq[..]));
    assert_eq!(log.torque(), Some(&tau[..]));
}

#[test]
fn every_bit_of_all_kinds() {
    for name in BAGS {
        let format = Format::of(bag(name)).expect("a bag");
        assert_eq!(format.name, "ROS bag", "{name}");
        let log = bags::read(bag(name), &in_order()).expect(name);
        assert_is_whole(&log);
        assert_eq!(log.source(), bag(name).display().to_string());
        let load = &log.channel("/load").expect("a number").values;
        let motor = &log.channel("/motor/temperature").expect("a number").values;
        assert_eq!(load.len(), 24);
        // Values without stamp are there by the time of the log, a millisecond after the state.
        assert!(
            load[0].is_nan()
                && load[1..].iter().zip(0..).all(|(load, k)| *load == 0.5 * f64::from(k))
        );
        assert_eq!((motor[7], motor[8]), (40.0, 48.0));
        assert_eq!(log.notes().len(), 1);
        assert!(log.notes()[0].starts_with("skipped topics: /chatter (std_msgs/"));
    }
}

#[test]
fn by_log_time_or_some_joints_of_a_topic() {
    for name in BAGS {
        let log = bags::read(bag(name), &in_order().with_clock(Clock::LogTime)).expect(name);
        assert_eq!(log.time()[0], START + DELAY);
        let options = McapOptions::default()
            .with_joints(Some(names(&["a"])))
            .with_logged_names(Some(names(&["elbow"])))
            .with_topics(Some(names(&["/joint_states"])));
        let log = bags::read(bag(name), &options).expect(name);
        assert_eq!((log.dof(), log.position()[0]), (1, 1f64.sin()));
        let text = message(bags::read(bag(name), &options.with_topics(Some(names(&["/up"])))));
        assert!(text.contains("there is no topic `/up` with joint states"), "{text}");
    }
}

#[test]
fn limits_hold() {
    for name in BAGS {
        for limit in [10, 100, 3000] {
            let text = message(bags::read(bag(name), &in_order().with_limit_bytes(limit)));
            assert!(text.contains(&format!("{name}: more than {limit} bytes")), "{text}");
        }
    }
}

/// A folder with copies of files.
fn folder(files: &[(PathBuf, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (from, to) in files {
        fs::copy(from, folder.path().join(to)).expect("a writable folder");
    }
    folder
}

#[test]
fn folders_without_a_description() {
    let parts = ["several_0.db3", "several_1.db3"];
    let part = |number: usize| bag("several").join(parts[number]);
    let whole = folder(&[(part(0), parts[0]), (part(1), parts[1])]);
    assert_is_whole(&bags::read(whole.path(), &in_order()).expect("a bag"));
    let two = folder(&[(part(0), "left_0.db3"), (part(1), "right_0.db3")]);
    let text = message(bags::read(two.path(), &in_order()));
    assert!(text.contains("its files are of 2 bags (left, right): read them one by one"), "{text}");
    let none = tempfile::tempdir().expect("a folder");
    let text = message(bags::read(none.path(), &in_order()));
    assert!(text.contains("not a ROS bag, or damaged: a folder without .db3 and"), "{text}");
}

#[test]
fn folders_of_mcap_files() {
    let zstd = fixture("zstd.mcap");
    let one = folder(&[(zstd.clone(), "log_0.mcap"), (bag("several/metadata.yaml"), "notes.txt")]);
    let format = Format::of(one.path()).expect("a bag");
    assert_eq!(format.name, "MCAP");
    let log = mcap::read(one.path(), &McapOptions::default()).expect("a bag");
    assert_eq!(log.len(), 50);
    let two = folder(&[(zstd.clone(), "log_0.mcap"), (zstd, "log_1.mcap")]);
    assert_eq!(Format::of(two.path()).expect("a bag").name, "ROS bag");
    assert_eq!(bags::read(two.path(), &McapOptions::default()).expect("a bag").len(), 100);
}

#[test]
fn files_of_another_kind() {
    let junk: Vec<u8> = (0..=255).cycle().take(5000).collect();
    for content in [&b""[..], b"t,q_1\n0,1\n", b"#ROSBAG V1.2\n", b"#ROSBAG V2.0\n"] {
        for options in [in_order(), recovering()] {
            let text = message(read(content, &options));
            assert!(text.contains("log.bag: not a ROS bag, or damaged: "), "{text}");
        }
    }
    for start in ["#ROSBAG V2.0\n", "SQLite format 3\0"] {
        let text = error([start.as_bytes(), &junk].concat());
        assert!(text.starts_with("log.bag: not a ROS bag, or damaged: "), "{text}");
    }
    let text = message(bags::read(bag("none.bag"), &in_order()));
    assert!(text.contains("No such file"), "{text}");
}

#[cfg(unix)]
#[test]
fn devices_are_not_waited_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.bag");
    std::os::unix::fs::symlink("/dev/zero", &path).expect("a writable folder");
    for result in [bags::read(&path, &in_order()), sgpr_recording::read(&path, None)] {
        let text = message(result);
        assert!(text.contains("this is a pipe or a device, not a file"), "{text}");
    }
    // Also not in place of the description of a bag, or of a file that it lists.
    let zero = folder.path().join("metadata.yaml");
    fs::rename(&path, &zero).expect("a writable folder");
    let text = message(bags::read(folder.path(), &in_order()));
    assert!(text.contains("a folder without"), "{text}");
    fs::rename(&zero, folder.path().join("zero.db3")).expect("a writable folder");
    fs::write(folder.path().join("metadata.yaml"), "relative_file_paths:\n  - zero.db3\n")
        .expect("a writable folder");
    let text = message(bags::read(folder.path(), &in_order()));
    assert!(text.contains("zero.db3: this is a pipe or a device"), "{text}");
}

#[test]
fn a_bag_without_joint_states() {
    let mut content = bytes("plain.bag");
    let pattern = b"sensor_msgs/JointState";
    let places: Vec<usize> = (0..content.len() - pattern.len())
        .filter(|at| content[*at..].starts_with(pattern))
        .collect();
    places.iter().for_each(|at| content[at + 12] = b'X');
    let text = error(&content);
    assert!(text.starts_with("log.bag: no topic with joint states (sensor_msgs/"), "{text}");
    assert!(text.contains("`/joint_states (sensor_msgs/XointState, ros1)`"), "{text}");
    let (_folder, path) = base("UPDATE topics SET type = 'a/msg/B' WHERE name = '/joint_states'");
    let text = message(bags::read(path, &in_order()));
    assert!(text.contains("`/joint_states (a/msg/B, cdr)`"), "{text}");
}

#[test]
fn bags_of_ros1_cut_anywhere() {
    for name in ["plain.bag", "bz2.bag", "lz4.bag"] {
        let whole = bytes(name);
        let mut former = 0;
        for length in (13..whole.len()).step_by(89) {
            let text = error(&whole[..length]);
            assert!(text.contains("incomplete"), "{length}: {text}");
            let samples = read(&whole[..length], &recovering()).map_or(0, |log| log.len());
            assert!(samples >= former, "{name} {length}: {samples} after {former}");
            former = samples;
        }
        assert_eq!(former, 24);
    }
}

/// Where the bytes `pattern` begin.
fn find(bytes: &[u8], pattern: &[u8]) -> usize {
    bytes.windows(pattern.len()).position(|window| window == pattern).expect("there")
}

#[test]
fn a_bag_of_ros1_that_was_never_finished() {
    let mut content = bytes("plain.bag");
    let at = find(&content, b"index_pos=") + 10;
    let index = usize::from_le_bytes(content[at..at + 8].try_into().expect("8 bytes"));
    content.truncate(index);
    content[at..at + 8].fill(0);
    let text = error(&content);
    assert!(text.contains("the file is truncated") && text.contains("54 messages are"), "{text}");
    let log = read(&content, &recovering()).expect("chunks are intact");
    assert_is_whole(&log);
    assert!(log.notes()[0].starts_with("recovered 54 messages"), "{:?}", log.notes());
}

#[test]
fn chunks_of_ros1_that_are_broken() {
    // The first chunk, with the first description of every topic.
    let mut content = bytes("bz2.bag");
    let at = find(&content, b"BZh");
    content[at + 20..at + 60].fill(0xff);
    let text = error(&content);
    assert!(text.contains("not a ROS bag, or damaged: a chunk cannot be unpacked"), "{text}");
    let log = read(&content, &recovering()).expect("the index repeats the topics");
    assert!(log.len() > 8 && log.len() < 24, "{}", log.len());
}

#[test]
fn chunks_of_ros1_that_claim_too_much() {
    let content = bytes("lz4.bag");
    let at = find(&content, b"size=") + 5;
    let claiming = |size: u32| {
        let mut content = content.clone();
        content[at..at + 4].copy_from_slice(&size.to_le_bytes());
        content
    };
    let text = error(claiming(1 << 30));
    assert!(text.contains("a chunk claims 1073741824 bytes and holds"), "{text}");
    let options = in_order().with_limit_bytes(1 << 20);
    let text = message(read(claiming(1 << 30), &options));
    assert!(text.contains("more than 1048576 bytes"), "{text}");
    // A length of a record, and of a field in its header.
    let chunk = find(&content, b"compression=") - 4;
    for (place, length) in [(chunk - 4, u32::MAX), (chunk, u32::MAX), (chunk, 1 << 31)] {
        let mut content = content.clone();
        content[place..place + 4].copy_from_slice(&length.to_le_bytes());
        let text = error(&content);
        assert!(text.contains("not a ROS bag, or damaged: "), "{text}");
    }
}

#[test]
fn an_encrypted_bag() {
    let mut content = bytes("plain.bag");
    let at = find(&content, b"conn_count=");
    content[at..at + 11].copy_from_slice(b"encryptor=x");
    assert!(error(&content).contains("the bag is encrypted (x"), "{}", error(&content));
}

/// A copy of the SQLite fixture after a command.
fn base(command: &str) -> (TempDir, PathBuf) {
    changed_base("sqlite/sqlite.db3", command)
}

fn changed_base(name: &str, command: &str) -> (TempDir, PathBuf) {
    let (folder, path) = file("log.db3", bytes(name));
    let base = Connection::open(&path).expect("a data base");
    base.execute_batch(command).expect("SQL");
    drop(base);
    (folder, path)
}

#[test]
fn data_bases_that_would_never_end() {
    let endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)
                   SELECT 1 AS topic_id, x AS timestamp, x'00010000' AS data FROM c";
    for command in [
        format!("DROP TABLE messages; CREATE VIEW messages AS {endless};"),
        "DROP TABLE messages; CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data BLOB \
         AS (zeroblob(900000000))); INSERT INTO messages(topic_id, timestamp) VALUES (1, 1);"
            .into(),
        "DROP TABLE topics;".into(),
    ] {
        for options in [in_order(), recovering()] {
            let (_folder, path) = base(&command);
            let text = message(bags::read(path, &options));
            assert!(text.contains("without the tables `topics` and `messages`"), "{text}");
        }
    }
}

#[test]
fn messages_that_are_not() {
    for (command, cause) in [
        ("UPDATE messages SET data = 'text' WHERE id = 5", "a message that is no blob"),
        ("UPDATE messages SET timestamp = -1 WHERE id = 5", "a message at the time -1 ns"),
        ("UPDATE messages SET topic_id = 99 WHERE id = 5", "a message on the unknown topic 99"),
        ("UPDATE messages SET data = x'28b52ffd00' WHERE id = 5", "a message cannot be unpacked"),
    ] {
        let (_folder, path) = base(command);
        let text = message(bags::read(&path, &in_order()));
        assert!(text.contains("log.db3: not a ROS bag, or damaged: "), "{text}");
        assert!(text.contains(cause) && text.contains("; set `recover`"), "{text}");
        let log = bags::read(&path, &recovering()).expect("the others are intact");
        assert_eq!(log.len(), 23, "{cause}");
    }
    let (_folder, path) = base("UPDATE messages SET data = x'00010000ffffff' WHERE id = 5");
    let text = message(bags::read(&path, &in_order()));
    assert!(text.contains("topic `/joint_states`, message "), "{text}");
    assert_eq!(bags::read(&path, &recovering()).expect("the others are intact").len(), 23);
}

#[test]
fn a_bomb_of_a_few_kilobytes() {
    let zeros = zstd::encode_all(std::io::repeat(0).take(200 << 20), 19).expect("packed");
    assert!(zeros.len() < 50_000, "{}", zeros.len());
    let (_folder, path) = base("DELETE FROM messages WHERE id > 1");
    let base = Connection::open(&path).expect("a data base");
    base.execute("UPDATE messages SET data = ?1", [&zeros]).expect("SQL");
    drop(base);
    let options = in_order().with_limit_bytes(1 << 20);
    for content in [fs::read(&path).expect("written"), zeros] {
        let (_folder, path) = file("log.db3.zstd", content);
        let text = message(bags::read(&path, &options));
        assert!(text.contains("more than 1048576 bytes"), "{text}");
    }
}

#[test]
fn a_recorder_that_was_stopped_before_sqlite_had_written() {
    let (folder, path) = file("log.db3", bytes("sqlite/sqlite.db3"));
    let base = Connection::open(&path).expect("a data base");
    base.execute_batch(
        "PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0;
         INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data
         FROM messages WHERE id = 1;",
    )
    .expect("SQL");
    let other = folder.path().join("stopped.db3");
    fs::copy(&path, &other).expect("a writable folder");
    fs::copy(folder.path().join("log.db3-wal"), folder.path().join("stopped.db3-wal"))
        .expect("a journal");
    let text = message(bags::read(&other, &in_order()));
    let advice = format!("messages may still be in {}-wal: `sqlite3", other.display());
    assert!(text.contains(&advice), "{text}");
    let log = bags::read(&other, &recovering()).expect("without the message in the journal");
    assert_is_whole(&log);
    assert!(log.notes()[0].contains("the recorder was stopped"), "{:?}", log.notes());
    // What the advice does.
    let base = Connection::open(&other).expect("a data base");
    base.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get::<_, i64>(0))
        .expect("SQL");
    drop(base);
    assert_eq!(bags::read(&other, &in_order()).expect("all messages").len(), 25);
}

#[test]
fn nothing_is_written_beside_a_bag() {
    let (folder, path) = file("log 1?#%.db3", bytes("sqlite/sqlite.db3"));
    assert_is_whole(&bags::read(&path, &in_order()).expect("a bag"));
    let doubled = PathBuf::from(format!("/{}", path.display()));
    assert_is_whole(&bags::read(doubled, &in_order()).expect("a bag"));
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
}

#[test]
fn broken_parts_of_a_bag() {
    let folder = folder(&[(bag("several").join("several_0.db3"), "log_0.db3")]);
    fs::write(folder.path().join("log_1.db3"), "").expect("a writable folder");
    let text = message(bags::read(folder.path(), &in_order()));
    assert!(text.contains("log_1.db3: not a ROS bag, or damaged: "), "{text}");
    let log = bags::read(folder.path(), &recovering()).expect("one part is intact");
    assert_eq!(log.len(), 12);
}
