use core::ops::{Add, AddAssign, Div, Mul, Sub, SubAssign};

#[cfg(feature = "std")]
use core::primitive::f64 as of_f64;

use super::Real;
#[cfg(not(feature = "std"))]
use crate::math as of_f64;

/// A number as laws of friction and other effects need it: what is written over it runs on a
/// sample, and can be recorded as an expression from which code is made.
///
/// Values cannot be branched on, as an expression has none: [`Self::where_positive`] and
/// [`Self::clamp`] choose.
pub trait Number:
    Real<Token = ()>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + Div<Output = Self>
    + AddAssign
    + SubAssign
{
    /// The constant `value`.
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self::splat((), Self::rounded(value))
    }

    /// Square root.
    fn sqrt(self) -> Self;

    /// e to the power of the number.
    fn exp(self) -> Self;

    /// Hyperbolic tangent.
    fn tanh(self) -> Self;

    /// Absolute value.
    fn abs(self) -> Self;

    /// Sign, zero at zero.
    fn sgn(self) -> Self;

    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);

    /// The number to a constant power.
    fn powf(self, exponent: f64) -> Self;

    /// `yes` where the number is above zero, `no` elsewhere.
    fn where_positive(self, yes: Self, no: Self) -> Self;

    /// The number, but not below `low` and not above `high`.
    fn clamp(self, low: Self, high: Self) -> Self;

    /// Whether the number is zero whatever the sample is.
    fn is_surely_zero(self) -> bool;

    /// Whether the number is known: `f64::NAN` stands for one that is not.
    fn is_known(self) -> bool;

    /// The square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }

    /// The larger of two.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        (self - other).where_positive(self, other)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn sqrt(self) -> Self {
        of_f64::sqrt(self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        of_f64::exp(self)
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        of_f64::tanh(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn sgn(self) -> Self {
        if self > 0.0 {
            1.0
        } else if self < 0.0 {
            -1.0
        } else {
            0.0
        }
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        of_f64::sin_cos(self)
    }

    #[inline(always)]
    fn powf(self, exponent: f64) -> Self {
        of_f64::powf(self, exponent)
    }

    #[inline(always)]
    fn where_positive(self, yes: Self, no: Self) -> Self {
        if self > 0.0 { yes } else { no }
    }

    #[inline(always)]
    fn clamp(self, low: Self, high: Self) -> Self {
        f64::clamp(self, low, high)
    }

    #[inline(always)]
    fn is_surely_zero(self) -> bool {
        self == 0.0
    }

    #[inline(always)]
    fn is_known(self) -> bool {
        !self.is_nan()
    }
}
