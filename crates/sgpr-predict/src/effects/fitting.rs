//! What those who fit constants ask of effects.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::{Constant, Dimension, Effect, Role, Scale, registry};

/// What is smaller, N·m (N), is rounding of zero; its square would vanish beside any other number.
pub const SMALLEST_TORQUE: f64 = 1e-30;

impl Constant {
    /// Values to start from, in its unit.
    #[doc(hidden)]
    pub fn grid_in(&self, ranges: &JointRanges) -> Vec<f64> {
        let [low, high] = ranges.position;
        let scaled = |x: &f64| match self.scale {
            Scale::Position => low + x * (high - low),
            Scale::PositionWidth => x * (high - low),
            Scale::Torque => x * ranges.torque,
            _ => *x,
        };
        self.grid.iter().map(scaled).collect()
    }

    /// Lowest and highest value, in its unit.
    #[doc(hidden)]
    pub fn bounds_in(&self, ranges: &JointRanges) -> [f64; 2] {
        let [low, high] = ranges.position;
        match self.scale {
            Scale::Position => [low, high],
            Scale::PositionWidth => [self.low, self.high].map(|x| x * (high - low)),
            Scale::Torque => [self.low, self.high].map(|x| x * ranges.torque),
            Scale::Time => ranges.time,
            // A resonance beyond the band would be seen by its foot alone.
            _ if self.dimension() == Dimension::Frequency => {
                [self.low, self.high.min(0.6 * ranges.band_hz).max(self.low)]
            }
            _ => [self.low, self.high],
        }
    }

    /// A change of the constant that is small against what can be noticed.
    #[doc(hidden)]
    pub fn difference_step(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Neutral { step } => step,
            Scale::Time => 0.05,
            Scale::Order => 0.01,
            _ => 0.02 * value.abs().max(0.05),
        }
    }
}

/// Every point of which each coordinate is one of its grid's values, the last coordinate fastest.
pub fn points_of(grids: &[Vec<f64>]) -> Vec<Vec<f64>> {
    grids.iter().fold(vec![vec![]], |points, grid| {
        points
            .iter()
            .flat_map(|point| grid.iter().map(move |x| [&point[..], &[*x]].concat()))
            .collect()
    })
}

/// What the logs show of a joint: the range that constants on its scales have.
#[derive(Clone, Copy, Debug)]
pub struct JointRanges {
    /// Lowest and highest position, rad (m).
    pub position: [f64; 2],
    /// Root mean square torque, N·m (N).
    pub torque: f64,
    /// Largest torque, N·m (N).
    pub largest_torque: f64,
    /// First and last time of the session, s.
    pub time: [f64; 2],
    /// Cut-off of the equations, Hz.
    pub band_hz: f64,
}

/// The effect of the library that plays a part.
pub fn with_role(role: Role) -> Arc<dyn Effect> {
    registry()
        .into_iter()
        .find(|effect| effect.role() == Some(role))
        .expect("every part has its effect")
}
