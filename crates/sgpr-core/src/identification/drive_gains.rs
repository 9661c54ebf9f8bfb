//! Torque per unit of motor current, from a payload of which something is known.
//!
//! On the UR10e, least squares gives gains about a tenth below those with which its controller
//! turns target torques into target currents; this estimator agrees with the controller within 5 %.
//!
//! Currents alone fix the parameters of an arm up to one factor per drive. A payload of known mass
//! fixes the factors: what it adds to the torque is known in N·m. All joints share the arm's
//! parameters, so each drive gets its own factor.
//!
//! The currents have the noise, not the motion, so the sum of (current - torque / gain)² is
//! minimised, which is not linear in the gains: total least squares with errors where they are,
//! each drive's in its own current (Van Huffel, Vandewalle (1991), section 10). It starts from
//! least squares with the gains on the side of the unknowns, which noise would draw to zero: in two
//! stages, the currents first fitted by the rows of their own joint, which have no noise (Theil
//! (1953)). Estimates can be held to be those of bodies (Wensing, Kim, Slotine (2018)).
//!
//! Sources: M. Gautier, S. Briot, Global identification of drive gains parameters of robots using a
//! known payload, J. Dynamic Systems, Measurement, Control 136(5) (2014); C. Gaz, F. Flacco, A. De
//! Luca (2014) for known payloads.

use derive_setters::Setters;
use faer::Mat;

use super::consistency::{Carrier, KnownPayload, bounded_least_squares};
use super::extended_factor::{ExtendedFactor, own_noise};
use super::payload::PayloadLink;
use super::{
    BaseParameters, Consistency, Estimate, IdentificationError, JointFactor, LeastSquares, Method,
    ParameterSet, torque_sizes,
};
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// How gains are estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GainEstimator {
    /// Least sum of (current - torque / gain)², each drive by its noise: what the currents' noise
    /// asks for.
    #[default]
    MaximumLikelihood,
    /// Least sum of (torque - gain current)², all drives alike: in use in the literature, and drawn
    /// to zero by the noise of the currents. Gains of joints that hardly feel the payload need a
    /// lower bound with it.
    LeastSquares,
}

/// What is known beforehand.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct GainOptions {
    /// Link that holds the payload.
    pub link: usize,
    /// The payload in the frame of that link, as far as known.
    pub known: KnownPayload,
    /// How gains are estimated.
    pub estimator: GainEstimator,
    /// Lower bounds of the gains, `[n]`; without bodies they hold for least squares only. None if
    /// empty.
    pub lowest: Vec<f64>,
    /// Whether the links and the payload are to be bodies, with the limits of the user and a weak
    /// pull toward the robot file.
    pub consistency: Option<Consistency>,
}

impl GainOptions {
    /// Gains by maximum likelihood, without bounds.
    ///
    /// - `link`: index of the link that holds the payload
    pub fn new(link: usize, known: KnownPayload) -> Self {
        Self {
            link,
            known,
            estimator: GainEstimator::default(),
            lowest: Vec::new(),
            consistency: None,
        }
    }
}

/// Gains of all drives.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct DriveGains {
    /// Torque per unit of what was given as torque, `[n]`: N·m/A for currents in A, 1 for torques
    /// in N·m.
    pub gains: Vec<f64>,
    /// Standard deviations, `[n]`.
    pub standard_deviations: Vec<f64>,
    /// The payload, known parameters as given.
    pub payload: [f64; PARAMETERS_PER_LINK],
    /// Base parameters of the arm, in N·m, `[rank]`.
    pub base: Vec<f64>,
    /// Times that the linearised problem was solved.
    pub iterations: usize,
}

const MOST_ITERATIONS: usize = 50;

/// A step of this share of the gains changes nothing.
const SMALL_STEP: f64 = 1e-9;

/// The same where each step is a semidefinite program, which has fewer digits.
const SMALL_STEP_OF_BODIES: f64 = 1e-5;

/// Times that the linear equations are weighted anew by the gains found.
const LINEAR_ROUNDS: usize = 3;

/// Estimates the gains of all drives.
///
/// - `unloaded`, `loaded`: factors whose torques are currents, or torques by gains that are in
///   doubt
/// - `correlation`: rows that carry as much as one independent row, per factor of `unloaded`, then
///   of `loaded`
///
/// # Errors
/// If nothing but zeros is known of the payload, there are fewer rows than unknowns, or a gain
/// comes out as no positive number: its joint hardly feels the payload.
pub fn identify_drive_gains(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    [unloaded, loaded]: [&[JointFactor]; 2],
    correlation: Option<&[f64]>,
    options: &GainOptions,
) -> Result<DriveGains, IdentificationError> {
    let GainOptions { link, known, estimator, lowest, consistency } = options;
    if !known.iter().flatten().any(|value| *value != 0.0) {
        return Err(IdentificationError::UnknownPayload);
    }
    let problem = GainProblem {
        rank: base.rank(),
        dof: set.dof(),
        held: PayloadLink::new(set, base, *link),
        known,
    };
    let unknowns = problem.unknowns();
    let solve = |method: Method, extend: &dyn Fn(&JointFactor, bool) -> JointFactor| {
        let without = unloaded.iter().map(|factor| extend(factor, false));
        let factors: Vec<JointFactor> =
            without.chain(loaded.iter().map(|factor| extend(factor, true))).collect();
        let fit = LeastSquares { method, correlation: correlation.map(<[f64]>::to_vec) };
        fit.solve_unknowns(&factors, &vec![0.0; unknowns])
    };

    let mut nominal = robot.standard_parameters();
    nominal.resize(set.len(), 0.0);
    let torque = torque_sizes(loaded, problem.dof);
    let carrier = consistency.as_ref().map(|consistency| Carrier {
        robot,
        set,
        base,
        consistency,
        nominal: &nominal,
        torque: &torque,
    });
    if *estimator == GainEstimator::LeastSquares {
        let linear = solve(Method::Ols, &|factor, loaded| {
            problem.linear(factor, loaded, Current::Measured)
        })?;
        return problem.least_squares(&linear, lowest, carrier.as_ref());
    }
    // Weights from the residual of these equations would reward gains of zero; the noise of the
    // currents does not.
    let noise = noise_of_joints(unloaded, loaded, problem.dof);
    let mut gains = vec![1.0; problem.dof];
    let mut x = Vec::new();
    for _ in 0..LINEAR_ROUNDS {
        let scaled = noise.iter().zip(&gains).map(|(noise, gain)| noise * gain).collect();
        let linear = |factor: &JointFactor, loaded| problem.linear(factor, loaded, Current::Fitted);
        x = solve(Method::WlsKnown(scaled), &linear)?.values;
        problem.require_positive(&x)?;
        gains = problem.gains(&x).to_vec();
    }
    for iterations in 1..=MOST_ITERATIONS {
        let step = solve(Method::Wls, &|factor, loaded| problem.linearised(factor, loaded, &x))?;
        let before = problem.gains(&x).to_vec();
        match &carrier {
            None => x.iter_mut().zip(&step.values).for_each(|(x, step)| *x += step),
            Some(carrier) => x = carrier.solve(&about(&step.whitened, &x), known, lowest)?,
        }
        problem.require_positive(&x)?;
        let change = problem
            .gains(&x)
            .iter()
            .zip(&before)
            .map(|(new, old)| (new / old - 1.0).abs())
            .fold(0.0, f64::max);
        let small = if carrier.is_some() { SMALL_STEP_OF_BODIES } else { SMALL_STEP };
        if change < small || iterations == MOST_ITERATIONS {
            let deviations = step.standard_deviations();
            return Ok(DriveGains {
                gains: problem.gains(&x).to_vec(),
                standard_deviations: problem.gains(&deviations).to_vec(),
                payload: problem.payload(&x),
                base: x[..problem.rank].to_vec(),
                iterations,
            });
        }
    }
    unreachable!("the last iteration returns")
}

/// The triangle of a step as one of x + step.
fn about(triangle: &Mat<f64>, x: &[f64]) -> Mat<f64> {
    let last = x.len();
    let mut shifted = triangle.clone();
    for i in 0..last {
        shifted[(i, last)] += x.iter().enumerate().map(|(j, x)| triangle[(i, j)] * x).sum::<f64>();
    }
    shifted
}

/// Noise of the currents of each joint: what parameters of its own leave over.
fn noise_of_joints(unloaded: &[JointFactor], loaded: &[JointFactor], dof: usize) -> Vec<f64> {
    let of_joint = |joint: usize| {
        let own =
            unloaded.iter().chain(loaded).filter(|factor| factor.joint == joint && !factor.resting);
        own.map(own_noise).fold(0.0, f64::max).max(f64::MIN_POSITIVE)
    };
    (0..dof).map(of_joint).collect()
}

/// Currents on the side of the unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Current {
    Measured,
    /// Without what the parameters of their own joint and log leave: without noise.
    Fitted,
}

/// Unknowns: base parameters, payload, gains.
struct GainProblem<'a> {
    rank: usize,
    dof: usize,
    held: PayloadLink,
    known: &'a KnownPayload,
}

impl GainProblem<'_> {
    fn unknowns(&self) -> usize {
        self.rank + PARAMETERS_PER_LINK + self.dof
    }

    fn gains<'x>(&self, x: &'x [f64]) -> &'x [f64] {
        &x[self.rank + PARAMETERS_PER_LINK..]
    }

    fn payload(&self, x: &[f64]) -> [f64; PARAMETERS_PER_LINK] {
        std::array::from_fn(|k| self.known[k].unwrap_or(x[self.rank + k]))
    }

    /// The solution of the linear equations, gains held at their bounds where it lies below.
    fn least_squares(
        &self,
        linear: &Estimate,
        lowest: &[f64],
        carrier: Option<&Carrier<'_>>,
    ) -> Result<DriveGains, IdentificationError> {
        let first = self.rank + PARAMETERS_PER_LINK;
        let bounds: Vec<(usize, f64)> =
            lowest.iter().enumerate().map(|(joint, bound)| (first + joint, *bound)).collect();
        let below = bounds.iter().any(|(unknown, bound)| linear.values[*unknown] < *bound);
        let x = match carrier {
            Some(carrier) => carrier.solve(&linear.whitened, self.known, lowest)?,
            None if below => bounded_least_squares(&linear.whitened, &bounds)?,
            None => linear.values.clone(),
        };
        self.require_positive(&x)?;
        Ok(DriveGains {
            gains: self.gains(&x).to_vec(),
            standard_deviations: self.gains(&linear.standard_deviations()).to_vec(),
            payload: self.payload(&x),
            base: x[..self.rank].to_vec(),
            iterations: 1,
        })
    }

    fn require_positive(&self, x: &[f64]) -> Result<(), IdentificationError> {
        match self.gains(x).iter().position(|gain| !(*gain > 0.0 && gain.is_finite())) {
            None => Ok(()),
            Some(joint) => Err(IdentificationError::NoGain { joint, gain: self.gains(x)[joint] }),
        }
    }

    /// Adds the columns of base and unknown payload, divided by `gain`.
    fn add_body(&self, extended: &mut ExtendedFactor<'_>, loaded: bool, gain: f64) {
        extended.keep(1.0 / gain);
        for parameter in (0..PARAMETERS_PER_LINK).filter(|&k| loaded && self.known[k].is_none()) {
            let column = extended.combined(|base| self.held.share(base, parameter) / gain);
            extended.add(self.rank + parameter, column);
        }
    }

    /// W base + W_payload payload - gain current = 0, the known part of the payload on the right.
    fn linear(&self, factor: &JointFactor, loaded: bool, current: Current) -> JointFactor {
        let mut extended = ExtendedFactor::new(factor);
        self.add_body(&mut extended, loaded, 1.0);
        let mut gained: Vec<f64> = extended.torque().iter().map(|value| -value).collect();
        if current == Current::Fitted {
            gained[factor.columns.len()] = 0.0;
        }
        extended.add(self.rank + PARAMETERS_PER_LINK + factor.joint, gained);
        let known = |base: usize| -> f64 {
            (0..PARAMETERS_PER_LINK)
                .map(|k| self.known[k].unwrap_or(0.0) * self.held.share(base, k))
                .sum()
        };
        let right = extended.combined(|base| if loaded { -known(base) } else { 0.0 });
        extended.finish(&right)
    }

    /// current - torque(x) / gain, about x.
    fn linearised(&self, factor: &JointFactor, loaded: bool, x: &[f64]) -> JointFactor {
        let gain = self.gains(x)[factor.joint];
        let payload = self.payload(x);
        let mut extended = ExtendedFactor::new(factor);
        self.add_body(&mut extended, loaded, gain);
        let torque = extended.combined(|base| {
            let held = |k: usize| payload[k] * self.held.share(base, k);
            x[base] + if loaded { (0..PARAMETERS_PER_LINK).map(held).sum() } else { 0.0 }
        });
        let slope = torque.iter().map(|value| -value / (gain * gain)).collect();
        extended.add(self.rank + PARAMETERS_PER_LINK + factor.joint, slope);
        let residual: Vec<f64> =
            extended.torque().iter().zip(&torque).map(|(i, tau)| i - tau / gain).collect();
        extended.finish(&residual)
    }
}
