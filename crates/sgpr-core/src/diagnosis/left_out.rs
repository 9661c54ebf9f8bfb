//! Fits that parts of the rows were left out of, and their errors there, from products that are computed once.
//!
//! With columns X of a model and z of something beside it, the fit of both follows from that of X by the Schur complement
//! of z. What one more effect would change on left-out blocks so costs little more than its products with the columns of
//! the joints on which it acts.

use rayon::prelude::*;

use super::basis::{Factor, Noise};
use super::evidence::LeftOut;
use super::problem::Column;
use crate::linalg::dot_in_lanes;

/// A column that less than this share of its length is left of is in the others.
const INVISIBLE: f64 = 1e-5;

/// Columns beside those of a fit.
#[derive(Default)]
pub(super) struct Extra<'a> {
    pub columns: &'a [Column],
    /// One over the variance that their factors have before any data, 0 for none.
    pub precision: f64,
}

/// Fits to all folds but one, for each of them.
pub(super) struct FoldFits {
    joints: Vec<JointRows>,
    /// Weight of a joint's rows, 1/(N·m)² (1/N²).
    weights: Vec<f64>,
    folds: Vec<FoldFit>,
}

/// The rows of a joint, fold by fold.
struct JointRows {
    /// Of each row its place among the rows of the problem.
    order: Vec<usize>,
    /// Where the folds begin, and the end.
    bounds: Vec<usize>,
    /// The columns that the joint has, with their indices.
    columns: Vec<(usize, Vec<f64>)>,
    target: Vec<f64>,
    /// Predicted less measured, each from the fit without its fold.
    errors: Vec<f64>,
}

/// The fit without a fold.
struct FoldFit {
    factor: Factor,
    /// Products of the columns with the target, forward substituted.
    forward: Vec<f64>,
}

impl JointRows {
    fn new(columns: &[Column], target: &Column, joint: usize, folds: &[usize], count: usize) -> Self {
        let mut order: Vec<usize> = (0..folds.len()).collect();
        order.sort_by_key(|&row| folds[row]);
        let bounds = (0..=count).map(|fold| order.partition_point(|&row| folds[row] < fold)).collect();
        let sorted = |values: &[f64]| -> Vec<f64> { order.iter().map(|&row| values[row]).collect() };
        let present = columns.iter().enumerate().filter(|(_, column)| !column[joint].is_empty());
        let columns = present.map(|(index, column)| (index, sorted(&column[joint]))).collect();
        let target = sorted(&target[joint]);
        Self { bounds, columns, errors: vec![0.0; order.len()], target, order }
    }

    fn fold(&self, fold: usize) -> std::ops::Range<usize> {
        self.bounds[fold]..self.bounds[fold + 1]
    }

    /// Values of the rows in their order among the rows of the problem.
    fn unsorted(&self, values: &[f64]) -> Vec<f64> {
        let mut by_row = vec![0.0; values.len()];
        self.order.iter().zip(values).for_each(|(&row, value)| by_row[row] = *value);
        by_row
    }
}

impl FoldFits {
    /// The fits of `columns` to a target, each joint weighted by its noise; `folds` per joint and row.
    pub fn new(columns: &[Column], target: &Column, noise: &Noise, folds: &[Vec<usize>]) -> Self {
        let count = folds.iter().flatten().max().map_or(0, |last| last + 1);
        let weights: Vec<f64> = noise.level.iter().map(|level| 1.0 / (level * level)).collect();
        let of_joint = |joint: usize| JointRows::new(columns, target, joint, &folds[joint], count);
        let mut joints: Vec<JointRows> = (0..folds.len()).map(of_joint).collect();
        let m = columns.len();
        let products: Vec<(Vec<f64>, Vec<f64>)> =
            (0..count).into_par_iter().map(|fold| products_of_fold(&joints, &weights, fold, m)).collect();
        let without = |left_out: usize| {
            let (mut gram, mut along) = (vec![0.0; m * m], vec![0.0; m]);
            for (_, (own, of_target)) in products.iter().enumerate().filter(|(fold, _)| *fold != left_out) {
                gram.iter_mut().zip(own).for_each(|(sum, x)| *sum += x);
                along.iter_mut().zip(of_target).for_each(|(sum, x)| *sum += x);
            }
            let lengths: Vec<f64> = (0..m).map(|i| gram[i * m + i]).collect();
            let factor = Factor::new(&gram, &lengths, INVISIBLE);
            let forward = factor.forward(&along);
            FoldFit { factor, forward }
        };
        let folds: Vec<FoldFit> = (0..count).into_par_iter().map(without).collect();
        let solutions: Vec<Vec<f64>> = folds.iter().map(|fold| fold.factor.backward(&fold.forward)).collect();
        for rows in &mut joints {
            rows.errors = rows.target.iter().map(|target| -target).collect();
            for fold in 0..count {
                let own = rows.bounds[fold]..rows.bounds[fold + 1];
                add_columns(&mut rows.errors[own.clone()], &rows.columns, &own, &solutions[fold]);
            }
        }
        Self { joints, weights, folds }
    }

    /// Errors on what was left out.
    pub fn errors(&self) -> LeftOut {
        LeftOut { rows: self.joints.iter().map(|rows| rows.unsorted(&rows.errors)).collect() }
    }

    /// The same of fits with columns beside those of the model, at some joints; at the others those without them.
    pub fn errors_with(&self, extra: &Extra<'_>, joints: &[usize]) -> LeftOut {
        let k = extra.columns.len();
        let sorted: Vec<Vec<Vec<f64>>> =
            self.joints.iter().enumerate().map(|(j, rows)| rows.sorted(extra, j)).collect();
        let (changes, factors): (Vec<Vec<f64>>, Vec<Vec<f64>>) = self.changes(extra, &sorted).into_iter().unzip();
        let of_joint = |(joint, rows): (usize, &JointRows)| {
            let mut errors = rows.errors.clone();
            for fold in (0..self.folds.len()).filter(|_| joints.contains(&joint)) {
                let own = rows.fold(fold);
                add_columns(&mut errors[own.clone()], &rows.columns, &own, &changes[fold]);
                for column in (0..k).filter(|&column| !sorted[joint][column].is_empty()) {
                    let values = &sorted[joint][column][own.clone()];
                    errors[own.clone()].iter_mut().zip(values).for_each(|(e, x)| *e += factors[fold][column] * x);
                }
            }
            rows.unsorted(&errors)
        };
        LeftOut { rows: self.joints.iter().enumerate().map(of_joint).collect() }
    }

    /// Per fold by how much the model's parameters change with columns beside it, and the factors of these.
    fn changes(&self, extra: &Extra<'_>, sorted: &[Vec<Vec<f64>>]) -> Vec<(Vec<f64>, Vec<f64>)> {
        let (m, k) = (self.folds.first().map_or(0, |fold| fold.forward.len()), extra.columns.len());
        let products: Vec<Products> =
            (0..self.folds.len()).map(|fold| self.products_with(sorted, fold, m, k)).collect();
        let of_fold = |(left_out, fold): (usize, &FoldFit)| {
            let mut sum = Products::zeros(m, k);
            products.iter().enumerate().filter(|(other, _)| *other != left_out).for_each(|(_, own)| sum.add(own));
            let lengths: Vec<f64> = (0..k).map(|i| sum.gram[i * k + i] + extra.precision).collect();
            let along: Vec<Vec<f64>> = sum.across.chunks(m.max(1)).map(|across| fold.factor.forward(across)).collect();
            let schur = |i: usize, j: usize| {
                let prior = if i == j { extra.precision } else { 0.0 };
                sum.gram[i * k + j] + prior - dot_in_lanes(&along[i], &along[j])
            };
            let complement: Vec<f64> = (0..k * k).map(|i| schur(i / k, i % k)).collect();
            let rest: Vec<f64> = (0..k).map(|i| sum.target[i] - dot_in_lanes(&along[i], &fold.forward)).collect();
            let factors = Factor::new(&complement, &lengths, INVISIBLE).solve(&rest);
            let mut taken = vec![0.0; m];
            for (along, factor) in along.iter().zip(&factors) {
                taken.iter_mut().zip(along).for_each(|(sum, x)| *sum -= factor * x);
            }
            (fold.factor.backward(&taken), factors)
        };
        if m == 0 || k == 0 {
            return vec![(vec![0.0; m], vec![0.0; k]); self.folds.len()];
        }
        self.folds.iter().enumerate().map(of_fold).collect()
    }

    fn products_with(&self, sorted: &[Vec<Vec<f64>>], fold: usize, m: usize, k: usize) -> Products {
        let mut sum = Products::zeros(m, k);
        for ((rows, own), weight) in self.joints.iter().zip(sorted).zip(&self.weights) {
            let at = rows.fold(fold);
            let present: Vec<usize> = (0..k).filter(|&column| !own[column].is_empty()).collect();
            for &a in &present {
                let z = &own[a][at.clone()];
                sum.target[a] += weight * dot_in_lanes(z, &rows.target[at.clone()]);
                present.iter().for_each(|&b| sum.gram[a * k + b] += weight * dot_in_lanes(z, &own[b][at.clone()]));
                let across = &mut sum.across[a * m..(a + 1) * m];
                rows.columns.iter().for_each(|(c, x)| across[*c] += weight * dot_in_lanes(z, &x[at.clone()]));
            }
        }
        sum
    }
}

impl JointRows {
    /// The rows of columns beside the model, fold by fold; empty where a column has none.
    fn sorted(&self, extra: &Extra<'_>, joint: usize) -> Vec<Vec<f64>> {
        let of_column = |column: &Column| match &column[joint] {
            values if values.is_empty() => vec![],
            values => self.order.iter().map(|&row| values[row]).collect(),
        };
        extra.columns.iter().map(of_column).collect()
    }
}

/// Products of columns beside a model in one fold: with each other, with the target and with the model's columns.
struct Products {
    gram: Vec<f64>,
    target: Vec<f64>,
    across: Vec<f64>,
}

impl Products {
    fn zeros(m: usize, k: usize) -> Self {
        Self { gram: vec![0.0; k * k], target: vec![0.0; k], across: vec![0.0; k * m] }
    }

    fn add(&mut self, other: &Self) {
        let both =
            [(&mut self.gram, &other.gram), (&mut self.target, &other.target), (&mut self.across, &other.across)];
        both.into_iter().for_each(|(sum, own)| sum.iter_mut().zip(own).for_each(|(sum, x)| *sum += x));
    }
}

/// Adds columns times factors to some rows.
fn add_columns(out: &mut [f64], columns: &[(usize, Vec<f64>)], rows: &std::ops::Range<usize>, factors: &[f64]) {
    for (index, values) in columns.iter().filter(|(index, _)| factors[*index] != 0.0) {
        out.iter_mut().zip(&values[rows.clone()]).for_each(|(out, x)| *out += factors[*index] * x);
    }
}

/// Products of the model's columns with each other and with the target in one fold.
fn products_of_fold(joints: &[JointRows], weights: &[f64], fold: usize, m: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut gram, mut along) = (vec![0.0; m * m], vec![0.0; m]);
    for (rows, weight) in joints.iter().zip(weights) {
        let at = rows.fold(fold);
        for (a, (i, x)) in rows.columns.iter().enumerate() {
            along[*i] += weight * dot_in_lanes(&x[at.clone()], &rows.target[at.clone()]);
            for (j, y) in &rows.columns[..=a] {
                let value = weight * dot_in_lanes(&x[at.clone()], &y[at.clone()]);
                gram[i * m + j] += value;
                if i != j {
                    gram[j * m + i] += value;
                }
            }
        }
    }
    (gram, along)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Fits anew to what is left, by another way than the products: QR of all rows of the other folds.
    fn anew(columns: &[Column], target: &Column, folds: &[Vec<usize>]) -> Column {
        let count = 1 + *folds.iter().flatten().max().expect("rows");
        let mut errors: Column = target.iter().map(|t| vec![0.0; t.len()]).collect();
        for fold in 0..count {
            let rows: Vec<(usize, usize)> = (0..target.len())
                .flat_map(|joint| (0..target[joint].len()).map(move |row| (joint, row)))
                .filter(|(joint, row)| folds[*joint][*row] != fold)
                .collect();
            let value = |c: &Column, (joint, row): (usize, usize)| c[joint].get(row).copied().unwrap_or_default();
            let x = nalgebra::DMatrix::from_fn(rows.len(), columns.len(), |i, j| value(&columns[j], rows[i]));
            let y = nalgebra::DVector::from_fn(rows.len(), |i, _| value(target, rows[i]));
            let factors = x.svd(true, true).solve(&y, 1e-12).expect("both sides were asked for");
            for joint in 0..target.len() {
                for row in (0..target[joint].len()).filter(|&row| folds[joint][row] == fold) {
                    let predicted: f64 =
                        columns.iter().zip(&factors).map(|(c, factor)| factor * value(c, (joint, row))).sum();
                    errors[joint][row] = predicted - target[joint][row];
                }
            }
        }
        errors
    }

    #[test]
    fn errors_are_those_of_fits_made_anew() {
        let mut random = Random::new(3);
        let mut column = |present: [bool; 2]| -> Column {
            present.iter().map(|p| (0..if *p { 40 } else { 0 }).map(|_| random.normal()).collect()).collect()
        };
        let model = [column([true, true]), column([true, false]), column([false, true])];
        let beside = [column([true, false]), column([true, true])];
        let target = column([true, true]);
        let folds: Vec<Vec<usize>> =
            vec![(0..40).map(|k| (k / 4) % 5).collect(), (0..40).map(|k| (k / 3) % 5).collect()];
        let noise = Noise::white(&vec![vec![1.0; 40]; 2]);
        let fits = FoldFits::new(&model, &target, &noise, &folds);
        let close = |own: &LeftOut, other: &Column| {
            for (own, other) in own.rows.iter().flatten().zip(other.iter().flatten()) {
                assert!((own - other).abs() < 1e-9, "{own} {other}");
            }
        };
        close(&fits.errors(), &anew(&model, &target, &folds));
        let with = fits.errors_with(&Extra { columns: &beside, precision: 0.0 }, &[0, 1]);
        close(&with, &anew(&[&model[..], &beside[..]].concat(), &target, &folds));
    }
}
