//! Structure that no effect of the catalogue explains: a Gaussian process on what is left, by groups of variables.

use rayon::prelude::*;

use super::basis::{Noise, dot, mean_square, products};
use super::evidence::{EVEN, LeftOut, SURE, probability_of_fall, weights};
use super::fit::{Fitted, beyond, fold_fits};
use super::left_out::{Extra, FoldFits};
use super::problem::{Column, Problem};
use crate::random::Random;
use sgpr_predict::internal::cos_in_place;

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
        for other in (0..n).filter(|other| *other != joint) {
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

/// Length scales of the processes, in standard deviations of their variables: about as smooth as the motion, and sharper.
const LENGTH_SCALES: [f64; 2] = [1.0, 0.35];

/// Largest standard deviation of a process, in root mean squares of what is left: functions that cancel each other are none.
const LARGEST: f64 = 3.0;

/// What is left at a joint.
#[derive(Clone, Debug)]
pub(super) struct Leftover {
    pub joint: usize,
    /// Share of the left-out error that the process takes away.
    pub share: f64,
    /// Probability that the share matters.
    pub probability: f64,
    pub group: String,
}

impl Leftover {
    /// Whether it is there and matters.
    pub fn is_material(&self) -> bool {
        self.probability > EVEN
    }
}

/// Share of a joint's left-out error that is worth a word: a twentieth.
pub(super) const MATTERS: f64 = 0.05;

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

/// A Gaussian process on what a fit leaves at a joint. Its columns are made when they are asked for: hundreds of processes
/// are tried, and few of them are looked at again.
pub(super) struct Smooth {
    joint: usize,
    group: Group,
    length_scale: f64,
    /// Variance of the columns' factors, and the largest that was tried.
    variance: f64,
    largest: f64,
    /// Log evidence against none.
    pub evidence: f64,
}

impl Smooth {
    /// The process that predicts left-out blocks best, of those with most evidence, and its errors there.
    pub fn best(problem: &Problem, fitted: &Fitted, noise: &Noise, joint: usize) -> Option<(Self, LeftOut)> {
        let all: Vec<usize> = (0..problem.dof()).collect();
        Self::best_beside(problem, (fitted, &fold_fits(problem, fitted, noise)), noise, joint, &all)
    }

    /// The same, with its errors at some joints and those of the fit alone at the others.
    fn best_beside(
        problem: &Problem,
        (fitted, fits): (&Fitted, &FoldFits),
        noise: &Noise,
        joint: usize,
        joints: &[usize],
    ) -> Option<(Self, LeftOut)> {
        /// As many are held against left-out blocks.
        const FINALISTS: usize = 5;
        let left = mean_square(&fitted.residual[joint]);
        let of_group = |(group, length_scale): (Group, f64)| {
            let columns = features(problem, joint, &group, length_scale);
            if columns.is_empty() {
                return None;
            }
            let white: Vec<Column> = columns.iter().map(|c| noise.whiten(problem, c)).collect();
            let of_unit_variance: f64 = columns.iter().map(|column| mean_square(&column[joint])).sum();
            let largest = LARGEST * LARGEST * left / of_unit_variance.max(f64::MIN_POSITIVE);
            let (variance, evidence) = evidence(fitted, &white, largest);
            Some(Self { joint, group, length_scale, variance, largest, evidence })
        };
        let groups = Group::all(joint, problem.dof()).into_iter();
        let tried: Vec<(Group, f64)> = groups.flat_map(|group| LENGTH_SCALES.map(|s| (group.clone(), s))).collect();
        let mut all: Vec<Self> = tried.into_par_iter().filter_map(of_group).filter(|own| own.evidence > 0.0).collect();
        all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        all.truncate(FINALISTS);
        let judged = all.into_par_iter().map(|own| {
            let precision = 1.0 / own.variance.max(f64::MIN_POSITIVE);
            let errors = fits.errors_with(&Extra { columns: &own.columns(problem), precision }, joints);
            (own, errors)
        });
        let error = |(_, errors): &(Self, LeftOut)| errors.mean_square(joint);
        judged.collect::<Vec<_>>().into_iter().min_by(|a, b| error(a).total_cmp(&error(b)))
    }

    /// Log evidence of the same process against none beside another fit.
    pub fn evidence_beside(&self, problem: &Problem, fitted: &Fitted, noise: &Noise) -> f64 {
        let white: Vec<Column> = self.columns(problem).iter().map(|c| noise.whiten(problem, c)).collect();
        evidence(fitted, &white, self.largest).1
    }

    fn columns(&self, problem: &Problem) -> Vec<Column> {
        features(problem, self.joint, &self.group, self.length_scale)
    }
}

/// What a Gaussian process could still predict at each joint, of the group with most evidence there; `own` are the errors
/// of the fit on blocks that were left out.
pub(super) fn leftover(problem: &Problem, fitted: &Fitted, own: &LeftOut, noise: &Noise) -> Vec<Leftover> {
    let names: Vec<&str> = problem.nominal.robot().joint_names().collect();
    let beyond = beyond(problem, fitted);
    let fits = fold_fits(problem, fitted, noise);
    let of_joint = |joint: usize| {
        let (smooth, with) = Smooth::best_beside(problem, (fitted, &fits), noise, joint, &[joint])?;
        let whole = |errors: &LeftOut| errors.mean_square(joint) + beyond[joint][0].powi(2);
        let share = 1.0 - (whole(&with) / whole(own).max(f64::MIN_POSITIVE)).sqrt();
        // One of so many groups, and none, are as likely before any data.
        let tried = Group::all(joint, problem.dof()).len() * LENGTH_SCALES.len();
        let there = weights(problem, &[own, &with], &[0.0, -(tried as f64).ln()], &[joint])[1];
        let matters = probability_of_fall(problem, [own, &with], joint, MATTERS, beyond[joint][0].powi(2));
        // Asked like an effect: what is not sure on left-out blocks is at most as likely as not.
        let most = if own.against(&with, problem, &[joint]).significance() >= SURE { 1.0 } else { EVEN };
        let probability = there.min(matters).min(most);
        let group = smooth.group.describe(joint, &names);
        Some(Leftover { joint, share, probability, group })
    };
    (0..problem.dof()).into_par_iter().filter_map(of_joint).collect()
}

/// Variance of the factors of `white`, at most the `largest`, at which their log evidence is greatest, and that.
fn evidence(fitted: &Fitted, white: &[Column], largest: f64) -> (f64, f64) {
    let k = white.len();
    let shares = fitted.basis.shares_of_many(&white.iter().collect::<Vec<_>>());
    let gram = products(white, &shares);
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
    let tried = (0..30).map(|e| largest * f64::from(-e).exp2()).map(|variance| (variance, at(variance)));
    tried.fold((0.0, 0.0), |best, tried| if tried.1 > best.1 { tried } else { best })
}
