//! Powers of two of numbers that are not positive, a register at a time: the exponential of
//! kernels, whose logarithm has a factor before it anyhow.

use super::registers::{Simd, lanes_f32, lanes_f64};

/// Below this the result is zero: numbers close to the smallest ones would slow every product down
/// that they enter, and 1e-38 of a variance says nothing.
const LOWEST: f64 = -125.5;

/// Adding and subtracting these rounds to an integer whose low bits stand in the low bits of the
/// sum.
const ROUND_F64: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
const ROUND_F32: f32 = 12_582_912.0; // 1.5 * 2^23

/// Coefficients of 2^x on [-1/2, 1/2] from the highest. In 64 bits those of Taylor, (ln 2)^k / k!,
/// with a rest below 2e-16; in 32 bits those of the polynomial through the Chebyshev nodes, within
/// 3e-9.
const SERIES_F64: [f64; 13] = [
    2.567_843_599_348_82e-11,
    4.445_538_271_870_81e-10,
    7.054_911_620_801_121e-9,
    1.017_808_600_923_969_7e-7,
    1.321_548_679_014_430_5e-6,
    1.525_273_380_405_983_8e-5,
    1.540_353_039_338_160_6e-4,
    1.333_355_814_642_844_1e-3,
    9.618_129_107_628_477e-3,
    5.550_410_866_482_157_6e-2,
    2.402_265_069_591_007e-1,
    core::f64::consts::LN_2,
    1.0,
];
const SERIES_F32: [f32; 7] =
    [1.546_144_5e-4, 1.340_042_8e-3, 9.618_057e-3, 5.550_327e-2, 2.402_265e-1, 6.931_472e-1, 1.0];

macro_rules! power_of_two {
    ($name:ident, $float:ty, $floats:ident, $round:ident, $series:ident, $shift:expr, $lanes:ident,
     $splat:ident, $add:ident, $sub:ident, $mul_add:ident, $less:ident, $select:ident) => {
        /// 2^x of every x <= 0, within two units in the last place; zero below -125.5.
        #[inline(always)]
        pub fn $name<S: Simd>(simd: S, x: S::$floats) -> S::$floats {
            let rounded = simd.$add(x, simd.$splat($round));
            let rest = simd.$sub(x, simd.$sub(rounded, simd.$splat($round)));
            let mut power = simd.$splat($series[0]);
            for c in &$series[1..] {
                power = simd.$mul_add(power, rest, simd.$splat(*c));
            }
            // Times a power of an integer, by way of the exponent.
            let (mut scaled, mut rounded) = (power, rounded);
            for (lane, integer) in
                $lanes::<S>(&mut scaled).iter_mut().zip($lanes::<S>(&mut rounded))
            {
                *lane =
                    <$float>::from_bits(lane.to_bits().wrapping_add(integer.to_bits() << $shift));
            }
            simd.$select(simd.$less(x, simd.$splat(LOWEST as $float)), simd.$splat(0.0), scaled)
        }
    };
}

power_of_two!(
    power_of_two_f64,
    f64,
    f64s,
    ROUND_F64,
    SERIES_F64,
    52,
    lanes_f64,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_add_e_f64s,
    less_than_f64s,
    select_f64s
);
power_of_two!(
    power_of_two_f32,
    f32,
    f32s,
    ROUND_F32,
    SERIES_F32,
    23,
    lanes_f32,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_add_e_f32s,
    less_than_f32s,
    select_f32s
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Arch, WithSimd};

    struct Both<'a>(&'a mut [f64], &'a mut [f32]);

    impl WithSimd for Both<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            let ((wide, rest), (narrow, other_rest)) =
                (S::as_mut_simd_f64s(self.0), S::as_mut_simd_f32s(self.1));
            assert!(rest.is_empty() && other_rest.is_empty(), "whole registers");
            wide.iter_mut().for_each(|x| *x = power_of_two_f64(simd, *x));
            narrow.iter_mut().for_each(|x| *x = power_of_two_f32(simd, *x));
        }
    }

    #[test]
    fn agrees_with_the_standard_library_within_two_units_in_the_last_place() {
        let mut x: Vec<f64> =
            (0..125_000).map(|k| -0.001 * f64::from(k)).chain([-0.0, -1e-300, -1e-9]).collect();
        x.resize(x.len().next_multiple_of(16), -1.0);
        let (mut wide, mut narrow) = (x.clone(), x.iter().map(|x| *x as f32).collect::<Vec<_>>());
        Arch::new().dispatch(Both(&mut wide, &mut narrow));
        for ((x, wide), narrow) in x.iter().zip(&wide).zip(&narrow) {
            assert!((wide - x.exp2()).abs() <= 2.0 * f64::EPSILON * x.exp2(), "{x}: {wide:e}");
            let expected = f64::from(*x as f32).exp2();
            assert!(
                (f64::from(*narrow) - expected).abs() <= 2.0 * f64::from(f32::EPSILON) * expected,
                "{x}"
            );
        }
        let mut far = [-125.6, -1e3, -1e300, f64::NEG_INFINITY].repeat(4);
        Arch::new().dispatch(Both(&mut far, &mut [-126.0, -1e30].repeat(8)));
        assert_eq!(far, [0.0; 16]);
    }
}
