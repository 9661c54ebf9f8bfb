//! What a diagnosis says.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::formula::Formula;
use super::structure::JointStructure;
use super::whereabouts::Whereabouts;
use crate::excitation::TrajectorySamples;
use crate::model::{Term, TorqueModel};

/// Samples per second of the motions of experiments.
pub(super) const RATE_HZ: f64 = 100.0;

/// What came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Effects of the catalogue are missing from the model.
    EffectsFound,
    /// Nothing material is missing at this noise.
    NothingMissing,
    /// Something is missing that no known effect explains.
    UnexplainedStructure,
}

/// An effect that the logs would have shown, had it been there and large enough.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Detectable {
    /// Effect.
    pub effect: String,
    /// Its joints; none for an effect of the whole arm.
    pub joints: Vec<String>,
    /// Constants for which the sizes hold, the parameter itself left out.
    pub constants: Vec<FoundParameter>,
    /// Parameter whose size is meant; the effect's other parameters are zero.
    pub parameter: String,
    /// Unit of the sizes.
    pub unit: String,
    /// Size from which it is seen: it has evidence, and the error falls by as much as matters.
    pub seen_from: f64,
    /// Root mean square torque of the effect of that size, at the joint where it is largest against
    /// what is left, N·m (N).
    pub torque: f64,
    /// Share of that torque that the parameters of the model do not take up.
    pub visible: f64,
    /// Size from which it is told from every other effect; none if there is no such size.
    pub told_apart_from: Option<f64>,
    /// The effect that it could be mistaken for below that size.
    pub mistaken_for: Option<String>,
}

/// Hears of the candidates of a search, best first, before it ends.
pub type Ranked<'a> = dyn Fn(&[Finding]) + Sync + 'a;

/// A parameter of a finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FoundParameter {
    /// Name: `joint_2.vs`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard deviation; none if the logs do not determine the parameter.
    #[serde(rename = "standard_deviation", alias = "std")]
    pub std: Option<f64>,
    /// Unit.
    pub unit: String,
}

/// Numbers by joint name.
pub type ByJoint = BTreeMap<String, f64>;

/// An effect that the diagnosis stands behind, or one that was tested.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Finding {
    /// Effect.
    pub effect: String,
    /// Names of its joints; none for an effect of the whole arm.
    pub joints: Vec<String>,
    /// Probability that it is there, or a form of it that these logs cannot tell from it;
    /// [`Self::evidence`] names those.
    pub probability: f64,
    /// Log of the Bayes factor against the same model without it.
    pub score: f64,
    /// Constants and linear parameters.
    pub parameters: Vec<FoundParameter>,
    /// Error on blocks of time that no fit has seen, of the model with all findings but this, N·m
    /// (N).
    pub rmse_before: ByJoint,
    /// The same with it; of a candidate with its constants as they were ranked.
    pub rmse_after: ByJoint,
    /// Largest fall of that error on a joint, percent of it: negative if it only rises, 0 for a
    /// candidate without evidence.
    #[serde(default)]
    pub error_gained_percent: f64,
    /// One sentence.
    pub evidence: String,
    /// Effects that these logs tell from it badly; `effect@joint` is the same one elsewhere.
    pub confusable_with: Vec<String>,
    /// What would tell them apart.
    pub separating_experiment: String,
    /// What it is made of, to be added to a model.
    #[serde(skip)]
    pub terms: Vec<Term>,
}

/// An effect that could not be tested.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct NotTestable {
    /// Effect.
    pub effect: String,
    /// Why.
    pub why: String,
}

/// Error of a joint on the test logs, torque as logged against prediction, and what noise alone
/// would leave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointErrors {
    /// Before, N·m (N).
    pub rmse_before: f64,
    /// After, N·m (N).
    pub rmse_after: f64,
    /// Noise of the torque, N·m (N).
    pub noise: f64,
    /// 100 (1 - |residual| / |measured - its mean|) before, percent; none for a joint that never
    /// moves.
    #[serde(rename = "fit_percent_before", alias = "fit_before")]
    pub fit_before: Option<f64>,
    /// The same after.
    #[serde(rename = "fit_percent_after", alias = "fit_after")]
    pub fit_after: Option<f64>,
}

/// A proposal for what to record next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct NextExperiment {
    /// Hypotheses that it would tell apart: the finding first.
    pub about: Vec<String>,
    /// What to do.
    pub experiment: String,
    /// Joints that it is about.
    pub joints: Vec<String>,
    /// Length of the motion, s.
    pub seconds: f64,
    /// Log of the Bayes factor that the logs give against the nearest of the others.
    pub separation_now: f64,
    /// The same to be expected with the motion recorded beside the logs.
    pub separation_expected: f64,
    /// The motion: within positions, speeds and accelerations of the logs, from rest to rest.
    #[serde(skip)]
    pub motion: TrajectorySamples,
}

/// The held-out error after one more effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Step {
    /// The effect that was added; none at the start.
    pub effect: Option<String>,
    /// Its joints.
    pub joints: Vec<String>,
    /// Error per joint on blocks of time that were left out of the fit, N·m (N).
    pub rmse: ByJoint,
}

/// The answer of [`diagnose`](super::diagnose).
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Diagnosis {
    /// Version of this layout.
    pub schema: u32,
    /// What came out.
    pub verdict: Verdict,
    /// Probability that nothing material is missing.
    pub probability_nothing_missing: f64,
    /// Probability that something is missing that no known effect explains.
    pub probability_unexplained: f64,
    /// What the diagnosis stands behind, best first.
    pub findings: Vec<Finding>,
    /// Every effect that was tested, best first.
    pub candidates: Vec<Finding>,
    /// What could not be tested.
    pub not_testable: Vec<NotTestable>,
    /// What the logs could have shown beside the findings, and from which size on.
    pub detectable: Vec<Detectable>,
    /// Joint by joint.
    pub joints: BTreeMap<String, JointErrors>,
    /// How the held-out error fell, effect by effect.
    pub steps: Vec<Step>,
    /// Where the error sits.
    pub whereabouts: Whereabouts,
    /// What the error of the model depends on, joint by joint.
    pub structure: Vec<JointStructure>,
    /// The same with the findings: what is left.
    pub left: Vec<JointStructure>,
    /// What unexplained structure depends on, in words.
    pub unexplained: Vec<String>,
    /// Formulas for unexplained structure: suggestions.
    pub formulas: Vec<Formula>,
    /// What to record next.
    pub next_experiment: Vec<NextExperiment>,
    /// The model that was diagnosed.
    #[serde(skip)]
    pub before: TorqueModel,
    /// The model with all findings, refitted.
    #[serde(skip)]
    pub after: TorqueModel,
}

impl Diagnosis {
    /// The content of `diagnosis.json`: the same input gives the same bytes.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("finite numbers and strings")
    }

    /// The diagnosis that [`Self::to_json`] wrote, with the models and the motions of its next
    /// experiments.
    ///
    /// # Errors
    /// If the text is no diagnosis, or the motions are not those of its experiments.
    pub fn from_json(
        text: &str,
        before: TorqueModel,
        after: TorqueModel,
        motions: Vec<TrajectorySamples>,
    ) -> Result<Self, String> {
        let mut data: serde_json::Value =
            serde_json::from_str(text).map_err(|error| error.to_string())?;
        let data = &mut data;
        let mut next_experiment: Vec<NextExperiment> = field(data, "next_experiment")?;
        if next_experiment.len() != motions.len() {
            return Err(format!(
                "{} experiments, {} motions",
                next_experiment.len(),
                motions.len()
            ));
        }
        for (experiment, motion) in next_experiment.iter_mut().zip(motions) {
            experiment.motion = motion;
        }
        let mut findings: Vec<Finding> = field(data, "findings")?;
        findings.iter_mut().for_each(|finding| finding.take_terms(&before, &after));
        Ok(Self {
            schema: field(data, "schema")?,
            verdict: field(data, "verdict")?,
            probability_nothing_missing: field(data, "probability_nothing_missing")?,
            probability_unexplained: field(data, "probability_unexplained")?,
            findings,
            candidates: field(data, "candidates")?,
            not_testable: field(data, "not_testable")?,
            detectable: field(data, "detectable")?,
            joints: field(data, "joints")?,
            steps: field(data, "steps")?,
            whereabouts: field(data, "whereabouts")?,
            structure: field(data, "structure")?,
            left: field(data, "left")?,
            unexplained: field(data, "unexplained")?,
            formulas: field(data, "formulas")?,
            next_experiment,
            before,
            after,
        })
    }

    /// The motions of [`Self::next_experiment`] one after the other, 100 samples per second; `None`
    /// if there is none.
    pub fn next_motion(&self) -> Option<TrajectorySamples> {
        let motions: Vec<&TrajectorySamples> =
            self.next_experiment.iter().map(|one| &one.motion).collect();
        (!motions.is_empty()).then(|| TrajectorySamples::in_a_row(&motions, RATE_HZ))
    }
}

impl Finding {
    /// What somebody knows to act, to be added without a search: terms with their constants, from
    /// which the fit starts.
    pub fn of_terms(terms: Vec<Term>) -> Self {
        Self {
            effect: String::new(),
            joints: vec![],
            probability: 1.0,
            score: 0.0,
            parameters: vec![],
            rmse_before: BTreeMap::new(),
            rmse_after: BTreeMap::new(),
            error_gained_percent: 0.0,
            evidence: String::new(),
            confusable_with: vec![],
            separating_experiment: String::new(),
            terms,
        }
    }

    /// A finding from its JSON; what it is made of is in `after`, not in `before`.
    ///
    /// # Errors
    /// If the text is no finding.
    pub fn from_json(
        text: &str,
        before: &TorqueModel,
        after: &TorqueModel,
    ) -> Result<Self, String> {
        let mut found: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        found.take_terms(before, after);
        Ok(found)
    }

    /// The fields as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("finite numbers and strings")
    }

    /// The same with the fall of its error.
    pub(super) fn with_gain(mut self) -> Self {
        let fall = |(joint, before): (&String, &f64)| {
            Some(100.0 * (1.0 - self.rmse_after.get(joint)? / before))
        };
        let falls = self.rmse_before.iter().filter_map(fall).filter(|fall| fall.is_finite());
        self.error_gained_percent = falls.reduce(f64::max).unwrap_or(0.0);
        self
    }

    fn take_terms(&mut self, before: &TorqueModel, after: &TorqueModel) {
        let fresh = |term: &&Term| !before.terms().iter().any(|known| known.is_like(term));
        self.terms = after
            .terms()
            .iter()
            .filter(fresh)
            .filter(|term| self.holds(term, after))
            .cloned()
            .collect();
    }

    /// Whether a term of a model is part of this finding.
    fn holds(&self, term: &Term, model: &TorqueModel) -> bool {
        let name = |joint: usize| &model.robot().joints()[joint].name;
        let at = term.site.joint().map(name);
        term.effect.name() == self.effect
            && match at {
                Some(joint) => self.joints.contains(joint),
                None => self.joints.is_empty(),
            }
    }
}

fn field<T: serde::de::DeserializeOwned>(
    data: &mut serde_json::Value,
    name: &str,
) -> Result<T, String> {
    let value = data.get_mut(name).ok_or_else(|| format!("no `{name}`"))?.take();
    serde_json::from_value(value).map_err(|error| format!("{name}: {error}"))
}
