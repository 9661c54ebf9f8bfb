//! Whether a step makes a model better: on data that no step saw, beyond the standard error.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Errors of two models on parts of the data that neither saw, compared part by part.
///
/// Parts are blocks of time, logs or sessions: errors within one go together, so a part is one
/// observation.
///
/// Source: L. Breiman, J. H. Friedman, R. A. Olshen, C. J. Stone, Classification and Regression
/// Trees (1984), section 3.4.3: the simpler model, unless the other is better by more than one
/// standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Judgement {
    /// What the second model saves, as a share of the error of the first; negative if it is worse.
    pub gain: f64,
    /// Standard error of `gain`, from how much the parts differ; infinite for fewer than two parts.
    pub standard_error: f64,
    /// Parts compared.
    pub parts: usize,
}

impl Judgement {
    /// - `errors`: for each part the errors of the first and of the second model, sums of sizes or
    ///   of squares of the same rows; parts in which neither errs say nothing
    pub fn of(errors: &[(f64, f64)]) -> Self {
        let said: Vec<(f64, f64)> = errors
            .iter()
            .copied()
            .filter(|(before, after)| *before > 0.0 || *after > 0.0)
            .collect();
        let count = said.len() as f64;
        let before: f64 = said.iter().map(|(before, _)| before).sum();
        let gains = || said.iter().map(|(before, after)| before - after);
        let mean = gains().sum::<f64>() / count;
        let variance = gains().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let share = |gain: f64| gain * count / before.max(f64::MIN_POSITIVE);
        match said.len() {
            0 => Self { gain: 0.0, standard_error: f64::INFINITY, parts: 0 },
            1 => Self { gain: share(mean), standard_error: f64::INFINITY, parts: 1 },
            parts => Self {
                gain: share(mean),
                standard_error: share((variance / count).sqrt()).abs(),
                parts,
            },
        }
    }

    /// The same of parts that overlap, of which only so many are independent.
    #[must_use]
    pub fn of_independent(self, count: f64) -> Self {
        Self {
            standard_error: self.standard_error * (self.parts as f64 / count).max(1.0).sqrt(),
            ..self
        }
    }

    /// The gain in standard errors: the normal deviate that is as improbable as Student's t with as
    /// few parts.
    pub fn deviate(&self) -> f64 {
        if self.parts < 2 {
            return 0.0;
        }
        deviate_of_t(
            self.gain / self.standard_error.max(f64::MIN_POSITIVE),
            self.parts as f64 - 1.0,
        )
    }

    /// Whether the second model is better by more than the standard error.
    pub fn is_better(&self) -> bool {
        self.gain > self.standard_error
    }

    /// Whether the first one is better by more than the standard error.
    pub fn is_worse(&self) -> bool {
        self.gain < -self.standard_error
    }
}

/// The normal deviate that is as improbable as Student's t with so many degrees of freedom.
pub(crate) fn deviate_of_t(t: f64, freedom: f64) -> f64 {
    let student = StudentsT::new(0.0, 1.0, freedom).expect("positive degrees of freedom");
    // By the smaller tail, whose probability does not round to one.
    let deviate = -Normal::standard().inverse_cdf(student.sf(t.abs()).max(f64::MIN_POSITIVE));
    deviate.copysign(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_counts_if_the_parts_agree() {
        let of = |after: [f64; 4]| Judgement::of(&after.map(|after| (1.0, after)));
        let even = of([0.5; 4]);
        assert_eq!((even.gain, even.standard_error, even.parts), (0.5, 0.0, 4));
        assert!(even.is_better() && !even.is_worse());
        // Gains 0.9, -0.1, -0.1, -0.1: mean 0.15, deviation 0.5, standard error 0.25.
        let one = of([0.1, 1.1, 1.1, 1.1]);
        assert!((one.gain - 0.15).abs() < 1e-12 && (one.standard_error - 0.25).abs() < 1e-12);
        assert!(!one.is_better() && !one.is_worse());
        assert!(of([1.2; 4]).is_worse());
        // Four halves of which two overlap with the other two are two: the standard error is that
        // of two.
        let halves = of([0.1, 0.1, 0.7, 0.7]);
        assert!(
            (halves.of_independent(2.0).standard_error / halves.standard_error - 2.0f64.sqrt())
                .abs()
                < 1e-12
        );
        assert_eq!(halves.of_independent(8.0), halves);
    }

    #[test]
    fn few_parts_are_less_sure() {
        let of = |parts| Judgement { gain: 3.0, standard_error: 1.0, parts };
        // P(t > 3) is 0.1024 with one degree of freedom and 0.0150 with five: normal deviates 1.268
        // and 2.169.
        assert!((of(2).deviate() - 1.268).abs() < 1e-3 && (of(6).deviate() - 2.169).abs() < 2e-3);
        assert!((of(10_000).deviate() - 3.0).abs() < 1e-2);
        assert_eq!(of(1).deviate(), 0.0);
        assert!(Judgement { gain: -3.0, ..of(6) }.deviate() < -2.0);
    }

    #[test]
    fn parts_without_error_say_nothing_and_one_part_proves_nothing() {
        assert_eq!(Judgement::of(&[(0.0, 0.0), (2.0, 1.0)]).parts, 1);
        assert!(!Judgement::of(&[(2.0, 1.0)]).is_better());
        assert_eq!(Judgement::of(&[]).parts, 0);
        assert!(!Judgement::of(&[(1.0, 2.0)]).is_worse());
    }
}
