use core::array;
use core::ops::{Add, Mul, Neg, Sub};

use super::Real;

/// A value with its derivatives in `N` directions: forward automatic differentiation of what is
/// written over [`Real`].
#[derive(Clone, Copy, Debug)]
pub struct Dual<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its derivatives.
    pub slope: [T; N],
}

impl<T: Real<Token = ()>, const N: usize> Dual<T, N> {
    /// `value`, with derivative one in `direction` if there is one.
    pub fn variable(value: T, direction: Option<usize>) -> Self {
        let mut slope = [T::zero(()); N];
        if let Some(slope) = direction.and_then(|direction| slope.get_mut(direction)) {
            *slope = T::splat((), T::rounded(1.0));
        }
        Self { value, slope }
    }

    /// Another function of the same variables: its value, and its derivative by this one.
    pub fn chain(&self, value: T, derivative: T) -> Self {
        Self { value, slope: self.slope.map(|slope| derivative * slope) }
    }

    #[inline(always)]
    fn combine(self, other: Self, value: T, slope: impl Fn(T, T) -> T) -> Self {
        Self { value, slope: array::from_fn(|k| slope(self.slope[k], other.slope[k])) }
    }
}

impl<T: Real<Token = ()>, const N: usize> Add for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.combine(b, self.value + b.value, |a, b| a + b)
    }
}

impl<T: Real<Token = ()>, const N: usize> Sub for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.combine(b, self.value - b.value, |a, b| a - b)
    }
}

impl<T: Real<Token = ()>, const N: usize> Mul for Dual<T, N> {
    type Output = Self;

    // The rule of products is a sum.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.combine(b, self.value * b.value, |da, db| da * b.value + self.value * db)
    }
}

impl<T: Real<Token = ()>, const N: usize> Neg for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, slope: self.slope.map(|slope| -slope) }
    }
}

impl<T: Real<Token = ()>, const N: usize> Real for Dual<T, N> {
    type Token = ();
    type Constant = T::Constant;

    #[inline(always)]
    fn rounded(value: f64) -> T::Constant {
        T::rounded(value)
    }

    #[inline(always)]
    fn splat((): (), value: T::Constant) -> Self {
        Self { value: T::splat((), value), slope: [T::zero(()); N] }
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }

    #[inline(always)]
    fn recip(self) -> Self {
        let value = self.value.recip();
        self.chain(value, -(value * value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_formula_are_those_of_calculus() {
        let (x, y) = (Dual::<f64, 8>::variable(1.3, Some(0)), Dual::variable(-0.7, Some(3)));
        let f = (x * y - x).mul_add(y, (x + y).recip()) + -y;
        // f = (x y - x) y + 1 / (x + y) - y
        let inverse = 1.0f64 / 0.6;
        assert!((f.value - ((1.3 * -0.7 - 1.3) * -0.7 + inverse + 0.7)).abs() < 1e-14);
        assert!((f.slope[0] - ((-0.7 - 1.0) * -0.7 - inverse * inverse)).abs() < 1e-13);
        assert!((f.slope[3] - (2.0 * 1.3 * -0.7 - 1.3 - inverse * inverse - 1.0)).abs() < 1e-13);
        assert!(f.slope[1] == 0.0 && f.slope[7] == 0.0);
    }
}
