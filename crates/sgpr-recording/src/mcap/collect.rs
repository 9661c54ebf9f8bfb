//! Messages, topic by topic, kept as numbers.

use std::collections::HashMap;
use std::rc::Rc;

use super::message::{Content, JointValues, MessageFormat, content};
use super::scan::{Message, Topic};
use super::{Clock, McapOptions};
use crate::RecordingError;

/// More topics, or kinds of messages (lists of joints, names of fields) on one topic, are no log.
const MOST_KINDS: usize = 1000;

/// All messages of the topics that are understood.
pub(super) struct Collector<'a> {
    path: &'a str,
    options: &'a McapOptions,
    /// Index into `logs`; `None` if the topic is not read.
    by_topic: HashMap<Rc<Topic>, Option<usize>>,
    pub(super) logs: Vec<TopicLog>,
    /// Topics that are not read, and why.
    skipped: Vec<String>,
    pub(super) notes: Vec<String>,
    bytes: u64,
}

/// The messages of one topic.
pub(super) struct TopicLog {
    pub(super) topic: Rc<Topic>,
    format: MessageFormat,
    messages: u64,
    /// Whether any message has a stamp.
    stamped: bool,
    /// Whether stamps are the time, or log times.
    by_stamp: bool,
    /// Messages left out because they are broken.
    broken: u64,
    /// Distinct lists of joint names, in order of appearance; `None` for joints without names.
    pub(super) sets: Vec<JointSet>,
    set_index: HashMap<(Option<Vec<String>>, usize), usize>,
    pub(super) states: Vec<JointStateMessage>,
    /// Values of all states.
    pub(super) values: Vec<f64>,
    /// Numbers beside the joints.
    pub(super) series: Vec<Series>,
    series_index: HashMap<String, usize>,
}

/// Names of the joints of a message.
pub(super) struct JointSet {
    pub(super) names: Option<Vec<String>>,
    pub(super) count: usize,
}

/// One joint state: where its values are.
pub(super) struct JointStateMessage {
    times: Times,
    pub(super) set: usize,
    /// Start of position, velocity and effort in `values`, if measured.
    pub(super) starts: [Option<usize>; 3],
}

/// A number over time.
pub(super) struct Series {
    pub(super) name: String,
    points: Vec<(Times, f64)>,
}

/// The two times of a message, ns.
#[derive(Clone, Copy)]
struct Times {
    log: i64,
    /// Log time if there is none.
    stamp: i64,
}

impl<'a> Collector<'a> {
    pub(super) fn new(path: &'a str, options: &'a McapOptions) -> Self {
        Self {
            path,
            options,
            by_topic: HashMap::new(),
            logs: Vec::new(),
            skipped: Vec::new(),
            notes: Vec::new(),
            bytes: 0,
        }
    }

    pub(super) fn take(&mut self, message: Message) -> Result<(), RecordingError> {
        let Some(index) = self.log_of(&message) else { return Ok(()) };
        let log = &mut self.logs[index];
        log.messages += 1;
        let result = content(log.format, &message.topic.encoding, message.data)
            .and_then(|content| log.take(message.log_time, content));
        match result {
            Ok(bytes) => self.bytes += bytes,
            Err(_) if self.options.recover => log.broken += 1,
            Err(cause) => {
                let (topic, index) = (log.topic.name.clone(), log.messages);
                return Err(RecordingError::Message {
                    path: self.path.into(),
                    topic,
                    index,
                    cause,
                });
            }
        }
        let limit = self.options.limit_bytes;
        if self.bytes > limit {
            Err(RecordingError::TooLarge { path: self.path.into(), limit })
        } else {
            Ok(())
        }
    }

    /// The log of the topic of a message; channels of one topic share it.
    fn log_of(&mut self, message: &Message) -> Option<usize> {
        if let Some(known) = self.by_topic.get(message.topic) {
            return *known;
        }
        let topic = message.topic;
        let index = match MessageFormat::of(topic) {
            Ok(format) => {
                let known = self
                    .logs
                    .iter()
                    .position(|log| log.topic.name == topic.name && log.format == format);
                known.or_else(|| self.new_log(topic, format))
            }
            Err(reason) => {
                self.skip(topic, &reason);
                None
            }
        };
        self.by_topic.insert(topic.clone(), index);
        index
    }

    fn new_log(&mut self, topic: &Rc<Topic>, format: MessageFormat) -> Option<usize> {
        if self.logs.len() == MOST_KINDS {
            self.skip(topic, "too many topics");
            return None;
        }
        self.logs.push(TopicLog::new(topic.clone(), format));
        Some(self.logs.len() - 1)
    }

    fn skip(&mut self, topic: &Topic, reason: &str) {
        let entry = format!("{} ({reason})", topic.name);
        if self.skipped.len() < MOST_KINDS && !self.skipped.contains(&entry) {
            self.skipped.push(entry);
        }
    }

    /// Brings messages into the order in which they were logged, and says what was odd.
    pub(super) fn finish(&mut self) {
        for log in &mut self.logs {
            let name = &log.topic.name;
            if log.broken > 0 {
                self.notes.push(format!(
                    "`{name}`: left out {} broken messages of {}",
                    log.broken, log.messages
                ));
            }
            log.by_stamp = log.stamped && self.options.clock == Clock::HeaderStamp;
            if !log.states.is_empty() && !log.stamped && self.options.clock == Clock::HeaderStamp {
                self.notes.push(format!(
                    "`{name}`: the messages have no stamps; the time is the log time"
                ));
            }
            log.states.sort_by_key(|state| state.times.log);
        }
        if !self.skipped.is_empty() {
            self.notes.push(format!("skipped topics: {}", self.skipped.join(", ")));
        }
    }
}

impl TopicLog {
    fn new(topic: Rc<Topic>, format: MessageFormat) -> Self {
        Self {
            topic,
            format,
            messages: 0,
            stamped: false,
            by_stamp: false,
            broken: 0,
            sets: Vec::new(),
            set_index: HashMap::new(),
            states: Vec::new(),
            values: Vec::new(),
            series: Vec::new(),
            series_index: HashMap::new(),
        }
    }

    /// Keeps a message; returns about how many bytes that takes.
    fn take(&mut self, log_time: u64, content: Content) -> Result<u64, String> {
        let log = i64::try_from(log_time)
            .map_err(|_| format!("the log time {log_time} ns is too large"))?;
        let times = Times { log, stamp: content.stamp.unwrap_or(log) };
        self.stamped |= content.stamp.is_some_and(|stamp| stamp != 0);
        let mut bytes = 0;
        if let Some(joints) = content.joints {
            bytes += 8 * (joints.arrays().iter().map(|values| values.len()).sum::<usize>() + 8);
            self.take_joints(times, joints)?;
        }
        for (name, value) in content.numbers {
            bytes += 24;
            let index = match self.series_index.get(&name) {
                Some(&index) => index,
                None if self.series.len() < MOST_KINDS => {
                    self.series_index.insert(name.clone(), self.series.len());
                    self.series.push(Series { name, points: Vec::new() });
                    self.series.len() - 1
                }
                None => {
                    return Err(format!("more than {MOST_KINDS} different fields on one topic"));
                }
            };
            self.series[index].points.push((times, value));
        }
        Ok(bytes as u64)
    }

    fn take_joints(&mut self, times: Times, joints: JointValues) -> Result<(), String> {
        let starts = joints.arrays().map(|values| {
            let start = self.values.len();
            self.values.extend(values);
            (!values.is_empty()).then_some(start)
        });
        let key = (joints.names.clone(), joints.count());
        let set = match self.set_index.get(&key) {
            Some(&set) => set,
            None if self.sets.len() < MOST_KINDS => {
                self.sets.push(JointSet { count: joints.count(), names: joints.names });
                self.set_index.insert(key, self.sets.len() - 1);
                self.sets.len() - 1
            }
            None => {
                return Err(format!(
                    "more than {MOST_KINDS} different lists of joints on one topic"
                ));
            }
        };
        self.states.push(JointStateMessage { times, set, starts });
        Ok(())
    }

    fn time_of(&self, times: Times) -> i64 {
        if self.by_stamp { times.stamp } else { times.log }
    }

    /// Time of a joint state, ns.
    pub(super) fn time(&self, state: &JointStateMessage) -> i64 {
        self.time_of(state.times)
    }

    /// Time (ns) and value of a series.
    pub(super) fn points(&self, series: &Series) -> Vec<(i64, f64)> {
        series.points.iter().map(|(times, value)| (self.time_of(*times), *value)).collect()
    }
}
