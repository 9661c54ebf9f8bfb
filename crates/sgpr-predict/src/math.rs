//! Functions of numbers that the standard library has and `core` has not, by `libm`.

pub(crate) use libm::{
    ceil, exp, expm1 as exp_m1, floor, hypot, log as ln, log1p as ln_1p, pow as powf, round, sin,
    sincos as sin_cos, sqrt, tanh,
};

/// Those of numbers of 32 bits.
pub(crate) mod single {
    pub(crate) use libm::{expf as exp, powf, sincosf as sin_cos, sqrtf as sqrt, tanhf as tanh};
}

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
    fn cos(self) -> Self;
    fn exp(self) -> Self;
    fn exp_m1(self) -> Self;
    fn ln_1p(self) -> Self;
    fn hypot(self, other: Self) -> Self;
    fn powi(self, exponent: i32) -> Self;
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
    #[inline]
    fn cos(self) -> Self {
        libm::cos(self)
    }

    #[inline]
    fn exp(self) -> Self {
        exp(self)
    }

    #[inline]
    fn exp_m1(self) -> Self {
        exp_m1(self)
    }

    #[inline]
    fn ln_1p(self) -> Self {
        ln_1p(self)
    }

    #[inline]
    fn hypot(self, other: Self) -> Self {
        hypot(self, other)
    }

    #[inline]
    fn powi(self, exponent: i32) -> Self {
        powf(self, f64::from(exponent))
    }
}
