//! A model with terms, fitted to the equations.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use rayon::prelude::*;

use super::DiagnosisError;
use super::basis::{Basis, INVISIBLE, INVISIBLE_TANGENT, Noise, gain};
use super::by_log::{ByLog, LogSums};
use super::evidence::LeftOut;
use super::left_out::{FoldFits, Held};
use super::problem::{Column, FOLDS, Problem};
use crate::effects::{Effect, Role, Scale, Site};
use crate::identification::nearest_load;
use crate::linalg::dot_in_lanes;
use crate::model::{Rigid, Term, TorqueModel};
use crate::motion::Motion;
use crate::robot::Robot;

/// A model and what it leaves of the torque.
#[derive(Clone)]
pub(super) struct Fitted {
    /// With its terms.
    pub model: TorqueModel,
    pub rigid: Arc<Vec<Rigid>>,
    /// What the columns have to explain: the torque less that of the model as it was, in the band.
    pub target: Arc<Column>,
    /// Base columns, then those of the terms, in the band; fits with the same transforms share
    /// them.
    pub columns: Vec<Arc<Column>>,
    pub basis: Arc<Basis>,
    /// Shares of the whitened target along the basis.
    pub along: Vec<f64>,
    /// Noise by which the basis is whitened.
    noise: Noise,
    /// Measured minus predicted, in the band.
    pub residual: Column,
    /// The same, whitened.
    pub white: Column,
    /// Sum of its squares, and what the terms' parameters cost that are not expected: as parts of
    /// an effect that make more torque than the joints have shown, and loads that are no bodies.
    pub chi2: f64,
    /// Precision of the factor of each column before any data.
    pub precision: Vec<f64>,
    /// Fits that blocks of time were left out of, and parts of the logs.
    blocks: Once,
    parts: Once,
    /// Fits without one of the terms, all else refitted, that were asked for.
    bare: Arc<Mutex<HashMap<usize, Arc<Fitted>>>>,
}

/// A column, and the same whitened if it is independent.
type AndWhite = (Arc<Column>, Option<Arc<Column>>);

/// Fits that rows were left out of, once they were asked for, and those of the fit that it was made
/// like.
#[derive(Clone, Default)]
struct Once {
    own: OnceLock<Arc<FoldFits>>,
    like: Option<Arc<FoldFits>>,
}

impl Once {
    fn like(other: &Self) -> Self {
        Self { own: OnceLock::new(), like: other.own.get().or(other.like.as_ref()).cloned() }
    }

    fn get(
        &self,
        fitted: &Fitted,
        problem: &Problem,
        noise: &Noise,
        folds: &[Vec<usize>],
    ) -> Arc<FoldFits> {
        let like = (folds, self.like.as_deref());
        let held = Held { file: &problem.priors, precision: &fitted.precision };
        let make = || FoldFits::new(&fitted.columns, &fitted.target, (noise, held), like).into();
        if fitted.noise == *noise { self.own.get_or_init(make).clone() } else { make() }
    }
}

impl Fitted {
    pub fn terms(&self) -> &[Term] {
        self.model.terms()
    }

    /// Coulomb friction of a joint, N·m (N), if the model has it there.
    pub fn dry_friction(&self, joint: usize) -> Option<f64> {
        let set = self.model.parameter_set();
        let of_set = set.effect_columns().iter().zip(&self.model.parameters()[set.inertial()..]);
        let is_dry = |effect: &dyn Effect| effect.role() == Some(Role::DryFriction);
        let of_set =
            of_set.filter(|(c, _)| c.joint == joint && is_dry(set.effects()[c.effect].as_ref()));
        let own = self
            .terms()
            .iter()
            .filter(|t| is_dry(t.effect.as_ref()) && t.site == Site::Joint(joint));
        of_set
            .map(|(_, x)| x)
            .chain(own.flat_map(|term| &term.coefficients))
            .copied()
            .reduce(|a, b| a + b)
    }

    /// Term and index of every constant.
    pub fn constants(&self) -> impl Iterator<Item = (usize, usize)> {
        let terms = self.terms().iter().enumerate();
        terms.flat_map(|(k, term)| (0..term.constants.len()).map(move |index| (k, index)))
    }

    /// The fits that blocks of time were left out of.
    pub fn folds(&self, problem: &Problem, noise: &Noise) -> Arc<FoldFits> {
        self.blocks.get(self, problem, noise, &problem.fold)
    }

    /// The fits that parts of the logs were left out of.
    pub fn part_fits(&self, problem: &Problem, noise: &Noise) -> Arc<FoldFits> {
        self.parts.get(self, problem, noise, &problem.parts(FOLDS))
    }

    /// The fit without a term, made if it was not asked for before with the same noise.
    pub fn bare(&self, term: usize, noise: &Noise, make: impl FnOnce() -> Self) -> Arc<Self> {
        if self.noise != *noise {
            return make().into();
        }
        let known = || self.bare.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bare) = known().get(&term) {
            return bare.clone();
        }
        // No lock is held meanwhile: what is made in parallel may wait for a thread that asks the
        // same.
        let bare = Arc::new(make());
        known().entry(term).or_insert(bare).clone()
    }

    /// The columns of a term as they are and whitened, if it is in the fit and they are those of
    /// any model with the same transforms.
    fn columns_of(&self, term: &Term) -> Option<Vec<AndWhite>> {
        let mut at = self.columns.len()
            - self.terms().iter().map(|own| own.coefficients.len()).sum::<usize>();
        for own in self.terms() {
            let width = own.coefficients.len();
            let same = own.is_like(term)
                && own.constants == term.constants
                && !own.effect.follows_torque();
            if same {
                return Some(
                    (at..at + width)
                        .map(|k| (self.columns[k].clone(), self.basis.column(k).cloned()))
                        .collect(),
                );
            }
            at += width;
        }
        None
    }
}

/// Least squares for base parameters and linear parameters of the terms, constants as they are.
pub(super) fn solve(
    problem: &Problem,
    start: &TorqueModel,
    terms: &[Term],
    noise: &Noise,
) -> Fitted {
    let model = start.clone().with_terms(terms.to_vec(), problem.clock);
    let rigid = problem.rigid(&model);
    let base = problem.base_columns(&problem.base, &model, &rigid);
    let target = problem.target(&model, &rigid).into();
    let base: Vec<Arc<Column>> = base.into_iter().map(Arc::new).collect();
    let basis = base_basis(problem, &base, noise);
    solve_with(problem, model, rigid, (base, basis), target, noise, None)
}

fn base_basis(problem: &Problem, columns: &[Arc<Column>], noise: &Noise) -> Basis {
    let white: Vec<Column> = columns.iter().map(|column| noise.whiten(problem, column)).collect();
    Basis::with_first(white, |index| problem.is_rotor(index))
}

/// The same with the base columns of a fit, if its transforms are those of `terms`, and those of
/// terms that it has.
pub(super) fn solve_like(
    problem: &Problem,
    like: &Fitted,
    terms: &[Term],
    noise: &Noise,
) -> Fitted {
    let transforms = |terms: &[Term]| -> Vec<(String, Site, Vec<f64>)> {
        let own = terms.iter().filter(|term| term.is_transform());
        own.map(|term| (term.effect.name().to_string(), term.site, term.constants.clone()))
            .collect()
    };
    if transforms(terms) != transforms(like.terms()) {
        return solve(problem, &like.model, terms, noise);
    }
    let model = like.model.clone().with_terms(terms.to_vec(), problem.clock);
    let rigid = problem.rigid(&model);
    let base = like.columns[..problem.base.rank()].to_vec();
    let basis = if like.noise == *noise {
        like.basis.of_first(base.len())
    } else {
        base_basis(problem, &base, noise)
    };
    solve_with(problem, model, rigid, (base, basis), like.target.clone(), noise, Some(like))
}

/// The fit without a term.
pub(super) fn without(problem: &Problem, fitted: &Fitted, k: usize, noise: &Noise) -> Fitted {
    let mut others = fitted.terms().to_vec();
    others.remove(k);
    solve_like(problem, fitted, &others, noise)
}

fn solve_with(
    problem: &Problem,
    mut model: TorqueModel,
    rigid: Vec<Rigid>,
    (mut columns, mut basis): (Vec<Arc<Column>>, Basis),
    target: Arc<Column>,
    noise: &Noise,
    like: Option<&Fitted>,
) -> Fitted {
    let terms: Vec<Term> = model.terms().to_vec();
    let whitened_alike = like.filter(|like| like.noise == *noise);
    let columns_of = |term: &Term| -> Vec<(Arc<Column>, Arc<Column>)> {
        let whitened = |column: &Arc<Column>| Arc::new(noise.whiten(problem, column));
        if let Some(known) = like.and_then(|like| like.columns_of(term)) {
            let both = |(column, white): AndWhite| {
                let white =
                    white.filter(|_| whitened_alike.is_some()).unwrap_or_else(|| whitened(&column));
                (column, white)
            };
            return known.into_iter().map(both).collect();
        }
        let own = problem.term_columns(&model, &rigid, term).into_iter().map(Arc::new);
        own.map(|column| (column.clone(), whitened(&column))).collect()
    };
    let of_terms: Vec<_> = terms.par_iter().map(columns_of).collect();
    let mut precision = vec![0.0; columns.len()];
    for (column, white) in of_terms.into_iter().flatten() {
        precision.push(problem.precision(&column));
        basis.push_held(white, precision[columns.len()]);
        columns.push(column);
    }
    let mut white = noise.whiten(problem, &target);
    let along = basis.shares_of(&white);
    let values = basis.coefficients(along.clone());
    let deviations = basis.deviations();
    basis.project_out(&mut white);
    let squares: f64 = white.iter().map(|w| dot_in_lanes(w, w)).sum();
    let chi2 = squares
        + basis.cost(&values)
        + unphysical((&terms, problem.nominal.robot()), &values, &basis, problem.base.rank());
    let mut residual = target.to_vec();
    for (column, value) in columns.iter().zip(&values) {
        for (r, c) in residual.iter_mut().zip(column.iter()) {
            r.iter_mut().zip(c).for_each(|(r, c)| *r -= value * c);
        }
    }
    // What the motion does not excite keeps the value that the model has: the fit is for the
    // difference.
    let mut parameters = problem.nominal.parameters().to_vec();
    problem
        .base
        .independent()
        .iter()
        .zip(&values)
        .for_each(|(index, change)| parameters[*index] += change);
    model.set_parameters(parameters);
    let mut at = problem.base.rank();
    let filled = terms.into_iter().map(|mut term| {
        let k = term.coefficients.len();
        term.coefficients = values[at..at + k].to_vec();
        term.coefficient_deviations =
            deviations[at..at + k].iter().map(|d| if d.is_finite() { *d } else { 0.0 }).collect();
        at += k;
        term
    });
    let terms = filled.collect();
    let model = model.with_terms(terms, problem.clock);
    Fitted {
        model,
        rigid: rigid.into(),
        target,
        columns,
        basis: basis.into(),
        along,
        noise: noise.clone(),
        residual,
        white,
        chi2,
        precision,
        blocks: like.map_or_else(Once::default, |like| Once::like(&like.blocks)),
        parts: like.map_or_else(Once::default, |like| Once::like(&like.parts)),
        bare: Arc::default(),
    }
}

/// By how much chi-squared grows at least where the loads among some terms are to be bodies.
///
/// - `values`: those of all columns
/// - `first`: the first column of the terms
fn unphysical(
    (terms, robot): (&[Term], &Robot),
    values: &[f64],
    basis: &Basis,
    first: usize,
) -> f64 {
    let (mut at, mut sum) = (first, 0.0);
    for term in terms {
        let own = at..at + term.effect.parameters().len();
        if let Some(parameters) =
            values[own.clone()].first_chunk().filter(|_| term.effect.is_body())
        {
            // Where the solver gives up nothing is known against it.
            sum += nearest_load(parameters, &basis.covariance(own.clone()), robot.length())
                .map_or(0.0, |nearest| nearest.distance2);
        }
        at = own.end;
    }
    sum
}

/// Tangent of the predicted torque by constant `index` of term `term`, in the band.
pub(super) fn tangent(
    problem: &Problem,
    (model, rigid): (&TorqueModel, &[Rigid]),
    (term, index): (usize, usize),
) -> Column {
    let constant = &model.terms()[term].effect.constants()[index];
    let value = model.terms()[term].constants[index];
    let step = constant.difference_step(value);
    let [low, high] = [(value - step).max(constant.low), (value + step).min(constant.high)];
    if !model.terms()[term].is_transform() {
        return problem.slope(model, rigid, &model.terms()[term], index, [low, high]);
    }
    let with = |value: f64| {
        let mut terms = model.terms().to_vec();
        terms[term].constants[index] = value;
        model.clone().with_terms(terms, problem.clock)
    };
    problem.difference([&with(low), &with(high)], high - low)
}

/// Tangents of some constants, term and index, whitened; empty for a limit of torque, which is not
/// smooth.
pub(super) fn tangents(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    constants: &[(usize, usize)],
) -> Vec<Column> {
    let is_limit = |term: &Term, index: usize| {
        term.is_transform() && term.effect.constants()[index].scale == Scale::Torque
    };
    let white = |&(k, index): &(usize, usize)| {
        if is_limit(&fitted.terms()[k], index) {
            return vec![vec![]; problem.dof()];
        }
        noise.whiten(problem, &tangent(problem, (&fitted.model, &fitted.rigid), (k, index)))
    };
    constants.par_iter().map(white).collect()
}

/// Largest number of steps for the constants of transforms.
const STEPS: usize = 6;

/// A step that promises less of chi-squared is not worth a solution.
const SMALL_STEP: f64 = 1.0;

/// Gauss-Newton steps for the constants of all transforms, which move base columns and torque.
pub(super) fn refine_transforms(problem: &Problem, mut fitted: Fitted, noise: &Noise) -> Fitted {
    for _ in 0..STEPS {
        let scale = |(k, index): (usize, usize)| fitted.terms()[k].effect.constants()[index].scale;
        let wanted: Vec<(usize, usize)> =
            fitted.constants().filter(|at| matches!(scale(*at), Scale::Neutral { .. })).collect();
        if wanted.is_empty() {
            return fitted;
        }
        let tangents = tangents(problem, &fitted, noise, &wanted);
        let gain = gain(&fitted.basis, &fitted.white, &tangents, INVISIBLE_TANGENT);
        if gain.chi2 < SMALL_STEP {
            return fitted;
        }
        let mut accepted = false;
        for share in [1.0, 0.4, 0.1] {
            let mut terms = fitted.terms().to_vec();
            for (&(k, index), step) in wanted.iter().zip(&gain.coefficients) {
                let constant = &terms[k].effect.constants()[index];
                let value =
                    (terms[k].constants[index] + share * step).clamp(constant.low, constant.high);
                terms[k].constants[index] = value;
            }
            let next = solve(problem, &fitted.model, &terms, noise);
            if next.chi2 < fitted.chi2 {
                let small = fitted.chi2 - next.chi2 < 0.5;
                fitted = next;
                accepted = !small;
                break;
            }
        }
        if !accepted {
            return fitted;
        }
    }
    fitted
}

/// Standard deviations of the constants and linear parameters, all together, for a report.
pub(super) fn with_deviations(problem: &Problem, fitted: &Fitted, noise: &Noise) -> Vec<Term> {
    let mut basis = Basis::clone(&fitted.basis);
    let mut terms = fitted.terms().to_vec();
    let constants: Vec<(usize, usize)> = fitted.constants().collect();
    tangents(problem, fitted, noise, &constants)
        .into_iter()
        .for_each(|tangent| basis.push(tangent.into()));
    let is_time =
        |(k, index): &(usize, usize)| terms[*k].effect.constants()[*index].scale == Scale::Time;
    let times: Vec<(usize, usize)> = constants.into_iter().filter(is_time).collect();
    let intervals: Vec<[f64; 2]> =
        times.par_iter().map(|at| interval(problem, fitted, noise, *at)).collect();
    let deviations = basis.deviations();
    let finite = |d: f64| if d.is_finite() { d } else { 0.0 };
    let mut at = problem.base.rank();
    for term in &mut terms {
        term.coefficient_deviations.iter_mut().for_each(|d| {
            *d = finite(deviations[at]);
            at += 1;
        });
    }
    for term in &mut terms {
        term.constant_deviations.iter_mut().for_each(|d| {
            *d = finite(deviations[at]);
            at += 1;
        });
    }
    // Chi-squared changes in steps with a time, and not at all while nothing moves: tangents know
    // nothing of that.
    for ((k, index), [low, high]) in times.into_iter().zip(intervals) {
        terms[k].constant_deviations[index] = 0.25 * (high - low);
        if high - low > UNSURE_S {
            terms[k].constants[index] =
                likeliest_as_logged(problem, &fitted.model, &terms, (k, index), [low, high]);
        }
    }
    terms
}

/// Of a longer interval of two deviations to both sides the torque as logged decides, s.
const UNSURE_S: f64 = 0.4;

/// The time in an interval with which the torque as logged is predicted best, s; of times that do
/// equally well the middle. Filters take the first and last rows of each log, and what begins there
/// shows only in the torque as logged.
fn likeliest_as_logged(
    problem: &Problem,
    model: &TorqueModel,
    terms: &[Term],
    (k, index): (usize, usize),
    [low, high]: [f64; 2],
) -> f64 {
    /// Times that are tried.
    const STEPS: usize = 40;
    /// Costs that differ by less than this share are equal.
    const EQUAL: f64 = 1e-9;
    let reference = problem.logged_error(&model.clone().with_terms(terms.to_vec(), problem.clock));
    let cost = |time: f64| {
        let mut terms = terms.to_vec();
        terms[k].constants[index] = time;
        let errors = problem.logged_error(&model.clone().with_terms(terms, problem.clock));
        let shares =
            errors.iter().zip(&reference).map(|(own, reference)| (own / reference).powi(2));
        shares.filter(|share| share.is_finite()).sum::<f64>()
    };
    let best_between = |low: f64, high: f64| -> [f64; 2] {
        let time = |step: usize| low + (high - low) * step as f64 / STEPS as f64;
        let costs: Vec<f64> = (0..=STEPS).into_par_iter().map(|step| cost(time(step))).collect();
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let mut best = (0..=STEPS).filter(|step| costs[*step] <= (1.0 + EQUAL) * least).map(time);
        let first = best.next().unwrap_or(low);
        [first, best.next_back().unwrap_or(first)]
    };
    // A load that begins some samples too early or late is a spike in the torque, which its inertia
    // would have to explain.
    let [first, last] = best_between(low, high);
    let step = (high - low) / STEPS as f64;
    let [first, last] = best_between((first - step).max(low), (last + step).min(high));
    0.5 * (first + last)
}

/// The interval of two deviations to both sides of a time of a term, s: chi-squared is within four
/// of the fit's.
fn interval(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    (k, index): (usize, usize),
) -> [f64; 2] {
    /// How well its ends are looked for, s.
    const RESOLUTION_S: f64 = 0.02;
    let term = &fitted.terms()[k];
    let own = term.constants[index];
    let without = without(problem, fitted, k, noise);
    let explained = |time: f64| {
        let mut term = term.clone();
        term.constants[index] = time;
        let columns = problem.term_columns(&without.model, &without.rigid, &term);
        let white: Vec<Column> =
            columns.iter().map(|column| noise.whiten(problem, column)).collect();
        gain(&without.basis, &without.white, &white, INVISIBLE).chi2
    };
    let most = explained(own);
    let [start, end] = problem.time_span();
    let low = term.times().filter(|time| *time < own).fold(start, f64::max);
    let high = term.times().filter(|time| *time > own).fold(end, f64::min);
    [low, high].map(|end| {
        let within = |share: f64| explained(own + share * (end - own)) > most - 4.0;
        let resolution = RESOLUTION_S / (end - own).abs().max(RESOLUTION_S);
        let mut reached = 0.0;
        let mut beyond = resolution;
        while beyond < 1.0 && within(beyond) {
            reached = beyond;
            beyond *= 2.0;
        }
        beyond = beyond.min(1.0);
        while beyond - reached > resolution {
            let middle = 0.5 * (reached + beyond);
            *(if within(middle) { &mut reached } else { &mut beyond }) = middle;
        }
        own + reached.max(0.5 * resolution) * (end - own)
    })
}

/// Errors per joint beyond the band of the equations, where nothing is fitted.
pub(super) fn beyond(problem: &Problem, fitted: &Fitted) -> Vec<ByLog> {
    beyond_of(problem, fitted, &problem.logged_rows(&fitted.model))
}

/// The same with the errors of the fit against the torque as logged.
pub(super) fn beyond_of(
    problem: &Problem,
    fitted: &Fitted,
    logged: &[Vec<Option<f64>>],
) -> Vec<ByLog> {
    let in_band = by_log(problem, &fitted.residual);
    let rest = |(logged, own): (&f64, &f64)| (logged * logged - own * own).max(0.0).sqrt();
    problem
        .errors_of(logged)
        .iter()
        .zip(&in_band)
        .map(|(logged, own)| logged.iter().zip(own).map(rest).collect())
        .collect()
}

/// Errors per joint in the band, of all logs together and of each.
pub(super) fn by_log(problem: &Problem, errors: &Column) -> Vec<ByLog> {
    let of_joint = |(joint, errors): (usize, &Vec<f64>)| {
        let mut sums = LogSums::new(problem.stretches.len());
        problem.rows[joint].iter().zip(errors).for_each(|((log, _), e)| sums.add(*log, e * e));
        sums.roots()
    };
    errors.iter().enumerate().map(of_joint).collect()
}

impl Fitted {
    /// Number of parts into which logs are cut so that others can predict what the term at `index`
    /// makes in any of them. Where it begins or ends at a time, as many as give two that are mostly
    /// before that and two mostly after it, and none if the finest do not. What changes with time
    /// all along is asked of the longest. Of any other as many as leave enough of what all tell of
    /// it, while they are farther from each other than blocks of time.
    pub fn parts_that_tell(&self, problem: &Problem, noise: &Noise, index: usize) -> Option<usize> {
        /// Of what all parts tell, what the others do beside the one that tells most.
        const ENOUGH: f64 = 1.0 / 3.0;
        let mut counts = [FOLDS, 2 * FOLDS, 4 * FOLDS].into_iter();
        let term = &self.terms()[index];
        if term.times().next().is_some() {
            return counts.find(|count| !is_in_one_part(problem, term, *count));
        }
        if term.effect.about().depends_on_time {
            return Some(FOLDS);
        }
        let held = Held { file: &problem.priors, precision: &self.precision };
        let tells = |count: usize| {
            let fits = match count {
                FOLDS => self.part_fits(problem, noise),
                _ => FoldFits::new(
                    &self.columns,
                    &self.target,
                    (noise, held),
                    (&problem.parts(count), None),
                )
                .into(),
            };
            fits.least_known(held, (self.indices_of(index), &term.coefficients)) >= ENOUGH
        };
        let mut finest = FOLDS;
        for count in counts.take_while(|count| *count == FOLDS || problem.are_far(*count)) {
            finest = count;
            if tells(count) {
                break;
            }
        }
        Some(finest)
    }

    /// Indices of the columns of a term.
    fn indices_of(&self, index: usize) -> Range<usize> {
        let count =
            |terms: &[Term]| terms.iter().map(|term| term.coefficients.len()).sum::<usize>();
        let end = self.columns.len() - count(&self.terms()[index + 1..]);
        end - self.terms()[index].coefficients.len()..end
    }
}

/// Whether fewer than two of so many parts of the logs are mostly before a time at which a term
/// begins or ends, or mostly after it.
fn is_in_one_part(problem: &Problem, term: &Term, count: usize) -> bool {
    let times: Vec<f64> = term.times().collect();
    if times.is_empty() {
        return false;
    }
    let rows = problem.rows.iter().flatten().zip(problem.parts(count).into_iter().flatten());
    is_alone(&times, rows.map(|(row, part)| (problem.time_of(*row), part)))
}

/// Whether what begins at the first of some times, ends at the second and so on is there in most
/// rows of fewer than two parts, or of all but fewer than two.
///
/// - `rows`: time, s, and part
fn is_alone(times: &[f64], rows: impl Iterator<Item = (f64, usize)>) -> bool {
    // Of every part: rows in which it is there, and those in which it is not.
    let mut counts: Vec<[usize; 2]> = Vec::new();
    for (now, part) in rows {
        counts.resize(counts.len().max(part + 1), [0; 2]);
        let is_there = times.iter().filter(|time| **time <= now).count() % 2 == 1;
        counts[part][usize::from(!is_there)] += 1;
    }
    let parts = |kind: usize| counts.iter().filter(|rows| rows[kind] > rows[1 - kind]).count();
    parts(0).min(parts(1)) < 2
}

/// Errors in the band, on parts of the logs that were left out of the fit. What begins or ends at a
/// time may be in one part alone ([`is_in_one_part`]): its torque counts as known.
///
/// - `count`: parts
pub(super) fn left_out_parts(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    count: usize,
) -> LeftOut {
    let known: Vec<bool> =
        fitted.terms().iter().map(|term| is_in_one_part(problem, term, count)).collect();
    if count == FOLDS && !known.contains(&true) {
        return fitted.part_fits(problem, noise).errors();
    }
    let mut target = fitted.target.to_vec();
    let mut at = problem.base.rank();
    let mut columns = fitted.columns[..at].to_vec();
    let mut precision = fitted.precision[..at].to_vec();
    for (term, known) in fitted.terms().iter().zip(known) {
        for factor in &term.coefficients {
            if known {
                for (target, column) in target.iter_mut().zip(fitted.columns[at].iter()) {
                    target.iter_mut().zip(column).for_each(|(target, x)| *target -= factor * x);
                }
            } else {
                columns.push(fitted.columns[at].clone());
                precision.push(fitted.precision[at]);
            }
            at += 1;
        }
    }
    let held = Held { file: &problem.priors, precision: &precision };
    FoldFits::new(&columns, &target.into(), (noise, held), (&problem.parts(count), None)).errors()
}

/// Errors in the band on fifths of the positions of a joint, and on fifths of its speeds, that were
/// left out of the fit: what is there holds where it was not seen, an imitation need not.
pub(super) fn left_out_states(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    joint: usize,
) -> [LeftOut; 2] {
    /// Parts of positions and speeds, each of which is left out in turn.
    const FIFTHS: usize = 5;
    let n = problem.dof();
    let errors = |state: fn(&Motion) -> &[f64]| {
        let value = |(stretch, sample): &(usize, usize)| {
            state(&problem.stretches[*stretch].motion)[sample * n + joint]
        };
        let mut values: Vec<f64> = problem.rows[joint].iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let cuts: Vec<f64> =
            (1..FIFTHS).filter_map(|k| values.get(k * values.len() / FIFTHS)).copied().collect();
        let fold = |row: &(usize, usize)| cuts.iter().filter(|cut| value(row) > **cut).count();
        let folds: Vec<Vec<usize>> =
            problem.rows.iter().map(|rows| rows.iter().map(fold).collect()).collect();
        let held = Held { file: &problem.priors, precision: &fitted.precision };
        FoldFits::new(&fitted.columns, &fitted.target, (noise, held), (&folds, None)).errors()
    };
    [errors(|motion| &motion.q), errors(|motion| &motion.dq)]
}

impl From<crate::signal::SignalError> for DiagnosisError {
    fn from(error: crate::signal::SignalError) -> Self {
        Self::Model(error.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_predicted_by_parts_on_both_sides_of_it() {
        // Of 50 s.
        let is_alone = |parts: usize, times: &[f64]| {
            is_alone(times, (0..500).map(|row| (0.1 * f64::from(row), row as usize * parts / 500)))
        };
        assert!(!is_alone(5, &[18.0]) && !is_alone(5, &[32.0]) && !is_alone(5, &[12.0, 34.0]));
        // One part before it, mostly; one after it; a contact in one part.
        assert!(is_alone(5, &[14.0]) && is_alone(5, &[36.0]) && is_alone(5, &[21.0, 29.0]));
        // Finer ones tell.
        assert!(!is_alone(10, &[14.0]) && !is_alone(10, &[36.0]) && !is_alone(20, &[21.0, 29.0]));
        assert!(is_alone(20, &[48.0]));
    }
}
