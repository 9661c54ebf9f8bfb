//! Arithmetic on a tile of points, small enough for the first-level cache, in `f64` and in `f32`.

#[cfg(feature = "std")]
use core::primitive::f64 as of_f64;

use super::Shape;
#[cfg(not(feature = "std"))]
use crate::math as of_f64;
use crate::simd::{Simd, lanes_f32, lanes_f64, power_of_two_f32, power_of_two_f64};

/// Points per tile; a multiple of the lanes of every register.
pub const TILE: usize = 256;

/// Registers of points that share what is read of a query.
pub const REGISTERS: usize = 4;

/// Numbers of one row before those of the next in a block of four; the lanes of the widest
/// register.
pub const BLOCK: usize = 16;

/// A number that kernels are computed in.
pub trait Element: Copy + Default + Send + Sync + core::fmt::Debug + 'static {
    /// As many numbers as the instruction set has lanes.
    type Register<S: Simd>: Copy;

    /// The nearest number.
    fn from_f64(value: f64) -> Self;
    /// The same number.
    fn to_f64(self) -> f64;

    /// The first registers of a slice.
    fn load<S: Simd, const COUNT: usize>(slice: &[Self]) -> [Self::Register<S>; COUNT];

    /// Writes registers to the beginning of a slice.
    fn store<S: Simd, const COUNT: usize>(
        registers: [Self::Register<S>; COUNT],
        slice: &mut [Self],
    );

    /// A register of one number.
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Register<S>;

    /// factor x.
    fn times<S: Simd>(simd: S, factor: f64, x: Self::Register<S>) -> Self::Register<S>;

    /// exp(factor x), where that is at most one.
    fn decay<S: Simd>(simd: S, factor: f64, x: Self::Register<S>) -> Self::Register<S>;

    /// a b + c.
    fn mul_add<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        c: Self::Register<S>,
    ) -> Self::Register<S>;

    /// Sum of all numbers.
    fn sum<S: Simd>(simd: S, registers: [Self::Register<S>; REGISTERS]) -> f64;

    /// sum over columns of (x - c)², for as many points as `r2` has; column m of x starts at
    /// `m * stride`.
    fn squared_distances<S: Simd>(simd: S, x: &[Self], stride: usize, c: &[Self], r2: &mut [Self]);

    /// The same for so many registers from `start` on.
    fn squares_at<S: Simd, const COUNT: usize>(
        simd: S,
        x: &[Self],
        stride: usize,
        start: usize,
        c: &[Self],
    ) -> [Self::Register<S>; COUNT];

    /// norms + norm + sum over digits of units * products, no less than zero; the products are
    /// integers with a sign, as many in all registers as there are norms.
    #[cfg(feature = "simd")]
    fn squares_from_products<S: Simd, const COUNT: usize>(
        simd: S,
        norms: [Self::Register<S>; REGISTERS],
        norm: Self,
        products: &[[S::u32s; COUNT]; 2],
        units: [Self; 2],
    ) -> [Self::Register<S>; REGISTERS];

    /// As many times as there are `K` kernels: sum over columns of weight (x - c)², for as many
    /// points as a row of `r2` uses. The squared differences are shared.
    ///
    /// - `x`: column m starts at `m * TILE`, `length` of it are used
    /// - `weights`: `[columns, K]`
    /// - `r2`: kernel k starts at `k * TILE`
    fn weighted_distances<S: Simd, const K: usize>(
        simd: S,
        x: &[Self],
        length: usize,
        c: &[Self],
        weights: &[[Self; K]],
        r2: &mut [Self],
    );

    /// The same for so many registers from `start` on: their sums stay in registers.
    fn distances_at<S: Simd, const K: usize, const REGISTERS: usize>(
        simd: S,
        x: &[Self],
        start: usize,
        c: &[Self],
        weights: &[[Self; K]],
        r2: &mut [Self],
    );

    /// Values at squared distances, and their derivatives by the squared distance where `SLOPES`
    /// (else the values again).
    fn shape_at<S: Simd, const SLOPES: bool>(
        simd: S,
        shape: Shape,
        r2: Self::Register<S>,
    ) -> [Self::Register<S>; 2];

    /// The same for slices, of whole registers.
    fn shape<S: Simd, const SLOPES: bool>(
        simd: S,
        shape: Shape,
        r2: &[Self],
        k: &mut [Self],
        slope: &mut [Self],
    );

    /// sum of a b, in double precision from register to register.
    fn dot<S: Simd>(simd: S, a: &[Self], b: &[Self]) -> f64;

    /// The products of four rows with a vector.
    ///
    /// - `rows`: `[length / BLOCK, 4, BLOCK]`, with the length of `b` a multiple of `BLOCK`
    fn four_dots<S: Simd>(simd: S, rows: &[Self], b: &[Self]) -> [f64; 4];

    /// sum of w (x - c)².
    fn weighted_squares<S: Simd>(simd: S, w: &[Self], x: &[Self], c: Self) -> f64;

    /// sum of w (x - c).
    fn weighted_differences<S: Simd>(simd: S, w: &[Self], x: &[Self], c: Self) -> f64;

    /// out = factor * a.
    fn scale(factor: Self, a: &[Self], out: &mut [Self]);

    /// out += a.
    fn add_to(a: &[Self], out: &mut [Self]);

    /// out *= a.
    fn multiply_to(a: &[Self], out: &mut [Self]);
}

macro_rules! element {
    ($float:ident, $power_of_two:ident, $lanes:ident, $registers:ident, $as_simd:ident, $as_mut_simd:ident, $splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $max:ident, $sqrt:ident, $mul_add:ident, $sum:ident) => {
        impl Element for $float {
            type Register<S: Simd> = S::$registers;

            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as Self
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                self.into()
            }

            #[inline(always)]
            fn load<S: Simd, const COUNT: usize>(slice: &[Self]) -> [S::$registers; COUNT] {
                *S::$as_simd(slice).0.first_chunk().expect("as many as are asked for")
            }

            #[inline(always)]
            fn store<S: Simd, const COUNT: usize>(
                registers: [S::$registers; COUNT],
                slice: &mut [Self],
            ) {
                *S::$as_mut_simd(slice).0.first_chunk_mut().expect("room for all") = registers;
            }

            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$registers {
                simd.$splat(value)
            }

            #[inline(always)]
            fn times<S: Simd>(simd: S, factor: f64, x: S::$registers) -> S::$registers {
                simd.$mul(simd.$splat(factor as Self), x)
            }

            #[inline(always)]
            fn decay<S: Simd>(simd: S, factor: f64, x: S::$registers) -> S::$registers {
                $power_of_two(simd, Self::times(simd, core::f64::consts::LOG2_E * factor, x))
            }

            #[inline(always)]
            fn mul_add<S: Simd>(
                simd: S,
                a: S::$registers,
                b: S::$registers,
                c: S::$registers,
            ) -> S::$registers {
                simd.$mul_add(a, b, c)
            }

            #[inline(always)]
            fn sum<S: Simd>(simd: S, [a, b, c, d]: [S::$registers; REGISTERS]) -> f64 {
                simd.$sum(simd.$add(simd.$add(a, b), simd.$add(c, d))).into()
            }

            #[inline(always)]
            fn squared_distances<S: Simd>(
                simd: S,
                x: &[Self],
                stride: usize,
                c: &[Self],
                r2: &mut [Self],
            ) {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let fours = r2.len() / (4 * lanes);
                for start in (0..fours).map(|four| 4 * lanes * four) {
                    Self::store::<S, 4>(
                        Self::squares_at(simd, x, stride, start, c),
                        &mut r2[start..],
                    );
                }
                for start in (4 * fours..r2.len() / lanes).map(|one| lanes * one) {
                    Self::store::<S, 1>(
                        Self::squares_at(simd, x, stride, start, c),
                        &mut r2[start..],
                    );
                }
            }

            #[inline(always)]
            fn squares_at<S: Simd, const COUNT: usize>(
                simd: S,
                x: &[Self],
                stride: usize,
                start: usize,
                c: &[Self],
            ) -> [S::$registers; COUNT] {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let mut sums = [simd.$splat(0.0); COUNT];
                for m in 0..c.len() {
                    let column = Self::load::<S, COUNT>(&x[m * stride + start..][..COUNT * lanes]);
                    let c = simd.$splat(c[m]);
                    for position in 0..COUNT {
                        let difference = simd.$sub(column[position], c);
                        sums[position] = simd.$mul_add(difference, difference, sums[position]);
                    }
                }
                sums
            }

            #[cfg(feature = "simd")]
            #[inline(always)]
            fn squares_from_products<S: Simd, const COUNT: usize>(
                simd: S,
                norms: [S::$registers; REGISTERS],
                norm: Self,
                products: &[[S::u32s; COUNT]; 2],
                units: [Self; 2],
            ) -> [S::$registers; REGISTERS] {
                // No `map`: it is not compiled for the instruction set.
                let mut squares = norms;
                for square in &mut squares {
                    *square = simd.$add(*square, simd.$splat(norm));
                }
                for (products, unit) in products.iter().zip(units) {
                    let mut floats = [simd.$splat(0.0); REGISTERS];
                    let lanes = bytemuck::cast_slice_mut::<S::$registers, Self>(&mut floats);
                    let integers = bytemuck::cast_slice::<S::u32s, i32>(products);
                    for (float, integer) in lanes.iter_mut().zip(integers) {
                        *float = *integer as Self;
                    }
                    for position in 0..REGISTERS {
                        squares[position] =
                            simd.$mul_add(floats[position], simd.$splat(unit), squares[position]);
                    }
                }
                for square in &mut squares {
                    *square = simd.$max(*square, simd.$splat(0.0));
                }
                squares
            }

            #[inline(always)]
            fn weighted_distances<S: Simd, const K: usize>(
                simd: S,
                x: &[Self],
                length: usize,
                c: &[Self],
                weights: &[[Self; K]],
                r2: &mut [Self],
            ) {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let pairs = length / (2 * lanes);
                for pair in 0..pairs {
                    Self::distances_at::<S, K, 2>(simd, x, 2 * lanes * pair, c, weights, r2);
                }
                for one in 2 * pairs..length / lanes {
                    Self::distances_at::<S, K, 1>(simd, x, lanes * one, c, weights, r2);
                }
            }

            #[inline(always)]
            fn distances_at<S: Simd, const K: usize, const REGISTERS: usize>(
                simd: S,
                x: &[Self],
                start: usize,
                c: &[Self],
                weights: &[[Self; K]],
                r2: &mut [Self],
            ) {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let end = start + REGISTERS * lanes;
                let mut sums = [[simd.$splat(0.0); REGISTERS]; K];
                for m in 0..weights.len() {
                    let column = S::$as_simd(&x[m * TILE + start..m * TILE + end]).0;
                    let column =
                        column.first_chunk::<REGISTERS>().expect("as many as were cut out");
                    let (c, weights) = (simd.$splat(c[m]), &weights[m]);
                    let mut squares = *column;
                    for position in 0..REGISTERS {
                        let difference = simd.$sub(column[position], c);
                        squares[position] = simd.$mul(difference, difference);
                    }
                    for k in 0..K {
                        let weight = simd.$splat(weights[k]);
                        for position in 0..REGISTERS {
                            sums[k][position] =
                                simd.$mul_add(weight, squares[position], sums[k][position]);
                        }
                    }
                }
                // By value: a copy of slices would take the address of the sums, which then live in
                // memory.
                for k in 0..K {
                    let out = S::$as_mut_simd(&mut r2[k * TILE + start..k * TILE + end]).0;
                    *out.first_chunk_mut::<REGISTERS>().expect("as many as were cut out") = sums[k];
                }
            }

            #[inline(always)]
            fn shape_at<S: Simd, const SLOPES: bool>(
                simd: S,
                shape: Shape,
                r2: S::$registers,
            ) -> [S::$registers; 2] {
                const ROOT_3: f64 = 1.732_050_807_568_877_2;
                const ROOT_5: f64 = 2.236_067_977_499_79;
                // No reciprocal of a distance below this, where the slope meets a squared
                // difference of zero.
                const TINY: $float = 1e-30;
                let one = simd.$splat(1.0);
                match shape {
                    Shape::SquaredExponential => {
                        let k = Self::decay(simd, -0.5, r2);
                        [k, if SLOPES { Self::times(simd, -0.5, k) } else { k }]
                    }
                    Shape::Exponential => {
                        let k = Self::decay(simd, -1.0, simd.$sqrt(r2));
                        let least = simd.$splat(TINY);
                        [
                            k,
                            if SLOPES {
                                simd.$div(
                                    Self::times(simd, -0.5, k),
                                    simd.$sqrt(simd.$max(r2, least)),
                                )
                            } else {
                                k
                            },
                        ]
                    }
                    Shape::Matern32 => {
                        let r = simd.$sqrt(r2);
                        let decay = Self::decay(simd, -ROOT_3, r);
                        let k = simd.$mul(decay, simd.$add(one, Self::times(simd, ROOT_3, r)));
                        [k, if SLOPES { Self::times(simd, -1.5, decay) } else { k }]
                    }
                    Shape::Matern52 => {
                        let r = simd.$sqrt(r2);
                        let decay = Self::decay(simd, -ROOT_5, r);
                        let line = simd.$add(one, Self::times(simd, ROOT_5, r));
                        let k = simd.$mul(decay, simd.$mul_add(simd.$splat(5.0 / 3.0), r2, line));
                        [
                            k,
                            if SLOPES {
                                simd.$mul(Self::times(simd, -5.0 / 6.0, decay), line)
                            } else {
                                k
                            },
                        ]
                    }
                    Shape::RationalQuadratic { mixture } => {
                        let share = Self::times(simd, 1.0 / (2.0 * mixture), r2);
                        let mut logarithm = share;
                        for x in $lanes::<S>(&mut logarithm) {
                            *x = of_f64::ln_1p(f64::from(*x)) as Self;
                        }
                        let k = Self::decay(simd, -mixture, logarithm);
                        [
                            k,
                            if SLOPES {
                                simd.$div(Self::times(simd, -0.5, k), simd.$add(one, share))
                            } else {
                                k
                            },
                        ]
                    }
                }
            }

            #[inline(always)]
            fn shape<S: Simd, const SLOPES: bool>(
                simd: S,
                shape: Shape,
                r2: &[Self],
                k: &mut [Self],
                slope: &mut [Self],
            ) {
                let (r2, k, slope) =
                    (S::$as_simd(r2).0, S::$as_mut_simd(k).0, S::$as_mut_simd(slope).0);
                shape.known(
                    #[inline(always)]
                    |shape| {
                        let mut slopes = slope.iter_mut();
                        for (r2, k) in r2.iter().zip(k) {
                            let [value, derivative] = Self::shape_at::<S, SLOPES>(simd, shape, *r2);
                            *k = value;
                            if let (true, Some(slope)) = (SLOPES, slopes.next()) {
                                *slope = derivative;
                            }
                        }
                    },
                );
            }

            #[inline(always)]
            fn dot<S: Simd>(simd: S, a: &[Self], b: &[Self]) -> f64 {
                let (a, b) = (S::$as_simd(a).0, S::$as_simd(b).0);
                let count = a.len().min(b.len());
                let (a, b) = (&a[..count], &b[..count]);
                let mut sums = [simd.$splat(0.0); 4];
                for four in 0..count / 4 {
                    let (a, b) = (&a[4 * four..4 * four + 4], &b[4 * four..4 * four + 4]);
                    for k in 0..4 {
                        sums[k] = simd.$mul_add(a[k], b[k], sums[k]);
                    }
                }
                for k in count / 4 * 4..count {
                    sums[0] = simd.$mul_add(a[k], b[k], sums[0]);
                }
                let sum = simd.$add(simd.$add(sums[0], sums[1]), simd.$add(sums[2], sums[3]));
                simd.$sum(sum).into()
            }

            #[inline(always)]
            fn four_dots<S: Simd>(simd: S, rows: &[Self], b: &[Self]) -> [f64; 4] {
                let registers = BLOCK * size_of::<Self>() / size_of::<S::$registers>();
                let (rows, b) = (S::$as_simd(rows).0, S::$as_simd(b).0);
                let mut sums = [simd.$splat(0.0); 4];
                for block in 0..b.len() / registers {
                    let b = &b[block * registers..(block + 1) * registers];
                    let rows = &rows[4 * block * registers..4 * (block + 1) * registers];
                    for position in 0..registers {
                        for k in 0..4 {
                            sums[k] =
                                simd.$mul_add(rows[k * registers + position], b[position], sums[k]);
                        }
                    }
                }
                [
                    simd.$sum(sums[0]).into(),
                    simd.$sum(sums[1]).into(),
                    simd.$sum(sums[2]).into(),
                    simd.$sum(sums[3]).into(),
                ]
            }

            #[inline(always)]
            fn weighted_squares<S: Simd>(simd: S, w: &[Self], x: &[Self], c: Self) -> f64 {
                let (w, x) = (S::$as_simd(w).0, S::$as_simd(x).0);
                let count = w.len().min(x.len());
                let (w, x, c) = (&w[..count], &x[..count], simd.$splat(c));
                let mut sums = [simd.$splat(0.0); 4];
                for four in 0..count / 4 {
                    let (w, x) = (&w[4 * four..4 * four + 4], &x[4 * four..4 * four + 4]);
                    for k in 0..4 {
                        let difference = simd.$sub(x[k], c);
                        sums[k] = simd.$mul_add(simd.$mul(w[k], difference), difference, sums[k]);
                    }
                }
                for k in count / 4 * 4..count {
                    let difference = simd.$sub(x[k], c);
                    sums[0] = simd.$mul_add(simd.$mul(w[k], difference), difference, sums[0]);
                }
                let sum = simd.$add(simd.$add(sums[0], sums[1]), simd.$add(sums[2], sums[3]));
                simd.$sum(sum).into()
            }

            #[inline(always)]
            fn weighted_differences<S: Simd>(simd: S, w: &[Self], x: &[Self], c: Self) -> f64 {
                let ((w, _), (x, _)) = (S::$as_simd(w), S::$as_simd(x));
                let c = simd.$splat(c);
                let mut sum = simd.$splat(0.0);
                for (w, x) in w.iter().zip(x) {
                    sum = simd.$mul_add(*w, simd.$sub(*x, c), sum);
                }
                simd.$sum(sum).into()
            }

            #[inline(always)]
            fn scale(factor: Self, a: &[Self], out: &mut [Self]) {
                out.iter_mut().zip(a).for_each(|(out, a)| *out = factor * *a);
            }

            #[inline(always)]
            fn add_to(a: &[Self], out: &mut [Self]) {
                out.iter_mut().zip(a).for_each(|(out, a)| *out += *a);
            }

            #[inline(always)]
            fn multiply_to(a: &[Self], out: &mut [Self]) {
                out.iter_mut().zip(a).for_each(|(out, a)| *out *= *a);
            }
        }
    };
}

element!(
    f64,
    power_of_two_f64,
    lanes_f64,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    max_f64s,
    sqrt_f64s,
    mul_add_e_f64s,
    reduce_sum_f64s
);
element!(
    f32,
    power_of_two_f32,
    lanes_f32,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    max_f32s,
    sqrt_f32s,
    mul_add_e_f32s,
    reduce_sum_f32s
);
