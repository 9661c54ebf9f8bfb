//! How far two results are apart.

/// Infinite if one of them is not a number.
pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let worse = |worst: f64, (a, b): (&f64, &f64)| {
        let difference = (a - b).abs();
        if difference.is_nan() { f64::INFINITY } else { worst.max(difference) }
    };
    a.iter().zip(b).fold(0.0, worse)
}
