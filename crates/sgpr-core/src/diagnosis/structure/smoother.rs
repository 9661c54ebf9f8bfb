//! How much of a residual a smooth function of some variables explains on blocks of time that it has not seen.
//!
//! Ridge regression on random Fourier features, the weight of the penalty chosen by the blocks.
//!
//! Source: A. Rahimi, B. Recht, Random features for large-scale kernel machines, NIPS (2007).

use super::super::problem::FOLDS;
use super::rows::JointRows;
use crate::linalg::dot_in_lanes;
use crate::random::Random;
use sgpr_predict::internal::cos_in_place;

/// A variable that a joint's torque may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Variable {
    Position(usize),
    Speed(usize),
    Acceleration,
    Load,
}

/// A third of the features see a speed through asinh(dq / share of the highest): what happens near a reversal is stretched.
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
                    inputs.push(rows.dq[joint].iter().map(|dq| (sign * dq / slow).asinh()).collect());
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
            let used = inputs.iter().zip(weights).zip(&self.moments).filter(|((_, weight), _)| **weight != 0.0);
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
    /// Share of the residual's energy that is explained on blocks that were left out; negative if it only fits noise.
    pub share: f64,
    /// What each row is predicted to be by the other blocks.
    pub predicted: Vec<f64>,
    /// Coefficients from all rows.
    pub coefficients: Vec<f64>,
}

/// Ridge regression of `target` on columns, judged on blocks that are left out.
pub(super) fn cross_validated(columns: &[Vec<f64>], target: &[f64], fold: &[usize]) -> Explained {
    let k = columns.len();
    let mut order: Vec<usize> = (0..fold.len()).collect();
    order.sort_by_key(|&row| fold[row]);
    let sorted: Vec<Vec<f64>> = columns.iter().map(|column| order.iter().map(|&row| column[row]).collect()).collect();
    let y: Vec<f64> = order.iter().map(|&row| target[row]).collect();
    let energy = dot_in_lanes(&y, &y);
    if energy <= 0.0 || k == 0 {
        return Explained { share: 0.0, predicted: vec![0.0; target.len()], coefficients: vec![0.0; k] };
    }
    let mut ranges = Vec::new();
    let mut first = 0;
    for index in 0..FOLDS {
        let end = first + fold.iter().filter(|own| **own == index).count();
        ranges.push(first..end);
        first = end;
    }
    let grams: Vec<(Vec<f64>, Vec<f64>)> = ranges
        .iter()
        .map(|range| {
            let mut gram = vec![0.0; k * k];
            for i in 0..k {
                for j in 0..=i {
                    let value = dot_in_lanes(&sorted[i][range.clone()], &sorted[j][range.clone()]);
                    gram[i * k + j] = value;
                    gram[j * k + i] = value;
                }
            }
            let b = sorted.iter().map(|column| dot_in_lanes(&column[range.clone()], &y[range.clone()])).collect();
            (gram, b)
        })
        .collect();
    let sum = |skip: Option<usize>| {
        let mut total = (vec![0.0; k * k], vec![0.0; k]);
        for (_, (gram, b)) in grams.iter().enumerate().filter(|(index, _)| Some(*index) != skip) {
            total.0.iter_mut().zip(gram).for_each(|(t, g)| *t += g);
            total.1.iter_mut().zip(b).for_each(|(t, b)| *t += b);
        }
        total
    };
    let sums: Vec<(Vec<f64>, Vec<f64>)> = (0..FOLDS).map(|index| sum(Some(index))).collect();
    let mut best: Option<(f64, f64, Vec<Vec<f64>>)> = None;
    for penalty in PENALTIES {
        let mut left = 0.0;
        let mut all = Vec::new();
        for (index, (gram, b)) in sums.iter().enumerate() {
            let x = ridge(gram, b, penalty);
            let (own, own_b) = &grams[index];
            let quadratic: f64 = (0..k).map(|i| x[i] * dot_in_lanes(&own[i * k..(i + 1) * k], &x)).sum();
            let linear: f64 = own_b.iter().zip(&x).map(|(b, x)| b * x).sum();
            left += quadratic - 2.0 * linear;
            all.push(x);
        }
        if best.as_ref().is_none_or(|(least, ..)| left < *least) {
            best = Some((left, penalty, all));
        }
    }
    let (left, penalty, all) = best.expect("some penalties");
    let mut predicted = vec![0.0; target.len()];
    for (range, x) in ranges.into_iter().zip(&all) {
        for row in range {
            predicted[order[row]] = sorted.iter().zip(x).map(|(column, x)| column[row] * x).sum();
        }
    }
    let (gram, b) = sum(None);
    Explained { share: -left / energy, predicted, coefficients: ridge(&gram, &b, penalty) }
}

/// Solves (G + penalty · mean of the diagonal · 1) x = b by Cholesky.
fn ridge(gram: &[f64], b: &[f64], penalty: f64) -> Vec<f64> {
    let k = b.len();
    let mean = (0..k).map(|i| gram[i * k + i]).sum::<f64>() / k as f64;
    let shift = penalty * mean + f64::MIN_POSITIVE;
    let mut l = vec![0.0; k * k];
    let mut x = b.to_vec();
    for i in 0..k {
        for j in 0..=i {
            let sum = dot_in_lanes(&l[i * k..i * k + j], &l[j * k..j * k + j]);
            let value = gram[i * k + j] - sum;
            if i == j {
                l[i * k + i] = (value + shift).max(1e-12 * mean + f64::MIN_POSITIVE).sqrt();
            } else {
                l[i * k + j] = value / l[j * k + j];
            }
        }
        x[i] = (x[i] - dot_in_lanes(&l[i * k..i * k + i], &x[..i])) / l[i * k + i];
    }
    for i in (0..k).rev() {
        let sum: f64 = (i + 1..k).map(|m| l[m * k + i] * x[m]).sum();
        x[i] = (x[i] - sum) / l[i * k + i];
    }
    x
}

/// Mean and standard deviation; the latter never zero.
pub(super) fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt().max(1e-9))
}
