//! Fits that parts of the rows were left out of, and their errors there, from products that are
//! computed once.
//!
//! With columns X of a model and z of something beside it, the fit of both follows from that of X
//! by the Schur complement of z. What one more effect would change on left-out blocks so costs
//! little more than its products with the columns of the joints on which it acts.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::basis::{Factor, Noise};
use super::evidence::LeftOut;
use super::file_prior::FilePrior;
use super::problem::Column;
use crate::linalg::dot_in_lanes;

/// A column that less than this share of its length is left of is in the others.
const INVISIBLE: f64 = 1e-5;

/// Share of the target's squares below which squares of what is left are rounding.
const ROUNDING: f64 = 1e-9;

/// Columns beside those of a fit.
#[derive(Default)]
pub(super) struct Extra<'a> {
    pub columns: &'a [Column],
    /// One over the variance that each of their factors has before any data; none if it is empty.
    pub precision: &'a [f64],
}

/// What is believed of the columns of a fit before the data.
#[derive(Clone, Copy)]
pub(super) struct Held<'a> {
    /// The robot file at several widths, among which left-out rows choose.
    pub file: &'a [FilePrior],
    /// One over the variance that each of their factors has around zero; none if it is empty.
    pub precision: &'a [f64],
}

/// Index of the last of some models that predicts left-out folds as well as the best, up to the
/// standard error of the difference and to rounding; each with its squares of every fold.
///
/// - `rounding`: differences of their sums that are none
///
/// Source: L. Breiman and others, Classification and Regression Trees (1984), section 3.4.3.
fn weakest_as_good(squares: &[&[f64]], rounding: f64) -> usize {
    let sum = |squares: &[f64]| squares.iter().sum::<f64>();
    let best = squares.iter().copied().min_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap_or_default();
    let is_as_good = |own: &[f64]| {
        let count = best.len() as f64;
        let more: Vec<f64> = own.iter().zip(best).map(|(own, best)| own - best).collect();
        let mean = sum(&more) / count;
        let scatter: f64 = more.iter().map(|x| (x - mean).powi(2)).sum();
        sum(&more) <= (count / (count - 1.0).max(1.0) * scatter).sqrt() + rounding
    };
    squares.iter().rposition(|own| is_as_good(own)).unwrap_or_default()
}

/// Fits to all folds but one, for each of them, held by the robot file as weakly as predicts what
/// was left out as well as any other width: where the other folds do not determine a parameter its
/// error would hide what a model lacks.
pub(super) struct FoldFits {
    columns: Vec<Arc<Column>>,
    target: Arc<Column>,
    /// Per fold: joints and contiguous rows of it.
    blocks: Vec<Vec<(usize, Range<usize>)>>,
    /// Weight of a joint's rows, 1/(N·m)² (1/N²).
    weights: Vec<f64>,
    /// Products of the rows of each fold.
    products: Vec<Products>,
    folds: Vec<FoldFit>,
    /// Predicted less measured, each from the fit without its fold.
    errors: Column,
    /// Which prior of the robot file holds them.
    weakest: usize,
}

/// The fit without a fold.
struct FoldFit {
    factor: Factor,
    /// Products of the columns with the target, forward substituted.
    forward: Vec<f64>,
}

impl FoldFit {
    /// The fit to all folds but one, or to all.
    fn new(
        products: &[Products],
        left_out: Option<usize>,
        (own, file): (&[f64], Option<&FilePrior>),
    ) -> Self {
        let m = products.first().map_or(0, |fold| fold.target.len());
        let mut sum = Products::without(products, left_out, m, 0);
        if let Some(FilePrior { precision, pull }) = file {
            let rank = pull.len();
            for (i, pull) in pull.iter().enumerate() {
                sum.target[i] += pull;
                let row = &mut sum.gram[i * m..i * m + rank];
                row.iter_mut().zip(&precision[i * rank..]).for_each(|(sum, x)| *sum += x);
            }
        }
        let lengths: Vec<f64> = (0..m).map(|i| sum.gram[i * m + i]).collect();
        own.iter().enumerate().for_each(|(i, precision)| sum.gram[i * m + i] += precision);
        let factor = Factor::new(&sum.gram, &lengths, INVISIBLE);
        let forward = factor.forward(&sum.target);
        Self { factor, forward }
    }
}

impl FoldFits {
    /// The fits of `columns` to a target, each joint weighted by its noise; `folds` per joint and
    /// row. Products of columns that are in fits `like` it are taken from there.
    pub fn new(
        columns: &[Arc<Column>],
        target: &Arc<Column>,
        (noise, held): (&Noise, Held<'_>),
        (folds, like): (&[Vec<usize>], Option<&Self>),
    ) -> Self {
        let weights: Vec<f64> = noise.level.iter().map(|level| 1.0 / (level * level)).collect();
        let blocks = blocks_of(folds);
        let all: Vec<&Column> = columns.iter().map(|column| &**column).collect();
        let like = like.filter(|like| {
            Arc::ptr_eq(&like.target, target) && like.weights == weights && like.blocks == blocks
        });
        let in_like: Vec<Option<usize>> =
            columns.iter().map(|column| like.and_then(|l| l.index_of(column))).collect();
        let of_fold = |(fold, blocks): (usize, &Vec<(usize, Range<usize>)>)| {
            let known = like.map(|like| (&like.products[fold], like.columns.len()));
            Products::symmetric(&all, target, (blocks, &weights), (known, &in_like))
        };
        let products: Vec<Products> = blocks.par_iter().enumerate().map(of_fold).collect();
        let with = |prior: Option<&FilePrior>| {
            let without =
                |fold: usize| FoldFit::new(&products, Some(fold), (held.precision, prior));
            let folds: Vec<FoldFit> = (0..blocks.len()).into_par_iter().map(without).collect();
            let squares = |(fold, products): (&FoldFit, &Products)| {
                products.change(&fold.factor.backward(&fold.forward))
            };
            (folds.iter().zip(&products).map(squares).collect::<Vec<f64>>(), folds)
        };
        let mut widths: Vec<_> = held.file.iter().map(Some).chain([None]).map(with).collect();
        // Squares of what is left are differences of those of the target.
        let size: f64 = target
            .iter()
            .zip(&weights)
            .map(|(target, weight)| weight * dot_in_lanes(target, target))
            .sum();
        let squares: Vec<&[f64]> = widths.iter().map(|(squares, _)| &squares[..]).collect();
        let weakest = weakest_as_good(&squares, ROUNDING * size);
        let (_, folds) = widths.swap_remove(weakest);
        let errors = errors_of((columns, target), &blocks, &folds);
        Self {
            columns: columns.to_vec(),
            target: target.clone(),
            blocks,
            weights,
            products,
            folds,
            errors,
            weakest,
        }
    }

    fn index_of(&self, column: &Arc<Column>) -> Option<usize> {
        self.columns.iter().position(|own| Arc::ptr_eq(own, column))
    }

    /// Errors on what was left out.
    pub fn errors(&self) -> LeftOut {
        LeftOut { rows: self.errors.clone() }
    }

    /// Errors of fits to one fold alone, on that fold.
    ///
    /// - `held`: by what the fits are held
    pub fn errors_of_each(&self, held: Held<'_>) -> Column {
        let prior = (held.precision, held.file.get(self.weakest));
        let alone = |own: &Products| FoldFit::new(std::slice::from_ref(own), None, prior);
        let fits: Vec<FoldFit> = self.products.iter().map(alone).collect();
        errors_of((&self.columns, &self.target), &self.blocks, &fits)
    }

    /// Of the folds that each fit is of, the share of the squares that it leaves, joints weighted
    /// by their noise.
    pub fn shares_left_of_others(&self) -> Vec<f64> {
        let square = |&(joint, ref rows): &(usize, Range<usize>)| {
            let target = &self.target[joint][rows.clone()];
            self.weights[joint] * dot_in_lanes(target, target)
        };
        let squares: Vec<f64> =
            self.blocks.iter().map(|blocks| blocks.iter().map(square).sum()).collect();
        let share = |(left_out, fit): (usize, &FoldFit)| {
            let solution = fit.factor.backward(&fit.forward);
            let others = || (0..squares.len()).filter(|fold| *fold != left_out);
            let change: f64 = others().map(|fold| self.products[fold].change(&solution)).sum();
            1.0 + change / others().map(|fold| squares[fold]).sum::<f64>()
        };
        self.folds.iter().enumerate().map(share).collect()
    }

    /// The least that remains, with a fold left out, of what all folds tell of the torque of some
    /// columns, as a share of it: of its squares with what the other columns can make taken out.
    ///
    /// - `held`: by what the fits are held
    pub fn least_known(&self, held: Held<'_>, (columns, factors): (Range<usize>, &[f64])) -> f64 {
        let own = |fit: &FoldFit| fit.factor.squares_beside_others(columns.clone(), factors);
        let all =
            own(&FoldFit::new(&self.products, None, (held.precision, held.file.get(self.weakest))));
        let least = self.folds.iter().map(own).fold(f64::INFINITY, f64::min);
        if all > 0.0 { least / all } else { 1.0 }
    }

    /// The same of fits with columns beside those of the model, at some joints; at the others those
    /// without them.
    pub fn errors_with(&self, extra: &Extra<'_>, joints: &[usize]) -> LeftOut {
        let own: Vec<&Column> = self.columns.iter().map(|column| &**column).collect();
        let beside: Vec<&Column> = extra.columns.iter().collect();
        let mut errors = self.errors.clone();
        for (blocks, (changes, factors)) in
            self.blocks.iter().zip(self.changes(extra.precision, &own, &beside))
        {
            for (joint, rows) in blocks.iter().filter(|(joint, _)| joints.contains(joint)) {
                let errors = &mut errors[*joint][rows.clone()];
                add_columns(errors, &own, &changes, (*joint, rows));
                add_columns(errors, &beside, &factors, (*joint, rows));
            }
        }
        LeftOut { rows: errors }
    }

    /// Per fold by how much the model's parameters change with columns beside it, and the factors
    /// of these.
    fn changes(
        &self,
        precision: &[f64],
        own: &[&Column],
        beside: &[&Column],
    ) -> Vec<(Vec<f64>, Vec<f64>)> {
        let (m, k) = (own.len(), beside.len());
        let of_fold = |blocks: &Vec<(usize, Range<usize>)>| {
            Products::new(beside, own, &self.target, blocks, &self.weights)
        };
        let products: Vec<Products> = self.blocks.iter().map(of_fold).collect();
        let of_fold = |(left_out, fold): (usize, &FoldFit)| {
            let sum = Products::without(&products, Some(left_out), k, m);
            let precision = |i: usize| precision.get(i).copied().unwrap_or_default();
            let lengths: Vec<f64> = (0..k).map(|i| sum.gram[i * k + i] + precision(i)).collect();
            let along: Vec<Vec<f64>> =
                (0..k).map(|i| fold.factor.forward(&sum.across[i * m..(i + 1) * m])).collect();
            let schur = |i: usize, j: usize| {
                let prior = if i == j { precision(i) } else { 0.0 };
                sum.gram[i * k + j] + prior - dot_in_lanes(&along[i], &along[j])
            };
            let complement: Vec<f64> = (0..k * k).map(|i| schur(i / k, i % k)).collect();
            let rest: Vec<f64> =
                (0..k).map(|i| sum.target[i] - dot_in_lanes(&along[i], &fold.forward)).collect();
            let factors = Factor::new(&complement, &lengths, INVISIBLE).solve(&rest);
            let mut taken = vec![0.0; m];
            for (along, factor) in along.iter().zip(&factors) {
                taken.iter_mut().zip(along).for_each(|(sum, x)| *sum -= factor * x);
            }
            (fold.factor.backward(&taken), factors)
        };
        self.folds.iter().enumerate().map(of_fold).collect()
    }
}

/// Predicted less measured, the rows of each fold from the fit that belongs to it.
fn errors_of(
    (columns, target): (&[Arc<Column>], &Column),
    blocks: &[Vec<(usize, Range<usize>)>],
    fits: &[FoldFit],
) -> Column {
    let columns: Vec<&Column> = columns.iter().map(|column| &**column).collect();
    let mut errors: Column =
        target.iter().map(|target| target.iter().map(|target| -target).collect()).collect();
    for (blocks, fit) in blocks.iter().zip(fits) {
        let solution = fit.factor.backward(&fit.forward);
        for (joint, rows) in blocks {
            add_columns(&mut errors[*joint][rows.clone()], &columns, &solution, (*joint, rows));
        }
    }
    errors
}

/// Per fold its joints and contiguous rows.
fn blocks_of(folds: &[Vec<usize>]) -> Vec<Vec<(usize, Range<usize>)>> {
    let count = folds.iter().flatten().max().map_or(0, |last| last + 1);
    let mut blocks = vec![vec![]; count];
    for (joint, folds) in folds.iter().enumerate() {
        let mut first = 0;
        for block in folds.chunk_by(|a, b| a == b) {
            blocks[block[0]].push((joint, first..first + block.len()));
            first += block.len();
        }
    }
    blocks
}

/// Products of columns in one fold: with each other, with the target and with other columns.
struct Products {
    gram: Vec<f64>,
    target: Vec<f64>,
    across: Vec<f64>,
}

impl Products {
    /// Of all columns of a model; those that are known, at some indices of others, are taken over.
    ///
    /// - `known`: products of other columns, and how many these are
    /// - `in_known`: per column its index among them
    fn symmetric(
        columns: &[&Column],
        target: &Column,
        (blocks, weights): (&[(usize, Range<usize>)], &[f64]),
        (known, in_known): (Option<(&Self, usize)>, &[Option<usize>]),
    ) -> Self {
        let m = columns.len();
        let (new, old): (Vec<usize>, Vec<usize>) = (0..m).partition(|k| in_known[*k].is_none());
        let pick = |some: &[usize]| -> Vec<&Column> { some.iter().map(|k| columns[*k]).collect() };
        let made = Self::new(&pick(&new), &pick(&old), target, blocks, weights);
        let mut own = Self { gram: vec![0.0; m * m], target: vec![0.0; m], across: vec![] };
        for (row, &a) in new.iter().enumerate() {
            own.target[a] = made.target[row];
            new.iter()
                .enumerate()
                .for_each(|(k, &b)| own.gram[a * m + b] = made.gram[row * new.len() + k]);
            for (k, &b) in old.iter().enumerate() {
                let product = made.across[row * old.len() + k];
                (own.gram[a * m + b], own.gram[b * m + a]) = (product, product);
            }
        }
        if let Some((known, size)) = known {
            for (&a, in_a) in old.iter().zip(in_known.iter().flatten()) {
                own.target[a] = known.target[*in_a];
                for (&b, in_b) in old.iter().zip(in_known.iter().flatten()) {
                    own.gram[a * m + b] = known.gram[in_a * size + in_b];
                }
            }
        }
        own
    }

    fn new(
        columns: &[&Column],
        others: &[&Column],
        target: &Column,
        blocks: &[(usize, Range<usize>)],
        weights: &[f64],
    ) -> Self {
        let (k, m) = (columns.len(), others.len());
        let mut own =
            Self { gram: vec![0.0; k * k], target: vec![0.0; k], across: vec![0.0; k * m] };
        for (joint, rows) in blocks {
            let weight = weights[*joint];
            let present = |columns: &[&Column]| -> Vec<usize> {
                (0..columns.len()).filter(|&column| !columns[column][*joint].is_empty()).collect()
            };
            let (mine, theirs) = (present(columns), present(others));
            for (index, &a) in mine.iter().enumerate() {
                let x = &columns[a][*joint][rows.clone()];
                own.target[a] += weight * dot_in_lanes(x, &target[*joint][rows.clone()]);
                for &b in &mine[..=index] {
                    own.gram[a * k + b] +=
                        weight * dot_in_lanes(x, &columns[b][*joint][rows.clone()]);
                }
                for &b in &theirs {
                    own.across[a * m + b] +=
                        weight * dot_in_lanes(x, &others[b][*joint][rows.clone()]);
                }
            }
        }
        for a in 0..k {
            (0..a).for_each(|b| own.gram[b * k + a] = own.gram[a * k + b]);
        }
        own
    }

    /// By how much the weighted squares of what is left of the target grow with factors of the
    /// columns.
    fn change(&self, factors: &[f64]) -> f64 {
        let m = factors.len();
        let along =
            |i: usize| dot_in_lanes(&self.gram[i * m..(i + 1) * m], factors) - 2.0 * self.target[i];
        (0..m).map(|i| factors[i] * along(i)).sum()
    }

    /// The sum of all folds, or of all but one, for `k` columns and `m` others.
    fn without(all: &[Self], left_out: Option<usize>, k: usize, m: usize) -> Self {
        let mut sum =
            Self { gram: vec![0.0; k * k], target: vec![0.0; k], across: vec![0.0; k * m] };
        for (_, own) in all.iter().enumerate().filter(|(fold, _)| Some(*fold) != left_out) {
            let parts = [
                (&mut sum.gram, &own.gram),
                (&mut sum.target, &own.target),
                (&mut sum.across, &own.across),
            ];
            parts
                .into_iter()
                .for_each(|(sum, own)| sum.iter_mut().zip(own).for_each(|(sum, x)| *sum += x));
        }
        sum
    }
}

/// Adds columns times factors to some rows of a joint.
fn add_columns(
    out: &mut [f64],
    columns: &[&Column],
    factors: &[f64],
    (joint, rows): (usize, &Range<usize>),
) {
    for (column, factor) in
        columns.iter().zip(factors).filter(|(column, _)| !column[joint].is_empty())
    {
        out.iter_mut().zip(&column[joint][rows.clone()]).for_each(|(out, x)| *out += factor * x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::internal::Random;

    /// Fits anew to what is left, by another way than the products: QR of all rows of the other
    /// folds, and of one for each factor that is expected to be near to a value.
    fn anew(
        columns: &[Column],
        target: &Column,
        folds: &[Vec<usize>],
        expected: &[(f64, f64)],
    ) -> Column {
        let count = 1 + *folds.iter().flatten().max().expect("rows");
        let mut errors: Column = target.iter().map(|t| vec![0.0; t.len()]).collect();
        for fold in 0..count {
            let rows: Vec<(usize, usize)> = (0..target.len())
                .flat_map(|joint| (0..target[joint].len()).map(move |row| (joint, row)))
                .filter(|(joint, row)| folds[*joint][*row] != fold)
                .collect();
            let value = |c: &Column, (joint, row): (usize, usize)| {
                c[joint].get(row).copied().unwrap_or_default()
            };
            let x =
                nalgebra::DMatrix::from_fn(rows.len() + expected.len(), columns.len(), |i, j| {
                    let of_prior = |k: usize| if k == j { 1.0 / expected[k].1 } else { 0.0 };
                    rows.get(i)
                        .map_or_else(|| of_prior(i - rows.len()), |row| value(&columns[j], *row))
                });
            let y = nalgebra::DVector::from_fn(rows.len() + expected.len(), |i, _| {
                let of_prior = |k: usize| expected[k].0 / expected[k].1;
                rows.get(i).map_or_else(|| of_prior(i - rows.len()), |row| value(target, *row))
            });
            let factors = x.svd(true, true).solve(&y, 1e-12).expect("both sides were asked for");
            for joint in 0..target.len() {
                for row in (0..target[joint].len()).filter(|&row| folds[joint][row] == fold) {
                    let predicted: f64 = columns
                        .iter()
                        .zip(&factors)
                        .map(|(c, factor)| factor * value(c, (joint, row)))
                        .sum();
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
            present
                .iter()
                .map(|p| (0..if *p { 40 } else { 0 }).map(|_| random.normal()).collect())
                .collect()
        };
        let model = [column([true, true]), column([true, false]), column([false, true])];
        let beside = [column([true, false]), column([true, true])];
        let target = Arc::new(column([true, true]));
        let folds: Vec<Vec<usize>> =
            vec![(0..40).map(|k| (k / 4) % 5).collect(), (0..40).map(|k| (k / 3) % 5).collect()];
        let noise = Noise::white(&vec![vec![1.0; 40]; 2]);
        let none = Held { file: &[], precision: &[] };
        let shared: Vec<Arc<Column>> = model.iter().cloned().map(Arc::new).collect();
        let fits = FoldFits::new(&shared, &target, (&noise, none), (&folds, None));
        let close = |own: &LeftOut, other: &Column| {
            for (own, other) in own.rows.iter().flatten().zip(other.iter().flatten()) {
                assert!((own - other).abs() < 1e-9, "{own} {other}");
            }
        };
        close(&fits.errors(), &anew(&model, &target, &folds, &[]));
        let with = fits.errors_with(&Extra { columns: &beside, precision: &[] }, &[0, 1]);
        close(&with, &anew(&[&model[..], &beside[..]].concat(), &target, &folds, &[]));
        // Made like others, of some of their columns and one more.
        let another = Arc::new(column([true, true]));
        let some = [shared[2].clone(), another.clone(), shared[0].clone()];
        let like = FoldFits::new(&some, &target, (&noise, none), (&folds, Some(&fits)));
        let some = [model[2].clone(), another.to_vec(), model[0].clone()];
        close(&like.errors(), &anew(&some, &target, &folds, &[]));
        // Each column shows in one fold alone, without which its factor is noise: what expects
        // factors of zero predicts the target best, which has nothing to do with them.
        let shows = |fold: usize| {
            let mut column = column([true, false]);
            let rows = column[0].iter_mut().zip(&folds[0]).filter(|(_, own)| **own != fold);
            rows.for_each(|(x, _)| *x *= 1e-3);
            column
        };
        let model: Vec<Column> = (0..5).map(shows).collect();
        let prior = |mean: f64, deviation: f64| {
            let precision = |at: usize| if at / 5 == at % 5 { deviation.powi(-2) } else { 0.0 };
            FilePrior {
                precision: (0..25).map(precision).collect(),
                pull: vec![mean * deviation.powi(-2); 5],
            }
        };
        let priors = [prior(5.0, 0.1), prior(0.0, 0.1), prior(0.0, 100.0)];
        let of_file = Held { file: &priors, precision: &[] };
        let shared: Vec<Arc<Column>> = model.iter().cloned().map(Arc::new).collect();
        let held = FoldFits::new(&shared, &target, (&noise, of_file), (&folds, None));
        close(&held.errors(), &anew(&model, &target, &folds, &[(0.0, 0.1); 5]));
        let with = held.errors_with(&Extra { columns: &beside, precision: &[] }, &[0, 1]);
        close(&with, &anew(&[&model[..], &beside[..]].concat(), &target, &folds, &[(0.0, 0.1); 5]));
        let each = Held { file: &[], precision: &[100.0; 5] };
        let each = FoldFits::new(&shared, &target, (&noise, each), (&folds, None));
        close(&each.errors(), &anew(&model, &target, &folds, &[(0.0, 0.1); 5]));
        let squares: [&[f64]; 4] =
            [&[1.0, 2.0, 1.0], &[1.1, 1.9, 1.1], &[1.0, 9.0, 1.0], &[3.0, 4.0, 3.0]];
        assert_eq!((weakest_as_good(&squares, 0.0), weakest_as_good(&squares, 6.0)), (2, 3));
    }

    /// Squares of what is left of one column beside others, by QR.
    fn squares_beside(column: &[f64], others: &[Vec<f64>]) -> f64 {
        let matrix = nalgebra::DMatrix::from_fn(column.len(), others.len(), |i, j| others[j][i]);
        let q = matrix.qr().q();
        let column = nalgebra::DVector::from_column_slice(column);
        (&column - &q * (q.transpose() * &column)).norm_squared()
    }

    #[test]
    fn what_one_fold_tells_of_a_column_is_not_known_without_it() {
        let mut random = Random::new(7);
        let mut noise = || (0..50).map(|_| random.normal()).collect::<Vec<f64>>();
        let (level, first, second) = (vec![1.0; 50], noise(), noise());
        let folds: Vec<usize> = (0..50).map(|row| row / 10).collect();
        let without = |column: &[f64], fold: usize| -> Vec<f64> {
            column.iter().zip(&folds).filter(|(_, own)| **own != fold).map(|(x, _)| *x).collect()
        };
        let least_known = |step: &[f64], factors: &[f64]| {
            let columns =
                [&level[..], step, &first, &second].map(|column| Arc::new(vec![column.to_vec()]));
            let target = Arc::new(vec![second.clone()]);
            let none = Held { file: &[], precision: &[] };
            let fits = FoldFits::new(
                &columns,
                &target,
                (&Noise::white(&vec![level.clone()]), none),
                (std::slice::from_ref(&folds), None),
            );
            fits.least_known(none, (1..1 + factors.len(), factors))
        };
        let share = |column: &[f64], others: &[&[f64]]| {
            let left = |fold: usize| {
                let others: Vec<Vec<f64>> =
                    others.iter().map(|other| without(other, fold)).collect();
                squares_beside(&without(column, fold), &others)
            };
            let others: Vec<Vec<f64>> = others.iter().map(|other| other.to_vec()).collect();
            (0..5).map(left).fold(f64::INFINITY, f64::min) / squares_beside(column, &others)
        };
        for begin in [15, 25, 38, 40] {
            let step: Vec<f64> = (0..50).map(|row| f64::from(u8::from(row >= begin))).collect();
            let both: Vec<f64> =
                step.iter().zip(&first).map(|(step, first)| 2.0 * step - 0.5 * first).collect();
            for (own, expected) in [
                (least_known(&step, &[3.0]), share(&step, &[&level, &first, &second])),
                (least_known(&step, &[2.0, -0.5]), share(&both, &[&level, &second])),
            ] {
                assert!((own - expected).abs() < 1e-9, "{begin}: {own} {expected}");
            }
        }
        // What begins in the last fold is not known without it.
        let last: Vec<f64> = (0..50).map(|row| f64::from(u8::from(row >= 40))).collect();
        assert!(least_known(&last, &[1.0]) < 1e-9);
        assert_eq!(least_known(&last, &[]), 1.0);
    }
}
