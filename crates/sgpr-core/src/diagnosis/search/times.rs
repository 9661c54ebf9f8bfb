//! Effects that begin, or begin and end, at a time.

use std::sync::Arc;

use super::super::basis::{Basis, Gain, gain_of};
use super::super::fit::Fitted;
use super::super::problem::{Column, Stretch};
use super::Search;
use super::candidates::Candidate;
use crate::effects::{Effect, Reach, Scale};
use crate::linalg::dot_in_lanes;
use crate::model::Term;

/// Resolution of the grid of times, s.
pub(super) const TIME_STEP: f64 = 0.5;

/// The windows with the largest gains of which none overlap: first and last moment, and whether it
/// stands out. A contact is told from the model's own errors by left-out blocks: where they are
/// largest need not be where it was. A short one is in few blocks; but what the model lacks
/// explains as much in many windows.
///
/// - `windows`: gain, first and last moment
fn apart(mut windows: Vec<(f64, usize, usize)>) -> Vec<(usize, usize, bool)> {
    /// Windows that are looked at.
    const MOST: usize = 4;
    /// A window stands out that explains as many times what the next one does.
    const STANDS_OUT: f64 = 10.0;
    windows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut apart: Vec<(f64, usize, usize)> = Vec::new();
    for window in windows {
        if apart.len() <= MOST && apart.iter().all(|own| window.2 <= own.1 || own.2 <= window.1) {
            apart.push(window);
        }
    }
    let stands_out =
        |k: usize| apart.get(k + 1).is_some_and(|next| apart[k].0 > STANDS_OUT * next.0);
    apart
        .iter()
        .enumerate()
        .take(MOST)
        .map(|(k, (_, first, last))| (*first, *last, stands_out(k)))
        .collect()
}

/// Gain from the sums of a window of time.
pub(super) fn switched_gain(sum: &[f64], k: usize, r: usize) -> Gain {
    let share = |a: usize, b: usize| -> f64 {
        let row = |a: usize| &sum[k * k + a * r..][..r];
        row(a).iter().zip(row(b)).map(|(x, y)| x * y).sum()
    };
    let gram: Vec<f64> = (0..k * k).map(|i| sum[i] - share(i / k, i % k)).collect();
    let lengths: Vec<f64> = (0..k).map(|a| sum[a * k + a]).collect();
    gain_of(&gram, &sum[k * k + k * r..], &lengths, 0.03)
}

impl Search<'_> {
    /// Whether no log shows a change at one joint, with two blocks before it and two after it, from
    /// which a scatter could be told: then it says no more than that logs differ, which every law
    /// that the model lacks makes them do.
    pub(in super::super) fn is_between_logs(&self, term: &Term) -> bool {
        let mut times = term.times();
        let (Some(time), None, Reach::Own) = (times.next(), times.next(), term.effect.reach())
        else {
            return false;
        };
        let margin = 2.0 * self.problem.block_s;
        let shows = |stretch: &Stretch| match (stretch.time.first(), stretch.time.last()) {
            (Some(first), Some(last)) => (first + margin..=last - margin).contains(&time),
            _ => true,
        };
        time.is_finite() && !self.problem.stretches.iter().any(shows)
    }

    /// Effects that begin, or begin and end, at a time: sums over blocks of time give every change
    /// point.
    pub(super) fn scan_times(
        &mut self,
        fitted: &Fitted,
        basis: &Basis,
        white: &Column,
    ) -> Vec<Candidate> {
        let mut found = Vec::new();
        let robot = self.problem.nominal.robot().clone();
        let [start, end] = self.problem.time_span();
        if end <= start {
            return found;
        }
        let bins = ((end - start) / TIME_STEP).ceil() as usize + 1;
        let wanted: Vec<Arc<dyn Effect>> =
            self.catalogue.iter().filter(|effect| self.wanted(effect.as_ref())).cloned().collect();
        for effect in &wanted {
            let times = effect.constants().iter().filter(|c| c.scale == Scale::Time).count();
            if times == 0 {
                continue;
            }
            if self.not_testable(fitted, effect.as_ref()).is_some() {
                continue;
            }
            for site in effect.sites(&robot) {
                if times == 1
                    && fitted
                        .terms()
                        .iter()
                        .any(|t| t.effect.name() == effect.name() && t.site == site)
                {
                    continue;
                }
                let always = [f64::NEG_INFINITY, f64::INFINITY];
                let whole = Term::new(effect.clone(), site, always[..times].to_vec());
                let columns: Vec<Column> = self
                    .raw(fitted, &whole)
                    .iter()
                    .map(|c| self.noise.whiten(&self.problem, c))
                    .collect();
                let sums = self.sums_over_time(basis, white, &columns, start, bins);
                let k = columns.len();
                let gain = |first: usize, last: usize| {
                    let sum: Vec<f64> =
                        sums[last].iter().zip(&sums[first]).map(|(b, a)| b - a).collect();
                    switched_gain(&sum, k, basis.rank())
                };
                let mut windows: Vec<(f64, usize, usize)> = Vec::new();
                let mut consider =
                    |first: usize, last: usize| windows.push((gain(first, last).chi2, first, last));
                let time = |bin: usize| start + bin as f64 * TIME_STEP;
                if times == 1 {
                    (2..bins - 2).for_each(|first| consider(first, bins));
                } else {
                    for first in 1..bins - 2 {
                        // A contact lasts at most a quarter of the session: longer ones are changes
                        // of payload.
                        let longest = (first + (bins / 4).max(4)).min(bins - 1);
                        (first + 1..longest).for_each(|last| consider(first, last));
                    }
                }
                for (first, last, stands_out) in apart(windows) {
                    let constants = [time(first), time(last)][..times].to_vec();
                    let term = Term::new(effect.clone(), site, constants);
                    let candidate = self.candidate(term, gain(first, last), times);
                    found.push(Candidate { stands_out: stands_out && times == 2, ..candidate });
                }
            }
        }
        found
    }

    /// Running sums over the time of the session: per bin [ZᵀZ, ZᵀQ, Zᵀy], one entry more than
    /// bins.
    pub(super) fn sums_over_time(
        &self,
        basis: &Basis,
        white: &Column,
        columns: &[Column],
        start: f64,
        bins: usize,
    ) -> Vec<Vec<f64>> {
        let (k, r) = (columns.len(), basis.rank());
        let width = k * k + k * r + k;
        let mut sums = vec![vec![0.0; width]; bins + 1];
        for joint in 0..self.problem.dof() {
            if columns.iter().all(|column| column[joint].is_empty()) {
                continue;
            }
            let rows = &self.problem.rows[joint];
            let bin = |row: usize| {
                let time = self.problem.time_of(rows[row]);
                (((time - start) / TIME_STEP) as usize).min(bins - 1)
            };
            let mut first = 0;
            while first < rows.len() {
                let here = bin(first);
                let mut last = first;
                while last < rows.len() && bin(last) == here && rows[last].0 == rows[first].0 {
                    last += 1;
                }
                let sum = &mut sums[here + 1];
                let part = |column: &Column| column[joint].get(first..last).unwrap_or(&[]).to_vec();
                let z: Vec<Vec<f64>> = columns.iter().map(part).collect();
                for a in 0..k {
                    for b in 0..k {
                        sum[a * k + b] += dot_in_lanes(&z[a], &z[b]);
                    }
                    for (b, q) in basis.independent().iter().enumerate() {
                        if let Some(q) = q[joint].get(first..last) {
                            sum[k * k + a * r + b] += dot_in_lanes(&z[a], q);
                        }
                    }
                    sum[k * k + k * r + a] += dot_in_lanes(&z[a], &white[joint][first..last]);
                }
                first = last;
            }
        }
        for sum in &mut sums {
            (0..k).for_each(|a| basis.forward_substitute(&mut sum[k * k + a * r..][..r]));
        }
        for bin in 1..=bins {
            for entry in 0..width {
                sums[bin][entry] += sums[bin - 1][entry];
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::internal::Random;

    #[test]
    fn a_short_contact_stands_out_and_slow_errors_do_not() {
        let mut random = Random::new(11);
        // Errors that remember for ten moments, of which a push of the same size for eight is ten
        // times as large.
        let mut slow = 0.0;
        let errors: Vec<f64> = (0..300)
            .map(|_| {
                slow = 0.9 * slow + 0.43 * random.normal();
                slow
            })
            .collect();
        let of = |errors: &[f64]| {
            let mut windows = Vec::new();
            for first in 0..errors.len() {
                for last in first + 1..(first + 40).min(errors.len()) {
                    let sum: f64 = errors[first..last].iter().sum();
                    windows.push((sum * sum / (last - first) as f64, first, last));
                }
            }
            apart(windows)
        };
        assert!(of(&errors).iter().all(|(.., stands_out)| !stands_out));
        let pushed: Vec<f64> = errors
            .iter()
            .enumerate()
            .map(|(k, e)| if (120..128).contains(&k) { e + 15.0 } else { *e })
            .collect();
        let found = of(&pushed);
        assert_eq!(found.len(), 4);
        assert_eq!(found[0], (120, 128, true));
        assert!(found[1..].iter().all(|(.., stands_out)| !stands_out));
    }
}
