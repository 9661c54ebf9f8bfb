//! Which effects: forward steps with joint refit, then backward ones.

mod backward;
mod by_hand;
mod candidates;
mod constants;
mod forward;
mod held_out;
mod imitations;
mod noise;
mod ranking;
mod rows;
mod times;

use std::collections::HashMap;
use std::sync::Arc;

use super::basis::Noise;
use super::evidence::sure_among;
use super::fit::{Fitted, solve, solve_like};
use super::problem::{Column, Problem};
use super::remembered::TermKey;
use super::unknown::Processes;
use crate::effects::{Dimension, Effect, Site};
use crate::model::Term;
use crate::progress::{Interrupted, Progress};
pub(super) use by_hand::Wanted;
pub(super) use candidates::Candidate;
use forward::{Next, falls};
use held_out::HeldOut;
pub(super) use held_out::{is_limit, material};
use imitations::MANY;
pub(super) use imitations::{CERTAIN, explained_share, imitations, is_much};

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
    /// Rivals at this step: other effects and their scores, best first.
    pub rivals: Vec<(Term, f64)>,
    /// Where else the same effect explained as much.
    pub twins: Vec<Site>,
    /// Whether a person asked for it: then it is never silent.
    pub wanted: bool,
    /// Whether it stood out among all times ([`Candidate::stands_out`]).
    stands_out: bool,
    /// Held-out error per joint right after it was added, N·m (N).
    pub with: Vec<f64>,
    /// Held-out error per joint of the whole model without it, N·m (N).
    pub without: Vec<f64>,
}

impl Accepted {
    /// The last term of `fits`, which are without and with it, and the errors of both.
    fn new(
        term: &Term,
        score: f64,
        fits: [&Fitted; 2],
        (without, with): (&HeldOut, &HeldOut),
    ) -> Self {
        Self {
            effect: term.effect.name().into(),
            site: term.site,
            score,
            first_score: score,
            first_by_joint: falls(&fits[0].white, &fits[1].white),
            effect_size: without.largest_fall_to(with, term),
            rivals: vec![],
            twins: vec![],
            wanted: false,
            stands_out: false,
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
    /// The same without the terms at some indices of the fit.
    pub fn without(mut self, search: &Search<'_>, out: &[usize]) -> Self {
        self.accepted = others(self.accepted, &self.fitted, out);
        self.fitted = search.polish(search.refit(&self.fitted, without(self.fitted.terms(), out)));
        self.held_out = search.held_out(&self.fitted);
        self
    }

    /// The same without what stood only beside terms that are gone.
    pub fn reduced(mut self, search: &Search<'_>) -> Result<Self, Interrupted> {
        (self.fitted, self.accepted) =
            search.backward(self.fitted, self.accepted, &|step| !step.wanted)?;
        self.held_out = search.held_out(&self.fitted);
        Ok(self)
    }

    /// [`Search::news`] of it.
    pub fn news(&self, search: &Search<'_>) -> impl Iterator<Item = (usize, &Accepted)> {
        search.news(&self.fitted, &self.accepted)
    }
}

/// Terms but those at some indices.
pub(super) fn without(terms: &[Term], out: &[usize]) -> Vec<Term> {
    (0..terms.len()).filter(|k| !out.contains(k)).map(|k| terms[k].clone()).collect()
}

/// Accepted terms of a fit but those at some indices of its terms.
pub(super) fn others(mut accepted: Vec<Accepted>, fitted: &Fitted, out: &[usize]) -> Vec<Accepted> {
    let mut index = fitted.terms().len() - accepted.len()..;
    accepted.retain(|_| !index.next().is_some_and(|k| out.contains(&k)));
    accepted
}

/// Whether a term refines what the model has already and does not matter, or is shorter than the
/// time between two samples and of little effect, and nobody asked for it.
fn is_silent(term: &Term, step: &Accepted, period: f64) -> bool {
    let times = term.is_transform()
        && term.effect.constants().iter().all(|c| c.dimension() == Dimension::Time);
    let within = || {
        term.constants.iter().all(|c| c.abs() < WITHIN_A_SAMPLE * period)
            && step.effect_size < LITTLE
    };
    !step.wanted
        && ((term.effect.refines().is_some() && step.effect_size < material(term))
            || (times && within()))
}

/// Torque and position of one row may be taken at moments that are this share of a period apart ...
const WITHIN_A_SAMPLE: f64 = 0.6;

/// ... which goes without saying as long as no joint's error falls by more than this share of what
/// is left.
const LITTLE: f64 = 0.08;

/// Scores below this are no evidence.
pub(super) const EVIDENCE: f64 = 8.0;

/// Smallest fall of the error of a joint as logged, as a share of what is left, that matters.
pub(super) const MATERIAL: f64 = 0.025;

/// Most terms that are looked for.
const MOST_TERMS: usize = 16;

const STAGE: &str = "look for effects";

pub(super) struct Search<'a> {
    pub problem: Problem,
    pub catalogue: &'a [Arc<dyn Effect>],
    /// Names of effects that the model has everywhere.
    pub known: Vec<String>,
    pub noise: Noise,
    pub units: f64,
    /// Least gain, in its standard deviations, of a finding ([`sure_among`]).
    pub sure: f64,
    pub rows: f64,
    cache: HashMap<TermKey, Vec<Column>>,
    /// Values to start from, by effect, site and index of the constant, where the effect has none
    /// of its own.
    grids: HashMap<(String, Site, usize), Vec<f64>>,
    progress: &'a dyn Progress,
    /// Hears of the candidates before the search ends.
    ranked: &'a OfRanked<'a>,
}
/// What is done with the candidates as soon as they are ranked, best first.
pub(super) type OfRanked<'a> = dyn Fn(&Search<'_>, &[Candidate]) + Sync + 'a;

impl<'a> Search<'a> {
    pub fn new(
        problem: Problem,
        catalogue: &'a [Arc<dyn Effect>],
        known: Vec<String>,
        (progress, ranked): (&'a dyn Progress, &'a OfRanked<'a>),
    ) -> Self {
        let noise = Noise::white(&problem.y);
        let robot = problem.nominal.robot();
        let units: usize = catalogue.iter().map(|effect| effect.sites(robot).len()).sum();
        let rows = problem.rows.iter().map(Vec::len).sum::<usize>() as f64;
        let (units, sure) = (units as f64, sure_among(units as f64));
        let (cache, grids) = (HashMap::new(), HashMap::new());
        Self { problem, catalogue, known, noise, units, sure, rows, cache, grids, progress, ranked }
    }

    /// The accepted terms with their indices in the fit and what the search knows of them, those
    /// that refine an effect of the model or align clocks within a sample left out.
    pub fn news<'f>(
        &self,
        fitted: &'f Fitted,
        accepted: &'f [Accepted],
    ) -> impl Iterator<Item = (usize, &'f Accepted)> + use<'f> {
        let given = fitted.terms().len() - accepted.len();
        let period =
            self.problem.stretches.iter().map(|s| 1.0 / s.motion.rate_hz).fold(0.0, f64::max);
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
        self.problem.believe_file(&plain.columns[..self.problem.base.rank()]);
        self.grids = self.grids_by_shape(&plain);
        self.noise = self.noise_of_largest(&plain)?;
        self.rows = self.noise.rows(&self.problem);
        let fitted = solve_like(&self.problem, &plain, &given, &self.noise);
        let fitted = if given.is_empty() { fitted } else { self.polish(fitted) };
        self.progress.step("fit the model", 4, 4)?;
        Ok(fitted)
    }

    /// Forward steps with joint refit, then backward ones.
    pub fn run(&mut self, start: &Fitted) -> Result<Outcome, Interrupted> {
        let mut fitted = start.clone();
        let mut accepted: Vec<Accepted> = Vec::new();
        let mut ranking = None;
        // Joints where a smooth function of the state does better than many effects: their rows
        // would mislead.
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
            let mut candidates = self.rank(&fitted, &basis, &white)?;
            let standing = self.standing(&fitted);
            if ranking.is_none() {
                self.judge_best(&fitted, &standing, &mut candidates)?;
                (self.ranked)(self, &candidates);
            }
            let promising = self.promising(&fitted, &standing, &candidates);
            match self.next_step(
                &fitted,
                (&standing, &accepted),
                (&basis, &white),
                (&candidates, &promising),
            )? {
                None => {
                    ranking.get_or_insert(candidates);
                    break;
                }
                Some(Next::Finer(next, steps)) => {
                    fitted = next;
                    accepted.extend(steps);
                    continue;
                }
                Some(Next::Term(next, step)) => {
                    ranking.get_or_insert(candidates);
                    fitted = if next.terms().len() > 1 { self.polish(next) } else { next };
                    accepted.push(step);
                }
            }
            if fitted.terms().last().is_some_and(Term::is_transform) {
                self.cache.clear();
            }
            if let Some(later) = self.without_late_rests(&fitted)? {
                fitted = later;
            }
            if let Some((joint, out)) = self.many_imitations(&fitted, &accepted) {
                closed[joint] = true;
                accepted = others(accepted, &fitted, &out);
                let bare = self.refit(&fitted, without(fitted.terms(), &out));
                fitted = self.on_rows_without(&closed, &bare);
            }
            if let Some(joints) = self.quieter_joints(&fitted) {
                fitted = self.with_noise_anew(&fitted, &joints)?;
            }
            self.progress.step(STAGE, fitted.terms().len().min(MOST_TERMS), MOST_TERMS)?;
        }
        (fitted, accepted) = self.settle(fitted, accepted, &closed)?;
        let start = solve(&self.problem, &start.model, start.terms(), &self.noise);
        self.progress.step(STAGE, MOST_TERMS, MOST_TERMS)?;
        let [held_out_before, held_out] = [&start, &fitted].map(|fit| self.held_out(fit));
        Ok(Outcome {
            start,
            fitted,
            accepted,
            ranking: ranking.unwrap_or_default(),
            held_out_before,
            held_out,
        })
    }

    /// What the steps forward found, in likelier, plainer or finer forms, without what is not
    /// needed.
    fn settle(
        &mut self,
        found: Fitted,
        mut accepted: Vec<Accepted>,
        closed: &[bool],
    ) -> Result<(Fitted, Vec<Accepted>), Interrupted> {
        let fitted = self.with_likelier_transforms(found, &mut accepted);
        let fitted = self.with_plainer_forms(fitted, &mut accepted);
        let fitted = self.with_finer_instead(fitted, &mut accepted);
        // What is at a closed joint has no rows here that it could explain.
        let is_closed = |step: &Accepted| step.site.joint().is_some_and(|joint| closed[joint]);
        let (fitted, accepted) = self.backward(fitted, accepted, &|step| !is_closed(step))?;
        if !closed.contains(&true) {
            return Ok((fitted, accepted));
        }
        let on_all_rows = self.on_rows_without(&vec![false; closed.len()], &fitted);
        let fitted = self.with_noise_anew(&on_all_rows, &self.all_joints())?;
        self.backward(fitted, accepted, &is_closed)
    }

    /// The joint of the last accepted term and the terms there, if there are many and they only
    /// imitate a smooth function of the state.
    fn many_imitations(
        &self,
        fitted: &Fitted,
        accepted: &[Accepted],
    ) -> Option<(usize, Vec<usize>)> {
        let joint = accepted.last()?.site.joint()?;
        let at_joint = |k: &usize| {
            fitted.terms()[*k].site.joint() == Some(joint) && !is_limit(&fitted.terms()[*k])
        };
        let own: Vec<usize> =
            self.news(fitted, accepted).map(|(k, _)| k).filter(at_joint).collect();
        let out = if own.len() < MANY {
            vec![]
        } else {
            let processes = Processes::new(&self.problem, fitted, &self.noise, joint);
            imitations(self, fitted, &own, (joint, 0.0), &processes)
        };
        (!out.is_empty()).then_some((joint, out))
    }

    /// Tells the listener how far a stage is.
    pub fn step(&self, stage: &'static str, done: usize, of: usize) -> Result<(), Interrupted> {
        self.progress.step(stage, done, of)
    }

    /// Score of going from one fit to a larger one.
    pub fn score_of(&self, small: &Fitted, large: &Fitted) -> f64 {
        let constants = |f: &Fitted| f.terms().iter().map(|t| t.constants.len()).sum::<usize>();
        let size = (large.basis.rank() + constants(large)) as f64
            - (small.basis.rank() + constants(small)) as f64;
        0.5 * (small.chi2 - large.chi2) - 0.5 * size * self.rows.max(2.0).ln() - self.units.ln()
    }
}
