use core::ops::{Add, Mul, Neg, Sub};

#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::Real;

/// A vector of three components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector3<T> {
    /// First component.
    pub x: T,
    /// Second component.
    pub y: T,
    /// Third component.
    pub z: T,
}

impl<T> Vector3<T> {
    /// The vector (x, y, z).
    #[inline(always)]
    pub const fn new(x: T, y: T, z: T) -> Self {
        Self { x, y, z }
    }

    /// The vector of a function of each component.
    pub(crate) fn map<U>(self, f: impl Fn(T) -> U) -> Vector3<U> {
        Vector3::new(f(self.x), f(self.y), f(self.z))
    }
}

impl<T: Real<Token = ()>> Vector3<T> {
    /// A vector of constants of 64 bits.
    pub(crate) fn constant(v: Vector3<f64>) -> Self {
        v.map(|x| T::splat((), T::rounded(x)))
    }
}

impl Vector3<f64> {
    /// The zero vector.
    pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);

    /// Components as an array.
    pub fn to_array(self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }

    /// Euclidean length.
    pub fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }
}

impl From<[f64; 3]> for Vector3<f64> {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self::new(x, y, z)
    }
}

impl<T: Real> Vector3<T> {
    /// A constant vector.
    #[inline(always)]
    pub fn splat(token: T::Token, v: Vector3<T::Constant>) -> Self {
        Self::new(T::splat(token, v.x), T::splat(token, v.y), T::splat(token, v.z))
    }

    /// The zero vector.
    #[inline(always)]
    pub fn zero(token: T::Token) -> Self {
        Self::new(T::zero(token), T::zero(token), T::zero(token))
    }

    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, b: Self) -> T {
        self.x.mul_add(b.x, self.y.mul_add(b.y, self.z * b.z))
    }

    /// Vector product.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        Self::new(
            self.y.mul_sub(b.z, self.z * b.y),
            self.z.mul_sub(b.x, self.x * b.z),
            self.x.mul_sub(b.y, self.y * b.x),
        )
    }

    /// `self * factor + c`.
    #[inline(always)]
    pub fn scale_add(self, factor: T, c: Self) -> Self {
        Self::new(
            self.x.mul_add(factor, c.x),
            self.y.mul_add(factor, c.y),
            self.z.mul_add(factor, c.z),
        )
    }

    /// `self x b + c`.
    #[inline(always)]
    pub fn cross_add(self, b: Self, c: Self) -> Self {
        Self::new(
            self.y.mul_add(b.z, self.z.neg_mul_add(b.y, c.x)),
            self.z.mul_add(b.x, self.x.neg_mul_add(b.z, c.y)),
            self.x.mul_add(b.y, self.y.neg_mul_add(b.x, c.z)),
        )
    }
}

impl<T: Real> Add for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self::new(self.x + b.x, self.y + b.y, self.z + b.z)
    }
}

impl<T: Real> Sub for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self::new(self.x - b.x, self.y - b.y, self.z - b.z)
    }
}

impl<T: Real> Neg for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl<T: Real> Mul<T> for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: T) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}
