use super::KernelError;

/// Why a Gaussian process could not be built or asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpError {
    /// No data.
    #[error("a Gaussian process needs at least one point")]
    Empty,
    /// Arrays that do not belong together.
    #[error("{what} hold {found} numbers where {expected} are expected")]
    Shape {
        /// Array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Length that would fit.
        expected: usize,
    },
    /// NaN or infinity.
    #[error("{what}: row {row}, column {column} is {value}; drop such rows first")]
    NotFinite {
        /// Array.
        what: &'static str,
        /// Row, counted from zero.
        row: usize,
        /// Column, counted from zero.
        column: usize,
        /// NaN or infinity.
        value: f64,
    },
    /// A covariance function that is none, or that cannot be used for this.
    #[error(transparent)]
    Kernel(#[from] KernelError),
    /// More points than fit.
    #[error(
        "{points} points need {needed_gb:.1} GB for an exact Gaussian process, {limit_gb:.1} GB \
         are allowed; take the sparse one, or at most {largest} points (subset)"
    )]
    TooLarge {
        /// Points.
        points: usize,
        /// Memory needed, GB.
        needed_gb: f64,
        /// Memory allowed, GB.
        limit_gb: f64,
        /// Most points that fit.
        largest: usize,
    },
    /// Not a covariance, even with jitter.
    #[error(
        "the covariance of the points is not positive definite, even with {jitter:e} added to its \
         diagonal: raise the noise variance or drop duplicate points"
    )]
    NotPositiveDefinite {
        /// Largest jitter tried.
        jitter: f64,
    },
    /// Nothing was asked of the sparse process.
    #[error("{found} inducing points for {points} data points; choose between 1 and {points}")]
    InducingPoints {
        /// Number asked for.
        found: usize,
        /// Number of data points.
        points: usize,
    },
    /// A file's content that is no Gaussian process.
    #[error("not a Gaussian process, or damaged: {message}")]
    Malformed {
        /// What is wrong with it.
        message: String,
    },
    /// The listener stopped the work before there was a result.
    #[error(transparent)]
    Interrupted(#[from] sgpr_numeric::progress::Interrupted),
}
