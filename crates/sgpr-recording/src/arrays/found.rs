//! What a reader finds in a file that holds more than arrays.

use super::{LISTED, NamedArray, recording_of_vectors};
use crate::csv::ReadOptions;
use crate::{Recording, RecordingError};

/// Most arrays of a file that are read; logs have some tens.
const MOST_ARRAYS: usize = 10_000;

/// What an array or text costs beside its values: itself and its block of memory.
pub(super) const OWN_BYTES: u64 = 64;

/// Arrays of a file, and names of what else is there, within a limit of bytes.
pub(super) struct Found {
    arrays: Vec<NamedArray>,
    skipped: Vec<String>,
    lost: Option<String>,
    left: u64,
}

/// Why a file cannot be read.
#[derive(Debug)]
pub(super) enum ArrayFault {
    /// It holds more than is allowed.
    TooLarge,
    /// What is wrong with it.
    Damaged(String),
}

impl ArrayFault {
    pub(super) fn damaged(cause: impl ToString) -> Self {
        Self::Damaged(cause.to_string())
    }

    /// - `format`: what the file should be
    pub(super) fn of(self, path: &str, format: &'static str, limit: u64) -> RecordingError {
        let path = path.into();
        match self {
            Self::TooLarge => RecordingError::TooLarge { path, limit },
            Self::Damaged(cause) => RecordingError::Broken { path, format, cause },
        }
    }
}

impl Found {
    /// - `limit`: most bytes that [`Found::pay`] grants
    pub(super) fn new(limit: u64) -> Self {
        Self { arrays: Vec::new(), skipped: Vec::new(), lost: None, left: limit }
    }

    /// Bytes that may still be taken.
    #[cfg(feature = "matlab")]
    pub(super) fn left(&self) -> u64 {
        self.left
    }

    /// Asks for memory before it is taken.
    pub(super) fn pay(&mut self, bytes: u64) -> Result<(), ArrayFault> {
        self.left = self.left.checked_sub(bytes).ok_or(ArrayFault::TooLarge)?;
        Ok(())
    }

    /// Whether there are as many arrays as are read.
    pub(super) fn is_full(&self) -> bool {
        self.arrays.len() >= MOST_ARRAYS
    }

    pub(super) fn add(&mut self, array: NamedArray) -> Result<(), ArrayFault> {
        self.pay(OWN_BYTES)?;
        if !self.is_full() {
            self.arrays.push(array);
        }
        Ok(())
    }

    /// Something that is left out, and what it is.
    pub(super) fn skip(&mut self, name: &str, what: impl std::fmt::Display) {
        if self.skipped.len() < LISTED {
            self.skipped.push(format!("`{name}` ({what})"));
        }
    }

    /// A place whose content cannot be listed, which matters if nothing else is found.
    pub(super) fn lose(&mut self, name: &str, cause: &dyn std::fmt::Display) {
        self.lost.get_or_insert_with(|| format!("`{name}`: {cause}"));
        self.skip(name, cause);
    }

    /// The same, or what is wrong with a file in which there is nothing but damage.
    pub(super) fn unless_lost(mut self) -> Result<Self, ArrayFault> {
        match self.lost.take() {
            Some(cause) if self.arrays.is_empty() => Err(ArrayFault::Damaged(cause)),
            _ => Ok(self),
        }
    }

    /// What [`recording_of_vectors`] makes of the arrays. What was left out is told with it, or
    /// with the error that it may be the reason of.
    pub(super) fn into_recording(
        self,
        path: &str,
        options: &ReadOptions,
    ) -> Result<Recording, RecordingError> {
        let mut skipped = self.skipped.join(", ");
        if self.is_full() {
            skipped = format!("whatever follows the first {MOST_ARRAYS} arrays; {skipped}");
        }
        let recording = recording_of_vectors(path, self.arrays, options);
        if skipped.is_empty() {
            return recording;
        }
        match recording {
            Ok(recording) => Ok(recording.with_note(format!("not read: {skipped}"))),
            Err(RecordingError::NoLog { path, cause }) => {
                Err(RecordingError::NoLog { path, cause: format!("{cause}; not read: {skipped}") })
            }
            error => error,
        }
    }
}
