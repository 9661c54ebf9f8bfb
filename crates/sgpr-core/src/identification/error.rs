use sgpr_predict::names::counted;

/// Why parameters could not be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentificationError {
    /// No row of data is left.
    #[error(
        "there is no usable sample: all were at rest or too near to the ends of their recordings; \
         record a motion of every joint, both ways, slowly and fast"
    )]
    NoData,
    /// A method of another name.
    #[error("there is no method `{text}`; expected is one of {}", super::Method::choices().join(", "))]
    UnknownMethod {
        /// What was asked for.
        text: String,
    },
    /// Fewer rows than unknowns.
    #[error(
        "{} for {}: record longer, or decimate less",
        counted(*rows, "row"),
        counted(*parameters, "parameter")
    )]
    TooFewRows {
        /// Rows there are.
        rows: usize,
        /// Unknowns.
        parameters: usize,
    },
    /// NaN or infinity in the data.
    #[error(
        "sample {sample}: {quantity} of joint {joint} is {value}; find and repair such samples \
         first"
    )]
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
    /// A number whose square overflows.
    #[error(
        "sample {sample}: the equation of joint {} has {value:e} in it, which no arm makes: check \
         the motion, gravity and lengths of the robot file, and the channels of the log that \
         effects ask for",
        joint + 1
    )]
    TooLarge {
        /// Sample, counted from zero.
        sample: usize,
        /// Joint, counted from zero.
        joint: usize,
        /// The value.
        value: f64,
    },
    /// A pull toward the robot file whose widths rounding does not tell apart.
    #[error(
        "ridge: parameters of the robot file are so much smaller than friction of the size of the \
         measured torques that rounding hides them: check the unit of the torque and the masses of \
         the robot file, or use another method"
    )]
    PullWithoutScale,
    /// A filter does not fit the data.
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
    /// Noise levels that make no weights.
    #[error("the noise of joint {} is given as {value}: a standard deviation is positive and \
         finite", joint + 1)]
    Noise {
        /// Joint, counted from zero.
        joint: usize,
        /// Given standard deviation.
        value: f64,
    },
    /// Limits that no arm can keep.
    #[error("no arm keeps these limits together: {}; loosen one of them", limits.join("; "))]
    Contradiction {
        /// A smallest set of limits that contradict each other and the laws of bodies.
        limits: Vec<String>,
    },
    /// A limit that cannot be read.
    #[error("{bound}: {reason}")]
    BadBound {
        /// The limit.
        bound: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A prior of no width.
    #[error(
        "a relative deviation of {value:e} for the prior: it is between {:e} and {:e}, 1 where the \
         robot file is a guess",
        super::PRIOR_DEVIATIONS.start(),
        super::PRIOR_DEVIATIONS.end()
    )]
    Prior {
        /// Given deviation.
        value: f64,
    },
    /// The program of consistent parameters could not be solved although its limits can be kept.
    #[error(
        "the consistent parameters could not be computed ({reason}): a prior less wide or less \
         narrow, or fewer unexcited parameters, make the problem better conditioned"
    )]
    Unsolved {
        /// The solver's word.
        reason: String,
    },
    /// A setting of a method out of its range.
    #[error("{setting}: {value:e} is out of range")]
    Setting {
        /// Which.
        setting: &'static str,
        /// Given value.
        value: f64,
    },
    /// Instrumental variables without instruments.
    #[error(
        "trajectory {} has no instruments: give the motion without its noise, the reference or a \
         simulation, at the same samples", trajectory + 1
    )]
    NoInstruments {
        /// Trajectory, counted from zero.
        trajectory: usize,
    },
    /// Output error without a controller.
    #[error("trajectory {} has no controller: give its gains and the reference, or use another \
         method", trajectory + 1)]
    NoController {
        /// Trajectory, counted from zero.
        trajectory: usize,
    },
    /// The simulated arm runs away.
    #[error(
        "the simulation of trajectory {} diverges: check sign and unit of the gains, or start from \
         a better robot file",
        trajectory + 1
    )]
    Diverged {
        /// Trajectory, counted from zero.
        trajectory: usize,
    },
    /// Too few blocks to draw from.
    #[error(
        "{blocks} blocks of {rows} rows: at least {needed} are needed to draw from; record longer, \
         or use HAC"
    )]
    FewBlocks {
        /// Blocks there are.
        blocks: usize,
        /// Rows of time in each.
        rows: usize,
        /// Fewest.
        needed: usize,
    },
    /// Gains without a scale.
    #[error("nothing is known of the payload: gains need at least its mass, or its first moment")]
    UnknownPayload,
    /// A gain that no drive has.
    #[error(
        "the gain of joint {} comes out as {gain:.3}: the joint hardly feels the payload in these \
         logs; record motions that carry it far from the joint, with speed changes",
        joint + 1
    )]
    NoGain {
        /// Joint, counted from zero.
        joint: usize,
        /// Estimate.
        gain: f64,
    },
    /// Instruments that have nothing to do with the motion.
    #[error("the instruments do not follow the motion: are they of the same samples?")]
    WeakInstruments,
}
