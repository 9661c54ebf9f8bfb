use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::str::FromStr;

use crate::effects::{Effect, Origin, Scale};
use crate::model::{StreamedModel, Term};

/// What a streamed torque is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// What the log would show: all of the model, as the prediction of a whole log.
    #[default]
    ExpectedMeasurement,
    /// What the arm needs: without errors of the measurement and without what was there for a while
    /// ([`Origin`]); a change of the arm at a time of the logs has happened.
    FeedForward,
}

impl Purpose {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::ExpectedMeasurement, Self::FeedForward];

    /// Its name: `expected_measurement`, `feed_forward`.
    pub fn name(self) -> &'static str {
        match self {
            Self::ExpectedMeasurement => "expected_measurement",
            Self::FeedForward => "feed_forward",
        }
    }
}

impl fmt::Display for Purpose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is that of no purpose.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("purpose: got `{0}`, expected `expected_measurement` or `feed_forward`")]
pub struct UnknownPurpose(pub String);

impl FromStr for Purpose {
    type Err = UnknownPurpose;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|purpose| purpose.name() == name)
            .ok_or_else(|| UnknownPurpose(name.into()))
    }
}

/// How a model is streamed.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct StreamOptions {
    /// Rate of the calls, Hz; none is enough where no effect needs time or the time between
    /// samples.
    pub rate_hz: Option<f64>,
    /// What the torque is for.
    pub purpose: Purpose,
    /// Names of effects that a feed-forward torque holds whatever they are a property of.
    pub keep: Vec<String>,
}

impl StreamOptions {
    setters! {
        with_rate_hz(rate_hz: Option<f64>),
        with_purpose(purpose: Purpose),
        with_keep(keep: Vec<String>),
    }
}

impl StreamOptions {
    /// Whether the torque holds an effect.
    #[doc(hidden)]
    pub fn holds(&self, effect: &dyn Effect) -> bool {
        self.purpose == Purpose::ExpectedMeasurement
            || effect.about().origin == Origin::Arm
            || self.keep.iter().any(|name| name == effect.name())
    }

    /// The terms that the torque holds.
    #[doc(hidden)]
    pub fn terms(&self, model: &StreamedModel) -> Vec<Term> {
        let held = model.terms().iter().filter(|term| self.holds(term.effect.as_ref()));
        held.cloned().map(|term| self.as_now(term)).collect()
    }

    /// A change of the arm during the logs lies in the past of whoever runs their model.
    fn as_now(&self, mut term: Term) -> Term {
        if self.purpose == Purpose::FeedForward && term.effect.about().origin == Origin::Arm {
            for (constant, value) in term.effect.constants().iter().zip(&mut term.constants) {
                if constant.scale == Scale::Time {
                    *value = f64::NEG_INFINITY;
                }
            }
        }
        term
    }

    /// The model's parameters, those of effects zero that the torque does not hold.
    pub(crate) fn parameters(&self, model: &StreamedModel) -> Vec<f64> {
        let set = model.parameter_set();
        let mut parameters = model.parameters().to_vec();
        for (column, value) in set.effect_columns().iter().zip(&mut parameters[set.inertial()..]) {
            if !self.holds(set.effects()[column.effect].as_ref()) {
                *value = 0.0;
            }
        }
        parameters
    }
}
