//! What each limit costs: how much better the data would be met without it.
//!
//! A limit that costs much is a hint, not a fault of the limit: no link has a negative mass. Something that the model lacks
//! is imitated by inertias that no body has, and the price says at which link.

use serde::{Deserialize, Serialize};

use super::program::Status;
use super::{ACTIVE, Consistency, Distance, Limit, MARGIN, Prior, Task, added_residual, nominal_links};
use crate::identification::{BaseParameters, IdentificationError, ParameterSet};
use crate::robot::Robot;
use faer::Mat;

/// What one limit costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Price {
    /// The limit: `the link of ... is a body`, or a bound as in `joint_2.Fv >= 0`.
    pub limit: String,
    /// Share of what all limits together add to the squared residual that would be gone without this one. Limits can stand
    /// in for each other, so shares need not add up to one.
    pub share: f64,
}

/// Shares below this are not worth a line.
const WORTH_NAMING: f64 = 0.05;

impl Consistency {
    /// What the limits cost one by one, dearest first; empty if they cost less than one unit of the residual's variance.
    ///
    /// Arguments as in [`Self::solve`]. The pull is Euclidean here, so that a link may leave the cone of bodies.
    ///
    /// # Errors
    /// As [`Self::solve`].
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn prices(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        whitened: &Mat<f64>,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<Vec<Price>, IdentificationError> {
        let task = Task::new(&self.bounds, robot, set, base, whitened, nominal, torque)?;
        let prior = Prior { distance: Distance::Euclidean, ..self.prior };
        let rank = base.rank() as f64;
        let solve = |without: Option<Limit>| -> Option<(Vec<f64>, f64)> {
            let outcome = task.program(prior, without).0.solve();
            if outcome.status != Status::Solved {
                return None;
            }
            let squares = added_residual(whitened, &base.combine(&task.parameters(&outcome.x))).powi(2) * rank;
            Some((outcome.x, squares))
        };
        let Some((x, all)) = solve(None) else { return Ok(Vec::new()) };
        if all < 1.0 {
            return Ok(Vec::new());
        }
        let parameters = task.parameters(&x);
        let mut candidates: Vec<(Limit, String)> = Vec::new();
        for (index, (link, size)) in nominal_links(&parameters, set).zip(&task.sizes).enumerate() {
            if size.scaled(&link).symmetric_eigenvalues().min() < 100.0 * MARGIN {
                candidates
                    .push((Limit::Body(index), format!("the link of `{}` is a body", robot.joints()[index].name)));
            }
        }
        let active = task.bounds.iter().enumerate().filter(|(_, bound)| bound.margin(&x) < ACTIVE);
        candidates.extend(active.map(|(index, bound)| (Limit::Bound(index), bound.name.clone())));
        let price = |(without, limit): (Limit, String)| {
            let (_, squares) = solve(Some(without))?;
            let share = ((all - squares) / all).clamp(0.0, 1.0);
            (share >= WORTH_NAMING).then_some(Price { limit, share })
        };
        let mut prices: Vec<Price> = candidates.into_iter().filter_map(price).collect();
        prices.sort_by(|a, b| b.share.total_cmp(&a.share));
        Ok(prices)
    }
}
