//! One door to all estimators.

use super::autocorrelation::Memory;
use super::groups::memories;
use super::{Equations, Estimate, IdentificationError, JointFactor, LeastSquares, Method};
use super::{instrumental_variables, output_error, recursive, ridge, robust, total_least_squares};

/// Estimates the base parameters by any method.
///
/// - `factors`: those of the equations, [`Equations::factors`]; methods that do not look at single rows need nothing else
/// - `nominal`: base parameters of the robot file, `[rank]`; directions that the data do not determine stay there
/// - `correlation`: per factor, rows that carry as much as one independent row, as [`residual_correlation`] finds
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
    let start = LeastSquares { method: method.clone(), correlation: correlation.map(<[f64]>::to_vec) };
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
        Method::Ols | Method::Wls | Method::WlsKnown(_) => Ok(start),
        Method::Irls { threshold } => robust::estimate(threshold, equations, factors, start, nominal),
        Method::Ridge { relative_deviation } => ridge::estimate(relative_deviation, equations, factors, start, nominal),
        Method::TotalLeastSquares { relative_noise } => {
            total_least_squares::estimate(relative_noise, factors, start, nominal)
        }
        Method::InstrumentalVariables => instrumental_variables::estimate(equations, factors, start, nominal),
        Method::OutputError => output_error::estimate(equations, start, nominal, correlation),
        Method::Recursive { forgetting } => recursive::estimate(forgetting, equations, factors, start, nominal),
    }
}

/// Per factor: how many rows carry as much as one independent row, from the autocorrelation of the residual that `base`
/// leaves.
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
