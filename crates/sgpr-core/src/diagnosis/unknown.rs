//! Structure that no effect of the catalogue explains: a Gaussian process on what is left, by
//! groups of variables.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::basis::Noise;
use super::evidence::{EVEN, LeftOut, probability_of, probability_of_fall, sure_among, weights};
use super::fit::{Fitted, beyond};
use super::left_out::{Extra, FoldFits};
use super::likelihood::{Hypothesis, JointNoise};
use super::problem::{Column, Problem};
use crate::linalg::{dot_in_lanes, mean_square};
use sgpr_numeric::internal::Random;
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
        let [positions, speeds] = [Position, Speed]
            .map(|variable| neighbours(joint, n).map(variable).collect::<Vec<_>>());
        Self::of(&[&[Position(joint), Speed(joint)], &positions[..], &speeds].concat())
    }

    /// All that are tried at a joint.
    fn all(joint: usize, n: usize) -> Vec<Self> {
        let (q, dq) = (Position(joint), Speed(joint));
        let times = |factors: &[Variable], of: &[Variable]| Self {
            factors: factors.to_vec(),
            of: of.to_vec(),
        };
        let mut groups =
            vec![Self::of(&[q]), Self::of(&[dq]), Self::of(&[q, dq]), Self::of(&[Time])];
        groups.extend([times(&[dq], &[q]), times(&[dq, dq], &[q])]);
        for other in (0..n).filter(|other| *other != joint) {
            let (p, dp) = (Position(other), Speed(other));
            groups.extend([[p, dp], [q, p], [q, dp], [dq, p], [dq, dp]].map(|of| Self::of(&of)));
            groups.extend([
                times(&[dq], &[q, p]),
                times(&[dp], &[q, p]),
                times(&[dq, dp], &[q, p]),
            ]);
        }
        groups.push(Self::whole(joint, n));
        groups
    }

    /// Length scales that are tried.
    fn length_scales(&self) -> &'static [f64] {
        match self.of[..] {
            [Position(_) | Speed(_)] => &LENGTH_SCALES,
            _ => &LENGTH_SCALES[..2],
        }
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
        words.extend(
            list(&self.of).into_iter().filter(|word| !words.contains(word)).collect::<Vec<_>>(),
        );
        words.dedup();
        words.join(", ")
    }
}

fn neighbours(joint: usize, n: usize) -> impl Iterator<Item = usize> {
    [joint.checked_sub(1), Some(joint + 1)].into_iter().flatten().filter(move |j| *j < n)
}

/// Random features per group (Rahimi and Recht (2007)).
const FEATURES: usize = 30;

/// Length scales of the processes, in standard deviations of their variables: about as smooth as
/// the motion, and sharper; of one position or speed alone, for which there are enough features, as
/// sharp as a ripple.
const LENGTH_SCALES: [f64; 3] = [1.0, 0.35, 0.1];

/// Largest standard deviation of a process, in root mean squares of what is left: functions that
/// cancel each other are none.
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

/// What is less probable needs no further doubt.
pub(super) const IMPROBABLE: f64 = 0.05;

/// Share of a joint's left-out error that is worth a word: a twentieth.
pub(super) const MATTERS: f64 = 0.05;

/// Features of a group at a joint: cosines of random combinations of the standardised variables,
/// times the factors. They are as smooth as the motion, and what the filter of the equations takes
/// out of that is nothing. None for a function of time if the logs have no common clock.
pub(super) fn features(
    problem: &Problem,
    joint: usize,
    group: &Group,
    length_scale: f64,
) -> Vec<Column> {
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
        let (sum, squares) =
            values.iter().fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
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
    let factor =
        |at: &(usize, usize)| factors.iter().map(|variable| value(at, *variable)).product::<f64>();
    let factors: Vec<f64> =
        if factors.is_empty() { vec![] } else { rows.iter().map(factor).collect() };
    let mut columns = vec![vec![vec![]; n]; FEATURES];
    for (column, (weights, phase)) in columns.iter_mut().zip(&draws) {
        let mut along = vec![*phase; rows.len()];
        for (weight, input) in weights.iter().zip(&inputs) {
            along.iter_mut().zip(input).for_each(|(sum, x)| *sum += weight * x);
        }
        cos_in_place(&mut along);
        along.iter_mut().zip(&factors).for_each(|(out, factor)| *out *= factor);
        column[joint] = along;
    }
    columns
}

/// A Gaussian process at a joint, by products of its whitened columns. They are made anew when they
/// are asked for: hundreds of processes are tried, and few of them are looked at again.
#[derive(Clone, Debug, Default)]
struct Process {
    group: Group,
    length_scale: f64,
    /// Mean square of its torque per variance of the columns' factors.
    of_unit_variance: f64,
    /// Products with each other ...
    gram: Vec<f64>,
    /// ... with the columns of a fit, and with its target.
    across: Vec<Vec<f64>>,
    target: Vec<f64>,
}

/// The Gaussian processes that are tried on what a fit leaves at a joint, and how each goes with
/// the columns of the fit. What speaks for a process beside any part of the fit follows from that.
pub(super) struct Processes {
    joint: usize,
    noise: Noise,
    target: Arc<Column>,
    /// Whitened columns of the fit.
    columns: Vec<Arc<Column>>,
    all: Vec<Process>,
}

/// One of the processes.
pub(super) struct Smooth {
    index: usize,
    /// Variance of the columns' factors, and the largest that was tried.
    variance: f64,
    largest: f64,
    /// Log evidence against none.
    pub evidence: f64,
}

/// Columns of one joint side by side.
fn side_by_side(columns: &[&[f64]]) -> Mat<f64> {
    Mat::from_fn(columns.first().map_or(0, |c| c.len()), columns.len(), |row, c| columns[c][row])
}

impl Processes {
    pub fn new(problem: &Problem, fitted: &Fitted, noise: &Noise, joint: usize) -> Self {
        let empty = |(group, length_scale): (Group, f64)| Process {
            group,
            length_scale,
            ..Default::default()
        };
        let groups = Group::all(joint, problem.dof()).into_iter();
        let scaled =
            |group: Group| group.length_scales().iter().map(move |scale| (group.clone(), *scale));
        let all = groups.flat_map(scaled).map(empty);
        let none = Arc::new(Column::default());
        let nothing =
            Self { joint, noise: noise.clone(), target: none, columns: vec![], all: all.collect() };
        let mut own = nothing.beside(problem, fitted, noise);
        own.all.retain(|process| !process.target.is_empty());
        own
    }

    /// The same processes beside another fit; what it shares with theirs is taken over.
    fn beside(&self, problem: &Problem, fitted: &Fitted, noise: &Noise) -> Self {
        let all = self.products_beside(problem, fitted, noise, &self.all);
        let columns = fitted.basis.independent().to_vec();
        Self {
            joint: self.joint,
            noise: noise.clone(),
            target: fitted.target.clone(),
            columns,
            all,
        }
    }

    fn products_beside(
        &self,
        problem: &Problem,
        fitted: &Fitted,
        noise: &Noise,
        some: &[Process],
    ) -> Vec<Process> {
        let joint = self.joint;
        let same_noise = self.noise == *noise;
        let same_target = same_noise && Arc::ptr_eq(&self.target, &fitted.target);
        let columns = fitted.basis.independent();
        let place =
            |own: &Arc<Column>| self.columns.iter().position(|other| Arc::ptr_eq(own, other));
        let places: Vec<Option<usize>> = columns.iter().map(place).collect();
        let acts = |k: &usize| !columns[*k][joint].is_empty();
        let new: Vec<usize> =
            (0..columns.len()).filter(|k| places[*k].is_none()).filter(acts).collect();
        let target = if same_target { vec![] } else { noise.whiten(problem, &fitted.target) };
        let beside =
            new.iter().map(|k| &columns[*k][joint]).chain(target.get(joint)).map(Vec::as_slice);
        let beside = side_by_side(&beside.collect::<Vec<_>>());
        let one = |known: &Process| {
            let across = |feature: usize| -> Vec<f64> {
                let known = known.across.get(feature);
                places.iter().map(|at| at.zip(known).map_or(0.0, |(at, known)| known[at])).collect()
            };
            if beside.ncols() == 0 && !known.target.is_empty() {
                return Process {
                    across: (0..known.across.len()).map(across).collect(),
                    ..known.clone()
                };
            }
            let own = features(problem, joint, &known.group, known.length_scale);
            if own.is_empty() {
                return known.clone();
            }
            let of_unit_variance = own.iter().map(|column| mean_square(&column[joint])).sum();
            let white: Vec<Column> =
                own.iter().map(|column| noise.whiten(problem, column)).collect();
            drop(own);
            let z =
                side_by_side(&white.iter().map(|column| &column[joint][..]).collect::<Vec<_>>());
            let k = white.len();
            let products = |other: &Mat<f64>| {
                let mut products = Mat::<f64>::zeros(k, other.ncols());
                matmul(
                    products.as_mut(),
                    Accum::Replace,
                    z.transpose(),
                    other.as_ref(),
                    1.0,
                    Par::Seq,
                );
                products
            };
            let gram = if same_noise && !known.gram.is_empty() {
                known.gram.clone()
            } else {
                let gram = products(&z);
                (0..k * k).map(|at| gram[(at / k, at % k)]).collect()
            };
            let along = products(&beside);
            let with_new = |feature: usize| {
                let mut all = across(feature);
                new.iter().enumerate().for_each(|(at, column)| all[*column] = along[(feature, at)]);
                all
            };
            let target = if same_target {
                known.target.clone()
            } else {
                (0..k).map(|f| along[(f, new.len())]).collect()
            };
            Process {
                of_unit_variance,
                gram,
                across: (0..k).map(with_new).collect(),
                target,
                ..known.clone()
            }
        };
        some.par_iter().map(one).collect()
    }

    /// The process that predicts left-out blocks best, of those with most evidence beside a fit,
    /// and its errors there.
    ///
    /// - `joints`: where to have these errors; at the others they are those of the fit alone
    pub fn best(
        &self,
        problem: &Problem,
        fitted: &Fitted,
        noise: &Noise,
        joints: &[usize],
    ) -> Option<(Smooth, LeftOut)> {
        /// As many are held against left-out blocks.
        const FINALISTS: usize = 5;
        let joint = self.joint;
        let left = mean_square(&fitted.residual[joint]);
        let beside = self.beside(problem, fitted, noise);
        let smooth = |(index, process): (usize, &Process)| {
            let largest =
                LARGEST * LARGEST * left / process.of_unit_variance.max(f64::MIN_POSITIVE);
            let (variance, evidence) = process.evidence(fitted, largest);
            Smooth { index, variance, largest, evidence }
        };
        let mut all: Vec<Smooth> = beside.all.par_iter().enumerate().map(smooth).collect();
        all.retain(|own| own.evidence > 0.0);
        all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        all.truncate(FINALISTS);
        let folds = fitted.folds(problem, noise);
        let judged = all.into_par_iter().map(|own| {
            let errors = self.errors_of(&own, problem, &folds, joints);
            (own, errors)
        });
        let error = |(_, errors): &(Smooth, LeftOut)| errors.mean_square(joint);
        judged.collect::<Vec<_>>().into_iter().min_by(|a, b| error(a).total_cmp(&error(b)))
    }

    /// Errors of a process on what fits beside it leave out.
    ///
    /// - `joints`: as in [`Self::best`]
    pub fn errors_of(
        &self,
        smooth: &Smooth,
        problem: &Problem,
        fits: &FoldFits,
        joints: &[usize],
    ) -> LeftOut {
        let (columns, precision) = self.columns(smooth, problem);
        fits.errors_with(
            &Extra { columns: &columns, precision: &vec![precision; columns.len()] },
            joints,
        )
    }

    /// Columns of a process, and the precision of their factors.
    pub fn columns(&self, smooth: &Smooth, problem: &Problem) -> (Vec<Column>, f64) {
        let Process { group, length_scale, .. } = &self.all[smooth.index];
        (
            features(problem, self.joint, group, *length_scale),
            1.0 / smooth.variance.max(f64::MIN_POSITIVE),
        )
    }

    /// Log evidence of a process against none beside another fit.
    pub fn evidence_beside(
        &self,
        smooth: &Smooth,
        problem: &Problem,
        fitted: &Fitted,
        noise: &Noise,
    ) -> f64 {
        let beside =
            self.products_beside(problem, fitted, noise, &self.all[smooth.index..=smooth.index]);
        beside[0].evidence(fitted, smooth.largest).1
    }

    /// What the torque of a process depends on, in words.
    fn describe(&self, smooth: &Smooth, names: &[&str]) -> String {
        self.all[smooth.index].group.describe(self.joint, names)
    }
}

impl Process {
    /// Variance of the columns' factors, at most the `largest`, at which their log evidence beside
    /// the fit is greatest, and that.
    fn evidence(&self, fitted: &Fitted, largest: f64) -> (f64, f64) {
        let k = self.target.len();
        let shares = |across: &Vec<f64>| -> Vec<f64> {
            let mut shares = across.clone();
            fitted.basis.forward_substitute(&mut shares);
            shares
        };
        let shares: Vec<Vec<f64>> = self.across.iter().map(shares).collect();
        let gram = |a: usize, b: usize| self.gram[a * k + b] - dot_in_lanes(&shares[a], &shares[b]);
        let gram = Mat::from_fn(k, k, |a, b| gram(a.max(b), a.min(b)));
        let b: Vec<f64> = self
            .target
            .iter()
            .zip(&shares)
            .map(|(own, shares)| own - dot_in_lanes(shares, &fitted.along))
            .collect();
        let (values, vectors) = crate::linalg::symmetric_eigen(gram.as_ref());
        let along: Vec<f64> =
            (0..k).map(|i| (0..k).map(|j| vectors[(j, i)] * b[j]).sum()).collect();
        let at = |variance: f64| {
            let one = |(value, along): (&f64, &f64)| {
                let scaled = 1.0 + variance * value.max(0.0);
                0.5 * (variance * along * along / scaled - scaled.ln())
            };
            values.iter().zip(&along).map(one).sum::<f64>()
        };
        let tried = (0..30)
            .map(|e| largest * f64::from(-e).exp2())
            .map(|variance| (variance, at(variance)));
        tried.fold((0.0, 0.0), |best, tried| if tried.1 > best.1 { tried } else { best })
    }
}

/// What a Gaussian process could still predict at each joint, of the group with most evidence
/// there; `own` are the errors of the fit on blocks that were left out.
///
/// - `noises`: those of each joint beside the fit
/// - `processes`: of each joint
pub(super) fn leftover(
    problem: &Problem,
    (fitted, own): (&Fitted, &LeftOut),
    (noise, noises): (&Noise, Option<&[JointNoise]>),
    processes: &[Processes],
) -> Vec<Leftover> {
    let names: Vec<&str> = problem.nominal.robot().joint_names().collect();
    let beyond = beyond(problem, fitted);
    let of_joint = |joint: usize| {
        let (smooth, with) = processes[joint].best(problem, fitted, noise, &[joint])?;
        let whole = |errors: &LeftOut| errors.mean_square(joint) + beyond[joint][0].powi(2);
        let share = 1.0 - (whole(&with) / whole(own).max(f64::MIN_POSITIVE)).sqrt();
        // One of so many groups, and none, are as likely before any data.
        let tried = processes[joint].all.len();
        let there = weights(problem, &[own, &with], &[0.0, -(tried as f64).ln()], &[joint])[1];
        let matters =
            probability_of_fall(problem, [own, &with], joint, MATTERS, beyond[joint][0].powi(2));
        // Asked like an effect: what is not sure on left-out blocks is at most as likely as not.
        let sure = sure_among((tried * problem.dof()) as f64);
        let most =
            if own.against(&with, problem, &[joint]).significance() >= sure { 1.0 } else { EVEN };
        let mut probability = there.min(matters).min(most);
        if let Some(noises) = noises.filter(|_| probability > IMPROBABLE) {
            let (columns, precision) = processes[joint].columns(&smooth, problem);
            let bare = Hypothesis::new(fitted, noises.to_vec());
            let process = bare.with(problem, fitted, (joint, &columns, precision));
            let factor = process.and_then(|process| process.log_bayes_factor(&bare, problem));
            probability = probability
                .min(factor.map_or(1.0, |factor| probability_of(factor - (tried as f64).ln())));
        }
        let group = processes[joint].describe(&smooth, &names);
        Some(Leftover { joint, share, probability, group })
    };
    (0..problem.dof()).into_par_iter().filter_map(of_joint).collect()
}
