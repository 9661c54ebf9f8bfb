//! What holds in the sources and no compiler asks for: one meaning for each name of a type, room
//! for fields that are not there yet, no circle of modules. The lists only get shorter.
#![allow(missing_docs)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Names with several meanings, and why they stay.
const KNOWN: [(&str, &str); 19] = [
    (
        "Basis",
        "of whitened columns in the diagnosis; of motions in the interface of the excitation",
    ),
    (
        "Candidate",
        "an effect in the diagnosis; a selection of inputs in the interface of the model",
    ),
    ("Comparison", "of two models on blocks in the diagnosis; of model and logs in the interface"),
    (
        "Controller",
        "of a reference log, two gains; of a simulated arm, any law: both in the interface",
    ),
    ("Experiment", "filtered logs inside of the model; a simulated run in the interface"),
    ("Factor", "of Cholesky, and of a formula, both inside of the diagnosis"),
    ("Finding", "of the diagnosis, and of the screening of logs: both in the interface"),
    ("Group", "of variables in the diagnosis, and of parts that are left out together"),
    ("Held", "a prior in the diagnosis; an estimate and its prior in the interface"),
    ("Input", "of a residual's structure, and of a kernel: both in the interface"),
    ("Joint", "of a robot; what a file of a semi-parametric model keeps of it"),
    ("LeftOut", "errors in the diagnosis; parts of the data in the interface"),
    ("Machine", "two files of which a processor has one"),
    (
        "PayloadOptions",
        "of an estimate from logs, and of one while the arm runs: both in the interface",
    ),
    ("Plan", "of an experiment in the diagnosis; of a kernel's evaluation"),
    ("Process", "as the diagnosis tries it, and as the model has it"),
    ("Smooth", "a smoother, and a process, both inside of the diagnosis"),
    ("Trajectory", "excited, identified from, predicted: all in the interface"),
    ("Variable", "of a joint, and of any joint, both inside of the diagnosis"),
];

/// Structs of which a caller may name all fields, since they are what the type is: no field will
/// come. By name, `q` is not taken for `dq`.
const WHOLE: [&str; 22] = [
    "Block",
    "Capsule",
    "Channel",
    "Controller",
    "Frame",
    "Gains",
    "Input",
    "JointState",
    "LinkInertia",
    "LinkMotion",
    "LinkSample",
    "Matrix3",
    "MeasuredMotion",
    "Measurement",
    "NamedColumn",
    "Pose",
    "Samples",
    "Setpoint",
    "SimulatedMotion",
    "Svd",
    "TrajectorySamples",
    "Vector3",
];

/// Structs of which all fields are public inside of the library, in none of its interfaces.
const INSIDE: [&str; 17] = [
    "Autoregression",
    "BasisParts",
    "Body",
    "Buffers",
    "Described",
    "Dual",
    "Evidence",
    "FadingNoise",
    "Implausible",
    "JointExtent",
    "JointRanges",
    "Parts",
    "ResidualJoint",
    "Sampler",
    "VarianceParts",
    "WeightRows",
    "WeightedKernel",
];

/// Files of a crate, but for those of tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).expect("a folder of sources");
    for path in entries.map(|entry| entry.expect("a readable entry").path()) {
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs")
            && !path.ends_with("tests.rs")
        {
            found.push(path);
        }
    }
}

/// The type that a line of code defines; those in blocks of implementations are not counted.
fn defined(line: &str) -> Option<&str> {
    let code = line.trim_start();
    let code = match code.strip_prefix("pub") {
        Some(rest) if rest.starts_with('(') => rest.split_once(") ").map_or(rest, |(_, rest)| rest),
        Some(rest) => rest.trim_start(),
        None => code,
    };
    let (kind, rest) = code.split_once(' ')?;
    let counts = matches!(kind, "struct" | "enum" | "trait" | "union")
        || kind == "type" && !line.starts_with(' ');
    let end =
        rest.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(rest.len());
    (counts && rest.starts_with(char::is_uppercase)).then(|| &rest[..end])
}

/// Folders of the sources of these crates that are there: in the repository, not in a package.
fn folders(crates: &[&str]) -> Vec<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folders = crates.iter().map(|name| beside.join(format!("sgpr-{name}/src")));
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    std::iter::once(own).chain(folders).filter(|folder| folder.is_dir()).collect()
}

/// Crates whose types meet in one program.
const TOGETHER: [&str; 4] = ["predict", "recording", "numeric", "gp"];

/// Files below a folder and their text without tests and what only runs the examples of a readme.
fn code(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut files = vec![];
    sources(folder, &mut files);
    let code = |file: &PathBuf| {
        let text = std::fs::read_to_string(file).expect("a source file");
        let ends = ["#[cfg(test)]\nmod ", "#[cfg(doctest)]"];
        ends.iter().fold(&*text, |code, end| code.split(end).next().unwrap_or_default()).to_string()
    };
    files.iter().map(|file| (file.clone(), code(file))).collect()
}

fn code_together() -> Vec<(PathBuf, String)> {
    folders(&TOGETHER).iter().flat_map(|folder| code(folder)).collect()
}

fn all_are_there() -> bool {
    folders(&TOGETHER).len() == TOGETHER.len() + 1
}

#[test]
fn no_more_names_of_types_have_several_meanings() {
    let files = code_together();
    let mut places: BTreeMap<String, Vec<&Path>> = BTreeMap::new();
    for (file, code) in &files {
        for name in code.lines().filter_map(defined) {
            places.entry(name.into()).or_default().push(file);
        }
    }
    assert!(places.len() > 300, "{} types: is this the folder of the sources?", places.len());
    places.retain(|_, files| files.len() > 1);
    let new: Vec<_> =
        places.iter().filter(|(name, _)| !KNOWN.iter().any(|(known, _)| known == name)).collect();
    assert!(
        new.is_empty(),
        "names that have a meaning already; take the field's word for this one: {new:#?}"
    );
    if all_are_there() {
        let gone: Vec<_> = KNOWN.iter().filter(|(name, _)| !places.contains_key(*name)).collect();
        assert!(gone.is_empty(), "they have one meaning now; shorten the list: {gone:#?}");
    }
}

/// Public structs of a file with public fields that no attribute keeps open for more.
fn closed(code: &str) -> Vec<&str> {
    let lines: Vec<&str> = code.lines().collect();
    let open = |at: usize| {
        let attributes = lines[..at]
            .iter()
            .rev()
            .take_while(|line| line.starts_with("#[") || line.starts_with("///"));
        attributes.into_iter().any(|line| *line == "#[non_exhaustive]")
    };
    let bare = |at: usize| {
        lines[at].ends_with('{')
            && lines[at..]
                .iter()
                .take_while(|line| **line != "}")
                .any(|line| line.starts_with("    pub ") && line.contains(": "))
    };
    let structs = (0..lines.len()).filter(|&at| lines[at].starts_with("pub struct "));
    structs.filter(|&at| bare(at) && !open(at)).filter_map(|at| defined(lines[at])).collect()
}

#[test]
fn structs_of_the_interface_can_have_more_fields_later() {
    assert_eq!(
        closed(
            "#[non_exhaustive]\npub struct A {\n    pub a: u8,\n}\npub struct B {\n    pub b: u8,\n}\n"
        ),
        ["B"]
    );
    let files = code_together();
    let mut found: Vec<&str> = files.iter().flat_map(|(_, code)| closed(code)).collect();
    found.sort_unstable();
    found.dedup();
    let listed = |name: &&str| WHOLE.contains(name) || INSIDE.contains(name);
    let new: Vec<_> = found.iter().filter(|name| !listed(name)).collect();
    assert!(
        new.is_empty(),
        "`#[non_exhaustive]`, with a constructor or setters: a new field breaks no caller {new:#?}"
    );
    if all_are_there() {
        let gone: Vec<_> =
            WHOLE.iter().chain(&INSIDE).filter(|name| !found.contains(name)).collect();
        assert!(gone.is_empty(), "they are open now; shorten the lists: {gone:#?}");
    }
}

/// Names of modules after `crate::`, also those of a list.
fn used(code: &str) -> BTreeSet<&str> {
    let name =
        |text: &'_ str| text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    let mut found = BTreeSet::new();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    let starts =
        lines.flat_map(|line| line.match_indices("crate::").map(move |(at, _)| &line[at + 7..]));
    found.extend(starts.filter(|rest| !rest.starts_with('{')).map(|rest| &rest[..name(rest)]));
    for (at, _) in code.match_indices("use crate::{") {
        let list = code[at + 12..].split("};").next().unwrap_or_default();
        let firsts = list.split([',', '{', '}']).map(str::trim).filter(|item| item.contains("::"));
        found.extend(firsts.map(|item| &item[..name(item)]));
    }
    found
}

/// Modules of a crate, each with those that it uses.
fn modules(folder: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let mut modules: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, code) in code(folder) {
        let path = file.strip_prefix(folder).expect("a file of the folder");
        let first = path.iter().next().expect("a name").to_string_lossy();
        let module = first.trim_end_matches(".rs").to_string();
        modules.entry(module).or_default().extend(used(&code).into_iter().map(String::from));
    }
    modules.remove("lib");
    let names: BTreeSet<String> = modules.keys().cloned().collect();
    for (module, used) in &mut modules {
        used.retain(|other| names.contains(other) && other != module);
    }
    modules
}

/// Modules that are left when one after the other is taken away that uses none of the others.
fn circle(mut modules: BTreeMap<String, BTreeSet<String>>) -> BTreeMap<String, BTreeSet<String>> {
    while let Some(free) =
        modules.iter().find(|(_, used)| used.is_empty()).map(|(name, _)| name.clone())
    {
        modules.remove(&free);
        for used in modules.values_mut() {
            used.remove(&free);
        }
    }
    modules
}

#[test]
fn no_module_uses_one_that_is_built_on_it() {
    let text =
        "use crate::a::X;\n// crate::b\nuse crate::{c::Y, d::{self, Z}};\nlet x = crate::e::f();\n";
    assert_eq!(used(text), BTreeSet::from(["a", "c", "d", "e"]));
    let uses = |other: &str| BTreeSet::from([other.to_string()]);
    let modules_of = BTreeMap::from([("a".into(), uses("b")), ("b".into(), uses("a"))]);
    assert_eq!(circle(modules_of).len(), 2);
    for folder in folders(&[&TOGETHER[..], &["py", "c", "lapack"]].concat()) {
        let modules = modules(&folder);
        assert!(modules.len() > 2, "{}: {} modules", folder.display(), modules.len());
        let circle = circle(modules);
        assert!(circle.is_empty(), "{}: modules use each other: {circle:#?}", folder.display());
    }
}
