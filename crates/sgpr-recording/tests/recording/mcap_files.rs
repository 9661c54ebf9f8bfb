//! MCAP files written by the Python packages `mcap` and `mcap-ros2-support`
//! (`data/recording/make_fixtures.py`), and ours.

use sgpr_recording::mcap::{self, Clock, McapOptions};
use sgpr_recording::{Recording, RecordingError};

use super::{assert_close, file, fixture, message, names};

const START: i64 = 1_700_000_000_000_000_000;
const PERIOD: i64 = 10_000_000;

/// Joints of the fixtures in the order of their formulas.
fn in_order() -> McapOptions {
    McapOptions::default().with_joints(Some(names(&["shoulder", "elbow", "wrist"])))
}

fn on_topics(topics: &[&str]) -> McapOptions {
    in_order().with_topics(Some(names(topics)))
}

fn read(name: &str, options: &McapOptions) -> Recording {
    mcap::read(fixture(name), options).expect("a readable fixture")
}

fn error(name: &str, options: &McapOptions) -> String {
    let result: Result<_, RecordingError> = mcap::read(fixture(name), options);
    let text = message(result);
    text[text.find(name).expect("the file is named")..].to_string()
}

/// Position, velocity and torque at time t, s.
fn state(t: f64) -> [Vec<f64>; 3] {
    let joints = [0.0, 1.0, 2.0];
    [
        joints.map(|j| (t + j).sin()),
        joints.map(|j| (t + j).cos()),
        joints.map(|j| 10.0 * (j + 1.0) - t),
    ]
    .map(|values| values.to_vec())
}

fn assert_follows_formulas(log: &Recording) {
    for (k, t) in log.time_seconds().into_iter().enumerate() {
        let [q, dq, tau] = state(t);
        let row = 3 * k..3 * k + 3;
        assert_close(&log.position()[row.clone()], &q, 1e-15);
        assert_close(&log.velocity().expect("logged")[row.clone()], &dq, 1e-15);
        assert_close(&log.torque().expect("logged")[row], &tau, 1e-13);
    }
}

#[test]
fn all_compressions_and_changing_joint_order() {
    for name in ["zstd.mcap", "lz4.mcap", "uncompressed.mcap"] {
        let log = read(name, &in_order());
        assert_eq!(log.len(), 50);
        assert_eq!(log.time()[..2], [START, START + PERIOD]);
        assert_follows_formulas(&log);
        assert!(log.notes().is_empty());
    }
}

#[test]
fn messages_of_ros1() {
    let mut message = vec![9, 0, 0, 0, 7, 0, 0, 0, 5, 0, 0, 0]; // counter and stamp
    message.extend([1, 0, 0, 0, b'x', 1, 0, 0, 0, 5, 0, 0, 0]); // frame, and one name
    message.extend(b"elbow");
    message.extend([1, 0, 0, 0].into_iter().chain(2.5_f64.to_le_bytes()));
    message.extend([0; 8]); // neither velocity nor effort
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.mcap");
    let file = std::fs::File::create(&path).expect("a writable folder");
    let mut writer = ::mcap::Writer::new(file).expect("written");
    let schema = writer.add_schema("sensor_msgs/JointState", "ros1msg", b"").expect("written");
    let channel = writer.add_channel(schema, "/joints", "ros1", &Default::default());
    let channel_id = channel.expect("written");
    let header =
        ::mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, &message).expect("written");
    writer.finish().expect("written");
    let log = mcap::read(&path, &McapOptions::default()).expect("a log");
    assert_eq!((log.time(), log.position()), (&[7_000_000_005][..], &[2.5][..]));
    assert_eq!(log.joint_names(), ["elbow"]);
}

#[test]
fn joints_in_order_of_appearance() {
    let log = read("zstd.mcap", &McapOptions::default());
    assert_eq!(log.joint_names(), ["wrist", "shoulder", "elbow"]);
}

#[test]
fn some_joints_under_other_names() {
    let options = McapOptions::default()
        .with_joints(Some(names(&["joint_2", "joint_1"])))
        .with_logged_names(Some(names(&["elbow", "shoulder"])));
    let log = read("zstd.mcap", &options);
    assert_eq!(log.joint_names(), ["joint_2", "joint_1"]);
    assert_close(&log.position()[..2], &[1f64.sin(), 0.0], 1e-15);
    let options = options.with_joints(Some(names(&["joint_2"])));
    let result = mcap::read(fixture("zstd.mcap"), &options);
    assert_eq!(
        message(result),
        "logged_names: got 2 values for 1 joint: give one for each, in joint order"
    );
}

#[test]
fn log_time_on_request() {
    let log = read("zstd.mcap", &in_order().with_clock(Clock::LogTime));
    assert_eq!(log.time()[0], START + 1_000_000);
}

#[test]
fn big_endian_without_stamps() {
    let log = read("big_endian.mcap", &in_order());
    assert_eq!((log.len(), log.time()[0]), (10, START));
    assert_follows_formulas(&log);
    assert_eq!(
        log.notes(),
        ["`/joint_states`: the messages have no stamps; the time is the log time"]
    );
}

#[test]
fn joint_states_in_json() {
    let log = read("json.mcap", &in_order());
    assert_eq!((log.len(), log.time()[1]), (30, START + PERIOD));
    assert_follows_formulas(&log);
    assert_eq!(log.channel("/motor/temperature").expect("kept").values[..2], [40.0, 41.0]);
    assert_eq!(log.channel("/motor/currents_2").expect("kept").values[..2], [0.0, 2.0]);
}

#[test]
fn json_without_joint_names() {
    let log = read("flat_json.mcap", &in_order());
    assert_eq!((log.len(), log.time()[0], log.time()[1]), (20, 0, PERIOD));
    assert_follows_formulas(&log);
    assert_eq!(log.channel("/log/load").expect("kept").values[0], 2.5);
    assert_eq!(
        read("flat_json.mcap", &McapOptions::default()).joint_names(),
        ["joint_1", "joint_2", "joint_3"]
    );
    let two = McapOptions::default().with_joints(Some(names(&["a", "b"])));
    assert_eq!(
        error("flat_json.mcap", &two),
        "flat_json.mcap: there is no joint `a`; the joints are `joint_1`, `joint_2`, `joint_3`"
    );
}

#[test]
fn the_same_joints_on_two_topics() {
    assert_eq!(
        error("extras.mcap", &in_order()),
        "extras.mcap: the joint `shoulder` is on the topics `/joint_states`, `/commands`: choose \
         with `topics`"
    );
    let log = read("extras.mcap", &on_topics(&["/joint_states"]));
    assert_follows_formulas(&log);
    let command = &log.channel("/commands/elbow/position").expect("kept").values;
    assert_close(
        command,
        &log.position().iter().skip(1).step_by(3).copied().collect::<Vec<_>>(),
        0.0,
    );
    assert!(log.channel("/commands/elbow/effort").is_none());
}

#[test]
fn other_numbers_are_held() {
    let log = read("extras.mcap", &on_topics(&["/joint_states"]));
    let temperature = &log.channel("/motor/temperature").expect("kept").values;
    assert!(temperature[4].is_nan());
    assert_eq!([temperature[5], temperature[14], temperature[15]], [45.0, 45.0, 55.0]);
    assert_eq!(log.channel("/payload").expect("kept").values[15], 7.5);
    assert_eq!(log.notes(), ["skipped topics: /log (std_msgs/msg/String)"]);
}

#[test]
fn joints_on_two_topics_are_merged() {
    let log = read("two_topics.mcap", &in_order());
    // The wrist is known from 3 ms to 483 ms.
    assert_eq!((log.len(), log.time()[0]), (48, START + PERIOD));
    for (k, q) in log.position().chunks(3).enumerate() {
        let t = (k + 1) as f64 * 0.01;
        assert_close(&q[..2], &[t.sin(), (t + 1.0).sin()], 1e-15);
        // The message is late by 3 ms, and what lies between messages is a line.
        let place = ((t - 0.003) / 0.02).floor() * 0.02;
        let u = (t - 0.003 - place) / 0.02;
        let line = (1.0 - u) * (place + 2.0).sin() + u * (place + 2.02).sin();
        assert_close(&q[2..], &[line], 1e-9);
    }
    assert!(log.velocity().is_none());
    assert_close(&log.torque().expect("logged")[..2], &[9.99, 19.99], 1e-12);
    assert!(log.notes()[0].starts_with("merged the joints of `/arm`, `/wrist`: 48 of 50 samples"));
    assert_eq!(log.notes()[1], "no velocity: the topics `/wrist` have none");
}

#[test]
fn one_of_two_topics() {
    let options = on_topics(&["/arm"]).with_joints(None);
    let log = read("two_topics.mcap", &options);
    assert_eq!((log.len(), log.joint_names()), (50, &names(&["elbow", "shoulder"])[..]));
    assert!(log.channel("/wrist/wrist/position").expect("kept").values[1].is_finite());
}

#[test]
fn what_is_not_there() {
    let joint = McapOptions::default().with_joints(Some(names(&["sholder"])));
    assert_eq!(
        error("zstd.mcap", &joint),
        "zstd.mcap: there is no joint `sholder` (did you mean `shoulder`?); the joints are \
         `elbow`, `shoulder`, `wrist`"
    );
    assert_eq!(
        error("zstd.mcap", &on_topics(&["/joint_state"])),
        "zstd.mcap: there is no topic `/joint_state` with joint states (did you mean \
         `/joint_states`?); topics with joint states are `/joint_states`"
    );
}

fn small() -> Recording {
    let time = vec![0, 1_000_000, 5_000_000_007];
    let position = vec![0.1, 0.2, 0.3, 0.4, 0.5, f64::INFINITY];
    let torque = Some(vec![-1.0, 2.0, -3.0, 4.0, -5.0, 6.0]);
    Recording::new("small", names(&["a", "b"]), time, position, None, torque, vec![])
        .expect("lengths fit")
}

#[test]
fn what_is_written_is_read() {
    let (_folder, path) = file("log.mcap", "");
    mcap::write(&path, &[("/measured", &small()), ("/predicted", &small())]).expect("writable");
    let options = McapOptions::default().with_topics(Some(names(&["/measured"])));
    let back = mcap::read(&path, &options).expect("readable");
    assert_eq!(back.time()[1..], small().time()[1..]);
    assert_eq!(back.joint_names(), small().joint_names());
    assert_eq!((back.position(), back.torque()), (small().position(), small().torque()));
    assert!(back.velocity().is_none());
    assert_eq!(back.channel("/predicted/b/effort").expect("kept").values, [2.0, 4.0, 6.0]);
}

#[test]
fn times_that_ros_cannot_hold() {
    for (time, text) in [(-1, "-1 ns"), (i64::MAX, "9223372036854775807 ns")] {
        let log = Recording::new("late", names(&["a"]), vec![time], vec![0.0], None, None, vec![])
            .expect("fits");
        let error = message(mcap::write("never.mcap", &[("/a", &log)]));
        assert_eq!(
            error,
            format!("late: the time {text} does not fit a ROS 2 time stamp (0 to 2^31 s)")
        );
    }
    assert!(
        message(mcap::write("no/such/folder/a.mcap", &[]))
            .starts_with("no/such/folder/a.mcap: cannot write")
    );
}
