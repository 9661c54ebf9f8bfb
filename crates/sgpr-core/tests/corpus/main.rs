//! The files that the fuzzer kept (`fuzz/corpus`), through the readers that it tried them on:
//! whatever is in them, a result or an error, no panic, within the memory of this program and
//! within seconds.
#![allow(missing_docs)]

mod attempts;
#[path = "../common/memory.rs"]
mod memory;

use std::path::Path;
use std::time::{Duration, Instant};

use memory::Limited;

/// What the whole program may take; beyond it the program is aborted.
const MOST: usize = 1 << 30;
/// What one file may take.
const LONGEST: Duration = Duration::from_secs(10);

#[global_allocator]
static MEMORY: Limited = Limited::new(MOST);

fn replay(target: &str, attempt: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let files: Vec<_> = std::fs::read_dir(folder)
        .expect("a corpus")
        .map(|file| file.expect("a file").path())
        .collect();
    assert!(files.len() >= 4, "{target}: {} files", files.len());
    for file in files {
        let start = Instant::now();
        attempt(&std::fs::read(&file).expect("readable"));
        assert!(start.elapsed() < LONGEST, "{}: {:?}", file.display(), start.elapsed());
    }
}

#[test]
fn robot_files() {
    replay("urdf", attempts::urdf);
}

#[test]
fn tables_of_robots() {
    replay("dh", attempts::dh);
}

#[test]
fn tables_of_logs() {
    replay("csv", attempts::csv);
}

#[test]
fn mcap_files() {
    replay("mcap", attempts::mcap);
}

#[test]
fn model_files() {
    replay("model", attempts::model);
}

#[test]
fn semi_parametric_files() {
    replay("semi_parametric", attempts::semi_parametric);
}
