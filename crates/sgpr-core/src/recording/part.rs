//! Parts of a recording: some of its joints, some of its samples.

use std::borrow::Cow;
use std::fmt::Display;
use std::ops::Range;

use super::{Channel, Recording, RecordingError, require_joint_list, seconds};

/// A step of the time longer than this many median steps is a gap.
pub const GAP_FACTOR: f64 = 5.0;

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
        let pick = |values: &[f64]| values.chunks_exact(n).flat_map(|row| columns.iter().map(|&j| row[j])).collect();
        Ok(Self {
            joint_names: names,
            position: pick(&self.position),
            velocity: self.velocity.as_deref().map(pick),
            torque: self.torque.as_deref().map(pick),
            ..self.clone()
        })
    }

    /// The joints `names` of a robot. A log that only numbers as many joints (`joint_1`, ..., what a reader makes of
    /// `q_1`) is taken by the numbers that the names end in, else in the order of its numbers.
    ///
    /// # Errors
    /// Those of [`Recording::select`].
    pub(crate) fn of_robot(&self, names: &[String]) -> Result<Self, RecordingError> {
        let Some(numbers) = self.numbers().filter(|numbers| numbers.len() == names.len()) else {
            return self.select(names);
        };
        if names.iter().any(|name| self.joint_names.contains(name)) {
            return self.select(names);
        }
        let sorted = |mut numbers: Vec<u32>| {
            numbers.sort_unstable();
            numbers
        };
        let in_order = sorted(numbers);
        let own: Option<Vec<u32>> = names.iter().map(|name| ending_number(name)).collect();
        let wanted = own.filter(|own| sorted(own.clone()) == in_order).unwrap_or(in_order);
        let called: Vec<String> = wanted.into_iter().map(numbered).collect();
        Ok(Self { joint_names: names.to_vec(), ..self.select(&called)? })
    }

    /// The numbers of the joints if they have no other names.
    fn numbers(&self) -> Option<Vec<u32>> {
        let number = |name: &String| ending_number(name).filter(|number| *name == numbered(*number));
        self.joint_names.iter().map(number).collect()
    }

    /// The samples `range`.
    ///
    /// # Panics
    /// If the range reaches beyond the last sample.
    pub fn slice(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "samples {range:?} of {}", self.len());
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
            time: keep.clone().map(|i| self.time[i]).collect(),
            position: rows(&self.position),
            velocity: self.velocity.as_deref().map(rows),
            torque: self.torque.as_deref().map(rows),
            channels: channels
                .map(|channel| Channel { name: channel.name.clone(), values: of_channel(channel) })
                .collect(),
            notes: self.notes.clone(),
        }
    }

    /// The stretches without a step longer than `longest` seconds.
    pub(super) fn split_at_steps(&self, longest: f64) -> Vec<Self> {
        self.stretches(longest).filter(|part| !part.is_empty()).map(Cow::into_owned).collect()
    }

    /// The stretches without a step longer than `longest` seconds, each copied when its turn comes; a recording without
    /// such a step is its own stretch and not copied.
    fn stretches(&self, longest: f64) -> impl Iterator<Item = Cow<'_, Self>> {
        let steps = self.time.windows(2).enumerate();
        let gaps = steps.filter(move |(_, pair)| seconds(pair[0], pair[1]) > longest).map(|(index, _)| index + 1);
        let ends: Vec<usize> = gaps.chain([self.len()]).collect();
        let mut start = 0;
        ends.into_iter().map(move |end| {
            let range = std::mem::replace(&mut start, end)..end;
            if range.len() == self.len() { Cow::Borrowed(self) } else { Cow::Owned(self.slice(range)) }
        })
    }
}

/// The stretches of a recording between its gaps: steps of the time longer than `factor` median steps (see
/// [`GAP_FACTOR`]). Nothing may be filtered or differentiated across their borders.
///
/// # Panics
/// If `factor` is not greater than 1.
pub fn split_at_gaps(recording: &Recording, factor: f64) -> Vec<Recording> {
    stretches(recording, factor).map(Cow::into_owned).collect()
}

/// [`split_at_gaps`] one after the other, without copying a recording that has no gap.
pub(crate) fn stretches(recording: &Recording, factor: f64) -> impl Iterator<Item = Cow<'_, Recording>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> Recording {
        let time = [0, 1, 2, 30, 31].map(|ms| ms * 1_000_000).to_vec();
        let position = (0..10).map(f64::from).collect();
        let channels = vec![Channel { name: "temperature".into(), values: vec![5.0, 6.0, 7.0, 8.0, 9.0] }];
        Recording::new("test", vec!["a".into(), "b".into()], time, position, None, None, channels).expect("consistent")
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
        assert_eq!(first(&logged(["joint_0", "joint_1"]), ["j1", "j2"]), [0.0, 1.0], "counted from zero");
        for (own, wanted) in [(["a", "b"], ["c", "d"]), (["joint_1", "joint_2"], ["joint_1", "joint_3"])] {
            assert!(logged(own).of_robot(&names(wanted)).is_err(), "{own:?} {wanted:?}");
        }
        assert!(logged(["joint_1", "joint_2"]).of_robot(&["j1".into()]).is_err(), "not as many");
    }

    #[test]
    fn gaps_split() {
        let parts = split_at_gaps(&recording(), GAP_FACTOR);
        assert_eq!(parts.iter().map(Recording::len).collect::<Vec<_>>(), [3, 2]);
        assert_eq!(parts[1].position(), [6.0, 7.0, 8.0, 9.0]);
        assert_eq!(parts[1].channels()[0].values, [8.0, 9.0]);
    }
}
