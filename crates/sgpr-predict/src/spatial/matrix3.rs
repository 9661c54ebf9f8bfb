use core::ops::{Add, Mul};

use super::Vector3;
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::Real;

/// A 3 x 3 matrix, stored by columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrix3<T> {
    /// Columns.
    pub columns: [Vector3<T>; 3],
}

impl<T> Matrix3<T> {
    /// The matrix with these columns.
    #[inline(always)]
    pub const fn from_columns(x: Vector3<T>, y: Vector3<T>, z: Vector3<T>) -> Self {
        Self { columns: [x, y, z] }
    }

    /// The matrix of a function of each entry.
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U) -> Matrix3<U>
    where
        T: Copy,
    {
        Matrix3 { columns: self.columns.map(|column| column.map(&f)) }
    }
}

impl Matrix3<f64> {
    /// The identity.
    pub const IDENTITY: Self = Self::diagonal(1.0, 1.0, 1.0);
    /// The zero matrix.
    pub const ZERO: Self = Self::diagonal(0.0, 0.0, 0.0);

    /// A diagonal matrix.
    pub const fn diagonal(x: f64, y: f64, z: f64) -> Self {
        Self::from_columns(
            Vector3::new(x, 0.0, 0.0),
            Vector3::new(0.0, y, 0.0),
            Vector3::new(0.0, 0.0, z),
        )
    }

    /// The matrix with these rows.
    pub fn from_rows(rows: [[f64; 3]; 3]) -> Self {
        let [a, b, c] = rows;
        Self::from_columns(
            Vector3::new(a[0], b[0], c[0]),
            Vector3::new(a[1], b[1], c[1]),
            Vector3::new(a[2], b[2], c[2]),
        )
    }

    /// Rows as nested arrays.
    pub fn to_rows(self) -> [[f64; 3]; 3] {
        let [x, y, z] = self.columns;
        [[x.x, y.x, z.x], [x.y, y.y, z.y], [x.z, y.z, z.z]]
    }

    /// Entry in `row` and `column`.
    pub fn get(&self, row: usize, column: usize) -> f64 {
        self.columns[column].to_array()[row]
    }

    /// The matrix of the vector product: `skew(a) * b = a x b`.
    pub const fn skew(a: Vector3<f64>) -> Self {
        Self::from_columns(
            Vector3::new(0.0, a.z, -a.y),
            Vector3::new(-a.z, 0.0, a.x),
            Vector3::new(a.y, -a.x, 0.0),
        )
    }

    /// `a bᵀ`.
    pub fn outer(a: Vector3<f64>, b: Vector3<f64>) -> Self {
        Self::from_columns(a * b.x, a * b.y, a * b.z)
    }

    /// Multiplied by a number.
    pub fn scaled(self, factor: f64) -> Self {
        let [x, y, z] = self.columns;
        Self::from_columns(x * factor, y * factor, z * factor)
    }

    /// Rotation by `angle` about the unit vector `axis` (Rodrigues).
    pub fn rotation(axis: Vector3<f64>, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self::outer(axis, axis).scaled(1.0 - cos)
            + Self::skew(axis).scaled(sin)
            + Self::diagonal(cos, cos, cos)
    }

    /// Rotation about the fixed axes x, y, z in this order (URDF's roll, pitch, yaw).
    pub fn from_roll_pitch_yaw([roll, pitch, yaw]: [f64; 3]) -> Self {
        let x = Self::rotation(Vector3::new(1.0, 0.0, 0.0), roll);
        let y = Self::rotation(Vector3::new(0.0, 1.0, 0.0), pitch);
        let z = Self::rotation(Vector3::new(0.0, 0.0, 1.0), yaw);
        z * (y * x)
    }
}

impl<T: Real> Matrix3<T> {
    /// A constant matrix.
    #[inline(always)]
    pub fn splat(token: T::Token, m: &Matrix3<T::Constant>) -> Self {
        let [x, y, z] = m.columns;
        Self::from_columns(
            Vector3::splat(token, x),
            Vector3::splat(token, y),
            Vector3::splat(token, z),
        )
    }

    /// The zero matrix.
    #[inline(always)]
    pub fn zero(token: T::Token) -> Self {
        let zero = Vector3::zero(token);
        Self::from_columns(zero, zero, zero)
    }

    /// The transpose.
    #[inline(always)]
    pub fn transposed(self) -> Self {
        let [x, y, z] = self.columns;
        Self::from_columns(
            Vector3::new(x.x, y.x, z.x),
            Vector3::new(x.y, y.y, z.y),
            Vector3::new(x.z, y.z, z.z),
        )
    }

    /// `selfᵀ * v`: for a rotation, the components of `v` in the rotated frame.
    #[inline(always)]
    pub fn transpose_mul(&self, v: Vector3<T>) -> Vector3<T> {
        let [x, y, z] = self.columns;
        Vector3::new(x.dot(v), y.dot(v), z.dot(v))
    }

    /// `self * factor + c`.
    #[inline(always)]
    pub fn scale_add(self, factor: T, c: Self) -> Self {
        let ([x, y, z], [cx, cy, cz]) = (self.columns, c.columns);
        Self::from_columns(
            x.scale_add(factor, cx),
            y.scale_add(factor, cy),
            z.scale_add(factor, cz),
        )
    }

    /// `self - left * rightᵀ`.
    #[inline(always)]
    pub fn minus_outer(self, left: Vector3<T>, right: Vector3<T>) -> Self {
        let [x, y, z] = self.columns;
        Self::from_columns(
            left.scale_add(-right.x, x),
            left.scale_add(-right.y, y),
            left.scale_add(-right.z, z),
        )
    }

    /// `self * v + c`.
    #[inline(always)]
    pub fn mul_add(&self, v: Vector3<T>, c: Vector3<T>) -> Vector3<T> {
        let [x, y, z] = self.columns;
        x.scale_add(v.x, y.scale_add(v.y, z.scale_add(v.z, c)))
    }
}

impl<T: Real> Mul<Vector3<T>> for Matrix3<T> {
    type Output = Vector3<T>;
    #[inline(always)]
    fn mul(self, v: Vector3<T>) -> Vector3<T> {
        let [x, y, z] = self.columns;
        x.scale_add(v.x, y.scale_add(v.y, z * v.z))
    }
}

impl<T: Real> Mul for Matrix3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let [x, y, z] = b.columns;
        Self::from_columns(self * x, self * y, self * z)
    }
}

impl<T: Real> Add for Matrix3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.columns, b.columns);
        Self::from_columns(ax + bx, ay + by, az + bz)
    }
}
