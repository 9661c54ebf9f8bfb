/// Why a signal could not be processed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// A cut-off that the sampling rate cannot represent.
    #[error("a cut-off of {cutoff_hz} Hz lies outside of what {rate_hz} Hz of sampling can hold: \
         choose between {lowest_hz:.1e} and {} Hz", rate_hz / 2.0)]
    CutoffOutOfRange {
        /// Requested cut-off, Hz.
        cutoff_hz: f64,
        /// Sampling rate, Hz.
        rate_hz: f64,
        /// Lowest cut-off at this rate, Hz.
        lowest_hz: f64,
    },
    /// A filter order that makes no sense.
    #[error("a Butterworth filter of order {order} is not supported: choose 1 to 10")]
    Order {
        /// Requested order.
        order: usize,
    },
    /// Fewer samples than the filter needs at both ends.
    #[error(
        "{samples} samples are too few for this filter, which needs more than {needed}: record \
         longer, or raise the cut-off"
    )]
    TooShort {
        /// Samples there are.
        samples: usize,
        /// Samples needed.
        needed: usize,
    },
    /// A differentiation window that cannot be.
    #[error("{message}")]
    Window {
        /// What is wrong and what would be right.
        message: String,
    },
}
