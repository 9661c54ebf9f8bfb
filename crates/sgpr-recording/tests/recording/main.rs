//! Reading, checking, repairing and writing logs.

#[cfg(any(feature = "numpy", feature = "hdf5"))]
mod arrays;
#[cfg(feature = "bags")]
mod bags;
mod columns;
mod csv_files;
mod damaged_mcap;
mod formats;
mod inspection;
mod mcap_files;
#[cfg(feature = "parquet")]
mod parquet_files;
mod real_logs;
mod repairs;

use std::path::{Path, PathBuf};

use sgpr_recording::csv::{self, ReadOptions};
use sgpr_recording::{Recording, RecordingError};
use tempfile::TempDir;

/// A folder with one file.
fn file(name: &str, content: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a writable folder for temporary files");
    let path = folder.path().join(name);
    std::fs::write(&path, content).expect("a writable folder");
    (folder, path)
}

fn read_csv_with(
    text: impl AsRef<[u8]>,
    options: &ReadOptions,
) -> Result<Recording, RecordingError> {
    let (_folder, path) = file("log.csv", text);
    csv::read(path, options)
}

fn read_csv(text: impl AsRef<[u8]>) -> Recording {
    read_csv_with(text, &ReadOptions::default()).expect("a readable log")
}

/// The message of an error, with the folder of the file cut away.
fn message<T>(result: Result<T, RecordingError>) -> String {
    let text = result.err().expect("an error").to_string();
    match text.find("log.csv") {
        Some(at) => text[at..].to_string(),
        None => text,
    }
}

fn csv_error(text: impl AsRef<[u8]>) -> String {
    message(read_csv_with(text, &ReadOptions::default()))
}

/// A file of `data/recording`.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/recording").join(name)
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| name.to_string()).collect()
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (index, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "value {index}: {a}, expected {b}");
    }
}
