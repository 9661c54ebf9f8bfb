//! Issues of the values, sample by sample.

use super::{Issue, IssueKind, Severity, counted, percent};
use crate::names::quoted;
use crate::statistics::first_place;
use crate::{Implausible, Recording, seconds, statistics};
use sgpr_predict::internal::rms;

/// A joint that moves less than this, rad (m), stands still.
pub(super) const STILL_RANGE: f64 = 0.002;
/// Samples on each side over which a motion is seen.
const MOTION_WINDOW: usize = 5;
/// A sample counts as moving from this share of a joint's RMS speed on.
const MOVING_SHARE: f64 = 0.1;
/// As many samples in a row at the largest torque are a flat top.
const FLAT_TOP: usize = 5;
/// A torque that keeps its value for so long, s, ...
const FROZEN: f64 = 0.5;
/// ... while the joint moves by this share of its range, is not measured.
const FROZEN_SHARE: f64 = 0.1;
/// Numbers that 16 bits can hold ...
const OF_16_BITS: f64 = 65_536.0;
/// ... and the share of them that numbers which overflow pass, and jump across.
const NEAR_THE_ENDS: [f64; 2] = [0.95, 0.9];

pub(super) fn issues(recording: &Recording) -> Vec<Issue> {
    let mut issues = errors(recording);
    issues.extend(still_joints(recording));
    issues.extend(clipped(recording));
    issues.extend(frozen(recording));
    issues.extend(encoder_steps(recording));
    issues
}

/// Those of them that can be errors.
pub(super) fn errors(recording: &Recording) -> Vec<Issue> {
    let mut issues = not_finite(recording);
    issues.extend(implausible(recording));
    issues.extend(repeated(recording));
    issues.extend(overflows(recording));
    issues
}

/// The values of one joint in a row-major array.
pub(super) fn column(values: &[f64], n: usize, joint: usize) -> impl Iterator<Item = f64> + '_ {
    values.iter().skip(joint).step_by(n).copied()
}

/// Whether all joint values of a sample are finite.
pub(crate) fn is_finite_row(recording: &Recording, sample: usize) -> bool {
    let n = recording.dof();
    recording.arrays().all(|(_, values)| {
        values[sample * n..(sample + 1) * n].iter().all(|value| value.is_finite())
    })
}

fn not_finite(recording: &Recording) -> Vec<Issue> {
    let n = recording.dof();
    let joints = recording.joint_names().iter().enumerate();
    let of_joints = joints.flat_map(|(joint, name)| {
        recording.arrays().map(move |(array, values)| {
            // Models are identified from positions and torques; logged velocities are only compared
            // with them.
            let severity = if array == "velocity" { Severity::Warning } else { Severity::Error };
            (format!("{name}_{array}"), joint, n, values, severity)
        })
    });
    let channels = recording.channels().iter();
    let of_channels =
        channels.map(|channel| (channel.name.clone(), 0, 1, &channel.values[..], Severity::Note));
    let is_bad = |values: &[f64]| first_place(values, |value| !value.is_finite()).is_some();
    if !recording.arrays().any(|(_, values)| is_bad(values))
        && !recording.channels().iter().any(|channel| is_bad(&channel.values))
    {
        return vec![];
    }
    let issue = |(name, first, step, values, severity): (
        String,
        usize,
        usize,
        &[f64],
        Severity,
    )| {
        let bad = |(_, value): &(usize, f64)| !value.is_finite();
        let mut found = column(values, step, first).enumerate().filter(bad);
        let at = found.next()?.0;
        let count = 1 + found.count();
        Some(Issue {
            kind: IssueKind::NotFinite,
            severity,
            time: Some(seconds(recording.time()[0], recording.time()[at])),
            message: format!(
                "`{name}` is missing or not finite in {} ({}), first in sample {at}: drop these \
                 samples{}",
                counted(count, "sample"),
                percent(count, recording.len()),
                if severity == Severity::Note { "" } else { " (repair: drop_not_finite)" },
            ),
            channel: Some(name),
            count,
        })
    };
    of_joints.chain(of_channels).filter_map(issue).collect()
}

/// A value that no arm makes.
fn implausible(recording: &Recording) -> Option<Issue> {
    let Implausible { quantity, joint, seconds, value, expected } = recording.implausible()?;
    let name = format!("{}_{quantity}", recording.joint_names()[joint]);
    Some(Issue {
        kind: IssueKind::Implausible,
        severity: Severity::Error,
        time: Some(seconds),
        message: format!("`{name}` is {value:.3e} {seconds:.3} s after the start; {expected}"),
        channel: Some(name),
        count: 1,
    })
}

/// Samples that repeat all values of the one before while the arm moves, in increasing order.
pub(crate) fn repeated_samples(recording: &Recording) -> Vec<usize> {
    let n = recording.dof();
    let same_channel = |values: &[f64], sample: usize| {
        let (before, now) = (values[sample - 1], values[sample]);
        before == now || before.is_nan() && now.is_nan()
    };
    let same = |sample: usize| {
        recording
            .arrays()
            .all(|(_, values)| values[(sample - 1) * n..][..n] == values[sample * n..][..n])
            && recording.channels().iter().all(|channel| same_channel(&channel.values, sample))
    };
    // Nearly every sample differs in the first number.
    let position = recording.position();
    let begins_alike =
        |sample: &usize| n == 0 || position[(sample - 1) * n] == position[sample * n];
    let candidates: Vec<usize> =
        (1..recording.len()).filter(begins_alike).filter(|&sample| same(sample)).collect();
    if candidates.is_empty() {
        return candidates;
    }
    let motion = MovingRows::new(recording);
    candidates.into_iter().filter(|&sample| motion.is_moving(sample)).collect()
}

fn repeated(recording: &Recording) -> Option<Issue> {
    let found = repeated_samples(recording);
    let first = *found.first()?;
    let share = found.len() as f64 / recording.len() as f64;
    Some(Issue {
        kind: IssueKind::RepeatedSamples,
        severity: match share {
            _ if share > 0.5 => Severity::Error,
            _ if share > 0.001 => Severity::Warning,
            _ => Severity::Note,
        },
        time: Some(seconds(recording.time()[0], recording.time()[first])),
        channel: None,
        count: found.len(),
        message: format!(
            "{} ({}) {} all values of the one before under a new stamp while the arm moves: drop \
             them before differentiating (repair: drop_repeated)",
            counted(found.len(), "sample"),
            percent(found.len(), recording.len()),
            if found.len() == 1 { "repeats" } else { "repeat" },
        ),
    })
}

/// Where the arm moves.
struct MovingRows<'a> {
    recording: &'a Recording,
    /// RMS change over the window, per joint; infinite for joints that stand still.
    usual: Vec<f64>,
}

impl<'a> MovingRows<'a> {
    fn new(recording: &'a Recording) -> Self {
        let mut motion = Self { recording, usual: Vec::new() };
        let usual = |joint| {
            let changes = (0..recording.len())
                .map(|sample| motion.change(sample, sample + MOTION_WINDOW, joint));
            let finite: Vec<f64> = changes.filter(|change| change.is_finite()).collect();
            if is_still(recording, joint) { f64::INFINITY } else { rms(&finite) }
        };
        motion.usual = (0..recording.dof()).map(usual).collect();
        motion
    }

    /// Change of a position between two samples.
    fn change(&self, from: usize, to: usize, joint: usize) -> f64 {
        let (n, position) = (self.recording.dof(), self.recording.position());
        (position[to.min(self.recording.len() - 1) * n + joint] - position[from * n + joint]).abs()
    }

    /// Whether some joint moves both before and after the sample.
    fn is_moving(&self, sample: usize) -> bool {
        let (from, to) = (sample.saturating_sub(MOTION_WINDOW), sample + MOTION_WINDOW);
        self.usual.iter().enumerate().any(|(joint, usual)| {
            let changes = [self.change(from, sample, joint), self.change(sample, to, joint)];
            changes.iter().all(|change| *change > MOVING_SHARE * usual)
        })
    }
}

/// Whether a joint stands still, as far as an encoder can tell.
pub fn is_still(recording: &Recording, joint: usize) -> bool {
    let range = statistics::range(column(recording.position(), recording.dof(), joint));
    range.is_some_and(is_still_range)
}

/// Whether a joint with positions in this range stands still.
pub(super) fn is_still_range([low, high]: [f64; 2]) -> bool {
    high - low < STILL_RANGE
}

fn still_joints(recording: &Recording) -> Option<Issue> {
    let n = recording.dof();
    let joints = recording.joint_names().iter().enumerate();
    let still: Vec<String> = joints
        .filter(|(joint, _)| is_still(recording, *joint))
        .map(|(_, name)| name.clone())
        .collect();
    if still.is_empty() || recording.len() < 2 {
        return None;
    }
    let message = if still.len() == n {
        format!("the arm stands still: no joint moves more than {STILL_RANGE} rad (m)")
    } else {
        format!(
            "{} of {n} joints {} less than {STILL_RANGE} rad (m): {}; what depends on {} motion \
             cannot be identified from this log",
            still.len(),
            if still.len() == 1 { "moves" } else { "move" },
            quoted(&still),
            if still.len() == 1 { "its" } else { "their" },
        )
    };
    let (kind, severity, count) = (IssueKind::StillJoint, Severity::Warning, still.len());
    let channel = (count == 1).then(|| format!("{}_position", still[0]));
    Some(Issue { kind, severity, time: None, channel, count, message })
}

/// Torques that stay at their extreme while the joint moves on.
fn clipped(recording: &Recording) -> Vec<Issue> {
    let Some(torque) = recording.torque() else { return Vec::new() };
    let n = recording.dof();
    let of_joint = |joint: usize| {
        let tau: Vec<f64> = column(torque, n, joint).collect();
        let q: Vec<f64> = column(recording.position(), n, joint).collect();
        let [low, high] =
            statistics::range(tau.iter().copied()).filter(|[low, high]| low < high)?;
        let runs = flat_tops(&tau, &q, low).into_iter().chain(flat_tops(&tau, &q, high));
        let runs: Vec<(usize, usize)> = runs.collect();
        let first = runs.iter().map(|(start, _)| *start).min()?;
        let count: usize = runs.iter().map(|(_, length)| length).sum();
        let name = format!("{}_torque", recording.joint_names()[joint]);
        Some(Issue {
            kind: IssueKind::ClippedTorque,
            severity: if count * 100 > recording.len() {
                Severity::Warning
            } else {
                Severity::Note
            },
            time: Some(seconds(recording.time()[0], recording.time()[first])),
            message: format!(
                "`{name}` stays at its extreme ({low} or {high}) for {count} samples in {} while \
                 the joint moves: it may be clipped by a limit of drive or logger; leave that time \
                 out (repair: trim)",
                in_stretches(runs.len()),
            ),
            channel: Some(name),
            count,
        })
    };
    (0..n).filter_map(of_joint).collect()
}

/// Torques that stay at one value, not their extreme, while the joint moves on.
fn frozen(recording: &Recording) -> Vec<Issue> {
    let Some(torque) = recording.torque() else { return Vec::new() };
    let (n, time) = (recording.dof(), recording.time_seconds());
    let of_joint = |joint: usize| {
        let tau: Vec<f64> = column(torque, n, joint).collect();
        let q: Vec<f64> = column(recording.position(), n, joint).collect();
        let width = |values: &[f64]| {
            statistics::range(values.iter().copied()).map_or(0.0, |[low, high]| high - low)
        };
        let extremes = statistics::range(tau.iter().copied()).filter(|[low, high]| low < high);
        let (mut start, mut runs) = (0, Vec::new());
        for run in tau.chunk_by(|a, b| a == b) {
            let end = start + run.len();
            let is_top = extremes.is_some_and(|extremes| extremes.contains(&run[0]));
            let moved = width(&q[start..end]);
            if time[end - 1] - time[start] >= FROZEN
                && !is_top
                && moved > STILL_RANGE.max(FROZEN_SHARE * width(&q))
            {
                runs.push(start..end);
            }
            start = end;
        }
        let first = runs.first()?.start;
        let count = runs.iter().map(std::ops::Range::len).sum();
        let name = format!("{}_torque", recording.joint_names()[joint]);
        Some(Issue {
            kind: IssueKind::FrozenTorque,
            severity: Severity::Warning,
            time: Some(time[first]),
            message: format!(
                "`{name}` stays at {} for {} ({}) in {} while the joint moves, first {:.3} s after \
                 the start: it was not measured there; leave that time out (repair: trim)",
                tau[first],
                counted(count, "sample"),
                percent(count, recording.len()),
                in_stretches(runs.len()),
                time[first],
            ),
            channel: Some(name),
            count,
        })
    };
    (0..n).filter_map(of_joint).collect()
}

fn in_stretches(count: usize) -> String {
    if count == 1 { "1 stretch".into() } else { format!("{count} stretches") }
}

type ValueColumn<'a> =
    std::iter::Copied<std::iter::StepBy<std::iter::Skip<std::slice::Iter<'a, f64>>>>;

/// Numbers that leave one end of 16 bits and come back at the other.
fn overflows(recording: &Recording) -> Vec<Issue> {
    let (n, time) = (recording.dof(), recording.time());
    let of_column = |(name, values, range): (String, ValueColumn<'_>, Option<[f64; 2]>)| {
        let [low, high] = range?;
        let visible = 1e-9 * (high - low);
        let share = |step: f64| (high - low) / (OF_16_BITS * step);
        let changes = || {
            values
                .clone()
                .zip(values.clone().skip(1))
                .map(|(before, now): (f64, f64)| (now - before).abs())
        };
        let mut step = f64::INFINITY;
        for change in changes().filter(|change| *change > visible) {
            step = step.min(change);
            // Finer steps make the share only larger.
            if share(step) > 1.0 {
                return None;
            }
        }
        if !(NEAR_THE_ENDS[0]..=1.0).contains(&share(step)) {
            return None;
        }
        let across =
            |(k, change): (usize, f64)| (change > NEAR_THE_ENDS[1] * (high - low)).then_some(k);
        let found: Vec<usize> = changes().enumerate().filter_map(across).collect();
        let at = seconds(time[0], time[found.first()? + 1]);
        Some(Issue {
            kind: IssueKind::Overflow,
            severity: Severity::Error,
            time: Some(at),
            message: format!(
                "`{name}` overflows {}, first {at:.3} s after the start: it leaves one end of \
                 65536 steps of {step:.3e} and comes back at the other; log it in more bits or \
                 larger steps, or leave that time out (repair: trim)",
                counted(found.len(), "time"),
            ),
            channel: Some(name),
            count: found.len(),
        })
    };
    let arrays =
        recording.arrays().map(|(array, values)| (array, values, statistics::ranges(values, n)));
    let arrays: Vec<_> = arrays.collect();
    let names = recording.joint_names().iter().enumerate();
    let columns =
        names.flat_map(|(joint, name)| arrays.iter().map(move |array| (joint, name, array)));
    let columns = columns.map(|(joint, name, (array, values, ranges))| {
        let own: ValueColumn<'_> = values.iter().skip(joint).step_by(n).copied();
        (format!("{name}_{array}"), own, ranges[joint])
    });
    columns.filter_map(of_column).collect()
}

/// Start and length of the runs of `tau` at `extreme` during which `q` keeps changing.
fn flat_tops(tau: &[f64], q: &[f64], extreme: f64) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut start = 0;
    for run in tau.chunk_by(|a, b| a == b) {
        let moves =
            q[start..start + run.len()].windows(2).filter(|pair| pair[0] != pair[1]).count();
        if run.len() >= FLAT_TOP && run[0] == extreme && 2 * moves >= run.len() {
            runs.push((start, run.len()));
        }
        start += run.len();
    }
    runs
}

fn encoder_steps(recording: &Recording) -> Option<Issue> {
    let n = recording.dof();
    let joints = recording.joint_names().iter().enumerate();
    let steps = joints.filter_map(|(joint, name)| {
        let q: Vec<f64> = column(recording.position(), n, joint).collect();
        quantum(&q).map(|step| format!("`{name}` {step:.3e}"))
    });
    let steps: Vec<String> = steps.collect();
    (!steps.is_empty()).then(|| Issue {
        kind: IssueKind::EncoderStep,
        severity: Severity::Note,
        time: None,
        channel: None,
        count: steps.len(),
        message: format!(
            "positions move in steps, of the encoder or of the rounding in the log, rad (m): {}; \
             filter before differentiating",
            steps.join(", "),
        ),
    })
}

/// The step of which the changes from sample to sample are multiples, if there is one and it is of
/// their size.
fn quantum(q: &[f64]) -> Option<f64> {
    let changes = q.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let magnitude =
        statistics::range(q.iter().copied())?.into_iter().map(f64::abs).fold(0.0, f64::max);
    let moving: Vec<f64> =
        changes.filter(|change| change.is_finite() && *change > 1e-12 * magnitude).collect();
    if moving.len() < 50 {
        return None;
    }
    let step = statistics::quantile(&mut moving.clone(), 0.01);
    let fits = |change: &&f64| {
        let multiple = *change / step;
        // Larger multiples say nothing: the step is not known well enough.
        multiple < 10.0 && (multiple - multiple.round()).abs() < 0.1
    };
    let small = moving.iter().filter(|change| **change / step < 10.0).count();
    let fitting = moving.iter().filter(fits).count();
    (small * 4 > moving.len() && fitting * 100 > small * 95).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantum_finds_the_encoder_step() {
        let smooth: Vec<f64> = (0..2000).map(|k| (f64::from(k) * 0.01).sin()).collect();
        assert_eq!(quantum(&smooth), None);
        let step = 0.002;
        let coarse: Vec<f64> = smooth.iter().map(|q| (q / step).round() * step).collect();
        assert!((quantum(&coarse).expect("steps") - step).abs() < 1e-9);
    }

    #[test]
    fn flat_tops_need_motion() {
        let tau = [0.0, 5.0, 5.0, 5.0, 5.0, 5.0, 1.0];
        let moving = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(flat_tops(&tau, &moving, 5.0), [(1, 5)]);
        assert!(flat_tops(&tau, &[0.0; 7], 5.0).is_empty());
    }
}
