//! Torque models of robot arms for controllers in C and C++: the functions of `include/sgpr.h`,
//! which is made from this source.
#![warn(clippy::too_many_lines)]

mod failure;
mod model;
mod predictor;

use std::ffi::c_char;

/// Grows when a function changes or goes away: compare it with sgpr_abi_version().
pub const SGPR_ABI_VERSION: u32 = 1;

/// SGPR_ABI_VERSION of the library.
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_abi_version() -> u32 {
    SGPR_ABI_VERSION
}

/// Version of the library, as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// What went wrong in the last call of this thread that failed; valid until the next one that does.
/// Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_last_error() -> *const c_char {
    failure::last()
}
