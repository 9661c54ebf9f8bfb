//! C and C++ programs with the library: compiled, run, and their torques compared bit for bit with
//! those in Rust.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

// Without a use of the library, cargo would not build it for this test.
use sgpr as _;
use sgpr_core::effects::{Site, by_name};
use sgpr_core::gp::PredictorOptions;
use sgpr_core::model::{
    Inputs, Predictor, SemiParametricModel, SemiParametricOptions, StreamOptions, Term,
    TorqueModel, fit_semi_parametric,
};
use sgpr_core::recording::csv;
use sgpr_core::robot::{Robot, UrdfOptions, puma560};
use sgpr_predict::model::StreamedModel;
use sgpr_predict::stream::ResidualOptions;

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
    assert!(
        output.status.success() && output.stderr.is_empty(),
        "{command:?}: {}\n{words}",
        output.status
    );
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
    let terms = vec![
        term("presliding_friction", Site::Joint(1), 0.01),
        term("actuator_lag", Site::Arm, 0.004),
    ];
    TorqueModel::with_parameters(&robot, &effects, parameters)
        .expect("known")
        .with_terms(terms, Some(0))
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

/// Friction is left to processes of few points, on one thread: the bits of the weights do not
/// depend on the threads then.
fn learned_model() -> SemiParametricModel {
    let data = Path::new(HERE).join("../../data/demo");
    let robot =
        Robot::from_urdf(data.join("robot.urdf"), &UrdfOptions::default()).expect("bundled");
    let log = csv::read(data.join("train_1.csv.gz"), &Default::default()).expect("bundled");
    let options = SemiParametricOptions::default()
        .with_inputs(Some(Inputs::OwnJoint))
        .with_points(60)
        .with_evaluations(5);
    fit_semi_parametric(&robot, std::slice::from_ref(&log), &options, &()).expect("a good log")
}

fn expected(mut predictor: Predictor, motion: &[f64]) -> Vec<u8> {
    let n = predictor.dof();
    let mut bytes = Vec::new();
    for sample in motion.chunks_exact(3 * n) {
        let tau = predictor.torque(&sample[..n], &sample[n..2 * n], &sample[2 * n..]);
        bytes.extend(tau.iter().flat_map(|tau| tau.to_le_bytes()));
    }
    bytes
}

fn is_here(tool: &str) -> bool {
    let here = Command::new(tool).arg("--version").output().is_ok();
    if !here {
        eprintln!("skipped: no {tool} here");
    }
    here
}

/// Torques, their standard deviations and novelties, in the calls of `sure.c`.
fn expected_with_deviation(mut predictor: Predictor, motion: &[f64]) -> Vec<u8> {
    let n = predictor.dof();
    let mut numbers = Vec::new();
    for (k, sample) in motion.chunks_exact(3 * n).enumerate() {
        let (q, dq, ddq) = (&sample[..n], &sample[n..2 * n], &sample[2 * n..]);
        let both = match k % 3 {
            2 => predictor.torque_and_deviation_after(0.008, q, dq, ddq),
            _ => predictor.torque_and_deviation(q, dq, ddq),
        };
        let (tau, deviation) = both.expect("finite");
        numbers.extend([tau, deviation].concat());
        numbers.extend_from_slice(predictor.novelty());
    }
    assert!(numbers.iter().all(|number| number.is_finite()));
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// A model and a motion in files, and what a program should make of them.
struct Case {
    folder: tempfile::TempDir,
    joints: usize,
    expected: Vec<u8>,
}

impl Case {
    fn new() -> Self {
        let model = model();
        let options = StreamOptions::default().with_rate_hz(Some(RATE_HZ));
        Self::of(&model.to_bytes(), model.predictor(&options).expect("streams"))
    }

    /// The same, physics and Gaussian processes.
    fn learned() -> Self {
        let model = learned_model();
        let options = StreamOptions::default().with_rate_hz(Some(RATE_HZ));
        let means = PredictorOptions::default().with_variance_rank(Some(0));
        Self::of(&model.to_bytes(), model.predictor(means, &options).expect("streams"))
    }

    /// The same, and how sure the torques are.
    fn sure() -> Self {
        let file = learned_model().to_bytes();
        let options = StreamOptions::default().with_rate_hz(Some(RATE_HZ));
        let rest = ResidualOptions::default().with_deviation(true);
        let model = StreamedModel::from_bytes(&file, "file").expect("just written");
        let predictor = model.predictor_with(&options, &rest).expect("streams");
        Self::with(&file, predictor, expected_with_deviation)
    }

    fn of(file: &[u8], predictor: Predictor) -> Self {
        Self::with(file, predictor, expected)
    }

    fn with(
        file: &[u8],
        predictor: Predictor,
        expected: impl FnOnce(Predictor, &[f64]) -> Vec<u8>,
    ) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let joints = predictor.dof();
        let motion = motion(joints);
        fs::write(folder.path().join("model.sgpr"), file).expect("writable");
        let bytes: Vec<u8> = motion.iter().flat_map(|value| value.to_le_bytes()).collect();
        fs::write(folder.path().join("motion.bin"), bytes).expect("writable");
        Self { joints, expected: expected(predictor, &motion), folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a program that finds its libraries in `libraries`.
    fn run(&self, program: &Path, libraries: &Path) {
        run(Command::new(program)
            .env("LD_LIBRARY_PATH", libraries)
            .args([self.at("model.sgpr"), self.at("motion.bin"), self.at("tau.bin")])
            .arg(self.joints.to_string()));
        assert!(
            fs::read(self.at("tau.bin")).expect("written") == self.expected,
            "{}: other torques",
            program.display()
        );
        fs::remove_file(self.at("tau.bin")).expect("written");
    }
}

/// Compiles a program of this folder with the library, runs it, and compares.
fn check(case: &Case, compiler: &str, source: &str, more: &[&str]) {
    if is_here(compiler) {
        let standard = if source.ends_with(".c") { "-std=c99" } else { "-std=c++17" };
        compile(case, compiler, standard, source, more);
        case.run(&case.at("program"), case.folder.path());
    }
}

fn compile(case: &Case, compiler: &str, standard: &str, source: &str, more: &[&str]) {
    let library = library();
    run(Command::new(compiler)
        .args([standard, "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
        .arg(format!("-I{HERE}/include"))
        .arg(Path::new(HERE).join("tests").join(source))
        .args(["-o", case.at("program").to_str().expect("UTF-8"), "-L"])
        .arg(&library)
        .args(more)
        .args(["-lsgpr", "-lm", "-pthread"]));
    // The name under which the loader looks for it.
    let link = case.at("libsgpr.so.1");
    if !link.exists() {
        std::os::unix::fs::symlink(library.join("libsgpr.so"), link).expect("a link");
    }
}

/// The library as it is installed, in a folder that was moved afterwards.
fn installed(case: &Case) -> PathBuf {
    run(Command::new("sh")
        .arg(format!("{HERE}/install.sh"))
        .args([&library(), &case.at("before")]));
    fs::rename(case.at("before"), case.at("moved")).expect("a folder");
    case.at("moved")
}

#[test]
fn pkg_config_finds_the_installed_library() {
    if !is_here("pkg-config") || !is_here("g++") {
        return;
    }
    let case = Case::new();
    let prefix = installed(&case);
    let flags = |more: &[&str]| -> Vec<String> {
        let path = prefix.join("lib/pkgconfig");
        let output =
            run(Command::new("pkg-config").env("PKG_CONFIG_PATH", path).args(more).arg("sgpr"));
        String::from_utf8(output.stdout)
            .expect("flags")
            .split_whitespace()
            .map(String::from)
            .collect()
    };
    assert_eq!(flags(&["--modversion"]), [env!("CARGO_PKG_VERSION")]);
    let program = case.at("program");
    let compile = |flags: Vec<String>| {
        let source = Path::new(HERE).join("tests/controller.cpp");
        run(Command::new("g++")
            .arg("-std=c++17")
            .arg(source)
            .arg("-o")
            .arg(&program)
            .args(flags)
            .arg("-pthread"));
    };
    compile(flags(&["--cflags", "--libs"]));
    case.run(&program, &prefix.join("lib"));
    // Without the shared library the linker takes the other one.
    for name in ["libsgpr.so", "libsgpr.so.1"] {
        fs::remove_file(prefix.join("lib").join(name)).expect("installed");
    }
    compile(flags(&["--cflags", "--libs", "--static"]));
    case.run(&program, Path::new(""));
}

#[test]
fn cmake_finds_the_installed_library() {
    if !is_here("cmake") || !is_here("g++") {
        return;
    }
    let case = Case::new();
    let (prefix, build) = (installed(&case), case.at("build"));
    run(Command::new("cmake")
        .args(["-S", &format!("{HERE}/tests/consumer"), "-DCMAKE_CXX_COMPILER=g++"])
        .arg("-B")
        .arg(&build)
        .arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    run(Command::new("cmake").arg("--build").arg(&build));
    case.run(&build.join("shared"), &prefix.join("lib"));
    case.run(&build.join("static"), Path::new(""));
}

#[test]
fn a_c_program_gets_the_same_bits_and_is_told_what_it_does_wrong() {
    let case = Case::new();
    check(&case, "gcc", "controller.c", &[]);
    check(&case, "clang", "controller.c", &[]);
}

#[test]
fn a_cpp_program_gets_the_same_bits() {
    let case = Case::new();
    check(&case, "g++", "controller.cpp", &[]);
    check(&case, "clang++", "controller.cpp", &[]);
}

#[test]
fn a_learned_model_gives_the_same_bits() {
    let case = Case::learned();
    check(&case, "g++", "controller.cpp", &[]);
    check(&case, "clang++", "controller.cpp", &[]);
}

#[test]
fn a_learned_model_says_how_sure_it_is_in_the_same_bits() {
    let case = Case::sure();
    for (compiler, source) in
        [("gcc", "sure.c"), ("clang", "sure.c"), ("g++", "sure.cpp"), ("clang++", "sure.cpp")]
    {
        check(&case, compiler, source, &[]);
        check(&case, compiler, source, &["-fsanitize=address,undefined"]);
    }
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu", target_arch = "x86_64"))]
fn nothing_takes_memory_or_calls_the_system_after_set_up() {
    for case in [Case::new(), Case::learned()] {
        compile(&case, "gcc", "-std=gnu99", "quiet.c", &[]);
        let program = Command::new(case.at("program"))
            .env("LD_LIBRARY_PATH", case.folder.path())
            .args([case.at("model.sgpr"), case.at("motion.bin"), case.at("tau.bin")])
            .arg(case.joints.to_string())
            .output()
            .expect("built");
        if program.status.code() == Some(77) {
            eprintln!("skipped: this system does not let a process forbid itself system calls");
            return;
        }
        assert_eq!(program.status.code(), Some(0), "4: memory, killed: a system call; {program:?}");
    }
}

#[test]
fn sanitisers_find_nothing() {
    let case = Case::new();
    for (c, cpp) in [("gcc", "g++"), ("clang", "clang++")] {
        check(&case, c, "controller.c", &["-fsanitize=address,undefined"]);
        check(&case, cpp, "controller.cpp", &["-fsanitize=thread"]);
    }
}

/// Beside declarations of our own where ROS 2 is not installed (`ros2_control/README.md`); it is
/// built with those of ROS 2 by its `CMakeLists.txt`.
#[test]
fn the_controller_for_ros2_control_gives_effort_of_the_model_and_of_feedback() {
    let example = format!("{HERE}/../../examples/ros2_control");
    for case in [Case::new(), Case::learned()] {
        for compiler in ["g++", "clang++"].into_iter().filter(|compiler| is_here(compiler)) {
            let controller = format!("{example}/src/feed_forward_controller.cpp");
            let [own, others] =
                [format!("-I{example}/include"), format!("-I{HERE}/tests/ros2_control/include")];
            compile(
                &case,
                compiler,
                "-std=c++17",
                "ros2_control/drive.cpp",
                &[&controller, &own, &others],
            );
            run(Command::new(case.at("program"))
                .env("LD_LIBRARY_PATH", case.folder.path())
                .arg(case.at("model.sgpr")));
        }
    }
}

#[test]
fn the_header_is_that_of_the_source() {
    let options =
        cbindgen::Config::from_file(format!("{HERE}/cbindgen.toml")).expect("the options");
    let mut made = Vec::new();
    cbindgen::Builder::new()
        .with_src(format!("{HERE}/src/lib.rs"))
        .with_config(options)
        .generate()
        .expect("C")
        .write(&mut made);
    let path = format!("{HERE}/include/sgpr.h");
    if std::env::var_os("SGPR_WRITE_HEADER").is_some() {
        fs::write(&path, &made).expect("writable");
    }
    let made = String::from_utf8(made).expect("UTF-8");
    assert!(
        fs::read_to_string(&path).expect("the header") == made,
        "the header is not that of the source: SGPR_WRITE_HEADER=1 cargo test --package sgpr-c \
         --test from_c header"
    );
}

#[test]
fn the_library_shows_what_the_header_declares_and_nothing_else() {
    let header = fs::read_to_string(format!("{HERE}/include/sgpr.h")).expect("the header");
    let named =
        |line: &str| line.split_once('(')?.0.rsplit([' ', '*']).next().map(ToString::to_string);
    let outside = header.lines().filter(|line| !line.starts_with([' ', '/', '#']));
    let declared: BTreeSet<String> =
        outside.filter_map(named).filter(|name| name.starts_with("sgpr_")).collect();
    assert!(declared.len() > 10, "{declared:?}");
    let output =
        run(Command::new("nm").args(["-D", "--defined-only"]).arg(library().join("libsgpr.so")));
    let text = String::from_utf8(output.stdout).expect("names");
    let shown: BTreeSet<String> = text
        .lines()
        .filter_map(|line| line.split_whitespace().last())
        .map(ToString::to_string)
        .collect();
    assert_eq!(declared, shown);
}
