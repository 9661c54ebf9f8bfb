//! A torque model as a controller needs it, and the file that it is read from.

mod file;
mod parameter_set;
mod streamed;
mod term;

#[doc(hidden)]
pub use file::Described;
pub use file::ModelError;
#[doc(hidden)]
pub use parameter_set::BARELY_MOVING;
pub use parameter_set::{EffectColumn, ParameterSet, TrajectoryColumn};
pub use streamed::StreamedModel;
#[doc(hidden)]
pub use streamed::identified;
pub use term::Term;
#[doc(hidden)]
pub use term::{LARGEST_POSITION, LARGEST_TORQUE, SMALLEST_TORQUE, TermDescription, times_of};
