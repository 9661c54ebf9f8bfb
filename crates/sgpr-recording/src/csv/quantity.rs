//! What a column of a log can be: a quantity, of a joint, in a unit.

use crate::units::{CurrentUnit, PositionUnit, TorqueUnit, VelocityUnit};

/// What a column of a joint holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    Position,
    Velocity,
    Torque,
    Current,
}

impl Quantity {
    pub(super) const ALL: [Self; 4] = [Self::Position, Self::Velocity, Self::Torque, Self::Current];

    /// Under which option the caller names its columns; currents are named in place of torques.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Torque | Self::Current => "torque",
        }
    }

    /// Words for it, in lower case.
    pub(super) fn words(self) -> &'static [&'static str] {
        match self {
            Self::Position => {
                &["position", "positions", "pos", "angle", "istposition", "winkel", "istwinkel"]
            }
            Self::Velocity => &[
                "velocity",
                "velocities",
                "vel",
                "speed",
                "geschwindigkeit",
                "istgeschwindigkeit",
                "drehzahl",
                "istdrehzahl",
                "vitesse",
            ],
            Self::Torque => &[
                "torque",
                "torques",
                "effort",
                "efforts",
                "force",
                "trq",
                "moment",
                "istmoment",
                "drehmoment",
                "istdrehmoment",
                "couple",
            ],
            Self::Current => &["current", "currents", "strom", "iststrom", "motorstrom", "courant"],
        }
    }

    /// Symbols for it. They do not make another part of a name a joint: `q_x` may be anything.
    pub(super) fn symbols(self) -> &'static [&'static str] {
        match self {
            Self::Position => &["q", "qpos"],
            Self::Velocity => &["dq", "qd", "qdot", "qvel"],
            Self::Torque => &["tau"],
            Self::Current => &["i"],
        }
    }

    /// The unit spelled `text`.
    pub(super) fn unit(self, text: &str) -> Option<StatedUnit> {
        match self {
            Self::Position => text.parse::<PositionUnit>().ok().map(StatedUnit::from),
            Self::Velocity => text.parse::<VelocityUnit>().ok().map(StatedUnit::from),
            Self::Torque => text.parse::<TorqueUnit>().ok().map(StatedUnit::from),
            Self::Current => text.parse::<CurrentUnit>().ok().map(StatedUnit::from),
        }
    }

    /// What is taken where nobody says a unit.
    pub(super) fn usual_unit(self) -> &'static str {
        match self {
            Self::Position => "rad (m)",
            Self::Velocity => "rad/s (m/s)",
            Self::Torque => "N·m (N)",
            Self::Current => "A",
        }
    }
}

/// A unit that somebody stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StatedUnit {
    pub(super) name: &'static str,
    /// What one of it is in SI.
    pub(super) factor: f64,
}

macro_rules! stated {
    ($($unit:ident),+) => {
        $(impl From<$unit> for StatedUnit {
            fn from(unit: $unit) -> Self {
                Self { name: unit.name(), factor: unit.factor() }
            }
        })+
    };
}

stated!(PositionUnit, VelocityUnit, TorqueUnit, CurrentUnit);

/// How a column names its joint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Label {
    /// Not at all.
    Unnamed,
    /// By number.
    Number(u32),
    /// By name.
    Name(String),
}

/// What a column name says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Meaning {
    pub(super) quantity: Quantity,
    pub(super) label: Label,
    /// `None` if the name is silent.
    pub(super) unit: Option<StatedUnit>,
}
