//! What the processes of a learned model add to its physics, and how sure the sum is.

use alloc::string::String;
use alloc::vec::Vec;

use super::{Plain, StreamError};
use crate::dynamics::{Workspace, regressor};
use crate::effects::JointState;
use crate::gp::{GpPredictor, LearnedProcess, Precision, SharedPredictor, WeightedKernel};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::model::{LearnedResidual, ParameterSet, StreamedModel};
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// The physics at a sample, as far as its spread goes.
pub(super) struct PhysicsAtSample<'a> {
    /// As transforms make it.
    pub robot: &'a Robot,
    /// Motion of its links, and of its joints: q, dq, ddq.
    pub links: &'a [Vec<f64>; 3],
    pub motion: &'a [Vec<f64>; 3],
    /// Sets the derivatives of a joint's torque by the coefficients of all terms of the model, as
    /// the drive makes it; zero for terms that are not held.
    pub term_columns: &'a dyn Fn(usize, &mut [f64]),
    /// What the log shows of a small torque more at a joint, delays and lags aside.
    pub gain: &'a dyn Fn(usize) -> f64,
}

/// How the processes of a learned model are asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ResidualOptions {
    /// Arithmetic.
    pub precision: Precision,
    /// Whether [`torque_and_deviation`](super::Predictor::torque_and_deviation) is called: needs a
    /// square of the points in memory, and as much time.
    pub deviation: bool,
}

impl ResidualOptions {
    setters! {
        with_precision(precision: Precision),
        with_deviation(deviation: bool),
    }
}

/// The processes of the joints.
#[derive(Debug)]
pub struct ResidualPredictor {
    joints: Vec<ResidualJoint>,
    /// Joints of the same points, and their means.
    together: Vec<(Vec<usize>, SharedPredictor)>,
    parameters: Option<BasisPredictor>,
    /// q, dq, ddq, and a time that nothing looks at.
    x: Vec<f64>,
    deviation: Vec<f64>,
    novelty: Vec<f64>,
    of_parameters: Vec<f64>,
    with_deviation: bool,
}

/// The process of one joint.
#[derive(Debug)]
pub struct ResidualJoint {
    /// None without a process, or if it is only asked together with others.
    pub process: Option<GpPredictor>,
    /// It has a process.
    pub learned: bool,
    /// Variance of the measurement about the signal, N²·m² (N²).
    pub noise_variance: f64,
    /// Variance of its process before the logs.
    pub prior: f64,
    /// What standard deviations of process and noise are multiplied by.
    pub calibration: f64,
}

/// What predictions need to know of the estimate of the linear parameters.
#[derive(Debug)]
pub struct BasisParts {
    /// Columns of the regressor that the parameters are.
    pub independent: Vec<usize>,
    /// Their covariance, with that of the coefficients of terms, `[unknowns, unknowns]`, row-major.
    pub covariance: Vec<f64>,
    /// k(x, X) K⁻¹ W of each joint whose process was estimated together with the parameters.
    pub explained: Vec<Option<GpPredictor>>,
}

impl ResidualPredictor {
    /// The only place that allocates.
    ///
    /// - `joints`: one per joint
    /// - `together`: groups of joints, and their means
    /// - `basis`: with a standard deviation, unless nobody knows how sure the parameters are
    pub fn new(
        model: &StreamedModel,
        joints: Vec<ResidualJoint>,
        together: Vec<(Vec<usize>, SharedPredictor)>,
        basis: Option<BasisParts>,
        with_deviation: bool,
    ) -> Self {
        let n = joints.len();
        Self {
            parameters: basis.map(|basis| BasisPredictor::new(model, basis)),
            joints,
            together,
            x: vec![0.0; 3 * n + 1],
            deviation: vec![0.0; n],
            novelty: vec![0.0; n],
            of_parameters: vec![0.0; n],
            with_deviation,
        }
    }

    /// Of a model file.
    pub(super) fn of_file(
        model: &StreamedModel,
        residual: &LearnedResidual,
        options: &ResidualOptions,
    ) -> Result<Self, StreamError> {
        let ResidualOptions { precision, deviation } = *options;
        let processes: Vec<Option<&LearnedProcess>> =
            residual.joints.iter().map(|joint| joint.process.as_ref()).collect();
        let sums: Vec<Option<WeightedKernel<'_>>> =
            processes.iter().map(|process| process.map(LearnedProcess::weighted_kernel)).collect();
        let together = together(&sums, precision);
        let refused = |joint: usize, reason: String| StreamError::Process {
            joint: model.joint_name(joint),
            reason,
        };
        if deviation {
            residual.check_deviation().map_err(|(joint, reason)| refused(joint, reason))?;
        }
        let mut joints = Vec::with_capacity(processes.len());
        let mut explained = Vec::with_capacity(processes.len());
        for (index, (process, joint)) in processes.iter().zip(&residual.joints).enumerate() {
            let alone = !together.iter().any(|(members, _)| members.contains(&index));
            let (mut predictor, mut of_basis) = (None, None);
            if let (Some(process), true) = (process, deviation) {
                let rows = residual.basis.as_ref().and_then(|basis| basis.rows[index].as_deref());
                let both = process
                    .mean_and_variance(precision, rows)
                    .map_err(|reason| refused(index, reason))?;
                (predictor, of_basis) = (Some(both.0), both.1);
            } else if let (Some(process), true) = (process, alone) {
                predictor = Some(process.mean(precision));
            }
            joints.push(ResidualJoint {
                process: predictor,
                learned: process.is_some(),
                noise_variance: joint.noise_variance,
                prior: process.map_or(1.0, LearnedProcess::prior_variance),
                calibration: joint.calibration,
            });
            explained.push(of_basis);
        }
        let basis = residual.basis.as_ref().filter(|_| deviation).map(|basis| BasisParts {
            independent: basis.independent.clone(),
            covariance: basis.covariance.clone(),
            explained,
        });
        Ok(Self::new(model, joints, together, basis, deviation))
    }

    pub(super) fn with_deviation(&self) -> bool {
        self.with_deviation
    }

    pub(super) fn deviation(&self) -> &[f64] {
        &self.deviation
    }

    pub(super) fn novelty(&self) -> &[f64] {
        &self.novelty
    }

    /// `own`, the torque of another model, at the joints without a process.
    pub(super) fn replace<F: Plain>(&self, tau: &mut [F], own: &[F]) {
        let without = self.joints.iter().zip(tau).zip(own).filter(|((joint, _), _)| !joint.learned);
        without.for_each(|((_, tau), own)| *tau = *own);
    }

    pub(super) fn set_motion<F: Plain>(&mut self, motion: [&[F]; 3]) {
        let n = self.deviation.len();
        for (part, x) in motion.into_iter().zip(self.x.chunks_exact_mut(n)) {
            x.iter_mut().zip(part).for_each(|(x, value)| *x = (*value).into());
        }
    }

    /// Adds the means.
    pub(super) fn add_means<F: Plain>(&mut self, tau: &mut [F]) {
        let add = |tau: &mut F, mean: f64| *tau = F::of(tau.number() + mean);
        for (index, joint) in self.joints.iter_mut().enumerate() {
            let together = self.together.iter().any(|(members, _)| members.contains(&index));
            if let (Some(process), false) = (&mut joint.process, together) {
                add(&mut tau[index], process.mean(&self.x)[0]);
            }
        }
        for (members, predictor) in &mut self.together {
            for (joint, mean) in members.iter().zip(predictor.means(&self.x)) {
                add(&mut tau[*joint], *mean);
            }
        }
    }

    /// Adds the means, and computes how sure the torque is.
    ///
    /// - `physics`: at this sample
    pub(super) fn add_means_and_spread(&mut self, physics: &PhysicsAtSample<'_>, tau: &mut [f64]) {
        for (joint, own) in self.joints.iter_mut().enumerate() {
            self.deviation[joint] = own.noise_variance;
            self.novelty[joint] = 0.0;
            if let Some(process) = &mut own.process {
                let (mean, unexplained) = process.mean_and_variance(&self.x);
                tau[joint] += mean[0];
                self.deviation[joint] += unexplained;
                self.novelty[joint] = unexplained / own.prior;
            }
        }
        self.of_parameters.fill(0.0);
        if let Some(parameters) = &mut self.parameters {
            let share =
                |joint: usize| if self.joints[joint].learned { self.novelty[joint] } else { 1.0 };
            parameters.add_variance(physics, &self.x, &share, &mut self.of_parameters);
        }
        for ((own, deviation), of_parameters) in
            self.joints.iter().zip(&mut self.deviation).zip(&self.of_parameters)
        {
            *deviation = (own.calibration * own.calibration * *deviation + of_parameters).sqrt();
        }
    }
}

/// Groups of two or more joints whose processes have the same points and can be asked together.
pub fn together(
    sums: &[Option<WeightedKernel<'_>>],
    precision: Precision,
) -> Vec<(Vec<usize>, SharedPredictor)> {
    let mut groups: Vec<(Vec<usize>, Vec<WeightedKernel<'_>>)> = vec![];
    for (index, sum) in sums.iter().enumerate().filter_map(|(index, sum)| Some((index, (*sum)?))) {
        match groups.iter_mut().find(|(_, group)| group[0].x == sum.x) {
            Some((members, group)) => {
                members.push(index);
                group.push(sum);
            }
            None => groups.push((vec![index], vec![sum])),
        }
    }
    let several = groups.into_iter().filter(|(members, _)| members.len() > 1);
    several
        .filter_map(|(members, group)| Some((members, SharedPredictor::new(&group, precision)?)))
        .collect()
}

/// The variance that uncertain parameters bring to the torque, one sample after the other: of r =
/// w - k(x, X) K⁻¹ W (GPML eq. 2.42). Beside a process that has learned what these parameters leave
/// over it is that of w, as far as the process does not know. Allocates nothing. What lies between
/// torque and log counts by its gain: a delay or a lag does not change how surely a torque is
/// known.
#[derive(Debug)]
struct BasisPredictor {
    set: ParameterSet,
    basis: BasisParts,
    ws: Workspace,
    /// Derivatives by the parameters, and by those of the effects of a joint.
    row: Vec<f64>,
    effects: Vec<f64>,
    /// Effect parameters of each joint.
    own: Vec<Vec<usize>>,
}

impl BasisPredictor {
    fn new(model: &StreamedModel, basis: BasisParts) -> Self {
        let set = model.parameter_set().clone();
        let of_terms: usize = model.terms().iter().map(|term| term.coefficients.len()).sum();
        Self {
            ws: Workspace::new(model.robot()),
            row: vec![0.0; basis.independent.len() + of_terms],
            effects: vec![0.0; set.effect_columns_per_joint()],
            own: (0..model.dof()).map(|joint| set.effect_parameters_of(joint)).collect(),
            basis,
            set,
        }
    }

    /// Adds the variance of each joint's torque.
    ///
    /// - `physics`: at this sample
    /// - `x`: of the processes
    /// - `share`: of a joint's variance that its process leaves
    fn add_variance(
        &mut self,
        physics: &PhysicsAtSample<'_>,
        x: &[f64],
        share: &dyn Fn(usize) -> f64,
        variance: &mut [f64],
    ) {
        let Self {
            set,
            basis: BasisParts { independent, covariance, explained },
            ws,
            row,
            effects,
            own,
        } = self;
        let PhysicsAtSample { robot, links, motion: [q, dq, ddq], term_columns, gain } = physics;
        let wide = robot.dof() * PARAMETERS_PER_LINK;
        let table = regressor(robot, ws, &links[0], &links[1], &links[2]);
        for (joint, (explained, variance)) in explained.iter_mut().zip(variance).enumerate() {
            set.effect_row(joint, &JointState { q, dq, ddq }, effects);
            let of_links = &table[joint * wide..][..wide];
            let (of_base, of_terms) = row.split_at_mut(independent.len());
            for (value, &parameter) in of_base.iter_mut().zip(&*independent) {
                *value = base_value(set, &own[joint], of_links, effects, parameter);
            }
            term_columns(joint, of_terms);
            let gain = gain(joint);
            row.iter_mut().for_each(|value| *value *= gain);
            let share = if explained.is_some() { 1.0 } else { share(joint) };
            if let Some(explained) = explained {
                row.iter_mut()
                    .zip(explained.mean(x))
                    .for_each(|(row, explained)| *row -= explained);
            }
            let mut sum = 0.0;
            for (a, covariances) in row.iter().zip(covariance.chunks_exact(row.len())) {
                sum += a * row.iter().zip(covariances).map(|(b, c)| b * c).sum::<f64>();
            }
            *variance += share * sum.max(0.0);
        }
    }
}

/// Derivative of a joint's torque by a parameter of the base.
///
/// - `own`: effect parameters of the joint
/// - `of_links`, `effects`: its derivatives by the parameters of all links, and by those of its
///   effects
pub fn base_value(
    set: &ParameterSet,
    own: &[usize],
    of_links: &[f64],
    effects: &[f64],
    parameter: usize,
) -> f64 {
    if parameter < set.inertial() {
        return of_links[parameter];
    }
    own.iter().position(|own| *own == parameter).map_or(0.0, |index| effects[index])
}
