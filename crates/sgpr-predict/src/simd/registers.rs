//! Registers that kernels are computed in: those of the machine with the feature `simd`, else of
//! one number each.

#[cfg(not(feature = "simd"))]
pub use super::scalar::{Arch, Simd, WithSimd};
#[cfg(feature = "simd")]
pub use pulp::{Arch, Simd, WithSimd};

macro_rules! lanes {
    ($name:ident, $float:ident, $registers:ident) => {
        /// The numbers of a register.
        #[inline(always)]
        pub fn $name<S: Simd>(register: &mut S::$registers) -> &mut [$float] {
            #[cfg(feature = "simd")]
            return bytemuck::cast_slice_mut(std::slice::from_mut(register));
            #[cfg(not(feature = "simd"))]
            return S::$name(register);
        }
    };
}

lanes!(lanes_f64, f64, f64s);
lanes!(lanes_f32, f32, f32s);
