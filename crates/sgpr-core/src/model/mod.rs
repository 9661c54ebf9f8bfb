//! The torque model of an arm: identified from logs, compared with others, kept in a file, used in a controller.

mod compare;
mod file;
mod identify;
mod predictor;
mod terms;
mod torque_model;

pub(crate) use identify::{motions, select_joints, torque_of};

pub use compare::{Comparison, JointComparison, LogResidual, compare};
pub use file::ModelFileError;
pub use identify::{
    CutoffInfluence, IdentificationReport, IdentifyError, IdentifyOptions, Start, cutoff_influence, identify,
};
pub use predictor::Predictor;
pub(crate) use terms::Rigid;
pub use terms::{Term, Trajectory};
pub use torque_model::{BaseParameter, Fit, Provenance, TorqueModel};
