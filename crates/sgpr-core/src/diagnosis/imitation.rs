//! Effects that imitate what no effect of the catalogue makes.
//!
//! A torque from outside of the catalogue is explained bit by bit by effects that happen to look like parts of it. They
//! are found out by a rival: a Gaussian process on the state of the joint in place of all that was found there. An effect
//! that is there beats it, as it says the same with fewer parameters, and holds at positions and speeds that it was not
//! fitted to; imitations together do not.

use super::fit::{Fitted, errors_elsewhere};
use super::search::{Accepted, EVIDENCE, Outcome, Search, is_limit, others, without};
use super::unknown::Smooth;
use crate::effects::Site;
use crate::model::Term;
use crate::progress::Interrupted;

/// The Gaussian process has so many times the evidence of imitations ...
const MORE: f64 = 1.01;

/// ... which leave so much more of the error on a usual block that was left out than the Gaussian process ...
const WORSE: f64 = 1.05;

/// ... and close less than this share of what it closes: the right effect in a somewhat different form closes more.
const CLOSED: f64 = 0.9;

/// Effects at one joint after which the rival is asked while others are still looked for.
const MANY: usize = 3;

/// `outcome` without the effects at joints where a smooth function of the state does better than all of them.
pub(super) fn without_imitations(search: &Search<'_>, mut outcome: Outcome) -> Result<Outcome, Interrupted> {
    let of_arm = joint_of_arm(search, &outcome);
    for joint in 0..search.problem.dof() {
        let terms = outcome.fitted.terms();
        let at_joint = |term: &Term| is_at(term, joint) || (term.site == Site::Arm && of_arm == Some(joint));
        let out: Vec<usize> = outcome.news(search).map(|(k, _)| k).filter(|k| at_joint(&terms[*k])).collect();
        let Some(bare) = without_imitated(search, &outcome.fitted, &out, joint) else { continue };
        outcome.accepted = others(outcome.accepted, &outcome.fitted, &out);
        (outcome.fitted, outcome.accepted) = search.backward(bare, outcome.accepted)?;
        outcome.held_out = search.held_out(&outcome.fitted);
    }
    Ok(outcome)
}

/// The joint of the last accepted term, and the fit and its accepted terms without the effects there, if there are many
/// and they imitate.
pub(super) fn without_many_imitations(
    search: &Search<'_>,
    fitted: &Fitted,
    accepted: &[Accepted],
) -> Option<(usize, Fitted, Vec<Accepted>)> {
    let joint = accepted.last()?.site.joint()?;
    let own = search.news(fitted, accepted).map(|(k, _)| k).filter(|k| is_at(&fitted.terms()[*k], joint));
    let out: Vec<usize> = own.collect();
    if out.len() < MANY {
        return None;
    }
    let bare = without_imitated(search, fitted, &out, joint)?;
    Some((joint, bare, others(accepted.to_vec(), fitted, &out)))
}

/// Whether a term acts at a joint and not only by cutting its torque: rows at a limit are no equations that it could explain.
fn is_at(term: &Term, joint: usize) -> bool {
    matches!(term.site, Site::Joint(own) | Site::Pair(own, _) if own == joint) && !is_limit(term)
}

/// The fit without the terms at the indices `out`, if a smooth function of the state of `joint` does better than they.
fn without_imitated(search: &Search<'_>, fitted: &Fitted, out: &[usize], joint: usize) -> Option<Fitted> {
    if out.is_empty() {
        return None;
    }
    let bare = search.refit(fitted, without(fitted.terms(), out));
    let found = search.score_of(&bare, fitted);
    let smooth = Smooth::best(&search.problem, &bare, &search.noise, joint)?;
    if smooth.evidence < (found + EVIDENCE).max(MORE * found) {
        return None;
    }
    let [before, with] = [&bare, fitted].map(|fit| search.usual_error(fit)[joint]);
    let rival = smooth.usual_error(&search.problem, &bare, &search.noise)[joint];
    let does_worse = with > WORSE * rival && before - with < CLOSED * (before - rival);
    (does_worse || fails_elsewhere(search, &bare, fitted, joint)).then_some(bare)
}

/// Whether what `fitted` has more than `bare` makes the error of a joint larger at positions or speeds that were left out.
fn fails_elsewhere(search: &Search<'_>, bare: &Fitted, fitted: &Fitted, joint: usize) -> bool {
    let [without, with] = [bare, fitted].map(|fit| errors_elsewhere(&search.problem, fit, &search.noise, joint));
    without.iter().zip(with).any(|(without, with)| with > WORSE * without)
}

/// The joint at which effects of the whole arm explain more than at all others together, if there is one.
fn joint_of_arm(search: &Search<'_>, outcome: &Outcome) -> Option<usize> {
    let terms = outcome.fitted.terms();
    let out: Vec<usize> = outcome.news(search).map(|(k, _)| k).filter(|k| terms[*k].site == Site::Arm).collect();
    if out.is_empty() {
        return None;
    }
    let bare = search.refit(&outcome.fitted, without(terms, &out));
    let energy = |white: &[f64]| white.iter().map(|w| w * w).sum::<f64>();
    let falls: Vec<f64> =
        bare.white.iter().zip(&outcome.fitted.white).map(|(bare, fitted)| energy(bare) - energy(fitted)).collect();
    let all: f64 = falls.iter().sum();
    falls.iter().position(|fall| *fall > 0.5 * all)
}
