//! Instrumental variables: the normal equations Zᵀ W base = Zᵀ tau with rows Z that share no noise
//! with W.
//!
//! Source: A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for
//! industrial robot identification, IEEE T-CST 22(1) (2014), section III.
//!
//! The residual holds the noise of the positions, differentiated twice: it changes sign from row to
//! row, and smooth instruments average it out. A variance per row would not know that, so the
//! covariance is that of the sum of instrument * residual, its spectrum at frequency zero, as in
//! [`hac_covariance`](super::hac_covariance).

use faer::Mat;

use super::estimator::{Estimator, EstimatorNeeds, EstimatorTask};
use super::groups::Groups;
use super::hac::{RowsOf, score_covariance};
use super::least_squares::Directions;
use super::{Equations, Estimate, IdentificationError, JointFactor, Trajectory, output_error};
use crate::linalg::solve_general;

/// Sums over the rows of a factor.
struct InstrumentProducts {
    /// Zᵀ W, `[columns, columns]`.
    with_rows: Mat<f64>,
    /// Zᵀ residual, `[columns]`.
    with_residual: Vec<f64>,
}

/// Instrumental variables: consistent also when the observation matrix has noise, given the motion
/// without noise, from a simulation or the reference ([`Trajectory::instruments`]).
pub static INSTRUMENTAL_VARIABLES: Estimator = Estimator {
    needs: EstimatorNeeds::Instruments,
    reweights: true,
    counts_memory: true,
    ..Estimator::new("iv", "weighted instrumental variables", estimate)
};

fn estimate(task: EstimatorTask<'_, '_>, start: Estimate) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { equations, factors, nominal, .. } = task;
    if equations
        .trajectories()
        .iter()
        .any(|trajectory| trajectory.instruments.is_none() && trajectory.closed_loop.is_some())
    {
        return simulated(equations, factors, start, nominal);
    }
    let directions = Directions::of(&start.whitened);
    let group = Groups::of(factors);
    // The second round is a step of iterative refinement: its residual has the digits that the
    // first sum lost.
    let mut values = nominal.to_vec();
    let mut projected = Mat::<f64>::zeros(0, 0);
    for _ in 0..2 {
        let mut products: Vec<InstrumentProducts> =
            factors.iter().map(|factor| InstrumentProducts::new(factor.columns.len())).collect();
        equations.for_each_with_instruments(|equation, instrument| {
            if let Some(index) = group.index(&equation) {
                products[index].add(equation.row, instrument, equation.residual(&values));
            }
        })?;
        let size = nominal.len();
        let mut left = Mat::<f64>::zeros(size, size);
        let mut right = Mat::<f64>::zeros(size, 1);
        for (index, (factor, products)) in factors.iter().zip(&products).enumerate() {
            let weight = start.weights[index].powi(-2);
            if weight == 0.0 {
                continue;
            }
            for (a, &i) in factor.columns.iter().enumerate() {
                right[(i, 0)] += weight * products.with_residual[a];
                for (b, &j) in factor.columns.iter().enumerate() {
                    left[(i, j)] += weight * products.with_rows[(a, b)];
                }
            }
        }
        let basis = &directions.basis;
        projected = basis.transpose() * left * basis;
        let right = basis.transpose() * right;
        let step = solve_general(&projected, &right).ok_or(IdentificationError::WeakInstruments)?;
        directions
            .advance(&mut values, &(0..directions.len()).map(|k| step[(k, 0)]).collect::<Vec<_>>());
    }
    let found = Estimate { values, ..start };
    let scores =
        score_covariance(equations, factors, &found, &directions, RowsOf::Instruments, None)?;
    // (Zᵀ W)⁻¹ S (Zᵀ W)⁻ᵀ, all rows in units of the noise.
    let projected = faer::Scale(found.unit.powi(-2)) * projected;
    let half = solve_general(&projected, &scores).ok_or(IdentificationError::WeakInstruments)?;
    let full = solve_general(&projected, &half.transpose().to_owned())
        .ok_or(IdentificationError::WeakInstruments)?;
    Ok(Estimate { covariance: directions.covariance(&full).into(), ..found })
}

/// Instruments from the arm simulated with the first estimate.
fn simulated(
    equations: &Equations<'_>,
    factors: &[JointFactor],
    start: Estimate,
    nominal: &[f64],
) -> Result<Estimate, IdentificationError> {
    let motions = match output_error::simulate(equations, &start.values) {
        Err(IdentificationError::Diverged { .. }) => output_error::simulate(equations, nominal)?,
        result => result?,
    };
    let trajectories = equations.trajectories().iter().zip(&motions).map(|(trajectory, motion)| {
        Trajectory { instruments: trajectory.instruments.or(Some(motion.samples())), ..*trajectory }
    });
    let (robot, set, base) = (equations.robot(), equations.parameter_set(), equations.base());
    let equations = &mut Equations::new(robot, set, base, trajectories.collect());
    estimate(EstimatorTask { setting: 0.0, equations, factors, nominal, correlation: None }, start)
}

impl InstrumentProducts {
    fn new(columns: usize) -> Self {
        Self { with_rows: Mat::zeros(columns, columns), with_residual: vec![0.0; columns] }
    }

    fn add(&mut self, row: &[f64], instrument: &[f64], residual: f64) {
        let columns = self.with_residual.len();
        for b in 0..columns {
            for (a, z) in instrument[..columns].iter().enumerate() {
                self.with_rows[(a, b)] += z * row[b];
            }
        }
        self.with_residual.iter_mut().zip(instrument).for_each(|(sum, z)| *sum += z * residual);
    }
}
