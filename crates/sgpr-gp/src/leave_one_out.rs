use super::Data;
use sgpr_numeric::internal::intervals::{HALF_INTERVAL_95, WITHIN_ONE_DEVIATION};

/// Predictions of every point by the others, with the hyperparameters of all.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LeaveOneOut {
    /// Mean, `[points, outputs]`, row-major.
    pub mean: Vec<f64>,
    /// Variance of the measurement, `[points]`.
    pub variance: Vec<f64>,
    /// Sum of the log densities of the measurements under these predictions.
    pub log_predictive_density: f64,
}

/// What standard deviations of a measurement have to be multiplied by so that intervals hold what
/// they say.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Calibration {
    /// To give half of the interval that 68 % of the errors fall into.
    pub deviation: f64,
    /// To give half of the interval that 95 % fall into: 1.96 times the above for errors with a
    /// normal distribution.
    pub half_interval_95: f64,
}

impl Calibration {
    /// For errors with a normal distribution.
    #[doc(hidden)]
    pub const NORMAL: Self = Self { deviation: 1.0, half_interval_95: HALF_INTERVAL_95 };

    /// From (error, variance) of unseen measurements: the quantiles of the errors in standard
    /// deviations.
    ///
    /// - `rank`: of a share among the sorted errors, from zero on
    /// - `wider`: factor on the quantiles
    #[doc(hidden)]
    pub fn of(
        errors: impl Iterator<Item = (f64, f64)>,
        rank: impl Fn(f64) -> usize,
        wider: f64,
    ) -> Self {
        let mut ratios: Vec<f64> =
            errors.map(|(error, variance)| error.abs() / variance.sqrt()).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        // Errors that are all zero leave nothing to multiply.
        let quantile = |share: f64| (wider * ratios[rank(share)]).max(1e-6);
        Self { deviation: quantile(WITHIN_ONE_DEVIATION), half_interval_95: quantile(0.95) }
    }
}

/// Fewer points say too little about the ends of a distribution.
const FEWEST: usize = 100;

impl LeaveOneOut {
    /// - `errors`: measurement less prediction, `[points, outputs]`, row-major
    /// - `variance`: `[points]`
    pub(super) fn new(data: &Data, errors: &[f64], variance: Vec<f64>) -> Self {
        let outputs = data.outputs();
        let mut log_predictive_density = 0.0;
        for (errors, variance) in errors.chunks_exact(outputs).zip(&variance) {
            for error in errors {
                log_predictive_density -=
                    0.5 * ((std::f64::consts::TAU * variance).ln() + error * error / variance);
            }
        }
        let mean = data.y().iter().zip(errors).map(|(y, error)| y - error).collect();
        Self { mean, variance, log_predictive_density }
    }

    /// How wide intervals of each output have to be, by the quantiles of these errors in standard
    /// deviations: a normal distribution with the variance of the errors is too wide in the middle
    /// if they have heavy tails, and too narrow at the ends. Of fewer than 100 points those of a
    /// normal distribution.
    ///
    /// It holds for points that are drawn as those of the data were. Samples of one log are not:
    /// their neighbours give them away.
    ///
    /// # Panics
    /// If these are predictions of other data.
    pub fn calibration(&self, data: &Data) -> Vec<Calibration> {
        let (outputs, points) = (data.outputs(), data.len());
        assert_eq!(
            (self.variance.len(), self.mean.len()),
            (points, points * outputs),
            "predictions of the data"
        );
        if points < FEWEST {
            return vec![Calibration::NORMAL; outputs];
        }
        // Of one point more, the new one, which falls between any two of the others as likely as
        // between any other two.
        let rank = |share: f64| (share * (points + 1) as f64).ceil() as usize - 1;
        let errors: Vec<f64> = data.y().iter().zip(&self.mean).map(|(y, mean)| y - mean).collect();
        let of_output = |output: usize| errors.iter().skip(output).step_by(outputs).copied();
        (0..outputs)
            .map(|o| Calibration::of(of_output(o).zip(self.variance.iter().copied()), rank, 1.0))
            .collect()
    }
}
