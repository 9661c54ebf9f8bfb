//! Which physical effect a model lacks.
//!
//! [`diagnose`] takes a model and the logs it was identified from, and asks of every effect of the catalogue how much of
//! the leftover torque it explains after projection on what the model can take up by itself. What stands is fitted
//! jointly, must lower the error on blocks of time that were left out, and is given a probability. The method is described
//! in `docs/diagnosis.md`.

mod basis;
mod calibration;
mod fit;
mod problem;
mod search;
mod unknown;
mod whereabouts;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use whereabouts::{Excess, Whereabouts};

use crate::effects::{self, Effect, Entry, Site};
use crate::model::{IdentifyError, Term, TorqueModel, compare};
use crate::motion::{MotionError, Processing};
use crate::progress::{Interrupted, Progress};
use crate::recording::{Recording, RecordingError};
use fit::{Fitted, held_out, with_deviations};
use problem::Problem;
use search::{Accepted, Candidate, Search};

/// What to look for.
#[derive(Clone, Debug)]
pub struct DiagnosisOptions {
    /// Effects to test; those of the library and the caller's own.
    pub catalogue: Vec<Arc<dyn Effect>>,
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self { catalogue: effects::registry() }
    }
}

/// Why there is no diagnosis.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiagnosisError {
    /// The logs cannot be used.
    #[error(transparent)]
    Model(#[from] IdentifyError),
    /// Nothing to fit to.
    #[error("{rows} usable rows for {parameters} parameters are too few to tell effects apart: record longer")]
    TooFewRows {
        /// Rows there are.
        rows: usize,
        /// Parameters of the model.
        parameters: usize,
    },
    /// The listener stopped the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl From<RecordingError> for DiagnosisError {
    fn from(error: RecordingError) -> Self {
        Self::Model(error.into())
    }
}

impl From<MotionError> for DiagnosisError {
    fn from(error: MotionError) -> Self {
        Self::Model(error.into())
    }
}

/// What came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects of the catalogue are missing from the model.
    EffectsFound,
    /// Nothing material is missing at this noise.
    NothingMissing,
    /// Something is missing that no known effect explains.
    UnexplainedStructure,
}

/// A parameter of a finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundParameter {
    /// Name: `joint_2.vs`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard deviation.
    pub std: f64,
    /// Unit.
    pub unit: String,
}

/// An effect that the diagnosis stands behind, or one that was tested.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Effect.
    pub effect: String,
    /// Names of its joints; none for an effect of the whole arm.
    pub joints: Vec<String>,
    /// Probability that it is there.
    pub probability: f64,
    /// Log Bayes factor against the model without it.
    pub score: f64,
    /// Constants and linear parameters.
    pub parameters: Vec<FoundParameter>,
    /// Held-out error per joint without it, N·m (N).
    pub rmse_before: Joints,
    /// The same with it.
    pub rmse_after: Joints,
    /// One sentence.
    pub evidence: String,
    /// Effects that these logs tell from it badly.
    pub confusable_with: Vec<String>,
    /// What would tell them apart.
    pub separating_experiment: String,
    /// What it is made of, to be added to a model.
    #[serde(skip)]
    pub terms: Vec<Term2>,
}

/// Numbers by joint name.
pub type Joints = std::collections::BTreeMap<String, f64>;

/// A term of a finding; comparable by its numbers.
#[derive(Clone, Debug)]
pub struct Term2(pub Term);

impl PartialEq for Term2 {
    fn eq(&self, other: &Self) -> bool {
        self.0.effect.name() == other.0.effect.name() && self.0.constants == other.0.constants
    }
}

/// An effect that could not be tested.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NotTestable {
    /// Effect.
    pub effect: String,
    /// Why.
    pub why: String,
}

/// Error of a joint on the test logs, unfiltered torque against prediction, and what noise alone would leave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointErrors {
    /// Before, N·m (N).
    pub rmse_before: f64,
    /// After, N·m (N).
    pub rmse_after: f64,
    /// Noise of the torque, N·m (N).
    pub noise: f64,
    /// Before, percent.
    pub fit_before: f64,
    /// After, percent.
    pub fit_after: f64,
}

/// A proposal for what to record next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// What it is about.
    pub about: Vec<String>,
    /// What to do.
    pub experiment: String,
    /// Joints to move.
    pub joints: Vec<String>,
}

/// The answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Version of this layout.
    pub schema: u32,
    /// What came out.
    pub verdict: Verdict,
    /// Probability that nothing material is missing.
    pub probability_nothing_missing: f64,
    /// Probability that something is missing that no known effect explains.
    pub probability_unexplained: f64,
    /// What the diagnosis stands behind, best first.
    pub findings: Vec<Finding>,
    /// Every effect that was tested, best first.
    pub candidates: Vec<Finding>,
    /// What could not be tested.
    pub not_testable: Vec<NotTestable>,
    /// Joint by joint.
    pub joints: std::collections::BTreeMap<String, JointErrors>,
    /// Where the error sits.
    pub whereabouts: Whereabouts,
    /// What unexplained structure depends on, in words.
    pub unexplained: Vec<String>,
    /// What to record next.
    pub next_experiment: Vec<NextExperiment>,
    /// The model before.
    #[serde(skip, default = "no_model")]
    pub before: Option<TorqueModel>,
    /// The model with all findings, refitted.
    #[serde(skip, default = "no_model")]
    pub after: Option<TorqueModel>,
}

fn no_model() -> Option<TorqueModel> {
    None
}

/// Diagnoses `model`, which was identified from `train`; `test` is only looked at for the errors that are reported.
///
/// # Errors
/// If the logs lack a joint or torque, cannot be differentiated, or hold too little.
pub fn diagnose(
    model: &TorqueModel,
    train: &[Recording],
    test: &[Recording],
    options: &DiagnosisOptions,
    progress: &dyn Progress,
) -> Result<Diagnosis, DiagnosisError> {
    let processing = match model.processing() {
        Some(processing) => processing.clone(),
        None => {
            let recordings = crate::model::select_joints(model.robot(), train)?;
            Processing::choose(&recordings, &Default::default())?.0
        }
    };
    progress.step("diagnose", 0, 4)?;
    let mut problem = Problem::new(model, train, &processing)?;
    problem.nominal.processing = Some(processing.clone());
    let parameters = problem.base.rank();
    let rows = problem.rows.iter().map(Vec::len).sum();
    if rows < 4 * parameters.max(10) {
        return Err(DiagnosisError::TooFewRows { rows, parameters });
    }
    let known: Vec<String> = problem.set.effects().iter().map(|effect| effect.name().into()).collect();
    let mut search = Search::new(problem, &options.catalogue, known);
    let start = search.start();
    progress.step("diagnose", 1, 4)?;
    let (fitted, accepted, ranking) = search.run(&start);
    progress.step("diagnose", 2, 4)?;
    let left = unknown::leftover(&search.problem, &fitted, &search.noise);
    progress.step("diagnose", 3, 4)?;
    let result = report(&mut search, model, &start, fitted, &accepted, &ranking, &left, test)?;
    progress.step("diagnose", 4, 4)?;
    Ok(result)
}

#[expect(clippy::too_many_arguments, reason = "the whole result of the search")]
fn report(
    search: &mut Search<'_>,
    model: &TorqueModel,
    start: &Fitted,
    fitted: Fitted,
    accepted: &[Accepted],
    ranking: &[Candidate],
    left: &[unknown::Leftover],
    test: &[Recording],
) -> Result<Diagnosis, DiagnosisError> {
    let robot = model.robot();
    let names: Vec<&str> = robot.joint_names().collect();
    let held = |f: &Fitted| -> Joints {
        let errors = held_out(&search.problem, &f.columns, &[], &search.noise);
        names.iter().map(|name| (*name).to_string()).zip(errors).collect()
    };
    let (before_held, after_held) = (held(start), held(&fitted));
    let known: f64 = 0.5 * (start.chi2 - fitted.chi2);
    let beyond: f64 = left.iter().map(|l| l.evidence.max(0.0)).sum();
    let largest_left = left.iter().map(|l| l.effect_size).fold(0.0, f64::max);
    let verdict_features = calibration::VerdictFeatures { known, unknown: beyond, unknown_size: largest_left };
    let unexplained = verdict_features.is_unexplained();

    let terms = with_deviations(&search.problem, &fitted, &search.noise);
    let mut findings: Vec<Finding> = Vec::new();
    for (term, accepted) in terms.iter().zip(accepted) {
        let about = term.effect.about();
        let rival = accepted.rivals.iter().map(|(_, _, s)| *s).fold(0.0, f64::max);
        let probability = calibration::probability(accepted, rival, &verdict_features);
        let mut confusable: Vec<String> = accepted
            .rivals
            .iter()
            .filter(|(_, _, score)| *score > 0.6 * accepted.score)
            .map(|(name, ..)| name.clone())
            .collect();
        let alias = options_alias(search.catalogue, term.effect.name());
        confusable.extend(alias);
        confusable.dedup();
        let parameters = parameters_of(term, robot);
        let joints: Vec<String> = joints_of(term).into_iter().map(|j| names[j].to_string()).collect();
        let evidence = format!(
            "{} it lowers the error on blocks that no fit has seen by {:.0} % on the joint where it matters most (log \
             Bayes factor {:.0})",
            term.effect.summary().trim_end_matches('.').to_string() + ":",
            100.0 * accepted.effect_size / (1.0 + accepted.effect_size),
            accepted.score
        );
        if let Some(same) = findings.iter_mut().find(|f| f.effect == term.effect.name() && !f.joints.is_empty()) {
            same.joints.extend(joints.into_iter().filter(|j| !same.joints.contains(j)).collect::<Vec<_>>());
            same.parameters.extend(parameters);
            same.probability = same.probability.max(probability);
            same.score += accepted.score;
            same.terms.push(Term2(term.clone()));
            continue;
        }
        findings.push(Finding {
            effect: term.effect.name().into(),
            joints,
            probability,
            score: accepted.score,
            parameters,
            rmse_before: before_held.clone(),
            rmse_after: after_held.clone(),
            evidence,
            confusable_with: confusable,
            separating_experiment: about.experiment.into(),
            terms: vec![Term2(term.clone())],
        });
    }
    findings.sort_by(|a, b| b.score.total_cmp(&a.score));

    let kept_terms: Vec<Term> =
        if unexplained { vec![] } else { findings.iter().flat_map(|f| f.terms.iter().map(|t| t.0.clone())).collect() };
    let after = if kept_terms.is_empty() {
        model.clone()
    } else {
        let mut after = fitted.model.clone().with_terms(kept_terms, search.problem.clock);
        after.provenance = model.provenance().clone();
        for finding in &findings {
            let at = if finding.joints.is_empty() { "the arm".into() } else { finding.joints.join(", ") };
            after.provenance.history.push(format!(
                "added {} at {at}: probability {:.2}, log Bayes factor {:.0}",
                finding.effect, finding.probability, finding.score
            ));
        }
        after
    };
    let mut candidates: Vec<Finding> = findings.clone();
    for candidate in ranking {
        let joints: Vec<String> = joints_of(&candidate.term).into_iter().map(|j| names[j].to_string()).collect();
        let name = candidate.term.effect.name();
        if candidates
            .iter()
            .any(|f| f.effect == name && (f.joints.is_empty() || joints.iter().all(|j| f.joints.contains(j))))
        {
            continue;
        }
        let about = candidate.term.effect.about();
        let mut term = candidate.term.clone();
        if !term.is_transform() {
            term.coefficients.clone_from(&candidate.gain.coefficients);
        }
        let evidence = if candidate.score == f64::NEG_INFINITY {
            "the model takes it up by itself: it cannot be told from its parameters here".into()
        } else if candidate.impossible {
            "explains part of the leftover only with an impossible sign: the shape, not this effect".into()
        } else {
            format!("log Bayes factor {:.0} alone against the model", candidate.score)
        };
        candidates.push(Finding {
            effect: name.into(),
            joints,
            probability: 0.0,
            score: candidate.score.max(-1e6),
            parameters: parameters_of(&term, robot),
            rmse_before: before_held.clone(),
            rmse_after: before_held.clone(),
            evidence,
            confusable_with: about.confusable.iter().map(|c| (*c).to_string()).collect(),
            separating_experiment: about.experiment.into(),
            terms: vec![],
        });
    }
    if unexplained {
        findings.clear();
    }
    let mut not_testable = Vec::new();
    for effect in search.catalogue {
        let about = effect.about();
        let of_effect = || ranking.iter().filter(|c| c.term.effect.name() == effect.name());
        let why = if effect.entry() == Entry::Gate {
            Some("found by the checks of the log, before any physics".to_string())
        } else if let Some(other) = about.alias_of {
            Some(format!("these logs cannot tell it from `{other}`, which stands for both"))
        } else if ["payload", "link_inertia_error"].contains(&effect.name()) {
            Some("the refitted base parameters take it up".into())
        } else if let Some(why) = search.not_testable(start, effect.as_ref()) {
            Some(why)
        } else if of_effect().next().is_some() && of_effect().all(|c| c.score == f64::NEG_INFINITY) {
            Some(format!("the model's parameters take it up with this motion; needs {}", about.excitation))
        } else {
            None
        };
        not_testable.extend(why.map(|why| NotTestable { effect: effect.name().into(), why }));
    }
    let verdict = if unexplained {
        Verdict::UnexplainedStructure
    } else if findings.is_empty() {
        Verdict::NothingMissing
    } else {
        Verdict::EffectsFound
    };
    let words =
        |l: &unknown::Leftover| format!("{}: depends on {} (log evidence {:.0})", names[l.joint], l.group, l.evidence);
    let joints = joint_errors(model, &after, test, &search.problem)?;
    let next_experiment = findings
        .iter()
        .filter(|f| !f.confusable_with.is_empty())
        .map(|f| NextExperiment {
            about: [&[f.effect.clone()], &f.confusable_with[..]].concat(),
            experiment: f.separating_experiment.clone(),
            joints: f.joints.clone(),
        })
        .collect();
    Ok(Diagnosis {
        schema: 1,
        verdict,
        probability_nothing_missing: calibration::nothing_missing(accepted, &verdict_features),
        probability_unexplained: calibration::unexplained(&verdict_features),
        findings,
        candidates,
        not_testable,
        joints,
        whereabouts: whereabouts::locate(&search.problem, start),
        unexplained: left.iter().filter(|l| l.evidence > 12.0 && l.effect_size > 0.02).map(words).collect(),
        next_experiment,
        before: Some(model.clone()),
        after: Some(after),
    })
}

/// Effects that stand behind another name.
fn options_alias(catalogue: &[Arc<dyn Effect>], name: &str) -> Vec<String> {
    let alias = |effect: &&Arc<dyn Effect>| effect.about().alias_of == Some(name);
    catalogue.iter().filter(alias).map(|effect| effect.name().to_string()).collect()
}

/// Joints that a report names.
fn joints_of(term: &Term) -> Vec<usize> {
    let whole_arm = ["link_length_error"].contains(&term.effect.name());
    match term.site {
        Site::Joint(joint) | Site::Pair(joint, _) if !whole_arm => vec![joint],
        _ => vec![],
    }
}

fn parameters_of(term: &Term, robot: &crate::robot::Robot) -> Vec<FoundParameter> {
    let joint = &robot.joints()[term.site.joint().unwrap_or_default()];
    let at = match term.site {
        Site::Arm => String::new(),
        Site::Joint(_) => format!("{}.", joint.name),
        Site::Pair(_, other) => format!("{}.{}.", joint.name, robot.joints()[other].name),
    };
    let constants = term.effect.constants().iter().zip(&term.constants).zip(&term.constant_deviations);
    let constants = constants.map(|((c, value), std)| (c.symbol, c.unit_at(joint.kind), value, std));
    let linear = term.effect.parameters().iter().zip(&term.coefficients).zip(&term.coefficient_deviations);
    let linear = linear.map(|((p, value), std)| (p.symbol, p.unit_at(joint.kind), value, std));
    constants
        .chain(linear)
        .map(|(symbol, unit, value, std)| FoundParameter {
            name: format!("{at}{symbol}"),
            value: *value,
            std: *std,
            unit: unit.into(),
        })
        .collect()
}

/// Errors on the test logs against the torque as logged.
fn joint_errors(
    before: &TorqueModel,
    after: &TorqueModel,
    test: &[Recording],
    problem: &Problem,
) -> Result<std::collections::BTreeMap<String, JointErrors>, DiagnosisError> {
    let mut errors = std::collections::BTreeMap::new();
    if test.is_empty() {
        return Ok(errors);
    }
    let processing = after.processing().or(before.processing());
    let [before, after] = [before, after].map(|model| compare(model, test, processing));
    let (before, after) = (before?, after?);
    for ((b, a), noise) in before.joints.iter().zip(&after.joints).zip(&problem.beyond) {
        let error = JointErrors {
            rmse_before: b.rmse_full_band,
            rmse_after: a.rmse_full_band,
            noise: *noise,
            fit_before: b.fit_percent,
            fit_after: a.fit_percent,
        };
        errors.insert(b.joint.clone(), error);
    }
    Ok(errors)
}

impl Diagnosis {
    /// The model with the findings of these positions only, its parameters those of the joint fit.
    pub fn apply(&self, findings: &[usize]) -> Option<TorqueModel> {
        let after = self.after.as_ref()?;
        let terms: Vec<Term> = findings
            .iter()
            .filter_map(|k| self.findings.get(*k))
            .flat_map(|f| f.terms.iter().map(|t| t.0.clone()))
            .collect();
        Some(after.clone().with_terms(terms, after.clock_start()))
    }
}
