use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions};

use super::cdr::CdrWriter;
use super::write::{io_error, stamp};
use crate::{RecordingError, write_file};

/// Definition of `trajectory_msgs/msg/JointTrajectory` with all it refers to.
const JOINT_TRAJECTORY: &str = "\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
";

/// Writes an MCAP file of profile `ros2` with one `trajectory_msgs/msg/JointTrajectory` message on
/// `topic`, stamped zero: what a `joint_trajectory_controller` takes.
///
/// - `time`: `[samples]`, s from the start
/// - `q`, `dq`, `ddq`: `[samples, n]`, rad (m), per s, per s²
///
/// # Errors
/// If the file cannot be written, or a time is negative or beyond 2^31 s.
///
/// # Panics
/// If the arrays do not hold the same samples.
pub fn write_joint_trajectory(
    path: impl AsRef<Path>,
    topic: &str,
    joint_names: &[String],
    time: &[f64],
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> Result<(), RecordingError> {
    let n = joint_names.len();
    assert!(
        [q, dq, ddq].iter().all(|array| array.len() == time.len() * n),
        "arrays of the same samples"
    );
    let mut message = CdrWriter::new();
    message.u32(0);
    message.u32(0);
    message.text(""); // frame_id
    message.texts(joint_names);
    message.u32(u32::try_from(time.len()).unwrap_or(u32::MAX));
    for (sample, seconds) in time.iter().enumerate() {
        let row = sample * n..(sample + 1) * n;
        for array in [&q[row.clone()], &dq[row.clone()], &ddq[row], &[]] {
            message.f64s(array);
        }
        let nanoseconds = (seconds * 1e9).round() as i64;
        let Some((seconds, nanoseconds)) = stamp(nanoseconds) else {
            return Err(RecordingError::StampRange { recording: topic.into(), nanoseconds });
        };
        message.u32(seconds);
        message.u32(nanoseconds);
    }
    let message = message.finish();
    write_file(path.as_ref(), |file| write(file, topic, &message).map_err(io_error))
}

fn write(file: impl io::Write + io::Seek, topic: &str, message: &[u8]) -> Result<(), McapError> {
    let options =
        WriteOptions::new().profile("ros2").library(concat!("sgpr ", env!("CARGO_PKG_VERSION")));
    let mut file = options.compression(Some(Compression::Zstd)).create(file)?;
    let schema = file.add_schema(
        "trajectory_msgs/msg/JointTrajectory",
        "ros2msg",
        JOINT_TRAJECTORY.as_bytes(),
    )?;
    let channel_id = file.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
    let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    file.write_to_known_channel(&header, message)?;
    file.finish().map(drop)
}
