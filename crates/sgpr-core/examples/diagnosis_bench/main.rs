//! Measures the diagnosis on random arms with random hidden effects, noise and rates, some of them
//! under a controller with friction that sticks, and on logs of real arms to whose torque an effect
//! was added:
//!
//! `cargo run --release --example diagnosis_bench -- [--seed 1] [--rounds 1] [--only KIND] [--effect NAME] [--case SEED] [--rough]`
//!
//! Kinds are `exact`, `pairs`, `joint` (two at one joint), `null`, `closed`, `unknown`, `beside`
//! (an unknown law beside a known effect), `forms`, `poor` and `poornull` (short, slowly sampled,
//! noise with a memory), `real` (with `SGPR_DATA`), and `next`. With `--rough` the noise of the
//! torque has a memory and encoders have steps of 0.1 mrad.

mod arm;
mod case;
mod closed_loop;
mod law;
mod real;
#[path = "../../tests/common/real_robot.rs"]
mod real_robot;
mod table;

use std::collections::BTreeMap;
use std::time::Instant;

use case::{AMBIGUOUS, CLOSED, Case, ONE_JOINT, POOR, Quality, SINGLES, Style, make};
use law::{FORMS, UNKNOWN};
use sgpr_core::diagnosis::{Diagnosis, DiagnosisOptions, Finding, Verdict, add, diagnose};
use sgpr_core::model::{IdentifyOptions, TorqueModel, compare, identify};
use sgpr_core::recording::Recording;
use table::{Row, Table};

type Failure = Box<dyn std::error::Error>;

/// Kinds of cases, and how many there are in a round.
const KINDS: [(&str, usize); 11] = [
    ("exact", SINGLES.len()),
    ("pairs", 10),
    ("null", 6),
    ("closed", CLOSED.len()),
    ("unknown", UNKNOWN.len()),
    ("forms", FORMS.len()),
    ("next", AMBIGUOUS.len()),
    ("joint", ONE_JOINT.len()),
    ("beside", UNKNOWN.len()),
    ("poor", POOR.len()),
    ("poornull", 16),
];

/// The same in words.
fn title(kind: &str) -> &str {
    match kind {
        "exact" => "one effect",
        "pairs" => "two effects, two joints",
        "joint" => "two effects at one joint",
        "null" => "nothing hidden",
        "closed" => "one effect, under a controller",
        "unknown" => "a law of no catalogue",
        "beside" => "such a law, and an effect",
        "forms" => "an effect in another form",
        "poor" => "one effect, poor logs",
        "poornull" => "nothing hidden, poor logs",
        other => other,
    }
}

/// What is hidden in a case, and how its arm moves.
fn hidden(kind: &str, index: usize, seed: u64) -> (Vec<&'static str>, Style) {
    match kind {
        "exact" => (vec![SINGLES[index]], Style::Exact),
        "pairs" => {
            let (k, count) = (seed as usize, SINGLES.len() - 1);
            (vec![SINGLES[(7 * k + 3) % count], SINGLES[(11 * k + 8) % count]], Style::Exact)
        }
        "null" => (vec![], if index % 2 == 1 { Style::Closed } else { Style::Exact }),
        "closed" => (vec![CLOSED[index]], Style::Closed),
        "unknown" => (vec![UNKNOWN[index].name], Style::Exact),
        "forms" => (vec![FORMS[index].name], Style::Exact),
        "joint" => (ONE_JOINT[index].to_vec(), Style::OneJoint),
        "beside" => (vec![UNKNOWN[index].name, POOR[index]], Style::Exact),
        "poor" => (vec![POOR[index]], Style::Exact),
        "poornull" => (vec![], Style::Exact),
        _ => (vec![AMBIGUOUS[index]], Style::Swinging),
    }
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value =
        |name: &str| arguments.iter().position(|a| a == name).and_then(|k| arguments.get(k + 1));
    let first: u64 = value("--seed").map_or(Ok(1), |text| text.parse())?;
    let rounds: u64 = value("--rounds").map_or(Ok(1), |text| text.parse())?;
    let only = value("--only").map_or("", String::as_str);
    let effect = value("--effect").map(String::as_str);
    let case: Option<u64> = value("--case").map(|text| text.parse()).transpose()?;
    let rough = arguments.iter().any(|argument| argument == "--rough");
    let quality = |kind: &str| match (kind, rough) {
        ("poor" | "poornull", _) => Quality::Poor,
        (_, true) => Quality::Rough,
        _ => Quality::Good,
    };
    let mut totals = Totals::default();
    for round in 0..rounds {
        for (kind, (name, count)) in (0..).zip(KINDS) {
            if name != only && (!only.is_empty() || name == "next") {
                continue;
            }
            for index in 0..count {
                let seed = first + 1000 * round + 100_000 * kind + index as u64;
                let (effects, style) = hidden(name, index, seed);
                let repeated = effects.len() == 2 && effects[0] == effects[1];
                let wanted = case.is_none_or(|case| case == seed)
                    && effect.is_none_or(|e| effects.contains(&e));
                if repeated || !wanted {
                    continue;
                }
                let case = make(seed, &effects, style, quality(name));
                if name == "next" {
                    totals.take_next(&case)?
                } else {
                    totals.take(title(name), &case)?
                }
            }
        }
    }
    if only.is_empty() || only == "real" {
        for robot in real::ROBOTS {
            let effect = effect.filter(|_| only == "real");
            // Without logs the reason is said.
            if let Some(row) = real::row(robot, first, rounds, effect)? {
                totals.table.add(&format!("one effect, added to real logs: {robot}"), row);
            }
        }
    }
    totals.print();
    Ok(())
}

#[derive(Default)]
struct Totals {
    table: Table,
    /// Parameters of effects that are found, alone and first: within a tenth or two standard
    /// deviations, all.
    parameters: [usize; 2],
    /// Where another motion was proposed: first finding right without it, with it, all.
    next: [usize; 3],
    /// Hidden -> first finding -> count.
    confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// One answer for both: a constant cannot be told from it while the joint moves.
fn plain(effect: &str) -> String {
    effect
        .replace("asymmetric_coulomb_friction", "torque_offset")
        .replace("cogging_torque", "torque_ripple")
}

/// The model of the user of a case.
fn identified(case: &Case, logs: &[Recording]) -> Result<TorqueModel, Failure> {
    let options = IdentifyOptions::default().with_effects(case.known.clone());
    Ok(identify(&case.guess, logs, &options, &())?.0)
}

/// The model of one who is told what is hidden.
fn told(case: &Case, model: &TorqueModel) -> Result<TorqueModel, Failure> {
    Ok(add(model, &[&Finding::of_terms(case.terms())], &case.train)?)
}

/// The first finding, and whether it is what is hidden.
fn first(case: &Case, diagnosis: &Diagnosis) -> (String, bool) {
    let names: Vec<&str> = case.guess.joint_names().collect();
    let Some(found) = diagnosis.findings.first() else { return ("nothing".into(), false) };
    let (effect, joint) = &case.hidden[0];
    let joint = joint.map(|j| names[j]).into_iter();
    let right =
        plain(&found.effect) == plain(effect) && joint.eq(found.joints.iter().map(String::as_str));
    (format!("{} {}", found.effect, found.joints.join(" ")), right)
}

/// Parameters of the only effect that is hidden, if it is found first: within a tenth or two
/// standard deviations, all.
fn parameters(case: &Case, diagnosis: &Diagnosis) -> [usize; 2] {
    let Some(found) = diagnosis.findings.first().filter(|found| found.effect == case.hidden[0].0)
    else {
        return [0; 2];
    };
    let truth = case.parameters();
    let close = found.parameters.iter().zip(&truth).filter(|(found, truth)| {
        let off = (found.value - **truth).abs();
        off <= (0.1 * truth.abs()).max(2.0 * found.std.unwrap_or_default())
    });
    [close.count(), truth.len()]
}

impl Totals {
    fn take(&mut self, kind: &str, case: &Case) -> Result<(), Failure> {
        let fit = |logs: &[Recording]| identified(case, logs);
        let model = fit(&case.train)?;
        let clock = Instant::now();
        let diagnosis =
            diagnose(&model, &case.train, &case.test, &DiagnosisOptions::default(), &())?;
        let seconds = clock.elapsed().as_secs_f64();
        let errors = |model: &TorqueModel, logs: &[Recording]| -> Result<Vec<f64>, Failure> {
            Ok(compare(model, logs, None)?
                .joints
                .iter()
                .map(|joint| joint.rmse_full_band)
                .collect())
        };
        let floor = if case.closed && !case.hidden.is_empty() {
            errors(&told(case, &model)?, &case.test)?
        } else {
            errors(&fit(&case.twin_train)?, &case.twin_test)?
        };
        let (before, after) = (errors(&model, &case.test)?, errors(&diagnosis.after, &case.test)?);
        let excess = |e: &[f64]| e.iter().zip(&floor).map(|(e, f)| (e - f) / f).sum::<f64>();
        let worse = |errors: &[f64]| errors.iter().zip(&floor).any(|(b, f)| b - f > 0.05 * f);
        let mut visible = Vec::new();
        for logs in &case.alone {
            visible.push(match logs {
                Some([train, test]) => worse(&errors(&fit(train)?, test)?),
                None => true,
            });
        }
        let detectable = worse(&before);
        let closure = (excess(&before) - excess(&after)) / excess(&before).max(1e-9);
        let row = self.score(case, &diagnosis, detectable, &visible, closure, seconds);
        self.table.add(kind, row);
        Ok(())
    }

    /// Records what the diagnosis proposes to record, and asks again.
    fn take_next(&mut self, case: &Case) -> Result<(), Failure> {
        let asked = |train: &[Recording]| -> Result<Diagnosis, Failure> {
            Ok(diagnose(
                &identified(case, train)?,
                train,
                &case.test,
                &DiagnosisOptions::default(),
                &(),
            )?)
        };
        let before = asked(&case.train)?;
        let Some(motion) = before.next_motion() else {
            println!("  {} {:?}: {}, no motion", case.name, case.hidden, first(case, &before).0);
            return Ok(());
        };
        let end =
            case.train.last().and_then(|log| log.time().last()).map_or(0.0, |t| *t as f64 * 1e-9);
        let all = [&case.train[..], &[case.record(motion, end + 60.0)]].concat();
        let after = asked(&all)?;
        let [(was, was_right), (is, is_right)] = [first(case, &before), first(case, &after)];
        for (count, right) in self.next.iter_mut().zip([was_right, is_right, true]) {
            *count += usize::from(right);
        }
        let mark = if is_right { '+' } else { '-' };
        println!(
            "{mark} {} {:?}: {was}, then {is}; {} left",
            case.name,
            case.hidden,
            after.next_experiment.len()
        );
        for one in &before.next_experiment {
            let (now, then) = (one.separation_now, one.separation_expected);
            println!("    {}: {now:.0} to {then:.0}, {}", one.about.join(", "), one.experiment);
        }
        Ok(())
    }

    fn score(
        &mut self,
        case: &Case,
        diagnosis: &Diagnosis,
        detectable: bool,
        visible: &[bool],
        closure: f64,
        seconds: f64,
    ) -> Row {
        let names: Vec<&str> = case.guess.joint_names().collect();
        let truth: Vec<(String, Option<&str>)> = case
            .hidden
            .iter()
            .map(|(effect, joint)| (plain(effect), joint.map(|j| names[j])))
            .collect();
        let found: Vec<(String, Option<&str>, f64)> = diagnosis
            .findings
            .iter()
            .flat_map(|f| {
                let joints: Vec<Option<&str>> = if f.joints.is_empty() {
                    vec![None]
                } else {
                    f.joints.iter().map(|j| Some(j.as_str())).collect()
                };
                joints.into_iter().map(|joint| (plain(&f.effect), joint, f.probability))
            })
            .collect();
        let is =
            |f: &(String, Option<&str>, f64), t: &(String, Option<&str>)| t.0 == f.0 && t.1 == f.1;
        let right = |f: &(String, Option<&str>, f64)| truth.iter().any(|t| is(f, t));
        let unknown = truth.iter().any(|(effect, _)| effect.starts_with("unknown"));
        let is_wanted = |k: usize| {
            let seen = if truth.len() == 1 { detectable } else { visible[k] };
            seen && !truth[k].0.starts_with("unknown")
        };
        let wanted: Vec<usize> = (0..truth.len()).filter(|k| is_wanted(*k)).collect();
        let hits = wanted.iter().filter(|k| found.iter().any(|f| is(f, &truth[**k]))).count();
        let silent = found.is_empty() && diagnosis.verdict == Verdict::NothingMissing;
        let mut row = Row {
            cases: 1,
            wanted: wanted.len(),
            found: hits,
            first: usize::from(!wanted.is_empty() && found.first().is_some_and(right)),
            asked_first: usize::from(!wanted.is_empty()),
            wrong: found.iter().filter(|f| !right(f)).count(),
            seconds: vec![seconds],
            probabilities: found.iter().map(|f| (f.2, right(f))).collect(),
            ..Row::default()
        };
        if unknown || truth.is_empty() {
            row.to_be_said = 1;
            row.said = usize::from(if unknown {
                diagnosis.probability_unexplained >= 0.5
            } else {
                silent
            });
        }
        if !wanted.is_empty() {
            row.closed.push(closure);
        }
        if truth.len() == 1 && !wanted.is_empty() {
            let [close, all] = parameters(case, diagnosis);
            self.parameters[0] += close;
            self.parameters[1] += all;
            let first = found.first().map_or("nothing".into(), |f| f.0.clone());
            *self.confusion.entry(truth[0].0.clone()).or_default().entry(first).or_default() += 1;
        }
        let well = row.found == row.wanted && row.said == row.to_be_said;
        let mark = if well { '+' } else { '-' };
        let place =
            |joint: &Option<&str>| joint.map_or("", |j| j.trim_start_matches("joint")).to_string();
        let hidden: Vec<String> =
            truth.iter().map(|(effect, joint)| format!("{effect}{}", place(joint))).collect();
        let told: Vec<String> = found
            .iter()
            .map(|(effect, joint, p)| format!("{effect}{} {p:.2}", place(joint)))
            .collect();
        println!(
            "{mark} {:<13} {:?} [{}] found [{}] {} false, closure {closure:.2}{}, left {:?} \
             {seconds:.1} s",
            case.name,
            diagnosis.verdict,
            hidden.join(", "),
            told.join(", "),
            row.wrong,
            if detectable { "" } else { " (not detectable)" },
            diagnosis.probability_unexplained,
        );
        if !well {
            let best = diagnosis.candidates.iter().take(6);
            let list: Vec<String> = best
                .map(|c| format!("{} {} {:.0}", c.effect, c.joints.join(" "), c.score))
                .collect();
            println!("    most evidence: {}", list.join(", "));
        }
        row
    }

    fn print(&self) {
        println!("\n{}", self.table);
        let [close, all] = self.parameters;
        println!(
            "parameters of effects found first, within a tenth or two standard deviations: \
             {close}/{all}"
        );
        let [was, is, all] = self.next;
        println!(
            "with a motion proposed, first finding right before and after it: {was}/{all}, \
             {is}/{all}"
        );
        println!("\n| hidden | first finding |\n|---|---|");
        for (hidden, found) in &self.confusion {
            let list: Vec<String> =
                found.iter().map(|(name, count)| format!("{name} {count}")).collect();
            println!("| {hidden} | {} |", list.join(", "));
        }
    }
}
