//! Arithmetic on a tile of points, small enough for the first-level cache, in `f64` and in `f32`.

use pulp::Simd;

use super::Shape;
use crate::simd::{exp_f32, exp_f64, fused};

/// Points per tile; a multiple of the lanes of every register.
pub(crate) const TILE: usize = 256;

/// Numbers of one row before those of the next in a block of four; the lanes of the widest register.
pub(crate) const BLOCK: usize = 16;

/// A number that kernels are computed in.
pub(crate) trait Element: Copy + Default + Send + Sync + std::fmt::Debug + bytemuck::Pod + 'static {
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;

    /// sum over columns of (x - c)², for as many points as `r2` has; column m of x starts at `m * stride`.
    fn squared_distances<S: Simd>(simd: S, x: &[Self], stride: usize, c: &[Self], r2: &mut [Self]);

    /// The same for so many registers from `start` on: their sums stay in registers.
    fn squares_at<S: Simd, const REGISTERS: usize>(
        simd: S,
        x: &[Self],
        stride: usize,
        start: usize,
        c: &[Self],
        r2: &mut [Self],
    );

    /// norms + norm + sum over digits of units * products, no less than zero; the products are integers with a sign.
    fn squares_from_products<S: Simd>(
        simd: S,
        norms: &[Self],
        norm: Self,
        products: &[Vec<u32>; 2],
        units: [Self; 2],
        r2: &mut [Self],
    );

    /// As many times as there are `K` kernels: sum over columns of weight (x - c)², for as many points as a row of `r2` uses.
    /// The squared differences are shared.
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

    /// Values at squared distances, and their derivatives by the squared distance where `SLOPES`.
    fn shape<S: Simd, const SLOPES: bool>(simd: S, shape: Shape, r2: &[Self], k: &mut [Self], slope: &mut [Self]);

    /// sum of a b, in double precision from register to register.
    fn dot<S: Simd>(simd: S, a: &[Self], b: &[Self]) -> f64;

    /// The products of four rows with a vector.
    ///
    /// - `rows`: `[length / BLOCK, 4, BLOCK]`, with the length of `b` a multiple of [`BLOCK`]
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
    ($float:ident, $exp:ident, $registers:ident, $as_simd:ident, $as_mut_simd:ident, $splat:ident, $add:ident, $sub:ident, $mul:ident, $mul_add:ident, $sum:ident) => {
        impl Element for $float {
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as Self
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                self.into()
            }

            #[inline(always)]
            fn squared_distances<S: Simd>(simd: S, x: &[Self], stride: usize, c: &[Self], r2: &mut [Self]) {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let fours = r2.len() / (4 * lanes);
                for four in 0..fours {
                    Self::squares_at::<S, 4>(simd, x, stride, 4 * lanes * four, c, r2);
                }
                for one in 4 * fours..r2.len() / lanes {
                    Self::squares_at::<S, 1>(simd, x, stride, lanes * one, c, r2);
                }
            }

            #[inline(always)]
            fn squares_at<S: Simd, const REGISTERS: usize>(
                simd: S,
                x: &[Self],
                stride: usize,
                start: usize,
                c: &[Self],
                r2: &mut [Self],
            ) {
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let end = start + REGISTERS * lanes;
                let mut sums = [simd.$splat(0.0); REGISTERS];
                for m in 0..c.len() {
                    let column = S::$as_simd(&x[m * stride + start..m * stride + end]).0;
                    let column = column.first_chunk::<REGISTERS>().expect("as many as were cut out");
                    let c = simd.$splat(c[m]);
                    for position in 0..REGISTERS {
                        let difference = simd.$sub(column[position], c);
                        sums[position] = simd.$mul_add(difference, difference, sums[position]);
                    }
                }
                let out = S::$as_mut_simd(&mut r2[start..end]).0;
                *out.first_chunk_mut::<REGISTERS>().expect("as many as were cut out") = sums;
            }

            #[inline(always)]
            fn squares_from_products<S: Simd>(
                _: S,
                norms: &[Self],
                norm: Self,
                [first, second]: &[Vec<u32>; 2],
                units: [Self; 2],
                r2: &mut [Self],
            ) {
                for (((r2, norms), first), second) in r2.iter_mut().zip(norms).zip(first).zip(second) {
                    let sum = fused!(S, $float, units[0], first.cast_signed() as $float, *norms + norm);
                    let sum = fused!(S, $float, units[1], second.cast_signed() as $float, sum);
                    *r2 = if sum < 0.0 { 0.0 } else { sum };
                }
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
                    let column = column.first_chunk::<REGISTERS>().expect("as many as were cut out");
                    let (c, weights) = (simd.$splat(c[m]), &weights[m]);
                    let mut squares = *column;
                    for position in 0..REGISTERS {
                        let difference = simd.$sub(column[position], c);
                        squares[position] = simd.$mul(difference, difference);
                    }
                    for k in 0..K {
                        let weight = simd.$splat(weights[k]);
                        for position in 0..REGISTERS {
                            sums[k][position] = simd.$mul_add(weight, squares[position], sums[k][position]);
                        }
                    }
                }
                // By value: a copy of slices would take the address of the sums, which then live in memory.
                for k in 0..K {
                    let out = S::$as_mut_simd(&mut r2[k * TILE + start..k * TILE + end]).0;
                    *out.first_chunk_mut::<REGISTERS>().expect("as many as were cut out") = sums[k];
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
                const ROOT_3: $float = 1.732_050_807_568_877_2_f64 as $float;
                const ROOT_5: $float = 2.236_067_977_499_79_f64 as $float;
                // No reciprocal of a distance below this, where the slope meets a squared difference of zero.
                const TINY: $float = 1e-30;
                match shape {
                    Shape::SquaredExponential => {
                        k.iter_mut().zip(r2).for_each(|(k, r2)| *k = -0.5 * *r2);
                        $exp(simd, k);
                        if SLOPES {
                            slope.iter_mut().zip(&*k).for_each(|(slope, k)| *slope = -0.5 * *k);
                        }
                    }
                    Shape::Exponential => {
                        k.iter_mut().zip(r2).for_each(|(k, r2)| *k = -r2.sqrt());
                        $exp(simd, k);
                        if SLOPES {
                            for ((slope, k), r2) in slope.iter_mut().zip(&*k).zip(r2) {
                                *slope = -0.5 * *k / r2.max(TINY).sqrt();
                            }
                        }
                    }
                    Shape::Matern32 => {
                        k.iter_mut().zip(r2).for_each(|(k, r2)| *k = -(ROOT_3 * r2.sqrt()));
                        $exp(simd, k);
                        if SLOPES {
                            slope.iter_mut().zip(&*k).for_each(|(slope, k)| *slope = -1.5 * *k);
                        }
                        k.iter_mut().zip(r2).for_each(|(k, r2)| *k *= 1.0 + ROOT_3 * r2.sqrt());
                    }
                    Shape::Matern52 => {
                        k.iter_mut().zip(r2).for_each(|(k, r2)| *k = -(ROOT_5 * r2.sqrt()));
                        $exp(simd, k);
                        if SLOPES {
                            for ((slope, k), r2) in slope.iter_mut().zip(&*k).zip(r2) {
                                *slope = (-5.0 / 6.0) * *k * (1.0 + ROOT_5 * r2.sqrt());
                            }
                        }
                        for (k, r2) in k.iter_mut().zip(r2) {
                            *k *= 1.0 + ROOT_5 * r2.sqrt() + (5.0 / 3.0) * *r2;
                        }
                    }
                    Shape::RationalQuadratic { mixture } => {
                        let mixture = mixture as $float;
                        let reciprocal = 1.0 / (2.0 * mixture);
                        for (k, r2) in k.iter_mut().zip(r2) {
                            *k = -mixture * (*r2 * reciprocal).ln_1p();
                        }
                        $exp(simd, k);
                        if SLOPES {
                            for ((slope, k), r2) in slope.iter_mut().zip(&*k).zip(r2) {
                                *slope = -0.5 * *k / (1.0 + *r2 * reciprocal);
                            }
                        }
                    }
                }
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
                            sums[k] = simd.$mul_add(rows[k * registers + position], b[position], sums[k]);
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
    exp_f64,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    mul_add_e_f64s,
    reduce_sum_f64s
);
element!(
    f32,
    exp_f32,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    mul_add_e_f32s,
    reduce_sum_f32s
);
