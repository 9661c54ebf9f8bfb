"""Writes the bags of ROS that the recording tests read, and the numbers in them, with a package that is not ours.

    pip install rosbags
    python make_fixtures.py

Every bag holds the same messages; `states.csv` has the joint states among them, one line each.
"""

import csv
import math
import shutil
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_typestore

HERE = Path(__file__).parent
START = 1_700_000_000_000_000_007
PERIOD = 10_000_000
DELAY = 1_000_000
SAMPLES = 24
# Of lengths that are no multiples of four: what follows is aligned in ROS 2, but not in ROS 1.
JOINTS = ["shoulder", "elbow", "wrist_1"]
JOINT_STATE = "sensor_msgs/msg/JointState"
TEMPERATURE = "sensor_msgs/msg/Temperature"
FLOAT64 = "std_msgs/msg/Float64"
STRING = "std_msgs/msg/String"


def state(k, joint):
    """Position, velocity and torque of a joint in sample k."""
    t = 0.01 * k
    return math.sin(t + joint), math.cos(t + joint), 10.0 * (joint + 1) - t / 3


def messages(store, samples, ros1):
    """Topic, type, log time and content of the messages of some samples."""

    def header(k):
        stamp = START + k * PERIOD
        time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        counter = {"seq": k} if ros1 else {}
        return store.types["std_msgs/msg/Header"](stamp=time, frame_id="base", **counter)

    for k in samples:
        order = [0, 1, 2] if k % 2 else [2, 0, 1]
        q, dq, tau = (np.array(values) for values in zip(*(state(k, joint) for joint in order), strict=True))
        names = [JOINTS[joint] for joint in order]
        log_time = START + k * PERIOD + DELAY
        content = store.types[JOINT_STATE](header=header(k), name=names, position=q, velocity=dq, effort=tau)
        yield "/joint_states", JOINT_STATE, log_time, content
        yield "/load", FLOAT64, log_time, store.types[FLOAT64](data=0.5 * k)
        if k % 8 == 0:
            content = store.types[TEMPERATURE](header=header(k), temperature=40.0 + k, variance=0.0)
            yield "/motor", TEMPERATURE, log_time, content
            yield "/chatter", STRING, log_time, store.types[STRING](data="hello")


def write(writer, store, samples, ros1):
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    connections = {}
    with writer:
        for topic, kind, log_time, content in messages(store, samples, ros1):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], log_time, serialize(content, kind))


def bag1(name, compression):
    path = HERE / name
    path.unlink(missing_ok=True)
    writer = Bag1(path)
    if compression:
        writer.set_compression(compression)
    # Several chunks.
    writer.chunk_threshold = 2000
    write(writer, get_typestore(Stores.ROS1_NOETIC), range(SAMPLES), ros1=True)


def bag2(name, mode=None, samples=range(SAMPLES)):
    path = HERE / name
    shutil.rmtree(path, ignore_errors=True)
    writer = Bag2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    write(writer, get_typestore(Stores.ROS2_HUMBLE), samples, ros1=False)


def several(name):
    """A bag of two files, as the recorder makes of a long log: the later part stands first in the list."""
    parts = [range(SAMPLES // 2, SAMPLES), range(SAMPLES // 2)]
    for number, samples in enumerate(parts):
        bag2(f"part_{number}", samples=samples)
    shutil.rmtree(HERE / name, ignore_errors=True)
    (HERE / name).mkdir()
    description = (HERE / "part_0" / "metadata.yaml").read_text()
    line = next(line for line in description.splitlines() if line.strip().startswith("- part_0"))
    lines = [line.replace("part_0", f"{name}_{number}") for number in range(len(parts))]
    (HERE / name / "metadata.yaml").write_text(description.replace(line, "\n".join(lines)))
    for number in range(len(parts)):
        shutil.move(HERE / f"part_{number}" / f"part_{number}.db3", HERE / name / f"{name}_{number}.db3")
        shutil.rmtree(HERE / f"part_{number}")


def numbers(name):
    with (HERE / name).open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        columns = [f"{joint}_{what}" for what in ("position", "velocity", "torque") for joint in JOINTS]
        writer.writerow(["time_ns", *columns])
        for k in range(SAMPLES):
            q, dq, tau = zip(*(state(k, joint) for joint in range(len(JOINTS))), strict=True)
            writer.writerow([START + k * PERIOD, *q, *dq, *tau])


if __name__ == "__main__":
    bag1("plain.bag", None)
    bag1("bz2.bag", Bag1.CompressionFormat.BZ2)
    bag1("lz4.bag", Bag1.CompressionFormat.LZ4)
    bag2("sqlite")
    bag2("packed_messages", CompressionMode.MESSAGE)
    bag2("packed_file", CompressionMode.FILE)
    several("several")
    numbers("states.csv")
