//! Intervals from a spread that few independent parts of the data show.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// By what the halves of intervals of 68 and 95 % are larger than with a spread that is known, if it is estimated from
/// `parts` independent parts: Student's quantiles in those of the normal distribution. Infinite for fewer than two.
pub(crate) fn widening(parts: usize) -> [f64; 2] {
    let normal = Normal::standard();
    let Ok(student) = StudentsT::new(0.0, 1.0, parts as f64 - 1.0) else { return [f64::INFINITY; 2] };
    [normal.cdf(1.0), 0.975].map(|rank| student.inverse_cdf(rank) / normal.inverse_cdf(rank))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Student's t of 4 degrees of freedom: 2.7764 at 0.975 (tables), where the normal has 1.95996; 1.1416 at 0.841345.
        let [narrow, wide] = widening(5);
        assert!((wide - 2.776_445 / 1.959_964).abs() < 1e-5 && (narrow - 1.141_6).abs() < 1e-3, "{narrow} {wide}");
        // One degree of freedom is Cauchy's law: tan(pi (p - 1/2)).
        let cauchy = (std::f64::consts::PI * 0.475).tan();
        assert!((widening(2)[1] - cauchy / 1.959_964).abs() < 1e-4);
        assert!(widening(100_000).into_iter().all(|factor| (factor - 1.0).abs() < 1e-4));
        assert_eq!(widening(1), [f64::INFINITY; 2]);
    }
}
