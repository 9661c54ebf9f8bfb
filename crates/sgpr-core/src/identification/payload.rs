//! What hangs on the last link: from logs with it and logs without it.
//!
//! A payload adds its ten parameters to those of the link that holds it, W_loaded = [W, W B_link],
//! so arm and payload are estimated together, and the covariance of the payload knows what the
//! arm's is.
//!
//! Source: W. Khalil, M. Gautier, P. Lemoine, Identification of the payload inertial parameters of
//! industrial manipulators, IEEE ICRA (2007), method 3 (both logs at once).

use derive_setters::Setters;
use faer::Mat;

use super::consistency::nearest_body;
use super::extended_factor::ExtendedFactor;
use super::{BaseParameters, IdentificationError, JointFactor, LeastSquares, Method, ParameterSet};
use crate::effects::Role;
use crate::linalg::Matrix;
use crate::spatial::PARAMETERS_PER_LINK;

/// How a payload is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct PayloadOptions {
    /// Link that holds it.
    pub link: usize,
    /// Whether friction and offsets may differ between the logs with and without it.
    pub friction_may_change: bool,
    /// Whether the payload is to be a body: of positive mass, with an inertia that some
    /// distribution of it has.
    pub consistent: bool,
}

impl PayloadOptions {
    /// A body, and friction that is the same with and without it.
    ///
    /// - `link`: index of the link that holds it
    pub fn new(link: usize) -> Self {
        Self { link, friction_may_change: false, consistent: true }
    }
}

/// A payload in the frame of the link that holds it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Payload {
    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    pub parameters: [f64; PARAMETERS_PER_LINK],
    /// Their covariance, `[10, 10]`, before physics is asked; infinite where the motion says
    /// nothing.
    pub covariance: Matrix,
    /// Base parameters of the arm without it, `[rank]`.
    pub base: Vec<f64>,
    /// Rows of both logs.
    pub rows: usize,
}

impl Payload {
    /// Mass, kg.
    pub fn mass(&self) -> f64 {
        self.parameters[0]
    }

    /// Centre of mass in the link frame, m.
    pub fn centre(&self) -> [f64; 3] {
        [1, 2, 3].map(|k: usize| self.parameters[k] / self.parameters[0])
    }

    /// Standard deviations, `[10]`.
    pub fn standard_deviations(&self) -> [f64; PARAMETERS_PER_LINK] {
        std::array::from_fn(|k| self.covariance[(k, k)].max(0.0).sqrt())
    }
}

/// Estimates a payload by weighted least squares on logs with and without it.
///
/// - `unloaded`, `loaded`: factors of the same columns
/// - `nominal`: base parameters of the robot file, `[rank]`
/// - `correlation`: rows that carry as much as one independent row, per factor of `unloaded`, then
///   of `loaded`
///
/// # Errors
/// If there are fewer rows than unknowns.
///
/// # Panics
/// If the link is not one of the robot's.
pub fn identify_payload(
    set: &ParameterSet,
    base: &BaseParameters,
    [unloaded, loaded]: [&[JointFactor]; 2],
    nominal: &[f64],
    correlation: Option<&[f64]>,
    options: &PayloadOptions,
) -> Result<Payload, IdentificationError> {
    assert!(options.link < set.dof(), "a link of the robot");
    let rank = base.rank();
    let held = PayloadLink::new(set, base, options.link);
    let changes: Vec<usize> = if options.friction_may_change {
        (0..rank)
            .filter(|&k| {
                base.independent()[k] >= set.inertial() && !is_rotor(set, base.independent()[k])
            })
            .collect()
    } else {
        Vec::new()
    };
    let extend = |factor: &JointFactor| {
        let mut extended = ExtendedFactor::new(factor);
        extended.keep(1.0);
        for parameter in 0..PARAMETERS_PER_LINK {
            let column = extended.combined(|base| held.share(base, parameter));
            extended.add(rank + parameter, column);
        }
        for (k, &changed) in changes.iter().enumerate() {
            let column = extended.combined(|base| f64::from(base == changed));
            extended.add(rank + PARAMETERS_PER_LINK + k, column);
        }
        let torque = extended.torque();
        extended.finish(&torque)
    };
    let factors: Vec<JointFactor> =
        unloaded.iter().cloned().chain(loaded.iter().map(extend)).collect();
    let mut start = nominal.to_vec();
    start.resize(rank + PARAMETERS_PER_LINK + changes.len(), 0.0);
    let fit = LeastSquares { method: Method::Wls, correlation: correlation.map(<[f64]>::to_vec) };
    let estimate = fit.solve_unknowns(&factors, &start)?;
    let covariance = Mat::from_fn(PARAMETERS_PER_LINK, PARAMETERS_PER_LINK, |i, j| {
        estimate.covariance[(rank + i, rank + j)]
    });
    let mut parameters: [f64; PARAMETERS_PER_LINK] =
        std::array::from_fn(|k| estimate.values[rank + k]);
    if options.consistent {
        parameters = nearest_body(&parameters, &covariance, f64::INFINITY)?.parameters;
    }
    Ok(Payload {
        parameters,
        covariance: covariance.into(),
        base: estimate.values[..rank].to_vec(),
        rows: factors.iter().map(|factor| factor.rows).sum(),
    })
}

fn is_rotor(set: &ParameterSet, parameter: usize) -> bool {
    let column = set.effect_columns()[parameter - set.inertial()];
    set.effects()[column.effect].role() == Some(Role::RotorInertia)
}

/// How the parameters of one link enter the base parameters.
pub(super) struct PayloadLink {
    matrix: Vec<f64>,
    width: usize,
    first: usize,
}

impl PayloadLink {
    pub fn new(set: &ParameterSet, base: &BaseParameters, link: usize) -> Self {
        Self { matrix: base.matrix(), width: set.len(), first: link * PARAMETERS_PER_LINK }
    }

    /// Base parameter per unit of the link's parameter.
    pub fn share(&self, base: usize, parameter: usize) -> f64 {
        self.matrix[base * self.width + self.first + parameter]
    }
}
