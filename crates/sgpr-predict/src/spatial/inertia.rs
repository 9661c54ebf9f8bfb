use core::ops::Add;

use super::{Matrix3, Pose, Vector3};
use crate::simd::Real;

/// Standard parameters per link.
pub const PARAMETERS_PER_LINK: usize = 10;

/// Names of a link's standard parameters, in the order of every array of this crate.
pub const STANDARD_PARAMETER_NAMES: [&str; PARAMETERS_PER_LINK] =
    ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];

/// Their units.
pub const STANDARD_PARAMETER_UNITS: [&str; PARAMETERS_PER_LINK] =
    ["kg", "kg·m", "kg·m", "kg·m", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²", "kg·m²"];

/// Inertia of one link as it enters the torque linearly: about the origin of the link frame, in its
/// axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkInertia<T = f64> {
    /// Mass, kg.
    pub mass: T,
    /// Mass times centre of mass, kg·m.
    pub first_moment: Vector3<T>,
    /// Rotational inertia about the frame origin, kg·m²; symmetric.
    pub inertia: Matrix3<T>,
}

impl<T: Real> LinkInertia<T> {
    /// A constant inertia.
    #[inline(always)]
    pub(crate) fn splat(token: T::Token, link: &LinkInertia<T::Constant>) -> Self {
        Self {
            mass: T::splat(token, link.mass),
            first_moment: Vector3::splat(token, link.first_moment),
            inertia: Matrix3::splat(token, &link.inertia),
        }
    }
}

impl LinkInertia {
    /// No inertia at all.
    pub const ZERO: Self = Self { mass: 0.0, first_moment: Vector3::ZERO, inertia: Matrix3::ZERO };

    /// From mass, centre of mass (m) and inertia about the centre of mass (kg·m²), all in the link
    /// frame's axes.
    pub fn from_centre_of_mass(
        mass: f64,
        centre: Vector3<f64>,
        inertia_at_centre: Matrix3<f64>,
    ) -> Self {
        Self {
            mass,
            first_moment: centre * mass,
            inertia: inertia_at_centre + steiner(mass, centre),
        }
    }

    /// From the ten standard parameters m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    pub fn from_standard_parameters(p: &[f64; PARAMETERS_PER_LINK]) -> Self {
        Self {
            mass: p[0],
            first_moment: Vector3::new(p[1], p[2], p[3]),
            inertia: Matrix3::from_rows([
                [p[4], p[5], p[7]],
                [p[5], p[6], p[8]],
                [p[7], p[8], p[9]],
            ]),
        }
    }

    /// The ten standard parameters.
    pub fn standard_parameters(&self) -> [f64; PARAMETERS_PER_LINK] {
        let h = self.first_moment;
        let i = |row, column| self.inertia.get(row, column);
        [self.mass, h.x, h.y, h.z, i(0, 0), i(0, 1), i(1, 1), i(0, 2), i(1, 2), i(2, 2)]
    }

    /// Centre of mass, m; the origin for a body without mass.
    pub fn centre_of_mass(&self) -> Vector3<f64> {
        if self.mass == 0.0 { Vector3::ZERO } else { self.first_moment * (1.0 / self.mass) }
    }

    /// Inertia about the centre of mass, kg·m², in the link frame's axes.
    pub fn inertia_at_centre(&self) -> Matrix3<f64> {
        self.inertia + steiner(-self.mass, self.centre_of_mass())
    }

    /// The same body expressed in frame A, given `X_AB` and the body in B.
    pub fn expressed_in(&self, x_ab: &Pose) -> Self {
        let rotation = x_ab.rotation;
        let centre = x_ab.transform_point(self.centre_of_mass());
        let turned = rotation * (self.inertia_at_centre() * rotation.transposed());
        if self.mass != 0.0 {
            return Self::from_centre_of_mass(self.mass, centre, turned);
        }
        // A first moment without mass does not belong to a body, but identified parameters may have
        // one: the transformation of the parameters is linear, and this is its general form.
        let h = rotation * self.first_moment;
        let t = x_ab.translation;
        let hat = |a, b| Matrix3::skew(a) * Matrix3::skew(b);
        let cross = hat(h, t) + hat(t, h);
        Self {
            mass: 0.0,
            first_moment: h,
            inertia: rotation * (self.inertia * rotation.transposed()) + cross.scaled(-1.0),
        }
    }

    /// The 4 x 4 pseudo-inertia matrix `[[S, h], [hᵀ, m]]` with S = tr(I)/2 1 - I, row-major; the
    /// parameters belong to a real body if and only if it is positive semidefinite.
    ///
    /// Source: P. M. Wensing, S. Kim, J.-J. Slotine, Linear matrix inequalities for physically
    /// consistent inertial parameter identification, IEEE RA-L 3(1) (2018), eq. 14.
    pub fn pseudo_inertia(&self) -> [[f64; 4]; 4] {
        let half_trace =
            0.5 * (self.inertia.get(0, 0) + self.inertia.get(1, 1) + self.inertia.get(2, 2));
        let h = self.first_moment.to_array();
        let mut matrix = [[0.0; 4]; 4];
        for row in 0..3 {
            for column in 0..3 {
                matrix[row][column] = -self.inertia.get(row, column);
            }
            matrix[row][row] += half_trace;
            matrix[row][3] = h[row];
            matrix[3][row] = h[row];
        }
        matrix[3][3] = self.mass;
        matrix
    }

    #[cfg(feature = "files")]
    /// Smallest eigenvalue of [`Self::pseudo_inertia`]; negative for parameters that no real body
    /// has.
    pub fn smallest_pseudo_inertia_eigenvalue(&self) -> f64 {
        let rows = self.pseudo_inertia();
        let matrix = nalgebra::Matrix4::from_fn(|row, column| rows[row][column]);
        matrix.symmetric_eigenvalues().min()
    }
}

impl LinkInertia {
    /// What is left when a part is taken off.
    #[must_use]
    pub fn minus(self, part: Self) -> Self {
        Self {
            mass: self.mass - part.mass,
            first_moment: self.first_moment - part.first_moment,
            inertia: self.inertia + part.inertia.scaled(-1.0),
        }
    }
}

impl Add for LinkInertia {
    type Output = Self;

    /// Both bodies rigidly joined.
    fn add(self, other: Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            first_moment: self.first_moment + other.first_moment,
            inertia: self.inertia + other.inertia,
        }
    }
}

/// Inertia about the origin of a point mass at `centre`: m (cᵀc 1 - c cᵀ).
fn steiner(mass: f64, centre: Vector3<f64>) -> Matrix3<f64> {
    let square = centre.dot(centre) * mass;
    Matrix3::diagonal(square, square, square) + Matrix3::outer(centre, centre).scaled(-mass)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: [f64; 10] = [2.0, 0.3, -0.2, 0.5, 0.6, 0.01, 0.7, -0.02, 0.03, 0.4];

    fn pose() -> Pose {
        Pose::new(Matrix3::from_roll_pitch_yaw([0.3, -0.7, 1.1]), Vector3::new(0.2, -0.5, 0.9))
    }

    #[test]
    fn moving_a_body_there_and_back_changes_nothing() {
        let body = LinkInertia::from_standard_parameters(&PARAMETERS);
        let back = body.expressed_in(&pose()).expressed_in(&pose().inverse());
        for (a, b) in back.standard_parameters().iter().zip(PARAMETERS) {
            assert!((a - b).abs() < 1e-14, "{a} {b}");
        }
    }

    #[test]
    fn moving_is_linear_in_the_parameters_with_and_without_mass() {
        // The massless and the massive branch must be parts of one linear map.
        let whole = LinkInertia::from_standard_parameters(&PARAMETERS);
        let mut without_mass = PARAMETERS;
        without_mass[0] = 0.0;
        let part = LinkInertia::from_standard_parameters(&without_mass);
        let mass = LinkInertia::from_standard_parameters(&[
            2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ]);
        let sum = part.expressed_in(&pose()) + mass.expressed_in(&pose());
        let expected = whole.expressed_in(&pose()).standard_parameters();
        for (a, b) in sum.standard_parameters().iter().zip(expected) {
            assert!((a - b).abs() < 1e-14, "{a} {b}");
        }
    }

    #[cfg(feature = "files")]
    #[test]
    fn the_pseudo_inertia_of_a_point_mass_is_its_moment_matrix() {
        // For a point mass S = m c cᵀ, so the matrix is m [c; 1][c; 1]ᵀ, of rank one.
        let centre = Vector3::new(0.1, -0.4, 0.3);
        let body = LinkInertia::from_centre_of_mass(1.5, centre, Matrix3::ZERO);
        let c = [0.1, -0.4, 0.3, 1.0];
        for (row, values) in body.pseudo_inertia().iter().enumerate() {
            for (column, value) in values.iter().enumerate() {
                assert!((value - 1.5 * c[row] * c[column]).abs() < 1e-15);
            }
        }
        assert!(body.smallest_pseudo_inertia_eigenvalue().abs() < 1e-15);
    }
}
