//! What is looked for, and its columns.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::Arc;

use rayon::prelude::*;

use super::super::basis::{Basis, Gain, dot};
use super::super::fit::{Fitted, tangent};
use super::super::problem::Column;
use super::super::remembered::key_of;
use super::Search;
use crate::effects::{Constant, Dimension, Effect, Entry, Scale, Site};
use crate::model::Term;
use crate::progress::Interrupted;
use sgpr_predict::internal::power_by_order;

/// An effect at a site, and how much of the leftover it explains.
#[derive(Clone, Debug)]
pub(in super::super) struct Candidate {
    pub term: Term,
    pub gain: Gain,
    /// Log of the Bayes factor with a unit-information prior, multiplicity taken off.
    pub score: f64,
    /// Why it is out of the question, if it is.
    pub impossible: bool,
    /// Whether it begins and ends, and explains many times what it would at any other time.
    pub stands_out: bool,
    /// Error per joint on blocks that were left out, without and with it, N·m (N), of those that
    /// were judged.
    pub errors: Option<[Vec<f64>; 2]>,
}

/// Whether a constant is the range of speeds over which friction changes sign. One that the joint
/// crosses within a sample cannot be told from none: it would hedge between the signs of a few
/// samples.
pub(super) fn is_width_of_reversal(effect: &dyn Effect, constant: &Constant) -> bool {
    effect.refines().is_some() && constant.dimension() == Dimension::Speed
}

/// Whether a constant has no grid: a time, or an order of what is periodic.
pub(super) fn is_searched_apart(constant: &Constant) -> bool {
    matches!(constant.scale, Scale::Time | Scale::Order)
}

/// Indices of the peaks of a periodogram without its ends, those first that stand out most of the
/// median of what is around them: a torque that is not periodic, and its side lobes, are larger
/// than a line at many orders, but alike at neighbouring ones.
///
/// - `lobe`: width of a line
fn lines_of(power: &[f64], lobe: usize) -> Vec<usize> {
    /// Widths of a line to either side that are around it.
    const AROUND: usize = 4;
    let inner = 1..power.len().saturating_sub(1);
    let around = |at: usize| {
        let half = AROUND * lobe.max(1);
        let mut own = power[at.saturating_sub(half)..power.len().min(at + half + 1)].to_vec();
        own.sort_by(f64::total_cmp);
        own[own.len() / 2].max(f64::MIN_POSITIVE)
    };
    let is_peak = |at: &usize| power[*at] >= power[at - 1] && power[*at] >= power[at + 1];
    let mut peaks: Vec<(usize, f64)> =
        inner.filter(is_peak).map(|at| (at, power[at] / around(at))).collect();
    peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
    peaks.into_iter().map(|(at, _)| at).collect()
}

impl Search<'_> {
    /// Whether an effect is looked for.
    pub(super) fn wanted(&self, effect: &dyn Effect) -> bool {
        let about = effect.about();
        let absent = !self.has_everywhere(effect) && !effect.is_absorbed();
        effect.entry() != Entry::Gate && about.alias_of.is_none() && absent
    }

    /// Where an effect stands in the catalogue.
    pub(super) fn place(&self, term: &Term) -> Option<usize> {
        self.catalogue.iter().position(|own| own.name() == term.effect.name())
    }

    /// Whether the model has an effect at every joint.
    pub fn has_everywhere(&self, effect: &dyn Effect) -> bool {
        effect.entry() == Entry::State && self.known.iter().any(|known| known == effect.name())
    }

    /// Why the logs cannot show an effect.
    pub fn not_testable(&self, fitted: &Fitted, effect: &dyn Effect) -> Option<String> {
        let contexts = self.problem.contexts(&fitted.model, &fitted.rigid);
        contexts.iter().find_map(|context| effect.not_testable(context))
    }

    /// Whether an effect remembers, at a joint whose acceleration is noise, how it was driven. That
    /// noise is in the torque which the model predicts: a resonance and a loop that follow it can
    /// take it out again.
    pub fn is_drowned(&self, effect: &dyn Effect, site: Site) -> bool {
        let rings = effect.constants().iter().any(|c| c.dimension() == Dimension::Frequency);
        let driven = effect.has_memory() && (rings || effect.follows_torque());
        driven && site.joint().is_some_and(|joint| self.problem.noisy[joint])
    }

    /// One term per effect, site and point of the grid; those that need a search of their own are
    /// left out.
    pub(super) fn terms_to_try(&self, fitted: &Fitted) -> Vec<Term> {
        let robot = self.problem.nominal.robot();
        let mut terms = Vec::new();
        for effect in self.catalogue.iter().filter(|effect| self.wanted(effect.as_ref())) {
            let constants = effect.constants();
            let limit = effect.entry() == Entry::Transform
                && constants.iter().any(|c| c.scale == Scale::Torque);
            if limit
                || constants.iter().any(is_searched_apart)
                || self.not_testable(fitted, effect.as_ref()).is_some()
            {
                continue;
            }
            for site in effect.sites(robot) {
                if !self.may_join(fitted, effect.as_ref(), site) {
                    continue;
                }
                let points = self.points(effect.as_ref(), site).into_iter();
                terms.extend(points.map(|point| Term::new(effect.clone(), site, point)));
            }
        }
        terms
    }

    /// Whether an effect is not in the fit at a site, and what it refines is in the model or there.
    pub(in super::super) fn may_join(
        &self,
        fitted: &Fitted,
        effect: &dyn Effect,
        site: Site,
    ) -> bool {
        let there =
            |name: &str| fitted.terms().iter().any(|t| t.effect.name() == name && t.site == site);
        let refines = |name: &str| self.known.iter().any(|known| known == name) || there(name);
        !there(effect.name()) && effect.refines().is_none_or(refines)
    }

    /// Constants to start from.
    pub(super) fn points(&self, effect: &dyn Effect, site: Site) -> Vec<Vec<f64>> {
        let grids: Vec<Vec<f64>> =
            (0..effect.constants().len()).map(|k| self.grid(effect, site, k)).collect();
        sgpr_predict::internal::points_of(&grids)
    }

    /// The grids of effects whose own say no more than ranges.
    pub(super) fn grids_by_shape(
        &self,
        fitted: &Fitted,
    ) -> HashMap<(String, Site, usize), Vec<f64>> {
        let robot = self.problem.nominal.robot();
        let testable = |e: &&Arc<dyn Effect>| {
            self.wanted(e.as_ref()) && self.not_testable(fitted, e.as_ref()).is_none()
        };
        let mut grids = HashMap::new();
        for effect in
            self.catalogue.iter().filter(|effect| effect.grids_span_ranges()).filter(testable)
        {
            for (site, index) in effect
                .sites(robot)
                .into_iter()
                .flat_map(|s| (0..effect.constants().len()).map(move |k| (s, k)))
            {
                let grid = self.grid_by_shape(fitted, effect, (site, index));
                grids.insert((effect.name().to_string(), site, index), grid);
            }
        }
        grids
    }

    /// Values of a constant of which neighbours have columns that explain half of each other,
    /// others in the middle of their ranges: a torque that is periodic in a position needs many
    /// over a wide range, one that bends needs few.
    fn grid_by_shape(
        &self,
        fitted: &Fitted,
        effect: &Arc<dyn Effect>,
        (site, index): (Site, usize),
    ) -> Vec<f64> {
        /// Share of the squares.
        const ALIKE: f64 = 0.5;
        /// Of all constants together.
        const MOST: f64 = 200.0;
        let most = MOST.powf(1.0 / effect.constants().len() as f64) as usize;
        let middle: Vec<f64> = (0..effect.constants().len())
            .map(|k| self.grid(effect.as_ref(), site, k))
            .map(|grid| grid[grid.len() / 2])
            .collect();
        let at = |value: f64| {
            let mut constants = middle.clone();
            constants[index] = value;
            let term = Term::new(effect.clone(), site, constants);
            (value, Basis::new(self.problem.term_columns(&fitted.model, &fitted.rigid, &term)))
        };
        let are_alike = |[(a, own), (b, other)]: [&(f64, Basis); 2]| {
            let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
            let all: f64 = other.independent().iter().map(|column| dot(column, column)).sum();
            let explained: f64 =
                other.independent().iter().map(|column| squares(&own.shares_of(column))).sum();
            explained >= ALIKE * all || (b - a).abs() < 1e-3 * b.abs().max(a.abs())
        };
        let constant = &effect.constants()[index];
        let between = |a: f64, b: f64| match constant.scale {
            Scale::Logarithmic => (a * b).sqrt(),
            _ => 0.5 * (a + b),
        };
        let coarse = self.grid(effect.as_ref(), site, index);
        let all = [&[constant.low], &coarse[..], &[constant.high]].concat();
        let mut rest: Vec<(f64, Basis)> = all[1..].iter().rev().map(|value| at(*value)).collect();
        let mut last = at(constant.low);
        let mut grid = vec![last.0];
        while let Some(next) = rest.pop() {
            if grid.len() + rest.len() + 1 >= most || are_alike([&last, &next]) {
                grid.push(next.0);
                last = next;
            } else {
                let middle = at(between(last.0, next.0));
                rest.extend([next, middle]);
            }
        }
        grid
    }

    /// Values of a constant to start from, in its unit.
    pub(super) fn grid(&self, effect: &dyn Effect, site: Site, index: usize) -> Vec<f64> {
        if let Some(grid) = self.grids.get(&(effect.name().to_string(), site, index)) {
            return grid.clone();
        }
        let joint = site.joint().unwrap_or_default();
        let constant = &effect.constants()[index];
        let mut grid = constant.grid_in(self.problem.ranges(joint));
        if is_width_of_reversal(effect, constant) {
            grid.retain(|width| *width >= self.problem.speed_steps[joint]);
        }
        grid
    }

    /// Lowest and highest value of a constant, in its unit.
    pub(super) fn bounds(&self, term: &Term, index: usize) -> [f64; 2] {
        let joint = term.site.joint().unwrap_or_default();
        let constant = &term.effect.constants()[index];
        let [low, high] = constant.bounds_in(self.problem.ranges(joint));
        let least = if is_width_of_reversal(term.effect.as_ref(), constant) {
            self.problem.speed_steps[joint]
        } else if constant.scale == Scale::Order {
            self.least_order(joint)
        } else {
            low
        };
        [least.clamp(low, high), high]
    }

    /// Least order, per turn, of what repeats within the positions of a joint: less than two
    /// periods are any smooth function of them.
    fn least_order(&self, joint: usize) -> f64 {
        let [low, high] = self.problem.ranges(joint).position;
        2.0 * TAU / (high - low)
    }

    /// Whether a term has an order that the logs do not show to repeat.
    pub(super) fn is_once(&self, term: &Term) -> bool {
        let constants = term.effect.constants().iter().zip(&term.constants);
        let mut orders = constants.filter(|(constant, _)| constant.scale == Scale::Order);
        orders.any(|(_, value)| *value <= self.least_order(term.site.joint().unwrap_or_default()))
    }

    /// Effects with an order: the lines of a periodogram of the residual over the position.
    pub(super) fn orders_to_try(&self, fitted: &Fitted) -> Vec<Term> {
        /// Lowest order that is looked for, per turn: lower ones are gravity and springs.
        const LOWEST: usize = 4;
        /// Highest order, per turn: gears with more teeth are not resolved by the logs.
        const HIGHEST: usize = 200;
        /// Lines of a joint that are tried.
        const MOST: usize = 3;
        let n = self.problem.dof();
        let mut terms = Vec::new();
        for joint in 0..n {
            let q = |&(stretch, sample): &(usize, usize)| {
                self.problem.stretches[stretch].motion.q[sample * n + joint]
            };
            let samples =
                self.problem.rows[joint].iter().map(q).zip(fitted.residual[joint].iter().copied());
            let [low, high] = self.problem.ranges(joint).position;
            let lobe = (TAU / (high - low)).ceil().min(HIGHEST as f64) as usize;
            let lines = lines_of(&power_by_order(samples, LOWEST - 1..=HIGHEST + 1), lobe);
            for effect in self.catalogue.iter().filter(|e| self.wanted(e.as_ref())) {
                let constants = effect.constants();
                if constants.len() == 1 && constants[0].scale == Scale::Order {
                    let line = |at: &usize| vec![(at + LOWEST - 1) as f64];
                    terms.extend(
                        lines
                            .iter()
                            .take(MOST)
                            .map(|at| Term::new(effect.clone(), Site::Joint(joint), line(at))),
                    );
                }
            }
        }
        terms.retain(|term| {
            !fitted.terms().iter().any(|t| {
                t.effect.name() == term.effect.name()
                    && t.site == term.site
                    && (t.constants[0] - term.constants[0]).abs() < 1.5
            })
        });
        terms
    }

    /// Every effect at every site at every point of its grid; those that begin or end at a time are
    /// left out.
    pub fn terms_of_ranking(&self, fitted: &Fitted) -> Vec<Term> {
        self.terms_to_try(fitted).into_iter().chain(self.orders_to_try(fitted)).collect()
    }

    /// Columns of a term in the band, tangents for a transform.
    pub(super) fn raw(&mut self, fitted: &Fitted, term: &Term) -> Vec<Column> {
        let key = key_of(term);
        if let Some(columns) = self.cache.get(&key) {
            return columns.clone();
        }
        let columns = self.columns_of(fitted, term);
        self.cache.insert(key, columns.clone());
        columns
    }

    /// The same if they are remembered.
    pub(super) fn cached(&self, term: &Term) -> Option<&[Column]> {
        self.cache.get(&key_of(term)).map(Vec::as_slice)
    }

    pub(super) fn columns_of(&self, fitted: &Fitted, term: &Term) -> Vec<Column> {
        if !term.is_transform() {
            return self.problem.term_columns(&fitted.model, &fitted.rigid, term);
        }
        let mut terms = fitted.terms().to_vec();
        terms.push(term.clone());
        let model = fitted.model.clone().with_terms(terms, self.problem.clock);
        let last = fitted.terms().len();
        (0..term.constants.len())
            .map(|k| tangent(&self.problem, (&model, &fitted.rigid), (last, k)))
            .collect()
    }

    /// Computes the columns that [`Self::raw`] will be asked for, on all cores.
    pub(super) fn prepare(&mut self, fitted: &Fitted, terms: &[Term]) -> Result<(), Interrupted> {
        /// Effects whose columns are made between two words to the listener.
        const AT_ONCE: usize = 24;
        let missing: Vec<&Term> =
            terms.iter().filter(|term| !self.cache.contains_key(&key_of(term))).collect();
        for (index, some) in missing.chunks(AT_ONCE).enumerate() {
            self.progress.step("columns of effects", AT_ONCE * index, missing.len())?;
            let columns: Vec<_> =
                some.par_iter().map(|term| self.columns_of(fitted, term)).collect();
            self.cache.extend(some.iter().map(|term| key_of(term)).zip(columns));
        }
        self.progress.step("columns of effects", missing.len(), missing.len())
    }

    /// The columns of terms in the band, tangents for a transform, which are not remembered any
    /// more.
    pub fn take_columns(
        &mut self,
        fitted: &Fitted,
        terms: &[Term],
    ) -> Result<Vec<Vec<Column>>, Interrupted> {
        self.prepare(fitted, terms)?;
        let take = |term: &Term| self.cache.remove(&key_of(term)).unwrap_or_default();
        Ok(terms.iter().map(take).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::internal::Random;

    #[test]
    fn a_ripple_is_found_beside_a_slow_torque_that_is_larger_at_most_orders() {
        // A motion of three sine waves, a torque that bends with the position, a tenth of it
        // periodic, and noise.
        let mut random = Random::new(7);
        let wave =
            |k: usize, size: f64, rate: f64, phase: f64| size * (rate * k as f64 + phase).sin();
        let position =
            |k| wave(k, 1.0, 0.0137, 0.0) + wave(k, 0.8, 0.0311, 1.0) + wave(k, 0.5, 0.0523, 2.0);
        let mut sample =
            |q: f64| (q, 2.0 * q + q.powi(2) + 0.2 * (28.0 * q).cos() + 0.1 * random.normal());
        let samples: Vec<(f64, f64)> = (0..4000).map(|k| sample(position(k))).collect();
        let power = power_by_order(samples.into_iter(), 3..=201);
        let is_line = |at: &usize| (27..=29).contains(&(at + 3));
        let mut largest: Vec<usize> = (1..198)
            .filter(|&at| power[at] >= power[at - 1] && power[at] >= power[at + 1])
            .collect();
        largest.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
        assert!(!largest[..3].iter().any(is_line), "{:?}", &largest[..3]);
        let lines = lines_of(&power, 2);
        assert!(lines[..3].iter().any(is_line), "{:?}", &lines[..3]);
    }
}
