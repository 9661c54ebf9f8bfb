//! Reads logs (CSV or MCAP), tells what is in them and what is wrong with them:
//!
//! `cargo run --example read_log -- LOG...`

use std::path::Path;
use std::process::ExitCode;

use sgpr_core::recording::{Recording, RecordingError, csv, inspect, mcap};

fn main() -> ExitCode {
    let mut code = ExitCode::SUCCESS;
    for path in std::env::args().skip(1) {
        match read(Path::new(&path)) {
            Ok(recording) => describe(&recording),
            Err(error) => {
                eprintln!("{error}");
                code = ExitCode::FAILURE;
            }
        }
    }
    code
}

fn read(path: &Path) -> Result<Recording, RecordingError> {
    if path.extension().is_some_and(|extension| extension == "mcap") {
        mcap::read(path, &mcap::McapOptions::default())
    } else {
        csv::read(path, &csv::ReadOptions::default())
    }
}

fn describe(recording: &Recording) {
    let rate =
        recording.sample_rate_hz().map_or("unknown rate".into(), |rate| format!("{rate:.2} Hz"));
    println!(
        "{}: {} samples in {:.3} s, {rate}",
        recording.source(),
        recording.len(),
        recording.duration()
    );
    println!("  joints: {}", recording.joint_names().join(", "));
    let logged = |present: bool| if present { "logged" } else { "not logged" };
    println!(
        "  velocity {}, torque {}",
        logged(recording.velocity().is_some()),
        logged(recording.torque().is_some())
    );
    let channels: Vec<&str> =
        recording.channels().iter().map(|channel| channel.name.as_str()).collect();
    if !channels.is_empty() {
        println!("  channels: {}", channels.join(", "));
    }
    for note in recording.notes() {
        println!("  read: {note}");
    }
    for issue in inspect(recording) {
        println!("  {:?}: {}", issue.severity, issue.message);
    }
}
