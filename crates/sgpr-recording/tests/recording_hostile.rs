//! Readers against bytes from anywhere: they must neither panic nor take more memory than stated.
//!
//! Alone in its program because the whole program runs under a memory limit.

use std::alloc::System;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cap::Cap;
use proptest::prelude::*;
use sgpr_recording::csv::ReadOptions;
use sgpr_recording::mcap::McapOptions;
use sgpr_recording::{
    FORMATS, Format, Reader, Recording, RecordingError, Repair, Resample, inspect, repair,
};

/// What a reader may take for itself, beyond some multiple of the file.
const LIMIT: u64 = 1 << 20;
/// What it takes at most: the numbers, the text or chunk they come from, and the room that vectors
/// grow into.
const MOST: usize = 16 << 20;
/// What the program may take, so that a panic still finds the memory for its backtrace.
const ROOM: usize = 1 << 30;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, ROOM);
/// One reader at a time, so that its memory can be told from that of others.
static ALONE: Mutex<()> = Mutex::new(());

/// Crates that read Parquet and HDF5 panic on some damaged files, which ends in an error of ours: no
/// message, and no backtrace, which takes more memory than a reader may.
fn hush() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            let place = panic.location().map_or("", |place| place.file());
            if !["/parquet-", "/arrow-", "/hdf5-reader-"].iter().any(|name| place.contains(name)) {
                usual(panic);
            }
        }));
    });
}

/// Reads, inspects and repairs in the memory that a reader takes at most.
fn attempt(name: &str, content: &[u8]) {
    hush();
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a writable folder for temporary files");
    let path = folder.path().join(name);
    std::fs::File::create(&path)
        .and_then(|mut file| file.write_all(content))
        .expect("a writable folder");
    let (before, most) = (MEMORY.allocated(), MEMORY.max_allocated());
    for recording in read_all(&path).into_iter().flatten() {
        use_recording(&recording);
    }
    let now = MEMORY.max_allocated();
    assert!(now <= most.max(before + MOST), "{name} takes {} bytes", now - before);
}

/// With the reader that a user gets, strict and lenient.
fn read_all(path: &Path) -> Vec<Result<Recording, RecordingError>> {
    match Format::of(path).expect("told by the name").read {
        Reader::Table(read) => {
            let joints = Some(vec!["joint_1".into(), "joint_2".into()]);
            let automatic = ReadOptions::default().with_limit_bytes(LIMIT);
            vec![read(path, &automatic), read(path, &automatic.with_joints(joints))]
        }
        Reader::Topics(read) => {
            let strict = McapOptions::default().with_limit_bytes(LIMIT);
            let lenient = strict.clone().with_recover(true);
            vec![read(path, &strict), read(path, &lenient)]
        }
    }
}

fn use_recording(recording: &Recording) {
    inspect(recording);
    let request = Repair::default()
        .with_sort(true)
        .with_drop_duplicates(true)
        .with_drop_not_finite(true)
        .with_replace_strays(true)
        .with_drop_repeated(true)
        .with_resample(Some(Resample::MedianRate));
    let _ = repair(recording, &request);
}

fn fixture(name: &str) -> Vec<u8> {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/recording");
    std::fs::read(folder.join(name)).expect("a fixture")
}

const FIXTURES: [&str; 8] = [
    "zstd.mcap",
    "lz4.mcap",
    "uncompressed.mcap",
    "extras.mcap",
    "two_topics.mcap",
    "json.mcap",
    "flat_json.mcap",
    "big_endian.mcap",
];

#[cfg(feature = "parquet")]
const PARQUET: [&str; 4] = [
    "parquet/kinds.parquet",
    "parquet/times.parquet",
    "parquet/lists.parquet",
    "parquet/lerobot/data/chunk-000/file-000.parquet",
];

#[cfg(feature = "bags")]
const BAGS: [&str; 6] = [
    "bags/plain.bag",
    "bags/bz2.bag",
    "bags/lz4.bag",
    "bags/sqlite/sqlite.db3",
    "bags/packed_messages/packed_messages.db3",
    "bags/packed_file/packed_file.db3.zstd",
];

/// Files of `arrays/`, of the formats that are built.
const ARRAYS: &[&str] = &[
    #[cfg(feature = "numpy")]
    "stored.npz",
    #[cfg(feature = "numpy")]
    "packed.npz",
    #[cfg(feature = "numpy")]
    "fortran.npz",
    #[cfg(feature = "numpy")]
    "narrow.npz",
    #[cfg(feature = "matlab")]
    "version_4.mat",
    #[cfg(feature = "matlab")]
    "plain.mat",
    #[cfg(feature = "matlab")]
    "packed.mat",
    #[cfg(feature = "matlab")]
    "structure.mat",
    #[cfg(feature = "matlab")]
    "big_endian.mat",
    #[cfg(feature = "matlab")]
    "version_7_3.mat",
    #[cfg(feature = "hdf5")]
    "earliest.h5",
    #[cfg(feature = "hdf5")]
    "latest.h5",
    #[cfg(feature = "hdf5")]
    "packed.h5",
    #[cfg(feature = "hdf5")]
    "lzf.h5",
    #[cfg(feature = "hdf5")]
    "narrow.h5",
    #[cfg(feature = "hdf5")]
    "units.h5",
];

fn table() -> Vec<u8> {
    let rows = (0..40).map(|k| format!("{}.{k:03},{k},{},idle,{k},0.{k}\n", k / 10, k * k));
    rows.fold("t,q_1,q_2,mode,dq_1,dq_2\n".to_string(), |text, row| text + &row).into_bytes()
}

/// A place, as a share of the length, and what happens there.
fn any_change() -> impl Strategy<Value = (f64, u8, u8)> {
    (0.0..1.0, 0u8..4, any::<u8>())
}

fn change(content: &mut Vec<u8>, changes: &[(f64, u8, u8)]) {
    for &(place, action, byte) in changes {
        let at = (place * content.len() as f64) as usize;
        match action {
            _ if content.is_empty() => {}
            0 => content[at] ^= 1 << (byte % 8),
            1 => content[at] = byte,
            2 => content.truncate(at),
            _ => {
                let end = (at + byte as usize).min(content.len());
                content[at..end].fill(0xff);
            }
        }
    }
}

/// As many files of each kind as `SGPR_FUZZ_CASES` says; `make fuzz` says many.
fn cases() -> ProptestConfig {
    let cases = std::env::var("SGPR_FUZZ_CASES").ok().and_then(|text| text.parse().ok());
    ProptestConfig::with_cases(cases.unwrap_or(400))
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn any_bytes(content in proptest::collection::vec(any::<u8>(), 0..2000), start in 0usize..11) {
        let starts: [&[u8]; 11] = [
            b"", b"\x89MCAP0\r\n", b"\x1f\x8b\x08", b"t,q_1\n", b"\x89MCAP0\r\n\x06", b"#ROSBAG V2.0\n",
            b"SQLite format 3\0", b"\x28\xb5\x2f\xfd", b"PK\x03\x04", b"PAR1",
            b"\x89HDF\r\n\x1a\n",
        ];
        let content = [starts[start], &content].concat();
        for ending in FORMATS.iter().flat_map(|format| format.endings) {
            attempt(&format!("log{ending}"), &content);
        }
    }

    #[test]
    fn any_text(text in "[tq12_,;. \n\"#eE+-]{0,300}") {
        attempt("log.csv", text.as_bytes());
    }

    #[test]
    fn changed_tables(changes in proptest::collection::vec(any_change(), 1..4)) {
        let mut content = table();
        change(&mut content, &changes);
        attempt("log.csv", &content);
    }

    #[test]
    #[cfg(feature = "parquet")]
    fn changed_parquet_files(name in 0..PARQUET.len(), changes in proptest::collection::vec(any_change(), 1..4)) {
        let mut content = fixture(PARQUET[name]);
        change(&mut content, &changes);
        attempt("log.parquet", &content);
    }

    #[test]
    fn changed_mcap_files(name in 0..FIXTURES.len(), changes in proptest::collection::vec(any_change(), 1..4)) {
        let mut content = fixture(FIXTURES[name]);
        change(&mut content, &changes);
        attempt("log.mcap", &content);
    }

    #[test]
    fn changed_arrays(place in any::<prop::sample::Index>(), changes in proptest::collection::vec(any_change(), 1..4)) {
        if let Some(name) = (!ARRAYS.is_empty()).then(|| ARRAYS[place.index(ARRAYS.len())]) {
            let mut content = fixture(&format!("arrays/{name}"));
            change(&mut content, &changes);
            attempt(name, &content);
        }
    }
}

/// Two million numbers in less than a kilobyte, and with each of its bits changed.
#[test]
#[cfg(feature = "parquet")]
fn lists_of_equal_numbers() {
    let content = fixture("parquet/many.parquet");
    attempt("log.parquet", &content);
    for bit in 0..8 * content.len() {
        let mut changed = content.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        attempt("log.parquet", &changed);
    }
}

#[cfg(feature = "bags")]
proptest! {
    #![proptest_config(cases())]

    #[test]
    fn changed_bags(name in 0..BAGS.len(), changes in proptest::collection::vec(any_change(), 1..4)) {
        let mut content = fixture(BAGS[name]);
        change(&mut content, &changes);
        attempt("log.bag", &content);
    }

    /// What is packed is changed before it is packed: the checksum of the packing hides nothing.
    #[test]
    fn changed_parts_of_bags(name in 0..2usize, changes in proptest::collection::vec(any_change(), 1..4)) {
        let mut content = fixture(["bags/plain.bag", "bags/sqlite/sqlite.db3"][name]);
        change(&mut content, &changes);
        let packed = zstd::encode_all(&content[..], 1).expect("packed");
        attempt("log.bag", &packed);
    }
}

#[test]
fn numbers_at_their_limits() {
    for row in ["9223372036,1", "-9223372036,1e308", "1e-300,-1e308", "0,inf"] {
        let text = format!("t,q_1,dq_1\n0,0,1\n{row},5\n1,1,-1e308\n");
        attempt("log.csv", text.as_bytes());
        attempt("log.csv", format!("{text}{}", "2,1,1\n3,1,1\n".repeat(30)).as_bytes());
    }
}

#[test]
fn wide_and_long_tables() {
    let wide: Vec<String> = (1..=9000).map(|joint| format!("q{joint}")).collect();
    attempt("log.csv", format!("t,{}\n0{}\n", wide.join(","), ",1".repeat(9000)).as_bytes());
    attempt("log.csv", format!("t,{}\n0,1\n", "q ".repeat(200_000)).as_bytes());
    attempt("log.csv", ("t,q1\n".to_string() + &"0,\n".repeat(1 << 20)).as_bytes());
}
