//! From motion and torque to parameters: which can be known, and what they are.
//!
//! [`ParameterSet`] names every parameter of a robot and its effects, [`BaseParameters`] are the combinations that
//! motion can reveal, [`Observation`] turns samples into one triangular factor per joint, and least squares
//! ([`LeastSquares`]) works on these factors only, so its cost does not depend on the length of the log.

mod base_parameters;
mod error;
mod least_squares;
mod observation;
mod parameter_set;

pub use base_parameters::{BaseParameters, ParameterClass};
pub use error::IdentificationError;
pub use least_squares::{Estimate, Excitation, LeastSquares, Method, SingularDirection};
pub use observation::{JointFactor, Observation, Row};
pub use parameter_set::{EffectColumn, ParameterSet};
