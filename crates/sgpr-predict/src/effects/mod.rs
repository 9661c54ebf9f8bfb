//! Physical effects beside the rigid body: what else the drive has to overcome, and what lies
//! between drive and log.
//!
//! One effect is one file and one line in [`registry`]. An effect enters the torque in one of three
//! ways ([`Entry`]):
//!
//! - as columns of the observation matrix that depend on the present joint motion alone (`State`),
//!   the simplest kind;
//! - as columns that depend on the whole trajectory (`Trajectory`): on time, on the rigid-body
//!   torque, on a hidden state such as the deflection of bristles, and on constants that enter
//!   nonlinearly;
//! - as a change of robot, motion or torque (`Transform`): gravity that leans, an encoder that is
//!   off, a delay. It has constants only; around its neutral constants the change of the predicted
//!   torque gives the columns to rank it by.
//!
//! Every effect can be advanced sample by sample ([`Effect::advance`]), for a control loop and a
//! simulator: it carries a hidden state where its torque depends on the past. What uses samples
//! that come later along a trajectory is told by [`Effect::streamed`].
//!
//! Linear parameters are identified together with the inertial ones; constants by variable
//! projection.

mod about;
mod actuator_lag;
mod asymmetric_coulomb_friction;
mod asymmetric_viscous_friction;
mod backlash;
mod base_compliance;
mod base_tilt;
mod cable_hysteresis;
mod cable_stiffness;
mod channel;
mod cogging_torque;
mod columns;
mod context;
mod coulomb_friction;
mod coulomb_transition;
mod encoder_eccentricity;
mod encoder_offset;
mod external_contact;
mod external_drag;
mod fitting;
mod friction_dead_band;
mod friction_step;
mod friction_warmup;
mod joint_elasticity;
mod kinematic_error;
mod link_flexibility;
mod link_inertia_error;
mod link_length_error;
mod load_dependent_friction;
mod nonlinear_viscous_friction;
mod payload;
mod payload_change;
mod position_dependent_friction;
mod presliding_friction;
mod quadratic_viscous_friction;
mod rotor_inertia;
mod spring_balancer;
mod stepping;
mod stribeck_friction;
mod temperature_dependent_friction;
mod time_base_error;
mod torque_delay;
mod torque_gain_drift;
mod torque_gain_error;
mod torque_offset;
mod torque_offset_drift;
mod torque_ripple;
mod torque_saturation;
mod transmission_hysteresis;
mod viscous_friction;
mod wrist_coupling;

use alloc::format;
use alloc::string::{String, ToString};
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::fmt::Debug;

pub use about::{About, Class, Origin, Role};
pub use channel::Channel;
pub use context::Context;
#[cfg(feature = "trajectories")]
pub use context::LinkMotion;
use serde::{Deserialize, Serialize};
pub(crate) use stepping::knows_one_row;
use stepping::written_once;
pub use stepping::{LinkSample, Needs, SampleInput, StepState, Stepped, Streamed};

#[cfg(feature = "expressions")]
use crate::expression::Expr;
use crate::names::suggestion;
use crate::robot::{JointKind, Robot};
use crate::simd::{Number, Single};

/// The methods of [`Effect`] that are one value each, as a table:
/// `name: "viscous_friction", entry: Entry::State`.
macro_rules! facts {
    ($($fact:ident: $value:expr),+ $(,)?) => { $(facts!(@$fact $value);)+ };
    (@name $value:expr) => { facts!(@fn name, &str, $value); };
    (@summary $value:expr) => { facts!(@fn summary, &str, $value); };
    (@parameters $value:expr) => { facts!(@fn parameters, &[super::EffectParameter], $value); };
    (@constants $value:expr) => { facts!(@fn constants, &[super::Constant], $value); };
    (@entry $value:expr) => { facts!(@fn entry, super::Entry, $value); };
    (@reach $value:expr) => { facts!(@fn reach, super::Reach, $value); };
    (@role $value:expr) => { facts!(@fn role, Option<super::Role>, $value); };
    (@refines $value:expr) => { facts!(@fn refines, Option<&str>, $value); };
    (@fn $fact:ident, $type:ty, $value:expr) => {
        fn $fact(&self) -> $type {
            $value
        }
    };
    (@$fact:ident $value:expr) => { facts!(@fn $fact, bool, $value); };
}

use facts;

/// The methods of [`Effect`] that advance it, over other numbers than `f64`: they do nothing of
/// their own.
macro_rules! methods_over {
    ($number:ident: $columns:ident, $start:ident, $advance:ident, $links:ident, $start_transmitted:ident,
     $transmitted:ident) => {
        /// As [`Self::columns`].
        fn $columns(&self, joint: usize, state: &JointState<'_, $number>, out: &mut [$number]) {
            let _ = (joint, state);
            out.fill($number::constant(0.0));
        }

        /// As [`Self::start`].
        fn $start(
            &self,
            site: Site,
            constants: &[f64],
            input: &SampleInput<'_, $number>,
            state: &mut StepState<'_, $number>,
        ) {
            let _ = (site, constants, input);
            state.hidden.fill($number::constant(0.0));
        }

        /// As [`Self::advance`].
        fn $advance(
            &self,
            site: Site,
            constants: &[f64],
            input: &SampleInput<'_, $number>,
            state: &mut StepState<'_, $number>,
            columns: &mut [$number],
        ) {
            let _ = (constants, state);
            let motion = JointState { q: input.q, dq: input.dq, ddq: input.ddq };
            self.$columns(site.joint().unwrap_or_default(), &motion, columns);
        }

        /// As [`Self::advance_links`].
        fn $links(
            &self,
            site: Site,
            constants: &[f64],
            input: &SampleInput<'_, $number>,
            state: &mut StepState<'_, $number>,
            links: &mut LinkSample<'_, $number>,
        ) {
            let _ = (site, constants, input, state, links);
        }

        /// As [`Self::start_transmitted`].
        fn $start_transmitted(&self, torque: $number, hidden: &mut [$number]) {
            let _ = torque;
            hidden.fill($number::constant(0.0));
        }

        /// As [`Self::advance_transmitted`].
        fn $transmitted(
            &self,
            site: Site,
            constants: &[f64],
            joint: usize,
            rate_hz: f64,
            hidden: &mut [$number],
            torque: $number,
        ) -> $number {
            let _ = (site, constants, joint, rate_hz, hidden);
            torque
        }
    };
}

/// A physical effect.
///
/// The torque is `sum over parameters of column * parameter`; columns may depend on constants.
pub trait Effect: Send + Sync + Debug {
    /// Name in files, column labels and on the command line: `viscous_friction`.
    fn name(&self) -> &str;

    /// One sentence for a person.
    fn summary(&self) -> &str;

    /// Formula, source, signature, look-alikes, and the experiment that tells them apart.
    fn about(&self) -> About<'_> {
        About::default()
    }

    /// The linear parameters at one site.
    fn parameters(&self) -> &[EffectParameter];

    /// The constants that enter nonlinearly, at one site.
    fn constants(&self) -> &[Constant] {
        &[]
    }

    /// How the effect enters the torque.
    fn entry(&self) -> Entry {
        Entry::State
    }

    /// The torque of which joints one site changes.
    fn reach(&self) -> Reach {
        Reach::Own
    }

    /// Where a robot can have the effect: at every joint unless said otherwise.
    fn sites(&self, robot: &Robot) -> Vec<Site> {
        (0..robot.dof()).map(Site::Joint).collect()
    }

    /// Why these logs cannot show the effect, if they cannot. An effect that depends on time needs
    /// a clock that the logs share.
    fn not_testable(&self, context: &Context<'_>) -> Option<String> {
        (self.about().depends_on_time && context.time.is_empty()).then(|| {
            "the logs do not share a clock: their times overlap, or span more than four hours"
                .into()
        })
    }

    /// Derivative of the joint's torque by each parameter, for an effect that enters by
    /// [`Entry::State`].
    ///
    /// - `out`: one number per parameter
    fn columns(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        let _ = (joint, state);
        out.fill(0.0);
    }

    /// The part that it plays in the dynamics of a joint, if code treats that part in a way of its
    /// own.
    fn role(&self) -> Option<Role> {
        None
    }

    /// What it depends on beside the motion.
    fn needs(&self) -> Needs {
        Needs { time: self.about().depends_on_time, ..Needs::default() }
    }

    /// How advancing it compares with its columns along a trajectory.
    fn streamed(&self) -> Streamed<'_> {
        Streamed::Exactly
    }

    /// Whether [`Self::advance`] is its own: columns of a trajectory then follow from that by
    /// default. If not, and if it does not enter by [`Entry::State`], a sample is asked for as a
    /// trajectory of one row, which takes memory; an effect whose columns at a sample depend on
    /// other samples is then not streamed.
    fn steps(&self) -> bool {
        self.entry() == Entry::State
    }

    /// Length of the hidden state: per site, or per joint for what [`Self::advance_transmitted`]
    /// carries.
    ///
    /// - `rate_hz`: lowest time between samples is half of one over it; NaN if it is not known
    fn state_len(&self, constants: &[f64], rate_hz: f64) -> usize {
        let _ = (constants, rate_hz);
        0
    }

    /// Sets the hidden state to what it is after a long motion at constant speed through this
    /// sample; at rest, where the speed is zero. A trajectory starts at rest at its first sample.
    fn start(
        &self,
        site: Site,
        constants: &[f64],
        input: &SampleInput<'_>,
        state: &mut StepState<'_>,
    ) {
        let _ = (site, constants, input);
        state.hidden.fill(0.0);
    }

    /// Derivative of the torque by each parameter at the next sample; moves the hidden state on.
    ///
    /// - `columns`: one number per parameter for [`Reach::Own`], `[parameters, n]` for
    ///   [`Reach::All`]
    fn advance(
        &self,
        site: Site,
        constants: &[f64],
        input: &SampleInput<'_>,
        state: &mut StepState<'_>,
        columns: &mut [f64],
    ) {
        let _ = state;
        if self.entry() == Entry::State {
            let motion = JointState { q: input.q, dq: input.dq, ddq: input.ddq };
            self.columns(site.joint().unwrap_or_default(), &motion, columns);
        } else {
            stepping::advance_one_row(self, site, constants, input, columns);
        }
    }

    /// Derivative of the torque by each parameter along a trajectory: sample by sample, starting at
    /// rest, by default.
    ///
    /// - `out`: per parameter `[samples]` for [`Reach::Own`], `[samples, n]` for [`Reach::All`];
    ///   zero on entry
    fn trajectory_columns(
        &self,
        site: Site,
        context: &Context<'_>,
        constants: &[f64],
        out: &mut [Vec<f64>],
    ) {
        if self.steps() {
            stepping::columns_by_steps(self, site, context, constants, out);
        }
    }

    /// The robot as a transform makes it.
    fn robot(&self, site: Site, constants: &[f64], robot: Robot) -> Robot {
        let _ = (site, constants);
        robot
    }

    /// Whether `link_motion` does anything.
    fn moves_links(&self) -> bool {
        false
    }

    /// The links' motion as a transform makes it from the measured one; only the rigid body sees
    /// it.
    #[cfg(feature = "trajectories")]
    fn link_motion(
        &self,
        site: Site,
        constants: &[f64],
        context: &Context<'_>,
        motion: &mut LinkMotion,
    ) {
        let _ = (site, constants, context, motion);
    }

    /// The links' motion at the next sample as `link_motion` makes it along a trajectory; moves the
    /// hidden state on.
    fn advance_links(
        &self,
        site: Site,
        constants: &[f64],
        input: &SampleInput<'_>,
        state: &mut StepState<'_>,
        links: &mut LinkSample<'_>,
    ) {
        let _ = (site, constants, input, state, links);
    }

    /// How far ahead of the sample the motion is taken, s: for torques that are logged before they
    /// act. A predictor extrapolates the motion by that time.
    fn lead(&self, constants: &[f64]) -> f64 {
        let _ = constants;
        0.0
    }

    /// Sets the hidden state of [`Self::advance_transmitted`] to what it is after a long time at
    /// `torque`.
    fn start_transmitted(&self, torque: f64, hidden: &mut [f64]) {
        let _ = torque;
        hidden.fill(0.0);
    }

    /// The next torque of `joint` as [`Self::transmit`] makes it along a trajectory; moves the
    /// hidden state of that joint on.
    ///
    /// - `rate_hz`: one over the time since the sample before; NaN if it is not known
    fn advance_transmitted(
        &self,
        site: Site,
        constants: &[f64],
        joint: usize,
        rate_hz: f64,
        hidden: &mut [f64],
        torque: f64,
    ) -> f64 {
        let _ = (site, constants, joint, rate_hz, hidden);
        torque
    }

    /// Whether the methods that begin with `single` and `record` are those without it, over numbers
    /// of 32 bits and over expressions: the effect runs in both, and can be exported as code.
    fn is_generic(&self) -> bool {
        false
    }

    methods_over!(
        Single: single_columns, single_start, single_advance, single_links, single_start_transmitted, single_transmitted
    );

    #[cfg(feature = "expressions")]
    methods_over!(
        Expr: record_columns, record_start, record, record_links, record_start_transmitted, record_transmitted
    );

    /// What went wrong in the calls since this was last asked, if an effect can fail; its columns
    /// are zero then.
    fn failure(&self) -> Option<String> {
        None
    }

    /// What lies between torque and log, if it is linear in the torque: applied to
    /// `[samples, width]`, row-major, torques or columns of `joint`.
    fn transmit(
        &self,
        site: Site,
        constants: &[f64],
        joint: usize,
        rate_hz: f64,
        values: &mut [f64],
        width: usize,
    ) {
        let _ = (site, constants, joint, rate_hz, values, width);
    }

    /// Largest torque of `joint` that the log can show.
    fn limit(&self, site: Site, constants: &[f64], joint: usize) -> Option<f64> {
        let _ = (site, constants, joint);
        None
    }

    /// The effect of which this one is only a finer form: it is fitted beside it, and not a finding
    /// of its own.
    fn refines(&self) -> Option<&str> {
        None
    }

    /// Whether linear parameters of these values are what the effect has by nature. A diagnosis
    /// proposes others only where they matter much; a model that is told of the effect may have
    /// them.
    fn is_plausible(&self, _coefficients: &[f64]) -> bool {
        true
    }

    /// Whether its linear parameters are the ten of a body that is taken up or put down: m, m c,
    /// and the inertia about the origin, all of one sign.
    fn is_body(&self) -> bool {
        false
    }

    /// Whether the base parameters take it up, whatever the motion: a model without it is as good.
    fn is_absorbed(&self) -> bool {
        false
    }

    /// Whether it is one of the whole arm although its sites are joints: a report names none.
    fn is_of_arm(&self) -> bool {
        false
    }

    /// Whether the grids of its constants say no more than their ranges: a search then looks
    /// between values at which the columns have little in common.
    fn grids_span_ranges(&self) -> bool {
        false
    }

    /// Whether the columns depend on the torque of the model, and change as it is refitted.
    fn follows_torque(&self) -> bool {
        false
    }

    /// Whether the present torque depends on the past of the trajectory, so that one sample is not
    /// enough to predict it.
    fn has_memory(&self) -> bool {
        false
    }
}

/// A parameter of an effect at one site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EffectParameter {
    /// Symbol, as in `joint_2.Fv`.
    pub symbol: &'static str,
    /// Unit at a rotating joint.
    pub unit: &'static str,
    /// Unit at a sliding joint.
    pub sliding_unit: &'static str,
    /// Whether physics forbids negative values.
    pub non_negative: bool,
}

impl EffectParameter {
    /// A parameter of either sign.
    pub const fn signed(
        symbol: &'static str,
        unit: &'static str,
        sliding_unit: &'static str,
    ) -> Self {
        Self { symbol, unit, sliding_unit, non_negative: false }
    }

    /// A parameter that physics keeps from being negative.
    pub const fn positive(
        symbol: &'static str,
        unit: &'static str,
        sliding_unit: &'static str,
    ) -> Self {
        Self { symbol, unit, sliding_unit, non_negative: true }
    }

    /// Unit at a joint of this kind.
    pub fn unit_at(&self, kind: JointKind) -> &'static str {
        if kind.is_rotation() { self.unit } else { self.sliding_unit }
    }
}

/// A constant that enters nonlinearly: a Stribeck velocity, a time, a delay.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Constant {
    /// Symbol, as in `joint_2.vs`.
    pub symbol: &'static str,
    /// Unit at a rotating joint.
    pub unit: &'static str,
    /// Unit at a sliding joint.
    pub sliding_unit: &'static str,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// What the values of the grid mean.
    pub scale: Scale,
    /// Values from which a search starts.
    pub grid: &'static [f64],
    /// Standard deviation about zero before any data, in its unit; infinite where nothing is known
    /// but the range.
    pub expected: f64,
}

/// What a constant measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// A time or a delay.
    Time,
    /// A frequency.
    Frequency,
    /// A speed of a joint.
    Speed,
    /// A position of a joint, or a length.
    Position,
    /// Anything else.
    Other,
}

impl Constant {
    /// What it measures, as its unit says.
    pub fn dimension(&self) -> Dimension {
        match self.unit {
            "s" => Dimension::Time,
            "Hz" => Dimension::Frequency,
            "rad/s" => Dimension::Speed,
            "rad" | "m" => Dimension::Position,
            _ => Dimension::Other,
        }
    }

    /// A constant that is searched in its logarithm.
    pub const fn logarithmic(
        symbol: &'static str,
        units: [&'static str; 2],
        bounds: [f64; 2],
        grid: &'static [f64],
    ) -> Self {
        Self::new(symbol, units, bounds, Scale::Logarithmic, grid)
    }

    /// A constant on a scale of its own.
    pub const fn new(
        symbol: &'static str,
        units: [&'static str; 2],
        bounds: [f64; 2],
        scale: Scale,
        grid: &'static [f64],
    ) -> Self {
        let [unit, sliding_unit] = units;
        Self {
            symbol,
            unit,
            sliding_unit,
            low: bounds[0],
            high: bounds[1],
            scale,
            grid,
            expected: f64::INFINITY,
        }
    }

    /// Constant of a transform: neutral at zero, `step` is small against what can be noticed.
    pub const fn neutral_at_zero(
        symbol: &'static str,
        units: [&'static str; 2],
        bounds: [f64; 2],
        step: f64,
    ) -> Self {
        Self::new(symbol, units, bounds, Scale::Neutral { step }, &[0.0])
    }

    /// The same with a standard deviation about zero before any data: larger values need more
    /// evidence.
    pub const fn expected_within(self, deviation: f64) -> Self {
        Self { expected: deviation, ..self }
    }

    /// Unit at a joint of this kind.
    pub fn unit_at(&self, kind: JointKind) -> &'static str {
        if kind.is_rotation() { self.unit } else { self.sliding_unit }
    }
}

/// How a constant is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// In its logarithm.
    Logarithmic,
    /// As it is; the number is a first step.
    Linear(f64),
    /// A position of the joint: the grid spans the joint's range, in shares of it.
    Position,
    /// A width of position: in shares of the joint's range.
    PositionWidth,
    /// A torque: in shares of the joint's root mean square torque.
    Torque,
    /// A time of the session, s: the grid is that of the logs.
    Time,
    /// A number of periods per revolution, found from a periodogram.
    Order,
    /// Constant of a transform: nothing happens at zero; `step` is small against what can be
    /// noticed.
    Neutral {
        /// Step of the finite difference.
        step: f64,
    },
}

/// How an effect enters the torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// By columns of the present joint motion ([`Effect::columns`]).
    State,
    /// By columns of the trajectory ([`Effect::trajectory_columns`]).
    Trajectory,
    /// By a change of robot, motion or measured torque.
    Transform,
    /// Not at all: found by checks of the log before any physics.
    Gate,
}

/// The torque of which joints one site of an effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// That of the site's joint.
    Own,
    /// That of all.
    All,
}

/// A place where a robot can have an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Site {
    /// The whole arm.
    Arm,
    /// A joint, or the link that it carries.
    Joint(usize),
    /// A joint, driven by another.
    Pair(usize, usize),
}

impl Site {
    /// The joint, if it is at one.
    pub fn joint(self) -> Option<usize> {
        match self {
            Self::Arm => None,
            Self::Joint(joint) | Self::Pair(joint, _) => Some(joint),
        }
    }
}

/// Motion of all joints at one sample.
#[derive(Clone, Copy, Debug)]
pub struct JointState<'a, S = f64> {
    /// Positions, rad (m).
    pub q: &'a [S],
    /// Velocities, rad/s (m/s).
    pub dq: &'a [S],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a [S],
}

/// All effects that come with the library, in the order of their columns.
pub fn registry() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(viscous_friction::ViscousFriction),
        Arc::new(coulomb_friction::CoulombFriction),
        Arc::new(coulomb_transition::CoulombTransition),
        Arc::new(asymmetric_viscous_friction::AsymmetricViscousFriction),
        Arc::new(rotor_inertia::RotorInertia),
        Arc::new(torque_offset::TorqueOffset),
        Arc::new(asymmetric_coulomb_friction::AsymmetricCoulombFriction),
        Arc::new(quadratic_viscous_friction::QuadraticViscousFriction),
        Arc::new(cable_stiffness::CableStiffness),
        Arc::new(stribeck_friction::StribeckFriction),
        Arc::new(nonlinear_viscous_friction::NonlinearViscousFriction),
        Arc::new(load_dependent_friction::LoadDependentFriction),
        Arc::new(temperature_dependent_friction::TemperatureDependentFriction),
        Arc::new(friction_warmup::FrictionWarmup),
        Arc::new(position_dependent_friction::PositionDependentFriction),
        Arc::new(presliding_friction::PreslidingFriction),
        Arc::new(friction_step::FrictionStep),
        Arc::new(friction_dead_band::FrictionDeadBand),
        Arc::new(joint_elasticity::JointElasticity),
        Arc::new(transmission_hysteresis::TransmissionHysteresis),
        Arc::new(backlash::Backlash),
        Arc::new(torque_ripple::TorqueRipple),
        Arc::new(kinematic_error::KinematicError),
        Arc::new(cogging_torque::CoggingTorque),
        Arc::new(wrist_coupling::WristCoupling),
        Arc::new(link_flexibility::LinkFlexibility),
        Arc::new(torque_offset_drift::TorqueOffsetDrift),
        Arc::new(cable_hysteresis::CableHysteresis),
        Arc::new(spring_balancer::SpringBalancer),
        Arc::new(base_tilt::BaseTilt),
        Arc::new(base_compliance::BaseCompliance),
        Arc::new(external_drag::ExternalDrag),
        Arc::new(payload::PayloadBody),
        Arc::new(payload_change::PayloadChange),
        Arc::new(link_inertia_error::LinkInertiaError),
        Arc::new(link_length_error::LinkLengthError),
        Arc::new(encoder_offset::EncoderOffset),
        Arc::new(encoder_eccentricity::EncoderEccentricity),
        Arc::new(torque_gain_error::TorqueGainError),
        Arc::new(torque_gain_drift::TorqueGainDrift),
        Arc::new(torque_delay::TorqueDelay),
        Arc::new(actuator_lag::ActuatorLag),
        Arc::new(torque_saturation::TorqueSaturation),
        Arc::new(time_base_error::TimeBaseError),
        Arc::new(external_contact::ExternalContact),
    ]
}

/// The effect `name`.
///
/// # Errors
/// If there is none; the message says which may have been meant, and where all are listed.
pub fn by_name(name: &str) -> Result<Arc<dyn Effect>, UnknownEffect> {
    let all = registry();
    let known = all.iter().map(|effect| effect.name().to_string()).collect();
    let found = all.into_iter().find(|effect| effect.name() == name);
    found.ok_or_else(|| UnknownEffect { name: name.into(), known })
}

/// An effect name that the library does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no effect `{name}`{}; {}", suggestion(name, known), choice(known))]
#[non_exhaustive]
pub struct UnknownEffect {
    /// Requested name.
    pub name: String,
    /// Names to choose from.
    pub known: Vec<String>,
}

impl UnknownEffect {
    /// `name` is none of `known`.
    pub fn new(name: impl Into<String>, known: Vec<String>) -> Self {
        Self { name: name.into(), known }
    }
}

/// More names than this are looked up, not read in a message.
const FEW: usize = 12;

fn choice(known: &[String]) -> String {
    if known.len() <= FEW {
        format!("known are {}", known.join(", "))
    } else {
        "`sgpr effects` lists all".into()
    }
}

/// Sign of `x`, zero at zero (`f64::signum` is one there).
#[inline]
pub fn sgn(x: f64) -> f64 {
    Number::sgn(x)
}

/// For [`crate::internal`].
pub(crate) mod parts {
    pub use super::fitting::{JointRanges, SMALLEST_TORQUE, points_of, with_role};
}

#[cfg(all(test, feature = "trajectories"))]
mod tests;
