use core::ops::Mul;

use super::{Matrix3, Vector3};
use crate::simd::Real;

/// Where a frame B sits in a frame A, `X_AB`: a point with components `p` in B has components
/// `rotation * p + translation` in A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<T = f64> {
    /// Axes of B as columns, in A.
    pub rotation: Matrix3<T>,
    /// Origin of B in A, m.
    pub translation: Vector3<T>,
}

impl Pose<f64> {
    /// B equals A.
    pub const IDENTITY: Self = Self { rotation: Matrix3::IDENTITY, translation: Vector3::ZERO };

    /// A pure translation.
    pub const fn from_translation(translation: Vector3<f64>) -> Self {
        Self::new(Matrix3::IDENTITY, translation)
    }

    /// A pure rotation.
    pub const fn from_rotation(rotation: Matrix3<f64>) -> Self {
        Self::new(rotation, Vector3::ZERO)
    }

    /// `X_BA`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transposed();
        Self::new(rotation, -(rotation * self.translation))
    }

    /// Homogeneous 4 x 4 matrix, row-major.
    pub fn to_matrix4(&self) -> [[f64; 4]; 4] {
        let [a, b, c] = self.rotation.to_rows();
        let t = self.translation;
        [
            [a[0], a[1], a[2], t.x],
            [b[0], b[1], b[2], t.y],
            [c[0], c[1], c[2], t.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    }
}

impl<T> Pose<T> {
    /// The pose with these parts.
    pub const fn new(rotation: Matrix3<T>, translation: Vector3<T>) -> Self {
        Self { rotation, translation }
    }
}

impl<T: Real> Pose<T> {
    /// Components in A of the point with components `p` in B.
    pub fn transform_point(&self, p: Vector3<T>) -> Vector3<T> {
        self.rotation * p + self.translation
    }
}

impl<T: Real> Mul for Pose<T> {
    type Output = Self;

    /// `X_AB * X_BC = X_AC`.
    fn mul(self, other: Self) -> Self {
        Self::new(self.rotation * other.rotation, self.transform_point(other.translation))
    }
}
