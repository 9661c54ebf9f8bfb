//! What stands of what a search found, how sure it is, and what no known effect explains.
//!
//! Everything here follows from errors on left-out blocks and from the evidence of a Gaussian
//! process on the state of a joint, which competes with the effects there:
//!
//! 1. Where such a process could still predict what matters beside the effects, or predicts better
//!    than they do, they may only imitate a law that no catalogue has. An effect that is there
//!    makes what is left of that law smaller: the process needs less variance beside it, and the
//!    two together have more evidence. One that imitates does not.
//! 2. The probability of an effect is its weight among its alternatives: none, its rivals in its
//!    place or beside it, the process.
//! 3. What is there predicts parts of the logs better, too, that are far from what it was fitted
//!    to.
//! 4. What is less probable than not leaves the model.

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use super::evidence::{
    Comparison, EVEN, LeftOut, probability_of, probability_of_fall, surprise, weights,
};
use super::fit::{Fitted, left_out_parts};
use super::likelihood::{Hypothesis, JointNoise, noises};
use super::search::{
    Accepted, CERTAIN, MATERIAL, Outcome, Search, explained_share, imitations, is_limit, is_much,
    material, without,
};
use super::unknown::{self, IMPROBABLE, Leftover, Processes};
use crate::effects::Site;
use crate::model::Term;
use crate::progress::Interrupted;

/// What was found, and what no known effect explains.
pub(super) struct Decision {
    pub outcome: Outcome,
    /// Of each term that was found.
    pub judged: Vec<Judged>,
    /// What is left at each joint.
    pub left: Vec<Leftover>,
    /// The likeliest of the effects that were not found, by name and site, each with its
    /// probability.
    pub rejected: Vec<(String, Site, f64)>,
}

impl Decision {
    /// What was found.
    ///
    /// - `named`: findings, or else effects that stand in the fit for whichever of several it is
    pub fn news(&self, search: &Search<'_>, named: bool) -> Vec<(&Judged, &Accepted)> {
        let of = |(index, step)| Some((self.judged.iter().find(|own| own.index == index)?, step));
        let all = self.outcome.news(search).filter_map(of);
        all.filter(|(judged, step)| judged.is_finding(step) == named).collect()
    }

    /// Probability that nothing that matters is missing: neither a finding or a rival in its place,
    /// nor any of the effects that were not found, nor what no known effect explains.
    pub fn nothing_missing(&self) -> f64 {
        let found = self.judged.iter().map(|judged| judged.something);
        let likeliest =
            self.rejected.iter().map(|(.., probability)| *probability).fold(0.0, f64::max);
        found.chain([likeliest, self.unexplained()]).map(|something| 1.0 - something).product()
    }

    /// Probability that something that matters is missing at some joint and that no known effect
    /// explains it.
    pub fn unexplained(&self) -> f64 {
        1.0 - self.left.iter().map(|left| 1.0 - left.probability).product::<f64>()
    }
}

/// A term that was found.
#[derive(Clone, Debug)]
pub(super) struct Judged {
    /// Of the term in the fit.
    pub index: usize,
    /// Probability that it is there, or a form of it that these logs cannot tell from it.
    pub probability: f64,
    /// Names of such forms that are not improbable.
    pub forms: Vec<String>,
    /// Probability that it or a rival is there.
    pub something: f64,
    /// It and its rivals, each in its place, and their weights.
    pub alternatives: Vec<(Term, f64)>,
}

impl Judged {
    /// Whether it is worth its name: more probable than not, or the same elsewhere is as probable,
    /// or somebody asked for it.
    pub fn is_finding(&self, step: &Accepted) -> bool {
        self.probability >= EVEN || !step.twins.is_empty() || step.wanted
    }
}

/// Rivals with less than this share of an effect's score are not tried in its place.
const CLOSE: f64 = 0.5;

/// Most rivals that are tried in the place of an effect.
const RIVALS: usize = 3;

/// Decides on an outcome.
pub(super) fn decide(search: &mut Search<'_>, outcome: Outcome) -> Result<Decision, Interrupted> {
    search.step("weigh what was found", 0, 3)?;
    let mut beside = Beside::of(search, &outcome.fitted);
    let found = outcome.accepted.len();
    let outcome = without_imitations(search, outcome, &beside)?;
    let mut outcome = without_chance(search, outcome);
    if outcome.accepted.len() < found {
        outcome = outcome.reduced(search)?;
        beside = Beside::of(search, &outcome.fitted);
    }
    search.step("weigh what was found", 1, 3)?;
    let judged = loop {
        let judged = judge(search, &outcome, &beside);
        let doubtful: Vec<usize> =
            judged.iter().filter(|j| j.something < EVEN).map(|j| j.index).collect();
        if doubtful.is_empty() {
            break judged;
        }
        outcome = outcome.without(search, &doubtful).reduced(search)?;
        beside = Beside::of(search, &outcome.fitted);
    };
    search.step("weigh what was found", 2, 3)?;
    let rejected = rejected(search, &outcome, &beside);
    let left = beside.left;
    search.step("weigh what was found", 3, 3)?;
    Ok(Decision { outcome, judged, left, rejected })
}

/// The same probabilities of an outcome that stays as it is.
pub(super) fn judge_only(search: &Search<'_>, outcome: Outcome) -> Decision {
    let beside = Beside::of(search, &outcome.fitted);
    let judged = judge(search, &outcome, &beside);
    let rejected = rejected(search, &outcome, &beside);
    Decision { outcome, judged, left: beside.left, rejected }
}

/// What is beside a fit.
struct Beside {
    /// Its errors on left-out blocks.
    errors: LeftOut,
    /// What a process could still predict at each joint.
    left: Vec<Leftover>,
    /// Those that are tried there.
    processes: Vec<Processes>,
    /// Noise of each joint beside the fit, if there are rows enough to tell.
    noises: Option<Vec<JointNoise>>,
}

impl Beside {
    fn of(search: &Search<'_>, fitted: &Fitted) -> Self {
        let (problem, noise) = (&search.problem, &search.noise);
        let errors = search.left_out(fitted);
        let joints = (0..problem.dof()).into_par_iter();
        let processes: Vec<Processes> =
            joints.map(|joint| Processes::new(problem, fitted, noise, joint)).collect();
        let noises = noises(problem, fitted);
        let left =
            unknown::leftover(problem, (fitted, &errors), (noise, noises.as_deref()), &processes);
        Self { errors, left, processes, noises }
    }

    /// The fit with the noise beside it.
    fn hypothesis<'f>(&self, fitted: &'f Fitted) -> Option<Hypothesis<'f>> {
        self.noises.clone().map(|noises| Hypothesis::new(fitted, noises))
    }
}

/// `outcome` without the effects that only imitate what no effect of the catalogue makes.
///
/// - `beside`: what is beside all of them
fn without_imitations(
    search: &mut Search<'_>,
    mut outcome: Outcome,
    beside: &Beside,
) -> Result<Outcome, Interrupted> {
    let n = search.problem.dof();
    let of_arm = joint_of_arm(search, &outcome);
    let mut closed = vec![false; n];
    for joint in 0..n {
        let terms = outcome.fitted.terms();
        let at_joint =
            |term: &Term| is_at(term, joint) || (term.site == Site::Arm && of_arm == Some(joint));
        let found: Vec<usize> =
            outcome.news(search).map(|(k, _)| k).filter(|k| at_joint(&terms[*k])).collect();
        let left = beside.left.iter().find(|l| l.joint == joint && l.is_material());
        closed[joint] = left.is_some();
        let left = left.map_or(0.0, |l| l.share);
        let imitations =
            imitations(search, &outcome.fitted, &found, (joint, left), &beside.processes[joint]);
        if !imitations.is_empty() {
            closed[joint] = true;
            outcome = outcome.without(search, &imitations);
        }
    }
    if !closed.contains(&true) || outcome.accepted.is_empty() {
        return Ok(outcome);
    }
    // What nothing explains at one joint must not be explained by effects at others.
    let open = search.on_rows_without(&closed, &outcome.fitted);
    let elsewhere = |step: &Accepted| step.site.joint().is_none_or(|joint| !closed[joint]);
    let (_, kept) = search.backward(open, outcome.accepted.clone(), &elsewhere)?;
    let fitted = search.on_rows_without(&vec![false; n], &outcome.fitted);
    outcome.fitted = search.refit(&fitted, fitted.terms().to_vec());
    let given = outcome.fitted.terms().len() - outcome.accepted.len();
    let gone =
        |step: &Accepted| !kept.iter().any(|k| k.effect == step.effect && k.site == step.site);
    let out: Vec<usize> = (0..outcome.accepted.len())
        .filter(|k| gone(&outcome.accepted[*k]))
        .map(|k| given + k)
        .collect();
    if out.is_empty() {
        return Ok(outcome);
    }
    Ok(outcome.without(search, &out))
}

/// Gain on parts of the logs, in its standard deviations, of what was surely found on blocks of
/// time between others: one that was chosen there is asked once more, not one of many.
const HOLDS: f64 = 2.0;

/// `outcome` without the effects that do not predict parts of the logs better which are far from
/// what they were fitted to, the least sure first: blocks of time between others may be predicted
/// by what this motion alone looks like. What is too short to lie in two parts is not asked.
fn without_chance(search: &Search<'_>, mut outcome: Outcome) -> Outcome {
    let (problem, noise) = (&search.problem, &search.noise);
    loop {
        let fitted = &outcome.fitted;
        let asked = |(k, _): (usize, &Accepted)| Some((k, search.parts_to_ask(fitted, k)?));
        let asked: Vec<(usize, usize)> = outcome.news(search).filter_map(asked).collect();
        let counts: HashSet<usize> = asked.iter().map(|(_, count)| *count).collect();
        let errors = |count| (count, left_out_parts(problem, fitted, noise, count));
        let with: HashMap<usize, LeftOut> = counts.into_par_iter().map(errors).collect();
        let sure = |(k, count): (usize, usize)| {
            let without = left_out_parts(problem, &search.bare(fitted, k), noise, count);
            (
                k,
                without
                    .against(&with[&count], problem, &search.joints_of(&fitted.terms()[k]))
                    .significance(),
            )
        };
        let all: Vec<(usize, f64)> = asked.into_par_iter().map(sure).collect();
        match all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, sure)| *sure < HOLDS) {
            Some((chance, _)) => outcome = outcome.without(search, &[chance]),
            None => return outcome,
        }
    }
}

/// Whether a term acts at a joint and not only by cutting its torque: rows at a limit are no
/// equations that it could explain.
fn is_at(term: &Term, joint: usize) -> bool {
    matches!(term.site, Site::Joint(own) | Site::Pair(own, _) if own == joint) && !is_limit(term)
}

/// The joint at which effects of the whole arm explain more than at all others together, if there
/// is one.
fn joint_of_arm(search: &Search<'_>, outcome: &Outcome) -> Option<usize> {
    let terms = outcome.fitted.terms();
    let out: Vec<usize> =
        outcome.news(search).map(|(k, _)| k).filter(|k| terms[*k].site == Site::Arm).collect();
    if out.is_empty() {
        return None;
    }
    let bare = search.refit(&outcome.fitted, without(terms, &out));
    let energy = |white: &[f64]| white.iter().map(|w| w * w).sum::<f64>();
    let falls: Vec<f64> = bare
        .white
        .iter()
        .zip(&outcome.fitted.white)
        .map(|(bare, fitted)| energy(bare) - energy(fitted))
        .collect();
    let all: f64 = falls.iter().sum();
    falls.iter().position(|fall| *fall > 0.5 * all)
}

/// The probabilities of the likeliest effects that were not found, beside what was.
fn rejected(search: &Search<'_>, outcome: &Outcome, beside: &Beside) -> Vec<(String, Site, f64)> {
    /// Effects that were not found which get a probability.
    const LIKELIEST: usize = 6;
    let (problem, own) = (&search.problem, &beside.errors);
    let bare = beside.hypothesis(&outcome.fitted);
    let found = |term: &Term| outcome.fitted.terms().iter().any(|own| own.is_like(term));
    let possible =
        outcome.ranking.iter().filter(|c| !c.impossible && c.score > 0.0 && !found(&c.term));
    let likeliest: Vec<&Term> = possible.take(LIKELIEST).map(|c| &c.term).collect();
    let probability = |term: &&Term| {
        let fitted = search.with_term(&outcome.fitted, (*term).clone());
        let (with, joints) = (search.left_out(&fitted), search.joints_of(term));
        let before = -search.units.ln() - fitted.terms().last().map_or(0.0, surprise);
        let there = weights(problem, &[own, &with], &[0.0, before], &joints)[1];
        let matters =
            |joint: &usize| probability_of_fall(problem, [own, &with], *joint, material(term), 0.0);
        let mut probability = there.min(joints.iter().map(matters).fold(0.0, f64::max));
        if let Some(bare) = bare.as_ref().filter(|_| probability > IMPROBABLE) {
            let with_it = bare.like(problem, &fitted, &joints);
            let factor = with_it.and_then(|with| with.log_bayes_factor(bare, problem));
            let gain = own.against(&with, problem, &joints);
            let elsewhere = || {
                let Some(count) = search.parts_to_ask(&fitted, outcome.fitted.terms().len()) else {
                    return true;
                };
                let parts = [&outcome.fitted, &fitted]
                    .map(|fit| left_out_parts(problem, fit, &search.noise, count));
                parts[0].against(&parts[1], problem, &joints).significance() >= HOLDS
            };
            probability = probability.min(most_probable(search, term, (gain, factor)));
            // What would not have been taken for it is at most as likely as not.
            if probability > EVEN && !(gain.significance() >= search.sure && elsewhere()) {
                probability = EVEN;
            }
        }
        (term.effect.name().to_string(), term.site, probability)
    };
    likeliest.par_iter().map(probability).collect()
}

/// The probability of every term that was found, by left-out blocks at the joints on which it acts.
fn judge(search: &Search<'_>, outcome: &Outcome, beside: &Beside) -> Vec<Judged> {
    let found: Vec<(usize, &Accepted)> = outcome.news(search).collect();
    let left_at = |step: &Accepted| {
        let own =
            beside.left.iter().find(|l| step.site.joint() == Some(l.joint) && l.is_material());
        own.map_or(0.0, |left| left.share)
    };
    let judged =
        |(index, step)| judge_one(search, (&outcome.fitted, beside), (index, step), left_at(step));
    found.into_par_iter().map(judged).collect()
}

fn judge_one(
    search: &Search<'_>,
    (fitted, beside): (&Fitted, &Beside),
    (index, step): (usize, &Accepted),
    left: f64,
) -> Judged {
    let own_errors = &beside.errors;
    let term = &fitted.terms()[index];
    if is_limit(term) {
        let probability = 1.0 - 1.0 / search.units;
        let (forms, alternatives) = (vec![], vec![]);
        return Judged { index, probability, forms, something: probability, alternatives };
    }
    let bare = search.bare(fitted, index);
    let rivals = step.rivals.iter().filter(|(rival, score)| {
        let there = fitted.terms().iter().any(|term| term.is_like(rival));
        *score > CLOSE * step.first_score && !there
    });
    let in_its_place = |rival: Term| search.with_instead(fitted, index, rival);
    let rivals: Vec<&Term> = rivals.take(RIVALS).map(|(rival, _)| rival).collect();
    let (mut models, mut surprises) = (Vec::new(), Vec::new());
    let mut weigh = |fit: &Fitted| {
        models.push(search.left_out(fit));
        surprises.push(fit.terms().iter().map(surprise).sum::<f64>());
    };
    weigh(&bare);
    weigh(fitted);
    rivals.iter().for_each(|rival| weigh(&in_its_place((*rival).clone())));
    step.twins.iter().for_each(|twin| weigh(&in_its_place(term.clone().with_site(*twin))));
    let twins = 2 + rivals.len()..2 + rivals.len() + step.twins.len();
    // A rival need not be instead of it: both may be there.
    let beside_it = |rival: &&&Term| search.may_join(fitted, rival.effect.as_ref(), rival.site);
    let with_it = |rival: &&Term| weigh(&search.with_term(fitted, (*rival).clone()));
    rivals.iter().filter(beside_it).for_each(with_it);
    let both = twins.end..models.len();
    // One of so many effects, and none, are as likely before any data.
    let one = -search.units.ln();
    let effects = |k: usize| match k {
        0 => 0.0,
        k if both.contains(&k) => 2.0,
        _ => 1.0,
    };
    let known = |k: usize| surprises[0] - surprises[k];
    let prior: Vec<f64> = (0..models.len()).map(|k| effects(k) * one + known(k)).collect();
    let of_all: Vec<&LeftOut> = models.iter().collect();
    let joints = search.joints_of(term);
    let weights_of =
        |models: &[&LeftOut], prior: &[f64]| weights(&search.problem, models, prior, &joints);
    let weights = weights_of(&of_all, &prior);
    let is_form = |k: &usize| {
        rivals[k - 2].site == term.site && says_the_same(&models[1], &models[*k], &joints)
    };
    let forms: Vec<usize> = (2..twins.start).filter(is_form).collect();
    // Where the same effect explains as much elsewhere, it is as likely there.
    let own: f64 = [1]
        .into_iter()
        .chain(forms.iter().copied())
        .chain(twins)
        .chain(both)
        .map(|k| weights[k])
        .sum();
    let probability = own / (1 + step.twins.len()) as f64;
    // A process that is about as good says the same with more freedom. One that could explain much
    // beside the effect says something else, unless the two together, which are one thing more, say
    // more than it alone.
    let of_process = |joint: usize| -> Option<f64> {
        let best = |fit: &Fitted| {
            beside.processes[joint].best(&search.problem, fit, &search.noise, &joints)
        };
        let (alone, both) = (best(&bare)?.1, best(fitted).map(|(_, errors)| errors));
        let of_all: Vec<&LeftOut> = of_all.iter().copied().chain([&alone]).chain(&both).collect();
        let prior = [&prior[..], &[one, one + prior[1]]].concat();
        weights_of(&of_all, &prior[..of_all.len()]).get(models.len()).copied()
    };
    let much_is_left =
        |joint: &usize| is_much(left, explained_share(*joint, &models[0], own_errors));
    let of_process =
        term.site.joint().filter(much_is_left).and_then(of_process).unwrap_or_default();
    let something = (1.0 - of_process).min(1.0 - weights[0]);
    let likely = forms.iter().filter(|k| weights[**k] > 1.0 - CERTAIN);
    let forms = likely.map(|k| rivals[k - 2].effect.name().to_string()).collect();
    let each = std::iter::once(term).chain(rivals.iter().copied()).cloned();
    let alternatives = each.zip(weights[1..].iter().copied()).collect();
    let comparison = models[0].against(own_errors, &search.problem, &joints);
    let most = beside.hypothesis(fitted).map_or(1.0, |own| {
        let without = own.like(&search.problem, &bare, &joints);
        let factor = without.and_then(|without| own.log_bayes_factor(&without, &search.problem));
        most_probable(search, term, (comparison, factor))
    });
    let (probability, something) = (probability.min(most), something.min(most));
    Judged { index, probability, forms, something, alternatives }
}

/// The largest probability of a term that its Bayes factor, if there is one, or its gain on
/// left-out blocks speaks for: one of all effects at all sites is there or none of them. The factor
/// believes in the noise of the model and lets each constant be known as well as one row says; the
/// gain does not, and needs more rows.
fn most_probable(
    search: &Search<'_>,
    term: &Term,
    (gain, log_bayes_factor): (Comparison, Option<f64>),
) -> f64 {
    let constants = 0.5 * term.constants.len() as f64 * search.rows.max(2.0).ln();
    let most = |factor: f64| (factor - constants).max(gain.largest_log_bayes_factor());
    let before = search.units.ln() + surprise(term);
    log_bayes_factor.map_or(1.0, |factor| probability_of(most(factor) - before))
}

/// Whether the errors of two models on left-out blocks differ at no joint by a share that matters:
/// forms of one law, which these logs cannot tell apart.
fn says_the_same(own: &LeftOut, other: &LeftOut, joints: &[usize]) -> bool {
    let least = (1.0 + MATERIAL).powi(2).recip();
    joints.iter().all(|&joint| {
        let [own, other] = [own, other].map(|errors| errors.mean_square(joint));
        own >= least * other && other >= least * own
    })
}
