//! How much the residual of a model remembers.

use std::sync::Arc;

use rayon::prelude::*;

use super::experiment::torque_of;
use super::{IdentifyError, TorqueModel};
use crate::identification::{JointFactor, Memory, Row};
use crate::motion::{Motion, Processing};

/// Per factor: how many rows carry as much as one independent row, from the autocorrelation of the
/// residual up to where it drowns in its own noise.
pub(super) fn correlation(
    model: &TorqueModel,
    motions: &[Arc<Motion>],
    processing: &Processing,
    factors: &[JointFactor],
) -> Result<Vec<f64>, IdentifyError> {
    crate::threads::prepare();
    let n = model.robot.dof();
    let mut memories = vec![Memory::default(); factors.len()];
    for (index, motion) in motions.iter().enumerate() {
        let mut residual = torque_of(motion)?.to_vec();
        residual
            .iter_mut()
            .zip(model.predict_motion(motion))
            .for_each(|(tau, predicted)| *tau -= predicted);
        if let Some(filter) = processing.band_filter(motion.rate_hz)? {
            filter.apply(&mut residual, n)?;
        }
        memories.par_iter_mut().zip(factors).for_each(|(memory, factor)| {
            let wanted = if factor.resting { Row::Resting } else { Row::Moving };
            let rows =
                (factor.joint..residual.len()).step_by(n * processing.decimation).enumerate();
            for (time, row) in rows.filter(|(_, row)| motion.use_as[*row] == wanted) {
                memory.push(index, time, residual[row]);
            }
        });
    }
    Ok(memories.into_iter().map(Memory::rows_per_independent_row).collect())
}
