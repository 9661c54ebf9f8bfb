//! Torques that are late: the shift against the motion with which they fit best.

use std::collections::HashMap;

use faer::Mat;

use super::super::{
    BaseParameters, Equations, IdentificationError, JointFactor, LeastSquares, Method, Trajectory,
    TrajectoryColumn,
};
use super::Finding;

/// Torques that are late or early: all together, and single joints beside them. Goes through the
/// data twice, and more often where torques seem late by more than ten milliseconds.
///
/// Dry friction near a turn of its joint is torque that seems to come at another time: give
/// equations without the rows there.
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
    residuals.know(&[-coarse, 0, coarse])?;
    let here = &residuals.known[&0].own;
    let judged: Vec<usize> = (0..joints.len()).filter(|&joint| here[joint].is_some()).collect();
    let alone = || judged.iter().copied().filter(|_| joints.len() > 1);
    let mut firsts = HashMap::new();
    for joint in std::iter::once(None).chain(alone().map(Some)) {
        if let Some(first) = residuals.coarse_shift(joint, coarse)? {
            firsts.insert(joint, first);
        }
    }
    let fine = (coarse / 4).max(1);
    residuals.know(
        &firsts.values().flat_map(|first| around(first.nearest(), fine)).collect::<Vec<_>>(),
    )?;
    let mut best = |joint: Option<usize>| -> Result<Option<Shift>, IdentificationError> {
        let Some(first) = firsts.get(&joint) else { return Ok(None) };
        // The residual is no parabola far from its minimum.
        let fit = residuals.vertex(joint, first.nearest(), fine)?.unwrap_or(*first);
        Ok(fit.is_inside(coarse).then_some(fit))
    };
    let together = best(None)?;
    let fits = alone()
        .map(|joint| Ok((joint, best(Some(joint))?)))
        .collect::<Result<Vec<_>, IdentificationError>>()?;
    let mut findings = Vec::new();
    let mut common = 0;
    if let Some(fit) = together {
        let (shift, gain) = (fit.nearest(), fit.gain(residuals.of(None, 0)?));
        let mut better = 0;
        for &joint in &judged {
            better +=
                usize::from(residuals.of(Some(joint), shift)? < residuals.of(Some(joint), 0)?);
        }
        if fit.samples.abs() > SAMPLES && gain > TOGETHER && 2 * better > judged.len() {
            common = shift;
            findings.push(Finding::AllLate { seconds: fit.samples / rate, gain });
        }
    }
    for (joint, fit) in fits {
        let Some(fit) = fit else { continue };
        let gain = fit.gain(residuals.of(Some(joint), common)?);
        if (fit.samples - common as f64).abs() > SAMPLES && gain > ALONE {
            findings.push(Finding::Late {
                joint: joints[joint].clone(),
                seconds: fit.samples / rate,
                gain,
            });
        }
    }
    Ok(findings)
}

/// Share of the residual that a shift of all torques must save to be worth a message: one clock
/// delays all joints ...
pub(super) const TOGETHER: f64 = 0.05;

/// ... and one of a single joint's: what a model lacks there saves up to a fifth at one shift or
/// another.
pub(super) const ALONE: f64 = 0.25;

/// Shifts of fewer samples are explained by a sample clock.
const SAMPLES: f64 = 0.5;

/// Shifted torques that are held at once, 128 MB, or those of one shift.
const SHIFTED: usize = 1 << 24;

/// What is left of the torques, shifted against the motion.
struct ShiftedResiduals<'e, 'a> {
    equations: &'e Equations<'a>,
    known: HashMap<isize, Residuals>,
}

/// Squared residuals in motion.
struct Residuals {
    /// Of each joint with parameters of its own; none if it has too few rows.
    own: Vec<Option<f64>>,
    /// Geometric mean over the rows of all joints, with the parameters of one arm, once it was
    /// asked for.
    together: Option<f64>,
    /// Of the joints in motion.
    factors: Vec<JointFactor>,
}

impl ShiftedResiduals<'_, '_> {
    /// The vertex about the shift with the least squared residual, in steps of `coarse`; none if
    /// that is none.
    fn coarse_shift(
        &mut self,
        joint: Option<usize>,
        coarse: isize,
    ) -> Result<Option<Shift>, IdentificationError> {
        let centre = self.least_shift(joint, coarse)?;
        self.vertex(joint, centre, coarse)
    }

    /// The shift, in steps of about `coarse`, with the least residual: outwards in doubled steps as
    /// long as it falls, then back in halved ones.
    fn least_shift(
        &mut self,
        joint: Option<usize>,
        coarse: isize,
    ) -> Result<isize, IdentificationError> {
        let reaches: Vec<isize> = (0..=DOUBLINGS).map(|doubling| coarse << doubling).collect();
        let mut centre = 0;
        for reach in &reaches {
            let next = self.least_of(joint, [centre, -reach, *reach])?;
            if next == centre {
                break;
            }
            centre = next;
            // Who goes on may go far.
            self.know(&reaches.iter().flat_map(|reach| [-reach, *reach]).collect::<Vec<_>>())?;
        }
        let mut step = centre.abs() / 2;
        while step >= coarse {
            let [before, _, after] = around(centre, step);
            centre = self.least_of(joint, [centre, before, after])?;
            step /= 2;
        }
        Ok(centre)
    }

    /// The first of some shifts with the least residual.
    fn least_of(
        &mut self,
        joint: Option<usize>,
        shifts: [isize; 3],
    ) -> Result<isize, IdentificationError> {
        self.know(&shifts)?;
        let (mut least, mut best) = (f64::INFINITY, shifts[0]);
        for shift in shifts {
            let found = self.of(joint, shift)?;
            if found < least {
                (least, best) = (found, shift);
            }
        }
        Ok(best)
    }

    /// The vertex through the residuals about a shift.
    fn vertex(
        &mut self,
        joint: Option<usize>,
        centre: isize,
        step: isize,
    ) -> Result<Option<Shift>, IdentificationError> {
        let shifts = around(centre, step);
        self.know(&shifts)?;
        let mut found = [0.0; 3];
        for (found, shift) in found.iter_mut().zip(shifts) {
            *found = self.of(joint, shift)?;
        }
        Ok(Shift::new(centre, step, found))
    }

    /// Of one joint, or of all together.
    fn of(&mut self, joint: Option<usize>, shift: isize) -> Result<f64, IdentificationError> {
        self.know(&[shift])?;
        let residuals = self.known.get_mut(&shift).expect("just made");
        match joint {
            Some(joint) => Ok(residuals.own[joint].unwrap_or(f64::INFINITY)),
            None => residuals.together(self.equations.base()),
        }
    }

    /// Residuals at several shifts, by one pass through the data, or more where they are many.
    fn know(&mut self, shifts: &[isize]) -> Result<(), IdentificationError> {
        let mut shifts: Vec<isize> =
            shifts.iter().copied().filter(|shift| !self.known.contains_key(shift)).collect();
        shifts.sort_unstable();
        shifts.dedup();
        let numbers: usize =
            self.equations.trajectories().iter().map(|trajectory| trajectory.tau.len()).sum();
        shifts.chunks((SHIFTED / numbers.max(1)).max(1)).try_for_each(|shifts| self.pass(shifts))
    }

    /// Residuals at shifts, by one pass through the data: the rows have all the shifted torques.
    fn pass(&mut self, shifts: &[isize]) -> Result<(), IdentificationError> {
        let equations = self.equations;
        let n = equations.robot().dof();
        let column = |shift: &isize| {
            TrajectoryColumn::new(format!("torque {shift} samples later"), "", None, 1.0)
        };
        let set = equations
            .parameter_set()
            .clone()
            .with_trajectory_columns(shifts.iter().map(column).collect());
        let base = equations.base().clone().with_later_columns(&set);
        let columns = |trajectory: &Trajectory<'_>| -> Vec<Vec<f64>> {
            let moved = shifts.iter().map(|shift| shifted(trajectory.tau, n, *shift));
            trajectory.columns.iter().cloned().chain(moved).collect()
        };
        let columns: Vec<Vec<Vec<f64>>> = equations.trajectories().iter().map(columns).collect();
        let trajectories = equations.trajectories().iter().zip(&columns);
        let trajectories = trajectories
            .map(|(trajectory, columns)| Trajectory { columns, ..*trajectory })
            .collect();
        let mut factors = Equations::new(equations.robot(), &set, &base, trajectories).factors()?;
        factors.retain(|factor| !factor.resting);
        for (index, shift) in shifts.iter().enumerate() {
            let own = factors.iter().map(|factor| of_column(factor, shifts.len(), index)).collect();
            self.known.insert(*shift, Residuals::new(n, own));
        }
        Ok(())
    }
}

/// The factor with one of the last columns before the torque, of which there are `later`, in the
/// place of the torque.
fn of_column(factor: &JointFactor, later: usize, index: usize) -> JointFactor {
    let count = factor.columns.len() - later;
    let below = factor.factor.col(count + index).subrows(count, factor.factor.nrows() - count);
    let entry = |i: usize, j: usize| match (i < count, j < count) {
        (true, true) => factor.factor[(i, j)],
        (true, false) => factor.factor[(i, count + index)],
        (false, true) => 0.0,
        (false, false) => below.norm_l2(),
    };
    let triangle = Mat::from_fn(count + 1, count + 1, entry);
    JointFactor {
        columns: factor.columns[..count].to_vec(),
        factor: triangle.into(),
        ..factor.clone()
    }
}

impl Residuals {
    /// - `factors`: of the joints in motion
    fn new(joints: usize, factors: Vec<JointFactor>) -> Self {
        // Rows for each parameter without which a small residual means nothing.
        const ROWS: usize = 3;
        let mut own = vec![None; joints];
        for factor in factors.iter().filter(|factor| factor.rows > ROWS * factor.columns.len()) {
            let last = factor.factor.ncols() - 1;
            own[factor.joint] = Some(factor.factor[(last, last)].powi(2));
        }
        Self { own, together: None, factors }
    }

    fn together(&mut self, base: &BaseParameters) -> Result<f64, IdentificationError> {
        if let Some(known) = self.together {
            return Ok(known);
        }
        let noise = LeastSquares::new(Method::Wls)
            .solve(&self.factors, base, &vec![0.0; base.rank()])?
            .noise;
        let pairs = self.factors.iter().zip(&noise);
        let counted =
            pairs.filter(|(factor, noise)| self.own[factor.joint].is_some() && **noise > 0.0);
        let (mut sum, mut rows) = (0.0, 0.0);
        for (factor, noise) in counted {
            sum += factor.rows as f64 * 2.0 * noise.ln();
            rows += factor.rows as f64;
        }
        let together = if rows > 0.0 { (sum / rows).exp() } else { 0.0 };
        self.together = Some(together);
        Ok(together)
    }
}

/// Farthest shift that is looked for: the coarse one, doubled this often.
const DOUBLINGS: u32 = 4;

fn around(centre: isize, step: isize) -> [isize; 3] {
    [centre - step, centre, centre + step]
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

    /// Whole samples.
    fn nearest(&self) -> isize {
        self.samples.round() as isize
    }

    /// Whether it lies within what was looked at: a residual that falls to the end of that has no
    /// minimum there.
    fn is_inside(&self, coarse: isize) -> bool {
        self.samples.abs() <= (coarse << DOUBLINGS) as f64
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
