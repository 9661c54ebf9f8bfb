//! What changed between sessions of one arm: friction, offset and gain of each joint, and what the
//! last link carries.
//!
//! Every session has values of its own where that predicts parts of the logs that were left out
//! better than common values do, and where values of the sessions differ by more than parts of one
//! session do. What changed is taken up one by one, that which saves most first, all other
//! parameters fitted again each time.

mod arm;
mod evidence;
mod shapes;
mod signs;

use arm::{Arm, Own, SessionGains};
use shapes::Shapes;
use signs::OtherSign;

use super::super::experiment::Experiment;
use super::super::{IdentifyError, TorqueModel};
use super::make::{experiment, record_of, recorded_effects};
use super::{Record, RecordError, RecordOptions, choose_processing};
use crate::identification::{BaseParameters, Judgement, ParameterSet, Row};
use crate::motion::{Conditioning, Motion};
use crate::progress::Progress;
use crate::recording::{LogSet, Recording};
use crate::robot::Robot;

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
#[non_exhaustive]
pub struct SessionTest {
    /// What is asked.
    pub cause: SessionCause,
    /// Per session: mean friction in the motion of all sessions, N·m (N); offset, N·m (N); gain;
    /// mass beyond the mean of all sessions, kg.
    pub values: Vec<f64>,
    /// Standard deviations, from what parts of one session differ by; infinite where a session does
    /// not determine the value.
    pub deviations: Vec<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// Probability that chance makes sessions differ as much.
    pub chance: f64,
    /// Values of each session against common ones, squares of errors on parts of the logs that were
    /// left out of both.
    pub judgement: Judgement,
    /// Whether it changed: beyond chance, and so that it matters to the prediction.
    pub changed: bool,
    /// Squares that values of each session save on parts that were left out, in units of the noise.
    saved: f64,
}

/// What sessions of one arm have in common, and what not.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct SessionComparison {
    /// Names of the sessions, as given.
    pub names: Vec<String>,
    /// All causes that the logs can test: the tool, then joint by joint.
    pub tests: Vec<SessionTest>,
    /// A model of each session: everything common but what changed. Gains that changed are not in
    /// it: its torque is that of all sessions together.
    pub models: Vec<TorqueModel>,
    /// What is to be said of copies.
    pub notes: Vec<String>,
}

/// Probability that anything at all is called changed if nothing is.
const FALSE_ALARM: f64 = 0.01;

/// Values of their own must lower the left-out error by as much as a finding of a diagnosis does,
/// in squares ...
const MATTERS: f64 = 0.05;

/// ... and beyond so many of its standard deviations.
const SURE: f64 = 2.5;

/// Length of a part, s.
const PART_SECONDS: f64 = 2.0;

/// Fewer parts of a session do not say how much it scatters.
const FEWEST_PARTS: usize = 3;

/// A gain that is no drive's: larger, or smaller by as much, or negative, it is a torque in another
/// unit or with another sign.
const LARGEST_GAIN: f64 = 100.0;

/// Finds what changed between sessions of one arm.
///
/// - `sessions`: a name and the logs of each session
/// - `effects`: beside the rigid body, each a linear function of the present motion and at every
///   joint
///
/// Logs are cut into parts of two seconds, from which the scatter is taken. What the model lacks
/// would look like a change where sessions move differently: beside the effects there is a torque
/// of any shape, a smooth function of each joint's position, speed and load, that is common to all
/// sessions.
///
/// # Errors
/// As [`record`](super::record), if the work is stopped, and if there are fewer than two sessions,
/// one has too little motion, or the gain of a joint changed as that of no drive does: a session
/// has its torque with the other sign, or in another unit.
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
    let session_of: Vec<usize> = sessions
        .iter()
        .enumerate()
        .flat_map(|(session, (_, logs))| std::iter::repeat_n(session, logs.len()))
        .collect();
    let ready = |(log, origin): (&Recording, &usize)| {
        let experiment = experiment(robot, log, &processing)?;
        Ok(Ready { session: session_of[*origin], log: log.clone(), experiment })
    };
    let ready: Vec<Ready> =
        logs.logs().iter().zip(logs.origins()).map(ready).collect::<Result<_, RecordError>>()?;
    require_motion(robot.dof(), sessions, &ready)?;
    let set = ParameterSet::new(robot, &recorded_effects(robot, effects)?)
        .map_err(IdentifyError::from)?;
    let shapes = Shapes::new(robot, &ready);
    let flexible = set.clone().with_trajectory_columns(shapes.parameters());
    let bases = [BaseParameters::new(robot, &flexible), BaseParameters::new(robot, &set)];
    let record = |one: &Ready, shapes: Option<&Shapes>| {
        let columns = shapes
            .map(|shapes| shapes.columns(&one.experiment.motions))
            .transpose()
            .map_err(IdentifyError::from)?;
        let options = RecordOptions {
            blocks: one.parts(),
            lags: shapes.is_none(),
            ..RecordOptions::default()
        };
        let equations = if shapes.is_some() { (&flexible, &bases[0]) } else { (&set, &bases[1]) };
        record_of(
            robot,
            &one.log,
            (&one.experiment, columns.as_ref()),
            equations,
            &processing,
            &options,
        )
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
    let turned = arm.other_signs()?;
    if !turned.is_empty() {
        let message =
            turned.iter().map(|one| one.sentence(robot, sessions)).collect::<Vec<_>>().join("; ");
        return Err(RecordError::Sessions { message });
    }
    let Changes { tests, own, gains } = Changes::of(&arm, progress)?;
    tests
        .iter()
        .filter(|test| test.changed)
        .try_for_each(|test| test.check_gain(robot, sessions))?;
    let plain = Arm::new(robot, &set, &bases[1], &plain_records);
    let (state, correlation) = plain.fit_with_memory(&own, gains)?;
    let model = |(session, (name, _)): (usize, &(String, _))| {
        plain.model((session, name), &own, &state, &correlation)
    };
    Ok(SessionComparison {
        models: sessions.iter().enumerate().map(model).collect(),
        names: sessions.iter().map(|(name, _)| name.clone()).collect(),
        tests,
        notes: logs.notes().to_vec(),
    })
}

/// Refuses a session of too few parts to say how much it scatters.
fn require_motion(
    dof: usize,
    sessions: &[(String, Vec<Recording>)],
    ready: &[Ready],
) -> Result<(), RecordError> {
    for (session, (name, _)) in sessions.iter().enumerate() {
        let own = ready.iter().filter(|one| one.session == session);
        let parts: usize = own.map(|one| one.moving_parts(dof)).sum();
        if parts < FEWEST_PARTS {
            let message = format!(
                "session `{name}` has {parts} parts of {PART_SECONDS} s in motion that no other \
                 session has, {FEWEST_PARTS} are the fewest"
            );
            return Err(RecordError::Sessions { message });
        }
    }
    Ok(())
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
            let of_motion = |motion: &std::sync::Arc<Motion>| {
                let rows = motion.use_as.iter().skip(joint).step_by(joints);
                rows.filter(|row| **row == Row::Moving).count() as f64 / motion.rate_hz
            };
            self.experiment.motions.iter().map(of_motion).sum::<f64>()
        };
        let most = (0..joints).map(seconds).fold(0.0, f64::max);
        ((most / PART_SECONDS) as usize).min(self.parts())
    }
}

/// What changed, with the gains that did, and what was found of all causes.
struct Changes {
    tests: Vec<SessionTest>,
    own: Own,
    gains: SessionGains,
}

impl Changes {
    /// One after the other. What was taken up early can turn out to be the shadow of something
    /// else; it is dropped again.
    fn of(arm: &Arm<'_>, progress: &dyn Progress) -> Result<Self, RecordError> {
        let causes = arm.causes();
        let (mut own, mut gains, mut dropped) = (Own::new(), arm.no_gains(), Own::new());
        // Gains enter with what they multiply: they settle while others are taken up, and once more
        // in the end.
        let mut settled = false;
        loop {
            progress.step("changes", own.len(), causes.len()).map_err(IdentifyError::from)?;
            let state = arm.fit(&own, gains.clone())?;
            let mut tests: Vec<SessionTest> =
                causes.iter().filter_map(|cause| arm.examine(*cause, &state)).collect();
            let limit = FALSE_ALARM / tests.len().max(1) as f64;
            let (taken, open): (Vec<&SessionTest>, Vec<&SessionTest>) =
                tests.iter().partition(|test| own.contains(&test.cause));
            let by_saving = |a: &&&SessionTest, b: &&&SessionTest| a.saved.total_cmp(&b.saved);
            let least = taken
                .iter()
                .filter(|test| !test.is_sure(limit))
                .min_by(by_saving)
                .map(|test| test.cause);
            let most =
                open.iter().filter(|test| test.is_sure(limit) && !dropped.contains(&test.cause));
            match (least, most.max_by(by_saving).map(|test| test.cause)) {
                (Some(least), _) if settled => {
                    own.remove(&least);
                    dropped.insert(least);
                    settled = false;
                }
                (_, Some(most)) => {
                    own.insert(most);
                    settled = false;
                }
                (None, None) if settled || own.is_empty() => {
                    tests.iter_mut().for_each(|test| test.changed = own.contains(&test.cause));
                    return Ok(Self { tests, own, gains });
                }
                _ => settled = true,
            }
            gains = arm.no_gains();
            for test in tests.iter().filter(|test| own.contains(&test.cause)) {
                let SessionCause::Gain { joint } = test.cause else { continue };
                // The torque of all sessions together is the common one.
                let mean = test.values.iter().sum::<f64>() / test.values.len() as f64;
                let of_all: Vec<f64> = test.values.iter().map(|value| value / mean).collect();
                if of_all.iter().all(|gain| is_of_a_drive(*gain)) {
                    gains.iter_mut().zip(of_all).for_each(|(gains, gain)| gains[joint] = gain);
                }
            }
        }
    }
}

/// Whether a drive can have so many times the gain of another session.
fn is_of_a_drive(gain: f64) -> bool {
    (1.0 / LARGEST_GAIN..=LARGEST_GAIN).contains(&gain)
}

impl OtherSign {
    /// Which session it is, and what to do.
    fn sentence(&self, robot: &Robot, sessions: &[(String, Vec<Recording>)]) -> String {
        let joint = &robot.joints()[self.joint].name;
        let named = |wanted: &dyn Fn(usize) -> bool| {
            let names = sessions.iter().enumerate().filter(|(session, _)| wanted(*session));
            names.map(|(_, (name, _))| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        };
        let values = &self.test.values;
        if self.wrong.is_empty() {
            let [plus, minus] =
                [named(&|session| values[session] >= 0.0), named(&|session| values[session] < 0.0)];
            return format!(
                "the torque of {joint} has another sign in {minus} than in {plus}: negate it in \
                 the wrong sessions, or leave them out"
            );
        }
        let wrong = named(&|session| self.wrong.contains(&session));
        let gains: Vec<String> = values
            .iter()
            .zip(&self.test.deviations)
            .map(|(value, d)| format!("{value:.3} ± {d:.3}"))
            .collect();
        format!(
            "the torque of {joint} has the other sign in {wrong}, where friction would drive the \
             joint (gains by session: {}): negate it there, or leave that session out",
            gains.join(", ")
        )
    }
}

impl SessionTest {
    /// Refuses a gain that no drive has beside that of another session.
    fn check_gain(
        &self,
        robot: &Robot,
        sessions: &[(String, Vec<Recording>)],
    ) -> Result<(), RecordError> {
        let SessionCause::Gain { joint } = self.cause else { return Ok(()) };
        let mut known = (0..sessions.len()).filter(|session| self.deviations[*session].is_finite());
        let Some(first) = known.next() else { return Ok(()) };
        let ratio = |session: usize| self.values[session] / self.values[first];
        let Some(other) = known.find(|session| !is_of_a_drive(ratio(*session))) else {
            return Ok(());
        };
        let message = format!(
            "the torque of `{}` in session `{}` is {:.3e} times that in session `{}`, which no \
             drive's gain explains: read both with the same unit, sign and torque constant, or \
             leave one out",
            robot.joints()[joint].name,
            sessions[other].0,
            ratio(other),
            sessions[first].0
        );
        Err(RecordError::Sessions { message })
    }

    /// Whether it is no chance, and matters.
    fn is_sure(&self, limit: f64) -> bool {
        let Judgement { gain, standard_error, .. } = self.judgement;
        self.chance < limit && gain > MATTERS && gain > SURE * standard_error
    }
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

    fn joint(&self, joint: usize) -> &str {
        &self.models[0].robot().joints()[joint].name
    }

    fn sentence(&self, test: &SessionTest) -> String {
        // The first session that says anything.
        let known: Vec<usize> =
            (0..self.names.len()).filter(|k| test.deviations[*k].is_finite()).collect();
        let Some((&reference, others)) = known.split_first() else {
            return "sessions differ".into();
        };
        let (first, of_first) = (test.values[reference], test.deviations[reference]);
        let (what, relative) = match test.cause {
            SessionCause::Tool => ("the last link carries".to_string(), false),
            SessionCause::Friction { joint } => {
                (format!("friction of {} is", self.joint(joint)), true)
            }
            SessionCause::Offset { joint } => {
                (format!("the torque offset of {} is", self.joint(joint)), false)
            }
            SessionCause::Gain { joint } => {
                (format!("the torque gain of {} is", self.joint(joint)), true)
            }
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
                format!(
                    "{:.1} ± {:.1} %",
                    100.0 * (change / first).abs(),
                    100.0 * (deviation / first).abs()
                )
            } else {
                format!("{:.3} ± {:.3} {}", change.abs(), deviation, test.unit)
            };
            format!("{size} {way} in {}", self.names[session])
        };
        let all: Vec<String> = others.iter().copied().map(of_session).collect();
        format!("{what} {} than in {}", all.join(", "), self.names[reference])
    }
}
