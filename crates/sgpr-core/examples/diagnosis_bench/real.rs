//! Logs of real arms to whose torque an effect is added: real noise, a model that lacks much, and
//! one thing that is known.

use std::f64::consts::SQRT_2;
use std::time::Instant;

use sgpr_core::diagnosis::{Diagnosis, DiagnosisOptions, Finding, add, diagnose};
use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{IdentifyOptions, Term, TorqueModel, compare, identify};
use sgpr_core::motion::Motion;
use sgpr_core::recording::{Recording, Repair, Resample};

use crate::Failure;
use crate::arm::Random;
use crate::real_robot::{Case, folder};
use crate::table::Row;

/// Folders of the logs (`docs/real-data.md`).
pub const ROBOTS: [&str; 4] = ["ur10e", "panda", "baxter", "kuka_lwr"];

/// What is added, at a joint.
const ADDED: [&str; 8] = [
    "cable_stiffness",
    "torque_ripple",
    "quadratic_viscous_friction",
    "stribeck_friction",
    "asymmetric_viscous_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "torque_gain_error",
];

/// Names that mean the same torque.
const ALIKE: [[&str; 2]; 3] = [
    ["cable_stiffness", "spring_balancer"],
    ["torque_ripple", "cogging_torque"],
    ["quadratic_viscous_friction", "nonlinear_viscous_friction"],
];

impl Case {
    fn identify(&self) -> Result<TorqueModel, Failure> {
        Ok(identify(&self.robot, &self.train, &IdentifyOptions::default(), &())?.0)
    }

    /// The same with the torque of a term.
    fn with(&self, model: &TorqueModel, term: &Term) -> Result<Self, Failure> {
        let with = model.clone().with_terms(vec![term.clone()], None);
        let added = |log: &Recording| -> Result<Recording, Failure> {
            let processing = model.processing().ok_or("not identified")?;
            let motions = Motion::from_recording(log, processing)?;
            let [motion] = &motions[..] else {
                return Err(format!("{} has gaps", log.source()).into());
            };
            let torques = with.predict_motion(motion).into_iter().zip(model.predict_motion(motion));
            let measured = log.torque().ok_or("no torque")?.iter();
            let tau =
                measured.zip(torques).map(|(tau, (with, without))| tau + with - without).collect();
            let (names, time) = (log.joint_names().to_vec(), log.time().to_vec());
            Ok(Recording::new(
                log.source(),
                names,
                time,
                log.position().to_vec(),
                None,
                Some(tau),
                vec![],
            )?)
        };
        let all = |logs: &[Recording]| logs.iter().map(&added).collect::<Result<Vec<_>, _>>();
        Ok(Self { robot: self.robot.clone(), train: all(&self.train)?, test: all(&self.test)? })
    }
}

/// Findings as effect and joint.
fn named(diagnosis: &Diagnosis) -> Vec<(String, String, f64)> {
    let of =
        |f: &sgpr_core::diagnosis::Finding| (f.effect.clone(), f.joints.join(" "), f.probability);
    diagnosis.findings.iter().map(of).collect()
}

fn is_alike(found: &str, added: &str) -> bool {
    found == added || ALIKE.iter().any(|pair| pair.contains(&found) && pair.contains(&added))
}

/// The figures of a robot; none without its logs. Each effect is added once a round, with one or
/// two times the error that the identified model leaves at the joint. Findings that the logs have
/// without it are neither right nor wrong, and an effect that does not raise the error on unseen
/// logs by a twentieth is not asked.
pub fn row(
    robot: &str,
    seed: u64,
    rounds: u64,
    only: Option<&str>,
) -> Result<Option<Row>, Failure> {
    let Some(folder) = folder(robot) else { return Ok(None) };
    let even = Repair::default().with_resample(Some(Resample::MedianRate));
    let logs = Case::read(&folder, &even);
    let model = logs.identify()?;
    let errors = |model: &TorqueModel, logs: &[Recording]| -> Result<Vec<f64>, Failure> {
        Ok(compare(model, logs, None)?.joints.iter().map(|joint| joint.rmse).collect())
    };
    let own = errors(&model, &logs.train)?;
    let untouched = diagnose(&model, &logs.train, &logs.test, &DiagnosisOptions::default(), &())?;
    let (base, floor) = (named(&untouched), errors(&untouched.after, &logs.test)?);
    let mut row = Row::default();
    for round in 0..rounds {
        for (index, effect) in ADDED
            .into_iter()
            .enumerate()
            .filter(|(_, effect)| only.is_none_or(|only| only == *effect))
        {
            let mut random = Random(
                (seed + 1000 * round + index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5EA1,
            );
            let joint = random.below(logs.robot.dof());
            let level = 1.0 + (index % 2) as f64;
            let Some(term) = term(effect, joint, level * own[joint], (&model, &logs), &mut random)?
            else {
                continue;
            };
            let changed = logs.with(&model, &term)?;
            let bare = changed.identify()?;
            let clock = Instant::now();
            let diagnosis =
                diagnose(&bare, &changed.train, &changed.test, &DiagnosisOptions::default(), &())?;
            let seconds = clock.elapsed().as_secs_f64();
            let name = logs.robot.joint_names().nth(joint).unwrap_or_default();
            let found = named(&diagnosis);
            let was = |f: &(String, String, f64)| base.iter().any(|b| b.0 == f.0 && b.1 == f.1);
            let is = |f: &(String, String, f64)| is_alike(&f.0, effect) && f.1 == name && !was(f);
            let new: Vec<&(String, String, f64)> = found.iter().filter(|f| !was(f)).collect();
            let gone =
                base.iter().filter(|b| !found.iter().any(|f| b.0 == f.0 && b.1 == f.1)).count();
            let (before, after) =
                (errors(&bare, &changed.test)?, errors(&diagnosis.after, &changed.test)?);
            // What the logs have already, or the parameters of the model take up, is not asked.
            let told = errors(
                &add(&bare, &[&Finding::of_terms(vec![term.clone()])], &changed.train)?,
                &changed.test,
            )?;
            let there = base.iter().any(|b| is_alike(&b.0, effect) && b.1 == name);
            let wanted =
                usize::from(!there && before.iter().zip(&told).any(|(b, t)| b - t > 0.05 * t));
            let excess =
                |errors: &[f64]| errors.iter().zip(&floor).map(|(e, f)| (e - f) / f).sum::<f64>();
            let closed = (excess(&before) - excess(&after)) / excess(&before).max(1e-9);
            println!(
                "{} {robot} {effect} {name} {level:.0}{}: new {:?}, {gone} gone, closed \
                 {closed:.2}, {seconds:.1} s",
                if found.iter().any(is) { '+' } else { '-' },
                if wanted == 1 { "" } else { " (not detectable)" },
                new.iter().map(|f| format!("{} {} {:.2}", f.0, f.1, f.2)).collect::<Vec<_>>()
            );
            row.add(Row {
                cases: 1,
                wanted,
                found: wanted * usize::from(found.iter().any(is)),
                asked_first: wanted,
                first: wanted * usize::from(new.first().is_some_and(|f| is(f))),
                wrong: new.iter().filter(|f| !is(f)).count(),
                gone,
                closed: vec![closed],
                seconds: vec![seconds],
                probabilities: new.iter().map(|f| (f.2, is(f))).collect(),
                ..Row::default()
            });
        }
    }
    Ok(Some(row))
}

/// An effect at a joint whose torque has this root mean square in the training logs, N·m; none if
/// the joint does not show it.
fn term(
    effect: &str,
    joint: usize,
    size: f64,
    (model, logs): (&TorqueModel, &Case),
    random: &mut Random,
) -> Result<Option<Term>, Failure> {
    let n = logs.robot.dof();
    let column = |values: &dyn Fn(&Recording) -> Option<Vec<f64>>| -> Vec<f64> {
        logs.train
            .iter()
            .filter_map(values)
            .flat_map(|v| v.into_iter().skip(joint).step_by(n))
            .collect()
    };
    let (q, tau) = (
        column(&|log| Some(log.position().to_vec())),
        column(&|log| log.torque().map(<[f64]>::to_vec)),
    );
    let [low, high] =
        [f64::min, f64::max].map(|of| q.iter().copied().reduce(of).unwrap_or_default());
    let rms = (tau.iter().map(|tau| tau * tau).sum::<f64>() / tau.len().max(1) as f64).sqrt();
    let constants = match effect {
        "stribeck_friction" => vec![random.logarithmic(0.02, 0.1)],
        "torque_ripple" => vec![random.between(6.0, 30.0).round()],
        "position_dependent_friction" => {
            vec![
                random.between(low + 0.25 * (high - low), high - 0.25 * (high - low)),
                0.1 * (high - low),
            ]
        }
        "torque_gain_error" => vec![random.sign() * size / rms],
        _ => vec![],
    };
    let mut term = Term::new(by_name(effect)?, Site::Joint(joint), constants);
    if term.coefficients.is_empty() {
        return Ok(Some(term));
    }
    let positive: Vec<bool> = term.effect.parameters().iter().map(|p| p.non_negative).collect();
    for (value, positive) in term.coefficients.iter_mut().zip(positive) {
        *value = if positive { 1.0 } else { random.sign() } / SQRT_2;
    }
    let added = logs.with(model, &term)?;
    let squares = |logs: &[Recording], others: &[Recording]| -> f64 {
        let pairs = logs.iter().zip(others).filter_map(|(a, b)| Some((a.torque()?, b.torque()?)));
        pairs
            .map(|(a, b)| {
                a.iter().zip(b).skip(joint).step_by(n).map(|(a, b)| (a - b).powi(2)).sum::<f64>()
            })
            .sum()
    };
    let now = (squares(&added.train, &logs.train) / q.len().max(1) as f64).sqrt();
    if now < 1e-9 {
        return Ok(None);
    }
    term.coefficients.iter_mut().for_each(|value| *value *= size / now);
    Ok(Some(term))
}
