//! A log as a sum: the small part of it that identification needs.
//!
//! Least squares knows of a log only the triangular factors of its equations with the torque. A
//! [`Record`] keeps them, joint by joint and part by part, with what the residual remembers and
//! where the log came from. Any choice of records is identified ([`identify_records`]), compared
//! with a model ([`compare_records`]) and looked through for changes ([`deviations`]), and asked
//! for effects that the model lacks ([`diagnose_records`]), without the logs: factors of several
//! logs below each other, reduced again, are the factor of all their rows. Adding a log is adding
//! its record to the list, removing it is leaving it out. Sessions of one arm are compared
//! ([`compare_sessions`]) from their logs, as sums with more columns than records keep.

mod deviation;
mod error;
mod make;
mod parts;
mod sessions;
mod sum;
mod suspects;

use std::collections::BTreeMap;

pub use super::extent::JointExtent;
pub use deviation::{Deviation, JointDeviation, ParameterDeviation, deviations};
pub use error::RecordError;
pub use make::{RecordOptions, choose_processing, record};
pub use sessions::{SessionCause, SessionComparison, SessionTest, compare_sessions};
pub use sum::{RecordedError, compare_records, copies_among, identify_records};
pub use suspects::{RecordDiagnosis, Suspect, SuspectTest, diagnose_records};

use serde::{Deserialize, Serialize};

use crate::identification::JointFactor;
use crate::linalg::Matrix;
use crate::motion::Processing;

/// What a log says about the parameters of a robot.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Record {
    /// [`Robot::fingerprint`](crate::robot::Robot::fingerprint) of the robot.
    pub robot: String,
    /// Its joints.
    pub joints: Vec<String>,
    /// Effects beside the rigid body.
    pub effects: Vec<String>,
    /// How the log was processed; records are summed only where this is the same.
    pub processing: Processing,
    /// Where the log came from.
    pub source: String,
    /// [`Recording::content_hash`](crate::recording::Recording::content_hash) of the log,
    /// hexadecimal.
    pub content_hash: String,
    /// Part of the log that counts, `[start, end)`, ns; all of it if `None`.
    pub counted: Option<[i64; 2]>,
    /// Stamps of the first and the last sample, ns.
    pub time: [i64; 2],
    /// Samples that count.
    pub samples: usize,
    /// What is suspicious in the log ([`RecordFinding`]).
    pub findings: Vec<RecordFinding>,
    /// Names that the caller gives: the arm, the session, its tool.
    pub labels: BTreeMap<String, String>,
    /// Version of the library that made it.
    pub library_version: String,
    /// What each joint did, `[n]`; empty in a record of an earlier version.
    pub extents: Vec<JointExtent>,
    /// Squares of the torque with which the log begins and of all of it: its place among others,
    /// whatever their files are called.
    pub key: [f64; 2],
    /// Effects that the equations lack and blocks have columns of.
    pub suspects: Vec<Suspect>,
    /// Base parameters that residuals are counted from: the log's own solution, where it has one.
    pub center: Vec<f64>,
    /// What the residual of each joint remembers.
    pub memory: Vec<RecordMemory>,
    /// Parts of the log in the order of time.
    pub blocks: Vec<RecordBlock>,
}

/// Something that a look at a log found, at its numbers, at the limits of the robot file or at the
/// equations.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct RecordFinding {
    /// What it is: names of [`IssueKind`](crate::recording::IssueKind) and
    /// [`Finding`](crate::identification::Finding), `frozen_torque`, `saturated`; `unnamed` in
    /// records of an earlier version.
    pub kind: String,
    /// How much it matters: `stop`, `look` or `know`.
    pub rank: String,
    /// The joint or column that it is about; none if it is about the whole log.
    pub subject: Option<String>,
    /// A sentence with numbers, and what to do.
    pub message: String,
}

/// Products of a joint's rows with those some rows later, summed over the log by groups of lags:
/// what any parameters leave of the torque remembers as these say.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordMemory {
    /// Joint.
    pub joint: usize,
    /// Whether these are the rows at which it stands.
    pub resting: bool,
    /// Per group of lags, symmetric: of all columns of the joint's factor, with the residual of
    /// [`Record::center`] in the place of the torque; of that residual alone if `[1, 1]`.
    pub sums: Vec<Matrix>,
    /// Number of products in each.
    pub counts: Vec<usize>,
}

/// A part of a log.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordBlock {
    /// Stamps of its first and last sample, ns.
    pub time: [i64; 2],
    /// Mean of each channel of the log, of the samples that have a value.
    pub channels: BTreeMap<String, f64>,
    /// Joints in motion, then joints at rest; without those that have no row.
    pub factors: Vec<JointFactor>,
    /// The same with the columns of suspects beside the base parameters, one after the other; empty
    /// without suspects.
    pub suspected: Vec<JointFactor>,
}

impl Record {
    /// Identifies the same part of the same log.
    pub(super) fn identity(&self) -> (&str, Option<[i64; 2]>) {
        (&self.content_hash, self.counted)
    }

    /// Rows of all joints and blocks.
    pub fn rows(&self) -> usize {
        self.blocks.iter().flat_map(|block| &block.factors).map(|factor| factor.rows).sum()
    }
}
