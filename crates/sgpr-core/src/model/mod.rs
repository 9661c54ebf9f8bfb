//! The torque model of an arm: identified from logs, compared with others, kept in a file, used in
//! a controller.

mod compare;
mod correlation;
mod error;
mod experiment;
mod extent;
mod file;
mod forecast;
mod held;
mod identify;
mod limits;
mod log_prediction;
mod payload;
mod prediction_band;
mod record;
mod semi_parametric;
mod streaming;
mod terms;
mod torque_model;
mod torque_scale;
mod trajectory;
mod variable_projection;

pub(crate) use experiment::{given_or_chosen, select_joints, torque_of};
pub(crate) use identify::{Given, identify_again};

pub use crate::identification::Forecast;
pub use compare::{Comparison, InBand, JointComparison, LogResidual, compare};
pub use error::IdentifyError;
pub use file::ModelFileError;
pub use identify::{
    Controller, CutoffInfluence, IdentificationReport, IdentifyOptions, Start, Uncertainty,
    cutoff_influence, identify, screen,
};
pub use log_prediction::{LogPrediction, predict};
pub use payload::{identify_drive_gains, identify_payload};
pub use record::{
    Deviation, JointDeviation, ParameterDeviation, Record, RecordBlock, RecordDiagnosis,
    RecordError, RecordFinding, RecordMemory, RecordOptions, RecordedError, SessionCause,
    SessionComparison, SessionTest, Suspect, SuspectTest, choose_processing, compare_records,
    compare_sessions, copies_among, deviations, diagnose_records, identify_records, record,
};
pub use semi_parametric::{
    Candidate, Coverage, FollowingIntervals, Inputs, JointReport, Mean, SemiParametricError,
    SemiParametricModel, SemiParametricOptions, TorquePrediction, fit_rest, fit_semi_parametric,
};
pub(crate) use sgpr_predict::internal::{Sampler, StreamStart, TermSteps, times_of};
pub use sgpr_predict::model::{StreamedModel, Term};
pub use sgpr_predict::stream::{
    Predictor, Purpose, ResidualOptions, SavedStates, StreamError, StreamOptions, UnknownPurpose,
};
pub use streaming::{StreamedMotion, compare_streaming};
pub(crate) use terms::{AlongMotion, common_clock, seconds_since};
pub(crate) use torque_model::nominal_parameters;
pub use torque_model::{BaseParameter, Certificate, Fit, Provenance, TorqueModel};
pub use torque_scale::torque_scale;
pub(crate) use trajectory::Rigid;
pub use trajectory::Trajectory;
