//! Arm, payload and drive gains at once, with lower bounds of the gains, and arm and payload as
//! bodies.

use faer::Mat;

use super::bounds::{self, BadBound};
use super::program::{Affine, ConicOutcome, ConicProgram, ConicStatus};
use super::{Consistency, Prior, explain, require_body};
use crate::identification::parameter_scales::{
    LINK_SIZE, LinkSize, nominal_links, parameter_scales,
};
use crate::identification::{BaseParameters, IdentificationError, ParameterSet};
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// What is known of the payload, in the frame of the link that holds it; `None` is estimated along.
pub type KnownPayload = [Option<f64>; PARAMETERS_PER_LINK];

/// The arm that carries a payload, and what is known of it.
pub(in crate::identification) struct Carrier<'a> {
    pub robot: &'a Robot,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    pub consistency: &'a Consistency,
    /// All parameters of the set.
    pub nominal: &'a [f64],
    /// Size of what was given as torque, per joint.
    pub torque: &'a [f64],
}

impl Carrier<'_> {
    /// min |R x - rho| over arms of bodies with a body as payload.
    ///
    /// - `system`: the triangle [R rho] of base parameters, ten parameters of the payload, gains
    /// - `known`: what is known of the payload
    /// - `lowest`: lower bounds of the gains; none if empty
    /// - returns x
    pub fn solve(
        &self,
        system: &Mat<f64>,
        known: &KnownPayload,
        lowest: &[f64],
    ) -> Result<Vec<f64>, IdentificationError> {
        // Where the solver gives up, a stronger pull makes the program better conditioned.
        let mut failure = None;
        for factor in [1.0, 3.0, 10.0] {
            let Prior { distance, relative_deviation } = self.consistency.prior;
            let prior = Prior { distance, relative_deviation: relative_deviation / factor };
            match self.attempt(prior, system, known, lowest) {
                Err(error @ IdentificationError::Unsolved { .. }) => {
                    failure.get_or_insert(error);
                }
                result => return result,
            }
        }
        Err(failure.expect("every attempt failed"))
    }

    fn attempt(
        &self,
        prior: Prior,
        system: &Mat<f64>,
        known: &KnownPayload,
        lowest: &[f64],
    ) -> Result<Vec<f64>, IdentificationError> {
        let Self { robot, set, base, nominal, torque, .. } = *self;
        let (rank, dof, width) = (base.rank(), robot.dof(), set.len());
        let sizes: Vec<LinkSize> = nominal_links(nominal, set).map(LinkSize::of).collect();
        let scale = parameter_scales(set, nominal, torque);
        let load = LinkSize {
            mass: known[0].filter(|mass| *mass > 0.0).unwrap_or(1.0),
            length: LINK_SIZE,
        }
        .scales();
        let limits = bounds::collect(&self.consistency.bounds, robot, set, &scale).map_err(
            |BadBound { bound, reason }| IdentificationError::BadBound { bound, reason },
        )?;
        let gain_scale =
            column_scales(system, rank + PARAMETERS_PER_LINK..rank + PARAMETERS_PER_LINK + dof);

        let mut program = ConicProgram::default();
        program.variables(width);
        let payload = program.variables(PARAMETERS_PER_LINK);
        let gains = program.variables(dof);
        let unknowns = rank + PARAMETERS_PER_LINK + dof;
        let residual = program.variables(unknowns);
        let combination = base.matrix();
        let rows = (0..unknowns).map(|i| {
            let mut row = Affine::variable(residual + i, -1.0).plus(-system[(i, unknowns)]);
            for (k, scale) in scale.iter().enumerate() {
                let factor: f64 =
                    (0..rank).map(|j| system[(i, j)] * combination[j * width + k]).sum();
                row.terms.push((k, factor * scale));
            }
            let of_load =
                (0..PARAMETERS_PER_LINK).map(|k| (payload + k, system[(i, rank + k)] * load[k]));
            let of_gains = (0..dof)
                .map(|k| (gains + k, system[(i, rank + PARAMETERS_PER_LINK + k)] * gain_scale[k]));
            row.terms.extend(of_load.chain(of_gains));
            row.terms.retain(|(_, factor)| *factor != 0.0);
            row
        });
        program.require_zero(rows.collect());
        (residual..residual + unknowns).for_each(|variable| program.add_square(variable, 0.0, 1.0));
        prior.add_to(&mut program, robot, set, nominal, &sizes, &scale);
        for (k, known) in known.iter().enumerate() {
            match known {
                Some(value) => program
                    .require_zero(vec![Affine::variable(payload + k, 1.0).plus(-value / load[k])]),
                None => program.add_square(payload + k, 0.0, prior.relative_deviation.powi(-2)),
            }
        }
        (0..dof).for_each(|link| require_body(&mut program, link * PARAMETERS_PER_LINK));
        require_body(&mut program, payload);
        limits.iter().for_each(|bound| bound.require(&mut program));
        for (k, bound) in lowest.iter().enumerate() {
            program.require_non_negative(vec![
                Affine::variable(gains + k, 1.0).plus(-bound / gain_scale[k]),
            ]);
        }
        let ConicOutcome { x, status, .. } = program.solve();
        match status {
            ConicStatus::Solved => {}
            ConicStatus::Infeasible => return Err(explain(dof, width, &limits)),
            ConicStatus::Failed(reason) => return Err(IdentificationError::Unsolved { reason }),
        }
        let standard: Vec<f64> = x.iter().zip(&scale).map(|(x, scale)| x * scale).collect();
        let mut found = base.combine(&standard);
        found.extend((0..PARAMETERS_PER_LINK).map(|k| x[payload + k] * load[k]));
        found.extend((0..dof).map(|k| x[gains + k] * gain_scale[k]));
        Ok(found)
    }
}

/// min |R x - rho| with lower bounds on some unknowns.
///
/// - `system`: `[unknowns + 1, unknowns + 1]`, the triangle [R rho]
/// - `lowest`: (unknown, bound)
pub(in crate::identification) fn bounded_least_squares(
    system: &Mat<f64>,
    lowest: &[(usize, f64)],
) -> Result<Vec<f64>, IdentificationError> {
    let unknowns = system.ncols() - 1;
    let scale = column_scales(system, 0..unknowns);
    let mut program = ConicProgram::default();
    program.variables(unknowns);
    let residual = program.variables(unknowns);
    let rows = (0..unknowns).map(|i| {
        let mut row = Affine::variable(residual + i, -1.0).plus(-system[(i, unknowns)]);
        row.terms.extend(
            (i..unknowns)
                .map(|j| (j, system[(i, j)] * scale[j]))
                .filter(|(_, factor)| *factor != 0.0),
        );
        row
    });
    program.require_zero(rows.collect());
    (residual..residual + unknowns).for_each(|variable| program.add_square(variable, 0.0, 1.0));
    for &(unknown, bound) in lowest {
        program.require_non_negative(vec![
            Affine::variable(unknown, 1.0).plus(-bound / scale[unknown]),
        ]);
    }
    let outcome = program.solve();
    match outcome.status {
        ConicStatus::Solved => {
            Ok(outcome.x[..unknowns].iter().zip(&scale).map(|(x, scale)| x * scale).collect())
        }
        ConicStatus::Infeasible => {
            Err(IdentificationError::Unsolved { reason: "bounds without a point".into() })
        }
        ConicStatus::Failed(reason) => Err(IdentificationError::Unsolved { reason }),
    }
}

/// Units in which columns of a triangle have length one.
fn column_scales(system: &Mat<f64>, columns: std::ops::Range<usize>) -> Vec<f64> {
    let unknowns = system.ncols() - 1;
    let norm = |j: usize| system.col(j).subrows(0, unknowns).norm_l2();
    columns.map(|j| if norm(j) > 0.0 { 1.0 / norm(j) } else { 1.0 }).collect()
}
