//! As much of `pulp` as kernels are computed with, for a machine of which nothing is known: one
//! number per register.

#![allow(missing_docs, reason = "names of pulp")]

#[cfg(feature = "std")]
use core::primitive::{f32 as of_f32, f64 as of_f64};

#[cfg(not(feature = "std"))]
use crate::math::{self as of_f64, single as of_f32};

/// Work that is compiled for an instruction set.
pub trait WithSimd {
    type Output;

    fn with_simd<S: Simd>(self, simd: S) -> Self::Output;
}

/// The instruction set of the machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arch;

impl Arch {
    pub fn new() -> Self {
        Self
    }

    #[inline(always)]
    pub fn dispatch<W: WithSimd>(self, work: W) -> W::Output {
        work.with_simd(Scalar)
    }
}

/// Arithmetic of single numbers.
#[derive(Clone, Copy, Debug)]
pub struct Scalar;

macro_rules! operations {
    ($of:ident, $float:ident, $registers:ident, $mask:ident, $lanes:ident, $as_simd:ident, $as_mut_simd:ident,
     $splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $max:ident, $sqrt:ident, $mul_add:ident, $sum:ident,
     $less:ident, $select:ident; $signatures:ident $bodies:ident) => {
        macro_rules! $signatures {
            () => {
                type $registers: Copy;
                type $mask: Copy;

                fn $lanes(register: &mut Self::$registers) -> &mut [$float];
                fn $as_simd(slice: &[$float]) -> (&[Self::$registers], &[$float]);
                fn $as_mut_simd(slice: &mut [$float]) -> (&mut [Self::$registers], &mut [$float]);
                fn $splat(self, value: $float) -> Self::$registers;
                fn $add(self, a: Self::$registers, b: Self::$registers) -> Self::$registers;
                fn $sub(self, a: Self::$registers, b: Self::$registers) -> Self::$registers;
                fn $mul(self, a: Self::$registers, b: Self::$registers) -> Self::$registers;
                fn $div(self, a: Self::$registers, b: Self::$registers) -> Self::$registers;
                fn $max(self, a: Self::$registers, b: Self::$registers) -> Self::$registers;
                fn $sqrt(self, a: Self::$registers) -> Self::$registers;
                fn $mul_add(
                    self,
                    a: Self::$registers,
                    b: Self::$registers,
                    c: Self::$registers,
                ) -> Self::$registers;
                fn $sum(self, a: Self::$registers) -> $float;
                fn $less(self, a: Self::$registers, b: Self::$registers) -> Self::$mask;
                fn $select(
                    self,
                    mask: Self::$mask,
                    yes: Self::$registers,
                    no: Self::$registers,
                ) -> Self::$registers;
            };
        }

        macro_rules! $bodies {
            () => {
                type $registers = $float;
                type $mask = bool;

                #[inline(always)]
                fn $lanes(register: &mut $float) -> &mut [$float] {
                    core::slice::from_mut(register)
                }

                #[inline(always)]
                fn $as_simd(slice: &[$float]) -> (&[$float], &[$float]) {
                    (slice, &[])
                }

                #[inline(always)]
                fn $as_mut_simd(slice: &mut [$float]) -> (&mut [$float], &mut [$float]) {
                    (slice, &mut [])
                }

                #[inline(always)]
                fn $splat(self, value: $float) -> $float {
                    value
                }

                #[inline(always)]
                fn $add(self, a: $float, b: $float) -> $float {
                    a + b
                }

                #[inline(always)]
                fn $sub(self, a: $float, b: $float) -> $float {
                    a - b
                }

                #[inline(always)]
                fn $mul(self, a: $float, b: $float) -> $float {
                    a * b
                }

                #[inline(always)]
                fn $div(self, a: $float, b: $float) -> $float {
                    a / b
                }

                #[inline(always)]
                fn $max(self, a: $float, b: $float) -> $float {
                    if a > b { a } else { b }
                }

                #[inline(always)]
                fn $sqrt(self, a: $float) -> $float {
                    $of::sqrt(a)
                }

                #[inline(always)]
                fn $mul_add(self, a: $float, b: $float, c: $float) -> $float {
                    a * b + c
                }

                #[inline(always)]
                fn $sum(self, a: $float) -> $float {
                    a
                }

                #[inline(always)]
                fn $less(self, a: $float, b: $float) -> bool {
                    a < b
                }

                #[inline(always)]
                fn $select(self, mask: bool, yes: $float, no: $float) -> $float {
                    if mask { yes } else { no }
                }
            };
        }
    };
}

operations!(
    of_f64, f64, f64s, m64s, lanes_f64, as_simd_f64s, as_mut_simd_f64s, splat_f64s, add_f64s, sub_f64s, mul_f64s,
    div_f64s, max_f64s, sqrt_f64s, mul_add_e_f64s, reduce_sum_f64s, less_than_f64s, select_f64s;
    signatures_f64 bodies_f64
);
operations!(
    of_f32, f32, f32s, m32s, lanes_f32, as_simd_f32s, as_mut_simd_f32s, splat_f32s, add_f32s, sub_f32s, mul_f32s,
    div_f32s, max_f32s, sqrt_f32s, mul_add_e_f32s, reduce_sum_f32s, less_than_f32s, select_f32s;
    signatures_f32 bodies_f32
);

/// Operations on registers of an instruction set.
#[allow(non_camel_case_types, reason = "names of pulp")]
pub trait Simd: Copy + Send + Sync + 'static {
    signatures_f64!();
    signatures_f32!();
}

impl Simd for Scalar {
    bodies_f64!();
    bodies_f32!();
}
