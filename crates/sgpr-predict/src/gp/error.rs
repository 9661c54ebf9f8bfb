use alloc::string::String;

/// Why something is no covariance function.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// A kernel that looks at inputs which are not there.
    #[error("the kernel looks at input {input}, but there are only {inputs} (counted from zero)")]
    Input {
        /// Index of the input.
        input: usize,
        /// Number of inputs.
        inputs: usize,
    },
    /// Length scales, variances and periods are positive, and have squares that are numbers.
    #[error("{name} is {value}; it must be positive and finite, from 1e-150 to 1e150")]
    Hyperparameter {
        /// Name.
        name: String,
        /// Its value.
        value: f64,
    },
    /// A kernel without a part that would make it one, or one that cannot be used for this.
    #[error("the kernel has {found}; {advice}")]
    Unfit {
        /// What is wrong.
        found: String,
        /// What would be right.
        advice: &'static str,
    },
}
