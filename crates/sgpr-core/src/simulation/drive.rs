//! What turns a joint: rotor and friction.

use derive_setters::Setters;

use super::SimulationError;
use crate::robot::Robot;

/// Rotor and friction of one joint, all seen at the joint: rad, N·m (m, N for a sliding joint).
///
/// Friction torque against a motion in direction s = ±1 with speed v:
/// Fv v + Fc(s) + (Fs(s) - Fc(s)) exp(-(v / vs)²); at rest anything between -Fs(-1) and Fs(+1).
///
/// Source: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools
/// and compensation methods for the control of machines with friction, Automatica 30(7) (1994),
/// section 2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Drive {
    /// Inertia Ia = gear ratio² · motor inertia, kg·m².
    pub rotor_inertia: f64,
    /// Fv, N·m·s/rad.
    pub viscous_friction: f64,
    /// Sizes Fc forwards and backwards, N·m.
    pub coulomb_friction: [f64; 2],
    /// Sizes Fs at rest, forwards and backwards, N·m; below the Coulomb friction it counts as equal
    /// to it.
    pub static_friction: [f64; 2],
    /// vs, rad/s: speed at which a third of the way from static to Coulomb friction is left. Zero:
    /// none above rest.
    pub stribeck_velocity: f64,
}

/// A motor with its gear, as data sheets give it: on the motor side.
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Motor {
    /// kg·m².
    pub inertia: f64,
    /// N·m·s/rad.
    pub viscous_friction: f64,
    /// Sizes forwards and backwards (of the joint), N·m.
    pub coulomb_friction: [f64; 2],
    /// Turns of the motor per turn of the joint; its sign does not matter here.
    pub gear_ratio: f64,
}

impl Motor {
    /// A motor without friction.
    pub fn new(inertia: f64, gear_ratio: f64) -> Self {
        Self { inertia, viscous_friction: 0.0, coulomb_friction: [0.0; 2], gear_ratio }
    }
}

impl Drive {
    /// A drive as seen through the gear: inertia and viscous friction times ratio², Coulomb
    /// friction times |ratio|.
    ///
    /// Source: P. I. Corke, Robotics Toolbox for MATLAB, `Link.friction`, whose directions are the
    /// joint's too.
    pub fn geared(motor: &Motor) -> Self {
        let ratio = motor.gear_ratio.abs();
        let coulomb = motor.coulomb_friction.map(|size| size.abs() * ratio);
        Self {
            rotor_inertia: motor.inertia * ratio * ratio,
            viscous_friction: motor.viscous_friction * ratio * ratio,
            coulomb_friction: coulomb,
            static_friction: coulomb,
            stribeck_velocity: 0.0,
        }
    }

    /// With static friction `ratio` times the Coulomb friction, falling off around
    /// `stribeck_velocity`.
    #[must_use]
    pub fn with_stiction(mut self, ratio: f64, stribeck_velocity: f64) -> Self {
        self.static_friction = self.coulomb_friction.map(|size| size * ratio);
        self.stribeck_velocity = stribeck_velocity;
        self
    }

    /// Whether there is dry friction in any direction.
    pub(super) fn has_dry_friction(&self) -> bool {
        self.coulomb_friction.iter().chain(&self.static_friction).any(|size| *size > 0.0)
    }

    /// Largest friction at rest against a push forwards (0) or backwards (1).
    #[inline]
    pub(super) fn holding(&self, direction: usize) -> f64 {
        self.static_friction[direction].max(self.coulomb_friction[direction])
    }

    /// Dry friction of a motion forwards (0) or backwards (1) with this speed, as a size.
    #[inline]
    pub(super) fn sliding(&self, direction: usize, speed: f64) -> f64 {
        let coulomb = self.coulomb_friction[direction];
        let extra = self.static_friction[direction] - coulomb;
        if extra <= 0.0 || self.stribeck_velocity <= 0.0 {
            return coulomb;
        }
        let ratio = speed / self.stribeck_velocity;
        coulomb + extra * (-ratio * ratio).exp()
    }

    /// Friction torque of a motion, viscous part included; zero at rest.
    pub fn friction(&self, velocity: f64) -> f64 {
        let dry = if velocity > 0.0 {
            self.sliding(0, velocity)
        } else if velocity < 0.0 {
            -self.sliding(1, -velocity)
        } else {
            0.0
        };
        dry + self.viscous_friction * velocity
    }
}

pub(super) fn require_valid(robot: &Robot, drives: &[Drive]) -> Result<(), SimulationError> {
    if drives.len() != robot.dof() {
        return Err(SimulationError::Length {
            what: "drives",
            expected: robot.dof(),
            found: drives.len(),
        });
    }
    for (joint, drive) in robot.joint_names().zip(drives) {
        let [forwards, backwards] = drive.coulomb_friction;
        let [hold_forwards, hold_backwards] = drive.static_friction;
        let fields = [
            ("rotor inertia", drive.rotor_inertia),
            ("viscous friction", drive.viscous_friction),
            ("forward Coulomb friction", forwards),
            ("backward Coulomb friction", backwards),
            ("forward static friction", hold_forwards),
            ("backward static friction", hold_backwards),
            ("Stribeck velocity", drive.stribeck_velocity),
        ];
        if let Some((quantity, value)) =
            fields.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite()))
        {
            return Err(SimulationError::InvalidDrive { joint: joint.into(), quantity, value });
        }
    }
    Ok(())
}

/// Drives of the [`puma560`](crate::robot::puma560): rotors, viscous and direction-dependent
/// Coulomb friction.
///
/// Source: S. Krishnamoorthi, MSc thesis, TU Delft (2018), table 5-1, after P. I. Corke, B.
/// Armstrong-Hélouvry, IEEE ICRA (1994).
pub fn puma560_drives() -> Vec<Drive> {
    let rows = [
        (2e-4, 1.48e-3, [0.395, 0.435], -62.61),
        (2e-4, 8.17e-4, [0.126, 0.071], 107.8),
        (2e-4, 1.38e-3, [0.132, 0.105], -53.79),
        (3.3e-5, 7.12e-5, [0.0112, 0.0169], 76.04),
        (3.3e-5, 8.26e-5, [0.00926, 0.0145], 71.92),
        (3.3e-5, 3.67e-5, [0.00396, 0.0105], 76.69),
    ];
    geared(&rows)
}

/// Drives of the [`two_link`](crate::robot::two_link) arm.
///
/// Source: S. Krishnamoorthi, MSc thesis, TU Delft (2018), table 5-2.
pub fn two_link_drives() -> Vec<Drive> {
    geared(&[(2e-4, 5e-4, [0.1, 0.1], -20.61), (2e-4, 2.5e-4, [0.05, 0.03], 20.82)])
}

fn geared(rows: &[(f64, f64, [f64; 2], f64)]) -> Vec<Drive> {
    rows.iter()
        .map(|&(inertia, viscous_friction, coulomb_friction, gear_ratio)| {
            Drive::geared(&Motor { inertia, viscous_friction, coulomb_friction, gear_ratio })
        })
        .collect()
}
