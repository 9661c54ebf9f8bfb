//! Arithmetic that is recorded instead of done: code over [`Number`](crate::simd::Number) that is
//! run with [`Expr`] leaves its formula on a tape, from which code in another language is printed.
//!
//! Numbers that do not depend on the input are folded, zeros and ones taken out, and what is
//! computed twice is kept once.

mod expr;
mod tape;

pub use tape::Expr;
/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::tape::{Node, Recorder, Tape};
}
