//! Steps backward: what the others make superfluous is taken out, what another explains better is
//! exchanged.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::fit::{Fitted, without as without_term};
use super::forward::{NEARLY, asked_of, freedom, is_out_of_range, is_plainer};
use super::held_out::{HeldOut, is_limit};
use super::{Accepted, EVIDENCE, Search, material};
use crate::effects::{Effect, Entry, Reach};
use crate::model::Term;
use crate::progress::Interrupted;

impl Search<'_> {
    /// The fit with another transform of the same kind in the place of one that explains less, or
    /// no more and comes later in the catalogue: which of them it is may show only when all others
    /// are there.
    pub(super) fn with_likelier_transforms(
        &self,
        mut fitted: Fitted,
        accepted: &mut [Accepted],
    ) -> Fitted {
        let given = fitted.terms().len() - accepted.len();
        for (k, step) in accepted.iter_mut().enumerate() {
            let own = fitted.terms()[given + k].clone();
            let others = self
                .transforms_like(&own)
                .into_iter()
                .map(|term| self.with_instead(&fitted, given + k, term));
            let margin = NEARLY * step.first_score;
            let likelier = |other: &Fitted| {
                let comes_first = self.place(&other.terms()[given + k]) < self.place(&own);
                0.5 * (fitted.chi2 - other.chi2) > if comes_first { -margin } else { margin }
            };
            let stays =
                |other: &Fitted| self.stays_in(other, given + k, &self.bare(&fitted, given + k));
            let Some(other) = others.into_iter().find(|other| likelier(other) && stays(other))
            else {
                continue;
            };
            let bare = self.bare(&fitted, given + k);
            *step = self.exchanged(step, [&bare, &fitted, &other], given + k);
            fitted = other;
        }
        fitted
    }

    /// The fit with a plainer torque at the same joint in the place of one with more freedom that
    /// does no better: what it has more may have stood for effects that were found after it.
    pub(super) fn with_plainer_forms(
        &self,
        mut fitted: Fitted,
        accepted: &mut [Accepted],
    ) -> Fitted {
        let given = fitted.terms().len() - accepted.len();
        if accepted.len() < 2 {
            return fitted;
        }
        for (k, step) in accepted.iter_mut().enumerate() {
            let own = fitted.terms()[given + k].clone();
            let plainer = self.plainer_rivals(&own, step, fitted.terms());
            if plainer.is_empty() {
                continue;
            }
            let bare = self.bare(&fitted, given + k);
            let (score, errors) = (self.score_of(&bare, &fitted), self.errors(&fitted));
            let others =
                plainer.into_iter().map(|term| self.with_instead(&fitted, given + k, term));
            let does_as_well = |other: &Fitted| {
                let loses = self.errors(other).largest_fall_to(&errors, &own) > material(&own);
                self.score_of(&bare, other) > (1.0 - NEARLY) * score
                    && !loses
                    && self.stays_in(other, given + k, &bare)
            };
            let best = others.filter(does_as_well).min_by(|a, b| a.chi2.total_cmp(&b.chi2));
            let Some(other) = best else { continue };
            *step = self.exchanged(step, [&bare, &fitted, &other], given + k);
            fitted = other;
        }
        fitted
    }

    /// Whether the term at `index` would stay in a fit, beside which `bare` is without it: what
    /// would not is in nobody's place.
    fn stays_in(&self, fitted: &Fitted, index: usize, bare: &Fitted) -> bool {
        let score = self.score_of(bare, fitted);
        self.stays(
            &fitted.terms()[index],
            (score, false),
            [&self.errors(bare), &self.errors(fitted)],
        )
    }

    /// Whether a term has evidence, lowers a left-out error by what is asked of it, for certain or
    /// where it `stands_out`, and harms nothing.
    fn stays(
        &self,
        term: &Term,
        (score, stands_out): (f64, bool),
        [without, with]: [&HeldOut; 2],
    ) -> bool {
        let matters = without.largest_fall_to(with, term) >= asked_of(term)
            && (stands_out || self.is_sure(without, with, term));
        let harms = self.is_worse_with(without, with, term) || is_out_of_range(term);
        score >= EVIDENCE && matters && !harms
    }

    /// Torques without constants that had nearly the evidence of one with more freedom at the same
    /// joint and that the model does not have.
    fn plainer_rivals(&self, own: &Term, step: &Accepted, terms: &[Term]) -> Vec<Term> {
        /// Share of the first score above which a plainer form had nearly as much evidence.
        const CLOSE: f64 = 0.9;
        let close = |name: &str| {
            let rivals =
                step.rivals.iter().filter(|(t, _)| t.effect.name() == name && t.site == own.site);
            rivals.map(|(_, score)| *score).fold(0.0, f64::max) > CLOSE * step.first_score
        };
        let effects = self
            .catalogue
            .iter()
            .filter(|effect| effect.constants().is_empty() && close(effect.name()));
        let terms_of = effects.map(|effect| Term::new(effect.clone(), own.site, vec![]));
        terms_of
            .filter(|term| is_plainer(term, own) && !terms.iter().any(|other| other.is_like(term)))
            .collect()
    }

    /// The fit with a finer form of what the model has in the place of an effect at the same joint
    /// with as much freedom, where chi-squared and left-out blocks both say so, beyond the standard
    /// error: what came first hides the other, which it is like.
    pub(super) fn with_finer_instead(
        &self,
        mut fitted: Fitted,
        accepted: &mut [Accepted],
    ) -> Fitted {
        let given = fitted.terms().len() - accepted.len();
        for (k, step) in accepted.iter_mut().enumerate() {
            let own = fitted.terms()[given + k].clone();
            let finer = self.finer_at(&fitted, &own);
            if finer.is_empty() {
                continue;
            }
            let bare = without_term(&self.problem, &fitted, given + k, &self.noise);
            let others = finer.iter().filter_map(|term| self.best_constants(&bare, term));
            let others = others.map(|term| self.with_instead(&fitted, given + k, term));
            let is_better = |other: &Fitted| {
                let [own_errors, errors] =
                    [&fitted, other].map(|fit| fit.folds(&self.problem, &self.noise).errors());
                other.chi2 < fitted.chi2
                    && own_errors
                        .against(&errors, &self.problem, &self.joints_of(&own))
                        .significance()
                        > 1.0
            };
            if let Some(other) = others.into_iter().find(is_better) {
                *step = self.exchanged(step, [&bare, &fitted, &other], given + k);
                fitted = other;
            }
        }
        fitted
    }

    /// Finer forms of what the model has at the joint of a torque, with as much freedom, which are
    /// not in the fit.
    fn finer_at(&self, fitted: &Fitted, own: &Term) -> Vec<Term> {
        if own.is_transform() || own.effect.reach() != Reach::Own || own.effect.refines().is_some()
        {
            return vec![];
        }
        let robot = self.problem.nominal.robot();
        let finer = |effect: &&Arc<dyn Effect>| {
            effect.refines().is_some()
                && self.wanted(effect.as_ref())
                && effect.sites(robot).contains(&own.site)
                && self.may_join(fitted, effect.as_ref(), own.site)
        };
        let term = |effect: &Arc<dyn Effect>| {
            let constants = self.points(effect.as_ref(), own.site).into_iter().next();
            Term::new(effect.clone(), own.site, constants.unwrap_or_default())
        };
        let terms = self.catalogue.iter().filter(finer).map(term);
        terms.filter(|term| freedom(term) <= freedom(own)).collect()
    }

    /// The fit with another term in the place of the one at `index`.
    pub(in super::super) fn with_instead(
        &self,
        fitted: &Fitted,
        index: usize,
        term: Term,
    ) -> Fitted {
        let mut terms = fitted.terms().to_vec();
        terms[index] = term;
        self.refit(fitted, terms)
    }

    /// A step with another term in the place of its own: of `fits`, which are without either, with
    /// its own and with the other, at `index`.
    fn exchanged(
        &self,
        step: &Accepted,
        [bare, own, other]: [&Fitted; 3],
        index: usize,
    ) -> Accepted {
        let mut rivals = vec![(own.terms()[index].clone(), self.score_of(bare, own))];
        rivals.extend(
            step.rivals
                .iter()
                .filter(|(t, _)| t.effect.name() != other.terms()[index].effect.name())
                .cloned(),
        );
        let (term, score) = (&other.terms()[index], self.score_of(bare, other));
        let next =
            Accepted::new(term, score, [bare, other], (&self.errors(bare), &self.errors(other)));
        Accepted { rivals, ..next }
    }

    /// Other transforms that are confused with one, with constants of the same units: they begin at
    /// its values.
    pub(super) fn transforms_like(&self, own: &Term) -> Vec<Term> {
        let robot = self.problem.nominal.robot();
        let units =
            |effect: &dyn Effect| effect.constants().iter().map(|c| c.unit).collect::<Vec<_>>();
        let alike = |effect: &&Arc<dyn Effect>| {
            own.is_transform()
                && effect.entry() == Entry::Transform
                && own.effect.about().confusable.contains(&effect.name())
                && units(effect.as_ref()) == units(own.effect.as_ref())
                && effect.sites(robot).contains(&own.site)
                && self.wanted(effect.as_ref())
        };
        let begun = |effect: &Arc<dyn Effect>| {
            let values = own.constants.iter().zip(effect.constants());
            Term::new(
                effect.clone(),
                own.site,
                values.map(|(value, c)| value.clamp(c.low, c.high)).collect(),
            )
        };
        self.catalogue.iter().filter(alike).map(begun).collect()
    }

    /// Takes terms out again that the others make superfluous, of those that `may_go`.
    pub fn backward(
        &self,
        mut fitted: Fitted,
        mut accepted: Vec<Accepted>,
        may_go: &dyn Fn(&Accepted) -> bool,
    ) -> Result<(Fitted, Vec<Accepted>), Interrupted> {
        let given = fitted.terms().len() - accepted.len();
        while !accepted.is_empty() {
            let with = self.errors(&fitted);
            self.progress.step("check each effect again", 0, 1)?;
            let without = |k: usize| {
                let bare = Fitted::clone(&self.bare(&fitted, given + k));
                self.with_imitated(bare, &fitted.terms()[given + k])
            };
            let fits: Vec<Fitted> = (0..accepted.len()).into_par_iter().map(without).collect();
            self.progress.step("check each effect again", 1, 1)?;
            let errors: Vec<HeldOut> = fits.par_iter().map(|fit| self.errors(fit)).collect();
            let mut weakest: Option<(f64, usize, Fitted)> = None;
            for (k, (step, (without, errors))) in
                accepted.iter_mut().zip(fits.into_iter().zip(&errors)).enumerate()
            {
                step.score = self.score_of(&without, &fitted);
                step.without = errors.total();
                step.effect_size = errors.largest_fall_to(&with, &fitted.terms()[given + k]);
                let size = step.effect_size;
                let term = &fitted.terms()[given + k];
                if is_limit(term) {
                    step.score = step.first_score;
                }
                let stays = self.stays(term, (step.score, step.stands_out), [errors, &with]);
                if !stays && may_go(step) && weakest.as_ref().is_none_or(|(s, ..)| size < *s) {
                    weakest = Some((size, k, without));
                }
            }
            let Some((_, k, without)) = weakest else { break };
            accepted.remove(k);
            fitted = self.polish(without);
        }
        Ok((fitted, accepted))
    }
}
