"""`sgpr.read`: every format, by name and by content."""

import io
import shutil
import sqlite3
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import sgpr
from conftest import assert_same
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
MSGDEF = """std_msgs/Header header
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
"""


def states(store: Any, log: sgpr.Recording, order: list[int], *, ros1: bool = False) -> list[tuple[int, Any]]:
    """The recording as messages of rosbags; joints stand in `order`, and in the other order every other time."""
    assert log.dq is not None
    assert log.tau is not None
    messages = []
    for k, stamp in enumerate(log.time_ns.tolist()):
        columns = order if k % 2 else order[::-1]
        time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        counter = {"seq": k} if ros1 else {}
        header = store.types["std_msgs/msg/Header"](stamp=time, frame_id="base", **counter)
        message = store.types[JOINT_STATE](
            header=header,
            name=[log.joint_names[j] for j in columns],
            position=log.q[k, columns],
            velocity=log.dq[k, columns],
            effort=log.tau[k, columns],
        )
        messages.append((stamp, message))
    return messages


def write_bag2(path: Path, topics: dict[str, sgpr.Recording], storage: StoragePlugin, *, packed: bool = False) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Bag2Writer(path, version=9, storage_plugin=storage)
    if packed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        for topic, log in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for stamp, message in states(store, log, [2, 0, 1][: log.dof]):
                writer.write(connection, stamp, store.serialize_cdr(message, JOINT_STATE))
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"](data="hello")
        writer.write(chatter, 1, store.serialize_cdr(text, "std_msgs/msg/String"))


def write_bag1(path: Path, topics: dict[str, sgpr.Recording], *, packed: bool = False) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Bag1Writer(path)
    if packed:
        writer.set_compression(Bag1Writer.CompressionFormat.BZ2)
    with writer:
        for topic, log in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for stamp, message in states(store, log, [2, 0, 1], ros1=True):
                writer.write(connection, stamp, store.serialize_ros1(message, JOINT_STATE))


def test_mcap_of_the_ros_package(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        schema = writer.register_msgdef(JOINT_STATE, MSGDEF)
        for stamp, message in states(store, log, [1, 2, 0]):
            content = {
                "header": {
                    "stamp": {"sec": message.header.stamp.sec, "nanosec": message.header.stamp.nanosec},
                    "frame_id": "base",
                },
                "name": message.name,
                "position": message.position.tolist(),
                "velocity": message.velocity.tolist(),
                "effort": message.effort.tolist(),
            }
            writer.write_message("/joint_states", schema, content, log_time=stamp, publish_time=stamp)
        writer.finish()
    assert_same(sgpr.read(path, log.joint_names), log)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@pytest.mark.parametrize("packed", [False, True])
def test_ros2_bags(log: sgpr.Recording, tmp_path: Path, storage: StoragePlugin, packed: bool) -> None:
    write_bag2(tmp_path / "bag", {"/joint_states": log}, storage, packed=packed)
    if storage == StoragePlugin.MCAP and packed:
        pytest.skip("MCAP packs by chunks: rosbags does not write messages that are packed one by one")
    rec = sgpr.read(tmp_path / "bag", log.joint_names)
    assert_same(rec, log)
    assert rec.source.startswith(str(tmp_path / "bag"))


def test_data_base_of_a_ros2_bag(log: sgpr.Recording, tmp_path: Path) -> None:
    write_bag2(tmp_path / "bag", {"/joint_states": log}, StoragePlugin.SQLITE3)
    (file,) = (tmp_path / "bag").glob("*.db3")
    assert_same(sgpr.read(file, log.joint_names), log)
    other = tmp_path / "other"
    shutil.copy(file, other)
    assert_same(sgpr.read(other, log.joint_names), log)


@pytest.mark.parametrize("packed", [False, True])
def test_ros1_bags(log: sgpr.Recording, tmp_path: Path, packed: bool) -> None:
    path = tmp_path / "log.bag"
    write_bag1(path, {"/joint_states": log}, packed=packed)
    rec = sgpr.read(path, log.joint_names)
    assert_same(rec, log)
    assert rec.source == str(path)
    path.rename(tmp_path / "log.unknown")
    assert_same(sgpr.read(tmp_path / "log.unknown", log.joint_names), log)


def test_topics_of_a_bag(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "bag"
    doubled = sgpr.Recording(log.time_ns, 2 * log.q, log.dq, log.tau, joint_names=log.joint_names)
    write_bag2(path, {"/left": log, "/right": doubled}, StoragePlugin.SQLITE3)
    with pytest.raises(sgpr.RecordingError, match="is on the topics `/left`, `/right`: choose with `topics`") as error:
        sgpr.read(path, log.joint_names)
    assert str(error.value).startswith(str(path))
    assert_same(sgpr.read(path, log.joint_names, topics=["/right"]), doubled)
    renamed = sgpr.read(path, ["a"], logged_names=["elbow"], topics=["/left"], clock="log")
    assert np.array_equal(renamed.q[:, 0], log.q[:, 1])
    with pytest.raises(sgpr.RecordingError, match="there is no topic `/up`"):
        sgpr.read(path, topics=["/up"])
    with pytest.raises(sgpr.RecordingError, match="more than 100 bytes"):
        sgpr.read(path, topics=["/left"], limit_bytes=100)


def test_bags_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "log.bag"
    for content in (b"", b"#ROSBAG V2.0\n", b"#ROSBAG V2.0\n" + bytes(range(256)) * 20):
        path.write_bytes(content)
        with pytest.raises(sgpr.RecordingError, match="not a ROS bag, or damaged"):
            sgpr.read(path)
    base = tmp_path / "log.db3"
    sqlite3.connect(base).close()
    base.write_bytes(b"SQLite format 3\0" + bytes(2000))
    with pytest.raises(sgpr.RecordingError, match="not a ROS bag, or damaged"):
        sgpr.read(base)
    (tmp_path / "empty").mkdir()
    with pytest.raises(sgpr.RecordingError, match=r"neither a ROS 2 bag .* nor a LeRobot data set"):
        sgpr.read(tmp_path / "empty")


def test_a_bag_without_joint_states(log: sgpr.Recording, tmp_path: Path) -> None:
    write_bag2(tmp_path / "bag", {}, StoragePlugin.SQLITE3)
    with pytest.raises(sgpr.RecordingError, match=r"no topic with joint states .* `/chatter \(std_msgs/msg/String, "):
        sgpr.read(tmp_path / "bag")


def test_a_damaged_bag_is_recovered(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.bag"
    write_bag1(path, {"/joint_states": log})
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(sgpr.RecordingError, match="the file is truncated"):
        sgpr.read(path)
    recovered = sgpr.read(path, log.joint_names, recover=True)
    assert 0 < len(recovered) <= len(log)
    assert np.array_equal(recovered.q, log.q[: len(recovered)])
    assert any("recovered" in note for note in recovered.notes)


def test_logs_need_no_other_package(log: sgpr.Recording, tmp_path: Path) -> None:
    import h5py
    from scipy.io import savemat

    arrays = {"t": log.t, "q": log.q, "tau": log.tau}
    write_bag1(tmp_path / "log.bag", {"/joint_states": log})
    write_bag2(tmp_path / "bag", {"/joint_states": log}, StoragePlugin.SQLITE3)
    parquet(tmp_path / "log.parquet", t=log.t, q_1=log.q[:, 0], q_2=log.q[:, 1], q_3=log.q[:, 2])
    np.savez(tmp_path / "log.npz", **arrays)
    savemat(tmp_path / "log.mat", arrays)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.update(arrays)
    names = ["log.bag", "bag", "log.parquet", "log.npz", "log.mat", "log.h5"]
    code = f"""
import sys
sys.modules |= dict.fromkeys(["rosbags", "pyarrow", "scipy", "h5py"])
import sgpr
print([len(sgpr.read({str(tmp_path)!r} + "/" + name)) for name in {names!r}])
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == str([len(log)] * len(names))


def test_numpy_archives(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    temperature = np.linspace(20, 30, len(log), dtype=np.float32)
    arrays = {"t": log.time_ns, "q": np.asfortranarray(log.q), "dq": log.dq, "tau": log.tau}
    names = np.array(log.joint_names)
    np.savez_compressed(path, joint_names=names, temperature=temperature, image=np.zeros((2, 2)), **arrays)
    rec = sgpr.read(path)
    assert_same(rec, log)
    assert np.array_equal(rec.channels["temperature"], temperature)
    assert rec.notes == ["skipped arrays: image"]
    assert sgpr.read(path, ["wrist", "elbow"]).joint_names == ["wrist", "elbow"]
    path.rename(tmp_path / "log.unknown")
    assert_same(sgpr.read(tmp_path / "log.unknown"), log)


def test_other_names_in_numpy_archives(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, time=log.t, position=log.q, velocity=log.dq, effort=log.tau)
    rec = sgpr.read(path)
    assert rec.joint_names == ["joint_1", "joint_2", "joint_3"]
    assert np.array_equal(rec.tau, log.tau)
    assert rec.time_ns[1] == 10_000_000
    assert sgpr.read(path, log.joint_names).joint_names == log.joint_names
    with pytest.raises(sgpr.RecordingError, match="3 columns without names, the robot has 2 joints"):
        sgpr.read(path, ["a", "b"])


def test_vectors_are_an_arm_of_one_joint(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=log.t, q=log.q[:, 0], tau=log.tau[:, 0])
    rec = sgpr.read(path, ["wrist"])
    assert np.array_equal(rec.q, log.q[:, :1]) and np.array_equal(rec.tau, log.tau[:, :1])
    np.savez(path, t=log.t, q=log.q[:, 0], tau=log.tau)
    with pytest.raises(sgpr.RecordingError, match=r"tau: got \(50, 3\), expected \(50, 1\)"):
        sgpr.read(path)


def npz(path: Path, **arrays: Any) -> Path:
    np.savez(path, **arrays)
    return path


def test_numpy_archives_that_are_refused(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    t, q = log.t, log.q
    with pytest.raises(sgpr.RecordingError, match=r"no array `q` or `position`.*the arrays are `x` \(50, 3\), `t`"):
        sgpr.read(npz(path, t=t, x=q))
    with pytest.raises(sgpr.RecordingError, match="t and time mean the same"):
        sgpr.read(npz(path, t=t, time=t, q=q))
    with pytest.raises(sgpr.RecordingError, match=r"q: got \(49, 3\), expected \(50, n\)"):
        sgpr.read(npz(path, t=t, q=q[1:]))
    with pytest.raises(sgpr.RecordingError, match="more than 1000 bytes"):
        sgpr.read(npz(path, t=t, q=q), limit_bytes=1000)
    with pytest.raises(sgpr.RecordingError, match="joint_names: got float64"):
        sgpr.read(npz(path, t=t, q=q, joint_names=np.zeros(3)))
    path.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(sgpr.RecordingError, match="not a NumPy archive, or damaged"):
        sgpr.read(path)


class Trap:
    """Leaves a trace when it is unpickled."""

    trace: Path

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.write_text, (self.trace, "run"))


def test_nothing_in_an_archive_is_run(log: sgpr.Recording, tmp_path: Path) -> None:
    trap = Trap()
    trap.trace = tmp_path / "trace"
    path = npz(tmp_path / "log.npz", t=log.t, q=log.q, extra=np.array([trap], dtype=object))
    with pytest.raises(sgpr.RecordingError, match="holds Python objects, which could run code"):
        sgpr.read(path)
    assert not trap.trace.exists()


def test_an_archive_that_lies_about_its_size_takes_no_memory(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 100)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("q.npy", buffer.getvalue() + bytes(80))
    with pytest.raises(sgpr.RecordingError, match="should hold 800000000000 bytes"):
        sgpr.read(path)
    # A packed megabyte of zeros that unpacks to more than is allowed.
    np.savez_compressed(path, t=np.zeros(10), q=np.zeros((10, 10**6)))
    assert path.stat().st_size < 10**6
    with pytest.raises(sgpr.RecordingError, match="more than 1000000 bytes"):
        sgpr.read(path, limit_bytes=10**6)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_damaged_archive_is_an_error_and_nothing_else(data: st.DataObject) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, t=np.arange(5.0), q=np.ones((5, 2)), joint_names=np.array(["a", "b"]))
    content = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.npz"
        path.write_bytes(content)
        try:
            rec = sgpr.read(path, limit_bytes=10**6)
        except sgpr.SgprError:
            return
        assert rec.q.ndim == 2


def parquet(path: Path, **columns: Any) -> Path:
    pq.write_table(pa.table(columns), path)
    return path


def test_parquet_keeps_every_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    n = 500
    stamps = 1_700_000_000_123_456_789 + np.cumsum(rng.integers(1, 10**7, n))
    values = rng.standard_normal((n, 4)) * 10.0 ** rng.integers(-12, 12, (n, 4))
    path = parquet(
        tmp_path / "log.parquet",
        timestamp=pa.array(stamps, pa.timestamp("ns", tz="UTC")),
        q_1=values[:, 0],
        q_2=values[:, 1],
        tau_1=values[:, 2],
        tau_2=values[:, 3],
        temperature=pa.array(values[:, 0].astype(np.float32)),
        enabled=pa.array(rng.integers(0, 2, n).astype(bool)),
        note=["text"] * n,
    )
    rec = sgpr.read(path)
    assert np.array_equal(rec.time_ns, stamps)
    assert np.array_equal(rec.q, values[:, :2])
    assert np.array_equal(rec.tau, values[:, 2:])
    assert np.array_equal(rec.channels["temperature"], values[:, 0].astype(np.float32))
    assert set(rec.channels["enabled"]) <= {0.0, 1.0}
    assert rec.source == str(path)
    assert any("skipped columns that hold no numbers: note" in note for note in rec.notes)


def test_parquet_times_and_gaps(tmp_path: Path) -> None:
    q = [1.0, None, float("nan"), 4.0]
    for kind in (pa.timestamp("ms"), pa.timestamp("us"), pa.duration("ns"), pa.duration("s")):
        path = parquet(tmp_path / "log.parquet", time=pa.array([-5, 10, 20, 30], kind), q_1=q)
        rec = sgpr.read(path)
        unit = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}[kind.unit]
        assert np.array_equal(rec.time_ns, np.array([-5, 10, 20, 30]) * unit)
        assert np.array_equal(rec.q[:, 0], [1, np.nan, np.nan, 4], equal_nan=True)


def test_parquet_takes_the_options_of_tables(tmp_path: Path) -> None:
    path = parquet(tmp_path / "log.parquet", zeit=[0, 1, 2], w=[0.0, 90.0, 180.0])
    options = {"columns": {"time": "zeit", "position": ["w"]}, "units": {"position": "deg", "time": "ms"}}
    rec = sgpr.read(path, ["a"], **options)
    assert np.allclose(rec.q[:, 0], [0, np.pi / 2, np.pi])
    assert len(sgpr.read(path, ["a"], rows=(2, 3), **options)) == 2
    with pytest.raises(sgpr.RecordingError, match="no joint positions") as error:
        sgpr.read(path, columns={"time": "zeit"})
    assert str(error.value).startswith(str(path))
    with pytest.raises(sgpr.RecordingError, match="more than 10 bytes"):
        sgpr.read(path, limit_bytes=10, **options)
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(sgpr.RecordingError, match="not a Parquet file, or damaged"):
        sgpr.read(path)


def test_by_content_where_the_name_does_not_tell(log: sgpr.Recording, tmp_path: Path, data: Path) -> None:
    other = tmp_path / "log.data"
    for name in ("log.csv.gz", "log.mcap"):
        log.save(tmp_path / name)
        shutil.copy(tmp_path / name, other)
        assert_same(sgpr.read(other, log.joint_names), log)
    shutil.copy(parquet(tmp_path / "x.parquet", t=[0, 1], q_1=[1.0, 2.0]), other)
    assert len(sgpr.read(other)) == 2
    for content in (b"", b"t,q_1\n0,1\n", b"PK\x03\x04", b"\x00" * 100):
        other.write_bytes(content)
        with pytest.raises(
            sgpr.RecordingError, match=r"neither name nor content tell the format; understood are \.csv"
        ):
            sgpr.read(other)


def test_names_in_capitals_and_of_other_tables(tmp_path: Path) -> None:
    (tmp_path / "LOG.CSV").write_text("t,q_1\n0,1\n")
    (tmp_path / "log.txt").write_text("t q_1\n0 1\n")
    (tmp_path / "log.tsv").write_text("t\tq_1\n0\t1\n")
    for name in ("LOG.CSV", "log.txt", "log.tsv"):
        assert sgpr.read(tmp_path / name).q[0, 0] == 1


def test_options_that_do_not_apply(data: Path, log: sgpr.Recording, tmp_path: Path) -> None:
    mcap = data / "recording" / "zstd.mcap"
    with pytest.raises(sgpr.RecordingError, match="the option `columns` does not apply to MCAP files; those that do: "):
        sgpr.read(mcap, columns={"time": "t"})
    log.save(tmp_path / "log.csv")
    known = "those that do: `columns`, `rows`, `sample_rate_hz`, `seconds`, `torque_constants`, `units`$"
    with pytest.raises(sgpr.RecordingError, match=f"the option `topics` does not apply to CSV files; {known}"):
        sgpr.read(tmp_path / "log.csv", topics=["/a"])
    with pytest.raises(sgpr.RecordingError, match="the option `recover` does not apply to NumPy archive files"):
        (tmp_path / "log.npz").touch()
        sgpr.read(tmp_path / "log.npz", recover=True)
    with pytest.raises(TypeError, match="unexpected keyword argument 'colums'; options are accept, clock, columns"):
        sgpr.read(mcap, colums={})
    # What is not given is not there.
    assert len(sgpr.read(mcap, columns=None, units=None)) == 50


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as error:
        sgpr.read(tmp_path / "nowhere.csv")
    assert error.value.filename == str(tmp_path / "nowhere.csv")
    with pytest.raises(FileNotFoundError):
        sgpr.read("nowhere")
