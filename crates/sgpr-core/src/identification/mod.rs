//! From motion and torque to parameters: which can be known, and what they are.
//!
//! [`ParameterSet`] names every parameter of a robot and its effects, [`BaseParameters`] are the
//! combinations that motion can reveal, [`Observation`] turns samples into one triangular factor
//! per joint, and least squares ([`LeastSquares`]) works on these factors only, so its cost does
//! not depend on the length of the log.

mod autocorrelation;
mod base_parameters;
mod block_bootstrap;
mod closed_loop;
mod consistency;
mod drive_gains;
mod error;
mod essential;
mod estimate;
mod estimator;
mod extended_factor;
mod few_rows;
mod forecast;
mod formulas;
mod gautier_khalil;
mod groups;
mod hac;
mod instrumental_variables;
mod judgement;
mod least_squares;
mod left_out;
mod null_space;
mod observation;
mod output_error;
mod parameter_scales;
mod payload;
mod posterior;
mod prior;
mod recursive;
mod ridge;
mod robust;
mod screening;
mod total_least_squares;

pub use crate::intervals::HALF_INTERVAL_95;
pub(crate) use autocorrelation::{LagProducts, Memory, lag_groups, rows_per_independent_row};
pub use base_parameters::{BaseParameters, ParameterClass};
pub use block_bootstrap::{Bootstrap, block_bootstrap};
pub use closed_loop::{ClosedLoop, SimulatedMotion};
pub(crate) use consistency::nearest_load;
pub use consistency::{
    Consistency, ConsistentParameters, Costs, DEVIATIONS, Distance, KeptOut, KnownPayload,
    LinkBounds, LinkCertificate, ParameterBounds, PhysicalBounds, Price, Prior, Region, Stage,
    weakest_good_deviation,
};
pub use drive_gains::{DriveGains, GainEstimator, GainOptions, identify_drive_gains};
pub use error::IdentificationError;
pub use essential::{Dropped, Essential, essential_parameters};
pub use estimate::{estimate, residual_correlation};
pub use estimator::{Estimator, EstimatorNeeds, EstimatorSetting, Method};
pub use forecast::Forecast;
pub(crate) use forecast::{LONGER, STATES, deviation_of, either_way, equations_of, variances};
pub use gautier_khalil::{Regrouping, RegroupingFactor, regroupings};
pub use hac::hac_covariance;
pub use instrumental_variables::INSTRUMENTAL_VARIABLES;
pub use judgement::Judgement;
pub(crate) use judgement::deviate_of_t;
pub use least_squares::{Estimate, LeastSquares, ParameterExcitation, SingularDirection};
pub(crate) use least_squares::{
    residual_norm, stack, torque_sizes, triangular_solution, unit_covariance,
};
pub(crate) use left_out::half_run;
pub use left_out::{Dispersion, LeftOut};
pub use observation::{Equation, Equations, JointFactor, Observation, Row, Trajectory};
pub(crate) use observation::{KeptRows, piece_of, stacked};
pub use output_error::OUTPUT_ERROR;
pub use payload::{Payload, PayloadOptions, identify_payload};
pub(crate) use posterior::without_negative;
pub use posterior::{Held, PriorWidth, estimate_with_prior};
pub use prior::ParameterPrior;
pub(crate) use prior::{EFFECT_SCALES, WIDTHS, role_of, usual_speed};
pub use recursive::{RECURSIVE, RecursiveLeastSquares};
pub use ridge::RIDGE;
pub use robust::IRLS;
pub(crate) use screening::{Apart, Left, ShiftedTorques, beyond_own_rows, logs_apart};
pub use screening::{
    Finding, screen_delays, screen_factors, screen_logs, screen_rows, screen_scale,
};
pub use sgpr_predict::model::{EffectColumn, ParameterSet, TrajectoryColumn};
pub use total_least_squares::TOTAL_LEAST_SQUARES;

/// All estimators beyond least squares, by name in [`Method`].
pub static ESTIMATORS: [&Estimator; 6] =
    [&IRLS, &RIDGE, &TOTAL_LEAST_SQUARES, &INSTRUMENTAL_VARIABLES, &OUTPUT_ERROR, &RECURSIVE];

/// Relative deviations of a prior: beyond, its squares and the data no longer fit into one number.
const PRIOR_DEVIATIONS: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

fn check_prior_deviation(value: f64) -> Result<(), IdentificationError> {
    if PRIOR_DEVIATIONS.contains(&value) {
        Ok(())
    } else {
        Err(IdentificationError::Prior { value })
    }
}
