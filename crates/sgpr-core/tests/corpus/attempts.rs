//! Bytes of strangers through each reader, and through what is done first with what was read. The
//! fuzzer calls these with bytes of its own (`fuzz/`), the test with those that it kept.
#![allow(dead_code)]

use std::fs::File;
use std::io::{Seek, Write};
use std::path::PathBuf;
use std::sync::{LazyLock, Mutex};

use sgpr_core::dynamics::{Samples, Workspace, mass_matrix, rnea};
use sgpr_core::model::{SemiParametricModel, TorqueModel, Trajectory};
use sgpr_core::recording::csv::{self, ReadOptions};
use sgpr_core::recording::mcap::{self, McapOptions};
use sgpr_core::recording::{IssueKind, Recording, Repair, Resample, inspect, repair};
use sgpr_core::robot::{DhConvention, DhRow, Robot, UrdfOptions};
use sgpr_core::spatial::Vector3;

/// What a reader may take, bytes.
const LIMIT: u64 = 1 << 20;

/// A robot file.
pub fn urdf(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(robot) = Robot::from_urdf_text(text, "robot.urdf", &UrdfOptions::default()) {
        move_it(&robot);
    }
}

/// A table of Denavit-Hartenberg parameters: twelve numbers for each row, and a flag.
pub fn dh(bytes: &[u8]) {
    let Some((first, rest)) = bytes.split_first() else { return };
    let numbers: Vec<f64> = rest
        .chunks_exact(8)
        .map(|chunk| f64::from_le_bytes(chunk.try_into().expect("eight bytes")))
        .collect();
    let rows: Vec<DhRow> = numbers.chunks_exact(14).take(8).map(row).collect();
    let convention = if first & 1 == 0 { DhConvention::Standard } else { DhConvention::Modified };
    let names: Vec<String> =
        (0..rows.len()).map(|k| format!("j{}", k % (1 + *first as usize))).collect();
    let names = (first & 2 == 0).then_some(&names[..]);
    if let Ok(robot) =
        Robot::from_dh("arm", convention, &rows, names, Vector3::new(0.0, 0.0, -9.81))
    {
        move_it(&robot);
    }
}

fn row(numbers: &[f64]) -> DhRow {
    let [a, alpha, d, theta, mass, x, y, z, xx, yy, zz, xy, xz, yz] =
        numbers.try_into().expect("fourteen");
    let inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let of_kind = if theta.to_bits() & 1 == 0 { DhRow::revolute } else { DhRow::prismatic };
    of_kind(a, alpha, d, theta).with_body(mass, [x, y, z], inertia)
}

/// A log as a table.
pub fn csv(bytes: &[u8]) {
    let path = on_disk(bytes);
    let any = ReadOptions::default().with_limit_bytes(LIMIT);
    let joints = Some(vec!["shoulder".into(), "joint_2".into()]);
    let accept = vec![IssueKind::JointsByOrder];
    let of_robot = any
        .clone()
        .with_joints(joints)
        .with_accept(accept)
        .with_torque_constants(Some(vec![2.0, 3.0]));
    for options in [any, of_robot] {
        if let Ok(recording) = csv::read(&path, &options) {
            look_at(&recording);
        }
    }
}

/// A log in MCAP.
pub fn mcap(bytes: &[u8]) {
    let path = on_disk(bytes);
    for recover in [false, true] {
        if let Ok(recording) =
            mcap::read(&path, &McapOptions::default().with_limit_bytes(LIMIT).with_recover(recover))
        {
            look_at(&recording);
        }
    }
}

/// A model file.
pub fn model(bytes: &[u8]) {
    if let Ok(model) = TorqueModel::from_bytes(&framed(bytes), "model.sgpr") {
        predict(&model);
    }
}

/// A model file with a process.
pub fn semi_parametric(bytes: &[u8]) {
    if let Ok(model) = SemiParametricModel::from_bytes(&framed(bytes), "model.sgpr") {
        predict(model.physics());
        let n = model.physics().robot().dof();
        let (q, dq, ddq) = (vec![0.3; 2 * n], vec![-0.2; 2 * n], vec![0.5; 2 * n]);
        let _ = model.predict(Samples { q: &q, dq: &dq, ddq: &ddq }, true);
    }
}

/// A model file begins with the length of its head: where bytes begin with the head itself, up to
/// the first zero, the length is put before it, so that a change of the text reaches the reader of
/// the text.
fn framed(bytes: &[u8]) -> Vec<u8> {
    if !bytes.starts_with(b"{") {
        return bytes.to_vec();
    }
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let arrays = bytes.get(end + 1..).unwrap_or_default();
    [&(end as u64).to_le_bytes()[..], &bytes[..end], arrays].concat()
}

/// The bytes as a file, the same one each time, in memory where the system has a folder for that.
fn on_disk(bytes: &[u8]) -> PathBuf {
    static FILE: LazyLock<Mutex<(File, tempfile::TempPath)>> = LazyLock::new(|| {
        let file =
            tempfile::NamedTempFile::new_in("/dev/shm").or_else(|_| tempfile::NamedTempFile::new());
        Mutex::new(file.expect("a writable folder for temporary files").into_parts())
    });
    let mut file = FILE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    file.0
        .set_len(0)
        .and_then(|()| file.0.rewind())
        .and_then(|()| file.0.write_all(bytes))
        .expect("a writable folder");
    file.1.to_path_buf()
}

fn move_it(robot: &Robot) {
    let n = robot.dof();
    let mut ws = Workspace::new(robot);
    assert_eq!(mass_matrix(robot, &mut ws, &vec![0.1; n]).len(), n * n);
    assert_eq!(rnea(robot, &mut ws, &vec![0.1; n], &vec![0.2; n], &vec![0.3; n]).len(), n);
}

fn look_at(recording: &Recording) {
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

fn predict(model: &TorqueModel) {
    let n = model.robot().dof();
    let (q, dq, ddq) = (vec![0.3; 2 * n], vec![-0.2; 2 * n], vec![0.5; 2 * n]);
    let known = Trajectory::of_samples(Samples { q: &q, dq: &dq, ddq: &ddq });
    assert_eq!(model.predict_trajectory(&known).len(), q.len());
    assert!(
        TorqueModel::from_bytes(&model.to_bytes(), "again").is_ok(),
        "what was read cannot be written"
    );
}
