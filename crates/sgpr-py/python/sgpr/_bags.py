"""ROS bags, through rosbags: ROS 1 (`.bag`) and ROS 2 (SQLite, or MCAP in several files)."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ._sgpr import Recording, RecordingError, SgprError, read_mcap

_DEFAULT_LIMIT = 4 << 30

_JOINT_STATE = "sensor_msgs/msg/JointState"
# What the MCAP reader understands beside joint states.
_NUMBERS = {
    "sensor_msgs/msg/Temperature",
    "std_msgs/msg/Float32",
    "std_msgs/msg/Float64",
    "std_msgs/msg/Float64MultiArray",
}


def read(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Copies the topics with joint states to a temporary MCAP file and reads that: one set of rules for all bags.

    Of ROS 1 bags the joint states are taken, of ROS 2 bags the numbers on other topics too, as channels.
    """
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError:
        raise SgprError(f"{path}: ROS bags need the package rosbags: pip install sgpr[bags]") from None
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    with tempfile.TemporaryDirectory() as folder:
        try:
            copy = _copy(path, Path(folder), limit)
        except (OSError, SgprError, MemoryError):
            raise
        except Exception as error:
            # A damaged bag surfaces as whatever its parts raise: rosbags, SQLite, struct.
            raise RecordingError(f"{path}: not a ROS bag, or damaged: {error}") from error
        try:
            recording = read_mcap(copy, joints, limit_bytes=limit, **options)
        except RecordingError as error:
            raise type(error)(str(error).replace(str(copy), str(path))) from None
    return recording._from_source(str(path), [])


def _copy(path: Path, folder: Path, limit: int) -> Path:
    """The messages that matter, as an MCAP file."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([_with_suffix(path, folder)], default_typestore=store) as bag:
        types = {_JOINT_STATE} | (_NUMBERS if bag.is2 else set())
        chosen = [connection for connection in bag.connections if connection.msgtype in types]
        if not any(connection.msgtype == _JOINT_STATE for connection in chosen):
            topics = sorted({f"`{one.topic} ({one.msgtype})`" for one in bag.connections})
            raise RecordingError(
                f"{path}: no topic with joint states (sensor_msgs/JointState); "
                f"the topics are {', '.join(topics) or 'none'}"
            )
        total = 0
        with Writer(folder / "copy", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            kinds = {connection.topic: connection.msgtype for connection in chosen}
            targets = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
            for topic, stamp, data in _messages(bag, chosen, store):
                total += len(data)
                if total > limit:
                    raise RecordingError(
                        f"{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes`"
                    )
                writer.write(targets[topic], stamp, data)
    (copy,) = (folder / "copy").glob("*.mcap")
    return copy


def _messages(bag: Any, connections: list[Any], store: Any) -> Iterator[tuple[str, int, bytes | memoryview]]:
    """Topic, log time and message, as ROS 2 writes it."""
    for connection, stamp, data in bag.messages(connections=connections):
        if bag.is2:
            yield connection.topic, stamp, data
            continue
        state = bag.deserialize(data, connection.msgtype)
        given = state.header.stamp
        time = store.types["builtin_interfaces/msg/Time"](sec=given.sec, nanosec=given.nanosec)
        header = store.types["std_msgs/msg/Header"](stamp=time, frame_id=state.header.frame_id)
        message = store.types[_JOINT_STATE](
            header=header, name=state.name, position=state.position, velocity=state.velocity, effort=state.effort
        )
        yield connection.topic, stamp, store.serialize_cdr(message, _JOINT_STATE)


def _with_suffix(path: Path, folder: Path) -> Path:
    """rosbags goes by the name: a bag of another name gets the right one."""
    if path.is_dir() or path.suffix in (".bag", ".db3", ".mcap"):
        return path
    with path.open("rb") as stream:
        suffix = ".bag" if stream.read(4) == b"#ROS" else ".db3"
    link = folder / f"bag{suffix}"
    link.symlink_to(path.resolve())
    return link
