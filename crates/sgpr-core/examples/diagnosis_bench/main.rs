//! Measures the diagnosis on random arms with random hidden effects, noise and rates, half of them under a controller
//! with friction that sticks:
//!
//! `cargo run --release --example diagnosis_bench -- [--seed 1] [--rounds 1] [--only exact|closed|null|pairs|unknown|forms|next]
//! [--effect NAME] [--case SEED] [--rough]`
//!
//! With `--rough` the noise of the torque has a memory and encoders have steps of 0.1 mrad.

mod arm;
mod case;
mod closed_loop;
mod law;

use std::collections::BTreeMap;
use std::time::Instant;

use case::{AMBIGUOUS, CLOSED, Case, SINGLES, Style, make};
use law::{FORMS, UNKNOWN};
use sgpr_core::diagnosis::{Diagnosis, DiagnosisOptions, Finding, Verdict, add, diagnose};
use sgpr_core::model::{IdentifyOptions, TorqueModel, compare, identify};
use sgpr_core::recording::Recording;

type Failure = Box<dyn std::error::Error>;

/// Kinds of cases, and how many there are in a round.
const KINDS: [(&str, usize); 7] = [
    ("exact", SINGLES.len()),
    ("pairs", 10),
    ("null", 6),
    ("closed", CLOSED.len()),
    ("unknown", UNKNOWN.len()),
    ("forms", FORMS.len()),
    ("next", AMBIGUOUS.len()),
];

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
        _ => (vec![AMBIGUOUS[index]], Style::Swinging),
    }
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|k| arguments.get(k + 1));
    let first: u64 = value("--seed").map_or(Ok(1), |text| text.parse())?;
    let rounds: u64 = value("--rounds").map_or(Ok(1), |text| text.parse())?;
    let only = value("--only").map_or("", String::as_str);
    let effect = value("--effect").map(String::as_str);
    let case: Option<u64> = value("--case").map(|text| text.parse()).transpose()?;
    let rough = arguments.iter().any(|argument| argument == "--rough");
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
                let wanted = case.is_none_or(|case| case == seed) && effect.is_none_or(|e| effects.contains(&e));
                if repeated || !wanted {
                    continue;
                }
                let case = make(seed, &effects, style, rough);
                if name == "next" { totals.take_next(&case)? } else { totals.take(&case)? }
            }
        }
    }
    totals.print();
    Ok(())
}

#[derive(Default)]
struct Totals {
    /// Detectable single effects: right effect first, right effect and joint first, among the first three, with others
    /// that are not there, all.
    singles: [usize; 5],
    /// Parameters of effects that are found, alone and first: within a tenth or two standard deviations, all.
    parameters: [usize; 2],
    /// Single effects that are too weak to be seen: silent, all.
    weak: [usize; 2],
    /// Effects hidden together: found, all.
    together: [usize; 2],
    /// Nothing hidden: silent, all.
    nulls: [usize; 2],
    /// Outside of the catalogue: said so, all.
    unknown: [usize; 2],
    /// Where another motion was proposed: first finding right without it, with it, all.
    next: [usize; 3],
    cases: usize,
    false_findings: usize,
    closures: Vec<f64>,
    seconds: Vec<f64>,
    /// (Probability, whether right).
    calibration: Vec<(f64, bool)>,
    /// Hidden -> first finding -> count.
    confusion: BTreeMap<String, BTreeMap<String, usize>>,
}

/// One answer for both: a constant cannot be told from it while the joint moves.
fn plain(effect: &str) -> String {
    effect.replace("asymmetric_coulomb_friction", "torque_offset").replace("cogging_torque", "torque_ripple")
}

/// The model of the user of a case.
fn identified(case: &Case, logs: &[Recording]) -> Result<TorqueModel, Failure> {
    let options = IdentifyOptions { effects: case.known.clone(), ..Default::default() };
    Ok(identify(&case.guess, logs, &options, &())?.0)
}

/// The model of one who is told what is hidden.
fn told(case: &Case, model: &TorqueModel) -> Result<TorqueModel, Failure> {
    let answer = Finding {
        effect: String::new(),
        joints: vec![],
        probability: 1.0,
        score: 0.0,
        parameters: vec![],
        rmse_before: BTreeMap::new(),
        rmse_after: BTreeMap::new(),
        error_gained_percent: 0.0,
        evidence: String::new(),
        confusable_with: vec![],
        separating_experiment: String::new(),
        terms: case.terms(),
    };
    Ok(add(model, &[&answer], &case.train)?)
}

/// The first finding, and whether it is what is hidden.
fn first(case: &Case, diagnosis: &Diagnosis) -> (String, bool) {
    let names: Vec<&str> = case.guess.joint_names().collect();
    let Some(found) = diagnosis.findings.first() else { return ("nothing".into(), false) };
    let (effect, joint) = &case.hidden[0];
    let joint = joint.map(|j| names[j]).into_iter();
    let right = plain(&found.effect) == plain(effect) && joint.eq(found.joints.iter().map(String::as_str));
    (format!("{} {}", found.effect, found.joints.join(" ")), right)
}

/// Parameters of the only effect that is hidden, if it is found first: within a tenth or two standard deviations, all.
fn parameters(case: &Case, diagnosis: &Diagnosis) -> [usize; 2] {
    let Some(found) = diagnosis.findings.first().filter(|found| found.effect == case.hidden[0].0) else {
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
    fn take(&mut self, case: &Case) -> Result<(), Failure> {
        let fit = |logs: &[Recording]| identified(case, logs);
        let model = fit(&case.train)?;
        let clock = Instant::now();
        let diagnosis = diagnose(&model, &case.train, &case.test, &DiagnosisOptions::default(), &())?;
        let seconds = clock.elapsed().as_secs_f64();
        let errors = |model: &TorqueModel, logs: &[Recording]| -> Result<Vec<f64>, Failure> {
            Ok(compare(model, logs, None)?.joints.iter().map(|joint| joint.rmse_full_band).collect())
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
        self.score(case, &diagnosis, detectable, &visible, closure, seconds);
        Ok(())
    }

    /// Records what the diagnosis proposes to record, and asks again.
    fn take_next(&mut self, case: &Case) -> Result<(), Failure> {
        let asked = |train: &[Recording]| -> Result<Diagnosis, Failure> {
            Ok(diagnose(&identified(case, train)?, train, &case.test, &DiagnosisOptions::default(), &())?)
        };
        let before = asked(&case.train)?;
        let Some(motion) = before.next_motion() else {
            println!("  {} {:?}: {}, no motion", case.name, case.hidden, first(case, &before).0);
            return Ok(());
        };
        let end = case.train.last().and_then(|log| log.time().last()).map_or(0.0, |t| *t as f64 * 1e-9);
        let all = [&case.train[..], &[case.record(motion, end + 60.0)]].concat();
        let after = asked(&all)?;
        let [(was, was_right), (is, is_right)] = [first(case, &before), first(case, &after)];
        for (count, right) in self.next.iter_mut().zip([was_right, is_right, true]) {
            *count += usize::from(right);
        }
        let mark = if is_right { '+' } else { '-' };
        println!("{mark} {} {:?}: {was}, then {is}; {} left", case.name, case.hidden, after.next_experiment.len());
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
    ) {
        let names: Vec<&str> = case.guess.joint_names().collect();
        let truth: Vec<(String, Option<&str>)> =
            case.hidden.iter().map(|(effect, joint)| (plain(effect), joint.map(|j| names[j]))).collect();
        let found: Vec<(String, Option<&str>, f64)> = diagnosis
            .findings
            .iter()
            .flat_map(|f| {
                let joints: Vec<Option<&str>> =
                    if f.joints.is_empty() { vec![None] } else { f.joints.iter().map(|j| Some(j.as_str())).collect() };
                joints.into_iter().map(|joint| (plain(&f.effect), joint, f.probability))
            })
            .collect();
        let right = |f: &(String, Option<&str>, f64)| truth.iter().any(|(e, j)| *e == f.0 && *j == f.1);
        let wrong = found.iter().filter(|f| !right(f)).count();
        self.cases += 1;
        self.seconds.push(seconds);
        self.calibration.extend(found.iter().map(|f| (f.2, right(f))));
        let unknown = truth.iter().any(|(effect, _)| effect.starts_with("unknown"));
        if !unknown {
            self.false_findings += wrong;
        }
        let mut mark = ' ';
        if unknown {
            let said = diagnosis.verdict == Verdict::UnexplainedStructure;
            self.unknown[0] += usize::from(said);
            self.unknown[1] += 1;
            mark = if said { '+' } else { '-' };
        } else if truth.is_empty() {
            self.nulls[0] += usize::from(found.is_empty() && diagnosis.verdict == Verdict::NothingMissing);
            self.nulls[1] += 1;
        } else if detectable {
            if truth.len() == 1 {
                let first = found.first();
                let effect = first.is_some_and(|f| f.0 == truth[0].0);
                self.singles[0] += usize::from(effect);
                self.singles[1] += usize::from(first.is_some_and(right));
                self.singles[2] += usize::from(found.iter().take(3).any(right));
                self.singles[3] += usize::from(wrong > 0);
                self.singles[4] += 1;
                let [close, all] = parameters(case, diagnosis);
                self.parameters[0] += close;
                self.parameters[1] += all;
                mark = if first.is_some_and(right) { '+' } else { '-' };
                let row = self.confusion.entry(truth[0].0.clone()).or_default();
                *row.entry(first.map_or("nothing".into(), |f| f.0.clone())).or_default() += 1;
            } else {
                let wanted = || truth.iter().zip(visible).filter(|(_, visible)| **visible);
                let hits = wanted().filter(|(t, _)| found.iter().any(|f| f.0 == t.0 && f.1 == t.1)).count();
                self.together[0] += hits;
                self.together[1] += wanted().count();
                mark = if hits == wanted().count() { '+' } else { '-' };
            }
            self.closures.push(closure);
        } else if truth.len() == 1 {
            self.weak[0] += usize::from(found.is_empty());
            self.weak[1] += 1;
        }
        let place = |joint: &Option<&str>| joint.map_or("", |j| j.trim_start_matches("joint")).to_string();
        let hidden: Vec<String> = truth.iter().map(|(effect, joint)| format!("{effect}{}", place(joint))).collect();
        let told: Vec<String> =
            found.iter().map(|(effect, joint, p)| format!("{effect}{} {p:.2}", place(joint))).collect();
        println!(
            "{mark} {:<13} {:?} [{}] found [{}] {wrong} false, closure {closure:.2}{}, left {:?} {seconds:.1} s",
            case.name,
            diagnosis.verdict,
            hidden.join(", "),
            told.join(", "),
            if detectable { "" } else { " (not detectable)" },
            diagnosis.probability_unexplained,
        );
        if mark == '-' {
            let best = diagnosis.candidates.iter().take(6);
            let list: Vec<String> =
                best.map(|c| format!("{} {} {:.0}", c.effect, c.joints.join(" "), c.score)).collect();
            println!("    most evidence: {}", list.join(", "));
        }
    }

    fn print(&mut self) {
        let share = |[part, all]: [usize; 2]| format!("{part}/{all}");
        let [effect, joint, among, more, all] = self.singles;
        println!("\nsingle effects, right effect first: {}", share([effect, all]));
        println!("single effects, right effect and joint first: {}", share([joint, all]));
        println!("single effects, right effect and joint among the first three: {}", share([among, all]));
        println!("single effects with findings too many: {}", share([more, all]));
        println!("parameters within a tenth or two standard deviations: {}", share(self.parameters));
        println!("single effects that lower no error by a twentieth, and nothing said: {}", share(self.weak));
        println!("two at once, visible ones found: {}", share(self.together));
        println!("nothing hidden and nothing said: {}", share(self.nulls));
        println!("outside of the catalogue and said so: {}", share(self.unknown));
        let [was, is, all] = self.next;
        println!("with a motion proposed, first finding right before and after it: {was}/{all}, {is}/{all}");
        println!("false findings per case: {:.2}", self.false_findings as f64 / self.cases.max(1) as f64);
        let quantile = |values: &mut Vec<f64>, p: f64| {
            values.sort_by(f64::total_cmp);
            values.get(((values.len() as f64 - 1.0) * p).round() as usize).copied().unwrap_or(f64::NAN)
        };
        let [least, tenth, median] = [0.0, 0.1, 0.5].map(|p| quantile(&mut self.closures, p));
        println!("share of the error closed: median {median:.3}, 10 % below {tenth:.3}, least {least:.3}");
        let [median, worst] = [0.5, 1.0].map(|p| quantile(&mut self.seconds, p));
        println!("seconds: median {median:.1}, worst {worst:.1}");
        let count = self.calibration.len().max(1) as f64;
        let miss = |(p, right): &(f64, bool)| p - f64::from(u8::from(*right));
        let brier = self.calibration.iter().map(|found| miss(found).powi(2)).sum::<f64>() / count;
        let of_bin = |bin: usize| self.calibration.iter().filter(move |(p, _)| ((10.0 * p) as usize).min(9) == bin);
        let error = (0..10).map(|bin| of_bin(bin).map(miss).sum::<f64>().abs()).sum::<f64>() / count;
        println!("probabilities of findings: Brier score {brier:.3}, calibration error in ten bins {error:.3}");
        println!("\n| probability | findings | right |\n|---|---|---|");
        for bin in 0..5 {
            let inside = |p: f64| ((5.0 * p) as usize).min(4) == bin;
            let own: Vec<bool> = self.calibration.iter().filter(|(p, _)| inside(*p)).map(|(_, right)| *right).collect();
            let right = own.iter().filter(|right| **right).count();
            println!("| {:.1} to {:.1} | {} | {right} |", 0.2 * bin as f64, 0.2 * (bin + 1) as f64, own.len());
        }
        println!("\n| hidden | first finding |\n|---|---|");
        for (hidden, found) in &self.confusion {
            let list: Vec<String> = found.iter().map(|(name, count)| format!("{name} {count}")).collect();
            println!("| {hidden} | {} |", list.join(", "));
        }
    }
}
