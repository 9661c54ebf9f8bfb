use alloc::vec::Vec;

use super::{About, Class, Constant, Effect, Entry, Origin, Reach, Site, facts};
use crate::robot::Robot;
use crate::spatial::Vector3;

/// A joint that sits elsewhere on its parent link than the robot file says, by (dx, dy, dz) in the
/// parent's axes. A refit absorbs nearly all of it.
///
/// Source: W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), section 11,
/// geometric calibration.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkLengthError;

const CONSTANTS: [Constant; 3] = [
    Constant::neutral_at_zero("dx", ["m", "m"], [-0.3, 0.3], 1e-4),
    Constant::neutral_at_zero("dy", ["m", "m"], [-0.3, 0.3], 1e-4),
    Constant::neutral_at_zero("dz", ["m", "m"], [-0.3, 0.3], 1e-4),
];

impl Effect for LinkLengthError {
    facts! {
        name: "link_length_error",
        summary: "A link whose length the robot file has wrong.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        reach: Reach::All,
        is_generic: true,
        is_of_arm: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "placement of joint j moved by (dx, dy, dz)",
            source: "W. Khalil, E. Dombre, Modeling, Identification and Control of Robots (2002), \
                 section 11, geometric calibration.",
            signature: "like an inertial parameter that changes with the pose",
            confusable: &["link_inertia_error", "encoder_offset"],
            experiment: "a known payload, or better an external measurement of position",
            excitation: "fast motion of the joints before and after, or a known payload",
            origin: Origin::Arm,
            origin_reason: "the link has this length",
            ..About::default()
        }
    }

    fn sites(&self, robot: &Robot) -> Vec<Site> {
        (1..robot.dof()).map(Site::Joint).collect()
    }

    fn robot(&self, site: Site, constants: &[f64], robot: Robot) -> Robot {
        let joint = site.joint().expect("at a joint");
        let shift = Vector3::new(constants[0], constants[1], constants[2]);
        robot.with_placement_moved(joint, shift)
    }
}
