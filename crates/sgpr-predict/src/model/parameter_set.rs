use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;

use crate::effects::{self, Effect, Entry, JointState, Stepped, UnknownEffect};
use crate::robot::Robot;
use crate::spatial::{PARAMETERS_PER_LINK, STANDARD_PARAMETER_UNITS};

/// Every parameter of a robot's torque: ten per link, then those of the effects, then those whose
/// columns are given along with the trajectories.
///
/// Effects stand in the order of the registry, whatever order they were given in, each with its
/// joints in order.
#[derive(Clone, Debug)]
pub struct ParameterSet {
    dof: usize,
    names: Vec<String>,
    units: Vec<&'static str>,
    effects: Vec<Arc<dyn Effect>>,
    columns: Vec<EffectColumn>,
    trajectory_columns: Vec<TrajectoryColumn>,
    /// Whether columns are lines about rest.
    sticks: bool,
}

/// A speed at which everything but a jump is as at rest, rad/s (m/s).
#[doc(hidden)]
pub const BARELY_MOVING: f64 = 1e-9;

/// A parameter whose column does not follow from the present motion alone, but from the whole
/// trajectory: it comes with the trajectory, beside its motion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct TrajectoryColumn {
    /// Name, as `joint_2.Th`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// The joint whose torque it is part of; none for all joints.
    pub joint: Option<usize>,
    /// Whether physics forbids negative values.
    pub non_negative: bool,
    /// Root mean square of the column.
    pub size: f64,
}

impl TrajectoryColumn {
    /// A column that may have either sign.
    pub fn new(name: String, unit: &'static str, joint: Option<usize>, size: f64) -> Self {
        Self { name, unit, joint, non_negative: false, size }
    }
}

/// One parameter of an effect at a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EffectColumn {
    /// Index into [`ParameterSet::effects`].
    pub effect: usize,
    /// Joint.
    pub joint: usize,
    /// Index into the effect's parameters.
    pub parameter: usize,
}

impl ParameterSet {
    /// The robot with these effects at every joint.
    ///
    /// # Errors
    /// If there is no effect of a name.
    pub fn new(robot: &Robot, effects: &[impl AsRef<str>]) -> Result<Self, UnknownEffect> {
        for name in effects {
            let effect = effects::by_name(name.as_ref())?;
            if effect.entry() != Entry::State {
                let plain = |effect: &Arc<dyn Effect>| effect.entry() == Entry::State;
                let known = effects::registry()
                    .into_iter()
                    .filter(plain)
                    .map(|effect| effect.name().into())
                    .collect();
                return Err(UnknownEffect { name: name.as_ref().into(), known });
            }
        }
        let wanted =
            |effect: &Arc<dyn Effect>| effects.iter().any(|name| name.as_ref() == effect.name());
        let effects: Vec<_> = effects::registry().into_iter().filter(wanted).collect();

        let mut names = robot.standard_parameter_names();
        let mut units: Vec<&'static str> = STANDARD_PARAMETER_UNITS.repeat(robot.dof());
        let mut columns = Vec::new();
        for (index, effect) in effects.iter().enumerate() {
            for (joint, description) in robot.joints().iter().enumerate() {
                for (parameter, details) in effect.parameters().iter().enumerate() {
                    names.push(format!("{}.{}", description.name, details.symbol));
                    units.push(details.unit_at(description.kind));
                    columns.push(EffectColumn { effect: index, joint, parameter });
                }
            }
        }
        Ok(Self {
            dof: robot.dof(),
            names,
            units,
            effects,
            columns,
            trajectory_columns: vec![],
            sticks: false,
        })
    }

    /// The same with parameters whose columns come with the trajectories.
    #[must_use]
    pub fn with_trajectory_columns(mut self, columns: Vec<TrajectoryColumn>) -> Self {
        self.names.extend(columns.iter().map(|column| column.name.clone()));
        self.units.extend(columns.iter().map(|column| column.unit));
        self.trajectory_columns.extend(columns);
        self
    }

    /// The same for joints that stick: the column of a joint that barely moves (1e-9 rad/s, m/s) is
    /// a line between what it is in either direction.
    ///
    /// So dry friction, an unknown torque at rest, has a speed of its own for every value up to its
    /// size, which is rest for all else. Simulated motions name it .
    #[must_use]
    pub fn with_sticking_joints(mut self) -> Self {
        self.sticks = true;
        self
    }

    /// Whether it is for joints that stick.
    #[doc(hidden)]
    pub fn sticks(&self) -> bool {
        self.sticks
    }

    /// The parameters whose columns come with the trajectories, the last ones of the set.
    pub fn trajectory_columns(&self) -> &[TrajectoryColumn] {
        &self.trajectory_columns
    }

    /// Number of parameters whose columns follow from the present motion; those of the trajectories
    /// follow.
    pub fn of_state(&self) -> usize {
        self.len() - self.trajectory_columns.len()
    }

    /// Whether physics forbids negative values of a parameter of an effect.
    ///
    /// # Panics
    /// If `index` is not that of an effect's parameter.
    pub fn is_non_negative(&self, index: usize) -> bool {
        let offset = index.checked_sub(self.inertial()).expect("a parameter of an effect");
        match self.columns.get(offset) {
            Some(column) => self.effects[column.effect].parameters()[column.parameter].non_negative,
            None => self.trajectory_columns[offset - self.columns.len()].non_negative,
        }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.dof
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether there is no parameter.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Number of inertial parameters, `10 n`; the effects' follow.
    pub fn inertial(&self) -> usize {
        PARAMETERS_PER_LINK * self.dof
    }

    /// Names: `joint_2.Ixx`, `joint_2.Fv`.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Units.
    pub fn units(&self) -> &[&'static str] {
        &self.units
    }

    /// Effects in column order.
    pub fn effects(&self) -> &[Arc<dyn Effect>] {
        &self.effects
    }

    /// What the columns from [`Self::inertial`] to [`Self::of_state`] are.
    pub fn effect_columns(&self) -> &[EffectColumn] {
        &self.columns
    }

    /// Values of the effect columns of `joint` at one sample, in column order.
    ///
    /// - `out`: one number per effect column of the joint
    pub fn effect_row(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        let mut rest = out;
        for effect in &self.effects {
            let (own, others) = rest.split_at_mut(effect.parameters().len());
            self.columns_of(effect.as_ref(), joint, state, own);
            rest = others;
        }
    }

    /// The columns of an effect at a joint, a line about rest for joints that stick.
    fn columns_of<S: Stepped>(
        &self,
        effect: &dyn Effect,
        joint: usize,
        state: &JointState<'_, S>,
        out: &mut [S],
    ) {
        let (zero, one, speed) = (S::zero(()), S::constant(1.0), state.dq[joint]);
        let width = S::constant(BARELY_MOVING);
        let sticks = (width - speed.abs()).where_positive(one, zero);
        if !self.sticks || sticks.is_surely_zero() {
            return S::columns(effect, joint, state, out);
        }
        let mut dq = state.dq.to_vec();
        let [mut forwards, mut backwards] = [[zero; MOST_PARAMETERS]; 2];
        let [forwards, backwards] =
            [&mut forwards, &mut backwards].map(|columns| &mut columns[..out.len()]);
        S::columns(effect, joint, state, out);
        dq[joint] = width;
        S::columns(effect, joint, &JointState { dq: &dq, ..*state }, forwards);
        dq[joint] = -width;
        S::columns(effect, joint, &JointState { dq: &dq, ..*state }, backwards);
        let share = (speed / width + 1.0) * 0.5;
        for ((value, forwards), backwards) in out.iter_mut().zip(forwards).zip(backwards) {
            let line = *backwards + share * (*forwards - *backwards);
            *value = sticks.where_positive(line, *value);
        }
    }

    /// Number of effect columns of a joint.
    pub fn effect_columns_per_joint(&self) -> usize {
        self.effects.iter().map(|effect| effect.parameters().len()).sum()
    }

    /// Indices of the parameters that [`Self::effect_row`] gives for `joint`, in its order.
    pub fn effect_parameters_of(&self, joint: usize) -> Vec<usize> {
        let own = self.columns.iter().enumerate().filter(|(_, column)| column.joint == joint);
        own.map(|(index, _)| self.inertial() + index).collect()
    }

    /// Torque that the effects need at one sample, added to `tau`.
    ///
    /// - `parameters`: all parameters, in the order of the set; those of trajectory columns are not
    ///   looked at
    /// - `tau`: `[n]`, N·m (N)
    pub fn add_effect_torque<S: Stepped>(
        &self,
        parameters: &[f64],
        state: &JointState<'_, S>,
        tau: &mut [S],
    ) {
        let mut values = [S::zero(()); MOST_PARAMETERS];
        let mut index = self.inertial();
        for effect in &self.effects {
            let count = effect.parameters().len();
            for (joint, tau) in tau.iter_mut().enumerate() {
                self.columns_of(effect.as_ref(), joint, state, &mut values[..count]);
                for value in &values[..count] {
                    *tau += *value * parameters[index];
                    index += 1;
                }
            }
        }
    }
}

/// Parameters that an effect may have per joint.
const MOST_PARAMETERS: usize = 16;
