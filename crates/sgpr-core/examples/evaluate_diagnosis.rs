//! Diagnoses every case of a folder of logs with a hidden effect and compares with the answers:
//!
//! `cargo run --release --example evaluate_diagnosis -- FOLDER [CASE...]`

use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use sgpr_core::diagnosis::{Diagnosis, DiagnosisOptions, Verdict, diagnose};
use sgpr_core::model::{IdentifyOptions, TorqueModel, compare, identify};
use sgpr_core::motion::Motion;
use sgpr_core::progress::{Interrupted, Progress};
use sgpr_core::recording::{Recording, csv};
use sgpr_core::robot::{Robot, UrdfOptions};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("which folder?")?;
    let wanted: Vec<String> = arguments.collect();
    let mut cases: Vec<String> = std::fs::read_dir(&folder)?
        .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
        .filter(|name| Path::new(&folder).join(name).join("case.json").exists())
        .filter(|name| wanted.is_empty() || wanted.contains(name))
        .collect();
    cases.sort();
    let mut totals = Totals::default();
    for case in &cases {
        run(Path::new(&folder), case, &mut totals)?;
    }
    totals.print();
    Ok(())
}

#[derive(Default)]
struct Totals {
    singles: f64,
    first_right: f64,
    f1: Vec<f64>,
    clean: f64,
    clean_right: f64,
    cases: f64,
    extras: f64,
    unknown: f64,
    unknown_right: f64,
    closures: Vec<f64>,
    seconds: Vec<f64>,
    /// (Probability, right) of every finding.
    calibration: Vec<(f64, bool)>,
}

impl Totals {
    fn print(&mut self) {
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        self.closures.sort_by(f64::total_cmp);
        let quantile =
            |v: &[f64], p: f64| v.get(((v.len() as f64 - 1.0) * p).round() as usize).copied();
        println!(
            "first finding right on detectable singles: {}/{}",
            self.first_right, self.singles
        );
        println!("F1 over (effect, joint): {:.3}", mean(&self.f1));
        println!("clean and silent: {}/{}", self.clean_right, self.clean);
        println!("false findings per case: {:.2}", self.extras / self.cases);
        println!("unknown said so: {}/{}", self.unknown_right, self.unknown);
        println!(
            "closure: median {:.3?}, 10 % {:.3?}, worst {:.3?}",
            quantile(&self.closures, 0.5),
            quantile(&self.closures, 0.1),
            self.closures.first()
        );
        let brier =
            self.calibration.iter().map(|(p, right)| (p - f64::from(u8::from(*right))).powi(2));
        println!("Brier score of the findings: {:.3}", mean(&brier.collect::<Vec<_>>()));
        self.seconds.sort_by(f64::total_cmp);
        println!(
            "seconds: median {:.2?}, worst {:.2?}",
            quantile(&self.seconds, 0.5),
            self.seconds.last()
        );
    }
}

fn strings(value: &serde_json::Value) -> Vec<String> {
    value
        .as_array()
        .map(|a| a.iter().filter_map(|v| Some(v.as_str()?.to_string())).collect())
        .unwrap_or_default()
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value
        .as_array()
        .map(|a| a.iter().filter_map(serde_json::Value::as_f64).collect())
        .unwrap_or_default()
}

fn run(folder: &Path, case: &str, totals: &mut Totals) -> Result<(), Failure> {
    let at = folder.join(case);
    let json = |path: &Path| -> Result<serde_json::Value, Failure> {
        Ok(serde_json::from_str(&std::fs::read_to_string(path)?)?)
    };
    let info = json(&at.join("case.json"))?;
    let answer = json(&folder.join("answers").join(format!("{case}.json")))?;
    let robot = Robot::from_urdf(at.join("robot.urdf"), &UrdfOptions::default())?;
    let columns = csv::ReadOptions::default()
        .with_joints(Some(robot.joint_names().map(String::from).collect()));
    let read = |names: &serde_json::Value| -> Result<Vec<Recording>, Failure> {
        strings(names).iter().map(|name| Ok(csv::read(at.join(name), &columns)?)).collect()
    };
    let (train, test) = (read(&info["train"])?, read(&info["test"])?);
    let options = IdentifyOptions::default().with_effects(strings(&info["model_effects"]));
    let (model, _) = identify(&robot, &train, &options, &())?;
    let clock = Instant::now();
    let stages = Stages::default();
    let diagnosis = diagnose(&model, &train, &test, &DiagnosisOptions::default(), &stages)?;
    let seconds = clock.elapsed().as_secs_f64();

    let names: Vec<String> = robot.joint_names().map(String::from).collect();
    let whole_arm =
        ["payload_change", "base_tilt", "torque_delay", "external_contact", "link_length_error"];
    let truth: Vec<(String, String)> = answer["hidden"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|hidden| {
            let effect = hidden["effect"].as_str().unwrap_or_default().to_string();
            let joint = hidden["joint"]
                .as_u64()
                .map(|j| names[j as usize].clone())
                .filter(|_| !whole_arm.contains(&&*effect));
            (
                effect.replace("asymmetric_coulomb_friction", "torque_offset"),
                joint.unwrap_or_default(),
            )
        })
        .collect();
    let found: Vec<(String, String, f64)> = diagnosis
        .findings
        .iter()
        .flat_map(|f| {
            let joints = if f.joints.is_empty() { vec![String::new()] } else { f.joints.clone() };
            let effect = f.effect.replace("asymmetric_coulomb_friction", "torque_offset");
            joints.into_iter().map(move |joint| (effect.clone(), joint, f.probability))
        })
        .collect();
    let after = errors(&diagnosis.after, &test)?;
    let before = errors(&model, &test)?;
    let (noise, base, oracle) = (
        numbers(&answer["noise_rmse"]),
        numbers(&answer["base_rmse"]),
        numbers(&answer["oracle_rmse"]),
    );
    let transform = base == oracle && !truth.is_empty();
    let floor = if transform { noise.clone() } else { oracle.clone() };
    let weight: Vec<f64> = noise.iter().map(|n| 1.0 / n).collect();
    let excess =
        |e: &[f64]| e.iter().zip(&floor).zip(&weight).map(|((e, f), w)| (e - f) * w).sum::<f64>();
    let detectable = before.iter().zip(&floor).zip(&noise).any(|((b, f), n)| b - f > 0.05 * n);
    let closure = excess_ratio(excess(&before), excess(&after));
    let hits =
        found.iter().filter(|(e, j, _)| truth.iter().any(|(te, tj)| te == e && tj == j)).count();
    let false_effects: Vec<&(String, String, f64)> =
        found.iter().filter(|(e, j, _)| !truth.iter().any(|(te, tj)| te == e && tj == j)).collect();
    let unknown = truth.iter().any(|(effect, _)| effect.starts_with("unknown"));
    totals.cases += 1.0;
    totals.seconds.push(seconds);
    totals.extras += false_effects.len() as f64;
    let first = found.first().map(|(e, j, _)| (e.clone(), j.clone()));
    let first_right = first.as_ref().is_some_and(|f| truth.contains(f));
    for (e, j, p) in &found {
        totals.calibration.push((*p, truth.iter().any(|(te, tj)| te == e && tj == j)));
    }
    if unknown {
        totals.unknown += 1.0;
        totals.unknown_right += f64::from(diagnosis.verdict == Verdict::UnexplainedStructure);
    } else if truth.is_empty() {
        totals.clean += 1.0;
        totals.clean_right += f64::from(diagnosis.verdict == Verdict::NothingMissing);
    } else {
        if truth.len() == 1 && detectable {
            totals.singles += 1.0;
            totals.first_right += f64::from(first_right);
        }
        if detectable {
            totals.f1.push(2.0 * hits as f64 / (truth.len() + found.len()) as f64);
            totals.closures.push(closure);
        }
    }
    let show = |list: &[(String, String)]| {
        list.iter()
            .map(|(e, j)| format!("{e}@{}", j.trim_start_matches("joint_")))
            .collect::<Vec<_>>()
            .join(" ")
    };
    let found_list: Vec<(String, String)> =
        found.iter().map(|(e, j, _)| (e.clone(), j.clone())).collect();
    let mark = if truth.is_empty() || unknown {
        ' '
    } else if first_right {
        '+'
    } else {
        '-'
    };
    println!(
        "{mark} {case} {:?} truth [{}] found [{}] {} false, closure {closure:.2}{}, unseen {:.2} \
         to {:.2} %, {seconds:.1} s",
        diagnosis.verdict,
        show(&truth),
        show(&found_list),
        false_effects.len(),
        if detectable { "" } else { " (not detectable)" },
        unseen_percent(&model, &model, &test)?,
        unseen_percent(&model, &diagnosis.after, &test)?
    );
    if std::env::var_os("SGPR_VERBOSE").is_some() {
        describe(&diagnosis, &before, &after, &floor, &noise);
        stages.print();
    }
    Ok(())
}

/// Seconds by stage.
#[derive(Default)]
struct Stages(Mutex<Vec<(&'static str, f64, Instant)>>);

impl Progress for Stages {
    fn step(&self, stage: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        let mut all = self.0.lock().expect("nobody panics while holding it");
        let now = Instant::now();
        if let Some(last) = all.last().map(|(_, _, at)| *at) {
            let name = all.last().map_or("", |(name, ..)| *name);
            if let Some(sum) = all.iter_mut().find(|(own, ..)| *own == name) {
                sum.1 += (now - last).as_secs_f64();
            }
        }
        if let Some(index) = all.iter().position(|(own, ..)| *own == stage) {
            let own = all.remove(index);
            all.push((own.0, own.1, now));
        } else {
            all.push((stage, 0.0, now));
        }
        Ok(())
    }
}

impl Stages {
    fn print(&self) {
        let all = self.0.lock().expect("nobody panics while holding it");
        let list: Vec<String> =
            all.iter().map(|(stage, seconds, _)| format!("{stage} {seconds:.1}")).collect();
        let rest = all.last().map_or(0.0, |(_, _, at)| at.elapsed().as_secs_f64());
        println!("    seconds: {}, then {rest:.1}", list.join(", "));
    }
}

/// Error on the test logs in percent of the torque, both as `model` processes them.
fn unseen_percent(
    model: &TorqueModel,
    judged: &TorqueModel,
    test: &[Recording],
) -> Result<f64, Failure> {
    Ok(compare(judged, test, model.processing())?.relative_error_percent)
}

fn excess_ratio(before: f64, after: f64) -> f64 {
    if before.abs() < 1e-9 { 0.0 } else { (before - after) / before }
}

fn describe(diagnosis: &Diagnosis, before: &[f64], after: &[f64], floor: &[f64], noise: &[f64]) {
    println!(
        "    before {before:.3?}\n    after  {after:.3?}\n    floor  {floor:.3?}\n    noise  {noise:.3?}"
    );
    println!(
        "    nothing {:.2} unexplained {:.2} {:?}",
        diagnosis.probability_nothing_missing,
        diagnosis.probability_unexplained,
        diagnosis.unexplained
    );
    for f in &diagnosis.findings {
        let parameters: Vec<String> = f
            .parameters
            .iter()
            .map(|p| format!("{} {:.4} ({:.4})", p.name, p.value, p.std.unwrap_or(f64::NAN)))
            .collect();
        println!(
            "    {} {:?} P {:.2} score {:.0} | {}",
            f.effect,
            f.joints,
            f.probability,
            f.score,
            parameters.join(", ")
        );
    }
}

/// Root mean square of logged minus predicted torque per joint, without the first and last 0.3 s.
fn errors(model: &TorqueModel, test: &[Recording]) -> Result<Vec<f64>, Failure> {
    let n = model.robot().dof();
    let processing = model.processing().ok_or("an identified model")?;
    let mut sums = vec![0.0; n];
    let mut count = 0.0;
    for recording in test {
        for motion in Motion::from_recording(recording, processing)? {
            let predicted = model.predict_motion(&motion);
            let tau = motion.tau.as_ref().ok_or("torque")?;
            let edge = (0.3 * motion.rate_hz) as usize;
            for k in edge..motion.len() - edge {
                for joint in 0..n {
                    sums[joint] += (tau[k * n + joint] - predicted[k * n + joint]).powi(2);
                }
                count += 1.0;
            }
        }
    }
    Ok(sums.into_iter().map(|s: f64| (s / count).sqrt()).collect())
}
