//! The model that is written: which findings enter it.
//!
//! It is identified anew, with all constants, by weighted least squares, with the prior and the
//! consistency of the given model, and must be better than that one on motion that no fit saw. What
//! a prediction errs by there is the error on parts of the logs that were left out, what is beyond
//! the band of the equations, and what parameters that the logs do not determine make of positions
//! that they do not show. An effect that stands in the fit for others which are as probable is in
//! the model if these say much the same at such positions.

use std::ops::Range;

use rayon::prelude::*;

use super::by_log::ByLog;
use super::decision::{Decision, Judged};
use super::elsewhere::Elsewhere;
use super::evidence::{LeftOut, deviate_of_mean};
use super::fit::{Fitted, beyond_of, left_out_parts};
use super::problem::{FOLDS, Problem};
use super::search::{Search, without};
use crate::effects::Site;
use crate::linalg::mean_square;
use crate::model::{Given, IdentifyError, Term, TorqueModel, identify_again};
use crate::recording::Recording;

/// The model with findings, and those that it does without.
pub(super) struct Written {
    pub model: TorqueModel,
    /// Indices of their terms.
    pub taken_back: Vec<usize>,
}

/// Growth of a joint's error that is harm: the one that is seen on other logs differs by as much
/// from chance.
const HARM: f64 = 0.02;

/// The same in standard deviations, where nothing that was found acts: there is one question a
/// joint.
const HARMED: f64 = 2.5;

/// The given model with all findings but those that make it worse: while some joint is, the one
/// without which it is best. A finding of the whole arm that makes some joint only less sure
/// elsewhere stays if without it all joints together are worse.
pub(super) fn written(
    search: &Search<'_>,
    given: &TorqueModel,
    decision: &Decision,
    train: &[Recording],
) -> Result<Written, IdentifyError> {
    let outcome = &decision.outcome;
    let problem = &search.problem;
    let elsewhere = Elsewhere::new(problem);
    let identified = |terms| identified_again(search, given, terms, train);
    let trial = |fitted: &Fitted| -> Result<(TorqueModel, Risk), IdentifyError> {
        let model = identified(fitted.terms().to_vec())?;
        let parts = left_out_parts(problem, fitted, &search.noise, FOLDS);
        let risk = Risk::new(problem, fitted, parts, elsewhere.variance(&model));
        Ok((model, risk))
    };
    let fit_without =
        |out: &[usize]| search.refit(&outcome.fitted, without(outcome.fitted.terms(), out));
    let found: Vec<usize> = outcome.news(search).map(|(k, _)| k).collect();
    if found.is_empty() {
        return Ok(Written { model: given.clone(), taken_back: vec![] });
    }
    let (before, after) = rayon::join(|| trial(&outcome.start), || trial(&outcome.fitted));
    let ((_, before), (mut model, mut after)) = (before?, after?);
    let mut taken_back = Vec::new();
    for (judged, _) in decision.news(search, false) {
        let there = (&outcome.fitted, &model);
        if !is_worth_its_place(search, there, judged, (&elsewhere, &identified))? {
            taken_back.push(judged.index);
        }
    }
    if !taken_back.is_empty() {
        (model, after) = trial(&fit_without(&taken_back))?;
    }
    loop {
        let inside: Vec<usize> =
            found.iter().filter(|k| !taken_back.contains(*k)).copied().collect();
        let acts = |k: &usize, joint: &usize| {
            search.joints_of(&outcome.fitted.terms()[*k]).contains(joint)
        };
        let is_acted_on = |joint: usize| inside.iter().any(|k| acts(k, &joint));
        let harm = |joint: usize| after.harm(&before, problem, joint, is_acted_on(joint));
        let harms: Vec<Option<Harm>> = (0..problem.dof()).map(harm).collect();
        let worse: Vec<usize> =
            (0..problem.dof()).filter(|joint| harms[*joint].is_some()).collect();
        if worse.is_empty() || inside.is_empty() {
            return Ok(Written { model, taken_back });
        }
        // Joints share bodies: what makes one look well known moves those of others.
        let there: Vec<usize> =
            inside.iter().filter(|k| worse.iter().any(|joint| acts(k, joint))).copied().collect();
        let all = if there.is_empty() { inside } else { there };
        let without_it = |k: &usize| {
            let out = [&taken_back[..], &[*k]].concat();
            let trial = trial(&fit_without(&out))?;
            let growth: f64 =
                worse.iter().map(|joint| (trial.1.of(*joint) / before.of(*joint)).ln()).sum();
            let of_all: f64 =
                (0..problem.dof()).map(|joint| (trial.1.of(joint) / after.of(joint)).ln()).sum();
            let of_arm = outcome.fitted.terms()[*k].site == Site::Arm;
            let stays = of_arm && of_all > 0.0 && !harms.contains(&Some(Harm::Seen));
            Ok((*k, growth, (!stays).then_some(trial)))
        };
        let trials = all.par_iter().map(without_it).collect::<Result<Vec<_>, IdentifyError>>()?;
        let harmful = trials.into_iter().filter_map(|(k, growth, trial)| Some((k, growth, trial?)));
        let Some((k, _, next)) = harmful.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            return Ok(Written { model, taken_back });
        };
        taken_back.push(k);
        (model, after) = next;
    }
}

/// Whether a term of a fit that stands for rivals, too, is expected to predict motion that the logs do
/// not show no worse than none would: if what is there is one of them, the term errs there by what the
/// two differ, and a model without it by what that one makes.
fn is_worth_its_place(
    search: &Search<'_>,
    (fitted, model): (&Fitted, &TorqueModel),
    judged: &Judged,
    (elsewhere, identified): (&Elsewhere, &Identified<'_>),
) -> Result<bool, IdentifyError> {
    let bare = identified(search.bare(fitted, judged.index).terms().to_vec())?;
    let mut gain = vec![0.0; search.problem.dof()];
    for (term, weight) in &judged.alternatives {
        let there = search.with_instead(fitted, judged.index, term.clone());
        let there = identified(there.terms().to_vec())?;
        let [without, with] = [&bare, model].map(|model| elsewhere.difference([model, &there]));
        let gains = without.iter().zip(&with).map(|(without, with)| weight * (without - with));
        gain.iter_mut().zip(gains).for_each(|(sum, gain)| *sum += gain);
    }
    Ok(search.joints_of(&fitted.terms()[judged.index]).iter().all(|joint| gain[*joint] >= 0.0))
}

/// The model with some terms, identified anew.
type Identified<'a> = dyn Fn(Vec<Term>) -> Result<TorqueModel, IdentifyError> + Sync + 'a;

/// The model with these terms, all parameters identified anew from the logs, with the prior and the
/// consistency that it has.
pub(super) fn identified_again(
    search: &Search<'_>,
    model: &TorqueModel,
    terms: Vec<Term>,
    train: &[Recording],
) -> Result<TorqueModel, IdentifyError> {
    let consistency = model
        .fit()
        .and_then(|fit| fit.consistency.as_ref())
        .map(|certificate| certificate.consistency());
    identify_again(model, Given { terms, clock: search.problem.clock }, consistency.as_ref(), train)
}

/// What a model may err by on other motion.
struct Risk {
    /// Errors in the band on parts that were left out.
    parts: LeftOut,
    /// Errors beyond the band.
    beyond: Vec<ByLog>,
    /// Squares of what the torque as logged has beyond the band, per joint and block of time: they
    /// tell what is chance.
    beyond_by_block: Vec<Vec<f64>>,
    /// Per joint: variance that comes to them at positions which the logs do not show.
    elsewhere: Vec<f64>,
}

impl Risk {
    fn new(problem: &Problem, fitted: &Fitted, parts: LeftOut, elsewhere: Vec<f64>) -> Self {
        let n = problem.dof();
        let logged = problem.logged_rows(&fitted.model);
        let of_block = |joint: usize, block: Range<usize>| {
            let rows = &problem.rows[joint][block.clone()];
            let [(log, first), (_, last)] = [rows[0], rows[rows.len() - 1]];
            let of_sample = |sample: usize| *logged[log].get(sample * n + joint)?;
            let as_logged: Vec<f64> = (first..=last).filter_map(of_sample).collect();
            match as_logged.is_empty() {
                true => 0.0,
                false => mean_square(&as_logged) - mean_square(&fitted.residual[joint][block]),
            }
        };
        let of_joint =
            |joint: usize| problem.blocks(joint).map(|block| of_block(joint, block)).collect();
        let beyond_by_block = (0..n).map(of_joint).collect();
        Self { parts, beyond: beyond_of(problem, fitted, &logged), beyond_by_block, elsewhere }
    }

    /// Mean square of a joint, (N·m)² (N²).
    fn of(&self, joint: usize) -> f64 {
        self.parts.mean_square(joint) + self.beyond[joint][0].powi(2) + self.elsewhere[joint]
    }

    /// What makes it larger than before at a joint, beyond what chance makes of it; for certain
    /// where no finding `acts`.
    fn harm(&self, before: &Self, problem: &Problem, joint: usize, acts: bool) -> Option<Harm> {
        if self.of(joint) <= (1.0 + HARM).powi(2) * before.of(joint) {
            return None;
        }
        let in_band = before.parts.against(&self.parts, problem, &[joint]).significance();
        if !acts {
            return (in_band < -HARMED).then_some(Harm::Seen);
        }
        let blocks = self.beyond_by_block[joint].iter().zip(&before.beyond_by_block[joint]);
        let growth: Vec<f64> = blocks.map(|(own, before)| own - before).collect();
        let beyond = self.beyond[joint][0] > (1.0 + HARM) * before.beyond[joint][0]
            && deviate_of_mean(&growth) > 1.0;
        let gained = before.parts.mean_square(joint) - self.parts.mean_square(joint);
        let elsewhere = self.elsewhere[joint] - before.elsewhere[joint] > gained.max(0.0);
        match beyond || in_band < -1.0 {
            true => Some(Harm::Seen),
            false => elsewhere.then_some(Harm::Elsewhere),
        }
    }
}

/// Why a prediction may err by more.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Harm {
    /// It does, on motion of the logs.
    Seen,
    /// Its variance is larger at positions that they do not show.
    Elsewhere,
}
