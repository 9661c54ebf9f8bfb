//! Covariance of the estimates whatever the noise remembers, over time and from joint to joint.
//!
//! The score of a sample is the sum over its rows of row * residual. The covariance of an estimate
//! is that of the sum of all scores, seen through the inverse of the weighted WᵀW. It is the
//! spectrum of the scores at frequency zero, for which the mean over the squares of their first
//! cosine coefficients stands: as many of them as lie where the spectrum is flat. Each is a new
//! observation of it, so their number is a number of degrees of freedom, and intervals are
//! Student's.
//!
//! The residual is what the fit left of the noise, and a row times a slow cosine looks like other
//! rows, so the coefficients are smaller than those of the noise: by as much as they would be if
//! the noise were white, E|S_j|² = |X|²/2 - |X' C_j X|² with rows X of unit noise and the cosine
//! C_j. The last norm is that of a product with one random vector of signs.
//!
//! Sources: E. Lazarus, D. J. Lewis, J. H. Stock, M. W. Watson, HAR inference: recommendations for
//! practice, J. Business & Economic Statistics 36(4) (2018), the equal-weighted cosine estimator;
//! R. M. Bell, D. F. McCaffrey, Bias reduction in standard errors for linear regression with
//! multi-stage samples, Survey Methodology 28(2) (2002); M. F. Hutchinson, A stochastic estimator
//! of the trace of the influence matrix, Comm. Statistics B 18(3) (1989).

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use faer::Mat;

use super::autocorrelation::Memory;
use super::groups::{Groups, memories};
use super::least_squares::Directions;
use super::{Equation, Equations, Estimate, IdentificationError, JointFactor};
use crate::linalg::Matrix;
use sgpr_numeric::internal::Random;

/// Rows of time per cosine in units of what the residual remembers. Where the memory decays
/// exponentially the mean over the cosines misses the share (pi / this)² / 12 of the spectrum at
/// zero.
const MEMORIES_PER_COSINE: f64 = 5.0;

/// Cosines for which the memory must leave room: Student's interval with so many degrees of freedom
/// is a tenth wider.
const FEWEST_COSINES: f64 = 10.0;

/// Most of them with instruments: noise of the positions, differentiated twice, all but vanishes at
/// frequency zero, and only close to it.
const MOST_COSINES: f64 = 100.0;

/// Share of the variance for which the fit can be made up.
pub(super) const MOST_LOST: f64 = 0.5;

/// Covariance of the base parameters under noise that is correlated in time and between joints,
/// `[rank, rank]`; infinite where the motion says nothing.
///
/// Widened so that 1.96 standard deviations hold the truth in 95 of 100 cases although the
/// covariance is itself an estimate.
///
/// - `rows_per_cosine`: rows of time per cosine, several times what the noise remembers; from the
///   residual if `None`
///
/// # Errors
/// As [`Equations::for_each`].
pub fn hac_covariance(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    rows_per_cosine: Option<usize>,
) -> Result<Matrix, IdentificationError> {
    let directions = Directions::of(&estimate.whitened);
    let sum = score_covariance(
        equations,
        factors,
        estimate,
        &directions,
        RowsOf::Motion,
        rows_per_cosine,
    )?;
    Ok(directions.covariance(&sum).into())
}

/// What the residual is multiplied by.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum RowsOf {
    /// The rows of the equations.
    Motion,
    /// Those of the instruments.
    Instruments,
}

/// Covariance of the sum over all rows of row * residual, both in units of the noise, in the
/// coordinates of `directions`; widened as [`hac_covariance`] says.
pub(super) fn score_covariance(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    directions: &Directions,
    rows_of: RowsOf,
    rows_per_cosine: Option<usize>,
) -> Result<Mat<f64>, IdentificationError> {
    let size = directions.len();
    let noise = NoiseMemory::of(equations, factors, estimate)?;
    let dof = equations.robot().dof();
    let rows: Vec<usize> = equations
        .trajectories()
        .iter()
        .map(|part| part.samples.count(dof).div_ceil(part.decimation))
        .collect();
    let total: usize = rows.iter().sum();
    let width = rows_per_cosine.map_or_else(
        || {
            let memory = (MEMORIES_PER_COSINE * noise.longest).min(total as f64 / FEWEST_COSINES);
            if rows_of == RowsOf::Motion { memory } else { memory.max(total as f64 / MOST_COSINES) }
        },
        |rows| rows as f64,
    );
    let cosines: Vec<usize> =
        rows.iter().map(|rows| ((*rows as f64 / width.max(1.0)) as usize).max(1)).collect();
    let mut coefficients: Vec<[Mat<f64>; 2]> =
        cosines.iter().map(|count| [0; 2].map(|_| Mat::zeros(size, *count))).collect();
    for_each_score(
        equations,
        factors,
        estimate,
        directions,
        rows_of,
        |trajectory, row, scores| {
            // cos (j + 1) a = 2 cos a cos j a - cos (j - 1) a.
            let angle = std::f64::consts::PI * (row as f64 + 0.5) / rows[trajectory] as f64;
            let (mut last, mut cosine) = (1.0, angle.cos());
            let twice = 2.0 * cosine;
            for j in 0..cosines[trajectory] {
                for (sums, score) in coefficients[trajectory].iter_mut().zip(scores) {
                    sums.col_mut(j)
                        .iter_mut()
                        .zip(score)
                        .for_each(|(sum, score)| *sum += cosine * score);
                }
                (last, cosine) = (cosine, twice * cosine - last);
            }
        },
    )?;
    let mut sum = Mat::<f64>::zeros(size, size);
    let mut lost = 0.0;
    for [scores, products] in &coefficients {
        let weight = 2.0 / scores.ncols() as f64;
        sum += faer::Scale(weight) * (scores * scores.transpose());
        lost += weight * products.squared_norm_l2() / size as f64;
    }
    // Of a sum of variances with few degrees of freedom each (Satterthwaite (1946)).
    let spread: f64 =
        rows.iter().zip(&cosines).map(|(rows, count)| (*rows as f64).powi(2) / *count as f64).sum();
    let widening = student((total as f64).powi(2) / spread).powi(2) / (1.0 - lost.min(MOST_LOST));
    Ok(faer::Scale(widening) * sum)
}

/// Visits every sample in the coordinates of `directions`, rows in units of their noise:
/// trajectory, row of time, and the sums over its rows of row * residual and of row * (row *
/// signs).
fn for_each_score(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    directions: &Directions,
    rows_of: RowsOf,
    mut visit: impl FnMut(usize, usize, &[Vec<f64>; 2]),
) -> Result<(), IdentificationError> {
    let group = Groups::of(factors);
    let steps: Vec<usize> =
        equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    let mut random = Random::new(0x5EED_51C5);
    let signs: Vec<f64> =
        (0..directions.len()).map(|_| if random.below(2) == 0 { -1.0 } else { 1.0 }).collect();
    let mut row = vec![0.0; directions.len()];
    let mut scores = [row.clone(), row.clone()];
    let mut at: Option<(usize, usize)> = None;
    let mut add = |equation: Equation<'_>, factors: &[f64]| {
        let now = (equation.trajectory, equation.sample / steps[equation.trajectory]);
        if let Some((trajectory, time)) = at.filter(|before| *before != now) {
            visit(trajectory, time, &scores);
            scores.iter_mut().for_each(|score| score.fill(0.0));
        }
        at = Some(now);
        let Some(index) = group.index(&equation) else { return };
        let noise = estimate.row_noise(index, equation.trajectory);
        if noise.is_finite() {
            row.fill(0.0);
            directions.add_coordinates(
                equation.columns,
                &factors[..equation.columns.len()],
                1.0 / noise,
                &mut row,
            );
            let product = row.iter().zip(&signs).map(|(row, sign)| row * sign).sum();
            for (score, factor) in
                scores.iter_mut().zip([equation.residual(&estimate.values) / noise, product])
            {
                score.iter_mut().zip(&row).for_each(|(score, row)| *score += factor * row);
            }
        }
    };
    match rows_of {
        RowsOf::Motion => equations.for_each(|equation| add(equation, equation.row))?,
        RowsOf::Instruments => equations.for_each_with_instruments(add)?,
    }
    if let Some((trajectory, time)) = at {
        visit(trajectory, time, &scores);
    }
    Ok(())
}

/// What the residual of an estimate remembers.
pub(super) struct NoiseMemory {
    /// Rows of a moving joint that carry as much as one independent row, of the joint for which
    /// that is most.
    pub longest: f64,
    /// Rows of time.
    rows: usize,
}

impl NoiseMemory {
    pub fn of(
        equations: &mut Equations<'_>,
        factors: &[JointFactor],
        estimate: &Estimate,
    ) -> Result<Self, IdentificationError> {
        let memory = memories(equations, factors, &estimate.values)?;
        let memory: Vec<f64> = memory.into_iter().map(Memory::rows_per_independent_row).collect();
        let moving = factors.iter().zip(&memory).filter(|(factor, _)| !factor.resting);
        let used = factors
            .iter()
            .zip(&memory)
            .zip(&estimate.weights)
            .filter(|(_, weight)| weight.is_finite());
        // The fit takes one independent row per parameter, and the slowest first.
        let independent: f64 = used.map(|((factor, memory), _)| factor.rows as f64 / memory).sum();
        let lost = (estimate.values.len() as f64 / independent.max(1.0)).min(MOST_LOST);
        Ok(Self {
            longest: moving.map(|(_, memory)| *memory).fold(1.0, f64::max) / (1.0 - lost),
            rows: factors.iter().map(|factor| factor.rows).max().unwrap_or(0),
        })
    }

    /// `memories` times what the residual remembers, and no more than leaves twenty such stretches
    /// in the data.
    pub fn stretch(&self, memories: f64) -> usize {
        const STRETCHES: usize = 20;
        ((memories * self.longest).ceil() as usize).min(self.rows / STRETCHES).max(1)
    }
}

/// Quantile of 97.5 % of Student's law with `freedom` degrees of freedom, at least five, over that
/// of the normal one.
pub(super) fn student(freedom: f64) -> f64 {
    /// The search for the quantile does not end where the law is all but normal.
    const MANY: f64 = 1000.0;
    let normal = Normal::standard().inverse_cdf(0.975);
    if freedom > MANY {
        // M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions (1964), equation 26.7.5,
        // to its first order.
        return 1.0 + (normal * normal + 1.0) / (4.0 * freedom);
    }
    StudentsT::new(0.0, 1.0, freedom.max(5.0)).map_or(1.0, |law| law.inverse_cdf(0.975) / normal)
}

#[cfg(test)]
mod tests {
    use super::student;

    #[test]
    fn quantiles_of_student_are_those_of_the_tables() {
        for (freedom, expected) in [
            (5.0, 2.571),
            (10.0, 2.228),
            (20.0, 2.086),
            (60.0, 2.000),
            (1000.0, 1.962),
            (1001.0, 1.962),
            (1e9, 1.960),
        ] {
            assert!((1.959_964 * student(freedom) - expected).abs() < 3e-3, "{freedom}");
        }
        let falling: Vec<f64> = (10..3000).map(|half| student(0.5 * f64::from(half))).collect();
        assert!(
            falling.windows(2).all(|pair| pair[0] > pair[1]),
            "also where one formula takes over from another"
        );
    }
}
