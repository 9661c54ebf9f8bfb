//! Units in which the parameters of an arm are of order one.

use super::ParameterSet;
use crate::spatial::{LinkInertia, PARAMETERS_PER_LINK};

/// Size of a link of which the robot file says nothing, m.
pub(super) const LINK_SIZE: f64 = 0.1;

pub(super) fn nominal_links<'a>(
    parameters: &'a [f64],
    set: &ParameterSet,
) -> impl Iterator<Item = LinkInertia> + 'a {
    parameters[..set.inertial()].as_chunks().0.iter().map(LinkInertia::from_standard_parameters)
}

/// Mass and length in whose units the parameters of a link are of order one.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkSize {
    pub mass: f64,
    pub length: f64,
}

impl LinkSize {
    pub fn of(nominal: LinkInertia) -> Self {
        let trace: f64 = (0..3).map(|axis| nominal.pseudo_inertia()[axis][axis]).sum();
        let mass = if nominal.mass > 1e-3 { nominal.mass } else { 1.0 };
        let length = (trace / mass).sqrt();
        let length =
            if length.is_finite() && length > 0.0 { length.clamp(0.02, 2.0) } else { LINK_SIZE };
        Self { mass, length }
    }

    /// Units of the ten parameters.
    pub fn scales(&self) -> [f64; PARAMETERS_PER_LINK] {
        let Self { mass, length } = *self;
        std::array::from_fn(|k| match k {
            0 => mass,
            1..4 => mass * length,
            _ => mass * length * length,
        })
    }

    pub fn scaled(&self, link: &LinkInertia) -> nalgebra::Matrix4<f64> {
        let rows = link.pseudo_inertia();
        let unit = |axis: usize| if axis < 3 { self.length } else { 1.0 };
        nalgebra::Matrix4::from_fn(|row, column| {
            rows[row][column] / (self.mass * unit(row) * unit(column))
        })
    }

    /// The scaled pseudo-inertia, with eigenvalues raised to where a body has them, and whether
    /// that was needed.
    pub fn definite(&self, link: &LinkInertia) -> (nalgebra::Matrix4<f64>, bool) {
        const THINNEST: f64 = 1e-3;
        let matrix = self.scaled(link);
        let eigen = matrix.symmetric_eigen();
        if eigen.eigenvalues.min() >= THINNEST {
            return (matrix, false);
        }
        // A slender rod is a body, and raising its thin directions is no news.
        let mended = eigen.eigenvalues.min() < -1e-9;
        let raised =
            nalgebra::Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(THINNEST)));
        (eigen.eigenvectors * raised * eigen.eigenvectors.transpose(), mended)
    }
}

/// Units in which all parameters are of order one.
pub(super) fn parameter_scales(set: &ParameterSet, nominal: &[f64], torque: &[f64]) -> Vec<f64> {
    let mut scales: Vec<f64> =
        nominal_links(nominal, set).flat_map(|link| LinkSize::of(link).scales()).collect();
    let of_state = set.effect_columns().iter().map(|column| 0.1 * torque[column.joint]);
    let largest = torque.iter().copied().fold(0.0, f64::max);
    let of_trajectory = set
        .trajectory_columns()
        .iter()
        .map(|column| 0.1 * column.joint.map_or(largest, |joint| torque[joint]) / column.size);
    for (offset, usual) in of_state.chain(of_trajectory).enumerate() {
        let scale = nominal[set.inertial() + offset].abs().max(usual);
        scales.push(if scale > 0.0 && scale.is_finite() { scale } else { 1.0 });
    }
    scales
}
