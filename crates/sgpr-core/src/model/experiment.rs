//! Recordings made ready for an identification.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use super::IdentifyError;
use crate::identification::{ClosedLoop, Row, Trajectory, TrajectoryColumn};
use crate::motion::{Conditioning, Motion, MotionError, Processing, stretches_of};
use crate::recording::{Recording, RecordingError, SMALLEST_TORQUE, is_still};
use crate::robot::Robot;
use crate::signal::LowPass;

/// The motion in some recordings with the filters of their equations.
pub(super) struct Experiment {
    pub motions: Vec<Arc<Motion>>,
    /// The stretches of each recording that has one.
    pub logs: Vec<Range<usize>>,
    filters: Vec<Option<LowPass>>,
    decimation: usize,
}

/// Torques and columns of all motions, with the constants of a model as they are.
pub(super) struct TermColumns {
    /// Per motion: measured torque less what transforms make, `[samples, n]`.
    pub tau: Vec<Vec<f64>>,
    /// Per motion and parameter, as [`Trajectory::columns`].
    pub values: Vec<Vec<Vec<f64>>>,
    pub parameters: Vec<TrajectoryColumn>,
    /// `[n]`, as [`Trajectory::gains`].
    pub gains: Vec<f64>,
}

impl Experiment {
    pub fn new(recordings: &[Recording], processing: &Processing) -> Result<Self, IdentifyError> {
        let (mut motions, mut logs) = (Vec::new(), Vec::new());
        for recording in recordings {
            let first = motions.len();
            motions.extend(stretches_of(recording, processing)?);
            logs.push(first..motions.len());
        }
        logs.retain(|stretches| !stretches.is_empty());
        let filters =
            motions.iter().map(|motion: &Arc<Motion>| processing.band_filter(motion.rate_hz));
        Ok(Self {
            filters: filters.collect::<Result<_, _>>()?,
            motions,
            logs,
            decimation: processing.decimation,
        })
    }

    /// What the rows of each motion would be without those near turns of their joints, within
    /// `turn_margin` of another processing, and without those in which the ends of a log show.
    pub fn calm_rows(&self, processing: &Processing) -> Vec<Vec<Row>> {
        let pairs = self.motions.iter().zip(&self.filters);
        pairs
            .map(|(motion, filter)| {
                settled_rows(motion, filter.as_ref(), motion.rows_between_turns(processing))
            })
            .collect()
    }

    /// One trajectory per motion.
    ///
    /// - `instruments`: the same motions without noise; none for none
    /// - `loops`: the controller of each motion; none for none
    pub fn trajectories<'a>(
        &'a self,
        instruments: &'a [Arc<Motion>],
        loops: &'a [ClosedLoop<'a>],
    ) -> Result<Vec<Trajectory<'a>>, MotionError> {
        self.trajectories_with(instruments, loops, None)
    }

    /// The same with the columns of terms, and the torque that these leave to linear equations.
    pub fn trajectories_with<'a>(
        &'a self,
        instruments: &'a [Arc<Motion>],
        loops: &'a [ClosedLoop<'a>],
        columns: Option<&'a TermColumns>,
    ) -> Result<Vec<Trajectory<'a>>, MotionError> {
        let pairs = self.motions.iter().zip(&self.filters).enumerate();
        pairs
            .map(|(index, (motion, filter))| {
                Ok(Trajectory {
                    samples: motion.samples(),
                    tau: columns
                        .map_or_else(|| torque_of(motion), |columns| Ok(&columns.tau[index]))?,
                    use_as: Some(&motion.use_as),
                    filter: filter.as_ref(),
                    decimation: if filter.is_some() { self.decimation } else { 1 },
                    instruments: instruments.get(index).map(|motion| motion.samples()),
                    closed_loop: loops.get(index),
                    columns: columns.map_or(&[], |columns| &columns.values[index]),
                    gains: columns.map_or(&[], |columns| &columns.gains),
                })
            })
            .collect()
    }

    /// The torques times gains, without terms.
    ///
    /// - `gains`: `[n]`
    pub fn with_gains(&self, gains: &[f64]) -> Result<TermColumns, MotionError> {
        let gained = |motion: &Arc<Motion>| -> Result<Vec<f64>, MotionError> {
            Ok(torque_of(motion)?
                .iter()
                .zip(gains.iter().cycle())
                .map(|(tau, gain)| tau * gain)
                .collect())
        };
        let tau = self.motions.iter().map(gained).collect::<Result<_, _>>()?;
        Ok(TermColumns {
            tau,
            values: vec![vec![]; self.motions.len()],
            parameters: vec![],
            gains: vec![],
        })
    }

    /// Rows of the equations per second, of each motion.
    pub fn row_rates_hz(&self) -> Vec<f64> {
        let step =
            |filter: &Option<LowPass>| if filter.is_some() { self.decimation as f64 } else { 1.0 };
        self.motions
            .iter()
            .zip(&self.filters)
            .map(|(motion, filter)| motion.rate_hz / step(filter))
            .collect()
    }

    pub fn rates_hz(&self) -> Vec<f64> {
        self.motions.iter().map(|motion| motion.rate_hz).collect()
    }
}

/// Rows of a motion without those in which the ends of a log show.
fn settled_rows(motion: &Motion, filter: Option<&LowPass>, mut rows: Vec<Row>) -> Vec<Row> {
    let Some(filter) = filter else { return rows };
    let (settled, joints) = (motion.settled(filter), rows.len() / motion.len());
    for (sample, rows) in rows.chunks_exact_mut(joints).enumerate() {
        if !settled.contains(&sample) {
            rows.fill(Row::Skip);
        }
    }
    rows
}

pub(crate) fn torque_of(motion: &Motion) -> Result<&[f64], MotionError> {
    motion.tau.as_deref().ok_or_else(|| MotionError::NoTorque { recording: motion.source.clone() })
}

/// The recordings with the robot's joints, in its order.
pub(crate) fn select_joints<'a>(
    robot: &Robot,
    recordings: &'a [Recording],
) -> Result<Cow<'a, [Recording]>, RecordingError> {
    if recordings
        .iter()
        .all(|recording| robot.joint_names().eq(recording.joint_names().iter().map(String::as_str)))
    {
        return Ok(Cow::Borrowed(recordings));
    }
    let names: Vec<String> = robot.joint_names().map(String::from).collect();
    recordings
        .iter()
        .map(|recording| recording.of_robot(&names))
        .collect::<Result<_, _>>()
        .map(Cow::Owned)
}

/// How recordings are processed: as it is given, or as their spectra ask for.
pub(crate) fn given_or_chosen(
    given: Option<&Processing>,
    recordings: &[Recording],
) -> Result<Processing, MotionError> {
    match given {
        Some(processing) => Ok(processing.clone()),
        None => Ok(Processing::choose(recordings, &Conditioning::default())?.0),
    }
}

/// Zeros in the place of a torque would be believed more than any measurement, as they have no
/// noise.
pub(super) fn require_torque(robot: &Robot, recordings: &[Recording]) -> Result<(), IdentifyError> {
    let is_zero = |log: &Recording, joint| {
        log.torque().is_some_and(|tau| {
            tau.iter().skip(joint).step_by(robot.dof()).all(|tau| tau.abs() < SMALLEST_TORQUE)
        })
    };
    let unmeasured = (0..robot.dof()).find(|&joint| {
        recordings.iter().any(|log| !is_still(log, joint))
            && recordings.iter().all(|log| is_zero(log, joint))
    });
    unmeasured.map_or(Ok(()), |joint| {
        Err(IdentifyError::NoTorque { joint: robot.joints()[joint].name.clone() })
    })
}
