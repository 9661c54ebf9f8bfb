//! Logs of real arms, which are not part of the repository.

use std::path::{Path, PathBuf};

use sgpr_core::recording::csv::{self, ReadOptions, Rows};
use sgpr_core::recording::{IssueKind, Recording, Repair, repair};
use sgpr_core::robot::{Robot, UrdfOptions};

#[path = "outside.rs"]
mod outside;

pub use outside::outside;

/// The folder of a robot, if the logs are there.
pub fn folder(name: &str) -> Option<PathBuf> {
    outside(&format!("real/{name}"))
}

/// Robot and logs as `dataset.json` describes them: which are for training and which for tests,
/// useful rows, and torque constants where a log has motor currents.
pub struct Case {
    pub robot: Robot,
    pub train: Vec<Recording>,
    pub test: Vec<Recording>,
}

impl Case {
    /// `request` makes the logs uniform.
    pub fn read(folder: &Path, request: &Repair) -> Self {
        let text = std::fs::read_to_string(folder.join("dataset.json")).expect("a description");
        let description: serde_json::Value = serde_json::from_str(&text).expect("valid JSON");
        let urdf = folder.join(description["urdf"].as_str().expect("a file"));
        let robot = Robot::from_urdf(urdf, &UrdfOptions::default()).expect("a valid robot");
        let logs = |role: &str| -> Vec<Recording> {
            let files = description["files"].as_object().expect("files").iter();
            let wanted = files
                .filter(|(_, details)| details["role"].as_str().expect("a role").starts_with(role));
            let read = |(file, details): (&String, &serde_json::Value)| {
                let rows: Option<[usize; 2]> =
                    serde_json::from_value(details["rows_1based"].clone()).expect("rows");
                let options = ReadOptions::default()
                    .with_joints(Some(robot.joint_names().map(String::from).collect()))
                    .with_accept(vec![IssueKind::JointsByOrder])
                    .with_rows(rows.map(|[first, last]| Rows::Numbers(first..=last)))
                    .with_torque_constants(
                        serde_json::from_value(description["drive_gain_Nm_per_A"].clone())
                            .expect("gains"),
                    );
                let log = csv::read(folder.join(file), &options).expect("a readable log");
                repair(&log, request).expect("time increases").0
            };
            wanted.flat_map(read).collect()
        };
        Self { train: logs("train"), test: logs("test"), robot }
    }
}
