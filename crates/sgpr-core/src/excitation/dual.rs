//! Forward automatic differentiation through the recursions of [`dynamics`](crate::dynamics).

use std::ops::{Add, Mul, Neg, Sub};

use crate::simd::Real;

/// Directions that one number carries: two AVX2 registers, one of AVX-512.
pub(super) const DIRECTIONS: usize = 8;

/// A value with its derivatives in [`DIRECTIONS`] directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual {
    pub value: f64,
    pub slope: [f64; DIRECTIONS],
}

impl Dual {
    pub fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; DIRECTIONS] }
    }

    /// `value`, with derivative one in `direction` if there is one.
    pub fn variable(value: f64, direction: Option<usize>) -> Self {
        let mut dual = Self::constant(value);
        if let Some(slope) = direction.and_then(|direction| dual.slope.get_mut(direction)) {
            *slope = 1.0;
        }
        dual
    }

    /// Another function of the same variables: its value, and its derivative by this one.
    pub fn chain(&self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope.map(|slope| derivative * slope) }
    }
}

#[inline(always)]
fn combine(a: [f64; DIRECTIONS], b: [f64; DIRECTIONS], f: impl Fn(f64, f64) -> f64) -> [f64; DIRECTIONS] {
    let mut result = [0.0; DIRECTIONS];
    for k in 0..DIRECTIONS {
        result[k] = f(a[k], b[k]);
    }
    result
}

impl Add for Dual {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { value: self.value + b.value, slope: combine(self.slope, b.slope, |a, b| a + b) }
    }
}

impl Sub for Dual {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { value: self.value - b.value, slope: combine(self.slope, b.slope, |a, b| a - b) }
    }
}

impl Mul for Dual {
    type Output = Self;
    // The rule of products is a sum.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let slope = combine(self.slope, b.slope, |da, db| da * b.value + self.value * db);
        Self { value: self.value * b.value, slope }
    }
}

impl Neg for Dual {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl Real for Dual {
    type Token = ();

    #[inline(always)]
    fn splat((): (), value: f64) -> Self {
        Self::constant(value)
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }

    #[inline(always)]
    fn recip(self) -> Self {
        let value = self.value.recip();
        self.chain(value, -value * value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_formula_are_those_of_calculus() {
        let (x, y) = (Dual::variable(1.3, Some(0)), Dual::variable(-0.7, Some(3)));
        let f = (x * y - x).mul_add(y, (x + y).recip()) + -y;
        // f = (x y - x) y + 1 / (x + y) - y
        let inverse = 1.0f64 / 0.6;
        assert!((f.value - ((1.3 * -0.7 - 1.3) * -0.7 + inverse + 0.7)).abs() < 1e-14);
        assert!((f.slope[0] - ((-0.7 - 1.0) * -0.7 - inverse * inverse)).abs() < 1e-13);
        assert!((f.slope[3] - (2.0 * 1.3 * -0.7 - 1.3 - inverse * inverse - 1.0)).abs() < 1e-13);
        assert!(f.slope[1] == 0.0 && f.slope[7] == 0.0);
    }
}
