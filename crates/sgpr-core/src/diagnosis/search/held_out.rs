//! Errors on blocks that were left out.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::by_log::ByLog;
use super::super::evidence::{Comparison, LeftOut, surprise};
use super::super::fit::{Fitted, beyond, by_log};
use super::super::left_out::{Extra, FoldFits};
use super::super::problem::{Column, Problem};
use super::super::unknown::MATTERS;
use super::candidates::Candidate;
use super::{MATERIAL, Search};
use crate::effects::Reach;
use crate::model::Term;
use crate::progress::Interrupted;

/// Smallest fall of a left-out error on some joint that matters, as a share of what is left: of a
/// torque in the band, of a transform as logged.
pub(in super::super) fn material(term: &Term) -> f64 {
    if term.is_transform() { MATERIAL } else { MATTERS }
}

/// An error of nothing, N·m (N).
const TINY: f64 = 1e-12;

/// Errors per joint on blocks that were left out, in the band and beyond it.
#[derive(Clone, Debug)]
pub(in super::super) struct HeldOut {
    pub left_out: LeftOut,
    in_band: Vec<ByLog>,
    beyond: Vec<ByLog>,
}

impl HeldOut {
    /// - `beyond`: errors beyond the band
    pub(super) fn new(problem: &Problem, left_out: LeftOut, beyond: Vec<ByLog>) -> Self {
        Self { in_band: by_log(problem, &left_out.rows), left_out, beyond }
    }

    /// The same fit with other errors in the band.
    pub(super) fn with_others(&self, problem: &Problem, left_out: LeftOut) -> Self {
        Self::new(problem, left_out, self.beyond.clone())
    }

    /// Of all logs together, per joint, N·m (N).
    pub(in super::super) fn total(&self) -> Vec<f64> {
        self.in_band.iter().zip(&self.beyond).map(|(own, beyond)| own[0].hypot(beyond[0])).collect()
    }

    /// Whether one more term makes the error of a joint many times as large: its parameters hang on
    /// a few rows.
    pub(super) fn explodes_to(&self, after: &Self) -> bool {
        /// Many times.
        const TIMES: f64 = 10.0;
        self.total().iter().zip(after.total()).any(|(own, after)| after > TIMES * own)
    }

    /// Whether the errors of some joints together are larger after, of some by more than those of
    /// others are smaller.
    fn is_worse_at(&self, after: &Self, joints: &[usize]) -> bool {
        let [own, after] = [self, after].map(Self::total);
        joints
            .iter()
            .map(|&joint| (own[joint].max(TINY) / after[joint].max(TINY)).ln())
            .sum::<f64>()
            < 0.0
    }

    /// Largest fall on a joint with one more term, as a share of what is left, in all logs or in
    /// one: an effect of fast motion matters although there are slow logs beside. That in one of N
    /// logs counts 1/√N, as its error is known by so much less. Of a torque it is that in the band
    /// of the model: beyond it is noise of sensors, which on some robots is larger than all else. A
    /// transform changes all that was logged, and is judged by it; but one that differentiates
    /// positions once more carries their noise into the torque beyond the band, one that smooths
    /// takes it out: neither speaks for or against it.
    pub(super) fn largest_fall_to(&self, after: &Self, term: &Term) -> f64 {
        let beyond = |joint: usize, k: usize| {
            let both = [self, after].map(|errors| errors.beyond[joint][k]);
            let least = both[0].min(both[1]);
            match term {
                _ if is_limit(term) => both,
                _ if term.is_transform() => [least; 2],
                _ => [0.0; 2],
            }
        };
        let fall = |joint: usize, k: usize| {
            let [before, with] = beyond(joint, k);
            let [own, own_after] = [self, after].map(|errors| errors.in_band[joint][k]);
            let fall = own.hypot(before) / own_after.hypot(with).max(TINY) - 1.0;
            let logs = (self.in_band[joint].len() - 1) as f64;
            if k == 0 { fall } else { fall / logs.sqrt() }
        };
        let of_joint = |joint: usize| (0..self.in_band[joint].len()).map(move |k| fall(joint, k));
        (0..self.in_band.len()).flat_map(of_joint).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Where a fit stands on blocks that were left out.
pub(super) struct Standing {
    fits: Arc<FoldFits>,
    pub errors: HeldOut,
}

/// What left-out blocks say of one more term, the others of the model refitted linearly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outlook {
    /// Gain of the log predictive density at the joints on which it acts.
    pub density: f64,
    /// Gain in its standard deviations.
    pub significance: f64,
    /// Largest fall of the error on a joint, as a share of what is left.
    pub fall: f64,
}

impl Search<'_> {
    pub(super) fn standing(&self, fitted: &Fitted) -> Standing {
        let fits = fitted.folds(&self.problem, &self.noise);
        let errors = HeldOut::new(&self.problem, fits.errors(), beyond(&self.problem, fitted));
        Standing { fits, errors }
    }

    /// What is to be expected of a term; a transform by its tangents.
    ///
    /// - `columns`: of the term, in the band
    pub(super) fn outlook(&self, standing: &Standing, term: &Term, columns: &[Column]) -> Outlook {
        let joints = self.joints_of(term);
        let precision = &self.precision(term, columns);
        let with = standing.fits.errors_with(&Extra { columns, precision }, &joints);
        let density = standing.errors.left_out.density_gain(&with, &self.problem, &joints);
        let with = standing.errors.with_others(&self.problem, with);
        let significance = self.comparison(&standing.errors, &with, term).significance();
        Outlook { density, significance, fall: standing.errors.largest_fall_to(&with, term) }
    }

    /// Error per joint on blocks that were left out, N·m (N).
    pub fn held_out(&self, fitted: &Fitted) -> Vec<f64> {
        self.errors(fitted).total()
    }

    pub(in super::super) fn errors(&self, fitted: &Fitted) -> HeldOut {
        HeldOut::new(&self.problem, self.left_out(fitted), beyond(&self.problem, fitted))
    }

    /// Those in the band alone.
    pub(in super::super) fn left_out(&self, fitted: &Fitted) -> LeftOut {
        fitted.folds(&self.problem, &self.noise).errors()
    }

    /// What the best candidates do to the errors on blocks that were left out: all parameters are
    /// refitted beside each, its constants stay.
    pub(super) fn judge_best(
        &self,
        fitted: &Fitted,
        standing: &Standing,
        candidates: &mut [Candidate],
    ) -> Result<(), Interrupted> {
        const STAGE: &str = "errors of effects";
        /// Of those with evidence.
        const MOST: usize = 16;
        /// Candidates between two words to the listener.
        const AT_ONCE: usize = 4;
        let has_evidence = |c: &&mut Candidate| {
            !c.impossible && c.score > 0.0 && c.term.effect.refines().is_none()
        };
        let mut best: Vec<&mut Candidate> =
            candidates.iter_mut().filter(has_evidence).take(MOST).collect();
        let all = self.all_joints();
        let count = best.len();
        for (index, some) in best.chunks_mut(AT_ONCE).enumerate() {
            self.step(STAGE, AT_ONCE * index, count)?;
            some.par_iter_mut().for_each(|candidate| {
                let columns = self.columns_of(fitted, &candidate.term);
                let precision = &self.precision(&candidate.term, &columns);
                let with = standing.fits.errors_with(&Extra { columns: &columns, precision }, &all);
                let with = standing.errors.with_others(&self.problem, with);
                candidate.errors = Some([standing.errors.total(), with.total()]);
            });
        }
        self.step(STAGE, count, count)
    }

    /// A model without a term against the same with it, at the joints on which the term acts.
    pub(in super::super) fn comparison(
        &self,
        without: &HeldOut,
        with: &HeldOut,
        term: &Term,
    ) -> Comparison {
        without.left_out.against(&with.left_out, &self.problem, &self.joints_of(term))
    }

    /// Whether left-out blocks are surely predicted better with a term, and speak for it more than
    /// what is known of its constants before any data speaks against it. What refines a given effect
    /// need not be sure, and rows at a limit of the torque are no equations.
    pub(super) fn is_sure(&self, without: &HeldOut, with: &HeldOut, term: &Term) -> bool {
        let asked = !is_limit(term) && term.effect.refines().is_none();
        let is_likely = |gain: Comparison| {
            gain.significance() >= self.sure && gain.largest_log_bayes_factor() >= surprise(term)
        };
        !asked || is_likely(self.comparison(without, with, term))
    }

    /// Whether a torque makes the errors of the joints on which it acts larger: what lowers them in
    /// the band may ring beyond it.
    pub(super) fn is_worse_with(&self, without: &HeldOut, with: &HeldOut, term: &Term) -> bool {
        !term.is_transform() && without.is_worse_at(with, &self.joints_of(term))
    }

    /// Joints on which a term acts.
    pub(in super::super) fn joints_of(&self, term: &Term) -> Vec<usize> {
        match term
            .site
            .joint()
            .filter(|_| term.effect.reach() == Reach::Own && !term.is_transform())
        {
            Some(joint) => vec![joint],
            None => self.all_joints(),
        }
    }

    pub(super) fn all_joints(&self) -> Vec<usize> {
        (0..self.problem.dof()).collect()
    }
}

/// Whether a term cuts the torque. Rows at the limit are no equations: it shows in the torque as
/// logged.
pub(in super::super) fn is_limit(term: &Term) -> bool {
    term.site
        .joint()
        .is_some_and(|joint| term.effect.limit(term.site, &term.constants, joint).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_helps_one_joint_and_harms_two_or_rings_beyond_the_band_is_none() {
        let errors = |own: [f64; 3]| HeldOut {
            left_out: LeftOut { rows: vec![] },
            in_band: own.map(|e| vec![e]).to_vec(),
            beyond: vec![vec![0.0]; 3],
        };
        let before = errors([1.0, 1.0, 1.0]);
        let arm = [0, 1, 2];
        assert!(before.is_worse_at(&errors([0.95, 1.1, 1.1]), &arm));
        assert!(!before.is_worse_at(&errors([0.95, 1.02, 1.02]), &arm));
        assert!(!before.is_worse_at(&errors([0.95, 1.1, 1.1]), &[0]));
        let rings =
            HeldOut { beyond: vec![vec![6.0], vec![0.0], vec![0.0]], ..errors([0.5, 1.0, 1.0]) };
        assert!(before.is_worse_at(&rings, &[0]));
    }
}
