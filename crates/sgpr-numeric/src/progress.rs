//! Long work says how far it is, and can be stopped.

/// Listener of long work. `()` listens to nothing.
pub trait Progress: Sync {
    /// `done` of `total` steps of a stage are done; called before the first and after every step.
    ///
    /// # Errors
    /// If the work shall stop; it then returns without a result.
    fn step(&self, stage: &'static str, done: usize, total: usize) -> Result<(), Interrupted>;
}

impl Progress for () {
    fn step(&self, _: &'static str, _: usize, _: usize) -> Result<(), Interrupted> {
        Ok(())
    }
}

/// The listener asked the work to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped on request")]
pub struct Interrupted;
