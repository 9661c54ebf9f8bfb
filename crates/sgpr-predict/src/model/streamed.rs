use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::{LearnedRest, ParameterSet, Term};
use crate::effects::{Role, UnknownEffect};
use crate::robot::Robot;

/// tau = rigid body(q, dq, ddq) + effects at every joint + effects at single sites + what was learned of the rest: a torque model
/// without where it comes from.
///
/// [`Self::predictor`] makes a [`Predictor`](crate::stream::Predictor) of it.
#[derive(Clone, Debug)]
pub struct StreamedModel {
    /// With the inertias of the model.
    robot: Robot,
    set: ParameterSet,
    /// All parameters of the set.
    parameters: Vec<f64>,
    terms: Vec<Term>,
    noise: Vec<f64>,
    pub(crate) rest: Option<Arc<LearnedRest>>,
}

impl StreamedModel {
    /// A model from its parts: `parameters` in the order of `set`.
    ///
    /// # Panics
    /// If `parameters` has another length than the set, or the set is of another number of joints.
    pub fn new(robot: &Robot, set: ParameterSet, parameters: Vec<f64>) -> Self {
        assert_eq!(parameters.len(), set.len(), "every parameter of the set");
        assert_eq!(set.dof(), robot.dof(), "a set of the robot");
        let robot = identified(robot, &set, &parameters);
        Self { robot, set, parameters, terms: Vec::new(), noise: Vec::new(), rest: None }
    }

    /// The rigid body that a robot has by its file.
    pub fn nominal(robot: &Robot) -> Self {
        let effects: [&str; 0] = [];
        Self::with_parameters(robot, &effects, robot.standard_parameters()).expect("no effect is unknown")
    }

    /// A model with given parameters: ten per link, then those of `effects`, in the order of [`ParameterSet`].
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
        Ok(Self::new(robot, ParameterSet::new(robot, effects)?, parameters))
    }

    /// The same with other effects at single sites.
    #[must_use]
    pub fn with_terms(mut self, terms: Vec<Term>) -> Self {
        self.terms = terms;
        self
    }

    /// The same with another standard deviation of the torque, per joint, N·m (N); none of a model that was not identified.
    #[must_use]
    pub fn with_noise(mut self, noise: Vec<f64>) -> Self {
        self.noise = noise;
        self
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.robot.dof()
    }

    /// The robot with the inertias of the model.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Names and units of all parameters.
    pub fn parameter_set(&self) -> &ParameterSet {
        &self.set
    }

    /// Values of all parameters.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Effects at single sites.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Standard deviation of the torque per joint, N·m (N), as the fit says; empty if the model was not identified.
    pub fn noise(&self) -> &[f64] {
        &self.noise
    }

    /// Whether it has Gaussian processes of what its physics leaves over: that of a semi-parametric model file.
    pub fn learned(&self) -> bool {
        self.rest.is_some()
    }

    pub(crate) fn joint_name(&self, joint: usize) -> String {
        self.robot.joints()[joint].name.clone()
    }

    /// Names of the effects, those of every joint first.
    pub fn effect_names(&self) -> Vec<String> {
        let everywhere = self.set.effects().iter().map(|effect| effect.name());
        everywhere.chain(self.terms.iter().map(|term| term.effect.name())).map(String::from).collect()
    }
}

impl From<&Self> for StreamedModel {
    fn from(model: &Self) -> Self {
        model.clone()
    }
}

/// `robot` with all of `parameters` that a robot file has a place for.
#[doc(hidden)]
pub fn identified(robot: &Robot, set: &ParameterSet, parameters: &[f64]) -> Robot {
    let mut robot = robot.clone().with_standard_parameters(&parameters[..set.inertial()]);
    for (column, value) in set.effect_columns().iter().zip(&parameters[set.inertial()..]) {
        let joint = robot.joint_mut(column.joint);
        match set.effects()[column.effect].role() {
            Some(Role::ViscousFriction) => joint.damping = *value,
            Some(Role::DryFriction) => joint.friction = *value,
            _ => {}
        }
    }
    robot
}
