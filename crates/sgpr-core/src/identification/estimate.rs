//! One door to all estimators.

use super::autocorrelation::Memory;
use super::estimator::EstimatorTask;
use super::groups::memories;
use super::{Equations, Estimate, IdentificationError, JointFactor, LeastSquares, Method};

/// Estimates the base parameters by any method.
///
/// - `factors`: those of the equations, [`Equations::factors`]; methods that do not look at single
///   rows need nothing else
/// - `nominal`: base parameters of the robot file, `[rank]`; directions that the data do not
///   determine stay there
/// - `correlation`: per factor, rows that carry as much as one independent row, as
///   [`residual_correlation`] finds
///
/// # Errors
/// If there are too few rows, a setting of the method makes no sense, or instruments are missing.
///
/// # Panics
/// If `nominal` is not of length `rank`.
pub fn estimate(
    method: &Method,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    nominal: &[f64],
    correlation: Option<&[f64]>,
) -> Result<Estimate, IdentificationError> {
    let start =
        LeastSquares { method: method.clone(), correlation: correlation.map(<[f64]>::to_vec) };
    let start = start.solve(factors, equations.base(), nominal)?;
    from_start(method, equations, factors, start, nominal, correlation)
}

/// The same from an estimate by least squares.
pub(super) fn from_start(
    method: &Method,
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    start: Estimate,
    nominal: &[f64],
    correlation: Option<&[f64]>,
) -> Result<Estimate, IdentificationError> {
    match *method {
        Method::By(estimator, setting) => (estimator.run)(
            EstimatorTask { setting, equations, factors, nominal, correlation },
            start,
        ),
        _ => Ok(start),
    }
}

/// Per factor: how many rows carry as much as one independent row, from the autocorrelation of the
/// residual that `base` leaves.
///
/// # Errors
/// As [`Equations::for_each`].
pub fn residual_correlation(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    base: &[f64],
) -> Result<Vec<f64>, IdentificationError> {
    let memories = memories(equations, factors, base)?;
    Ok(memories.into_iter().map(Memory::rows_per_independent_row).collect())
}
