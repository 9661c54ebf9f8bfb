//! When a residual changes: one function of the state before a moment, another one after it.

use serde::{Deserialize, Serialize};

use super::super::evidence::probability_of;
use super::rows::JointRows;
use super::whiteness::{autoregression, whitened};
use crate::effects::sgn;

/// A change of the residual.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Change {
    /// Most likely moment, s of the session.
    pub time: f64,
    /// The moment lies between these with 95 % probability, s.
    pub interval: [f64; 2],
    /// When it ends, s of the session, if the residual is as before afterwards.
    pub end: Option<f64>,
    /// Probability that there is a change.
    pub probability: f64,
    /// Share of the residual's variance that it explains.
    pub share: f64,
}

/// Resolution, s; coarser for long sessions.
const STEP_S: f64 = 0.25;
/// Most bins of a session.
const MOST_BINS: usize = 240;

/// Functions of the state: constant, direction, speed, two of the position, load.
const FUNCTIONS: usize = 6;

/// Rows farther out than this many standard deviations are drawn in: spikes at reversals are no
/// change.
const FARTHEST: f64 = 4.0;

/// Gram matrix, product with the residual and number of rows, of some rows.
type Sums = Vec<f64>;
/// Products of the functions with each other, with the residual, and its square.
const WIDTH: usize = FUNCTIONS * FUNCTIONS + FUNCTIONS + 1;

/// The change of a residual that has most evidence, if there is evidence at all.
///
/// - `noise`: what neither state nor time explains, of the same rows
pub(super) fn change(rows: &JointRows, noise: &[f64]) -> Option<Change> {
    if rows.time.is_empty() || rows.len() < 200 {
        return None;
    }
    let phi = autoregression(noise, &rows.run);
    let white = |values: &[f64]| whitened(values, &rows.run, &phi).0;
    let (mut y, mut innovations) = (white(&rows.residual), white(noise));
    let most = FARTHEST * spread(&y).max(1e-300);
    innovations.iter_mut().for_each(|x| *x = x.clamp(-most, most));
    let sigma = spread(&innovations).max(1e-300);
    y.iter_mut().for_each(|y| *y = y.clamp(-most, most) / sigma);
    let z = functions(rows).map(|column| white(&column));
    let [start, end] = rows
        .time
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], t| [a.min(*t), b.max(*t)]);
    let step = STEP_S.max((end - start) / MOST_BINS as f64);
    let bins = ((end - start) / step).ceil().max(1.0) as usize;
    let sums = running_sums(rows, &z, &y, [start, step], bins);
    let total = sums[bins].clone();
    let alone = explained(&total);
    let rows_between = |a: usize, b: usize| sums[b][WIDTH - 1] - sums[a][WIDTH - 1];
    let part =
        |a: usize, b: usize| -> Sums { sums[b].iter().zip(&sums[a]).map(|(x, y)| x - y).collect() };
    let count = rows.len() as f64;
    let penalty = 0.5 * (FUNCTIONS + 1) as f64 * count.ln();
    let least = 30.0;
    // A change that stays.
    let mut scores = Vec::new();
    for bin in 1..bins {
        if rows_between(0, bin) >= least && rows_between(bin, bins) >= least {
            let gain = explained(&part(0, bin)) + explained(&part(bin, bins)) - alone;
            scores.push((bin, bins, gain, 0.5 * gain - penalty));
        }
    }
    // A change that ends: what is before and after is the same.
    for first in 1..bins {
        for last in first + 1..bins {
            if rows_between(first, last) >= least
                && rows_between(0, first) + rows_between(last, bins) >= least
            {
                let inside = part(first, last);
                let outside: Sums = total.iter().zip(&inside).map(|(t, i)| t - i).collect();
                let gain = explained(&inside) + explained(&outside) - alone;
                scores.push((first, last, gain, 0.5 * gain - penalty - 0.5 * count.ln()));
            }
        }
    }
    let best = scores.iter().copied().max_by(|a, b| a.3.total_cmp(&b.3))?;
    let (begin, finish, gain, score) = best;
    // One over the number of moments is the prior of each; moments beside the best share its
    // evidence.
    let same_kind = |s: &&(usize, usize, f64, f64)| s.1 == finish;
    let mut moments: Vec<(usize, f64)> =
        scores.iter().filter(same_kind).map(|s| (s.0, (s.3 - score).exp())).collect();
    let mass: f64 = moments.iter().map(|(_, weight)| weight).sum();
    let odds = score + mass.ln() - (bins as f64).ln();
    moments.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (mut held, mut low, mut high) = (0.0, begin, begin);
    for (bin, weight) in moments {
        if held >= 0.95 * mass {
            break;
        }
        held += weight;
        (low, high) = (low.min(bin), high.max(bin));
    }
    // A change within a bin spoils the bins on both sides of the moment that fits best.
    let time = |bin: usize| start + step * bin as f64;
    let energy = y.iter().map(|y| y * y).sum::<f64>();
    Some(Change {
        time: time(begin),
        interval: [time(low) - step, time(high) + step],
        end: (finish < bins).then(|| time(finish)),
        probability: probability_of(odds),
        share: (gain / energy.max(1e-300)).clamp(0.0, 1.0),
    })
}

/// Root mean square.
fn spread(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

fn functions(rows: &JointRows) -> [Vec<f64>; FUNCTIONS] {
    let (q, dq) = (&rows.q[rows.joint], &rows.dq[rows.joint]);
    let top = rows.top_speed(rows.joint);
    let size = spread(&rows.load).max(1e-12);
    [
        vec![1.0; rows.len()],
        dq.iter().map(|dq| sgn(*dq)).collect(),
        dq.iter().map(|dq| dq / top).collect(),
        q.iter().map(|q| q.sin()).collect(),
        q.iter().map(|q| q.cos()).collect(),
        rows.load.iter().map(|tau| tau / size).collect(),
    ]
}

/// Sums over the rows before each bin, one entry more than bins.
fn running_sums(
    rows: &JointRows,
    z: &[Vec<f64>; FUNCTIONS],
    y: &[f64],
    [start, step]: [f64; 2],
    bins: usize,
) -> Vec<Sums> {
    let mut sums = vec![vec![0.0; WIDTH]; bins + 1];
    for k in 0..rows.len() {
        let bin = (((rows.time[k] - start) / step) as usize).min(bins - 1);
        let sum = &mut sums[bin + 1];
        for a in 0..FUNCTIONS {
            for b in 0..FUNCTIONS {
                sum[a * FUNCTIONS + b] += z[a][k] * z[b][k];
            }
            sum[FUNCTIONS * FUNCTIONS + a] += z[a][k] * y[k];
        }
        sum[WIDTH - 1] += 1.0;
    }
    for bin in 1..=bins {
        let (before, after) = sums.split_at_mut(bin);
        after[0].iter_mut().zip(&before[bin - 1]).for_each(|(own, last)| *own += last);
    }
    sums
}

/// Fall of chi-squared by the functions, from the sums of some rows.
fn explained(sums: &[f64]) -> f64 {
    /// Functions with less of their squares left are in the others.
    const DEPENDENT: f64 = 1e-9;
    let mut l = [[0.0; FUNCTIONS]; FUNCTIONS];
    let mut forward = [0.0; FUNCTIONS];
    let mut kept = [false; FUNCTIONS];
    for i in 0..FUNCTIONS {
        for j in (0..i).filter(|&j| kept[j]) {
            let sum: f64 = (0..j).map(|m| l[i][m] * l[j][m]).sum();
            l[i][j] = (sums[i * FUNCTIONS + j] - sum) / l[j][j];
        }
        let diagonal = sums[i * FUNCTIONS + i];
        let pivot = diagonal - (0..i).map(|m| l[i][m].powi(2)).sum::<f64>();
        if pivot > DEPENDENT * diagonal.max(1e-300) {
            kept[i] = true;
            l[i][i] = pivot.sqrt();
            let sum: f64 = (0..i).map(|m| l[i][m] * forward[m]).sum();
            forward[i] = (sums[FUNCTIONS * FUNCTIONS + i] - sum) / l[i][i];
        } else {
            l[i] = [0.0; FUNCTIONS];
        }
    }
    forward.iter().map(|x| x * x).sum()
}
