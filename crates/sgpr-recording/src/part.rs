//! Parts of a recording: some of its joints, some of its samples.

use std::borrow::Cow;
use std::fmt::Display;
use std::ops::Range;
use std::sync::Arc;

use super::derived::Derived;
use super::{Channel, IssueKind, Recording, RecordingError, require_joint_list, seconds};

impl Recording {
    /// The joints `names`, in this order.
    ///
    /// # Errors
    /// If a name is not among [`Recording::joint_names`], or twice in `names`.
    pub fn select<S: AsRef<str>>(&self, names: &[S]) -> Result<Self, RecordingError> {
        let names: Vec<String> = names.iter().map(|name| name.as_ref().to_string()).collect();
        require_joint_list(&self.source, &names)?;
        let column = |name: &String| self.joint_names.iter().position(|joint| joint == name);
        let columns = names.iter().map(|name| {
            let unknown = || RecordingError::UnknownJoint {
                recording: self.source.clone(),
                joint: name.clone(),
                known: self.joint_names.clone(),
            };
            column(name).ok_or_else(unknown)
        });
        let columns: Vec<usize> = columns.collect::<Result<_, _>>()?;
        let n = self.dof();
        let same = columns.iter().copied().eq(0..n);
        let pick = |values: &Arc<Vec<f64>>| {
            if same {
                return values.clone();
            }
            Arc::new(
                values.chunks_exact(n).flat_map(|row| columns.iter().map(|&j| row[j])).collect(),
            )
        };
        Ok(Self {
            joint_names: names,
            layout: self.layout.as_ref().map(|layout| layout.select(&columns)),
            position: pick(&self.position),
            velocity: self.velocity.as_ref().map(pick),
            torque: self.torque.as_ref().map(pick),
            ..self.clone()
        })
    }

    /// The joints `names` of a robot. A log that only numbers its joints (`joint_1`, ..., what a
    /// reader makes of `q_1`) is taken by the numbers that the names end in. If these have none and
    /// there are as many, it is taken in the order of its numbers: arrays without further word, as
    /// they come in the order of the robot; files if [`IssueKind::JointsByOrder`] is accepted.
    ///
    /// # Errors
    /// Those of [`Recording::select`], and numbers that do not tell which joint is which.
    #[doc(hidden)]
    pub fn of_robot(&self, names: &[String]) -> Result<Self, RecordingError> {
        let Some(numbers) = self.numbers() else { return self.select(names) };
        if names.iter().any(|name| self.joint_names.contains(name)) {
            return self.select(names);
        }
        let mut in_order = numbers;
        in_order.sort_unstable();
        let own: Option<Vec<u32>> = names.iter().map(|name| ending_number(name)).collect();
        let own = own.and_then(|own| places_of_numbers(&own, &in_order));
        if own.is_none() && in_order.len() != names.len() {
            return self.select(names);
        }
        let confirmed = names.len() == 1
            || self.layout.as_ref().is_none_or(|layout| layout.by_order)
            || self.accepted.contains(&IssueKind::JointsByOrder);
        if own.is_none() && !confirmed {
            let columns = self.layout.as_ref().map(|layout| &layout.joints[..]).unwrap_or_default();
            return Err(RecordingError::JointsByOrder {
                recording: self.source.clone(),
                joints: names.to_vec(),
                columns: columns.iter().map(|joint| joint.position.column.clone()).collect(),
            });
        }
        let called: Vec<String> = own.unwrap_or(in_order).into_iter().map(numbered).collect();
        let chosen = self.select(&called)?;
        Ok(Self {
            joint_names: names.to_vec(),
            layout: chosen.layout.clone().map(|layout| layout.renamed(names)),
            ..chosen
        })
    }

    /// The numbers of the joints if they have no other names.
    fn numbers(&self) -> Option<Vec<u32>> {
        let number =
            |name: &String| ending_number(name).filter(|number| *name == numbered(*number));
        self.joint_names.iter().map(number).collect()
    }

    /// The samples `range`.
    ///
    /// # Panics
    /// If the range reaches beyond the last sample.
    pub fn slice(&self, range: Range<usize>) -> Self {
        assert!(
            range.start <= range.end && range.end <= self.len(),
            "samples {range:?} of {}",
            self.len()
        );
        self.pick(range)
    }

    /// The samples `keep`, in this order.
    pub(super) fn pick(&self, keep: impl Iterator<Item = usize> + Clone) -> Self {
        let n = self.dof();
        let rows = |values: &[f64]| {
            let mut rows = Vec::with_capacity(keep.size_hint().0 * n);
            keep.clone().for_each(|i| rows.extend_from_slice(&values[i * n..(i + 1) * n]));
            rows
        };
        let of_channel = |channel: &Channel| keep.clone().map(|i| channel.values[i]).collect();
        let channels = self.channels.iter();
        Self {
            source: self.source.clone(),
            joint_names: self.joint_names.clone(),
            time: Arc::new(keep.clone().map(|i| self.time[i]).collect()),
            position: Arc::new(rows(&self.position)),
            velocity: self.velocity().map(rows).map(Arc::new),
            torque: self.torque().map(rows).map(Arc::new),
            channels: channels
                .map(|channel| Channel { name: channel.name.clone(), values: of_channel(channel) })
                .collect(),
            notes: self.notes.clone(),
            layout: self.layout.clone(),
            accepted: self.accepted.clone(),
            kept: Derived::default(),
        }
    }

    /// The stretches without a step longer than `longest` seconds.
    pub(super) fn split_at_steps(&self, longest: f64) -> Vec<Self> {
        self.stretches(longest).filter(|part| !part.is_empty()).map(Cow::into_owned).collect()
    }

    /// The stretches without a step longer than `longest` seconds, each copied when its turn comes;
    /// a recording without such a step is its own stretch and not copied.
    fn stretches(&self, longest: f64) -> impl Iterator<Item = Cow<'_, Self>> {
        let steps = self.time.windows(2).enumerate();
        let gaps = steps
            .filter(move |(_, pair)| seconds(pair[0], pair[1]) > longest)
            .map(|(index, _)| index + 1);
        let ends: Vec<usize> = gaps.chain([self.len()]).collect();
        let mut start = 0;
        ends.into_iter().map(move |end| {
            let range = std::mem::replace(&mut start, end)..end;
            if range.len() == self.len() {
                Cow::Borrowed(self)
            } else {
                Cow::Owned(self.slice(range))
            }
        })
    }
}

/// The stretches of a recording between its gaps: steps of the time longer than `factor` median
/// steps (see [`GAP_FACTOR`](super::GAP_FACTOR)). Nothing may be filtered or differentiated across
/// their borders.
///
/// # Panics
/// If `factor` is not greater than 1.
pub fn split_at_gaps(recording: &Recording, factor: f64) -> Vec<Recording> {
    stretches(recording, factor).map(Cow::into_owned).collect()
}

/// [`split_at_gaps`] one after the other, without copying a recording that has no gap.
pub fn stretches(recording: &Recording, factor: f64) -> impl Iterator<Item = Cow<'_, Recording>> {
    assert!(factor > 1.0, "a gap is longer than the usual step: factor {factor}");
    recording.stretches(recording.sample_rate_hz().map_or(f64::INFINITY, |rate| factor / rate))
}

/// What a joint is called that a log only numbers.
pub(super) fn numbered(number: impl Display) -> String {
    format!("joint_{number}")
}

/// The number that a name ends in.
pub(super) fn ending_number(name: &str) -> Option<u32> {
    let stem = name.trim_end_matches(|letter: char| letter.is_ascii_digit());
    name[stem.len()..].parse().ok()
}

/// Which of `numbers` each of the joints is that are numbered `own`: its own one, or, where all
/// count from one and the numbers as many from zero, the one below. `None` if that does not tell.
///
/// - `numbers`: increasing
pub(super) fn places_of_numbers(own: &[u32], numbers: &[u32]) -> Option<Vec<u32>> {
    let mut distinct = own.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    if distinct.len() != own.len() {
        return None;
    }
    // More numbers than joints, from zero: the joint with number one may be the first or the
    // second.
    let either = numbers.first() == Some(&0) && !own.contains(&0) && numbers.len() > own.len();
    if !either && own.iter().all(|number| numbers.binary_search(number).is_ok()) {
        return Some(own.to_vec());
    }
    let count = u32::try_from(own.len()).ok()?;
    let from_one = distinct.iter().copied().eq(1..=count);
    let from_zero = numbers.iter().copied().eq(0..count);
    (from_one && from_zero).then(|| own.iter().map(|number| number - 1).collect())
}

/// Which numbers the joints would have if none of them were missing among `numbers`: their own, or
/// those from one or zero on, the first of these that hold all of them. `None` if no count of that
/// many joints does.
///
/// - `numbers`: increasing
pub(super) fn numbers_with_gaps(
    own: Option<&[u32]>,
    numbers: &[u32],
    joints: usize,
) -> Option<Vec<u32>> {
    let count = u32::try_from(joints).ok()?;
    let counts =
        [own.map(<[u32]>::to_vec), Some((1..=count).collect()), Some((0..count).collect())];
    let holds = |all: &Vec<u32>| numbers.iter().all(|number| all.contains(number));
    let distinct = |all: &Vec<u32>| (1..all.len()).all(|k| !all[..k].contains(&all[k]));
    counts.into_iter().flatten().find(|all| holds(all) && distinct(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_in_the_numbers_is_the_missing_joint() {
        assert_eq!(numbers_with_gaps(Some(&[3, 2, 1]), &[1, 3], 3), Some(vec![3, 2, 1]));
        assert_eq!(numbers_with_gaps(Some(&[11, 12, 13]), &[1, 3], 3), Some(vec![1, 2, 3]));
        assert_eq!(numbers_with_gaps(Some(&[1, 2, 3]), &[0, 2], 3), Some(vec![0, 1, 2]));
        assert_eq!(numbers_with_gaps(None, &[2, 3], 3), Some(vec![1, 2, 3]));
        assert_eq!(numbers_with_gaps(None, &[0, 3], 3), None);
        assert_eq!(numbers_with_gaps(Some(&[1, 1]), &[1], 2), Some(vec![1, 2]));
    }

    #[test]
    fn joints_are_found_by_their_numbers() {
        assert_eq!(places_of_numbers(&[3, 2], &[1, 2, 3]), Some(vec![3, 2]));
        assert_eq!(places_of_numbers(&[2, 1, 3], &[0, 1, 2]), Some(vec![1, 0, 2]));
        assert_eq!(places_of_numbers(&[1, 1], &[0, 1]), None);
        assert_eq!(places_of_numbers(&[1, 2], &[0, 1, 2, 3]), None);
        assert_eq!(places_of_numbers(&[1, 2], &[1, 2, 3]), Some(vec![1, 2]));
        assert_eq!(places_of_numbers(&[2, 3], &[0, 1]), None);
    }

    fn recording() -> Recording {
        let time = [0, 1, 2, 30, 31].map(|ms| ms * 1_000_000).to_vec();
        let position = (0..10).map(f64::from).collect();
        let channels =
            vec![Channel { name: "temperature".into(), values: vec![5.0, 6.0, 7.0, 8.0, 9.0] }];
        Recording::new("test", vec!["a".into(), "b".into()], time, position, None, None, channels)
            .expect("consistent")
    }

    #[test]
    fn joints_are_selected_in_order() {
        let chosen = recording().select(&["b", "a"]).expect("known");
        assert_eq!(chosen.position()[..4], [1.0, 0.0, 3.0, 2.0]);
        assert_eq!(chosen.joint_names(), ["b", "a"]);
        let only = recording().select(&["b"]).expect("known");
        assert_eq!(only.position(), [1.0, 3.0, 5.0, 7.0, 9.0]);
    }

    #[test]
    fn unknown_and_double_joints_are_refused() {
        let message = recording().select(&["c"]).expect_err("unknown").to_string();
        assert_eq!(message, "test: there is no joint `c`; the joints are `a`, `b`");
        let message = recording().select(&["a", "a"]).expect_err("double").to_string();
        assert_eq!(message, "test: the joint `a` occurs twice");
    }

    #[test]
    fn numbered_joints_are_those_of_the_robot() {
        let names = |names: [&str; 2]| names.map(String::from);
        let logged = |own| Recording { joint_names: names(own).to_vec(), ..recording() };
        let first = |log: &Recording, wanted| {
            let chosen = log.of_robot(&names(wanted)).expect("as many");
            assert_eq!(chosen.joint_names(), wanted);
            chosen.position()[..2].to_vec()
        };
        let log = logged(["joint_2", "joint_1"]);
        assert_eq!(first(&log, ["arm_joint1", "arm_joint2"]), [1.0, 0.0], "by number");
        assert_eq!(first(&log, ["shoulder", "elbow"]), [1.0, 0.0], "in order");
        assert_eq!(first(&log, ["joint_2", "joint_1"]), [0.0, 1.0], "by name");
        assert_eq!(
            first(&logged(["joint_0", "joint_1"]), ["j1", "j2"]),
            [0.0, 1.0],
            "counted from zero"
        );
        for (own, wanted) in
            [(["a", "b"], ["c", "d"]), (["joint_1", "joint_2"], ["joint_1", "joint_3"])]
        {
            assert!(logged(own).of_robot(&names(wanted)).is_err(), "{own:?} {wanted:?}");
        }
        let second =
            logged(["joint_1", "joint_2"]).of_robot(&["j2".into()]).expect("its number is there");
        assert_eq!(second.position()[..2], [1.0, 3.0]);
        assert!(logged(["joint_1", "joint_2"]).of_robot(&["j3".into()]).is_err(), "no such number");
        assert!(
            logged(["joint_0", "joint_1"]).of_robot(&["j1".into()]).is_err(),
            "counted from zero or from one"
        );
    }

    #[test]
    fn gaps_split() {
        let parts = split_at_gaps(&recording(), crate::GAP_FACTOR);
        assert_eq!(parts.iter().map(Recording::len).collect::<Vec<_>>(), [3, 2]);
        assert_eq!(parts[1].position(), [6.0, 7.0, 8.0, 9.0]);
        assert_eq!(parts[1].channels()[0].values, [8.0, 9.0]);
    }
}
