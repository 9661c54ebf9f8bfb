use alloc::string::String;
use alloc::vec::Vec;

use crate::model::StreamedModel;
use crate::simd::Number;
use crate::stream::{Plain, Predictor, Purpose, StreamError, StreamOptions};

/// How gravity and friction are compensated.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CompensationOptions {
    /// Share of the friction that is compensated, from 0 to 1: friction that is taken for larger
    /// than it is drives the arm.
    pub friction: f64,
    /// Speed of each joint at which its friction is compensated in full, rad/s (m/s); below it the
    /// share falls in a line.
    pub transition_speed: f64,
    /// Largest torque of each joint, `[n]`, N·m (N); empty for none.
    pub limits: Vec<f64>,
    /// Rate of the calls, and effects to keep. The purpose is always that of a feed-forward.
    pub stream: StreamOptions,
}

impl CompensationOptions {
    setters! {
        with_friction(friction: f64),
        with_transition_speed(transition_speed: f64),
        with_limits(limits: Vec<f64>),
        with_stream(stream: StreamOptions),
    }
}

impl Default for CompensationOptions {
    fn default() -> Self {
        let stream = StreamOptions { purpose: Purpose::FeedForward, ..StreamOptions::default() };
        Self { friction: 0.8, transition_speed: 0.02, limits: Vec::new(), stream }
    }
}

/// The torque that holds an arm where it is and overcomes its friction in the direction of the
/// wanted velocity.
///
/// Gravity is that of the measured position. Friction is that of the wanted velocity and never of
/// the measured one, whose noise would make it chatter at rest; as the share of the friction falls
/// to nothing at rest, an arm that is wanted to stand gets gravity alone. Friction with a memory,
/// as of bristles that bend, is taken as built up in the wanted direction. Friction with a share of
/// at most one takes out no more energy than the joint loses.
///
/// # Examples
/// ```
/// use sgpr_predict::control::{Compensation, CompensationOptions};
/// use sgpr_predict::{model::StreamedModel, robot::two_link};
/// let model = StreamedModel::nominal(&two_link());
/// let mut compensation = Compensation::new(&model, &CompensationOptions::default()).unwrap();
/// let tau = compensation.torque(&[0.0, 0.0], &[0.0, 0.0]).unwrap();
/// assert!((tau[0] - 19.62).abs() < 1e-12);
/// ```
#[derive(Debug)]
pub struct Compensation<F: Plain = f64> {
    /// With the wanted velocity.
    moving: Predictor<F>,
    /// With the wanted velocity reversed: half the difference to the above is friction.
    reversed: Predictor<F>,
    options: CompensationOptions,
    /// Since the start, for effects of time.
    samples: u64,
    minus_dq: Vec<F>,
    zeros: Vec<F>,
    tau: Vec<F>,
}

impl Compensation {
    /// # Errors
    /// If the model cannot be streamed; if a share, a speed or a limit is none.
    pub fn new(
        model: impl Into<StreamedModel>,
        options: &CompensationOptions,
    ) -> Result<Self, StreamError> {
        Self::of(&model.into(), options)
    }
}

impl Compensation<f32> {
    /// The same in 32 bits ([`StreamedModel::single_predictor`]).
    ///
    /// # Errors
    /// As [`Compensation::new`]; if an effect is not written over numbers of 32 bits.
    pub fn single(
        model: impl Into<StreamedModel>,
        options: &CompensationOptions,
    ) -> Result<Self, StreamError> {
        Self::of(&model.into(), options)
    }
}

impl<F: Plain> Compensation<F> {
    fn of(model: &StreamedModel, options: &CompensationOptions) -> Result<Self, StreamError> {
        let mut options = options.clone();
        options.stream.purpose = Purpose::FeedForward;
        let n = model.robot().dof();
        let check = |name: String, found: f64, good: bool, expected: &'static str| {
            if good { Ok(()) } else { Err(StreamError::OutOfRange { name, found, expected }) }
        };
        let (share, speed) = (options.friction, options.transition_speed);
        check("friction".into(), share, (0.0..=1.0).contains(&share), "a share from 0 to 1")?;
        check(
            "transition_speed".into(),
            speed,
            speed.is_finite() && speed > 0.0,
            "a speed above zero",
        )?;
        if !options.limits.is_empty() && options.limits.len() != n {
            return Err(StreamError::Length {
                name: "limits",
                found: options.limits.len(),
                expected: n,
            });
        }
        for (joint, limit) in options.limits.iter().enumerate() {
            let name = format!("limits of {}", model.joint_name(joint));
            check(
                name,
                *limit,
                limit.is_finite() && *limit >= 0.0,
                "a torque that is not below zero",
            )?;
        }
        Ok(Self {
            moving: model.predictor_in(&options.stream)?,
            reversed: model.predictor_in(&options.stream)?,
            options,
            samples: 0,
            minus_dq: vec![F::default(); n],
            zeros: vec![F::default(); n],
            tau: vec![F::default(); n],
        })
    }

    /// Torque of the next sample, `[n]`, N·m (N).
    ///
    /// - `q`: measured positions, `[n]`, rad (m)
    /// - `wanted_dq`: wanted velocities, `[n]`, rad/s (m/s)
    ///
    /// # Errors
    /// If there is not one finite number per joint.
    pub fn torque(&mut self, q: &[F], wanted_dq: &[F]) -> Result<&[F], StreamError> {
        let Self { moving, reversed, options, samples, minus_dq, zeros, tau } = self;
        if minus_dq.len() == wanted_dq.len() {
            minus_dq.iter_mut().zip(wanted_dq).for_each(|(minus, dq)| *minus = F::of(-dq.number()));
        }
        let time = options.stream.rate_hz.map_or(0.0, |rate_hz| *samples as f64 / rate_hz);
        let there = built_up(moving, time, [q, wanted_dq, zeros])?;
        let back = built_up(reversed, time, [q, minus_dq, zeros])?;
        *samples += 1;
        for (joint, tau) in tau.iter_mut().enumerate() {
            // What does not change with the direction: gravity, and centripetal torque.
            let (there, back) = (there[joint].number(), back[joint].number());
            let (even, friction) = ((there + back) * 0.5, (there - back) * 0.5);
            let [zero, one] = [0.0, 1.0].map(F::Number::constant);
            let share = (wanted_dq[joint].number().abs() / options.transition_speed)
                .clamp(zero, one)
                * options.friction;
            let mut own = even + share * friction;
            if let Some(limit) = options.limits.get(joint) {
                own = own.clamp(F::Number::constant(-limit), F::Number::constant(*limit));
            }
            *tau = F::of(own);
        }
        Ok(tau)
    }
}

/// Torque after a long motion at a speed.
fn built_up<'p, F: Plain>(
    predictor: &'p mut Predictor<F>,
    time: f64,
    [q, dq, ddq]: [&[F]; 3],
) -> Result<&'p [F], StreamError> {
    predictor.reset_at(q, dq)?;
    predictor.set_time(time)?;
    predictor.try_torque(q, dq, ddq)
}
