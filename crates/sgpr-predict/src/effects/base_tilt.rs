use alloc::vec::Vec;

use super::{About, Class, Constant, Effect, Entry, Origin, Reach, Site, facts};
use crate::robot::Robot;
use crate::spatial::Matrix3;

/// A base that does not stand upright: gravity turned in base axes by a roll about x and a pitch
/// about y.
///
/// Source: common in calibration; W. Khalil, E. Dombre, Modeling, Identification and Control of
/// Robots (2002), section 9.3, with gravity as a parameter.
#[derive(Clone, Copy, Debug)]
pub(super) struct BaseTilt;

/// How level a base is set up before any data, rad: with a spirit level or by eye, within a degree
/// or two.
const LEVEL: f64 = 0.03;

const CONSTANTS: [Constant; 2] = [
    Constant::neutral_at_zero("roll", ["rad", "rad"], [-0.35, 0.35], 1e-4).expected_within(LEVEL),
    Constant::neutral_at_zero("pitch", ["rad", "rad"], [-0.35, 0.35], 1e-4).expected_within(LEVEL),
];

impl Effect for BaseTilt {
    facts! {
        name: "base_tilt",
        summary: "The base does not stand upright.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        is_generic: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "g_base = R(roll, pitch)ᵀ g",
            source: "common in calibration; W. Khalil, E. Dombre, Modeling, Identification and \
                 Control of Robots (2002), section 9.3, with gravity as a parameter.",
            signature: "torque of a vertical first joint, which should have none, follows the sine \
                 of its position",
            confusable: &["cable_stiffness", "torque_offset"],
            experiment: "joint 1 over a whole turn with the arm stretched out",
            excitation: "the first joint moves by a radian or more",
            origin: Origin::Arm,
            origin_reason: "gravity leans in control as in the log",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<Site> {
        vec![Site::Arm]
    }

    fn robot(&self, _: Site, constants: &[f64], robot: Robot) -> Robot {
        let tilt = Matrix3::from_roll_pitch_yaw([constants[0], constants[1], 0.0]);
        let gravity = tilt.transposed() * robot.gravity();
        robot.with_gravity(gravity)
    }
}
