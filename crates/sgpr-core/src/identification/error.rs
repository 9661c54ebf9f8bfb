/// Why parameters could not be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentificationError {
    /// No row of data is left.
    #[error("there is no usable sample: all were at rest or too near to the ends of their recordings")]
    NoData,
    /// Fewer rows than unknowns.
    #[error("{rows} rows for {parameters} parameters: record longer, or decimate less")]
    TooFewRows {
        /// Rows there are.
        rows: usize,
        /// Unknowns.
        parameters: usize,
    },
    /// NaN or infinity in the data.
    #[error("sample {sample}: {quantity} of joint {joint} is {value}; find and repair such samples first")]
    NotFinite {
        /// Sample, counted from zero.
        sample: usize,
        /// Position, velocity, acceleration or torque.
        quantity: &'static str,
        /// Joint, counted from zero.
        joint: usize,
        /// The value.
        value: f64,
    },
    /// A filter does not fit the data.
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
    /// Noise levels that make no weights.
    #[error("the noise of joint {joint} is given as {value}: a standard deviation is positive and finite")]
    Noise {
        /// Joint, counted from zero.
        joint: usize,
        /// Given standard deviation.
        value: f64,
    },
}
