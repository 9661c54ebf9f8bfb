//! Sine and cosine of a slice, a register at a time.

use pulp::{Arch, Simd, WithSimd};

/// Beyond this the three-part reduction below loses bits, and the library function is used instead.
const LARGEST_ANGLE: f64 = 1e5;

/// Adding and subtracting this rounds to an integer whose low bits stand in the low bits of the
/// sum.
const ROUND_TO_INTEGER: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52

// pi/2 in three parts of 53 bits each.
const HALF_PI_1: f64 = std::f64::consts::FRAC_PI_2;
const HALF_PI_2: f64 = 6.123_233_995_736_766e-17;
const HALF_PI_3: f64 = -1.497_384_904_859_169_8e-33;

/// Minimax coefficients on [-pi/4, pi/4], from fdlibm's `__kernel_sin` and `__kernel_cos` (Sun
/// Microsystems, 1993).
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Writes sin(x) and cos(x) of every `x` of `angle`; within 2 units in the last place, also for
/// large and non-finite angles.
///
/// All three slices have the same length.
#[inline(always)]
pub fn sin_cos_slice<S: Simd>(simd: S, angle: &[f64], sin: &mut [f64], cos: &mut [f64]) {
    // `abs() <= limit` is false for NaN, which then also takes the exact path.
    let mut small = true;
    for x in angle {
        small &= x.abs() <= LARGEST_ANGLE;
    }
    if S::IS_SCALAR || !small {
        for ((x, s), c) in angle.iter().zip(sin).zip(cos) {
            (*s, *c) = x.sin_cos();
        }
        return;
    }
    let width = S::F64_LANES;
    let count = angle.len();
    if count < width {
        let (s, c) = sin_cos(simd, simd.partial_load_f64s(angle));
        simd.partial_store_f64s(sin, s);
        simd.partial_store_f64s(cos, c);
        return;
    }
    // Whole registers only, the last one overlapping the one before: partial loads cost a call.
    for start in (0..count - width).step_by(width).chain([count - width]) {
        let (s, c) = sin_cos(simd, S::as_simd_f64s(&angle[start..]).0[0]);
        S::as_mut_simd_f64s(&mut sin[start..]).0[0] = s;
        S::as_mut_simd_f64s(&mut cos[start..]).0[0] = c;
    }
}

/// Replaces every angle by its cosine.
pub fn cos_in_place(angles: &mut [f64]) {
    Arch::new().dispatch(Cosines(angles));
}

struct Cosines<'a>(&'a mut [f64]);

impl WithSimd for Cosines<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const AT_ONCE: usize = 64;
        let (mut sin, mut cos) = ([0.0; AT_ONCE], [0.0; AT_ONCE]);
        for angles in self.0.chunks_mut(AT_ONCE) {
            let count = angles.len();
            sin_cos_slice(simd, angles, &mut sin[..count], &mut cos[..count]);
            angles.copy_from_slice(&cos[..count]);
        }
    }
}

/// Cody-Waite reduction to [-pi/4, pi/4] and two polynomials; the quadrant swaps them and sets the
/// signs.
#[inline(always)]
fn sin_cos<S: Simd>(simd: S, x: S::f64s) -> (S::f64s, S::f64s) {
    let magic = simd.splat_f64s(ROUND_TO_INTEGER);
    let rounded = simd.mul_add_f64s(x, simd.splat_f64s(std::f64::consts::FRAC_2_PI), magic);
    let quadrant = simd.transmute_u64s_f64s(rounded);
    let turns = simd.sub_f64s(magic, rounded);
    let r = simd.mul_add_f64s(turns, simd.splat_f64s(HALF_PI_1), x);
    let r = simd.mul_add_f64s(turns, simd.splat_f64s(HALF_PI_2), r);
    let r = simd.mul_add_f64s(turns, simd.splat_f64s(HALF_PI_3), r);

    let z = simd.mul_f64s(r, r);
    let sin = simd.mul_add_f64s(simd.mul_f64s(z, r), polynomial(simd, &SIN, z), r);
    let half = simd.mul_f64s(z, simd.splat_f64s(0.5));
    let one_minus = simd.sub_f64s(simd.splat_f64s(1.0), half);
    let rounding = simd.sub_f64s(simd.sub_f64s(simd.splat_f64s(1.0), one_minus), half);
    let tail = simd.mul_add_f64s(simd.mul_f64s(z, z), polynomial(simd, &COS, z), rounding);
    let cos = simd.add_f64s(one_minus, tail);

    let one = simd.splat_u64s(1);
    let odd = simd.equal_u64s(simd.and_u64s(quadrant, one), one);
    (
        flip(simd, simd.select_f64s(odd, cos, sin), quadrant),
        flip(simd, simd.select_f64s(odd, sin, cos), simd.add_u64s(quadrant, one)),
    )
}

#[inline(always)]
fn polynomial<S: Simd>(simd: S, coefficients: &[f64; 6], z: S::f64s) -> S::f64s {
    let mut p = simd.splat_f64s(coefficients[5]);
    for k in (0..5).rev() {
        p = simd.mul_add_f64s(p, z, simd.splat_f64s(coefficients[k]));
    }
    p
}

/// Changes the sign in the third and fourth quadrant.
#[inline(always)]
fn flip<S: Simd>(simd: S, value: S::f64s, quadrant: S::u64s) -> S::f64s {
    let two = simd.splat_u64s(2);
    let negative = simd.equal_u64s(simd.and_u64s(quadrant, two), two);
    simd.select_f64s(negative, simd.neg_f64s(value), value)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Slice<'a> {
        angle: &'a [f64],
        sin: &'a mut [f64],
        cos: &'a mut [f64],
    }

    impl WithSimd for Slice<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            sin_cos_slice(simd, self.angle, self.sin, self.cos);
        }
    }

    fn evaluate(angle: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut sin = vec![0.0; angle.len()];
        let mut cos = vec![0.0; angle.len()];
        Arch::new().dispatch(Slice { angle, sin: &mut sin, cos: &mut cos });
        (sin, cos)
    }

    #[test]
    fn agrees_with_the_standard_library_within_two_units_in_the_last_place() {
        // Multiples of pi/2 are where the reduction cancels; an irrational step visits every
        // quadrant.
        let angle: Vec<f64> = (-40_000..40_000)
            .map(|k| f64::from(k) * 0.037_123)
            .chain((-200..200).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_2))
            .chain([0.0, -0.0, 1e-300, 99_999.9, -31_415.926_535_897_93])
            .collect();
        let (sin, cos) = evaluate(&angle);
        for ((x, s), c) in angle.iter().zip(&sin).zip(&cos) {
            for (value, expected) in [(s, x.sin()), (c, x.cos())] {
                let tolerance = 2.0 * f64::EPSILON * expected.abs().max(1e-17);
                assert!(
                    (value - expected).abs() <= tolerance,
                    "{x}: {value:e} against {expected:e}"
                );
            }
        }
    }

    #[test]
    fn large_and_non_finite_angles_take_the_exact_path() {
        let (sin, cos) = evaluate(&[1e6, f64::NAN, f64::INFINITY]);
        assert_eq!((sin[0], cos[0]), 1e6f64.sin_cos());
        assert!(sin[1].is_nan() && cos[2].is_nan());
    }
}
