//! Parameters that enter the torque linearly, estimated together with the processes: explicit basis
//! functions. They are the base parameters, then the coefficients of the effects that the physics
//! has at single joints.

use faer::Mat;
use sgpr_predict::internal::base_value;

use super::super::IdentifyError;
use super::super::compare::LogResidual;
use super::super::{Rigid, Trajectory};
use super::TorqueModel;
use super::joint_process::JointProcess;
use super::process::{Process, ProcessTerms};
use super::rows::ResidualRows;
use crate::dynamics::{BatchWorkspace, Samples, regressor_batch};
use crate::effects::{JointState, Reach};
use crate::gp::{GpPredictor, Precision};
use crate::motion::Processing;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// What predictions need to know of the estimate of the linear parameters.
#[derive(Clone, Debug)]
pub(super) struct ParameterBasis {
    /// Covariance of the parameters.
    pub covariance: Mat<f64>,
    /// Rows of their regressor, in the band of the model, at the points of each joint's process;
    /// projected on them if they are inducing points.
    pub rows: Vec<Option<Mat<f64>>>,
    /// K⁻¹ times these rows, a column per parameter.
    weights: Vec<Vec<Vec<f64>>>,
}

impl ParameterBasis {
    pub fn new(covariance: Mat<f64>, rows: Vec<Option<Mat<f64>>>, joints: &[JointProcess]) -> Self {
        let weights = rows.iter().zip(joints).map(|(rows, residual)| match (rows, &residual.gp) {
            (Some(rows), Some(gp)) => {
                let solved = gp.solve(rows);
                (0..solved.ncols()).map(|k| solved.col_as_slice(k).to_vec()).collect()
            }
            _ => vec![],
        });
        Self { weights: weights.collect(), covariance, rows }
    }

    /// Of parameters that were identified before the processes learned what they leave over; none
    /// if they have no covariance. What logs did not determine at all, and constants, are left out.
    pub fn of_physics(physics: &TorqueModel) -> Option<Self> {
        let fit = physics.fit.as_ref()?;
        let unknowns = unknowns(physics);
        if unknowns == 0 {
            return None;
        }
        let with_terms = &fit.covariance_with_terms;
        let (given, width) = match with_terms.is_empty() {
            true => (&fit.covariance, physics.base().rank()),
            false => (with_terms, with_terms.len().isqrt()),
        };
        let covariance = Mat::from_fn(unknowns, unknowns, |i, j| match i < width && j < width {
            true => Some(given[i * width + j]).filter(|value| value.is_finite()).unwrap_or(0.0),
            false => 0.0,
        });
        let n = physics.robot().dof();
        Some(Self { covariance, rows: vec![None; n], weights: vec![vec![]; n] })
    }

    /// `[unknowns, unknowns]`, row-major.
    pub fn covariance_by_rows(&self) -> Vec<f64> {
        let unknowns = self.covariance.ncols();
        (0..unknowns * unknowns).map(|k| self.covariance[(k / unknowns, k % unknowns)]).collect()
    }

    /// k(x, X) K⁻¹ W of each joint whose process was estimated together with the parameters, one
    /// sample after the other.
    pub fn explained(&self, joints: &[JointProcess]) -> Vec<Option<GpPredictor>> {
        let explained = joints.iter().zip(self.weights.iter().zip(&self.rows)).map(
            |(residual, (weights, rows))| {
                let gp = residual.gp.as_ref().filter(|_| rows.is_some() && !weights.is_empty())?;
                let signal = &gp.covariance().signal;
                Some(GpPredictor::weighing(signal, gp.x(), gp.inputs(), weights, Precision::Double))
            },
        );
        explained.collect()
    }

    /// Adds the variance that uncertain parameters bring to the prediction: of r = w - k(x, X) K⁻¹
    /// W (GPML eq. 2.42). Beside a process that has learned what these parameters leave over it is
    /// that of w, as far as the process does not know.
    ///
    /// - `x`: `[samples, 3 n + 1]`, of the processes
    /// - `novelty`: `[samples, n]`, what the processes do not know, as a share of what they knew
    ///   before the logs
    /// - `variance`: `[samples, n]`
    pub fn add_variance(
        &self,
        physics: &TorqueModel,
        joints: &[JointProcess],
        trajectory: &Trajectory<'_>,
        x: &[f64],
        novelty: &[f64],
        variance: &mut [f64],
    ) {
        let n = physics.robot().dof();
        let unknowns = self.covariance.ncols();
        if unknowns == 0 {
            return;
        }
        for joint in 0..n {
            let mut r = joint_rows(physics, trajectory, joint);
            let together = self.rows[joint].is_some();
            if let Some(gp) = joints[joint].gp.as_ref().filter(|_| together) {
                let explained = gp.weigh(x, &self.weights[joint]);
                r.iter_mut().zip(explained).for_each(|(r, explained)| *r -= explained);
            }
            let r = faer::MatRef::from_row_major_slice(&r, r.len() / unknowns, unknowns);
            let spread = r * &self.covariance;
            let share = |k: usize| {
                if together || joints[joint].gp.is_none() { 1.0 } else { novelty[k * n + joint] }
            };
            for k in 0..r.nrows() {
                variance[k * n + joint] +=
                    share(k) * (spread.row(k) * r.row(k).transpose()).max(0.0);
            }
        }
    }
}

/// Number of parameters that enter the torque linearly.
pub(super) fn unknowns(model: &TorqueModel) -> usize {
    model.base().rank() + model.terms().iter().map(|term| term.coefficients.len()).sum::<usize>()
}

/// Derivatives of the torque of a joint by the linear parameters, `[samples, unknowns]`, row-major.
fn joint_rows(model: &TorqueModel, trajectory: &Trajectory<'_>, joint: usize) -> Vec<f64> {
    let (rank, width) = (model.base().rank(), unknowns(model));
    let samples = trajectory.samples;
    if model.terms().is_empty() {
        return base_rows(model, model.robot(), samples, samples, joint, width);
    }
    let rigid = model.rigid(trajectory);
    let links = rigid.motion.as_ref();
    let links =
        links.map_or(samples, |motion| Samples { q: &motion.q, dq: &motion.dq, ddq: &motion.ddq });
    let mut rows = base_rows(model, &rigid.robot, links, samples, joint, width);
    add_term_columns(model, trajectory, &rigid, joint, &mut rows, (rank, width));
    for term in model.terms().iter().filter(|term| term.is_transform()) {
        term.effect.transmit(
            term.site,
            &term.constants,
            joint,
            trajectory.rate_hz,
            &mut rows,
            width,
        );
    }
    let limits = model
        .terms()
        .iter()
        .filter_map(|term| term.effect.limit(term.site, &term.constants, joint));
    let limit = limits.fold(f64::INFINITY, f64::min);
    if limit.is_finite() {
        // At the limit of the drive no parameter changes the torque.
        let tau = model.predict_trajectory(trajectory);
        let own = tau.iter().skip(joint).step_by(model.robot().dof());
        rows.chunks_exact_mut(width)
            .zip(own)
            .filter(|(_, tau)| tau.abs() >= limit)
            .for_each(|(row, _)| row.fill(0.0));
    }
    rows
}

/// Rows of the base regressor of a joint, `width` apart: the rigid body along the motion of the
/// links, the effects along the measured one.
fn base_rows(
    model: &TorqueModel,
    robot: &Robot,
    links: Samples<'_>,
    measured: Samples<'_>,
    joint: usize,
    width: usize,
) -> Vec<f64> {
    /// Samples whose whole regressor is held at a time.
    const PIECE: usize = 256;
    let (n, set, base) = (robot.dof(), model.parameter_set(), model.base());
    let own = set.effect_parameters_of(joint);
    let mut rows = vec![0.0; links.count(n) * width];
    let mut ws = BatchWorkspace::new(robot);
    let mut effects = vec![0.0; own.len()];
    let wide = n * PARAMETERS_PER_LINK;
    let mut regressor = vec![0.0; PIECE * n * wide];
    for (piece, rows) in rows.chunks_mut((PIECE * width).max(1)).enumerate() {
        let (first, count) = (piece * PIECE, rows.len() / width);
        let at = first * n..(first + count) * n;
        let samples =
            Samples { q: &links.q[at.clone()], dq: &links.dq[at.clone()], ddq: &links.ddq[at] };
        regressor_batch(robot, &mut ws, samples, &mut regressor[..count * n * wide]);
        for (k, row) in rows.chunks_exact_mut(width).enumerate() {
            let at = (first + k) * n..(first + k + 1) * n;
            let state = JointState {
                q: &measured.q[at.clone()],
                dq: &measured.dq[at.clone()],
                ddq: &measured.ddq[at],
            };
            set.effect_row(joint, &state, &mut effects);
            let of_links = &regressor[(k * n + joint) * wide..][..wide];
            for (value, &parameter) in row.iter_mut().zip(base.independent()) {
                *value = base_value(set, &own, of_links, &effects, parameter);
            }
        }
    }
    rows
}

/// Writes the columns of the terms that reach a joint into its rows, from column `first` on.
fn add_term_columns(
    model: &TorqueModel,
    trajectory: &Trajectory<'_>,
    rigid: &Rigid,
    joint: usize,
    rows: &mut [f64],
    (first, width): (usize, usize),
) {
    let n = model.robot().dof();
    let context = model.context(trajectory, rigid);
    let mut at = first;
    for term in model.terms() {
        let (start, step) = match term.effect.reach() {
            Reach::All => (joint, n),
            Reach::Own => (0, 1),
        };
        let reached = term.effect.reach() == Reach::All || term.site.joint() == Some(joint);
        if reached && !term.coefficients.is_empty() {
            for (offset, column) in term.columns(&context).iter().enumerate() {
                let values = column.iter().skip(start).step_by(step);
                rows.chunks_exact_mut(width)
                    .zip(values)
                    .for_each(|(row, value)| row[at + offset] = *value);
            }
        }
        at += term.coefficients.len();
    }
}

/// For each joint: the linear terms as its process sees them, or at all rows if it has none.
pub(super) fn terms(joints: &[JointProcess], rows: &[ResidualRows]) -> Vec<ProcessTerms> {
    let of_joint = |(residual, rows): (&JointProcess, &ResidualRows)| {
        let all = rows.terms.as_ref().expect("with the mean `joint`");
        match &residual.gp {
            Some(Process::Exact(_)) => ProcessTerms::at_rows(all, &residual.points),
            Some(Process::Sparse(_)) => residual.evidence.terms(&residual.evidence.without(None)),
            None => ProcessTerms { matrix: all.clone(), of_rows: None },
        }
    };
    joints.iter().zip(rows).map(of_joint).collect()
}

/// Rows of the regressor of a joint, in the band of the model.
pub(super) fn matrix(
    model: &TorqueModel,
    logs: &[LogResidual],
    joint: usize,
    rows: &ResidualRows,
    processing: &Processing,
) -> Result<Mat<f64>, IdentifyError> {
    let unknowns = unknowns(model);
    let mut matrix = Mat::zeros(rows.source.len(), unknowns);
    for (index, log) in logs.iter().enumerate() {
        let time = model.time_of(&log.motion);
        let mut of_log = joint_rows(model, &Trajectory::of(&log.motion, &time), joint);
        if let Some(filter) = processing.band_filter(log.motion.rate_hz)? {
            filter.apply(&mut of_log, unknowns)?;
        }
        for (i, (_, sample)) in
            rows.source.iter().enumerate().filter(|(_, (source, _))| *source == index)
        {
            (0..unknowns).for_each(|k| matrix[(i, k)] = of_log[sample * unknowns + k]);
        }
    }
    Ok(matrix)
}

/// Share of a parameter's information that is added, so that directions without any stay where they
/// are.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Site, by_name};
    use crate::model::Term;
    use crate::robot::two_link;

    /// A two-link arm with friction, and effects of every kind at single sites.
    fn model(names: &[(&str, Site, &[f64], &[f64])]) -> TorqueModel {
        let robot = two_link();
        let mut parameters = robot.standard_parameters();
        parameters.extend([0.8, 1.0, 0.5, 0.6]);
        let model = TorqueModel::with_parameters(
            &robot,
            &["viscous_friction", "coulomb_friction"],
            parameters,
        );
        let term = |(name, site, constants, coefficients): &(&str, Site, &[f64], &[f64])| {
            let mut term =
                Term::new(by_name(name).expect("of the library"), *site, constants.to_vec());
            term.coefficients = coefficients.to_vec();
            term
        };
        model.expect("of the library").with_terms(names.iter().map(term).collect(), Some(0))
    }

    #[test]
    fn rows_are_the_derivatives_of_the_torque_by_the_linear_parameters() {
        let count = 400;
        let wave = |scale: f64, phase: f64| -> Vec<f64> {
            (0..2 * count)
                .map(|k| scale * (0.05 * f64::from(k / 2) + phase + f64::from(k % 2)).sin())
                .collect()
        };
        let (q, dq, ddq) = (wave(0.8, 0.0), wave(1.7, 1.6), wave(3.0, 3.1));
        let time: Vec<f64> = (0..count).map(|k| 0.01 * f64::from(k)).collect();
        let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
        let trajectory = Trajectory { samples, rate_hz: 100.0, time: &time, channels: &[] };
        let model = model(&[
            ("stribeck_friction", Site::Joint(1), &[0.2], &[0.7]),
            ("encoder_offset", Site::Joint(1), &[0.05], &[]),
            ("torque_delay", Site::Arm, &[0.013], &[]),
            ("torque_saturation", Site::Joint(0), &[10.0], &[]),
        ]);
        let predict = |values: &[f64], coefficient: f64| {
            let mut changed = model.clone();
            changed.set_parameters(model.base().expand(values, model.parameters()));
            changed.terms[0].coefficients[0] = coefficient;
            changed.predict_trajectory(&trajectory)
        };
        let values = model.base().combine(model.parameters());
        let rank = values.len();
        let before = predict(&values, 0.7);
        assert!(before.iter().step_by(2).any(|tau| tau.abs() == 10.0), "the drive saturates");
        for joint in 0..2 {
            let rows = joint_rows(&model, &trajectory, joint);
            assert_eq!(rows.len(), count as usize * unknowns(&model));
            let mut largest: f64 = 0.0;
            for k in 0..=rank {
                // The torque is linear but for the limit, which so small a step crosses nowhere.
                let step = 1e-5;
                let mut values = values.clone();
                values
                    .iter_mut()
                    .enumerate()
                    .filter(|(i, _)| *i == k)
                    .for_each(|(_, value)| *value += step);
                let after = predict(&values, if k == rank { 0.7 + step } else { 0.7 });
                for sample in 0..count as usize {
                    let quotient = (after[2 * sample + joint] - before[2 * sample + joint]) / step;
                    let row = rows[sample * (rank + 1) + k];
                    largest = largest.max(row.abs());
                    assert!(
                        (row - quotient).abs() < 1e-6 * (1.0 + row.abs()),
                        "{k} {sample}: {row} {quotient}"
                    );
                }
            }
            assert!(largest > 1.0);
        }
    }
}
