//! How much a residual remembers.
//!
//! What counts is the sum of the autocorrelation over all lags, up to where it drowns in its own
//! noise. Lags are looked at in groups, each half as long again as all before it, so that a few
//! sums of products hold all that is needed. They are quadratic: if the residual is a row times a
//! vector, they are that vector times the products of the rows ([`LagProducts`]), whatever the
//! vector turns out to be.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use crate::linalg::dot_in_lanes;

/// Longest memory that is looked at, in rows.
const LONGEST_LAG: usize = 500;

/// Lags 0, 1, 2, 3 to 4, 5 to 7, 8 to 11 ...
pub(crate) fn lag_groups() -> impl Iterator<Item = Range<usize>> {
    let from = |start: usize| start..(start + 1).max((3 * start).div_ceil(2)).min(LONGEST_LAG + 1);
    let next = move |group: &Range<usize>| (group.end <= LONGEST_LAG).then(|| from(group.end));
    std::iter::successors(Some(from(0)), next)
}

/// How many rows carry as much as one independent row, 1 + 2 sum of the autocorrelation, from sums
/// and numbers of products by group of lags.
///
/// Source: G. V. Bayley, J. M. Hammersley, The effective number of independent observations in an
/// autocorrelated time series, Suppl. J. R. Stat. Soc. 8(2) (1946).
pub(crate) fn rows_per_independent_row(products: &[(f64, usize)]) -> f64 {
    let mean = |(sum, count): (f64, usize)| sum / f64::max(count as f64, 1.0);
    let variance = products.first().map_or(0.0, |squares| mean(*squares));
    let mut sum = 0.0;
    for (lags, products) in lag_groups().zip(products).skip(1) {
        let correlation = mean(*products) / variance;
        let products_per_lag = f64::max(products.1 as f64 / lags.len() as f64, 1.0);
        // Without rows or without residual the correlation is 0 / 0.
        if correlation.is_nan() || correlation <= 2.0 / products_per_lag.sqrt() {
            break;
        }
        sum += correlation * lags.len() as f64;
    }
    1.0 + 2.0 * sum
}

/// Products of rows of one kind with those some lags later, summed over a log: rows come one by
/// one, with holes where there was none, and no more of them are kept than the longest lag needs.
#[derive(Clone, Debug)]
pub(crate) struct LagProducts {
    width: usize,
    /// Rows whose later ones are not all there, zero in holes.
    rows: Vec<f64>,
    present: Vec<bool>,
    /// Trajectory and time of the last row.
    at: Option<(usize, usize)>,
    sums: Vec<Mat<f64>>,
    counts: Vec<usize>,
}

impl LagProducts {
    /// Of rows of so many numbers.
    pub fn new(width: usize) -> Self {
        let groups = lag_groups().count();
        let sums = (0..groups).map(|_| Mat::zeros(width, width)).collect();
        Self { width, rows: vec![], present: vec![], at: None, sums, counts: vec![0; groups] }
    }

    /// Adds row `time` of a trajectory; rows come in order, and those of different trajectories
    /// have no products.
    ///
    /// # Panics
    /// If the row has another width.
    pub fn push(&mut self, trajectory: usize, time: usize, row: impl IntoIterator<Item = f64>) {
        /// Rows that are taken at once: many against the longest lag, few enough for the cache.
        const AT_ONCE: usize = 4 * LONGEST_LAG;
        match self.at {
            Some((last, before)) if last == trajectory && time - before <= LONGEST_LAG => {
                let holes = time - before - 1;
                self.rows.resize(self.rows.len() + holes * self.width, 0.0);
                self.present.resize(self.present.len() + holes, false);
            }
            _ => self.take(self.present.len()),
        }
        self.rows.extend(row);
        self.present.push(true);
        assert_eq!(self.rows.len(), self.present.len() * self.width, "a row of the right width");
        self.at = Some((trajectory, time));
        if self.present.len() >= AT_ONCE + LONGEST_LAG {
            self.take(AT_ONCE);
        }
    }

    /// Per group of lags: sums of products, symmetric, and their number.
    pub fn finish(mut self) -> (Vec<Mat<f64>>, Vec<usize>) {
        self.take(self.present.len());
        let symmetric = |sum: &Mat<f64>| faer::Scale(0.5) * (sum + sum.transpose());
        (self.sums.iter().map(symmetric).collect(), self.counts)
    }

    /// Adds the products of the first rows with all later ones, and forgets them.
    fn take(&mut self, taken: usize) {
        let (width, length) = (self.width, self.present.len());
        // Sums of all rows before one, so that a group of lags is a difference of two; beyond the
        // last row they stay.
        let padded = length + LONGEST_LAG + 2;
        let mut before = vec![0.0; padded * width];
        let mut count_before = vec![0; padded];
        if width == 1 {
            let mut sum = 0.0;
            for (before, value) in before[1..=length].iter_mut().zip(&self.rows) {
                sum += value;
                *before = sum;
            }
        } else {
            for t in 0..length {
                let (done, next) = before.split_at_mut((t + 1) * width);
                let pairs = done[t * width..].iter().zip(&self.rows[t * width..]);
                next.iter_mut()
                    .zip(pairs)
                    .take(width)
                    .for_each(|(sum, (before, value))| *sum = before + value);
            }
        }
        let mut count = 0;
        for (before, present) in count_before[1..=length].iter_mut().zip(&self.present) {
            count += usize::from(*present);
            *before = count;
        }
        let (sums, counts) = (before[length * width..][..width].to_vec(), count_before[length]);
        before[(length + 1) * width..]
            .chunks_exact_mut(width)
            .for_each(|row| row.copy_from_slice(&sums));
        count_before[length + 1..].fill(counts);
        let mut later = vec![0.0; taken * width];
        let rows = &self.rows[..taken * width];
        for (group, lags) in lag_groups().enumerate().take_while(|(_, lags)| lags.start < length) {
            let (ends, starts) = (&before[lags.end * width..], &before[lags.start * width..]);
            later
                .iter_mut()
                .zip(ends)
                .zip(starts)
                .for_each(|((later, end), start)| *later = end - start);
            let (ends, starts) =
                (&count_before[lags.end..][..taken], &count_before[lags.start..][..taken]);
            let own = self.present[..taken].iter().zip(ends).zip(starts);
            self.counts[group] += own
                .map(|((present, end), start)| if *present { end - start } else { 0 })
                .sum::<usize>();
            let sums = &mut self.sums[group];
            if width == 1 {
                sums[(0, 0)] += dot_in_lanes(rows, &later);
                continue;
            }
            let rows = MatRef::from_row_major_slice(rows, taken, width);
            let later = MatRef::from_row_major_slice(&later, taken, width);
            matmul(sums.as_mut(), Accum::Add, rows.transpose(), later, 1.0, Par::Seq);
        }
        self.rows.drain(..taken * width);
        self.present.drain(..taken);
    }
}

/// Residuals of one kind of rows, collected row by row.
#[derive(Clone, Debug)]
pub(crate) struct Memory(LagProducts);

impl Default for Memory {
    fn default() -> Self {
        Self(LagProducts::new(1))
    }
}

impl Memory {
    /// Adds the residual of row `time` of a trajectory; rows come in order.
    pub fn push(&mut self, trajectory: usize, time: usize, residual: f64) {
        self.0.push(trajectory, time, [residual]);
    }

    /// How many rows carry as much as one independent row.
    pub fn rows_per_independent_row(self) -> f64 {
        let (sums, counts) = self.0.finish();
        rows_per_independent_row(
            &sums.iter().map(|sum| sum[(0, 0)]).zip(counts).collect::<Vec<_>>(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_order_process_has_the_memory_of_theory() {
        // x[k] = a x[k-1] + e: correlations a^lag, so 1 + 2 a / (1 - a) rows per independent one.
        let (mut state, mut x) = (1u64, 0.0);
        let mut memory = Memory::default();
        for time in 0..100_000 {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1u64 << 53) as f64;
            }
            x = 0.8 * x + (sum - 6.0);
            // Holes must not shift the lags.
            if time % 7 != 3 {
                memory.push(time / 25_000, time % 25_000, x);
            }
        }
        let expected = 1.0 + 2.0 * 0.8 / 0.2;
        let found = memory.rows_per_independent_row();
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
    }

    #[test]
    fn products_are_those_of_every_pair_of_rows_and_of_any_residual() {
        // Two trajectories with holes, one longer than what is taken at once; one hole longer than
        // any lag.
        let mut state = 7u64;
        let mut number = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let times = (0..3100)
            .filter(|time| time % 11 != 4 && !(700..1300).contains(time))
            .map(|time| (0, time));
        let rows: Vec<((usize, usize), [f64; 3])> = times
            .chain((0..400).map(|time| (1, 3 * time)))
            .map(|at| (at, [number() + (0.01 * at.1 as f64).sin(), number(), 1.0]))
            .collect();
        let vector = [0.7, -0.2, 0.1];
        let (mut products, mut memory) = (LagProducts::new(3), Memory::default());
        for ((trajectory, time), row) in &rows {
            products.push(*trajectory, *time, *row);
            memory.push(*trajectory, *time, row.iter().zip(vector).map(|(a, b)| a * b).sum());
        }
        let (sums, counts) = products.finish();
        let mut of_vector = Vec::new();
        for (group, lags) in lag_groups().enumerate() {
            let (mut sum, mut count) = (Mat::<f64>::zeros(3, 3), 0);
            for (k, ((trajectory, time), row)) in rows.iter().enumerate() {
                for ((other, later), partner) in &rows[k..] {
                    if other == trajectory && lags.contains(&(later - time)) {
                        sum += Mat::from_fn(3, 3, |i, j| {
                            0.5 * (row[i] * partner[j] + row[j] * partner[i])
                        });
                        count += 1;
                    }
                }
            }
            assert_eq!(count, counts[group]);
            let off = (&sum - &sums[group]).norm_l2();
            assert!(off < 1e-11 * sums[0].norm_l2(), "{lags:?} {off}");
            let own = |i: usize, j: usize| vector[i] * sums[group][(i, j)] * vector[j];
            of_vector.push(((0..9).map(|k| own(k / 3, k % 3)).sum::<f64>(), counts[group]));
        }
        let (found, expected) =
            (rows_per_independent_row(&of_vector), memory.rows_per_independent_row());
        assert!(expected > 5.0 && (found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn groups_hold_every_lag_once() {
        let lags: Vec<usize> = lag_groups().flatten().collect();
        assert_eq!(lags, (0..=LONGEST_LAG).collect::<Vec<_>>());
        assert_eq!(lag_groups().count(), 16);
    }

    #[test]
    fn no_rows_and_no_residual_remember_nothing() {
        assert_eq!(Memory::default().rows_per_independent_row(), 1.0);
        let mut zeros = Memory::default();
        (0..10).for_each(|time| zeros.push(0, time, 0.0));
        assert_eq!(zeros.rows_per_independent_row(), 1.0);
    }
}
