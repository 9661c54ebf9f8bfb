//! Errors that neighbours in time share, without a matrix of them.

use super::minimise::{StoppingCriteria, minimise};
use super::{Covariance, GpError, Shape};

/// Independent errors, and errors whose covariance fades exponentially over an input such as time.
///
/// In the order of that input such errors are a Markov chain with independent errors on top: R⁻¹ =
/// Wᵀ W with W the filter that leaves of every measurement what those before do not predict, in its
/// standard deviation. So n points take n operations instead of n³.
///
/// Source: J. Hartikainen, S. Särkkä, Kalman filtering and smoothing solutions to temporal Gaussian
/// process regression models, IEEE Workshop on Machine Learning for Signal Processing (2010), with
/// the Matérn kernel 1/2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FadingNoise {
    /// Variance of independent errors.
    pub independent: f64,
    /// Variance of the errors that neighbours share.
    pub shared: f64,
    /// Difference of the input after which these are alike by 1/e.
    pub length: f64,
    /// The input.
    pub input: usize,
}

/// One step of the filter.
#[derive(Clone, Copy, Debug)]
pub struct FadingStep {
    /// What the shared error of the point before says of that of this point.
    decay: f64,
    /// Share of what is new that is taken for shared error.
    gain: f64,
    /// Of a measurement given those before.
    deviation: f64,
}

impl FadingNoise {
    /// The errors of a covariance; none if its correlated noise is not exponential over one input.
    pub fn of(covariance: &Covariance) -> Option<Self> {
        let independent = covariance.noise_variance;
        let Some(kernel) = &covariance.correlated_noise else {
            return Some(Self { independent, shared: 0.0, length: 1.0, input: 0 });
        };
        match kernel.single_leaf()? {
            (shared, leaf) if leaf.shape == Shape::Exponential && leaf.inputs.len() == 1 => {
                Some(Self {
                    independent,
                    shared,
                    length: leaf.scale(0),
                    input: leaf.inputs[0].index,
                })
            }
            _ => None,
        }
    }

    /// The steps along points at these values of the input, in order.
    pub fn steps(&self, times: impl Iterator<Item = f64>) -> Vec<FadingStep> {
        let (mut before, mut variance) = (None, self.shared);
        let step = |time: f64| {
            let decay =
                before.map_or(0.0, |before: f64| (-(time - before).abs() / self.length).exp());
            before = Some(time);
            let predicted = decay * decay * variance + (1.0 - decay * decay) * self.shared;
            let total = predicted + self.independent;
            let gain = if total > 0.0 { predicted / total } else { 0.0 };
            variance = (1.0 - gain) * predicted;
            FadingStep { decay, gain, deviation: total.sqrt() }
        };
        times.map(step).collect()
    }

    /// The most likely errors of a series of them.
    ///
    /// - `times`: in order
    /// - `lengths`: the shortest and the longest memory
    ///
    /// # Errors
    /// If the likelihood cannot be computed, for which the errors would have to be infinite.
    pub fn most_likely(
        times: &[f64],
        errors: &[f64],
        input: usize,
        lengths: (f64, f64),
    ) -> Result<Self, GpError> {
        let count = errors.len() as f64;
        let at = |theta: &[f64]| Self {
            independent: 1.0,
            shared: theta[0].exp(),
            length: theta[1].exp(),
            input,
        };
        // The scale that is most likely with a ratio and a length, and minus the log likelihood per
        // point.
        let cost = |theta: &[f64]| {
            let steps = at(theta).steps(times.iter().copied());
            let mut white = errors.to_vec();
            whiten(&steps, &mut white, &mut 0.0);
            let scale = white.iter().map(|w| w * w).sum::<f64>() / count;
            (
                scale,
                0.5 * scale.ln()
                    + steps.iter().map(|step| step.deviation.ln()).sum::<f64>() / count,
            )
        };
        let ratios = (-7.0, 7.0);
        let lengths = (lengths.0.ln(), lengths.1.ln());
        let mut start = vec![0.0; 2];
        let mut least = f64::INFINITY;
        for ratio in [-2.0, 2.0] {
            for share in [0.2, 0.5, 0.8] {
                let theta = vec![ratio, lengths.0 + share * (lengths.1 - lengths.0)];
                let (_, value) = cost(&theta);
                if value < least {
                    (least, start) = (value, theta);
                }
            }
        }
        const STEP: f64 = 1e-4;
        let slope = |theta: &[f64], k: usize| {
            let moved = |by: f64| {
                let mut theta = theta.to_vec();
                theta[k] += by;
                cost(&theta).1
            };
            (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
        };
        let mut evaluate =
            |theta: &[f64]| Ok((cost(theta).1, vec![slope(theta, 0), slope(theta, 1)]));
        let limits = StoppingCriteria { evaluations: 40, gain: 1e-9, gradient: 1e-6 };
        let minimum = minimise(
            &start,
            &[ratios.0, lengths.0],
            &[ratios.1, lengths.1],
            limits,
            &mut evaluate,
        )?;
        let (scale, _) = cost(&minimum.at);
        let relative = at(&minimum.at);
        Ok(Self { independent: scale, shared: scale * relative.shared, ..relative })
    }
}

/// W times a column, the next of its points; `state` is the shared error after the points before,
/// zero before the first.
pub(crate) fn whiten(steps: &[FadingStep], column: &mut [f64], state: &mut f64) {
    for (step, value) in steps.iter().zip(column) {
        let predicted = step.decay * *state;
        let new = *value - predicted;
        *state = predicted + step.gain * new;
        *value = new / step.deviation;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use sgpr_numeric::internal::Random;
    use sgpr_numeric::internal::linalg::cholesky;

    #[test]
    fn what_is_white_has_the_inverse_of_the_covariance() {
        let noise = FadingNoise { independent: 0.3, shared: 1.7, length: 0.4, input: 0 };
        let mut random = Random::new(1);
        let mut times: Vec<f64> = (0..40).map(|_| 5.0 * random.uniform()).collect();
        times.sort_by(f64::total_cmp);
        let covariance = Mat::from_fn(40, 40, |i, j| {
            let shared = noise.shared * (-(times[i] - times[j]).abs() / noise.length).exp();
            shared + if i == j { noise.independent } else { 0.0 }
        });
        let steps = noise.steps(times.iter().copied());
        // W R W' = 1, column by column from both sides, in two pieces.
        let both = |matrix: &Mat<f64>| {
            let mut product = matrix.clone();
            for k in 0..40 {
                let (mut state, column) = (0.0, product.col_as_slice_mut(k));
                whiten(&steps[..13], &mut column[..13], &mut state);
                whiten(&steps[13..], &mut column[13..], &mut state);
            }
            product.transpose().to_owned()
        };
        let identity = both(&both(&covariance));
        let difference = &identity - Mat::<f64>::identity(40, 40);
        assert!(difference.norm_max() < 1e-12, "{}", difference.norm_max());
        let factor = cholesky(covariance.as_ref()).expect("a covariance");
        let log_root: f64 = (0..40).map(|k| factor[(k, k)].ln()).sum();
        assert!(
            (steps.iter().map(|step| step.deviation.ln()).sum::<f64>() - log_root).abs() < 1e-11
        );
    }

    #[test]
    fn the_memory_of_errors_is_found() {
        let (rate, truth) =
            (100.0, FadingNoise { independent: 0.5, shared: 2.0, length: 0.3, input: 3 });
        let mut random = Random::new(7);
        let (mut shared, decay) = (0.0, (-1.0 / (rate * truth.length)).exp());
        let errors: Vec<f64> = (0..40_000)
            .map(|_| {
                shared = decay * shared
                    + ((1.0 - decay * decay) * truth.shared).sqrt() * random.normal();
                shared + truth.independent.sqrt() * random.normal()
            })
            .collect();
        let times: Vec<f64> = (0..errors.len()).map(|k| k as f64 / rate).collect();
        let found = FadingNoise::most_likely(&times, &errors, 3, (0.005, 5.0)).expect("finite");
        // 40,000 samples are some 600 independent ones of the shared error.
        assert!((found.independent / truth.independent - 1.0).abs() < 0.05, "{found:?}");
        assert!(
            (found.shared / truth.shared - 1.0).abs() < 0.2
                && (found.length / truth.length).ln().abs() < 0.2
        );
        // Independent errors are taken for such.
        let white: Vec<f64> = (0..20_000).map(|_| random.normal()).collect();
        let found =
            FadingNoise::most_likely(&times[..20_000], &white, 3, (0.005, 5.0)).expect("finite");
        let neighbours =
            found.shared * (-0.01 / found.length).exp() / (found.shared + found.independent);
        assert!(
            neighbours < 0.03 && (found.shared + found.independent - 1.0).abs() < 0.03,
            "{found:?}"
        );
    }
}
