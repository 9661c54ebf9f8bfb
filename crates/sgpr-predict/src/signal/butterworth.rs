//! Second-order sections of a digital Butterworth low-pass.

/// One biquad: y = (b0 + b1/z + b2/z²) / (1 + a1/z + a2/z²) x, with its state for a constant input
/// of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Section {
    pub b: [f64; 3],
    pub a: [f64; 2],
    pub steady: [f64; 2],
}

impl Section {
    /// A section with these poles and all its zeros at half the sampling rate, where a constant
    /// passes with a gain of one to the last digit.
    fn low_pass(a: [f64; 2], zeros: usize) -> Self {
        let level = 1.0 + a[0] + a[1];
        let b = if zeros == 1 {
            [0.5 * level, 0.5 * level, 0.0]
        } else {
            [0.25, 0.5, 0.25].map(|share| share * level)
        };
        Self { b, a, steady: [1.0 - b[0], b[2] - a[1]] }
    }
}

/// Sections of a Butterworth low-pass, the weakest damped last, so that the others have calmed what
/// reaches it.
///
/// With K = tan(pi fc / fs), the bilinear transform s = (z - 1) / (K (z + 1)) makes 1 / (s² + d s +
/// 1), of damping d = 2 sin(pi (2k - 1) / 2N), a section with a1 = 2 (K² - 1) / (1 + d K + K²) and
/// a2 = (1 - d K + K²) / (1 + d K + K²); an odd order has 1 / (s + 1) too.
///
/// - `order`: N
/// - `ratio`: cut-off over sampling rate, fc / fs
///
/// Source: A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing (2010), sections 7.3 and
/// B.1.
pub(super) fn sections(order: usize, ratio: f64) -> Vec<Section> {
    let warped = (std::f64::consts::PI * ratio).tan();
    let square = warped * warped;
    let real =
        (order % 2 == 1).then(|| Section::low_pass([(warped - 1.0) / (warped + 1.0), 0.0], 1));
    let pair = |k: usize| {
        let damping = 2.0 * (std::f64::consts::FRAC_PI_2 * (2 * k - 1) as f64 / order as f64).sin();
        let norm = 1.0 + damping * warped + square;
        let a = [
            2.0 * (warped - 1.0) * (warped + 1.0) / norm,
            (1.0 - damping * warped + square) / norm,
        ];
        Section::low_pass(a, 2)
    };
    real.into_iter().chain((1..=order / 2).rev().map(pair)).collect()
}
