//! Exported models are the models: compiled and run beside the predictor.
#![allow(missing_docs)]

#[path = "common/every_effect.rs"]
mod every_effect;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use every_effect::{plain, term};
use sgpr_core::effects::{Effect, EffectParameter, Entry, JointState, Site, by_name, registry};
use sgpr_core::export::{ExportError, ExportOptions, Language};
use sgpr_core::gp::Precision;
use sgpr_core::model::{Purpose, StreamOptions, TorqueModel};
use sgpr_core::robot::{Robot, puma560, two_link};

const RATE_HZ: f64 = 250.0;
const SAMPLES: usize = 800;
const CELSIUS: f64 = 33.0;

/// A motion with reversals and a rest, `[samples][q, dq, ddq][n]`, one after the other.
fn motion(n: usize) -> Vec<f64> {
    let mut values = Vec::new();
    for k in 0..SAMPLES {
        let t = k as f64 / RATE_HZ;
        let parts = |part: fn(f64, f64) -> f64, power: i32| -> Vec<f64> {
            let of_joint = |joint: usize| {
                let w = 2.0 + 0.7 * joint as f64;
                let one = |w: f64, size: f64| size * w.powi(power) * part(w * t + joint as f64, w);
                // The second joint rests for a while in the middle.
                if joint == 1 && (300..400).contains(&k) {
                    return if power == 0 { 0.4 } else { 0.0 };
                }
                one(w, 0.7) + one(2.3 * w, 0.2)
            };
            (0..n).map(of_joint).collect()
        };
        values.extend(parts(|x, _| x.sin(), 0));
        values.extend(parts(|x, _| x.cos(), 1));
        values.extend(parts(|x, _| -x.sin(), 2));
    }
    values
}

fn options(
    (language, precision): (Language, Precision),
    name: &str,
    purpose: Purpose,
) -> ExportOptions {
    let stream = StreamOptions::default().with_rate_hz(Some(RATE_HZ)).with_purpose(purpose);
    ExportOptions::new(language)
        .with_precision(precision)
        .with_name(Some(name.into()))
        .with_stream(stream)
}

/// Models with every effect of the library, each alone, a joint of the wrist for those that have
/// one; and with many.
fn models() -> Vec<(String, TorqueModel, Purpose)> {
    let robot = puma560();
    let mut models = Vec::new();
    for effect in registry().iter().filter(|effect| effect.entry() != Entry::Gate) {
        let sites = effect.sites(&robot);
        let site = sites[2.min(sites.len() - 1)];
        let mut terms = vec![term(effect, site)];
        if effect.name() == "torque_delay" {
            terms[0].constants = vec![3.4 / RATE_HZ];
        }
        let model = plain(&robot).with_terms(terms, Some(0));
        models.push((effect.name().to_string(), model, Purpose::ExpectedMeasurement));
    }
    let of = |name: &str, site: Site| term(&by_name(name).expect("of the library"), site);
    let mut early = of("torque_delay", Site::Arm);
    early.constants = vec![-0.006];
    models.push((
        "early".into(),
        plain(&robot).with_terms(vec![early], Some(0)),
        Purpose::ExpectedMeasurement,
    ));
    let many = vec![
        of("presliding_friction", Site::Joint(2)),
        of("friction_step", Site::Joint(1)),
        of("cable_hysteresis", Site::Joint(0)),
        of("transmission_hysteresis", Site::Joint(4)),
        of("encoder_offset", Site::Joint(1)),
        of("base_tilt", Site::Arm),
        of("payload_change", Site::Arm),
        of("torque_gain_error", Site::Joint(2)),
        of("actuator_lag", Site::Arm),
        of("torque_saturation", Site::Joint(1)),
    ];
    for (name, purpose) in
        [("shown", Purpose::ExpectedMeasurement), ("fed_forward", Purpose::FeedForward)]
    {
        models.push((
            format!("many_{name}"),
            plain(&robot).with_terms(many.clone(), Some(0)),
            purpose,
        ));
    }
    models
}

/// What the predictor says along the motion, `[samples, n]`; the second half begins in a motion.
fn expected(model: &TorqueModel, purpose: Purpose, motion: &[f64]) -> Vec<f64> {
    let n = model.robot().dof();
    let options = StreamOptions::default().with_rate_hz(Some(RATE_HZ)).with_purpose(purpose);
    let mut predictor = model.predictor(&options).expect("streams");
    predictor.set_temperature(&vec![CELSIUS; n]).expect("finite");
    predictor.set_time(0.5).expect("finite");
    let mut all = Vec::new();
    for (k, sample) in motion.chunks_exact(3 * n).enumerate() {
        let (q, rest) = sample.split_at(n);
        let (dq, ddq) = rest.split_at(n);
        if k == SAMPLES / 2 {
            predictor.reset_at(q, dq).expect("finite");
        }
        all.extend_from_slice(predictor.try_torque(q, dq, ddq).expect("a good sample"));
    }
    all
}

fn run(command: &mut Command) {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stderr.is_empty(), "{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
}

fn exists(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok();
    if !found {
        eprintln!("skipped: no {program} here");
    }
    found
}

/// A program that runs every model over the motion in `motion.bin` and writes the torques to
/// `tau.bin`.
fn c_main(models: &[(String, TorqueModel, Purpose)], n: usize, precision: Precision) -> String {
    let number = if precision == Precision::Single { "float" } else { "double" };
    let mut out = String::from("#include <stdio.h>\n#include <math.h>\n");
    models.iter().for_each(|(name, ..)| writeln!(out, "#include \"{name}.h\"").expect("a string"));
    let width = 3 * n;
    writeln!(out, "static {number} motion[{SAMPLES}][{width}];").expect("a string");
    for (name, model, purpose) in models {
        let code =
            model.export(&options((Language::C, precision), name, *purpose)).expect("exports");
        let has = |function: &str| code.contains(&format!("sgpr_{name}_{function}("));
        let temperature = if has("set_temperature") {
            format!("sgpr_{name}_set_temperature(&state, celsius);")
        } else {
            "(void)celsius;".into()
        };
        let time = if has("set_time") {
            format!("sgpr_{name}_set_time(&state, 0.5);")
        } else {
            String::new()
        };
        write!(
            out,
            "static int run_{name}(FILE *file)
{{
    static sgpr_{name}_state state;
    {number} tau[{n}], bad[{n}], celsius[{n}];
    int k, failed = 0;
    for (k = 0; k < {n}; ++k) {{ celsius[k] = ({number}){CELSIUS:?}; bad[k] = motion[0][k]; }}
    bad[1] = ({number})NAN;
    sgpr_{name}_reset(&state);
    {temperature}
    {time}
    for (k = 0; k < {SAMPLES}; ++k) {{
        const {number} *q = motion[k];
        if (k == {half}) {{ failed |= sgpr_{name}_reset_at(&state, q, q + {n}) != 0; }}
        failed |= sgpr_{name}_torque(&state, bad, q + {n}, q + 2 * {n}, tau) != 1;
        failed |= sgpr_{name}_torque(&state, q, q + {n}, q + 2 * {n}, tau) != 0;
        failed |= fwrite(tau, sizeof tau, 1, file) != 1;
    }}
    return failed;
}}
",
            half = SAMPLES / 2
        )
        .expect("a string");
    }
    out.push_str(
        "int main(void)
{
    FILE *in = fopen(\"motion.bin\", \"rb\"), *file = fopen(\"tau.bin\", \"wb\");
    int failed = in == NULL || file == NULL || fread(motion, sizeof motion, 1, in) != 1;
",
    );
    models
        .iter()
        .for_each(|(name, ..)| writeln!(out, "    failed |= run_{name}(file);").expect("a string"));
    out.push_str("    failed |= fclose(file) != 0;\n    return failed;\n}\n");
    out
}

fn rust_main(models: &[(String, TorqueModel, Purpose)], n: usize, precision: Precision) -> String {
    let (number, bytes) = if precision == Precision::Single { ("f32", 4) } else { ("f64", 8) };
    let mut out = String::from("use std::io::Write;\n");
    models.iter().for_each(|(name, ..)| writeln!(out, "mod {name};").expect("a string"));
    write!(
        out,
        "fn part(sample: &[{number}], k: usize) -> [{number}; {n}] {{ sample[k * {n}..(k + 1) * {n}].try_into().unwrap() }}
fn main() {{
    let bytes = std::fs::read(\"motion.bin\").unwrap();
    let motion: Vec<{number}> =
        bytes.chunks_exact({bytes}).map(|b| {number}::from_le_bytes(b.try_into().unwrap())).collect();
    let mut file = std::io::BufWriter::new(std::fs::File::create(\"tau.bin\").unwrap());
"
    )
    .expect("a string");
    for (name, ..) in models {
        write!(
            out,
            "    let mut state = {name}::State::new();
    state.set_temperature(&[{CELSIUS:?}; {n}]).unwrap();
    state.set_time(0.5).unwrap();
    for (k, sample) in motion.chunks_exact(3 * {n}).enumerate() {{
        let [q, dq, ddq] = [part(sample, 0), part(sample, 1), part(sample, 2)];
        if k == {half} {{ state.reset_at(&q, &dq).unwrap(); }}
        assert_eq!(state.torque(&[{number}::INFINITY; {n}], &dq, &ddq), Err({name}::Fault::NotFinite));
        for tau in state.torque(&q, &dq, &ddq).unwrap() {{ file.write_all(&tau.to_le_bytes()).unwrap(); }}
    }}
",
            half = SAMPLES / 2
        )
        .expect("a string");
    }
    out.push_str("    file.flush().unwrap();\n}\n");
    out
}

fn write_all(
    folder: &Path,
    models: &[(String, TorqueModel, Purpose)],
    (language, precision): (Language, Precision),
    motion: &[f64],
) {
    let bytes = |value: &f64| match precision {
        Precision::Single => (*value as f32).to_le_bytes().to_vec(),
        Precision::Double => value.to_le_bytes().to_vec(),
    };
    let bytes: Vec<u8> = motion.iter().flat_map(bytes).collect();
    fs::write(folder.join("motion.bin"), bytes).expect("writable");
    let ending = if language == Language::C { "h" } else { "rs" };
    for (name, model, purpose) in models {
        let path = folder.join(format!("{name}.{ending}"));
        model.export_to(path, &options((language, precision), name, *purpose)).expect("exports");
    }
    let n = models[0].1.robot().dof();
    let (main, code) = match language {
        Language::C => ("main.c", c_main(models, n, precision)),
        Language::Rust => ("main.rs", rust_main(models, n, precision)),
    };
    fs::write(folder.join(main), code).expect("writable");
}

/// Runs the program that was built and compares its torques with those of the predictors.
fn compare(
    folder: &Path,
    models: &[(String, TorqueModel, Purpose)],
    motion: &[f64],
    precision: Precision,
) {
    run(Command::new(folder.join("program")).current_dir(folder));
    let bytes = fs::read(folder.join("tau.bin")).expect("written");
    let tau: Vec<f64> = match precision {
        Precision::Single => {
            bytes.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()
        }
        Precision::Double => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
    };
    let rows = SAMPLES * models[0].1.robot().dof();
    assert_eq!(tau.len(), models.len() * rows);
    for ((name, model, purpose), found) in models.iter().zip(tau.chunks_exact(rows)) {
        let expected = expected(model, *purpose, motion);
        let largest = expected.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        let apart =
            expected.iter().zip(found).fold(0.0f64, |apart, (a, b)| apart.max((a - b).abs()));
        let without = self::expected(&plain(model.robot()), *purpose, motion);
        let in_it = !["viscous_friction", "arm"].contains(&name.as_str());
        assert!(!in_it || expected != without, "{name} does nothing");
        let bound = if precision == Precision::Single { 2e-6 } else { 1e-12 };
        assert!(apart <= bound * largest, "{name}: {:e} of the largest torque", apart / largest);
        if std::env::var_os("SGPR_PRINT_EXPORT").is_some() {
            println!("{name}: {:e}", apart / largest);
        }
    }
}

fn build_c(folder: &Path, compiler: &str, standard: &str, language: &str) {
    let strict =
        ["-Wall", "-Wextra", "-Wpedantic", "-Wdouble-promotion", "-Werror", "-o", "program", "-O1"];
    let mut command = Command::new(compiler);
    command.current_dir(folder).arg(standard).args(strict).args(["-x", language, "main.c", "-lm"]);
    run(&mut command);
}

fn build_rust(folder: &Path) {
    let mut command = Command::new(std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into()));
    command.current_dir(folder).args([
        "--edition",
        "2021",
        "-D",
        "warnings",
        "-o",
        "program",
        "main.rs",
    ]);
    run(&mut command);
}

#[test]
fn every_effect_in_c_gives_the_torque_of_the_predictor() {
    in_c(&motion(6), Precision::Double);
}

fn in_c(motion: &[f64], precision: Precision) {
    let models = models();
    let folder = tempfile::tempdir().expect("a folder");
    write_all(folder.path(), &models, (Language::C, precision), motion);
    let builds =
        [("gcc", "-std=c99", "c"), ("g++", "-std=c++17", "c++"), ("clang", "-std=c99", "c")];
    for (compiler, standard, language) in builds {
        if exists(compiler) {
            build_c(folder.path(), compiler, standard, language);
            compare(folder.path(), &models, motion, precision);
        }
    }
}

#[test]
fn every_effect_in_rust_gives_the_torque_of_the_predictor() {
    in_rust(&motion(6), Precision::Double);
}

fn in_rust(motion: &[f64], precision: Precision) {
    let models = models();
    let folder = tempfile::tempdir().expect("a folder");
    write_all(folder.path(), &models, (Language::Rust, precision), motion);
    build_rust(folder.path());
    compare(folder.path(), &models, motion, precision);
}

/// So that what differs is the arithmetic.
fn as_32_bits_hold_it(motion: Vec<f64>) -> Vec<f64> {
    motion.into_iter().map(|value| f64::from(value as f32)).collect()
}

#[test]
fn every_effect_in_c_in_32_bits_gives_the_torque_of_the_predictor() {
    in_c(&as_32_bits_hold_it(motion(6)), Precision::Single);
}

#[test]
fn every_effect_in_rust_in_32_bits_gives_the_torque_of_the_predictor() {
    in_rust(&as_32_bits_hold_it(motion(6)), Precision::Single);
}

#[test]
fn code_in_32_bits_computes_with_no_other_numbers_but_times() {
    let terms = vec![term(&by_name("friction_step").expect("of the library"), Site::Joint(1))];
    let model = plain(&puma560()).with_terms(terms, Some(0));
    let code = model.export(&options(
        (Language::C, Precision::Single),
        "arm",
        Purpose::ExpectedMeasurement,
    ));
    let code = code.expect("exports");
    let lines: Vec<&str> = code.lines().skip_while(|line| !line.starts_with("#ifndef")).collect();
    for line in lines.iter().filter(|line| line.contains("double")) {
        let of_time = ["origin", "steps", "time"].iter().any(|word| line.contains(word));
        assert!(of_time, "{line}");
    }
    // Constants without their suffix are of 64 bits, and so is what is computed with them.
    let statements =
        lines.iter().filter(|line| line.contains("const float t") || line.contains("tau["));
    let wide = |word: &&str| word.contains('.') && word.parse::<f64>().is_ok();
    for line in statements.filter(|line| !line.contains("time")) {
        let words = line.split(|c: char| "()*+-/;,= ".contains(c));
        assert_eq!(words.filter(wide).count(), 0, "{line}");
    }
    assert!(code.contains("(float)(time - 1.3)") && code.contains("sinf(q[1])"), "{code}");
}

#[test]
fn code_for_one_robot_has_no_zero_in_it_and_shares_what_it_needs_twice() {
    let robot = two_link();
    let code =
        TorqueModel::nominal(&robot).export(&ExportOptions::new(Language::C)).expect("exports");
    assert_eq!(code.matches("sin(q[1])").count(), 1, "{code}");
    assert!(
        !code.contains("* 0.0") && !code.contains("0.0 *") && !code.contains("1.0 *"),
        "{code}"
    );
    // A planar arm of two joints: gravity, coupling and inertia, and no more.
    let operations =
        code.lines().filter(|line| line.contains("const double t")).flat_map(str::chars);
    let count = operations.filter(|c| "*+-".contains(*c)).count();
    assert!(count < 60, "{count} operations\n{code}");
}

#[test]
fn names_from_strangers_stay_in_their_comment() {
    let table = two_link();
    let names = ["*/ int x = system(\"rm\"); /*", "a\\\n#error \"b\" ??/\u{202e}\r\n"];
    let mut joints = table.joints().to_vec();
    joints.iter_mut().zip(names).for_each(|(joint, name)| joint.name = name.into());
    let robot = Robot::new("*/ arm", joints, table.links().to_vec(), vec![], table.gravity())
        .expect("a robot");
    let model = plain(&robot);
    for language in Language::ALL {
        let code = model
            .export(&options((language, Precision::Double), "arm", Purpose::FeedForward))
            .expect("exports");
        assert!(
            !code.contains("*/ int x") && !code.contains("#error") && !code.contains('\u{202e}'),
            "{code}"
        );
        assert!(!code.contains('\\') && !code.contains("??/"), "{code}");
        let folder = tempfile::tempdir().expect("a folder");
        let one = [("arm".to_string(), model.clone(), Purpose::FeedForward)];
        let motion = motion(2);
        write_all(folder.path(), &one, (language, Precision::Double), &motion);
        match language {
            Language::C => build_c(folder.path(), "gcc", "-std=c99", "c"),
            Language::Rust => build_rust(folder.path()),
        }
        compare(folder.path(), &one, &motion, Precision::Double);
    }
    for name in ["", "a b", "x;", "ä", &"x".repeat(41)] {
        let error = model
            .export(&options((Language::C, Precision::Double), name, Purpose::FeedForward))
            .expect_err("no identifier");
        assert!(matches!(error, ExportError::Name { .. }), "{error}");
    }
}

/// tau = a dq³, as a user writes it.
#[derive(Debug)]
struct OfAUser;

const PARAMETERS: [EffectParameter; 1] = [EffectParameter::signed("a", "N·m·s³/rad³", "N·s³/m³")];

impl Effect for OfAUser {
    fn name(&self) -> &str {
        "cubic_friction"
    }

    fn summary(&self) -> &str {
        "Friction that grows with the cube of the speed."
    }

    fn parameters(&self) -> &[EffectParameter] {
        &PARAMETERS
    }

    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        out[0] = state.dq[joint].powi(3);
    }
}

#[test]
fn what_cannot_be_exported_is_refused_with_its_name() {
    let robot = two_link();
    let effect: Arc<dyn Effect> = Arc::new(OfAUser);
    let model = plain(&robot).with_terms(vec![term(&effect, Site::Joint(0))], Some(0));
    let error = model.export(&ExportOptions::new(Language::C)).expect_err("a user's").to_string();
    assert!(error.contains("cubic_friction") && error.contains("formula"), "{error}");
    let delay = term(&by_name("actuator_lag").expect("of the library"), Site::Arm);
    let model = plain(&robot).with_terms(vec![delay], Some(0));
    let mut of_a_log = ExportOptions::new(Language::Rust);
    of_a_log.stream.purpose = Purpose::ExpectedMeasurement;
    let error = model.export(&of_a_log).expect_err("no rate").to_string();
    assert!(error.contains("actuator_lag") && error.contains("rate_hz"), "{error}");
    assert!(model.export(&ExportOptions::new(Language::Rust)).is_ok());
    let error = model
        .export_to("/nowhere/at/all.h", &ExportOptions::new(Language::C))
        .expect_err("no folder");
    assert!(error.to_string().contains("/nowhere/at/all.h"), "{error}");
    assert!("fortran".parse::<Language>().expect_err("none").to_string().contains("fortran"));
}
