//! Recursions over one sample, compiled for the machine: with its fused instructions where the
//! feature `simd` is on.

#[cfg(not(feature = "simd"))]
mod plain;
#[cfg(feature = "simd")]
mod widest;

#[cfg(not(feature = "simd"))]
pub(super) use plain::Machine;
#[cfg(feature = "simd")]
pub(super) use widest::Machine;

use super::scratch::{LoneNumber, OnOneSample, Scratch};
use crate::robot::Robot;

/// Joint positions, and where their sines and cosines go, `[n]` each.
pub(super) struct Positions<'a> {
    pub q: &'a [f64],
    pub sin: &'a mut [f64],
    pub cos: &'a mut [f64],
}

/// Runs an algorithm with the joint positions set, and their sines and cosines.
#[inline(always)]
fn run_on<T: LoneNumber>(
    robot: &Robot,
    scratch: &mut Scratch<T>,
    at: &Positions<'_>,
    algorithm: impl OnOneSample,
) {
    for (k, body) in scratch.bodies.iter_mut().enumerate() {
        body.q = T::splat((), at.q[k]);
        body.sin = T::splat((), at.sin[k]);
        body.cos = T::splat((), at.cos[k]);
    }
    algorithm.run(robot, scratch);
}
