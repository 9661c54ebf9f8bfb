//! Reading the file of a torque model: a head in JSON and arrays of numbers, in the format of
//! safetensors.
//!
//! The crate `safetensors` would make the tree of this one half as large again; what is needed of
//! the format is a length, a JSON object and ranges of bytes.

use alloc::collections::BTreeMap;
use alloc::string::{String, ToString};
use alloc::sync::Arc;
use alloc::vec::Vec;

use serde::Deserialize;

use super::streamed::{LearnedBasis, LearnedJoint};
use super::term::TermDescription;
use super::{LearnedResidual, ParameterSet, StreamedModel, Term};
use crate::effects::{self, Effect};
use crate::gp::{Covariance, LearnedProcess, Seen};
use crate::robot::Robot;

const FORMAT: &str = "sgpr torque model";
const LEARNED_FORMAT: &str = "sgpr semi-parametric model";
const VERSION: u32 = 1;

/// Largest budget of points that a model is learned with.
const MOST_POINTS: usize = 20_000;

/// Larger files hold no torque model.
#[cfg(feature = "std")]
const LARGEST_FILE: u64 = 1 << 30;

/// Why a model could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file could not be read.
    #[cfg(feature = "std")]
    #[error("{path}: {source}")]
    Unreadable {
        /// File.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Larger than any model.
    #[cfg(feature = "std")]
    #[error("{path}: {bytes} bytes are too many for a torque model (at most {limit})")]
    TooLarge {
        /// File.
        path: String,
        /// Its size.
        bytes: u64,
        /// Largest size that is read.
        limit: u64,
    },
    /// Not a model file, or a damaged one.
    #[error("{origin}: not a torque model, or damaged: {message}")]
    Malformed {
        /// File.
        origin: String,
        /// What is wrong with it.
        message: String,
    },
    /// A model of another kind.
    #[error(
        "{origin}: its head says `{found}`; a controller takes a `{FORMAT}` or a `{LEARNED_FORMAT}`"
    )]
    Kind {
        /// File.
        origin: String,
        /// What the head names.
        found: String,
    },
    /// Written by a later version.
    #[error(
        "{origin}: the file has version {found}, this library reads up to {supported}: update it"
    )]
    Version {
        /// File.
        origin: String,
        /// Its version.
        found: u32,
        /// Latest version that is read.
        supported: u32,
    },
}

/// What the head of a file says of the torque.
#[doc(hidden)]
#[derive(Debug, Deserialize)]
pub struct Described {
    pub effects: Vec<String>,
    pub parameter_names: Vec<String>,
    #[serde(default)]
    pub terms: Vec<TermDescription>,
    pub robot: Robot,
}

impl Described {
    /// Parameters and terms, checked: the robot as described, the set, its parameters, the terms.
    ///
    /// - `read`: the array of that name and length
    ///
    /// # Errors
    /// What is wrong.
    pub fn parts(
        self,
        known: &[Arc<dyn Effect>],
        read: impl FnOnce(&str, usize) -> Result<Vec<f64>, String>,
    ) -> Result<(Robot, ParameterSet, Vec<f64>, Vec<Term>), String> {
        let Self { effects, parameter_names, terms, robot } = self;
        let set = ParameterSet::new(&robot, &effects).map_err(|error| error.to_string())?;
        if parameter_names != set.names() {
            return Err("its parameters are not those of its robot and effects".into());
        }
        let parameters = read("parameters", set.len())?;
        if let Some(index) = parameters.iter().position(|value| !value.is_finite()) {
            return Err(format!(
                "the parameter {} is {}",
                parameter_names[index], parameters[index]
            ));
        }
        let terms =
            terms.into_iter().map(|term| term.term(known, &robot)).collect::<Result<_, _>>()?;
        Ok((robot, set, parameters, terms))
    }
}

/// The head, but for what only identification knows.
#[derive(Deserialize)]
struct PhysicsHead {
    fit: Option<StoredFit>,
    #[serde(flatten)]
    described: Described,
}

#[derive(Deserialize)]
struct StoredFit {
    noise: Vec<f64>,
}

/// The part of the head that every version has.
#[derive(Deserialize)]
struct KindOfFile {
    format: String,
    version: u32,
}

impl StreamedModel {
    /// Reads the file of a torque model or of a semi-parametric one. Safe with files from
    /// strangers: nothing in them is run, sizes are checked before memory is taken.
    ///
    /// # Errors
    /// If the file is no model, damaged, or of a later version.
    #[cfg(feature = "std")]
    pub fn load(path: impl AsRef<std::path::Path>) -> Result<Self, ModelError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let unreadable = |source| ModelError::Unreadable { path: name.clone(), source };
        let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
        if bytes > LARGEST_FILE {
            return Err(ModelError::TooLarge { path: name, bytes, limit: LARGEST_FILE });
        }
        Self::from_bytes(&std::fs::read(path).map_err(unreadable)?, &name)
    }

    /// A model from a file's content; `origin` names it in messages.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_bytes(bytes: &[u8], origin: &str) -> Result<Self, ModelError> {
        Self::from_bytes_with(bytes, origin, &effects::registry())
    }

    /// As [`Self::from_bytes`], with effects of the caller's own.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_bytes_with(
        bytes: &[u8],
        origin: &str,
        effects: &[Arc<dyn Effect>],
    ) -> Result<Self, ModelError> {
        Self::read(bytes, origin, effects, false)
    }

    /// - `within`: whether the bytes lie within the file of a semi-parametric model, which has none
    ///   within it in turn
    fn read(
        bytes: &[u8],
        origin: &str,
        effects: &[Arc<dyn Effect>],
        within: bool,
    ) -> Result<Self, ModelError> {
        let malformed = |message: String| ModelError::Malformed { origin: origin.into(), message };
        let archive = Archive::open(bytes).map_err(malformed)?;
        let of_head = |error: serde_json::Error| malformed(format!("its head: {error}"));
        let KindOfFile { format, version } =
            serde_json::from_str(&archive.head).map_err(of_head)?;
        let learned = format == LEARNED_FORMAT;
        if format != FORMAT && (within || !learned) {
            return Err(ModelError::Kind { origin: origin.into(), found: format });
        }
        if version > VERSION {
            return Err(ModelError::Version {
                origin: origin.into(),
                found: version,
                supported: VERSION,
            });
        }
        if learned {
            let part = |name: &str| {
                archive.bytes(name).map(|bytes| Self::read(bytes, origin, effects, true))
            };
            let mut model =
                part("physics").ok_or_else(|| malformed("`physics` is missing".into()))??;
            let identified = part("identified").transpose()?;
            let head = serde_json::from_str(&archive.head).map_err(of_head)?;
            model.residual =
                Some(Arc::new(residual(head, &model, identified, &archive).map_err(malformed)?));
            return Ok(model);
        }
        let PhysicsHead { fit, described } =
            serde_json::from_str(&archive.head).map_err(of_head)?;
        let read = |name: &str, length: usize| archive.array(name, length);
        let (robot, set, parameters, terms) = described.parts(effects, read).map_err(malformed)?;
        let noise = fit.map_or_else(Vec::new, |fit| fit.noise);
        let known = |value: &f64| value.is_finite() && *value >= 0.0;
        if !(noise.is_empty() || noise.len() == robot.dof() && noise.iter().all(known)) {
            return Err(malformed("the noise of its fit is not one number per joint".into()));
        }
        Ok(Self::new(&robot, set, parameters).with_terms(terms).with_noise(noise))
    }
}

/// The head of a semi-parametric model, but for what only those who learn it know.
#[derive(Deserialize)]
struct LearnedHead {
    joints: Vec<JointHead>,
    /// Columns of the regressor that the base parameters are; not in files of versions that did not
    /// keep it.
    #[serde(default)]
    independent: Option<Vec<usize>>,
}

#[derive(Deserialize)]
struct JointHead {
    report: Report,
    noise_variance: f64,
    covariance: Option<Covariance>,
}

#[derive(Deserialize)]
struct Report {
    calibration: f64,
}

/// What was learned, checked.
fn residual(
    head: LearnedHead,
    model: &StreamedModel,
    identified: Option<StreamedModel>,
    archive: &Archive<'_>,
) -> Result<LearnedResidual, String> {
    let n = model.dof();
    if head.joints.len() != n || identified.as_ref().is_some_and(|identified| identified.dof() != n)
    {
        return Err("what was learned is of another robot than the physics".into());
    }
    let mut joints = Vec::with_capacity(n);
    for (joint, JointHead { report: Report { calibration }, noise_variance, covariance }) in
        head.joints.into_iter().enumerate()
    {
        if !(noise_variance >= 0.0
            && noise_variance.is_finite()
            && calibration > 0.0
            && calibration.is_finite())
        {
            return Err(format!(
                "noise variance or calibration of joint {} are no numbers above zero",
                joint + 1
            ));
        }
        let process = covariance
            .map(|covariance| process(archive, joint, 3 * n + 1, covariance))
            .transpose()?;
        joints.push(LearnedJoint { process, noise_variance, calibration });
    }
    let knows_parameters = head.independent.is_some();
    let has_basis = archive.arrays.contains_key("basis_covariance");
    let basis = match head.independent.filter(|_| has_basis) {
        None => None,
        Some(independent) => Some(basis(independent, model, &joints, archive)?),
    };
    Ok(LearnedResidual { joints, identified, basis, knows_parameters })
}

fn process(
    archive: &Archive<'_>,
    joint: usize,
    inputs: usize,
    covariance: Covariance,
) -> Result<LearnedProcess, String> {
    let name = |name: &str| format!("joint_{}.{name}", joint + 1);
    let through = archive.arrays.contains_key(&name("products"));
    let of_points = name(if through { "projection" } else { "residual" });
    let points = archive.length(&of_points)?;
    if points > MOST_POINTS {
        return Err(format!("{points} points of joint {} are more than {MOST_POINTS}", joint + 1));
    }
    let array = |name: &str, length: usize| archive.array(name, length);
    let x = array(&name("x"), points * inputs)?;
    let own = array(&of_points, points)?;
    let seen = match through {
        false => Seen::AtPoints(own),
        true => Seen::Through {
            products: array(&name("products"), points * (points + 1) / 2)?,
            projection: own,
        },
    };
    let weights = name("weights");
    let weights =
        archive.arrays.contains_key(&weights).then(|| array(&weights, points)).transpose()?;
    LearnedProcess::new(covariance, x, inputs, seen, weights)
        .map_err(|error| format!("joint {}: {error}", joint + 1))
}

fn basis(
    independent: Vec<usize>,
    model: &StreamedModel,
    joints: &[LearnedJoint],
    archive: &Archive<'_>,
) -> Result<LearnedBasis, String> {
    if independent.iter().any(|column| *column >= model.parameter_set().len()) {
        return Err("its base parameters are not of its robot".into());
    }
    let of_terms: usize = model.terms().iter().map(|term| term.coefficients.len()).sum();
    let unknowns = independent.len() + of_terms;
    let covariance = archive.array("basis_covariance", unknowns * unknowns)?;
    let rows = joints.iter().enumerate().map(|(joint, learned)| {
        let name = format!("joint_{}.basis", joint + 1);
        let process = learned.process.as_ref().filter(|_| archive.arrays.contains_key(&name));
        process.map(|process| archive.array(&name, process.len() * unknowns)).transpose()
    });
    let rows: Vec<Option<Vec<f64>>> = rows.collect::<Result<_, String>>()?;
    if rows.iter().flatten().flatten().chain(&covariance).any(|value| !value.is_finite()) {
        return Err("what it says of its parameters has numbers that are not finite".into());
    }
    Ok(LearnedBasis { independent, covariance, rows })
}

/// The header of a model file, which is a file of safetensors, and what follows it.
///
/// # Errors
/// What a file is that has no such header.
#[doc(hidden)]
pub fn header_and_numbers(bytes: &[u8]) -> Result<(&[u8], &[u8]), &'static str> {
    if bytes.is_empty() {
        return Err("the file is empty");
    }
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or(NO_MODEL)?;
    if rest.first().is_some_and(|first| *first != b'{') {
        return Err(NO_MODEL);
    }
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| CUT_OFF)?;
    rest.split_at_checked(length).ok_or(CUT_OFF)
}

const NO_MODEL: &str =
    "it does not begin as the files do that `save` and `sgpr identify` write (`model.sgpr`)";
const CUT_OFF: &str = "it ends before its header does, as a file that was not copied to its end";

/// The content of a file of safetensors.
struct Archive<'a> {
    head: String,
    arrays: BTreeMap<String, ArrayOf>,
    numbers: &'a [u8],
}

#[derive(Deserialize)]
struct TensorHeader {
    #[serde(rename = "__metadata__", default)]
    metadata: BTreeMap<String, String>,
    #[serde(flatten)]
    arrays: BTreeMap<String, ArrayOf>,
}

#[derive(Deserialize)]
struct ArrayOf {
    dtype: String,
    data_offsets: [usize; 2],
}

impl<'a> Archive<'a> {
    fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let (header, numbers) = header_and_numbers(bytes)?;
        let TensorHeader { mut metadata, arrays } =
            serde_json::from_slice(header).map_err(|error| error.to_string())?;
        let head = metadata.remove("sgpr").ok_or("its head has no entry `sgpr`")?;
        Ok(Self { head, arrays, numbers })
    }

    /// An array of bytes.
    fn bytes(&self, name: &str) -> Option<&'a [u8]> {
        let ArrayOf { dtype, data_offsets: [start, end] } = self.arrays.get(name)?;
        self.numbers.get(*start..*end).filter(|_| dtype == "U8")
    }

    /// How many numbers of 64 bits an array holds.
    fn length(&self, name: &str) -> Result<usize, String> {
        let ArrayOf { data_offsets: [start, end], .. } =
            self.arrays.get(name).ok_or_else(|| format!("`{name}` is missing"))?;
        Ok(end.saturating_sub(*start) / size_of::<f64>())
    }

    fn array(&self, name: &str, length: usize) -> Result<Vec<f64>, String> {
        let ArrayOf { dtype, data_offsets: [start, end] } =
            self.arrays.get(name).ok_or_else(|| format!("`{name}` is missing"))?;
        let wrong = || format!("`{name}` should hold {length} numbers of 64 bits");
        let (chunks, rest) = self.numbers.get(*start..*end).ok_or_else(wrong)?.as_chunks::<8>();
        if dtype != "F64" || chunks.len() != length || !rest.is_empty() {
            return Err(wrong());
        }
        Ok(chunks.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }
}
