use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions};

use super::cdr::CdrWriter;
use crate::{Recording, RecordingError, write_file};

/// Definition of `sensor_msgs/msg/JointState` with all it refers to, so that readers need no ROS.
const JOINT_STATE: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Writes recordings as an MCAP file of profile `ros2`, packed with zstd: one topic with
/// `sensor_msgs/msg/JointState` messages for each (topic, recording), e.g. measured, predicted and
/// residual torques. Foxglove, PlotJuggler and ROS 2 read it. An existing file is replaced only by
/// the whole new one.
///
/// Stamp and log time of a message are the time of the sample. Channels are not written.
///
/// # Errors
/// If the file cannot be written, or a time is negative or beyond 2^31 s.
///
/// # Examples
/// ```no_run
/// # fn write(measured: &sgpr_recording::Recording, predicted: &sgpr_recording::Recording)
/// # -> Result<(), sgpr_recording::RecordingError> {
/// use sgpr_recording::mcap;
/// mcap::write("compare.mcap", &[("/measured", measured), ("/predicted", predicted)])?;
/// # Ok(()) }
/// ```
pub fn write(path: impl AsRef<Path>, topics: &[(&str, &Recording)]) -> Result<(), RecordingError> {
    for (_, recording) in topics {
        if let Some(&nanoseconds) = recording.time().iter().find(|&&time| stamp(time).is_none()) {
            return Err(RecordingError::StampRange {
                recording: recording.source().into(),
                nanoseconds,
            });
        }
    }
    write_file(path.as_ref(), |file| write_messages(file, topics).map_err(io_error))
}

pub(super) fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        error => io::Error::other(error.to_string()),
    }
}

fn write_messages(
    file: impl io::Write + io::Seek,
    topics: &[(&str, &Recording)],
) -> Result<(), McapError> {
    let options =
        WriteOptions::new().profile("ros2").library(concat!("sgpr ", env!("CARGO_PKG_VERSION")));
    let mut file = options.compression(Some(Compression::Zstd)).create(file)?;
    let schema =
        file.add_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.as_bytes())?;
    let mut channels = Vec::with_capacity(topics.len());
    for (topic, _) in topics {
        channels.push(file.add_channel(schema, topic, "cdr", &BTreeMap::new())?);
    }

    let samples = topics.iter().enumerate();
    let mut order: Vec<(i64, usize, usize)> = samples
        .flat_map(|(topic, (_, recording))| {
            recording.time().iter().enumerate().map(move |(sample, time)| (*time, topic, sample))
        })
        .collect();
    order.sort_unstable();
    for (time, topic, sample) in order {
        let log_time = time.unsigned_abs();
        let sequence = u32::try_from(sample).unwrap_or(u32::MAX);
        let header = MessageHeader {
            channel_id: channels[topic],
            sequence,
            log_time,
            publish_time: log_time,
        };
        file.write_to_known_channel(&header, &joint_state(topics[topic].1, sample))?;
    }
    file.finish().map(drop)
}

/// Seconds and nanoseconds of a ROS 2 stamp.
pub(super) fn stamp(time: i64) -> Option<(u32, u32)> {
    let seconds = i32::try_from(time.div_euclid(1_000_000_000)).ok()?;
    let nanoseconds = time.rem_euclid(1_000_000_000) as u32;
    u32::try_from(seconds).ok().map(|seconds| (seconds, nanoseconds))
}

fn joint_state(recording: &Recording, sample: usize) -> Vec<u8> {
    let n = recording.dof();
    let row = |values: Option<&'_ [f64]>| {
        values.map_or(vec![], |values| values[sample * n..(sample + 1) * n].to_vec())
    };
    let (seconds, nanoseconds) = stamp(recording.time()[sample]).expect("checked before writing");
    let mut message = CdrWriter::new();
    message.u32(seconds);
    message.u32(nanoseconds);
    message.text(""); // frame_id
    message.texts(recording.joint_names());
    message.f64s(&row(Some(recording.position())));
    message.f64s(&row(recording.velocity()));
    message.f64s(&row(recording.torque()));
    message.finish()
}
