//! What the data say of limits and of the pull toward the robot file: parts of them are predicted
//! from the others.
//!
//! Source: M. Stone, Cross-validatory choice and assessment of statistical predictions, J. R. Stat.
//! Soc. B 36(2) (1974).

use serde::{Deserialize, Serialize};

use super::{Consistency, Prior};
use crate::identification::least_squares::{Solution, residual_norm};
use crate::identification::left_out::Split;
use crate::identification::{BaseParameters, IdentificationError, LeftOut, ParameterSet};
use crate::robot::Robot;

/// Relative deviations of the robot file from which the data choose.
pub const DEVIATIONS: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];

/// An error this much above the least is as good as the least.
const SAME: f64 = 1.01;

/// Errors on parts of the data that were kept out of the fit, percent of the torque of the rows in
/// motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct KeptOut {
    /// Of least squares without limits.
    pub unconstrained_percent: f64,
    /// Of consistent parameters.
    pub consistent_percent: f64,
}

/// The weakest pull that predicts as well as the best.
///
/// - `scores`: as [`Consistency::cross_validate`] gives them
pub fn weakest_good_deviation(scores: &[(f64, f64)]) -> Option<f64> {
    let least = scores.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
    let good =
        scores.iter().filter(|(_, error)| *error <= SAME * least).map(|(deviation, _)| *deviation);
    good.max_by(f64::total_cmp)
}

impl Consistency {
    /// The relative deviation of the prior with which each part of the data is predicted best from
    /// the others.
    ///
    /// - `parts`: parts of the data, with the noise level of their rows
    /// - `nominal`, `torque`: as in [`Self::solve`]
    /// - returns per candidate of [`DEVIATIONS`] the root mean square error in units of the noise
    ///
    /// # Errors
    /// As [`Self::solve`]; [`IdentificationError::NoData`] with fewer than two parts.
    pub fn cross_validate(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        parts: &LeftOut<'_>,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<Vec<(f64, f64)>, IdentificationError> {
        let mut scores: Vec<(f64, f64)> =
            DEVIATIONS.iter().map(|deviation| (*deviation, 0.0)).collect();
        let mut rows = 0;
        for Split { others, part } in parts.splits()? {
            let used = part.iter().filter(|(_, noise)| noise.is_finite());
            rows += used.map(|(factor, _)| factor.rows).sum::<usize>();
            for (deviation, squares) in &mut scores {
                let prior = Prior { relative_deviation: *deviation, ..self.prior };
                let candidate = Self { prior, bounds: self.bounds.clone() };
                let found = candidate.solve(robot, set, base, &others, nominal, torque)?;
                let errors = part
                    .iter()
                    .map(|(factor, noise)| (residual_norm(factor, &found.base) / noise).powi(2));
                *squares += errors.sum::<f64>();
            }
        }
        scores
            .iter_mut()
            .for_each(|(_, squares)| *squares = (*squares / rows.max(1) as f64).sqrt());
        Ok(scores)
    }

    /// What the limits do where the motion is new: each part of the data predicted from the others,
    /// with them and without.
    ///
    /// Arguments as in [`Self::cross_validate`].
    ///
    /// # Errors
    /// As [`Self::cross_validate`].
    pub fn kept_out(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        parts: &LeftOut<'_>,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<KeptOut, IdentificationError> {
        let rest = base.combine(nominal);
        let [mut unconstrained, mut consistent, mut whole] = [0.0; 3];
        for Split { others, part } in parts.splits()? {
            let squares = |values: &[f64]| -> f64 {
                let moving = part.iter().filter(|(factor, _)| !factor.resting);
                moving.map(|(factor, _)| residual_norm(factor, values).powi(2)).sum()
            };
            unconstrained += squares(&Solution::new(&others, &rest).values);
            consistent += squares(&self.solve(robot, set, base, &others, nominal, torque)?.base);
            whole += squares(&vec![0.0; base.rank()]);
        }
        let percent = |squares: f64| 100.0 * (squares / whole.max(f64::MIN_POSITIVE)).sqrt();
        Ok(KeptOut {
            unconstrained_percent: percent(unconstrained),
            consistent_percent: percent(consistent),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_the_data_cannot_tell_the_pull_is_weak() {
        assert_eq!(
            weakest_good_deviation(&[(1.0, 2.0), (3.0, 1.0), (10.0, 1.005), (30.0, 1.02)]),
            Some(10.0)
        );
        assert_eq!(weakest_good_deviation(&[(1.0, 0.5), (3.0, 0.6)]), Some(1.0));
        assert_eq!(weakest_good_deviation(&[]), None);
    }
}
