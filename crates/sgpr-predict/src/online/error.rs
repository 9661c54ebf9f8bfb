use alloc::string::{String, ToString};

use crate::gp::KernelError;
use crate::names::counted;
use crate::stream::StreamError;

/// Why an online model was not made, or refuses a sample.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OnlineError {
    /// An option without meaning.
    #[error("{option} is {value}: {expected}")]
    InvalidOption {
        /// Option.
        option: &'static str,
        /// Given value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A link that the robot does not have.
    #[error(
        "there is no link {link}: the robot has the links 0 to {last}; payloads hang on one of them"
    )]
    NoSuchLink {
        /// Link asked for.
        link: usize,
        /// Last link of the robot.
        last: usize,
    },
    /// One value per joint, or per input, is needed.
    #[error("{what}: got {}, expected {expected}", counted(*found, "value"))]
    Length {
        /// Array.
        what: &'static str,
        /// Values needed.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A sample with NaN or infinity, which would stay in the memory of the model.
    #[error("{what}: value {index} is {value}; leave samples that were not measured out")]
    NotFinite {
        /// Array.
        what: &'static str,
        /// Place in it.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A kernel of which no process can be made.
    #[error("{0}")]
    Kernel(String),
    /// A model that cannot be streamed.
    #[error(transparent)]
    Stream(#[from] StreamError),
}

impl From<KernelError> for OnlineError {
    fn from(error: KernelError) -> Self {
        Self::Kernel(error.to_string())
    }
}

pub(super) fn require(
    what: &'static str,
    values: &[f64],
    expected: usize,
) -> Result<(), OnlineError> {
    if values.len() != expected {
        return Err(OnlineError::Length { what, expected, found: values.len() });
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(OnlineError::NotFinite { what, index, value: values[index] }),
        None => Ok(()),
    }
}

pub(super) fn require_positive(option: &'static str, value: f64) -> Result<(), OnlineError> {
    match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(OnlineError::InvalidOption {
            option,
            value,
            expected: "a finite number above zero",
        }),
    }
}
