use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::{ParameterSet, Term};
use crate::effects::{Role, UnknownEffect};
use crate::gp::LearnedProcess;
use crate::robot::Robot;

/// tau = rigid body(q, dq, ddq) + effects at every joint + effects at single sites + what was
/// learned of the residual: a torque model without where it comes from.
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
    pub(crate) residual: Option<Arc<LearnedResidual>>,
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
        Self { robot, set, parameters, terms: Vec::new(), noise: Vec::new(), residual: None }
    }

    /// The rigid body that a robot has by its file.
    pub fn nominal(robot: &Robot) -> Self {
        let effects: [&str; 0] = [];
        Self::with_parameters(robot, &effects, robot.standard_parameters())
            .expect("no effect is unknown")
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
        Ok(Self::new(robot, ParameterSet::new(robot, effects)?, parameters))
    }

    /// The same with other effects at single sites.
    #[must_use]
    pub fn with_terms(mut self, terms: Vec<Term>) -> Self {
        self.terms = terms;
        self
    }

    /// The same with another standard deviation of the torque, per joint, N·m (N); none of a model
    /// that was not identified.
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

    /// Standard deviation of the torque per joint, N·m (N), as the fit says; empty if the model was
    /// not identified.
    pub fn noise(&self) -> &[f64] {
        &self.noise
    }

    /// Whether it has Gaussian processes of what its physics leaves over: that of a semi-parametric
    /// model file.
    pub fn learned(&self) -> bool {
        self.residual.is_some()
    }

    pub(crate) fn joint_name(&self, joint: usize) -> String {
        self.robot.joints()[joint].name.clone()
    }

    /// Names of the effects, those of every joint first.
    pub fn effect_names(&self) -> Vec<String> {
        let everywhere = self.set.effects().iter().map(|effect| effect.name());
        everywhere
            .chain(self.terms.iter().map(|term| term.effect.name()))
            .map(String::from)
            .collect()
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

/// More points than this are a matter of a machine with the memory for the square of them.
const MOST_FOR_DEVIATION: usize = 5_000;

/// What a semi-parametric model has learned of what its physics leaves over.
#[derive(Clone, Debug)]
pub(crate) struct LearnedResidual {
    pub joints: Vec<LearnedJoint>,
    /// The physics as it was identified, for the joints without a process, if there are some and it
    /// differs.
    pub identified: Option<StreamedModel>,
    /// None if nobody knows how sure the parameters are.
    pub basis: Option<LearnedBasis>,
    /// Whether the file says how sure the parameters are; those of early versions do not.
    pub knows_parameters: bool,
}

/// What was learned at a joint.
#[derive(Clone, Debug)]
pub(crate) struct LearnedJoint {
    pub process: Option<LearnedProcess>,
    pub noise_variance: f64,
    pub calibration: f64,
}

/// How sure the linear parameters are.
#[derive(Clone, Debug)]
pub(crate) struct LearnedBasis {
    pub independent: Vec<usize>,
    /// `[unknowns, unknowns]`, row-major.
    pub covariance: Vec<f64>,
    /// Rows of their regressor at the points of each joint's process, `[points, unknowns]`, if they
    /// were estimated together.
    pub rows: Vec<Option<Vec<f64>>>,
}

impl LearnedResidual {
    /// Whether a standard deviation can be computed; if not, for which joint, and why.
    pub fn check_deviation(&self) -> Result<(), (usize, String)> {
        if !self.knows_parameters {
            let old = "its file was written by a version that did not keep how sure the parameters \
                 are: load it and save it again in Python (`sgpr.SemiParametricModel.load`, \
                 `save`), or ask for no deviation";
            return Err((0, old.into()));
        }
        for (joint, learned) in self.joints.iter().enumerate() {
            let points = learned.process.as_ref().map_or(0, LearnedProcess::len);
            if points > MOST_FOR_DEVIATION {
                return Err((
                    joint,
                    format!(
                        "the deviation of {points} points takes too much memory, at most \
                         {MOST_FOR_DEVIATION} are taken: ask for none"
                    ),
                ));
            }
        }
        Ok(())
    }
}
