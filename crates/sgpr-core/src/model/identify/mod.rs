//! The main job: from a robot and logs to a model.

mod cutoff;
mod fit;
mod notes;
mod references;
mod screening;
mod source;
mod torque_end;

use derive_setters::Setters;

pub use cutoff::{CutoffInfluence, cutoff_influence};
pub(super) use fit::{Setup, require_one_arm};
pub use screening::screen;
use sgpr_predict::internal::with_role;
pub(super) use source::{PARTS, Place, Source, SourceFactors, key_of, parts_of_blocks};
use torque_end::torque_end;

use super::experiment::{given_or_chosen, require_torque, select_joints};
use super::limits::beyond_limits;
use super::{IdentifyError, Term, TorqueModel};
use crate::effects::Role;
use crate::identification::{
    Consistency, Essential, Estimate, Finding, Forecast, Method, PriorWidth,
};
use crate::motion::{Conditioning, Processing};
use crate::progress::Progress;
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;
use crate::signal::CutoffChoice;

/// What to identify, and how.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct IdentifyOptions {
    /// Names of effects beside the rigid body, any that change the torque, at all joints or at one:
    /// `cable_stiffness`, `cable_hysteresis@joint_4`. Their constants are fitted by variable
    /// projection.
    pub effects: Vec<String>,
    /// The estimator.
    pub method: Method,
    /// Physics and limits that the full set of parameters keeps; none if `None`.
    pub consistency: Option<Consistency>,
    /// Whether the data choose how strong the pull toward the robot file is
    /// ([`Consistency::cross_validate`]).
    pub cross_validated_prior: bool,
    /// Whether parameters that the data do not support are left out.
    pub essential: bool,
    /// Where standard deviations come from.
    pub uncertainty: Uncertainty,
    /// The same motions without noise, simulated or the references, for instrumental variables; the
    /// references of the controller, if there is one.
    pub instruments: Vec<Recording>,
    /// The controller, for output error and for simulated instruments.
    pub controller: Option<Controller>,
    /// What is done to the logs.
    pub conditioning: Conditioning,
    /// Values that parameters keep where the motion does not determine them.
    pub start: Start,
    /// What holds parameters that the logs determine worse than the robot file does
    /// ([`ParameterPrior`](crate::identification::ParameterPrior)): the width of the prior; the
    /// bare estimate if `None`. With it a joint that the robot file predicts better on parts of the
    /// logs that were left out keeps the file.
    pub prior: Option<PriorWidth>,
    /// Whether the report says how much data is enough ([`Forecast`]).
    pub forecast: bool,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        let effects = [Role::ViscousFriction, Role::DryFriction, Role::RotorInertia, Role::Offset];
        Self {
            effects: effects.map(|role| with_role(role).name().to_string()).to_vec(),
            method: Method::Wls,
            consistency: None,
            cross_validated_prior: false,
            essential: false,
            uncertainty: Uncertainty::Memory,
            instruments: Vec::new(),
            controller: None,
            conditioning: Conditioning::default(),
            start: Start::RobotFile,
            prior: Some(PriorWidth::Chosen),
            forecast: false,
        }
    }
}

/// Where the standard deviations of the estimates come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uncertainty {
    /// The scatter and the memory of each joint's residual, joints taken as independent.
    Memory,
    /// The residuals as they are, over time and between joints
    /// ([`hac_covariance`](crate::identification::hac_covariance)).
    Hac,
    /// Experiments made of blocks of this one
    /// ([`block_bootstrap`](crate::identification::block_bootstrap)).
    Bootstrap {
        /// How many.
        replicates: usize,
    },
}

/// tau = torque of the reference's recording + kp (reference - q) + kd (its speed - dq), at the
/// joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// `[n]`, N·m/rad (N/m).
    pub kp: Vec<f64>,
    /// `[n]`, N·m·s/rad (N·s/m).
    pub kd: Vec<f64>,
}

/// What the parameters are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The robot file: the torque of the log is the whole torque.
    RobotFile,
    /// Zero: the torque of the log is what an internal model leaves over, its feedback torque, and
    /// the result is the error of the internal model (thesis eqs. 4-18 to 4-20), to be added with
    /// [`TorqueModel::plus`].
    Zero,
}

/// How the identification went, beside the model.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct IdentificationReport {
    /// Per log: the spectra and the cut-off that they suggest.
    pub cutoff_choices: Vec<CutoffChoice>,
    /// Largest first.
    pub singular_values: Vec<f64>,
    /// Sentences that the user should read.
    pub warnings: Vec<String>,
    /// What speaks against the logs; each is among the warnings.
    pub findings: Vec<Finding>,
    /// Samples in the logs, and equations per joint taken from them.
    pub samples: usize,
    /// Which base parameters the data support, if that was asked for.
    pub essential: Option<Essential>,
    /// How much data is enough, if that was asked for.
    pub forecast: Option<Forecast>,
}

/// Identifies the torque model of `robot` from recordings.
///
/// The joints of each recording are picked by the names of the robot's joints. Samples that two
/// recordings share count once ([`LogSet`]), and a warning says so. `progress` hears of every log;
/// `&()` for silence.
///
/// # Errors
/// If a recording lacks a joint or torque, cannot be differentiated, or holds too little; each
/// message names the recording and says what to do.
pub fn identify(
    robot: &Robot,
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: &dyn Progress,
) -> Result<(TorqueModel, IdentificationReport), IdentifyError> {
    let set = set_of(recordings, options);
    let (recordings, said) =
        set.as_ref().map_or((recordings, &[][..]), |set| (set.logs(), set.notes()));
    let recordings = select_joints(robot, recordings)?;
    require_torque(robot, &recordings)?;
    let (processing, cutoff_choices) = Processing::choose(&recordings, &options.conditioning)?;
    let (model, mut outcome, motions) =
        fit::fit(robot, &recordings, options, &processing, Given::default(), progress)?;
    // What a controller adds to an internal model ends where the controller does.
    if options.start == Start::RobotFile {
        outcome.findings.extend(torque_end(&model, &motions, &processing)?);
    }
    outcome.findings.extend(beyond_limits(robot, &recordings));
    let samples = recordings.iter().map(Recording::len).sum();
    let report = outcome.report(&model, said.to_vec(), samples);
    Ok((model, IdentificationReport { cutoff_choices, ..report }))
}

/// The recordings as a set; `None` with instruments, which go with the recordings sample by sample.
fn set_of(recordings: &[Recording], options: &IdentifyOptions) -> Option<LogSet> {
    options.instruments.is_empty().then(|| LogSet::new(recordings))
}

/// `model` with these terms, everything fitted again under physical consistency. What the robot
/// file holds in `model` it holds again, no wider than there: logs determine no more of a model with
/// more parameters, and how wrong the file is does not hang on them.
///
/// # Errors
/// As [`identify`].
pub(crate) fn identify_again(
    model: &TorqueModel,
    given: Given,
    consistency: Option<&Consistency>,
    recordings: &[Recording],
) -> Result<TorqueModel, IdentifyError> {
    let recordings = select_joints(&model.robot, recordings)?;
    let processing = given_or_chosen(model.processing.as_ref(), &recordings)?;
    let fit = model.fit.as_ref();
    let held = fit.and_then(|fit| fit.prior_standard_deviation);
    let asked = fit.map_or(Some(PriorWidth::Chosen), |fit| fit.prior);
    let options = IdentifyOptions {
        prior: asked.map(|width| match (width, held) {
            (PriorWidth::Given(_), _) | (_, None) => width,
            (_, Some(held)) => PriorWidth::AtMost(held),
        }),
        effects: model.set.effects().iter().map(|effect| effect.name().into()).collect(),
        consistency: consistency.cloned(),
        ..IdentifyOptions::default()
    };
    let (mut again, ..) = fit::fit(&model.robot, &recordings, &options, &processing, given, &())?;
    let before = model.provenance.history.clone();
    let other = again.provenance.history.into_iter().filter(|line| !before.contains(line));
    let own: Vec<String> =
        other.map(|line| format!("with the effects that follow, {line}")).collect();
    again.provenance.history = [before, own].concat();
    Ok(again)
}

/// Terms that a fit starts with.
#[derive(Default)]
pub(crate) struct Given {
    pub terms: Vec<Term>,
    /// Start of their clock, ns.
    pub clock: Option<i64>,
}

/// What a fit gives beside the model.
pub(super) struct FitOutcome {
    estimate: Estimate,
    essential: Option<Essential>,
    forecast: Option<Forecast>,
    notes: Vec<String>,
    findings: Vec<Finding>,
}

impl FitOutcome {
    /// The report of it.
    ///
    /// - `said`: to be said beside what the robot and the fit say
    pub fn report(
        self,
        model: &TorqueModel,
        said: Vec<String>,
        samples: usize,
    ) -> IdentificationReport {
        let Self { estimate, essential, forecast, notes, findings } = self;
        let found = findings.iter().map(ToString::to_string);
        let mut report = IdentificationReport {
            cutoff_choices: vec![],
            singular_values: estimate.excitation.singular_values,
            warnings: model
                .robot
                .warnings()
                .into_iter()
                .chain(said)
                .chain(notes)
                .chain(found)
                .collect(),
            findings,
            samples,
            essential,
            forecast,
        };
        warn(&mut report, model);
        report
    }
}

fn warn(report: &mut IdentificationReport, model: &TorqueModel) {
    let Some(fit) = &model.fit else { return };
    let bare = fit.standard_deviations.iter().any(|deviation| deviation.is_infinite());
    if bare && !fit.undetermined.is_empty() {
        report.warnings.push(format!(
            "the motion does not excite {} of {} base parameters: {}; they keep their values of \
             the robot file. Record a motion that moves these joints, fast and slow, in both \
             directions",
            fit.undetermined.len(),
            model.base.rank(),
            fit.undetermined.join(", ")
        ));
    }
    let uncertain: Vec<&str> = model
        .base
        .names()
        .iter()
        .enumerate()
        .filter(|(k, _)| {
            fit.standard_deviations[*k].is_finite()
                && fit.standard_deviations[*k] > fit.values[*k].abs()
        })
        .map(|(_, name)| name.as_str())
        .collect();
    if !uncertain.is_empty() {
        let parameters =
            if uncertain.len() == 1 { "base parameter is" } else { "base parameters are" };
        report.warnings.push(format!(
            "{} {parameters} smaller than their standard deviation: {}",
            uncertain.len(),
            uncertain.join(", ")
        ));
    }
}
