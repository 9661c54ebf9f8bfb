//! The logs of one robot as a set: what is in two of them counts once, and their order does not
//! matter.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::{Deref, Range};
use std::sync::Arc;

use super::Recording;

/// The logs of one robot, every sample once.
///
/// A log that is a copy of another, under whatever name, is left out; of logs that overlap, the
/// samples that a log before has are left out, as recorders write them that cut a stream into
/// files. Samples are the same if all positions and torques of a run of them are the same numbers:
/// those of another run of the same motion have other noise.
///
/// A set goes wherever logs go, as a slice of its logs, and results are those of the list that it
/// was made of. It never changes, and its clones share all that it holds. What filters and
/// derivatives make of its logs is kept with them, of the two ways of processing that were asked
/// for last: identification, comparison, diagnosis and processes find the motion of a log of a set
/// once.
///
/// # Examples
/// ```
/// use sgpr_recording::{LogSet, Recording};
/// let wave = |k: i64| (0.01 * k as f64).sin();
/// let log = |name: &str, samples: std::ops::Range<i64>| {
///     let time = samples.clone().map(|k| 1_000_000 * k).collect();
///     Recording::new(name, vec!["a".into()], time, samples.map(wave).collect(), None, None, vec![])
/// };
/// let logs = [log("one", 0..500)?, log("two", 400..900)?, log("one again", 0..500)?];
/// let set = LogSet::new(&logs);
/// let samples: Vec<usize> = set.logs().iter().map(Recording::len).collect();
/// assert_eq!(samples, [500, 400]);
/// assert_eq!(set.notes().len(), 2);
/// assert_eq!(set[1].source(), "two");
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
#[derive(Clone, Debug)]
pub struct LogSet {
    logs: Arc<[Recording]>,
    /// Of each log: which of those that were looked at it is of.
    origins: Arc<[usize]>,
    notes: Arc<[String]>,
}

/// Shorter runs may be alike by chance, where an arm stands and numbers are coarse: so many samples
/// that differ from the one before. Shorter rests between runs are not worth a log.
const LEAST: usize = 50;

/// Every so many samples of a known log are looked for in others; at most [`LEAST`].
const BETWEEN: usize = 32;

impl LogSet {
    /// The logs in the order given.
    pub fn new(recordings: &[Recording]) -> Self {
        let (mut logs, mut origins, mut notes) =
            (Vec::with_capacity(recordings.len()), vec![], vec![]);
        let mut known = Known::default();
        for (origin, log) in recordings.iter().enumerate() {
            let shared = known.runs_of(log);
            let own = rest(log.len(), shared.iter().map(|(run, _)| run));
            notes.extend(note(log, &shared, &own, &known));
            if shared.is_empty() {
                logs.push(log.clone());
            } else {
                logs.extend(own.into_iter().map(|range| log.slice(range)));
            }
            origins.resize(logs.len(), origin);
            known.add(log);
        }
        Self::of(logs, origins, notes)
    }

    /// Every log whole, whatever others hold of it: for predictions of each, not for figures over
    /// all.
    pub fn whole(recordings: &[Recording]) -> Self {
        Self::of(recordings.to_vec(), (0..recordings.len()).collect(), vec![])
    }

    fn of(mut logs: Vec<Recording>, origins: Vec<usize>, notes: Vec<String>) -> Self {
        logs.iter_mut().for_each(|log| log.kept = log.kept.on());
        Self { logs: logs.into(), origins: origins.into(), notes: notes.into() }
    }

    /// The logs in an order that follows from what is in them, by their first stamps and then by
    /// their content: whatever order they are given in, the same log keeps what two share.
    pub fn sorted(recordings: &[Recording]) -> Self {
        let mut sorted = recordings.to_vec();
        sorted.sort_by(by_content);
        Self::new(&sorted)
    }

    /// The logs, and of overlapping ones the stretches that are their own.
    pub fn logs(&self) -> &[Recording] {
        &self.logs
    }

    /// For each of [`Self::logs`] the index of the log it is of, among those that [`Self::new`] was
    /// given.
    pub fn origins(&self) -> &[usize] {
        &self.origins
    }

    /// What was left out, in sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }
}

impl Deref for LogSet {
    type Target = [Recording];

    fn deref(&self) -> &[Recording] {
        &self.logs
    }
}

impl From<&LogSet> for LogSet {
    fn from(set: &LogSet) -> Self {
        set.clone()
    }
}

impl From<&[Recording]> for LogSet {
    fn from(recordings: &[Recording]) -> Self {
        Self::new(recordings)
    }
}

impl From<&Vec<Recording>> for LogSet {
    fn from(recordings: &Vec<Recording>) -> Self {
        Self::new(recordings)
    }
}

impl<const COUNT: usize> From<&[Recording; COUNT]> for LogSet {
    fn from(recordings: &[Recording; COUNT]) -> Self {
        Self::new(recordings)
    }
}

/// Runs of samples of `new` that one of the `known` logs has, too, in order, and which log that is.
///
/// An error on samples that a fit has seen is none on unseen data. Samples are the same as in a
/// [`LogSet`]: another run of the same motion has other noise and is found by
/// [`repeated_share`](super::repeated_share).
pub fn shared_samples(known: &[Recording], new: &Recording) -> Vec<(Range<usize>, usize)> {
    let mut logs = Known::default();
    known.iter().for_each(|log| logs.add(log));
    logs.runs_of(new)
}

fn by_content(a: &Recording, b: &Recording) -> Ordering {
    let first = |recording: &Recording| recording.time().first().copied();
    let numbers = |a: &[f64], b: &[f64]| {
        let differ = a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
        a.len().cmp(&b.len()).then(differ.unwrap_or(Ordering::Equal))
    };
    first(a)
        .cmp(&first(b))
        .then_with(|| numbers(a.position(), b.position()))
        .then_with(|| numbers(a.torque().unwrap_or(&[]), b.torque().unwrap_or(&[])))
        .then_with(|| a.time().cmp(b.time()))
}

fn note(
    log: &Recording,
    shared: &[(Range<usize>, usize)],
    own: &[Range<usize>],
    known: &Known<'_>,
) -> Option<String> {
    let (first, other) = shared.first()?;
    let (other, name) = (known.logs[*other], log.source());
    let what = if other.len() > log.len() { "part" } else { "copy" };
    let other = other.source();
    if own.is_empty() {
        return Some(format!(
            "{name} is a {what} of {other} and is left out: the same samples would count twice"
        ));
    }
    let count: usize = shared.iter().map(|(run, _)| run.len()).sum();
    let start = log.time_seconds()[first.start];
    Some(format!(
        "{count} of {} samples of {name}, from {start:.2} s after its start on, are in {other}, \
         too, and are left out: the same samples would count twice",
        log.len()
    ))
}

/// What is left of `0..length` between `runs`, which are in order.
fn rest<'a>(length: usize, runs: impl Iterator<Item = &'a Range<usize>>) -> Vec<Range<usize>> {
    let (mut start, mut own) = (0, vec![]);
    for run in runs {
        own.push(start..run.start);
        start = run.end;
    }
    own.push(start..length);
    own.retain(|range| range.len() >= LEAST);
    own
}

/// Logs that were seen, and where some of their samples are.
#[derive(Default)]
struct Known<'a> {
    logs: Vec<&'a Recording>,
    places: HashMap<u64, Vec<(usize, usize)>>,
}

impl<'a> Known<'a> {
    fn add(&mut self, log: &'a Recording) {
        for sample in (0..log.len()).step_by(BETWEEN) {
            self.places.entry(hash(log, sample)).or_default().push((self.logs.len(), sample));
        }
        self.logs.push(log);
    }

    /// Runs of samples of `log` that a known log has, in order, and which.
    fn runs_of(&self, log: &Recording) -> Vec<(Range<usize>, usize)> {
        if let Some(copy) = self.logs.iter().position(|known| is_copy(log, known)) {
            return vec![(0..log.len(), copy)];
        }
        let mut runs: Vec<(Range<usize>, usize)> = vec![];
        let mut sample = 0;
        while sample < log.len() && !self.logs.is_empty() {
            let least = runs.last().map_or(0, |(run, _)| run.end);
            let places = self.places.get(&hash(log, sample)).into_iter().flatten();
            let found = places.map(|&(other, there)| {
                (self.run_around(log, sample, (other, there), least), other)
            });
            let longest =
                found.max_by_key(|(run, _)| run.len()).filter(|(run, _)| moves(log, run) >= LEAST);
            match longest {
                Some((run, other)) => {
                    sample = run.end;
                    runs.push((run, other));
                }
                None => sample += 1,
            }
        }
        runs
    }

    /// The samples of `log` from `least` on around `sample` that are those of a known log around
    /// `there`.
    fn run_around(
        &self,
        log: &Recording,
        sample: usize,
        there: (usize, usize),
        least: usize,
    ) -> Range<usize> {
        let (other, there) = (self.logs[there.0], there.1);
        let same = |a: usize, b: usize| is_same(log, a, other, b);
        let after = (0..(log.len() - sample).min(other.len() - there))
            .take_while(|k| same(sample + k, there + k))
            .count();
        let before =
            (1..=(sample - least).min(there)).take_while(|k| same(sample - k, there - k)).count();
        sample - before..sample + after
    }
}

/// Samples of a run that differ from the one before.
fn moves(log: &Recording, run: &Range<usize>) -> usize {
    run.clone().skip(1).filter(|&k| !is_same(log, k - 1, log, k)).take(LEAST).count()
}

/// Whether all is the same but the source, as [`Recording::content_hash`] has it, also of an arm
/// that stands.
fn is_copy(a: &Recording, b: &Recording) -> bool {
    let same = |a: &[f64], b: &[f64]| {
        a.iter().map(|value| value.to_bits()).eq(b.iter().map(|value| value.to_bits()))
    };
    a.joint_names() == b.joint_names()
        && a.time() == b.time()
        && a.arrays().count() == b.arrays().count()
        && a.arrays().zip(b.arrays()).all(|((name, a), (other, b))| name == other && same(a, b))
}

fn numbers(log: &Recording, sample: usize) -> impl Iterator<Item = u64> {
    let row = sample * log.dof()..(sample + 1) * log.dof();
    let torque = log.torque().map_or(&[][..], |torque| &torque[row.clone()]);
    log.position()[row].iter().chain(torque).map(|value| value.to_bits())
}

fn hash(log: &Recording, sample: usize) -> u64 {
    let mut hasher = DefaultHasher::new();
    numbers(log, sample).for_each(|bits| bits.hash(&mut hasher));
    hasher.finish()
}

fn is_same(a: &Recording, i: usize, b: &Recording, j: usize) -> bool {
    a.joint_names() == b.joint_names() && numbers(a, i).eq(numbers(b, j))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion at 100 Hz, with numbers that never come back; the clock starts anew.
    fn log(name: &str, samples: Range<usize>) -> Recording {
        let wave = |k: usize| [(0.013 * k as f64).sin(), (0.7 + 0.0217 * k as f64).cos()];
        let time = (0..samples.len() as i64).map(|k| 10_000_000 * k).collect();
        let (q, tau): (Vec<f64>, Vec<f64>) = samples
            .flat_map(wave)
            .map(|value| (value, 3.0 * value + 1e-3 * (1e4 * value).sin()))
            .unzip();
        Recording::new(name, vec!["a".into(), "b".into()], time, q, None, Some(tau), vec![])
            .expect("a recording")
    }

    fn lengths(logs: &[Recording]) -> Vec<usize> {
        LogSet::new(logs).logs().iter().map(Recording::len).collect()
    }

    #[test]
    fn what_two_logs_share_counts_once() {
        assert_eq!(lengths(&[log("a", 0..400), log("b", 400..800)]), [400, 400]);
        assert_eq!(lengths(&[log("a", 0..400), log("b", 0..400)]), [400]);
        // A part of it, after it and before it; overlaps at either end; one in the middle.
        assert_eq!(lengths(&[log("a", 0..400), log("b", 101..317)]), [400]);
        let parts = [log("b", 101..317), log("a", 0..400)];
        assert_eq!(lengths(&parts), [216, 101, 83]);
        assert_eq!(LogSet::new(&parts).origins(), [0, 1, 1]);
        assert_eq!(lengths(&[log("a", 100..400), log("b", 0..211)]), [300, 100]);
        assert_eq!(
            lengths(&[log("a", 0..400), log("b", 300..500), log("c", 430..600)]),
            [400, 100, 100]
        );
        // Fewer samples than could be no chance.
        assert_eq!(lengths(&[log("a", 0..400), log("b", 370..600)]), [400, 230]);
        let notes = LogSet::new(&[log("a", 0..400), log("b", 300..500)]).notes().to_vec();
        assert_eq!(notes.len(), 1);
        assert!(notes[0].starts_with("100 of 200 samples of b, from 0.00 s"), "{}", notes[0]);
    }

    #[test]
    fn a_test_log_that_the_training_has_is_found_by_its_samples() {
        let train = [log("a", 0..400), log("b", 500..900)];
        assert_eq!(shared_samples(&train, &log("c", 380..700)), [(120..320, 1)]);
        assert_eq!(shared_samples(&train, &log("c", 300..600)), [(0..100, 0), (200..300, 1)]);
        assert_eq!(shared_samples(&train, &log("c", 500..900)), [(0..400, 1)]);
        assert_eq!(shared_samples(&train, &log("c", 900..1300)), []);
        assert_eq!(shared_samples(&[], &log("c", 0..400)), []);
    }

    #[test]
    fn an_arm_that_stands_is_no_copy() {
        let still = |name: &str, start: i64| {
            let time = (start..start + 500).map(|k| 10_000_000 * k).collect();
            Recording::new(
                name,
                vec!["a".into()],
                time,
                vec![0.3; 500],
                None,
                Some(vec![1.5; 500]),
                vec![],
            )
            .expect("a recording")
        };
        assert_eq!(lengths(&[still("a", 0), still("b", 900)]), [500, 500]);
        // The same stamps, too: it is the same file.
        assert_eq!(lengths(&[still("a", 0), still("b", 0)]), [500]);
    }

    #[test]
    fn the_order_of_a_set_follows_from_its_content() {
        // The first two overlap.
        let logs = [log("a", 0..400), log("b", 300..900), log("c", 1000..1300)];
        let names = |logs: &[Recording]| -> Vec<(String, usize)> {
            LogSet::sorted(logs)
                .logs()
                .iter()
                .map(|log| (log.source().to_string(), log.len()))
                .collect()
        };
        let [a, b, c] = logs.clone();
        assert_eq!(names(&logs), names(&[c, a, b]));
    }
}
