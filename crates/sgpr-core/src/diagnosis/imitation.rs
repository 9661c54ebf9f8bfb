//! Effects that imitate what no effect of the catalogue makes.
//!
//! A torque from outside of the catalogue is explained bit by bit by effects that happen to look like parts of it. They
//! are found out by a rival: a Gaussian process on the state of the joint in place of all that was found there. An effect
//! that is there beats it, as it says the same with fewer parameters; imitations together do not.

use super::search::{EVIDENCE, Outcome, Search};
use super::unknown::Smooth;
use crate::effects::Site;
use crate::model::Term;
use crate::progress::Interrupted;

/// The Gaussian process has so many times the evidence of imitations ...
const MORE: f64 = 1.01;

/// ... which leave so much more of the held-out error than the Gaussian process ...
const WORSE: f64 = 1.05;

/// ... and close less than this share of what it closes: the right effect in a somewhat different form closes more.
const CLOSED: f64 = 0.9;

/// `outcome` without the effects at joints where a smooth function of the state does better than all of them.
pub(super) fn without_imitations(search: &Search<'_>, mut outcome: Outcome) -> Result<Outcome, Interrupted> {
    let of_arm = joint_of_arm(search, &outcome);
    for joint in 0..search.problem.dof() {
        let terms = outcome.fitted.terms();
        let at_joint = |site: Site| match site {
            Site::Joint(own) | Site::Pair(own, _) => own == joint,
            Site::Arm => of_arm == Some(joint),
        };
        let out: Vec<usize> = outcome.news(search).map(|(k, _)| k).filter(|k| at_joint(terms[*k].site)).collect();
        if out.is_empty() {
            continue;
        }
        let bare = search.refit(&outcome.fitted, without(terms, &out));
        let found = search.score_of(&bare, &outcome.fitted);
        let Some(smooth) = Smooth::best(&search.problem, &bare, &search.noise, joint) else { continue };
        if smooth.evidence < (found + EVIDENCE).max(MORE * found) {
            continue;
        }
        let [before, with] = [search.held_out(&bare)[joint], outcome.held_out[joint]];
        let rival = smooth.held_out(&search.problem, &bare, &search.noise)[joint];
        if with < WORSE * rival || before - with > CLOSED * (before - rival) {
            continue;
        }
        let given = terms.len() - outcome.accepted.len();
        let mut index = given..;
        outcome.accepted.retain(|_| !index.next().is_some_and(|k| out.contains(&k)));
        (outcome.fitted, outcome.accepted) = search.backward(bare, outcome.accepted)?;
        outcome.held_out = search.held_out(&outcome.fitted);
    }
    Ok(outcome)
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

/// Terms but those at some indices.
fn without(terms: &[Term], out: &[usize]) -> Vec<Term> {
    (0..terms.len()).filter(|k| !out.contains(k)).map(|k| terms[k].clone()).collect()
}
