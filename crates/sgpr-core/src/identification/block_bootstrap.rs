//! How the estimates would scatter: experiments made of blocks of this one, drawn with replacement.
//!
//! Blocks that are long against the memory of the noise keep it, so nothing is assumed of its law.
//! Each block is one Gram matrix and one score, and a replicate is their sum: thousands cost less
//! than one pass over the data.
//!
//! Few blocks scatter less than new experiments would. The residual is what the fit left of the
//! noise: of unit noise a block with the Gram matrix G shows G - G², where all G together are the
//! identity; with `n` like blocks that is the share (n - 1) / n (Bell, McCaffrey). And quantiles
//! are those of the normal law instead of Student's (Hesterberg). Replicates are moved away from
//! the estimate by as much.
//!
//! Source: H. R. Künsch, The jackknife and the bootstrap for general stationary observations,
//! Annals of Statistics 17(3) (1989), with blocks that do not overlap (E. Carlstein, 1986); T. C.
//! Hesterberg, What teachers should know about the bootstrap, American Statistician 69(4) (2015),
//! section 5.3; R. M. Bell, D. F. McCaffrey, Bias reduction in standard errors for linear
//! regression with multi-stage samples, Survey Methodology 28(2) (2002).

use faer::Mat;

use super::groups::Groups;
use super::hac::{MOST_LOST, NoiseMemory, student};
use super::least_squares::Directions;
use super::{Equations, Estimate, IdentificationError, JointFactor};
use crate::linalg::{Matrix, solve_general};
use sgpr_numeric::internal::Random;

/// Rows per block in units of what the residual remembers. Blocks lose the share 1 / (2 * this) of
/// the variance, which is correlated across their borders.
const MEMORIES_PER_BLOCK: f64 = 10.0;

/// Replicated estimates, expanded as few blocks require.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Bootstrap {
    /// `[replicates, rank]`
    pub estimates: Vec<Vec<f64>>,
    /// Rows of time per block.
    pub block: usize,
    /// Blocks in the data.
    pub blocks: usize,
}

impl Bootstrap {
    /// Covariance of the replicates, `[rank, rank]`.
    pub fn covariance(&self) -> Matrix {
        let rank = self.estimates.first().map_or(0, Vec::len);
        let count = self.estimates.len() as f64;
        let mean: Vec<f64> =
            (0..rank).map(|k| self.estimates.iter().map(|e| e[k]).sum::<f64>() / count).collect();
        Matrix::from_fn(rank, rank, |i, j| {
            self.estimates.iter().map(|e| (e[i] - mean[i]) * (e[j] - mean[j])).sum::<f64>()
                / (count - 1.0)
        })
    }

    /// Interval that holds the share `level` of the replicates of each base parameter, `[rank]`.
    pub fn intervals(&self, level: f64) -> Vec<[f64; 2]> {
        let rank = self.estimates.first().map_or(0, Vec::len);
        let tail = 0.5 * (1.0 - level);
        let interval = |k: usize| {
            let mut values: Vec<f64> = self.estimates.iter().map(|estimate| estimate[k]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
            [at(tail), at(1.0 - tail)]
        };
        (0..rank).map(interval).collect()
    }
}

/// Replicates of an estimate by weighted least squares.
///
/// - `block`: rows of time per block; several times what the residual remembers if `None`
///
/// # Errors
/// If the data hold fewer than ten blocks.
pub fn block_bootstrap(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    estimate: &Estimate,
    replicates: usize,
    block: Option<usize>,
) -> Result<Bootstrap, IdentificationError> {
    const FEWEST: usize = 10;
    let block = match block {
        Some(block) => block.max(1),
        None => NoiseMemory::of(equations, factors, estimate)?.stretch(MEMORIES_PER_BLOCK),
    };
    let directions = Directions::of(&estimate.whitened);
    let size = directions.len();
    let group = Groups::of(factors);
    let steps: Vec<usize> =
        equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    let mut blocks: Vec<(Mat<f64>, Vec<f64>)> = Vec::new();
    let mut at = None;
    let mut row = vec![0.0; size];
    equations.for_each(|equation| {
        let now = (equation.trajectory, equation.sample / steps[equation.trajectory] / block);
        if at.replace(now) != Some(now) {
            blocks.push((Mat::zeros(size, size), vec![0.0; size]));
        }
        let Some(index) = group.index(&equation) else { return };
        let noise = estimate.row_noise(index, equation.trajectory);
        if noise.is_finite() {
            let (gram, score) = blocks.last_mut().expect("just begun");
            row.fill(0.0);
            directions.add_coordinates(equation.columns, equation.row, 1.0 / noise, &mut row);
            let residual = equation.residual(&estimate.values) / noise;
            for j in 0..size {
                let factor = row[j];
                if factor != 0.0 {
                    gram.col_mut(j)
                        .iter_mut()
                        .zip(&row)
                        .for_each(|(gram, row)| *gram += factor * row);
                    score[j] += factor * residual;
                }
            }
        }
    })?;
    if blocks.len() < FEWEST {
        return Err(IdentificationError::FewBlocks {
            blocks: blocks.len(),
            rows: block,
            needed: FEWEST,
        });
    }
    let lost =
        blocks.iter().map(|(gram, _)| gram.squared_norm_l2()).sum::<f64>() / size.max(1) as f64;
    let widening = student(blocks.len() as f64 - 1.0) / (1.0 - lost.min(MOST_LOST)).sqrt();
    let mut random = Random::new(0x5EED_B007);
    let mut estimates = Vec::with_capacity(replicates);
    while estimates.len() < replicates {
        let mut gram = Mat::<f64>::zeros(size, size);
        let mut score = Mat::<f64>::zeros(size, 1);
        for _ in 0..blocks.len() {
            let (part, own) = &blocks[random.below(blocks.len())];
            gram += part;
            own.iter().enumerate().for_each(|(k, own)| score[(k, 0)] += own);
        }
        // A draw that leaves a direction without data is no experiment that anyone would evaluate.
        let Some(step) = solve_general(&gram, &score) else { continue };
        let mut values = estimate.values.clone();
        directions
            .advance(&mut values, &(0..size).map(|k| widening * step[(k, 0)]).collect::<Vec<_>>());
        estimates.push(values);
    }
    Ok(Bootstrap { estimates, block, blocks: blocks.len() })
}
