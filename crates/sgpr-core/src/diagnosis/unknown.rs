//! Structure that no effect of the catalogue explains: a Gaussian process on what is left, by groups of variables.

use rayon::prelude::*;

use super::basis::{Noise, dot};
use super::fit::{Extra, Fitted, beyond, held_out, usual_error};
use super::problem::{Column, Problem};
use crate::random::Random;
use crate::simd::cos_in_place;

/// What a joint's torque may depend on, and of which joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Variable {
    Position(usize),
    Speed(usize),
    Time,
}

use Variable::{Position, Speed, Time};

/// A smooth function of some variables, times a product of others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Group {
    factors: Vec<Variable>,
    of: Vec<Variable>,
}

impl Group {
    fn of(of: &[Variable]) -> Self {
        Self { factors: vec![], of: of.to_vec() }
    }

    /// Positions and speeds of a joint and its neighbours.
    pub fn whole(joint: usize, n: usize) -> Self {
        let [positions, speeds] =
            [Position, Speed].map(|variable| neighbours(joint, n).map(variable).collect::<Vec<_>>());
        Self::of(&[&[Position(joint), Speed(joint)], &positions[..], &speeds].concat())
    }

    /// All that are tried at a joint.
    fn all(joint: usize, n: usize) -> Vec<Self> {
        let (q, dq) = (Position(joint), Speed(joint));
        let times = |factors: &[Variable], of: &[Variable]| Self { factors: factors.to_vec(), of: of.to_vec() };
        let mut groups = vec![Self::of(&[q]), Self::of(&[dq]), Self::of(&[q, dq]), Self::of(&[Time])];
        groups.extend([times(&[dq], &[q]), times(&[dq, dq], &[q])]);
        for other in neighbours(joint, n) {
            let (p, dp) = (Position(other), Speed(other));
            groups.extend([[p, dp], [q, p], [q, dp], [dq, p], [dq, dp]].map(|of| Self::of(&of)));
            groups.extend([times(&[dq], &[q, p]), times(&[dp], &[q, p]), times(&[dq, dp], &[q, p])]);
        }
        groups.push(Self::whole(joint, n));
        groups
    }

    /// In words: `speed of joint_2 times a function of position`.
    fn describe(&self, joint: usize, names: &[&str]) -> String {
        let word = |variable: &Variable| match variable {
            Position(j) if *j == joint => "position".into(),
            Speed(j) if *j == joint => "speed".into(),
            Position(j) => format!("position of {}", names[*j]),
            Speed(j) => format!("speed of {}", names[*j]),
            Time => "time".into(),
        };
        let list = |variables: &[Variable]| variables.iter().map(word).collect::<Vec<String>>();
        let mut words = list(&self.factors);
        words.extend(list(&self.of).into_iter().filter(|word| !words.contains(word)).collect::<Vec<_>>());
        words.dedup();
        words.join(", ")
    }
}

fn neighbours(joint: usize, n: usize) -> impl Iterator<Item = usize> {
    [joint.checked_sub(1), Some(joint + 1)].into_iter().flatten().filter(move |j| *j < n)
}

/// Random features per group (Rahimi and Recht (2007)).
const FEATURES: usize = 30;

/// What is left at a joint.
#[derive(Clone, Debug)]
pub(super) struct Leftover {
    pub joint: usize,
    pub evidence: f64,
    /// Fall of the held-out error, of all blocks or of a usual one, as a share of what is left.
    pub effect_size: f64,
    pub group: String,
}

impl Leftover {
    /// Whether it is worth a word.
    pub fn is_material(&self) -> bool {
        self.evidence > 12.0 && self.effect_size > 0.02
    }
}

/// Features of a group at a joint: cosines of random combinations of the standardised variables, times the factors. They
/// are as smooth as the motion, and what the filter of the equations takes out of that is nothing.
pub(super) fn features(problem: &Problem, joint: usize, group: &Group, length_scale: f64) -> Vec<Column> {
    let n = problem.dof();
    let Group { factors, of } = group;
    if of.contains(&Time) && problem.clock.is_none() {
        return vec![];
    }
    let rows = &problem.rows[joint];
    let value = |&(stretch, k): &(usize, usize), variable: Variable| {
        let stretch = &problem.stretches[stretch];
        match variable {
            Position(j) => stretch.motion.q[k * n + j],
            Speed(j) => stretch.motion.dq[k * n + j],
            Time => stretch.time.get(k).copied().unwrap_or_default(),
        }
    };
    let standardised = |variable: &Variable| -> Vec<f64> {
        let values: Vec<f64> = rows.iter().map(|at| value(at, *variable)).collect();
        let (sum, squares) = values.iter().fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
        let count = f64::max(values.len() as f64, 1.0);
        let mean = sum / count;
        let std = (squares / count - mean * mean).max(1e-18).sqrt();
        values.iter().map(|x| (x - mean) / std).collect()
    };
    let inputs: Vec<Vec<f64>> = of.iter().map(standardised).collect();
    let mut random = Random::new(0x00D1_A905 ^ joint as u64);
    let draws: Vec<(Vec<f64>, f64)> = (0..FEATURES)
        .map(|_| {
            let weights = of.iter().map(|_| random.normal() / length_scale).collect();
            (weights, std::f64::consts::TAU * random.uniform())
        })
        .collect();
    let mut columns = vec![vec![vec![]; n]; FEATURES];
    for (column, (weights, phase)) in columns.iter_mut().zip(&draws) {
        let factor = |at: &(usize, usize)| factors.iter().map(|variable| value(at, *variable)).product::<f64>();
        let along = |row: usize| weights.iter().zip(&inputs).map(|(w, x)| w * x[row]).sum::<f64>() + phase;
        column[joint] = (0..rows.len()).map(along).collect();
        cos_in_place(&mut column[joint]);
        if !factors.is_empty() {
            column[joint].iter_mut().zip(rows).for_each(|(out, at)| *out *= factor(at));
        }
    }
    columns
}

/// A Gaussian process on what a fit leaves at a joint.
pub(super) struct Smooth {
    group: Group,
    columns: Vec<Column>,
    /// Variance of the columns' factors.
    variance: f64,
    /// Log evidence against none.
    pub evidence: f64,
}

impl Smooth {
    /// The group with most evidence.
    pub fn best(problem: &Problem, fitted: &Fitted, noise: &Noise, joint: usize) -> Option<Self> {
        let mut best: Option<Self> = None;
        for group in Group::all(joint, problem.dof()) {
            let columns = features(problem, joint, &group, 1.0);
            if columns.is_empty() {
                continue;
            }
            let white: Vec<Column> = columns.iter().map(|c| noise.whiten(problem, c)).collect();
            let (variance, evidence) = evidence(fitted, &white);
            if best.as_ref().is_none_or(|best| evidence > best.evidence) {
                best = Some(Self { group, columns, variance, evidence });
            }
        }
        best
    }

    /// Error per joint in the band on blocks of time that were left out, N·m (N).
    fn held_out(&self, problem: &Problem, fitted: &Fitted, noise: &Noise) -> Vec<f64> {
        held_out(problem, fitted, &self.extra(), noise).iter().map(|own| own[0]).collect()
    }

    /// The same on a usual block.
    pub fn usual_error(&self, problem: &Problem, fitted: &Fitted, noise: &Noise) -> Vec<f64> {
        usual_error(problem, fitted, &self.extra(), noise)
    }

    fn extra(&self) -> Extra<'_> {
        Extra { columns: &self.columns, precision: 1.0 / self.variance.max(f64::MIN_POSITIVE) }
    }
}

/// Log evidence of a Gaussian process against none, per joint with its best group; `errors` of the fit on blocks that
/// were left out.
pub(super) fn leftover(problem: &Problem, fitted: &Fitted, errors: &[f64], noise: &Noise) -> Vec<Leftover> {
    let names: Vec<&str> = problem.nominal.robot().joint_names().collect();
    let usual = usual_error(problem, fitted, &Extra::default(), noise);
    let beyond = beyond(problem, fitted);
    let of_joint = |joint: usize| {
        let smooth = Smooth::best(problem, fitted, noise, joint)?;
        let mut effect_size = 0.0;
        if smooth.evidence > 5.0 {
            let with_beyond = |in_band: &[f64]| in_band[joint].hypot(beyond[joint][0]);
            let fall = |before: f64, after: f64| (before - after) / after.max(1e-12);
            let of_all = fall(errors[joint], with_beyond(&smooth.held_out(problem, fitted, noise)));
            let of_usual = fall(with_beyond(&usual), with_beyond(&smooth.usual_error(problem, fitted, noise)));
            effect_size = of_all.max(of_usual);
        }
        Some(Leftover { joint, evidence: smooth.evidence, effect_size, group: smooth.group.describe(joint, &names) })
    };
    (0..problem.dof()).into_par_iter().filter_map(of_joint).collect()
}

/// Variance of the factors of `white` at which their log evidence is greatest, and that.
fn evidence(fitted: &Fitted, white: &[Column]) -> (f64, f64) {
    let k = white.len();
    let gram = fitted.basis.gram(white);
    let gram = faer::Mat::from_fn(k, k, |a, b| gram[a * k + b]);
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
    let tried = (-24..12).map(|e| f64::from(e).exp2()).map(|variance| (variance, at(variance)));
    tried.fold((0.0, 0.0), |best, tried| if tried.1 > best.1 { tried } else { best })
}
