//! One file per model: safetensors, so any reader of that format can look at the numbers, and none
//! runs code.
//!
//! The head of the file is JSON: format, version, robot, effects, processing, fit and history, for
//! a person to read with `head -c 4000`. The numbers follow as little-endian `f64`, so that a model
//! read back predicts the same bits.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use sgpr_predict::internal::{Described, TermDescription, header_and_numbers};

use super::TorqueModel;
use super::torque_model::{Fit, Provenance};
use crate::effects::{self, Effect};
use crate::motion::Processing;
use crate::robot::Robot;

/// The entry of the head.
pub(super) const HEAD: &str = "sgpr";
const FORMAT: &str = "sgpr torque model";
const VERSION: u32 = 1;

/// The covariance of base parameters and terms.
const WITH_TERMS: &str = "covariance_with_terms";

/// Larger files hold no torque model.
const LARGEST_FILE: u64 = 1 << 30;

/// Why a model file could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Unreadable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written; an older file of that name is untouched.
    #[error("{path} cannot be written: {source}")]
    Unwritable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Larger than any model.
    #[error("{path}: {bytes} bytes are too many for a torque model (at most {limit})")]
    TooLarge {
        /// File.
        path: String,
        /// Its size.
        bytes: u64,
        /// Largest size that is read.
        limit: u64,
    },
    /// Processes that do not fit into memory.
    #[error(
        "{path}: its Gaussian processes need {needed_gb:.1} GB, {limit_gb:.1} GB may be taken: use \
         a machine with more memory, or learn them with fewer points (`points`, `--points`)"
    )]
    Memory {
        /// File.
        path: String,
        /// Memory needed, GB.
        needed_gb: f64,
        /// Memory that may be taken, GB.
        limit_gb: f64,
    },
    /// Not a model file, or a damaged one.
    #[error("{path}: not a torque model, or damaged: {message}")]
    Malformed {
        /// File.
        path: String,
        /// What is wrong with it.
        message: String,
    },
    /// Written by a later version.
    #[error(
        "{path}: the file has version {found}, this library reads up to {supported}: update it \
         (pip install -U sgpr)"
    )]
    Version {
        /// File.
        path: String,
        /// Its version.
        found: u32,
        /// Latest version that is read.
        supported: u32,
    },
}

impl TorqueModel {
    /// Writes the model to a file; the file is complete or not there.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ModelFileError> {
        write(path.as_ref(), &self.to_bytes())
    }

    /// Reads a model. Safe with files from strangers: nothing in them is run, sizes are checked
    /// before memory is taken.
    ///
    /// # Errors
    /// If the file is no model, damaged, or of a later version.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ModelFileError> {
        Self::load_with(path, &effects::registry())
    }

    /// As [`TorqueModel::load`], with effects of the caller's own among the terms.
    ///
    /// # Errors
    /// As [`TorqueModel::load`].
    pub fn load_with(
        path: impl AsRef<Path>,
        effects: &[Arc<dyn Effect>],
    ) -> Result<Self, ModelFileError> {
        let path = path.as_ref();
        Self::from_bytes_with(&read_limited(path)?, &path.display().to_string(), effects)
    }

    /// The file's content.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = ModelHead {
            format: FORMAT.into(),
            version: VERSION,
            provenance: self.provenance.clone(),
            effects: self.set.effects().iter().map(|effect| effect.name().to_string()).collect(),
            parameter_names: self.set.names().to_vec(),
            processing: self.processing.clone(),
            fit: self.fit.clone(),
            terms: self.terms.iter().map(TermDescription::of).collect(),
            clock_start: self.clock_start,
            robot: self.robot.clone(),
        };
        let mut arrays: Vec<(&str, Vec<usize>, &[f64])> =
            vec![("parameters", vec![self.parameters.len()], &self.parameters)];
        if let Some(fit) = &self.fit {
            let rank = fit.values.len();
            arrays.push(("standard_deviations", vec![rank], &fit.standard_deviations));
            arrays.push(("covariance", vec![rank, rank], &fit.covariance));
            let width = fit.covariance_with_terms.len().isqrt();
            if width > 0 {
                arrays.push((WITH_TERMS, vec![width; 2], &fit.covariance_with_terms));
            }
        }
        let encoded: Vec<(&str, Vec<usize>, Vec<u8>)> = arrays
            .into_iter()
            .map(|(name, shape, values)| {
                (name, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
            })
            .collect();
        let views = encoded.iter().map(|(name, shape, bytes)| {
            (
                *name,
                TensorView::new(Dtype::F64, shape.clone(), bytes).expect("eight bytes per number"),
            )
        });
        // One entry: the order of several would differ from run to run.
        let head = serde_json::to_string(&head).expect("plain data");
        safetensors::serialize(views, Some(HashMap::from([(HEAD.into(), head)])))
            .expect("valid tensors")
    }

    /// A model from a file's content; `origin` names it in messages.
    ///
    /// # Errors
    /// As [`TorqueModel::load`].
    pub fn from_bytes(bytes: &[u8], origin: &str) -> Result<Self, ModelFileError> {
        Self::from_bytes_with(bytes, origin, &effects::registry())
    }

    /// As [`TorqueModel::from_bytes`], with effects of the caller's own among the terms.
    ///
    /// # Errors
    /// As [`TorqueModel::load`].
    pub fn from_bytes_with(
        bytes: &[u8],
        origin: &str,
        effects: &[Arc<dyn Effect>],
    ) -> Result<Self, ModelFileError> {
        let malformed =
            |message: String| ModelFileError::Malformed { path: origin.into(), message };
        let (head, tensors) = open(bytes, origin, FORMAT, VERSION)?;
        let head: ModelHead =
            serde_json::from_str(&head).map_err(|error| malformed(format!("its head: {error}")))?;
        Self::from_head(head, &tensors, effects).map_err(malformed)
    }

    fn from_head(
        head: ModelHead,
        tensors: &SafeTensors<'_>,
        known: &[Arc<dyn Effect>],
    ) -> Result<Self, String> {
        let ModelHead {
            robot,
            effects,
            parameter_names,
            provenance,
            processing,
            fit,
            terms,
            clock_start,
            ..
        } = head;
        let described = Described { effects, parameter_names, terms, robot };
        let (robot, set, parameters, terms) =
            described.parts(known, |name, length| array(tensors, name, length))?;
        if let Some(processing) = &processing {
            processing.check(robot.dof()).map_err(|error| format!("its processing: {error}"))?;
        }
        let mut model = Self::from_parameters(robot, set, parameters, vec![]);
        (model.provenance, model.processing) = (provenance, processing);
        model = model.with_terms(terms, clock_start);
        if let Some(mut fit) = fit {
            let rank = model.base.rank();
            if fit.values.len() != rank {
                return Err(format!(
                    "{} base parameters where the robot has {rank}",
                    fit.values.len()
                ));
            }
            check_figures(&fit, model.robot.dof())?;
            fit.standard_deviations = array(tensors, "standard_deviations", rank)?;
            fit.covariance = array(tensors, "covariance", rank * rank)?;
            // Not in files of versions that did not keep it.
            if tensors.names().contains(&WITH_TERMS) {
                let of_terms =
                    model.terms.iter().map(|term| term.coefficients.len() + term.constants.len());
                let width = rank + of_terms.sum::<usize>();
                fit.covariance_with_terms = array(tensors, WITH_TERMS, width * width)?;
            }
            model.fit = Some(fit);
        }
        Ok(model)
    }
}

/// Largest factor on a standard deviation.
const MOST_TIMES: f64 = 1e9;

/// Figures of a fit are there for each joint, and within range.
fn check_figures(fit: &Fit, joints: usize) -> Result<(), String> {
    for (name, count) in [
        ("noise", fit.noise.len()),
        ("rows", fit.rows.len()),
        ("correlation", fit.correlation.len()),
    ] {
        if count != joints {
            return Err(format!(
                "its fit: {name} is of {count} joints where the robot has {joints}"
            ));
        }
    }
    let prior = fit.prior_standard_deviation.map(|value| ("prior_standard_deviation", value));
    for (name, value) in
        [("dispersion", fit.dispersion), ("half_interval_95", fit.half_interval_95)]
            .into_iter()
            .chain(prior)
    {
        if !(0.0..=MOST_TIMES).contains(&value) {
            return Err(format!(
                "its fit: {name} is {value}; expected a number from 0 to {MOST_TIMES:e}"
            ));
        }
    }
    fit.prior.map_or(Ok(()), |width| width.check()).map_err(|error| format!("its fit: {error}"))
}

/// What the head of a file says, in the order in which a person reads it.
#[derive(Serialize, Deserialize)]
struct ModelHead {
    format: String,
    version: u32,
    provenance: Provenance,
    effects: Vec<String>,
    parameter_names: Vec<String>,
    processing: Option<Processing>,
    fit: Option<Fit>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    terms: Vec<TermDescription>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    clock_start: Option<i64>,
    robot: Robot,
}

/// The part of the head that every version has.
#[derive(Deserialize)]
struct FileKind {
    format: String,
    version: u32,
}

/// The content of a file that is not too large.
pub(super) fn read_limited(path: &Path) -> Result<Vec<u8>, ModelFileError> {
    let name = path.display().to_string();
    let unreadable = |source| ModelFileError::Unreadable { path: name.clone(), source };
    let content = crate::limited_file::read(path, LARGEST_FILE).map_err(unreadable)?;
    content.map_err(|bytes| ModelFileError::TooLarge { path: name, bytes, limit: LARGEST_FILE })
}

pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), ModelFileError> {
    crate::atomic_file::write(path, |file| file.write_all(bytes))
        .map_err(|source| ModelFileError::Unwritable { path: path.display().to_string(), source })
}

/// Head and arrays of a file of `format`, if it is one and its version is known.
pub(super) fn open<'a>(
    bytes: &'a [u8],
    origin: &str,
    expected: &str,
    supported: u32,
) -> Result<(String, SafeTensors<'a>), ModelFileError> {
    let malformed = |message: String| ModelFileError::Malformed { path: origin.into(), message };
    header_and_numbers(bytes).map_err(|fault| malformed(fault.into()))?;
    let (_, header) =
        SafeTensors::read_metadata(bytes).map_err(|error| malformed(error.to_string()))?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|error| malformed(error.to_string()))?;
    let head = header.metadata().as_ref().and_then(|entries| entries.get(HEAD));
    let head = head.ok_or_else(|| malformed(format!("its head has no entry `{HEAD}`")))?;
    let FileKind { format, version } =
        serde_json::from_str(head).map_err(|error| malformed(format!("its head: {error}")))?;
    if format != expected {
        return Err(malformed(format!("its head says `{format}`, not `{expected}`")));
    }
    if version > supported {
        return Err(ModelFileError::Version { path: origin.into(), found: version, supported });
    }
    Ok((head.clone(), tensors))
}

pub(super) fn array(
    tensors: &SafeTensors<'_>,
    name: &str,
    length: usize,
) -> Result<Vec<f64>, String> {
    let view = tensors.tensor(name).map_err(|_| format!("`{name}` is missing"))?;
    let (chunks, rest) = view.data().as_chunks::<8>();
    if view.dtype() != Dtype::F64 || chunks.len() != length || !rest.is_empty() {
        return Err(format!("`{name}` should hold {length} numbers of 64 bits"));
    }
    Ok(chunks.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
}
