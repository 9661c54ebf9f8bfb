//! The exponential of numbers that are not positive, a register at a time.

use pulp::Simd;

/// Below this the result is zero: numbers close to the smallest ones would slow every product down that they enter,
/// and 1e-38 of a variance says nothing.
const LOWEST: f64 = -87.0;

/// Adding and subtracting these rounds to an integer whose low bits stand in the low bits of the sum.
const ROUND_F64: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
const ROUND_F32: f32 = 12_582_912.0; // 1.5 * 2^23

// ln 2 in two parts, the first with zeros at its end, from fdlibm and Cephes.
const LN2_F64: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
const LN2_F32: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];

/// Taylor coefficients of exp, 1/k! from the highest: on [-ln 2 / 2, ln 2 / 2] the rest after the twelfth power is below
/// 2e-16, after the seventh below 5e-9.
const TAYLOR_F64: [f64; 13] = [
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];
const TAYLOR_F32: [f32; 8] = [1.0 / 5_040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];

macro_rules! exponential {
    ($name:ident, $float:ty, $bits:ty, $floats:ident, $round:ident, $ln2:ident, $taylor:ident, $log2e:expr, $shift:expr,
     $splat:ident, $sub:ident, $mul_add:ident, $less:ident, $select:ident) => {
        /// exp(x) of every x <= 0, within two units in the last place; zero below -87.
        #[inline(always)]
        pub(crate) fn $name<S: Simd>(simd: S, x: S::$floats) -> S::$floats {
            let rounded = simd.$mul_add(x, simd.$splat($log2e), simd.$splat($round));
            let power = simd.$sub(rounded, simd.$splat($round));
            let r = simd.$mul_add(power, simd.$splat(-$ln2[0]), x);
            let r = simd.$mul_add(power, simd.$splat(-$ln2[1]), r);
            let mut p = simd.$splat($taylor[0]);
            for c in &$taylor[1..] {
                p = simd.$mul_add(p, r, simd.$splat(*c));
            }
            // Times a power of two, by way of the exponent.
            let mut scaled = p;
            let lanes = bytemuck::cast_slice_mut::<S::$floats, $bits>(std::slice::from_mut(&mut scaled));
            let powers = bytemuck::cast_slice::<S::$floats, $bits>(std::slice::from_ref(&rounded));
            lanes.iter_mut().zip(powers).for_each(|(p, power)| *p = p.wrapping_add(power << $shift));
            simd.$select(simd.$less(x, simd.$splat(LOWEST as $float)), simd.$splat(0.0), scaled)
        }
    };
}

exponential!(
    exp_f64,
    f64,
    u64,
    f64s,
    ROUND_F64,
    LN2_F64,
    TAYLOR_F64,
    std::f64::consts::LOG2_E,
    52,
    splat_f64s,
    sub_f64s,
    mul_add_e_f64s,
    less_than_f64s,
    select_f64s
);
exponential!(
    exp_f32,
    f32,
    u32,
    f32s,
    ROUND_F32,
    LN2_F32,
    TAYLOR_F32,
    std::f32::consts::LOG2_E,
    23,
    splat_f32s,
    sub_f32s,
    mul_add_e_f32s,
    less_than_f32s,
    select_f32s
);

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct Both<'a>(&'a mut [f64], &'a mut [f32]);

    impl WithSimd for Both<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            let (wide, narrow) = (self.0.chunks_mut(S::F64_LANES), self.1.chunks_mut(S::F32_LANES));
            wide.for_each(|x| simd.partial_store_f64s(x, exp_f64(simd, simd.partial_load_f64s(x))));
            narrow.for_each(|x| simd.partial_store_f32s(x, exp_f32(simd, simd.partial_load_f32s(x))));
        }
    }

    #[test]
    fn agrees_with_the_standard_library_within_two_units_in_the_last_place() {
        let x: Vec<f64> = (0..87_000).map(|k| -0.001 * f64::from(k)).chain([-0.0, -1e-300, -1e-9]).collect();
        let (mut wide, mut narrow) = (x.clone(), x.iter().map(|x| *x as f32).collect::<Vec<_>>());
        Arch::new().dispatch(Both(&mut wide, &mut narrow));
        for ((x, wide), narrow) in x.iter().zip(&wide).zip(&narrow) {
            assert!((wide - x.exp()).abs() <= 2.0 * f64::EPSILON * x.exp(), "{x}: {wide:e}");
            let expected = f64::from(*x as f32).exp();
            assert!((f64::from(*narrow) - expected).abs() <= 2.0 * f64::from(f32::EPSILON) * expected, "{x}");
        }
        let mut far = [-87.5, -1e3, -1e300, f64::NEG_INFINITY];
        Arch::new().dispatch(Both(&mut far, &mut [-90.0, -1e30]));
        assert_eq!(far, [0.0; 4]);
    }
}
