//! Readers of other crates, which may panic on a damaged file.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::RecordingError;

/// What `read` gives; a file on which it panics is damaged, too. Its message stands on standard
/// error as well, which is not ours to silence.
///
/// - `format`: what the file should be
pub(crate) fn guarded<T>(
    path: &str,
    format: &'static str,
    read: impl FnOnce() -> Result<T, RecordingError>,
) -> Result<T, RecordingError> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|payload| {
        let cause = cause(payload.as_ref()).to_string();
        Err(RecordingError::Broken { path: path.into(), format, cause })
    })
}

fn cause(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| payload.downcast_ref().copied()).unwrap_or("its reader stopped")
}
