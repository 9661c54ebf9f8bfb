//! Long work, heard of and stopped from Python.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use sgpr_core::progress::{Interrupted, Progress};

use crate::detached::detached;
use crate::errors::IntoPyErr;

/// Work goes on at least this long before Python is asked again.
const PAUSE: Duration = Duration::from_millis(50);

/// Asks Python for signals (Ctrl-C), and tells the user's `progress(stage, done, total)`.
struct Listener {
    callback: Option<Py<PyAny>>,
    heard: Mutex<Option<Instant>>,
    failure: Mutex<Option<PyErr>>,
}

impl Listener {
    fn tell(&self, stage: &'static str, done: usize, total: usize) -> PyResult<()> {
        Python::attach(|py| {
            py.check_signals()?;
            match &self.callback {
                Some(callback) => callback.call1(py, (stage, done, total)).map(drop),
                None => Ok(()),
            }
        })
    }
}

impl Progress for Listener {
    fn step(&self, stage: &'static str, done: usize, total: usize) -> Result<(), Interrupted> {
        if self.failure.lock().unwrap_or_else(PoisonError::into_inner).is_some() {
            return Err(Interrupted);
        }
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        // The end of a stage is always told: a bar should get there.
        if done != total && heard.is_some_and(|last| last.elapsed() < PAUSE) {
            return Ok(());
        }
        *heard = Some(Instant::now());
        drop(heard);
        self.tell(stage, done, total).map_err(|error| {
            *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            Interrupted
        })
    }
}

/// Runs `work` detached from the interpreter. What the callback or a signal handler raises stops it
/// and is raised again.
pub fn listen<T: Send, E: IntoPyErr + Send>(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Result<T, E> + Send,
) -> PyResult<T> {
    listen_and_keep(py, callback, work).map(|(value, _)| value)
}

/// The same for work that keeps the best so far when it is stopped: returns it with what stopped
/// it.
pub fn listen_and_keep<T: Send, E: IntoPyErr + Send>(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Result<T, E> + Send,
) -> PyResult<(T, Option<PyErr>)> {
    let listener = Listener { callback, heard: Mutex::new(None), failure: Mutex::new(None) };
    let result = detached(py, || work(&listener));
    let failure = listener.failure.into_inner().unwrap_or_else(PoisonError::into_inner);
    match (result, failure) {
        (Ok(value), failure) => Ok((value, failure)),
        (Err(_), Some(failure)) => Err(failure),
        (Err(error), None) => Err(error.into_py_err()),
    }
}
