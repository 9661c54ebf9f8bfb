//! From scores to probabilities.

use super::answer::Finding;
use super::search::{Accepted, Candidate, Outcome, Search};
use super::unknown::Leftover;

/// What decides between known and unknown.
#[derive(Clone, Copy, Debug)]
pub(super) struct VerdictFeatures {
    /// Log evidence of the known effects, and of a Gaussian process on what they leave.
    pub known: f64,
    pub unknown: f64,
    /// Fall of the held-out error that the Gaussian process brings.
    pub unknown_size: f64,
}

impl VerdictFeatures {
    /// Of a search and of what it leaves at each joint.
    pub fn of(outcome: &Outcome, left: &[Leftover]) -> Self {
        Self {
            known: 0.5 * (outcome.start.chi2 - outcome.fitted.chi2),
            unknown: left.iter().map(|l| l.evidence.max(0.0)).sum(),
            unknown_size: left.iter().map(|l| l.effect_size).fold(0.0, f64::max),
        }
    }

    /// More is left that matters than known effects explain.
    pub fn is_unexplained(&self) -> bool {
        self.unknown > 12.0 && self.unknown_size > 0.05 && self.unknown > 0.5 * self.known
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// A term that was found.
pub(super) struct Believed<'o> {
    /// Of the term in the fit.
    pub index: usize,
    /// What the search knows of it.
    pub accepted: &'o Accepted,
    /// Probability that it is there: at this joint, where others explain as much.
    pub probability: f64,
    /// Probability that it or a rival is there: of what has most evidence; beside that, a form that is not quite right may
    /// leave what many effects explain, and it is the probability of this one.
    pub something: f64,
}

/// Every term that was found with its probabilities.
pub(super) fn probabilities<'o>(
    search: &Search<'_>,
    outcome: &'o Outcome,
    verdict: &VerdictFeatures,
) -> Vec<Believed<'o>> {
    let strongest = outcome.news(search).map(|(_, accepted)| accepted.score).fold(1.0, f64::max);
    let believed = |(index, accepted): (usize, &'o Accepted)| {
        let rival = accepted.rivals.iter().map(|(_, _, score)| *score).fold(0.0, f64::max);
        let lead = ((accepted.first_score - rival) / accepted.first_score.max(1.0)).clamp(0.0, 1.0);
        let lead_of_something = if accepted.score >= strongest { 1.0 } else { lead };
        let [probability, something] =
            [lead, lead_of_something].map(|lead| probability(accepted, lead, strongest, verdict));
        let probability = probability / (1 + accepted.twins.len()) as f64;
        Believed { index, accepted, probability, something }
    };
    outcome.news(search).map(believed).collect()
}

/// Probability that an accepted term is there which leads its rivals by a share of its score; `strongest` is the score of
/// the finding with most evidence. Little evidence, and less than a tenth of the strongest's, is what is left by forms that
/// are not quite right.
fn probability(accepted: &Accepted, lead: f64, strongest: f64, verdict: &VerdictFeatures) -> f64 {
    const MUCH: f64 = 100.0;
    const SMALL: f64 = 0.1;
    let size = (accepted.effect_size / 0.05).ln().clamp(-3.0, 3.0);
    let left = verdict.unknown / (verdict.unknown + verdict.known).max(1.0);
    let little = (accepted.first_score.max(1.0) / MUCH).ln().min(0.0);
    let beside = (accepted.score.max(1.0) / (SMALL * strongest)).log10().min(0.0);
    logistic(1.2 + 3.0 * lead + 0.8 * size - 4.0 * left + 0.5 * (little + beside)).clamp(0.01, 0.99)
}

/// Probability that nothing material is missing.
pub(super) fn nothing_missing<'a>(accepted: impl Iterator<Item = &'a Accepted>, verdict: &VerdictFeatures) -> f64 {
    let strongest = accepted.map(|a| (a.effect_size / 0.015).ln()).fold(-3.0, f64::max);
    let unknown = if verdict.unknown > 12.0 { (verdict.unknown_size.max(1e-6) / 0.05).ln() } else { -3.0 };
    logistic(-1.5 - 1.5 * strongest.max(unknown)).clamp(0.01, 0.99)
}

/// Probability that something is missing that no known effect explains.
pub(super) fn unexplained(verdict: &VerdictFeatures) -> f64 {
    if verdict.unknown < 12.0 {
        return 0.02;
    }
    let share = (verdict.unknown / (0.5 * verdict.known).max(1.0)).ln();
    let size = (verdict.unknown_size.max(1e-6) / 0.05).ln();
    logistic(2.0 * share.min(size)).clamp(0.01, 0.99)
}

/// Probability of an effect that was tested and not accepted: a share of what the best finding leaves.
pub(super) fn of_candidate(candidate: &Candidate, best: Option<&Finding>) -> f64 {
    if candidate.impossible || candidate.score < 0.0 {
        return 0.001;
    }
    let share = best.map_or(0.5, |best| candidate.score / best.score.max(1.0)).clamp(0.0, 1.0);
    (0.3 * share * best.map_or(1.0, |best| 1.0 - best.probability)).clamp(0.001, 0.3)
}
