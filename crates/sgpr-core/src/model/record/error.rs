use super::super::IdentifyError;

/// Why a record could not be made, read or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The log cannot be turned into equations, or the equations not be solved.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// No record.
    #[error("no record was given")]
    NoRecord,
    /// Not a record, or a damaged one.
    #[error("not a record, or damaged: {message}")]
    Malformed {
        /// What is wrong with it.
        message: String,
    },
    /// Of another robot.
    #[error(
        "the record of {source_name} is of another robot: its fingerprint is {found}, that of \
         `{robot}` is {expected}; joints, links and gravity must be those of the robot file that \
         it was made with"
    )]
    OtherRobot {
        /// Log of the record.
        source_name: String,
        /// Fingerprint of the record.
        found: String,
        /// Name of the robot.
        robot: String,
        /// Its fingerprint.
        expected: String,
    },
    /// Of other equations than the first record.
    #[error(
        "the records of {first} and {other} differ in their {what}, so their equations cannot be \
         summed: make both with the same {what}"
    )]
    Different {
        /// Log of the first record.
        first: String,
        /// Log of the other.
        other: String,
        /// Effects or processing.
        what: &'static str,
    },
    /// Made before records knew what joints did.
    #[error(
        "the record of {source_name} was made by version {version}, which did not keep what a \
         prior asks of the motion: make it again from its log, or identify without a prior"
    )]
    Older {
        /// Log of the record.
        source_name: String,
        /// Version of the library.
        version: String,
    },
    /// What needs single rows.
    #[error(
        "{what} needs the single rows of the logs, which records do not hold: identify from the \
         logs, or choose another method (ols, wls with or without known noise, ridge, tls) and \
         uncertainty `memory`"
    )]
    NeedsRows {
        /// Method or option.
        what: String,
    },
    /// What is no linear effect of the present motion.
    #[error(
        "`{effect}` follows the whole trajectory or has constants that enter nonlinearly, and no \
         record can hold it: leave it out, and add it to the model from a log"
    )]
    NotRecorded {
        /// Effect.
        effect: String,
    },
    /// An effect of which no record can hold columns.
    #[error("`{effect}` cannot be a suspect: {reason}. `sgpr diagnose` looks for it in the logs")]
    NotSuspected {
        /// Effect.
        effect: String,
        /// Why.
        reason: String,
    },
    /// Records that cannot be diagnosed.
    #[error(
        "the record of {source_name} has no columns of effects to look for: make records with \
         suspects"
    )]
    NoSuspects {
        /// Log of the record.
        source_name: String,
    },
    /// Sessions that cannot be compared.
    #[error("{message}")]
    Sessions {
        /// Why, and what to do.
        message: String,
    },
    /// Nothing counts.
    #[error("no sample of {source_name} lies in the part that counts")]
    NothingCounts {
        /// Log.
        source_name: String,
    },
    /// A model whose parameters are not those of the record.
    #[error(
        "the model has `{parameter}`, the record of {source_name} does not: make records with the \
         effects of the model"
    )]
    OtherParameters {
        /// Parameter, or effect, of the model.
        parameter: String,
        /// Log of the record.
        source_name: String,
    },
}
