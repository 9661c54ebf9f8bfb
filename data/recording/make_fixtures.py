"""Writes the MCAP fixtures of the recording tests with packages that are not ours.

    pip install mcap mcap-ros2-support
    python make_fixtures.py

The joint states follow formulas (`state` below) that the Rust tests repeat.
"""

import json
import math
import struct
from io import BytesIO
from pathlib import Path

from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as Ros2Writer

HERE = Path(__file__).parent
START = 1_700_000_000_000_000_000
PERIOD = 10_000_000
JOINTS = ["shoulder", "elbow", "wrist"]
RULE = "=" * 80
HEADER = f"""{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + HEADER
TEMPERATURE = "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n" + HEADER
FLOAT64 = "float64 data\n"


def state(k, joint):
    """Position, velocity and torque of joint 0, 1, 2 in sample k."""
    t = k * PERIOD * 1e-9
    return math.sin(t + joint), math.cos(t + joint), 10.0 * (joint + 1) - t


def header(nanoseconds):
    return {"stamp": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}, "frame_id": "base"}


def message(k, order=(0, 1, 2), velocity=True, effort=True, stamp=None):
    values = [state(k, joint) for joint in order]
    return {
        "header": header(START + k * PERIOD if stamp is None else stamp),
        "name": [JOINTS[joint] for joint in order],
        "position": [q for q, _, _ in values],
        "velocity": [dq for _, dq, _ in values] if velocity else [],
        "effort": [tau for _, _, tau in values] if effort else [],
    }


def ros2(name, compression, fill, checksums=True):
    with open(HERE / name, "wb") as file:
        writer = Ros2Writer(file, chunk_size=1024, compression=compression, enable_crcs=checksums)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        fill(writer, schema)
        writer.finish()


def write(writer, schema, topic, k, content, delay=1_000_000):
    log_time = START + k * PERIOD + delay
    writer.write_message(topic=topic, schema=schema, message=content, log_time=log_time, publish_time=log_time, sequence=k)


def plain(writer, schema):
    """One topic; the order of the joints changes from message to message."""
    for k in range(50):
        write(writer, schema, "/joint_states", k, message(k, (0, 1, 2) if k % 2 else (2, 0, 1)))


def with_extras(writer, schema):
    """Temperature of a motor, a number, commands for the same joints, and a topic that nobody reads."""
    temperature = writer.register_msgdef("sensor_msgs/msg/Temperature", TEMPERATURE)
    number = writer.register_msgdef("std_msgs/msg/Float64", FLOAT64)
    text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
    for k in range(50):
        write(writer, schema, "/joint_states", k, message(k))
        write(writer, schema, "/commands", k, message(k, velocity=False, effort=False), delay=0)
        if k % 10 == 5:
            reading = {"header": header(START + k * PERIOD), "temperature": 40.0 + k, "variance": 0.0}
            write(writer, temperature, "/motor", k, reading)
            write(writer, number, "/payload", k, {"data": 0.5 * k}, delay=0)
            write(writer, text, "/log", k, {"data": "hello"})


def two_topics(writer, schema):
    """Shoulder and elbow at 100 Hz; the wrist at 50 Hz, 3 ms later, without velocity."""
    for k in range(50):
        write(writer, schema, "/arm", k, message(k, (1, 0)))
        if k % 2 == 0:
            late = START + k * PERIOD + 3_000_000
            write(writer, schema, "/wrist", k, message(k, (2,), velocity=False, stamp=late))


def json_log(name):
    """Joint states and a flat message in JSON."""
    with open(HERE / name, "wb") as file:
        writer = Writer(file, chunk_size=1024, compression=CompressionType.ZSTD)
        writer.start(profile="", library="make_fixtures")
        anything = json.dumps({"type": "object"}).encode()
        schema = writer.register_schema(name="state", encoding="jsonschema", data=anything)
        states = writer.register_channel(topic="/state", message_encoding="json", schema_id=schema)
        motor = writer.register_channel(topic="/motor", message_encoding="json", schema_id=schema)
        for k in range(30):
            log_time = START + k * PERIOD
            data = json.dumps(message(k)).encode()
            writer.add_message(channel_id=states, log_time=log_time, publish_time=log_time, data=data)
            data = json.dumps({"temperature": 40.0 + k, "currents": [k, 2 * k], "name": "m1"}).encode()
            writer.add_message(channel_id=motor, log_time=log_time, publish_time=log_time, data=data)
        writer.finish()


def flat_json(name):
    """Arrays without joint names, time in seconds."""
    with open(HERE / name, "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile="", library="make_fixtures")
        channel = writer.register_channel(topic="/log", message_encoding="json", schema_id=0)
        for k in range(20):
            q, dq, tau = zip(*(state(k, joint) for joint in range(3)))
            data = json.dumps({"t": k * PERIOD * 1e-9, "q": q, "dq": dq, "tau": tau, "load": 2.5}).encode()
            writer.add_message(channel_id=channel, log_time=START + k, publish_time=START + k, data=data)
        writer.finish()


def big_endian(name):
    """A JointState as a big-endian machine sends it, packed by hand; no stamp."""

    def align(buffer, size):
        buffer.write(b"\0" * (-(buffer.tell() - 4) % size))

    def sequence(buffer, values):
        align(buffer, 4)
        buffer.write(struct.pack(">I", len(values)))
        if values:
            align(buffer, 8)
            buffer.write(struct.pack(f">{len(values)}d", *values))

    def text(buffer, value):
        align(buffer, 4)
        buffer.write(struct.pack(">I", len(value) + 1) + value.encode() + b"\0")

    with open(HERE / name, "wb") as file:
        writer = Writer(file, use_chunking=False, enable_data_crcs=True)
        writer.start(profile="ros2", library="make_fixtures")
        schema = writer.register_schema(name="sensor_msgs/msg/JointState", encoding="ros2msg", data=JOINT_STATE.encode())
        channel = writer.register_channel(topic="/joint_states", message_encoding="cdr", schema_id=schema)
        for k in range(10):
            content = message(k)
            buffer = BytesIO()
            buffer.write(b"\0\0\0\0" + struct.pack(">iI", 0, 0))
            text(buffer, "base")
            align(buffer, 4)
            buffer.write(struct.pack(">I", 3))
            for joint in content["name"]:
                text(buffer, joint)
            for field in ("position", "velocity", "effort"):
                sequence(buffer, content[field])
            log_time = START + k * PERIOD
            writer.add_message(channel_id=channel, log_time=log_time, publish_time=log_time, data=buffer.getvalue())
        writer.finish()


if __name__ == "__main__":
    ros2("zstd.mcap", CompressionType.ZSTD, plain)
    ros2("lz4.mcap", CompressionType.LZ4, plain)
    ros2("uncompressed.mcap", CompressionType.NONE, plain)
    ros2("extras.mcap", CompressionType.ZSTD, with_extras)
    # Without checksums, so that tests can break what is inside of chunks.
    ros2("two_topics.mcap", CompressionType.NONE, two_topics, checksums=False)
    json_log("json.mcap")
    flat_json("flat_json.mcap")
    big_endian("big_endian.mcap")
    # In the middle of the last chunk: a recorder that was switched off.
    for name in ("zstd", "lz4", "uncompressed"):
        whole = (HERE / f"{name}.mcap").read_bytes()
        (HERE / f"truncated_{name}.mcap").write_bytes(whole[: len(whole) * 6 // 10])
