use alloc::boxed::Box;
use alloc::vec::Vec;

use crate::stream::Predictor;

/// A torque model as a controller uses it: parametric, non-parametric or both.
pub trait InverseDynamics: Send {
    /// Adds the torque of a motion to `tau`, `[n]`, N·m (N).
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]);
}

impl<F: FnMut(&[f64], &[f64], &[f64], &mut [f64]) + Send> InverseDynamics for F {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self(q, dq, ddq, tau);
    }
}

impl InverseDynamics for Predictor {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        tau.iter_mut().zip(self.torque(q, dq, ddq)).for_each(|(tau, more)| *tau += more);
    }
}

/// Models on top of each other: an internal model and what compensates it.
impl InverseDynamics for Vec<Box<dyn InverseDynamics>> {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        for model in self {
            model.add_torque(q, dq, ddq, tau);
        }
    }
}

impl InverseDynamics for Box<dyn InverseDynamics> {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        (**self).add_torque(q, dq, ddq, tau);
    }
}
