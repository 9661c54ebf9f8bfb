//! The model that is written: which findings enter it.
//!
//! It is identified anew, with all constants, by weighted least squares, with the prior and the consistency of the given
//! model, and must be better than that one on motion that no fit saw. What a prediction errs by there is the error on parts
//! of the logs that were left out, what is beyond the band of the equations, and what parameters that the logs do not
//! determine make of positions that they do not show.

use rayon::prelude::*;

use super::by_log::ByLog;
use super::decision::Decision;
use super::elsewhere::Elsewhere;
use super::evidence::{LeftOut, SURE};
use super::fit::{Fitted, beyond, left_out_parts};
use super::problem::{FOLDS, Problem};
use super::search::{Search, without};
use crate::model::{Given, IdentifyError, Term, TorqueModel, identify_again};
use crate::recording::Recording;

/// The model with findings, and those that it does without.
pub(super) struct Written {
    pub model: TorqueModel,
    /// Indices of their terms.
    pub taken_back: Vec<usize>,
}

/// Growth of a joint's error that is harm: the one that is seen on other logs differs by as much from chance.
const HARM: f64 = 0.02;

/// The given model with all findings but those that make it worse: while some joint is, the one without which it is best.
pub(super) fn written(
    search: &Search<'_>,
    given: &TorqueModel,
    decision: &Decision,
    train: &[Recording],
) -> Result<Written, IdentifyError> {
    let outcome = &decision.outcome;
    let problem = &search.problem;
    let elsewhere = Elsewhere::new(problem);
    let trial = |fitted: &Fitted| -> Result<(TorqueModel, Risk), IdentifyError> {
        let model = identified_again(search, given, fitted.terms().to_vec(), train)?;
        let parts = left_out_parts(problem, fitted, &search.noise, FOLDS);
        let risk = Risk { parts, beyond: beyond(problem, fitted), elsewhere: elsewhere.variance(&model) };
        Ok((model, risk))
    };
    let found: Vec<usize> = outcome.news(search).map(|(k, _)| k).collect();
    let mut taken_back = Vec::new();
    if found.is_empty() {
        return Ok(Written { model: given.clone(), taken_back });
    }
    let (before, after) = rayon::join(|| trial(&outcome.start), || trial(&outcome.fitted));
    let ((_, before), (mut model, mut after)) = (before?, after?);
    loop {
        let inside: Vec<usize> = found.iter().filter(|k| !taken_back.contains(*k)).copied().collect();
        let acts = |k: &usize, joint: &usize| search.joints_of(&outcome.fitted.terms()[*k]).contains(joint);
        let is_worse = |joint: &usize| after.is_worse(&before, problem, *joint, inside.iter().any(|k| acts(k, joint)));
        let worse: Vec<usize> = (0..problem.dof()).filter(is_worse).collect();
        if worse.is_empty() || inside.is_empty() {
            return Ok(Written { model, taken_back });
        }
        // Joints share bodies: what makes one look well known moves those of others.
        let there: Vec<usize> = inside.iter().filter(|k| worse.iter().any(|joint| acts(k, joint))).copied().collect();
        let all = if there.is_empty() { inside } else { there };
        let without_it = |k: &usize| {
            let out = [&taken_back[..], &[*k]].concat();
            let trial = trial(&search.refit(&outcome.fitted, without(outcome.fitted.terms(), &out)))?;
            let growth: f64 = worse.iter().map(|joint| (trial.1.of(*joint) / before.of(*joint)).ln()).sum();
            Ok((*k, growth, trial))
        };
        let trials = all.par_iter().map(without_it).collect::<Result<Vec<_>, IdentifyError>>()?;
        let Some((k, _, next)) = trials.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) else {
            return Ok(Written { model, taken_back });
        };
        taken_back.push(k);
        (model, after) = next;
    }
}

/// The model with these terms, all parameters identified anew from the logs, with the prior and the consistency that it has.
pub(super) fn identified_again(
    search: &Search<'_>,
    model: &TorqueModel,
    terms: Vec<Term>,
    train: &[Recording],
) -> Result<TorqueModel, IdentifyError> {
    let consistency = model.fit().and_then(|fit| fit.consistency.as_ref()).map(|certificate| certificate.consistency());
    identify_again(model, Given { terms, clock: search.problem.clock }, consistency.as_ref(), train)
}

/// What a model may err by on other motion.
struct Risk {
    parts: LeftOut,
    beyond: Vec<ByLog>,
    elsewhere: Vec<f64>,
}

impl Risk {
    /// Mean square of a joint, (N·m)² (N²).
    fn of(&self, joint: usize) -> f64 {
        self.parts.mean_square(joint) + self.beyond[joint][0].powi(2) + self.elsewhere[joint]
    }

    /// Whether it is larger than before at a joint, beyond what chance makes of it; for certain where no finding `acts`.
    fn is_worse(&self, before: &Self, problem: &Problem, joint: usize, acts: bool) -> bool {
        let grows = self.of(joint) > (1.0 + HARM).powi(2) * before.of(joint);
        let in_band = before.parts.against(&self.parts, problem, &[joint]).significance();
        if !acts {
            return grows && in_band < -SURE;
        }
        // Beyond the band there is no fit, and no chance.
        let beyond = self.beyond[joint][0] > (1.0 + HARM) * before.beyond[joint][0];
        let gained = before.parts.mean_square(joint) - self.parts.mean_square(joint);
        let elsewhere = self.elsewhere[joint] - before.elsewhere[joint] > gained.max(0.0);
        grows && (beyond || elsewhere || in_band < -1.0)
    }
}
