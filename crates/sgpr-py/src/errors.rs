//! Errors of the core as Python exceptions.
//!
//! Everything the library complains about is an `SgprError`, which is a `ValueError`; files that
//! the system does not open are an `OSError`, as from `open`.

use std::ffi::CString;

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use sgpr_core::control::ObserverError;
use sgpr_core::diagnosis::DiagnosisError;
use sgpr_core::effects::UnknownEffect;
use sgpr_core::excitation::ExcitationError as ExcitationFailure;
use sgpr_core::export::ExportError;
use sgpr_core::gp::{GpError, KernelError};
use sgpr_core::identification;
use sgpr_core::model::{self, IdentifyError, SemiParametricError};
use sgpr_core::motion::MotionError;
use sgpr_core::online::OnlineError;
use sgpr_core::recording;
use sgpr_core::robot;
use sgpr_core::signal::SignalError;
use sgpr_core::simulation::SimulationError as SimulationFailure;

create_exception!(
    sgpr,
    SgprError,
    PyValueError,
    "What sgpr cannot accept, and why. The base of its exceptions."
);
create_exception!(sgpr, RobotError, SgprError, "A robot file or table that makes no robot.");
create_exception!(
    sgpr,
    RecordingError,
    SgprError,
    "A log that cannot be read, repaired, written or turned into motion."
);
create_exception!(
    sgpr,
    IdentificationError,
    SgprError,
    "Parameters that cannot be identified from what was given."
);
create_exception!(
    sgpr,
    GaussianProcessError,
    SgprError,
    "Data or a kernel of which no Gaussian process can be made."
);
create_exception!(sgpr, ModelFileError, SgprError, "A file that holds no model.");

create_exception!(
    sgpr,
    ExcitationError,
    SgprError,
    "Limits or options under which there is no excitation trajectory."
);
create_exception!(
    sgpr,
    SimulationError,
    SgprError,
    "A simulation that cannot be run, or stopped: which joint, and when."
);

/// An error of the core, as Python shall see it.
pub trait IntoPyErr {
    /// The exception.
    fn into_py_err(self) -> PyErr;
}

/// An argument that cannot be.
pub fn invalid(message: impl Into<String>) -> PyErr {
    SgprError::new_err(message.into())
}

impl IntoPyErr for robot::RobotError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Unreadable { path, source } | Self::Unwritable { path, source } => {
                os_error(path, &source).unwrap_or_else(RobotError::new_err)
            }
            error => RobotError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for recording::RecordingError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Unreadable { path, source } | Self::Unwritable { path, source } => {
                os_error(path, &source).unwrap_or_else(RecordingError::new_err)
            }
            error => RecordingError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for model::ModelFileError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Unreadable { path, source } | Self::Unwritable { path, source } => {
                os_error(path, &source).unwrap_or_else(ModelFileError::new_err)
            }
            error => ModelFileError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for MotionError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::NoRecording | Self::Processing { .. } => {
                IdentificationError::new_err(self.to_string())
            }
            Self::Signal(error) => error.into_py_err(),
            error => RecordingError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for SignalError {
    fn into_py_err(self) -> PyErr {
        IdentificationError::new_err(self.to_string())
    }
}

impl IntoPyErr for ExcitationFailure {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Recording(error) => error.into_py_err(),
            error => ExcitationError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for OnlineError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Kernel(message) => GaussianProcessError::new_err(message),
            error => SgprError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for model::StreamError {
    fn into_py_err(self) -> PyErr {
        SgprError::new_err(self.to_string())
    }
}

impl IntoPyErr for ObserverError {
    fn into_py_err(self) -> PyErr {
        SgprError::new_err(self.to_string())
    }
}

impl IntoPyErr for ExportError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Language { .. } | Self::Precision { .. } | Self::Name { .. } => {
                PyValueError::new_err(self.to_string())
            }
            Self::Write { .. } => PyOSError::new_err(self.to_string()),
            _ => SgprError::new_err(self.to_string()),
        }
    }
}

impl IntoPyErr for SimulationFailure {
    fn into_py_err(self) -> PyErr {
        SimulationError::new_err(self.to_string())
    }
}

impl IntoPyErr for UnknownEffect {
    fn into_py_err(self) -> PyErr {
        IdentificationError::new_err(self.to_string())
    }
}

impl IntoPyErr for identification::IdentificationError {
    fn into_py_err(self) -> PyErr {
        IdentificationError::new_err(self.to_string())
    }
}

impl IntoPyErr for IdentifyError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Recording(error) => error.into_py_err(),
            Self::Motion(error) => error.into_py_err(),
            Self::Identification(error) => error.into_py_err(),
            Self::Effect(error) => error.into_py_err(),
            Self::Signal(error) => error.into_py_err(),
            Self::Stream(error) => error.into_py_err(),
            error => IdentificationError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for model::RecordError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Identify(error) => error.into_py_err(),
            error => IdentificationError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for KernelError {
    fn into_py_err(self) -> PyErr {
        GpError::from(self).into_py_err()
    }
}

impl IntoPyErr for GpError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::TooLarge { .. } => PyMemoryError::new_err(self.to_string()),
            error => GaussianProcessError::new_err(error.to_string()),
        }
    }
}

impl IntoPyErr for SemiParametricError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Identify(error) => error.into_py_err(),
            Self::Gp(error) => error.into_py_err(),
            error => invalid(error.to_string()),
        }
    }
}

impl IntoPyErr for DiagnosisError {
    fn into_py_err(self) -> PyErr {
        match self {
            Self::Model(error) => error.into_py_err(),
            error => IdentificationError::new_err(error.to_string()),
        }
    }
}

/// `FileNotFoundError`, `PermissionError` and so on, as `open` raises them. A message if the file
/// was opened and it was its content that could not be read.
fn os_error(path: String, source: &std::io::Error) -> Result<PyErr, String> {
    let Some(code) = os_code(source) else { return Err(format!("{path}: {source}")) };
    let text = std::io::Error::from_raw_os_error(code).to_string();
    let reason = text.split(" (os error").next().unwrap_or_default().to_string();
    Ok(PyOSError::new_err((code, reason, path)))
}

/// What the system said, if it was the system; where its number got lost on the way, the number
/// that the kind has.
fn os_code(error: &std::io::Error) -> Option<i32> {
    use std::io::ErrorKind;
    error.raw_os_error().or(match error.kind() {
        ErrorKind::NotFound => Some(2),
        ErrorKind::PermissionDenied => Some(13),
        ErrorKind::AlreadyExists => Some(17),
        ErrorKind::NotADirectory => Some(20),
        ErrorKind::IsADirectory => Some(21),
        ErrorKind::StorageFull => Some(28),
        ErrorKind::ReadOnlyFilesystem => Some(30),
        _ => None,
    })
}

/// Warns of what the user should read.
pub fn warn(py: Python<'_>, texts: &[String]) -> PyResult<()> {
    let category = py.get_type::<PyUserWarning>();
    texts
        .iter()
        .try_for_each(|text| PyErr::warn(py, &category, &CString::new(text.replace('\0', ""))?, 2))
}
