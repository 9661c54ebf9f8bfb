use super::super::predictor::Predictor;
use super::{SemiParametricError, SemiParametricModel};
use crate::gp::{GpPredictor, PredictorOptions};

/// Torque of one sample after the other, for a controller: physics and processes. Owns its buffers, allocates nothing,
/// takes no lock, can move to another thread, and its work does not depend on the sample.
///
/// Source: thesis eqs. 4-17 and 4-21, the feed-forward torque.
#[derive(Debug)]
pub struct SemiParametricPredictor {
    physics: Predictor,
    /// Process, noise variance and calibration of each joint.
    joints: Vec<(Option<GpPredictor>, f64, f64)>,
    x: Vec<f64>,
    tau: Vec<f64>,
    deviation: Vec<f64>,
}

impl SemiParametricPredictor {
    /// The only place that allocates.
    ///
    /// # Errors
    /// If the variance needs more memory than allowed.
    pub fn new(model: &SemiParametricModel, options: PredictorOptions) -> Result<Self, SemiParametricError> {
        let n = model.physics.robot().dof();
        let mut joints = Vec::with_capacity(n);
        for rest in &model.joints {
            let process = rest.gp.as_ref().map(|gp| GpPredictor::new(gp, options)).transpose()?;
            joints.push((process, rest.noise_variance, rest.report.calibration));
        }
        let physics = Predictor::new(&model.physics);
        Ok(Self { physics, joints, x: vec![0.0; 3 * n + 1], tau: vec![0.0; n], deviation: vec![0.0; n] })
    }

    /// Torque that the motion needs.
    ///
    /// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
    /// - returns `[n]`, N·m (N)
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> &[f64] {
        self.set(q, dq, ddq);
        for ((process, _, _), tau) in self.joints.iter_mut().zip(&mut self.tau) {
            if let Some(process) = process {
                *tau += process.mean(&self.x)[0];
            }
        }
        &self.tau
    }

    /// Torque, and the standard deviation of its measurement, `[n]` each, N·m (N).
    ///
    /// # Panics
    /// If a slice is not of length n, or the predictor was made without variance.
    pub fn torque_and_deviation(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> (&[f64], &[f64]) {
        self.set(q, dq, ddq);
        let results = self.tau.iter_mut().zip(&mut self.deviation);
        for ((process, noise, calibration), (tau, deviation)) in self.joints.iter_mut().zip(results) {
            let mut variance = *noise;
            if let Some(process) = process {
                let (mean, unexplained) = process.mean_and_variance(&self.x);
                *tau += mean[0];
                variance += unexplained;
            }
            *deviation = *calibration * variance.sqrt();
        }
        (&self.tau, &self.deviation)
    }

    fn set(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) {
        self.tau.copy_from_slice(self.physics.torque(q, dq, ddq));
        let n = self.tau.len();
        for (part, x) in [q, dq, ddq].into_iter().zip(self.x.chunks_exact_mut(n)) {
            x.copy_from_slice(part);
        }
    }
}
