use core::fmt::Debug;
use core::ops::{Add, Mul, Neg, Sub};

/// A number as the recursions of this crate need it.
///
/// `Token` is the proof that the instructions behind the type exist on this machine; it is
/// zero-sized and nothing for plain numbers.
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// What is needed to make a value out of nothing.
    type Token: Copy;

    /// Numbers that a robot is kept in for recursions over this one, so that none is converted in
    /// them.
    type Constant: Copy + Debug + Send + Sync;

    /// `value` as such a number.
    fn rounded(value: f64) -> Self::Constant;

    /// The constant `value`.
    fn splat(token: Self::Token, value: Self::Constant) -> Self;

    /// `self * b + c`, with one rounding where the machine has it.
    fn mul_add(self, b: Self, c: Self) -> Self;

    /// `self * b - c`.
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self.mul_add(b, -c)
    }

    /// `c - self * b`.
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        (-self).mul_add(b, c)
    }

    /// `1 / self`.
    fn recip(self) -> Self;

    /// Zero.
    #[inline(always)]
    fn zero(token: Self::Token) -> Self {
        Self::splat(token, Self::rounded(0.0))
    }
}

impl Real for f64 {
    type Token = ();
    type Constant = Self;

    #[inline(always)]
    fn rounded(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn splat((): (), value: f64) -> Self {
        value
    }

    // Two roundings: without the instruction, `f64::mul_add` is a slow library call.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }

    #[inline(always)]
    fn recip(self) -> Self {
        f64::recip(self)
    }
}
