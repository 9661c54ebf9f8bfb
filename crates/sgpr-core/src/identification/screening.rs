//! What is wrong with data before anyone believes an estimate from them.
//!
//! A rigid arm is a strong test of its log: all joints share the same bodies. A torque of the wrong sign or unit, or one
//! that is late, breaks what the other joints say, and the break tells which.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fmt;

use faer::Mat;

use super::estimate::Groups;
use super::extended_factor::{ExtendedFactor, own_noise};
use super::least_squares::{Directions, Solution, stack};
use super::{BaseParameters, Equations, Estimate, IdentificationError, JointFactor, ParameterSet, Trajectory};

/// Something suspicious in the data of an identification.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// A torque has the other sign.
    Negated {
        /// Name of the joint.
        joint: String,
    },
    /// All torques have the other sign: friction would drive the arm.
    AllNegated,
    /// A torque is in another unit than those of the other joints.
    Scaled {
        /// Name of the joint.
        joint: String,
        /// What it must be multiplied by.
        factor: f64,
    },
    /// Torque and motion of a joint are not simultaneous.
    Late {
        /// Name of the joint.
        joint: String,
        /// By how much the torque comes after the motion that it belongs to, s; negative if before.
        seconds: f64,
        /// Share by which the residual falls if that is undone.
        gain: f64,
    },
    /// Rows far off.
    Outliers {
        /// Name of the joint.
        joint: String,
        /// How many.
        count: usize,
        /// Trajectory and sample of the worst.
        worst: (usize, usize),
        /// Its residual in standard deviations.
        deviations: f64,
    },
    /// One second on which much of the estimate hangs.
    Leverage {
        /// Trajectory and sample where it begins.
        at: (usize, usize),
        /// Share of the time.
        time: f64,
        /// Share of what the data say.
        share: f64,
    },
    /// A combination that the motion hardly excites.
    Weak {
        /// The combination, as in `1.0 joint_5.Ixx - 0.7 joint_6.Iyy`.
        combination: String,
        /// Its singular value as a share of the largest.
        share: f64,
        /// Joints to move.
        joints: Vec<String>,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Negated { joint } => write!(
                f,
                "the torque of {joint} looks negated: with the other sign it agrees with the other joints; check the sign \
                 conventions of the log"
            ),
            Self::AllNegated => write!(
                f,
                "all torques look negated: as they are, friction would drive the arm; check the sign convention of the log"
            ),
            Self::Scaled { joint, factor } => write!(
                f,
                "the torque of {joint} is in another unit or has another gain than the others: times {factor:.3} it agrees \
                 with them"
            ),
            Self::Late { joint, seconds, gain } => {
                let (by, side) = (1e3 * seconds.abs(), if *seconds > 0.0 { "after" } else { "before" });
                write!(
                    f,
                    "the torque of {joint} comes {by:.1} ms {side} its motion; shifted, its residual would be {:.0} % \
                     smaller. Joints that differ among each other have no common delay: friction that lags behind a \
                     reversal, a spring or an elastic joint looks the same",
                    100.0 * gain
                )
            }
            Self::Outliers { joint, count, worst, deviations } => write!(
                f,
                "{count} {} far off the model, the farthest by {deviations:.0} standard deviations (log {}, sample {}): \
                 look there, or use a robust method (irls)",
                if *count == 1 { format!("torque of {joint} lies") } else { format!("torques of {joint} lie") },
                worst.0 + 1,
                worst.1
            ),
            Self::Leverage { at, time, share } => write!(
                f,
                "{:.0} % of what the data say come from {:.1} % of the time (log {}, from sample {}): the estimate hangs \
                 on it",
                100.0 * share,
                100.0 * time,
                at.0 + 1,
                at.1
            ),
            Self::Weak { combination, share, joints } => write!(
                f,
                "the motion hardly excites {combination} (1/{:.0} of what it excites most): move {} faster, farther and \
                 against each other",
                1.0 / share,
                joints.join(" and ")
            ),
        }
    }
}

/// A direction is weak below this share of the strongest, columns of unit length: condition numbers of 50 to 100 are
/// what optimised excitations reach.
const WEAK: f64 = 1.0 / 500.0;

/// Joints that see the same arm leave at most this many times the residual that each leaves with parameters of its own.
const DISAGREEMENT: f64 = 2.0;

/// What the factors alone tell: signs, units, weak directions. Costs nothing against collecting them.
pub fn screen_factors(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Vec<Finding> {
    let disagree = factors.iter().zip(&estimate.noise).any(|(factor, noise)| *noise > DISAGREEMENT * own_noise(factor));
    let mut findings = if disagree { wrong_torques(set, base, joints, factors) } else { Vec::new() };
    if findings.is_empty() && friction_drives(set, base, &estimate.values, &estimate.standard_deviations()) {
        findings.push(Finding::AllNegated);
    }
    findings.extend(weak_direction(base.names(), joints, estimate));
    findings
}

/// Signs and units, joint by joint: the factor on a joint's torque with which it agrees best with the other joints.
fn wrong_torques(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
) -> Vec<Finding> {
    // Residual ratio by which a correction must be better before anyone is told.
    const BETTER: f64 = 2.0;
    let rank = base.rank();
    let mut factors = factors.to_vec();
    let mut noise: Vec<f64> = factors.iter().map(own_noise).collect();
    let mut corrections = vec![1.0; joints.len()];
    for _ in 0..joints.len() {
        let now = residual(&stack(&factors, rank, &noise));
        let candidates = (0..joints.len()).map(|joint| Candidate::new(joint, &factors, &noise, rank));
        let Some(best) = candidates.min_by(|a, b| a.residual.total_cmp(&b.residual)) else { break };
        let Candidate { joint, factor, deviation, residual: after } = best;
        let suspicious = !(0.3..3.0).contains(&factor) && corrections[joint] == 1.0;
        // A joint whose torque may as well be zero agrees with everything.
        let known = factor.abs() > 10.0 * deviation * (after / total_rows(&factors)).sqrt();
        if !(suspicious && known && now > BETTER * after) {
            break;
        }
        let correction = if (-3.0..-0.3).contains(&factor) { -1.0 } else { factor };
        corrections[joint] = correction;
        for (factor, noise) in factors.iter_mut().zip(&mut noise).filter(|(factor, _)| factor.joint == joint) {
            let last = factor.factor.ncols() - 1;
            factor.factor.col_mut(last).iter_mut().for_each(|value| *value *= correction);
            *noise *= correction.abs();
        }
    }
    // What agrees is known up to a common sign: friction must brake.
    let system = stack(&factors, rank, &noise);
    let Solution { values, inverse, .. } = Solution::new(&system, &vec![0.0; rank]);
    let unit = residual(&system) / total_rows(&factors);
    let deviations: Vec<f64> = (0..rank).map(|k| (unit * inverse[(k, k)]).sqrt()).collect();
    if corrections.contains(&-1.0) && friction_drives(set, base, &values, &deviations) {
        corrections.iter_mut().for_each(|correction| *correction = -*correction);
    }
    let finding = |(joint, correction): (&String, f64)| match correction {
        1.0 => None,
        -1.0 => Some(Finding::Negated { joint: joint.clone() }),
        factor => Some(Finding::Scaled { joint: joint.clone(), factor }),
    };
    joints.iter().zip(corrections).filter_map(finding).collect()
}

/// A factor on one joint's torque.
struct Candidate {
    joint: usize,
    factor: f64,
    deviation: f64,
    residual: f64,
}

impl Candidate {
    fn new(joint: usize, factors: &[JointFactor], noise: &[f64], rank: usize) -> Self {
        let extended: Vec<JointFactor> = factors.iter().map(|factor| with_free_torque(factor, joint, rank)).collect();
        let mut noise = noise.to_vec();
        let mut found = Self { joint, factor: 1.0, deviation: 0.0, residual: f64::INFINITY };
        // The noise of the torque is scaled with it: once more with the right one.
        for _ in 0..3 {
            let system = stack(&extended, rank + 1, &noise);
            let solution = Solution::new(&system, &vec![0.0; rank + 1]);
            let (before, factor) = (found.factor, solution.values[rank]);
            let deviation = solution.inverse[(rank, rank)].sqrt();
            found = Self { joint, factor, deviation, residual: residual(&system) };
            if factor == 0.0 || !factor.is_finite() {
                break;
            }
            let own = factors.iter().zip(&mut noise).filter(|(part, _)| part.joint == joint);
            own.for_each(|(_, noise)| *noise *= (factor / before).abs());
        }
        found
    }
}

fn residual(system: &Mat<f64>) -> f64 {
    let last = system.ncols() - 1;
    system[(last, last)].powi(2)
}

fn total_rows(factors: &[JointFactor]) -> f64 {
    factors.iter().filter(|factor| !factor.resting).map(|factor| factor.rows as f64).sum::<f64>().max(1.0)
}

/// W base - scale tau = 0 for the joint, as it was for the others.
fn with_free_torque(factor: &JointFactor, joint: usize, rank: usize) -> JointFactor {
    if factor.joint != joint {
        return factor.clone();
    }
    let mut extended = ExtendedFactor::new(factor);
    extended.keep(1.0);
    let torque: Vec<f64> = extended.torque().iter().map(|value| -value).collect();
    extended.add(rank, torque);
    extended.finish(&vec![0.0; factor.factor.nrows()])
}

/// Whether most of the parameters that cannot be negative are, beyond doubt.
fn friction_drives(set: &ParameterSet, base: &BaseParameters, values: &[f64], deviations: &[f64]) -> bool {
    const SURE: f64 = 5.0;
    let (mut negative, mut positive) = (0, 0);
    for (k, &parameter) in base.independent().iter().enumerate() {
        if parameter < set.inertial() {
            continue;
        }
        if set.is_non_negative(parameter) && values[k].abs() > SURE * deviations[k] {
            if values[k] < 0.0 { negative += 1 } else { positive += 1 }
        }
    }
    negative > 0 && negative >= set.dof().div_ceil(2) && negative > positive
}

fn weak_direction(names: &[String], joints: &[String], estimate: &Estimate) -> Option<Finding> {
    let weakest = estimate.excitation.weakest.as_ref()?;
    if weakest.relative_singular_value >= WEAK || !estimate.excitation.unexcited.is_empty() {
        return None;
    }
    let mut combination = String::new();
    let mut moving: Vec<String> = Vec::new();
    for (k, (base, share)) in weakest.shares.iter().take(4).enumerate() {
        let sign = match (k, *share < 0.0) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => " + ",
            (_, true) => " - ",
        };
        combination += &format!("{sign}{:.2} {}", share.abs(), names[*base]);
        let own = joints
            .iter()
            .find(|joint| names[*base].strip_prefix(joint.as_str()).is_some_and(|rest| rest.starts_with('.')));
        if let Some(joint) = own.filter(|joint| !moving.contains(joint)) {
            moving.push(joint.clone());
        }
    }
    Some(Finding::Weak { combination, share: weakest.relative_singular_value, joints: moving })
}

/// What only the rows tell: torques that are late, rows far off, times on which everything hangs. Goes through the data
/// four times, and more often where torques are late by more than ten milliseconds.
///
/// - `joints`: names
/// - `rates_hz`: sampling rate of each trajectory
///
/// # Errors
/// As [`Equations::for_each`].
pub fn screen_rows(
    equations: &mut Equations<'_>,
    joints: &[String],
    rates_hz: &[f64],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Result<Vec<Finding>, IdentificationError> {
    let mut findings = late_torques(equations, joints, rates_hz)?;
    findings.extend(far_rows(equations, joints, rates_hz, factors, estimate)?);
    Ok(findings)
}

/// Shift of each joint's torque with which its own rows fit best: the vertex of the parabola through the residuals at
/// three shifts.
fn late_torques(
    equations: &Equations<'_>,
    joints: &[String],
    rates_hz: &[f64],
) -> Result<Vec<Finding>, IdentificationError> {
    // Shares of the residual that are worth a message, and shifts that a sample clock explains.
    const GAIN: f64 = 0.05;
    const SAMPLES: f64 = 0.5;
    let rate = rates_hz.iter().copied().fold(f64::INFINITY, f64::min);
    let n = joints.len();
    let residuals = |shift: isize| -> Result<Vec<f64>, IdentificationError> {
        let moved: Vec<Vec<f64>> =
            equations.trajectories().iter().map(|trajectory| shifted(trajectory.tau, n, shift)).collect();
        let trajectories = equations.trajectories().iter().zip(&moved);
        let trajectories = trajectories.map(|(trajectory, tau)| Trajectory { tau, ..*trajectory }).collect();
        let others = Equations::new(equations.robot(), equations.parameter_set(), equations.base(), trajectories);
        let mut squares = vec![0.0; n];
        for factor in others.factors()?.iter().filter(|factor| !factor.resting) {
            let last = factor.factor.ncols() - 1;
            squares[factor.joint] = factor.factor[(last, last)].powi(2);
        }
        Ok(squares)
    };
    // Ten milliseconds, or a few samples where they are farther apart.
    let coarse = (0.01 * rate).round().max(2.0) as isize;
    let mut known: HashMap<isize, Vec<f64>> = HashMap::new();
    let mut residual = |joint: usize, shift: isize| -> Result<f64, IdentificationError> {
        if let Entry::Vacant(place) = known.entry(shift) {
            place.insert(residuals(shift)?);
        }
        Ok(known[&shift][joint])
    };
    let mut findings = Vec::new();
    for joint in 0..n {
        let here = residual(joint, 0)?;
        let centre = least_shift(coarse, &mut |shift| residual(joint, shift))?;
        let mut around = |step: isize| -> Result<[f64; 3], IdentificationError> {
            Ok([residual(joint, centre - step)?, residual(joint, centre)?, residual(joint, centre + step)?])
        };
        let Some(first) = Shift::new(centre, coarse, around(coarse)?)
            .filter(|fit| fit.gain(here) > GAIN && fit.samples.abs() > SAMPLES)
        else {
            continue;
        };
        // The residual is no parabola far from its minimum: once more close to it.
        let (centre, fine) = (first.samples.round() as isize, (coarse / 4).max(1));
        let around = [residual(joint, centre - fine)?, residual(joint, centre)?, residual(joint, centre + fine)?];
        let fit = Shift::new(centre, fine, around).unwrap_or(first);
        let gain = 1.0 - (fit.least / here).clamp(0.0, 1.0).sqrt();
        if fit.samples.abs() > SAMPLES && gain > 0.5 * GAIN {
            findings.push(Finding::Late { joint: joints[joint].clone(), seconds: fit.samples / rate, gain });
        }
    }
    Ok(findings)
}

/// The shift, in steps of about `coarse`, with the least residual: outwards in doubled steps as long as it falls, then back
/// in halved ones.
fn least_shift(
    coarse: isize,
    residual: &mut impl FnMut(isize) -> Result<f64, IdentificationError>,
) -> Result<isize, IdentificationError> {
    const DOUBLINGS: u32 = 5;
    let (mut centre, mut least) = (0, residual(0)?);
    for reach in (0..DOUBLINGS).map(|doubling| coarse << doubling) {
        let before = centre;
        for shift in [-reach, reach] {
            let found = residual(shift)?;
            if found < least {
                (centre, least) = (shift, found);
            }
        }
        if centre == before {
            break;
        }
    }
    let mut step = centre.abs() / 2;
    while step >= coarse {
        for shift in [centre - step, centre + step] {
            let found = residual(shift)?;
            if found < least {
                (centre, least) = (shift, found);
            }
        }
        step /= 2;
    }
    Ok(centre)
}

/// Vertex of a parabola through the squared residuals at three shifts.
#[derive(Clone, Copy, Debug)]
struct Shift {
    /// Positive where later torques fit the motion better.
    samples: f64,
    /// Squared residual there.
    least: f64,
}

impl Shift {
    fn new(centre: isize, step: isize, [before, here, after]: [f64; 3]) -> Option<Self> {
        let curvature = before + after - 2.0 * here;
        (curvature > 0.0 && here > 0.0).then(|| {
            // Beyond the three points nothing is known.
            let shift = (0.5 * (before - after) / curvature).clamp(-2.0, 2.0);
            let least = here - 0.5 * (before - after) * shift + 0.5 * curvature * shift * shift;
            Self { samples: centre as f64 + shift * step as f64, least }
        })
    }

    /// Share of the squared residual that the shift saves.
    fn gain(&self, here: f64) -> f64 {
        1.0 - self.least / here
    }
}

/// The torque of `shift` samples later, the ends repeated.
fn shifted(tau: &[f64], n: usize, shift: isize) -> Vec<f64> {
    let samples = tau.len() / n;
    let from = |k: usize| (k as isize + shift).clamp(0, samples as isize - 1) as usize;
    (0..samples).flat_map(|k| tau[from(k) * n..(from(k) + 1) * n].iter().copied()).collect()
}

fn far_rows(
    equations: &mut Equations<'_>,
    joints: &[String],
    rates_hz: &[f64],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Result<Vec<Finding>, IdentificationError> {
    // Normal noise has one row in 1e15 beyond eight deviations; friction and filters have tails.
    const FAR: f64 = 8.0;
    const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;
    // A hundredth of the time may carry this much of the information.
    const SHARE: f64 = 0.3;
    const TIME: f64 = 0.02;
    let group = Groups::of(factors);
    let directions = Directions::of(&estimate.whitened);
    let mut residuals: Vec<Vec<(f64, usize, usize)>> = vec![Vec::new(); joints.len()];
    let mut leverage: Vec<((usize, usize), f64)> = Vec::new();
    let mut coordinates = vec![0.0; directions.len()];
    let mut rows = 0usize;
    equations.for_each(|equation| {
        let noise = estimate.row_noise(group.index(&equation), equation.trajectory);
        if equation.resting || !noise.is_finite() {
            return;
        }
        rows += 1;
        residuals[equation.joint].push((equation.residual(&estimate.values), equation.trajectory, equation.sample));
        coordinates.fill(0.0);
        directions.add_coordinates(equation.columns, equation.row, 1.0 / noise, &mut coordinates);
        let weight: f64 = coordinates.iter().map(|value| value * value).sum();
        let second = (equation.sample as f64 / rates_hz[equation.trajectory]) as usize;
        match leverage.last_mut() {
            Some((at, sum)) if *at == (equation.trajectory, second) => *sum += weight,
            _ => leverage.push(((equation.trajectory, second), weight)),
        }
    })?;
    let mut findings = Vec::new();
    for (joint, own) in residuals.iter().enumerate().filter(|(_, own)| !own.is_empty()) {
        let mut sizes: Vec<f64> = own.iter().map(|(residual, ..)| residual.abs()).collect();
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let scale = (median / MEDIAN_OF_NORMAL).max(1e-9);
        let far = own.iter().filter(|(residual, ..)| residual.abs() > FAR * scale);
        let count = far.clone().count();
        if let Some(worst) = far.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())) {
            findings.push(Finding::Outliers {
                joint: joints[joint].clone(),
                count,
                worst: (worst.1, worst.2),
                deviations: worst.0.abs() / scale,
            });
        }
    }
    let total: f64 = leverage.iter().map(|(_, weight)| weight).sum();
    let time = 1.0 / leverage.len().max(1) as f64;
    if let Some(((trajectory, second), weight)) = leverage.iter().max_by(|a, b| a.1.total_cmp(&b.1))
        && time < TIME
        && *weight > SHARE * total
    {
        let sample = (*second as f64 * rates_hz[*trajectory]) as usize;
        findings.push(Finding::Leverage { at: (*trajectory, sample), time, share: weight / total });
    }
    Ok(findings)
}
