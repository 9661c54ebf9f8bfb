use core::fmt::Debug;

use crate::effects::{Effect, Stepped};
use crate::gp::Precision;
use crate::simd::{Number, Single};

/// A number that a [`super::Predictor`] takes and gives: `f64`, or `f32` for processors that
/// compute with no other.
///
/// Times are `f64` in both.
pub trait Plain:
    sealed::Sealed + Copy + Debug + Default + Into<f64> + PartialEq + Send + Sync + 'static
{
    /// The same number as laws of effects are written over it.
    #[doc(hidden)]
    type Number: Stepped<Time = f64> + Default;

    /// Arithmetic of Gaussian processes beside it.
    #[doc(hidden)]
    const PRECISION: Precision;

    #[doc(hidden)]
    fn number(self) -> Self::Number;

    #[doc(hidden)]
    fn of(number: Self::Number) -> Self;

    #[doc(hidden)]
    fn of_f64(value: f64) -> Self;

    /// Whether an effect is written over it.
    #[doc(hidden)]
    fn has(effect: &dyn Effect) -> bool;
}

impl Plain for f64 {
    type Number = Self;

    const PRECISION: Precision = Precision::Double;

    #[inline(always)]
    fn number(self) -> Self {
        self
    }

    #[inline(always)]
    fn of(number: Self) -> Self {
        number
    }

    #[inline(always)]
    fn of_f64(value: f64) -> Self {
        value
    }

    fn has(_: &dyn Effect) -> bool {
        true
    }
}

impl Plain for f32 {
    type Number = Single;

    const PRECISION: Precision = Precision::Single;

    #[inline(always)]
    fn number(self) -> Single {
        Single(self)
    }

    #[inline(always)]
    fn of(number: Single) -> Self {
        number.0
    }

    #[inline(always)]
    fn of_f64(value: f64) -> Self {
        Single::constant(value).0
    }

    fn has(effect: &dyn Effect) -> bool {
        effect.is_generic()
    }
}

mod sealed {
    pub trait Sealed {}

    impl Sealed for f64 {}

    impl Sealed for f32 {}
}
