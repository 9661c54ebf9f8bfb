//! Recursive least squares with exponential forgetting, as an updated triangular factor.

use faer::Mat;

use super::estimator::{Estimator, EstimatorSetting, EstimatorTask};
use super::groups::Groups;
use super::least_squares::Solution;
use super::{Estimate, IdentificationError};

/// Least squares that takes one row after the other, with a memory that fades: for parameters that
/// change, as when a payload is picked up.
///
/// What is kept is the triangular factor of the weighted rows, turned by Givens rotations, not the
/// covariance matrix that textbooks update: it does not lose definiteness, and directions that the
/// motion stops exciting fade instead of exploding (the estimate in them stays at `nominal`).
///
/// Source: G. H. Golub, C. F. Van Loan, Matrix Computations (2013), section 6.5.3; S. Haykin,
/// Adaptive Filter Theory (2002), chapter 14 (square-root recursive least squares).
///
/// # Examples
/// ```
/// use sgpr_core::identification::RecursiveLeastSquares;
/// let mut fit = RecursiveLeastSquares::new(2, 0.9);
/// for (x, y) in [(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)] {
///     fit.forget();
///     fit.update(&[1.0, x], y);
/// }
/// let line = fit.estimate(&[0.0, 0.0]);
/// assert!((line[0] - 1.0).abs() < 1e-12 && (line[1] - 2.0).abs() < 1e-12);
/// ```
#[derive(Clone, Debug)]
pub struct RecursiveLeastSquares {
    /// `[unknowns + 1, unknowns + 1]`.
    factor: Mat<f64>,
    forgetting: f64,
    row: Vec<f64>,
    weight: f64,
}

impl RecursiveLeastSquares {
    /// Without rows.
    ///
    /// - `forgetting`: weight that what is known keeps at each [`Self::forget`], above 0 and at
    ///   most 1; 0.99 remembers about a hundred
    ///
    /// # Panics
    /// If `forgetting` is out of range.
    pub fn new(unknowns: usize, forgetting: f64) -> Self {
        assert!(forgetting > 0.0 && forgetting <= 1.0, "a share above zero and at most one");
        Self {
            factor: Mat::zeros(unknowns + 1, unknowns + 1),
            forgetting,
            row: vec![0.0; unknowns + 1],
            weight: 0.0,
        }
    }

    /// Lets what is known fade by one step.
    pub fn forget(&mut self) {
        self.weight *= self.forgetting;
        if self.forgetting < 1.0 {
            let scale = self.forgetting.sqrt();
            for j in 0..self.factor.ncols() {
                for i in 0..=j {
                    self.factor[(i, j)] *= scale;
                }
            }
        }
    }

    /// Adds the equation row * unknowns = value, both sides divided by its noise.
    ///
    /// # Panics
    /// If the row has not one number per unknown.
    pub fn update(&mut self, row: &[f64], value: f64) {
        let unknowns = self.factor.ncols() - 1;
        assert_eq!(row.len(), unknowns, "one number per unknown");
        self.row[..unknowns].copy_from_slice(row);
        self.row[unknowns] = value;
        self.absorb();
    }

    /// Number of rows that the memory holds, old ones counted by their weight.
    pub fn effective_rows(&self) -> f64 {
        self.weight
    }

    /// The unknowns; directions that the rows do not determine stay at `nominal`.
    ///
    /// # Panics
    /// If `nominal` has not one number per unknown.
    pub fn estimate(&self, nominal: &[f64]) -> Vec<f64> {
        assert_eq!(nominal.len() + 1, self.factor.ncols(), "one number per unknown");
        Solution::new(&self.factor, nominal).values
    }

    /// Turns `self.row` into the factor.
    fn absorb(&mut self) {
        self.weight += 1.0;
        let width = self.row.len();
        for k in 0..width {
            let y = self.row[k];
            if y == 0.0 {
                continue;
            }
            let x = self.factor[(k, k)];
            let length = x.hypot(y);
            let (c, s) = (x / length, y / length);
            for j in k..width {
                let (a, b) = (self.factor[(k, j)], self.row[j]);
                self.factor[(k, j)] = c * a + s * b;
                self.row[j] = c * b - s * a;
            }
        }
    }
}

/// Recursive weighted least squares, sample after sample, what is past losing weight; the estimates
/// are those at the end. Setting: weight that a sample keeps from one row of the decimated log to
/// the next; 1 forgets nothing.
pub static RECURSIVE: Estimator = Estimator {
    setting: EstimatorSetting::new("FORGETTING", 1.0),
    ..Estimator::new("rls", "recursive weighted least squares", estimate)
};

fn estimate(task: EstimatorTask<'_, '_>, start: Estimate) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { setting: forgetting, equations, factors, nominal, .. } = task;
    if !(forgetting > 0.0 && forgetting <= 1.0) {
        return Err(IdentificationError::Setting { setting: "forgetting", value: forgetting });
    }
    let group = Groups::of(factors);
    let mut fit = RecursiveLeastSquares::new(nominal.len(), forgetting);
    let mut at = None;
    equations.for_each(|equation| {
        let now = (equation.trajectory, equation.sample);
        if at.replace(now).is_some_and(|before| before != now) {
            fit.forget();
        }
        let Some(index) = group.index(&equation) else { return };
        let noise = start.weights[index];
        if noise.is_finite() {
            fit.row.fill(0.0);
            for (&column, factor) in equation.columns.iter().zip(equation.row) {
                fit.row[column] = factor / noise;
            }
            let torque = fit.row.len() - 1;
            fit.row[torque] = equation.torque() / noise;
            fit.absorb();
        }
    })?;
    let solution = Solution::new(&fit.factor, nominal);
    // In the units of the batch fit's noise and memory.
    let unknowns = nominal.len();
    let residual = |triangle: &Mat<f64>| triangle[(unknowns, unknowns)].powi(2);
    let rows: f64 = factors
        .iter()
        .zip(&start.weights)
        .filter(|(_, w)| w.is_finite())
        .map(|(f, _)| f.rows as f64)
        .sum();
    let of_batch = if residual(&start.whitened) > 0.0 {
        (rows - unknowns as f64).max(1.0) / residual(&start.whitened)
    } else {
        1.0
    };
    let found = (residual(&fit.factor) / (fit.effective_rows() - unknowns as f64).max(1.0)
        * of_batch)
        .sqrt();
    // As many unknowns as rows leave no residual: the unit is then what rounding leaves of the
    // torque.
    let torque = fit.factor.col(unknowns).norm_l2();
    let unit = found.max(1e-9 * torque / rows.max(1.0).sqrt()).max(f64::MIN_POSITIVE);
    let variance = unit * unit;
    let mut covariance = faer::Scale(variance) * &solution.inverse;
    for (k, undetermined) in solution.undetermined.iter().enumerate() {
        if *undetermined {
            covariance[(k, k)] = f64::INFINITY;
        }
    }
    let mut notes = start.notes.clone();
    notes.push(format!("the estimate rests on the last {:.0} rows", fit.effective_rows()));
    Ok(Estimate {
        covariance: covariance.into(),
        whitened: (faer::Scale(1.0 / unit) * &fit.factor).into(),
        unit,
        values: solution.values,
        notes,
        ..start
    })
}
