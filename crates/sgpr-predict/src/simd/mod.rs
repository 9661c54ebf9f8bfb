//! One source for one sample and for many: arithmetic generic over the scalar type.
//!
//! A recursion written over [`Real`] runs on a single number ([`f64`], [`Fused`]), on one sample per register lane
//! ([`Lanes`]) and on any further type that brings the same operations (dual numbers). The instruction set is chosen
//! when the program runs, by `pulp::Arch`, so one binary serves every machine.

#[cfg(feature = "simd")]
mod fused;
#[cfg(feature = "simd")]
mod lanes;
mod number;
#[cfg(feature = "simd")]
mod pair_products;
#[cfg(feature = "simd")]
mod power_of_two;
mod real;
#[cfg(feature = "simd")]
mod transpose;
#[cfg(feature = "simd")]
mod trigonometry;

#[cfg(feature = "simd")]
pub use fused::Fused;
#[cfg(feature = "simd")]
pub use lanes::Lanes;
#[cfg(feature = "simd")]
#[doc(hidden)]
pub use lanes::MAX_LANES;
pub use number::Number;
#[cfg(feature = "simd")]
#[doc(hidden)]
pub use pair_products::{pair, pair_products};
#[cfg(feature = "simd")]
#[doc(hidden)]
pub use power_of_two::{power_of_two_f32, power_of_two_f64};
pub use real::Real;
#[cfg(feature = "simd")]
#[doc(hidden)]
pub use transpose::Transpose;
#[cfg(feature = "simd")]
#[doc(hidden)]
pub use trigonometry::{cos_in_place, sin_cos_slice};
