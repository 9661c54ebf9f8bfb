use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sgpr_predict::internal::{identified, with_role};
use sgpr_predict::model::StreamedModel;

use crate::dynamics::{BatchWorkspace, Samples, rnea_batch};
use crate::effects::{JointState, Role, Site, UnknownEffect};
use crate::identification::{
    BaseParameters, Consistency, ConsistentParameters, Costs, Distance, KeptOut, LinkCertificate,
    ParameterSet, PhysicalBounds, Price, Prior, PriorWidth, Stage,
};
use crate::model::{Predictor, StreamError, StreamOptions};
use crate::motion::Processing;
use crate::robot::{JointDynamics, Robot, RobotError};
use crate::spatial::PARAMETERS_PER_LINK;

/// tau = rigid body(q, dq, ddq; parameters) + effects(q, dq, ddq; parameters).
#[derive(Clone, Debug)]
pub struct TorqueModel {
    /// The robot with the inertias of its file.
    pub(super) robot: Robot,
    pub(super) set: ParameterSet,
    pub(super) base: BaseParameters,
    /// All parameters of the set.
    pub(super) parameters: Vec<f64>,
    /// The robot with the inertias of `parameters`.
    pub(super) dynamics: Robot,
    pub(super) fit: Option<Fit>,
    pub(crate) processing: Option<Processing>,
    pub(crate) provenance: Provenance,
    /// Effects at single sites.
    pub(super) terms: Vec<super::Term>,
    /// Start of the clock that effects of time go by, ns.
    pub(super) clock_start: Option<i64>,
}

/// What an identification says about its estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Fit {
    /// Name of the method.
    pub method: String,
    /// Estimated base parameters.
    pub values: Vec<f64>,
    /// Their standard deviations; infinite where the motion says nothing.
    #[serde(skip)]
    pub standard_deviations: Vec<f64>,
    /// Their covariance, `[rank, rank]`, row-major.
    #[serde(skip)]
    pub covariance: Vec<f64>,
    /// Covariance of the base parameters, the linear parameters of all terms and their constants,
    /// in this order, `[width, width]`, row-major; empty without terms, and where only the base
    /// parameters have a covariance.
    #[serde(skip)]
    pub covariance_with_terms: Vec<f64>,
    /// Standard deviation of the torque residual per joint, in the band of the fit, N·m (N).
    pub noise: Vec<f64>,
    /// Rows per joint.
    pub rows: Vec<usize>,
    /// Per joint: rows that carry as much as one independent row, from the autocorrelation of the
    /// residual.
    pub correlation: Vec<f64>,
    /// By what the standard deviations are larger than noise makes them, where the robot file holds
    /// what the logs do not determine: parts of the logs predict the others so much worse. Else
    /// one.
    #[serde(default = "one")]
    pub dispersion: f64,
    /// Half the interval into which 95 % of the errors fall that uncertain parameters make, in
    /// their standard deviations: 1.96; more where errors of parts of the logs that were left out
    /// have heavier tails.
    #[serde(default = "of_normal_errors")]
    pub half_interval_95: f64,
    /// Which prior was asked for, if one was.
    #[serde(default = "chosen")]
    pub prior: Option<PriorWidth>,
    /// Relative deviation of the bodies of the robot file, by which it holds what the logs do not
    /// determine; none if the estimate is bare, or the logs rich.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior_standard_deviation: Option<f64>,
    /// cond(W); infinite where the motion does not excite a direction at all.
    #[serde(with = "infinity_as_null")]
    pub condition: f64,
    /// cond(W) with columns scaled to unit length.
    #[serde(with = "infinity_as_null")]
    pub scaled_condition: f64,
    /// Base parameters that the motion does not determine.
    pub undetermined: Vec<String>,
    /// The proof that every link is a body, if that was required.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<Certificate>,
}

fn one() -> f64 {
    1.0
}

fn chosen() -> Option<PriorWidth> {
    Some(PriorWidth::Chosen)
}

fn of_normal_errors() -> f64 {
    crate::identification::HALF_INTERVAL_95
}

/// What physical consistency did to the estimates, and the proof of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Certificate {
    /// Link by link.
    pub links: Vec<LinkCertificate>,
    /// Limits at which the estimate lies.
    pub active: Vec<String>,
    /// Root mean square of what consistency adds to the residual, in standard deviations of the
    /// fit.
    pub cost: f64,
    /// Time in the solver, s.
    pub seconds: f64,
    /// How much larger the weighted residual is than without limits, percent; zero if that is less
    /// than noise explains.
    #[serde(default)]
    pub residual_percent: f64,
    /// What the limits cost one by one, dearest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub prices: Vec<Price>,
    /// What is left of `residual_percent` without the dearest limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<Stage>,
    /// Errors on parts of the logs that were kept out of the fit; none if the limits cost no more
    /// than noise explains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept_out: Option<KeptOut>,
    /// Relative standard deviation of the robot file's values that the estimate was pulled with;
    /// not in files of versions that did not keep it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior_deviation: Option<f64>,
    /// How the distance to the robot file was measured.
    #[serde(default)]
    pub distance: Distance,
    /// Limits of the user.
    #[serde(default)]
    pub bounds: PhysicalBounds,
}

impl Certificate {
    pub(super) fn new(
        consistent: ConsistentParameters,
        costs: Costs,
        kept_out: Option<KeptOut>,
        consistency: Consistency,
    ) -> Self {
        let ConsistentParameters { links, active, cost, seconds, .. } = consistent;
        let Costs { residual_percent, prices, stages, .. } = costs;
        let Consistency { prior: Prior { distance, relative_deviation }, bounds } = consistency;
        let prior_deviation = Some(relative_deviation);
        Self {
            links,
            active,
            cost,
            seconds,
            residual_percent,
            prices,
            stages,
            kept_out,
            prior_deviation,
            distance,
            bounds,
        }
    }

    /// What the parameters were held to.
    pub fn consistency(&self) -> Consistency {
        let prior = Prior::default();
        let relative_deviation = self.prior_deviation.unwrap_or(prior.relative_deviation);
        Consistency {
            prior: Prior { distance: self.distance, relative_deviation },
            bounds: self.bounds.clone(),
        }
    }
}

/// Where a model comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Provenance {
    /// Version of this library.
    pub library_version: String,
    /// Logs it was fitted to.
    pub logs: Vec<String>,
    /// First and last time stamp of each of them, ns; empty if they are not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spans: Vec<[i64; 2]>,
    /// What was done, in order, one sentence each.
    pub history: Vec<String>,
    /// How its logs were read, for those who read others like them: text that the library keeps and
    /// does not look at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<String>,
}

/// One base parameter for a table.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BaseParameter {
    /// Parameter that stands for the combination.
    pub name: String,
    /// The combination.
    pub expression: String,
    /// Unit.
    pub unit: &'static str,
    /// Value in this model.
    pub value: f64,
    /// Standard deviation; none for a model that was not identified, infinite if the motion did not
    /// determine it.
    pub standard_deviation: Option<f64>,
    /// Value that the robot file gives.
    pub nominal: f64,
}

impl TorqueModel {
    /// The model that the robot file describes: its inertias, and its `<dynamics>` as friction
    /// where given.
    pub fn nominal(robot: &Robot) -> Self {
        let has = |select: fn(&crate::robot::Joint) -> f64| {
            robot.joints().iter().any(|joint| select(joint) != 0.0)
        };
        let mut effects = Vec::new();
        if has(|joint| joint.damping) {
            effects.push(with_role(Role::ViscousFriction).name().to_string());
        }
        if has(|joint| joint.friction) {
            effects.push(with_role(Role::DryFriction).name().to_string());
        }
        let set = ParameterSet::new(robot, &effects).expect("effects of the library");
        let parameters = nominal_parameters(robot, &set);
        let history = vec![format!("taken from the robot file of `{}`", robot.name())];
        Self::from_parameters(robot.clone(), set, parameters, history)
    }

    /// A model with given parameters: ten per link, then those of `effects`, in the order of
    /// [`ParameterSet`].
    ///
    /// # Errors
    /// If there is no effect of a name.
    ///
    /// # Panics
    /// If `parameters` has another length than the set.
    pub fn with_parameters(
        robot: &Robot,
        effects: &[impl AsRef<str>],
        parameters: Vec<f64>,
    ) -> Result<Self, UnknownEffect> {
        let set = ParameterSet::new(robot, effects)?;
        Ok(Self::from_parameters(
            robot.clone(),
            set,
            parameters,
            vec!["made from given parameters".into()],
        ))
    }

    pub(crate) fn from_parameters(
        robot: Robot,
        set: ParameterSet,
        parameters: Vec<f64>,
        history: Vec<String>,
    ) -> Self {
        assert_eq!(parameters.len(), set.len(), "every parameter of the set");
        let library_version = env!("CARGO_PKG_VERSION").into();
        let provenance =
            Provenance { library_version, logs: vec![], spans: vec![], history, reading: None };
        Self {
            base: BaseParameters::new(&robot, &set),
            dynamics: identified(&robot, &set, &parameters),
            robot,
            set,
            parameters,
            fit: None,
            processing: None,
            provenance,
            terms: vec![],
            clock_start: None,
        }
    }

    pub(crate) fn set_parameters(&mut self, parameters: Vec<f64>) {
        self.dynamics = identified(&self.robot, &self.set, &parameters);
        self.parameters = parameters;
    }

    /// The robot with the inertias of its file.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The robot with the inertias of the model, and with its viscous and Coulomb friction where it
    /// has them at every joint: what a robot file can hold.
    pub fn identified_robot(&self) -> &Robot {
        &self.dynamics
    }

    /// Names and units of all parameters.
    pub fn parameter_set(&self) -> &ParameterSet {
        &self.set
    }

    /// Values of all parameters.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// The identifiable combinations.
    pub fn base(&self) -> &BaseParameters {
        &self.base
    }

    /// What the identification says, if the model was identified.
    pub fn fit(&self) -> Option<&Fit> {
        self.fit.as_ref()
    }

    /// How logs are processed for this model, if it was identified.
    pub fn processing(&self) -> Option<&Processing> {
        self.processing.as_ref()
    }

    /// The same model with a note on how its logs were read, see [`Provenance::reading`].
    #[must_use]
    pub fn with_reading(mut self, reading: Option<String>) -> Self {
        self.provenance.reading = reading;
        self
    }

    /// Where the model comes from.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// The table of base parameters.
    pub fn base_parameters(&self) -> Vec<BaseParameter> {
        let values = self.base.combine(&self.parameters);
        let nominal = self.base.combine(&nominal_parameters(&self.robot, &self.set));
        let row = |k: usize| BaseParameter {
            name: self.base.names()[k].clone(),
            expression: self.base.expression(k),
            unit: self.base.units()[k],
            value: values[k],
            standard_deviation: self.fit.as_ref().map(|fit| fit.standard_deviations[k]),
            nominal: nominal[k],
        };
        (0..self.base.rank()).map(row).collect()
    }

    /// This model and an error model on top of it: the parameters of both added (thesis eq. 4-21).
    ///
    /// Effects that only one of the two has are kept.
    ///
    /// # Panics
    /// If the models are of different robots.
    #[must_use]
    pub fn plus(&self, error: &Self) -> Self {
        let same_robot = self.robot.joint_names().eq(error.robot.joint_names());
        assert!(same_robot, "both models are of one robot");
        let effects = |model: &Self| {
            model.set.effects().iter().map(|e| e.name().to_string()).collect::<Vec<_>>()
        };
        let mut names = effects(self);
        names.extend(effects(error));
        let set = ParameterSet::new(&self.robot, &names).expect("effects of the models");
        let mut sum = vec![0.0; set.len()];
        for model in [self, error] {
            for (name, value) in model.set.names().iter().zip(&model.parameters) {
                let index = set.names().iter().position(|other| other == name).expect("a union");
                sum[index] += value;
            }
        }
        let mut history = self.provenance.history.clone();
        history.extend(
            error.provenance.history.iter().map(|line| format!("error model added: {line}")),
        );
        let mut model = Self::from_parameters(self.robot.clone(), set, sum, history);
        model.processing = error.processing.clone().or_else(|| self.processing.clone());
        model.provenance.logs.clone_from(&error.provenance.logs);
        model.provenance.spans.clone_from(&error.provenance.spans);
        model.terms = self.terms.iter().chain(&error.terms).cloned().collect();
        model.clock_start = self.clock_start.or(error.clock_start);
        model
    }

    /// Torque along a processed stretch of a log.
    pub fn predict_motion(&self, motion: &crate::motion::Motion) -> Vec<f64> {
        if self.terms.is_empty() {
            return self.predict(motion.samples());
        }
        self.predict_trajectory(&super::Trajectory::of(motion, &self.time_of(motion)))
    }

    /// Torque of every sample, allocation aside as fast as the dynamics of a batch.
    ///
    /// Effects that need time or a sampling rate are left out: see [`Self::predict_trajectory`].
    ///
    /// - returns `[samples, n]`, row-major, N·m (N)
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn predict(&self, samples: Samples<'_>) -> Vec<f64> {
        let n = self.robot.dof();
        samples.count(n);
        if !self.terms.is_empty() {
            return self.predict_trajectory(&super::Trajectory::of_samples(samples));
        }
        let mut tau = vec![0.0; samples.q.len()];
        // Samples do not know of each other: it makes no difference to them how many threads there
        // are.
        crate::threads::prepare();
        let blocks = tau.par_chunks_mut(PREDICTED_AT_ONCE * n).enumerate();
        blocks.for_each_init(
            || BatchWorkspace::new(&self.dynamics),
            |ws, (block, tau)| {
                let own = block * PREDICTED_AT_ONCE * n..block * PREDICTED_AT_ONCE * n + tau.len();
                let samples = Samples {
                    q: &samples.q[own.clone()],
                    dq: &samples.dq[own.clone()],
                    ddq: &samples.ddq[own],
                };
                self.predict_block(ws, samples, tau);
            },
        );
        tau
    }

    /// Torque of samples without terms, into `tau`.
    fn predict_block(&self, ws: &mut BatchWorkspace, samples: Samples<'_>, tau: &mut [f64]) {
        let n = self.robot.dof();
        rnea_batch(&self.dynamics, ws, samples, tau);
        if self.set.len() > self.set.inertial() {
            for (k, tau) in tau.chunks_exact_mut(n).enumerate() {
                let row = k * n..(k + 1) * n;
                let state = JointState {
                    q: &samples.q[row.clone()],
                    dq: &samples.dq[row.clone()],
                    ddq: &samples.ddq[row],
                };
                self.set.add_effect_torque(&self.parameters, &state, tau);
            }
        }
    }
}

/// Samples that a thread predicts before it asks for more.
const PREDICTED_AT_ONCE: usize = 4096;

impl From<&TorqueModel> for StreamedModel {
    fn from(model: &TorqueModel) -> Self {
        let noise = model.fit.as_ref().map_or_else(Vec::new, |fit| fit.noise.clone());
        Self::new(&model.robot, model.set.clone(), model.parameters.clone())
            .with_terms(model.terms.clone())
            .with_noise(noise)
    }
}

impl TorqueModel {
    /// The model one sample after the other.
    ///
    /// # Errors
    /// If a rate is needed and none given, or no number above zero; if an effect cannot be
    /// streamed; if an effect to keep is none of the model.
    pub fn predictor(&self, options: &StreamOptions) -> Result<Predictor, StreamError> {
        StreamedModel::from(self).predictor(options)
    }

    /// The model as MJCF for MuJoCo, with rotor inertia, viscous and Coulomb friction, at every
    /// joint or at one; MJCF has no place for other effects.
    ///
    /// # Errors
    /// If a link is no body: identify with consistency first.
    pub fn to_mjcf(&self) -> Result<String, RobotError> {
        let mut joints = vec![JointDynamics::default(); self.robot.dof()];
        for (column, value) in
            self.set.effect_columns().iter().zip(&self.parameters[self.set.inertial()..])
        {
            let joint = &mut joints[column.joint];
            match self.set.effects()[column.effect].role() {
                Some(Role::RotorInertia) => joint.rotor_inertia = *value,
                Some(Role::ViscousFriction) => joint.viscous_friction = *value,
                Some(Role::DryFriction) => joint.coulomb_friction = *value,
                _ => {}
            }
        }
        for (joint, role, value) in self.at_single_joints() {
            match role {
                Role::RotorInertia => joints[joint].rotor_inertia += value,
                Role::ViscousFriction => joints[joint].viscous_friction += value,
                Role::DryFriction => joints[joint].coulomb_friction += value,
                _ => {}
            }
        }
        self.dynamics.to_mjcf(&joints)
    }

    /// The robot as a URDF can hold the model: its inertias, and its viscous and Coulomb friction,
    /// at every joint or at one. What the model does not have at a joint is as in the robot file.
    pub fn robot_for_urdf(&self) -> Robot {
        let mut robot = self.dynamics.clone();
        let everywhere =
            |role: Role| self.set.effects().iter().any(|effect| effect.role() == Some(role));
        for (joint, role, value) in self.at_single_joints() {
            let joint = robot.joint_mut(joint);
            match role {
                Role::ViscousFriction => {
                    joint.damping = value + if everywhere(role) { joint.damping } else { 0.0 }
                }
                Role::DryFriction => {
                    joint.friction = value + if everywhere(role) { joint.friction } else { 0.0 }
                }
                _ => {}
            }
        }
        robot
    }

    /// Joint, role and value of the effects at single joints that a robot file may have a place
    /// for.
    fn at_single_joints(&self) -> impl Iterator<Item = (usize, Role, f64)> {
        self.terms.iter().filter_map(|term| {
            match (term.effect.role(), term.site, &term.coefficients[..]) {
                (Some(role), Site::Joint(joint), [value]) => Some((joint, role, *value)),
                _ => None,
            }
        })
    }
}

/// Parameters that the robot file gives: inertias, damping and friction; zero for what it does not
/// know.
pub(crate) fn nominal_parameters(robot: &Robot, set: &ParameterSet) -> Vec<f64> {
    let mut parameters = robot.standard_parameters();
    debug_assert_eq!(parameters.len(), PARAMETERS_PER_LINK * robot.dof());
    for column in set.effect_columns() {
        let joint = &robot.joints()[column.joint];
        parameters.push(match set.effects()[column.effect].role() {
            Some(Role::ViscousFriction) => joint.damping,
            Some(Role::DryFriction) => joint.friction,
            _ => 0.0,
        });
    }
    parameters.resize(set.len(), 0.0);
    parameters
}

/// JSON has no infinity.
mod infinity_as_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}
