//! Structure that no effect of the catalogue explains: a Gaussian process on what is left, by groups of variables.

use rayon::prelude::*;

use super::basis::{Noise, dot};
use super::fit::{Fitted, beyond, held_out};
use super::problem::{Column, Problem};
use crate::random::Random;
use crate::simd::cos_in_place;

/// Variables that a joint's torque may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variable {
    Position,
    Speed,
    NeighbourPosition,
    NeighbourSpeed,
    Time,
}

use Variable::{NeighbourPosition, NeighbourSpeed, Position, Speed, Time};

pub(super) const ALL: [Variable; 4] = [Position, Speed, NeighbourPosition, NeighbourSpeed];

const GROUPS: [&[Variable]; 7] = [
    &[Position],
    &[Speed],
    &[Position, Speed],
    &[NeighbourPosition, NeighbourSpeed],
    &[Position, NeighbourSpeed],
    &[Position, Speed, NeighbourPosition, NeighbourSpeed],
    &[Time],
];

/// Random features per group (Rahimi and Recht (2007)).
const FEATURES: usize = 30;

/// What is left at a joint.
#[derive(Clone, Debug)]
pub(super) struct Leftover {
    pub joint: usize,
    pub evidence: f64,
    /// Fall of the held-out error, as a share of what is left.
    pub effect_size: f64,
    pub group: String,
}

impl Leftover {
    /// Whether it is worth a word.
    pub fn is_material(&self) -> bool {
        self.evidence > 12.0 && self.effect_size > 0.02
    }
}

/// Features of a group at a joint: cosines of random combinations of the standardised variables.
pub(super) fn features(problem: &Problem, joint: usize, group: &[Variable], length_scale: f64) -> Vec<Column> {
    let n = problem.dof();
    let neighbours: Vec<usize> =
        [joint.checked_sub(1), Some(joint + 1)].into_iter().flatten().filter(|j| *j < n).collect();
    let mut picks: Vec<(Variable, usize)> = Vec::new();
    for variable in group {
        match variable {
            NeighbourPosition | NeighbourSpeed => picks.extend(neighbours.iter().map(|j| (*variable, *j))),
            _ => picks.push((*variable, joint)),
        }
    }
    if picks.is_empty() || (group == [Time] && problem.clock.is_none()) {
        return vec![];
    }
    let value = |stretch: &super::problem::Stretch, k: usize, (variable, j): (Variable, usize)| match variable {
        Position | NeighbourPosition => stretch.motion.q[k * n + j],
        Speed | NeighbourSpeed => stretch.motion.dq[k * n + j],
        Time => stretch.time.get(k).copied().unwrap_or_default(),
    };
    let moments: Vec<(f64, f64)> = picks
        .iter()
        .map(|pick| {
            let values = problem.rows[joint].iter().map(|&(s, k)| value(&problem.stretches[s], k, *pick));
            let (sum, squares, count) = values.fold((0.0, 0.0, 0.0), |(s, q, c), x| (s + x, q + x * x, c + 1.0));
            let mean = sum / f64::max(count, 1.0);
            (mean, (squares / f64::max(count, 1.0) - mean * mean).max(1e-18).sqrt())
        })
        .collect();
    let mut random = Random::new(0x00D1_A905 ^ joint as u64);
    let draws: Vec<(Vec<f64>, f64)> = (0..FEATURES)
        .map(|_| {
            let weights = picks.iter().map(|_| random.normal() / length_scale).collect();
            (weights, std::f64::consts::TAU * random.uniform())
        })
        .collect();
    problem.feature_columns(joint, FEATURES, |stretch, k, row| {
        let x: Vec<f64> =
            picks.iter().zip(&moments).map(|(p, (mean, std))| (value(stretch, k, *p) - mean) / std).collect();
        for (out, (weights, phase)) in row.iter_mut().zip(&draws) {
            *out = weights.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>() + phase;
        }
        cos_in_place(row);
    })
}

/// Log evidence of a Gaussian process against none, per joint with its best group.
pub(super) fn leftover(problem: &Problem, fitted: &Fitted, noise: &Noise) -> Vec<Leftover> {
    let beyond = beyond(problem, fitted);
    let errors = |extra: &[Column]| -> Vec<f64> {
        let in_band = held_out(problem, fitted, extra, noise).into_iter();
        in_band.zip(&beyond).map(|(own, beyond)| own[0].hypot(beyond[0])).collect()
    };
    let before = errors(&[]);
    let of_joint = |joint: usize| {
        let mut best: Option<(f64, &[Variable], Vec<Column>)> = None;
        for group in GROUPS {
            let columns = features(problem, joint, group, 1.0);
            if columns.is_empty() {
                continue;
            }
            let white: Vec<Column> = columns.iter().map(|c| noise.whiten(problem, c)).collect();
            let evidence = evidence(fitted, &white);
            if best.as_ref().is_none_or(|(value, ..)| evidence > *value) {
                best = Some((evidence, group, columns));
            }
        }
        let (evidence, group, columns) = best?;
        let mut effect_size = 0.0;
        if evidence > 5.0 {
            let after = errors(&columns);
            effect_size = (before[joint] - after[joint]) / after[joint].max(1e-12);
        }
        let names = group.iter().map(|v| match v {
            Position => "position",
            Speed => "speed",
            NeighbourPosition => "positions of the neighbours",
            NeighbourSpeed => "speeds of the neighbours",
            Time => "time",
        });
        Some(Leftover { joint, evidence, effect_size, group: names.collect::<Vec<_>>().join(", ") })
    };
    (0..problem.dof()).into_par_iter().filter_map(of_joint).collect()
}

fn evidence(fitted: &Fitted, white: &[Column]) -> f64 {
    let k = white.len();
    let shares: Vec<Vec<f64>> = white.iter().map(|c| fitted.basis.q.iter().map(|q| dot(q, c)).collect()).collect();
    let gram = faer::Mat::from_fn(k, k, |a, b| {
        dot(&white[a], &white[b]) - shares[a].iter().zip(&shares[b]).map(|(x, y)| x * y).sum::<f64>()
    });
    let b: Vec<f64> = white.iter().map(|c| dot(c, &fitted.white)).collect();
    let (values, vectors) = crate::linalg::symmetric_eigen(gram.as_ref());
    let along: Vec<f64> = (0..k).map(|i| (0..k).map(|j| vectors[(j, i)] * b[j]).sum()).collect();
    let at = |variance: f64| {
        let one = |(value, along): (&f64, &f64)| {
            let scaled = 1.0 + variance * value.max(0.0);
            0.5 * (variance * along * along / scaled - scaled.ln())
        };
        values.iter().zip(&along).map(one).sum::<f64>()
    };
    (-24..12).map(|e| at(f64::from(e).exp2())).fold(0.0, f64::max)
}
