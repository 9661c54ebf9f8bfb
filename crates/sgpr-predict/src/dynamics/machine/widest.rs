use std::any::Any;

use pulp::{Arch, Simd, WithSimd};

use super::{LoneNumber, OnOneSample, Positions, Robot, Scratch, run_on};
use crate::simd::{Fused, sin_cos_slice};

/// The instructions of the machine that the program runs on.
#[derive(Debug)]
pub(in super::super) struct Machine {
    arch: Arch,
    scratch: Box<dyn Any + Send>,
}

impl Machine {
    pub fn new(dof: usize) -> Self {
        let arch = arch_for_one_sample();
        Self { arch, scratch: arch.dispatch(NewScratch { dof }) }
    }

    /// Runs `algorithm` with the joint positions set.
    #[inline(always)]
    pub fn run(&mut self, robot: &Robot, at: Positions<'_>, algorithm: impl OnOneSample) {
        self.arch.dispatch(Run { robot, at, scratch: &mut *self.scratch, algorithm });
    }
}

/// One sample has no use for registers of eight: with them the compiler packs unrelated numbers
/// together, and the recursions took 1.2 to 1.5 times as long on an AVX-512 machine.
fn arch_for_one_sample() -> Arch {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(v4) => Arch::V3(*v4),
        arch => arch,
    }
}

struct NewScratch {
    dof: usize,
}

impl WithSimd for NewScratch {
    type Output = Box<dyn Any + Send>;

    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        if S::IS_SCALAR {
            Box::new(Scratch::<f64>::new((), self.dof))
        } else {
            Box::new(Scratch::<Fused>::new((), self.dof))
        }
    }
}

struct Run<'a, A> {
    robot: &'a Robot,
    at: Positions<'a>,
    scratch: &'a mut (dyn Any + Send),
    algorithm: A,
}

impl<A: OnOneSample> Run<'_, A> {
    #[inline(always)]
    fn with_scalar<T: LoneNumber>(self) {
        let scratch = self
            .scratch
            .downcast_mut::<Scratch<T>>()
            .expect("made in `Machine::new` for the same instruction set");
        run_on(self.robot, scratch, &self.at, self.algorithm);
    }
}

impl<A: OnOneSample> WithSimd for Run<'_, A> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        sin_cos_slice(simd, self.at.q, self.at.sin, self.at.cos);
        if S::IS_SCALAR { self.with_scalar::<f64>() } else { self.with_scalar::<Fused>() }
    }
}
