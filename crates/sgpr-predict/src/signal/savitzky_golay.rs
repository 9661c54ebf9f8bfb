//! Weights of a sliding polynomial fit.

/// Weights of the samples of a window for the derivative of a polynomial at the window's centre, in
/// units of one over the sampling period to the power of the derivative; the first is that of the
/// first sample.
///
/// The polynomial of least squares is a sum of Gram polynomials, which are orthogonal over the
/// window: the weight of sample i is sum_k g_k(i) g_k^(s)(0) / |g_k|², k = 0..degree. No system of
/// equations is solved, so that long windows and high degrees lose no digits.
///
/// - `half`: samples on either side of the centre, m
/// - `degree`: of the polynomial, less than 2 m + 1
/// - `derivative`: s
///
/// Source: P. A. Gorry, General least-squares smoothing and differentiation by the convolution
/// (Savitzky-Golay) method, Anal. Chem. 62 (1990), eq. 8 to 11.
pub(super) fn weights(half: usize, degree: usize, derivative: usize) -> Vec<f64> {
    assert!(
        degree <= 2 * half,
        "a polynomial of degree {degree} has more freedom than {} samples",
        2 * half + 1
    );
    let m = half as f64;
    let at_centre = gram_polynomials(0.0, m, degree, derivative);
    // (2k + 1) (2m)! (2m)! / ((2m - k)! (2m + k + 1)!): one over the squared length, term by term.
    let mut inverse_squares = Vec::with_capacity(degree + 1);
    let mut ratio = 1.0 / (2.0 * m + 1.0);
    for k in 0..=degree {
        let order = k as f64;
        inverse_squares.push((2.0 * order + 1.0) * ratio);
        ratio *= (2.0 * m - order) / (2.0 * m + order + 2.0);
    }
    let weight = |i: usize| {
        let values = gram_polynomials(i as f64 - m, m, degree, 0);
        let terms = values.iter().zip(&at_centre).zip(&inverse_squares);
        terms.map(|((value, derived), inverse)| value * derived * inverse).sum()
    };
    (0..=2 * half).map(weight).collect()
}

/// Derivatives of the Gram polynomials of degree 0 to `degree` at `i`.
fn gram_polynomials(i: f64, m: f64, degree: usize, derivative: usize) -> Vec<f64> {
    let mut lower = vec![0.0; degree + 1];
    for s in 0..=derivative {
        let mut values: Vec<f64> = Vec::with_capacity(degree + 1);
        values.push(if s == 0 { 1.0 } else { 0.0 });
        for k in 1..=degree {
            let order = k as f64;
            let norm = order * (2.0 * m - order + 1.0);
            let before = if k > 1 { values[k - 2] } else { 0.0 };
            let rising = (4.0 * order - 2.0) / norm * (i * values[k - 1] + s as f64 * lower[k - 1]);
            values.push(rising - (order - 1.0) * (2.0 * m + order) / norm * before);
        }
        lower = values;
    }
    lower
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First, second, middle, last but one and last weight from the normal equations in rational
    /// numbers (Python's `fractions`); `scipy.signal.savgol_coeffs(window, degree, deriv,
    /// use="dot")` of SciPy 1.17.1 agrees to 1e-14, and to 1e-10 for the window of 101.
    #[test]
    fn agrees_with_exact_fits() {
        for (window, degree, derivative, expected) in EXACT {
            let found = weights(window / 2, degree, derivative);
            assert_eq!(found.len(), window);
            let largest =
                expected.iter().fold(0.0, |largest: f64, weight| largest.max(weight.abs()));
            for (place, expected) in
                [0, 1, window / 2, window - 2, window - 1].into_iter().zip(expected)
            {
                let found = found[place];
                assert!(
                    (found - expected).abs() < 1e-13 * largest,
                    "{window} {degree} {derivative}: {found} {expected}"
                );
            }
        }
    }

    #[rustfmt::skip]
    const EXACT: [(usize, usize, usize, [f64; 5]); 10] = [
        (5, 2, 1, [-0.2, -0.1, 0.0, 0.1, 0.2]),
        (5, 2, 2, [2.0 / 7.0, -1.0 / 7.0, -2.0 / 7.0, -1.0 / 7.0, 2.0 / 7.0]),
        (9, 4, 1, [0.0723905723905724, -0.11952861952861953, 0.0, 0.11952861952861953, -0.0723905723905724]),
        (9, 4, 2, [-0.07342657342657342, 0.2162004662004662, -0.21561771561771562, 0.2162004662004662, -0.07342657342657342]),
        (7, 6, 1, [-1.0 / 60.0, 0.15, 0.0, -0.15, 1.0 / 60.0]),
        (7, 6, 2, [1.0 / 90.0, -0.15, -49.0 / 18.0, -0.15, 1.0 / 90.0]),
        (21, 3, 1, [0.023135077482903568, 0.0027605244996549345, 0.0, -0.0027605244996549345, -0.023135077482903568]),
        (21, 3, 2, [0.00564652738565782, 0.003952569169960474, -0.0032690421706440013, 0.003952569169960474, 0.00564652738565782]),
        (101, 5, 1, [-0.0021312033444568423, -0.001305581677536408, 0.0, 0.001305581677536408, 0.0021312033444568423]),
        (101, 5, 2, [-0.00018105201988810225, -0.00013692534741327228, -0.00012755254106133263, -0.00013692534741327228, -0.00018105201988810225]),
    ];
}
