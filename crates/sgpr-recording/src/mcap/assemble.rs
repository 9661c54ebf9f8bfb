//! From the messages of all topics to one recording.

use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use super::McapOptions;
use super::collect::{Collector, JointStateMessage, Series, TopicLog};
use super::message::MOST_JOINTS;
use super::scan::Topic;
use crate::names::quoted;
use crate::part::numbered;
use crate::resample::BetweenSamples;
use crate::statistics::median;
use crate::{Channel, GAP_FACTOR, Recording, RecordingError, seconds};

pub(super) fn assemble(
    path: &str,
    topics: &[Rc<Topic>],
    collector: Collector,
    options: &McapOptions,
) -> Result<Recording, RecordingError> {
    let Collector { logs, mut notes, .. } = collector;
    let chosen = choose(path, topics, &logs, options)?;
    let wanted = wanted_names(&logs, &chosen, options);
    let streams = streams(path, &logs, &chosen, &wanted, &mut notes)?;
    let Merged { time, arrays: [position, velocity, effort] } =
        merge(path, &logs, &streams, wanted.len(), &mut notes)?;

    let mut tracks: Vec<NumberTrack> = Vec::new();
    for (index, log) in logs.iter().enumerate() {
        tracks.extend(log.series.iter().map(|series| NumberTrack::of_series(log, series)));
        if !chosen.contains(&index) {
            tracks.extend(NumberTrack::of_joints(log));
        }
    }
    if (tracks.len() * time.len()) as u64 > options.limit_bytes / 8 {
        return Err(RecordingError::TooLarge { path: path.into(), limit: options.limit_bytes });
    }
    let channels = tracks.into_iter().map(|track| track.held(&time)).collect();
    let joints = options.joints.clone().unwrap_or(wanted);
    let position = position.expect("streams have positions");
    Ok(Recording::new(path, joints, time, position, velocity, effort, channels)?.with_notes(notes))
}

/// Logs that joints are taken from.
fn choose(
    path: &str,
    topics: &[Rc<Topic>],
    logs: &[TopicLog],
    options: &McapOptions,
) -> Result<Vec<usize>, RecordingError> {
    let has_positions = |log: &TopicLog| log.states.iter().any(|state| state.starts[0].is_some());
    let candidates: Vec<usize> =
        (0..logs.len()).filter(|&index| has_positions(&logs[index])).collect();
    if candidates.is_empty() {
        let topics = topics
            .iter()
            .map(|topic| format!("{} ({}, {})", topic.name, topic.schema, topic.encoding));
        return Err(RecordingError::NoJointStates { path: path.into(), topics: topics.collect() });
    }
    let Some(names) = &options.topics else { return Ok(candidates) };
    let known = || candidates.iter().map(|&index| logs[index].topic.name.clone()).collect();
    let find = |name: &String| {
        let found = candidates.iter().copied().find(|&index| logs[index].topic.name == *name);
        found.ok_or_else(|| RecordingError::UnknownTopic {
            path: path.into(),
            topic: name.clone(),
            known: known(),
        })
    };
    let mut chosen: Vec<usize> = names.iter().map(find).collect::<Result<_, _>>()?;
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

/// Names, in the log, of the joints wanted: as asked for, else all in order of appearance.
fn wanted_names(logs: &[TopicLog], chosen: &[usize], options: &McapOptions) -> Vec<String> {
    if let Some(names) = options.logged_names.as_ref().or(options.joints.as_ref()) {
        return names.clone();
    }
    let mut names: Vec<String> = Vec::new();
    for log in chosen.iter().map(|&index| &logs[index]) {
        for set in log.sets_with_positions() {
            for name in log.joint_names(set, &[]) {
                if !names.contains(&name) && names.len() < MOST_JOINTS {
                    names.push(name);
                }
            }
        }
    }
    names
}

impl TopicLog {
    fn sets_with_positions(&self) -> Vec<usize> {
        let mut sets: Vec<usize> = self
            .states
            .iter()
            .filter(|state| state.starts[0].is_some())
            .map(|state| state.set)
            .collect();
        sets.sort_unstable();
        sets.dedup();
        sets
    }

    /// Names of the joints of a set; those without names are called like `wanted` if there are as
    /// many, else by number.
    fn joint_names(&self, set: usize, wanted: &[String]) -> Vec<String> {
        let set = &self.sets[set];
        match &set.names {
            Some(names) => names.clone(),
            None if set.count == wanted.len() => wanted.to_vec(),
            None => (1..=set.count).map(numbered).collect(),
        }
    }

    fn value(&self, state: &JointStateMessage, array: usize, column: usize) -> f64 {
        state.starts[array].map_or(f64::NAN, |start| self.values[start + column])
    }
}

/// Messages of one topic that carry the same wanted joints.
struct Stream {
    log: usize,
    /// Index into the wanted joints, increasing.
    joints: Vec<usize>,
    /// Index of the state in the log, and the columns of the joints in it.
    states: Vec<(usize, Rc<Vec<usize>>)>,
}

fn streams(
    path: &str,
    logs: &[TopicLog],
    chosen: &[usize],
    wanted: &[String],
    notes: &mut Vec<String>,
) -> Result<Vec<Stream>, RecordingError> {
    let mut streams: Vec<Stream> = Vec::new();
    for &log in chosen {
        let mut of_topic = streams_of(log, &logs[log], wanted);
        // The most complete messages first.
        of_topic
            .sort_by_key(|stream| std::cmp::Reverse((stream.joints.len(), stream.states.len())));
        let mut taken: Vec<usize> = Vec::new();
        for stream in of_topic {
            if stream.joints.iter().any(|joint| taken.contains(joint)) {
                let (name, count) = (&logs[log].topic.name, stream.states.len());
                notes.push(format!(
                    "`{name}`: left out {count} messages that lack some of the joints"
                ));
            } else {
                taken.extend(&stream.joints);
                streams.push(stream);
            }
        }
    }
    for (joint, name) in wanted.iter().enumerate() {
        let carriers: Vec<&Stream> =
            streams.iter().filter(|stream| stream.joints.contains(&joint)).collect();
        match carriers[..] {
            [_] => {}
            [] => {
                let names = chosen.iter().flat_map(|&index| {
                    let log = &logs[index];
                    log.sets_with_positions().into_iter().flat_map(|set| log.joint_names(set, &[]))
                });
                let mut known: Vec<String> = names.take(MOST_JOINTS).collect();
                known.sort();
                known.dedup();
                return Err(RecordingError::UnknownJoint {
                    recording: path.into(),
                    joint: name.clone(),
                    known,
                });
            }
            _ => {
                let topics =
                    carriers.iter().map(|stream| logs[stream.log].topic.name.clone()).collect();
                return Err(RecordingError::AmbiguousTopics {
                    path: path.into(),
                    joint: name.clone(),
                    topics,
                });
            }
        }
    }
    Ok(streams)
}

fn streams_of(index: usize, log: &TopicLog, wanted: &[String]) -> Vec<Stream> {
    let mut streams: Vec<Stream> = Vec::new();
    // For each set of the log its stream and columns.
    let mut place: Vec<Option<(usize, Rc<Vec<usize>>)>> = Vec::new();
    for set in 0..log.sets.len() {
        let names = log.joint_names(set, wanted);
        let column = |joint: &String| names.iter().position(|name| name == joint);
        let found =
            wanted.iter().enumerate().filter_map(|(joint, name)| Some((joint, column(name)?)));
        let (joints, columns): (Vec<usize>, Vec<usize>) = found.unzip();
        if joints.is_empty() {
            place.push(None);
            continue;
        }
        let stream =
            streams.iter().position(|stream| stream.joints == joints).unwrap_or_else(|| {
                streams.push(Stream { log: index, joints, states: Vec::new() });
                streams.len() - 1
            });
        place.push(Some((stream, Rc::new(columns))));
    }
    for (number, state) in
        log.states.iter().enumerate().filter(|(_, state)| state.starts[0].is_some())
    {
        if let Some((stream, columns)) = &place[state.set] {
            streams[*stream].states.push((number, columns.clone()));
        }
    }
    streams.retain(|stream| !stream.states.is_empty());
    streams
}

/// Time, and position, velocity and effort of all wanted joints.
struct Merged {
    time: Vec<i64>,
    arrays: [Option<Vec<f64>>; 3],
}

/// Names of the arrays of a joint state.
const ARRAYS: [&str; 3] = ["position", "velocity", "effort"];

fn merge(
    path: &str,
    logs: &[TopicLog],
    streams: &[Stream],
    joints: usize,
    notes: &mut Vec<String>,
) -> Result<Merged, RecordingError> {
    let leader = streams
        .iter()
        .max_by_key(|stream| stream.states.len())
        .expect("every wanted joint has a stream");
    let tracks: Vec<Track> =
        streams.iter().map(|stream| Track::new(&logs[stream.log], stream)).collect();
    let all: Vec<i64> = leader
        .states
        .iter()
        .map(|(state, _)| logs[leader.log].time(&logs[leader.log].states[*state]))
        .collect();
    let rows: Vec<(i64, Vec<BetweenSamples>)> = if streams.len() == 1 {
        (0..all.len())
            .map(|before| (all[before], vec![BetweenSamples { before, fraction: 0.0 }]))
            .collect()
    } else {
        let places = |time: i64| {
            tracks.iter().map(|track| track.place(time)).collect::<Option<Vec<BetweenSamples>>>()
        };
        all.iter().filter_map(|&time| Some((time, places(time)?))).collect()
    };
    if rows.is_empty() {
        let topics = streams.iter().map(|stream| logs[stream.log].topic.name.clone()).collect();
        return Err(RecordingError::NoCommonTime { path: path.into(), topics });
    }
    if streams.len() > 1 {
        notes.push(merge_note(logs, streams, all.len(), &rows));
    }
    let arrays = [0, 1, 2].map(|array| {
        let lacking: Vec<String> = tracks
            .iter()
            .filter(|track| !track.has(array))
            .map(|track| logs[track.stream.log].topic.name.clone())
            .collect();
        if !lacking.is_empty() {
            if lacking.len() < tracks.len() {
                notes.push(format!(
                    "no {}: the topics {} have none",
                    ARRAYS[array],
                    quoted(&lacking)
                ));
            }
            return None;
        }
        let mut values = vec![f64::NAN; rows.len() * joints];
        for (row, (_, places)) in values.chunks_exact_mut(joints).zip(&rows) {
            for (track, place) in tracks.iter().zip(places) {
                track.fill(row, place, array);
            }
        }
        Some(values)
    });
    Ok(Merged { time: rows.into_iter().map(|(time, _)| time).collect(), arrays })
}

fn merge_note(
    logs: &[TopicLog],
    streams: &[Stream],
    all: usize,
    rows: &[(i64, Vec<BetweenSamples>)],
) -> String {
    let topics: Vec<String> =
        streams.iter().map(|stream| logs[stream.log].topic.name.clone()).collect();
    let between =
        rows.iter().filter(|(_, places)| places.iter().any(|place| place.fraction != 0.0)).count();
    format!(
        "merged the joints of {}: {} of {all} samples have all joints, in {between} of them some \
         are interpolated between messages",
        quoted(&topics),
        rows.len(),
    )
}

/// The messages of a stream in the order of their stamps.
struct Track<'a> {
    log: &'a TopicLog,
    stream: &'a Stream,
    /// Stamp, and index into the states of the stream.
    order: Vec<(i64, usize)>,
    /// Longest time between two messages to interpolate between, s.
    longest: f64,
}

impl<'a> Track<'a> {
    fn new(log: &'a TopicLog, stream: &'a Stream) -> Self {
        let times = stream.states.iter().map(|(state, _)| log.time(&log.states[*state]));
        let mut order: Vec<(i64, usize)> =
            times.enumerate().map(|(index, time)| (time, index)).collect();
        order.sort_by_key(|(time, _)| *time);
        let mut steps: Vec<f64> =
            order.windows(2).map(|pair| seconds(pair[0].0, pair[1].0)).collect();
        Self { log, stream, order, longest: GAP_FACTOR * median(&mut steps) }
    }

    /// Where `time` lies in the order; `None` if no messages are near enough.
    fn place(&self, time: i64) -> Option<BetweenSamples> {
        let before = self.order.partition_point(|(stamp, _)| *stamp <= time).checked_sub(1)?;
        let from = self.order[before].0;
        if from == time {
            return Some(BetweenSamples { before, fraction: 0.0 });
        }
        let step = seconds(from, self.order.get(before + 1)?.0);
        (step <= self.longest)
            .then(|| BetweenSamples { before, fraction: seconds(from, time) / step })
    }

    fn has(&self, array: usize) -> bool {
        self.stream.states.iter().any(|(state, _)| self.log.states[*state].starts[array].is_some())
    }

    /// Puts the values of the joints at `place` into a row of all joints.
    fn fill(&self, row: &mut [f64], place: &BetweenSamples, array: usize) {
        for (position, &joint) in self.stream.joints.iter().enumerate() {
            row[joint] = place.linear(|index| {
                let (state, columns) = &self.stream.states[self.order[index].1];
                self.log.value(&self.log.states[*state], array, columns[position])
            });
        }
    }
}

/// A number over time, under its full name.
struct NumberTrack {
    name: String,
    /// Time (ns) and value, in the order of time.
    points: Vec<(i64, f64)>,
}

impl NumberTrack {
    fn new(name: String, mut points: Vec<(i64, f64)>) -> Self {
        points.sort_by_key(|(time, _)| *time);
        Self { name, points }
    }

    /// A field of the messages of a topic.
    fn of_series(log: &TopicLog, series: &Series) -> Self {
        let topic = &log.topic.name;
        let name =
            if series.name.is_empty() { topic.clone() } else { format!("{topic}/{}", series.name) };
        Self::new(name, log.points(series))
    }

    /// The joint states of a topic: `topic/joint/position`.
    fn of_joints(log: &TopicLog) -> Vec<Self> {
        let mut tracks: BTreeMap<(usize, usize), Self> = BTreeMap::new();
        let mut numbers: HashMap<String, usize> = HashMap::new();
        let names: Vec<Vec<String>> =
            (0..log.sets.len()).map(|set| log.joint_names(set, &[])).collect();
        for state in &log.states {
            for (column, joint) in names[state.set].iter().enumerate() {
                let next = numbers.len();
                let number = *numbers.entry(joint.clone()).or_insert(next);
                for array in (0..ARRAYS.len()).filter(|&array| state.starts[array].is_some()) {
                    let name = || format!("{}/{joint}/{}", log.topic.name, ARRAYS[array]);
                    let track = tracks
                        .entry((array, number))
                        .or_insert_with(|| Self::new(name(), Vec::new()));
                    track.points.push((log.time(state), log.value(state, array, column)));
                }
            }
        }
        tracks.into_values().map(|track| Self::new(track.name, track.points)).collect()
    }

    /// The last value received at each time.
    fn held(self, time: &[i64]) -> Channel {
        let last = |time: &i64| {
            let received = self.points.partition_point(|(stamp, _)| stamp <= time);
            received.checked_sub(1).map_or(f64::NAN, |index| self.points[index].1)
        };
        Channel { values: time.iter().map(last).collect(), name: self.name }
    }
}
