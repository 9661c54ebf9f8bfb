use alloc::string::String;
use alloc::vec::Vec;

/// A quantity logged beside the joints: a temperature, a commanded position.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name as in the log.
    pub name: String,
    /// `[samples]`; NaN where the log has no value.
    pub values: Vec<f64>,
}
