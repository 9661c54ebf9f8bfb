//! Total least squares on the triangular factor.
//!
//! Source: S. Van Huffel, J. Vandewalle, The Total Least Squares Problem (SIAM 1991), algorithm
//! 3.1; the errors of the columns are scaled to that of the torque.

use faer::Mat;

use super::estimator::{Estimator, EstimatorNeeds, EstimatorSetting, EstimatorTask};
use super::least_squares::Scaled;
use super::{Estimate, IdentificationError};
use crate::linalg::Svd;

/// Weighted total least squares: the observation matrix has noise too. Setting: standard deviation
/// of a column's noise as a share of the column's root mean square.
pub static TOTAL_LEAST_SQUARES: Estimator = Estimator {
    setting: EstimatorSetting::new("RELATIVE_NOISE", 1e-3),
    needs: EstimatorNeeds::Factors,
    reweights: true,
    ..Estimator::new("tls", "weighted total least squares", estimate)
};

fn estimate(
    task: EstimatorTask<'_, '_>,
    mut start: Estimate,
) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { setting: relative_noise, factors, nominal, .. } = task;
    if !(relative_noise > 0.0 && relative_noise < 1.0) {
        return Err(IdentificationError::Setting {
            setting: "relative noise of the columns",
            value: relative_noise,
        });
    }
    let unknowns = nominal.len();
    let used = factors.iter().zip(&start.weights).filter(|(_, weight)| weight.is_finite());
    let rows: usize = used.map(|(factor, _)| factor.rows).sum();
    // Columns of unit length over all rows have this noise per row, the torque one of 1.
    let noise = relative_noise / (rows as f64).sqrt();
    let Scaled { norms, values, v, .. } = Scaled::new(&start.whitened);
    let determined = super::least_squares::determined(&values);
    // In the singular directions the noise is as it was: they are orthonormal.
    let system = Mat::from_fn(unknowns + 1, determined + 1, |i, k| {
        if k < determined {
            (i..unknowns).map(|j| start.whitened[(i, j)] / norms[j] * v[(j, k)]).sum::<f64>()
                / noise
        } else {
            start.whitened[(i, unknowns)]
        }
    });
    if !system.is_all_finite() {
        return Err(IdentificationError::Setting {
            setting: "relative noise of the columns",
            value: relative_noise,
        });
    }
    let Svd { v: right, .. } = Svd::new(system.as_ref());
    let last = determined;
    let torque_share = right[(determined, last)];
    if torque_share.abs() < 1e-12 {
        return Err(IdentificationError::Setting {
            setting: "relative noise of the columns",
            value: relative_noise,
        });
    }
    // Scaled base parameters: determined directions from the data, the others from the nominal
    // values.
    let along = |k: usize| -right[(k, last)] / (torque_share * noise);
    let scaled_nominal = |j: usize| if norms[j].is_finite() { nominal[j] * norms[j] } else { 0.0 };
    let mut values: Vec<f64> = nominal.to_vec();
    let mut squares = 0.0;
    for j in (0..unknowns).filter(|&j| norms[j].is_finite()) {
        let from_data: f64 = (0..determined).map(|k| v[(j, k)] * along(k)).sum();
        let rest: f64 = (determined..unknowns)
            .map(|k| v[(j, k)] * (0..unknowns).map(|i| v[(i, k)] * scaled_nominal(i)).sum::<f64>())
            .sum();
        values[j] = (from_data + rest) / norms[j];
        squares += (from_data + rest).powi(2);
    }
    // To first order the noise of the columns adds to that of the torque.
    let of_columns = noise * squares.sqrt();
    let growth = 1.0 + of_columns * of_columns;
    start.covariance = (faer::Scale(growth) * &*start.covariance).into();
    start.notes.push(if of_columns < 1.0 {
        format!(
            "the noise of the columns adds {:.1} % to that of the torque",
            100.0 * (growth.sqrt() - 1.0)
        )
    } else {
        format!(
            "columns with a noise of {relative_noise} of their size would leave more than the \
             residual there is: they have {:.1e} of it at most",
            relative_noise / of_columns
        )
    });
    Ok(Estimate { values, ..start })
}
