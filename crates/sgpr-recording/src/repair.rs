use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use derive_setters::Setters;

use super::inspect::{is_finite_row, is_turn, repeated_samples, stray_samples, usual_change};
use super::resample::{at_stamps, resample};
use super::{GAP_FACTOR, Recording, RecordingError, seconds};

/// A shorter stretch holds no motion: derivatives need a few samples on either side.
const SHORTEST_STRETCH: usize = 10;
/// More new samples than this per old one are a slip of the pen.
const MOST_NEW_SAMPLES: f64 = 1000.0;

/// What to change about a recording. The default changes nothing.
///
/// The steps are done in the order of the fields.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Repair {
    /// Keep this part only, s since the first sample, both ends included.
    pub trim: Option<RangeInclusive<f64>>,
    /// Bring the samples into the order of their stamps.
    pub sort: bool,
    /// Of samples with the same stamp, keep the first.
    pub drop_duplicates: bool,
    /// Remove samples with a position, velocity or torque that is not finite.
    pub drop_not_finite: bool,
    /// Put what lies between its neighbours in the place of a sample with a value that leaves them
    /// and comes back, see [`IssueKind::StraySample`](super::IssueKind::StraySample); without those
    /// at the ends.
    pub replace_strays: bool,
    /// Remove samples that repeat the one before while the arm moves.
    pub drop_repeated: bool,
    /// Take back jumps of positions by a full turn, of joints whose position is wrapped to one.
    pub unwrap: bool,
    /// Cut where the time makes a step longer than this, s.
    pub split_gaps: Option<f64>,
    /// Bring the samples to equal steps. Cuts at gaps, see [`GAP_FACTOR`], if `split_gaps` is not
    /// given.
    pub resample: Option<Resample>,
}

/// The rate to resample to.
///
/// The steps are whole nanoseconds. Positions are interpolated by cubics (Catmull-Rom slopes for
/// unequal steps), all else linearly. Nothing is filtered: before a much lower rate, filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resample {
    /// One over the median step.
    MedianRate,
    /// Hz
    Hz(f64),
}

/// Changes a recording as asked, and nothing else. Returns the stretches that result (several if it
/// was cut) and a sentence for each thing done.
///
/// # Errors
/// If an option has a value that cannot be, if no sample is left, or if the time does not increase
/// where it must (for `replace_strays`, `split_gaps` and `resample`).
///
/// # Examples
/// ```
/// use sgpr_recording::{Recording, Repair, Resample, repair};
/// # let time = vec![0, 2_000_000, 1_000_000, 3_000_000];
/// # let recording = Recording::new("log", vec!["a".into()], time, vec![0.0, 2.0, 1.0, 3.0], None, None, vec![])?;
/// let request = Repair::default().with_sort(true).with_resample(Some(Resample::Hz(500.0)));
/// let (parts, actions) = repair(&recording, &request)?;
/// assert_eq!(parts[0].position(), [0.0, 2.0]);
/// assert_eq!(actions.len(), 2);
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn repair(
    recording: &Recording,
    request: &Repair,
) -> Result<(Vec<Recording>, Vec<String>), RecordingError> {
    request.check()?;
    let mut work = RepairWork { recording: recording.apart(), actions: Vec::new() };
    if let Some(window) = &request.trim {
        let time = recording.time_seconds();
        let what = format!("outside {} to {} s", window.start(), window.end());
        work.drop(&what, |sample| !window.contains(&time[sample]))?;
    }
    if request.sort {
        work.sort();
    }
    if request.drop_duplicates {
        let time = work.recording.time().to_vec();
        work.drop("with the stamp of the one before", |sample| {
            sample > 0 && time[sample] == time[sample - 1]
        })?;
    }
    if request.drop_not_finite {
        let log = work.recording.clone();
        work.drop("with values that are not finite", |sample| !is_finite_row(&log, sample))?;
    }
    if request.replace_strays {
        require_increasing_time(&work.recording)?;
        work.replace_strays();
    }
    if request.drop_repeated {
        let repeated = repeated_samples(&work.recording);
        work.drop("that repeat the one before", |sample| repeated.binary_search(&sample).is_ok())?;
    }
    if request.unwrap {
        work.unwrap();
    }
    if request.split_gaps.is_none() && request.resample.is_none() {
        return Ok((vec![work.recording], work.actions));
    }
    require_increasing_time(&work.recording)?;
    let parts = work.split(request.split_gaps);
    Ok(match request.resample {
        Some(rate) => (work.resample(parts, rate)?, work.actions),
        None => (parts, work.actions),
    })
}

impl Repair {
    fn check(&self) -> Result<(), RecordingError> {
        let invalid = |option, value: f64, expected| {
            Err(RecordingError::InvalidOption { option, value: value.to_string(), expected })
        };
        match (self.split_gaps, self.resample) {
            (Some(gap), _) if !(gap > 0.0 && gap.is_finite()) => {
                invalid("split_gaps", gap, "the length of a step in seconds, greater than zero")
            }
            (_, Some(Resample::Hz(rate))) if !(rate > 0.0 && rate <= 1e9) => {
                invalid("resample", rate, "a rate in Hz, greater than zero and at most 1e9")
            }
            _ => Ok(()),
        }
    }
}

fn require_increasing_time(recording: &Recording) -> Result<(), RecordingError> {
    let time = recording.time();
    match time.windows(2).position(|pair| pair[1] <= pair[0]) {
        None => Ok(()),
        Some(before) => Err(RecordingError::UnsortedTime {
            recording: recording.source().into(),
            sample: before + 1,
            seconds: seconds(time[0], time[before + 1]),
        }),
    }
}

/// A recording under repair, with what was done.
struct RepairWork {
    recording: Recording,
    actions: Vec<String>,
}

impl RepairWork {
    fn note(&mut self, action: String) {
        self.actions.push(format!("{}: {action}", self.recording.source()));
    }

    /// Removes the samples for which `is_bad` holds.
    fn drop(&mut self, what: &str, is_bad: impl Fn(usize) -> bool) -> Result<(), RecordingError> {
        let all = self.recording.len();
        let keep: Vec<usize> = (0..all).filter(|&sample| !is_bad(sample)).collect();
        let action = format!("dropped {} of {all} samples {what}", all - keep.len());
        if keep.is_empty() {
            return Err(RecordingError::NothingLeft {
                recording: self.recording.source().into(),
                action,
            });
        }
        if keep.len() < all {
            self.recording = self.recording.pick(keep.iter().copied());
        }
        self.note(action);
        Ok(())
    }

    fn sort(&mut self) {
        let time = self.recording.time();
        let mut order: Vec<usize> = (0..time.len()).collect();
        order.sort_by_key(|&sample| time[sample]);
        let moved = order.iter().enumerate().filter(|(place, sample)| place != *sample).count();
        if moved > 0 {
            self.recording = self.recording.pick(order.iter().copied());
        }
        self.note(format!("sorted by time, {moved} of {} samples moved", self.recording.len()));
    }

    fn replace_strays(&mut self) {
        let all = self.recording.len();
        let strays = stray_samples(&self.recording);
        let kept: Vec<usize> =
            (0..all).filter(|sample| strays.binary_search(sample).is_err()).collect();
        if let ([first, .., last], false) = (&kept[..], strays.is_empty()) {
            let stamps = self.recording.time()[*first..=*last].to_vec();
            self.recording = at_stamps(&self.recording.pick(kept.iter().copied()), stamps);
        }
        let dropped = all - self.recording.len();
        let at_the_ends = if dropped > 0 {
            format!(", and dropped {dropped} at the ends")
        } else {
            String::new()
        };
        let replaced = strays.len() - dropped;
        self.note(format!(
            "replaced {replaced} of {all} samples that stray by what lies between the \
             others{at_the_ends}"
        ));
    }

    fn unwrap(&mut self) {
        let n = self.recording.dof();
        let mut position = self.recording.position().to_vec();
        let time = self.recording.time_seconds();
        let mut jumps = 0;
        for joint in 0..n {
            let logged: Vec<f64> = position.iter().skip(joint).step_by(n).copied().collect();
            // Across positions that are no numbers, too.
            let numbers: Vec<usize> =
                (0..logged.len()).filter(|&sample| !logged[sample].is_nan()).collect();
            let change = |pair: &[usize]| logged[pair[1]] - logged[pair[0]];
            let changes: Vec<f64> = numbers.windows(2).map(|pair| change(pair).abs()).collect();
            let usual = usual_change(&changes);
            let mut offset = 0.0;
            for pair in numbers.windows(2) {
                if is_turn(change(pair), time[pair[1]] - time[pair[0]], usual) {
                    offset -= TAU.copysign(change(pair));
                    jumps += 1;
                }
                position[pair[1] * n + joint] += offset;
            }
        }
        if jumps > 0 {
            self.recording.position = position.into();
        }
        self.note(format!("took back {jumps} jumps by a full turn"));
    }

    fn split(&mut self, gap: Option<f64>) -> Vec<Recording> {
        let period = self.recording.median_period();
        let longest = gap.unwrap_or(GAP_FACTOR * period);
        let parts = self.recording.split_at_steps(longest);
        let cuts = parts.len() - 1;
        if gap.is_some() || cuts > 0 {
            let lengths: Vec<String> = parts.iter().map(|part| part.len().to_string()).collect();
            let lengths = lengths.join(", ");
            self.note(format!(
                "cut at {cuts} steps longer than {longest:.6} s into {lengths} samples"
            ));
        }
        self.without_crumbs(parts)
    }

    /// Without stretches that are too short to be differentiated, such as a single sample that
    /// strayed before the log began, if others remain.
    fn without_crumbs(&mut self, parts: Vec<Recording>) -> Vec<Recording> {
        let (long, short): (Vec<Recording>, Vec<Recording>) =
            parts.into_iter().partition(|part| part.len() >= SHORTEST_STRETCH);
        if long.is_empty() || short.is_empty() {
            return if long.is_empty() { short } else { long };
        }
        let samples: usize = short.iter().map(Recording::len).sum();
        self.note(format!(
            "left out {samples} samples in {} stretches of fewer than {SHORTEST_STRETCH}",
            short.len()
        ));
        long
    }

    fn resample(
        &mut self,
        parts: Vec<Recording>,
        rate: Resample,
    ) -> Result<Vec<Recording>, RecordingError> {
        let median = self.recording.median_period();
        let wanted = match rate {
            Resample::MedianRate => median,
            Resample::Hz(rate) => 1.0 / rate,
        };
        if wanted.is_nan() {
            let (recording, action) =
                (self.recording.source().into(), "resampling of a single sample".into());
            return Err(RecordingError::NothingLeft { recording, action });
        }
        let old = self.recording.len();
        let expected = parts.iter().map(Recording::duration).sum::<f64>() / wanted;
        if expected > MOST_NEW_SAMPLES * old as f64 {
            return Err(RecordingError::InvalidOption {
                option: "resample",
                value: format!("{} Hz", 1.0 / wanted),
                expected: "a rate that makes at most 1000 samples of each one; or cut the gaps \
                     with `split_gaps`",
            });
        }
        let period = ((wanted * 1e9).round() as u64).max(1);
        let new: Vec<Recording> = parts.iter().map(|part| resample(part, period)).collect();
        let samples = new.iter().map(Recording::len).sum::<usize>();
        let mut action =
            format!("resampled from {old} to {samples} samples at {:.6} Hz", 1e9 / period as f64);
        if wanted > 1.1 * median {
            action += &format!(
                "; the log had {:.6} Hz, and what lies above half the new rate now shows as lower \
                 frequencies unless it was filtered away",
                1.0 / median
            );
        }
        self.note(action);
        Ok(new)
    }
}
