//! How much of the leftover each candidate explains.

use std::collections::HashMap;
use std::ops::RangeInclusive;

use rayon::prelude::*;

use super::super::basis::{Basis, Gain, INVISIBLE, gain, gain_with, invisible};
use super::super::fit::{Fitted, tangents};
use super::super::problem::Column;
use super::super::remembered::key_of;
use super::candidates::Candidate;
use super::{EVIDENCE, Search};
use crate::effects::{Dimension, Site};
use crate::model::Term;
use crate::progress::Interrupted;

impl Search<'_> {
    /// The columns of the fit and those that take up what constants of the model may be wrong by.
    pub fn with_nuisances(&self, fitted: &Fitted) -> (Basis, Column) {
        /// Friction at creeping speed beyond dry friction, as a share of it, that is an effect of
        /// its own: what is larger is nothing that lubricants do.
        const BREAKAWAY: RangeInclusive<f64> = 0.3..=3.0;
        let mut basis = Basis::clone(&fitted.basis);
        let problem = &self.problem;
        for joint in 0..problem.dof() {
            if let Some(dry) = fitted.dry_friction(joint) {
                let width = fitted
                    .model
                    .processing()
                    .map_or(0.003, |p| p.standstill_speed[joint])
                    .clamp(0.002, 0.01);
                let widths = [width, 3.0 * width];
                let columns = problem.reversal_columns(&fitted.model, &fitted.rigid, joint, widths);
                let columns: Vec<Column> =
                    columns.iter().map(|column| self.noise.whiten(problem, column)).collect();
                if !BREAKAWAY.contains(&(self.friction_at_creep(fitted, widths, &columns) / dry)) {
                    columns.into_iter().for_each(|column| basis.push(column.into()));
                }
            }
        }
        let constants: Vec<(usize, usize)> = fitted.constants().collect();
        tangents(problem, fitted, &self.noise, &constants)
            .into_iter()
            .for_each(|tangent| basis.push(tangent.into()));
        let mut white = self.noise.whiten(problem, &fitted.target);
        basis.project_out(&mut white);
        (basis, white)
    }

    /// Friction at creeping speed beyond dry friction, N·m (N), that whitened columns which fall
    /// off over two ranges of speed say is there; zero without evidence.
    fn friction_at_creep(&self, fitted: &Fitted, widths: [f64; 2], columns: &[Column]) -> f64 {
        let gain = gain(&fitted.basis, &fitted.white, columns, INVISIBLE);
        let evidence =
            0.5 * gain.chi2 - 0.5 * gain.rank as f64 * self.rows.max(2.0).ln() - self.units.ln();
        if evidence < EVIDENCE {
            return 0.0;
        }
        let at = |speed: f64| -> f64 {
            gain.coefficients
                .iter()
                .zip(widths)
                .map(|(factor, width)| factor * (-speed / width).exp())
                .sum()
        };
        (0..20).map(|k| at(0.25 * f64::from(k) * widths[0])).fold(0.0, f64::max)
    }

    /// Precision of the factors of a term's columns before any data; the constants of a transform
    /// have ranges instead.
    pub(super) fn precision(&self, term: &Term, columns: &[Column]) -> Vec<f64> {
        if term.is_transform() {
            vec![]
        } else {
            columns.iter().map(|column| self.problem.precision(column)).collect()
        }
    }

    pub(super) fn candidate(&self, term: Term, gain: Gain, constants: usize) -> Candidate {
        let size = (gain.rank + constants) as f64;
        let score = 0.5 * gain.chi2 - 0.5 * size * self.rows.max(2.0).ln() - self.units.ln();
        let score = if gain.visible < invisible(&term) { f64::NEG_INFINITY } else { score };
        let signs = term.effect.parameters().iter().zip(&gain.coefficients);
        let first_negative =
            signs.take(1).any(|(parameter, value)| parameter.non_negative && *value < 0.0);
        let out_of_bounds = term.is_transform()
            && term
                .effect
                .constants()
                .iter()
                .zip(&gain.coefficients)
                .any(|(c, x)| c.low > -1e-3 * c.high && *x < 0.0);
        let resonances = term.constants.iter().enumerate().zip(term.effect.constants());
        let at_edge = resonances
            .filter(|(_, constant)| constant.dimension() == Dimension::Frequency)
            .any(|((k, value), _)| *value > 0.98 * self.bounds(&term, k)[1]);
        let drowned = self.is_drowned(term.effect.as_ref(), term.site);
        let not_a_body = first_negative && !term.effect.is_body();
        let once = self.is_once(&term);
        let impossible = not_a_body || out_of_bounds || at_edge || drowned || once;
        Candidate { impossible, stands_out: false, term, gain, score, errors: None }
    }

    /// Every effect at every site at its best point of the grid, best first.
    pub(super) fn rank(
        &mut self,
        fitted: &Fitted,
        basis: &Basis,
        white: &Column,
    ) -> Result<Vec<Candidate>, Interrupted> {
        /// Candidates whose columns are whitened at once.
        const AT_ONCE: usize = 128;
        let mut best: HashMap<(String, Site), Candidate> = HashMap::new();
        let keep = |best: &mut HashMap<(String, Site), Candidate>, candidate: Candidate| {
            let key = (candidate.term.effect.name().to_string(), candidate.term.site);
            match best.get(&key) {
                Some(old)
                    if (old.impossible, -old.score) <= (candidate.impossible, -candidate.score) => {
                }
                _ => {
                    best.insert(key, candidate);
                }
            }
        };
        let terms = self.terms_of_ranking(fitted);
        let count = terms.len();
        self.prepare(fitted, &terms)?;
        self.progress.step("rank effects", 0, count)?;
        for some in terms.chunks(AT_ONCE) {
            let whiten = |term: &Term| -> Vec<Column> {
                self.cache[&key_of(term)]
                    .iter()
                    .map(|c| self.noise.whiten(&self.problem, c))
                    .collect()
            };
            let columns: Vec<Vec<Column>> = some.par_iter().map(whiten).collect();
            let precision = |term: &Term| self.precision(term, &self.cache[&key_of(term)]);
            let shares = basis.shares_of_many(&columns.iter().flatten().collect::<Vec<_>>());
            let mut first = 0;
            for (term, columns) in some.iter().zip(&columns) {
                let own = &shares[first..first + columns.len()];
                first += columns.len();
                let gain = gain_with(own, white, (columns, &precision(term)), invisible(term));
                let constants = if term.is_transform() { 0 } else { term.constants.len() };
                keep(&mut best, self.candidate(term.clone(), gain, constants));
            }
        }
        let mut all: Vec<Candidate> = best.into_values().collect();
        all.extend(self.scan_times(fitted, basis, white));
        all.sort_by(|a, b| {
            let key = |c: &Candidate| (c.term.effect.name().to_string(), c.term.site);
            (a.impossible, -a.score)
                .partial_cmp(&(b.impossible, -b.score))
                .unwrap_or(std::cmp::Ordering::Equal)
                .then_with(|| key(a).cmp(&key(b)))
        });
        self.progress.step("rank effects", count, count)?;
        Ok(all)
    }
}
