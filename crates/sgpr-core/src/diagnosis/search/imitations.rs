//! Effects that only imitate a law of the state that no catalogue has.

use rayon::prelude::*;

use super::super::evidence::{LeftOut, weights};
use super::super::fit::{Fitted, left_out_states};
use super::super::unknown::Processes;
use super::{EVIDENCE, Search, without};

/// So many effects at one joint beside which something is left explain a law bit by bit.
pub(super) const MANY: usize = 3;

/// As likely as two standard deviations.
pub(in super::super) const CERTAIN: f64 = 0.95;

/// Of the terms at some indices of a fit, which act at a joint, those that only imitate a smooth
/// function of its state. They are asked where that function predicts left-out blocks better than
/// they do, or could still explain beside them more than half of what they do; or something that
/// matters beside many of them.
///
/// - `left`: share of the joint's left-out error that it could still take away
pub(in super::super) fn imitations(
    search: &Search<'_>,
    fitted: &Fitted,
    found: &[usize],
    (joint, left): (usize, f64),
    processes: &Processes,
) -> Vec<usize> {
    if found.is_empty() {
        return vec![];
    }
    let (problem, noise) = (&search.problem, &search.noise);
    let bare = search.refit(fitted, without(fitted.terms(), found));
    let Some((smooth, with_smooth)) = processes.best(problem, &bare, noise, &[joint]) else {
        return vec![];
    };
    let with_found = search.errors(fitted).left_out;
    let explained = explained_share(joint, &search.errors(&bare).left_out, &with_found);
    let weight_of_smooth = |found: &LeftOut, smooth: &LeftOut| {
        weights(problem, &[found, smooth], &[0.0; 2], &[joint])[1]
    };
    let of_smooth = weight_of_smooth(&with_found, &with_smooth);
    // A change that no log shows is confounded with all that logs differ in: it stands where
    // nothing else is in question, or where it surely predicts whole logs better, of which only
    // those before and after it know.
    let between = |k: &usize| search.is_between_logs(&fitted.terms()[*k]);
    let between: Vec<usize> = found.iter().copied().filter(between).collect();
    if !between.is_empty() && (left > 0.0 || of_smooth > 1.0 - CERTAIN) {
        let with_found = fitted.part_fits(problem, noise).errors();
        let with_smooth =
            processes.errors_of(&smooth, problem, &bare.part_fits(problem, noise), &[joint]);
        if weight_of_smooth(&with_found, &with_smooth) > 1.0 - CERTAIN {
            return between;
        }
    }
    let much_is_left = is_much(left, explained) || (left > 0.0 && found.len() >= MANY);
    if !much_is_left && of_smooth < CERTAIN {
        return vec![];
    }
    // Terms that hold at positions and speeds that they were not fitted to ...
    let holds = |k: &usize| between.contains(k) || holds_elsewhere(search, fitted, *k, joint);
    let mut kept: Vec<usize> = found.iter().copied().filter(holds).collect();
    // ... and those that have evidence beside the process, the strongest first.
    let mut best = smooth.evidence;
    loop {
        let trial = |k: usize| {
            let out: Vec<usize> =
                found.iter().copied().filter(|f| *f != k && !kept.contains(f)).collect();
            let with = search.refit(fitted, without(fitted.terms(), &out));
            search.score_of(&bare, &with)
                + processes.evidence_beside(&smooth, problem, &with, noise)
        };
        let rest: Vec<usize> = found.iter().copied().filter(|k| !kept.contains(k)).collect();
        let evidence: Vec<(usize, f64)> = rest.into_par_iter().map(|k| (k, trial(k))).collect();
        match evidence.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((k, evidence)) if evidence > best + EVIDENCE => {
                kept.push(k);
                best = evidence;
            }
            _ => break,
        }
    }
    found.iter().copied().filter(|k| !kept.contains(k)).collect()
}

/// By how much the square of a joint's left-out error falls with something, as a share of what is
/// left of it.
pub(in super::super) fn explained_share(joint: usize, without: &LeftOut, with: &LeftOut) -> f64 {
    without.mean_square(joint) / with.mean_square(joint) - 1.0
}

/// Whether more than half of what was explained could be explained beside it.
///
/// - `left`: share of the left-out error that a process could still take away
pub(in super::super) fn is_much(left: f64, explained: f64) -> bool {
    /// Half of what is explained is much.
    const HALF: f64 = 0.5;
    1.0 - (1.0 - left).powi(2) > HALF * explained
}

/// Whether a term of a fit surely lowers the error of a joint on fifths of its positions, and on
/// fifths of its speeds, that were left out.
fn holds_elsewhere(search: &Search<'_>, fitted: &Fitted, index: usize, joint: usize) -> bool {
    let (problem, noise) = (&search.problem, &search.noise);
    let bare = search.bare(fitted, index);
    let [without, with] = [&bare, fitted].map(|fit| left_out_states(problem, fit, noise, joint));
    without.iter().zip(&with).all(|(without, with)| {
        without.against(with, problem, &[joint]).significance() >= search.sure
    })
}
