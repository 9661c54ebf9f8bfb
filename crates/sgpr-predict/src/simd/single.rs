use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

#[cfg(feature = "std")]
use core::primitive::f32 as of_f32;

use super::{Number, Real};
#[cfg(not(feature = "std"))]
use crate::math::single as of_f32;

/// A number of 32 bits, for processors without instructions for 64: a type of its own, because
/// `f32` cannot be added to the constants of 64 bits that laws are written with.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
#[repr(transparent)]
pub struct Single(pub f32);

impl From<Single> for f64 {
    #[inline(always)]
    fn from(number: Single) -> Self {
        Self::from(number.0)
    }
}

impl Neg for Single {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// An operator between two numbers, and between one and a constant.
macro_rules! operator {
    ($operator:ident, $method:ident) => {
        impl $operator for Single {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }

        impl $operator<f64> for Single {
            type Output = Self;

            #[inline(always)]
            fn $method(self, constant: f64) -> Self {
                self.$method(Self::constant(constant))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl AddAssign for Single {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl SubAssign for Single {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        self.0 -= other.0;
    }
}

impl Real for Single {
    type Token = ();
    type Constant = f32;

    #[inline(always)]
    fn rounded(value: f64) -> f32 {
        value as f32
    }

    #[inline(always)]
    fn splat((): (), value: f32) -> Self {
        Self(value)
    }

    // Two roundings, as for `f64`.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }

    #[inline(always)]
    fn recip(self) -> Self {
        Self(self.0.recip())
    }
}

impl Number for Single {
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(of_f32::sqrt(self.0))
    }

    #[inline(always)]
    fn exp(self) -> Self {
        Self(of_f32::exp(self.0))
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        Self(of_f32::tanh(self.0))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    #[inline(always)]
    fn sgn(self) -> Self {
        if self.0 > 0.0 {
            Self(1.0)
        } else if self.0 < 0.0 {
            Self(-1.0)
        } else {
            Self(0.0)
        }
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = of_f32::sin_cos(self.0);
        (Self(sine), Self(cosine))
    }

    #[inline(always)]
    fn powf(self, exponent: f64) -> Self {
        Self(of_f32::powf(self.0, exponent as f32))
    }

    #[inline(always)]
    fn where_positive(self, yes: Self, no: Self) -> Self {
        if self.0 > 0.0 { yes } else { no }
    }

    #[inline(always)]
    fn clamp(self, low: Self, high: Self) -> Self {
        Self(self.0.clamp(low.0, high.0))
    }

    #[inline(always)]
    fn is_surely_zero(self) -> bool {
        self.0 == 0.0
    }

    #[inline(always)]
    fn is_known(self) -> bool {
        !self.0.is_nan()
    }
}
