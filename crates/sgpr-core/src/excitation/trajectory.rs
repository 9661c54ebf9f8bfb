//! A motion of all joints, its samples, its files.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Basis, ExcitationError};
use crate::recording::{self, Channel, Recording, RecordingError};
use crate::robot::Robot;
use crate::simulation::Reference;

/// A motion of all joints: one [`Basis`], coefficients per joint, and the position it starts from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TrajectoryParts")]
pub struct Trajectory {
    basis: Basis,
    /// Added to the motion, `[n]`.
    start: Vec<f64>,
    /// `[n, basis.len()]`.
    coefficients: Vec<f64>,
}

/// Samples of a trajectory; every array `[samples, n]`, row-major, SI.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrajectorySamples {
    /// s.
    pub time: Vec<f64>,
    /// Positions.
    pub q: Vec<f64>,
    /// Velocities.
    pub dq: Vec<f64>,
    /// Accelerations.
    pub ddq: Vec<f64>,
}

/// What a stranger says that a trajectory is made of.
#[derive(Deserialize)]
struct TrajectoryParts {
    basis: Basis,
    start: Vec<f64>,
    coefficients: Vec<f64>,
}

impl TryFrom<TrajectoryParts> for Trajectory {
    type Error = String;

    fn try_from(parts: TrajectoryParts) -> Result<Self, String> {
        let TrajectoryParts { basis, start, coefficients } = parts;
        basis.require_valid().map_err(|error| error.to_string())?;
        let fits = start.len().checked_mul(basis.len()) == Some(coefficients.len());
        if !fits || start.iter().chain(&coefficients).any(|number| !number.is_finite()) {
            return Err("not a trajectory: its parts do not belong together".into());
        }
        Ok(Self { basis, start, coefficients })
    }
}

impl Trajectory {
    /// - `start`: `[n]`, added to the positions that the functions make, rad (m)
    /// - `coefficients`: `[n, basis.len()]`, row-major
    ///
    /// # Errors
    /// If the basis has no functions.
    ///
    /// # Panics
    /// If the number of coefficients does not fit.
    pub fn new(
        basis: Basis,
        start: Vec<f64>,
        coefficients: Vec<f64>,
    ) -> Result<Self, ExcitationError> {
        basis.require_valid()?;
        assert_eq!(coefficients.len(), start.len() * basis.len(), "coefficients of every joint");
        Ok(Self { basis, start, coefficients })
    }

    /// A Fourier series from the amplitudes of its velocity, started where q_0 = sum b_l / (ω l)
    /// puts it.
    ///
    /// - `a`, `b`: `[terms, n]`, amplitudes a_l and b_l of thesis eq. 3-1, rad/s (m/s), a row per
    ///   harmonic as in its tables C-1 and C-2
    ///
    /// # Errors
    /// If the frequency is not positive or there is less than two terms.
    ///
    /// # Panics
    /// If the arrays do not have the same size, in whole rows.
    pub fn fourier(
        fundamental_hz: f64,
        dof: usize,
        a: &[f64],
        b: &[f64],
    ) -> Result<Self, ExcitationError> {
        assert!(
            a.len() == b.len() && a.len().is_multiple_of(dof),
            "rows of amplitudes, as many a as b"
        );
        let terms = a.len() / dof;
        let basis = Basis::fourier(fundamental_hz, terms);
        let mut coefficients = Vec::new();
        for joint in 0..dof {
            let column =
                |rows: &[f64]| (0..terms).map(|l| rows[l * dof + joint]).collect::<Vec<_>>();
            let (a, b) = (column(a), column(b));
            let w = |l: usize| std::f64::consts::TAU * fundamental_hz * (l + 1) as f64;
            let offset = b.iter().enumerate().map(|(l, b)| b / w(l)).sum();
            coefficients.extend(a.into_iter().chain(b).chain([offset]));
        }
        Self::new(basis, vec![0.0; dof], coefficients)
    }

    /// The functions.
    pub fn basis(&self) -> &Basis {
        &self.basis
    }

    /// Position that the motion starts from, `[n]`, rad (m).
    pub fn start(&self) -> &[f64] {
        &self.start
    }

    /// `[n, basis.len()]`, row-major.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Duration; one period of a series, s.
    pub fn duration(&self) -> f64 {
        self.basis.duration()
    }

    /// The same motion about its start, smaller or larger.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.coefficients.iter_mut().for_each(|c| *c *= factor);
        self
    }

    /// Samples at `rate_hz` from time zero up to, without, `duration` seconds.
    ///
    /// # Panics
    /// If the rate or the duration is not positive.
    pub fn samples(&self, rate_hz: f64, duration: f64) -> TrajectorySamples {
        assert!(rate_hz > 0.0 && duration > 0.0, "a rate and a duration above zero");
        let count = (duration * rate_hz - 1e-9).ceil().max(1.0) as usize;
        self.at((0..count).map(|k| k as f64 / rate_hz))
    }

    /// The whole motion at `rate_hz`, its end at rest with it where that falls on a sample: what an
    /// arm is to follow once.
    ///
    /// # Panics
    /// If the rate is not positive.
    pub fn whole(&self, rate_hz: f64) -> TrajectorySamples {
        assert!(rate_hz > 0.0, "a rate above zero");
        let last = (self.duration() * rate_hz + 1e-9).floor() as usize;
        self.at((0..=last).map(|k| k as f64 / rate_hz))
    }

    /// Samples at these times, s.
    pub fn at(&self, times: impl IntoIterator<Item = f64>) -> TrajectorySamples {
        let n = self.start.len();
        let mut samples = TrajectorySamples { time: vec![], q: vec![], dq: vec![], ddq: vec![] };
        for time in times {
            let from = samples.q.len();
            samples.time.push(time);
            for array in [&mut samples.q, &mut samples.dq, &mut samples.ddq] {
                array.resize(from + n, 0.0);
            }
            let [q, dq, ddq] =
                [&mut samples.q, &mut samples.dq, &mut samples.ddq].map(|array| &mut array[from..]);
            self.sample(time, q, dq, ddq);
        }
        samples
    }
}

impl Reference for Trajectory {
    fn dof(&self) -> usize {
        self.start.len()
    }

    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        let k = self.basis.len();
        q.copy_from_slice(&self.start);
        dq.fill(0.0);
        ddq.fill(0.0);
        self.basis.for_each(time, |index, [value, slope, curvature]| {
            for (joint, own) in self.coefficients.chunks_exact(k).enumerate() {
                let c = own[index];
                q[joint] += c * value;
                dq[joint] += c * slope;
                ddq[joint] += c * curvature;
            }
        });
    }
}

impl TrajectorySamples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Motions one after the other, each from rest to rest at the same pose, as evenly spaced
    /// samples.
    pub(crate) fn in_a_row(motions: &[&Self], rate_hz: f64) -> Self {
        let all = |of: fn(&Self) -> &Vec<f64>| {
            motions.iter().flat_map(|motion| of(motion)).copied().collect()
        };
        let count: usize = motions.iter().map(|motion| motion.len()).sum();
        let time = (0..count).map(|k| k as f64 / rate_hz).collect();
        Self {
            time,
            q: all(|motion| &motion.q),
            dq: all(|motion| &motion.dq),
            ddq: all(|motion| &motion.ddq),
        }
    }

    /// The samples as a recording without torque; accelerations as channels `NAME_acceleration`.
    pub fn recording(&self, robot: &Robot, source: &str) -> Recording {
        let n = robot.dof();
        let channel = |(joint, name): (usize, &str)| Channel {
            name: format!("{name}_acceleration"),
            values: self.ddq.iter().skip(joint).step_by(n).copied().collect(),
        };
        let channels = robot.joint_names().enumerate().map(channel).collect();
        let names = robot.joint_names().map(String::from).collect();
        let time = self.time.iter().map(|time| (time * 1e9).round() as i64).collect();
        Recording::new(source, names, time, self.q.clone(), Some(self.dq.clone()), None, channels)
            .expect("arrays of the same samples")
    }

    /// Writes a table: `t_s`, then position and velocity of every joint, then accelerations.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_csv(&self, robot: &Robot, path: impl AsRef<Path>) -> Result<(), RecordingError> {
        recording::csv::write(path, &self.recording(robot, "excitation trajectory"))
    }

    /// Writes an MCAP file of profile `ros2` with one `trajectory_msgs/msg/JointTrajectory` message
    /// of all samples.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_mcap(
        &self,
        robot: &Robot,
        topic: &str,
        path: impl AsRef<Path>,
    ) -> Result<(), RecordingError> {
        let names: Vec<String> = robot.joint_names().map(String::from).collect();
        recording::mcap::write_joint_trajectory(
            path, topic, &names, &self.time, &self.q, &self.dq, &self.ddq,
        )
    }
}
