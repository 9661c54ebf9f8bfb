//! What changed between sessions of one arm: friction, offset and gain of each joint, and what the last link carries.
//!
//! Every session has values of its own where that predicts parts of the logs that were left out better than common values
//! do, and where values of the sessions differ by more than parts of one session do. What changed is taken up one by one,
//! that which saves most first, all other parameters fitted again each time.

use std::collections::BTreeSet;

use faer::{Col, Mat};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use super::super::experiment::{Experiment, torque_of};
use super::super::torque_model::nominal_parameters;
use super::super::variable_projection::Columns;
use super::super::{IdentifyError, TorqueModel};
use super::make::{experiment, record_of, recorded_effects};
use super::sum::{correlation, fit, stacked};
use super::{Record, RecordError, RecordOptions, choose_processing};
use crate::dynamics::{Workspace, gravity_torque};
use crate::effects::Role;
use crate::identification::{
    BaseParameters, Estimate, JointFactor, Judgement, LeastSquares, Method, ParameterSet, Row, TrajectoryColumn,
};
use crate::linalg::{symmetric_eigen, triangle};
use crate::motion::{Conditioning, Motion, MotionError};
use crate::progress::Progress;
use crate::recording::{LogSet, Recording};
use crate::robot::{Joint, JointKind, Robot};
use crate::spatial::PARAMETERS_PER_LINK;

/// What may differ between sessions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SessionCause {
    /// Mass and first moments of what the last link carries.
    Tool,
    /// The friction of a joint: parameters of its effects but inertia and offset.
    Friction {
        /// Joint.
        joint: usize,
    },
    /// The torque offset of a joint.
    Offset {
        /// Joint.
        joint: usize,
    },
    /// The gain of a joint's torque: its motor constant, or its sensor.
    Gain {
        /// Joint.
        joint: usize,
    },
}

/// What was found of a cause.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionTest {
    /// What is asked.
    pub cause: SessionCause,
    /// Per session: mean friction in the motion of all sessions, N·m (N); offset, N·m (N); gain; mass beyond the mean of all
    /// sessions, kg.
    pub values: Vec<f64>,
    /// Standard deviations, from what parts of one session differ by; infinite where a session does not determine the value.
    pub deviations: Vec<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// Probability that chance makes sessions differ as much.
    pub chance: f64,
    /// Values of each session against common ones, squares of errors on parts of the logs that were left out of both.
    pub judgement: Judgement,
    /// Whether it changed: beyond chance, and so that it matters to the prediction.
    pub changed: bool,
    /// Squares that values of each session save on parts that were left out, in units of the noise.
    saved: f64,
}

/// What sessions of one arm have in common, and what not.
#[derive(Clone, Debug)]
pub struct SessionComparison {
    /// Names of the sessions, as given.
    pub names: Vec<String>,
    /// All causes that the logs can test: the tool, then joint by joint.
    pub tests: Vec<SessionTest>,
    /// A model of each session: everything common but what changed. Gains that changed are not in it: its torque is that of
    /// all sessions together.
    pub models: Vec<TorqueModel>,
    /// What is to be said of copies.
    pub notes: Vec<String>,
    joints: Vec<String>,
}

/// Probability that anything at all is called changed if nothing is.
const FALSE_ALARM: f64 = 0.01;

/// Values of their own must lower the left-out error by as much as a finding of a diagnosis does, in squares ...
const MATTERS: f64 = 0.05;

/// ... and beyond so many of its standard deviations.
const SURE: f64 = 2.5;

/// Length of a part, s.
const PART_SECONDS: f64 = 2.0;

/// Fewer parts of a session do not say how much it scatters.
const FEWEST_PARTS: usize = 3;

/// Parameters of a tool that sessions tell: mass and first moments.
const OF_TOOL: usize = 4;

/// Finds what changed between sessions of one arm.
///
/// - `sessions`: a name and the logs of each session
/// - `effects`: beside the rigid body, each a linear function of the present motion and at every joint
///
/// Logs are cut into parts of two seconds, from which the scatter is taken. What the model lacks would look like a change
/// where sessions move differently: beside the effects there is a torque of any shape, a smooth function of each joint's
/// position, speed and load, that is common to all sessions.
///
/// # Errors
/// As [`record`](super::record), if the work is stopped, and if there are fewer than two sessions, or one has too little motion.
pub fn compare_sessions(
    robot: &Robot,
    sessions: &[(String, Vec<Recording>)],
    effects: &[String],
    conditioning: &Conditioning,
    progress: &dyn Progress,
) -> Result<SessionComparison, RecordError> {
    if sessions.len() < 2 {
        let message = format!("{} session: two or more make a comparison", sessions.len());
        return Err(RecordError::Sessions { message });
    }
    let all: Vec<Recording> = sessions.iter().flat_map(|(_, logs)| logs.iter().cloned()).collect();
    // A log counts once, in the first session that has it.
    let logs = LogSet::new(&all);
    let processing = choose_processing(robot, logs.logs(), conditioning)?;
    let session_of: Vec<usize> =
        sessions.iter().enumerate().flat_map(|(session, (_, logs))| std::iter::repeat_n(session, logs.len())).collect();
    let ready = |(log, origin): (&Recording, &usize)| {
        let experiment = experiment(robot, log, &processing)?;
        Ok(Ready { session: session_of[*origin], log: log.clone(), experiment })
    };
    let ready: Vec<Ready> = logs.logs().iter().zip(logs.origins()).map(ready).collect::<Result<_, RecordError>>()?;
    for (session, (name, _)) in sessions.iter().enumerate() {
        let own = ready.iter().filter(|one| one.session == session);
        let parts: usize = own.map(|one| one.moving_parts(robot.dof())).sum();
        if parts < FEWEST_PARTS {
            let message = format!(
                "session `{name}` has {parts} parts of {PART_SECONDS} s in motion that no other session has, \
                 {FEWEST_PARTS} are the fewest"
            );
            return Err(RecordError::Sessions { message });
        }
    }
    let set = ParameterSet::new(robot, &recorded_effects(robot, effects)?).map_err(IdentifyError::from)?;
    let shapes = Shapes::new(robot, &ready);
    let flexible = set.clone().with_trajectory_columns(shapes.parameters());
    let bases = [BaseParameters::new(robot, &flexible), BaseParameters::new(robot, &set)];
    let record = |one: &Ready, shapes: Option<&Shapes>| {
        let columns =
            shapes.map(|shapes| shapes.columns(&one.experiment.motions)).transpose().map_err(IdentifyError::from)?;
        let options = RecordOptions { blocks: one.parts(), lags: shapes.is_none(), ..RecordOptions::default() };
        let equations = if shapes.is_some() { (&flexible, &bases[0]) } else { (&set, &bases[1]) };
        record_of(robot, &one.log, (&one.experiment, columns.as_ref()), equations, &processing, &options)
    };
    let of_all = |shapes: Option<&Shapes>| {
        let mut records: Vec<Vec<Record>> = vec![vec![]; sessions.len()];
        let before = if shapes.is_some() { 0 } else { ready.len() };
        for (done, one) in ready.iter().enumerate() {
            progress.step("logs", before + done, 2 * ready.len()).map_err(IdentifyError::from)?;
            records[one.session].push(record(one, shapes)?);
        }
        Ok::<_, RecordError>(records)
    };
    let [flexible_records, plain_records] = [of_all(Some(&shapes))?, of_all(None)?];
    let arm = Arm::new(robot, &flexible, &bases[0], &flexible_records);
    let (tests, own, gains) = arm.changes(progress)?;
    let plain = Arm::new(robot, &set, &bases[1], &plain_records);
    let (state, correlation) = plain.fit_with_memory(&own, gains)?;
    let model = |(session, (name, _)): (usize, &(String, _))| plain.model((session, name), &own, &state, &correlation);
    Ok(SessionComparison {
        models: sessions.iter().enumerate().map(model).collect(),
        names: sessions.iter().map(|(name, _)| name.clone()).collect(),
        tests,
        notes: logs.notes().to_vec(),
        joints: robot.joint_names().map(String::from).collect(),
    })
}

/// A log that is ready.
struct Ready {
    session: usize,
    log: Recording,
    experiment: Experiment,
}

impl Ready {
    fn parts(&self) -> usize {
        ((self.log.duration() / PART_SECONDS) as usize).max(1)
    }

    /// Parts that the joint that moves most moves for.
    fn moving_parts(&self, joints: usize) -> usize {
        let seconds = |joint: usize| {
            let of_motion = |motion: &Motion| {
                let rows = motion.use_as.iter().skip(joint).step_by(joints);
                rows.filter(|row| **row == Row::Moving).count() as f64 / motion.rate_hz
            };
            self.experiment.motions.iter().map(of_motion).sum::<f64>()
        };
        let most = (0..joints).map(seconds).fold(0.0, f64::max);
        ((most / PART_SECONDS) as usize).min(self.parts())
    }
}

/// Functions of a joint's position, speed and load, of which a torque of any shape is made.
struct Shapes<'a> {
    robot: &'a Robot,
    /// Per joint: root mean square speed, and the range of a joint that slides.
    scales: Vec<(f64, [f64; 2])>,
}

/// Shares of the usual speed at which friction may have taken half of its turn.
const TURNS: [f64; 3] = [0.05, 0.2, 0.7];

/// Functions of each joint.
const SHAPES: usize = TURNS.len() + 4 + 8 + 1;

impl<'a> Shapes<'a> {
    fn new(robot: &'a Robot, logs: &[Ready]) -> Self {
        let n = robot.dof();
        let scale = |joint: usize| {
            let (mut squares, mut rows, mut range) = (0.0, 0, [f64::INFINITY, f64::NEG_INFINITY]);
            for motion in logs.iter().flat_map(|one| &one.experiment.motions) {
                for at in (joint..motion.q.len()).step_by(n).filter(|at| motion.use_as[*at] == Row::Moving) {
                    squares += motion.dq[at] * motion.dq[at];
                    rows += 1;
                    range = [range[0].min(motion.q[at]), range[1].max(motion.q[at])];
                }
            }
            let speed = (squares / f64::max(rows as f64, 1.0)).sqrt();
            let slides = robot.joints()[joint].kind == JointKind::Prismatic && range[1] > range[0];
            // A joint that turns repeats itself after a turn, one that slides does not within twice its range.
            let period = if slides { [range[0], 2.0 * (range[1] - range[0])] } else { [0.0, std::f64::consts::TAU] };
            (if speed > 0.0 { speed } else { 1.0 }, period)
        };
        Self { robot, scales: (0..n).map(scale).collect() }
    }

    /// Whether a column, counted over all joints, is friction of this one: what turns with the speed.
    fn is_friction(column: usize, joint: usize) -> bool {
        let even = TURNS.len() + 2..TURNS.len() + 8;
        column / SHAPES == joint && !even.contains(&(column % SHAPES))
    }

    fn parameters(&self) -> Vec<TrajectoryColumn> {
        let of = |joint: &Joint, index: usize, k: usize| TrajectoryColumn {
            name: format!("{}.shape_{k}", joint.name),
            unit: joint.kind.torque_unit(),
            joint: Some(index),
            non_negative: false,
            size: 1.0,
        };
        let joints = self.robot.joints().iter().enumerate();
        joints.flat_map(|(index, joint)| (0..SHAPES).map(move |k| of(joint, index, k))).collect()
    }

    fn columns(&self, motions: &[Motion]) -> Result<Columns, MotionError> {
        let n = self.robot.dof();
        let mut ws = Workspace::new(self.robot);
        let mut of_motion = |motion: &Motion| {
            let mut columns = vec![vec![0.0; motion.len()]; n * SHAPES];
            for sample in 0..motion.len() {
                let at = sample * n..(sample + 1) * n;
                let load = gravity_torque(self.robot, &mut ws, &motion.q[at.clone()]);
                for joint in 0..n {
                    let values =
                        self.values(joint, motion.q[at.start + joint], motion.dq[at.start + joint], load[joint]);
                    for (column, value) in columns[joint * SHAPES..].iter_mut().zip(values) {
                        column[sample] = value;
                    }
                }
            }
            columns
        };
        let values = motions.iter().map(&mut of_motion).collect();
        let tau = motions.iter().map(|motion| torque_of(motion).map(<[f64]>::to_vec)).collect::<Result<_, _>>()?;
        Ok(Columns { tau, values, parameters: vec![] })
    }

    fn values(&self, joint: usize, q: f64, dq: f64, load: f64) -> [f64; SHAPES] {
        let (speed, [zero, period]) = self.scales[joint];
        let (x, angle) = (dq / speed, std::f64::consts::TAU * (q - zero) / period);
        let turned = TURNS.map(|turn| (x / turn).tanh());
        let place = [angle.sin(), angle.cos(), (2.0 * angle).sin(), (2.0 * angle).cos()];
        let mut all = [0.0; SHAPES];
        let values = turned.into_iter().chain([x * x.abs(), x.powi(3), x.abs(), x * x]);
        let values = values.chain(place).chain(place.map(|value| turned[0] * value)).chain([turned[0] * load.abs()]);
        all.iter_mut().zip(values).for_each(|(all, value)| *all = value);
        all
    }
}

/// What is taken to differ between sessions.
type Own = BTreeSet<SessionCause>;

/// Factors on the torque of each joint, by session.
type Gains = Vec<Vec<f64>>;

struct Arm<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    base: &'a BaseParameters,
    start: Vec<f64>,
    /// Per session.
    records: &'a [Vec<Record>],
    /// Per session: all rows.
    factors: Vec<Vec<JointFactor>>,
    /// Per joint: base parameters of its friction, of shapes that are friction, and of its offset.
    friction: Vec<Vec<usize>>,
    shapes: Vec<Vec<usize>>,
    offset: Vec<Vec<usize>>,
    /// Base parameters that a unit of each of the tool's parameters makes.
    tool: Vec<Vec<f64>>,
}

/// Values of a fit.
struct State {
    /// Base parameters of each session, its tool included.
    values: Vec<Vec<f64>>,
    /// Tool of each session beyond that of the first.
    tool: Vec<Vec<f64>>,
    gains: Gains,
    /// Noise of each joint in motion, zero where it never moves.
    noise: Vec<f64>,
    estimate: Estimate,
    /// By session, their columns unknowns.
    factors: Vec<(usize, JointFactor)>,
}

/// What is told of a cause: a combination of its numbers, and what comes to it.
struct Told {
    unit: &'static str,
    share: Col<f64>,
    rest: f64,
}

/// Normal equations of a part of a session.
struct Part {
    session: usize,
    gram: Mat<f64>,
    right: Col<f64>,
    squares: f64,
}

impl<'a> Arm<'a> {
    fn new(robot: &'a Robot, set: &'a ParameterSet, base: &'a BaseParameters, records: &'a [Vec<Record>]) -> Self {
        let factors = |records: &Vec<Record>| {
            let all: Vec<&JointFactor> =
                records.iter().flat_map(|record| &record.blocks).flat_map(|block| &block.factors).collect();
            stacked(&all)
        };
        let of_role = |joint: usize, wanted: fn(Option<Role>) -> bool| {
            let of_effects = set.effect_parameters_of(joint).into_iter().filter(move |parameter| {
                let column = set.effect_columns()[parameter - set.inertial()];
                wanted(set.effects()[column.effect].role())
            });
            of_effects.collect::<Vec<usize>>()
        };
        let in_base = |own: Vec<usize>| (0..base.rank()).filter(|k| own.contains(&base.independent()[*k])).collect();
        let is_friction = |role| !matches!(role, Some(Role::Offset | Role::RotorInertia));
        let friction = |joint: usize| in_base(of_role(joint, is_friction));
        let shapes = |joint: usize| {
            let all = set.of_state()..set.len();
            in_base(all.filter(|parameter| Shapes::is_friction(parameter - set.of_state(), joint)).collect())
        };
        let offset = |joint: usize| in_base(of_role(joint, |role| role == Some(Role::Offset)));
        let first = set.inertial() - PARAMETERS_PER_LINK;
        let direction = |parameter: usize| {
            let unit: Vec<f64> = (0..set.len()).map(|k| f64::from(u8::from(k == parameter))).collect();
            base.combine(&unit)
        };
        Self {
            robot,
            set,
            base,
            start: nominal_parameters(robot, set),
            factors: records.iter().map(factors).collect(),
            records,
            friction: (0..robot.dof()).map(friction).collect(),
            shapes: (0..robot.dof()).map(shapes).collect(),
            offset: (0..robot.dof()).map(offset).collect(),
            tool: (first..first + OF_TOOL).map(direction).collect(),
        }
    }

    /// What changed, one after the other, with the factors that did, and what was found of all causes.
    fn changes(&self, progress: &dyn Progress) -> Result<(Vec<SessionTest>, Own, Gains), RecordError> {
        let of_joint =
            |joint| [SessionCause::Friction { joint }, SessionCause::Offset { joint }, SessionCause::Gain { joint }];
        let joints = (0..self.robot.dof()).flat_map(of_joint);
        let causes: Vec<SessionCause> = std::iter::once(SessionCause::Tool).chain(joints).collect();
        let ones = vec![1.0; self.robot.dof()];
        let (mut own, mut gains) = (Own::new(), vec![ones; self.records.len()]);
        // What was taken up early can turn out to be the shadow of something else. Gains enter with what they multiply:
        // they settle while others are taken up, and once more in the end.
        let (mut dropped, mut settled) = (Own::new(), false);
        loop {
            progress.step("changes", own.len(), causes.len()).map_err(IdentifyError::from)?;
            let state = self.fit(&own, gains.clone())?;
            let mut tests: Vec<SessionTest> = causes.iter().filter_map(|cause| self.examine(*cause, &state)).collect();
            let limit = FALSE_ALARM / tests.len().max(1) as f64;
            let sure = |test: &SessionTest| {
                let Judgement { gain, standard_error, .. } = test.judgement;
                test.chance < limit && gain > MATTERS && gain > SURE * standard_error
            };
            let (taken, open): (Vec<&SessionTest>, Vec<&SessionTest>) =
                tests.iter().partition(|test| own.contains(&test.cause));
            let by_saving = |a: &&&SessionTest, b: &&&SessionTest| a.saved.total_cmp(&b.saved);
            let least = taken.iter().filter(|test| !sure(test)).min_by(by_saving).map(|test| test.cause);
            let most = open.iter().filter(|test| sure(test) && !dropped.contains(&test.cause)).max_by(by_saving);
            match (least, most.map(|test| test.cause)) {
                (Some(least), _) if settled => {
                    own.remove(&least);
                    dropped.insert(least);
                    settled = false;
                    if let SessionCause::Gain { joint } = least {
                        gains.iter_mut().for_each(|gains| gains[joint] = 1.0);
                    }
                }
                (_, Some(most)) => {
                    own.insert(most);
                    settled = false;
                }
                (None, None) if settled || own.is_empty() => {
                    tests.iter_mut().for_each(|test| test.changed = own.contains(&test.cause));
                    return Ok((tests, own, gains));
                }
                _ => settled = true,
            }
            for test in tests.iter().filter(|test| own.contains(&test.cause)) {
                let SessionCause::Gain { joint } = test.cause else { continue };
                // The torque of all sessions together is the common one.
                let mean = test.values.iter().sum::<f64>() / test.values.len() as f64;
                gains.iter_mut().zip(&test.values).for_each(|(gains, value)| gains[joint] = value / mean);
            }
        }
    }

    /// Index of a base parameter of a session among the unknowns.
    fn unknown(&self, own: &[usize], session: usize, column: usize) -> usize {
        match own.iter().position(|k| *k == column) {
            Some(place) if session > 0 => self.base.rank() + (session - 1) * own.len() + place,
            _ => column,
        }
    }

    /// Base parameters of which each session has its own.
    fn own_columns(&self, own: &Own) -> Vec<usize> {
        let of = |cause: &SessionCause| match cause {
            SessionCause::Friction { joint } => self.friction[*joint].clone(),
            SessionCause::Offset { joint } => self.offset[*joint].clone(),
            _ => vec![],
        };
        own.iter().flat_map(of).collect()
    }

    /// All parameters, of which some are those of a session each.
    fn fit(&self, own: &Own, gains: Gains) -> Result<State, RecordError> {
        let (rank, sessions) = (self.base.rank(), self.records.len());
        let columns = self.own_columns(own);
        let with_tool = own.contains(&SessionCause::Tool);
        let first_of_tool = rank + (sessions - 1) * columns.len();
        let count = first_of_tool + if with_tool { (sessions - 1) * OF_TOOL } else { 0 };
        let mut factors = Vec::new();
        for (session, all) in self.factors.iter().enumerate() {
            for factor in all {
                let mut unknowns: Vec<usize> =
                    factor.columns.iter().map(|k| self.unknown(&columns, session, *k)).collect();
                let mut added = vec![];
                if with_tool && session > 0 {
                    unknowns.extend((0..OF_TOOL).map(|k| first_of_tool + (session - 1) * OF_TOOL + k));
                    added = self.tool.iter().map(|direction| predicted(factor, direction)).collect();
                }
                let (width, joint) = (factor.columns.len(), factor.joint);
                let gain = gains[session][joint];
                let wide =
                    Mat::from_fn(factor.factor.nrows(), width + added.len() + 1, |i, j| match j.checked_sub(width) {
                        None => factor.factor[(i, j)],
                        Some(k) if k < added.len() => added[k][i],
                        Some(_) => factor.factor[(i, width)] / gain,
                    });
                factors.push((
                    session,
                    JointFactor { columns: unknowns, factor: triangle(wide.as_ref()), ..factor.clone() },
                ));
            }
        }
        let nominal_base = self.base.combine(&self.start);
        let mut nominal = vec![0.0; count];
        nominal[..rank].copy_from_slice(&nominal_base);
        for session in 1..sessions {
            columns.iter().for_each(|k| nominal[self.unknown(&columns, session, *k)] = nominal_base[*k]);
        }
        let plain: Vec<JointFactor> = factors.iter().map(|(_, factor)| factor.clone()).collect();
        let solver = LeastSquares::new(Method::Wls);
        let estimate = solver.solve_unknowns(&plain, &nominal).map_err(IdentifyError::from)?;
        let (values, tool) = self.values(&columns, with_tool, &estimate.values);
        let mut squares = vec![(0.0, 0usize); self.robot.dof()];
        for (session, factor) in self.moving() {
            let (sum, rows) = &mut squares[factor.joint];
            *sum += residual(factor, &values[session], gains[session][factor.joint]).iter().map(|r| r * r).sum::<f64>();
            *rows += factor.rows;
        }
        let noise = squares.into_iter().map(|(sum, rows)| (sum / rows.max(1) as f64).sqrt()).collect();
        Ok(State { values, tool, gains, noise, estimate, factors })
    }

    /// The same, and per factor the rows that carry as much as one independent row: the estimates stay, their spread grows.
    fn fit_with_memory(&self, own: &Own, gains: Gains) -> Result<(State, Vec<f64>), RecordError> {
        let mut state = self.fit(own, gains)?;
        let of_session = |session: usize| {
            let records: Vec<&Record> = self.records[session].iter().collect();
            correlation(&records, &self.factors[session], &state.values[session])
        };
        let correlation: Vec<f64> = (0..self.records.len()).flat_map(of_session).collect();
        let factors: Vec<JointFactor> = state.factors.iter().map(|(_, factor)| factor.clone()).collect();
        let solver = LeastSquares { method: Method::Wls, correlation: Some(correlation.clone()) };
        let nominal = state.estimate.values.clone();
        state.estimate = solver.solve_unknowns(&factors, &nominal).map_err(IdentifyError::from)?;
        Ok((state, correlation))
    }

    /// Rows in motion of all sessions.
    fn moving(&self) -> impl Iterator<Item = (usize, &JointFactor)> {
        let sessions = self.factors.iter().enumerate();
        let rows = sessions.flat_map(|(session, all)| all.iter().map(move |factor| (session, factor)));
        rows.filter(|(_, factor)| !factor.resting)
    }

    /// Base parameters of each session, and what its tool has beyond that of the first, from the unknowns.
    fn values(&self, columns: &[usize], with_tool: bool, unknowns: &[f64]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let (rank, sessions) = (self.base.rank(), self.records.len());
        let first_of_tool = rank + (sessions - 1) * columns.len();
        let tool = |session: usize| match (with_tool, session) {
            (true, 1..) => unknowns[first_of_tool + (session - 1) * OF_TOOL..][..OF_TOOL].to_vec(),
            _ => vec![0.0; OF_TOOL],
        };
        let tools: Vec<Vec<f64>> = (0..sessions).map(tool).collect();
        let value = |session: usize| {
            let mut values: Vec<f64> = (0..rank).map(|k| unknowns[self.unknown(columns, session, k)]).collect();
            for (direction, amount) in self.tool.iter().zip(&tools[session]) {
                values.iter_mut().zip(direction).for_each(|(value, share)| *value += amount * share);
            }
            values
        };
        ((0..sessions).map(value).collect(), tools)
    }

    /// Whether values of a cause that each session has for itself predict better, and differ by more than chance; none if
    /// the logs cannot tell.
    fn examine(&self, cause: SessionCause, state: &State) -> Option<SessionTest> {
        let parts = self.parts(cause, state);
        let sessions = self.records.len();
        let count = parts.first()?.right.nrows();
        let zero = || (Mat::<f64>::zeros(count, count), Col::<f64>::zeros(count));
        let mut sums: Vec<(Mat<f64>, Col<f64>)> = (0..sessions).map(|_| zero()).collect();
        let mut total = zero();
        for part in &parts {
            let (gram, right) = &mut sums[part.session];
            *gram += &part.gram;
            *right += &part.right;
            total.0 += &part.gram;
            total.1 += &part.right;
        }
        let (inverse, rank) = pseudo_inverse(&total.0);
        let common = &inverse * &total.1;
        let inverses: Vec<(Mat<f64>, usize)> = sums.iter().map(|(gram, _)| pseudo_inverse(gram)).collect();
        let values: Vec<Col<f64>> = (0..sessions).map(|s| own_values(&sums[s].0, &sums[s].1, &common)).collect();
        // Scatter between the parts of a session.
        let (mut scatter, mut weight, mut freedom) = (0.0, 0.0, 0.0);
        let mut number = vec![0usize; sessions];
        for part in &parts {
            let (inverse, _) = &inverses[part.session];
            let score = &part.right - &part.gram * &values[part.session];
            scatter += (score.transpose() * inverse * &score).max(0.0);
            let share = inverse * &part.gram;
            weight -= (&share * &share).diagonal().column_vector().sum();
            number[part.session] += 1;
        }
        for ((_, rank), number) in inverses.iter().zip(&number) {
            weight += *rank as f64;
            freedom += (*rank * number.saturating_sub(1)) as f64;
        }
        let apart = inverses.iter().map(|(_, rank)| rank).sum::<usize>().saturating_sub(rank);
        if apart == 0 || freedom < 1.0 || weight <= 0.0 {
            return None;
        }
        let variance = (scatter / weight).max(f64::MIN_POSITIVE);
        let between: f64 = (0..sessions)
            .map(|s| {
                let off = &values[s] - &common;
                off.transpose() * &sums[s].0 * &off
            })
            .sum();
        let errors: Vec<(f64, f64)> = parts
            .iter()
            .map(|part| {
                let common = &pseudo_inverse(&(&total.0 - &part.gram)).0 * (&total.1 - &part.right);
                let (gram, right) = &sums[part.session];
                let own = own_values(&(gram - &part.gram), &(right - &part.right), &common);
                (part.left_by(&common), part.left_by(&own))
            })
            .collect();
        let noise = match cause {
            SessionCause::Tool => 1.0,
            SessionCause::Friction { joint } | SessionCause::Offset { joint } | SessionCause::Gain { joint } => {
                state.noise[joint].powi(2)
            }
        };
        let saved = errors.iter().map(|(before, after)| before - after).sum::<f64>() / noise.max(f64::MIN_POSITIVE);
        let Told { unit, share, rest } = self.told_of(cause, count, state);
        let deviation = |s: usize| {
            let inverse = &inverses[s].0;
            let seen = &sums[s].0 * (inverse * &share);
            let determined = (seen - &share).norm_max() <= 1e-6 * share.norm_max();
            let own = (share.transpose() * inverse * &share).max(0.0);
            if determined { (variance * own).sqrt() } else { f64::INFINITY }
        };
        Some(SessionTest {
            cause,
            values: values.iter().map(|values| rest + share.transpose() * values).collect(),
            deviations: (0..sessions).map(deviation).collect(),
            unit,
            chance: exceeded(between / variance, apart as f64, freedom),
            judgement: Judgement::of(&errors),
            changed: false,
            saved,
        })
    }

    /// What is told of a cause.
    fn told_of(&self, cause: SessionCause, count: usize, state: &State) -> Told {
        // The first number tells: the offset, the factor, the mass.
        let first = Col::from_fn(count, |k| f64::from(u8::from(k == 0)));
        let joint = match cause {
            SessionCause::Tool => return Told { unit: "kg", share: first, rest: 0.0 },
            SessionCause::Gain { .. } => return Told { unit: "", share: first, rest: 0.0 },
            SessionCause::Offset { joint } | SessionCause::Friction { joint } => joint,
        };
        let unit = self.robot.joints()[joint].kind.torque_unit();
        if cause == (SessionCause::Offset { joint }) {
            return Told { unit, share: first, rest: 0.0 };
        }
        // Friction is the mean of its torque times the direction of motion, which is the column of dry friction, or the shape
        // that comes next to it.
        let dry = |k: &&usize| self.role(**k) == Some(Role::DryFriction);
        let direction = self.friction[joint].iter().find(dry).or(self.shapes[joint].first());
        let mut means = vec![0.0; self.base.rank()];
        let mut length = 0.0;
        for (_, factor) in self.moving().filter(|(_, factor)| factor.joint == joint) {
            let place = |column: usize| factor.columns.iter().position(|k| *k == column);
            let Some(along) = direction.and_then(|column| place(*column)) else { continue };
            let along = factor.factor.col(along);
            length += along.squared_norm_l2();
            for column in self.friction[joint].iter().chain(&self.shapes[joint]) {
                means[*column] += place(*column).map_or(0.0, |k| along.transpose() * factor.factor.col(k));
            }
        }
        let mean = |column: &usize| means[*column] / length.max(f64::MIN_POSITIVE);
        let rest = self.shapes[joint].iter().map(|k| mean(k) * state.values[0][*k]).sum();
        let own = &self.friction[joint];
        Told { unit, share: Col::from_fn(count, |k| mean(&own[k])), rest }
    }

    fn role(&self, column: usize) -> Option<Role> {
        let effect = self.base.independent()[column].checked_sub(self.set.inertial())?;
        self.set.effects()[self.set.effect_columns().get(effect)?.effect].role()
    }

    /// The equations of each part of the sessions for the numbers of a cause, everything else as fitted.
    fn parts(&self, cause: SessionCause, state: &State) -> Vec<Part> {
        let mut parts = Vec::new();
        for (session, records) in self.records.iter().enumerate() {
            for block in records.iter().flat_map(|record| &record.blocks) {
                let mut part: Option<Part> = None;
                for factor in block.factors.iter().filter(|factor| !factor.resting) {
                    if let Some((columns, target)) = self.rows(cause, session, factor, state) {
                        part.get_or_insert_with(|| Part::empty(session, columns.len())).add(&columns, &target);
                    }
                }
                parts.extend(part);
            }
        }
        parts
    }

    /// Columns of the numbers of a cause in rows of a joint, and what they have to explain together; none if the joint has
    /// nothing to do with it.
    fn rows(
        &self,
        cause: SessionCause,
        session: usize,
        factor: &JointFactor,
        state: &State,
    ) -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
        let (joint, values) = (factor.joint, &state.values[session]);
        let gain = state.gains[session][joint];
        let mut target = residual(factor, values, gain);
        let (columns, amounts): (Vec<Vec<f64>>, Vec<f64>) = match cause {
            SessionCause::Tool => {
                let noise = state.noise[joint];
                if noise == 0.0 {
                    return None;
                }
                target.iter_mut().for_each(|value| *value /= noise);
                let column =
                    |direction: &Vec<f64>| predicted(factor, direction).into_iter().map(|v| v / noise).collect();
                (self.tool.iter().map(column).collect(), state.tool[session].clone())
            }
            SessionCause::Friction { joint: asked } | SessionCause::Offset { joint: asked } if asked == joint => {
                let own = if matches!(cause, SessionCause::Offset { .. }) { &self.offset } else { &self.friction };
                let place = |column: &usize| factor.columns.iter().position(|k| k == column);
                let own: Vec<(usize, usize)> = own[joint].iter().filter_map(|k| Some((*k, place(k)?))).collect();
                let column = |(_, place): &(usize, usize)| factor.factor.col(*place).iter().copied().collect();
                (own.iter().map(column).collect(), own.iter().map(|(k, _)| values[*k]).collect())
            }
            SessionCause::Gain { joint: asked } if asked == joint => {
                let model = predicted(factor, values);
                // The torque as measured.
                target = model.iter().zip(&target).map(|(model, left)| gain * (model + left)).collect();
                return Some((vec![model], target));
            }
            _ => return None,
        };
        for (column, amount) in columns.iter().zip(amounts) {
            target.iter_mut().zip(column).for_each(|(target, value)| *target += amount * value);
        }
        (!columns.is_empty()).then_some((columns, target))
    }

    fn model(&self, (session, name): (usize, &str), own: &Own, state: &State, correlation: &[f64]) -> TorqueModel {
        let (rank, columns) = (self.base.rank(), self.own_columns(own));
        let unknowns = state.estimate.values.len();
        let first_of_tool = rank + (self.records.len() - 1) * columns.len();
        let mut select = Mat::<f64>::zeros(rank, unknowns);
        for k in 0..rank {
            select[(k, self.unknown(&columns, session, k))] = 1.0;
            if own.contains(&SessionCause::Tool) && session > 0 {
                for (at, direction) in self.tool.iter().enumerate() {
                    select[(k, first_of_tool + (session - 1) * OF_TOOL + at)] = direction[k];
                }
            }
        }
        // Unknowns that no row determines have no covariance to be carried on.
        let finite = Mat::from_fn(unknowns, unknowns, |i, j| {
            Some(state.estimate.covariance[(i, j)]).filter(|v| v.is_finite()).unwrap_or(0.0)
        });
        let mut covariance = &select * finite * select.transpose();
        for k in 0..rank {
            let at = self.unknown(&columns, session, k);
            if state.estimate.covariance[(at, at)].is_infinite() {
                covariance[(k, k)] = f64::INFINITY;
            }
        }
        let of_session: Vec<usize> = (0..state.factors.len()).filter(|k| state.factors[*k].0 == session).collect();
        let estimate = Estimate {
            values: state.values[session].clone(),
            covariance,
            noise: of_session.iter().map(|k| state.estimate.noise[*k]).collect(),
            ..state.estimate.clone()
        };
        let correlation: Vec<f64> = of_session.iter().map(|k| correlation[*k]).collect();
        let parameters = self.base.expand(&estimate.values, &self.start);
        let history = format!(
            "session {name}: its own {}, everything else common to {} sessions",
            self.told(own),
            self.records.len()
        );
        let mut model = TorqueModel::from_parameters(self.robot.clone(), self.set.clone(), parameters, vec![history]);
        model.fit =
            Some(fit(&estimate, self.base, &self.factors[session], &correlation, (self.robot.dof(), &Method::Wls)));
        model.processing = Some(self.records[session][0].processing.clone());
        model.provenance.logs = self.records[session].iter().map(|record| record.source.clone()).collect();
        model
    }

    fn told(&self, own: &Own) -> String {
        let one = |cause: &SessionCause| match cause {
            SessionCause::Tool => Some("tool".to_string()),
            SessionCause::Friction { joint } => Some(format!("friction of {}", self.robot.joints()[*joint].name)),
            SessionCause::Offset { joint } => Some(format!("offset of {}", self.robot.joints()[*joint].name)),
            SessionCause::Gain { .. } => None,
        };
        let all: Vec<String> = own.iter().filter_map(one).collect();
        if all.is_empty() { "nothing".into() } else { all.join(", ") }
    }
}

impl Part {
    fn empty(session: usize, count: usize) -> Self {
        Self { session, gram: Mat::zeros(count, count), right: Col::zeros(count), squares: 0.0 }
    }

    fn add(&mut self, columns: &[Vec<f64>], target: &[f64]) {
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate() {
                self.gram[(i, j)] += product(a, b);
            }
            self.right[i] += product(a, target);
        }
        self.squares += product(target, target);
    }

    /// Squares that these numbers leave.
    fn left_by(&self, values: &Col<f64>) -> f64 {
        (self.squares - 2.0 * (values.transpose() * &self.right) + values.transpose() * &self.gram * values).max(0.0)
    }
}

/// What the rows of a session say; where they say nothing, the common values.
fn own_values(gram: &Mat<f64>, right: &Col<f64>, common: &Col<f64>) -> Col<f64> {
    common + &pseudo_inverse(gram).0 * (right - gram * common)
}

/// Inverse of a Gram matrix in the directions that it determines, and their number; columns count scaled to unit length.
fn pseudo_inverse(gram: &Mat<f64>) -> (Mat<f64>, usize) {
    const DETERMINED: f64 = 1e-9;
    let count = gram.nrows();
    let scale: Vec<f64> =
        (0..count).map(|k| if gram[(k, k)] > 0.0 { gram[(k, k)].sqrt().recip() } else { 0.0 }).collect();
    let scaled = Mat::from_fn(count, count, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let (values, vectors) = symmetric_eigen(scaled.as_ref());
    let kept: Vec<usize> = (0..count).filter(|k| values[*k] > DETERMINED).collect();
    let entry = |i: usize, j: usize| {
        kept.iter().map(|k| vectors[(i, *k)] * vectors[(j, *k)] / values[*k]).sum::<f64>() * scale[i] * scale[j]
    };
    (Mat::from_fn(count, count, entry), kept.len())
}

/// Rows of a factor times base parameters.
fn predicted(factor: &JointFactor, base: &[f64]) -> Vec<f64> {
    let row =
        |i: usize| factor.columns.iter().enumerate().map(|(k, &column)| factor.factor[(i, k)] * base[column]).sum();
    (0..factor.factor.nrows()).map(row).collect()
}

/// What base parameters leave of the torque, which is first divided by its gain.
fn residual(factor: &JointFactor, base: &[f64], gain: f64) -> Vec<f64> {
    let torque = factor.factor.col(factor.columns.len());
    torque.iter().zip(predicted(factor, base)).map(|(torque, model)| torque / gain - model).collect()
}

/// Probability of a ratio of variances above this one.
fn exceeded(chi_squared: f64, of: f64, freedom: f64) -> f64 {
    let ratio = chi_squared / of;
    FisherSnedecor::new(of, freedom).map_or(1.0, |law| if ratio.is_finite() { law.sf(ratio.max(0.0)) } else { 0.0 })
}

impl SessionComparison {
    /// What changed, a sentence each; or that nothing did.
    pub fn sentences(&self) -> Vec<String> {
        let changed = self.tests.iter().filter(|test| test.changed);
        let found: Vec<String> = changed.map(|test| self.sentence(test)).collect();
        if found.is_empty() {
            vec!["nothing changed between the sessions that these logs can show".into()]
        } else {
            found
        }
    }

    fn sentence(&self, test: &SessionTest) -> String {
        let (first, of_first) = (test.values[0], test.deviations[0]);
        let (what, relative) = match test.cause {
            SessionCause::Tool => ("the last link carries".to_string(), false),
            SessionCause::Friction { joint } => (format!("friction of {} is", self.joints[joint]), true),
            SessionCause::Offset { joint } => (format!("the torque offset of {} is", self.joints[joint]), false),
            SessionCause::Gain { joint } => (format!("the torque gain of {} is", self.joints[joint]), true),
        };
        let of_session = |session: usize| {
            let change = test.values[session] - first;
            let deviation = test.deviations[session].hypot(of_first);
            let way = match (change >= 0.0, test.cause) {
                (true, SessionCause::Tool) => "more",
                (false, SessionCause::Tool) => "less",
                (true, _) => "higher",
                (false, _) => "lower",
            };
            let size = if relative {
                format!("{:.1} ± {:.1} %", 100.0 * (change / first).abs(), 100.0 * (deviation / first).abs())
            } else {
                format!("{:.3} ± {:.3} {}", change.abs(), deviation, test.unit)
            };
            format!("{size} {way} in {}", self.names[session])
        };
        let known = (1..self.names.len()).filter(|session| test.deviations[*session].is_finite());
        let all: Vec<String> = known.map(of_session).collect();
        format!("{what} {} than in {}", all.join(", "), self.names[0])
    }
}
