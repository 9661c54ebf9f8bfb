//! Whoever builds only the predictor builds few crates, none of them with code in another language
//! than Rust.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// This crate among them.
const MOST_CRATES: usize = 15;

/// What builds or finds code in other languages.
const FOREIGN: [&str; 8] =
    ["cc", "cmake", "bindgen", "pkg-config", "vcpkg", "autotools", "nasm-rs", "system-deps"];

fn cargo(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .arg("--locked")
        .output()
        .expect("cargo");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo {arguments:?}: {words}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Name and version of the crates that are built for a package, `more` features asked for.
fn built(package: &str, more: &[&str]) -> BTreeSet<String> {
    let tree = ["tree", "--package", package, "--edges", "normal,build", "--prefix", "none"];
    let lines = cargo(&[&tree, more].concat());
    let package = |line: &str| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    lines.lines().filter(|line| !line.is_empty()).map(package).collect()
}

fn names_of(crates: &BTreeSet<String>) -> BTreeSet<&str> {
    crates.iter().filter_map(|line| line.split(' ').next()).collect()
}

/// Sources in other languages below a folder, its tests and examples aside.
fn foreign_sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let aside = ["tests", "examples", "benches", "target", "without_std"];
    for entry in fs::read_dir(folder).expect("a package").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() && !aside.iter().any(|aside| name == *aside) {
            foreign_sources(&path, found);
        }
        let ending = path.extension().unwrap_or_default();
        if ["c", "cc", "cpp", "cxx", "h", "hpp", "s", "S", "asm", "f", "f90", "a", "o"]
            .iter()
            .any(|e| ending == *e)
        {
            found.push(path);
        }
    }
}

#[test]
fn few_crates_and_none_of_another_language() {
    let crates = built("sgpr-predict", &[]);
    assert!(crates.len() <= MOST_CRATES, "{} crates: {crates:#?}", crates.len());
    assert!(built("sgpr-predict", &["--no-default-features"]).len() <= MOST_CRATES);
    let names = names_of(&crates);
    assert!(names.contains("sgpr-predict") && names.contains("libm"), "{names:?}");
    assert!(FOREIGN.iter().all(|foreign| !names.contains(foreign)), "{names:?}");

    let metadata: Value =
        serde_json::from_str(&cargo(&["metadata", "--format-version", "1"])).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let text = |package: &Value, key: &str| package[key].as_str().unwrap_or_default().to_string();
    let of_tree = packages.iter().filter(|package| {
        crates.contains(&format!("{} v{}", text(package, "name"), text(package, "version")))
    });
    let mut seen = 0;
    for package in of_tree {
        let name = text(package, "name");
        assert!(package["links"].is_null(), "{name} links {}", package["links"]);
        let manifest = PathBuf::from(text(package, "manifest_path"));
        let mut found = vec![];
        foreign_sources(manifest.parent().expect("a folder"), &mut found);
        assert_eq!(found, Vec::<PathBuf>::new(), "{name}");
        seen += 1;
    }
    assert_eq!(seen, crates.len(), "every crate is looked at");
}

#[test]
fn who_reads_logs_or_learns_processes_builds_no_more_than_that() {
    let formats = ["csv", "flate2", "lz4", "mcap", "zstd"];
    let algebra = ["faer", "nalgebra"];
    let others = ["clarabel", "safetensors", "sgpr-core", "sgpr-lapack", "slsqp", "urdf-rs"];
    let without = [
        ("sgpr-recording", &algebra[..]),
        ("sgpr-gp", &formats[..]),
        ("sgpr-numeric", &formats[..]),
    ];
    for (package, without) in without {
        // Beside it in the repository, not in a package.
        if !Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(package).is_dir() {
            continue;
        }
        let crates = built(package, &[]);
        let names = names_of(&crates);
        assert!(names.contains("sgpr-predict"), "{names:?}");
        let found: Vec<_> =
            without.iter().chain(&others).filter(|name| names.contains(*name)).collect();
        assert!(found.is_empty(), "{package} builds {found:?}");
    }
}
