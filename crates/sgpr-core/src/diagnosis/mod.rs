//! Which physical effect a model lacks.
//!
//! [`diagnose`] takes a model and the logs it was identified from, and asks of every effect of the
//! catalogue how much of the leftover torque it explains after projection on what the model can
//! take up by itself. What stands is fitted jointly, must lower the error on blocks of time that
//! were left out, and is given a probability. The method is described in `docs/diagnosis.md`.

mod answer;
mod basis;
mod by_log;
mod decision;
mod described;
mod detectability;
mod elsewhere;
mod evidence;
mod experiment;
mod file_prior;
mod fit;
mod formula;
mod left_out;
mod likelihood;
mod one_arm;
mod problem;
mod remembered;
mod report;
mod search;
mod structure;
mod unknown;
mod whereabouts;
mod written;

use std::sync::Arc;

use derive_setters::Setters;

pub use answer::{
    ByJoint, Detectable, Diagnosis, Finding, FoundParameter, JointErrors, NextExperiment,
    NotTestable, Ranked, Step, Verdict,
};
pub use described::parameters_of;
pub use formula::{Formula, FormulaTerm};
pub use structure::{Change, Dependence, Input, JointStructure, Shares, structure_of_logs};
pub use whereabouts::{Excess, JointWhereabouts, Whereabouts};

use crate::effects::{self, Effect};
use crate::model::{IdentifyError, Term, TorqueModel, given_or_chosen, select_joints};
use crate::motion::MotionError;
use crate::progress::{Interrupted, Progress};
use crate::recording::{LogSet, Recording, RecordingError};
use problem::Problem;
use search::{Candidate, Search, Wanted};
use written::Written;

/// What to look for.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct DiagnosisOptions {
    /// Effects to test; those of the library and the caller's own.
    pub catalogue: Vec<Arc<dyn Effect>>,
    /// Effects to add without a search, as a person wants them: `torque_ripple@joint_2`,
    /// `payload_change`, `wrist_coupling@joint_6,joint_5`. They are fitted, judged and reported
    /// like findings, and stay whatever comes out.
    pub by_hand: Vec<String>,
}

impl Default for DiagnosisOptions {
    fn default() -> Self {
        Self { catalogue: effects::registry(), by_hand: vec![] }
    }
}

/// Why there is no diagnosis.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiagnosisError {
    /// The logs cannot be used.
    #[error(transparent)]
    Model(#[from] IdentifyError),
    /// Nothing to fit to.
    #[error(
        "{rows} usable rows for {parameters} parameters are too few to tell effects apart: record \
         longer"
    )]
    TooFewRows {
        /// Rows there are.
        rows: usize,
        /// Parameters of the model.
        parameters: usize,
    },
    /// Too little time for blocks that are left out.
    #[error(
        "{seconds:.1} s of training logs are too short to tell effects apart: record {needed:.0} s \
         or more"
    )]
    TooShort {
        /// Length of the logs, s.
        seconds: f64,
        /// Least length, s.
        needed: f64,
    },
    /// Logs that are not of one arm, with one load.
    #[error(
        "the logs do not fit one model: a fit to {log} alone leaves {:.1} % of its torque, one to \
         all of them {:.1} %, and they agree best without {odd}. They are of two robots, have \
         other loads, or columns in another order or unit: leave out what is not of this arm, or \
         diagnose the logs one by one", left[0], left[1]
    )]
    LogsApart {
        /// The log that suffers most from the others.
        log: String,
        /// What a fit to it alone and one to all logs leave of its torque, %, geometric means of
        /// the joints.
        left: [f64; 2],
        /// The log without which the others agree best.
        odd: String,
    },
    /// An effect that was to be added by hand cannot be.
    #[error("add {addition}: {reason}")]
    Addition {
        /// As it was written.
        addition: String,
        /// Why, and what to write.
        reason: String,
    },
    /// The listener stopped the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl From<RecordingError> for DiagnosisError {
    fn from(error: RecordingError) -> Self {
        Self::Model(error.into())
    }
}

impl From<MotionError> for DiagnosisError {
    fn from(error: MotionError) -> Self {
        Self::Model(error.into())
    }
}

/// Diagnoses `model`, which was identified from `train`; `test` is only looked at for the errors
/// that are reported.
///
/// Effects that the model has already, everywhere or at single joints, stay and are refitted with
/// what is found.
///
/// # Errors
/// If the logs lack a joint or torque, cannot be differentiated, or hold too little.
///
/// # Panics
/// Never on the user's data.
pub fn diagnose(
    model: &TorqueModel,
    train: &[Recording],
    test: &[Recording],
    options: &DiagnosisOptions,
    progress: &dyn Progress,
) -> Result<Diagnosis, DiagnosisError> {
    diagnose_with(model, train, test, options, progress, &|_| ())
}

/// The same; `ranked` hears of the candidates, best first, as soon as all are ranked: long before
/// the search ends, and also if it is stopped after that.
///
/// # Errors
/// As [`diagnose`].
pub fn diagnose_with(
    model: &TorqueModel,
    train: &[Recording],
    test: &[Recording],
    options: &DiagnosisOptions,
    progress: &dyn Progress,
    ranked: &Ranked<'_>,
) -> Result<Diagnosis, DiagnosisError> {
    let wanted = options.by_hand.iter().map(|text| Wanted::parse(text, model.robot()));
    let wanted: Vec<Wanted> = wanted.collect::<Result<_, _>>()?;
    wanted.iter().try_for_each(|one| one.check(&options.catalogue, model.robot()))?;
    let train = LogSet::sorted(train);
    let train = train.logs();
    let problem = problem(model, train)?;
    let known: Vec<String> =
        problem.set.effects().iter().map(|effect| effect.name().into()).collect();
    let of_ranked =
        |search: &Search<'_>, ranking: &[Candidate]| ranked(&report::ranked(search, ranking));
    let mut search = Search::new(problem, &options.catalogue, known, (progress, &of_ranked));
    let start = search.start()?;
    let decision = if wanted.is_empty() {
        let outcome = search.run(&start)?;
        let decision = decision::decide(&mut search, outcome)?;
        one_arm::require_one_arm(&search.problem, &decision.outcome.fitted, &search.noise)?;
        decision
    } else {
        let outcome = search.by_hand(&start, &wanted)?;
        decision::judge_only(&search, outcome)
    };
    let written = if wanted.is_empty() {
        written::written(&search, model, &decision, train)?
    } else {
        let terms = decision.outcome.fitted.terms().to_vec();
        Written {
            model: written::identified_again(&search, model, terms, train)?,
            taken_back: vec![],
        }
    };
    report::report(&mut search, model, (&decision, written), test)
}

/// `model` with the effects of `findings` on top, all parameters refitted to `train`. A model that
/// was identified under physical consistency stays consistent.
///
/// # Errors
/// As [`diagnose`].
pub fn add(
    model: &TorqueModel,
    findings: &[&Finding],
    train: &[Recording],
) -> Result<TorqueModel, DiagnosisError> {
    let train = LogSet::sorted(train);
    let train = train.logs();
    let problem = problem(model, train)?;
    let known: Vec<String> =
        problem.set.effects().iter().map(|effect| effect.name().into()).collect();
    let mut search = Search::new(problem, &[], known, (&(), &|_, _| ()));
    let start = search.start()?;
    let mut terms = start.terms().to_vec();
    let new = |term: &&Term| !model.terms().iter().any(|own| own.is_like(term));
    terms.extend(findings.iter().flat_map(|finding| &finding.terms).filter(new).cloned());
    let refitted = search.refit(&start, terms);
    let fitted = search.polish(refitted);
    let history = findings.iter().map(|finding| report::sentence(finding));
    let mut again = written::identified_again(&search, model, fitted.terms().to_vec(), train)?;
    again.provenance.history.extend(history);
    Ok(again)
}

fn problem(model: &TorqueModel, train: &[Recording]) -> Result<Problem, DiagnosisError> {
    let processing = given_or_chosen(model.processing(), &select_joints(model.robot(), train)?)?;
    let problem = Problem::new(model, train, &processing)?;
    let (seconds, needed) = (problem.seconds(), problem.least_seconds());
    if seconds < needed {
        return Err(DiagnosisError::TooShort { seconds, needed });
    }
    let parameters = problem.base.rank();
    let rows = problem.rows.iter().map(Vec::len).sum();
    if rows < 4 * parameters.max(10) {
        return Err(DiagnosisError::TooFewRows { rows, parameters });
    }
    Ok(problem)
}
