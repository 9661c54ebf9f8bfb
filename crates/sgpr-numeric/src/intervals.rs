//! Intervals that errors fall into: by a normal distribution, and by errors that were seen.

/// Share of a normal distribution within one standard deviation.
pub const WITHIN_ONE_DEVIATION: f64 = 0.682_689;

/// Half the interval of 95 % of a normal distribution, in standard deviations.
pub const HALF_INTERVAL_95: f64 = 1.96;

/// Place of the value of a sorted list below which this share of it lies.
///
/// # Panics
/// If the list has no values.
pub fn place_of_share(share: f64, values: usize) -> usize {
    ((share * values as f64) as usize).min(values - 1)
}
