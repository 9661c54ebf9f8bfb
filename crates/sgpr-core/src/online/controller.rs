use super::OnlineModel;
use crate::simulation::{Controller, FeedForward, Gains, Measurement, Setpoint};

/// Feed-forward of a model that learns while it runs: u = model(q_d, dq_d, ddq_d) + Kp (q_d - q) +
/// Kd (dq_d - dq).
///
/// The torque commanded last stands for the measured one. A sample that is not finite is left out.
#[derive(Debug)]
pub struct AdaptiveFeedForward {
    law: FeedForward<OnlineModel>,
    last: Vec<f64>,
    commanded: bool,
}

impl AdaptiveFeedForward {
    /// With a model that is updated once per call.
    pub fn new(model: OnlineModel, gains: Gains) -> Self {
        Self {
            last: vec![0.0; gains.kp.len()],
            law: FeedForward { model, gains },
            commanded: false,
        }
    }

    /// The model as it is now.
    pub fn model(&self) -> &OnlineModel {
        &self.law.model
    }
}

impl Controller for AdaptiveFeedForward {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        if self.commanded {
            // Refused samples leave the model as it is; the simulator says what is wrong with the
            // arm.
            let _refused = self.law.model.update(measured.q, &self.last);
        }
        self.law.torque(measured, wanted, tau);
        self.last.copy_from_slice(tau);
        self.commanded = true;
    }
}
