use std::ops::{Add, Mul, Neg, Sub};

use pulp::Simd;

use super::Real;

/// Lanes of the widest instruction set.
pub const MAX_LANES: usize = 8;

/// As many numbers as a register of the instruction set `S` holds: the same joint of that many
/// samples.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// Numbers per register.
    pub const COUNT: usize = S::F64_LANES;

    /// Wraps a register.
    #[inline(always)]
    pub fn new(simd: S, values: S::f64s) -> Self {
        Self { simd, values }
    }

    /// The register.
    #[inline(always)]
    pub fn values(self) -> S::f64s {
        self.values
    }

    /// Reads the first [`Self::COUNT`] numbers.
    ///
    /// # Panics
    /// If there are fewer.
    #[inline(always)]
    pub fn load(simd: S, slice: &[f64]) -> Self {
        Self::new(simd, S::as_simd_f64s(slice).0[0])
    }

    /// Writes the first [`Self::COUNT`] numbers.
    ///
    /// # Panics
    /// If the slice is shorter.
    #[inline(always)]
    pub fn store(self, slice: &mut [f64]) {
        S::as_mut_simd_f64s(slice).0[0] = self.values;
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, rhs: Self) -> Self {
        Self::new(self.simd, self.simd.add_f64s(self.values, rhs.values))
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, rhs: Self) -> Self {
        Self::new(self.simd, self.simd.sub_f64s(self.values, rhs.values))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, rhs: Self) -> Self {
        Self::new(self.simd, self.simd.mul_f64s(self.values, rhs.values))
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(self.simd, self.simd.neg_f64s(self.values))
    }
}

impl<S: Simd> Real for Lanes<S> {
    type Token = S;
    type Constant = f64;

    #[inline(always)]
    fn rounded(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    fn splat(simd: S, value: f64) -> Self {
        Self::new(simd, simd.splat_f64s(value))
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self::new(self.simd, self.simd.mul_add_e_f64s(self.values, b.values, c.values))
    }

    #[inline(always)]
    fn recip(self) -> Self {
        let one = self.simd.splat_f64s(1.0);
        Self::new(self.simd, self.simd.div_f64s(one, self.values))
    }
}
