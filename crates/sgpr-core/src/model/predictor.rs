use super::TorqueModel;
use crate::dynamics::{Samples, Workspace, rnea};
use crate::effects::JointState;

/// Torque of one sample after the other, for a controller: owns its buffers, allocates nothing, takes no lock, and can
/// move to another thread.
///
/// A model with effects at single sites ([`TorqueModel::terms`]) is asked by [`TorqueModel::predict`] instead: that takes
/// memory, and effects that need time, a sampling rate or the samples before are as at the start of a motion.
///
/// # Examples
/// ```
/// use sgpr_core::{model::{Predictor, TorqueModel}, robot::puma560};
/// let model = TorqueModel::nominal(&puma560());
/// let mut predictor = Predictor::new(&model);
/// let tau = predictor.torque(&[0.1; 6], &[0.0; 6], &[0.0; 6]);
/// assert_eq!(tau.len(), 6);
/// ```
#[derive(Debug)]
pub struct Predictor {
    model: TorqueModel,
    ws: Workspace,
    tau: Vec<f64>,
}

impl Predictor {
    /// The only place that allocates.
    pub fn new(model: &TorqueModel) -> Self {
        Self { ws: Workspace::new(&model.dynamics), tau: vec![0.0; model.robot.dof()], model: model.clone() }
    }

    /// Torque that the motion needs.
    ///
    /// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
    /// - returns `[n]`, N·m (N)
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> &[f64] {
        let Self { model, ws, tau } = self;
        if !model.terms.is_empty() {
            tau.copy_from_slice(&model.predict(Samples { q, dq, ddq }));
            return tau;
        }
        tau.copy_from_slice(rnea(&model.dynamics, ws, q, dq, ddq));
        model.set.add_effect_torque(&model.parameters, &JointState { q, dq, ddq }, tau);
        tau
    }
}
