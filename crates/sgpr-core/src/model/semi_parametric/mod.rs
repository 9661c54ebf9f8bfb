//! tau = physics + what the physics leaves over, learned by a Gaussian process per joint.

mod all_rows;
mod basis;
mod file;
mod fit;
mod following;
mod inputs;
mod joint_process;
mod left_out;
mod predictor;
mod process;
mod rows;
mod shared;

use std::cell::RefCell;
use std::sync::Arc;

use derive_setters::Setters;

pub use fit::{fit_rest, fit_semi_parametric};
pub use following::FollowingIntervals;
pub use inputs::Inputs;
pub use joint_process::{Candidate, JointReport};

use basis::ParameterBasis;
use joint_process::JointProcess;

use super::compare::{Comparison, compare_by};
use super::{
    IdentificationReport, IdentifyError, IdentifyOptions, TorqueModel, Trajectory, identify,
};
use crate::dynamics::Samples;
use crate::gp::{Compute, GpError, Shape};
use crate::identification::HALF_INTERVAL_95;
use crate::motion::Motion;
use crate::recording::Recording;

/// A torque model and, for every joint, a Gaussian process of what it leaves over (thesis 4-3 and
/// 4-4).
///
/// tau_j = physics_j(q, dq, ddq) + f_j(x) + noise, f_j ~ GP(0, k_j). The process of a joint sees q,
/// dq and ddq, or some of them. The logs decide which: stretches of them are left out in turn, and
/// only a process that predicts those better than the physics alone is kept. Far from the data its
/// mean is zero, so that the physics still predicts.
///
/// Samples of a log share their errors with their neighbours in time. Such errors have a kernel of
/// their own, over time, so that the process does not take them for a function of the motion.
#[derive(Clone, Debug)]
pub struct SemiParametricModel {
    physics: TorqueModel,
    mean: Mean,
    joints: Vec<JointProcess>,
    /// With [`Mean::Joint`].
    basis: Option<ParameterBasis>,
    /// With [`Mean::Joint`]: the physics as it was identified, for the joints without a process, if
    /// there are some.
    identified: Option<TorqueModel>,
    /// How the physics was identified; none of physics that was there, and of a model that was
    /// read.
    report: Option<Arc<IdentificationReport>>,
    stopped: bool,
}

/// The physics whose residual the processes learn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mean {
    /// The identified physics, its parameters as least squares found them (thesis eq. 4-12).
    #[default]
    Physics,
    /// The physics, its parameters estimated again together with the processes: generalised least
    /// squares with their covariances. Hyperparameters are searched with the linear parameters
    /// unknown: what least squares leaves over lacks all that it explained by wrong parameters. A
    /// joint at which physics and process together predict parts of the logs that were left out no
    /// better for certain than the identified physics is left to that, whatever inputs are asked
    /// for.
    Joint,
    /// Nothing: the process alone, for comparison (thesis 4-3).
    Zero,
}

/// How a semi-parametric model is fitted.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct SemiParametricOptions {
    /// How the physics is identified. With [`super::Start::Zero`] the logs hold the feedback torque
    /// of a controller with an internal model, and the result is its error (case 2 of the thesis,
    /// 4-4).
    pub identify: IdentifyOptions,
    /// The physics whose residual the processes learn.
    pub mean: Mean,
    /// Kernel of the processes.
    pub shape: Shape,
    /// A length scale for each input, or one for all.
    pub ard: bool,
    /// What the processes look at; chosen for each joint by stretches left out if `None`.
    pub inputs: Option<Inputs>,
    /// One kernel for all joints, over the points at which all of them move: the search factors one
    /// matrix for all, and a predictor reads the points once and computes one kernel. Cheaper, and
    /// often less accurate: joints differ.
    pub shared: bool,
    /// Budget: points of each process. Of more rows the most informative ones are taken, for the
    /// search for hyperparameters and, unless all rows seen through as many inducing points predict
    /// parts left out clearly better, for the process.
    pub points: usize,
    /// Whether more rows than the budget are all seen through inducing points (Titsias 2009), at a
    /// cost of their number times the square of the budget; if `None`, chosen for each joint by
    /// stretches left out, from ten rows per point on.
    pub sparse: Option<bool>,
    /// Starts of the search for the hyperparameters.
    pub starts: usize,
    /// Evaluations of the likelihood in each search.
    pub evaluations: usize,
    /// Threads, which share the joints among them.
    pub compute: Compute,
}

impl Default for SemiParametricOptions {
    fn default() -> Self {
        Self {
            identify: IdentifyOptions::default(),
            mean: Mean::Physics,
            shape: Shape::SquaredExponential,
            ard: true,
            inputs: None,
            shared: false,
            points: 500,
            sparse: None,
            starts: 1,
            evaluations: 60,
            compute: Compute::default(),
        }
    }
}

/// Why a semi-parametric model could not be fitted or asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SemiParametricError {
    /// The physics could not be identified.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A process could not be computed.
    #[error(transparent)]
    Gp(#[from] GpError),
    /// The physics could not be streamed.
    #[error(transparent)]
    Stream(#[from] super::StreamError),
    /// A budget of no points, or of too many.
    #[error("a budget of {points} points per joint; choose between 2 and {most}")]
    Budget {
        /// Points asked for.
        points: usize,
        /// Most that are allowed.
        most: usize,
    },
    /// A kernel that joints share, and inputs that differ from joint to joint.
    #[error(
        "a kernel that all joints share cannot look at `{inputs}`: choose velocities, positions, \
         positions_and_velocities or all"
    )]
    NotShared {
        /// Name of the inputs.
        inputs: &'static str,
    },
    /// Physics to learn the residual of, and a mean that leaves it out.
    #[error(
        "a mean of zero leaves out the physics that is given: fit to the robot, or choose the mean \
         `physics` or `joint`"
    )]
    PhysicsGiven,
}

/// Torques of many samples.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct TorquePrediction {
    /// `[samples, n]`, row-major, N·m (N).
    pub tau: Vec<f64>,
    /// Standard deviation of a measurement in the band of the model, `[samples, n]`, N·m (N): half
    /// the interval of 68 %. Empty if not asked for.
    pub standard_deviation: Vec<f64>,
    /// Half the interval of 95 %, `[samples, n]`, N·m (N): 1.96 standard deviations for errors with
    /// a normal distribution, more where those on parts left out had heavy tails. Empty if the
    /// standard deviation was not asked for.
    pub interval_95: Vec<f64>,
    /// Share of the process's variance that the data have not explained, `[samples, n]`, between 0
    /// at a point of the data and 1 far from all; 0 for a joint without a process. Above 0.95 the
    /// prediction is that of the physics. Empty if the standard deviation was not asked for.
    pub novelty: Vec<f64>,
}

/// How many measurements fall within their predicted intervals.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Coverage {
    /// Joint.
    pub joint: String,
    /// Samples counted.
    pub samples: usize,
    /// Share within one standard deviation, percent; 68 if the intervals hold.
    pub percent_68: f64,
    /// Share within the interval of 95 %, percent; 95 if it holds.
    pub percent_95: f64,
    /// Half the interval of 68 %, mean over the samples, N·m (N): of two that hold the narrower one
    /// says more.
    pub half_width_68: f64,
    /// Half the interval of 95 %, mean over the samples, N·m (N).
    pub half_width_95: f64,
}

impl SemiParametricModel {
    /// The physics.
    pub fn physics(&self) -> &TorqueModel {
        &self.physics
    }

    /// How the physics was identified; none of physics that was given, and of a model that was
    /// read.
    pub fn report(&self) -> Option<&IdentificationReport> {
        self.report.as_deref()
    }

    /// The physics whose residual the processes learn.
    pub fn mean(&self) -> Mean {
        self.mean
    }

    /// Whether the search for the processes was stopped before its end.
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    /// What was learned, joint by joint.
    pub fn reports(&self) -> Vec<&JointReport> {
        self.joints.iter().map(|residual| &residual.report).collect()
    }

    /// Hyperparameters of a joint's process by name; none without a process.
    ///
    /// # Panics
    /// If there is no such joint.
    pub fn hyperparameters(&self, joint: usize) -> Option<Vec<(String, f64)>> {
        let covariance = self.joints[joint].gp.as_ref()?.covariance();
        Some(
            covariance
                .names()
                .into_iter()
                .zip(covariance.theta().into_iter().map(f64::exp))
                .collect(),
        )
    }

    /// Torque of every sample, and how sure it is.
    ///
    /// Effects of the physics that need time or a sampling rate are left out: see
    /// [`Self::predict_trajectory`].
    ///
    /// # Errors
    /// If a value is not finite.
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn predict(
        &self,
        samples: Samples<'_>,
        with_deviation: bool,
    ) -> Result<TorquePrediction, SemiParametricError> {
        self.predict_trajectory(&Trajectory::of_samples(samples), with_deviation)
    }

    /// The same along a processed stretch of a log, with all effects of the physics.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn predict_motion(
        &self,
        motion: &Motion,
        with_deviation: bool,
    ) -> Result<TorquePrediction, SemiParametricError> {
        let time = self.physics.time_of(motion);
        self.predict_trajectory(&Trajectory::of(motion, &time), with_deviation)
    }

    /// The same along a trajectory, hidden states, time and transforms of the physics included.
    ///
    /// # Errors
    /// If a value is not finite.
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn predict_trajectory(
        &self,
        trajectory: &Trajectory<'_>,
        with_deviation: bool,
    ) -> Result<TorquePrediction, SemiParametricError> {
        let (n, samples) = (self.physics.robot().dof(), trajectory.samples);
        let of_physics = |physics: &TorqueModel| match physics.terms().is_empty() {
            true => physics.predict(samples),
            false => physics.predict_trajectory(trajectory),
        };
        let mut tau = of_physics(&self.physics);
        if let Some(identified) = &self.identified {
            let own = of_physics(identified);
            let without = |k: usize| self.joints[k % n].gp.is_none();
            tau.iter_mut()
                .zip(own)
                .enumerate()
                .filter(|(k, _)| without(*k))
                .for_each(|(_, (tau, own))| *tau = own);
        }
        let mut variance = vec![0.0; if with_deviation { tau.len() } else { 0 }];
        let mut novelty = variance.clone();
        let x = process_inputs(samples, n);
        for (joint, residual) in self.joints.iter().enumerate() {
            let place = |k: usize| k * n + joint;
            if let Some(gp) = &residual.gp {
                let prediction = gp.predict(&x, with_deviation)?;
                let prior = gp.covariance().signal.variance();
                prediction.mean.iter().enumerate().for_each(|(k, mean)| tau[place(k)] += mean);
                for (k, unexplained) in prediction.variance.iter().enumerate() {
                    variance[place(k)] = *unexplained;
                    novelty[place(k)] = unexplained / prior;
                }
            }
        }
        let mut of_parameters = vec![0.0; variance.len()];
        if let Some(basis) = self.basis.as_ref().filter(|_| with_deviation) {
            basis.add_variance(
                &self.physics,
                &self.joints,
                trajectory,
                &x,
                &novelty,
                &mut of_parameters,
            );
        }
        let half_interval =
            |of_parameters_alone: f64, factor: fn(&JointReport) -> f64| -> Vec<f64> {
                let both = variance.iter().zip(&of_parameters).enumerate();
                let half = |(k, (variance, of_parameters)): (usize, (&f64, &f64))| {
                    let residual = &self.joints[k % n];
                    let scaled =
                        factor(&residual.report).powi(2) * (variance + residual.noise_variance);
                    (scaled + of_parameters_alone.powi(2) * of_parameters).sqrt()
                };
                both.map(half).collect()
            };
        let standard_deviation = half_interval(1.0, |report| report.calibration);
        let of_parameters_95 =
            self.physics.fit.as_ref().map_or(HALF_INTERVAL_95, |fit| fit.half_interval_95);
        let interval_95 = half_interval(of_parameters_95, |report| report.calibration_95);
        Ok(TorquePrediction { tau, standard_deviation, interval_95, novelty })
    }

    /// Compares with recordings, as [`super::compare`] does it for the physics alone.
    ///
    /// # Errors
    /// If a recording lacks a joint or torque, or cannot be differentiated.
    pub fn compare(&self, recordings: &[Recording]) -> Result<Comparison, SemiParametricError> {
        let predict = |motion: &Motion, _: &Recording| Ok(self.predict_motion(motion, false)?.tau);
        compare_by(&self.physics, &predict, recordings, None)
    }

    /// The same, and for each of the comparison's logs the prediction with its spread.
    ///
    /// # Errors
    /// As [`SemiParametricModel::compare`].
    pub fn compare_with_spread(
        &self,
        recordings: &[Recording],
    ) -> Result<(Comparison, Vec<TorquePrediction>), SemiParametricError> {
        let predictions = RefCell::new(Vec::new());
        let predict = |motion: &Motion, _: &Recording| {
            let prediction = self.predict_motion(motion, true)?;
            let tau = prediction.tau.clone();
            predictions.borrow_mut().push(prediction);
            Ok::<_, SemiParametricError>(tau)
        };
        let comparison = compare_by(&self.physics, &predict, recordings, None)?;
        Ok((comparison, predictions.into_inner()))
    }

    /// Share of the variance of the torque that is explained on recordings, the mean over joints;
    /// at most one.
    ///
    /// # Errors
    /// As [`SemiParametricModel::compare`].
    pub fn score(&self, recordings: &[Recording]) -> Result<f64, SemiParametricError> {
        let joints = self.compare(recordings)?.joints;
        Ok(joints.iter().map(|joint| joint.r2).sum::<f64>() / joints.len() as f64)
    }

    /// How many of the measurements of recordings fall within their predicted intervals, in the
    /// band of the model, over the samples at which a joint moves.
    ///
    /// - `following`: whether the intervals follow the errors of the samples before
    ///   ([`FollowingIntervals`]), from log to log, rather than stay as they are predicted from the
    ///   motion alone. An error enters when it is past the reach of the filters, one period of the
    ///   band later.
    ///
    /// # Errors
    /// As [`SemiParametricModel::compare`].
    pub fn coverage(
        &self,
        recordings: &[Recording],
        following: bool,
    ) -> Result<Vec<Coverage>, SemiParametricError> {
        let n = self.physics.robot().dof();
        let (comparison, predictions) = self.compare_with_spread(recordings)?;
        let processing = self.physics.processing().expect("set with the model");
        let band_hz = processing.torque_cutoff_hz.unwrap_or(processing.cutoff_hz);
        let coverage_of = |joint: usize| {
            let mut followed: Option<FollowingIntervals> = None;
            let (mut samples, mut within, mut widths) = (0, [0usize; 2], [0.0; 2]);
            for (log, prediction) in comparison.logs.iter().zip(&predictions) {
                let rate_hz = log.motion.rate_hz;
                let followed = followed.get_or_insert_with(|| FollowingIntervals::new(rate_hz));
                let late = (rate_hz / band_hz).ceil() as usize;
                let counted: Vec<usize> = (0..log.motion.len())
                    .map(|sample| sample * n + joint)
                    .filter(|&k| log.counts(k))
                    .collect();
                let in_band = log.in_band(joint);
                let error = |k: usize| in_band.residual(k / n);
                let half = |k: usize| [prediction.standard_deviation[k], prediction.interval_95[k]];
                for (index, &k) in counted.iter().enumerate() {
                    if following && index >= late {
                        let past = counted[index - late];
                        let [half_68, half_95] = half(past);
                        followed.observe(error(past), half_68, half_95);
                    }
                    let factors = if following { followed.factors() } else { [1.0; 2] };
                    for (which, half) in half(k).into_iter().enumerate() {
                        within[which] += usize::from(error(k).abs() <= factors[which] * half);
                        widths[which] += factors[which] * half;
                    }
                }
                samples += counted.len();
            }
            let share = |hits: usize| 100.0 * hits as f64 / samples.max(1) as f64;
            let width = |sum: f64| sum / samples.max(1) as f64;
            Coverage {
                joint: String::new(),
                samples,
                percent_68: share(within[0]),
                percent_95: share(within[1]),
                half_width_68: width(widths[0]),
                half_width_95: width(widths[1]),
            }
        };
        let names = self.physics.robot().joint_names();
        Ok(names
            .enumerate()
            .map(|(joint, name)| Coverage { joint: name.into(), ..coverage_of(joint) })
            .collect())
    }
}

/// x of every sample, `[samples, 3 n + 1]`: q, dq, ddq and a time that predictions do not look at.
fn process_inputs(samples: Samples<'_>, n: usize) -> Vec<f64> {
    let count = samples.count(n);
    let mut x = Vec::with_capacity(count * (3 * n + 1));
    for k in 0..count {
        for part in [samples.q, samples.dq, samples.ddq] {
            x.extend_from_slice(&part[k * n..(k + 1) * n]);
        }
        x.push(0.0);
    }
    x
}
