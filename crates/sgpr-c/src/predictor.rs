//! Predictors: one sample after the other.

use std::ffi::{CStr, c_char};

use sgpr_predict::stream::{Predictor, Purpose, ResidualOptions, StreamOptions};

use crate::failure::{Code, Failure, code};
use crate::model::sgpr_model;

/// The torque that the arm needs: without errors of the measurement and what was there for a while.
pub const SGPR_FEED_FORWARD: i32 = 0;
/// The torque that a log would show.
pub const SGPR_EXPECTED_MEASUREMENT: i32 = 1;

/// The torque of a refused sample is the last good one, zero before the first.
pub const SGPR_LAST_TORQUE: i32 = 0;
/// The torque of a refused sample is zero.
pub const SGPR_ZERO_TORQUE: i32 = 1;

/// More names than any model has effects are a length that is none.
const MOST_NAMES: usize = 10_000;

/// How a predictor is made. All zero (`sgpr_options options = {0};`) is a feed-forward without a
/// rate.
#[derive(Clone, Copy, Debug)]
#[allow(non_camel_case_types, reason = "the name in C")]
#[repr(C)]
pub struct sgpr_options {
    /// Calls per second, 0 if not known; effects of time, delays and lags need it.
    pub rate_hz: f64,
    /// SGPR_FEED_FORWARD or SGPR_EXPECTED_MEASUREMENT.
    pub purpose: i32,
    /// 1: every call computes the standard deviation of its torque, too, for which a learned model
    /// needs a square of its points in memory, and as much time. 0: none does.
    pub deviation: i32,
    /// Names of effects that a feed-forward leaves out and that are wanted all the same, as a
    /// payload that is carried; UTF-8, may be NULL.
    pub keep: *const *const c_char,
    /// How many names there are.
    pub keep_length: usize,
}

/// The torque of one sample after the other.
#[derive(Debug)]
#[allow(non_camel_case_types, reason = "the name in C")]
pub struct sgpr_predictor {
    inner: Predictor,
    /// At the last good sample, `[n]`.
    last_torque: Vec<f64>,
    spread: Option<Spread>,
    zero_when_refused: bool,
    refused: u64,
    /// Of the last sample, by the clock of the caller, s.
    last_time: Option<f64>,
}

/// How sure the last good torque is.
#[derive(Debug)]
struct Spread {
    /// `[n]`, as the novelty.
    deviation: Vec<f64>,
    novelty: Vec<f64>,
    /// Whether there was a sample.
    known: bool,
}

impl sgpr_predictor {
    fn check_joints(&self, joints: usize) -> Result<(), Failure> {
        let expected = self.inner.dof();
        let words = format_args!("joints: got {joints}, expected {expected}");
        if joints == expected { Ok(()) } else { Err(Failure::new(Code::WrongLength, &words)) }
    }

    /// Seconds since the last sample by the clock of the caller; none at the first.
    fn step_to(&self, time: f64) -> Result<Option<f64>, Failure> {
        if !time.is_finite() {
            return Err(Failure::new(
                Code::NotFinite,
                &format_args!("time: got {time}, expected a finite number"),
            ));
        }
        match self.last_time {
            Some(last) if time <= last => {
                let words = format_args!(
                    "time: got {time} s, expected more than {last} s, that of the last sample"
                );
                Err(Failure::new(Code::BadTime, &words))
            }
            last => Ok(last.map(|last| time - last)),
        }
    }

    fn torque(&mut self, when: When, [q, dq, ddq]: [&[f64]; 3]) -> Result<(), Failure> {
        let Self { inner, last_torque, spread, .. } = self;
        let Some(spread) = spread else {
            let tau = match when {
                When::Next => inner.try_torque(q, dq, ddq)?,
                When::After(step) => inner.torque_after(step, q, dq, ddq)?,
            };
            last_torque.copy_from_slice(tau);
            return Ok(());
        };
        let (tau, deviation) = match when {
            When::Next => inner.torque_and_deviation(q, dq, ddq)?,
            When::After(step) => inner.torque_and_deviation_after(step, q, dq, ddq)?,
        };
        last_torque.copy_from_slice(tau);
        spread.deviation.copy_from_slice(deviation);
        spread.novelty.copy_from_slice(inner.novelty());
        spread.known = true;
        Ok(())
    }

    /// There is no last sample.
    fn forget(&mut self) {
        self.last_torque.fill(0.0);
        self.last_time = None;
        if let Some(spread) = &mut self.spread {
            spread.known = false;
        }
    }

    fn spread(&self) -> Result<&Spread, Failure> {
        match &self.spread {
            None => {
                let words = "predictor: made without a standard deviation: set `deviation` of \
                     sgpr_options to 1";
                Err(Failure::new(Code::BadOption, &words))
            }
            Some(spread) if !spread.known => {
                Err(Failure::new(Code::NoSample, &"predictor: no good sample yet"))
            }
            Some(spread) => Ok(spread),
        }
    }
}

/// When a sample is.
#[derive(Clone, Copy)]
enum When {
    Next,
    After(f64),
}

/// `[n]` numbers behind a pointer.
///
/// # Safety
/// `values` is NULL or has `joints` numbers that nobody writes meanwhile.
unsafe fn array<'a>(name: &str, values: *const f64, joints: usize) -> Result<&'a [f64], Failure> {
    if values.is_null() {
        return Err(Failure::null(name));
    }
    // SAFETY: not null, and the caller says that there are so many.
    Ok(unsafe { std::slice::from_raw_parts(values, joints) })
}

/// Runs a call with a predictor.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
unsafe fn with(
    predictor: *mut sgpr_predictor,
    call: impl FnOnce(&mut sgpr_predictor) -> Result<(), Failure>,
) -> i32 {
    // SAFETY: NULL or valid, as the caller says.
    code(|| call(unsafe { predictor.as_mut() }.ok_or_else(|| Failure::null("predictor"))?))
}

/// The predictor of a model, with hidden states at rest at the first sample.
fn made(
    model: &sgpr_model,
    stream: &StreamOptions,
    deviation: bool,
) -> Result<Box<sgpr_predictor>, Failure> {
    let inner = model
        .inner
        .predictor_with(stream, &ResidualOptions::default().with_deviation(deviation))?;
    let zeros = || vec![0.0; inner.dof()];
    Ok(Box::new(sgpr_predictor {
        last_torque: zeros(),
        spread: deviation.then(|| Spread { deviation: zeros(), novelty: zeros(), known: false }),
        inner,
        zero_when_refused: false,
        refused: 0,
        last_time: None,
    }))
}

fn stream_options(rate_hz: f64, purpose: i32, keep: Vec<String>) -> Result<StreamOptions, Failure> {
    let purpose = match purpose {
        SGPR_FEED_FORWARD => Purpose::FeedForward,
        SGPR_EXPECTED_MEASUREMENT => Purpose::ExpectedMeasurement,
        found => {
            let words = format_args!(
                "purpose: got {found}, expected SGPR_FEED_FORWARD (0) or SGPR_EXPECTED_MEASUREMENT \
                 (1)"
            );
            return Err(Failure::new(Code::BadOption, &words));
        }
    };
    Ok(StreamOptions::default()
        .with_rate_hz((rate_hz != 0.0).then_some(rate_hz))
        .with_purpose(purpose)
        .with_keep(keep))
}

/// Makes a predictor of a model; hidden states start at rest at the first sample.
///
/// rate_hz: calls per second, 0 if not known; effects of time, delays and lags need it.
/// purpose: SGPR_FEED_FORWARD leaves out errors of the measurement and what was there for a while,
/// SGPR_EXPECTED_MEASUREMENT nothing.
///
/// # Safety
/// `model` is NULL or was made here; `predictor` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_new(
    model: *const sgpr_model,
    rate_hz: f64,
    purpose: i32,
    predictor: *mut *mut sgpr_predictor,
) -> i32 {
    let options =
        sgpr_options { rate_hz, purpose, deviation: 0, keep: std::ptr::null(), keep_length: 0 };
    // SAFETY: as the caller says; no name is given.
    unsafe { sgpr_predictor_new_with(model, &raw const options, predictor) }
}

/// Makes a predictor of a model with all options; SGPR_BAD_OPTION if it is to say how sure its
/// torques are and the model has not learned that (sgpr_model_learned).
///
/// # Safety
/// `model` is NULL or was made here; `options` is NULL or has as many names as it says; `predictor`
/// is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_new_with(
    model: *const sgpr_model,
    options: *const sgpr_options,
    predictor: *mut *mut sgpr_predictor,
) -> i32 {
    code(|| {
        // SAFETY: NULL or valid, as the caller says.
        let model = unsafe { model.as_ref() }.ok_or_else(|| Failure::null("model"))?;
        // SAFETY: NULL or valid, as the caller says.
        let options = unsafe { options.as_ref() }.ok_or_else(|| Failure::null("options"))?;
        if predictor.is_null() {
            return Err(Failure::null("predictor"));
        }
        let deviation = match options.deviation {
            0 => false,
            1 => true,
            found => {
                let words = format_args!("deviation: got {found}, expected 0 or 1");
                return Err(Failure::new(Code::BadOption, &words));
            }
        };
        // SAFETY: as the caller says.
        let keep = unsafe { names(options) }?;
        let made =
            made(model, &stream_options(options.rate_hz, options.purpose, keep)?, deviation)?;
        // SAFETY: not null, and the caller says that it may be written.
        unsafe { *predictor = Box::into_raw(made) };
        Ok(())
    })
}

/// The names of effects to keep.
///
/// # Safety
/// There are as many as the options say, C strings or NULL.
unsafe fn names(options: &sgpr_options) -> Result<Vec<String>, Failure> {
    let sgpr_options { keep, keep_length, .. } = *options;
    if keep_length == 0 {
        return Ok(vec![]);
    }
    if keep.is_null() {
        return Err(Failure::null("keep"));
    }
    if keep_length > MOST_NAMES {
        let words = format_args!("keep_length: got {keep_length}, expected at most {MOST_NAMES}");
        return Err(Failure::new(Code::WrongLength, &words));
    }
    // SAFETY: not null, and the caller says that there are so many.
    let names = unsafe { std::slice::from_raw_parts(keep, keep_length) };
    let own = |name: &*const c_char| {
        if name.is_null() {
            return Err(Failure::null("keep: a name"));
        }
        // SAFETY: not null, and the caller says that it ends in a zero.
        let name = unsafe { CStr::from_ptr(*name) };
        Ok(name
            .to_str()
            .map_err(|_| Failure::new(Code::BadOption, &"keep: a name is not UTF-8"))?
            .into())
    };
    names.iter().map(own).collect()
}

/// Frees a predictor.
///
/// # Safety
/// `predictor` is NULL or was made here, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_free(predictor: *mut sgpr_predictor) {
    if !predictor.is_null() {
        // SAFETY: made by `Box::into_raw`, and given back once.
        drop(unsafe { Box::from_raw(predictor) });
    }
}

/// Number of joints; 0 for NULL.
///
/// # Safety
/// `predictor` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_joints(predictor: *const sgpr_predictor) -> usize {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { predictor.as_ref() }.map_or(0, |predictor| predictor.inner.dof())
}

/// Samples refused since the predictor was made; 0 for NULL.
///
/// # Safety
/// `predictor` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_refused(predictor: *const sgpr_predictor) -> u64 {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { predictor.as_ref() }.map_or(0, |predictor| predictor.refused)
}

/// What the torque is when a sample is refused: SGPR_LAST_TORQUE (at first) or SGPR_ZERO_TORQUE.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_set_fallback(
    predictor: *mut sgpr_predictor,
    fallback: i32,
) -> i32 {
    let set = |predictor: &mut sgpr_predictor| {
        if ![SGPR_LAST_TORQUE, SGPR_ZERO_TORQUE].contains(&fallback) {
            let words = format_args!(
                "fallback: got {fallback}, expected SGPR_LAST_TORQUE (0) or SGPR_ZERO_TORQUE (1)"
            );
            return Err(Failure::new(Code::BadOption, &words));
        }
        predictor.zero_when_refused = fallback == SGPR_ZERO_TORQUE;
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, set) }
}

/// Forgets all samples: hidden states start at rest at the next one, the clock is at zero.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_reset(predictor: *mut sgpr_predictor) -> i32 {
    let reset = |predictor: &mut sgpr_predictor| {
        predictor.inner.reset();
        predictor.forget();
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, reset) }
}

/// Forgets all samples: hidden states are those after a long motion at speed dq to q, the clock is
/// at zero.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or
/// have `joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_reset_at(
    predictor: *mut sgpr_predictor,
    q: *const f64,
    dq: *const f64,
    joints: usize,
) -> i32 {
    let reset = |predictor: &mut sgpr_predictor| {
        predictor.check_joints(joints)?;
        // SAFETY: as the caller says, of the length that was checked.
        let (q, dq) = unsafe { (array("q", q, joints)?, array("dq", dq, joints)?) };
        predictor.inner.reset_at(q, dq)?;
        predictor.forget();
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, reset) }
}

/// Sets the time of the session at the next sample, s.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_set_time(predictor: *mut sgpr_predictor, time: f64) -> i32 {
    // SAFETY: as the caller says.
    unsafe { with(predictor, |predictor| Ok(predictor.inner.set_time(time)?)) }
}

/// Sets the temperature of each joint, degrees Celsius.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
/// or has `joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_set_temperature(
    predictor: *mut sgpr_predictor,
    celsius: *const f64,
    joints: usize,
) -> i32 {
    let set = |predictor: &mut sgpr_predictor| {
        predictor.check_joints(joints)?;
        // SAFETY: as the caller says, of the length that was checked.
        let celsius = unsafe { array("celsius", celsius, joints)? };
        Ok(predictor.inner.set_temperature(celsius)?)
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, set) }
}

/// Arrays of a sample, and where its torque goes.
#[derive(Clone, Copy)]
struct Sample {
    q: *const f64,
    dq: *const f64,
    ddq: *const f64,
    tau: *mut f64,
    joints: usize,
}

/// # Safety
/// As [`sgpr_predictor_torque`].
unsafe fn torque(
    predictor: *mut sgpr_predictor,
    sample: Sample,
    when: impl FnOnce(&mut sgpr_predictor) -> Result<When, Failure>,
) -> i32 {
    let call = |predictor: &mut sgpr_predictor| {
        let Sample { q, dq, ddq, tau, joints } = sample;
        predictor.check_joints(joints)?;
        if tau.is_null() {
            return Err(Failure::null("tau"));
        }
        // SAFETY: as the caller says, of the length that was checked.
        let motion = unsafe {
            [array("q", q, joints)?, array("dq", dq, joints)?, array("ddq", ddq, joints)?]
        };
        let done = when(predictor).and_then(|when| predictor.torque(when, motion));
        let refused = done.is_err_and(Failure::is_of_sample);
        predictor.refused += u64::from(refused);
        let (from, zero) = (predictor.last_torque.as_ptr(), refused && predictor.zero_when_refused);
        if done.is_ok() || refused {
            // SAFETY: not null, of the length that was checked; the motion is not read any more, so
            // that the caller may give one of its arrays; the own array is nobody else's.
            unsafe {
                if zero {
                    tau.write_bytes(0, joints)
                } else {
                    tau.copy_from_nonoverlapping(from, joints)
                }
            }
        }
        done
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, call) }
}

/// Torque at the next sample, one period after the last. If a number is not finite or a temperature
/// is missing, the sample is refused and counted, tau is as the fallback says, and hidden states
/// stay as they are.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or
/// have `joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_torque(
    predictor: *mut sgpr_predictor,
    q: *const f64,
    dq: *const f64,
    ddq: *const f64,
    tau: *mut f64,
    joints: usize,
) -> i32 {
    // SAFETY: as the caller says.
    unsafe { torque(predictor, Sample { q, dq, ddq, tau, joints }, |_| Ok(When::Next)) }
}

/// Torque `step` seconds after the last sample: for irregular calls and pauses.
///
/// # Safety
/// As [`sgpr_predictor_torque`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_torque_after(
    predictor: *mut sgpr_predictor,
    step: f64,
    q: *const f64,
    dq: *const f64,
    ddq: *const f64,
    tau: *mut f64,
    joints: usize,
) -> i32 {
    // SAFETY: as the caller says.
    unsafe { torque(predictor, Sample { q, dq, ddq, tau, joints }, |_| Ok(When::After(step))) }
}

/// Torque at a time of a clock, s, which must be later than at the sample before. The first sample
/// sets the clock.
///
/// # Safety
/// As [`sgpr_predictor_torque`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_torque_at(
    predictor: *mut sgpr_predictor,
    time: f64,
    q: *const f64,
    dq: *const f64,
    ddq: *const f64,
    tau: *mut f64,
    joints: usize,
) -> i32 {
    let when = |predictor: &mut sgpr_predictor| {
        let step = predictor.step_to(time)?;
        Ok(step.map_or(When::Next, When::After))
    };
    // SAFETY: as the caller says.
    let code = unsafe { torque(predictor, Sample { q, dq, ddq, tau, joints }, when) };
    if code == crate::failure::SGPR_OK {
        // SAFETY: the call has succeeded, so that it is valid.
        unsafe { (*predictor).last_time = Some(time) };
    }
    code
}

/// Copies `[n]` numbers that say how sure the last torque is.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; `to` is NULL or has
/// `joints` numbers.
unsafe fn copy_spread(
    predictor: *const sgpr_predictor,
    (name, to): (&str, *mut f64),
    joints: usize,
    part: impl FnOnce(&Spread) -> &[f64],
) -> i32 {
    code(|| {
        // SAFETY: NULL or valid, as the caller says.
        let predictor = unsafe { predictor.as_ref() }.ok_or_else(|| Failure::null("predictor"))?;
        predictor.check_joints(joints)?;
        if to.is_null() {
            return Err(Failure::null(name));
        }
        let from = part(predictor.spread()?);
        // SAFETY: not null, of the length that was checked; the own array is nobody else's.
        unsafe { to.copy_from_nonoverlapping(from.as_ptr(), joints) };
        Ok(())
    })
}

/// Standard deviation of the measured torque about the last good one, `[n]`, N m (N): of the
/// Gaussian processes, of noise, and of what uncertain parameters bring. Of a predictor made with
/// `deviation`.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
/// or has `joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_deviation(
    predictor: *const sgpr_predictor,
    deviation: *mut f64,
    joints: usize,
) -> i32 {
    // SAFETY: as the caller says.
    unsafe { copy_spread(predictor, ("deviation", deviation), joints, |spread| &spread.deviation) }
}

/// Share of the variance of each joint's process that its logs have not explained at the last good
/// sample, `[n]`: from 0 at a point of the logs to 1 far from all, 0 for a joint without a process.
/// Above 0.95 the torque is that of the physics. Of a predictor made with `deviation`.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL
/// or has `joints` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_novelty(
    predictor: *const sgpr_predictor,
    novelty: *mut f64,
    joints: usize,
) -> i32 {
    // SAFETY: as the caller says.
    unsafe { copy_spread(predictor, ("novelty", novelty), joints, |spread| &spread.novelty) }
}
