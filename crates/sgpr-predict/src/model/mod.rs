//! A torque model as a controller needs it, and the file that it is read from.

mod file;
mod parameter_set;
mod streamed;
mod term;

pub use file::ModelError;
pub use parameter_set::{EffectColumn, ParameterSet, TrajectoryColumn};
pub(crate) use streamed::LearnedResidual;
pub use streamed::StreamedModel;
pub use term::Term;

/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::file::{Described, header_and_numbers};
    pub use super::parameter_set::BARELY_MOVING;
    pub use super::streamed::identified;
    pub use super::term::{LARGEST_POSITION, LARGEST_TORQUE, TermDescription, times_of};
}
