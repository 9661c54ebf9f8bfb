//! Work without the interpreter.

use pyo3::prelude::*;
use sgpr_core::threads;

/// Runs `work` while other threads of Python may run; in a forked process on the calling thread
/// alone.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    threads::prepare();
    py.detach(work)
}
