//! What joints did in logs, as far as it is asked beside the equations.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::identification::Row;
use crate::motion::Motion;

/// Where a joint was, how fast it went, and how often each way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointExtent {
    /// Smallest and largest position, rad (m).
    pub position: [f64; 2],
    /// Largest speed in motion, rad/s (m/s).
    pub speed: f64,
    /// Largest acceleration in motion, rad/s² (m/s²).
    pub acceleration: f64,
    /// Samples in motion forwards and backwards.
    pub samples: [usize; 2],
}

impl JointExtent {
    /// Of each joint in some motions.
    pub(super) fn of(motions: &[Arc<Motion>], joints: usize) -> Vec<Self> {
        let mut extents = vec![
            Self {
                position: [f64::MAX, f64::MIN],
                speed: 0.0,
                acceleration: 0.0,
                samples: [0; 2]
            };
            joints
        ];
        for motion in motions {
            for (k, use_as) in motion.use_as.iter().enumerate() {
                let extent = &mut extents[k % joints];
                extent.position =
                    [extent.position[0].min(motion.q[k]), extent.position[1].max(motion.q[k])];
                if *use_as == Row::Moving {
                    let speed = motion.dq[k];
                    extent.speed = extent.speed.max(speed.abs());
                    extent.acceleration = extent.acceleration.max(motion.ddq[k].abs());
                    if speed != 0.0 {
                        extent.samples[usize::from(speed < 0.0)] += 1;
                    }
                }
            }
        }
        extents
    }

    /// Takes in what the joint did in another log.
    pub(super) fn add(&mut self, other: &Self) {
        self.position =
            [self.position[0].min(other.position[0]), self.position[1].max(other.position[1])];
        self.speed = self.speed.max(other.speed);
        self.acceleration = self.acceleration.max(other.acceleration);
        self.samples = [0, 1].map(|way| self.samples[way] + other.samples[way]);
    }
}
