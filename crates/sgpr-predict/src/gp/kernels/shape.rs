use serde::{Deserialize, Serialize};

#[cfg(not(feature = "std"))]
use crate::math::Float;

/// A stationary kernel as a function of the distance r in length scales, with variance one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// exp(-r²/2): infinitely smooth functions.
    SquaredExponential,
    /// exp(-r), the Matérn kernel 1/2: continuous, nowhere smooth.
    Exponential,
    /// (1 + √3 r) exp(-√3 r): functions with one derivative.
    Matern32,
    /// (1 + √5 r + 5/3 r²) exp(-√5 r): functions with two derivatives.
    Matern52,
    /// (1 + r²/(2 mixture))^(-mixture): a mixture of squared exponentials of many length scales.
    RationalQuadratic {
        /// How alike the length scales are; the squared exponential is the limit of a large one.
        mixture: f64,
    },
}

impl Shape {
    /// k at the squared distance `r2`.
    pub fn value(self, r2: f64) -> f64 {
        let scaled = |factor: f64| (factor * r2).sqrt();
        match self {
            Self::SquaredExponential => (-0.5 * r2).exp(),
            Self::Exponential => (-r2.sqrt()).exp(),
            Self::Matern32 => (1.0 + scaled(3.0)) * (-scaled(3.0)).exp(),
            Self::Matern52 => (1.0 + scaled(5.0) + 5.0 / 3.0 * r2) * (-scaled(5.0)).exp(),
            Self::RationalQuadratic { mixture } => {
                (-mixture * (r2 / (2.0 * mixture)).ln_1p()).exp()
            }
        }
    }

    /// Calls `work` with a shape that the compiler knows at each place, so that no loop in it
    /// decides about shapes.
    #[inline(always)]
    pub(crate) fn known<R>(self, work: impl FnOnce(Self) -> R) -> R {
        match self {
            Self::SquaredExponential => work(Self::SquaredExponential),
            Self::Exponential => work(Self::Exponential),
            Self::Matern32 => work(Self::Matern32),
            Self::Matern52 => work(Self::Matern52),
            Self::RationalQuadratic { mixture } => work(Self::RationalQuadratic { mixture }),
        }
    }

    /// Its name in files, tables and other languages.
    pub fn name(self) -> &'static str {
        match self {
            Self::SquaredExponential => "squared_exponential",
            Self::Exponential => "exponential",
            Self::Matern32 => "matern32",
            Self::Matern52 => "matern52",
            Self::RationalQuadratic { .. } => "rational_quadratic",
        }
    }

    /// The shape of that name; a rational quadratic with mixture 1.
    pub fn by_name(name: &str) -> Option<Self> {
        let rational = Self::RationalQuadratic { mixture: 1.0 };
        [Self::SquaredExponential, Self::Exponential, Self::Matern32, Self::Matern52, rational]
            .into_iter()
            .find(|shape| shape.name() == name)
    }
}
