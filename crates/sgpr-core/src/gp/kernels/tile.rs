//! Arithmetic on a tile of points, small enough for the first-level cache, in `f64` and in `f32`.

use pulp::Simd;

use super::Shape;
use crate::simd::{exp_f32, exp_f64};

/// Points per tile; a multiple of the lanes of every register.
pub(crate) const TILE: usize = 256;

/// A number that kernels are computed in.
pub(crate) trait Element: Copy + Default + Send + Sync + std::fmt::Debug + bytemuck::Pod + 'static {
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;

    /// sum over columns of (x - c)², for as many points as `r2` has; column m of x starts at `m * stride`.
    fn squared_distances<S: Simd>(simd: S, x: &[Self], stride: usize, c: &[Self], r2: &mut [Self]);

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
                let (registers, rest) = S::$as_mut_simd(r2);
                debug_assert!(rest.is_empty(), "whole registers");
                let lanes = size_of::<S::$registers>() / size_of::<Self>();
                let (fours, ones) = registers.as_chunks_mut::<4>();
                for (block, out) in fours.iter_mut().enumerate() {
                    let start = 4 * block * lanes;
                    let mut sums = [simd.$splat(0.0); 4];
                    for (m, c) in c.iter().enumerate() {
                        let c = simd.$splat(*c);
                        let column = S::$as_simd(&x[m * stride + start..][..4 * lanes]).0;
                        for (sum, x) in sums.iter_mut().zip(column) {
                            let difference = simd.$sub(*x, c);
                            *sum = simd.$mul_add(difference, difference, *sum);
                        }
                    }
                    *out = sums;
                }
                let start = 4 * fours.len() * lanes;
                for (k, out) in ones.iter_mut().enumerate() {
                    let mut sum = simd.$splat(0.0);
                    for (m, c) in c.iter().enumerate() {
                        let x = S::$as_simd(&x[m * stride + start + k * lanes..][..lanes]).0[0];
                        let difference = simd.$sub(x, simd.$splat(*c));
                        sum = simd.$mul_add(difference, difference, sum);
                    }
                    *out = sum;
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
                for start in (2 * lanes * pairs..length).step_by(lanes) {
                    Self::distances_at::<S, K, 1>(simd, x, start, c, weights, r2);
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
                for ((column, c), weights) in x.chunks_exact(TILE).zip(c).zip(weights) {
                    let c = simd.$splat(*c);
                    let registers = S::$as_simd(&column[start..end]).0;
                    for position in 0..REGISTERS {
                        let difference = simd.$sub(registers[position], c);
                        let square = simd.$mul(difference, difference);
                        for (sum, weight) in sums.iter_mut().zip(weights) {
                            sum[position] = simd.$mul_add(simd.$splat(*weight), square, sum[position]);
                        }
                    }
                }
                for (sum, r2) in sums.iter().zip(r2.chunks_exact_mut(TILE)) {
                    S::$as_mut_simd(&mut r2[start..end]).0.copy_from_slice(sum);
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
                let ((a, _), (b, _)) = (S::$as_simd(a), S::$as_simd(b));
                let ((a4, a1), (b4, b1)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
                let mut sums = [simd.$splat(0.0); 4];
                for (a, b) in a4.iter().zip(b4) {
                    for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                        *sum = simd.$mul_add(*a, *b, *sum);
                    }
                }
                for (a, b) in a1.iter().zip(b1) {
                    sums[0] = simd.$mul_add(*a, *b, sums[0]);
                }
                let sum = simd.$add(simd.$add(sums[0], sums[1]), simd.$add(sums[2], sums[3]));
                simd.$sum(sum).into()
            }

            #[inline(always)]
            fn weighted_squares<S: Simd>(simd: S, w: &[Self], x: &[Self], c: Self) -> f64 {
                let ((w, _), (x, _)) = (S::$as_simd(w), S::$as_simd(x));
                let ((w4, w1), (x4, x1)) = (w.as_chunks::<4>(), x.as_chunks::<4>());
                let c = simd.$splat(c);
                let mut sums = [simd.$splat(0.0); 4];
                for (w, x) in w4.iter().zip(x4) {
                    for ((sum, w), x) in sums.iter_mut().zip(w).zip(x) {
                        let difference = simd.$sub(*x, c);
                        *sum = simd.$mul_add(simd.$mul(*w, difference), difference, *sum);
                    }
                }
                for (w, x) in w1.iter().zip(x1) {
                    let difference = simd.$sub(*x, c);
                    sums[0] = simd.$mul_add(simd.$mul(*w, difference), difference, sums[0]);
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
