//! Factors with more, other or scaled columns: what is linear in the rows of [W tau] needs no
//! second look at the data.

use faer::Mat;

use super::JointFactor;
use crate::linalg::triangle;

/// A factor under construction: every column is a combination of the columns of a [`JointFactor`].
pub(super) struct ExtendedFactor<'a> {
    source: &'a JointFactor,
    columns: Vec<(usize, Vec<f64>)>,
}

impl<'a> ExtendedFactor<'a> {
    pub fn new(source: &'a JointFactor) -> Self {
        Self { source, columns: Vec::new() }
    }

    /// sum over the base parameters in the rows of `share(base parameter)` * their column.
    pub fn combined(&self, share: impl Fn(usize) -> f64) -> Vec<f64> {
        let height = self.source.factor.nrows();
        let mut column = vec![0.0; height];
        for (position, &base) in self.source.columns.iter().enumerate() {
            let share = share(base);
            if share != 0.0 {
                (0..=position)
                    .for_each(|row| column[row] += share * self.source.factor[(row, position)]);
            }
        }
        column
    }

    /// The torque's column.
    pub fn torque(&self) -> Vec<f64> {
        let last = self.source.factor.ncols() - 1;
        (0..self.source.factor.nrows()).map(|row| self.source.factor[(row, last)]).collect()
    }

    /// The columns of the base parameters, as they are or scaled.
    pub fn keep(&mut self, scale: f64) {
        for (position, &base) in self.source.columns.iter().enumerate() {
            let column = |row: usize| scale * self.source.factor[(row, position)];
            self.columns.push((base, (0..self.source.factor.nrows()).map(column).collect()));
        }
    }

    /// A column of the unknown `index`; left out if there is nothing in it.
    pub fn add(&mut self, index: usize, column: Vec<f64>) {
        if column.iter().any(|value| *value != 0.0) {
            self.columns.push((index, column));
        }
    }

    /// With the right-hand side.
    pub fn finish(self, right: &[f64]) -> JointFactor {
        let width = self.columns.len() + 1;
        let all = Mat::from_fn(right.len(), width, |row, column| {
            self.columns.get(column).map_or(right[row], |(_, values)| values[row])
        });
        JointFactor {
            joint: self.source.joint,
            resting: self.source.resting,
            columns: self.columns.into_iter().map(|(index, _)| index).collect(),
            factor: triangle(all.as_ref()).into(),
            rows: self.source.rows,
            least_noise: self.source.least_noise,
        }
    }
}

/// Noise of a factor with parameters of its own: what is left is no disagreement with other joints.
/// Infinite at rest, and where a brake leaves no torque at all.
pub(super) fn own_noise(factor: &JointFactor) -> f64 {
    let last = factor.factor.ncols() - 1;
    let torque = factor.factor.col(last).norm_l2();
    let left = factor.factor[(last, last)].abs().max(1e-6 * torque).max(f64::MIN_POSITIVE);
    let freedom = factor.rows.saturating_sub(factor.columns.len()).max(1);
    if factor.resting || torque == 0.0 { f64::INFINITY } else { left / (freedom as f64).sqrt() }
}
