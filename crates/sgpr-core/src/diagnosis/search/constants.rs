//! Constants of effects, refined, and all parameters with them.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::basis::{Basis, Gain, INVISIBLE, gain_with};
use super::super::fit::{Fitted, refine_transforms, solve_like, without};
use super::super::problem::Column;
use super::candidates::Candidate;
use super::held_out::{Outlook, Standing};
use super::times::TIME_STEP;
use super::{EVIDENCE, Search, material};
use crate::effects::Scale;
use crate::model::{Term, times_of};
use crate::progress::Interrupted;

/// Whether what begins and ends lasts long enough to be something else than one wrong moment of the
/// log.
pub(super) fn lasts(term: &Term, constants: &[f64]) -> bool {
    /// Shortest time, s.
    const SHORTEST_S: f64 = 0.2;
    let times: Vec<f64> = times_of(term.effect.as_ref(), constants).collect();
    times.windows(2).all(|pair| pair[1] - pair[0] >= SHORTEST_S)
}

/// A candidate and what is to be expected of it.
#[derive(Clone, Debug)]
pub(super) struct Promise {
    pub candidate: Candidate,
    pub outlook: Outlook,
}

/// Most candidates whose constants are refined at once.
pub(super) const MOST_REFINED: usize = 8;

/// Farthest step of a time before it is refined, in steps of the grid.
pub(super) const FARTHEST_JUMP: i32 = 8;

impl Search<'_> {
    /// A term with other constants, the others of the model refitted linearly.
    pub(super) fn with_constants(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        term: &Term,
        constants: &[f64],
    ) -> Candidate {
        let term = Term::new(term.effect.clone(), term.site, constants.to_vec());
        let columns = self.problem.term_columns(&fitted.model, &fitted.rigid, &term);
        let precision = self.precision(&term, &columns);
        let columns: Vec<Column> =
            columns.iter().map(|c| self.noise.whiten(&self.problem, c)).collect();
        let gain = gain_with(&basis.shares(&columns), white, (&columns, &precision), INVISIBLE);
        self.candidate(term, gain, constants.len())
    }

    /// The constants of a term searched coordinate by coordinate, the others of the model refitted
    /// linearly.
    pub fn refine(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        candidate: &Candidate,
    ) -> Candidate {
        let term = &candidate.term;
        if term.is_transform() || term.constants.is_empty() {
            return candidate.clone();
        }
        let evaluate =
            |constants: &[f64]| self.with_constants(fitted, (basis, white), term, constants);
        let mut best = evaluate(&candidate.term.constants);
        let count = term.constants.len();
        // Between two logs there are no rows, and all times are equal there: steps must reach the
        // other side.
        for k in (0..count).filter(|k| term.effect.constants()[*k].scale == Scale::Time) {
            let [low, high] = self.bounds(term, k);
            let start = best.term.constants.clone();
            for step in (-FARTHEST_JUMP..=FARTHEST_JUMP).filter(|step| *step != 0) {
                let mut constants = start.clone();
                constants[k] = (constants[k] + f64::from(step) * TIME_STEP).clamp(low, high);
                let next = Some(evaluate(&constants)).filter(|_| lasts(term, &constants));
                best = next.filter(|next| next.gain.chi2 > best.gain.chi2).unwrap_or(best);
            }
        }
        let mut steps: Vec<f64> = (0..count)
            .map(|k| match term.effect.constants()[k].scale {
                Scale::Logarithmic => 0.5,
                Scale::Linear(step) => step,
                Scale::Position => 0.06 * (self.bounds(term, k)[1] - self.bounds(term, k)[0]),
                Scale::PositionWidth | Scale::Torque => 0.4 * term.constants[k],
                Scale::Time => 0.5 * TIME_STEP,
                Scale::Order => 0.3,
                Scale::Neutral { step } => step,
            })
            .collect();
        // A step in the torque that is a few samples off leaves a spike.
        let exact =
            |k: usize| if term.effect.constants()[k].scale == Scale::Time { 0.002 } else { 0.03 };
        let smallest: Vec<f64> =
            steps.iter().enumerate().map(|(k, step)| exact(k) * step).collect();
        let logarithmic = |k: usize| term.effect.constants()[k].scale == Scale::Logarithmic;
        for _ in 0..40 {
            let mut moved = false;
            for k in 0..count {
                let [low, high] = self.bounds(term, k);
                for direction in [1.0, -1.0] {
                    let mut constants = best.term.constants.clone();
                    let value = constants[k];
                    let step = direction * steps[k];
                    constants[k] = if logarithmic(k) { value * step.exp() } else { value + step }
                        .clamp(low, high);
                    if constants[k] == value || !lasts(term, &constants) {
                        continue;
                    }
                    let next = evaluate(&constants);
                    if !next.impossible
                        && (best.impossible || next.gain.chi2 > best.gain.chi2 + 0.02)
                    {
                        best = next;
                        moved = true;
                        break;
                    }
                }
            }
            if !moved {
                steps.iter_mut().for_each(|step| *step *= 0.45);
                if steps.iter().zip(&smallest).all(|(step, smallest)| step < smallest) {
                    break;
                }
            }
        }
        Candidate { stands_out: candidate.stands_out, ..best }
    }

    /// Candidates that may matter by what left-out blocks say of them, the most promising first.
    /// How much of the whitened leftover they explain is no measure across joints: what the model
    /// lacks at one would hide all that others lack.
    pub(super) fn promising(
        &self,
        fitted: &Fitted,
        standing: &Standing,
        candidates: &[Candidate],
    ) -> Vec<Candidate> {
        /// Least gain on left-out blocks, in its standard deviations, before constants are refined.
        const CHANCE: f64 = 1.0;
        let own = |c: &&Candidate| {
            !c.impossible && c.score > EVIDENCE && c.term.effect.refines().is_none()
        };
        let own: Vec<&Candidate> = candidates.iter().filter(own).collect();
        let outlook = |candidate: &&Candidate| {
            let term = &candidate.term;
            match self.cached(term) {
                Some(columns) => self.outlook(standing, term, columns),
                None => self.outlook(standing, term, &self.columns_of(fitted, term)),
            }
        };
        let outlooks: Vec<Outlook> = own.par_iter().map(outlook).collect();
        let all =
            own.into_iter().zip(outlooks).filter(|(_, outlook)| outlook.significance > CHANCE);
        let mut promising: Vec<(&Candidate, f64)> =
            all.map(|(candidate, outlook)| (candidate, outlook.density)).collect();
        promising.sort_by(|a, b| b.1.total_cmp(&a.1));
        promising.into_iter().map(|(candidate, _)| candidate.clone()).collect()
    }

    /// Candidates with their constants refined that may still matter, the most promising first.
    pub(super) fn refined(
        &self,
        fitted: &Fitted,
        standing: &Standing,
        residual: (&Basis, &Column),
        candidates: &[Candidate],
    ) -> Result<Vec<Promise>, Interrupted> {
        /// Of what is asked of the model fitted with it: its other constants may still move.
        const NEARLY: f64 = 0.8;
        /// The same of a transform: tangents flatter it and wrong it.
        const BY_TANGENTS: f64 = 0.4;
        self.progress.step("refine constants", 0, 1)?;
        let refine = |candidate: &Candidate| {
            let refined = self.refine(fitted, residual, candidate);
            let columns = self.columns_of(fitted, &refined.term);
            let outlook = self.outlook(standing, &refined.term, &columns);
            Promise { candidate: refined, outlook }
        };
        let mut tried: Vec<Promise> = candidates.par_iter().map(refine).collect();
        self.progress.step("refine constants", 1, 1)?;
        tried.retain(|Promise { candidate, outlook }| {
            let share = if candidate.term.is_transform() { BY_TANGENTS } else { NEARLY };
            let is_sure = candidate.stands_out || outlook.significance > share * self.sure;
            let matters = is_sure && outlook.fall > share * material(&candidate.term);
            matters && !candidate.impossible && candidate.score > EVIDENCE
        });
        tried.sort_by(|a, b| b.outlook.density.total_cmp(&a.outlook.density));
        Ok(tried)
    }

    /// The fit with one more term, all constants refined.
    pub fn with_term(&self, fitted: &Fitted, term: Term) -> Fitted {
        let mut terms = fitted.terms().to_vec();
        terms.push(term);
        self.refit(fitted, terms)
    }

    pub fn refit(&self, like: &Fitted, terms: Vec<Term>) -> Fitted {
        let mut next = solve_like(&self.problem, like, &terms, &self.noise);
        // Columns that follow the torque of the model are those of the fit before.
        if terms.iter().any(|term| term.effect.follows_torque()) {
            for _ in 0..2 {
                next = solve_like(&self.problem, &next, &terms, &self.noise);
            }
        }
        refine_transforms(&self.problem, next, &self.noise)
    }

    /// The fit without the term at `index`, all else refitted.
    pub fn bare(&self, fitted: &Fitted, index: usize) -> Arc<Fitted> {
        fitted.bare(index, &self.noise, || {
            self.refit(fitted, super::without(fitted.terms(), &[index]))
        })
    }

    /// The fit with the constants of those terms looked for anew that a removed one at their joint
    /// is confused with: it may have stood for them while they described only what it left.
    pub(super) fn with_imitated(&self, mut fitted: Fitted, removed: &Term) -> Fitted {
        let confused = |term: &Term| {
            let says = |a: &Term, b: &Term| a.effect.about().confusable.contains(&b.effect.name());
            term.site == removed.site
                && !term.is_transform()
                && (says(term, removed) || says(removed, term))
        };
        for k in 0..fitted.terms().len() {
            let term = fitted.terms()[k].clone();
            if self.points(term.effect.as_ref(), term.site).len() < 2 || !confused(&term) {
                continue;
            }
            let without = without(&self.problem, &fitted, k, &self.noise);
            let Some(best) = self.best_constants(&without, &term) else { continue };
            let mut terms = fitted.terms().to_vec();
            terms[k].constants = best.constants;
            let next = self.refit(&fitted, terms);
            if next.chi2 < fitted.chi2 {
                fitted = next;
            }
        }
        fitted
    }

    /// A term beside a fit with its constants at the best point of their grids, refined, if there
    /// is a possible one.
    pub(super) fn best_constants(&self, bare: &Fitted, term: &Term) -> Option<Term> {
        let residual = (bare.basis.as_ref(), &bare.white);
        let points = self.points(term.effect.as_ref(), term.site).into_iter();
        let candidates = points.map(|point| self.with_constants(bare, residual, term, &point));
        let best =
            candidates.filter(|c| !c.impossible).max_by(|a, b| a.score.total_cmp(&b.score))?;
        Some(self.refine(bare, residual, &best).term)
    }

    /// Every term's constants once more, the others given.
    pub fn polish(&self, fitted: Fitted) -> Fitted {
        let mut fitted = fitted;
        for k in 0..fitted.terms().len() {
            let term = fitted.terms()[k].clone();
            if term.is_transform() || term.constants.is_empty() {
                continue;
            }
            let without = without(&self.problem, &fitted, k, &self.noise);
            let candidate = Candidate {
                term,
                gain: Gain::default(),
                score: 0.0,
                impossible: false,
                stands_out: false,
                errors: None,
            };
            let refined = self.refine(&without, (&without.basis, &without.white), &candidate);
            let mut terms = fitted.terms().to_vec();
            terms[k].constants = refined.term.constants;
            let next = solve_like(&self.problem, &fitted, &terms, &self.noise);
            if next.chi2 < fitted.chi2 {
                fitted = next;
            }
        }
        refine_transforms(&self.problem, fitted, &self.noise)
    }
}
