use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::TorqueModel;
use crate::dynamics::{BatchWorkspace, Samples, rnea_batch};
use crate::effects::{Constant, Context, Effect, Entry, JointState, LinkMotion, Reach, Scale, Site};
use crate::motion::Motion;
use crate::recording::{Channel, LARGEST_POSITION, LARGEST_TORQUE, SMALLEST_TORQUE, seconds};
use crate::robot::Robot;

/// An effect at one site of a robot, with its constants and parameters.
#[derive(Clone, Debug)]
pub struct Term {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Where.
    pub site: Site,
    /// Values of its constants.
    pub constants: Vec<f64>,
    /// Values of its linear parameters.
    pub coefficients: Vec<f64>,
    /// Standard deviations of the constants.
    pub constant_deviations: Vec<f64>,
    /// Standard deviations of the linear parameters.
    pub coefficient_deviations: Vec<f64>,
}

/// Those of the constants of an effect that are times of the session, s.
pub(crate) fn times_of<'a>(effect: &'a dyn Effect, constants: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    effect.constants().iter().zip(constants).filter(|(c, _)| c.scale == Scale::Time).map(|(_, time)| *time)
}

impl Term {
    /// A term with these constants, all linear parameters zero.
    pub fn new(effect: Arc<dyn Effect>, site: Site, constants: Vec<f64>) -> Self {
        let (k, m) = (effect.parameters().len(), constants.len());
        let [coefficients, coefficient_deviations, constant_deviations] = [vec![0.0; k], vec![0.0; k], vec![0.0; m]];
        Self { effect, site, constants, coefficients, constant_deviations, coefficient_deviations }
    }

    /// Whether it is of class X.
    pub fn is_transform(&self) -> bool {
        self.effect.entry() == Entry::Transform
    }

    /// Its constants that are times of the session, s.
    pub(crate) fn times(&self) -> impl Iterator<Item = f64> + '_ {
        times_of(self.effect.as_ref(), &self.constants)
    }

    /// Whether it is the same effect at the same site, whatever its values.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        self.effect.name() == other.effect.name() && self.site == other.site
    }

    /// What the names of its parameters begin with: `joint_2.`, or nothing for the whole arm.
    pub(crate) fn prefix(&self, robot: &Robot) -> String {
        let joint = |joint: usize| &robot.joints()[joint].name;
        match self.site {
            Site::Arm => String::new(),
            Site::Joint(own) => format!("{}.", joint(own)),
            Site::Pair(own, other) => format!("{}.{}.", joint(own), joint(other)),
        }
    }

    /// Columns along a trajectory, `[samples]` or `[samples, n]` each; zero where an effect of time
    /// has no clock.
    pub(crate) fn columns(&self, context: &Context<'_>) -> Vec<Vec<f64>> {
        let length = match self.effect.reach() {
            Reach::Own => context.len(),
            Reach::All => context.q.len(),
        };
        let mut out = vec![vec![0.0; length]; self.effect.parameters().len()];
        let lacks_time = context.time.is_empty() && self.effect.about().depends_on_time;
        if !out.is_empty() && !lacks_time {
            self.effect.trajectory_columns(self.site, context, &self.constants, &mut out);
        }
        out
    }
}

/// What a file keeps of a [`Term`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct TermDescription {
    effect: String,
    site: Site,
    constants: Vec<f64>,
    coefficients: Vec<f64>,
    constant_deviations: Vec<f64>,
    coefficient_deviations: Vec<f64>,
}

impl TermDescription {
    pub fn of(term: &Term) -> Self {
        Self {
            effect: term.effect.name().into(),
            site: term.site,
            constants: term.constants.clone(),
            coefficients: term.coefficients.clone(),
            constant_deviations: term.constant_deviations.clone(),
            coefficient_deviations: term.coefficient_deviations.clone(),
        }
    }

    /// The term, its effect one of `effects`.
    pub fn term(self, effects: &[Arc<dyn Effect>], robot: &Robot) -> Result<Term, String> {
        let effect = effects.iter().find(|effect| effect.name() == self.effect).cloned();
        let unknown = || {
            format!(
                "it has the effect `{}`, which is not one of the library: give it along (`load_with`; in Python call \
                 `sgpr.register_effect` first)",
                self.effect
            )
        };
        let effect = effect.ok_or_else(unknown)?;
        if !effect.sites(robot).contains(&self.site) {
            return Err(format!("`{}` cannot be at {:?}", self.effect, self.site));
        }
        let (k, m) = (effect.parameters().len(), effect.constants().len());
        let lengths = [&self.coefficients, &self.coefficient_deviations].map(Vec::len);
        if lengths != [k; 2] || [&self.constants, &self.constant_deviations].map(Vec::len) != [m; 2] {
            return Err(format!("`{}` has another number of parameters", self.effect));
        }
        if self.constants.iter().chain(&self.coefficients).any(|value| !value.is_finite()) {
            return Err(format!("a parameter of `{}` is not a number", self.effect));
        }
        for (constant, value) in effect.constants().iter().zip(&self.constants) {
            let [low, high] = usable_range(constant);
            if !(low..=high).contains(value) {
                let symbol = constant.symbol;
                return Err(format!(
                    "the constant `{symbol}` of `{}` is {value:e}, which should be from {low:e} to {high:e}",
                    self.effect
                ));
            }
        }
        let Self { site, constants, coefficients, constant_deviations, coefficient_deviations, .. } = self;
        Ok(Term { effect, site, constants, coefficients, constant_deviations, coefficient_deviations })
    }
}

/// What the arithmetic of effects can take of a constant: no fit leaves its bounds, and what a
/// person put in by hand is no more than a thousand times beyond them.
fn usable_range(constant: &Constant) -> [f64; 2] {
    const BEYOND: f64 = 1e3;
    // Seconds between two stamps of 64 bits.
    const LONGEST_TIME: f64 = 2e10;
    let least = |smallest: f64| if constant.low > 0.0 { smallest } else { 0.0 };
    match constant.scale {
        Scale::Position => [-LARGEST_POSITION, LARGEST_POSITION],
        Scale::PositionWidth => [least(1.0 / LARGEST_POSITION), LARGEST_POSITION],
        Scale::Torque => [least(SMALLEST_TORQUE), LARGEST_TORQUE],
        Scale::Time => [-LONGEST_TIME, LONGEST_TIME],
        _ => {
            let low = if constant.low > 0.0 { constant.low / BEYOND } else { constant.low * BEYOND };
            let high = if constant.high < 0.0 { constant.high / BEYOND } else { constant.high * BEYOND };
            [low, high]
        }
    }
}

/// Evenly sampled motion with what effects may depend on beside it. Arrays are `[samples, n]`, row-major, SI.
#[derive(Clone, Copy, Debug)]
pub struct Trajectory<'a> {
    /// Joint motion.
    pub samples: Samples<'a>,
    /// Sampling rate, Hz; NaN if it is not known: delays and elastic joints are then left out.
    pub rate_hz: f64,
    /// Time of the model's session, `[samples]`, s; empty if it is not known: effects of time are then left out.
    pub time: &'a [f64],
    /// What else was logged.
    pub channels: &'a [Channel],
}

impl<'a> Trajectory<'a> {
    /// Samples alone: effects that need time, a sampling rate or a channel are left out.
    pub fn of_samples(samples: Samples<'a>) -> Self {
        Self { samples, rate_hz: f64::NAN, time: &[], channels: &[] }
    }

    /// A processed stretch of a log.
    ///
    /// - `time`: of [`TorqueModel::session_time`]
    pub fn of(motion: &'a Motion, time: &'a [f64]) -> Self {
        Self { samples: motion.samples(), rate_hz: motion.rate_hz, time, channels: &motion.channels }
    }
}

/// The rigid body as the transforms of a model make it.
pub(crate) struct Rigid {
    pub robot: Robot,
    /// Motion of the links, where it is not the measured one.
    pub motion: Option<LinkMotion>,
    pub rigid_torque: Vec<f64>,
    /// With the effects that the model has everywhere.
    pub torque: Vec<f64>,
}

impl TorqueModel {
    /// Effects at single sites.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Time stamp at which the clock of the session starts, ns.
    pub fn clock_start(&self) -> Option<i64> {
        self.clock_start
    }

    /// The same model with other terms.
    #[must_use]
    pub fn with_terms(mut self, terms: Vec<Term>, clock_start: Option<i64>) -> Self {
        self.terms = terms;
        self.clock_start = clock_start;
        if let Some(fit) = &mut self.fit {
            fit.covariance_with_terms.clear();
        }
        self
    }

    /// The same model without terms.
    pub(super) fn without_terms(&self) -> Self {
        self.clone().with_terms(vec![], self.clock_start)
    }

    /// Takes all parameters: those of the set, then those of the terms.
    pub(super) fn set_all_parameters(&mut self, parameters: &[f64]) {
        let (own, of_terms) = parameters.split_at(self.set.len());
        self.set_parameters(own.to_vec());
        let coefficients = self.terms.iter_mut().flat_map(|term| &mut term.coefficients);
        coefficients.zip(of_terms).for_each(|(coefficient, value)| *coefficient = *value);
    }

    /// Times of a log on the clock of the model, s.
    pub fn session_time(&self, stamps: &[i64]) -> Vec<f64> {
        let start = self.clock_start.or(stamps.first().copied()).unwrap_or_default();
        seconds_since(start, stamps)
    }

    /// Torque of every sample of a trajectory, hidden states, time and transforms included.
    ///
    /// - returns `[samples, n]`, row-major, N·m (N)
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn predict_trajectory(&self, trajectory: &Trajectory<'_>) -> Vec<f64> {
        let n = self.robot.dof();
        let rigid = self.rigid(trajectory);
        let context = self.context(trajectory, &rigid);
        let mut tau = rigid.torque.clone();
        for term in &self.terms {
            for (column, factor) in term.columns(&context).iter().zip(&term.coefficients) {
                match term.effect.reach() {
                    Reach::All => tau.iter_mut().zip(column).for_each(|(tau, c)| *tau += factor * c),
                    Reach::Own => {
                        let joint = term.site.joint().expect("it reaches its own joint");
                        tau.iter_mut().skip(joint).step_by(n).zip(column).for_each(|(tau, c)| *tau += factor * c);
                    }
                }
            }
        }
        for term in self.terms.iter().filter(|term| term.is_transform()) {
            for joint in 0..n {
                let mut own: Vec<f64> = tau.iter().skip(joint).step_by(n).copied().collect();
                term.effect.transmit(term.site, &term.constants, joint, trajectory.rate_hz, &mut own, 1);
                if let Some(limit) = term.effect.limit(term.site, &term.constants, joint) {
                    own.iter_mut().for_each(|tau| *tau = tau.clamp(-limit, limit));
                }
                tau.iter_mut().skip(joint).step_by(n).zip(own).for_each(|(tau, own)| *tau = own);
            }
        }
        tau
    }

    /// The rigid body after all transforms of robot and motion; deflections follow the torque without them.
    pub(crate) fn rigid(&self, trajectory: &Trajectory<'_>) -> Rigid {
        let Samples { q, dq, ddq } = trajectory.samples;
        let transforms = || self.terms.iter().filter(|term| term.is_transform());
        let robot = transforms().fold(self.dynamics.clone(), |robot, t| t.effect.robot(t.site, &t.constants, robot));
        let mut ws = BatchWorkspace::new(&robot);
        let mut rigid_torque = vec![0.0; q.len()];
        rnea_batch(&robot, &mut ws, trajectory.samples, &mut rigid_torque);
        let motion = transforms().any(|term| term.effect.moves_links()).then(|| {
            let mut links = LinkMotion { q: q.to_vec(), dq: dq.to_vec(), ddq: ddq.to_vec() };
            let context = Context {
                robot: &robot,
                rate_hz: trajectory.rate_hz,
                time: trajectory.time,
                q,
                dq,
                ddq,
                rigid_torque: &rigid_torque,
                torque: &rigid_torque,
                channels: trajectory.channels,
            };
            transforms().for_each(|t| t.effect.link_motion(t.site, &t.constants, &context, &mut links));
            links
        });
        if let Some(links) = &motion {
            let samples = Samples { q: &links.q, dq: &links.dq, ddq: &links.ddq };
            rnea_batch(&robot, &mut ws, samples, &mut rigid_torque);
        }
        let mut torque = rigid_torque.clone();
        self.add_effects(trajectory.samples, &mut torque);
        Rigid { robot, motion, rigid_torque, torque }
    }

    /// Torque of this model's parameters on the robot and along the motion that the transforms of another make.
    pub(crate) fn torque_under(&self, rigid: &Rigid, trajectory: &Trajectory<'_>) -> Vec<f64> {
        let robot = rigid.robot.clone().with_standard_parameters(&self.dynamics.standard_parameters());
        let links = rigid.motion.as_ref();
        let motion = links.map_or(trajectory.samples, |m| Samples { q: &m.q, dq: &m.dq, ddq: &m.ddq });
        let mut torque = vec![0.0; motion.q.len()];
        rnea_batch(&robot, &mut BatchWorkspace::new(&robot), motion, &mut torque);
        self.add_effects(trajectory.samples, &mut torque);
        torque
    }

    /// Adds the torque of the effects that the model has everywhere.
    fn add_effects(&self, samples: Samples<'_>, torque: &mut [f64]) {
        if self.set.len() == self.set.inertial() {
            return;
        }
        let n = self.robot.dof();
        for (k, tau) in torque.chunks_exact_mut(n).enumerate() {
            let row = k * n..(k + 1) * n;
            let state = JointState { q: &samples.q[row.clone()], dq: &samples.dq[row.clone()], ddq: &samples.ddq[row] };
            self.set.add_effect_torque(&self.parameters, &state, tau);
        }
    }

    pub(crate) fn context<'a>(&self, trajectory: &Trajectory<'a>, rigid: &'a Rigid) -> Context<'a> {
        let Samples { q, dq, ddq } = trajectory.samples;
        Context {
            robot: &rigid.robot,
            rate_hz: trajectory.rate_hz,
            time: trajectory.time,
            q,
            dq,
            ddq,
            rigid_torque: &rigid.rigid_torque,
            torque: &rigid.torque,
            channels: trajectory.channels,
        }
    }
}

/// Longest time that logs of one session span, s: the clock of the session tells warming up and
/// changes of load, which take minutes, and everything that is asked of every moment of it takes
/// memory for every moment.
const LONGEST_SESSION: f64 = 4.0 * 3600.0;

/// A clock that starts within this of zero counts from zero, ns.
const NEAR_ZERO: u64 = 3_600_000_000_000;

/// The earliest stamp, if no two logs overlap in time and all belong to one session. A clock that
/// starts near zero starts at zero.
pub(crate) fn common_clock(motions: &[Motion]) -> Option<i64> {
    let mut spans: Vec<(i64, i64)> = motions.iter().filter_map(|m| Some((*m.time.first()?, *m.time.last()?))).collect();
    spans.sort_unstable();
    let apart = spans.windows(2).all(|pair| pair[0].1 <= pair[1].0);
    let (first, last) = (spans.first()?.0, spans.last()?.1);
    let together = seconds(first, last) <= LONGEST_SESSION;
    (apart && together).then_some(if first.unsigned_abs() < NEAR_ZERO { 0 } else { first })
}

/// Stamps in seconds since `start`.
pub(crate) fn seconds_since(start: i64, stamps: &[i64]) -> Vec<f64> {
    stamps.iter().map(|stamp| seconds(start, *stamp)).collect()
}
