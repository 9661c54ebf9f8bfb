use alloc::boxed::Box;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use super::residual::{PhysicsAtSample, ResidualOptions, ResidualPredictor};
use super::sampler::{Buffers, Sampler};
use super::start::StreamStart;
use super::steps::TransformSteps;
use super::{Plain, Purpose, StreamError, StreamOptions};
use crate::effects::{Effect, Needs, Streamed, knows_one_row};
use crate::model::{StreamedModel, Term};
use crate::robot::Robot;
use crate::simd::{Number, Real};

/// Torque of one sample after the other, for a controller: owns its buffers, allocates nothing
/// after it is made, takes no lock, and can move to another thread.
///
/// Of a learned model the torque is that of the physics and what its Gaussian processes add
/// ([`StreamedModel::learned`]), and [`Self::torque_and_deviation`] says how sure it is. Far from
/// the logs the processes add nothing.
///
/// Effects with a memory carry their hidden state from call to call: the torque of sample k is that
/// of a whole trajectory at sample k, from the first sample after [`Self::reset`] on. Where a
/// trajectory uses samples that come later, [`crate::effects::Effect::streamed`] says what is done
/// instead. Effects of a user that only know columns of trajectories
/// ([`crate::effects::Effect::steps`]) are asked for a trajectory of one row, which takes memory.
///
/// # Examples
/// ```
/// use sgpr_predict::{model::StreamedModel, robot::puma560, stream::Predictor};
/// let model = StreamedModel::nominal(&puma560());
/// let mut predictor = Predictor::new(&model);
/// let tau = predictor.torque(&[0.1; 6], &[0.0; 6], &[0.0; 6]);
/// assert_eq!(tau.len(), 6);
/// ```
///
/// Friction that builds up over a distance remembers the way:
/// ```
/// use sgpr_predict::effects::{Site, by_name};
/// use sgpr_predict::model::{StreamedModel, Term};
/// use sgpr_predict::{robot::two_link, stream::StreamOptions};
/// let mut friction = Term::new(by_name("presliding_friction").unwrap(), Site::Joint(1), vec![0.01]);
/// friction.coefficients = vec![2.0];
/// let model = StreamedModel::nominal(&two_link()).with_terms(vec![friction]);
/// let mut predictor = model.predictor(&StreamOptions::default()).unwrap();
/// let at_rest = predictor.torque(&[0.0, 0.0], &[0.0; 2], &[0.0; 2])[1];
/// let moved = predictor.torque(&[0.0, 1.0], &[0.0; 2], &[0.0; 2])[1];
/// let back = predictor.torque(&[0.0, 0.0], &[0.0; 2], &[0.0; 2])[1];
/// assert!((back - (at_rest - 2.0)).abs() < 1e-12 && moved != back);
/// ```
#[derive(Debug)]
pub struct Predictor<F: Plain = f64> {
    sampler: Sampler<F::Number>,
    /// Index of the first coefficient of each of the terms among those of all terms of the model.
    first_coefficients: Vec<usize>,
    /// What a constant torque becomes at each joint, and its largest value.
    gains: Vec<[f64; 2]>,
    options: StreamOptions,
    clock: SessionClock,
    /// Effect and joint that need a temperature.
    warm: Option<(String, usize)>,
    /// Whether steps must not be shorter than half of what the rate says: of a torque that is late
    /// or early.
    delays: bool,
    /// Whether an effect may fail.
    fallible: bool,
    start: StreamStart<F::Number>,
    /// Of a learned model.
    residual: Option<Box<ResidualPredictor>>,
    /// For the joints without a process, where it differs from the physics.
    identified: Option<Box<Self>>,
    tau: Vec<F>,
}

/// The time of the session.
#[derive(Clone, Copy, Debug)]
struct SessionClock {
    /// Nominal, Hz; NaN if it is not known.
    rate_hz: f64,
    /// At the last step of another length, s.
    origin: f64,
    /// Nominal steps since.
    steps: u64,
    /// Whether the next sample is at the time of the clock.
    at_start: bool,
}

impl SessionClock {
    fn time(&self) -> f64 {
        if self.steps == 0 { self.origin } else { self.origin + self.steps as f64 / self.rate_hz }
    }

    /// To the time of a sample; of the nominal period without a step.
    fn advance(&mut self, step: Option<f64>) {
        match step {
            _ if self.at_start => self.at_start = false,
            None => self.steps += 1,
            Some(step) => (self.origin, self.steps) = (self.time() + step, 0),
        }
    }
}

impl StreamedModel {
    /// The model one sample after the other.
    ///
    /// # Errors
    /// If a rate is needed and none given, or no number above zero; if an effect cannot be
    /// streamed; if an effect to keep is none of the model.
    pub fn predictor(&self, options: &StreamOptions) -> Result<Predictor, StreamError> {
        self.predictor_with(options, &ResidualOptions::default())
    }

    /// The same with another arithmetic of the processes of a learned model, or with a standard
    /// deviation.
    ///
    /// # Errors
    /// As [`Self::predictor`]; if a standard deviation is asked for and the model has no processes,
    /// or too many points for it.
    pub fn predictor_with(
        &self,
        options: &StreamOptions,
        residual: &ResidualOptions,
    ) -> Result<Predictor, StreamError> {
        self.predictor_of(options, residual)
    }

    /// The same in 32 bits, for processors that compute with no other numbers: of the motion, the
    /// hidden states and the torque; times and the gaps between them stay in 64. It has no standard
    /// deviation.
    ///
    /// # Errors
    /// As [`Self::predictor`]; if an effect is not written over numbers of 32 bits, as one of a
    /// user may be.
    ///
    /// # Examples
    /// ```
    /// use sgpr_predict::{model::StreamedModel, robot::puma560, stream::StreamOptions};
    /// let model = StreamedModel::nominal(&puma560());
    /// let mut predictor = model.single_predictor(&StreamOptions::default()).unwrap();
    /// let tau: &[f32] = predictor.torque(&[0.1; 6], &[0.0; 6], &[0.0; 6]);
    /// let in_64_bits = model.predictor(&StreamOptions::default()).unwrap().torque(&[0.1; 6], &[0.0; 6], &[0.0; 6])[1];
    /// assert!((f64::from(tau[1]) - in_64_bits).abs() < 1e-4);
    /// ```
    pub fn single_predictor(&self, options: &StreamOptions) -> Result<Predictor<f32>, StreamError> {
        self.predictor_in(options)
    }

    /// The torque alone, in the arithmetic of a number.
    pub(crate) fn predictor_in<F: Plain>(
        &self,
        options: &StreamOptions,
    ) -> Result<Predictor<F>, StreamError> {
        self.predictor_of(options, &ResidualOptions { precision: F::PRECISION, deviation: false })
    }

    pub(super) fn predictor_of<F: Plain>(
        &self,
        options: &StreamOptions,
        residual: &ResidualOptions,
    ) -> Result<Predictor<F>, StreamError> {
        let physics = self.physics_predictor(options)?;
        match &self.residual {
            Some(learned) => {
                let alone = ResidualOptions { deviation: false, ..*residual };
                let other = |model: &Self| model.predictor_of(options, &alone);
                let identified = learned.identified.as_ref().map(other).transpose()?;
                Ok(physics.with_residual(
                    ResidualPredictor::of_file(self, learned, residual)?,
                    identified,
                ))
            }
            None if residual.deviation => Err(StreamError::NotLearned),
            None => Ok(physics),
        }
    }

    /// The physics alone.
    fn physics_predictor<F: Plain>(
        &self,
        options: &StreamOptions,
    ) -> Result<Predictor<F>, StreamError> {
        let rate_hz = match options.rate_hz {
            Some(found) if !(found.is_finite() && found > 0.0) => {
                return Err(StreamError::Rate { found });
            }
            given => given.unwrap_or(f64::NAN),
        };
        self.check_kept(options)?;
        let terms = options.terms(self);
        check(&terms, rate_hz, self.robot())?;
        let effects =
            self.parameter_set().effects().iter().chain(terms.iter().map(|term| &term.effect));
        check_numbers::<F>(effects.map(AsRef::as_ref))?;
        let n = self.robot().dof();
        let warm = terms.iter().find(|term| term.effect.needs().temperature);
        // A memory that grows with the rate is one of samples; a torque that is early takes the
        // jerk from two of them.
        let held = |t: &Term| {
            t.effect.lead(&t.constants) > 0.0
                || t.effect.state_len(&t.constants, rate_hz)
                    != t.effect.state_len(&t.constants, 2.0 * rate_hz)
        };
        let sampler = Sampler::new(self, options, &terms, rate_hz);
        Ok(Predictor {
            fallible: sampler.terms.may_fail(),
            first_coefficients: first_coefficients(self, options),
            gains: TransformSteps::new(&terms, n, rate_hz).static_gains(n),
            warm: warm
                .map(|term| (term.effect.name().into(), term.site.joint().unwrap_or_default())),
            delays: terms.iter().any(held),
            options: options.clone(),
            clock: SessionClock { rate_hz, origin: 0.0, steps: 0, at_start: true },
            start: StreamStart::AtRest,
            residual: None,
            identified: None,
            tau: vec![F::default(); n],
            sampler,
        })
    }

    fn check_kept(&self, options: &StreamOptions) -> Result<(), StreamError> {
        let everywhere = self.parameter_set().effects().iter().map(|effect| effect.name());
        let known: Vec<&str> =
            everywhere.chain(self.terms().iter().map(|term| term.effect.name())).collect();
        let unknown = options.keep.iter().find(|name| !known.contains(&name.as_str()));
        unknown.map_or(Ok(()), |name| {
            let known = known.iter().map(ToString::to_string).collect();
            Err(StreamError::UnknownEffect { name: name.clone(), known })
        })
    }
}

fn first_coefficients(model: &StreamedModel, options: &StreamOptions) -> Vec<usize> {
    let mut first = 0;
    let mut all = Vec::new();
    for term in model.terms() {
        if !term.is_transform() && options.holds(term.effect.as_ref()) {
            all.push(first);
        }
        first += term.coefficients.len();
    }
    all
}

/// Whether effects are written over a number.
fn check_numbers<'a, F: Plain>(
    mut effects: impl Iterator<Item = &'a dyn Effect>,
) -> Result<(), StreamError> {
    effects.find(|effect| !F::has(*effect)).map_or(Ok(()), |effect| {
        let reason = "it is written over numbers of 64 bits alone".into();
        Err(StreamError::NotStreamed { effect: effect.name().into(), reason })
    })
}

/// Whether terms can be streamed.
fn check(terms: &[Term], rate_hz: f64, robot: &Robot) -> Result<(), StreamError> {
    let mut unpaced = Vec::new();
    for term in terms {
        let (effect, name) = (&term.effect, || term.effect.name().to_string());
        if let Streamed::Not(reason) = effect.streamed() {
            return Err(StreamError::NotStreamed { effect: name(), reason: reason.into() });
        }
        let Needs { time, rate, channels, .. } = effect.needs();
        if let Some(channel) = channels.into_iter().next() {
            return Err(StreamError::ChannelNeeded { effect: name(), channel });
        }
        if !term.is_transform() && !effect.steps() {
            let refuse = |reason| StreamError::NotStreamed { effect: name(), reason };
            let one_row = knows_one_row(effect.as_ref(), term.site, &term.constants, robot)
                .map_err(refuse)?;
            if effect.has_memory() || !one_row {
                return Err(refuse("its torque at a sample depends on other samples".into()));
            }
        }
        if (time || rate) && rate_hz.is_nan() && !unpaced.contains(&name()) {
            unpaced.push(name());
        }
    }
    if unpaced.is_empty() { Ok(()) } else { Err(StreamError::RateNeeded { effects: unpaced }) }
}

impl Predictor {
    /// All of a model, without a rate.
    ///
    /// # Panics
    /// If an effect of the model needs a rate or cannot be streamed: use
    /// [`StreamedModel::predictor`].
    pub fn new(model: impl Into<StreamedModel>) -> Self {
        match model.into().predictor(&StreamOptions::default()) {
            Ok(predictor) => predictor,
            Err(error) => panic!(
                "{error} (`predictor` of the model takes a rate and returns this as an error)"
            ),
        }
    }
}

impl<F: Plain> Predictor<F> {
    /// The same with the processes of a learned model.
    ///
    /// - `identified`: the model of the joints without a process, if it is another
    #[doc(hidden)]
    #[must_use]
    pub fn with_residual(mut self, residual: ResidualPredictor, identified: Option<Self>) -> Self {
        self.residual = Some(Box::new(residual));
        self.identified = identified.map(Box::new);
        self
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.tau.len()
    }

    /// What the torque is for.
    pub fn purpose(&self) -> Purpose {
        self.options.purpose
    }

    /// Rate of the calls, Hz, if it was given.
    pub fn rate_hz(&self) -> Option<f64> {
        self.options.rate_hz
    }

    /// Time of the session at the last sample, s; at the next one, if that is the first since a
    /// reset.
    pub fn time(&self) -> f64 {
        self.clock.time()
    }

    /// Sets the clock of the session: the time of the next sample, s. It starts at zero.
    ///
    /// # Errors
    /// If the time is not finite.
    pub fn set_time(&mut self, time: f64) -> Result<(), StreamError> {
        if !time.is_finite() {
            return Err(StreamError::OutOfRange {
                name: "time".into(),
                found: time,
                expected: "a finite number",
            });
        }
        self.clock = SessionClock { origin: time, steps: 0, at_start: true, ..self.clock };
        self.identified.as_mut().map_or(Ok(()), |other| other.set_time(time))
    }

    /// Sets the temperature of each joint, °C, for friction that depends on it.
    ///
    /// # Errors
    /// If there is not one finite value per joint.
    pub fn set_temperature(&mut self, celsius: &[f64]) -> Result<(), StreamError> {
        self.check_array("temperature", celsius)?;
        let own = self.sampler.buffers.temperature.iter_mut();
        own.zip(celsius).for_each(|(own, given)| *own = F::Number::constant(*given));
        self.identified.as_mut().map_or(Ok(()), |other| other.set_temperature(celsius))
    }

    /// Forgets all samples: the clock is at zero, and the hidden states start at rest at the next
    /// sample, as a trajectory does at its first.
    pub fn reset(&mut self) {
        self.clock = SessionClock { origin: 0.0, steps: 0, at_start: true, ..self.clock };
        self.sampler.forget();
        self.start = StreamStart::AtRest;
        if let Some(other) = &mut self.identified {
            other.reset();
        }
    }

    /// Forgets all samples: the clock is at zero, and the hidden states are those after a long
    /// motion at speed `dq` to `q`, those of rest for a joint without speed.
    ///
    /// - `q`, `dq`: `[n]`, rad, rad/s (m for prismatic joints)
    ///
    /// # Errors
    /// If there is not one finite value per joint; then nothing is forgotten.
    pub fn reset_at(&mut self, q: &[F], dq: &[F]) -> Result<(), StreamError> {
        self.check_array("q", q)?;
        self.check_array("dq", dq)?;
        self.reset();
        self.set_motion(&[q, dq]);
        self.sampler.buffers.motion[2].fill(F::Number::zero(()));
        self.start = StreamStart::Moving;
        self.sample(self.clock.rate_hz);
        self.sampler.forget();
        self.identified.as_mut().map_or(Ok(()), |other| other.reset_at(q, dq))
    }

    /// Torque at the next sample, one period after the last; moves the hidden states on.
    ///
    /// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
    /// - returns `[n]`, N·m (N); NaN if a value of the sample is not finite or a temperature is
    ///   missing, and then the hidden states stay as they are ([`Self::try_torque`] says what is
    ///   wrong)
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn torque(&mut self, q: &[F], dq: &[F], ddq: &[F]) -> &[F] {
        let n = self.dof();
        assert!([q, dq, ddq].iter().all(|values| values.len() == n), "one value per joint");
        if self.take([q, dq, ddq], None, add_means).is_err() {
            self.tau.fill(F::of_f64(f64::NAN));
        }
        &self.tau
    }

    /// As [`Self::torque`], with what is wrong with a sample as an error.
    ///
    /// # Errors
    /// If a slice is not of length n or holds a number that is not finite, or a temperature is
    /// missing; the hidden states stay as they are.
    pub fn try_torque(&mut self, q: &[F], dq: &[F], ddq: &[F]) -> Result<&[F], StreamError> {
        self.take([q, dq, ddq], None, add_means)?;
        Ok(&self.tau)
    }

    pub(super) fn last_torque(&self) -> &[F] {
        &self.tau
    }

    /// As [`Self::try_torque`], `step` seconds after the last sample: for irregular calls and
    /// pauses.
    ///
    /// # Errors
    /// As [`Self::try_torque`]; if the step is no finite number above zero, or shorter than half a
    /// period where the model has a delay.
    pub fn torque_after(
        &mut self,
        step: f64,
        q: &[F],
        dq: &[F],
        ddq: &[F],
    ) -> Result<&[F], StreamError> {
        self.take([q, dq, ddq], Some(step), add_means)?;
        Ok(&self.tau)
    }

    /// Everything that is carried from call to call, to come back to it by [`Self::restore`].
    pub fn save(&self, into: &mut SavedStates<F>) {
        into.terms.clear();
        into.terms.extend_from_slice(self.sampler.terms.hidden());
        into.transforms.clear();
        into.transforms.extend_from_slice(self.sampler.transforms.hidden());
        into.last_ddq.clear();
        into.last_ddq.extend_from_slice(&self.sampler.buffers.last_ddq);
        into.run = Some((self.clock, self.start, self.sampler.buffers.has_last));
        if let Some(other) = &self.identified {
            other.save(into.other.get_or_insert_default());
        }
    }

    /// Back to what was saved.
    ///
    /// # Panics
    /// If it was saved by another predictor.
    pub fn restore(&mut self, from: &SavedStates<F>) {
        let (clock, start, has_last) = from.run.expect("something was saved");
        self.sampler.terms.set_hidden(&from.terms);
        self.sampler.transforms.set_hidden(&from.transforms);
        self.sampler.buffers.last_ddq.copy_from_slice(&from.last_ddq);
        self.sampler.buffers.has_last = has_last;
        (self.clock, self.start) = (clock, start);
        if let (Some(other), Some(from)) = (&mut self.identified, &from.other) {
            other.restore(from);
        }
    }

    /// - `add_residual`: how what the processes say is added to the torque
    fn take(
        &mut self,
        motion: [&[F]; 3],
        step: Option<f64>,
        add_residual: impl FnOnce(&mut ResidualPredictor, &Self, &mut [F]),
    ) -> Result<(), StreamError> {
        for (name, values) in ["q", "dq", "ddq"].into_iter().zip(motion) {
            self.check_array(name, values)?;
        }
        if let Some((effect, joint)) = &self.warm
            && !self.sampler.buffers.temperature[*joint].is_known()
        {
            let joint = self.sampler.robot.joints()[*joint].name.clone();
            return Err(StreamError::TemperatureNeeded { effect: effect.clone(), joint });
        }
        if let Some(found) = step {
            if !(found.is_finite() && found > 0.0) {
                return Err(StreamError::Step { found });
            }
            let shortest = 0.5 / self.clock.rate_hz;
            if self.delays && found < shortest {
                return Err(StreamError::StepTooShort { found, shortest });
            }
        }
        let mut before = self.fallible.then(SavedStates::default);
        if let Some(before) = &mut before {
            self.save(before);
        }
        self.set_motion(&motion);
        self.clock.advance(step);
        let rate_hz = step.map_or(self.clock.rate_hz, |step| 1.0 / step);
        self.sample(rate_hz);
        if let Some(before) = &before
            && let Some((effect, reason)) = self.sampler.terms.failure()
        {
            self.restore(before);
            return Err(StreamError::EffectFailed { effect, reason });
        }
        if let Some(mut residual) = self.residual.take() {
            let other = self.identified.as_mut();
            let other = other.map_or(Ok(()), |other| other.take(motion, step, add_means));
            if other.is_ok() {
                let mut tau = core::mem::take(&mut self.tau);
                residual.set_motion(motion);
                if let Some(identified) = &self.identified {
                    residual.replace(&mut tau, identified.last_torque());
                }
                add_residual(&mut residual, self, &mut tau);
                self.tau = tau;
            }
            self.residual = Some(residual);
            if let (Err(_), Some(before)) = (&other, &before) {
                self.restore(before);
            }
            return other;
        }
        Ok(())
    }

    fn set_motion(&mut self, motion: &[&[F]]) {
        for (own, given) in self.sampler.buffers.motion.iter_mut().zip(motion) {
            own.iter_mut().zip(*given).for_each(|(own, given)| *own = given.number());
        }
    }

    fn check_array<V: Copy + Into<f64>>(
        &self,
        name: &'static str,
        values: &[V],
    ) -> Result<(), StreamError> {
        let expected = self.dof();
        if values.len() != expected {
            return Err(StreamError::Length { name, found: values.len(), expected });
        }
        match values.iter().position(|value| !(*value).into().is_finite()) {
            Some(joint) => Err(StreamError::NotFinite { name, joint, value: values[joint].into() }),
            None => Ok(()),
        }
    }

    /// Torque of the motion in the buffers.
    fn sample(&mut self, rate_hz: f64) {
        self.sampler.sample(rate_hz, self.clock.time(), &self.start);
        self.tau
            .iter_mut()
            .zip(&self.sampler.buffers.tau)
            .for_each(|(tau, own)| *tau = F::of(*own));
        self.start = StreamStart::Done;
    }
}

impl Predictor {
    /// The same, and the standard deviation of its measurement, `[n]` each, N·m (N): of the
    /// processes, of noise, and what uncertain parameters bring, beside a process as far as that
    /// does not know.
    ///
    /// # Errors
    /// As [`Self::try_torque`].
    ///
    /// # Panics
    /// If the predictor was made without a standard deviation ([`ResidualOptions`]).
    pub fn torque_and_deviation(
        &mut self,
        q: &[f64],
        dq: &[f64],
        ddq: &[f64],
    ) -> Result<(&[f64], &[f64]), StreamError> {
        self.take_with_deviation(q, dq, ddq, None)
    }

    /// The same, `step` seconds after the last sample: for irregular calls and pauses.
    ///
    /// # Errors
    /// As [`Self::torque_after`].
    ///
    /// # Panics
    /// As [`Self::torque_and_deviation`].
    pub fn torque_and_deviation_after(
        &mut self,
        step: f64,
        q: &[f64],
        dq: &[f64],
        ddq: &[f64],
    ) -> Result<(&[f64], &[f64]), StreamError> {
        self.take_with_deviation(q, dq, ddq, Some(step))
    }

    fn take_with_deviation(
        &mut self,
        q: &[f64],
        dq: &[f64],
        ddq: &[f64],
        step: Option<f64>,
    ) -> Result<(&[f64], &[f64]), StreamError> {
        assert!(
            self.residual.as_ref().is_some_and(|residual| residual.with_deviation()),
            "made with a standard deviation"
        );
        self.take([q, dq, ddq], step, |residual, physics, tau| {
            let Sampler { robot, transforms, buffers: Buffers { motion, links, .. }, .. } =
                &physics.sampler;
            residual.add_means_and_spread(
                &PhysicsAtSample {
                    robot,
                    links: if transforms.move_links() { links } else { motion },
                    motion,
                    term_columns: &|joint, out| physics.term_columns(joint, out),
                    gain: &|joint| physics.gain(joint),
                },
                tau,
            );
        })?;
        Ok((&self.tau, self.residual.as_ref().map_or(&[], |residual| residual.deviation())))
    }

    /// Share of the variance of each joint's process that the logs have not explained, `[n]`, at
    /// the last sample that was asked with [`Self::torque_and_deviation`]: from 0 at a point of the
    /// logs to 1 far from all, 0 for a joint without a process. Above 0.95 the torque is that of
    /// the physics. Empty for a model without processes.
    pub fn novelty(&self) -> &[f64] {
        self.residual.as_ref().map_or(&[], |residual| residual.novelty())
    }

    /// Derivatives of a joint's torque by the coefficients of all terms of the model at the last
    /// sample, as the drive makes it; zero for terms that are not held.
    fn term_columns(&self, joint: usize, out: &mut [f64]) {
        out.fill(0.0);
        let first = &self.first_coefficients;
        self.sampler.terms.for_each_column(joint, self.dof(), |term, index, value| {
            out[first[term] + index] = value
        });
    }

    /// What the log shows of a small torque more at a joint at the last sample, delays and lags
    /// aside.
    fn gain(&self, joint: usize) -> f64 {
        let [gain, largest] = self.gains[joint];
        if self.sampler.buffers.tau[joint].abs() >= largest { 0.0 } else { gain }
    }
}

fn add_means<F: Plain>(residual: &mut ResidualPredictor, _: &Predictor<F>, tau: &mut [F]) {
    residual.add_means(tau);
}

/// What a [`Predictor`] carries from call to call.
#[derive(Clone, Debug, Default)]
pub struct SavedStates<F: Plain = f64> {
    terms: Vec<F::Number>,
    transforms: Vec<F::Number>,
    last_ddq: Vec<F::Number>,
    /// Clock, start, and whether there is an acceleration before.
    run: Option<(SessionClock, StreamStart<F::Number>, F::Number)>,
    /// Of the model of joints without a process, if it is another.
    other: Option<Box<SavedStates<F>>>,
}
