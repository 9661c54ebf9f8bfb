//! Single samples that no others are like.

use rayon::prelude::*;

use super::motion::is_near_a_turn;
use super::values::{STILL_RANGE, column};
use super::{Issue, IssueKind, Severity, counted};
use crate::{Recording, statistics};

/// What strays does so for this time, s, or for one sample ...
const LONGEST: f64 = 0.01;
/// ... and for no more samples in a row than this.
const MOST_IN_A_ROW: usize = 3;
/// Largest share of samples that stray, and most of them: more are the log.
const MOST_SHARE: f64 = 0.01;
const MOST: usize = 100;
/// A sample that strays is this many times as far from those around it as any that does not.
const APART: f64 = 5.0;
/// A position that strays does so by more than this many times its mean change from sample to
/// sample.
const STEPS: f64 = 2.0;

/// The samples of a quantity of one joint that stray.
struct Strays {
    joint: usize,
    array: &'static str,
    samples: Vec<usize>,
    /// Of the first one from those around it.
    distance: f64,
}

/// Samples with a value that leaves those before and after it and comes back, in increasing order.
pub(crate) fn stray_samples(recording: &Recording) -> Vec<usize> {
    samples_of(&strays(recording))
}

fn samples_of(strays: &[Strays]) -> Vec<usize> {
    let mut samples: Vec<usize> =
        strays.iter().flat_map(|strays| strays.samples.iter().copied()).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}

/// A recording without what strays, which is told.
///
/// - `clean`: with stamps that increase and values that are finite
pub(super) fn taken_out(clean: Recording) -> (Recording, Vec<Issue>) {
    let found = strays(&clean);
    if found.is_empty() {
        return (clean, vec![]);
    }
    let issues = issues(&clean, &found);
    let samples = samples_of(&found);
    let stays = |sample: &usize| samples.binary_search(sample).is_err();
    (clean.pick((0..clean.len()).filter(stays)), issues)
}

fn issues(clean: &Recording, strays: &[Strays]) -> Vec<Issue> {
    let issue = |strays: &Strays| {
        let (count, at) = (strays.samples.len(), clean.time_seconds()[strays.samples[0]]);
        let name = format!("{}_{}", clean.joint_names()[strays.joint], strays.array);
        let unit = match strays.array {
            "position" => "rad (m)",
            "velocity" => "rad/s (m/s)",
            _ => "N·m (N)",
        };
        Issue {
            kind: IssueKind::StraySample,
            // Models are identified from positions and torques.
            severity: if strays.array == "velocity" { Severity::Warning } else { Severity::Error },
            time: Some(at),
            message: format!(
                "`{name}` strays in {}, first {at:.3} s after the start, {:.4} {unit} from what is \
                 before and after it: replace such samples (repair: replace_strays), or confirm \
                 them (accept: stray_sample)",
                counted(count, "sample"),
                strays.distance,
            ),
            channel: Some(name),
            count,
        }
    };
    strays.iter().map(issue).collect()
}

fn strays(recording: &Recording) -> Vec<Strays> {
    let in_a_row = ((LONGEST / recording.median_period()) as usize).clamp(1, MOST_IN_A_ROW);
    let n = recording.dof();
    let of_array = |(array, values): (&'static str, &[f64])| -> Vec<Strays> {
        let of_joint = |joint: usize| {
            let own: Vec<f64> = column(values, n, joint).collect();
            let (samples, distance) =
                StrayColumn { own: &own, is_position: array == "position", in_a_row }.strays()?;
            Some(Strays { joint, array, samples, distance })
        };
        (0..n).into_par_iter().filter_map(of_joint).collect()
    };
    recording.arrays().flat_map(of_array).collect()
}

struct StrayColumn<'a> {
    own: &'a [f64],
    is_position: bool,
    /// Most samples that stray in a row.
    in_a_row: usize,
}

impl StrayColumn<'_> {
    /// Those that stray, and the distance of the first one.
    fn strays(&self) -> Option<(Vec<usize>, f64)> {
        // Of most logs this is all: what goes away and comes back bends by no less than a quarter
        // of the way.
        let bend = |of: &[f64]| (of[0] - 2.0 * of[1] + of[2]).abs();
        if self.own.windows(3).map(bend).fold(0.0, f64::max) < self.least(self.own) / 4.0 {
            return None;
        }
        let most = ((MOST_SHARE * self.own.len() as f64) as usize).clamp(1, MOST);
        let farthest = self.farthest(most + 1);
        let count = (1..farthest.len()).rev().find(|&count| {
            let (strays, next) = (&farthest[..count], farthest[count].1);
            strays.iter().all(|(_, distance)| *distance > APART * next) && self.are_strays(strays)
        })?;
        let mut strays = farthest[..count].to_vec();
        strays.sort_unstable_by_key(|(sample, _)| *sample);
        Some((strays.iter().map(|(sample, _)| *sample).collect(), strays[0].1))
    }

    /// The samples that are farthest from those around them, each with its distance, down to the
    /// first that is too near: one after the other, without those before, which would make others
    /// beside them look far.
    fn farthest(&self, count: usize) -> Vec<(usize, f64)> {
        let mut values = self.own.to_vec();
        let mut places = self.places();
        let mut found = Vec::new();
        while found.len() < count {
            let sample = (0..places.len())
                .max_by(|a, b| places[*a].distance.total_cmp(&places[*b].distance));
            let Some(sample) = sample else { break };
            let distance = places[sample].distance;
            found.push((sample, distance));
            values[sample] = places[sample].usual;
            if distance <= self.least(&values) {
                break;
            }
            let reach = self.in_a_row + 1;
            for near in sample.saturating_sub(2 * reach)..(sample + 2 * reach + 1).min(values.len())
            {
                places[near] = self.place(&values, near);
            }
            places[sample].distance = 0.0;
        }
        found
    }

    /// Of all samples; those that go on from their neighbours are near.
    fn places(&self) -> Vec<SampleDistance> {
        let near = STEPS * mean_change(self.own) / APART;
        let goes_on = |pair: &[f64]| (pair[1] - pair[0]).abs() < near;
        let place = |sample: usize| match self.own.get(sample.wrapping_sub(1)..sample + 2) {
            Some(around) if goes_on(&around[..2]) && goes_on(&around[1..]) => {
                SampleDistance { usual: around[1], distance: 0.0 }
            }
            _ => self.place(self.own, sample),
        };
        (0..self.own.len()).map(place).collect()
    }

    fn are_strays(&self, strays: &[(usize, f64)]) -> bool {
        let mut sorted: Vec<usize> = strays.iter().map(|(sample, _)| *sample).collect();
        sorted.sort_unstable();
        let in_a_row = sorted.chunk_by(|a, b| a + 1 == *b).map(<[usize]>::len).max().unwrap_or(0);
        let is_stray = |sample: usize| sorted.binary_search(&sample).is_ok();
        let others: Vec<f64> =
            (0..self.own.len()).filter(|k| !is_stray(*k)).map(|k| self.own[k]).collect();
        let least = self.least(&others);
        let strays_all = strays.iter().all(|(_, distance)| {
            *distance > least && !(self.is_position && is_near_a_turn(*distance))
        });
        in_a_row <= self.in_a_row && least > 0.0 && strays_all
    }

    /// By how much a sample strays at least, beside these.
    fn least(&self, others: &[f64]) -> f64 {
        if self.is_position {
            return STILL_RANGE.max(STEPS * mean_change(others));
        }
        statistics::range(others.iter().copied()).map_or(0.0, |[low, high]| high - low)
    }

    /// Of a sample among what is before and after it; at the ends, beyond what goes on from there.
    fn place(&self, values: &[f64], sample: usize) -> SampleDistance {
        let (last, reach, own) = (values.len() - 1, self.in_a_row + 1, values[sample]);
        let count = 2 * reach + 1;
        if last < count {
            return SampleDistance { usual: own, distance: 0.0 };
        }
        if sample < reach {
            let others = &values[self.in_a_row.max(sample + 1)..count];
            return SampleDistance { usual: others[0], distance: beyond(own, others) };
        }
        if sample + reach > last {
            let others = &values[last + 1 - count..=(last - self.in_a_row).min(sample - 1)];
            return SampleDistance {
                usual: others[others.len() - 1],
                distance: beyond(own, others),
            };
        }
        let mut window = [0.0; 2 * (MOST_IN_A_ROW + 1) + 1];
        let window = &mut window[..count];
        window.copy_from_slice(&values[sample - reach..=sample + reach]);
        window.sort_unstable_by(f64::total_cmp);
        SampleDistance { usual: window[reach], distance: (own - window[reach]).abs() }
    }
}

/// What is usual where a sample is, and how far it is from that.
struct SampleDistance {
    usual: f64,
    distance: f64,
}

fn mean_change(values: &[f64]) -> f64 {
    let changes: f64 = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
    changes / values.len().max(1) as f64
}

/// By how much a value is farther from others than they range over.
fn beyond(own: f64, others: &[f64]) -> f64 {
    let [low, high] = statistics::range(others.iter().copied()).unwrap_or([own; 2]);
    ((low - own).max(own - high) - (high - low)).max(0.0)
}
