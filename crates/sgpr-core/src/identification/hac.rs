//! Covariance of the estimates whatever the noise remembers, over time and from joint to joint.
//!
//! The score of a sample is the sum over its rows of row * residual. The covariance of an estimate is that of the sum of
//! all scores, seen through the inverse of the weighted WᵀW. With Bartlett's weights that covariance is the mean, over all
//! windows of `lag` samples, of the square of the window's sum, so it is never indefinite and one pass suffices.
//!
//! Source: W. K. Newey, K. D. West, A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
//! covariance matrix, Econometrica 55(3) (1987).

use std::collections::VecDeque;

use faer::Mat;

use super::estimate::{Groups, memories};
use super::least_squares::Directions;
use super::{Equations, Estimate, IdentificationError, JointFactor};

/// Lags in units of what the residual remembers: Bartlett's weights lose the share (memory / lag) of the variance.
const LAGS_PER_MEMORY: f64 = 6.0;

/// Covariance of the base parameters under noise that is correlated in time and between joints, `[rank, rank]`; infinite
/// where the motion says nothing.
///
/// - `lag`: rows over which the noise may be correlated; from the residual if `None`
///
/// # Errors
/// As [`Equations::for_each`].
pub fn hac_covariance(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    lag: Option<usize>,
) -> Result<Mat<f64>, IdentificationError> {
    let lag = match lag {
        Some(lag) => lag.max(1),
        None => suggested_lag(equations, factors, estimate)?,
    };
    let directions = Directions::of(&estimate.whitened);
    let size = directions.len();
    let mut sum = Mat::<f64>::zeros(size, size);
    let mut window = Window { scores: VecDeque::new(), total: vec![0.0; size], lag, trajectory: usize::MAX };
    let mut rows = 0usize;
    for_each_score(equations, factors, estimate, &directions, |trajectory, gap, score, count| {
        rows += count;
        if window.trajectory != trajectory {
            window.drain(&mut sum);
            window.trajectory = trajectory;
        }
        // Samples without a row are samples without a score.
        (1..gap.min(lag + 1)).for_each(|_| window.push(vec![0.0; size], &mut sum));
        window.push(score.to_vec(), &mut sum);
    })?;
    window.drain(&mut sum);
    let freedom = rows as f64 / (rows as f64 - size as f64).max(1.0);
    Ok(directions.covariance(&(faer::Scale(freedom / lag as f64) * sum)))
}

/// A window of scores that slides over a trajectory, over its ends too.
struct Window {
    scores: VecDeque<Vec<f64>>,
    total: Vec<f64>,
    lag: usize,
    trajectory: usize,
}

impl Window {
    fn push(&mut self, score: Vec<f64>, sum: &mut Mat<f64>) {
        self.total.iter_mut().zip(&score).for_each(|(total, score)| *total += score);
        self.scores.push_back(score);
        if self.scores.len() > self.lag {
            self.pop();
        }
        self.add_square(sum);
    }

    fn drain(&mut self, sum: &mut Mat<f64>) {
        while !self.scores.is_empty() {
            self.pop();
            self.add_square(sum);
        }
        self.total.fill(0.0);
    }

    fn pop(&mut self) {
        let oldest = self.scores.pop_front().expect("not empty");
        self.total.iter_mut().zip(&oldest).for_each(|(total, score)| *total -= score);
    }

    fn add_square(&self, sum: &mut Mat<f64>) {
        for j in 0..self.total.len() {
            let factor = self.total[j];
            sum.col_mut(j).iter_mut().zip(&self.total).for_each(|(sum, total)| *sum += factor * total);
        }
    }
}

/// Visits the score of every sample in the coordinates of `directions`: trajectory, rows of time since the one before,
/// score, number of equations.
pub(super) fn for_each_score(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    directions: &Directions,
    mut visit: impl FnMut(usize, usize, &[f64], usize),
) -> Result<(), IdentificationError> {
    let group = Groups::of(factors);
    let steps: Vec<usize> = equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    let mut score = vec![0.0; directions.len()];
    let mut at: Option<(usize, usize)> = None;
    let (mut last, mut count) = (0, 0);
    equations.for_each(|equation| {
        let now = (equation.trajectory, equation.sample / steps[equation.trajectory]);
        if let Some(before) = at.filter(|before| *before != now) {
            visit(before.0, before.1 - last, &score, count);
            last = if before.0 == now.0 { before.1 } else { now.1.saturating_sub(1) };
            score.fill(0.0);
            count = 0;
        } else if at.is_none() {
            last = now.1.saturating_sub(1);
        }
        at = Some(now);
        let noise = estimate.weights[group.index(&equation)] * estimate.unit;
        if noise.is_finite() {
            let scale = equation.residual(&estimate.values) / (noise * noise);
            directions.add_coordinates(equation.columns, equation.row, scale, &mut score);
            count += 1;
        }
    })?;
    if let Some(before) = at {
        visit(before.0, before.1 - last, &score, count);
    }
    Ok(())
}

/// Lag that covers what the residual of moving joints remembers, and leaves twenty windows in the data.
pub(super) fn suggested_lag(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Result<usize, IdentificationError> {
    const WINDOWS: usize = 20;
    let memory = memories(equations, factors, &estimate.values)?;
    let moving = factors.iter().zip(&memory).filter(|(factor, _)| !factor.resting);
    let longest = moving.map(|(_, memory)| memory.rows_per_independent_row()).fold(1.0, f64::max);
    let rows = factors.iter().map(|factor| factor.rows).max().unwrap_or(0);
    Ok(((LAGS_PER_MEMORY * longest).ceil() as usize).min(rows / WINDOWS).max(1))
}
