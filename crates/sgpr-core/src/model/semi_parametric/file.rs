//! One file per model, in the format of the torque model: a head in JSON, the physics as a file
//! within the file, points and residuals, or inducing points and what all rows say at them, as
//! little-endian `f64`. The processes are conditioned again when the file is read; for
//! `sgpr-predict`, which conditions them for a variance only, it has the weights of their means,
//! too.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use faer::Mat;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::super::file::{HEAD, ModelFileError, array, open, read_limited, write};
use super::all_rows::EvidenceParts;
use super::basis::{self, ParameterBasis};
use super::fit::MOST_POINTS;
use super::joint_process::{JointProcess, JointReport};
use super::process::{Process, Sparse};
use super::{Mean, SemiParametricModel, TorqueModel};
use crate::effects::{self, Effect};
use crate::gp::{Compute, Covariance, Data, GaussianProcess};

/// The format that the head names.
pub(in super::super) const FORMAT: &str = "sgpr semi-parametric model";
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Head {
    format: String,
    version: u32,
    mean: Mean,
    /// The search was stopped.
    stopped: bool,
    joints: Vec<Joint>,
    /// Columns of the regressor that the base parameters are: for those who predict and do not
    /// analyse the robot.
    #[serde(default)]
    independent: Vec<usize>,
}

#[derive(Serialize, Deserialize)]
struct Joint {
    report: JointReport,
    noise_variance: f64,
    covariance: Option<Covariance>,
}

impl SemiParametricModel {
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

    /// As [`SemiParametricModel::load`], with effects of the caller's own in the physics.
    ///
    /// # Errors
    /// As [`SemiParametricModel::load`].
    pub fn load_with(
        path: impl AsRef<Path>,
        effects: &[Arc<dyn Effect>],
    ) -> Result<Self, ModelFileError> {
        let path = path.as_ref();
        Self::from_bytes_with(&read_limited(path)?, &path.display().to_string(), effects)
    }

    /// The file's content.
    pub fn to_bytes(&self) -> Vec<u8> {
        let joint = |residual: &JointProcess| Joint {
            report: residual.report.clone(),
            noise_variance: residual.noise_variance,
            covariance: residual.gp.as_ref().map(|gp| gp.covariance().clone()),
        };
        let head = Head {
            format: FORMAT.into(),
            version: VERSION,
            mean: self.mean,
            stopped: self.stopped,
            joints: self.joints.iter().map(joint).collect(),
            independent: self.physics.base().independent().to_vec(),
        };
        let encode = |values: &mut dyn Iterator<Item = f64>| {
            values.flat_map(f64::to_le_bytes).collect::<Vec<u8>>()
        };
        let mut arrays = Vec::new();
        for (joint, residual) in self.joints.iter().enumerate() {
            let Some(gp) = &residual.gp else { continue };
            let mut push =
                |name: &str, shape: Vec<usize>, values: &mut dyn Iterator<Item = f64>| {
                    arrays.push((format!("joint_{}.{name}", joint + 1), shape, encode(values)));
                };
            let m = gp.len();
            push("x", vec![m, gp.inputs()], &mut gp.x().iter().copied());
            push("weights", vec![m], &mut gp.weighted_kernel().weights.iter().copied());
            match gp {
                Process::Exact(gp) => push("residual", vec![m], &mut gp.data().y().iter().copied()),
                Process::Sparse(Sparse { products, projection, .. }) => {
                    push("projection", vec![m], &mut projection.col_as_slice(0).iter().copied());
                    let lower = products
                        .col_iter()
                        .enumerate()
                        .flat_map(|(j, column)| (j..m).map(move |i| column[i]));
                    push("products", vec![m * (m + 1) / 2], &mut { lower });
                }
            }
        }
        if let Some(basis) = &self.basis {
            let matrices = basis
                .rows
                .iter()
                .enumerate()
                .filter_map(|(joint, rows)| Some((joint, rows.as_ref()?)));
            let named = matrices.map(|(joint, rows)| (format!("joint_{}.basis", joint + 1), rows));
            for (name, matrix) in named.chain([("basis_covariance".into(), &basis.covariance)]) {
                let (height, width) = (matrix.nrows(), matrix.ncols());
                let mut values = (0..height * width).map(|k| matrix[(k / width, k % width)]);
                arrays.push((name, vec![height, width], encode(&mut values)));
            }
        }
        let physics = self.physics.to_bytes();
        let identified = self.identified.as_ref().map(TorqueModel::to_bytes);
        let numbers = arrays.iter().map(|(name, shape, bytes)| {
            (
                name.as_str(),
                TensorView::new(Dtype::F64, shape.clone(), bytes).expect("eight bytes per number"),
            )
        });
        let model = |bytes| {
            TensorView::new(Dtype::U8, vec![<[u8]>::len(bytes)], bytes).expect("one byte per byte")
        };
        let identified = identified.as_ref().map(|bytes| ("identified", model(bytes)));
        let views = numbers.chain([("physics", model(&physics))]).chain(identified);
        let head = serde_json::to_string(&head).expect("plain data");
        safetensors::serialize(views, Some(HashMap::from([(HEAD.into(), head)])))
            .expect("valid tensors")
    }

    /// A model from a file's content; `origin` names it in messages.
    ///
    /// # Errors
    /// As [`SemiParametricModel::load`].
    pub fn from_bytes(bytes: &[u8], origin: &str) -> Result<Self, ModelFileError> {
        Self::from_bytes_with(bytes, origin, &effects::registry())
    }

    /// As [`SemiParametricModel::from_bytes`], with effects of the caller's own in the physics.
    ///
    /// # Errors
    /// As [`SemiParametricModel::load`].
    pub fn from_bytes_with(
        bytes: &[u8],
        origin: &str,
        effects: &[Arc<dyn Effect>],
    ) -> Result<Self, ModelFileError> {
        let malformed =
            |message: String| ModelFileError::Malformed { path: origin.into(), message };
        let (head, tensors) = open(bytes, origin, FORMAT, VERSION)?;
        let head: Head =
            serde_json::from_str(&head).map_err(|error| malformed(format!("its head: {error}")))?;
        let physics =
            tensors.tensor("physics").map_err(|_| malformed("`physics` is missing".into()))?;
        let physics = TorqueModel::from_bytes_with(physics.data(), origin, effects)?;
        let identified = match tensors.tensor("identified") {
            Ok(bytes) => Some(TorqueModel::from_bytes_with(bytes.data(), origin, effects)?),
            Err(_) => None,
        };
        let (needed, limit) = (memory_for(&tensors, head.joints.len()), crate::memory::usable());
        if needed > limit {
            let (needed_gb, limit_gb) = (needed as f64 / 1e9, limit as f64 / 1e9);
            return Err(ModelFileError::Memory { path: origin.into(), needed_gb, limit_gb });
        }
        Self::from_head(head, physics, identified, &tensors).map_err(malformed)
    }

    fn from_head(
        head: Head,
        physics: TorqueModel,
        identified: Option<TorqueModel>,
        tensors: &SafeTensors<'_>,
    ) -> Result<Self, String> {
        let (n, unknowns) = (physics.robot().dof(), basis::unknowns(&physics));
        if identified.as_ref().is_some_and(|identified| identified.robot().dof() != n) {
            return Err("`identified` is of another robot".into());
        }
        if head.joints.len() != n {
            return Err(format!("{} joints where the robot has {n}", head.joints.len()));
        }
        if physics.processing().is_none() {
            return Err("its physics does not say how logs are processed".into());
        }
        let compute = Compute::default();
        let mut joints = Vec::with_capacity(n);
        for (joint, Joint { report, noise_variance, covariance }) in
            head.joints.into_iter().enumerate()
        {
            if !(noise_variance >= 0.0 && noise_variance.is_finite()) {
                return Err(format!(
                    "the noise variance of joint {} is {noise_variance}",
                    joint + 1
                ));
            }
            for value in [report.calibration, report.calibration_95] {
                if !(value > 0.0 && value.is_finite()) {
                    return Err(format!("a calibration of joint {} is {value}", joint + 1));
                }
            }
            let gp = match covariance {
                None => None,
                Some(covariance) => Some(process(tensors, joint, 3 * n + 1, covariance, &compute)?),
            };
            joints.push(JointProcess {
                gp,
                noise_variance,
                report,
                points: vec![],
                evidence: EvidenceParts::default(),
            });
        }
        let mut model = Self {
            physics,
            mean: head.mean,
            joints,
            basis: None,
            identified,
            report: None,
            stopped: head.stopped,
        };
        if head.mean == Mean::Physics {
            model.basis = ParameterBasis::of_physics(&model.physics);
        }
        if head.mean == Mean::Joint {
            let covariance = matrix(tensors, "basis_covariance", unknowns, unknowns)?;
            let rows = model.joints.iter().enumerate().map(|(joint, residual)| {
                let gp = residual.gp.as_ref();
                gp.map(|gp| {
                    matrix(tensors, &format!("joint_{}.basis", joint + 1), gp.len(), unknowns)
                })
                .transpose()
            });
            let rows = rows.collect::<Result<Vec<_>, String>>()?;
            model.basis = Some(ParameterBasis::new(covariance, rows, &model.joints));
        }
        Ok(model)
    }
}

/// Bytes that the processes of a file take once they are conditioned: a square matrix of the points
/// of an exact one, and six for one that sees all rows through them.
fn memory_for(tensors: &SafeTensors<'_>, joints: usize) -> u64 {
    let points = |joint: usize, name: &str| {
        let view = tensors.tensor(&format!("joint_{}.{name}", joint + 1)).ok()?;
        Some((view.data().len() / size_of::<f64>()) as u64)
    };
    let bytes =
        |points: u64, matrices: u64| points.saturating_mul(points).saturating_mul(8 * matrices);
    let of_joint = |joint: usize| {
        let sparse = points(joint, "projection").map(|points| bytes(points, 6));
        sparse
            .or_else(|| points(joint, "residual").map(|points| bytes(points, 1)))
            .unwrap_or_default()
    };
    (0..joints).map(of_joint).fold(0, u64::saturating_add)
}

/// The process of a joint.
fn process(
    tensors: &SafeTensors<'_>,
    joint: usize,
    width: usize,
    covariance: Covariance,
    compute: &Compute,
) -> Result<Process, String> {
    let of_joint = |name: &str| format!("joint_{}.{name}", joint + 1);
    let sparse = tensors.tensor(&of_joint("products")).is_ok();
    let name = of_joint(if sparse { "projection" } else { "residual" });
    let points = tensors.tensor(&name).map_err(|_| format!("`{name}` is missing"))?.data().len()
        / size_of::<f64>();
    if points > MOST_POINTS {
        return Err(format!("{points} points of joint {} are more than {MOST_POINTS}", joint + 1));
    }
    let x = array(tensors, &of_joint("x"), points * width)?;
    if !sparse {
        let data = Data::new(x, width, array(tensors, &name, points)?, 1)
            .map_err(|error| error.to_string())?;
        return GaussianProcess::fit(data, covariance, compute)
            .map(Process::Exact)
            .map_err(|error| error.to_string());
    }
    let projection = matrix(tensors, &name, points, 1)?;
    let lower = matrix(tensors, &of_joint("products"), points * (points + 1) / 2, 1)?;
    let column = |j: usize| j * points - j * (j + 1) / 2;
    let products = Mat::from_fn(points, points, |i, j| lower[(column(i.min(j)) + i.max(j), 0)]);
    Sparse::new(covariance, x, width, products, projection)
        .map(Process::Sparse)
        .map_err(|error| error.to_string())
}

fn matrix(
    tensors: &SafeTensors<'_>,
    name: &str,
    height: usize,
    width: usize,
) -> Result<Mat<f64>, String> {
    let values = array(tensors, name, height * width)?;
    if values.iter().any(|value| !value.is_finite()) {
        return Err(format!("`{name}` has numbers that are not finite"));
    }
    Ok(Mat::from_fn(height, width, |i, j| values[i * width + j]))
}
