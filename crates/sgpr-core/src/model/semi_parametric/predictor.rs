use sgpr_predict::internal::{BasisParts, ResidualJoint, ResidualPredictor, together};
use sgpr_predict::model::StreamedModel;

use super::super::{Predictor, StreamOptions};
use super::process::Process;
use super::{SemiParametricError, SemiParametricModel};
use crate::gp::PredictorOptions;

impl SemiParametricModel {
    /// Torque of one sample after the other, for a controller: physics and processes, which hold
    /// what the physics leaves of the logs, whatever it is a property of. Joints whose processes
    /// have the same points are computed together; so is a kernel that they share.
    ///
    /// Source: thesis eqs. 4-17 and 4-21, the feed-forward torque.
    ///
    /// - `options`: of the processes; with any variance the predictor knows how sure a torque is
    ///
    /// # Errors
    /// If the variance needs more memory than allowed; as [`super::super::TorqueModel::predictor`].
    pub fn predictor(
        &self,
        options: PredictorOptions,
        stream: &StreamOptions,
    ) -> Result<Predictor, SemiParametricError> {
        let sums: Vec<_> = self
            .joints
            .iter()
            .map(|residual| residual.gp.as_ref().map(Process::weighted_kernel))
            .collect();
        let together = together(&sums, options.precision);
        let with_variance = options.variance_rank != Some(0);
        let mut joints = Vec::with_capacity(self.joints.len());
        for (index, residual) in self.joints.iter().enumerate() {
            let alone = !together.iter().any(|(members, _)| members.contains(&index));
            let wanted = residual.gp.as_ref().filter(|_| with_variance || alone);
            joints.push(ResidualJoint {
                process: wanted.map(|gp| gp.predictor(options)).transpose()?,
                learned: residual.gp.is_some(),
                noise_variance: residual.noise_variance,
                prior: residual.gp.as_ref().map_or(1.0, |gp| gp.covariance().signal.variance()),
                calibration: residual.report.calibration,
            });
        }
        let basis = self.basis.as_ref().filter(|_| with_variance).map(|basis| BasisParts {
            independent: self.physics.base().independent().to_vec(),
            covariance: basis.covariance_by_rows(),
            explained: basis.explained(&self.joints),
        });
        let identified =
            self.identified.as_ref().map(|identified| identified.predictor(stream)).transpose()?;
        let residual = ResidualPredictor::new(
            &StreamedModel::from(&self.physics),
            joints,
            together,
            basis,
            with_variance,
        );
        Ok(self.physics.predictor(stream)?.with_residual(residual, identified))
    }
}
