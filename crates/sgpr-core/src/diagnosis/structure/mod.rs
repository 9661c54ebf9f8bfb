//! What is left of a joint's torque: is it noise, what does it depend on, what shape has it, when
//! does it begin?
//!
//! Works on the residual of any model on any logs: of a comparison as of a diagnosis.

mod change;
mod rows;
mod shape;
mod smoother;
mod whiteness;

pub use change::Change;
use rayon::prelude::*;
use rows::JointRows;
use serde::{Deserialize, Serialize};
use smoother::{Explained, Smooth, Variable, cross_validated};
use whiteness::{autoregression, memory, portmanteau};

use super::fit::Fitted;
use super::problem::Problem;
use crate::effects::sgn;
use crate::model::{LogResidual, TorqueModel};
use crate::robot::Robot;

/// A function of the state that a residual is correlated with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Dependence {
    /// The function: `speed of joint_2`, `size of the acceleration`.
    pub on: String,
    /// Correlation.
    pub correlation: f64,
    /// Two standard deviations of it for noise that remembers itself as what is left does.
    pub band: f64,
}

/// A variable that the structure of a residual depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Input {
    /// The variable: `speed of joint_2`.
    pub variable: String,
    /// Share of the residual's variance on unseen blocks that a smooth function of it alone
    /// explains.
    pub alone: f64,
    /// Share that is lost without it: its total effect, interactions included.
    pub total: f64,
}

/// Shares of a residual's variance; they add up to one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Shares {
    /// A smooth function of position, speed, acceleration and load explains it on blocks of time
    /// that it has not seen.
    pub state: f64,
    /// A function of time explains of what is left.
    pub time: f64,
    /// Neither does.
    pub noise: f64,
}

/// What is left of one joint's torque.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointStructure {
    /// Joint.
    pub joint: String,
    /// Root mean square residual, N·m (N).
    pub rmse: f64,
    /// Rows.
    pub rows: usize,
    /// How many independent rows tell as much, by the memory of the residual.
    pub independent_rows: f64,
    /// Probability that noise is as far from white as the residual is, once whitened as what is
    /// left needs it.
    pub whiteness: f64,
    /// Functions of the state with a correlation beyond three and a half standard deviations,
    /// largest first.
    pub dependence: Vec<Dependence>,
    /// Whence its variance comes.
    pub shares: Shares,
    /// What its structure depends on, most important first.
    pub inputs: Vec<Input>,
    /// When it changes, if there is evidence that it does.
    pub change: Option<Change>,
    /// Its shape, in words.
    pub shape: Vec<String>,
    /// All of it in one sentence.
    pub summary: String,
}

impl JointStructure {
    /// The fields as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("finite numbers and strings")
    }

    /// Whether there is structure worth a word.
    pub fn has_structure(&self) -> bool {
        self.shares.state + self.shares.time > MATERIAL
    }
}

/// Structure with a smaller share of the variance is not worth a word.
const MATERIAL: f64 = 0.05;

/// Rows on which variables are chosen, and features of each function of them.
const ROWS_TO_CHOOSE: usize = 1000;
/// Features of each function on which variables are chosen ...
const FEATURES_TO_CHOOSE: usize = 36;
/// ... and with which the chosen ones are described.
const FEATURES: usize = 80;

/// A variable must bring so much of the variance, and so much of what the others bring.
const LEAST_GAIN: f64 = 0.015;
/// The same as a share of what the others bring.
const LEAST_SHARE: f64 = 0.04;

/// Most variables of a function.
const MOST_INPUTS: usize = 3;

/// What `model` leaves of the torque of every joint in a comparison with logs.
///
/// - `logs`: the stretches of a [`Comparison`](crate::model::Comparison) with it
pub fn structure_of_logs(model: &TorqueModel, logs: &[&LogResidual]) -> Vec<JointStructure> {
    let robot = model.robot();
    let decimation = |log: &&LogResidual| {
        let band = model.processing().and_then(|processing| processing.torque_cutoff_hz);
        band.map_or(1, |band| {
            (log.motion.rate_hz / (ROWS_PER_CUTOFF * band)).floor().max(1.0) as usize
        })
    };
    let decimation = logs.first().map_or(1, decimation);
    by_joint(robot, |joint| JointRows::of_logs(logs, robot.dof(), decimation, joint))
}

/// Rows per second, in cut-offs of the filter that the torque passed.
const ROWS_PER_CUTOFF: f64 = 3.0;

/// What a fit leaves of the torque of every joint.
pub(super) fn structure_of_fit(problem: &Problem, fitted: &Fitted) -> Vec<JointStructure> {
    by_joint(problem.nominal.robot(), |joint| JointRows::of_fit(problem, fitted, joint))
}

fn by_joint(robot: &Robot, rows: impl Fn(usize) -> JointRows + Sync) -> Vec<JointStructure> {
    let names: Vec<&str> = robot.joint_names().collect();
    let unit = |joint: usize| robot.joints()[joint].kind.position_unit();
    (0..names.len())
        .into_par_iter()
        .map(|joint| analyse(&rows(joint), &names, unit(joint)))
        .collect()
}

fn analyse(rows: &JointRows, names: &[&str], unit: &str) -> JointStructure {
    let energy: f64 = rows.residual.iter().map(|r| r * r).sum();
    let count = rows.len().max(1) as f64;
    let mut found = JointStructure {
        joint: names[rows.joint].into(),
        rmse: (energy / count).sqrt(),
        rows: rows.len(),
        independent_rows: count,
        whiteness: 1.0,
        dependence: vec![],
        shares: Shares { state: 0.0, time: 0.0, noise: 1.0 },
        inputs: vec![],
        change: None,
        shape: vec![],
        summary: String::new(),
    };
    if rows.len() < 200 || energy <= 0.0 {
        found.summary = format!("{}: too few rows to tell noise from structure.", found.joint);
        return found;
    }
    let state = of_state(rows);
    let rest: Vec<f64> =
        rows.residual.iter().zip(&state.explained.predicted).map(|(r, p)| r - p).collect();
    let by_time = of_time(rows, &rest);
    let noise: Vec<f64> = rest.iter().zip(&by_time.predicted).map(|(r, p)| r - p).collect();
    let left = noise.iter().map(|x| x * x).sum::<f64>() / energy;
    let (by_state, time) =
        (state.explained.share.max(0.0), (1.0 - state.explained.share.max(0.0) - left).max(0.0));
    found.shares = Shares { state: by_state, time, noise: 1.0 - by_state - time };
    let phi = autoregression(&noise, &rows.run);
    found.whiteness = portmanteau(&rows.residual, &rows.run, &phi);
    let own_memory = memory(&rows.residual, &rows.run);
    found.independent_rows =
        (count / (1.0 + 2.0 * own_memory.iter().sum::<f64>()).max(1.0)).max(1.0);
    found.dependence = dependence(rows, names, &memory(&noise, &rows.run));
    found.change = change::change(&rows.with_residual(rest), &noise)
        .map(|found| change::Change { share: found.share * (1.0 - by_state), ..found })
        .filter(|change| change.probability > 0.95 && change.share > MATERIAL);
    if by_state > MATERIAL {
        found.inputs = state.inputs(rows, names);
        found.shape = shape::words(rows, &state, unit);
    }
    found.summary = summary(&found);
    found
}

/// The function of the state that explains most of a residual.
struct OfState {
    variables: Vec<Variable>,
    smooth: Smooth,
    explained: Explained,
    /// A periodic function of the joint's own position: periods per turn and share, if there is
    /// one.
    periodic: Option<shape::Periodic>,
}

fn of_state(rows: &JointRows) -> OfState {
    let few = rows.thinned(ROWS_TO_CHOOSE);
    let joint = rows.joint;
    let own =
        [Variable::Position(joint), Variable::Speed(joint), Variable::Acceleration, Variable::Load];
    let others = (0..rows.q.len())
        .filter(|j| *j != joint)
        .flat_map(|j| [Variable::Position(j), Variable::Speed(j)]);
    let all: Vec<Variable> = own.into_iter().chain(others).collect();
    let share = |variables: &[Variable]| {
        let smooth = Smooth::new(&few, variables, FEATURES_TO_CHOOSE, 1);
        cross_validated(&smooth.columns(&few, false), &few.residual, &few.fold).share
    };
    let gains =
        |more: f64, less: f64| more > less.max(0.0) + LEAST_GAIN + LEAST_SHARE * less.max(0.0);
    let best_of = |sets: Vec<Vec<Variable>>| {
        let scored = sets.into_iter().map(|set| (share(&set), set));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).expect("some variables")
    };
    let (mut value, mut chosen) = best_of(all.iter().map(|variable| vec![*variable]).collect());
    if !gains(value, 0.0) {
        (value, chosen) = (0.0, vec![]);
    }
    let mut pairs = Vec::new();
    for (k, first) in own.iter().enumerate() {
        pairs.extend(all[k + 1..].iter().map(|second| vec![*first, *second]));
    }
    let pair = best_of(pairs);
    if gains(pair.0, value) {
        (value, chosen) = pair;
    }
    while !chosen.is_empty() && chosen.len() < MOST_INPUTS {
        let more = all
            .iter()
            .filter(|v| !chosen.contains(v))
            .map(|v| [&chosen[..], &[*v]].concat())
            .collect();
        let next = best_of(more);
        if !gains(next.0, value) {
            break;
        }
        (value, chosen) = next;
    }
    let smooth = Smooth::new(rows, &chosen, if chosen.is_empty() { 0 } else { FEATURES }, 2);
    let mut columns = smooth.columns(rows, false);
    let mut explained = cross_validated(&columns, &rows.residual, &rows.fold);
    let rest: Vec<f64> =
        rows.residual.iter().zip(&explained.predicted).map(|(r, p)| r - p).collect();
    let mut periodic = shape::periodic(&rows.with_residual(rest));
    if let Some(found) = &mut periodic {
        columns.extend(found.columns(rows));
        let with = cross_validated(&columns, &rows.residual, &rows.fold);
        found.share = with.share - explained.share.max(0.0);
        if found.share > LEAST_GAIN {
            explained = with;
        } else {
            periodic = None;
        }
    }
    OfState { variables: chosen, smooth, explained, periodic }
}

impl OfState {
    /// The variables by the share that is lost without each.
    fn inputs(&self, rows: &JointRows, names: &[&str]) -> Vec<Input> {
        let share = |variables: &[Variable]| {
            if variables.is_empty() {
                return 0.0;
            }
            let smooth = Smooth::new(rows, variables, FEATURES, 2);
            cross_validated(&smooth.columns(rows, false), &rows.residual, &rows.fold).share.max(0.0)
        };
        let all = share(&self.variables);
        let mut inputs: Vec<Input> = self
            .variables
            .iter()
            .map(|variable| {
                let others: Vec<Variable> =
                    self.variables.iter().filter(|v| *v != variable).copied().collect();
                let name = name_of(*variable, names, rows.joint);
                Input {
                    variable: name,
                    alone: share(&[*variable]),
                    total: (all - share(&others)).max(0.0),
                }
            })
            .collect();
        if let Some(periodic) = &self.periodic {
            let own = name_of(Variable::Position(rows.joint), names, rows.joint);
            match inputs.iter_mut().find(|input| input.variable == own) {
                Some(input) => input.total += periodic.share,
                None => inputs.push(Input {
                    variable: own,
                    alone: periodic.share,
                    total: periodic.share,
                }),
            }
        }
        inputs
            .sort_by(|a, b| b.total.total_cmp(&a.total).then_with(|| a.variable.cmp(&b.variable)));
        inputs
    }
}

/// A function of time on what the state leaves: slow waves, alone, with the direction and with the
/// load.
fn of_time(rows: &JointRows, rest: &[f64]) -> Explained {
    /// Slow waves over the session.
    const WAVES: usize = 8;
    if rows.time.is_empty() {
        return Explained { predicted: vec![0.0; rows.len()], ..Explained::default() };
    }
    let [start, end] = rows
        .time
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], t| [a.min(*t), b.max(*t)]);
    let size = rows.load.iter().fold(1e-12, |size: f64, tau| size.max(tau.abs()));
    let mut columns = Vec::new();
    for wave in 0..WAVES {
        let factor = std::f64::consts::PI * wave as f64 / (end - start).max(1e-9);
        let slow: Vec<f64> = rows.time.iter().map(|t| (factor * (t - start)).cos()).collect();
        let times = |function: &dyn Fn(usize) -> f64| {
            slow.iter().enumerate().map(|(k, x)| x * function(k)).collect()
        };
        columns.push(times(&|k| sgn(rows.dq[rows.joint][k])));
        columns.push(times(&|k| rows.load[k] / size));
        columns.push(slow);
    }
    let explained = cross_validated(&columns, rest, &rows.fold);
    if explained.share > LEAST_GAIN {
        explained
    } else {
        Explained { predicted: vec![0.0; rows.len()], ..Explained::default() }
    }
}

fn dependence(rows: &JointRows, names: &[&str], memory: &[f64]) -> Vec<Dependence> {
    /// Standard deviations beyond which a correlation is told.
    const BEYOND: f64 = 3.5;
    let own = rows.joint;
    let mut functions: Vec<(String, Vec<f64>)> = Vec::new();
    let mut add = |name: String, values: &[f64]| {
        functions.push((format!("size of the {name}"), values.iter().map(|x| x.abs()).collect()));
        functions.push((name, values.to_vec()));
    };
    for joint in 0..names.len() {
        add(name_of(Variable::Position(joint), names, own), &rows.q[joint]);
        add(name_of(Variable::Speed(joint), names, own), &rows.dq[joint]);
    }
    add(name_of(Variable::Acceleration, names, own), &rows.ddq);
    add(name_of(Variable::Load, names, own), &rows.load);
    if !rows.time.is_empty() {
        functions.push(("time".into(), rows.time.clone()));
    }
    let directions = rows.dq[own].iter().map(|dq| sgn(*dq)).collect();
    functions.push((format!("direction of {}", names[own]), directions));
    let mut found: Vec<(f64, Dependence)> = functions
        .into_iter()
        .map(|(on, values)| {
            let (correlation, deviation) = whiteness::correlation(rows, &values, memory);
            (correlation.abs() / deviation, Dependence { on, correlation, band: 2.0 * deviation })
        })
        .filter(|(size, _)| *size > BEYOND)
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(6).map(|(_, one)| one).collect()
}

fn name_of(variable: Variable, names: &[&str], own: usize) -> String {
    match variable {
        Variable::Position(joint) => format!("position of {}", names[joint]),
        Variable::Speed(joint) => format!("speed of {}", names[joint]),
        Variable::Acceleration => format!("acceleration of {}", names[own]),
        Variable::Load => format!("load of {}", names[own]),
    }
}

fn summary(found: &JointStructure) -> String {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let Shares { state, time, noise } = found.shares;
    let mut parts = Vec::new();
    if state > MATERIAL {
        let inputs: Vec<&str> = found.inputs.iter().map(|input| input.variable.as_str()).collect();
        let on = if inputs.is_empty() {
            "nothing that varies: it is constant".into()
        } else {
            inputs.join(", ")
        };
        let shape = if found.shape.is_empty() {
            String::new()
        } else {
            format!(" ({})", found.shape.join("; "))
        };
        parts.push(format!("{} of the variance depends on {on}{shape}", percent(state)));
    }
    if time > MATERIAL {
        parts.push(format!("{} on time", percent(time)));
    }
    let rest = if found.whiteness > 0.01 && parts.is_empty() {
        "what is left is noise".into()
    } else {
        format!("{} is noise or depends on what was not looked at", percent(noise))
    };
    parts.push(rest);
    if let Some(change) = &found.change {
        let [low, high] = change.interval;
        let until = change.end.map_or(String::new(), |end| format!(" and ends at {end:.1} s"));
        parts.push(format!("it changes at {:.1} s ({low:.1} to {high:.1} s){until}", change.time));
    }
    format!("{}: {}.", found.joint, parts.join("; "))
}
