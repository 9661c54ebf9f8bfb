//! How far the torque of a model may be off because its parameters are: the delta method.
//!
//! The torque is linear in base parameters and linear parameters of terms; constants of terms enter
//! by the derivative of the torque. Its variance is x' C x with the row x of all these derivatives
//! and the covariance C of all these estimates.

use super::variable_projection::{gains, own_joint, take_gains, tangent};
use super::{TorqueModel, Trajectory};
use crate::dynamics::Samples;
use crate::effects::Scale;
use crate::identification::{self, Equations, IdentificationError};
use crate::motion::Motion;

/// A derivative of the torque.
struct Derivative {
    /// Joint whose torque it is, all if `None`.
    joint: Option<usize>,
    /// `[samples]` for one joint, `[samples, n]` for all.
    values: Vec<f64>,
}

impl TorqueModel {
    /// Standard deviation of the predicted torque that the uncertainty of the parameters makes,
    /// without the noise of a single torque ([`Fit::noise`](super::Fit::noise)).
    ///
    /// Effects that need time or a sampling rate are left out: see
    /// [`Self::standard_deviation_along`].
    ///
    /// - returns `[samples, n]`, N·m (N); infinite where a parameter enters that the data did not
    ///   determine; zero for a model that was not identified
    ///
    /// # Errors
    /// If a sample has a motion that no arm makes, whose torque has no square.
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn standard_deviation(
        &self,
        samples: Samples<'_>,
    ) -> Result<Vec<f64>, IdentificationError> {
        self.standard_deviation_along(&Trajectory::of_samples(samples))
    }

    /// The same along a processed stretch of a log.
    ///
    /// # Errors
    /// As [`Self::standard_deviation`].
    pub fn standard_deviation_of(&self, motion: &Motion) -> Result<Vec<f64>, IdentificationError> {
        self.standard_deviation_along(&Trajectory::of(motion, &self.time_of(motion)))
    }

    /// The same along a trajectory, terms included if their estimates have a covariance.
    ///
    /// # Errors
    /// As [`Self::standard_deviation`].
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn standard_deviation_along(
        &self,
        trajectory: &Trajectory<'_>,
    ) -> Result<Vec<f64>, IdentificationError> {
        let n = self.robot.dof();
        let samples = trajectory.samples;
        let zeros = vec![0.0; samples.count(n) * n];
        let Some(fit) = &self.fit else { return Ok(zeros) };
        let rank = self.base.rank();
        let with_terms = &fit.covariance_with_terms;
        let (covariance, width) = if with_terms.is_empty() {
            (&fit.covariance, rank)
        } else {
            (with_terms, with_terms.len().isqrt())
        };
        let gains = &gains(self)[..];
        let derivatives =
            if width == rank { vec![] } else { self.derivatives_by_terms(trajectory, gains) };
        debug_assert_eq!(rank + derivatives.len(), width, "a derivative for every estimate");
        let mut deviations = vec![0.0; zeros.len()];
        let rows = identification::Trajectory {
            gains,
            ..identification::Trajectory::new(samples, &zeros)
        };
        let mut equations = Equations::new(&self.robot, &self.set, &self.base, vec![rows]);
        let mut row: Vec<(usize, f64)> = Vec::with_capacity(width);
        equations.for_each(|equation| {
            let of_terms =
                derivatives.iter().zip(rank..).map(|(derivative, column)| match derivative.joint {
                    None => (column, derivative.values[equation.sample * n + equation.joint]),
                    Some(joint) if joint == equation.joint => {
                        (column, derivative.values[equation.sample])
                    }
                    Some(_) => (column, 0.0),
                });
            let of_base = equation.columns.iter().copied().zip(equation.row.iter().copied());
            row.clear();
            row.extend(of_base.chain(of_terms).filter(|(_, factor)| *factor != 0.0));
            let mut variance = 0.0;
            for (i, a) in &row {
                for (j, b) in &row {
                    variance += a * b * covariance[i * width + j];
                }
            }
            deviations[equation.sample * n + equation.joint] = variance.max(0.0).sqrt();
        })?;
        Ok(deviations)
    }

    /// Derivatives by the linear parameters of all terms, then by their constants.
    ///
    /// - `gains`: `[n]`, as [`identification::Trajectory::gains`]
    fn derivatives_by_terms(&self, trajectory: &Trajectory<'_>, gains: &[f64]) -> Vec<Derivative> {
        let rigid = self.rigid(trajectory);
        let context = self.context(trajectory, &rigid);
        let joint_of = |term: &super::Term| own_joint(term).filter(|_| !term.is_transform());
        let mut derivatives = Vec::new();
        for term in &self.terms {
            let as_logged = |mut values: Vec<f64>| {
                take_gains(gains, joint_of(term), &mut values);
                Derivative { joint: joint_of(term), values }
            };
            derivatives.extend(term.columns(&context).into_iter().map(as_logged));
        }
        for (index, term) in self.terms.iter().enumerate() {
            for (k, constant) in term.effect.constants().iter().enumerate() {
                // Limits in shares of the logs' ranges hold for those logs.
                let bounds = match constant.scale {
                    Scale::Position | Scale::PositionWidth | Scale::Torque | Scale::Time => {
                        [f64::NEG_INFINITY, f64::INFINITY]
                    }
                    _ => [constant.low, constant.high],
                };
                let values = tangent(self, trajectory, &rigid, (index, k), bounds);
                derivatives.push(Derivative { joint: joint_of(term), values });
            }
        }
        derivatives
    }
}
