//! Torques that are late, found beside the memory of a record in one pass through the rows.
//!
//! [`screen_delays`](super::screen_delays) goes through the data for each shift that it looks at.
//! Here products of the rows with the torques of a few rows earlier and later are summed, of every
//! fourth row that is far from turns of its joint: with them each joint's own least squares has a
//! residual at each of these shifts.

use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par};

use super::super::{Equation, JointFactor};
use super::Finding;
use super::delays::{ALONE, Shift, TOGETHER};
use crate::linalg::cholesky;

/// Shifts of the torque, in rows.
const SHIFTS: [isize; 9] = [-8, -4, -2, -1, 0, 1, 2, 4, 8];
/// Rows before and after one that its shifts need.
const REACH: usize = 8;
/// Rows that are held.
const HELD: usize = 2 * REACH + 1;
/// Of so many rows one counts: neighbours say the same.
const STEP: usize = 4;
/// Rows for each parameter without which a small residual means nothing.
const ROWS: usize = 6;
/// Share of a column's square that is added to it, so that columns without content have a solution.
const RIDGE: f64 = 1e-12;
/// Shifts by less of a row are within what its neighbours tell.
const LEAST_SHIFT: f64 = 0.1;

/// Products of the rows of moving joints with shifted torques.
pub(crate) struct ShiftedTorques {
    /// By joint; none without rows in motion.
    joints: Vec<Option<ShiftProducts>>,
}

struct ShiftProducts {
    /// Columns of a row without its torque.
    columns: usize,
    /// The last rows, each at its number modulo [`HELD`], the torque last; and whether they are
    /// calm.
    held: Vec<f64>,
    calm: [bool; HELD],
    /// Trajectory and number of the last row, and how many came without a hole up to it.
    at: Option<(usize, usize)>,
    run: usize,
    /// Lower triangle of the sum of products, `[columns + shifts]` squared, row-major.
    sum: Vec<f64>,
    rows: usize,
    row: Vec<f64>,
}

impl ShiftedTorques {
    /// Of the rows in motion that these factors have.
    pub fn new(factors: &[JointFactor]) -> Self {
        let count = factors.iter().map(|factor| factor.joint + 1).max().unwrap_or_default();
        let mut joints: Vec<Option<ShiftProducts>> = (0..count).map(|_| None).collect();
        for factor in factors.iter().filter(|factor| !factor.resting) {
            joints[factor.joint] = Some(ShiftProducts::new(factor.columns.len()));
        }
        Self { joints }
    }

    /// Adds an equation; those of a joint come in order.
    ///
    /// - `place`: number of its row in its trajectory
    /// - `is_calm`: whether it is far from turns of its joint and from the ends of the log
    pub fn push(&mut self, equation: &Equation<'_>, place: usize, is_calm: bool) {
        if let (false, Some(products)) = (equation.resting, &mut self.joints[equation.joint]) {
            products.push(equation, place, is_calm);
        }
    }

    /// Torques that are late or early: all together, or else single joints; to about a row.
    ///
    /// - `joints`: names
    /// - `rates_hz`: rows per second of each trajectory
    pub fn findings(&self, joints: &[String], rates_hz: &[f64]) -> Vec<Finding> {
        let rate = rates_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let judged: Vec<(usize, f64, [f64; SHIFTS.len()])> = (self.joints.iter().enumerate())
            .filter_map(|(joint, products)| {
                let products = products.as_ref()?;
                Some((joint, products.rows as f64, products.residuals()?))
            })
            .collect();
        let rows: f64 = judged.iter().map(|(_, rows, _)| rows).sum();
        let together = |shift: usize| {
            let sum: f64 = judged.iter().map(|(_, rows, squares)| rows * squares[shift].ln()).sum();
            (sum / rows).exp()
        };
        let together: [f64; SHIFTS.len()] = std::array::from_fn(together);
        if let Some((fit, gain)) = best(&together).filter(|_| rows > 0.0) {
            let nearest = nearest(fit.samples);
            let better =
                judged.iter().filter(|(.., squares)| squares[nearest] < squares[MIDDLE]).count();
            if fit.samples.abs() > LEAST_SHIFT && gain > TOGETHER && 2 * better > judged.len() {
                // Single joints stand apart from a clock that is right.
                return vec![Finding::AllLate { seconds: fit.samples / rate, gain }];
            }
        }
        let late = |(joint, _, squares): &(usize, f64, [f64; SHIFTS.len()])| {
            let (fit, gain) = best(squares)?;
            let is_late = fit.samples.abs() > LEAST_SHIFT && gain > ALONE;
            is_late.then(|| Finding::Late {
                joint: joints[*joint].clone(),
                seconds: fit.samples / rate,
                gain,
            })
        };
        judged.iter().filter(|_| joints.len() > 1).filter_map(late).collect()
    }
}

/// The shift by nothing.
const MIDDLE: usize = SHIFTS.len() / 2;

/// The shift that is nearest to so many rows.
fn nearest(rows: f64) -> usize {
    let apart = |shift: &usize| (SHIFTS[*shift] as f64 - rows).abs();
    (0..SHIFTS.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("there are shifts")
}

/// The shift with the least squared residual, and the share of the residual that it saves; none if
/// the residual falls to the end of what was looked at.
fn best(squares: &[f64; SHIFTS.len()]) -> Option<(Shift, f64)> {
    let least = (0..SHIFTS.len()).min_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
    // Three shifts about it, or the last three, of equal steps.
    let centre = SHIFTS[least.clamp(1, SHIFTS.len() - 2)];
    let step = centre.abs().max(1);
    let at = |shift: isize| squares[nearest(shift as f64)];
    let fit = Shift::new(centre, step, [at(centre - step), at(centre), at(centre + step)])?;
    let is_inside = fit.samples.abs() <= REACH as f64;
    is_inside.then(|| (fit, fit.gain(squares[MIDDLE])))
}

impl ShiftProducts {
    fn new(columns: usize) -> Self {
        let width = columns + SHIFTS.len();
        Self {
            columns,
            held: vec![0.0; HELD * (columns + 1)],
            calm: [false; HELD],
            at: None,
            run: 0,
            sum: vec![0.0; width * width],
            rows: 0,
            row: vec![0.0; width],
        }
    }

    fn push(&mut self, equation: &Equation<'_>, place: usize, is_calm: bool) {
        let goes_on = self.at.is_some_and(|(trajectory, last)| {
            trajectory == equation.trajectory && last + 1 == place
        });
        self.run = if goes_on { self.run + 1 } else { 1 };
        self.at = Some((equation.trajectory, place));
        let width = self.columns + 1;
        self.held[place % HELD * width..][..width].copy_from_slice(&equation.row[..width]);
        self.calm[place % HELD] = is_calm;
        if self.run < HELD {
            return;
        }
        let centre = place - REACH;
        if !centre.is_multiple_of(STEP) || !self.calm[centre % HELD] {
            return;
        }
        self.row[..self.columns]
            .copy_from_slice(&self.held[centre % HELD * width..][..self.columns]);
        for (value, shift) in self.row[self.columns..].iter_mut().zip(SHIFTS) {
            *value = self.held[centre.wrapping_add_signed(shift) % HELD * width + self.columns];
        }
        let all = self.row.len();
        for (k, value) in self.row.iter().enumerate() {
            let products = self.sum[k * all..=k * all + k].iter_mut().zip(&self.row);
            products.for_each(|(sum, other)| *sum += value * other);
        }
        self.rows += 1;
    }

    /// Squared residual at each shift; none with too few rows, or without a solution.
    fn residuals(&self) -> Option<[f64; SHIFTS.len()]> {
        if self.rows <= ROWS * self.columns {
            return None;
        }
        let all = self.row.len();
        let (columns, at) =
            (self.columns, |row: usize, column: usize| self.sum[row * all + column]);
        let scale: Vec<f64> = (0..columns)
            .map(|k| if at(k, k) > 0.0 { 1.0 / at(k, k).sqrt() } else { 1.0 })
            .collect();
        let products = Mat::from_fn(columns, columns, |row, column| {
            let (low, high) = (row.max(column), row.min(column));
            let ridge = if row == column { RIDGE } else { 0.0 };
            at(low, high) * scale[row] * scale[column] + ridge
        });
        let factor = cholesky(products.as_ref())?;
        let mut shared =
            Mat::from_fn(columns, SHIFTS.len(), |row, shift| at(columns + shift, row) * scale[row]);
        solve_lower_triangular_in_place(factor.transpose(), shared.as_mut(), Par::Seq);
        let residual = |shift: usize| {
            let explained: f64 = shared.col(shift).iter().map(|value| value * value).sum();
            at(columns + shift, columns + shift) - explained
        };
        let found: [f64; SHIFTS.len()] = std::array::from_fn(residual);
        // What rounding left of a torque that is explained whole says nothing.
        let whole = at(columns + MIDDLE, columns + MIDDLE);
        found.iter().all(|square| *square > 1e-9 * whole).then_some(found)
    }
}
