//! What every part of sgpr that computes stands on: factors of tall matrices, selections of
//! columns, how long work reports and is stopped, threads in forked processes.
//!
//! - [`linalg`]: a thin layer over faer
//! - [`progress`]: how long work reports and is stopped
//! - [`threads`]: what parallel work needs in forked processes
//!
//! A crate beside `sgpr-gp` and `sgpr-core`, which show these modules as theirs; by itself of
//! little use.
#![warn(clippy::too_many_lines)]
#![forbid(unsafe_code)]

mod intervals;
pub mod linalg;
mod memory;
pub mod progress;
mod random;
pub mod threads;

/// What `sgpr-gp` and `sgpr-core` take of this crate beside its interface. No part of that: it
/// changes without notice.
#[doc(hidden)]
pub mod internal {
    pub use crate::random::Random;

    /// Intervals that errors fall into.
    pub mod intervals {
        pub use crate::intervals::*;
    }

    /// Decompositions.
    pub mod linalg {
        pub use crate::linalg::parts::*;
    }

    /// How much memory there is to take.
    pub mod memory {
        pub use crate::memory::*;
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
