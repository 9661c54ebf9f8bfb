//! One source for one sample and for many: arithmetic generic over the scalar type.
//!
//! A recursion written over [`Real`] runs on a single number ([`f64`], `Fused`), on one sample per
//! register lane (`Lanes`) and on any further type that brings the same operations (dual numbers).
//! The instruction set is chosen when the program runs, by `pulp::Arch`, so one binary serves every
//! machine.

#[cfg(feature = "simd")]
mod dot;
mod dual;
#[cfg(feature = "simd")]
mod fused;
#[cfg(feature = "simd")]
mod lanes;
mod number;
#[cfg(feature = "simd")]
mod pair_products;
mod power_of_two;
mod real;
mod registers;
#[cfg(not(feature = "simd"))]
mod scalar;
mod single;
#[cfg(feature = "simd")]
mod transpose;
#[cfg(feature = "simd")]
mod trigonometry;

pub use dual::Dual;
#[cfg(feature = "simd")]
pub use fused::Fused;
#[cfg(feature = "simd")]
pub use lanes::Lanes;
#[cfg(feature = "simd")]
pub(crate) use lanes::MAX_LANES;
pub use number::Number;
#[cfg(feature = "simd")]
pub(crate) use pair_products::{pair, pair_products};
pub(crate) use power_of_two::{power_of_two_f32, power_of_two_f64};
pub use real::Real;
pub(crate) use registers::{Arch, Simd, WithSimd, lanes_f32, lanes_f64};
pub use single::Single;
#[cfg(feature = "simd")]
pub(crate) use transpose::Transpose;
#[cfg(feature = "simd")]
pub(crate) use trigonometry::sin_cos_slice;

/// For [`crate::internal`].
#[cfg(feature = "simd")]
pub(crate) mod parts {
    pub use super::dot::{dot, dot_in_lanes, mean_square, rms};
    pub use super::trigonometry::cos_in_place;
}
