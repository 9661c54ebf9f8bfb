//! The BLAS and LAPACK symbols that clarabel's cone of positive semidefinite matrices calls, in
//! plain Rust.
//!
//! The cone asks for `?gemm ?gemv ?symv ?syrk ?syr2k ?potrf ?potrs ?gesv ?syevr ?gesdd ?gesvd` with
//! the calling convention of Fortran. Its matrices here are 4 x 4 to 8 x 8, where a tuned library
//! gains nothing, and every such library costs a Fortran compiler, a system package or tens of
//! megabytes in a Python wheel. So this crate defines the symbols itself. They keep to LAPACK's
//! definitions.
//!
//! The algorithms, in [`blas`] and [`lapack`], are safe and generic; `symbols` is the boundary, and
//! the only unsafe code. Eigenvalues and singular values come from Jacobi's method, as accurate as
//! any for matrices of this size.
//!
//! A crate that links it says `extern crate sgpr_lapack as _;`, or the linker would leave it out. A
//! shared library that it becomes part of shows none of the symbols (on systems with ELF). Within a
//! program they are global, as the symbols of any BLAS: one that links another turns off the
//! feature `bundled-lapack` of `sgpr-core`.
#![warn(clippy::too_many_lines)]

pub mod blas;
pub mod lapack;
mod real;
mod symbols;

pub use real::Real;
