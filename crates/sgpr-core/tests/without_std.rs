//! The crate of the predictor in a program without the standard library: linked, run, and its
//! torques compared.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use sgpr_core::control::{Compensation, CompensationOptions};
use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{StreamOptions, Term, TorqueModel};
use sgpr_core::robot::puma560;

const RATE_HZ: f64 = 250.0;
const SLIM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../sgpr-predict");

fn model() -> TorqueModel {
    let robot = puma560();
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..3 * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let terms = [
        ("presliding_friction", Site::Joint(1), vec![0.01]),
        ("stribeck_friction", Site::Joint(2), vec![0.1]),
        ("joint_elasticity", Site::Joint(0), vec![1e-4]),
        ("payload", Site::Arm, vec![]),
        ("base_compliance", Site::Arm, vec![]),
        ("torque_delay", Site::Arm, vec![0.01]),
        ("actuator_lag", Site::Arm, vec![0.004]),
    ];
    let terms = terms.map(|(name, site, constants)| {
        let mut term = Term::new(by_name(name).expect("of the library"), site, constants);
        term.coefficients.fill(0.2);
        term
    });
    TorqueModel::with_parameters(&robot, &effects, parameters)
        .expect("known")
        .with_terms(terms.into(), Some(0))
}

/// `[samples][q, dq, ddq][n]`.
fn motion(n: usize) -> Vec<f64> {
    let sample = |k: usize| {
        let t = k as f64 / RATE_HZ;
        let w = |joint: usize| 1.3 + 0.4 * joint as f64;
        let q = (0..n).map(move |joint| (w(joint) * t).sin());
        let dq = (0..n).map(move |joint| w(joint) * (w(joint) * t).cos());
        let ddq = (0..n).map(move |joint| -w(joint).powi(2) * (w(joint) * t).sin());
        q.chain(dq).chain(ddq)
    };
    (0..600).flat_map(sample).collect()
}

fn expected(model: &TorqueModel, motion: &[f64]) -> Vec<f64> {
    let n = model.robot().dof();
    let stream = StreamOptions::default().with_rate_hz(Some(RATE_HZ));
    let mut predictor = model.predictor(&stream).expect("streams");
    let options = CompensationOptions::default().with_stream(stream);
    let mut compensation = Compensation::new(model, &options).expect("streams");
    let mut all = Vec::new();
    for sample in motion.chunks_exact(3 * n) {
        let (q, dq, ddq) = (&sample[..n], &sample[n..2 * n], &sample[2 * n..]);
        all.extend_from_slice(predictor.torque(q, dq, ddq));
        all.extend_from_slice(compensation.torque(q, dq).expect("finite"));
    }
    all
}

fn cargo() -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.current_dir(Path::new(SLIM).join("without_std"));
    // What this build was told is not for that one.
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        cargo.env_remove(name);
    }
    cargo
}

#[test]
fn a_program_without_std_computes_the_same_torques_and_allocates_nothing_after_set_up() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("without_std");
    let built = cargo()
        .args(["build", "--locked", "--quiet", "--target-dir"])
        .arg(&folder)
        .status()
        .expect("cargo");
    assert!(built.success(), "the program is not built");
    let model = model();
    let (bytes, motion) = (model.to_bytes(), motion(model.robot().dof()));
    let mut program = Command::new(folder.join("debug/without-std"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("built");
    let mut input = program.stdin.take().expect("piped");
    let numbers = [RATE_HZ].into_iter().chain(motion.iter().copied()).flat_map(f64::to_le_bytes);
    let all: Vec<u8> =
        (bytes.len() as u64).to_le_bytes().into_iter().chain(bytes).chain(numbers).collect();
    let writer = std::thread::spawn(move || input.write_all(&all));
    let output = program.wait_with_output().expect("it runs");
    writer.join().expect("no panic").expect("it reads");
    assert_eq!(output.status.code(), Some(0), "3: memory after set-up, 101: a panic, 1: refused");
    let own: Vec<f64> =
        output.stdout.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let expected = expected(&model, &motion);
    assert_eq!(own.len(), 2 * expected.len());
    let n = model.robot().dof();
    let largest = expected.iter().fold(0.0f64, |largest, tau| largest.max(tau.abs()));
    let mut apart = [0.0f64; 2];
    for (own, expected) in own.chunks(4 * n).zip(expected.chunks(2 * n)) {
        for (apart, own) in apart.iter_mut().zip(own.chunks(2 * n)) {
            *apart = own
                .iter()
                .zip(expected)
                .fold(*apart, |apart, (own, tau)| apart.max((own - tau).abs()));
        }
    }
    // In 64 bits, and in 32.
    assert!(apart[0] < 1e-12 * largest && apart[1] < 1e-5 * largest, "{apart:?} of {largest}");
}

#[test]
fn its_tree_is_small_and_has_no_c_code() {
    let tree = cargo()
        .args([
            "tree",
            "--locked",
            "--edges",
            "normal,build",
            "--prefix",
            "none",
            "--no-dedupe",
            "--format",
            "{p}",
        ])
        .output()
        .expect("cargo");
    assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
    let text = String::from_utf8(tree.stdout).expect("names");
    let all: BTreeSet<&str> =
        text.lines().filter(|line| !line.starts_with("without-std")).collect();
    let names: BTreeSet<&str> = all.iter().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.len() <= 15, "{} crates: {names:?}", names.len());
    assert!(!names.iter().any(|name| *name == "cc" || name.ends_with("-sys")), "{names:?}");
}

/// Processors with instructions for 32 bits alone, and without an operating system.
const BARE: &str = "thumbv7em-none-eabihf";

#[test]
fn it_is_built_for_a_processor_without_a_system() {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let found = Command::new(rustc)
        .args(["--print", "target-libdir", "--target", BARE])
        .output()
        .expect("rustc");
    let library = String::from_utf8(found.stdout).expect("a path");
    if !Path::new(library.trim()).is_dir() {
        return println!("skipped: the toolchain has no {BARE} (`rustup target add {BARE}`)");
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bare");
    let mut build = cargo();
    build.current_dir(SLIM).args([
        "build",
        "--locked",
        "--quiet",
        "--no-default-features",
        "--target",
        BARE,
    ]);
    assert!(
        build.arg("--target-dir").arg(folder).status().expect("cargo").success(),
        "not built for {BARE}"
    );
}
