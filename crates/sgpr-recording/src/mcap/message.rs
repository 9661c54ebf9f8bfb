//! What one message says: a joint state, other numbers, or nothing that a recording can hold.

use serde_json::Value;

use super::bytes::MessageFault;
use super::cdr::Cdr;
use super::scan::Topic;
use crate::TimeUnit;
use crate::decimal::nanoseconds;
use crate::names::counted;

/// No robot has more joints; a message that says so is broken.
pub(super) const MOST_JOINTS: usize = 1000;
/// Longest JSON message, bytes: it takes some twenty times as much memory.
const LONGEST_JSON: usize = 1 << 20;

/// What the messages of ROS 1 are encoded as.
pub(crate) const ROS1: &str = "ros1";

/// How the messages of a topic are understood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum MessageFormat {
    JointState,
    Float32,
    Float64,
    Float64MultiArray,
    Temperature,
    Json,
}

impl MessageFormat {
    /// The format of a topic, or why its messages are not read.
    pub(crate) fn of(topic: &Topic) -> Result<Self, String> {
        match topic.encoding.as_str() {
            "json" => return Ok(Self::Json),
            "cdr" | ROS1 => {}
            "" => return Err("no encoding".into()),
            other => return Err(format!("encoding {other}")),
        }
        match topic.schema.replace("/msg/", "/").as_str() {
            "sensor_msgs/JointState" => Ok(Self::JointState),
            "std_msgs/Float32" => Ok(Self::Float32),
            "std_msgs/Float64" => Ok(Self::Float64),
            "std_msgs/Float64MultiArray" => Ok(Self::Float64MultiArray),
            "sensor_msgs/Temperature" => Ok(Self::Temperature),
            _ => Err(topic.schema.clone()),
        }
    }
}

/// What a message says.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Content {
    /// ns; zero is how ROS says that there is none
    pub(super) stamp: Option<i64>,
    pub(super) joints: Option<JointValues>,
    /// Numbers beside the joints, with the names of their fields; empty for a message that is one
    /// number.
    pub(super) numbers: Vec<(String, f64)>,
}

/// A joint state; an array is empty if it was not measured.
#[derive(Debug, Default, PartialEq)]
pub(super) struct JointValues {
    /// `None` if the message does not name its joints.
    pub(super) names: Option<Vec<String>>,
    pub(super) position: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    pub(super) effort: Vec<f64>,
}

impl JointValues {
    pub(super) fn arrays(&self) -> [&[f64]; 3] {
        [&self.position, &self.velocity, &self.effort]
    }

    /// Number of joints.
    pub(super) fn count(&self) -> usize {
        self.names.as_ref().map_or(self.position.len(), Vec::len)
    }

    fn checked(self) -> Result<Self, MessageFault> {
        let count = self.count();
        for (array, values) in ["positions", "velocities", "efforts"].into_iter().zip(self.arrays())
        {
            if !values.is_empty() && values.len() != count {
                return Err(format!("{} {array} for {}", values.len(), counted(count, "joint")));
            }
        }
        if count > MOST_JOINTS {
            return Err(format!("{count} joints, at most {MOST_JOINTS} are read"));
        }
        let mut names: Vec<&String> = self.names.iter().flatten().collect();
        names.sort_unstable();
        match names.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(format!("the joint `{}` occurs twice", pair[0])),
            None => Ok(self),
        }
    }
}

/// Reads a message.
pub(super) fn content(
    format: MessageFormat,
    encoding: &str,
    data: &[u8],
) -> Result<Content, MessageFault> {
    if format == MessageFormat::Json {
        return json(data);
    }
    let mut cdr = if encoding == ROS1 { Cdr::ros1(data) } else { Cdr::new(data)? };
    let number = |name: &str, value: f64| Content {
        numbers: vec![(name.into(), value)],
        ..Content::default()
    };
    Ok(match format {
        MessageFormat::Float32 => number("", f64::from(cdr.f32()?)),
        MessageFormat::Float64 => number("", cdr.f64()?),
        MessageFormat::Float64MultiArray => {
            Content { numbers: numbered("", &multi_array(&mut cdr)?), ..Content::default() }
        }
        MessageFormat::Temperature => {
            let stamp = Some(cdr.header()?);
            Content { stamp, ..number("temperature", cdr.f64()?) }
        }
        MessageFormat::JointState | MessageFormat::Json => {
            let stamp = Some(cdr.header()?);
            let names = cdr.texts(MOST_JOINTS)?.into_iter().map(|name| name.into_owned()).collect();
            let (position, velocity, effort) = (cdr.f64s()?, cdr.f64s()?, cdr.f64s()?);
            let joints =
                JointValues { names: Some(names), position, velocity, effort }.checked()?;
            Content { stamp, joints: Some(joints), numbers: Vec::new() }
        }
    })
}

/// `std_msgs/msg/Float64MultiArray`: the data, whatever their layout.
fn multi_array(cdr: &mut Cdr) -> Result<Vec<f64>, MessageFault> {
    for _ in 0..cdr.u32()? {
        cdr.text()?; // label
        cdr.u32()?; // size
        cdr.u32()?; // stride
    }
    cdr.u32()?; // data offset
    cdr.f64s()
}

fn numbered(name: &str, values: &[f64]) -> Vec<(String, f64)> {
    let separator = if name.is_empty() { "" } else { "_" };
    values
        .iter()
        .enumerate()
        .map(|(index, value)| (format!("{name}{separator}{}", index + 1), *value))
        .collect()
}

fn json(data: &[u8]) -> Result<Content, MessageFault> {
    if data.len() > LONGEST_JSON {
        return Err(format!(
            "a JSON message of {} bytes, at most {LONGEST_JSON} are read",
            data.len()
        ));
    }
    let value: Value =
        serde_json::from_slice(data).map_err(|error| format!("not JSON: {error}"))?;
    let Value::Object(mut fields) = value else {
        let numbers = number(&value).map(|value| (String::new(), value));
        return Ok(Content { numbers: numbers.into_iter().collect(), ..Content::default() });
    };
    let mut take = |names: &[&str]| names.iter().find_map(|name| fields.remove(*name));
    let stamp = match take(&["header"]) {
        Some(mut header) => stamp(&header["stamp"].take()),
        None => None,
    };
    let stamp =
        stamp.or_else(|| take(&["t", "time", "timestamp", "stamp"]).as_ref().and_then(self::stamp));
    let names = take(&["name", "names", "joint_names"])
        .and_then(|names| serde_json::from_value(names).ok());
    let position = take(&["position", "positions", "q"]);
    let joints = match position.as_ref().map(array) {
        Some(Some(position)) => {
            let mut others = |names| take(names).as_ref().and_then(array).unwrap_or_default();
            let velocity = others(&["velocity", "velocities", "dq", "qd"]);
            let effort = others(&["effort", "efforts", "torque", "torques", "tau"]);
            Some(JointValues { names, position, velocity, effort }.checked()?)
        }
        _ => None,
    };
    let mut numbers = Vec::new();
    if let (None, Some(position)) = (&joints, &position) {
        flatten("position", position, &mut numbers);
    }
    for (name, value) in &fields {
        flatten(name, value, &mut numbers);
    }
    Ok(Content { stamp, joints, numbers })
}

/// A list of numbers, `null` for what was not measured.
fn array(value: &Value) -> Option<Vec<f64>> {
    let number = |value: &Value| if value.is_null() { Some(f64::NAN) } else { value.as_f64() };
    value.as_array()?.iter().map(number).collect()
}

fn number(value: &Value) -> Option<f64> {
    value.as_f64().or_else(|| value.as_bool().map(f64::from))
}

/// A stamp: `{"sec": .., "nanosec": ..}`, or a number of seconds, or a large one of smaller units
/// since 1970.
fn stamp(value: &Value) -> Option<i64> {
    if let Some(seconds) = value["sec"].as_i64().or_else(|| value["secs"].as_i64()) {
        let parts = ["nanosec", "nsec", "nsecs"].into_iter();
        let nanoseconds = parts.filter_map(|part| value[part].as_i64()).next().unwrap_or(0);
        seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds)
    } else {
        let number = value.as_number()?;
        nanoseconds(&number.to_string(), TimeUnit::likely(number.as_f64()?).power_of_ten())
    }
}

/// The numbers in `value`: `a/b` for the field b of a, `a_1` for the first element of a.
fn flatten(name: &str, value: &Value, numbers: &mut Vec<(String, f64)>) {
    match value {
        Value::Object(fields) => {
            fields
                .iter()
                .for_each(|(field, value)| flatten(&format!("{name}/{field}"), value, numbers));
        }
        Value::Array(_) => {
            numbers.extend(array(value).map(|values| numbered(name, &values)).unwrap_or_default())
        }
        value => numbers.extend(number(value).map(|value| (name.to_string(), value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Content {
        content(MessageFormat::Json, "json", text.as_bytes()).expect("JSON")
    }

    #[test]
    fn json_joint_states() {
        let message = read(
            r#"{"header": {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": ""}, "name": ["a", "b"], "position": [1, 2.5],
                "velocity": [], "effort": [0.5, null], "mode": "x", "current": [1, 2]}"#,
        );
        assert_eq!(message.stamp, Some(5_000_000_007));
        let joints = message.joints.expect("positions");
        assert_eq!(joints.names, Some(vec!["a".to_string(), "b".to_string()]));
        assert_eq!(joints.position, [1.0, 2.5]);
        assert!(joints.velocity.is_empty());
        assert!(joints.effort[0] == 0.5 && joints.effort[1].is_nan());
        assert_eq!(
            message.numbers,
            [("current_1".to_string(), 1.0), ("current_2".to_string(), 2.0)]
        );
    }

    #[test]
    fn json_without_names() {
        let message = read(r#"{"t": 60.004, "q": [1, 2], "dq": [3, 4], "tau": [5, 6]}"#);
        assert_eq!(message.stamp, Some(60_004_000_000));
        let joints = message.joints.expect("positions");
        assert_eq!((joints.names, joints.effort), (None, vec![5.0, 6.0]));
    }

    #[test]
    fn json_numbers() {
        let message = read(
            r#"{"timestamp": 1700000000123456789, "temperature": 41.2, "motor": {"on": true, "id": "x"}}"#,
        );
        assert_eq!(message.stamp, Some(1_700_000_000_123_456_789));
        assert_eq!(
            message.numbers,
            [("motor/on".to_string(), 1.0), ("temperature".to_string(), 41.2)]
        );
        assert_eq!(read("3.5").numbers, [(String::new(), 3.5)]);
        assert_eq!(read("[1]"), Content::default());
    }

    #[test]
    fn faults_are_named() {
        let fault =
            |text: &str| content(MessageFormat::Json, "json", text.as_bytes()).expect_err("broken");
        assert!(fault("{").starts_with("not JSON"));
        assert_eq!(fault(r#"{"name": ["a"], "position": [1, 2]}"#), "2 positions for 1 joint");
        assert_eq!(
            fault(r#"{"name": ["a", "a"], "position": [1, 2]}"#),
            "the joint `a` occurs twice"
        );
        assert_eq!(fault(r#"{"q": [1, 2], "tau": [1]}"#), "1 efforts for 2 joints");
    }
}
