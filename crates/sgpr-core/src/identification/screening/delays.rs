//! Torques that are late: the shift against the motion with which they fit best.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::super::{Equations, IdentificationError, JointFactor, LeastSquares, Method, Trajectory};
use super::Finding;

/// Torques that are late or early: all together, and single joints beside them. Goes through the data some seven times,
/// and more often where torques are late by more than ten milliseconds.
///
/// Dry friction near a turn of its joint is torque that seems to come at another time: give equations without the rows
/// there.
///
/// - `joints`: names
/// - `rates_hz`: sampling rate of each trajectory
///
/// # Errors
/// As [`Equations::factors`].
pub fn screen_delays(
    equations: &Equations<'_>,
    joints: &[String],
    rates_hz: &[f64],
) -> Result<Vec<Finding>, IdentificationError> {
    let rate = rates_hz.iter().copied().fold(f64::INFINITY, f64::min);
    // Ten milliseconds, or a few samples where they are farther apart.
    let coarse = (0.01 * rate).round().max(2.0) as isize;
    let mut residuals = ShiftedResiduals { equations, known: HashMap::new() };
    let here = residuals.at(0)?.clone();
    let judged: Vec<usize> = (0..joints.len()).filter(|&joint| here.own[joint].is_some()).collect();
    let own = |of: &Residuals, joint: usize| of.own[joint].unwrap_or(f64::INFINITY);
    let mut findings = Vec::new();
    let mut common = 0;
    if let Some(fit) = Shift::best(coarse, &mut |shift| Ok(residuals.at(shift)?.together))? {
        let (shift, gain) = (fit.samples.round() as isize, fit.gain(here.together));
        let there = residuals.at(shift)?;
        let better = judged.iter().filter(|&&joint| own(there, joint) < own(&here, joint)).count();
        if fit.samples.abs() > SAMPLES && gain > TOGETHER && 2 * better > judged.len() {
            common = shift;
            findings.push(Finding::AllLate { seconds: fit.samples / rate, gain });
        }
    }
    for &joint in judged.iter().filter(|_| joints.len() > 1) {
        let beside = own(residuals.at(common)?, joint);
        let Some(fit) = Shift::best(coarse, &mut |shift| Ok(own(residuals.at(shift)?, joint)))? else { continue };
        let gain = fit.gain(beside);
        if (fit.samples - common as f64).abs() > SAMPLES && gain > ALONE {
            findings.push(Finding::Late { joint: joints[joint].clone(), seconds: fit.samples / rate, gain });
        }
    }
    Ok(findings)
}

/// Share of the residual that a shift of all torques must save to be worth a message: one clock delays all joints ...
pub(super) const TOGETHER: f64 = 0.05;

/// ... and one of a single joint's: what a model lacks there saves up to a fifth at one shift or another.
pub(super) const ALONE: f64 = 0.25;

/// Shifts of fewer samples are explained by a sample clock.
const SAMPLES: f64 = 0.5;

/// What is left of the torques, shifted against the motion.
struct ShiftedResiduals<'e, 'a> {
    equations: &'e Equations<'a>,
    known: HashMap<isize, Residuals>,
}

/// Squared residuals in motion.
#[derive(Clone)]
struct Residuals {
    /// Of each joint with parameters of its own; none if it has too few rows.
    own: Vec<Option<f64>>,
    /// Geometric mean over the rows of all joints, with the parameters of one arm.
    together: f64,
}

impl ShiftedResiduals<'_, '_> {
    fn at(&mut self, shift: isize) -> Result<&Residuals, IdentificationError> {
        Ok(match self.known.entry(shift) {
            Entry::Occupied(found) => found.into_mut(),
            Entry::Vacant(place) => place.insert(residuals_at(self.equations, shift)?),
        })
    }
}

fn residuals_at(equations: &Equations<'_>, shift: isize) -> Result<Residuals, IdentificationError> {
    // Rows for each parameter without which a small residual means nothing.
    const ROWS: usize = 3;
    let n = equations.robot().dof();
    let moved: Vec<Vec<f64>> =
        equations.trajectories().iter().map(|trajectory| shifted(trajectory.tau, n, shift)).collect();
    let trajectories = equations.trajectories().iter().zip(&moved);
    let trajectories = trajectories.map(|(trajectory, tau)| Trajectory { tau, ..*trajectory }).collect();
    let others = Equations::new(equations.robot(), equations.parameter_set(), equations.base(), trajectories);
    let factors: Vec<JointFactor> = others.factors()?.into_iter().filter(|factor| !factor.resting).collect();
    let mut own = vec![None; n];
    for factor in factors.iter().filter(|factor| factor.rows > ROWS * factor.columns.len()) {
        let last = factor.factor.ncols() - 1;
        own[factor.joint] = Some(factor.factor[(last, last)].powi(2));
    }
    let nominal = vec![0.0; equations.base().rank()];
    let noise = LeastSquares::new(Method::Wls).solve(&factors, equations.base(), &nominal)?.noise;
    let counted = factors.iter().zip(&noise).filter(|(factor, noise)| own[factor.joint].is_some() && **noise > 0.0);
    let (mut sum, mut rows) = (0.0, 0.0);
    for (factor, noise) in counted {
        sum += factor.rows as f64 * 2.0 * noise.ln();
        rows += factor.rows as f64;
    }
    Ok(Residuals { own, together: if rows > 0.0 { (sum / rows).exp() } else { 0.0 } })
}

/// Farthest shift that is looked for: the coarse one, doubled this often.
const DOUBLINGS: u32 = 4;

/// The shift, in steps of about `coarse`, with the least residual: outwards in doubled steps as long as it falls, then back
/// in halved ones.
fn least_shift(
    coarse: isize,
    residual: &mut impl FnMut(isize) -> Result<f64, IdentificationError>,
) -> Result<isize, IdentificationError> {
    let (mut centre, mut least) = (0, residual(0)?);
    for reach in (0..=DOUBLINGS).map(|doubling| coarse << doubling) {
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
pub(super) struct Shift {
    /// Positive where later torques fit the motion better.
    pub(super) samples: f64,
    /// Squared residual there.
    least: f64,
}

impl Shift {
    pub(super) fn new(centre: isize, step: isize, [before, here, after]: [f64; 3]) -> Option<Self> {
        let curvature = before + after - 2.0 * here;
        (curvature > 0.0 && here > 0.0).then(|| {
            // Beyond the three points nothing is known.
            let shift = (0.5 * (before - after) / curvature).clamp(-2.0, 2.0);
            let least = here - 0.5 * (before - after) * shift + 0.5 * curvature * shift * shift;
            Self { samples: centre as f64 + shift * step as f64, least }
        })
    }

    /// The vertex close to the shift with the least squared residual; none if that is none.
    fn best(
        coarse: isize,
        residual: &mut impl FnMut(isize) -> Result<f64, IdentificationError>,
    ) -> Result<Option<Self>, IdentificationError> {
        let centre = least_shift(coarse, residual)?;
        let mut around = |centre: isize, step: isize| -> Result<Option<Self>, IdentificationError> {
            Ok(Self::new(centre, step, [residual(centre - step)?, residual(centre)?, residual(centre + step)?]))
        };
        let Some(first) = around(centre, coarse)? else { return Ok(None) };
        // The residual is no parabola far from its minimum: once more close to it.
        let fit = around(first.samples.round() as isize, (coarse / 4).max(1))?.unwrap_or(first);
        // A residual that falls to the end of what was looked at has no minimum there.
        Ok((fit.samples.abs() <= (coarse << DOUBLINGS) as f64).then_some(fit))
    }

    /// Share of the residual that the shift saves.
    pub(super) fn gain(&self, here: f64) -> f64 {
        1.0 - (self.least / here).clamp(0.0, 1.0).sqrt()
    }
}

/// The torque of `shift` samples later, the ends repeated.
fn shifted(tau: &[f64], n: usize, shift: isize) -> Vec<f64> {
    let samples = tau.len() / n;
    let from = |k: usize| (k as isize + shift).clamp(0, samples as isize - 1) as usize;
    (0..samples).flat_map(|k| tau[from(k) * n..(from(k) + 1) * n].iter().copied()).collect()
}
