//! What each limit costs: how much better the data would be met without it.
//!
//! A limit that costs much is a hint, not a fault of the limit: no link has a negative mass. Something that the model lacks
//! is imitated by inertias that no body has, and the price says at which link.

use serde::{Deserialize, Serialize};

use super::bounds::{self, BadBound};
use super::program::{Program, Status};
use super::{ACTIVE, Consistency, Distance, LinkSize, MARGIN, Prior};
use super::{add_data, added_residual, nominal_links, parameter_scales, require_body};
use crate::identification::{BaseParameters, IdentificationError, ParameterSet};
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;
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

/// Which limit is left out.
#[derive(Clone, Copy, PartialEq)]
enum Without {
    Nothing,
    Body(usize),
    Bound(usize),
}

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
        assert_eq!(nominal.len(), set.len(), "every parameter of the set");
        let sizes: Vec<LinkSize> = nominal_links(nominal, set).map(LinkSize::of).collect();
        let scale = parameter_scales(set, nominal, torque);
        let limits = bounds::collect(&self.bounds, robot, set, &scale)
            .map_err(|BadBound { bound, reason }| IdentificationError::BadBound { bound, reason })?;
        let pull = Self { prior: Prior { distance: Distance::Euclidean, ..self.prior }, bounds: self.bounds.clone() };
        let rank = base.rank() as f64;
        let solve = |without: Without| -> Option<(Vec<f64>, f64)> {
            let mut program = Program::default();
            program.variables(set.len());
            add_data(&mut program, base, whitened, &scale);
            pull.add_prior(&mut program, robot, set, nominal, &sizes, &scale);
            let links = (0..robot.dof()).filter(|link| without != Without::Body(*link));
            links.for_each(|link| require_body(&mut program, link * PARAMETERS_PER_LINK));
            let kept = limits.iter().enumerate().filter(|(index, _)| without != Without::Bound(*index));
            kept.for_each(|(_, bound)| bound.require(&mut program));
            let outcome = program.solve();
            if outcome.status != Status::Solved {
                return None;
            }
            let parameters: Vec<f64> = outcome.x.iter().zip(&scale).map(|(x, scale)| x * scale).collect();
            let squares = added_residual(whitened, &base.combine(&parameters)).powi(2) * rank;
            Some((outcome.x, squares))
        };
        let Some((x, all)) = solve(Without::Nothing) else { return Ok(Vec::new()) };
        if all < 1.0 {
            return Ok(Vec::new());
        }
        let parameters: Vec<f64> = x.iter().zip(&scale).map(|(x, scale)| x * scale).collect();
        let mut candidates: Vec<(Without, String)> = Vec::new();
        for (index, (link, size)) in nominal_links(&parameters, set).zip(&sizes).enumerate() {
            if size.scaled(&link).symmetric_eigenvalues().min() < 100.0 * MARGIN {
                candidates
                    .push((Without::Body(index), format!("the link of `{}` is a body", robot.joints()[index].name)));
            }
        }
        let active = limits.iter().enumerate().filter(|(_, bound)| bound.margin(&x) < ACTIVE);
        candidates.extend(active.map(|(index, bound)| (Without::Bound(index), bound.name.clone())));
        let price = |(without, limit): (Without, String)| {
            let (_, squares) = solve(without)?;
            let share = ((all - squares) / all).clamp(0.0, 1.0);
            (share >= WORTH_NAMING).then_some(Price { limit, share })
        };
        let mut prices: Vec<Price> = candidates.into_iter().filter_map(price).collect();
        prices.sort_by(|a, b| b.share.total_cmp(&a.share));
        Ok(prices)
    }
}
