//! What to record next: a motion that tells effects apart which the logs cannot.
//!
//! For each finding and each effect that imitates it, candidate motions are laid out within what
//! the arm did in the logs. A motion is judged by what the imitation, its parameters and those of
//! the model refitted to logs and motion together, would leave of the finding's torque: half of
//! that chi-squared is the log of the Bayes factor to expect.
//!
//! Source: A. C. Atkinson, V. V. Fedorov, The design of experiments for discriminating between two
//! rival models, Biometrika 62(1) (1975), the T-criterion.

mod path;
mod plan;

use std::cmp::Ordering;

use path::JointLimits;
use plan::{Plan, Room, plans};

use super::answer::{Finding, NextExperiment, RATE_HZ};
use super::basis::{Basis, INVISIBLE, dot, gain};
use super::fit::Fitted;
use super::problem::{Column, Problem};
use super::search::{Candidate, Search};
use crate::dynamics::{Samples, Workspace, regressor};
use crate::effects::{JointState, Reach, Scale};
use crate::excitation::TrajectorySamples;
use crate::linalg::rms;
use crate::model::{Term, TorqueModel, Trajectory};
use crate::spatial::PARAMETERS_PER_LINK;

/// Log of the Bayes factor below which an imitation is within reach of a finding. A motion that
/// does not promise as much decides nothing, and is not proposed.
const REACH: f64 = 12.0;

/// Two hypotheses of which one is so much likelier are told apart.
const ENOUGH: f64 = 2.0 * REACH;

/// Most findings for which a motion is planned, and most imitations of each.
const MOST: usize = 3;

/// Rows of the logs and of a motion that a judgement looks at.
const ROWS: usize = 1200;

/// Seconds of a log that are repeated.
const PIECE_S: f64 = 8.0;

/// Mass of the payload, kg.
const PAYLOAD: f64 = 2.0;

/// Motions that would tell the findings from what is within their reach, the most doubtful finding
/// first.
pub(super) fn next_experiments(
    search: &Search<'_>,
    fitted: &Fitted,
    findings: &[Finding],
    ranking: &[Candidate],
) -> Vec<NextExperiment> {
    let room = room(search);
    let mut found = Vec::new();
    for finding in findings.iter().take(MOST) {
        for term in finding.terms.iter().take(1) {
            found.extend(of_finding(search, fitted, finding, term, ranking, &room));
        }
    }
    found.sort_by(|a, b| a.separation_now.total_cmp(&b.separation_now));
    found
}

fn of_finding(
    search: &Search<'_>,
    fitted: &Fitted,
    finding: &Finding,
    term: &Term,
    ranking: &[Candidate],
    room: &Room,
) -> Option<NextExperiment> {
    let robot = search.problem.nominal.robot();
    let joint = match term.site.joint() {
        Some(joint) => joint,
        None => {
            (0..robot.dof()).find(|j| finding.rmse_before.contains_key(&robot.joints()[*j].name))?
        }
    };
    let name = &robot.joints()[joint].name;
    let judge = Judge::new(search, fitted, term, joint);
    let effect = finding.effect.as_str();
    let known = term.effect.about().confusable;
    let own_score =
        ranking.iter().find(|c| c.term.is_like(term)).map_or(f64::INFINITY, |own| own.score);
    let near = |c: &&Candidate| {
        let name = c.term.effect.name();
        let said =
            finding.confusable_with.iter().any(|other| other == name) || known.contains(&name);
        let equal = (c.score - own_score).abs() < REACH;
        (said || equal)
            && c.term.site == term.site
            && name != effect
            && !c.impossible
            && c.score > 0.0
    };
    let basis = judge.basis(&judge.logs.1);
    let estimated = ranking.iter().filter(near).map(|candidate| {
        let rival = judge.rival(candidate);
        let now = judge.now(&basis, &rival);
        (rival, now)
    });
    let mut rivals: Vec<(Rival, f64)> = estimated.filter(|(_, now)| *now < REACH).collect();
    rivals.sort_by(|a, b| a.1.total_cmp(&b.1));
    rivals.truncate(MOST);
    let now = rivals.first()?.1;
    let imitations: Vec<Rival> = rivals.iter().map(|(rival, _)| rival.clone()).collect();
    // The least certain of the pairs is what counts.
    let judged =
        plans(room, joint, name).into_iter().map(|plan| (judge.with(&imitations, &plan), plan));
    let best = judged.max_by(|(a, one), (b, other)| {
        let worth = |expected: &Expected, plan: &Plan| {
            let decides = expected.separation.min(ENOUGH);
            // Motions that ask for less are preferred as long as they decide, and of those the ones
            // that show the finding best.
            let decided = decides == ENOUGH;
            let asks = f64::from(plan.loaded || plan.later > 0.0);
            [decides, if decided { -asks } else { 0.0 }, if decided { expected.shown } else { 0.0 }]
        };
        worth(a, one).partial_cmp(&worth(b, other)).unwrap_or(Ordering::Equal)
    });
    let (Expected { separation, .. }, plan) =
        best.filter(|(expected, _)| expected.separation >= REACH)?;
    let about = rivals.iter().map(|(rival, _)| rival.term.effect.name());
    Some(NextExperiment {
        about: std::iter::once(effect).chain(about).map(String::from).collect(),
        experiment: plan.text,
        joints: vec![name.clone()],
        seconds: plan.motion.time.last().copied().unwrap_or_default(),
        separation_now: now,
        separation_expected: separation,
        motion: plan.motion,
    })
}

/// The term of a candidate; a transform with the constants that its tangents promise.
fn as_estimated(candidate: &Candidate) -> Term {
    let mut term = candidate.term.clone();
    if term.is_transform() {
        let steps = term.effect.constants().iter().zip(&candidate.gain.coefficients);
        let moved = term
            .constants
            .iter()
            .zip(steps)
            .map(|(value, (c, step))| (value + step).clamp(c.low, c.high));
        term.constants = moved.collect();
    }
    term
}

/// What might be there in the place of a finding.
#[derive(Clone)]
struct Rival {
    term: Term,
    /// Whether it contains the finding as a special case: no motion speaks against it if the
    /// finding is right.
    contains: bool,
}

/// What a motion promises.
struct Expected {
    /// Log of the Bayes factor.
    separation: f64,
    /// Root mean square of the finding's torque along it, in standard deviations of the noise.
    shown: f64,
}

/// Judges motions for one term by one joint's equation.
struct Judge<'a> {
    problem: &'a Problem,
    fitted: &'a Fitted,
    term: &'a Term,
    joint: usize,
    level: f64,
    /// Rows of the logs that are looked at, and the weight of each.
    rows: Vec<usize>,
    weight: f64,
    /// The torque that the term brings in the logs, and the columns of the other terms and
    /// parameters of the model there.
    logs: (Vec<f64>, Vec<Vec<f64>>),
}

impl<'a> Judge<'a> {
    fn new(search: &'a Search<'_>, fitted: &'a Fitted, term: &'a Term, joint: usize) -> Self {
        let problem = &search.problem;
        let count = problem.rows[joint].len();
        let every = count.div_ceil(ROWS).max(1);
        let rows: Vec<usize> = (0..count).step_by(every).collect();
        let pick = |column: &Column| -> Vec<f64> {
            rows.iter().map(|&row| column[joint].get(row).copied().unwrap_or_default()).collect()
        };
        let brought =
            pick(&problem.difference([&without(problem, fitted, term), &fitted.model], 1.0));
        let mut at = problem.base.rank();
        let mut columns: Vec<Vec<f64>> =
            fitted.columns[..at].iter().map(|column| pick(column)).collect();
        for own in fitted.terms() {
            let width = own.coefficients.len();
            if !own.is_like(term) {
                columns.extend(fitted.columns[at..at + width].iter().map(|column| pick(column)));
            }
            at += width;
        }
        let level = search.noise.level[joint].max(1e-12);
        Self {
            problem,
            fitted,
            term,
            joint,
            level,
            rows,
            weight: (every as f64).sqrt(),
            logs: (brought, columns),
        }
    }

    /// A candidate with what the logs say of its size. Parts that they do not show are as large as
    /// the noise.
    fn rival(&self, candidate: &Candidate) -> Rival {
        let mut term = as_estimated(candidate);
        if term.is_transform() {
            return Rival { term, contains: false };
        }
        let columns = self.columns_in_logs(&term);
        let raw: Vec<Column> = columns.iter().map(|column| self.scaled(column)).collect();
        let brought = self.scaled(&self.logs.0);
        let power = dot(&brought, &brought);
        let contains = power - gain(&Basis::new(vec![]), &brought, &raw, 1e-9).chi2 < 1e-6 * power;
        for (k, coefficient) in term.coefficients.iter_mut().enumerate() {
            let given = candidate.gain.coefficients.get(k).copied().unwrap_or_default();
            *coefficient =
                if given == 0.0 { self.level / rms(&columns[k]).max(1e-150) } else { given };
        }
        Rival { term, contains }
    }

    /// Log of the Bayes factor that the logs alone give against an imitation.
    ///
    /// - `basis`: of what else the model has in the logs
    fn now(&self, basis: &Basis, rival: &Rival) -> f64 {
        self.separation(basis, &self.logs.0, rival, &|term| self.columns_in_logs(term))
    }

    /// The same to be expected of logs and motion together, for the imitation that is hardest to
    /// tell.
    fn with(&self, rivals: &[Rival], plan: &Plan) -> Expected {
        let Some(drawn) = self.drawn(plan) else { return Expected { separation: 0.0, shown: 0.0 } };
        let joined =
            |logs: &[f64], plan: &[f64]| -> Vec<f64> { logs.iter().chain(plan).copied().collect() };
        let brought = joined(&self.logs.0, &drawn.brought);
        let columns: Vec<Vec<f64>> =
            self.logs.1.iter().zip(&drawn.columns).map(|(a, b)| joined(a, b)).collect();
        let both = |term: &Term| -> Vec<Vec<f64>> {
            let (logs, plan) = (self.columns_in_logs(term), drawn.columns_of(self, term));
            logs.iter().zip(&plan).map(|(a, b)| joined(a, b)).collect()
        };
        let basis = self.basis(&columns);
        let separation = |rival: &Rival| self.separation(&basis, &brought, rival, &both);
        Expected {
            separation: rivals.iter().map(separation).fold(f64::INFINITY, f64::min),
            shown: rms(&drawn.brought) / self.level,
        }
    }

    /// What a rival, its parameters free, leaves of the finding's torque; if it contains the
    /// finding, what the finding leaves of the rival's.
    fn separation(
        &self,
        basis: &Basis,
        brought: &[f64],
        rival: &Rival,
        columns_of: &dyn Fn(&Term) -> Vec<Vec<f64>>,
    ) -> f64 {
        if rival.contains {
            let mut torque = vec![0.0; brought.len()];
            for (column, factor) in columns_of(&rival.term).iter().zip(&rival.term.coefficients) {
                torque.iter_mut().zip(column).for_each(|(torque, x)| *torque += factor * x);
            }
            return self.left(basis, &self.rest(basis, &torque), &columns_of(self.term));
        }
        let rest = self.rest(basis, brought);
        let left = |term: &Term| self.left(basis, &rest, &columns_of(term));
        variants(&rival.term).iter().map(left).fold(f64::INFINITY, f64::min)
    }

    /// Values in standard deviations of the noise; a row of the logs stands for several.
    fn scaled(&self, values: &[f64]) -> Column {
        let factor = |k: usize| if k < self.rows.len() { self.weight } else { 1.0 } / self.level;
        vec![values.iter().enumerate().map(|(k, x)| factor(k) * x).collect()]
    }

    /// Columns made orthonormal.
    fn basis(&self, columns: &[Vec<f64>]) -> Basis {
        Basis::new(columns.iter().map(|column| self.scaled(column)).collect())
    }

    /// What a basis leaves of a torque.
    fn rest(&self, basis: &Basis, torque: &[f64]) -> Column {
        let mut rest = self.scaled(torque);
        basis.project_out(&mut rest);
        rest
    }

    /// Half of chi-squared of what the columns of an imitation leave of it in addition.
    fn left(&self, basis: &Basis, rest: &Column, rival: &[Vec<f64>]) -> f64 {
        let columns: Vec<Column> = rival.iter().map(|column| self.scaled(column)).collect();
        0.5 * (dot(rest, rest) - gain(basis, rest, &columns, INVISIBLE).chi2).max(0.0)
    }

    fn columns_in_logs(&self, rival: &Term) -> Vec<Vec<f64>> {
        let columns = if rival.is_transform() {
            let rest = without(self.problem, self.fitted, self.term);
            vec![self.problem.difference([&rest, &with(&rest, rival, self.problem)], 1.0)]
        } else {
            self.problem.term_columns(&self.fitted.model, &self.fitted.rigid, rival)
        };
        let pick = |column: &Column| -> Vec<f64> {
            self.rows
                .iter()
                .map(|&row| column[self.joint].get(row).copied().unwrap_or_default())
                .collect()
        };
        columns.iter().map(pick).collect()
    }

    /// The equation of the joint along a plan.
    fn drawn(&self, plan: &Plan) -> Option<Drawn> {
        let robot = self.problem.nominal.robot();
        let n = robot.dof();
        let motion = &plan.motion;
        let every = motion.len().div_ceil(ROWS).max(1);
        let moves = |k: &usize| motion.dq[k * n + self.joint] != 0.0;
        let rows: Vec<usize> = (0..motion.len()).step_by(every).filter(moves).collect();
        if rows.is_empty() {
            return None;
        }
        let [_, end] = self.problem.time_span();
        let start = if self.problem.clock.is_some() { end + plan.later } else { 0.0 };
        let time = match self.problem.clock {
            Some(_) => motion.time.iter().map(|t| start + t).collect(),
            None => vec![],
        };
        let mut drawn = Drawn {
            motion: motion.clone(),
            time,
            rows,
            loaded: plan.loaded,
            brought: vec![],
            columns: vec![],
        };
        let rest = drawn.load(&without(self.problem, self.fitted, self.term));
        drawn.brought = drawn.difference(self, &rest, &drawn.load(&self.fitted.model));
        let mut columns = vec![vec![]; self.problem.base.rank()];
        let set = &self.problem.set;
        let parameters = set.effect_parameters_of(self.joint);
        let mut ws = Workspace::new(robot);
        let mut effects = vec![0.0; set.effect_columns_per_joint()];
        for &k in &drawn.rows {
            let at = k * n..(k + 1) * n;
            let state = JointState {
                q: &motion.q[at.clone()],
                dq: &motion.dq[at.clone()],
                ddq: &motion.ddq[at],
            };
            let row = regressor(robot, &mut ws, state.q, state.dq, state.ddq);
            let row = &row[self.joint * n * PARAMETERS_PER_LINK..][..n * PARAMETERS_PER_LINK];
            set.effect_row(self.joint, &state, &mut effects);
            for (column, &parameter) in columns.iter_mut().zip(self.problem.base.independent()) {
                let effect =
                    parameters.iter().position(|own| *own == parameter).map(|index| effects[index]);
                column.push(row.get(parameter).copied().or(effect).unwrap_or_default());
            }
        }
        for own in self.fitted.terms().iter().filter(|own| !own.is_like(self.term)) {
            columns.extend(drawn.linear_columns(self, own));
        }
        drawn.columns = columns;
        Some(drawn)
    }
}

/// The equation of a joint along a motion.
struct Drawn {
    motion: TrajectorySamples,
    time: Vec<f64>,
    rows: Vec<usize>,
    loaded: bool,
    /// The torque that the term brings.
    brought: Vec<f64>,
    /// Columns of what else the model has.
    columns: Vec<Vec<f64>>,
}

impl Drawn {
    fn trajectory(&self) -> Trajectory<'_> {
        let TrajectorySamples { q, dq, ddq, .. } = &self.motion;
        Trajectory {
            samples: Samples { q, dq, ddq },
            rate_hz: RATE_HZ,
            time: &self.time,
            channels: &[],
        }
    }

    /// A model with the payload of the plan.
    fn load(&self, model: &TorqueModel) -> TorqueModel {
        if self.loaded { with_payload(model) } else { model.clone() }
    }

    fn difference(&self, judge: &Judge<'_>, a: &TorqueModel, b: &TorqueModel) -> Vec<f64> {
        let n = judge.problem.dof();
        let [a, b] = [a, b].map(|model| model.predict_trajectory(&self.trajectory()));
        self.rows.iter().map(|k| b[k * n + judge.joint] - a[k * n + judge.joint]).collect()
    }

    fn linear_columns(&self, judge: &Judge<'_>, term: &Term) -> Vec<Vec<f64>> {
        let n = judge.problem.dof();
        let model = self.load(&judge.fitted.model);
        let trajectory = self.trajectory();
        let rigid = model.rigid(&trajectory);
        let columns = term.columns(&model.context(&trajectory, &rigid));
        let own = |column: &Vec<f64>| -> Vec<f64> {
            match term.effect.reach() {
                Reach::All => self.rows.iter().map(|k| column[k * n + judge.joint]).collect(),
                Reach::Own if term.site.joint() == Some(judge.joint) => {
                    self.rows.iter().map(|k| column[*k]).collect()
                }
                Reach::Own => vec![0.0; self.rows.len()],
            }
        };
        columns.iter().map(own).collect()
    }

    fn columns_of(&self, judge: &Judge<'_>, rival: &Term) -> Vec<Vec<f64>> {
        if rival.is_transform() {
            let rest = self.load(&without(judge.problem, judge.fitted, judge.term));
            vec![self.difference(judge, &rest, &with(&rest, rival, judge.problem))]
        } else {
            self.linear_columns(judge, rival)
        }
    }
}

/// The term with each of its constants as it is, a third of it and three times it.
fn variants(term: &Term) -> Vec<Term> {
    let mut all = vec![term.clone()];
    for (k, constant) in term.effect.constants().iter().enumerate() {
        if constant.scale == Scale::Logarithmic {
            for factor in [1.0 / 3.0, 0.6, 1.7, 3.0] {
                let mut other = term.clone();
                other.constants[k] =
                    (factor * other.constants[k]).clamp(constant.low, constant.high);
                all.push(other);
            }
        }
    }
    all
}

fn without(problem: &Problem, fitted: &Fitted, term: &Term) -> TorqueModel {
    let rest = fitted.terms().iter().filter(|own| !own.is_like(term)).cloned().collect();
    fitted.model.clone().with_terms(rest, problem.clock)
}

fn with(model: &TorqueModel, term: &Term, problem: &Problem) -> TorqueModel {
    let terms = model.terms().iter().cloned().chain([term.clone()]).collect();
    model.clone().with_terms(terms, problem.clock)
}

/// The model with a payload of [`PAYLOAD`] at the last link's origin.
fn with_payload(model: &TorqueModel) -> TorqueModel {
    let mut loaded = model.clone();
    let mut parameters = model.parameters().to_vec();
    parameters[(model.robot().dof() - 1) * PARAMETERS_PER_LINK] += PAYLOAD;
    loaded.set_parameters(parameters);
    loaded
}

/// What the arm did in the logs: positions that it took, speeds and accelerations that it reached,
/// within its limits.
fn room(search: &Search<'_>) -> Room {
    /// Share of the samples whose speeds and accelerations count as reached: the others are spikes.
    const COMMON: f64 = 0.995;
    let problem = &search.problem;
    let robot = problem.nominal.robot();
    let n = robot.dof();
    let high_of = |joint: usize, of: &dyn Fn(usize) -> Vec<f64>| {
        let mut all: Vec<f64> = (0..problem.stretches.len())
            .flat_map(|index| {
                of(index).into_iter().skip(joint).step_by(n).map(f64::abs).collect::<Vec<_>>()
            })
            .collect();
        all.sort_by(f64::total_cmp);
        all.get(((all.len() as f64 * COMMON) as usize).min(all.len().saturating_sub(1)))
            .copied()
            .unwrap_or_default()
    };
    let limits: Vec<JointLimits> = (0..n)
        .map(|joint| {
            let own = robot.joints()[joint].limits;
            let [mut low, mut high] = problem.range(joint);
            if let Some([lowest, highest]) = own.position {
                (low, high) = (low.max(lowest), high.min(highest));
            }
            let speed = high_of(joint, &|index| problem.stretches[index].motion.dq.clone());
            let acceleration = high_of(joint, &|index| problem.stretches[index].motion.ddq.clone());
            JointLimits {
                range: [low, high.max(low)],
                speed: own
                    .velocity
                    .filter(|limit| *limit > 0.0)
                    .map_or(speed, |limit| limit.min(speed)),
                acceleration,
            }
        })
        .collect();
    // The sample nearest to the middle of all.
    let distance = |q: &[f64]| -> f64 {
        let share = |(q, limits): (&f64, &JointLimits)| {
            let [low, high] = limits.range;
            ((q - 0.5 * (low + high)) / (high - low).max(1e-9)).powi(2)
        };
        q.iter().zip(&limits).map(share).sum()
    };
    let poses = problem.stretches.iter().flat_map(|stretch| stretch.motion.q.chunks_exact(n));
    let home = poses
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .map_or(vec![0.0; n], <[f64]>::to_vec);
    let home = home.iter().zip(&limits).map(|(q, l)| q.clamp(l.range[0], l.range[1])).collect();
    let piece = problem.stretches.first().and_then(|stretch| {
        let motion = &stretch.motion;
        let first = motion.inner.iter().position(|inner| *inner)?;
        let last = (first + (PIECE_S * motion.rate_hz) as usize)
            .min(motion.inner.iter().rposition(|inner| *inner)?);
        let cut = |values: &[f64]| values[first * n..(last + 1) * n].to_vec();
        (last > first + 10)
            .then(|| (motion.rate_hz, [cut(&motion.q), cut(&motion.dq), cut(&motion.ddq)]))
    });
    let units = robot.joints().iter().map(|joint| joint.kind.position_unit()).collect();
    Room { home, limits, units, piece }
}
