//! One source for one sample and for many: arithmetic generic over the scalar type.
//!
//! A recursion written over [`Real`] runs on a single number ([`f64`], [`Fused`]), on one sample per register lane
//! ([`Lanes`]) and on any further type that brings the same operations (dual numbers). The instruction set is chosen
//! when the program runs, by `pulp::Arch`, so one binary serves every machine.

mod lanes;
mod number;
mod pair_products;
mod power_of_two;
mod real;
mod transpose;
mod trigonometry;

pub use lanes::Lanes;
pub(crate) use lanes::MAX_LANES;
pub use number::Number;
pub(crate) use pair_products::{pair, pair_products};
pub(crate) use power_of_two::{power_of_two_f32, power_of_two_f64};
pub use real::{Fused, Real};
pub(crate) use transpose::Transpose;
pub(crate) use trigonometry::{cos_in_place, sin_cos_slice};
