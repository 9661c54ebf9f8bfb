//! The result of a search in words and numbers.

use std::collections::BTreeMap;

use super::answer::{ByJoint, Diagnosis, Finding, JointErrors, NotTestable, Step, Verdict};
use super::decision::Decision;
use super::described::{joints_of, parameters_of};
use super::fit::{Fitted, with_deviations};
use super::formula::Formula;
use super::search::{Accepted, Candidate, Search};
use super::structure::JointStructure;
use super::unknown::Leftover;
use super::written::Written;
use super::{DiagnosisError, detectability, experiment, formula, structure, whereabouts};
use crate::effects::{Effect, Entry, Scale, Site};
use crate::model::{Term, TorqueModel, compare};
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;

/// A rival with this share of a finding's evidence is named beside it.
const CONFUSABLE: f64 = 0.6;

/// A state that explains this share of what is left at a joint is worth a formula.
const WORTH_A_FORMULA: f64 = 0.2;

/// Joints whose held-out error falls by this share are listed with a finding.
const LISTED: f64 = 0.01;

pub(super) fn report(
    search: &mut Search<'_>,
    model: &TorqueModel,
    (decision, written): (&Decision, Written),
    test: &[Recording],
) -> Result<Diagnosis, DiagnosisError> {
    let Decision { outcome, left, .. } = decision;
    let start = &outcome.start;
    let unnamed = decision.news(search, false);
    let unexplained = left.iter().any(Leftover::is_material) || !unnamed.is_empty();
    let terms = with_deviations_of_left_out(search, &outcome.fitted);
    let mut findings = findings(search, decision, &terms);
    let candidates = candidates(search, &findings, decision);
    let not_testable = not_testable(search, start, &outcome.ranking);
    let after = with_history(model, decision, written, &mut findings);
    let last = if findings.is_empty() { start } else { &outcome.fitted };
    let structure = structure::structure_of_fit(&search.problem, start);
    let of_last = if findings.is_empty() {
        structure.clone()
    } else {
        structure::structure_of_fit(&search.problem, last)
    };
    let left_out = if findings.is_empty() { &outcome.held_out_before } else { &outcome.held_out };
    // Takes the columns that are remembered: what comes after it needs the room.
    let detectable = detectability::detectable(search, last, left_out)?;
    let formulas = if unexplained { formulas(search, last, left, &of_last) } else { vec![] };
    let names: Vec<&str> = model.robot().joint_names().collect();
    let words = |l: &Leftover| {
        format!(
            "{}: torque that depends on {}, {:.0} % of the error on unseen blocks of time",
            names[l.joint],
            l.group,
            100.0 * l.share
        )
    };
    let unnamed = unnamed.into_iter().map(|(judged, _)| &outcome.fitted.terms()[judged.index]);
    let in_words = |term: &Term| {
        let at = term.site.joint().map_or("the whole arm", |joint| names[joint]);
        let name = term.effect.name();
        format!(
            "{at}: {name} would explain part of the error, others would as well, and none is more \
             probable than not"
        )
    };
    let verdict = match (unexplained, findings.is_empty()) {
        (_, false) => Verdict::EffectsFound,
        (true, true) => Verdict::UnexplainedStructure,
        (false, true) => Verdict::NothingMissing,
    };
    Ok(Diagnosis {
        schema: 2,
        verdict,
        probability_nothing_missing: decision.nothing_missing(),
        probability_unexplained: decision.unexplained(),
        next_experiment: experiment::next_experiments(
            search,
            &outcome.fitted,
            &findings,
            &outcome.ranking,
        ),
        findings,
        candidates,
        not_testable,
        detectable,
        joints: joint_errors(search, &outcome.fitted, model, &after, test)?,
        steps: steps(search, decision),
        whereabouts: whereabouts::locate(&search.problem, start),
        structure,
        left: of_last,
        unexplained: left
            .iter()
            .filter(|l| l.is_material())
            .map(words)
            .chain(unnamed.map(in_words))
            .collect(),
        formulas,
        before: model.clone(),
        after,
    })
}

/// The terms of a fit with standard deviations of all parameters. What a model lacks is not noise:
/// they are as much larger than those of the noise as errors on blocks that were left out are
/// larger than it, at the joints on which a term acts.
fn with_deviations_of_left_out(search: &Search<'_>, fitted: &Fitted) -> Vec<Term> {
    let mut terms = with_deviations(&search.problem, fitted, &search.noise);
    let errors = search.errors(fitted).left_out;
    for term in &mut terms {
        let joints = search.joints_of(term);
        let excess = |joint: &usize| {
            (errors.mean_square(*joint) / search.noise.level[*joint].powi(2)).max(1.0)
        };
        let factor = (joints.iter().map(excess).sum::<f64>() / joints.len().max(1) as f64).sqrt();
        let own = term.coefficient_deviations.iter_mut().chain(&mut term.constant_deviations);
        own.for_each(|deviation| *deviation *= factor);
    }
    terms
}

/// Formulas for the joints where structure is left.
fn formulas(
    search: &Search<'_>,
    last: &Fitted,
    left: &[Leftover],
    structure: &[JointStructure],
) -> Vec<Formula> {
    let material = |joint: usize| {
        left.iter().any(|l| l.joint == joint && l.is_material())
            || structure[joint].shares.state > WORTH_A_FORMULA
    };
    let joints = (0..search.problem.dof()).filter(|joint| material(*joint));
    joints
        .filter_map(|joint| formula::formula(&search.problem, last, &search.noise, joint))
        .collect()
}

/// The model that is written, its history told by what is in it; findings that it does without say
/// so.
fn with_history(
    model: &TorqueModel,
    decision: &Decision,
    written: Written,
    findings: &mut [Finding],
) -> TorqueModel {
    let fitted = &decision.outcome.fitted;
    let out: Vec<&Term> = written.taken_back.iter().map(|k| &fitted.terms()[*k]).collect();
    let is_out = |term: &Term| out.iter().any(|own| own.is_like(term));
    for finding in findings.iter_mut().filter(|finding| finding.terms.iter().any(is_out)) {
        finding.evidence +=
            "; left out of the model: with it other motion would be predicted worse";
    }
    let inside = || findings.iter().filter(|finding| !finding.terms.iter().any(is_out));
    if inside().next().is_none() {
        return model.clone();
    }
    let mut after = written.model;
    let found =
        |term: &Term| inside().any(|finding| finding.terms.iter().any(|own| own.is_like(term)));
    let given = |term: &Term| model.terms().iter().any(|own| own.is_like(term));
    let beside = fitted.terms().iter().filter(|term| !is_out(term) && !found(term) && !given(term));
    let beside: Vec<String> = beside.map(|term| beside_findings(term, model.robot())).collect();
    after.provenance.history.extend(inside().map(sentence).chain(beside));
    after
}

/// A line of a model's history for what is fitted with the findings and is none itself.
fn beside_findings(term: &Term, robot: &Robot) -> String {
    let values: Vec<String> = parameters_of(term, robot)
        .iter()
        .map(|p| format!("{} = {:.3e} {}", p.name, p.value, p.unit))
        .collect();
    format!(
        "added {} beside the findings, too small or too unsure for one: {}",
        term.effect.name(),
        values.join(", ")
    )
}

/// One line of a model's history.
pub(super) fn sentence(finding: &Finding) -> String {
    let at = if finding.joints.is_empty() { "the arm".into() } else { finding.joints.join(", ") };
    let fell = largest_fall(&finding.rmse_before, &finding.rmse_after);
    let fell = fell.map_or(String::new(), |(joint, before, after)| {
        format!("; held-out error of {joint} {before:.4} to {after:.4}")
    });
    format!("added {} at {at}, probability {:.2}{fell}", finding.effect, finding.probability)
}

fn largest_fall(before: &ByJoint, after: &ByJoint) -> Option<(String, f64, f64)> {
    let falls =
        before.iter().filter_map(|(joint, b)| Some((joint.clone(), *b, *after.get(joint)?)));
    falls.max_by(|x, y| (x.2 / x.1).total_cmp(&(y.2 / y.1)).reverse())
}

fn findings(search: &Search<'_>, decision: &Decision, terms: &[Term]) -> Vec<Finding> {
    let robot = search.problem.nominal.robot();
    let mut findings: Vec<Finding> = Vec::new();
    for (judged, accepted) in decision.news(search, true) {
        let term = terms[judged.index].clone();
        let mut finding =
            finding(search, term, accepted, &decision.outcome.held_out, judged.probability);
        finding.evidence = evidence(&finding, robot, &judged.forms);
        findings.push(finding);
    }
    findings.sort_by(|a, b| b.score.total_cmp(&a.score).then_with(|| a.effect.cmp(&b.effect)));
    findings.into_iter().map(Finding::with_gain).collect()
}

fn finding(
    search: &Search<'_>,
    term: Term,
    accepted: &Accepted,
    after: &[f64],
    probability: f64,
) -> Finding {
    let robot = search.problem.nominal.robot();
    let about = term.effect.about();
    let close =
        accepted.rivals.iter().filter(|(_, score)| *score > CONFUSABLE * accepted.first_score);
    let mut confusable: Vec<String> =
        close.map(|(rival, _)| rival.effect.name().to_string()).collect();
    let name = term.effect.name();
    let aliases = search.catalogue.iter().filter(|effect| effect.about().alias_of == Some(name));
    confusable.extend(aliases.map(|effect| effect.name().to_string()));
    confusable.dedup();
    let names = |site: &Site| site.joint().map(|joint| robot.joints()[joint].name.as_str());
    confusable
        .extend(accepted.twins.iter().filter_map(names).map(|joint| format!("{name}@{joint}")));
    let joints = joints_of(&term);
    let listed = |joint: &usize| {
        joints.is_empty()
            || joints.contains(joint)
            || accepted.without[*joint] > (1.0 + LISTED) * after[*joint]
    };
    let by_joint = |errors: &[f64]| -> ByJoint {
        let names = robot.joint_names().zip(errors).enumerate();
        names
            .filter(|(joint, _)| listed(joint))
            .map(|(_, (name, error))| (name.to_string(), *error))
            .collect()
    };
    Finding {
        effect: name.into(),
        joints: joints.iter().map(|joint| robot.joints()[*joint].name.clone()).collect(),
        probability,
        score: accepted.score,
        parameters: parameters_of(&term, robot),
        rmse_before: by_joint(&accepted.without),
        rmse_after: by_joint(after),
        error_gained_percent: 0.0,
        evidence: String::new(),
        confusable_with: confusable,
        separating_experiment: about.experiment.into(),
        terms: vec![term],
    }
}

/// - `forms`: effects that these logs cannot tell from it at its place
fn evidence(finding: &Finding, robot: &Robot, forms: &[String]) -> String {
    let about = finding.terms[0].effect.about();
    let signature =
        if about.signature.is_empty() { String::new() } else { format!(" ({})", about.signature) };
    let summary = finding.terms[0].effect.summary().trim_end_matches('.');
    let usual = finding.terms.iter().all(|term| term.effect.is_plausible(&term.coefficients));
    let sign = if usual {
        ""
    } else {
        "; its sign is the opposite of what such a part has: look for what else acts so"
    };
    let prefix = format!("{}@", finding.effect);
    let elsewhere: Vec<&str> =
        finding.confusable_with.iter().filter_map(|c| c.strip_prefix(&prefix)).collect();
    let mut undecided = String::new();
    if !forms.is_empty() {
        undecided += &format!(
            "; {} would explain as much: these logs cannot tell which it is",
            forms.join(" or ")
        );
    }
    if !elsewhere.is_empty() {
        undecided += &format!(
            "; at {} it would explain as much: these logs cannot tell where it is",
            elsewhere.join(" or ")
        );
    }
    match largest_fall(&finding.rmse_before, &finding.rmse_after) {
        Some((joint, before, after)) => {
            let of_name = robot.joints().iter().find(|one| one.name == joint);
            let unit = of_name.map_or("N·m", |one| one.kind.torque_unit());
            format!(
                "{summary}{signature}: with it the error of {joint} on blocks of time that no fit \
                 has seen falls from {before:.4} to {after:.4} {unit}{sign}{undecided}"
            )
        }
        None => format!("{summary}{signature}{sign}{undecided}"),
    }
}

fn candidates(search: &Search<'_>, findings: &[Finding], decision: &Decision) -> Vec<Finding> {
    let outcome = &decision.outcome;
    let unnamed = decision.news(search, false).into_iter();
    let unnamed =
        unnamed.map(|(judged, step)| (step.effect.clone(), step.site, judged.probability));
    let unsure: Vec<(String, Site, f64)> =
        unnamed.chain(decision.rejected.iter().cloned()).collect();
    let mut candidates: Vec<Finding> = findings.to_vec();
    for candidate in outcome.ranking.iter().filter(|c| c.term.effect.refines().is_none()) {
        let mut one = as_finding(search, candidate, &outcome.held_out_before);
        let listed = |f: &Finding| {
            f.effect == one.effect && one.joints.iter().all(|joint| f.joints.contains(joint))
        };
        if candidates.iter().any(listed) {
            continue;
        }
        let own =
            unsure.iter().find(|(own, site, _)| *own == one.effect && *site == candidate.term.site);
        one.probability = own.map_or(0.0, |(_, _, probability)| *probability);
        candidates.push(one);
    }
    candidates
}

/// The candidates of a search that goes on, none of them judged yet.
pub(super) fn ranked(search: &Search<'_>, ranking: &[Candidate]) -> Vec<Finding> {
    let unknown = vec![0.0; search.problem.dof()];
    let own = ranking.iter().filter(|c| c.term.effect.refines().is_none());
    own.map(|candidate| as_finding(search, candidate, &unknown)).collect()
}

/// What is known of a candidate.
///
/// - `without`: error per joint on blocks that were left out, N·m (N), if it was not judged
fn as_finding(search: &Search<'_>, candidate: &Candidate, without: &[f64]) -> Finding {
    let robot = search.problem.nominal.robot();
    let joints: Vec<String> = joints_of(&candidate.term)
        .into_iter()
        .map(|joint| robot.joints()[joint].name.clone())
        .collect();
    let about = candidate.term.effect.about();
    let mut term = candidate.term.clone();
    if term.is_transform() {
        term.constants
            .iter_mut()
            .zip(&candidate.gain.coefficients)
            .for_each(|(c, step)| *c += step);
    } else {
        term.coefficients.clone_from(&candidate.gain.coefficients);
    }
    let evidence = if candidate.score == f64::NEG_INFINITY {
        "the model takes it up by itself: these logs cannot tell it from the parameters of the \
         model"
            .into()
    } else if candidate.impossible {
        "explains part of the leftover only with an impossible sign: the shape, not this effect"
            .into()
    } else {
        // Rounded to zero it has no sign.
        format!("log Bayes factor {:.0} alone against the model", candidate.score.round() + 0.0)
    };
    let errors = |errors: &[f64]| -> ByJoint {
        let own = robot.joint_names().zip(errors);
        let own =
            own.filter(|(joint, _)| joints.iter().any(|own| own == joint) || joints.is_empty());
        own.map(|(joint, error)| (joint.to_string(), *error)).collect()
    };
    let [before, after] =
        candidate.errors.as_ref().map_or([without; 2], |both| both.each_ref().map(Vec::as_slice));
    let finding = Finding {
        effect: candidate.term.effect.name().into(),
        probability: 0.0,
        score: candidate.score.max(LOWEST_SCORE),
        parameters: parameters_of(&term, robot),
        rmse_before: errors(before),
        rmse_after: errors(after),
        error_gained_percent: 0.0,
        evidence,
        confusable_with: about.confusable.iter().map(|c| (*c).to_string()).collect(),
        separating_experiment: about.experiment.into(),
        joints,
        terms: vec![],
    };
    finding.with_gain()
}

/// Stands for minus infinity, which JSON does not have.
const LOWEST_SCORE: f64 = -1e6;

fn not_testable(search: &Search<'_>, start: &Fitted, ranking: &[Candidate]) -> Vec<NotTestable> {
    let mut list = Vec::new();
    for effect in search.catalogue {
        let about = effect.about();
        let of_effect = || ranking.iter().filter(|c| c.term.effect.name() == effect.name());
        let invisible =
            of_effect().next().is_some() && of_effect().all(|c| c.score == f64::NEG_INFINITY);
        let why = if effect.entry() == Entry::Gate {
            Some("found by the checks of the log, before any physics".to_string())
        } else if search.has_everywhere(effect.as_ref()) || effect.refines().is_some() {
            None
        } else if let Some(other) = about.alias_of {
            Some(format!("these logs cannot tell it from `{other}`, which stands for both"))
        } else if effect.is_absorbed() {
            Some("the refitted base parameters take it up".into())
        } else if effect.entry() == Entry::Transform
            && effect.constants().iter().any(|c| c.scale == Scale::Torque)
        {
            let none = search.problem.limits.iter().all(Option::is_none);
            none.then(|| "no torque stays at its largest value".into())
        } else if let Some(why) = search.not_testable(start, effect.as_ref()) {
            Some(why)
        } else if let Some(why) = drowned(search, effect.as_ref()) {
            Some(why)
        } else {
            invisible.then(|| {
                format!(
                    "the model's parameters take it up with this motion; it needs {}",
                    about.excitation
                )
            })
        };
        list.extend(why.map(|why| NotTestable { effect: effect.name().into(), why }));
    }
    let robot = search.problem.nominal.robot();
    let still = robot.joint_names().zip(&search.problem.rows).filter(|(_, rows)| rows.is_empty());
    let names: Vec<&str> = still.map(|(name, _)| name).collect();
    if !names.is_empty() {
        let why = format!(
            "{} never moves in the training logs: no effect can be tested there",
            names.join(", ")
        );
        list.push(NotTestable { effect: "*".into(), why });
    }
    list
}

/// Where an effect cannot be told from noise of the acceleration, if anywhere.
fn drowned(search: &Search<'_>, effect: &dyn Effect) -> Option<String> {
    let robot = search.problem.nominal.robot();
    let names: Vec<&str> = robot.joint_names().collect();
    let sites = effect.sites(robot).into_iter().filter(|site| search.is_drowned(effect, *site));
    let joints: Vec<&str> = sites.filter_map(|site| Some(names[site.joint()?])).collect();
    (!joints.is_empty()).then(|| {
        format!(
            "not at {}: noise of the position, twice differentiated, is as large there as that of \
             the torque; it needs finer encoders, or longer logs in a narrower band",
            joints.join(", ")
        )
    })
}

fn steps(search: &Search<'_>, decision: &Decision) -> Vec<Step> {
    let names: Vec<&str> = search.problem.nominal.robot().joint_names().collect();
    let by_joint = |errors: &[f64]| {
        names.iter().map(|name| (*name).to_string()).zip(errors.iter().copied()).collect()
    };
    let mut steps = vec![Step {
        effect: None,
        joints: vec![],
        rmse: by_joint(&decision.outcome.held_out_before),
    }];
    for (_, accepted) in decision.news(search, true) {
        let joints = match accepted.site {
            Site::Joint(joint) | Site::Pair(joint, _) => vec![names[joint].to_string()],
            Site::Arm => vec![],
        };
        steps.push(Step {
            effect: Some(accepted.effect.clone()),
            joints,
            rmse: by_joint(&accepted.with),
        });
    }
    steps
}

/// Errors on the test logs against the torque as logged.
fn joint_errors(
    search: &Search<'_>,
    fitted: &Fitted,
    before: &TorqueModel,
    after: &TorqueModel,
    test: &[Recording],
) -> Result<BTreeMap<String, JointErrors>, DiagnosisError> {
    let mut errors = BTreeMap::new();
    if test.is_empty() {
        return Ok(errors);
    }
    let processing = search.problem.nominal.processing();
    let test = LogSet::new(test);
    let (old, new) = (compare(before, &test, processing)?, compare(after, &test, processing)?);
    let finite = |value: f64| value.is_finite().then_some(value);
    let beyond = super::fit::beyond(&search.problem, fitted);
    let noise =
        beyond.iter().zip(&search.noise.level).map(|(beyond, in_band)| beyond[0].hypot(*in_band));
    for ((b, a), noise) in old.joints.iter().zip(&new.joints).zip(noise) {
        let error = JointErrors {
            rmse_before: b.rmse_full_band,
            rmse_after: a.rmse_full_band,
            noise,
            fit_before: finite(b.fit_percent),
            fit_after: finite(a.fit_percent),
        };
        errors.insert(b.joint.clone(), error);
    }
    Ok(errors)
}
