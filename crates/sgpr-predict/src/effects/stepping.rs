//! Effects that advance sample by sample: what a control loop and a simulator need, and what the
//! columns of a whole trajectory follow from.

use alloc::string::String;
use alloc::vec::Vec;

use super::{Context, Effect, JointState, Reach, Site};
use crate::dynamics::{NumberWorkspace, Workspace, forward_kinematics, regressor, rnea};
#[cfg(feature = "expressions")]
use crate::expression::Expr;
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::robot::Robot;
use crate::simd::{Number, Single};
use crate::spatial::Pose;

/// One sample of a motion and what a model says of it: everything that a stepped effect may depend
/// on.
///
/// Arrays are `[n]`, SI.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SampleInput<'a, S: Stepped = f64> {
    /// The robot with the inertias of the model.
    pub robot: &'a Robot,
    /// One over the time since the sample before, Hz; NaN if it is not known.
    pub rate_hz: f64,
    /// Time of the session, s; NaN if it is not known.
    pub time: S::Time,
    /// Positions, rad (m).
    pub q: &'a [S],
    /// Velocities, rad/s (m/s).
    pub dq: &'a [S],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a [S],
    /// Torque of the rigid body, N·m (N).
    pub rigid_torque: &'a [S],
    /// Torque of the rigid body and the effects that the model has everywhere, N·m (N).
    pub torque: &'a [S],
    /// Temperature of each joint, °C; NaN where it is not known.
    pub temperature_celsius: &'a [S],
}

impl<'a, S: Stepped> SampleInput<'a, S> {
    setters! {
        with_robot(robot: &'a Robot),
        with_rate_hz(rate_hz: f64),
        with_time(time: S::Time),
        with_q(q: &'a [S]),
        with_dq(dq: &'a [S]),
        with_ddq(ddq: &'a [S]),
        with_rigid_torque(rigid_torque: &'a [S]),
        with_torque(torque: &'a [S]),
        with_temperature_celsius(temperature_celsius: &'a [S]),
    }
}

impl<'a, S: Stepped> SampleInput<'a, S> {
    /// A sample of which nothing but the motion is known: no torques, no temperatures.
    pub fn new(robot: &'a Robot, rate_hz: f64, time: S::Time, motion: JointState<'a, S>) -> Self {
        let JointState { q, dq, ddq } = motion;
        Self {
            robot,
            rate_hz,
            time,
            q,
            dq,
            ddq,
            rigid_torque: &[],
            torque: &[],
            temperature_celsius: &[],
        }
    }
}

/// What an effect carries from sample to sample, and room to work in.
#[derive(Debug)]
#[non_exhaustive]
pub struct StepState<'a, S: Stepped = f64> {
    /// Hidden state, [`Effect::state_len`] numbers.
    pub hidden: &'a mut [S],
    /// Buffers of the dynamics; nothing in them is kept from call to call.
    pub workspace: &'a mut S::Workspace,
}

/// Motion of the links at one sample, `[n]`, where a transform makes it differ from the measured
/// one.
#[derive(Debug)]
pub struct LinkSample<'a, S = f64> {
    /// Positions, rad (m).
    pub q: &'a mut [S],
    /// Velocities, rad/s (m/s).
    pub dq: &'a mut [S],
    /// Accelerations, rad/s² (m/s²).
    pub ddq: &'a mut [S],
}

/// What an effect depends on beside the motion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Needs {
    /// The time of the session.
    pub time: bool,
    /// The time between samples.
    pub rate: bool,
    /// The temperature of the joint.
    pub temperature: bool,
    /// Channels of the log by name.
    pub channels: Vec<String>,
}

impl Needs {
    setters! {
        with_time(time: bool),
        with_rate(rate: bool),
        with_temperature(temperature: bool),
        with_channels(channels: Vec<String>),
    }
}

/// A number that effects are advanced over: of a sample, or an expression from which code is made.
pub trait Stepped: Number {
    /// A time of the session. It has 64 bits where the number has 32: after an hour those would
    /// tell no milliseconds apart.
    type Time: Number;

    /// The time since `origin`, s.
    fn since(time: Self::Time, origin: f64) -> Self;

    /// Buffers of the dynamics.
    type Workspace: core::fmt::Debug + Send;

    /// Buffers for a robot.
    fn workspace(robot: &Robot) -> Self::Workspace;

    /// Torque of the rigid body, `[n]`, as [`crate::dynamics::rnea`].
    fn rnea(robot: &Robot, workspace: &mut Self::Workspace, motion: [&[Self]; 3], tau: &mut [Self]);

    /// As [`crate::dynamics::regressor`].
    fn regressor<'ws>(
        robot: &Robot,
        workspace: &'ws mut Self::Workspace,
        motion: [&[Self]; 3],
    ) -> &'ws [Self];

    /// As [`crate::dynamics::forward_kinematics`].
    fn forward_kinematics<'ws>(
        robot: &Robot,
        workspace: &'ws mut Self::Workspace,
        q: &[Self],
    ) -> &'ws [Pose<Self>];

    /// A value some time ago: `delay` seconds before `value`, which comes `step` seconds after the
    /// last one; moves the hidden state on. Before the start it was what [`Self::start_delay`]
    /// says.
    fn delayed(hidden: &mut [Self], value: Self, delay: f64, step: f64) -> Self;

    /// Sets the hidden state of [`Self::delayed`] to what it is after a long time at `value`.
    fn start_delay(hidden: &mut [Self], value: Self);

    /// [`Effect::columns`] over this number; those below likewise.
    fn columns(effect: &dyn Effect, joint: usize, state: &JointState<'_, Self>, out: &mut [Self]);

    /// [`Effect::start`].
    fn start(
        effect: &dyn Effect,
        at: (Site, &[f64]),
        input: &SampleInput<'_, Self>,
        state: &mut StepState<'_, Self>,
    );

    /// [`Effect::advance`].
    fn advance(
        effect: &dyn Effect,
        at: (Site, &[f64]),
        input: &SampleInput<'_, Self>,
        state: &mut StepState<'_, Self>,
        columns: &mut [Self],
    );

    /// [`Effect::advance_links`].
    fn advance_links(
        effect: &dyn Effect,
        at: (Site, &[f64]),
        input: &SampleInput<'_, Self>,
        state: &mut StepState<'_, Self>,
        links: &mut LinkSample<'_, Self>,
    );

    /// [`Effect::start_transmitted`].
    fn start_transmitted(effect: &dyn Effect, torque: Self, hidden: &mut [Self]);

    /// [`Effect::advance_transmitted`].
    fn advance_transmitted(
        effect: &dyn Effect,
        at: (Site, &[f64]),
        joint: usize,
        rate_hz: f64,
        hidden: &mut [Self],
        torque: Self,
    ) -> Self;
}

/// The methods of [`Stepped`] that are those of an effect, by their names there.
macro_rules! methods_of_effects {
    ($columns:ident, $start:ident, $advance:ident, $links:ident, $start_transmitted:ident, $transmitted:ident) => {
        fn columns(
            effect: &dyn Effect,
            joint: usize,
            state: &JointState<'_, Self>,
            out: &mut [Self],
        ) {
            effect.$columns(joint, state, out);
        }

        fn start(
            effect: &dyn Effect,
            (site, constants): (Site, &[f64]),
            input: &SampleInput<'_, Self>,
            state: &mut StepState<'_, Self>,
        ) {
            effect.$start(site, constants, input, state);
        }

        fn advance(
            effect: &dyn Effect,
            (site, constants): (Site, &[f64]),
            input: &SampleInput<'_, Self>,
            state: &mut StepState<'_, Self>,
            columns: &mut [Self],
        ) {
            effect.$advance(site, constants, input, state, columns);
        }

        fn advance_links(
            effect: &dyn Effect,
            (site, constants): (Site, &[f64]),
            input: &SampleInput<'_, Self>,
            state: &mut StepState<'_, Self>,
            links: &mut LinkSample<'_, Self>,
        ) {
            effect.$links(site, constants, input, state, links);
        }

        fn start_transmitted(effect: &dyn Effect, torque: Self, hidden: &mut [Self]) {
            effect.$start_transmitted(torque, hidden);
        }

        fn advance_transmitted(
            effect: &dyn Effect,
            (site, constants): (Site, &[f64]),
            joint: usize,
            rate_hz: f64,
            hidden: &mut [Self],
            torque: Self,
        ) -> Self {
            effect.$transmitted(site, constants, joint, rate_hz, hidden, torque)
        }
    };
}

impl Stepped for f64 {
    type Time = Self;
    type Workspace = Workspace;

    methods_of_effects!(
        columns,
        start,
        advance,
        advance_links,
        start_transmitted,
        advance_transmitted
    );

    #[inline]
    fn since(time: Self, origin: f64) -> Self {
        time - origin
    }

    fn workspace(robot: &Robot) -> Workspace {
        Workspace::new(robot)
    }

    fn rnea(robot: &Robot, workspace: &mut Workspace, [q, dq, ddq]: [&[f64]; 3], tau: &mut [f64]) {
        tau.copy_from_slice(rnea(robot, workspace, q, dq, ddq));
    }

    fn regressor<'ws>(
        robot: &Robot,
        workspace: &'ws mut Workspace,
        [q, dq, ddq]: [&[f64]; 3],
    ) -> &'ws [f64] {
        regressor(robot, workspace, q, dq, ddq)
    }

    fn forward_kinematics<'ws>(
        robot: &Robot,
        workspace: &'ws mut Workspace,
        q: &[f64],
    ) -> &'ws [Pose] {
        forward_kinematics(robot, workspace, q)
    }

    fn delayed(hidden: &mut [f64], value: f64, delay: f64, step: f64) -> f64 {
        Delay(hidden).advance(value, delay, step)
    }

    fn start_delay(hidden: &mut [f64], value: f64) {
        Delay(hidden).start(value);
    }
}

/// The dynamics of a number whose buffers are a [`NumberWorkspace`].
macro_rules! dynamics_of_numbers {
    () => {
        type Workspace = NumberWorkspace<Self>;

        fn workspace(robot: &Robot) -> Self::Workspace {
            NumberWorkspace::new(robot)
        }

        fn rnea(
            _: &Robot,
            workspace: &mut Self::Workspace,
            motion: [&[Self]; 3],
            tau: &mut [Self],
        ) {
            workspace.rnea(motion, tau);
        }

        fn regressor<'ws>(
            _: &Robot,
            workspace: &'ws mut Self::Workspace,
            motion: [&[Self]; 3],
        ) -> &'ws [Self] {
            workspace.regressor(motion)
        }

        fn forward_kinematics<'ws>(
            _: &Robot,
            workspace: &'ws mut Self::Workspace,
            q: &[Self],
        ) -> &'ws [Pose<Self>] {
            workspace.forward_kinematics(q)
        }
    };
}

impl Stepped for Single {
    type Time = f64;

    dynamics_of_numbers!();

    methods_of_effects!(
        single_columns,
        single_start,
        single_advance,
        single_links,
        single_start_transmitted,
        single_transmitted
    );

    #[inline]
    fn since(time: f64, origin: f64) -> Self {
        Self::constant(time - origin)
    }

    fn delayed(hidden: &mut [Self], value: Self, delay: f64, step: f64) -> Self {
        Delay(hidden).advance(value, delay, step)
    }

    fn start_delay(hidden: &mut [Self], value: Self) {
        Delay(hidden).start(value);
    }
}

#[cfg(feature = "expressions")]
impl Stepped for Expr {
    type Time = Self;

    dynamics_of_numbers!();

    methods_of_effects!(
        record_columns,
        record_start,
        record,
        record_links,
        record_start_transmitted,
        record_transmitted
    );

    fn since(time: Self, origin: f64) -> Self {
        time - origin
    }

    /// Steps of one length need no ring: the values move up by one place, and the weights are
    /// constants.
    fn delayed(hidden: &mut [Self], value: Self, delay: f64, step: f64) -> Self {
        let (first, weights) = delay_weights(delay / step);
        hidden[..=first].rotate_right(1);
        hidden[0] = value;
        (0..NODES).fold(Self::constant(0.0), |sum, node| sum + hidden[first - node] * weights[node])
    }

    fn start_delay(hidden: &mut [Self], value: Self) {
        hidden.fill(value);
    }
}

/// An effect's method, and the same over the other numbers, by one function that is written over
/// [`Stepped`] numbers.
macro_rules! written_once {
    (columns: $law:ident) => {
        fn is_generic(&self) -> bool {
            true
        }

        written_once!(@columns columns, f64, $law);
        written_once!(@columns single_columns, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@columns record_columns, crate::expression::Expr, $law);
    };
    (@columns $name:ident, $number:ty, $law:ident) => {
        fn $name(&self, joint: usize, state: &super::JointState<'_, $number>, out: &mut [$number]) {
            $law(joint, state, out);
        }
    };
    (start: $law:ident) => {
        written_once!(@start start, f64, $law);
        written_once!(@start single_start, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@start record_start, crate::expression::Expr, $law);
    };
    (@start $name:ident, $number:ty, $law:ident) => {
        fn $name(
            &self,
            site: super::Site,
            constants: &[f64],
            input: &super::SampleInput<'_, $number>,
            state: &mut super::StepState<'_, $number>,
        ) {
            $law(site, constants, input, state);
        }
    };
    (advance: $law:ident) => {
        fn steps(&self) -> bool {
            true
        }

        fn is_generic(&self) -> bool {
            true
        }

        written_once!(@advance advance, f64, $law);
        written_once!(@advance single_advance, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@advance record, crate::expression::Expr, $law);
    };
    (@advance $name:ident, $number:ty, $law:ident) => {
        fn $name(
            &self,
            site: super::Site,
            constants: &[f64],
            input: &super::SampleInput<'_, $number>,
            state: &mut super::StepState<'_, $number>,
            columns: &mut [$number],
        ) {
            $law(site, constants, input, state, columns);
        }
    };
    (advance_links: $law:ident) => {
        fn is_generic(&self) -> bool {
            true
        }

        written_once!(@advance_links advance_links, f64, $law);
        written_once!(@advance_links single_links, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@advance_links record_links, crate::expression::Expr, $law);
    };
    (@advance_links $name:ident, $number:ty, $law:ident) => {
        fn $name(
            &self,
            site: super::Site,
            constants: &[f64],
            input: &super::SampleInput<'_, $number>,
            state: &mut super::StepState<'_, $number>,
            links: &mut super::LinkSample<'_, $number>,
        ) {
            $law(site, constants, input, state, links);
        }
    };
    (start_transmitted: $law:ident) => {
        written_once!(@start_transmitted start_transmitted, f64, $law);
        written_once!(@start_transmitted single_start_transmitted, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@start_transmitted record_start_transmitted, crate::expression::Expr, $law);
    };
    (@start_transmitted $name:ident, $number:ty, $law:ident) => {
        fn $name(&self, torque: $number, hidden: &mut [$number]) {
            $law(torque, hidden);
        }
    };
    (advance_transmitted: $law:ident) => {
        fn is_generic(&self) -> bool {
            true
        }

        written_once!(@advance_transmitted advance_transmitted, f64, $law);
        written_once!(@advance_transmitted single_transmitted, crate::simd::Single, $law);
        #[cfg(feature = "expressions")]
        written_once!(@advance_transmitted record_transmitted, crate::expression::Expr, $law);
    };
    (@advance_transmitted $name:ident, $number:ty, $law:ident) => {
        fn $name(
            &self,
            site: super::Site,
            constants: &[f64],
            joint: usize,
            rate_hz: f64,
            hidden: &mut [$number],
            torque: $number,
        ) -> $number {
            $law(site, constants, joint, rate_hz, hidden, torque)
        }
    };
}
pub(super) use written_once;

/// How an effect that is advanced sample by sample compares with its columns along a whole
/// trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Streamed<'a> {
    /// Causal: the same but for rounding.
    Exactly,
    /// The columns of a trajectory use samples that come later, or all of them; what is done
    /// instead.
    Nearly(&'a str),
    /// Not at all, and why.
    Not(&'a str),
}

/// The columns of a trajectory by [`Effect::advance`] from sample to sample.
pub(super) fn columns_by_steps<E: Effect + ?Sized>(
    effect: &E,
    site: Site,
    context: &Context<'_>,
    constants: &[f64],
    out: &mut [Vec<f64>],
) {
    let n = context.dof();
    let width = if effect.reach() == Reach::All { n } else { 1 };
    let mut columns = vec![0.0; out.len() * width];
    let mut hidden = vec![0.0; effect.state_len(constants, context.rate_hz)];
    let mut state =
        StepState { hidden: &mut hidden, workspace: &mut Workspace::new(context.robot) };
    let of_joint = |joint: usize| context.temperature_celsius(joint);
    let channels: Vec<Option<&[f64]>> =
        if effect.needs().temperature { (0..n).map(of_joint).collect() } else { vec![None; n] };
    let mut temperature = vec![f64::NAN; n];
    let at_rest = vec![0.0; n];
    for k in 0..context.len() {
        for (value, channel) in temperature.iter_mut().zip(&channels) {
            *value = channel.map_or(f64::NAN, |channel| channel[k]);
        }
        let row = k * n..(k + 1) * n;
        let input = SampleInput {
            robot: context.robot,
            rate_hz: context.rate_hz,
            time: context.time.get(k).copied().unwrap_or(f64::NAN),
            q: &context.q[row.clone()],
            dq: &context.dq[row.clone()],
            ddq: &context.ddq[row.clone()],
            rigid_torque: &context.rigid_torque[row.clone()],
            torque: &context.torque[row],
            temperature_celsius: &temperature,
        };
        if k == 0 {
            effect.start(
                site,
                constants,
                &SampleInput { dq: &at_rest, ddq: &at_rest, ..input },
                &mut state,
            );
        }
        effect.advance(site, constants, &input, &mut state, &mut columns);
        for (out, columns) in out.iter_mut().zip(columns.chunks_exact(width)) {
            out[k * width..(k + 1) * width].copy_from_slice(columns);
        }
    }
}

/// One sample of an effect that only knows columns of trajectories: as a trajectory of one row.
/// Takes memory.
pub(super) fn advance_one_row<E: Effect + ?Sized>(
    effect: &E,
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_>,
    columns: &mut [f64],
) {
    let width = if effect.reach() == Reach::All { input.robot.dof() } else { 1 };
    let mut out = vec![vec![0.0; width]; columns.len() / width];
    let time = [input.time];
    let context = Context {
        robot: input.robot,
        rate_hz: input.rate_hz,
        time: if input.time.is_nan() { &[] } else { &time },
        q: input.q,
        dq: input.dq,
        ddq: input.ddq,
        rigid_torque: input.rigid_torque,
        torque: input.torque,
        channels: &[],
    };
    effect.trajectory_columns(site, &context, constants, &mut out);
    columns
        .chunks_exact_mut(width)
        .zip(&out)
        .for_each(|(columns, out)| columns.copy_from_slice(out));
}

/// Whether the columns of an effect at a sample are those of a trajectory of that sample alone, on
/// some motion.
///
/// # Errors
/// What the effect says of a failure.
pub(crate) fn knows_one_row(
    effect: &dyn Effect,
    site: Site,
    constants: &[f64],
    robot: &Robot,
) -> Result<bool, String> {
    const SAMPLES: usize = 12;
    let n = robot.dof();
    let numbers = |scale: f64| {
        (0..SAMPLES * n).map(|k| scale * (1.7 * k as f64 + scale).sin()).collect::<Vec<_>>()
    };
    let [q, dq, ddq, torque] = [0.9, 1.3, 4.0, 7.0].map(numbers);
    let time: Vec<f64> = (0..SAMPLES).map(|k| 0.01 * k as f64).collect();
    let width = if effect.reach() == Reach::All { n } else { 1 };
    let columns_of = |rows: core::ops::Range<usize>| {
        let of_joints = rows.start * n..rows.end * n;
        let context = Context {
            robot,
            rate_hz: 100.0,
            time: &time[rows.clone()],
            q: &q[of_joints.clone()],
            dq: &dq[of_joints.clone()],
            ddq: &ddq[of_joints.clone()],
            rigid_torque: &torque[of_joints.clone()],
            torque: &torque[of_joints],
            channels: &[],
        };
        let mut out = vec![vec![0.0; rows.len() * width]; effect.parameters().len()];
        effect.trajectory_columns(site, &context, constants, &mut out);
        effect.failure().map_or(Ok(out), Err)
    };
    let all = columns_of(0..SAMPLES)?;
    let largest = all.iter().flatten().fold(0.0f64, |largest, x| largest.max(x.abs()));
    for k in 0..SAMPLES {
        for (all, one) in all.iter().zip(columns_of(k..k + 1)?) {
            let apart = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-9 * largest;
            if all[k * width..(k + 1) * width].iter().zip(&one).any(apart) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// Numbers that a Dahl element carries.
pub(super) const DAHL_STATE: usize = 2;

/// A Dahl element: z follows the direction of what it runs over within a distance, stepped exactly
/// for pieces of one direction.
///
/// State: z and the last value.
///
/// Source: P. Dahl, A solid friction model, Aerospace Corp. TOR-0158(3107-18)-1 (1968).
pub(super) struct Dahl<'a, S>(pub &'a mut [S]);

impl<S: Number> Dahl<'_, S> {
    /// After a long run in one direction, or relaxed where there is none.
    pub fn start(self, x: S, direction: S) {
        self.0[0] = direction.sgn();
        self.0[1] = x;
    }

    /// z at the next value.
    #[inline]
    pub fn advance(self, x: S, distance: f64) -> S {
        let [z, last] = self.0 else { unreachable!("a Dahl element has two numbers") };
        let step = x - *last;
        *last = x;
        let direction = step.sgn();
        *z = direction + (*z - direction) * (-step.abs() / distance).exp();
        *z
    }
}

/// Starts a Dahl element over the position of a joint.
pub(super) fn start_over_position<S: Stepped>(
    site: Site,
    _: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
) {
    let joint = site.joint().expect("at a joint");
    Dahl(state.hidden).start(input.q[joint], input.dq[joint]);
}

/// Column of a Dahl element over the position of a joint, its distance the first constant.
pub(super) fn over_position<S: Stepped>(
    site: Site,
    constants: &[f64],
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    let x = input.q[site.joint().expect("at a joint")];
    columns[0] = Dahl(state.hidden).advance(x, constants[0]);
}

/// Numbers that a first-order lag carries.
pub(super) const LAG_STATE: usize = 2;

/// First-order lag for an input that is linear between samples: y' = (u - y) / T, exact for a ramp.
///
/// State: y and the last input.
pub(super) struct Lag<'a, S>(pub &'a mut [S]);

impl<S: Number> Lag<'_, S> {
    /// Settled at a value.
    pub fn start(self, value: S) {
        self.0.fill(value);
    }

    /// y at the next value.
    ///
    /// - `samples`: time constant in times between samples
    #[inline]
    pub fn advance(self, value: S, samples: S) -> S {
        let [y, input] = self.0 else { unreachable!("a lag has two numbers") };
        let one = S::constant(1.0);
        let decay = (-one / samples).exp();
        let slope = samples * (one - decay);
        let (old, new) = (slope - decay, one - slope);
        *y = decay * *y + old * *input + new * value;
        *input = value;
        *y
    }
}

/// Seconds of a spectrum of the motion.
pub(super) const WINDOW_S: f64 = 4.0;

/// The cut-off of what is differentiated over the bandwidth of the motion.
pub(super) const ABOVE: f64 = 3.0;

/// Numbers that [`SmoothDerivatives`] carry.
pub(super) const SMOOTH_DERIVATIVES_STATE: usize = SMOOTH_HEAD + 3 * LAG_STATE;

/// Those beside the lags.
const SMOOTH_HEAD: usize = 3;

/// First and second derivative of a value behind three lags of one time constant T in a row,
/// advanced by the delay of the lags: with x3 behind all three, x = (1 + T s)³ x3, so that dx/dt is
/// s (1 + 3 T s + 3 T² s²) x3 but for T³ s⁴, and d²x/dt² is s² (1 + 3 T s) x3 but for 3 T² s⁴.
/// Differences of the values behind the lags are these derivatives: T s x3 = x2 - x3.
///
/// The cut-off of the lags is [`ABOVE`] times the bandwidth of the motion so far: that of a normal
/// spectrum with the same second moment, of whose power 99.5 % lie below 2.81 times the root mean
/// square frequency.
///
/// State: number of samples, means of squared speeds and accelerations, and the three lags. It
/// begins at rest.
///
/// Source: S. O. Rice, Mathematical analysis of random noise, Bell Syst. Tech. J. 23 (1944), for
/// that frequency.
pub(super) struct SmoothDerivatives<'a, S>(pub &'a mut [S]);

impl<S: Stepped> SmoothDerivatives<'_, S> {
    /// Derivatives at the next value, that of a sample.
    pub fn advance(self, x: S, input: &SampleInput<'_, S>) -> [S; 2] {
        const BAND: f64 = 2.81;
        const TAU: f64 = core::f64::consts::TAU;
        let sum_of_squares =
            |values: &[S]| values.iter().fold(S::zero(()), |sum, x| sum + x.squared());
        let (head, lags) = self.0.split_at_mut(SMOOTH_HEAD);
        lags.iter_mut().for_each(|lag| *lag = head[0].where_positive(*lag, x));
        let [count, speed, acceleration] = head else { unreachable!("three numbers") };
        // Means, and not sums: one sample more still counts among many.
        *count = *count + 1.0;
        *speed += (sum_of_squares(input.dq) - *speed) / *count;
        *acceleration += (sum_of_squares(input.ddq) - *acceleration) / *count;
        let moment =
            speed.where_positive((*acceleration / *speed).sqrt(), S::constant(f64::INFINITY));
        let [low, high] = [1.0 / WINDOW_S, 0.5 * input.rate_hz].map(S::constant);
        let bandwidth = (moment * BAND / TAU).clamp(low, high);
        let time = (bandwidth * (TAU * ABOVE)).recip();
        let mut behind = [x; 4];
        for (index, lag) in lags.chunks_exact_mut(LAG_STATE).enumerate() {
            behind[index + 1] = Lag(lag).advance(behind[index], time * input.rate_hz);
        }
        let [x, x1, x2, x3] = behind;
        let (first, second, third) = (x2 - x3, x1 - x2 * 2.0 + x3, x - x1 * 3.0 + x2 * 3.0 - x3);
        [(first + (second + third) * 3.0) / time, (second + third * 3.0) / (time * time)]
    }
}

/// Nodes of the interpolation of [`Delay`].
const NODES: usize = 4;

/// Numbers of a [`Delay`] beside its values and the times between them.
const DELAY_HEAD: usize = 3;

/// A value some time ago, by cubic interpolation between the samples around that time, or the four
/// newest where the time is younger than the last but one. Before the start the value was what it
/// was there.
///
/// State: place of the newest value, the time between samples, for how many values that did not
/// change; then the values and the time before each in a ring.
pub(super) struct Delay<'a, S = f64>(pub &'a mut [S]);

impl Delay<'_> {
    /// Numbers for a delay at a rate, if the time between samples is never less than half of what
    /// the rate says.
    pub fn len(delay: f64, rate_hz: f64) -> usize {
        let samples =
            if rate_hz.is_finite() { (delay.max(0.0) * rate_hz).ceil() as usize } else { 0 };
        DELAY_HEAD + 2 * (2 * samples + NODES + 1)
    }
}

impl<S: Number + Into<f64>> Delay<'_, S> {
    /// It has always been this value.
    pub fn start(self, value: S) {
        let capacity = (self.0.len() - DELAY_HEAD) / 2;
        self.0.fill(S::zero(()));
        self.0[DELAY_HEAD..DELAY_HEAD + capacity].fill(value);
    }

    /// The value `delay` seconds before this one, which comes `step` seconds after the last one.
    pub fn advance(self, value: S, delay: f64, step: f64) -> S {
        let (head, ring) = self.0.split_at_mut(DELAY_HEAD);
        let [place, last_step, even] = head else { unreachable!("three numbers") };
        let capacity = ring.len() / 2;
        let (values, steps) = ring.split_at_mut(capacity);
        let newest = ((*place).into() as usize + 1) % capacity;
        let this_step = S::constant(step);
        if last_step.is_surely_zero() {
            // What was before the start is evenly spaced.
            steps.fill(this_step);
            (*last_step, *even) = (this_step, S::constant(capacity as f64));
        }
        let changed = !(*last_step - this_step).is_surely_zero();
        *even = if changed {
            S::constant(1.0)
        } else {
            (*even + 1.0).clamp(S::zero(()), S::constant(capacity as f64))
        };
        *place = S::constant(newest as f64);
        *last_step = this_step;
        values[newest] = value;
        steps[newest] = this_step;
        let at = |back: usize| (newest + capacity - back.min(capacity - 1)) % capacity;
        if (*even).into() >= capacity as f64 {
            let (first, weights) = delay_weights(delay / step);
            return (0..NODES)
                .fold(S::zero(()), |sum, node| sum + values[at(first - node)] * weights[node]);
        }
        let (mut older, mut age) = (1, steps[newest].into());
        while older + 1 < capacity && age < delay {
            age += steps[at(older)].into();
            older += 1;
        }
        let (old, new) = (values[at(older)], values[at(older - 1)]);
        let between: f64 = steps[at(older - 1)].into();
        old + (new - old) * ((age - delay) / between).clamp(0.0, 1.0)
    }
}

/// How far back the oldest of the values lies that a delay is interpolated between, and their
/// weights, oldest first.
///
/// - `behind`: the delay, in times between samples
fn delay_weights(behind: f64) -> (usize, [f64; NODES]) {
    let first = (behind.ceil() as usize + 1).max(NODES - 1);
    (first, cubic_weights(first as f64 - 1.0 - behind))
}

/// Weights of the values at -1, 0, 1 and 2 of the cubic through them, at `x`.
pub(super) fn cubic_weights(x: f64) -> [f64; NODES] {
    [
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    ]
}
