//! Which effects: ranking, forward steps with joint refit, backward steps.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::basis::{Basis, Gain, INVISIBLE, Noise, Rest, gain, gain_of, invisible, rms};
use super::fit::{
    ByLog, Extra, Fitted, beyond, held_out, refine_transforms, solve, solve_like, tangent, tangents, usual_error,
    without,
};
use super::imitation::without_many_imitations;
use super::problem::{Column, Problem};
use super::unknown::{self, Group};
use crate::effects::{self, Constant, Effect, Entry, Reach, Scale, Site};
use crate::linalg::dot_in_lanes;
use crate::model::Term;
use crate::progress::{Interrupted, Progress};
use crate::signal::power_by_order;

/// An effect at a site, and how much of the leftover it explains.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub term: Term,
    pub gain: Gain,
    /// Log of the Bayes factor with a unit-information prior, multiplicity taken off.
    pub score: f64,
    /// Why it is out of the question, if it is.
    pub impossible: bool,
}

/// A term that was accepted.
#[derive(Clone, Debug)]
pub(super) struct Accepted {
    pub effect: String,
    pub site: Site,
    pub score: f64,
    /// The same when it was added, others not yet there.
    pub first_score: f64,
    /// Of that, what each joint's rows brought.
    first_by_joint: Vec<f64>,
    /// Largest fall of the held-out error on a joint, as a share of what is left.
    pub effect_size: f64,
    /// Rivals at this step: effect and score.
    pub rivals: Vec<(String, Site, f64)>,
    /// Held-out error per joint right after it was added, N·m (N).
    pub with: Vec<f64>,
    /// Held-out error per joint of the whole model without it, N·m (N).
    pub without: Vec<f64>,
}

impl Accepted {
    /// The last term of `fits`, which are without and with it, and the errors of both.
    fn new(term: &Term, score: f64, fits: [&Fitted; 2], (without, with): (&HeldOut, &HeldOut)) -> Self {
        Self {
            effect: term.effect.name().into(),
            site: term.site,
            score,
            first_score: score,
            first_by_joint: falls(&fits[0].white, &fits[1].white),
            effect_size: without.largest_fall_to(with, term),
            rivals: vec![],
            with: with.total(),
            without: without.total(),
        }
    }
}

/// What a search came to.
pub(super) struct Outcome {
    /// The model as it was, on the rows that count.
    pub start: Fitted,
    pub fitted: Fitted,
    /// The last terms of the fit, in their order.
    pub accepted: Vec<Accepted>,
    /// All candidates against the model as it was.
    pub ranking: Vec<Candidate>,
    /// Held-out error per joint of the model as it was, N·m (N) ...
    pub held_out_before: Vec<f64>,
    /// ... and of the fit.
    pub held_out: Vec<f64>,
}

impl Outcome {
    /// [`Search::news`] of it.
    pub fn news(&self, search: &Search<'_>) -> impl Iterator<Item = (usize, &Accepted)> {
        search.news(&self.fitted, &self.accepted)
    }
}

/// Whether a term is part of what the model has already, or shorter than the time between two samples and of little
/// effect.
fn is_silent(term: &Term, step: &Accepted, period: f64) -> bool {
    let times = term.is_transform() && term.effect.constants().iter().all(|c| c.unit == "s");
    let within = || term.constants.iter().all(|c| c.abs() < WITHIN_A_SAMPLE * period) && step.effect_size < LITTLE;
    term.effect.refines().is_some() || (times && within())
}

/// Torque and position of one row may be taken at moments that are this share of a period apart ...
const WITHIN_A_SAMPLE: f64 = 0.6;

/// ... which goes without saying as long as no joint's error falls by more than this share of what is left.
const LITTLE: f64 = 0.2;

/// Whether the base parameters take an effect up whatever the motion.
pub(super) fn is_absorbed(effect: &dyn Effect) -> bool {
    ["payload", "link_inertia_error"].contains(&effect.name())
}

/// Scores below this are no evidence.
pub(super) const EVIDENCE: f64 = 8.0;

/// Smallest fall of the held-out error on some joint, as a share of what is left.
pub(super) const MATERIAL: f64 = 0.025;

/// The same for a term, whose parameters were fitted: more for one with parameters that it does not have by nature.
fn asked_of(term: &Term) -> f64 {
    const IMPLAUSIBLE: f64 = 0.06;
    match term {
        _ if term.effect.refines().is_some() => 0.0,
        _ if term.effect.is_plausible(&term.coefficients) => MATERIAL,
        _ => IMPLAUSIBLE,
    }
}

/// Whether what begins and ends lasts long enough to be something else than one wrong moment of the log.
fn lasts(term: &Term, constants: &[f64]) -> bool {
    const SHORTEST_S: f64 = 0.2;
    let all = term.effect.constants().iter().zip(constants);
    let times: Vec<f64> = all.filter(|(c, _)| c.scale == Scale::Time).map(|(_, time)| *time).collect();
    times.windows(2).all(|pair| pair[1] - pair[0] >= SHORTEST_S)
}

/// Most terms that are looked for.
const MOST_TERMS: usize = 16;

/// Most candidates whose constants are refined in a step.
const MOST_REFINED: usize = 8;

/// Growth of a joint's error that speaks against a finer form.
const HARM: f64 = 1.02;

/// Scores that differ by less than this share are equal.
const NEARLY: f64 = 0.005;

/// Most candidates that are fitted with the whole model in a step.
const MOST_TRIED: usize = 4;

const STAGE: &str = "look for effects";

/// Resolution of the grid of times, s.
const TIME_STEP: f64 = 0.5;

/// Farthest step of a time before it is refined, in steps of the grid.
const FARTHEST_JUMP: i32 = 8;

pub(super) struct Search<'a> {
    pub problem: Problem,
    pub catalogue: &'a [Arc<dyn Effect>],
    /// Names of effects that the model has everywhere.
    pub known: Vec<String>,
    pub noise: Noise,
    pub units: f64,
    pub rows: f64,
    cache: HashMap<(String, Site, Vec<u64>), Vec<Column>>,
    progress: &'a dyn Progress,
}

impl<'a> Search<'a> {
    pub fn new(
        problem: Problem,
        catalogue: &'a [Arc<dyn Effect>],
        known: Vec<String>,
        progress: &'a dyn Progress,
    ) -> Self {
        let noise = Noise::white(&problem.y);
        let robot = problem.nominal.robot();
        let units: usize = catalogue.iter().map(|effect| effect.sites(robot).len()).sum();
        let rows = problem.rows.iter().map(Vec::len).sum::<usize>() as f64;
        Self { problem, catalogue, known, noise, units: units as f64, rows, cache: HashMap::new(), progress }
    }

    /// The accepted terms with their indices in the fit and what the search knows of them, those that refine an effect of
    /// the model or align clocks within a sample left out.
    pub fn news<'f>(
        &self,
        fitted: &'f Fitted,
        accepted: &'f [Accepted],
    ) -> impl Iterator<Item = (usize, &'f Accepted)> + use<'f> {
        let given = fitted.terms().len() - accepted.len();
        let period = self.problem.stretches.iter().map(|s| 1.0 / s.motion.rate_hz).fold(0.0, f64::max);
        let steps = accepted.iter().enumerate().map(move |(k, accepted)| (given + k, accepted));
        steps.filter(move |(k, step)| !is_silent(&fitted.terms()[*k], step, period))
    }

    /// The model as it is; noise from what the largest model leaves.
    pub fn start(&mut self) -> Result<Fitted, Interrupted> {
        self.progress.step("fit the model", 0, 4)?;
        let problem = &self.problem;
        let given = problem.given.clone();
        let mut plain = solve(problem, &problem.nominal, &given, &self.noise);
        for k in 0..2 {
            self.progress.step("fit the model", k + 1, 4)?;
            self.noise = Noise::white(&plain.residual);
            plain = solve_like(problem, &plain, &given, &self.noise);
        }
        self.progress.step("fit the model", 3, 4)?;
        self.noise = self.noise_of_largest(&plain)?;
        self.rows = self.noise.rows(&self.problem);
        let fitted = solve_like(&self.problem, &plain, &given, &self.noise);
        let fitted = if given.is_empty() { fitted } else { self.polish(fitted) };
        self.progress.step("fit the model", 4, 4)?;
        Ok(fitted)
    }

    /// Noise as what the candidates at their default constants and random features of the state leave.
    fn noise_of_largest(&mut self, fitted: &Fitted) -> Result<Noise, Interrupted> {
        let n = self.problem.dof();
        let mut seen = HashSet::new();
        let mut terms = self.terms_to_try(fitted);
        terms.retain(|t| t.effect.reach() == Reach::Own && seen.insert((t.effect.name().to_string(), t.site)));
        self.prepare(fitted, &terms)?;
        let of_joint = |joint: usize| {
            let own = terms.iter().filter(|term| term.site == Site::Joint(joint));
            let mut columns: Vec<Column> = own.flat_map(|term| self.cache[&key_of(term)].iter().cloned()).collect();
            columns.extend(unknown::features(&self.problem, joint, &Group::whole(joint, n), 0.8));
            let only = |column: &Column| -> Column {
                (0..n).map(|j| if j == joint { column[j].clone() } else { vec![] }).collect()
            };
            let base = fitted.columns.iter().map(only);
            let all: Vec<Column> = base.chain(columns).filter(|column| !column[joint].is_empty()).collect();
            self.left_by(joint, &all, &fitted.residual[joint])
        };
        let left: Vec<Rest> = (0..n).into_par_iter().map(of_joint).collect();
        Ok(Noise::of(&self.problem, &left))
    }

    /// Whether the last term of a fit corrects the geometry, a tilt, a zero, a length, and less than the noise is left at
    /// a joint: the largest model at the start could not know of it and took it for noise.
    fn is_quieter(&self, fitted: &Fitted) -> bool {
        const QUIETER: f64 = 0.95;
        let geometric = |term: &Term| {
            term.is_transform() && term.effect.constants().iter().all(|constant| ["rad", "m"].contains(&constant.unit))
        };
        fitted.terms().last().is_some_and(geometric)
            && fitted.residual.iter().zip(&self.noise.level).any(|(r, level)| !r.is_empty() && rms(r) < QUIETER * level)
    }

    /// What columns leave of a joint's residual. Seconds with far more of it than others hold what begins and ends, a
    /// contact or a load: they are no noise, are left out of a second fit and marked.
    fn left_by(&self, joint: usize, columns: &[Column], residual: &[f64]) -> Rest {
        const LOUD: f64 = 4.0;
        let rows = &self.problem.rows[joint];
        let second = |row: usize| {
            let (stretch, sample) = rows[row];
            (stretch, (sample as f64 / self.problem.stretches[stretch].motion.rate_hz) as usize)
        };
        let (mut left, mut used, mut calm) = (residual.to_vec(), 0, vec![true; residual.len()]);
        for _ in 0..3 {
            let masked = |values: &[f64]| -> Vec<f64> {
                values.iter().zip(calm.iter()).map(|(x, calm)| if *calm { *x } else { 0.0 }).collect()
            };
            let column = |values: Vec<f64>| -> Column {
                let mut column = vec![vec![]; self.problem.dof()];
                column[joint] = values;
                column
            };
            let some: Vec<Column> = columns.iter().map(|c| column(masked(&c[joint]))).collect();
            let basis = Basis::new(&some);
            used = basis.q.len();
            let factors = basis.solve(&column(masked(residual)));
            left = residual.to_vec();
            for (c, factor) in columns.iter().zip(&factors).filter(|(_, factor)| **factor != 0.0) {
                left.iter_mut().zip(&c[joint]).for_each(|(left, c)| *left -= factor * c);
            }
            let mut energies: Vec<((usize, usize), f64, f64)> = Vec::new();
            for (row, value) in left.iter().enumerate() {
                match energies.last_mut().filter(|(key, ..)| *key == second(row)) {
                    Some((_, sum, count)) => (*sum, *count) = (*sum + value * value, *count + 1.0),
                    None => energies.push((second(row), value * value, 1.0)),
                }
            }
            let mut sorted: Vec<f64> = energies.iter().map(|(_, sum, count)| sum / count).collect();
            sorted.sort_by(f64::total_cmp);
            let Some(median) = sorted.get(sorted.len() / 2) else { break };
            let loud: Vec<(usize, usize)> =
                energies.iter().filter(|(_, sum, count)| sum / count > LOUD * median).map(|(key, ..)| *key).collect();
            (0..rows.len()).for_each(|row| calm[row] = loud.binary_search(&second(row)).is_err());
        }
        Rest { residual: left, used, calm }
    }

    /// Whether an effect is looked for.
    fn wanted(&self, effect: &dyn Effect) -> bool {
        let about = effect.about();
        let absent = !self.has_everywhere(effect) && !is_absorbed(effect);
        effect.entry() != Entry::Gate && about.alias_of.is_none() && absent
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

    /// One term per effect, site and point of the grid; those that need a search of their own are left out.
    fn terms_to_try(&self, fitted: &Fitted) -> Vec<Term> {
        let robot = self.problem.nominal.robot();
        let mut terms = Vec::new();
        for effect in self.catalogue.iter().filter(|effect| self.wanted(effect.as_ref())) {
            let constants = effect.constants();
            let special = |c: &Constant| matches!(c.scale, Scale::Time | Scale::Order);
            let limit = effect.entry() == Entry::Transform && constants.iter().any(|c| c.scale == Scale::Torque);
            if limit || constants.iter().any(special) || self.not_testable(fitted, effect.as_ref()).is_some() {
                continue;
            }
            for site in effect.sites(robot) {
                let there = |name: &str| fitted.terms().iter().any(|t| t.effect.name() == name && t.site == site);
                let refines = |name: &str| self.known.iter().any(|known| known == name) || there(name);
                if there(effect.name()) || !effect.refines().is_none_or(refines) {
                    continue;
                }
                let points = self.points(effect.as_ref(), site).into_iter();
                terms.extend(points.map(|point| Term::new(effect.clone(), site, point)));
            }
        }
        terms
    }

    /// Constants to start from.
    fn points(&self, effect: &dyn Effect, site: Site) -> Vec<Vec<f64>> {
        let grids: Vec<Vec<f64>> = (0..effect.constants().len()).map(|k| self.grid(effect, site, k)).collect();
        effects::points_of(&grids)
    }

    /// Values of a constant to start from, in its unit.
    fn grid(&self, effect: &dyn Effect, site: Site, index: usize) -> Vec<f64> {
        let joint = site.joint().unwrap_or_default();
        let constant = &effect.constants()[index];
        let mut grid = constant.grid_in(self.problem.ranges(joint));
        if is_width_of_reversal(effect, constant) {
            grid.retain(|width| *width >= self.problem.speed_steps[joint]);
        }
        grid
    }

    /// Lowest and highest value of a constant, in its unit.
    fn bounds(&self, term: &Term, index: usize) -> [f64; 2] {
        let joint = term.site.joint().unwrap_or_default();
        let constant = &term.effect.constants()[index];
        let [low, high] = constant.bounds_in(self.problem.ranges(joint));
        let resolved = is_width_of_reversal(term.effect.as_ref(), constant);
        [if resolved { self.problem.speed_steps[joint].clamp(low, high) } else { low }, high]
    }

    /// Columns of a term in the band, tangents for a transform.
    fn raw(&mut self, fitted: &Fitted, term: &Term) -> Vec<Column> {
        let key = key_of(term);
        if let Some(columns) = self.cache.get(&key) {
            return columns.clone();
        }
        let columns = self.columns_of(fitted, term);
        self.cache.insert(key, columns.clone());
        columns
    }

    fn columns_of(&self, fitted: &Fitted, term: &Term) -> Vec<Column> {
        if !term.is_transform() {
            return self.problem.term_columns(&fitted.model, &fitted.rigid, term);
        }
        let mut terms = fitted.terms().to_vec();
        terms.push(term.clone());
        let model = fitted.model.clone().with_terms(terms, self.problem.clock);
        let last = fitted.terms().len();
        (0..term.constants.len()).map(|k| tangent(&self.problem, (&model, &fitted.rigid), (last, k))).collect()
    }

    /// Computes the columns that [`Self::raw`] will be asked for, on all cores.
    fn prepare(&mut self, fitted: &Fitted, terms: &[Term]) -> Result<(), Interrupted> {
        const AT_ONCE: usize = 24;
        let missing: Vec<&Term> = terms.iter().filter(|term| !self.cache.contains_key(&key_of(term))).collect();
        for (index, some) in missing.chunks(AT_ONCE).enumerate() {
            self.progress.step("columns of effects", AT_ONCE * index, missing.len())?;
            let columns: Vec<_> = some.par_iter().map(|term| self.columns_of(fitted, term)).collect();
            self.cache.extend(some.iter().map(|term| key_of(term)).zip(columns));
        }
        self.progress.step("columns of effects", missing.len(), missing.len())
    }

    /// The columns of the fit and those that take up what constants of the model may be wrong by.
    pub fn with_nuisances(&self, fitted: &Fitted) -> (Basis, Column) {
        let mut basis = Basis::clone(&fitted.basis);
        let problem = &self.problem;
        for joint in 0..problem.dof() {
            let has = |name: &str| {
                self.known.iter().any(|known| known == name)
                    || fitted.terms().iter().any(|t| t.effect.name() == name && t.site == Site::Joint(joint))
            };
            if has("coulomb_friction") {
                let width = fitted.model.processing().map_or(0.003, |p| p.standstill_speed[joint]).clamp(0.002, 0.01);
                let columns = problem.reversal_columns(&fitted.model, &fitted.rigid, joint, [width, 3.0 * width]);
                columns.iter().for_each(|column| basis.push(&self.noise.whiten(problem, column)));
            }
        }
        let smooth = |(k, index): &(usize, usize)| {
            let term = &fitted.terms()[*k];
            !(term.is_transform() && term.effect.constants()[*index].scale == Scale::Torque)
        };
        let constants: Vec<(usize, usize)> = fitted.constants().filter(smooth).collect();
        let tangents = tangents(problem, fitted, &self.noise, &constants);
        tangents.iter().for_each(|tangent| basis.push(tangent));
        let mut white = self.noise.whiten(problem, &fitted.target);
        basis.project_out(&mut white);
        basis.project_out(&mut white);
        (basis, white)
    }

    fn candidate(&self, term: Term, gain: Gain, constants: usize) -> Candidate {
        let size = (gain.rank + constants) as f64;
        let score = 0.5 * gain.chi2 - 0.5 * size * self.rows.max(2.0).ln() - self.units.ln();
        let score = if gain.visible < invisible(&term) { f64::NEG_INFINITY } else { score };
        let signs = term.effect.parameters().iter().zip(&gain.coefficients);
        let first_negative = signs.take(1).any(|(parameter, value)| parameter.non_negative && *value < 0.0);
        let out_of_bounds = term.is_transform()
            && term.effect.constants().iter().zip(&gain.coefficients).any(|(c, x)| c.low > -1e-3 * c.high && *x < 0.0);
        let resonances = term.constants.iter().enumerate().zip(term.effect.constants());
        let at_edge = resonances
            .filter(|(_, constant)| constant.unit == "Hz")
            .any(|((k, value), _)| *value > 0.98 * self.bounds(&term, k)[1]);
        let contact_like = term.effect.name() == "payload_change" || term.effect.name() == "external_contact";
        let impossible = (first_negative && !contact_like) || out_of_bounds || at_edge;
        Candidate { impossible, term, gain, score }
    }

    /// Every effect at every site at every point of its grid; those that begin or end at a time are left out.
    pub fn terms_of_ranking(&self, fitted: &Fitted) -> Vec<Term> {
        self.terms_to_try(fitted).into_iter().chain(self.orders_to_try(fitted)).collect()
    }

    /// The columns of terms in the band, tangents for a transform, which are not remembered any more.
    pub fn take_columns(&mut self, fitted: &Fitted, terms: &[Term]) -> Result<Vec<Vec<Column>>, Interrupted> {
        self.prepare(fitted, terms)?;
        let take = |term: &Term| self.cache.remove(&key_of(term)).unwrap_or_default();
        Ok(terms.iter().map(take).collect())
    }

    /// Every effect at every site at its best point of the grid, best first.
    fn rank(&mut self, fitted: &Fitted, basis: &Basis, white: &Column) -> Result<Vec<Candidate>, Interrupted> {
        let mut best: HashMap<(String, Site), Candidate> = HashMap::new();
        let keep = |best: &mut HashMap<(String, Site), Candidate>, candidate: Candidate| {
            let key = (candidate.term.effect.name().to_string(), candidate.term.site);
            match best.get(&key) {
                Some(old) if (old.impossible, -old.score) <= (candidate.impossible, -candidate.score) => {}
                _ => {
                    best.insert(key, candidate);
                }
            }
        };
        let terms = self.terms_of_ranking(fitted);
        let count = terms.len();
        self.prepare(fitted, &terms)?;
        self.progress.step("rank effects", 0, count)?;
        let scored = |term: &Term| {
            let columns = &self.cache[&key_of(term)];
            let white_columns: Vec<Column> = columns.iter().map(|c| self.noise.whiten(&self.problem, c)).collect();
            let gain = gain(basis, white, &white_columns, invisible(term));
            let constants = if term.is_transform() { 0 } else { term.constants.len() };
            self.candidate(term.clone(), gain, constants)
        };
        let candidates: Vec<Candidate> = terms.par_iter().map(scored).collect();
        candidates.into_iter().for_each(|candidate| keep(&mut best, candidate));
        for candidate in self.scan_times(fitted, basis, white) {
            keep(&mut best, candidate);
        }
        let mut all: Vec<Candidate> = best.into_values().collect();
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

    /// Effects with an order: the peaks of a periodogram of the residual over the position.
    fn orders_to_try(&self, fitted: &Fitted) -> Vec<Term> {
        const LOWEST: usize = 4;
        const HIGHEST: usize = 200;
        let n = self.problem.dof();
        let mut terms = Vec::new();
        for joint in 0..n {
            let q = |&(stretch, sample): &(usize, usize)| self.problem.stretches[stretch].motion.q[sample * n + joint];
            let samples = self.problem.rows[joint].iter().map(q).zip(fitted.residual[joint].iter().copied());
            let power = power_by_order(samples, LOWEST - 1..=HIGHEST + 1);
            let at = |order: usize| power[order + 1 - LOWEST];
            let mut peaks: Vec<usize> =
                (LOWEST..=HIGHEST).filter(|&order| at(order) >= at(order - 1) && at(order) >= at(order + 1)).collect();
            peaks.sort_by(|&a, &b| at(b).total_cmp(&at(a)));
            for effect in self.catalogue.iter().filter(|e| self.wanted(e.as_ref())) {
                let constants = effect.constants();
                if constants.len() == 1 && constants[0].scale == Scale::Order {
                    let order = |order: &usize| Term::new(effect.clone(), Site::Joint(joint), vec![*order as f64]);
                    terms.extend(peaks.iter().take(3).map(order));
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

    /// Effects that begin, or begin and end, at a time: sums over blocks of time give every change point.
    fn scan_times(&mut self, fitted: &Fitted, basis: &Basis, white: &Column) -> Vec<Candidate> {
        let mut found = Vec::new();
        let robot = self.problem.nominal.robot().clone();
        let [start, end] = self.problem.time_span();
        if end <= start {
            return found;
        }
        let bins = ((end - start) / TIME_STEP).ceil() as usize + 1;
        let wanted: Vec<Arc<dyn Effect>> =
            self.catalogue.iter().filter(|effect| self.wanted(effect.as_ref())).cloned().collect();
        for effect in &wanted {
            let times = effect.constants().iter().filter(|c| c.scale == Scale::Time).count();
            if times == 0 {
                continue;
            }
            if self.not_testable(fitted, effect.as_ref()).is_some() {
                continue;
            }
            for site in effect.sites(&robot) {
                if times == 1 && fitted.terms().iter().any(|t| t.effect.name() == effect.name() && t.site == site) {
                    continue;
                }
                let always = [f64::NEG_INFINITY, f64::INFINITY];
                let whole = Term::new(effect.clone(), site, always[..times].to_vec());
                let columns: Vec<Column> =
                    self.raw(fitted, &whole).iter().map(|c| self.noise.whiten(&self.problem, c)).collect();
                let sums = self.sums_over_time(basis, white, &columns, start, bins);
                let mut best: Option<(f64, Vec<f64>, Gain)> = None;
                let k = columns.len();
                let mut consider = |first: usize, last: usize, constants: Vec<f64>| {
                    let sum: Vec<f64> = sums[last].iter().zip(&sums[first]).map(|(b, a)| b - a).collect();
                    let gain = switched_gain(&sum, k, basis.q.len());
                    if best.as_ref().is_none_or(|(chi2, ..)| gain.chi2 > *chi2) {
                        best = Some((gain.chi2, constants, gain));
                    }
                };
                let time = |bin: usize| start + bin as f64 * TIME_STEP;
                if times == 1 {
                    (2..bins - 2).for_each(|first| consider(first, bins, vec![time(first)]));
                } else {
                    for first in 1..bins - 2 {
                        // A contact lasts at most a quarter of the session: longer ones are changes of payload.
                        let longest = (first + (bins / 4).max(4)).min(bins - 1);
                        (first + 1..longest).for_each(|last| consider(first, last, vec![time(first), time(last)]));
                    }
                }
                if let Some((_, constants, gain)) = best {
                    let term = Term::new(effect.clone(), site, constants);
                    found.push(self.candidate(term, gain, times));
                }
            }
        }
        found
    }

    /// Running sums over the time of the session: per bin [ZᵀZ, ZᵀQ, Zᵀy], one entry more than bins.
    fn sums_over_time(
        &self,
        basis: &Basis,
        white: &Column,
        columns: &[Column],
        start: f64,
        bins: usize,
    ) -> Vec<Vec<f64>> {
        let (k, r) = (columns.len(), basis.q.len());
        let width = k * k + k * r + k;
        let mut sums = vec![vec![0.0; width]; bins + 1];
        for joint in 0..self.problem.dof() {
            if columns.iter().all(|column| column[joint].is_empty()) {
                continue;
            }
            let rows = &self.problem.rows[joint];
            let bin = |row: usize| {
                let time = self.problem.time_of(rows[row]);
                (((time - start) / TIME_STEP) as usize).min(bins - 1)
            };
            let mut first = 0;
            while first < rows.len() {
                let here = bin(first);
                let mut last = first;
                while last < rows.len() && bin(last) == here && rows[last].0 == rows[first].0 {
                    last += 1;
                }
                let sum = &mut sums[here + 1];
                let part = |column: &Column| column[joint].get(first..last).unwrap_or(&[]).to_vec();
                let z: Vec<Vec<f64>> = columns.iter().map(part).collect();
                for a in 0..k {
                    for b in 0..k {
                        sum[a * k + b] += dot_in_lanes(&z[a], &z[b]);
                    }
                    for (b, q) in basis.q.iter().enumerate() {
                        if let Some(q) = q[joint].get(first..last) {
                            sum[k * k + a * r + b] += dot_in_lanes(&z[a], q);
                        }
                    }
                    sum[k * k + k * r + a] += dot_in_lanes(&z[a], &white[joint][first..last]);
                }
                first = last;
            }
        }
        for bin in 1..=bins {
            for entry in 0..width {
                sums[bin][entry] += sums[bin - 1][entry];
            }
        }
        sums
    }

    /// A term with other constants, the rest of the model refitted linearly.
    fn with_constants(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        term: &Term,
        constants: &[f64],
    ) -> Candidate {
        let term = Term::new(term.effect.clone(), term.site, constants.to_vec());
        let columns = self.problem.term_columns(&fitted.model, &fitted.rigid, &term);
        let columns: Vec<Column> = columns.iter().map(|c| self.noise.whiten(&self.problem, c)).collect();
        let gain = gain(basis, white, &columns, INVISIBLE);
        self.candidate(term, gain, constants.len())
    }

    /// The constants of a term searched coordinate by coordinate, the rest of the model refitted linearly.
    pub fn refine(&self, fitted: &Fitted, (basis, white): (&Basis, &Column), candidate: &Candidate) -> Candidate {
        let term = &candidate.term;
        if term.is_transform() || term.constants.is_empty() {
            return candidate.clone();
        }
        let evaluate = |constants: &[f64]| self.with_constants(fitted, (basis, white), term, constants);
        let mut best = evaluate(&candidate.term.constants);
        let count = term.constants.len();
        // Between two logs there are no rows, and all times are equal there: steps must reach the other side.
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
        let exact = |k: usize| if term.effect.constants()[k].scale == Scale::Time { 0.002 } else { 0.03 };
        let smallest: Vec<f64> = steps.iter().enumerate().map(|(k, step)| exact(k) * step).collect();
        let logarithmic = |k: usize| term.effect.constants()[k].scale == Scale::Logarithmic;
        for _ in 0..40 {
            let mut moved = false;
            for k in 0..count {
                let [low, high] = self.bounds(term, k);
                for direction in [1.0, -1.0] {
                    let mut constants = best.term.constants.clone();
                    let value = constants[k];
                    let step = direction * steps[k];
                    constants[k] = if logarithmic(k) { value * step.exp() } else { value + step }.clamp(low, high);
                    if constants[k] == value || !lasts(term, &constants) {
                        continue;
                    }
                    let next = evaluate(&constants);
                    if !next.impossible && (best.impossible || next.gain.chi2 > best.gain.chi2 + 0.02) {
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
        best
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

    /// The fit with the constants of those terms looked for anew that a removed one at their joint is confused with: it may
    /// have stood for them while they described only what it left.
    fn with_imitated(&self, mut fitted: Fitted, removed: &Term) -> Fitted {
        let confused = |term: &Term| {
            let says = |a: &Term, b: &Term| a.effect.about().confusable.contains(&b.effect.name());
            term.site == removed.site && !term.is_transform() && (says(term, removed) || says(removed, term))
        };
        for k in 0..fitted.terms().len() {
            let term = fitted.terms()[k].clone();
            let points = self.points(term.effect.as_ref(), term.site);
            if points.len() < 2 || !confused(&term) {
                continue;
            }
            let without = without(&self.problem, &fitted, k, &self.noise);
            let residual = (without.basis.as_ref(), &without.white);
            let at = |point: Vec<f64>| self.with_constants(&without, residual, &term, &point);
            let candidates: Vec<Candidate> = points.into_iter().map(at).filter(|c| !c.impossible).collect();
            let Some(best) = candidates.iter().max_by(|a, b| a.score.total_cmp(&b.score)) else { continue };
            let mut terms = fitted.terms().to_vec();
            terms[k].constants = self.refine(&without, residual, best).term.constants;
            let next = self.refit(&fitted, terms);
            if next.chi2 < fitted.chi2 {
                fitted = next;
            }
        }
        fitted
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
            let candidate = Candidate { term, gain: Gain::default(), score: 0.0, impossible: false };
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

    /// Score of going from one fit to a larger one.
    pub fn score_of(&self, small: &Fitted, large: &Fitted) -> f64 {
        let constants = |f: &Fitted| f.terms().iter().map(|t| t.constants.len()).sum::<usize>();
        let size = (large.basis.q.len() + constants(large)) as f64 - (small.basis.q.len() + constants(small)) as f64;
        0.5 * (small.chi2 - large.chi2) - 0.5 * size * self.rows.max(2.0).ln() - self.units.ln()
    }

    /// Forward steps with joint refit, then backward ones.
    pub fn run(&mut self, start: &Fitted) -> Result<Outcome, Interrupted> {
        let mut fitted = start.clone();
        let mut accepted: Vec<Accepted> = Vec::new();
        let mut ranking = None;
        // Joints where a smooth function of the state does better than many effects: their rows would mislead.
        let mut closed = vec![false; self.problem.dof()];
        self.progress.step(STAGE, 0, MOST_TERMS)?;
        for (next, step) in self.limits(&fitted) {
            fitted = next;
            accepted.push(step);
        }
        while fitted.terms().len() < MOST_TERMS {
            let (basis, white) = self.with_nuisances(&fitted);
            if let Some(released) = self.without_holds(&fitted, (&basis, &white))? {
                fitted = released;
                continue;
            }
            let candidates = self.rank(&fitted, &basis, &white)?;
            let tried = self.refined(&fitted, (&basis, &white), &candidates)?;
            let tried = self.worth_it(&fitted, (&basis, &white), &accepted, tried);
            if let Some((next, steps)) = self.finer_forms(&fitted, (&basis, &white), &candidates, &tried)? {
                fitted = next;
                accepted.extend(steps);
                continue;
            }
            ranking.get_or_insert(candidates);
            let Some((next, step)) = self.next_term(&fitted, &tried)? else {
                break;
            };
            let transform = next.terms().last().is_some_and(Term::is_transform);
            fitted = if next.terms().len() > 1 { self.polish(next) } else { next };
            accepted.push(step);
            if transform {
                self.cache.clear();
            }
            if let Some(later) = self.without_late_rests(&fitted)? {
                fitted = later;
            }
            if let Some((joint, bare, others)) = without_many_imitations(self, &fitted, &accepted) {
                closed[joint] = true;
                accepted = others;
                fitted = self.on_rows_without(&closed, &bare);
            }
            if self.is_quieter(&fitted) {
                fitted = self.with_noise_anew(&fitted)?;
            }
            self.progress.step(STAGE, fitted.terms().len().min(MOST_TERMS), MOST_TERMS)?;
        }
        fitted = self.with_likelier_transforms(fitted, &mut accepted);
        let (mut fitted, accepted) = self.backward(fitted, accepted)?;
        if closed.contains(&true) {
            let on_all_rows = self.on_rows_without(&vec![false; closed.len()], &fitted);
            fitted = self.with_noise_anew(&on_all_rows)?;
        }
        let start = solve(&self.problem, &start.model, start.terms(), &self.noise);
        self.progress.step(STAGE, MOST_TERMS, MOST_TERMS)?;
        let [held_out_before, held_out] = [&start, &fitted].map(|fit| self.held_out(fit));
        Ok(Outcome { start, fitted, accepted, ranking: ranking.unwrap_or_default(), held_out_before, held_out })
    }

    /// The fit with the noise that the largest model leaves beside it.
    fn with_noise_anew(&mut self, fitted: &Fitted) -> Result<Fitted, Interrupted> {
        self.noise = self.noise_of_largest(fitted)?;
        self.rows = self.noise.rows(&self.problem);
        let next = solve_like(&self.problem, fitted, fitted.terms(), &self.noise);
        Ok(refine_transforms(&self.problem, next, &self.noise))
    }

    /// The fit on the rows of all joints but the closed ones.
    fn on_rows_without(&mut self, closed: &[bool], fitted: &Fitted) -> Fitted {
        self.problem.leave_out_joints(closed).expect("the logs had torque before");
        self.cache.clear();
        self.rows = self.noise.rows(&self.problem);
        solve(&self.problem, &fitted.model, fitted.terms(), &self.noise)
    }

    /// The fit with the limits at which the logged torque stays, one after the other.
    fn limits(&self, fitted: &Fitted) -> Vec<(Fitted, Accepted)> {
        let mut steps: Vec<(Fitted, Accepted)> = Vec::new();
        let probe = |effect: &Arc<dyn Effect>, joint: usize, limit: f64| {
            let constants = effect.constants();
            let wanted = constants.len() == 1 && constants[0].scale == Scale::Torque && self.wanted(effect.as_ref());
            let term = wanted.then(|| Term::new(effect.clone(), Site::Joint(joint), vec![limit]));
            term.filter(is_limit)
        };
        for (joint, limit) in self.problem.limits.iter().enumerate() {
            let Some(limit) = *limit else { continue };
            let Some(term) = self.catalogue.iter().find_map(|effect| probe(effect, joint, limit)) else { continue };
            let before = steps.last().map_or(fitted, |(fitted, _)| fitted);
            if before.terms().iter().any(|t| is_limit(t) && t.site == term.site) {
                continue;
            }
            let next =
                solve_like(&self.problem, before, &[before.terms(), std::slice::from_ref(&term)].concat(), &self.noise);
            let (without, with) = (self.errors(before), self.errors(&next));
            if without.largest_fall_to(&with, &term) < MATERIAL {
                continue;
            }
            let fall = without.total()[joint].powi(2) - with.total()[joint].powi(2);
            let score = 0.5 * self.problem.rows[joint].len() as f64 * fall / self.noise.level[joint].powi(2);
            let accepted = Accepted::new(&term, score, [before, &next], (&without, &with));
            steps.push((next, accepted));
        }
        steps
    }

    /// The fit without the moments before reversals at which joints stick, if there are joints that do.
    fn without_holds(
        &mut self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
    ) -> Result<Option<Fitted>, Interrupted> {
        const DURATIONS_S: [f64; 5] = [0.016, 0.03, 0.05, 0.08, 0.12];
        /// Rows are left out somewhat farther than the jump is seen: stops differ in length.
        const FARTHER: f64 = 1.5;
        let mut holds = Vec::new();
        for joint in 0..self.problem.dof() {
            let dry = self.known.iter().any(|known| known == "coulomb_friction")
                || fitted.terms().iter().any(|t| t.effect.name() == "coulomb_friction" && t.site == Site::Joint(joint));
            if !dry || self.problem.leaves_holds_out(joint) {
                continue;
            }
            let tried = DURATIONS_S.map(|seconds| {
                let column = self.noise.whiten(&self.problem, &self.problem.approach_column(joint, seconds));
                (seconds, gain(basis, white, &[column], INVISIBLE))
            });
            let best = tried.into_iter().max_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2)).expect("some durations");
            let (seconds, gain) = best;
            let size = gain.coefficients[0];
            if 0.5 * gain.chi2 > 3.0 * EVIDENCE && size > self.noise.level[joint] {
                holds.push((joint, FARTHER * seconds + 0.02));
            }
        }
        if holds.is_empty() || self.problem.leave_out_holds(&holds).is_err() {
            return Ok(None);
        }
        self.on_other_rows(fitted).map(Some)
    }

    /// The fit without the moments after rests into which a delay, if it is the last term, carries the torque of the rest:
    /// a lag that rounds steps would look better.
    fn without_late_rests(&mut self, fitted: &Fitted) -> Result<Option<Fitted>, Interrupted> {
        /// Of the delay, which other effects may hide in part.
        const FARTHER: f64 = 2.0;
        let seconds = FARTHER * fitted.terms().last().and_then(delay).unwrap_or_default();
        if seconds <= self.problem.after_rest || self.problem.leave_out_after_rests(seconds).is_err() {
            return Ok(None);
        }
        self.on_other_rows(fitted).map(Some)
    }

    /// The fit on rows that were chosen anew, with the noise there.
    fn on_other_rows(&mut self, fitted: &Fitted) -> Result<Fitted, Interrupted> {
        self.cache.clear();
        let again = solve(&self.problem, &fitted.model, fitted.terms(), &self.noise);
        self.with_noise_anew(&again)
    }

    /// The best candidates, at most two sites of an effect, their constants refined, best first.
    fn refined(
        &self,
        fitted: &Fitted,
        residual: (&Basis, &Column),
        candidates: &[Candidate],
    ) -> Result<Vec<Candidate>, Interrupted> {
        let mut chosen: Vec<&Candidate> = Vec::new();
        let mut names: Vec<&str> = Vec::new();
        let own = |c: &&Candidate| !c.impossible && c.score > 0.0 && c.term.effect.refines().is_none();
        for candidate in candidates.iter().filter(own) {
            let name = candidate.term.effect.name();
            if chosen.len() < MOST_REFINED && names.iter().filter(|other| **other == name).count() < 2 {
                names.push(name);
                chosen.push(candidate);
            }
        }
        self.progress.step("refine constants", 0, 1)?;
        let refine = |candidate: &&Candidate| self.refine(fitted, residual, candidate);
        let mut tried: Vec<Candidate> = chosen.par_iter().map(refine).collect();
        self.progress.step("refine constants", 1, 1)?;
        tried.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(tried)
    }

    /// Candidates with evidence that is not tiny beside what was found before at the same joint: a form that is right to
    /// one percent leaves so much, and it would be taken for an effect of its own. Beside a contact, which is strong and
    /// short, only that counts which is explained while it is not there.
    fn worth_it(
        &self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
        accepted: &[Accepted],
        mut tried: Vec<Candidate>,
    ) -> Vec<Candidate> {
        const SHARE: f64 = 0.01;
        const TRANSFORM: f64 = 0.001;
        /// What an effect at one joint may leave at others, which the parameters of the links tie to it.
        const ELSEWHERE: f64 = 0.0001;
        let given = fitted.terms().len() - accepted.len();
        let news = || accepted.iter().zip(&fitted.terms()[given..]).filter(|(_, t)| t.effect.refines().is_none());
        let windows: Vec<[f64; 2]> = news().filter_map(|(_, term)| window_of_arm(term)).collect();
        // Per joint what is tiny there, and what is tiny of all joints together, beside some terms.
        let tiny_beside = |terms: &[(&Accepted, &Term)]| -> (Vec<f64>, f64) {
            let left = |joint: usize, (step, term): &(&Accepted, &Term)| {
                if term.is_transform() {
                    return TRANSFORM * step.first_by_joint[joint];
                }
                // A load that comes or goes changes friction at all joints a little, wrists far from most of its torque.
                let arm = term.effect.reach() == Reach::All;
                SHARE * if arm { step.first_score } else { step.first_by_joint[joint] }
            };
            let at = |joint: usize| terms.iter().map(|term| left(joint, term)).fold(0.0, f64::max);
            let elsewhere = terms.iter().map(|(step, _)| ELSEWHERE * step.first_score).fold(0.0, f64::max);
            ((0..self.problem.dof()).map(at).collect(), elsewhere)
        };
        let beside_all = tiny_beside(&news().collect::<Vec<_>>());
        if beside_all.1 == 0.0 {
            return tried;
        }
        let beside_lasting = tiny_beside(&news().filter(|(_, t)| window_of_arm(t).is_none()).collect::<Vec<_>>());
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
        tried.retain(|candidate| {
            let with = self.white_with(fitted, (basis, white), candidate);
            let all = falls(white, &with);
            // What depends on time may be the contact in another form.
            let apart = !windows.is_empty() && !candidate.term.effect.about().depends_on_time;
            let (falls, (tiny, elsewhere)) = if apart {
                (falls(&outside(white), &outside(&with)), &beside_lasting)
            } else {
                (all.clone(), &beside_all)
            };
            let inside = all.iter().sum::<f64>() - falls.iter().sum::<f64>();
            let beside: f64 = falls.iter().zip(tiny).filter(|(fall, tiny)| fall < tiny).map(|(fall, _)| fall).sum();
            candidate.score - inside - beside > if apart { elsewhere.max(EVIDENCE) } else { *elsewhere }
        });
        tried
    }

    /// What a candidate leaves of the whitened residual.
    fn white_with(&self, fitted: &Fitted, (basis, white): (&Basis, &Column), candidate: &Candidate) -> Column {
        let mut with = white.clone();
        for (column, factor) in self.columns_of(fitted, &candidate.term).iter().zip(&candidate.gain.coefficients) {
            for (with, x) in with.iter_mut().zip(&self.noise.whiten(&self.problem, column)) {
                with.iter_mut().zip(x).for_each(|(with, x)| *with -= factor * x);
            }
        }
        basis.project_out(&mut with);
        with
    }

    /// The fit with finer forms of effects that the model has, at all joints where no other effect of the joint does
    /// better, if there are any.
    fn finer_forms(
        &mut self,
        fitted: &Fitted,
        residual: (&Basis, &Column),
        candidates: &[Candidate],
        tried: &[Candidate],
    ) -> Result<Option<(Fitted, Vec<Accepted>)>, Interrupted> {
        let finer = |c: &&Candidate| c.term.effect.refines().is_some() && !c.impossible && c.score > EVIDENCE;
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
            !refined.impossible && refined.score > EVIDENCE && refined.score > best
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
            let harms = |c: &Candidate| c.term.site.joint().is_some_and(|joint| after[joint] > HARM * before[joint]);
            let count = found.len();
            found.retain(|candidate| !harms(candidate));
            if found.len() == count {
                break (next, with);
            }
        };
        let accepted = |c: Candidate| Accepted::new(&c.term, c.score, [fitted, &next], (&without, &with));
        let steps = found.into_iter().map(accepted).collect();
        Ok(Some((next, steps)))
    }

    /// The fit with the best of the candidates that has evidence and matters, if there is one.
    fn next_term(&mut self, fitted: &Fitted, tried: &[Candidate]) -> Result<Option<(Fitted, Accepted)>, Interrupted> {
        let mut worthy: &[&Candidate] =
            &tried.iter().filter(|c| !c.impossible && c.score > EVIDENCE).collect::<Vec<&Candidate>>();
        let without = self.errors(fitted);
        // One with much evidence that matters nowhere, in a moment of the log, must not hide the others.
        while let Some(best) = worthy.first() {
            let close = worthy.iter().take_while(|c| c.score > 0.3 * best.score).count().min(MOST_TRIED);
            let (some, rest) = worthy.split_at(close);
            if let Some(step) = self.best_of(fitted, &without, some, tried)? {
                return Ok(Some(step));
            }
            worthy = rest;
        }
        Ok(None)
    }

    /// The fit with the best of some candidates that has evidence and matters, if there is one.
    fn best_of(
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
        let scored = worthy.iter().zip(fits).map(|(candidate, trial)| {
            let score = self.score_of(fitted, &trial);
            (*candidate, trial, score)
        });
        let mut trials: Vec<(&Candidate, Fitted, f64)> = scored.collect();
        trials.sort_by(|a, b| b.2.total_cmp(&a.2));
        // Of effects that do equally well the plainest comes first: forms with more freedom imitate it.
        let best = trials.first().map_or(0.0, |(_, _, score)| *score);
        let freedom = |c: &Candidate| c.term.constants.len() + c.term.coefficients.len();
        let (mut equal, others): (Vec<_>, Vec<_>) =
            trials.into_iter().partition(|(_, _, score)| *score > best - NEARLY * best.abs());
        equal.sort_by_key(|(candidate, ..)| freedom(candidate));
        let trials = equal.into_iter().chain(others);
        for (candidate, trial, score) in trials.filter(|(_, _, score)| *score >= EVIDENCE) {
            let with = self.errors(&trial);
            let fitted_term = trial.terms().last().unwrap_or(&candidate.term);
            if without.largest_fall_to(&with, fitted_term) < asked_of(fitted_term) {
                continue;
            }
            let own = candidate.term.effect.name();
            let rivals = tried.iter().filter(|c| c.term.effect.name() != own);
            let rivals = rivals.map(|c| (c.term.effect.name().into(), c.term.site, c.score)).collect();
            let accepted =
                Accepted { rivals, ..Accepted::new(&candidate.term, score, [fitted, &trial], (without, &with)) };
            return Ok(Some((trial, accepted)));
        }
        Ok(None)
    }

    /// The fit with another transform of the same kind in the place of one that explains less, or no more and comes later
    /// in the catalogue: which of them it is may show only when all others are there.
    fn with_likelier_transforms(&self, mut fitted: Fitted, accepted: &mut [Accepted]) -> Fitted {
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
    fn transforms_like(&self, own: &Term) -> Vec<Term> {
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
                if (step.score < EVIDENCE || size < asked_of(term)) && weakest.as_ref().is_none_or(|(s, ..)| size < *s)
                {
                    weakest = Some((size, k, without));
                }
            }
            let Some((_, k, without)) = weakest else { break };
            accepted.remove(k);
            fitted = self.polish(without);
        }
        Ok((fitted, accepted))
    }

    /// Error per joint on blocks that were left out, N·m (N).
    pub fn held_out(&self, fitted: &Fitted) -> Vec<f64> {
        self.errors(fitted).total()
    }

    /// Error per joint in the band on a usual block that was left out, N·m (N).
    pub fn usual_error(&self, fitted: &Fitted) -> Vec<f64> {
        usual_error(&self.problem, fitted, &Extra::default(), &self.noise)
    }

    fn errors(&self, fitted: &Fitted) -> HeldOut {
        let in_band = held_out(&self.problem, fitted, &Extra::default(), &self.noise);
        HeldOut { in_band, beyond: beyond(&self.problem, fitted) }
    }
}

/// Errors per joint on blocks that were left out, in the band and beyond it.
#[derive(Clone, Debug)]
struct HeldOut {
    in_band: Vec<ByLog>,
    beyond: Vec<ByLog>,
}

impl HeldOut {
    /// Of all logs together, per joint, N·m (N).
    fn total(&self) -> Vec<f64> {
        self.in_band.iter().zip(&self.beyond).map(|(own, beyond)| own[0].hypot(beyond[0])).collect()
    }

    /// Largest fall on a joint with one more term, as a share of what is left, in all logs or in one: an effect of fast
    /// motion matters although there are slow logs beside. A transform that differentiates positions once more carries
    /// their noise into the torque beyond the band, one that smooths takes it out: neither speaks for or against its
    /// being there.
    fn largest_fall_to(&self, after: &Self, term: &Term) -> f64 {
        let flat = |errors: &[ByLog]| -> Vec<f64> { errors.iter().flatten().copied().collect() };
        let [own, beyond] = [flat(&self.in_band), flat(&self.beyond)];
        let [own_after, beyond_after] = [flat(&after.in_band), flat(&after.beyond)];
        let filters = term.is_transform() && !is_limit(term);
        let falls = (0..own.len()).map(|k| {
            let least = beyond[k].min(beyond_after[k]);
            let [beyond, beyond_after] = if filters { [least; 2] } else { [beyond[k], beyond_after[k]] };
            own[k].hypot(beyond) / own_after[k].hypot(beyond_after).max(1e-12) - 1.0
        });
        falls.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Whether a constant is the range of speeds over which friction changes sign. One that the joint crosses within a sample
/// cannot be told from none: it would hedge between the signs of a few samples.
fn is_width_of_reversal(effect: &dyn Effect, constant: &Constant) -> bool {
    effect.refines().is_some() && constant.unit == "rad/s"
}

/// Whether a term cuts the torque. Rows at the limit are no equations: it shows in the torque as logged.
fn is_limit(term: &Term) -> bool {
    term.site.joint().is_some_and(|joint| term.effect.limit(term.site, &term.constants, joint).is_some())
}

/// How much later than the motion a term says that the whole torque is logged, s; `None` if it says nothing of it.
fn delay(term: &Term) -> Option<f64> {
    let [constant] = term.effect.constants() else { return None };
    let late = term.is_transform() && term.site == Site::Arm && constant.unit == "s";
    late.then(|| term.constants[0])
}

/// When a contact of the arm is there, s, with the time over which filters carry its ends.
fn window_of_arm(term: &Term) -> Option<[f64; 2]> {
    const MARGIN_S: f64 = 0.5;
    let times = term.effect.constants().iter().zip(&term.constants).filter(|(c, _)| c.scale == Scale::Time);
    let mut times = times.map(|(_, time)| *time).filter(|_| term.effect.reach() == Reach::All);
    Some([times.next()? - MARGIN_S, times.next()? + MARGIN_S])
}

/// Half the fall of chi-squared per joint from one whitened residual to another.
fn falls(before: &Column, after: &Column) -> Vec<f64> {
    before
        .iter()
        .zip(after)
        .map(|(before, after)| 0.5 * (dot_in_lanes(before, before) - dot_in_lanes(after, after)))
        .collect()
}

/// What a term is remembered by.
fn key_of(term: &Term) -> (String, Site, Vec<u64>) {
    (term.effect.name().to_string(), term.site, term.constants.iter().map(|c| c.to_bits()).collect())
}

/// Gain from the sums of a window of time.
fn switched_gain(sum: &[f64], k: usize, r: usize) -> Gain {
    let share = |a: usize, b: usize| -> f64 {
        let row = |a: usize| &sum[k * k + a * r..][..r];
        row(a).iter().zip(row(b)).map(|(x, y)| x * y).sum()
    };
    let gram: Vec<f64> = (0..k * k).map(|i| sum[i] - share(i / k, i % k)).collect();
    let lengths: Vec<f64> = (0..k).map(|a| sum[a * k + a]).collect();
    gain_of(&gram, &sum[k * k + k * r..], &lengths, 0.03)
}
