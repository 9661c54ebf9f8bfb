//! Dynamics of whole logs: one sample per register lane.

use std::any::Any;

use pulp::{Arch, Simd, WithSimd};

use super::body::Body;
use super::regressor::regressor_kernel;
use super::rnea::rnea_kernel;
use super::scratch::Scratch;
use crate::robot::Robot;
use crate::simd::{Lanes, MAX_LANES, Transpose, sin_cos_slice};
use crate::spatial::PARAMETERS_PER_LINK;

/// Joint motion of many samples, each slice `[samples, n]` row-major, SI.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Positions, rad (m).
    pub q: &'a [f64],
    /// Velocities, rad/s (m/s).
    pub dq: &'a [f64],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a [f64],
}

impl Samples<'_> {
    /// Number of samples.
    ///
    /// # Panics
    /// If the slices differ in length or do not hold whole samples of `dof` joints.
    pub fn count(&self, dof: usize) -> usize {
        assert!(
            self.q.len() == self.dq.len()
                && self.q.len() == self.ddq.len()
                && self.q.len().is_multiple_of(dof),
            "positions, velocities and accelerations of the same samples"
        );
        self.q.len() / dof
    }
}

/// Every buffer that dynamics of many samples needs; made once for a robot. One per thread.
#[derive(Debug)]
pub struct BatchWorkspace {
    arch: Arch,
    dof: usize,
    scratch: Box<dyn Any + Send>,
}

impl BatchWorkspace {
    /// The only place that allocates.
    pub fn new(robot: &Robot) -> Self {
        let arch = Arch::new();
        Self { arch, dof: robot.dof(), scratch: arch.dispatch(NewLanes { dof: robot.dof() }) }
    }

    #[inline(always)]
    fn run<A: OnLanes>(&mut self, robot: &Robot, samples: Samples<'_>, algorithm: A) {
        assert_eq!(
            self.dof,
            robot.dof(),
            "the workspace was made for a robot with another number of joints"
        );
        let Self { arch, scratch, .. } = self;
        arch.dispatch(BatchRun { robot, samples, scratch: &mut **scratch, algorithm });
    }
}

/// Inverse dynamics of every sample, as [`rnea`](super::rnea).
///
/// - `tau`: `[samples, n]`, row-major, N·m (N)
///
/// # Panics
/// If the slices do not hold the same samples.
pub fn rnea_batch(robot: &Robot, ws: &mut BatchWorkspace, samples: Samples<'_>, tau: &mut [f64]) {
    assert_eq!(tau.len(), samples.q.len(), "one torque per position");
    samples.count(robot.dof());
    ws.run(robot, samples, InverseDynamicsOfBatch { tau });
}

/// Regressor of every sample, as [`regressor`](super::regressor): the rigid-body part of the
/// observation matrix W.
///
/// - `matrix`: `[samples * n, 10 n]`, row-major, rows sample by sample
///
/// # Panics
/// If the slices do not hold the same samples or `matrix` has another size.
pub fn regressor_batch(
    robot: &Robot,
    ws: &mut BatchWorkspace,
    samples: Samples<'_>,
    matrix: &mut [f64],
) {
    let n = robot.dof();
    let rows = samples.count(n) * n;
    assert_eq!(matrix.len(), rows * n * PARAMETERS_PER_LINK, "10 n columns per row");
    ws.run(robot, samples, RegressorOfBatch { matrix });
}

/// Calls `sink(joint, link, first, count, block)` for every pair where the joint carries the link
/// and every group of `count` samples from `first` on: `block[k][s]` is the regressor entry of
/// parameter k of the link at sample first + s.
///
/// `sink` should be `#[inline(always)]`; it becomes part of the recursion.
///
/// # Panics
/// If the slices do not hold the same samples.
pub fn for_each_regressor_block(
    robot: &Robot,
    ws: &mut BatchWorkspace,
    samples: Samples<'_>,
    sink: impl FnMut(usize, usize, usize, usize, &[[f64; MAX_LANES]; PARAMETERS_PER_LINK]),
) {
    samples.count(robot.dof());
    ws.run(robot, samples, LaneBlocks { sink });
}

/// A recursion over as many samples as a register has lanes.
trait OnLanes {
    fn run<S: Simd>(
        &mut self,
        simd: S,
        robot: &Robot,
        scratch: &mut Scratch<Lanes<S>>,
        first: usize,
        count: usize,
    );
}

struct InverseDynamicsOfBatch<'a> {
    tau: &'a mut [f64],
}

impl OnLanes for InverseDynamicsOfBatch<'_> {
    #[inline(always)]
    fn run<S: Simd>(
        &mut self,
        simd: S,
        robot: &Robot,
        scratch: &mut Scratch<Lanes<S>>,
        first: usize,
        count: usize,
    ) {
        let n = robot.dof();
        rnea_kernel(simd, robot.chain(), &mut scratch.bodies);
        for (joint, body) in scratch.bodies.iter().enumerate() {
            let mut lanes = [0.0; MAX_LANES];
            body.tau.store(&mut lanes[..S::F64_LANES]);
            for (k, value) in lanes[..count].iter().enumerate() {
                self.tau[(first + k) * n + joint] = *value;
            }
        }
    }
}

struct RegressorOfBatch<'a> {
    matrix: &'a mut [f64],
}

impl OnLanes for RegressorOfBatch<'_> {
    #[inline(always)]
    fn run<S: Simd>(
        &mut self,
        simd: S,
        robot: &Robot,
        scratch: &mut Scratch<Lanes<S>>,
        first: usize,
        count: usize,
    ) {
        let n = robot.dof();
        let Scratch { bodies, axes, .. } = scratch;
        let transpose = Transpose::new(simd, count, n * n * PARAMETERS_PER_LINK);
        let blocks = &mut self.matrix.as_chunks_mut::<PARAMETERS_PER_LINK>().0[first * n * n..]
            [..count * n * n];
        for sample in blocks.chunks_exact_mut(n * n) {
            for &block in robot.zero_blocks() {
                sample[block] = [0.0; PARAMETERS_PER_LINK];
            }
        }
        regressor_kernel(
            simd,
            robot.chain(),
            bodies,
            axes,
            #[inline(always)]
            |joint, link, block| {
                let start = ((first * n + joint) * n + link) * PARAMETERS_PER_LINK;
                transpose.write_rows(block, &mut self.matrix[start..]);
            },
        );
    }
}

struct LaneBlocks<F> {
    sink: F,
}

impl<F: FnMut(usize, usize, usize, usize, &[[f64; MAX_LANES]; PARAMETERS_PER_LINK])> OnLanes
    for LaneBlocks<F>
{
    #[inline(always)]
    fn run<S: Simd>(
        &mut self,
        simd: S,
        robot: &Robot,
        scratch: &mut Scratch<Lanes<S>>,
        first: usize,
        count: usize,
    ) {
        let Scratch { bodies, axes, .. } = scratch;
        regressor_kernel(
            simd,
            robot.chain(),
            bodies,
            axes,
            #[inline(always)]
            |joint, link, block| {
                let mut lanes = [[0.0; MAX_LANES]; PARAMETERS_PER_LINK];
                for (target, value) in lanes.iter_mut().zip(block) {
                    value.store(target);
                }
                (self.sink)(joint, link, first, count, &lanes);
            },
        );
    }
}

struct NewLanes {
    dof: usize,
}

impl WithSimd for NewLanes {
    type Output = Box<dyn Any + Send>;

    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        Box::new(LaneScratch {
            scratch: Scratch::<Lanes<S>>::new(simd, self.dof),
            angles: Angles::new::<S>(self.dof),
        })
    }
}

struct LaneScratch<S: Simd> {
    scratch: Scratch<Lanes<S>>,
    angles: Angles,
}

/// Joint positions of a register's samples, joint by joint.
struct Angles {
    q: Vec<f64>,
    sin: Vec<f64>,
    cos: Vec<f64>,
}

impl Angles {
    fn new<S: Simd>(dof: usize) -> Self {
        let zeros = vec![0.0; dof * S::F64_LANES];
        Self { q: zeros.clone(), sin: zeros.clone(), cos: zeros }
    }
}

struct BatchRun<'a, A> {
    robot: &'a Robot,
    samples: Samples<'a>,
    scratch: &'a mut (dyn Any + Send),
    algorithm: A,
}

impl<A: OnLanes> WithSimd for BatchRun<'_, A> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let LaneScratch { scratch, angles } = self
            .scratch
            .downcast_mut::<LaneScratch<S>>()
            .expect("made in `BatchWorkspace::new` for the same instruction set");
        let n = self.robot.dof();
        let width = S::F64_LANES;
        let samples = self.samples.q.len() / n;
        for first in (0..samples).step_by(width) {
            let count = width.min(samples - first);
            load(simd, &self.samples, first, count, &mut scratch.bodies, angles);
            self.algorithm.run(simd, self.robot, scratch, first, count);
        }
    }
}

/// Sets the joint motion of `count` samples, one per lane; idle lanes repeat the last.
#[inline(always)]
fn load<S: Simd>(
    simd: S,
    samples: &Samples<'_>,
    first: usize,
    count: usize,
    bodies: &mut [Body<Lanes<S>>],
    angles: &mut Angles,
) {
    let n = bodies.len();
    let width = S::F64_LANES;
    for joint in 0..n {
        let lanes = gather(samples.q, n, joint, first, count);
        angles.q[joint * width..][..width].copy_from_slice(&lanes[..width]);
    }
    sin_cos_slice(simd, &angles.q, &mut angles.sin, &mut angles.cos);
    for (joint, body) in bodies.iter_mut().enumerate() {
        let lane = joint * width..(joint + 1) * width;
        body.q = Lanes::load(simd, &angles.q[lane.clone()]);
        body.sin = Lanes::load(simd, &angles.sin[lane.clone()]);
        body.cos = Lanes::load(simd, &angles.cos[lane]);
        body.dq = Lanes::load(simd, &gather(samples.dq, n, joint, first, count)[..width]);
        body.ddq = Lanes::load(simd, &gather(samples.ddq, n, joint, first, count)[..width]);
    }
}

/// Values of one joint in `count` rows of a `[samples, n]` array; the last is repeated.
#[inline(always)]
fn gather(source: &[f64], n: usize, joint: usize, first: usize, count: usize) -> [f64; MAX_LANES] {
    let mut lanes = [0.0; MAX_LANES];
    for (k, lane) in lanes.iter_mut().enumerate() {
        *lane = source[(first + k.min(count - 1)) * n + joint];
    }
    lanes
}
