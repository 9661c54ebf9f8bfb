//! What a call returns, and its words; no panic leaves the library.

use std::cell::RefCell;
use std::ffi::c_char;
use std::fmt::{self, Display, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};

use sgpr_predict::stream::StreamError;

/// All went well.
pub const SGPR_OK: i32 = 0;
/// A pointer that must not be NULL is.
pub const SGPR_NULL_POINTER: i32 = 1;
/// An array of another length than the model has joints.
pub const SGPR_WRONG_LENGTH: i32 = 2;
/// A number of a sample that is not finite.
pub const SGPR_NOT_FINITE: i32 = 3;
/// A time between samples that is zero, negative or too short, a time that runs backwards.
pub const SGPR_BAD_TIME: i32 = 4;
/// An effect needs the temperature of its joint: sgpr_predictor_set_temperature.
pub const SGPR_NO_TEMPERATURE: i32 = 5;
/// A file that is not there, is no model, or is that of a newer version.
pub const SGPR_BAD_MODEL: i32 = 6;
/// An option that is none, a rate that an effect needs, or a standard deviation of a model or
/// predictor without one.
pub const SGPR_BAD_OPTION: i32 = 7;
/// A model with an effect that cannot be advanced sample by sample, or a Gaussian process that
/// cannot be asked.
pub const SGPR_NOT_STREAMED: i32 = 8;
/// A mistake in the library: please report it.
pub const SGPR_INTERNAL: i32 = 9;
/// No good sample yet, of which something could be said.
pub const SGPR_NO_SAMPLE: i32 = 10;

/// The codes of failures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Code {
    NullPointer = SGPR_NULL_POINTER,
    WrongLength = SGPR_WRONG_LENGTH,
    NotFinite = SGPR_NOT_FINITE,
    BadTime = SGPR_BAD_TIME,
    NoTemperature = SGPR_NO_TEMPERATURE,
    BadModel = SGPR_BAD_MODEL,
    BadOption = SGPR_BAD_OPTION,
    NotStreamed = SGPR_NOT_STREAMED,
    Internal = SGPR_INTERNAL,
    NoSample = SGPR_NO_SAMPLE,
}

/// A failure; its words are kept in this thread.
#[derive(Clone, Copy, Debug)]
pub struct Failure(Code);

impl Failure {
    /// Keeps the words without allocating, so that a refused sample costs no more than a good one.
    pub fn new(code: Code, words: &dyn Display) -> Self {
        MESSAGE.with_borrow_mut(|message| {
            message.length = 0;
            // What is too long is cut.
            let _ = write!(message, "{words}");
            message.text[message.length] = 0;
        });
        Self(code)
    }

    pub fn null(name: &str) -> Self {
        Self::new(Code::NullPointer, &format_args!("{name} is NULL"))
    }

    pub fn is_of_sample(self) -> bool {
        matches!(self.0, Code::NotFinite | Code::NoTemperature | Code::BadTime)
    }
}

impl From<StreamError> for Failure {
    fn from(error: StreamError) -> Self {
        let code = match error {
            StreamError::Length { .. } => Code::WrongLength,
            StreamError::OutOfRange { found, .. } if !found.is_finite() => Code::NotFinite,
            StreamError::NotFinite { .. } => Code::NotFinite,
            StreamError::Step { .. } | StreamError::StepTooShort { .. } => Code::BadTime,
            StreamError::TemperatureNeeded { .. } => Code::NoTemperature,
            StreamError::Rate { .. }
            | StreamError::RateNeeded { .. }
            | StreamError::UnknownEffect { .. }
            | StreamError::OutOfRange { .. }
            | StreamError::NotLearned => Code::BadOption,
            _ => Code::NotStreamed,
        };
        Self::new(code, &error)
    }
}

/// Longest message, with the zero at its end.
const LONGEST: usize = 1024;

/// A C string.
struct Message {
    text: [u8; LONGEST],
    length: usize,
}

impl Write for Message {
    fn write_str(&mut self, words: &str) -> fmt::Result {
        for c in words.chars() {
            let next = self.length + c.len_utf8();
            if next >= LONGEST {
                return Err(fmt::Error);
            }
            c.encode_utf8(&mut self.text[self.length..next]);
            self.length = next;
        }
        Ok(())
    }
}

thread_local! {
    static MESSAGE: RefCell<Message> = const { RefCell::new(Message { text: [0; LONGEST], length: 0 }) };
}

pub fn last() -> *const c_char {
    MESSAGE.with_borrow(|message| message.text.as_ptr().cast())
}

/// The code of a call.
pub fn code(call: impl FnOnce() -> Result<(), Failure>) -> i32 {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => SGPR_OK,
        Ok(Err(Failure(code))) => code as i32,
        Err(panic) => {
            let words = panic.downcast_ref::<String>().map(String::as_str);
            let words =
                words.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words");
            Failure::new(
                Code::Internal,
                &format_args!("a mistake in sgpr, please report it: {words}"),
            );
            Code::Internal as i32
        }
    }
}
