//! Issues of position and velocity together.

use std::f64::consts::TAU;

use super::values::{column, is_still_range};
use super::{Issue, IssueKind, Severity, counted, duration, strays};
use crate::resample::resample;
use crate::statistics::{self, first_change, first_place};
use crate::{GAP_FACTOR, Recording};
use sgpr_predict::internal::rms;

/// Shortest stretch over which velocity and position are compared, s.
const STRETCH: f64 = 0.1;
/// Fewest samples in a stretch.
const STRETCH_SAMPLES: usize = 10;
/// A joint must move this much, rad (m), before its velocity is judged.
const ENOUGH_MOTION: f64 = 0.02;
/// No arm joint turns further than this between its limits, rad.
const WIDEST_RANGE: f64 = 4.0 * std::f64::consts::PI;
/// Least change from one sample to the next that is a jump, and most that a jump by a turn differs
/// from one, rad (m).
const JUMP: f64 = 0.5;
/// Few arm joints are faster, rad/s (m/s).
const FAST: f64 = 10.0;
/// No arm joint is as fast, rad/s (m/s).
const JUMP_SPEED: f64 = 50.0;
/// A jump is this many times what nine of ten samples change by.
const JUMP_FACTOR: f64 = 10.0;
/// Largest lag that is looked for, s.
const LARGEST_LAG: f64 = 0.05;
/// Most samples for the cross-correlation.
const LONGEST_PIECE: usize = 20_000;

/// - `is_time_right`: whether the unit of the time is beyond doubt
pub(super) fn issues(recording: &Recording, is_time_right: bool) -> Vec<Issue> {
    let (clean, strays) = strays::taken_out(without_faults(recording));
    let ratios: Vec<Option<PositionCheck>> =
        (0..clean.dof()).map(|joint| PositionCheck::of_joint(&clean, joint)).collect();
    let mut issues = all_degrees(&clean, &ratios);
    let suspected: Vec<Option<String>> = issues.iter().map(|issue| issue.channel.clone()).collect();
    if is_time_right {
        let mismatches =
            (0..clean.dof()).filter_map(|joint| mismatch(&clean, joint, ratios[joint]?));
        issues.extend(mismatches.filter(|issue| {
            let position =
                issue.channel.as_ref().map(|name| name.replace("_velocity", "_position"));
            !suspected.contains(&position)
        }));
        issues.extend(lag(&clean, &ratios));
    }
    issues.extend((0..clean.dof()).filter_map(|joint| jumps(&clean, joint)));
    issues.extend(strays);
    issues
}

/// Positions that look like degrees, or finer units of an angle.
///
/// - `clean`: [`without_faults`]
pub(super) fn positions_in_degrees(clean: &Recording) -> Vec<Issue> {
    let ratios: Vec<Option<PositionCheck>> =
        (0..clean.dof()).map(|joint| PositionCheck::of_joint(clean, joint)).collect();
    all_degrees(clean, &ratios)
}

/// Positions that are wrapped to a turn.
///
/// - `clean`: [`without_faults`]
pub(super) fn wrapped_positions(clean: &Recording) -> Vec<Issue> {
    let jumps = (0..clean.dof()).filter_map(|joint| jumps(clean, joint));
    jumps.filter(|issue| issue.severity == Severity::Error).collect()
}

/// An error where half of the moving joints look so, else a warning.
fn all_degrees(clean: &Recording, ratios: &[Option<PositionCheck>]) -> Vec<Issue> {
    let ranges = statistics::ranges(clean.position(), clean.dof());
    let of_joint =
        |(joint, range): (usize, &Option<[f64; 2]>)| Some(Range::of_joint(clean, joint, (*range)?));
    let joints: Vec<Range> = ranges.iter().enumerate().filter_map(of_joint).collect();
    let usual = joints.iter().map(|range| range.usual);
    let finest = |comparison: &Option<PositionCheck>| {
        comparison.is_some_and(|comparison| comparison.is_near(1e3))
    };
    let suspected = Suspected::of_ranges(usual, ratios.iter().any(finest));
    let mut issues: Vec<Issue> = joints
        .iter()
        .filter_map(|range| not_radians(clean, range, ratios[range.joint], suspected))
        .collect();
    let moving = ranges.iter().filter(|range| !range.is_some_and(is_still_range)).count();
    let (some, most) = (issues.len() < moving, 2 * issues.len() >= moving);
    for issue in &mut issues {
        if most {
            issue.severity = Severity::Error;
        }
        if some {
            issue.message += "; other joints do not look so: a unit of some joints alone stands in \
                 the names of their columns, such as q_1 [deg]";
        }
    }
    issues
}

/// The samples whose stamp is later than all before and whose values are finite.
pub(super) fn without_faults(recording: &Recording) -> Recording {
    let runs_forward = recording.time().windows(2).all(|pair| pair[1] > pair[0]);
    if runs_forward
        && recording
            .arrays()
            .all(|(_, values)| first_place(values, |value| !value.is_finite()).is_none())
    {
        return recording.clone();
    }
    let mut latest = i64::MIN;
    let mut keep = Vec::new();
    for (sample, &time) in recording.time().iter().enumerate() {
        if (time > latest || keep.is_empty()) && super::is_finite_row(recording, sample) {
            keep.push(sample);
            latest = time;
        }
    }
    recording.pick(keep.iter().copied())
}

/// Positions that no joint can have one after the other.
fn jumps(recording: &Recording, joint: usize) -> Option<Issue> {
    let q: Vec<f64> = column(recording.position(), recording.dof(), joint).collect();
    // Of most logs this is all.
    first_change(&q, 1, |before, now| (now - before).abs() > JUMP)?;
    let changes: Vec<f64> = q.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let steps = recording.steps();
    let usual = usual_change(&changes);
    let found: Vec<usize> = (0..changes.len())
        .filter(|&k| changes[k] > JUMP.max(JUMP_SPEED * steps[k]).max(JUMP_FACTOR * usual))
        .collect();
    let first = *found.first()?;
    let name = format!("{}_position", recording.joint_names()[joint]);
    let (often, at) = (counted(found.len(), "time"), recording.time_seconds()[first + 1]);
    let (severity, message) = if found.iter().all(|&k| is_turn(changes[k], steps[k], usual)) {
        let message = format!(
            "`{name}` jumps by a full turn {often}, first {at:.3} s after the start: unwrap it \
             (repair: unwrap)"
        );
        (Severity::Error, message)
    } else {
        let message = format!(
            "`{name}` jumps {often}, first by {:.3} rad (m) within {} {at:.3} s after the start: \
             leave out that time (repair: trim), or the samples that no joint can have",
            changes[first],
            duration(steps[first]),
        );
        (Severity::Warning, message)
    };
    let (kind, time, count) = (IssueKind::PositionJump, Some(at), found.len());
    Some(Issue { kind, severity, time, channel: Some(name), count, message })
}

/// What nine of ten samples of a position change by.
pub(crate) fn usual_change(changes: &[f64]) -> f64 {
    statistics::quantile(&mut changes.to_vec(), 0.9)
}

/// Whether a position is about a turn from another: it is wrapped to one.
pub(super) fn is_near_a_turn(distance: f64) -> bool {
    (distance - TAU).abs() < JUMP
}

/// Whether a position changes by a full turn, give or take what the joint moves in a step.
///
/// - `step`: its length, s
/// - `usual`: what nine of ten samples change by
pub(crate) fn is_turn(change: f64, step: f64, usual: f64) -> bool {
    (change.abs() - TAU).abs() < JUMP.min((FAST * step).max(JUMP_FACTOR * usual))
}

/// The change of a position against the integral of its velocity.
#[derive(Clone, Copy)]
struct PositionCheck {
    /// Size of the change over that of the integral, with the sign of their correlation.
    ratio: f64,
    correlation: f64,
}

impl PositionCheck {
    fn of_joint(recording: &Recording, joint: usize) -> Option<Self> {
        let (n, velocity) = (recording.dof(), recording.velocity()?);
        let q: Vec<f64> = column(recording.position(), n, joint).collect();
        let [low, high] = statistics::range(q.iter().copied())?;
        if high - low < ENOUGH_MOTION {
            return None;
        }
        let v: Vec<f64> = column(velocity, n, joint).collect();
        let time = recording.time_seconds();
        let period = recording.median_period();
        let length = STRETCH_SAMPLES.max((STRETCH / period).ceil() as usize);
        let mut integral = vec![0.0];
        for k in 1..q.len() {
            integral.push(integral[k - 1] + 0.5 * (v[k] + v[k - 1]) * (time[k] - time[k - 1]));
        }
        let starts = (0..q.len().saturating_sub(length)).step_by(length.div_ceil(2));
        let whole =
            starts.filter(|&k| time[k + length] - time[k] < GAP_FACTOR * length as f64 * period);
        let (moved, integrated): (Vec<f64>, Vec<f64>) =
            whole.map(|k| (q[k + length] - q[k], integral[k + length] - integral[k])).unzip();
        let products: f64 = moved.iter().zip(&integrated).map(|(a, b)| a * b).sum();
        let (moved_size, integrated_size) = (rms(&moved), rms(&integrated));
        let correlation = products / (moved.len() as f64 * moved_size * integrated_size);
        let ratio = (moved_size / integrated_size).copysign(correlation);
        (moved.len() >= 5).then_some(Self {
            ratio,
            correlation: if correlation.is_finite() { correlation } else { 0.0 },
        })
    }

    fn is_near(self, ratio: f64) -> bool {
        self.correlation.abs() > 0.8 && (self.ratio.abs() / ratio - 1.0).abs() < 0.1
    }
}

/// What a joint moves over.
struct Range {
    joint: usize,
    whole: f64,
    /// Without the hundredth at each end: a single stray sample is a jump, no unit.
    usual: f64,
}

impl Range {
    fn of_joint(recording: &Recording, joint: usize, [low, high]: [f64; 2]) -> Self {
        // Which part of a range that any joint has is the usual one does not matter.
        let usual = match high - low > WIDEST_RANGE {
            true => {
                let mut q: Vec<f64> =
                    column(recording.position(), recording.dof(), joint).collect();
                statistics::quantile(&mut q, 0.99) - statistics::quantile(&mut q, 0.01)
            }
            false => high - low,
        };
        Self { joint, whole: high - low, usual }
    }
}

/// The unit of positions that are no radians: that in which the joint that moves most turns no
/// further than joints can.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Suspected {
    Degrees,
    Milliradians,
    Counts,
}

impl Suspected {
    /// - `ranges`: of the joints, in the unit of the log
    /// - `is_thousandfold`: whether a position changes a thousand times as fast as its velocity
    ///   says
    fn of_ranges(ranges: impl Iterator<Item = f64>, is_thousandfold: bool) -> Self {
        match ranges.fold(0.0, f64::max) {
            range if range > 1e3 * WIDEST_RANGE => Self::Counts,
            range if range > WIDEST_RANGE.to_degrees() || is_thousandfold => Self::Milliradians,
            _ => Self::Degrees,
        }
    }

    /// What it looks like, and what to do.
    fn remedy(self) -> &'static str {
        match self {
            Self::Degrees => {
                "it looks like degrees; give the unit of the position with `units.position` (deg, \
                 mm of a slide, or rad if that is right)"
            }
            Self::Milliradians => {
                "it looks like milliradians; give the unit of the position with `units.position` \
                 (mrad, or rad if that is right)"
            }
            Self::Counts => {
                "it looks like counts of an encoder; write the position in rad or deg to the log, \
                 or give its unit with `units.position` (rad if that is right)"
            }
        }
    }
}

fn not_radians(
    recording: &Recording,
    range: &Range,
    comparison: Option<PositionCheck>,
    suspected: Suspected,
) -> Option<Issue> {
    let name = format!("{}_position", recording.joint_names()[range.joint]);
    let reason = match comparison {
        Some(comparison) if comparison.is_near(1f64.to_degrees()) => {
            format!("changes {:.1} times as fast as the velocity says", comparison.ratio.abs())
        }
        _ if range.usual > WIDEST_RANGE => {
            format!(
                "has a range of {:.1}, {:.1} turns if it were rad",
                range.whole,
                range.whole / TAU
            )
        }
        _ => return None,
    };
    Some(Issue {
        kind: IssueKind::PositionInDegrees,
        severity: Severity::Warning,
        time: None,
        message: format!(
            "`{name}` {reason}: {}, or confirm it (accept: position_in_degrees)",
            suspected.remedy()
        ),
        channel: Some(name),
        count: 1,
    })
}

/// Ratios of the change of the position to the integral of the velocity that tell of a unit.
const KNOWN_RATIOS: [(f64, &str); 6] = [
    (std::f64::consts::PI / 180.0, "the velocity looks like deg/s (`units.velocity`)"),
    (180.0 / std::f64::consts::PI, "the position looks like degrees (`units.position`)"),
    (TAU / 60.0, "the velocity looks like rpm (`units.velocity`)"),
    (1e-3, "the velocity looks like mrad/s or mm/s (`units.velocity`)"),
    (1e3, "the position looks like mrad or mm (`units.position`)"),
    (1.0 / 60.0, "the velocity looks like units per minute"),
];

fn mismatch(recording: &Recording, joint: usize, comparison: PositionCheck) -> Option<Issue> {
    let PositionCheck { ratio, correlation } = comparison;
    let known = KNOWN_RATIOS.iter().find(|(known, _)| comparison.is_near(*known));
    let finding = if correlation.abs() < 0.8 {
        let text = "is not the derivative of the position (correlation {}): check which columns \
             belong together";
        text.replace("{}", &format!("{correlation:.2}"))
    } else if let Some((_, unit)) = known {
        format!("does not fit the position, which changes {:.4} times as fast: {unit}", ratio.abs())
    } else if correlation < 0.0 {
        "has the opposite sign of the change of the position: check the direction of the joint"
            .into()
    } else if (ratio - 1.0).abs() > 0.1 {
        format!(
            "does not fit the position, which changes {ratio:.3} times as fast: check units and \
             gear ratio"
        )
    } else {
        return None;
    };
    let name = format!("{}_velocity", recording.joint_names()[joint]);
    Some(Issue {
        kind: IssueKind::VelocityMismatch,
        severity: Severity::Warning,
        time: None,
        message: format!("`{name}` {finding}"),
        channel: Some(name),
        count: 1,
    })
}

fn lag(recording: &Recording, comparisons: &[Option<PositionCheck>]) -> Option<Issue> {
    let judged =
        |joint: &usize| comparisons[*joint].is_some_and(|comparison| comparison.correlation > 0.8);
    let joints: Vec<usize> = (0..recording.dof()).filter(judged).collect();
    let period = recording.median_period();
    let nanoseconds = (period * 1e9).round() as u64;
    if joints.is_empty() || nanoseconds == 0 {
        return None;
    }
    let pieces = recording.split_at_steps(GAP_FACTOR * period);
    let longest = pieces.into_iter().max_by_key(Recording::len)?;
    let even = resample(&longest.slice(0..longest.len().min(LONGEST_PIECE)), nanoseconds);
    let Correlation { lag, peak } = Correlation::largest(&even, &joints)?;
    if lag.abs() < 1e-3 || lag.abs() < 0.25 * period || peak < 0.8 {
        return None;
    }
    let direction = if lag > 0.0 { "late" } else { "early" };
    Some(Issue {
        kind: IssueKind::VelocityLag,
        severity: Severity::Warning,
        time: None,
        channel: None,
        count: joints.len(),
        message: format!(
            "the velocity is {} {direction} against the derivative of the position (correlation \
             {peak:.3}): take velocities from the filtered positions",
            duration(lag.abs()),
        ),
    })
}

/// Where the velocity is most like the derivative of the position.
struct Correlation {
    /// s; positive if the velocity is late
    lag: f64,
    peak: f64,
}

impl Correlation {
    /// The peak of the mean over `joints` of the cross-correlation, between samples by a parabola.
    /// The recording has equal steps.
    fn largest(even: &Recording, joints: &[usize]) -> Option<Self> {
        let (n, velocity, period) = (even.dof(), even.velocity()?, even.median_period());
        let reach = ((LARGEST_LAG / period).ceil() as usize).clamp(3, 100);
        if even.len() < 10 * reach {
            return None;
        }
        let mut mean = vec![0.0; 2 * reach + 1];
        for &joint in joints {
            let q: Vec<f64> = column(even.position(), n, joint).collect();
            let v: Vec<f64> = column(velocity, n, joint).skip(1).collect();
            let derivative: Vec<f64> =
                q.windows(3).map(|q| (q[2] - q[0]) / (2.0 * period)).collect();
            for (shift, sum) in mean.iter_mut().enumerate() {
                *sum += correlation(&derivative, &v, shift, reach) / joints.len() as f64;
            }
        }
        let best = (0..mean.len()).max_by(|&a, &b| mean[a].total_cmp(&mean[b]))?;
        if best == 0 || best == 2 * reach {
            return None;
        }
        let (before, peak, after) = (mean[best - 1], mean[best], mean[best + 1]);
        let vertex = 0.5 * (before - after) / (before - 2.0 * peak + after);
        Some(Self { lag: (best as f64 - reach as f64 + vertex) * period, peak })
    }
}

/// Correlation of `derivative[k]` with `velocity[k + shift - reach]`.
fn correlation(derivative: &[f64], velocity: &[f64], shift: usize, reach: usize) -> f64 {
    let inner = &derivative[reach..derivative.len() - reach];
    let shifted = &velocity[shift..shift + inner.len()];
    let product: f64 = inner.iter().zip(shifted).map(|(a, b)| a * b).sum();
    let sizes = rms(inner) * rms(shifted) * inner.len() as f64;
    if sizes > 0.0 { product / sizes } else { 0.0 }
}
