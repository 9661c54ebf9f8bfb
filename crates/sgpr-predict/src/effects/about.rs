use core::fmt;

/// What a person should know of an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct About<'a> {
    /// How it enters the fit.
    pub class: Class,
    /// The torque, in the conventions of the library.
    pub formula: &'a str,
    /// Author, title or venue, year.
    pub source: &'a str,
    /// What gives it away in the residual.
    pub signature: &'a str,
    /// Names of effects that look like it.
    pub confusable: &'a [&'a str],
    /// The experiment that tells them apart.
    pub experiment: &'a str,
    /// What the motion must do for it to be seen.
    pub excitation: &'a str,
    /// Name of the effect that joint data cannot tell from it, and that stands for both.
    pub alias_of: Option<&'a str>,
    /// What the effect is a property of.
    pub origin: Origin,
    /// Why so: what a controller makes of it.
    pub origin_reason: &'a str,
    /// Whether the whole of it depends on the time of the session.
    pub depends_on_time: bool,
}

impl<'a> About<'a> {
    setters! {
        with_class(class: Class),
        with_formula(formula: &'a str),
        with_source(source: &'a str),
        with_signature(signature: &'a str),
        with_confusable(confusable: &'a [&'a str]),
        with_experiment(experiment: &'a str),
        with_excitation(excitation: &'a str),
        with_alias_of(alias_of: Option<&'a str>),
        with_origin(origin: Origin),
        with_origin_reason(origin_reason: &'a str),
        with_depends_on_time(depends_on_time: bool),
    }
}

/// What an effect is a property of: the arm, the measurement, or the hours of the logs.
///
/// A feed-forward torque holds what the arm needs, and nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// Of the arm: its torque is needed.
    #[default]
    Arm,
    /// An error of the measurement: the log shows it, the arm does not need it.
    Measurement,
    /// Something that was there for a while.
    Temporary,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Arm => "the arm",
            Self::Measurement => "the measurement",
            Self::Temporary => "a time of the logs",
        })
    }
}

/// A part that an effect plays in the dynamics of a joint, for code that treats it in a way of its
/// own: a robot file has a place for it, a simulator integrates it stiffly, another parameter can
/// take its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Proportional to the speed.
    ViscousFriction,
    /// Of one size against the motion.
    DryFriction,
    /// What dry friction has more at creeping speed.
    Stribeck,
    /// Inertia of the rotor, seen from the joint.
    RotorInertia,
    /// A constant torque.
    Offset,
}

/// How an effect enters the fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Class {
    /// L: linear in its parameters.
    #[default]
    Linear,
    /// N: a few constants, linear otherwise.
    Nonlinear,
    /// H: a hidden state, driven by the measured motion.
    HiddenState,
    /// X: changes what is measured or how the robot is put together.
    Transform,
    /// T: begins or ends at a time.
    ChangePoint,
    /// Found by checks of the log.
    Gate,
}

impl Class {
    /// The letter of the catalogue.
    pub fn letter(self) -> &'static str {
        match self {
            Self::Linear => "L",
            Self::Nonlinear => "N",
            Self::HiddenState => "H",
            Self::Transform => "X",
            Self::ChangePoint => "T",
            Self::Gate => "G",
        }
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear",
            Self::Nonlinear => "linear with nonlinear constants",
            Self::HiddenState => "with a hidden state",
            Self::Transform => "a transform of robot, motion or torque",
            Self::ChangePoint => "beginning at a time",
            Self::Gate => "a check of the log",
        })
    }
}
