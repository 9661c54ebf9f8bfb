//! Base parameters estimated together with the processes: explicit basis functions.

use faer::Mat;

use super::super::compare::LogResidual;
use super::super::experiment::band_filter;
use super::super::identify::IdentifyError;
use super::rest::{Rest, Rows};
use super::{SemiParametricModel, TorqueModel};
use crate::dynamics::{BatchWorkspace, Samples, regressor_batch};
use crate::effects::JointState;
use crate::motion::Processing;
use crate::spatial::PARAMETERS_PER_LINK;

/// What predictions need to know of the estimate of the base parameters.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    /// Covariance of the base parameters.
    pub covariance: Mat<f64>,
    /// Rows of the base regressor, in the band of the model, at the points of each joint's process.
    pub rows: Vec<Option<Mat<f64>>>,
    /// K⁻¹ times these rows, a column per base parameter.
    weights: Vec<Vec<Vec<f64>>>,
}

impl Basis {
    pub fn new(covariance: Mat<f64>, rows: Vec<Option<Mat<f64>>>, joints: &[Rest]) -> Self {
        let weights = rows.iter().zip(joints).map(|(rows, rest)| match (rows, &rest.gp) {
            (Some(rows), Some(gp)) => {
                let solved = gp.solve(rows);
                (0..solved.ncols()).map(|k| solved.col_as_slice(k).to_vec()).collect()
            }
            _ => vec![],
        });
        Self { weights: weights.collect(), covariance, rows }
    }

    /// Adds the variance that uncertain base parameters bring to the prediction: of r = w - k(x, X) K⁻¹ W (GPML eq. 2.42).
    ///
    /// - `x`: `[samples, 3 n + 1]`, of the processes
    /// - `variance`: `[samples, n]`
    pub fn add_variance(
        &self,
        physics: &TorqueModel,
        joints: &[Rest],
        samples: Samples<'_>,
        x: &[f64],
        variance: &mut [f64],
    ) {
        let n = physics.robot().dof();
        for joint in 0..n {
            let mut r = joint_rows(physics, samples, joint);
            if let Some(gp) = &joints[joint].gp {
                let explained = gp.weigh(x, &self.weights[joint]);
                r.iter_mut().zip(explained).for_each(|(r, explained)| *r -= explained);
            }
            let unknowns = self.covariance.ncols();
            let r = faer::MatRef::from_row_major_slice(&r, r.len() / unknowns, unknowns);
            let spread = r * &self.covariance;
            for k in 0..r.nrows() {
                variance[k * n + joint] += (spread.row(k) * r.row(k).transpose()).max(0.0);
            }
        }
    }
}

/// Rows of the base regressor of a joint, `[samples, rank]`, row-major.
fn joint_rows(model: &TorqueModel, samples: Samples<'_>, joint: usize) -> Vec<f64> {
    /// Samples whose whole regressor is held at a time.
    const PIECE: usize = 256;
    let (n, set, base) = (model.robot().dof(), model.parameter_set(), model.base());
    let own = set.effect_parameters_of(joint);
    let mut rows = Vec::with_capacity(samples.count(n) * base.rank());
    let mut ws = BatchWorkspace::new(model.robot());
    let mut effects = vec![0.0; own.len()];
    let width = n * PARAMETERS_PER_LINK;
    let pieces = samples.q.chunks(PIECE * n).zip(samples.dq.chunks(PIECE * n)).zip(samples.ddq.chunks(PIECE * n));
    for ((q, dq), ddq) in pieces {
        let count = q.len() / n;
        let mut regressor = vec![0.0; count * n * width];
        regressor_batch(model.robot(), &mut ws, Samples { q, dq, ddq }, &mut regressor);
        for k in 0..count {
            let sample = k * n..(k + 1) * n;
            let state = JointState { q: &q[sample.clone()], dq: &dq[sample.clone()], ddq: &ddq[sample] };
            set.effect_row(joint, &state, &mut effects);
            let row = &regressor[(k * n + joint) * width..][..width];
            rows.extend(base.independent().iter().map(|&parameter| {
                let of_effect = || own.iter().position(|own| *own == parameter).map_or(0.0, |index| effects[index]);
                if parameter < set.inertial() { row[parameter] } else { of_effect() }
            }));
        }
    }
    rows
}

/// For each joint: rows of the base regressor, in the band of the model, at the points of its process, or at all its rows
/// if it has none.
pub(super) fn matrices(
    model: &SemiParametricModel,
    logs: &[LogResidual],
    rows: &[Rows],
    processing: &Processing,
) -> Result<Vec<Mat<f64>>, IdentifyError> {
    let unknowns = model.physics.base().rank();
    let mut matrices = Vec::new();
    for (joint, (rest, rows)) in model.joints.iter().zip(rows).enumerate() {
        let all: Vec<usize> = (0..rows.source.len()).collect();
        let points = if rest.gp.is_some() { &rest.points } else { &all };
        let mut matrix = Mat::zeros(points.len(), unknowns);
        for (index, log) in logs.iter().enumerate() {
            let mut of_log = joint_rows(&model.physics, log.motion.samples(), joint);
            if let Some(filter) = band_filter(processing, log.motion.rate_hz)? {
                filter.apply(&mut of_log, unknowns)?;
            }
            for (i, &point) in points.iter().enumerate().filter(|(_, point)| rows.source[**point].0 == index) {
                let sample = rows.source[point].1;
                (0..unknowns).for_each(|k| matrix[(i, k)] = of_log[sample * unknowns + k]);
            }
        }
        matrices.push(matrix);
    }
    Ok(matrices)
}

/// Share of a parameter's information that is added, so that directions without any stay where they are.
const RIDGE: f64 = 1e-9;

/// Solution and covariance of normal equations.
pub(super) fn solve(information: &Mat<f64>, projection: &Mat<f64>) -> (Vec<f64>, Mat<f64>) {
    let unknowns = information.ncols();
    let scale: Vec<f64> = (0..unknowns)
        .map(|k| information[(k, k)].sqrt())
        .map(|norm| if norm > 0.0 { 1.0 / norm } else { 1.0 })
        .collect();
    let scaled = Mat::from_fn(unknowns, unknowns, |i, j| {
        information[(i, j)] * scale[i] * scale[j] + if i == j { RIDGE } else { 0.0 }
    });
    let eigen = scaled.self_adjoint_eigen(faer::Side::Lower).expect("finite numbers");
    // Rounding can leave a direction without information slightly negative.
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let inverse = Mat::from_fn(unknowns, unknowns, |i, j| {
        (0..unknowns).map(|k| vectors[(i, k)] * vectors[(j, k)] / values[k].max(RIDGE)).sum::<f64>()
    });
    let covariance = Mat::from_fn(unknowns, unknowns, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let solution = &covariance * projection;
    (solution.col_as_slice(0).to_vec(), covariance)
}
