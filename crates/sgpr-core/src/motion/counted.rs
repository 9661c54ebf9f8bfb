//! How often logs were conditioned, for tests.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

static TIMES: Mutex<Option<HashMap<String, usize>>> = Mutex::new(None);

/// One time more.
pub(super) fn count(source: &str) {
    let mut times = TIMES.lock().unwrap_or_else(PoisonError::into_inner);
    *times.get_or_insert_default().entry(source.into()).or_default() += 1;
}

/// How often a log of this name was conditioned, by all tests.
pub(crate) fn times_conditioned(source: &str) -> usize {
    let mut times = TIMES.lock().unwrap_or_else(PoisonError::into_inner);
    times.get_or_insert_default().get(source).copied().unwrap_or(0)
}
