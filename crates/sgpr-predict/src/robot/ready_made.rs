//! Robots of the literature, ready to use.

use core::f64::consts::FRAC_PI_2;

use super::{DhConvention, DhRow, Limits, Robot, STANDARD_GRAVITY};
use crate::spatial::Vector3;

fn symmetric(limit: f64, velocity: f64) -> Limits {
    Limits { position: Some([-limit, limit]), velocity: Some(velocity), effort: None }
}

fn diagonal(x: f64, y: f64, z: f64) -> [[f64; 3]; 3] {
    [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
}

/// The Unimation PUMA 560, six revolute joints, base upright; rigid body only.
///
/// Choices where sources differ: the centre of mass of link 4 is (0, 0.019, 0) m as in Corke's
/// toolbox (the thesis prints 0.0019); the offset of link 3 is d = +0.15005 m as in the thesis's
/// code listing (its table prints a minus sign). Links 1 and 3 have inertias that no single body
/// can have; they are the published values, and the base parameters they combine to are realisable.
///
/// Source: P. I. Corke, B. Armstrong-Hélouvry, A search for consensus among model parameters
/// reported for the PUMA 560 robot, IEEE ICRA (1994); limits from S. Krishnamoorthi, MSc thesis, TU
/// Delft (2018), table 5-5.
pub fn puma560() -> Robot {
    let body = |a, alpha, d, mass, com, inertia, limit| {
        DhRow::revolute(a, alpha, d, 0.0)
            .with_body(mass, com, inertia)
            .with_limits(symmetric(limit, 5.0))
    };
    let rows = [
        body(0.0, FRAC_PI_2, 0.0, 0.0, [0.0; 3], diagonal(0.0, 0.35, 0.0), 2.79),
        body(0.4318, 0.0, 0.0, 17.4, [-0.3638, 0.006, 0.2275], diagonal(0.13, 0.524, 0.539), 3.92),
        body(
            0.0203,
            -FRAC_PI_2,
            0.15005,
            4.8,
            [-0.0203, -0.0141, 0.07],
            diagonal(0.066, 0.086, 0.0125),
            0.78,
        ),
        body(
            0.0,
            FRAC_PI_2,
            0.4318,
            0.82,
            [0.0, 0.019, 0.0],
            diagonal(0.0018, 0.0013, 0.0018),
            2.96,
        ),
        body(0.0, -FRAC_PI_2, 0.0, 0.34, [0.0; 3], diagonal(0.0003, 0.0004, 0.0003), 1.74),
        body(0.0, 0.0, 0.0, 0.09, [0.0, 0.0, 0.032], diagonal(0.00015, 0.00015, 0.00004), 4.64),
    ];
    Robot::from_dh("puma560", DhConvention::Standard, &rows, None, STANDARD_GRAVITY)
        .expect("a valid table")
}

/// The two-link arm of the thesis: two links of 1 m and 1 kg with the mass in the middle; rigid
/// body only.
///
/// The thesis does not say how the arm stands, and counts four base parameters. Here it moves in a
/// vertical plane, gravity along -y of the base, which makes six. Under `with_gravity` along z, the
/// joint axes, gravity does no work and there are four.
///
/// Source: S. Krishnamoorthi, MSc thesis, TU Delft (2018), tables 5-2, 5-4.
pub fn two_link() -> Robot {
    let row = DhRow::revolute(1.0, 0.0, 0.0, 0.0)
        .with_body(1.0, [-0.5, 0.0, 0.0], [[0.0; 3]; 3])
        .with_limits(symmetric(FRAC_PI_2, 2.0));
    let gravity = Vector3::new(0.0, -9.81, 0.0);
    Robot::from_dh("two_link", DhConvention::Standard, &[row.clone(), row], None, gravity)
        .expect("a valid table")
}
