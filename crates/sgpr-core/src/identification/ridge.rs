//! Least squares with a normal prior around the robot file.
//!
//! The robot file knows the bodies and says nothing of friction, rotors and offsets: what it does
//! not know is not pulled.

use faer::Mat;

use super::estimator::{Estimator, EstimatorNeeds, EstimatorSetting, EstimatorTask};
use super::least_squares::{Solution, torque_sizes};
use super::parameter_scales::parameter_scales;
use super::{Estimate, IdentificationError};
use crate::linalg::{cholesky, triangle};

/// Standard deviation, in units of their expected size, of parameters of which the robot file says
/// nothing: the pull on them is a millionth of a millionth of what it would be.
const UNKNOWN: f64 = 1e6;

/// Weighted least squares pulled toward the robot file: a normal prior on all standard parameters,
/// those of a link in the units of its mass and size. Setting: standard deviation of the robot
/// file's values as a share of them.
pub static RIDGE: Estimator = Estimator {
    setting: EstimatorSetting::new("RELATIVE_DEVIATION", 1.0),
    needs: EstimatorNeeds::Factors,
    reweights: true,
    has_prior: true,
    ..Estimator::new("ridge", "weighted least squares with a pull toward the robot file", estimate)
};

/// The prior makes all standard parameters independent, with deviations in the units of their link,
/// so the base parameters have the covariance B D Bᵀ; its inverse root stands below the data as
/// more rows.
fn estimate(task: EstimatorTask<'_, '_>, start: Estimate) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { setting: relative_deviation, equations, factors, nominal, .. } = task;
    super::check_prior_deviation(relative_deviation)?;
    let (base, unknowns) = (equations.base(), nominal.len());
    let set = equations.parameter_set();
    let torque = torque_sizes(factors, equations.robot().dof());
    let mut standard = equations.robot().standard_parameters();
    standard.resize(set.len(), 0.0);
    let mut scale = parameter_scales(set, &standard, &torque);
    for parameter in set.inertial()..set.len() {
        let own = base.independent().iter().position(|kept| *kept == parameter);
        if own.is_none_or(|own| nominal[own] == 0.0) {
            scale[parameter] *= UNKNOWN / relative_deviation;
        }
    }
    let combination = base.matrix();
    let width = scale.len();
    let covariance = Mat::from_fn(unknowns, unknowns, |i, j| {
        let product =
            |k: usize| combination[i * width + k] * combination[j * width + k] * scale[k].powi(2);
        relative_deviation.powi(2) * (0..width).map(product).sum::<f64>()
    });
    // Scaled to a unit diagonal, so that units do not spoil the factor.
    let size: Vec<f64> = (0..unknowns).map(|k| covariance[(k, k)].sqrt()).collect();
    let scaled = Mat::from_fn(unknowns, unknowns, |i, j| covariance[(i, j)] / (size[i] * size[j]));
    // RᵀR = scaled, so the rows are R⁻ᵀ.
    let root = cholesky(scaled.as_ref()).ok_or(IdentificationError::PullWithoutScale)?;
    let mut rows = Mat::<f64>::identity(unknowns, unknowns);
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(
        root.transpose(),
        rows.as_mut(),
        faer::Par::Seq,
    );
    let all =
        Mat::from_fn(2 * unknowns + 1, unknowns + 1, |i, j| match i.checked_sub(unknowns + 1) {
            None => start.whitened[(i, j)],
            Some(i) if j < unknowns => rows[(i, j)] / size[j],
            Some(i) => (0..=i).map(|k| rows[(i, k)] / size[k] * nominal[k]).sum(),
        });
    let system = triangle(all.as_ref());
    let solution = Solution::new(&system, nominal);
    Ok(Estimate { covariance: solution.inverse.clone().into(), values: solution.values, ..start })
}
