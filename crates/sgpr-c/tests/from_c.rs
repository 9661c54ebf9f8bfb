//! C and C++ programs with the library: compiled, run, and their torques compared bit for bit with those in Rust.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

// Without a use of the library, cargo would not build it for this test.
use sgpr as _;
use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{StreamOptions, Term, TorqueModel};
use sgpr_core::robot::puma560;

const RATE_HZ: f64 = 250.0;
const HERE: &str = env!("CARGO_MANIFEST_DIR");

/// The folder of the library that cargo has built for this test.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("this program");
    let folder = test.parent().expect("in a folder");
    assert!(folder.join("libsgpr.so").exists(), "no libsgpr.so in {}", folder.display());
    folder.into()
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && output.stderr.is_empty(), "{command:?}: {}\n{words}", output.status);
    output
}

fn model() -> TorqueModel {
    let robot = puma560();
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..3 * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let term = |name: &str, site: Site, constant: f64| {
        let mut term = Term::new(by_name(name).expect("of the library"), site, vec![constant]);
        term.coefficients.fill(0.7);
        term
    };
    let terms = vec![term("presliding_friction", Site::Joint(1), 0.01), term("actuator_lag", Site::Arm, 0.004)];
    TorqueModel::with_parameters(&robot, &effects, parameters).expect("known").with_terms(terms, Some(0))
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
    (0..1500).flat_map(sample).collect()
}

fn expected(model: &TorqueModel, motion: &[f64]) -> Vec<u8> {
    let n = model.robot().dof();
    let options = StreamOptions { rate_hz: Some(RATE_HZ), ..StreamOptions::default() };
    let mut predictor = model.predictor(&options).expect("streams");
    let mut bytes = Vec::new();
    for sample in motion.chunks_exact(3 * n) {
        let tau = predictor.torque(&sample[..n], &sample[n..2 * n], &sample[2 * n..]);
        bytes.extend(tau.iter().flat_map(|tau| tau.to_le_bytes()));
    }
    bytes
}

/// Compiles a program of this folder with the library, runs it, and compares.
fn check(compiler: &str, standard: &str, source: &str, more: &[&str]) {
    if Command::new(compiler).arg("--version").output().is_err() {
        eprintln!("skipped: no {compiler} here");
        return;
    }
    let (model, folder, library) = (model(), tempfile::tempdir().expect("a folder"), library());
    let n = model.robot().dof();
    let motion = motion(n);
    let at = |name: &str| folder.path().join(name);
    model.save(at("model.sgpr")).expect("writable");
    fs::write(at("motion.bin"), motion.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
        .expect("writable");
    run(Command::new(compiler)
        .args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
        .arg(format!("-I{HERE}/include"))
        .arg(Path::new(HERE).join("tests").join(source))
        .args(["-o", at("program").to_str().expect("UTF-8"), "-L"])
        .arg(&library)
        .args(more)
        .args(["-lsgpr", "-lm", "-pthread"]));
    // The name under which the loader looks for it.
    std::os::unix::fs::symlink(library.join("libsgpr.so"), at("libsgpr.so.1")).expect("a link");
    run(Command::new(at("program"))
        .env("LD_LIBRARY_PATH", folder.path())
        .args([at("model.sgpr"), at("motion.bin"), at("tau.bin")])
        .arg(n.to_string()));
    assert!(fs::read(at("tau.bin")).expect("written") == expected(&model, &motion), "{source}: other torques");
}

#[test]
fn a_c_program_gets_the_same_bits_and_is_told_what_it_does_wrong() {
    check("gcc", "-std=c99", "controller.c", &[]);
    check("clang", "-std=c99", "controller.c", &[]);
}

#[test]
fn a_cpp_program_gets_the_same_bits() {
    check("g++", "-std=c++17", "controller.cpp", &[]);
    check("clang++", "-std=c++17", "controller.cpp", &[]);
}

#[test]
fn sanitisers_find_nothing() {
    check("gcc", "-std=c99", "controller.c", &["-fsanitize=address,undefined"]);
    check("g++", "-std=c++17", "controller.cpp", &["-fsanitize=thread"]);
}

/// Names of functions in a text, before their parenthesis.
fn functions(text: &str, before: &str) -> BTreeSet<String> {
    let after = text.split(before).skip(1);
    let name = |rest: &str| rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    after.map(name).collect()
}

#[test]
fn the_library_shows_what_the_header_declares_and_nothing_else() {
    let header = fs::read_to_string(format!("{HERE}/include/sgpr.h")).expect("the header");
    let declared: BTreeSet<String> = header
        .lines()
        .filter(|line| line.contains('(') && line.contains("sgpr_") && !line.starts_with([' ', '/', '#']))
        .map(|line| {
            let name = line.split('(').next().expect("a part").rsplit([' ', '*']).next();
            name.expect("a name").to_string()
        })
        .collect();
    let mut written = BTreeSet::new();
    for file in ["lib.rs", "model.rs", "predictor.rs"] {
        let source = fs::read_to_string(format!("{HERE}/src/{file}")).expect("a source");
        written.append(&mut functions(&source, "extern \"C\" fn "));
    }
    assert_eq!(declared, written);
    let output = run(Command::new("nm").args(["-D", "--defined-only"]).arg(library().join("libsgpr.so")));
    let text = String::from_utf8(output.stdout).expect("names");
    let shown: BTreeSet<String> =
        text.lines().filter_map(|line| line.split_whitespace().last()).map(ToString::to_string).collect();
    assert_eq!(declared, shown);
}
