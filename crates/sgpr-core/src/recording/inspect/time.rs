//! Issues of the time stamps.

use super::{Issue, IssueKind, Severity, counted, milliseconds, percent};
use crate::recording::statistics::{median, quantile};
use crate::recording::{GAP_FACTOR, Recording};

/// Periods outside this range, s, are more likely a wrong unit than a log of an arm.
const LIKELY_PERIOD: [f64; 2] = [1e-5, 1.0];

pub(super) fn issues(recording: &Recording) -> Vec<Issue> {
    let log = Log { time: recording.time_seconds(), steps: recording.steps() };
    let issues = [log.backwards(), log.duplicates(), log.gaps(), log.irregular(), log.unlikely_rate()];
    issues.into_iter().flatten().collect()
}

struct Log {
    /// s since the first sample
    time: Vec<f64>,
    /// s
    steps: Vec<f64>,
}

impl Log {
    /// An issue of the steps `found`, unless there are none.
    fn issue(&self, kind: IssueKind, severity: Severity, found: &[usize], message: String) -> Option<Issue> {
        let first = *found.first()?;
        Some(Issue { kind, severity, time: Some(self.time[first + 1]), channel: None, count: found.len(), message })
    }

    fn where_step(&self, is_bad: impl Fn(f64) -> bool) -> Vec<usize> {
        (0..self.steps.len()).filter(|&index| is_bad(self.steps[index])).collect()
    }

    fn backwards(&self) -> Option<Issue> {
        let found = self.where_step(|step| step < 0.0);
        let first = *found.first()?;
        let message = format!(
            "the time runs backwards {}, first by {} at sample {}: sort the samples, or cut the log there if it was restarted",
            counted(found.len(), "time"),
            milliseconds(-self.steps[first]),
            first + 1,
        );
        self.issue(IssueKind::TimeBackwards, Severity::Error, &found, message)
    }

    fn duplicates(&self) -> Option<Issue> {
        let found = self.where_step(|step| step == 0.0);
        let message = format!(
            "{} {} the stamp of the one before: drop the duplicates, or check the resolution of the time",
            counted(found.len(), "sample"),
            if found.len() == 1 { "has" } else { "have" },
        );
        self.issue(IssueKind::DuplicateStamps, Severity::Error, &found, message)
    }

    fn gaps(&self) -> Option<Issue> {
        let usual = self.usual_period()?;
        let found = self.where_step(|step| step > GAP_FACTOR * usual);
        let longest = found.iter().map(|&index| self.steps[index]).fold(0.0, f64::max);
        let message = format!(
            "{}, the longest of {} (a gap is a step longer than {GAP_FACTOR} median steps of {}): cut the log there, nothing may be filtered or differentiated across",
            counted(found.len(), "gap"),
            milliseconds(longest),
            milliseconds(usual),
        );
        self.issue(IssueKind::Gap, Severity::Warning, &found, message)
    }

    fn irregular(&self) -> Option<Issue> {
        let usual = self.usual_period()?;
        let regular: Vec<f64> = self.steps.iter().copied().filter(|&step| step <= GAP_FACTOR * usual).collect();
        let off = |share: f64| self.where_step(|step| (step - usual).abs() > share * usual);
        let (by_10, by_50) = (off(0.1), off(0.5));
        if by_10.len() * 100 <= self.steps.len() {
            return None;
        }
        let mean = regular.iter().sum::<f64>() / regular.len() as f64;
        let message = format!(
            "irregular sampling: median step {}, mean {}, 1 % to 99 % of the steps {} to {}; {} of the steps are off by more than 10 %, {} by more than 50 %: resample before filtering or differentiating",
            milliseconds(usual),
            milliseconds(mean),
            milliseconds(quantile(&mut regular.clone(), 0.01)),
            milliseconds(quantile(&mut regular.clone(), 0.99)),
            percent(by_10.len(), self.steps.len()),
            percent(by_50.len(), self.steps.len()),
        );
        self.issue(IssueKind::IrregularSampling, Severity::Warning, &by_10, message)
    }

    fn unlikely_rate(&self) -> Option<Issue> {
        let usual = self.usual_period()?;
        if (LIKELY_PERIOD[0]..=LIKELY_PERIOD[1]).contains(&usual) {
            return None;
        }
        let message = format!(
            "the median step is {usual} s: if the log is not that {}, give the unit of the time",
            if usual < LIKELY_PERIOD[0] { "fast" } else { "slow" }
        );
        let (kind, severity) = (IssueKind::UnlikelyRate, Severity::Warning);
        Some(Issue { kind, severity, time: None, channel: None, count: self.time.len(), message })
    }

    /// Median of the steps forward, s.
    fn usual_period(&self) -> Option<f64> {
        let mut forward: Vec<f64> = self.steps.iter().copied().filter(|&step| step > 0.0).collect();
        Some(median(&mut forward)).filter(|period| period.is_finite())
    }
}
