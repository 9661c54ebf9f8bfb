//! Noise, and least squares on whitened columns by an orthonormal basis.

use std::ops::Range;
use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::problem::{Column, Problem};
use crate::linalg::{dot_in_lanes, rms};
use crate::model::Term;
use sgpr_predict::internal::Autoregression;

/// Autoregressive noise of every joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Noise {
    phi: Vec<Vec<f64>>,
    /// Standard deviation of the innovations.
    pub sigma: Vec<f64>,
    /// Standard deviation in the band.
    pub level: Vec<f64>,
}

/// What is left of a joint's torque.
pub(super) struct Rest {
    pub residual: Vec<f64>,
    /// Parameters that were fitted.
    pub used: usize,
    /// Rows that may be noise.
    pub calm: Vec<bool>,
}

impl Rest {
    /// Of the rows that may be noise, per degree of freedom, (N·m)² (N²).
    fn variance(&self) -> f64 {
        let own =
            || self.residual.iter().zip(&self.calm).filter(|(_, calm)| **calm).map(|(x, _)| x);
        let count = own().count() as f64;
        let freedom = (count - self.used as f64).max(0.2 * count).max(1.0);
        own().map(|x| x * x).sum::<f64>() / freedom
    }
}

/// Least noise, as a share of the torque.
pub(super) const LEAST_SHARE: f64 = 1e-5;

/// Highest order of the autoregression.
pub(super) const ORDER: usize = 6;

/// Rows for each of its terms.
pub(super) const ROWS_PER_ORDER: f64 = 50.0;

impl Noise {
    /// The same with another's noise of some joints.
    pub fn with_joints_of(&self, other: &Self, joints: &[usize]) -> Self {
        let mut own = self.clone();
        for &joint in joints {
            own.phi[joint].clone_from(&other.phi[joint]);
            (own.sigma[joint], own.level[joint]) = (other.sigma[joint], other.level[joint]);
        }
        own
    }

    /// White noise of the size of the residual.
    pub fn white(residual: &Column) -> Self {
        let level: Vec<f64> = residual.iter().map(|r| rms(r).max(1e-12)).collect();
        Self { phi: vec![vec![]; residual.len()], sigma: level.clone(), level }
    }

    /// The autoregression that describes the residual of each joint best by Akaike's criterion.
    pub fn of(problem: &Problem, rests: &[Rest]) -> Self {
        // Whatever the fit says, no model of an arm is right to five digits.
        let least = |joint: usize| (LEAST_SHARE * rms(&problem.y[joint])).max(1e-12);
        let level = |(joint, rest): (usize, &Rest)| rest.variance().sqrt().max(least(joint));
        let level: Vec<f64> = rests.iter().enumerate().map(level).collect();
        let mut noise = Self { phi: vec![vec![]; rests.len()], sigma: level.clone(), level };
        for (joint, Rest { residual: r, calm, .. }) in rests.iter().enumerate() {
            let count = calm.iter().filter(|calm| **calm).count() as f64;
            let order = (count / ROWS_PER_ORDER) as usize;
            let covariance = |lag: usize| {
                let run = &problem.run[joint];
                let pairs = (lag..r.len()).filter(|&k| run[k] >= lag && calm[k] && calm[k - lag]);
                let (sum, count) =
                    pairs.fold((0.0, 0.0), |(s, c), k| (s + r[k] * r[k - lag], c + 1.0));
                sum / f64::max(count, 1.0)
            };
            let c: Vec<f64> = (0..=order.min(ORDER)).map(covariance).collect();
            let own = Autoregression::of(&c, count);
            noise.sigma[joint] = (noise.level[joint] * own.innovation.sqrt()).max(1e-12);
            noise.phi[joint] = own.phi;
        }
        noise
    }

    pub fn whiten(&self, problem: &Problem, column: &Column) -> Column {
        let of_joint = |(joint, x): (usize, &Vec<f64>)| {
            let (phi, scale) = (&self.phi[joint], 1.0 / self.sigma[joint]);
            let mut predicted = vec![0.0; x.len()];
            for (lag, p) in phi.iter().enumerate() {
                let later = predicted.get_mut(lag + 1..).unwrap_or_default();
                later.iter_mut().zip(x).for_each(|(sum, x)| *sum += p * x);
            }
            let rows = x.iter().zip(&predicted).zip(&problem.run[joint]);
            rows.map(|((x, p), run)| if *run < phi.len() { 0.0 } else { scale * (x - p) }).collect()
        };
        column.iter().enumerate().map(of_joint).collect()
    }

    /// Rows that count.
    pub fn rows(&self, problem: &Problem) -> f64 {
        let of_joint = |(run, phi): (&Vec<usize>, &Vec<f64>)| {
            run.iter().filter(|run| **run >= phi.len()).count()
        };
        problem.run.iter().zip(&self.phi).map(of_joint).sum::<usize>() as f64
    }
}

/// What whitened columns span: they and the triangle R of their products, RᵀR = WᵀW, so that the
/// rows of R⁻ᵀWᵀ are the shares along an orthonormal basis which is never formed.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    /// The independent columns W.
    independent: Vec<Arc<Column>>,
    /// Index of each of them among all columns.
    kept: Vec<usize>,
    /// Of each the precision that its factor has before any data, 0 for none: one more row of the
    /// triangle's products.
    precision: Vec<f64>,
    /// Columns of R.
    triangle: Vec<Vec<f64>>,
    columns: usize,
}

/// Columns with less of their length left are dependent.
const DEPENDENT: f64 = 1e-5;

impl Basis {
    /// Of columns in their order.
    pub fn new(columns: Vec<Column>) -> Self {
        Self::with_first(columns, |_| false)
    }

    /// The same, where of columns that depend on each other those stay whose index is to come
    /// `first`.
    pub fn with_first(columns: Vec<Column>, first: impl Fn(usize) -> bool) -> Self {
        let columns: Vec<Arc<Column>> = columns.into_iter().map(Arc::new).collect();
        let mut basis = Self {
            independent: vec![],
            kept: vec![],
            precision: vec![],
            triangle: vec![],
            columns: columns.len(),
        };
        for turn in [true, false] {
            for index in (0..columns.len()).filter(|index| first(*index) == turn) {
                basis.take(index, columns[index].clone(), 0.0);
            }
        }
        basis
    }

    /// Number of independent columns.
    pub fn rank(&self) -> usize {
        self.independent.len()
    }

    /// The independent columns.
    pub fn independent(&self) -> &[Arc<Column>] {
        &self.independent
    }

    /// The basis of the first `count` columns only, which were taken before the others.
    pub fn of_first(&self, count: usize) -> Self {
        let size = self.kept.iter().take_while(|index| **index < count).count();
        Self {
            independent: self.independent[..size].to_vec(),
            kept: self.kept[..size].to_vec(),
            precision: self.precision[..size].to_vec(),
            triangle: self.triangle[..size].to_vec(),
            columns: count,
        }
    }

    /// One of all columns, if it is independent.
    pub fn column(&self, index: usize) -> Option<&Arc<Column>> {
        self.kept.iter().position(|own| *own == index).map(|k| &self.independent[k])
    }

    pub fn push(&mut self, column: Arc<Column>) {
        self.push_held(column, 0.0);
    }

    /// A column whose factor is expected near zero.
    pub fn push_held(&mut self, column: Arc<Column>, precision: f64) {
        self.columns += 1;
        self.take(self.columns - 1, column, precision);
    }

    fn take(&mut self, index: usize, column: Arc<Column>, precision: f64) {
        let length = dot(&column, &column);
        if length <= 0.0 || !length.is_finite() {
            return;
        }
        let mut shares = self.shares_of(&column);
        let left = length - dot_in_lanes(&shares, &shares);
        if left > DEPENDENT * DEPENDENT * length {
            shares.push((left + precision).sqrt());
            self.precision.push(precision);
            self.triangle.push(shares);
            self.kept.push(index);
            self.independent.push(column);
        }
    }

    /// Takes what the columns span out of a column, but for what their factors are not believed to
    /// be.
    pub fn project_out(&self, column: &mut Column) {
        /// The second takes what the first has left by rounding.
        const ROUNDS: usize = 2;
        let mut factors = vec![0.0; self.rank()];
        for _ in 0..ROUNDS {
            let mut step: Vec<f64> = self.independent.iter().map(|own| dot(own, column)).collect();
            step.iter_mut()
                .zip(&self.precision)
                .zip(&factors)
                .for_each(|((step, p), factor)| *step -= p * factor);
            self.forward_substitute(&mut step);
            self.back_substitute(&mut step);
            for ((own, step), factor) in self.independent.iter().zip(step).zip(&mut factors) {
                *factor += step;
                for (x, own) in column.iter_mut().zip(own.iter()) {
                    if x.is_empty() && !own.is_empty() {
                        x.resize(own.len(), 0.0);
                    }
                    x.iter_mut().zip(own).for_each(|(x, own)| *x -= step * own);
                }
            }
        }
    }

    /// What factors of all columns cost that are not what they are expected to be.
    pub fn cost(&self, factors: &[f64]) -> f64 {
        self.kept
            .iter()
            .zip(&self.precision)
            .map(|(index, precision)| precision * factors[*index].powi(2))
            .sum()
    }

    /// Shares of a column along the basis.
    pub fn shares_of(&self, column: &Column) -> Vec<f64> {
        let mut products: Vec<f64> = self.independent.iter().map(|own| dot(own, column)).collect();
        self.forward_substitute(&mut products);
        products
    }

    /// Per column its shares along the basis. Where all columns begin or end with zeros nothing is
    /// computed.
    pub fn shares(&self, columns: &[Column]) -> Vec<Vec<f64>> {
        let spans = spans(columns);
        let of_column = |column: &Column| {
            let product = |own: &Arc<Column>| {
                let along =
                    |((own, x), rows): ((&Vec<f64>, &Vec<f64>), &std::ops::Range<usize>)| {
                        let both = own.get(rows.clone()).zip(x.get(rows.clone()));
                        both.map_or(0.0, |(own, x)| dot_in_lanes(own, x))
                    };
                own.iter().zip(column).zip(&spans).map(along).sum()
            };
            let mut products: Vec<f64> = self.independent.iter().map(product).collect();
            self.forward_substitute(&mut products);
            products
        };
        columns.iter().map(of_column).collect()
    }

    /// The same of many columns at once, by products of matrices.
    pub fn shares_of_many(&self, columns: &[&Column]) -> Vec<Vec<f64>> {
        /// Columns whose products are formed at once.
        const AT_ONCE: usize = 64;
        let some = |columns: &[&Column]| -> Vec<Vec<f64>> {
            let mut shares = vec![vec![0.0; self.rank()]; columns.len()];
            for joint in 0..columns[0].len() {
                let own: Vec<usize> =
                    (0..columns.len()).filter(|&c| !columns[c][joint].is_empty()).collect();
                let with: Vec<usize> =
                    (0..self.rank()).filter(|&k| !self.independent[k][joint].is_empty()).collect();
                let (Some(first), false) = (own.first(), with.is_empty()) else { continue };
                let rows = columns[*first][joint].len();
                let z = Mat::from_fn(rows, own.len(), |row, c| columns[own[c]][joint][row]);
                let w =
                    Mat::from_fn(rows, with.len(), |row, k| self.independent[with[k]][joint][row]);
                let mut products = Mat::<f64>::zeros(with.len(), own.len());
                matmul(products.as_mut(), Accum::Replace, w.transpose(), z.as_ref(), 1.0, Par::Seq);
                for (c, column) in own.iter().enumerate() {
                    with.iter()
                        .enumerate()
                        .for_each(|(k, basis)| shares[*column][*basis] += products[(k, c)]);
                }
            }
            shares.iter_mut().for_each(|shares| self.forward_substitute(shares));
            shares
        };
        columns.par_chunks(AT_ONCE).flat_map_iter(some).collect()
    }

    /// Coefficients of the columns that `y` is made of, zero for dependent ones.
    pub fn solve(&self, y: &Column) -> Vec<f64> {
        self.coefficients(self.shares_of(y))
    }

    /// The same from the shares of y along the basis.
    pub fn coefficients(&self, mut along: Vec<f64>) -> Vec<f64> {
        self.back_substitute(&mut along);
        let mut coefficients = vec![0.0; self.columns];
        self.kept.iter().zip(along).for_each(|(index, value)| coefficients[*index] = value);
        coefficients
    }

    /// From products with the columns to shares along the basis: b becomes R⁻ᵀb.
    pub fn forward_substitute(&self, b: &mut [f64]) {
        for j in 0..b.len() {
            let column = &self.triangle[j];
            b[j] = (b[j] - dot_in_lanes(&column[..j], &b[..j])) / column[j];
        }
    }

    /// b becomes R⁻¹b.
    fn back_substitute(&self, b: &mut [f64]) {
        for j in (0..b.len()).rev() {
            b[j] /= self.triangle[j][j];
            let x = b[j];
            for (b, t) in b[..j].iter_mut().zip(&self.triangle[j]) {
                *b -= t * x;
            }
        }
    }

    /// Covariance of some coefficients for unit noise; infinite for dependent ones.
    pub fn covariance(&self, columns: std::ops::Range<usize>) -> Mat<f64> {
        let rows: Vec<Option<Vec<f64>>> = columns.map(|index| self.row_of_inverse(index)).collect();
        Mat::from_fn(rows.len(), rows.len(), |i, j| match (&rows[i], &rows[j]) {
            (Some(a), Some(b)) => dot_in_lanes(a, b),
            _ if i == j => f64::INFINITY,
            _ => 0.0,
        })
    }

    /// Standard deviations of the coefficients for unit noise; infinite for dependent ones.
    pub fn deviations(&self) -> Vec<f64> {
        let deviation = |index| {
            self.row_of_inverse(index).map_or(f64::INFINITY, |row| dot_in_lanes(&row, &row).sqrt())
        };
        (0..self.columns).map(deviation).collect()
    }

    /// The row of R⁻¹ that belongs to a column, if it is independent: R⁻¹R⁻ᵀ is the covariance for
    /// unit noise.
    fn row_of_inverse(&self, index: usize) -> Option<Vec<f64>> {
        let mut row = vec![0.0; self.rank()];
        row[self.kept.iter().position(|own| *own == index)?] = 1.0;
        self.forward_substitute(&mut row);
        Some(row)
    }
}

/// Products of columns with each other less those of their shares along a basis, row-major.
pub(super) fn products(columns: &[Column], shares: &[Vec<f64>]) -> Vec<f64> {
    let k = columns.len();
    let mut gram = vec![0.0; k * k];
    for a in 0..k {
        for b in 0..=a {
            let value = dot(&columns[a], &columns[b]) - dot_in_lanes(&shares[a], &shares[b]);
            (gram[a * k + b], gram[b * k + a]) = (value, value);
        }
    }
    gram
}

/// How much of a residual some columns explain.
#[derive(Clone, Debug, Default)]
pub(super) struct Gain {
    /// Fall of chi-squared.
    pub chi2: f64,
    pub coefficients: Vec<f64>,
    /// Share of the columns' length that the model does not have already.
    pub visible: f64,
    /// Columns that are not in the model.
    pub rank: usize,
}

/// Less of its length must be left for a column to be told from the model.
pub(super) const INVISIBLE: f64 = 0.01;

/// The same for a tangent: base parameters take up nearly all of what a wrong length does, and the
/// little that they leave can be far above the noise.
pub(super) const INVISIBLE_TANGENT: f64 = 0.003;

/// The one of the two that holds for a term.
pub(super) fn invisible(term: &Term) -> f64 {
    if term.is_transform() { INVISIBLE_TANGENT } else { INVISIBLE }
}

/// Gain of whitened columns on a residual that is orthogonal to `basis`. Columns with less than
/// `tolerance` of their length left are left out.
pub(super) fn gain(basis: &Basis, residual: &Column, columns: &[Column], tolerance: f64) -> Gain {
    gain_with(&basis.shares(columns), residual, (columns, &[]), tolerance)
}

/// The same with the shares of the columns along the basis.
///
/// - `precision`: that of each column's factor before any data; none if it is empty
pub(super) fn gain_with(
    shares: &[Vec<f64>],
    residual: &Column,
    (columns, precision): (&[Column], &[f64]),
    tolerance: f64,
) -> Gain {
    let lengths: Vec<f64> = columns.iter().map(|column| dot(column, column)).collect();
    let b: Vec<f64> = columns.iter().map(|column| dot(column, residual)).collect();
    let mut gram = products(columns, shares);
    for (k, (precision, length)) in precision.iter().zip(&lengths).enumerate() {
        let left = &mut gram[k * columns.len() + k];
        // A column that the model has already stays one, whatever is believed of it.
        if *left > tolerance * tolerance * length {
            *left += precision;
        }
    }
    gain_of(&gram, &b, &lengths, tolerance)
}

/// The same from projected products: Gram matrix, product with the residual, squared lengths before
/// projection. Columns with less than `tolerance` of their length left are left out.
pub(super) fn gain_of(gram: &[f64], b: &[f64], lengths: &[f64], tolerance: f64) -> Gain {
    let factor = Factor::new(gram, lengths, tolerance);
    let forward = factor.forward(b);
    let chi2 = forward.iter().map(|x| x * x).sum();
    let rank = factor.kept.iter().filter(|kept| **kept).count();
    Gain { chi2, coefficients: factor.backward(&forward), visible: factor.visible, rank }
}

/// Cholesky factor of a Gram matrix in the given order; columns that the ones before explain are
/// left out.
pub(super) struct Factor {
    l: Vec<f64>,
    kept: Vec<bool>,
    /// Largest share of its length that is left of a column.
    visible: f64,
}

impl Factor {
    /// Of a matrix, row by row; a column with less than `tolerance` of its squared length left is
    /// left out.
    pub fn new(gram: &[f64], lengths: &[f64], tolerance: f64) -> Self {
        let k = lengths.len();
        let mut l = vec![0.0; k * k];
        let mut kept = vec![false; k];
        let mut visible = 0.0f64;
        for i in 0..k {
            for j in (0..i).filter(|&j| kept[j]) {
                let sum = dot_in_lanes(&l[i * k..i * k + j], &l[j * k..j * k + j]);
                l[i * k + j] = (gram[i * k + j] - sum) / l[j * k + j];
            }
            let own = &l[i * k..i * k + i];
            let pivot = gram[i * k + i] - dot_in_lanes(own, own);
            let share = (pivot / lengths[i].max(f64::MIN_POSITIVE)).max(0.0).sqrt();
            if share > tolerance && pivot > 0.0 {
                visible = visible.max(share);
                kept[i] = true;
                l[i * k + i] = pivot.sqrt();
            } else {
                l[i * k..(i + 1) * k].fill(0.0);
            }
        }
        Self { l, kept, visible }
    }

    /// Zero for columns that are left out.
    pub fn forward(&self, b: &[f64]) -> Vec<f64> {
        let k = self.kept.len();
        let mut forward = vec![0.0; k];
        for i in (0..k).filter(|&i| self.kept[i]) {
            let sum = dot_in_lanes(&self.l[i * k..i * k + i], &forward[..i]);
            forward[i] = (b[i] - sum) / self.l[i * k + i];
        }
        forward
    }

    /// The solution of what was substituted forward.
    pub fn backward(&self, forward: &[f64]) -> Vec<f64> {
        let k = self.kept.len();
        let (mut rest, mut solution) = (forward.to_vec(), vec![0.0; k]);
        for i in (0..k).rev().filter(|&i| self.kept[i]) {
            solution[i] = rest[i] / self.l[i * k + i];
            rest[..i]
                .iter_mut()
                .zip(&self.l[i * k..])
                .for_each(|(rest, l)| *rest -= l * solution[i]);
        }
        solution
    }

    pub fn solve(&self, b: &[f64]) -> Vec<f64> {
        self.backward(&self.forward(b))
    }

    /// Squares of some of the columns times their factors, with what the other columns can make
    /// taken out.
    pub fn squares_beside_others(&self, columns: Range<usize>, factors: &[f64]) -> f64 {
        let k = self.kept.len();
        let unit = |at: usize| (0..k).map(|i| f64::from(u8::from(i == at))).collect::<Vec<f64>>();
        let inverse: Vec<f64> = columns
            .clone()
            .flat_map(|at| self.solve(&unit(at))[columns.clone()].to_vec())
            .collect();
        let lengths: Vec<f64> =
            (0..columns.len()).map(|i| inverse[i * columns.len() + i]).collect();
        dot_in_lanes(&Self::new(&inverse, &lengths, 0.0).solve(factors), factors)
    }
}

/// Per joint the rows outside of which all columns are zero.
fn spans(columns: &[Column]) -> Vec<std::ops::Range<usize>> {
    let of_joint = |joint: usize| {
        let own =
            || columns.iter().map(move |column| &column[joint]).filter(|rows| !rows.is_empty());
        let first = own().filter_map(|rows| rows.iter().position(|x| *x != 0.0)).min();
        let last = own().filter_map(|rows| rows.iter().rposition(|x| *x != 0.0)).max();
        first.zip(last).map_or(0..0, |(first, last)| first..last + 1)
    };
    (0..columns.first().map_or(0, Vec::len)).map(of_joint).collect()
}

pub(super) fn dot(a: &Column, b: &Column) -> f64 {
    a.iter().zip(b).map(|(a, b)| dot_in_lanes(a, b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_that_of_calm_rows_and_of_the_freedom_that_is_left() {
        let residual: Vec<f64> =
            (0..60).map(|row| if row < 40 { [1.0, -1.0][row % 2] } else { 50.0 }).collect();
        let calm: Vec<bool> = (0..60).map(|row| row < 40).collect();
        let rest = |used: usize| Rest { residual: residual.clone(), used, calm: calm.clone() };
        assert_eq!(rest(0).variance(), 1.0);
        assert_eq!(rest(20).variance(), 2.0);
    }

    /// Columns whose factors are expected near zero are those of a fit with one more row for each
    /// of them.
    #[test]
    fn held_columns_are_rows_of_their_own() {
        let mut random = sgpr_numeric::internal::Random::new(1);
        let mut column = || -> Vec<f64> { (0..30).map(|_| random.normal()).collect() };
        let (free, held, target) = (column(), [column(), column()], column());
        let precision = [4.0, 50.0];
        let mut basis = Basis::new(vec![vec![free.clone()]]);
        held.iter()
            .zip(precision)
            .for_each(|(column, p)| basis.push_held(vec![column.clone()].into(), p));
        let factors = basis.solve(&vec![target.clone()]);
        let all = [&free, &held[0], &held[1]];
        let row = |i: usize, k: usize| match i {
            0..30 => all[k][i],
            _ => f64::from(k == i - 29) * precision[i - 30].sqrt(),
        };
        let x = nalgebra::DMatrix::from_fn(32, 3, row);
        let y = nalgebra::DVector::from_fn(32, |i, _| target.get(i).copied().unwrap_or_default());
        let anew = x.clone().svd(true, true).solve(&y, 1e-12).expect("both sides were asked for");
        (0..3).for_each(|k| {
            assert!((factors[k] - anew[k]).abs() < 1e-12, "{k}: {} {}", factors[k], anew[k])
        });
        let mut rest = vec![target.clone()];
        basis.project_out(&mut rest);
        let chi2 = dot(&rest, &rest) + basis.cost(&factors);
        assert!((chi2 - (&y - &x * &anew).norm_squared()).abs() < 1e-10, "{chi2}");
        let covariance = (x.transpose() * &x).try_inverse().expect("independent columns");
        let own = basis.covariance(1..3);
        (0..4).for_each(|k| {
            assert!((own[(k / 2, k % 2)] - covariance[(1 + k / 2, 1 + k % 2)]).abs() < 1e-12)
        });
        // One more column, held, gains as much as the fit with it.
        let (another, p) = (column(), 7.0);
        let white = vec![vec![another.clone()]];
        let gained = gain_with(&basis.shares(&white), &rest, (&white, &[p]), 0.01).chi2;
        basis.push_held(vec![another].into(), p);
        let factors = basis.solve(&vec![target.clone()]);
        let mut rest = vec![target];
        basis.project_out(&mut rest);
        assert!((chi2 - gained - dot(&rest, &rest) - basis.cost(&factors)).abs() < 1e-10);
    }
}
