//! Predictors: one sample after the other.

use sgpr_predict::stream::{Predictor, Purpose, StreamOptions};

use crate::failure::{Code, Failure, code};
use crate::model::sgpr_model;

/// `sgpr_predictor` of the header.
#[derive(Debug)]
#[allow(non_camel_case_types, reason = "the name in C")]
pub struct sgpr_predictor {
    inner: Predictor,
    /// At the last good sample, `[n]`.
    last_torque: Vec<f64>,
    zero_when_refused: bool,
    refused: u64,
    /// Of the last sample, by the clock of the caller, s.
    last_time: Option<f64>,
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
            return Err(Failure::new(Code::NotFinite, &format_args!("time: got {time}, expected a finite number")));
        }
        match self.last_time {
            Some(last) if time <= last => {
                let words = format_args!("time: got {time} s, expected more than {last} s, that of the last sample");
                Err(Failure::new(Code::BadTime, &words))
            }
            last => Ok(last.map(|last| time - last)),
        }
    }

    fn torque(&mut self, when: When, [q, dq, ddq]: [&[f64]; 3]) -> Result<(), Failure> {
        let Self { inner, last_torque, .. } = self;
        let tau = match when {
            When::Next => inner.try_torque(q, dq, ddq)?,
            When::After(step) => inner.torque_after(step, q, dq, ddq)?,
        };
        last_torque.copy_from_slice(tau);
        Ok(())
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
unsafe fn with(predictor: *mut sgpr_predictor, call: impl FnOnce(&mut sgpr_predictor) -> Result<(), Failure>) -> i32 {
    // SAFETY: NULL or valid, as the caller says.
    code(|| call(unsafe { predictor.as_mut() }.ok_or_else(|| Failure::null("predictor"))?))
}

/// Makes a predictor.
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
    code(|| {
        // SAFETY: NULL or valid, as the caller says.
        let model = unsafe { model.as_ref() }.ok_or_else(|| Failure::null("model"))?;
        if predictor.is_null() {
            return Err(Failure::null("predictor"));
        }
        let purpose = match purpose {
            0 => Purpose::FeedForward,
            1 => Purpose::ExpectedMeasurement,
            found => {
                let words = format_args!(
                    "purpose: got {found}, expected SGPR_FEED_FORWARD (0) or SGPR_EXPECTED_MEASUREMENT (1)"
                );
                return Err(Failure::new(Code::BadOption, &words));
            }
        };
        let rate_hz = (rate_hz != 0.0).then_some(rate_hz);
        let inner = model.inner.predictor(&StreamOptions { rate_hz, purpose, keep: vec![] })?;
        let made = sgpr_predictor {
            last_torque: vec![0.0; inner.dof()],
            inner,
            zero_when_refused: false,
            refused: 0,
            last_time: None,
        };
        // SAFETY: not null, and the caller says that it may be written.
        unsafe { *predictor = Box::into_raw(Box::new(made)) };
        Ok(())
    })
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

/// Number of joints.
///
/// # Safety
/// `predictor` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_joints(predictor: *const sgpr_predictor) -> usize {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { predictor.as_ref() }.map_or(0, |predictor| predictor.inner.dof())
}

/// Samples that were refused.
///
/// # Safety
/// `predictor` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_refused(predictor: *const sgpr_predictor) -> u64 {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { predictor.as_ref() }.map_or(0, |predictor| predictor.refused)
}

/// What the torque is when a sample is refused.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_set_fallback(predictor: *mut sgpr_predictor, fallback: i32) -> i32 {
    let set = |predictor: &mut sgpr_predictor| {
        if !(0..=1).contains(&fallback) {
            let words = format_args!("fallback: got {fallback}, expected SGPR_LAST_TORQUE (0) or SGPR_ZERO_TORQUE (1)");
            return Err(Failure::new(Code::BadOption, &words));
        }
        predictor.zero_when_refused = fallback == 1;
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, set) }
}

/// Forgets all samples.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_reset(predictor: *mut sgpr_predictor) -> i32 {
    let reset = |predictor: &mut sgpr_predictor| {
        predictor.inner.reset();
        predictor.last_torque.fill(0.0);
        predictor.last_time = None;
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, reset) }
}

/// Forgets all samples; hidden states are those of a motion.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or have `joints` numbers.
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
        predictor.last_torque.fill(0.0);
        predictor.last_time = None;
        Ok(())
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, reset) }
}

/// Sets the clock.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_predictor_set_time(predictor: *mut sgpr_predictor, time: f64) -> i32 {
    // SAFETY: as the caller says.
    unsafe { with(predictor, |predictor| Ok(predictor.inner.set_time(time)?)) }
}

/// Sets temperatures.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; the array is NULL or has `joints` numbers.
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
        let motion = unsafe { [array("q", q, joints)?, array("dq", dq, joints)?, array("ddq", ddq, joints)?] };
        let done = when(predictor).and_then(|when| predictor.torque(when, motion));
        let refused = done.is_err_and(Failure::is_of_sample);
        predictor.refused += u64::from(refused);
        let (from, zero) = (predictor.last_torque.as_ptr(), refused && predictor.zero_when_refused);
        if done.is_ok() || refused {
            // SAFETY: not null, of the length that was checked; the motion is not read any more, so that the caller may give
            // one of its arrays; the own array is nobody else's.
            unsafe { if zero { tau.write_bytes(0, joints) } else { tau.copy_from_nonoverlapping(from, joints) } }
        }
        done
    };
    // SAFETY: as the caller says.
    unsafe { with(predictor, call) }
}

/// Torque one period after the last sample.
///
/// # Safety
/// `predictor` is NULL or was made here, and no other thread uses it meanwhile; arrays are NULL or have `joints` numbers.
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

/// Torque `step` seconds after the last sample.
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

/// Torque at a time of the caller's clock.
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
    if code == crate::failure::OK {
        // SAFETY: the call has succeeded, so that it is valid.
        unsafe { (*predictor).last_time = Some(time) };
    }
    code
}
