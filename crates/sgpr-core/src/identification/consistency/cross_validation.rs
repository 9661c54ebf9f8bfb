//! How strong the pull toward the robot file is to be, from the data: with the strength that predicts kept-out parts best.
//!
//! Source: M. Stone, Cross-validatory choice and assessment of statistical predictions, J. R. Stat. Soc. B 36(2) (1974).

use super::{Consistency, Prior};
use crate::identification::least_squares::{residual_norm, stack};
use crate::identification::{BaseParameters, IdentificationError, JointFactor, ParameterSet};
use crate::robot::Robot;

/// Relative deviations of the robot file from which the data choose.
pub const DEVIATIONS: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];

/// An error this much above the least is as good as the least.
const SAME: f64 = 1.01;

/// The weakest pull that predicts as well as the best.
///
/// - `scores`: as [`Consistency::cross_validate`] gives them
pub fn weakest_good_deviation(scores: &[(f64, f64)]) -> Option<f64> {
    let least = scores.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
    let good = scores.iter().filter(|(_, error)| *error <= SAME * least).map(|(deviation, _)| *deviation);
    good.max_by(f64::total_cmp)
}

impl Consistency {
    /// The relative deviation of the prior with which each part of the data is predicted best from the others.
    ///
    /// - `folds`: factors of parts of the data
    /// - `noise`: noise level of the rows of a factor, N·m (N); infinite leaves them out
    /// - `nominal`, `torque`: as in [`Self::solve`]
    /// - returns per candidate of [`DEVIATIONS`] the root mean square error in units of the noise
    ///
    /// # Errors
    /// As [`Self::solve`]; [`IdentificationError::NoData`] with fewer than two parts.
    #[expect(clippy::too_many_arguments, reason = "what a program of consistent parameters is made of")]
    pub fn cross_validate(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        folds: &[Vec<JointFactor>],
        noise: impl Fn(&JointFactor) -> f64,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<Vec<(f64, f64)>, IdentificationError> {
        if folds.len() < 2 {
            return Err(IdentificationError::NoData);
        }
        let mut scores: Vec<(f64, f64)> = DEVIATIONS.iter().map(|deviation| (*deviation, 0.0)).collect();
        let mut rows = 0;
        for (index, fold) in folds.iter().enumerate() {
            let others = folds.iter().enumerate().filter(|(other, _)| *other != index);
            let others: Vec<JointFactor> = others.flat_map(|(_, factors)| factors.iter().cloned()).collect();
            let levels: Vec<f64> = others.iter().map(&noise).collect();
            let training = stack(&others, base.rank(), &levels);
            rows += fold.iter().filter(|factor| noise(factor).is_finite()).map(|factor| factor.rows).sum::<usize>();
            for (deviation, squares) in &mut scores {
                let prior = Prior { relative_deviation: *deviation, ..self.prior };
                let candidate = Self { prior, bounds: self.bounds.clone() };
                let found = candidate.solve(robot, set, base, &training, nominal, torque)?;
                let error = |factor: &JointFactor| (residual_norm(factor, &found.base) / noise(factor)).powi(2);
                *squares += fold.iter().map(error).sum::<f64>();
            }
        }
        scores.iter_mut().for_each(|(_, squares)| *squares = (*squares / rows.max(1) as f64).sqrt());
        Ok(scores)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_the_data_cannot_tell_the_pull_is_weak() {
        assert_eq!(weakest_good_deviation(&[(1.0, 2.0), (3.0, 1.0), (10.0, 1.005), (30.0, 1.02)]), Some(10.0));
        assert_eq!(weakest_good_deviation(&[(1.0, 0.5), (3.0, 0.6)]), Some(1.0));
        assert_eq!(weakest_good_deviation(&[]), None);
    }
}
