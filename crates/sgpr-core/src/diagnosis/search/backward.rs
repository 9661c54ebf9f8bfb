//! Steps backward: what the others make superfluous is taken out, what another explains better is exchanged.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::fit::Fitted;
use super::forward::{NEARLY, asked_of, is_limit};
use super::held_out::HeldOut;
use super::{Accepted, EVIDENCE, Search};
use crate::effects::{Effect, Entry};
use crate::model::Term;
use crate::progress::Interrupted;

impl Search<'_> {
    /// The fit with another transform of the same kind in the place of one that explains less, or no more and comes later
    /// in the catalogue: which of them it is may show only when all others are there.
    pub(super) fn with_likelier_transforms(&self, mut fitted: Fitted, accepted: &mut [Accepted]) -> Fitted {
        let given = fitted.terms().len() - accepted.len();
        let place = |term: &Term| self.catalogue.iter().position(|own| own.name() == term.effect.name());
        for (k, step) in accepted.iter_mut().enumerate() {
            let own = fitted.terms()[given + k].clone();
            let others = self.transforms_like(&own).into_iter().map(|term| {
                let mut terms = fitted.terms().to_vec();
                terms[given + k] = term;
                self.refit(&fitted, terms)
            });
            let margin = NEARLY * step.first_score;
            let likelier = |other: &Fitted| {
                let comes_first = place(&other.terms()[given + k]) < place(&own);
                0.5 * (fitted.chi2 - other.chi2) > if comes_first { -margin } else { margin }
            };
            let Some(other) = others.into_iter().find(likelier) else { continue };
            let mut rest = fitted.terms().to_vec();
            rest.remove(given + k);
            let bare = self.refit(&fitted, rest);
            let mut rivals = vec![(step.effect.clone(), own.site, self.score_of(&bare, &fitted))];
            rivals.append(&mut step.rivals);
            let (term, score) = (&other.terms()[given + k], self.score_of(&bare, &other));
            let next = Accepted::new(term, score, [&bare, &other], (&self.errors(&bare), &self.errors(&other)));
            *step = Accepted { rivals, ..next };
            fitted = other;
        }
        fitted
    }

    /// Other transforms that are confused with one, with constants of the same units: they begin at its values.
    pub(super) fn transforms_like(&self, own: &Term) -> Vec<Term> {
        let robot = self.problem.nominal.robot();
        let units = |effect: &dyn Effect| effect.constants().iter().map(|c| c.unit).collect::<Vec<_>>();
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
            Term::new(effect.clone(), own.site, values.map(|(value, c)| value.clamp(c.low, c.high)).collect())
        };
        self.catalogue.iter().filter(alike).map(begun).collect()
    }

    /// Takes terms out again that the others make superfluous.
    pub fn backward(
        &self,
        mut fitted: Fitted,
        mut accepted: Vec<Accepted>,
    ) -> Result<(Fitted, Vec<Accepted>), Interrupted> {
        let given = fitted.terms().len() - accepted.len();
        while accepted.len() > 1 {
            let with = self.errors(&fitted);
            self.progress.step("check each effect again", 0, 1)?;
            let without = |k: usize| {
                let mut others = fitted.terms().to_vec();
                let removed = others.remove(given + k);
                self.with_imitated(self.refit(&fitted, others), &removed)
            };
            let fits: Vec<Fitted> = (0..accepted.len()).into_par_iter().map(without).collect();
            self.progress.step("check each effect again", 1, 1)?;
            let errors: Vec<HeldOut> = fits.par_iter().map(|fit| self.errors(fit)).collect();
            let mut weakest: Option<(f64, usize, Fitted)> = None;
            for (k, (step, (without, errors))) in accepted.iter_mut().zip(fits.into_iter().zip(errors)).enumerate() {
                step.score = self.score_of(&without, &fitted);
                step.without = errors.total();
                step.effect_size = errors.largest_fall_to(&with, &fitted.terms()[given + k]);
                let size = step.effect_size;
                let term = &fitted.terms()[given + k];
                if is_limit(term) {
                    step.score = step.first_score;
                }
                let stays = step.score >= EVIDENCE && size >= asked_of(term) && !errors.is_worse_for_arm(&with, term);
                if !stays && weakest.as_ref().is_none_or(|(s, ..)| size < *s) {
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
