//! What left-out data say between models: the one statistic that every decision of the diagnosis
//! rests on.
//!
//! A model is judged by its errors on blocks of time that were left out of its fit. Two models are
//! compared block by block, so that what is hard to predict for both cancels. Noise has a memory,
//! which is counted, and an effect that helps in some blocks and harms in others is less sure than
//! one that helps wherever it acts.

use statrs::distribution::{ContinuousCDF, Normal};

use super::problem::{Column, Problem};
use crate::identification::deviate_of_t;
use crate::linalg::mean_square;
use crate::model::Term;
use sgpr_numeric::internal::Random;

/// What chance alone may lift above the gain that is asked, in a diagnosis.
const BY_CHANCE: f64 = 1.0 / 3.0;

/// Least gain on left-out blocks, in its standard deviations, of what is said to be there and was
/// chosen among so many that were `tried`, effects at their places: 2.3 for thirty, 3.0 for 250
/// (Bonferroni).
pub(super) fn sure_among(tried: f64) -> f64 {
    Normal::standard().inverse_cdf(1.0 - BY_CHANCE / tried.max(1.0))
}

/// As likely as not.
pub(super) const EVEN: f64 = 0.5;

/// The probability that belongs to the log of the odds.
pub(super) fn probability_of(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).clamp(-700.0, 700.0).exp())
}

/// By how much the values of a term's constants lower its log odds, where something is known of
/// them before any data: by half their squares in standard deviations.
pub(super) fn surprise(term: &Term) -> f64 {
    let constants = term.effect.constants().iter().zip(&term.constants);
    constants.map(|(constant, value)| 0.5 * (value / constant.expected).powi(2)).sum()
}

/// Errors of one model on blocks that were left out of its fit, per joint and row, N·m (N).
#[derive(Clone, Debug)]
pub(super) struct LeftOut {
    pub rows: Column,
}

/// The paired comparison of two models on left-out blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Comparison {
    /// Fall of the sum of squares, each joint in units of its own left-out variance.
    pub gain: f64,
    /// Standard deviation of that.
    pub deviation: f64,
    /// Mean fall of the logarithm of a block's error, in its standard deviations, for one joint.
    usual: f64,
}

impl Comparison {
    /// Gain in standard deviations: of the squares, in which an effect shows that acts for a short
    /// time, or of a usual block, whatever some blocks with large errors say.
    pub fn significance(&self) -> f64 {
        self.of_squares().max(self.usual)
    }

    fn of_squares(&self) -> f64 {
        if self.deviation > 0.0 { self.gain / self.deviation } else { 0.0 }
    }

    /// Largest log of the Bayes factor that the gain of the squares speaks for: 1 / (-e p ln p), p
    /// the probability that chance alone gains as many standard deviations. It asks nothing of the
    /// noise but what the deviation counts.
    ///
    /// Source: T. Sellke, M. J. Bayarri, J. O. Berger, Calibration of p values for testing precise
    /// null hypotheses, The American Statistician 55 (2001), the bound -e p ln p.
    pub fn largest_log_bayes_factor(&self) -> f64 {
        let p = Normal::standard().cdf(-self.of_squares()).max(f64::MIN_POSITIVE);
        if p < 1.0 / std::f64::consts::E { -1.0 - p.ln() - (-p.ln()).ln() } else { 0.0 }
    }
}

/// Mean of values in standard deviations of it: the normal deviate that is as improbable as
/// Student's t with as few values.
pub(super) fn deviate_of_mean(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    if count < 3.0 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let t = mean / (variance / count).sqrt().max(f64::MIN_POSITIVE);
    deviate_of_t(t, count - 1.0)
}

/// Longest memory of errors that is believed, s.
const LONGEST_MEMORY_S: f64 = 1.0;

/// Correlation of neighbouring rows of a joint whose errors remember as long as is believed.
pub(super) fn largest_correlation(problem: &Problem, joint: usize) -> f64 {
    let block = problem.blocks(joint).next().map_or(1, |block| block.len());
    let longest = (LONGEST_MEMORY_S * block as f64 / problem.block_s).max(1.0);
    (longest - 1.0) / (longest + 1.0)
}

impl LeftOut {
    /// Mean square error of a joint, (N·m)² (N²).
    pub fn mean_square(&self, joint: usize) -> f64 {
        mean_square(&self.rows[joint])
    }

    /// Correlation of neighbouring rows of a joint, at most that with which a second says as much
    /// as one row.
    fn correlation(&self, problem: &Problem, joint: usize) -> f64 {
        let (rows, run) = (&self.rows[joint], &problem.run[joint]);
        let (mut products, mut squares) = (0.0, 0.0);
        for k in (1..rows.len()).filter(|&k| run[k] > 0) {
            products += rows[k] * rows[k - 1];
            squares += 0.5 * (rows[k] * rows[k] + rows[k - 1] * rows[k - 1]);
        }
        let r = if squares > 0.0 { (products / squares).clamp(0.0, 0.999) } else { 0.0 };
        r.min(largest_correlation(problem, joint))
    }

    /// How many rows of a joint say as much about a smooth column as one row without memory would:
    /// for an autoregression of first order (1 + r) / (1 - r), r the correlation of neighbours.
    pub fn memory(&self, problem: &Problem, joint: usize) -> f64 {
        let r = self.correlation(problem, joint);
        (1.0 + r) / (1.0 - r)
    }

    /// Gain of the log predictive density with something that this model lacks, at some joints: the
    /// fall of the squares in units of the error that is left and of how many rows say as much as
    /// one.
    pub fn density_gain(&self, with: &Self, problem: &Problem, joints: &[usize]) -> f64 {
        let of_joint = |&joint: &usize| {
            let (own, left) = (self.mean_square(joint), with.mean_square(joint));
            let rows = self.rows[joint].len() as f64;
            if left > 0.0 {
                0.5 * rows * (own / left - 1.0) / with.memory(problem, joint)
            } else {
                0.0
            }
        };
        joints.iter().map(of_joint).sum()
    }

    /// This model without something against `with` it, at some joints.
    ///
    /// With prediction errors e0 and e1, d = e0 - e1 is what the two predict differently. If the
    /// larger model is right the fall of the squares in a block is its share of the squares of d,
    /// and varies with the noise by 4 Σ dᵢ dⱼ r^|i - j| / s², r the correlation of neighbouring
    /// errors and s the error: much where d is as slow as the errors, and as much as without memory
    /// where it is fast. It varies more from block to block than that where the larger model is
    /// wrong.
    pub fn against(&self, with: &Self, problem: &Problem, joints: &[usize]) -> Comparison {
        let (mut noise, mut blocks, mut logarithms) = (0.0, Vec::new(), Vec::new());
        for &joint in joints {
            let variance = with.mean_square(joint);
            if variance <= 0.0 {
                continue;
            }
            let r = with.correlation(problem, joint);
            for block in problem.blocks(joint) {
                let (mut fall, mut size, mut correlated) = (0.0, 0.0, 0.0);
                let mut before_it = 0.0;
                let square = |errors: &Self| {
                    errors.rows[joint][block.clone()].iter().map(|e| e * e).sum::<f64>()
                };
                let [before, after] = [self, with].map(square);
                if before > 0.0 && after > 0.0 {
                    logarithms.push((before / after).ln());
                }
                for row in block {
                    let (own, other) = (self.rows[joint][row], with.rows[joint][row]);
                    fall += (own * own - other * other) / variance;
                    let d = own - other;
                    size += d * d / variance;
                    before_it *= if problem.run[joint][row] > 0 { r } else { 0.0 };
                    correlated += d * (d + 2.0 * before_it) / variance;
                    before_it += d;
                }
                noise += 4.0 * size.max(correlated);
                blocks.push((fall, size));
            }
        }
        let (gain, size) =
            blocks.iter().fold((0.0, 0.0), |(gain, size), block| (gain + block.0, size + block.1));
        let rate = if size > 0.0 { gain / size } else { 0.0 };
        let scatter: f64 = blocks.iter().map(|(fall, size)| (fall - rate * size).powi(2)).sum();
        let usual = if joints.len() == 1 { deviate_of_mean(&logarithms) } else { 0.0 };
        Comparison { gain, deviation: noise.max(scatter).sqrt(), usual }
    }
}

/// Draws of the bootstrap.
const DRAWS: usize = 400;

/// Weights of models by their predictive density on left-out blocks, which sum to one: averaged
/// over a Bayesian bootstrap of the blocks, so that a lead that hangs on few blocks counts less
/// (pseudo-BMA+; Yao, Vehtari, Simpson, Gelman, Using stacking to average Bayesian predictive
/// distributions, Bayesian Analysis 13 (2018), section 3.4).
///
/// - `prior`: log of the weights before any data
pub(super) fn weights(
    problem: &Problem,
    models: &[&LeftOut],
    prior: &[f64],
    joints: &[usize],
) -> Vec<f64> {
    let mut densities: Vec<Vec<f64>> = vec![vec![]; models.len()];
    for &joint in joints {
        let best =
            models.iter().min_by(|a, b| a.mean_square(joint).total_cmp(&b.mean_square(joint)));
        let Some(best) = best.filter(|best| best.mean_square(joint) > 0.0) else { continue };
        let scale = -0.5 / (best.mean_square(joint) * best.memory(problem, joint));
        for block in problem.blocks(joint) {
            for (densities, model) in densities.iter_mut().zip(models) {
                densities.push(
                    scale * model.rows[joint][block.clone()].iter().map(|e| e * e).sum::<f64>(),
                );
            }
        }
    }
    let mut weights = vec![0.0; models.len()];
    for draw in draws(densities.first().map_or(0, Vec::len)) {
        let of_model = |(densities, prior): (&Vec<f64>, &f64)| {
            prior
                + densities.iter().zip(&draw).map(|(density, weight)| density * weight).sum::<f64>()
        };
        let all: Vec<f64> = densities.iter().zip(prior).map(of_model).collect();
        let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = all.iter().map(|density| (density - most).exp()).collect();
        let sum: f64 = shares.iter().sum();
        weights
            .iter_mut()
            .zip(shares)
            .for_each(|(weight, share)| *weight += share / sum / DRAWS as f64);
    }
    weights
}

/// Probability, over the same bootstrap, that the root mean square error of a joint falls by more
/// than a share of it.
///
/// - `apart`: mean square that is in both, (N·m)² (N²)
pub(super) fn probability_of_fall(
    problem: &Problem,
    [own, with]: [&LeftOut; 2],
    joint: usize,
    share: f64,
    apart: f64,
) -> f64 {
    let sums = |errors: &LeftOut| -> Vec<f64> {
        let square = |block: std::ops::Range<usize>| {
            errors.rows[joint][block.clone()].iter().map(|e| e * e).sum::<f64>()
                + apart * block.len() as f64
        };
        problem.blocks(joint).map(square).collect()
    };
    let [own, with] = [own, with].map(sums);
    let weighted = |sums: &[f64], draw: &[f64]| {
        sums.iter().zip(draw).map(|(x, weight)| x * weight).sum::<f64>()
    };
    let falls =
        |draw: &Vec<f64>| weighted(&with, draw) < (1.0 - share).powi(2) * weighted(&own, draw);
    draws(own.len()).filter(falls).count() as f64 / DRAWS as f64
}

/// Weights of `count` blocks with mean one, from the flat Dirichlet distribution; the same for
/// every call.
fn draws(count: usize) -> impl Iterator<Item = Vec<f64>> {
    let mut random = Random::new(0x00D1_A905);
    (0..DRAWS).map(move |_| {
        let draw: Vec<f64> = (0..count).map(|_| -random.uniform().max(1e-300).ln()).collect();
        let mean = draw.iter().sum::<f64>() / count.max(1) as f64;
        draw.into_iter().map(|weight| weight / mean).collect()
    })
}

#[cfg(test)]
mod tests {
    use statrs::distribution::Continuous;

    use super::*;
    use crate::effects::{Site, by_name};

    #[test]
    fn more_is_asked_where_more_is_tried() {
        // Tables of the normal distribution: deviates that chance exceeds with these probabilities.
        for (p, deviate) in [(0.05, 1.6449), (0.01, 2.3263), (0.001, 3.0902)] {
            assert!((sure_among(BY_CHANCE / p) - deviate).abs() < 1e-4, "{p}");
        }
        assert_eq!(sure_among(0.0), sure_among(1.0));
    }

    #[test]
    fn a_large_tilt_needs_more_evidence() {
        let tilt = |roll: f64, pitch: f64| {
            let effect = by_name("base_tilt").expect("in the library");
            surprise(&Term::new(effect, Site::Arm, vec![roll, pitch]))
        };
        // The logarithm of the densities of the normal distribution at zero and there.
        let log_density = |x: f64| Normal::new(0.0, 0.03).expect("a deviation").ln_pdf(x);
        let expected = 2.0 * log_density(0.0) - log_density(0.05) - log_density(-0.12);
        assert!((tilt(0.05, -0.12) - expected).abs() < 1e-9);
        assert_eq!(tilt(0.0, 0.0), 0.0);
        // Nothing is known of a delay but its range.
        let delay = by_name("torque_delay").expect("in the library");
        assert_eq!(surprise(&Term::new(delay, Site::Arm, vec![0.01])), 0.0);
    }

    #[test]
    fn a_gain_bounds_the_bayes_factor_as_published() {
        // Sellke, Bayarri and Berger (2001), table 1: probability by chance and least Bayes factor
        // for it.
        for (p, least) in
            [(0.1, 0.6259), (0.05, 0.4072), (0.01, 0.1252), (0.005, 0.0720), (0.001, 0.0188)]
        {
            let gain = Normal::standard().inverse_cdf(1.0 - p);
            let comparison = Comparison { gain, deviation: 1.0, usual: 0.0 };
            let bound = (-comparison.largest_log_bayes_factor()).exp();
            assert!((bound - least).abs() < 5e-4, "{p}: {bound} and {least}");
        }
        let of =
            |gain: f64| Comparison { gain, deviation: 1.0, usual: 0.0 }.largest_log_bayes_factor();
        assert_eq!(of(0.0), 0.0);
        assert!(of(60.0).is_finite());
    }
}
