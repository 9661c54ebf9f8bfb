//! What several test files share: the reference robots of `data/reference`.
#![allow(dead_code, missing_docs, unused_imports)]

mod difference;
pub mod outside;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

pub use difference::largest_difference;
use sgpr_core::recording::{Recording, csv};
use sgpr_core::robot::{DhConvention, DhRow, Robot, UrdfOptions};
use sgpr_core::spatial::Vector3;

pub const ROBOTS: [&str; 8] = [
    "two_link",
    "puma560",
    "puma560_thesis_com4",
    "stanford_like",
    "panda_like",
    "ur5e_like",
    "scara",
    "gripper_tree",
];

pub fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data").join(path)
}

/// Robot, training logs and test log of a case with a hidden effect; none, with a word about it,
/// where the folder is not.
pub fn hidden_case(name: &str) -> Option<(Robot, [Recording; 3], [Recording; 1])> {
    let folder = outside::outside(&format!("hidden_effects/{name}"))?;
    let robot =
        Robot::from_urdf(folder.join("robot.urdf"), &UrdfOptions::default()).expect("a robot");
    let read = |name: &str| {
        csv::read(folder.join(format!("{name}.csv")), &Default::default()).expect("a log")
    };
    Some((robot, ["train_1", "train_2", "train_3"].map(read), [read("test")]))
}

/// Values computed by Pinocchio, MuJoCo and the robotics toolbox (`data/reference/README.md`).
pub struct Reference {
    pub info: serde_json::Value,
    arrays: HashMap<String, Vec<f64>>,
}

impl Reference {
    pub fn load(name: &str) -> Self {
        let text =
            std::fs::read_to_string(data(&format!("reference/{name}.json"))).expect("bundled file");
        let mut archive = npyz::npz::NpzArchive::open(data(&format!("reference/{name}.npz")))
            .expect("bundled file");
        let names: Vec<String> = archive.array_names().map(String::from).collect();
        let arrays = names.into_iter().map(|name| {
            let array = archive.by_name(&name).expect("readable").expect("listed");
            (name, row_major(array))
        });
        let arrays = arrays.collect();
        Self { info: serde_json::from_str(&text).expect("valid JSON"), arrays }
    }

    pub fn array(&self, name: &str) -> &[f64] {
        &self.arrays[name]
    }

    pub fn numbers(&self, key: &str) -> Vec<f64> {
        serde_json::from_value(self.info[key].clone()).expect("a list of numbers")
    }

    pub fn max_abs_tau(&self) -> f64 {
        self.info["max_abs_tau"].as_f64().expect("a number")
    }

    pub fn gravity(&self) -> Vector3<f64> {
        let g = self.numbers("gravity");
        Vector3::new(g[0], g[1], g[2])
    }

    pub fn joint_names(&self) -> Vec<String> {
        serde_json::from_value(self.info["joint_names"].clone()).expect("names")
    }

    pub fn by_urdf(&self) -> Robot {
        let file = self.info["urdf"].as_str().expect("a file name");
        let options = UrdfOptions::default()
            .with_joints(Some(self.joint_names()))
            .with_gravity(self.gravity());
        Robot::from_urdf(data(&format!("reference/urdf/{file}")), &options).expect("a valid robot")
    }

    /// The DH table with convention and rows, for robots that have one with inertias.
    pub fn dh_rows(&self) -> Option<Vec<DhRow>> {
        let dh = self.info.get("dh")?;
        let column =
            |key: &str| -> Vec<f64> { serde_json::from_value(dh[key].clone()).expect("a column") };
        let (a, alpha, d, theta) = (column("a"), column("alpha"), column("d"), column("theta"));
        let (sigma, mass) = (column("sigma"), column("mass"));
        let com: Vec<[f64; 3]> = serde_json::from_value(dh["com"].clone()).expect("points");
        let inertia: Vec<[[f64; 3]; 3]> =
            serde_json::from_value(dh["inertia_com"].clone()).expect("matrices");
        let row = |i: usize| {
            let row = DhRow::revolute(a[i], alpha[i], d[i], theta[i])
                .with_body(mass[i], com[i], inertia[i]);
            row.with_prismatic(sigma[i] == 1.0)
        };
        Some((0..a.len()).map(row).collect())
    }

    pub fn by_dh(&self) -> Option<Robot> {
        let names = self.joint_names();
        let rows = self.dh_rows()?;
        Some(
            Robot::from_dh("dh", DhConvention::Standard, &rows, Some(&names), self.gravity())
                .expect("a valid table"),
        )
    }

    /// The robot by every path that leads to it.
    pub fn robots(&self) -> Vec<(&'static str, Robot)> {
        let mut robots = vec![("urdf", self.by_urdf())];
        robots.extend(self.by_dh().map(|robot| ("dh", robot)));
        robots
    }
}

/// numpy writes a transposed matrix as it lies in memory, column by column.
fn row_major(array: npyz::NpyFile<impl std::io::Read>) -> Vec<f64> {
    let shape: Vec<usize> = array.shape().iter().map(|&length| length as usize).collect();
    let by_columns = array.order() == npyz::Order::Fortran;
    let values = array.into_vec::<f64>().expect("numbers");
    match (by_columns, &shape[..]) {
        (true, &[rows, columns]) => {
            (0..rows * columns).map(|k| values[k % columns * rows + k / columns]).collect()
        }
        _ => values,
    }
}
