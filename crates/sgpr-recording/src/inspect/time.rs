//! Issues of the time stamps.

use super::{Issue, IssueKind, Severity, counted, duration, percent, rounded};
use crate::statistics::{median, quantile};
use crate::{Recording, seconds};

/// A step of the time longer than this many median steps is a gap.
pub const GAP_FACTOR: f64 = 5.0;
/// Periods outside this range, s, are more likely a wrong unit than a log of an arm: no drive
/// reports more often, and a motion that shows inertia is over in the time of the few samples that
/// are left.
const LIKELY_PERIOD: [f64; 2] = [1e-5, 0.5];
/// From this period on, s, ...
const SLOW_PERIOD: f64 = 0.05;
/// ... an arm in which no joint is faster, rad/s (m/s), is more likely one whose time is in
/// milliseconds.
const SLOW_MOTION: f64 = 0.01;
/// Steps of a stretch may deviate from their median by this share of it (root mean square) before
/// differences become wrong.
pub const MOST_JITTER: f64 = 0.02;

/// Median of steps, and their root mean square deviation from it as a share of it; `None` without
/// steps.
pub fn jitter(steps: &[i64]) -> Option<(i64, f64)> {
    if steps.is_empty() {
        return None;
    }
    let mut copy = steps.to_vec();
    let median = *copy.select_nth_unstable(steps.len() / 2).1;
    let deviation = |step: &i64| (*step as f64 / median as f64 - 1.0).powi(2);
    Some((median, (steps.iter().map(deviation).sum::<f64>() / steps.len() as f64).sqrt()))
}

pub(super) fn issues(recording: &Recording) -> Vec<Issue> {
    let log = Log::new(recording);
    if let Some(coarse) = log.coarse() {
        return log.backwards().into_iter().chain([coarse]).collect();
    }
    let issues =
        [log.backwards(), log.duplicates(), log.gaps(), log.irregular(), log.unlikely_rate()];
    issues.into_iter().flatten().collect()
}

struct Log<'a> {
    recording: &'a Recording,
    /// s
    steps: Vec<f64>,
    /// The same, ns.
    nanoseconds: Vec<i64>,
    /// Median of the steps forward, s; none if there is no such step.
    usual: Option<f64>,
    /// Steps without time in which the position changes.
    moves_at_once: usize,
}

/// Of the joints' speeds from sample to sample, those that nine of ten do not exceed, the largest
/// one.
fn fastest(recording: &Recording) -> f64 {
    let n = recording.dof();
    let steps = recording.steps();
    let of_joint = |joint: usize| {
        let q = |sample: usize| recording.position()[sample * n + joint];
        let speeds = (0..steps.len()).map(|k| (q(k + 1) - q(k)).abs() / steps[k]);
        let mut speeds: Vec<f64> = speeds.filter(|speed| speed.is_finite()).collect();
        quantile(&mut speeds, 0.9)
    };
    (0..n).map(of_joint).fold(0.0, f64::max)
}

impl<'a> Log<'a> {
    fn new(recording: &'a Recording) -> Self {
        let nanoseconds =
            recording.time().windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
        let n = recording.dof();
        let position = |sample: usize| &recording.position()[sample * n..(sample + 1) * n];
        let steps = recording.steps();
        let moves = |step: &usize| steps[*step] == 0.0 && position(*step) != position(step + 1);
        let moves_at_once = (0..steps.len()).filter(moves).count();
        let mut forward: Vec<f64> = steps.iter().copied().filter(|&step| step > 0.0).collect();
        let usual = Some(median(&mut forward)).filter(|period| period.is_finite());
        Self { recording, steps, nanoseconds, usual, moves_at_once }
    }

    /// An issue of the steps `found`, unless there are none.
    fn issue(
        &self,
        kind: IssueKind,
        severity: Severity,
        found: &[usize],
        message: String,
    ) -> Option<Issue> {
        let first = *found.first()?;
        let time = self.recording.time();
        let at = seconds(time[0], time[first + 1]);
        Some(Issue { kind, severity, time: Some(at), channel: None, count: found.len(), message })
    }

    fn where_step(&self, is_bad: impl Fn(f64) -> bool) -> Vec<usize> {
        (0..self.steps.len()).filter(|&index| is_bad(self.steps[index])).collect()
    }

    fn backwards(&self) -> Option<Issue> {
        let found = self.where_step(|step| step < 0.0);
        let first = *found.first()?;
        let message = format!(
            "the time runs backwards {}, first by {} at sample {}: sort the samples (repair: \
             sort), or if it was restarted there, read its parts one by one (`rows`)",
            counted(found.len(), "time"),
            duration(-self.steps[first]),
            first + 1,
        );
        self.issue(IssueKind::TimeBackwards, Severity::Error, &found, message)
    }

    fn duplicates(&self) -> Option<Issue> {
        let found = self.where_step(|step| step == 0.0);
        let message = format!(
            "{} {} the stamp of the one before: drop the duplicates (repair: drop_duplicates), or \
             check the resolution of the time",
            counted(found.len(), "sample"),
            if found.len() == 1 { "has" } else { "have" },
        );
        self.issue(IssueKind::DuplicateStamps, Severity::Error, &found, message)
    }

    /// Most samples move on under the stamp of the one before: what the steps say is about the
    /// clock, not about the samples.
    fn coarse(&self) -> Option<Issue> {
        if 2 * self.moves_at_once <= self.steps.len() {
            return None;
        }
        let found = self.where_step(|step| step == 0.0);
        let resolution =
            self.usual.map_or_else(String::new, |period| format!(" of {}", duration(period)));
        let message = format!(
            "{} have the stamp of the one before: the time has a resolution{resolution}, which is \
             coarser than the samples; if they came at a constant rate, give it with \
             `sample_rate_hz`, or take another column for the time with `columns.time`",
            counted(found.len(), "sample"),
        );
        self.issue(IssueKind::DuplicateStamps, Severity::Error, &found, message)
    }

    fn gaps(&self) -> Option<Issue> {
        let usual = self.usual?;
        let found = self.where_step(|step| step > GAP_FACTOR * usual);
        let longest = found.iter().map(|&index| self.steps[index]).fold(0.0, f64::max);
        let message = format!(
            "{}, the longest of {} (a gap is a step longer than {GAP_FACTOR} median steps of {}): \
             nothing is filtered or differentiated across; if what stands before or behind does \
             not belong to the motion, leave it out (repair: trim)",
            counted(found.len(), "gap"),
            duration(longest),
            duration(usual),
        );
        self.issue(IssueKind::Gap, Severity::Warning, &found, message)
    }

    fn irregular(&self) -> Option<Issue> {
        let usual = self.usual?;
        if self.runs_backwards() {
            return None;
        }
        let regular: Vec<f64> =
            self.steps.iter().copied().filter(|&step| step <= GAP_FACTOR * usual).collect();
        let off = |share: f64| self.where_step(|step| (step - usual).abs() > share * usual);
        let (by_10, by_50) = (off(0.1), off(0.5));
        // Of a time that does not run forward the order is to be mended first.
        let runs_forward = self.steps.iter().all(|&step| step > 0.0);
        let worst = if runs_forward { self.worst_jitter(usual) } else { 0.0 };
        if by_10.len() * 100 <= self.steps.len() && worst <= MOST_JITTER {
            return None;
        }
        let mean = regular.iter().sum::<f64>() / regular.len() as f64;
        let message = format!(
            "irregular sampling: median step {}, mean {}, 1 % to 99 % of the steps {} to {}; {} of \
             the steps are off by more than 10 %, {} by more than 50 %: {} (resample: {} Hz)",
            duration(usual),
            duration(mean),
            duration(quantile(&mut regular.clone(), 0.01)),
            duration(quantile(&mut regular.clone(), 0.99)),
            percent(by_10.len(), self.steps.len()),
            percent(by_50.len(), self.steps.len()),
            if worst > MOST_JITTER {
                "too irregular to differentiate, resample first"
            } else {
                "resample"
            },
            rounded(1.0 / usual),
        );
        let severity = if worst > MOST_JITTER { Severity::Error } else { Severity::Warning };
        let found = if by_10.is_empty() { self.where_step(|step| step != usual) } else { by_10 };
        self.issue(IssueKind::IrregularSampling, severity, &found, message)
    }

    /// The largest deviation of the steps of a stretch between gaps from its median, as a share of
    /// it.
    fn worst_jitter(&self, usual: f64) -> f64 {
        let longest = GAP_FACTOR * usual * 1e9;
        let stretches = self.nanoseconds.split(|&step| step as f64 > longest);
        stretches.filter_map(jitter).map(|(_, share)| share).fold(0.0, f64::max)
    }

    fn unlikely_rate(&self) -> Option<Issue> {
        let usual = self.usual?;
        if self.runs_backwards() {
            return None;
        }
        let fastest = if usual > SLOW_PERIOD { fastest(self.recording) } else { f64::INFINITY };
        let slow_arm = fastest < SLOW_MOTION && fastest > 0.0;
        if (LIKELY_PERIOD[0]..=LIKELY_PERIOD[1]).contains(&usual) && !slow_arm {
            return None;
        }
        let message = format!(
            "the median step is {} s{}: if the log is not that {}, give the unit of the time with \
             `units.time`; if it is, confirm it (accept: unlikely_rate)",
            rounded(usual),
            if slow_arm {
                format!(", and no joint is faster than {fastest:.1e} rad/s (m/s)")
            } else {
                String::new()
            },
            if usual < LIKELY_PERIOD[0] { "fast" } else { "slow" }
        );
        let (kind, severity) = (IssueKind::UnlikelyRate, Severity::Error);
        Some(Issue {
            kind,
            severity,
            time: None,
            channel: None,
            count: self.recording.len(),
            message,
        })
    }

    /// Whether the order of the samples is to be mended before their steps say anything.
    fn runs_backwards(&self) -> bool {
        self.steps.iter().any(|&step| step < 0.0)
    }
}
