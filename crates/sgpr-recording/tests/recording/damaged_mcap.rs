//! MCAP files that end early, lie about themselves or are none.

use std::path::Path;

use sgpr_recording::mcap::{self, McapOptions};
use sgpr_recording::{Recording, RecordingError};

use super::{file, fixture, message};

fn recovering() -> McapOptions {
    McapOptions::default().with_recover(true)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(fixture(name)).expect("a fixture")
}

fn read(content: impl AsRef<[u8]>, options: &McapOptions) -> Result<Recording, RecordingError> {
    let (_folder, path) = file("log.mcap", content);
    mcap::read(path, options)
}

fn error(content: impl AsRef<[u8]>) -> String {
    let text = message(read(content, &McapOptions::default()));
    text[text.find("log.mcap").expect("the file is named")..].to_string()
}

/// Where the bytes `pattern` begin.
fn find(bytes: &[u8], pattern: &[u8]) -> usize {
    bytes.windows(pattern.len()).position(|window| window == pattern).expect("there")
}

#[test]
fn a_recorder_that_was_switched_off() {
    for name in ["truncated_zstd.mcap", "truncated_lz4.mcap", "truncated_uncompressed.mcap"] {
        let whole = mcap::read(fixture(&name["truncated_".len()..]), &McapOptions::default())
            .expect("whole");
        let log = mcap::read(fixture(name), &recovering()).expect("partly readable");
        assert!(log.len() > 25, "{name}: {}", log.len());
        assert_eq!(log.position(), whole.slice(0..log.len()).position());
        let text = message(mcap::read(fixture(name), &McapOptions::default()));
        assert!(text.contains("the file is truncated: what begins at byte "), "{text}");
        assert!(
            text.contains(&format!("{} messages are readable: set `recover`", log.len())),
            "{text}"
        );
        assert!(log.notes()[0].starts_with("recovered "), "{}", log.notes()[0]);
    }
}

#[test]
fn cut_anywhere() {
    let whole = bytes("uncompressed.mcap");
    let mut former = 0;
    for length in (8..whole.len()).step_by(97) {
        let text = error(&whole[..length]);
        assert!(text.contains("truncated"), "{length}: {text}");
        let samples = read(&whole[..length], &recovering()).map_or(0, |log| log.len());
        assert!(samples >= former, "{length}: {samples} after {former}");
        former = samples;
    }
    assert_eq!(former, 50);
    assert_eq!(
        error(&whole[..5]),
        "log.mcap: the file is truncated: what begins at byte 0 is incomplete; 0 messages are \
         readable: set `recover` to take them"
    );
    assert_eq!(error(""), "log.mcap: the file is empty");
}

#[test]
fn a_wrong_bit_in_a_chunk() {
    let mut content = bytes("uncompressed.mcap");
    // In the number of the first message.
    let at = find(&content, b"shoulder") + 60;
    content[at] ^= 0x10;
    let text = error(&content);
    assert!(
        text.starts_with("log.mcap: damaged at byte ") && text.contains("checksum of the chunk"),
        "{text}"
    );
    let log = read(&content, &recovering()).expect("the other chunks are intact");
    assert!(log.len() >= 40 && log.len() < 50, "{}", log.len());
}

#[test]
fn a_wrong_bit_in_a_file_without_chunks() {
    let mut content = bytes("big_endian.mcap");
    let at = find(&content, b"shoulder") + 61;
    content[at] ^= 0x10;
    let text = error(&content);
    assert!(text.contains("checksum of the data"), "{text}");
    assert_eq!(read(&content, &recovering()).expect("messages are there").len(), 10);
}

#[test]
fn packed_data_that_are_broken() {
    let mut content = bytes("zstd.mcap");
    let at = find(&content, b"\x28\xb5\x2f\xfd");
    content[at + 12..at + 60].fill(0xff);
    let text = error(&content);
    assert!(text.contains("damaged at byte"), "{text}");
    assert!(read(&content, &recovering()).expect("the other chunks are intact").len() >= 40);
}

#[test]
fn chunks_that_claim_too_much() {
    // The unpacked size of the first chunk.
    let mut content = bytes("zstd.mcap");
    let at = find(&content, b"zstd") - 4 - 4 - 8;
    content[at..at + 8].copy_from_slice(&(1u64 << 40).to_le_bytes());
    assert!(error(&content).starts_with("log.mcap: more than 4294967296 bytes of unpacked data"));
    content[at..at + 8].copy_from_slice(&(1u64 << 30).to_le_bytes());
    assert!(error(&content).contains("a chunk claims 1073741824 bytes and holds"));
    // The packed size.
    let mut content = bytes("zstd.mcap");
    let at = find(&content, b"zstd") + 4;
    content[at..at + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(error(&content).contains("a chunk claims 18446744073709551615 packed bytes"));
}

#[test]
fn an_unknown_compression() {
    let mut content = bytes("zstd.mcap");
    let at = find(&content, b"zstd");
    content[at..at + 4].copy_from_slice(b"zzzz");
    assert!(error(&content).contains("the compression `zzzz` is not supported"));
}

#[test]
fn a_message_that_breaks_its_schema() {
    // A length in the first message, in a file without checksums of chunks.
    let mut content = bytes("big_endian.mcap");
    let at = find(&content, b"shoulder") - 4;
    content[at..at + 4].copy_from_slice(&0x7fff_ffff_u32.to_be_bytes());
    assert_eq!(
        error(&content),
        "log.mcap: topic `/joint_states`, message 1: a length of 2147483647 at byte 24, but only \
         132 bytes follow"
    );
    let log = read(&content, &recovering()).expect("the other messages are intact");
    assert_eq!(log.len(), 9);
    assert!(
        log.notes().iter().any(|note| note == "`/joint_states`: left out 1 broken messages of 10")
    );
}

#[test]
fn files_of_another_kind() {
    for (start, kind, advice) in [
        ("SQLite format 3\0", "an SQLite bag of ROS 2", "ends in .db3"),
        ("#ROSBAG V2.0\n", "a ROS 1 bag", "ends in .bag"),
        ("t,q1\n0,1\n", "a file of another kind", "89 4d 43 41 50"),
    ] {
        let text = error(start);
        assert!(
            text.starts_with(&format!("log.mcap: this is {kind}, not MCAP"))
                && text.contains(advice),
            "{text}"
        );
    }
    assert!(
        message(mcap::read(Path::new("no/such.mcap"), &McapOptions::default()))
            .contains("No such file")
    );
}

#[test]
fn no_joint_states() {
    // The only topic turns into something else.
    let mut content = bytes("big_endian.mcap");
    let at = find(&content, b"sensor_msgs/msg/JointState");
    content[at + 16] = b'X';
    let text = error(&content);
    assert!(text.contains("no topic with joint states") || text.contains("checksum"), "{text}");
    let text = message(read(&content, &recovering()));
    assert!(
        text.contains("the topics are `/joint_states (sensor_msgs/msg/XointState, cdr)`"),
        "{text}"
    );
}

#[test]
fn limits_hold_for_messages_too() {
    let options = McapOptions::default().with_limit_bytes(3000);
    let text = message(read(bytes("uncompressed.mcap"), &options));
    assert!(text.contains("more than 3000 bytes"), "{text}");
}
