//! What the limits cost: how much better the data would be met without one of them, and without
//! several.
//!
//! A limit that costs much is a hint, not a fault of the limit: no link has a negative mass.
//! Something that the model lacks is imitated by inertias that no body has, and the price says at
//! which link.

use serde::{Deserialize, Serialize};

use super::program::ConicStatus;
use super::{ACTIVE, Consistency, ConsistencyTask, Distance, Limit, MARGIN, Prior, added_residual};
use crate::identification::parameter_scales::nominal_links;
use crate::identification::{BaseParameters, IdentificationError, ParameterSet};
use crate::linalg::Matrix;
use crate::robot::Robot;

/// What the limits of an arm cost.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Costs {
    /// How much larger the weighted residual is than without limits, percent.
    pub residual_percent: f64,
    /// Limits one by one, dearest first.
    pub prices: Vec<Price>,
    /// Limits left out one after the other, each time the one that is then the dearest.
    pub stages: Vec<Stage>,
    /// Those of the stages' limits that the user set, and not physics.
    pub given: Vec<String>,
}

/// What one limit costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Price {
    /// The limit: `the link of ... is a body`, or a bound as in `joint_2.Fv >= 0`.
    pub limit: String,
    /// Share of what all limits together add to the squared residual that would be gone without
    /// this one. Limits can stand in for each other, so shares need not add up to one.
    pub share: f64,
}

/// One limit more that is left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Stage {
    /// The limit, named as in [`Price`].
    pub limit: String,
    /// What is left of [`Costs::residual_percent`] without it and those before.
    pub residual_percent: f64,
}

/// Shares below this are not worth a line.
const WORTH_NAMING: f64 = 0.05;

/// Most limits that are left out together.
const STAGES: usize = 4;

impl Consistency {
    /// What the limits cost one by one and together; nothing if they cost less than one unit of the
    /// residual's variance.
    ///
    /// Arguments as in [`Self::solve`]. The pull is Euclidean here, so that a link may leave the
    /// cone of bodies.
    ///
    /// # Errors
    /// As [`Self::solve`].
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn costs(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        whitened: &Matrix,
        nominal: &[f64],
        torque: &[f64],
    ) -> Result<Costs, IdentificationError> {
        let task = ConsistencyTask::new(&self.bounds, robot, set, base, whitened, nominal, torque)?;
        let prior = Prior { distance: Distance::Euclidean, ..self.prior };
        let Some(all) = task.relaxed(prior, &[]).filter(|all| all.added >= 1.0) else {
            return Ok(Costs::default());
        };
        let least = task.whitened[(base.rank(), base.rank())].powi(2);
        let percent =
            |added: f64| 100.0 * ((1.0 + added / least.max(f64::MIN_POSITIVE)).sqrt() - 1.0);
        let mut costs = Costs { residual_percent: percent(all.added), ..Costs::default() };
        let mut without: Vec<Limit> = Vec::new();
        let mut now = all.clone();
        for stage in 0..STAGES {
            let with = |limit: &Limit| [&without[..], &[*limit]].concat();
            let candidates =
                task.active(&now.x).into_iter().filter(|limit| !without.contains(limit));
            let relaxed =
                candidates.filter_map(|limit| Some((limit, task.relaxed(prior, &with(&limit))?)));
            let share =
                |relaxed: &Relaxed| ((now.added - relaxed.added) / all.added).clamp(0.0, 1.0);
            let mut relaxed: Vec<(Limit, Relaxed)> =
                relaxed.filter(|(_, r)| share(r) >= WORTH_NAMING).collect();
            relaxed.sort_by(|(_, a), (_, b)| a.added.total_cmp(&b.added));
            if stage == 0 {
                let price = |(limit, r): &(Limit, Relaxed)| Price {
                    limit: task.name(*limit),
                    share: share(r),
                };
                costs.prices = relaxed.iter().map(price).collect();
            }
            if relaxed.is_empty() {
                break;
            }
            let (limit, next) = relaxed.swap_remove(0);
            if matches!(limit, Limit::Bound(index) if task.bounds[index].given) {
                costs.given.push(task.name(limit));
            }
            costs
                .stages
                .push(Stage { limit: task.name(limit), residual_percent: percent(next.added) });
            without.push(limit);
            now = next;
        }
        Ok(costs)
    }
}

/// The solution of a program that lacks some limits.
#[derive(Clone)]
struct Relaxed {
    x: Vec<f64>,
    /// Squared residual above that of least squares, in units of the residual's variance.
    added: f64,
}

impl ConsistencyTask<'_> {
    /// None if the solver gives up.
    fn relaxed(&self, prior: Prior, without: &[Limit]) -> Option<Relaxed> {
        let outcome = self.program(prior, without).0.solve();
        let base = self.base.combine(&self.parameters(&outcome.x));
        let added = added_residual(&self.whitened, &base).powi(2) * base.len() as f64;
        (outcome.status == ConicStatus::Solved).then_some(Relaxed { x: outcome.x, added })
    }

    /// Limits at which a point lies.
    fn active(&self, x: &[f64]) -> Vec<Limit> {
        let parameters = self.parameters(x);
        let links = nominal_links(&parameters, self.set).zip(&self.sizes).enumerate();
        let thin = links.filter(|(_, (link, size))| {
            size.scaled(link).symmetric_eigenvalues().min() < 100.0 * MARGIN
        });
        let bounds = self.bounds.iter().enumerate().filter(|(_, bound)| bound.margin(x) < ACTIVE);
        thin.map(|(index, _)| Limit::Body(index))
            .chain(bounds.map(|(index, _)| Limit::Bound(index)))
            .collect()
    }

    fn name(&self, limit: Limit) -> String {
        match limit {
            Limit::Body(link) => {
                format!("the link of `{}` is a body", self.robot.joints()[link].name)
            }
            Limit::Bound(index) => self.bounds[index].name.clone(),
        }
    }
}
