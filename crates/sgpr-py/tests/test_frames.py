"""Frames of pandas and polars, MATLAB and HDF5 files."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from conftest import assert_same
from numpy.testing import assert_allclose

pandas = pytest.importorskip("pandas")


def test_there_and_back(log: sgpr.Recording) -> None:
    frame = log.to_dataframe()
    assert list(frame.columns[:4]) == ["t_s", "shoulder_position", "elbow_position", "wrist_position"]
    back = sgpr.read(frame, joints=log.joint_names)
    assert np.array_equal(back.q, log.q) and np.array_equal(back.tau, log.tau)
    assert_allclose(back.t, log.t, rtol=0.0, atol=1e-9)
    assert back.source == "table"


def test_times_of_pandas(log: sgpr.Recording) -> None:
    frame = log.to_dataframe().drop(columns="t_s")
    stamps = pandas.to_datetime(log.time_ns, utc=True)
    for dated in (frame.assign(time=stamps), frame.set_index(stamps), frame.set_index(stamps.rename("stamp"))):
        back = sgpr.Recording.from_dataframe(dated, joints=log.joint_names)
        assert np.array_equal(back.time_ns, log.time_ns)
    elapsed = frame.set_index(pandas.to_timedelta(log.time_ns - log.time_ns[0]))
    assert np.array_equal(sgpr.read(elapsed).time_ns, log.time_ns - log.time_ns[0])


def test_units_and_constants_of_frames() -> None:
    frame = pandas.DataFrame({"t": [0.0, 0.1], "q_1 [°]": [0.0, 180.0], "i1_A": [1.0, 2.0]})
    log = sgpr.read(frame, torque_constants=[10.0])
    assert_allclose(log.q[:, 0], [0.0, np.pi])
    assert_allclose(log.tau[:, 0], [10.0, 20.0])
    with pytest.raises(sgpr.RecordingError, match=r"^table: there is no column `x`"):
        sgpr.read(frame, columns={"position": ["x"]})


def test_polars(log: sgpr.Recording) -> None:
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"t": log.t, **{f"q_{k + 1}": log.q[:, k] for k in range(3)}})
    assert np.array_equal(sgpr.read(frame).q, log.q)


def test_what_is_no_frame() -> None:
    with pytest.raises(TypeError, match="expected a DataFrame"):
        sgpr.Recording.from_dataframe([[0.0]])


def tables(log: sgpr.Recording) -> dict[str, pandas.DataFrame]:
    """Tables with all that columns can hold, by what counts their time."""
    rng, rows = np.random.default_rng(8), len(log)
    scattered = rng.standard_normal((rows, 4)) * 10.0 ** rng.integers(-12, 6, (rows, 4))
    columns = {
        **{f"q{k + 1}_deg": scattered[:, k] for k in range(2)},
        **{f"tau_{k + 1}": scattered[:, 2 + k] for k in range(2)},
        "small": rng.standard_normal(rows).astype(np.float32),
        "on": rng.integers(0, 2, rows).astype(bool),
        "count": rng.integers(-(2**60), 2**60, rows),
        "large": rng.integers(0, 2**63, rows, dtype=np.uint64) * 2 + 1,
        "holes": np.where(rng.random(rows) < 0.2, np.nan, 1.0 / 3.0),
    }
    since = np.cumsum(rng.integers(10**6, 10**7, rows))
    stamps = 1_700_000_000_123_456_789 + since
    times = {
        "seconds": {"t": since / 1e9},
        "milliseconds": {"time_ms": since / 1e6},
        "since 1970": {"time": stamps / 1e9},
        "short": {"t": (since / 1e9).astype(np.float32)},
        "whole": {"timestamp": stamps},
        "stamps": {"header.stamp.sec": stamps // 10**9, "header.stamp.nanosec": stamps % 10**9},
        "dates": {"time": pandas.to_datetime(stamps)},
    }
    return {name: pandas.DataFrame({**time, **columns}) for name, time in times.items()}


def all_of(log: sgpr.Recording) -> list[Any]:
    """Everything that a recording holds but its source."""
    assert log.tau is not None
    arrays = [log.time_ns, log.q, log.tau, *log.channels.values()]
    issues = [(issue.kind, issue.rank, issue.message, issue.time, issue.count) for issue in log.issues]
    return [*(array.tobytes() for array in arrays), list(log.channels), log.layout, log.joint_names, issues]


def test_tables_in_memory_are_what_their_text_is(log: sgpr.Recording, tmp_path: Path) -> None:
    polars, parquet = pytest.importorskip("polars"), pytest.importorskip("pyarrow.parquet")
    arrow = pytest.importorskip("pyarrow")
    for name, frame in tables(log).items():
        frame.to_csv(tmp_path / "table.csv", index=False)
        for part in ({}, {"rows": (3, 40)}, {"seconds": (0.1, 0.3)}):
            text = sgpr.read(tmp_path / "table.csv", **part)
            assert all_of(sgpr.read(frame, **part)) == all_of(text), name
            assert all_of(sgpr.read(polars.from_pandas(frame), **part)) == all_of(text), name
            if name not in ("short", "dates"):
                # Parquet keeps 32 bits as they are, and counts dates.
                wide = frame.astype({"small": np.float64})
                wide.to_csv(tmp_path / "wide.csv", index=False)
                parquet.write_table(arrow.Table.from_pandas(wide), tmp_path / "table.parquet")
                assert all_of(sgpr.read(tmp_path / "table.parquet", **part)) == all_of(
                    sgpr.read(tmp_path / "wide.csv", **part)
                ), name


def test_tables_in_memory_are_refused_as_their_text_is(tmp_path: Path) -> None:
    for columns in (
        {"t": [0.0, 1.0], "q_1": [1.0, "twelve"]},
        {"t": [0.0, np.inf], "q_1": [1.0, 2.0]},
        {"t": ["now", "later"], "q_1": [1.0, 2.0]},
        {"t": [], "q_1": []},
        {"a": [0.0], "b": [1.0]},
        {0: [0.0], 1: [1.0]},
        {"t": [0.0, 1.0], "q1 [%]": [0.1, 0.2]},
    ):
        frame = pandas.DataFrame(columns)
        frame.to_csv(tmp_path / "table.csv", index=False)
        with pytest.raises(sgpr.RecordingError) as of_text:
            sgpr.read(tmp_path / "table.csv")
        with pytest.raises(sgpr.RecordingError) as of_frame:
            sgpr.read(frame)
        assert str(of_frame.value) == str(of_text.value).replace(str(tmp_path / "table.csv"), "table")


def test_a_line_of_units_in_a_frame_is_understood() -> None:
    frame = pandas.DataFrame({"t": ["ms", "0", "4", "8"], "q_1": ["deg", "0", "90", "180"]})
    assert_allclose(sgpr.read(frame).q[:, 0], [0.0, np.pi / 2, np.pi])
    assert sgpr.read(frame).time_ns.tolist() == [0, 4_000_000, 8_000_000]


def matlab_files(folder: Path, log: sgpr.Recording) -> list[Path]:
    scipy = pytest.importorskip("scipy.io")
    names = np.array(log.joint_names, dtype=object)
    arrays = {"t": log.t[:, None], "q": log.q, "dq": log.dq, "tau": log.tau, "joint_names": names}
    scipy.savemat(folder / "arrays.mat", arrays)
    scipy.savemat(folder / "struct.mat", {"run": {**arrays, "q": log.q.T}})
    scipy.savemat(folder / "packed.mat", arrays, do_compression=True)
    return [folder / name for name in ("arrays.mat", "struct.mat", "packed.mat")]


def test_matlab(tmp_path: Path, log: sgpr.Recording) -> None:
    for path in matlab_files(tmp_path, log):
        back = sgpr.read(path)
        assert back.joint_names == log.joint_names
        assert np.array_equal(back.q, log.q) and np.array_equal(back.tau, log.tau)
    scipy = pytest.importorskip("scipy.io")
    vectors = {"t": log.t, "q_1_deg": np.degrees(log.q[:, 0]), "tau_1": log.tau[:, 0], "gain": 3.0}
    scipy.savemat(tmp_path / "vectors.mat", vectors)
    back = sgpr.read(tmp_path / "vectors.mat")
    assert_allclose(back.q[:, 0], log.q[:, 0], rtol=1e-14)
    with pytest.raises(sgpr.RecordingError, match="more than 100 bytes"):
        sgpr.read(tmp_path / "vectors.mat", limit_bytes=100)
    (tmp_path / "damaged.mat").write_bytes((tmp_path / "packed.mat").read_bytes()[:400])
    with pytest.raises(sgpr.RecordingError, match="not a MATLAB file, or damaged"):
        sgpr.read(tmp_path / "damaged.mat")


def matlab_object(name: str, of_class: str) -> bytes:
    """An object of MATLAB, such as a `timeseries`, as a MATLAB file holds it."""
    scipy, stream = pytest.importorskip("scipy.io"), io.BytesIO()
    scipy.savemat(stream, {"x": np.zeros((1, 1))})

    def text(value: str) -> bytes:
        return struct.pack("<II", 1, len(value)) + value.encode().ljust(-(-len(value) // 8) * 8, b"\0")

    body = struct.pack("<4I", 6, 8, 17, 0) + text(name) + text("MCOS") + text(of_class) + stream.getvalue()[128:]
    return struct.pack("<II", 14, len(body)) + body


def test_matlab_files_of_another_toolbox(tmp_path: Path, log: sgpr.Recording) -> None:
    scipy = pytest.importorskip("scipy.io")
    settings = {"gains": np.ones(4), "limits": np.ones(4), "names": {"t": 1.0}}
    run = {"time": log.t, "q_deg": np.degrees(log.q).T, "tau": log.tau.T}
    scipy.savemat(tmp_path / "run.mat", {"rec": run, "para": settings}, do_compression=True)
    with (tmp_path / "run.mat").open("ab") as file:
        file.write(matlab_object("run", "timeseries"))
    back = sgpr.read(tmp_path / "run.mat")
    assert_allclose(back.q, log.q, rtol=1e-14)
    assert np.array_equal(back.tau, log.tau)
    # Names that say nothing: the arrays are told, those of samples first, and are called by their own names.
    odd = {"c": log.t, "meas": log.q.T, "sens": log.tau.T, "u": np.ones(4)}
    scipy.savemat(tmp_path / "odd.mat", {"rec": odd, "para": {**settings, "u": np.ones(4)}})
    with pytest.raises(sgpr.RecordingError, match=r"no time and positions among the arrays `(meas|sens)` \("):
        sgpr.read(tmp_path / "odd.mat")
    columns = {"time": "c", "position": "meas", "torque": "sens"}
    back = sgpr.read(tmp_path / "odd.mat", columns=columns)
    assert np.array_equal(back.q, log.q) and np.array_equal(back.tau, log.tau)


def test_a_packed_structure_cannot_eat_all_memory(tmp_path: Path) -> None:
    scipy = pytest.importorskip("scipy.io")
    scipy.savemat(tmp_path / "bomb.mat", {"rec": {"q": np.zeros((100_000, 7))}}, do_compression=True)
    assert (tmp_path / "bomb.mat").stat().st_size < 20_000
    with pytest.raises(sgpr.RecordingError, match="more than 1000000 bytes of unpacked data"):
        sgpr.read(tmp_path / "bomb.mat", limit_bytes=1_000_000)


def test_hdf5(tmp_path: Path, log: sgpr.Recording) -> None:
    hdf5 = pytest.importorskip("h5py")
    with hdf5.File(tmp_path / "log.h5", "w") as file:
        group = file.create_group("run_1")
        for name, values in (("t", log.t), ("q", log.q), ("dq", log.dq), ("tau", log.tau)):
            group[name] = values
        group["joint_names"] = log.joint_names
    back = sgpr.read(tmp_path / "log.h5")
    assert back.joint_names == log.joint_names
    assert np.array_equal(back.q, log.q) and np.array_equal(back.dq, log.dq)
    # MATLAB 7.3 is HDF5 with columns first.
    with hdf5.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        for name, values in (("t", log.t[None, :]), ("q", log.q.T), ("tau", log.tau.T)):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    assert_same(sgpr.read(tmp_path / "log.mat").renamed(log.joint_names), sgpr.Recording(
        log.t, log.q, tau=log.tau, joint_names=log.joint_names))  # fmt: skip
    (tmp_path / "damaged.h5").write_bytes((tmp_path / "log.h5").read_bytes()[:600])
    with pytest.raises(sgpr.RecordingError, match="not an HDF5 file, or damaged"):
        sgpr.read(tmp_path / "damaged.h5")
    with hdf5.File(tmp_path / "empty.h5", "w") as file:
        file["note"] = "nothing"
    with pytest.raises(sgpr.RecordingError, match="name them `t` and `q`"):
        sgpr.read(tmp_path / "empty.h5")


def test_units_beside_the_arrays_of_hdf5(tmp_path: Path, log: sgpr.Recording) -> None:
    hdf5 = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with hdf5.File(path, "w") as file:
        file["run/time"], file["run/position"] = 1000.0 * log.t, np.degrees(log.q)
        file["run/effort"] = log.tau
        for name, unit in (("time", "ms"), ("position", "deg"), ("effort", np.bytes_("Nm"))):
            file[f"run/{name}"].attrs["units"] = unit
    found = sgpr.read(path)
    assert np.allclose(found.q, log.q) and np.allclose(found.t, log.t)
    assert found.layout is not None and "position in deg, torque in Nm" in found.layout["text"]
    # The name that was used remains good.
    assert np.allclose(sgpr.read(path, columns={"position": "position"}).q, log.q)
    with hdf5.File(path, "r+") as file:
        file["run/effort"].attrs["units"] = "%"
    with pytest.raises(sgpr.RecordingError, match="no known unit of torque"):
        sgpr.read(path)


def test_an_array_is_no_measurement_if_its_name_says_more(tmp_path: Path, log: sgpr.Recording) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, t=log.t, q_actual=log.q, q_des=log.q + 1.0, tau_ext=log.tau)
    found = sgpr.read(path)
    assert np.array_equal(found.q, log.q) and found.tau is None
    np.savez(path, t=log.t, q_des=log.q, tau=log.tau)
    with pytest.raises(sgpr.RecordingError, match=r"no array `q` .* `q_des`"):
        sgpr.read(path)
    assert np.array_equal(sgpr.read(path, columns={"position": "q_des"}).q, log.q)


def test_lists_in_parquet(tmp_path: Path, log: sgpr.Recording) -> None:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = {
        "timestamp": arrow.array(log.time_ns, arrow.timestamp("ns")),
        "position": arrow.array(list(np.degrees(log.q))),
        "effort": arrow.array(list(log.tau)),
        "note": ["text"] * len(log),
    }
    path = tmp_path / "log.parquet"
    parquet.write_table(arrow.table(table), path)
    found = sgpr.read(path, units={"position": "deg"})
    assert np.allclose(found.q, log.q) and np.array_equal(found.tau, log.tau)
    assert np.array_equal(found.time_ns, log.time_ns)
    assert any("skipped columns that hold no numbers: note" in note for note in found.notes)
    uneven = arrow.table({"t": [0.0, 1.0], "q": arrow.array([[0.0, 1.0], [0.0]])})
    parquet.write_table(uneven, path)
    with pytest.raises(sgpr.RecordingError, match="unequal length"):
        sgpr.read(path)


def test_arrays_have_units_and_names_of_their_own(tmp_path: Path, log: sgpr.Recording) -> None:
    degrees, current = np.degrees(log.q), log.tau / 2.0
    np.savez(tmp_path / "named.npz", time=log.t, q_deg=degrees, tau=log.tau)
    np.savez(tmp_path / "others.npz", clock=1e3 * log.t, joint_angles=degrees.T, drives=current)
    np.savez(tmp_path / "counted.npz", qpos=log.q, effort=log.tau)
    joints = log.joint_names
    named = sgpr.read(tmp_path / "named.npz", joints)
    assert_allclose(named.q, log.q, rtol=1e-14)
    assert named.layout["joints"][1]["position"] == {
        "column": "2 of q_deg", "unit": "deg", "stated": True, "torque_constant": None
    }  # fmt: skip
    others = sgpr.read(
        tmp_path / "others.npz",
        joints,
        columns={"time": "clock", "position": "joint_angles", "torque": "drives"},
        units={"time": "ms", "position": "deg"},
        torque_constants=[2.0, 2.0, 2.0],
    )
    assert_allclose(others.q, log.q, rtol=1e-14)
    assert_allclose(others.tau, log.tau, rtol=1e-14)
    assert_allclose(others.t, log.t - log.t[0], atol=1e-9)
    counted = sgpr.read(tmp_path / "counted.npz", joints, sample_rate_hz=100.0)
    assert np.array_equal(counted.q, log.q) and np.array_equal(counted.tau, log.tau)
    assert counted.sample_rate_hz == 100.0
    for options, said in (
        ({}, "no array `t` or `time` or `time_ns` of shape"),
        ({"columns": {"position": "angles"}}, "there is no array `angles` for position; the arrays are `qpos`"),
    ):
        with pytest.raises(sgpr.RecordingError, match=said):
            sgpr.read(tmp_path / "counted.npz", **options)
    with pytest.raises(sgpr.RecordingError, match="3 columns without names, the robot has 2 joints"):
        sgpr.read(tmp_path / "named.npz", ["a", "b"])
    plain = tmp_path / "plain.npz"
    np.savez(plain, t=log.t, q=log.q)
    assert "1 of q" in sgpr.read(plain).layout["text"]


def lerobot(folder: Path, log: sgpr.Recording, episodes: int, *, one_file: bool) -> Path:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = {"motors": [f"{name}.pos" for name in log.joint_names]}
    info = {
        "codebase_version": "v3.0" if one_file else "v2.1",
        "fps": 100,
        "features": {
            "observation.state": {"names": names},
            "observation.effort": {"names": log.joint_names},
            "action": {"names": names},
        },
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    rows = len(log.t)
    tables = [
        arrow.table(
            {
                "observation.state": arrow.array(list(log.q + episode)),
                "observation.effort": arrow.array(list(log.tau)),
                "action": arrow.array(list(log.q)),
                "timestamp": arrow.array((np.arange(rows) / 100).astype(np.float32)),
                "frame_index": np.arange(rows),
                "episode_index": np.full(rows, episode),
                "task": ["pick"] * rows,
            }
        )
        for episode in range(episodes)
    ]
    if one_file:
        parquet.write_table(arrow.concat_tables(tables), chunk / "file-000.parquet")
    else:
        for episode, table in enumerate(tables):
            parquet.write_table(table, chunk / f"episode_{episode:06d}.parquet")
    return folder


@pytest.mark.parametrize("one_file", [False, True])
def test_lerobot(tmp_path: Path, log: sgpr.Recording, one_file: bool) -> None:
    place = lerobot(tmp_path / "data_set", log, 3, one_file=one_file)
    for episode in range(3):
        found = sgpr.read(place / f"episode_{episode}")
        assert found.joint_names == log.joint_names
        assert_allclose(found.q, log.q + episode, rtol=1e-14)
        assert np.array_equal(found.tau, log.tau)
        assert_allclose(found.t, np.arange(len(log.t)) / 100, atol=1e-12)
        assert "skipped columns that hold no rows of numbers: task" in found.notes
    for path, said in ((place, "3 episodes; each is a log of its own"), (place / "episode_7", "there is no episode 7")):
        with pytest.raises(sgpr.RecordingError, match=said):
            sgpr.read(path)
    file = min((place / "data").rglob("*.parquet"))
    if one_file:
        with pytest.raises(sgpr.RecordingError, match=r"from .*episode_0 to .*episode_2"):
            sgpr.read(file)
    else:
        assert_allclose(sgpr.read(file).q, log.q, rtol=1e-14)
    (place / "meta" / "info.json").write_text("[1]")
    with pytest.raises(sgpr.RecordingError, match="expected `features`"):
        sgpr.read(place / "episode_0")


def test_a_data_set_of_one_episode_is_a_log(tmp_path: Path, log: sgpr.Recording) -> None:
    place = lerobot(tmp_path / "one", log, 1, one_file=True)
    assert_allclose(sgpr.read(place).q, log.q, rtol=1e-14)
    with pytest.raises(sgpr.RecordingError, match="more than 100 bytes"):
        sgpr.read(place, limit_bytes=100)
