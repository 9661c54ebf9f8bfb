//! How much of a residual a smooth function of some variables explains on blocks of time that it
//! has not seen.
//!
//! Ridge regression on random Fourier features, the weight of the penalty chosen by the blocks.
//!
//! Source: A. Rahimi, B. Recht, Random features for large-scale kernel machines, NIPS (2007).

use std::ops::Range;

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Col, ColRef, Mat, MatRef, Par};

use super::super::problem::FOLDS;
use super::rows::JointRows;
use crate::linalg::{cholesky, dot_in_lanes};
use sgpr_numeric::internal::Random;
use sgpr_predict::internal::cos_in_place;

/// A variable that a joint's torque may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Variable {
    Position(usize),
    Speed(usize),
    Acceleration,
    Load,
}

/// A third of the features see a speed through asinh(dq / share of the highest): what happens near
/// a reversal is stretched.
const SLOW_SHARE: f64 = 0.02;

/// Length scales of the features, in standard deviations of the variables.
const LENGTH_SCALES: [f64; 3] = [0.4, 1.0, 3.0];

/// Penalties that are tried, relative to the mean of the diagonal.
const PENALTIES: [f64; 6] = [1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0];

/// Columns of a smooth function and their coefficients.
pub(super) struct Smooth {
    variables: Vec<Variable>,
    draws: Vec<(Vec<f64>, f64)>,
    moments: Vec<(f64, f64)>,
    top: Vec<f64>,
}

impl Smooth {
    /// `count` random features of the variables.
    pub fn new(rows: &JointRows, variables: &[Variable], count: usize, seed: u64) -> Self {
        let mut smooth = Self {
            variables: variables.to_vec(),
            draws: vec![],
            moments: vec![],
            top: (0..rows.dq.len()).map(|joint| rows.top_speed(joint)).collect(),
        };
        let inputs = smooth.inputs(rows, false);
        smooth.moments = inputs.iter().map(|values| mean_and_deviation(values)).collect();
        let mut random = Random::new(0x5eed ^ seed);
        smooth.draws = (0..count)
            .map(|k| {
                let scale = LENGTH_SCALES[k % LENGTH_SCALES.len()];
                let mut weights = Vec::new();
                for variable in variables {
                    if let Variable::Speed(_) = variable {
                        let stretched = random.below(3) == 0;
                        let weight = random.normal() / scale;
                        weights.extend(if stretched { [0.0, weight] } else { [weight, 0.0] });
                    } else {
                        weights.push(random.normal() / scale);
                    }
                }
                (weights, std::f64::consts::TAU * random.uniform())
            })
            .collect();
        smooth
    }

    fn inputs(&self, rows: &JointRows, mirrored: bool) -> Vec<Vec<f64>> {
        let mut inputs = Vec::new();
        for variable in &self.variables {
            match *variable {
                Variable::Position(joint) => inputs.push(rows.q[joint].clone()),
                Variable::Acceleration => inputs.push(rows.ddq.clone()),
                Variable::Load => inputs.push(rows.load.clone()),
                Variable::Speed(joint) => {
                    let sign = if mirrored && joint == rows.joint { -1.0 } else { 1.0 };
                    let slow = SLOW_SHARE * self.top[joint];
                    inputs.push(rows.dq[joint].iter().map(|dq| sign * dq).collect());
                    inputs
                        .push(rows.dq[joint].iter().map(|dq| (sign * dq / slow).asinh()).collect());
                }
            }
        }
        inputs
    }

    /// The columns, a constant first; `mirrored` with the speed of the joint itself reversed.
    pub fn columns(&self, rows: &JointRows, mirrored: bool) -> Vec<Vec<f64>> {
        let inputs = self.inputs(rows, mirrored);
        let mut columns = vec![vec![1.0; rows.len()]];
        for (weights, phase) in &self.draws {
            let mut column = vec![*phase; rows.len()];
            let used = inputs
                .iter()
                .zip(weights)
                .zip(&self.moments)
                .filter(|((_, weight), _)| **weight != 0.0);
            for ((values, weight), (mean, deviation)) in used {
                let factor = weight / deviation;
                column.iter_mut().zip(values).for_each(|(x, value)| *x += factor * (value - mean));
            }
            cos_in_place(&mut column);
            columns.push(column);
        }
        columns
    }
}

/// What columns explain.
#[derive(Clone, Debug, Default)]
pub(super) struct Explained {
    /// Share of the residual's energy that is explained on blocks that were left out; negative if
    /// it only fits noise.
    pub share: f64,
    /// What each row is predicted to be by the other blocks.
    pub predicted: Vec<f64>,
    /// Coefficients from all rows.
    pub coefficients: Vec<f64>,
}

/// Products of some rows of columns with each other, `[k, k]`, the lower triangle, and with a
/// target, `[k]`.
struct RidgeSums {
    gram: Mat<f64>,
    target: Vec<f64>,
}

impl RidgeSums {
    fn new(columns: MatRef<'_, f64>, target: &[f64]) -> Self {
        let k = columns.ncols();
        let mut gram = Mat::zeros(k, k);
        let lower = BlockStructure::TriangularLower;
        let all = BlockStructure::Rectangular;
        triangular::matmul(
            gram.as_mut(),
            lower,
            Accum::Replace,
            columns.transpose(),
            all,
            columns,
            all,
            1.0,
            Par::Seq,
        );
        let along = columns.transpose() * ColRef::from_slice(target);
        Self { gram, target: along.iter().copied().collect() }
    }

    /// All of them but one, or all.
    fn sum(all: &[Self], skip: Option<usize>) -> Self {
        let k = all[0].target.len();
        let mut sum = Self { gram: Mat::zeros(k, k), target: vec![0.0; k] };
        for (_, own) in all.iter().enumerate().filter(|(index, _)| Some(*index) != skip) {
            sum.gram += &own.gram;
            sum.target.iter_mut().zip(&own.target).for_each(|(sum, x)| *sum += x);
        }
        sum
    }

    /// Solves (G + penalty · mean of the diagonal · 1) x = b.
    fn ridge(&self, penalty: f64) -> Col<f64> {
        let k = self.target.len();
        let mean = (0..k).map(|i| self.gram[(i, i)]).sum::<f64>() / k as f64;
        let shift = penalty * mean + f64::MIN_POSITIVE;
        let shifted =
            Mat::from_fn(
                k,
                k,
                |i, j| if i == j { self.gram[(i, j)] + shift } else { self.gram[(i, j)] },
            );
        let mut x = Col::from_fn(k, |i| self.target[i]);
        match cholesky(shifted.as_ref()) {
            Some(upper) => {
                solve_lower_triangular_in_place(upper.transpose(), x.as_mat_mut(), Par::Seq);
                solve_upper_triangular_in_place(upper.as_ref(), x.as_mat_mut(), Par::Seq);
            }
            None => x.fill(0.0),
        }
        x
    }

    /// By how much the squares of what is left of the target grow with factors of the columns.
    fn change(&self, factors: &Col<f64>) -> f64 {
        let k = self.target.len();
        let along = |i: usize| {
            let below: f64 = (0..i).map(|j| self.gram[(i, j)] * factors[j]).sum();
            self.gram[(i, i)] * factors[i] + 2.0 * below - 2.0 * self.target[i]
        };
        (0..k).map(|i| factors[i] * along(i)).sum()
    }
}

/// Ridge regression of `target` on columns, judged on blocks that are left out.
pub(super) fn cross_validated(columns: &[Vec<f64>], target: &[f64], fold: &[usize]) -> Explained {
    let k = columns.len();
    let energy = dot_in_lanes(target, target);
    if energy <= 0.0 || k == 0 {
        return Explained {
            share: 0.0,
            predicted: vec![0.0; target.len()],
            coefficients: vec![0.0; k],
        };
    }
    // Rows of a fold side by side.
    let mut order: Vec<usize> = (0..fold.len()).collect();
    order.sort_by_key(|&row| fold[row]);
    let sorted = Mat::from_fn(order.len(), k, |row, column| columns[column][order[row]]);
    let y: Vec<f64> = order.iter().map(|&row| target[row]).collect();
    let mut ranges = Vec::new();
    let mut first = 0;
    for index in 0..FOLDS {
        let end = first + fold.iter().filter(|own| **own == index).count();
        ranges.push(first..end);
        first = end;
    }
    let rows = |range: &Range<usize>| sorted.as_ref().subrows(range.start, range.len());
    let products: Vec<RidgeSums> =
        ranges.iter().map(|range| RidgeSums::new(rows(range), &y[range.clone()])).collect();
    let others: Vec<RidgeSums> =
        (0..FOLDS).map(|index| RidgeSums::sum(&products, Some(index))).collect();
    let with = |penalty: f64| {
        let all: Vec<Col<f64>> = others.iter().map(|others| others.ridge(penalty)).collect();
        let left: f64 = products.iter().zip(&all).map(|(own, x)| own.change(x)).sum();
        (left, penalty, all)
    };
    let best = PENALTIES.into_iter().map(with).min_by(|a, b| a.0.total_cmp(&b.0));
    let (left, penalty, all) = best.expect("some penalties");
    let mut predicted = vec![0.0; target.len()];
    for (range, x) in ranges.iter().zip(&all) {
        let own = rows(range) * x;
        range.clone().zip(own.iter()).for_each(|(row, own)| predicted[order[row]] = *own);
    }
    let coefficients = RidgeSums::sum(&products, None).ridge(penalty).iter().copied().collect();
    Explained { share: -left / energy, predicted, coefficients }
}

/// Mean and standard deviation; the latter never zero.
pub(super) fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt().max(1e-9))
}
