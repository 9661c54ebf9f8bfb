//! Functions of numbers that the standard library has and `core` has not, by `libm`.

pub(crate) use libm::{ceil, exp, floor, log as ln, pow as powf, round, sin, sincos as sin_cos, sqrt, tanh};

/// The methods of `f64` by the names that they have with the standard library.
pub(crate) trait Float {
    fn sqrt(self) -> Self;
    fn ln(self) -> Self;
    fn sin(self) -> Self;
    fn floor(self) -> Self;
    fn ceil(self) -> Self;
    fn round(self) -> Self;
    fn sin_cos(self) -> (Self, Self)
    where
        Self: Sized;
}

impl Float for f64 {
    #[inline]
    fn sqrt(self) -> Self {
        sqrt(self)
    }

    #[inline]
    fn ln(self) -> Self {
        ln(self)
    }

    #[inline]
    fn sin(self) -> Self {
        sin(self)
    }

    #[inline]
    fn floor(self) -> Self {
        floor(self)
    }

    #[inline]
    fn ceil(self) -> Self {
        ceil(self)
    }

    #[inline]
    fn round(self) -> Self {
        round(self)
    }

    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }
}
