//! Torque models of robot arms for controllers in C and C++: the functions of `include/sgpr.h`, which says what each does.

mod failure;
mod model;
mod predictor;

use std::ffi::c_char;

/// As `SGPR_ABI_VERSION` of the header.
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_abi_version() -> u32 {
    1
}

/// Version of the library.
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// Words for the last failure of this thread.
#[unsafe(no_mangle)]
pub extern "C" fn sgpr_last_error() -> *const c_char {
    failure::last()
}
