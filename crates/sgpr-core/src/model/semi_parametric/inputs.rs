use serde::{Deserialize, Serialize};

/// What of the motion the process of a joint looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Inputs {
    /// The joint's own velocity: a better friction curve.
    OwnVelocity,
    /// Its own position and velocity: friction that depends on position, cogging.
    OwnJoint,
    /// Its own position, velocity and acceleration: also a rotor that the physics lacks. Only if
    /// asked for.
    OwnMotion,
    /// All velocities.
    Velocities,
    /// All positions: springs, a better gravity.
    Positions,
    /// All positions and velocities.
    PositionsAndVelocities,
    /// All positions, velocities and accelerations (thesis 4-3).
    All,
}

impl Inputs {
    /// All selections.
    pub const NAMED: [Self; 7] = [
        Self::OwnVelocity,
        Self::OwnJoint,
        Self::OwnMotion,
        Self::Velocities,
        Self::Positions,
        Self::PositionsAndVelocities,
        Self::All,
    ];

    /// The selections that are tried when none is asked for, smallest first.
    pub const EVERY: [Self; 6] = [
        Self::OwnVelocity,
        Self::OwnJoint,
        Self::Velocities,
        Self::Positions,
        Self::PositionsAndVelocities,
        Self::All,
    ];

    /// Columns of x = [q, dq, ddq] for a joint of `n`.
    pub fn columns(self, joint: usize, n: usize) -> Vec<usize> {
        match self {
            Self::OwnVelocity => vec![n + joint],
            Self::OwnJoint => vec![joint, n + joint],
            Self::OwnMotion => vec![joint, n + joint, 2 * n + joint],
            Self::Velocities => (n..2 * n).collect(),
            Self::Positions => (0..n).collect(),
            Self::PositionsAndVelocities => (0..2 * n).collect(),
            Self::All => (0..3 * n).collect(),
        }
    }

    /// Its name in files, tables and other languages.
    pub fn name(self) -> &'static str {
        match self {
            Self::OwnVelocity => "own_velocity",
            Self::OwnJoint => "own_joint",
            Self::OwnMotion => "own_motion",
            Self::Velocities => "velocities",
            Self::Positions => "positions",
            Self::PositionsAndVelocities => "positions_and_velocities",
            Self::All => "all",
        }
    }

    /// The selection of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::NAMED.into_iter().find(|inputs| inputs.name() == name)
    }
}
