//! The momentum of the links, and how it changes with the configuration.

use alloc::vec::Vec;

use super::body::Body;
use super::rnea::rnea_kernel;
use crate::robot::{Chain, Robot};
use crate::simd::{Dual, Number};
use crate::spatial::Vector3;

/// Buffers for [`Self::run`], made once for a robot.
#[derive(Debug)]
pub(crate) struct Momentum<T: Number> {
    /// Without gravity, so that its torque of an acceleration at rest is M(q) times it.
    weightless: Chain<T::Constant>,
    /// Derivatives along the motion.
    bodies: Vec<Body<Dual<T, 1>>>,
}

impl<T: Number> Momentum<T> {
    pub fn new(robot: &Robot) -> Self {
        let weightless = robot.clone().with_gravity(Vector3::ZERO);
        Self { weightless: weightless.chain().of::<T>(), bodies: vec![Body::zero(()); robot.dof()] }
    }

    /// The momentum p = M(q) dq, and dM/dt dq: what it changes by per second as the arm moves on at
    /// dq.
    ///
    /// - all `[n]`
    pub fn run(&mut self, q: &[T], dq: &[T], momentum: &mut [T], change: &mut [T]) {
        for ((body, q), dq) in self.bodies.iter_mut().zip(q).zip(dq) {
            let (sine, cosine) = q.sin_cos();
            body.q = Dual { value: *q, slope: [*dq] };
            body.sin = body.q.chain(sine, cosine);
            body.cos = body.q.chain(cosine, -sine);
            body.dq = Dual::variable(T::zero(()), None);
            body.ddq = Dual::variable(*dq, None);
        }
        rnea_kernel((), &self.weightless, &mut self.bodies);
        for ((body, momentum), change) in self.bodies.iter().zip(momentum).zip(change) {
            (*momentum, [*change]) = (body.tau.value, body.tau.slope);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Workspace, mass_matrix};
    use crate::robot::puma560;
    use crate::simd::Single;

    #[test]
    fn it_is_the_mass_matrix_times_the_velocity_and_changes_as_that_does() {
        const STEP: f64 = 1e-5;
        let robot = puma560();
        let (q, dq) = ([0.3, -0.8, 1.1, 0.4, -0.6, 0.9], [0.7, -1.2, 0.5, 2.0, -0.4, 1.1]);
        let mut ws = Workspace::new(&robot);
        let mut of_matrix = |time: f64| -> Vec<f64> {
            let at: Vec<f64> = q.iter().zip(&dq).map(|(q, dq)| q + time * dq).collect();
            let matrix = mass_matrix(&robot, &mut ws, &at);
            matrix.chunks(6).map(|row| row.iter().zip(&dq).map(|(m, dq)| m * dq).sum()).collect()
        };
        let (now, before, after) = (of_matrix(0.0), of_matrix(-STEP), of_matrix(STEP));
        let [mut momentum, mut change] = [[0.0; 6]; 2];
        Momentum::new(&robot).run(&q, &dq, &mut momentum, &mut change);
        let [mut single, mut single_change] = [[Single::default(); 6]; 2];
        let [single_q, single_dq] = [q, dq].map(|all| all.map(Single::constant));
        Momentum::new(&robot).run(&single_q, &single_dq, &mut single, &mut single_change);
        for joint in 0..6 {
            let expected = (after[joint] - before[joint]) / (2.0 * STEP);
            assert!((momentum[joint] - now[joint]).abs() < 1e-13, "{momentum:?} {now:?}");
            assert!(
                (change[joint] - expected).abs() < 1e-8,
                "joint {joint}: {} {expected}",
                change[joint]
            );
            assert!((f64::from(single[joint]) - momentum[joint]).abs() < 1e-5);
            assert!((f64::from(single_change[joint]) - change[joint]).abs() < 1e-5);
        }
    }
}
