//! Instrumental variables: the normal equations Zᵀ W base = Zᵀ tau with rows Z that share no noise with W.
//!
//! Source: A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for industrial robot
//! identification, IEEE T-CST 22(1) (2014), section III.
//!
//! The residual holds the noise of the positions, differentiated twice: it changes sign from row to row, and smooth
//! instruments average it out. A variance per row would not know that, so the covariance is that of the sums of
//! instrument * residual over windows of time, as in [`hac_covariance`](super::hac_covariance) but with the lag weights of
//! E. Parzen, Mathematical considerations in the estimation of spectra, Technometrics 3(2) (1961).

use faer::Mat;

use super::estimate::Groups;
use super::hac::NoiseMemory;
use super::least_squares::Directions;
use super::{Equations, Estimate, IdentificationError, JointFactor, Trajectory, output_error};
use crate::linalg::solve_general;

/// Sums over the rows of a factor.
struct Products {
    /// Zᵀ W, `[columns, columns]`.
    with_rows: Mat<f64>,
    /// Zᵀ residual, `[columns]`.
    with_residual: Vec<f64>,
}

pub(super) fn estimate(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    start: Estimate,
    nominal: &[f64],
) -> Result<Estimate, IdentificationError> {
    if equations
        .trajectories()
        .iter()
        .any(|trajectory| trajectory.instruments.is_none() && trajectory.closed_loop.is_some())
    {
        return simulated(equations, factors, start, nominal);
    }
    let directions = Directions::of(&start.whitened);
    let group = Groups::of(factors);
    // The second round is a step of iterative refinement: its residual has the digits that the first sum lost.
    let mut values = nominal.to_vec();
    let mut projected = Mat::<f64>::zeros(0, 0);
    for _ in 0..2 {
        let mut products: Vec<Products> = factors.iter().map(|factor| Products::new(factor.columns.len())).collect();
        equations.for_each_with_instruments(|equation, instrument| {
            let residual = equation.residual(&values);
            products[group.index(&equation)].add(equation.row, instrument, residual);
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
        directions.advance(&mut values, &(0..directions.len()).map(|k| step[(k, 0)]).collect::<Vec<_>>());
    }
    let found = Estimate { values, ..start };
    let middle = scores(equations, factors, &found, &directions)?;
    // (Zᵀ W)⁻¹ S (Zᵀ W)⁻ᵀ.
    let half = solve_general(&projected, &middle).ok_or(IdentificationError::WeakInstruments)?;
    let full = solve_general(&projected, &half.transpose().to_owned()).ok_or(IdentificationError::WeakInstruments)?;
    Ok(Estimate { covariance: directions.covariance(&full), ..found })
}

/// Width of the windows in units of what the residual remembers.
const MEMORIES_PER_WINDOW: f64 = 6.0;

/// Covariance of Zᵀ residual, in the coordinates of `directions`.
fn scores(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    found: &Estimate,
    directions: &Directions,
) -> Result<Mat<f64>, IdentificationError> {
    let width = NoiseMemory::of(equations, factors, found)?.stretch(MEMORIES_PER_WINDOW);
    let group = Groups::of(factors);
    let steps: Vec<usize> = equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    let mut scores = Scores::default();
    equations.for_each_with_instruments(|equation, instrument| {
        let weight = found.weights[group.index(&equation)].powi(-2);
        if weight > 0.0 {
            let score = scores.at(equation.trajectory, equation.sample / steps[equation.trajectory], directions.len());
            let scale = weight * equation.residual(&found.values);
            directions.add_coordinates(equation.columns, &instrument[..equation.columns.len()], scale, score);
            scores.rows += 1;
        }
    })?;
    let freedom = scores.rows as f64 / (scores.rows as f64 - directions.len() as f64).max(1.0);
    Ok(faer::Scale(freedom) * scores.covariance(width, directions.len()))
}

/// Sums of instrument * residual, one per row of time.
#[derive(Default)]
struct Scores {
    /// Trajectory, first row of time, and a score per row from there on, those without equations zero.
    stretches: Vec<(usize, usize, Vec<Vec<f64>>)>,
    rows: usize,
}

/// Longer stretches without an equation are not filled.
const LONGEST_HOLE: usize = 500;

impl Scores {
    /// The score of a row of time; rows come in order.
    fn at(&mut self, trajectory: usize, time: usize, size: usize) -> &mut [f64] {
        let follows = |&(other, first, ref scores): &(usize, usize, Vec<Vec<f64>>)| {
            other == trajectory && time < first + scores.len() + LONGEST_HOLE
        };
        if !self.stretches.last().is_some_and(follows) {
            self.stretches.push((trajectory, time, Vec::new()));
        }
        let (_, first, scores) = self.stretches.last_mut().expect("just begun");
        scores.resize((time - *first + 1).max(scores.len()), vec![0.0; size]);
        &mut scores[time - *first]
    }

    /// Covariance of the sum of all scores: windows are triangles of twice `width`, so that lags are weighted by a cubic
    /// spline (Parzen (1961)), which is flat at lag zero and leaves the variance of noise that changes sign small.
    fn covariance(&self, width: usize, size: usize) -> Mat<f64> {
        let mut sum = Mat::<f64>::zeros(size, size);
        for (_, _, scores) in &self.stretches {
            for total in windows(&windows(scores, width, size), width, size) {
                for j in 0..size {
                    sum.col_mut(j).iter_mut().zip(&total).for_each(|(sum, value)| *sum += total[j] * value);
                }
            }
        }
        // Square sum of the triangle 1, 2, ..., width, ..., 2, 1.
        let w = width as f64;
        faer::Scale(3.0 / (w * (2.0 * w * w + 1.0))) * sum
    }
}

/// Sums over all windows of `width` rows, over the ends too.
fn windows(scores: &[Vec<f64>], width: usize, size: usize) -> Vec<Vec<f64>> {
    let mut total = vec![0.0; size];
    let step = |end: usize| {
        if let Some(score) = scores.get(end) {
            total.iter_mut().zip(score).for_each(|(total, score)| *total += score);
        }
        if let Some(score) = end.checked_sub(width).map(|begin| &scores[begin]) {
            total.iter_mut().zip(score).for_each(|(total, score)| *total -= score);
        }
        total.clone()
    };
    (0..scores.len() + width - 1).map(step).collect()
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
    let trajectories = equations.trajectories().iter().zip(&motions).map(|(trajectory, motion)| Trajectory {
        instruments: trajectory.instruments.or(Some(motion.samples())),
        ..*trajectory
    });
    let (robot, set, base) = (equations.robot(), equations.parameter_set(), equations.base());
    estimate(&mut Equations::new(robot, set, base, trajectories.collect()), factors, start, nominal)
}

impl Products {
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
