//! Where equations come from: logs, whose rows can be gone through again, or records, which hold
//! sums of their products.
//!
//! Estimators see logs as triangular factors alone, and everything is decided by parts of the data
//! that are whole blocks of logs: so it makes no difference to a model which of both there were.

use std::ops::Range;

use faer::Mat;

use crate::identification::{
    BaseParameters, JointFactor, Observation, ParameterSet, Trajectory, piece_of, stacked,
};
use crate::model::correlation::correlation;
use crate::model::experiment::Experiment;
use crate::model::extent::JointExtent;
use crate::model::forecast::states_of;
use crate::model::variable_projection::{self, TermFit};
use crate::model::{IdentifyError, Term, TorqueModel};
use crate::motion::{Motion, Processing};
use crate::progress::Progress;
use crate::robot::Robot;

/// Parts of the data, each of which is predicted from the others, and blocks into which each log is
/// cut for them.
pub(in crate::model) const PARTS: usize = 5;

/// Factors of logs that were gone through once.
pub(in crate::model) struct SourceFactors {
    /// Of consecutive parts of all logs, one log after the other.
    pub parts: Vec<Vec<JointFactor>>,
    /// Of each log, with its name; none of a single one.
    pub logs: Vec<(String, Vec<JointFactor>)>,
}

/// Sums of products of equations, and what else identification asks of them.
pub(in crate::model) trait Source {
    /// Factors of consecutive parts of all logs, and of each log.
    fn factors(
        &self,
        parts: usize,
        progress: &dyn Progress,
    ) -> Result<SourceFactors, IdentifyError>;

    /// Factors of parts of each log: the first of all logs, then the second of all.
    fn folds(&self) -> Result<Vec<Vec<JointFactor>>, IdentifyError>;

    /// Per factor: rows that carry as much as one independent row of what a model leaves.
    fn correlation(
        &self,
        model: &TorqueModel,
        factors: &[JointFactor],
    ) -> Result<Vec<f64>, IdentifyError>;

    /// What joints did.
    fn extents(&self) -> Vec<JointExtent>;

    /// Factors of all rows anew, where they depend on the parameters of a model.
    fn anew(&self, _model: &TorqueModel) -> Result<Option<Vec<JointFactor>>, IdentifyError> {
        Ok(None)
    }

    /// Covariance of base parameters and constants of terms; of base parameters: `linear`.
    fn joint_covariance(
        &self,
        _model: &mut TorqueModel,
        linear: &Mat<f64>,
    ) -> Result<Mat<f64>, IdentifyError> {
        Ok(linear.clone())
    }

    /// Seconds of the logs, and equations of states in which each joint moves as at some time of
    /// the logs; none where single samples are not known.
    fn states(&self) -> Result<Option<(f64, Vec<JointFactor>)>, IdentifyError> {
        Ok(None)
    }
}

/// A log, as far as its place among the others goes.
pub(in crate::model) struct Place<'a> {
    pub source: &'a str,
    /// Stamps of the first and the last sample, ns.
    pub time: [i64; 2],
    /// Squares of torque: of the first sample, and of all.
    pub key: [f64; 2],
    pub samples: usize,
    /// Parts of equal length that go together.
    pub blocks: usize,
}

/// Squares of the torque with which a motion begins, and of all of it.
pub(in crate::model) fn key_of(motion: &Motion) -> [f64; 2] {
    let square = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
    let tau = motion.tau.as_deref().unwrap_or_default();
    let dof = motion.use_as.len() / motion.len().max(1);
    [square(&tau[..dof.min(tau.len())]), square(tau)]
}

/// Indices of logs in an order in which that of the files does not show: by the torque that a log
/// begins with, then by that of all of it; what goes on after a log stays behind it.
///
/// Parts of the data go by it, and what is decided by parts that are left out.
pub(in crate::model) fn order_of_logs(logs: &[Place<'_>]) -> Vec<usize> {
    let mut keys: Vec<[f64; 2]> = Vec::with_capacity(logs.len());
    for (index, log) in logs.iter().enumerate() {
        let goes_on =
            |before: &Place<'_>| before.source == log.source && before.time[1] < log.time[0];
        keys.push(match index.checked_sub(1) {
            Some(before) if goes_on(&logs[before]) => keys[before],
            _ => log.key,
        });
    }
    let mut order: Vec<usize> = (0..logs.len()).collect();
    let by_key = |a: &[f64; 2], b: &[f64; 2]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]));
    order.sort_by(|a, b| by_key(&keys[*a], &keys[*b]));
    order
}

/// Per log and block of it: which of consecutive parts of all logs it belongs to, by the place of
/// its middle.
pub(in crate::model) fn parts_of_blocks(logs: &[Place<'_>], parts: usize) -> Vec<Vec<usize>> {
    let all: usize = logs.iter().map(|log| log.samples).sum();
    let mut of_blocks = vec![vec![]; logs.len()];
    let mut before = 0;
    for index in order_of_logs(logs) {
        let Place { samples, blocks, .. } = logs[index];
        let twice_middle = |block: usize| 2 * before * blocks + (2 * block + 1) * samples;
        let part =
            |block: usize| (twice_middle(block) * parts / (2 * blocks * all.max(1))).min(parts - 1);
        of_blocks[index] = (0..blocks).map(part).collect();
        before += samples;
    }
    of_blocks
}

/// Logs.
pub(super) struct Logs<'a> {
    pub robot: &'a Robot,
    pub processing: &'a Processing,
    pub experiment: &'a Experiment,
    pub terms: &'a TermFit<'a>,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    pub trajectories: &'a [Trajectory<'a>],
}

impl Logs<'_> {
    fn places(&self) -> Vec<Place<'_>> {
        let Experiment { motions, logs, .. } = self.experiment;
        let place = |stretches: &Range<usize>| {
            let (first, last) = (&motions[stretches.start], &motions[stretches.end - 1]);
            let time =
                [first.time.first(), last.time.last()].map(|stamp| stamp.copied().unwrap_or(0));
            let samples = motions[stretches.clone()].iter().map(|motion| motion.len()).sum();
            Place { source: &first.source, time, key: key_of(first), samples, blocks: PARTS }
        };
        logs.iter().map(place).collect()
    }
}

impl Source for Logs<'_> {
    fn factors(
        &self,
        parts: usize,
        progress: &dyn Progress,
    ) -> Result<SourceFactors, IdentifyError> {
        let places = self.places();
        let of_blocks = parts_of_blocks(&places, parts);
        let mut of_parts: Vec<Vec<JointFactor>> = vec![vec![]; parts];
        let mut logs = Vec::with_capacity(places.len());
        for (done, index) in order_of_logs(&places).into_iter().enumerate() {
            progress.step("observe", done, places.len())?;
            let own = &of_blocks[index];
            let touched = own[0]..own[own.len() - 1] + 1;
            let mut observation =
                Observation::in_parts(self.robot, self.set, self.base, touched.len());
            for trajectory in &self.trajectories[self.experiment.logs[index].clone()] {
                let count = trajectory.samples.count(self.robot.dof());
                observation.add_to(trajectory, |sample| {
                    own[piece_of(sample, count, own.len())] - touched.start
                })?;
            }
            let of_log = observation.parts();
            if places.len() > 1 {
                logs.push((places[index].source.to_string(), stacked(of_log.iter().flatten())));
            }
            touched.zip(of_log).for_each(|(part, factors)| of_parts[part].extend(factors));
        }
        progress.step("observe", places.len(), places.len())?;
        Ok(SourceFactors { parts: of_parts.iter().map(stacked).collect(), logs })
    }

    fn folds(&self) -> Result<Vec<Vec<JointFactor>>, IdentifyError> {
        let mut observation = Observation::in_parts(self.robot, self.set, self.base, PARTS);
        for trajectory in self.trajectories {
            let count = trajectory.samples.count(self.robot.dof());
            observation.add_to(trajectory, |sample| piece_of(sample, count, PARTS))?;
        }
        Ok(observation.parts())
    }

    fn correlation(
        &self,
        model: &TorqueModel,
        factors: &[JointFactor],
    ) -> Result<Vec<f64>, IdentifyError> {
        correlation(model, &self.experiment.motions, self.processing, factors)
    }

    fn extents(&self) -> Vec<JointExtent> {
        JointExtent::of(&self.experiment.motions, self.robot.dof())
    }

    fn anew(&self, model: &TorqueModel) -> Result<Option<Vec<JointFactor>>, IdentifyError> {
        if !model.terms().iter().any(Term::is_transform) {
            return Ok(None);
        }
        let columns = self.terms.columns(model)?;
        variable_projection::factors(self.robot, self.set, self.base, self.experiment, &columns)
            .map(Some)
    }

    fn joint_covariance(
        &self,
        model: &mut TorqueModel,
        linear: &Mat<f64>,
    ) -> Result<Mat<f64>, IdentifyError> {
        self.terms.joint_covariance(model, linear)
    }

    fn states(&self) -> Result<Option<(f64, Vec<JointFactor>)>, IdentifyError> {
        let motions = &self.experiment.motions;
        let seconds = motions.iter().map(|motion| motion.len() as f64 / motion.rate_hz).sum();
        Ok(Some((seconds, states_of(self.robot, self.set, self.base, motions)?)))
    }
}
