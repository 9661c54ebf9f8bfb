//! Threads in processes that were forked.
//!
//! A fork copies the calling thread and no other. The pool of threads that parallel work is handed
//! to has none in the child, which would wait for ever. There each thread that computes is a pool
//! of its own: a forked process computes on the threads that it starts itself, and workers of
//! Python's `multiprocessing` on one each.

use std::cell::Cell;
use std::sync::OnceLock;

/// The process that has the threads of the common pool.
static HOME: OnceLock<u32> = OnceLock::new();

thread_local! {
    static HAS_OWN_POOL: Cell<bool> = const { Cell::new(false) };
}

/// Says that this process has the threads of the common pool, and processes that are forked from it
/// have not. To be called before the first fork; without, the first call of [`prepare`] does.
pub fn remember_process() {
    HOME.get_or_init(std::process::id);
}

/// Lets the calling thread compute in a process that was forked, on itself alone; does nothing
/// elsewhere.
pub fn prepare() {
    let here = std::process::id();
    if *HOME.get_or_init(|| here) == here || HAS_OWN_POOL.get() {
        return;
    }
    if let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build() {
        // It lasts as long as the thread.
        std::mem::forget(pool);
        HAS_OWN_POOL.set(true);
    }
}
