use std::fmt;

/// What a person should know of an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    /// Whether the whole of it depends on the time of the session.
    pub depends_on_time: bool,
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
