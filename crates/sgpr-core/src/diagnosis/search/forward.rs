//! Steps forward: what has evidence and matters is added.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::basis::Basis;
use super::super::fit::{Fitted, left_out_parts, solve_like};
use super::super::problem::Column;
use super::candidates::Candidate;
use super::constants::{MOST_REFINED, Promise};
use super::held_out::{HeldOut, Standing, is_limit, material};
use super::{Accepted, EVIDENCE, Search};
use crate::effects::{Constant, Effect, Reach, Scale, Site};
use crate::linalg::dot_in_lanes;
use crate::model::Term;
use crate::progress::Interrupted;

/// The same for a term, whose parameters were fitted: more for one with parameters that it does not
/// have by nature.
pub(super) fn asked_of(term: &Term) -> f64 {
    /// Times as large a fall of the error is asked of an effect with the opposite sign.
    const IMPLAUSIBLE: f64 = 2.5;
    match term {
        _ if term.effect.refines().is_some() => 0.0,
        _ if term.effect.is_plausible(&term.coefficients) => material(term),
        _ => IMPLAUSIBLE * material(term),
    }
}

/// Growth of a joint's error that speaks against a finer form.
pub(super) const HARM: f64 = 1.02;

/// Scores that differ by less than this share are equal ...
pub(super) const NEARLY: f64 = 0.005;

/// ... by less than this share where more speaks for the one that is behind.
const ALMOST: f64 = 0.05;

/// Whether two candidates are one effect at two joints and their scores say the same.
fn are_twins((own, score): (&Candidate, f64), (other, other_score): (&Candidate, f64)) -> bool {
    /// Scores that differ by less than this share are those of one effect at two joints.
    const TIED: f64 = 0.001;
    let same =
        own.term.effect.name() == other.term.effect.name() && own.term.site != other.term.site;
    same && (score - other_score).abs() < TIED * score
}

/// Most candidates that are fitted with the whole model in a step.
pub(super) const MOST_TRIED: usize = 4;

/// Whether a constant of a transform is at the end of its range, which holds all that can be: the
/// fit asks for what cannot.
pub(super) fn is_out_of_range(term: &Term) -> bool {
    let ends = term.effect.constants().iter().zip(&term.constants);
    let is_at_end = |(constant, value): (&Constant, &f64)| {
        matches!(constant.scale, Scale::Neutral { .. })
            && (*value <= constant.low || *value >= constant.high)
    };
    term.is_transform() && ends.filter(|(_, value)| **value != 0.0).any(is_at_end)
}

/// When a contact or a change of the load of the arm is there, s, with the time over which filters
/// carry its ends.
fn window_of_arm(term: &Term) -> Option<[f64; 2]> {
    /// Time over which the filter carries an end, s.
    const MARGIN_S: f64 = 0.5;
    let mut times = term.times().filter(|_| term.effect.reach() == Reach::All);
    Some([times.next()? - MARGIN_S, times.next().unwrap_or(f64::INFINITY) + MARGIN_S])
}

/// Half the fall of chi-squared per joint from one whitened residual to another.
pub(super) fn falls(before: &Column, after: &Column) -> Vec<f64> {
    before
        .iter()
        .zip(after)
        .map(|(before, after)| 0.5 * (dot_in_lanes(before, before) - dot_in_lanes(after, after)))
        .collect()
}

/// Candidates that promise this share of the best one's gain are tried beside it.
const CLOSE: f64 = 0.3;

/// A step forward.
pub(super) enum Next {
    /// Finer forms of effects that the model has.
    Finer(Fitted, Vec<Accepted>),
    /// One more effect.
    Term(Fitted, Accepted),
}

/// A candidate and the model fitted with it.
struct Trial<'c> {
    candidate: &'c Candidate,
    fit: Fitted,
    score: f64,
    errors: HeldOut,
}

/// Whether a candidate that changes the whitened residual from one to another is worth a fit to see
/// whether it explains most of an error.
fn may_explain_most(candidate: &Candidate, white: &Column, with: &Column) -> bool {
    /// Share of the squares of a residual that is worth a fit.
    const MUCH: f64 = 0.25;
    let energy = |own: &[f64]| dot_in_lanes(own, own);
    let explains_much =
        |(white, with): (&Vec<f64>, &Vec<f64>)| energy(with) < (1.0 - MUCH) * energy(white);
    // What depends on time may be a load in another form.
    let timeless = !candidate.term.effect.about().depends_on_time;
    let possible = !candidate.impossible && candidate.score > EVIDENCE;
    possible && timeless && white.iter().zip(with).any(explains_much)
}

/// Numbers that a term has to be fitted with.
pub(super) fn freedom(term: &Term) -> usize {
    term.constants.len() + term.coefficients.len()
}

/// Whether two terms are torques at the same joint and the first has less freedom.
pub(super) fn is_plainer(own: &Term, other: &Term) -> bool {
    let torques = !own.is_transform() && !other.is_transform();
    torques && own.site == other.site && own.site.joint().is_some() && freedom(own) < freedom(other)
}

impl Search<'_> {
    /// The fit with the limits at which the logged torque stays, one after the other.
    pub(super) fn limits(&self, fitted: &Fitted) -> Vec<(Fitted, Accepted)> {
        let mut steps: Vec<(Fitted, Accepted)> = Vec::new();
        let probe = |effect: &Arc<dyn Effect>, joint: usize, limit: f64| {
            let constants = effect.constants();
            let wanted = constants.len() == 1
                && constants[0].scale == Scale::Torque
                && self.wanted(effect.as_ref());
            let term = wanted.then(|| Term::new(effect.clone(), Site::Joint(joint), vec![limit]));
            term.filter(is_limit)
        };
        for (joint, limit) in self.problem.limits.iter().enumerate() {
            let Some(limit) = *limit else { continue };
            let Some(term) = self.catalogue.iter().find_map(|effect| probe(effect, joint, limit))
            else {
                continue;
            };
            let before = steps.last().map_or(fitted, |(fitted, _)| fitted);
            if before.terms().iter().any(|t| is_limit(t) && t.site == term.site) {
                continue;
            }
            let next = solve_like(
                &self.problem,
                before,
                &[before.terms(), std::slice::from_ref(&term)].concat(),
                &self.noise,
            );
            let (without, with) = (self.errors(before), self.errors(&next));
            if without.largest_fall_to(&with, &term) < material(&term) {
                continue;
            }
            let fall = without.total()[joint].powi(2) - with.total()[joint].powi(2);
            let score = 0.5 * self.problem.rows[joint].len() as f64 * fall
                / self.noise.level[joint].powi(2);
            let accepted = Accepted::new(&term, score, [before, &next], (&without, &with));
            steps.push((next, accepted));
        }
        steps
    }

    /// Candidates with evidence that is not tiny beside what was found before at the same joint: a
    /// form that is right to one percent leaves so much, and it would be taken for an effect of its
    /// own. Beside a contact, which is strong and short, only that counts which is explained while
    /// it is not there; beside a load that comes or goes that counts, too. Not tiny either is what
    /// explains most of the error that is left on some joint: a load is strong on all of them,
    /// friction of a light wrist is not.
    pub(super) fn worth_it(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        (errors, accepted): (&HeldOut, &[Accepted]),
        mut tried: Vec<Promise>,
    ) -> Vec<Promise> {
        /// What a form that is right to one percent leaves of what it explained.
        const SHARE: f64 = 0.01;
        /// The same of a transform, which is applied exactly.
        const TRANSFORM: f64 = 0.001;
        /// What an effect at one joint may leave at others, which the parameters of the links tie
        /// to it.
        const ELSEWHERE: f64 = 0.0001;
        let given = fitted.terms().len() - accepted.len();
        let news = || {
            accepted
                .iter()
                .zip(&fitted.terms()[given..])
                .filter(|(_, t)| t.effect.refines().is_none())
        };
        let windows: Vec<[f64; 2]> = news().filter_map(|(_, term)| window_of_arm(term)).collect();
        // Per joint what is tiny there, and what is tiny of all joints together, beside some terms.
        let tiny_beside = |terms: &[(&Accepted, &Term)]| -> (Vec<f64>, f64) {
            let left = |joint: usize, (step, term): &(&Accepted, &Term)| {
                if term.is_transform() {
                    return TRANSFORM * step.first_by_joint[joint];
                }
                // A load that comes or goes changes friction at all joints a little, wrists far
                // from most of its torque.
                let arm = term.effect.reach() == Reach::All;
                SHARE * if arm { step.first_score } else { step.first_by_joint[joint] }
            };
            let at = |joint: usize| terms.iter().map(|term| left(joint, term)).fold(0.0, f64::max);
            let elsewhere =
                terms.iter().map(|(step, _)| ELSEWHERE * step.first_score).fold(0.0, f64::max);
            ((0..self.problem.dof()).map(at).collect(), elsewhere)
        };
        let beside_all = tiny_beside(&news().collect::<Vec<_>>());
        if beside_all.1 == 0.0 {
            return tried;
        }
        let beside_lasting =
            tiny_beside(&news().filter(|(_, t)| window_of_arm(t).is_none()).collect::<Vec<_>>());
        // Logs without a common clock have no times, and no windows.
        let is_there = |row: (usize, usize)| {
            windows.iter().any(|[first, last]| (*first..*last).contains(&self.problem.time_of(row)))
        };
        let outside = |column: &Column| -> Column {
            let of_joint = |(rows, x): (&Vec<(usize, usize)>, &Vec<f64>)| {
                rows.iter().zip(x).map(|(row, x)| if is_there(*row) { 0.0 } else { *x }).collect()
            };
            self.problem.rows.iter().zip(column).map(of_joint).collect()
        };
        let is_contact = windows.iter().any(|[_, last]| last.is_finite());
        tried.retain(|Promise { candidate, .. }| {
            let with = self.white_with(fitted, (basis, white), candidate);
            let all = falls(white, &with);
            let is_worth = |falls: &[f64], (tiny, elsewhere): &(Vec<f64>, f64), least: f64| {
                let not_counted = all.iter().sum::<f64>() - falls.iter().sum::<f64>();
                let beside: f64 = falls
                    .iter()
                    .zip(tiny)
                    .filter(|(fall, tiny)| fall < tiny)
                    .map(|(fall, _)| fall)
                    .sum();
                candidate.score - not_counted - beside > elsewhere.max(least)
            };
            // What depends on time may be the contact or the load in another form.
            let timeless = !candidate.term.effect.about().depends_on_time;
            let apart =
                || is_worth(&falls(&outside(white), &outside(&with)), &beside_lasting, EVIDENCE);
            (timeless && !windows.is_empty() && apart())
                || (!(timeless && is_contact) && is_worth(&all, &beside_all, 0.0))
                || (may_explain_most(candidate, white, &with)
                    && self.explains_most(fitted, errors, candidate))
        });
        tried
    }

    /// Whether a candidate explains most of the error that is left on some joint, `errors` those
    /// without it.
    fn explains_most(&self, fitted: &Fitted, errors: &HeldOut, candidate: &Candidate) -> bool {
        /// More than half of the error goes: it falls by as much as is left.
        const MOST: f64 = 1.0;
        let trial = self.with_term(fitted, candidate.term.clone());
        errors.largest_fall_to(&self.errors(&trial), &candidate.term) > MOST
    }

    /// What a candidate leaves of the whitened residual.
    pub(super) fn white_with(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        candidate: &Candidate,
    ) -> Column {
        let mut with = white.clone();
        for (column, factor) in
            self.columns_of(fitted, &candidate.term).iter().zip(&candidate.gain.coefficients)
        {
            for (with, x) in with.iter_mut().zip(&self.noise.whiten(&self.problem, column)) {
                with.iter_mut().zip(x).for_each(|(with, x)| *with -= factor * x);
            }
        }
        basis.project_out(&mut with);
        with
    }

    /// The fit with finer forms of effects that the model has, at all joints where no other effect
    /// of the joint does better, if there are any.
    pub(super) fn finer_forms(
        &mut self,
        fitted: &Fitted,
        residual: (&Basis, &Column),
        candidates: &[Candidate],
        tried: &[Candidate],
    ) -> Result<Option<(Fitted, Vec<Accepted>)>, Interrupted> {
        let finer = |c: &&Candidate| {
            c.term.effect.refines().is_some() && !c.impossible && c.score > EVIDENCE
        };
        let finer: Vec<&Candidate> = candidates.iter().filter(finer).collect();
        self.progress.step("refine constants", 0, 1)?;
        let refine = |candidate: &&Candidate| self.refine(fitted, residual, candidate);
        let mut found: Vec<Candidate> = finer.par_iter().map(refine).collect();
        self.progress.step("refine constants", 1, 1)?;
        found.retain(|refined| {
            let rival = |c: &&Candidate| {
                let own = c.term.site == refined.term.site && c.term.effect.reach() == Reach::Own;
                own && !c.impossible && c.term.effect.refines().is_none()
            };
            let all = candidates.iter().chain(tried);
            let best = all.filter(rival).map(|c| c.score).fold(f64::NEG_INFINITY, f64::max);
            // A transition wider than the speeds of the log is viscous friction.
            !refined.impossible && refined.score > EVIDENCE && (1.0 - NEARLY) * refined.score > best
        });
        let without = self.errors(fitted);
        let (next, with) = loop {
            if found.is_empty() {
                return Ok(None);
            }
            let mut terms = fitted.terms().to_vec();
            terms.extend(found.iter().map(|c| c.term.clone()));
            let next = self.refit(fitted, terms);
            let with = self.errors(&next);
            // Whitened rows near reversals may like a form that the torque as logged does not.
            let (before, after) = (without.total(), with.total());
            let harms = |c: &Candidate| {
                c.term.site.joint().is_some_and(|joint| after[joint] > HARM * before[joint])
            };
            let count = found.len();
            found.retain(|candidate| !harms(candidate));
            if found.len() == count {
                break (next, with);
            }
        };
        let accepted =
            |c: Candidate| Accepted::new(&c.term, c.score, [fitted, &next], (&without, &with));
        let steps = found.into_iter().map(accepted).collect();
        Ok(Some((next, steps)))
    }

    /// The next step forward, if there is one: finer forms of what the model has, or the best of
    /// the candidates that has evidence and matters.
    ///
    /// - `promising`: those of the candidates that may matter, the most promising first
    pub(super) fn next_step(
        &mut self,
        fitted: &Fitted,
        (standing, accepted): (&Standing, &[Accepted]),
        residual: (&Basis, &Column),
        (candidates, promising): (&[Candidate], &[Candidate]),
    ) -> Result<Option<Next>, Interrupted> {
        let mut tried: Vec<Candidate> = Vec::new();
        let mut first = true;
        for some in promising.chunks(MOST_REFINED) {
            let refined = self.refined(fitted, standing, residual, some)?;
            let refined = self.worth_it(fitted, residual, (&standing.errors, accepted), refined);
            tried.extend(refined.iter().map(|promise| promise.candidate.clone()));
            if std::mem::take(&mut first)
                && let Some((next, steps)) =
                    self.finer_forms(fitted, residual, candidates, &tried)?
            {
                return Ok(Some(Next::Finer(next, steps)));
            }
            // One that promises much and matters nowhere must not hide the others.
            let mut rest = &refined[..];
            while let Some(best) = rest.first() {
                let close =
                    |promise: &&Promise| promise.outlook.density > CLOSE * best.outlook.density;
                let (some, others) =
                    rest.split_at(rest.iter().take_while(close).count().clamp(1, MOST_TRIED));
                let some: Vec<&Candidate> = some.iter().map(|promise| &promise.candidate).collect();
                if let Some((next, step)) = self.best_of(fitted, &standing.errors, &some, &tried)? {
                    return Ok(Some(Next::Term(next, step)));
                }
                rest = others;
            }
        }
        if first
            && let Some((next, steps)) = self.finer_forms(fitted, residual, candidates, &tried)?
        {
            return Ok(Some(Next::Finer(next, steps)));
        }
        Ok(None)
    }

    /// Trials that do equally well with their errors, those with least freedom first: forms with
    /// more imitate them. Not so where more of it lowers the error on blocks that were left out:
    /// what is left of that is small beside what was explained, and would never become an effect of
    /// its own.
    fn plainest_first<'c>(&self, mut trials: Vec<Trial<'c>>) -> Vec<Trial<'c>> {
        trials.sort_by_key(|trial| freedom(&trial.candidate.term));
        let beats = |other: &Trial<'_>, own: &Trial<'_>| {
            let beyond_its_range = self.is_at_edge(&other.fit)
                && is_plainer(&own.candidate.term, &other.candidate.term);
            !beyond_its_range
                && own.errors.largest_fall_to(&other.errors, &own.candidate.term)
                    > material(&own.candidate.term)
        };
        let beaten: Vec<bool> =
            trials.iter().map(|own| trials.iter().any(|other| beats(other, own))).collect();
        let (worse, good): (Vec<_>, Vec<_>) =
            trials.into_iter().zip(beaten).partition(|(_, beaten)| *beaten);
        good.into_iter().chain(worse).map(|(trial, _)| trial).collect()
    }

    /// Trials, best first: those that do as well as the first, and the others.
    fn equal_to_first<'c>(&self, trials: Vec<Trial<'c>>) -> (Vec<Trial<'c>>, Vec<Trial<'c>>) {
        let equal: Vec<bool> =
            trials.iter().map(|trial| self.does_as_well(trial, &trials[0])).collect();
        let mut equal = equal.into_iter();
        trials.into_iter().partition(|_| equal.next() == Some(true))
    }

    /// Whether a trial's score is that of the first one; or nearly so, where it is a plainer form
    /// and the first one is at the end of its range, or makes the joint's error on blocks that were
    /// left out larger.
    fn does_as_well(&self, own: &Trial<'_>, first: &Trial<'_>) -> bool {
        let error = |trial: &Trial<'_>| {
            own.candidate.term.site.joint().map_or(0.0, |joint| trial.errors.total()[joint])
        };
        let speaks_for_it = || self.is_at_edge(&first.fit) || error(own) < error(first);
        let within = |share: f64| {
            own.score > (1.0 - share) * first.score && first.score > (1.0 - share) * own.score
        };
        within(NEARLY)
            || (within(ALMOST)
                && is_plainer(&own.candidate.term, &first.candidate.term)
                && speaks_for_it())
    }

    /// Of trials, best first, the one comes first that surely predicts left-out blocks better than
    /// those before it: evidence is that of forms that are right.
    fn put_surely_better_first(&self, trials: &mut [Trial<'_>]) {
        let beats = |other: &Trial<'_>, own: &Trial<'_>| {
            let mut joints =
                [own, other].map(|trial| self.joints_of(&trial.candidate.term)).concat();
            joints.sort_unstable();
            joints.dedup();
            own.errors
                .left_out
                .against(&other.errors.left_out, &self.problem, &joints)
                .significance()
                >= self.sure
        };
        let best = (1..trials.len())
            .fold(0, |best, k| if beats(&trials[k], &trials[best]) { k } else { best });
        if best > 0 {
            trials[..=best].rotate_right(1);
        }
    }

    /// Of trials that are the first one's effect at another joint and explain as much, the one
    /// comes first whose inertias are nearest to those of the robot's file: gains of two joints may
    /// be the same torque but for the scale of what they share.
    fn put_likely_twin_first(&self, trials: &mut [Trial<'_>]) {
        let Some(first) = trials.first() else { return };
        let is_twin = |k: &usize| {
            are_twins((first.candidate, first.score), (trials[*k].candidate, trials[*k].score))
        };
        let twins: Vec<usize> = (1..trials.len()).filter(is_twin).collect();
        if twins.is_empty() {
            return;
        }
        let all =
            std::iter::once(0).chain(twins).map(|k| (k, self.distance_to_file(&trials[k].fit)));
        if let Some((nearest, _)) = all.min_by(|a, b| a.1.total_cmp(&b.1)) {
            trials[..=nearest].rotate_right(1);
        }
    }

    /// Squares of the torque by which the bodies of a fit differ from those of the robot's file,
    /// each joint by its noise.
    fn distance_to_file(&self, fitted: &Fitted) -> f64 {
        let (model, base) = (&fitted.model, fitted.model.base());
        let mut of_file = model.parameters().to_vec();
        let bodies = self.problem.nominal.robot().standard_parameters();
        of_file[..bodies.len()].copy_from_slice(&bodies);
        let [own, file] = [model.parameters(), &of_file].map(|parameters| base.combine(parameters));
        let differences: Vec<f64> = own.iter().zip(&file).map(|(own, file)| own - file).collect();
        let of_joint = |joint: usize| -> f64 {
            let rows = fitted.residual[joint].len();
            let torque = |row: usize| -> f64 {
                let columns = fitted
                    .columns
                    .iter()
                    .zip(&differences)
                    .filter(|(column, _)| !column[joint].is_empty());
                columns.map(|(column, factor)| factor * column[joint][row]).sum()
            };
            (0..rows).map(|row| (torque(row) / self.noise.level[joint]).powi(2)).sum()
        };
        (0..self.problem.dof()).map(of_joint).sum()
    }

    /// Whether the only constant of the last term of a fit is at the end of its range: it comes
    /// near to another form.
    fn is_at_edge(&self, fitted: &Fitted) -> bool {
        /// Share of a bound within which a constant is at it.
        const NEAR: f64 = 1e-6;
        let Some(term) = fitted.terms().last() else { return false };
        let (constants, [value]) = (term.effect.constants(), &term.constants[..]) else {
            return false;
        };
        matches!(constants[0].scale, Scale::Linear(_) | Scale::Logarithmic)
            && self.bounds(term, 0).iter().any(|bound| (value - bound).abs() < NEAR * bound.abs())
    }

    /// Number of parts of the logs that the term at `index` is asked to predict, far from what it
    /// was fitted to; none if it is not asked.
    pub(in super::super) fn parts_to_ask(&self, fitted: &Fitted, index: usize) -> Option<usize> {
        let asked = !is_limit(&fitted.terms()[index]);
        asked.then(|| fitted.parts_that_tell(&self.problem, &self.noise, index))?
    }

    /// Whether the last term of a fit makes the error larger on parts of the logs that are far from
    /// what it was fitted to.
    fn fails_elsewhere(&self, without: &Fitted, with: &Fitted) -> bool {
        let Some((term, others)) = with.terms().split_last() else { return false };
        let Some(count) = self.parts_to_ask(with, others.len()) else { return false };
        let [without, with] =
            [without, with].map(|fit| left_out_parts(&self.problem, fit, &self.noise, count));
        without.against(&with, &self.problem, &self.joints_of(term)).significance() < 0.0
    }

    /// The fit with the best of some candidates that has evidence and matters, if there is one.
    pub(super) fn best_of(
        &self,
        fitted: &Fitted,
        without: &HeldOut,
        worthy: &[&Candidate],
        tried: &[Candidate],
    ) -> Result<Option<(Fitted, Accepted)>, Interrupted> {
        // Transforms are judged by what they do exactly: tangents flatter and wrong them.
        self.progress.step("try effects", 0, 1)?;
        let with = |candidate: &&Candidate| self.with_term(fitted, candidate.term.clone());
        let fits: Vec<Fitted> = worthy.par_iter().map(with).collect();
        self.progress.step("try effects", 1, 1)?;
        let scores = fits.iter().map(|fit| self.score_of(fitted, fit)).collect::<Vec<f64>>();
        let all = worthy
            .iter()
            .copied()
            .zip(fits)
            .zip(scores)
            .filter(|(_, score)| *score >= EVIDENCE)
            .collect::<Vec<_>>();
        let trial = |((candidate, fit), score)| {
            let errors = self.errors(&fit);
            Trial { candidate, fit, score, errors }
        };
        let mut trials: Vec<Trial<'_>> = all.into_par_iter().map(trial).collect();
        // Columns may be the same, a torque that is lost in the direction of a torque of one sign
        // and an offset: then the order of the catalogue decides.
        trials.sort_by_key(|trial| {
            ((-2.0 * trial.score).round() as i64, self.place(&trial.candidate.term))
        });
        self.put_likely_twin_first(&mut trials);
        self.put_surely_better_first(&mut trials);
        let scores: Vec<(&Candidate, f64)> =
            trials.iter().map(|trial| (trial.candidate, trial.score)).collect();
        let (equal, others) = self.equal_to_first(trials);
        for Trial { candidate, fit: trial, score, errors: with } in
            self.plainest_first(equal).into_iter().chain(others)
        {
            let fitted_term = trial.terms().last().unwrap_or(&candidate.term);
            let matters = without.largest_fall_to(&with, fitted_term) >= asked_of(fitted_term)
                && (candidate.stands_out || self.is_sure(without, &with, fitted_term));
            let harms =
                without.explodes_to(&with) || self.is_worse_with(without, &with, fitted_term);
            if !matters
                || harms
                || is_out_of_range(fitted_term)
                || self.fails_elsewhere(fitted, &trial)
            {
                continue;
            }
            let own = candidate.term.effect.name();
            let rivals = tried.iter().filter(|c| c.term.effect.name() != own);
            let rivals = rivals.map(|c| (c.term.clone(), c.score)).collect();
            let twins = scores.iter().filter(|other| are_twins((candidate, score), **other));
            let twins = twins.map(|(twin, _)| twin.term.site).collect();
            let stands_out = candidate.stands_out;
            let accepted = Accepted {
                rivals,
                twins,
                stands_out,
                ..Accepted::new(&candidate.term, score, [fitted, &trial], (without, &with))
            };
            return Ok(Some((trial, accepted)));
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::by_name;

    #[test]
    fn a_correction_at_the_end_of_its_range_is_none() {
        let of = |name: &str, constants: &[f64]| {
            Term::new(by_name(name).expect("in the library"), Site::Joint(0), constants.to_vec())
        };
        assert!(is_out_of_range(&of("encoder_eccentricity", &[0.001, -0.03])));
        assert!(!is_out_of_range(&of("encoder_eccentricity", &[0.001, -0.029])));
        // Nothing is the least that a lag can be.
        assert!(!is_out_of_range(&of("joint_elasticity", &[0.0])));
        // A form that comes near to another one at the end of its range is a matter of its own.
        assert!(!is_out_of_range(&of("stribeck_friction", &[0.6])));
    }
}
