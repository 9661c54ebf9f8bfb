//! The compiled half of the Python package: a boundary, no mathematics.
#![warn(clippy::too_many_lines)]

mod compare;
mod control;
mod convert;
mod detached;
mod diagnosis;
mod dynamics;
mod errors;
mod estimators;
mod excitation;
mod gp;
mod identification;
mod identification_report;
mod keywords;
mod log_residual;
mod log_set;
mod model;
mod online;
mod payload;
mod progress;
mod record;
mod recording;
mod robot;
mod semi_parametric;
mod sessions;
mod simulation;
mod streaming;
mod tables;
mod user_effect;

/// Torque models of robot arms: identify, compare, diagnose, predict.
#[pyo3::pymodule]
mod _sgpr {
    #[pymodule_export]
    use crate::compare::{Comparison, JointComparison, compare};
    #[pymodule_export]
    use crate::control::{Compensation, MomentumObserver};
    #[pymodule_export]
    use crate::diagnosis::{Diagnosis, Finding, diagnose, residual_structure};
    #[pymodule_export]
    use crate::errors::{
        ExcitationError, GaussianProcessError, IdentificationError, ModelFileError, RecordingError,
        RobotError, SgprError, SimulationError,
    };
    #[pymodule_export]
    use crate::estimators::estimators;
    #[pymodule_export]
    use crate::excitation::{Excitation, Trajectory, excite};
    #[pymodule_export]
    use crate::gp::{FittedProcess, Kernel, ProcessPredictor, fit_process, restore_process};
    #[pymodule_export]
    use crate::identification::{
        CutoffInfluence, cutoff_influence, effects, identify, repeated_share, shared_samples,
    };
    #[pymodule_export]
    use crate::identification_report::{CutoffChoice, IdentificationReport};
    #[pymodule_export]
    use crate::log_residual::LogResidual;
    #[pymodule_export]
    use crate::log_set::LogSet;
    #[pymodule_export]
    use crate::model::{Model, Parameter, Parameters, Predictor, Processing, load};
    #[pymodule_export]
    use crate::online::{OnlineGaussianProcess, OnlineModel};
    #[pymodule_export]
    use crate::payload::{DriveGains, Payload, identify_drive_gains, identify_payload, screen};
    #[pymodule_export]
    use crate::record::{
        Record, choose_processing, compare_records, deviations, diagnose_records, identify_records,
        record,
    };
    #[pymodule_export]
    use crate::recording::{
        Issue, Pieces, Recording, Repaired, format_of, formats, quantity_of_array, read_columns,
        read_csv, read_log, read_mcap, read_parquet_pieces, write_mcap,
    };
    #[pymodule_export]
    use crate::robot::{BaseParameters, Robot, puma560, regroupings, two_link};
    #[pymodule_export]
    use crate::semi_parametric::{
        FittedSemiParametric, SemiParametricPredictor, fit_semi_parametric,
    };
    #[pymodule_export]
    use crate::sessions::{SessionComparison, compare_sessions};
    #[pymodule_export]
    use crate::simulation::{Drive, Simulation, puma560_drives, simulate, two_link_drives};
    #[pymodule_export]
    use crate::streaming::compare_streaming;
    #[pymodule_export]
    use crate::user_effect::{UserEffect, register_effect, unregister_effect};
    #[pymodule_init]
    fn init(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        let _ = module;
        sgpr_core::threads::remember_process();
        Ok(())
    }

    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
