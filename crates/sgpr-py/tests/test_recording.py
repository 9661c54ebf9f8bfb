"""Recordings: made of arrays, checked, repaired, written; CSV and MCAP files."""

import copy
import gzip
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import sgpr
from conftest import assert_same
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def test_arrays_in_and_out() -> None:
    t = np.arange(5) / 10
    q = np.arange(10.0).reshape(5, 2)
    rec = sgpr.Recording(t, q, tau=-q, channels={"temperature": t + 20}, source="test")
    assert (rec.source, rec.joint_names, rec.dof, len(rec)) == ("test", ["joint_1", "joint_2"], 2, 5)
    assert np.array_equal(rec.t, t)
    assert rec.time_ns.dtype == np.int64
    assert np.array_equal(rec.time_ns, [0, 100_000_000, 200_000_000, 300_000_000, 400_000_000])
    assert np.array_equal(rec.q, q)
    assert rec.dq is None
    assert rec.tau is not None
    assert np.array_equal(rec.tau, -q)
    assert list(rec.channels) == ["temperature"]
    assert np.array_equal(rec.channels["temperature"], t + 20)
    assert (rec.duration, rec.sample_rate_hz, rec.notes) == (0.4, 10.0, [])
    assert "5 samples, 10.000000 Hz" in repr(rec)


def test_arrays_are_views_that_keep_their_recording() -> None:
    rec = sgpr.Recording(np.arange(100.0), np.ones((100, 2)))
    q = rec.q
    assert np.shares_memory(q, rec.q)
    assert not q.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        q[0, 0] = 5
    with pytest.raises(ValueError, match="WRITEABLE"):
        q.flags.writeable = True
    del rec
    assert q.sum() == 200


def test_a_recording_keeps_a_copy() -> None:
    q = np.ones((3, 1))
    rec = sgpr.Recording([0, 1, 2], q)
    q[:] = 5
    assert np.all(rec.q == 1)


def test_a_recording_travels_to_other_processes(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q_1,tau_1,temperature,comment\n0.5,1,2,20,a\n0.6,1.5,nan,21,b\n")
    rec = sgpr.read(path)
    assert rec.notes == ["skipped columns of text: `comment`"]
    for again in (pickle.loads(pickle.dumps(rec)), copy.copy(rec), copy.deepcopy(rec)):
        assert (again.source, again.joint_names, again.notes) == (rec.source, rec.joint_names, rec.notes)
        assert np.array_equal(again.time_ns, rec.time_ns)
        assert np.array_equal(again.q, rec.q)
        assert again.dq is None
        assert np.array_equal(again.tau, rec.tau, equal_nan=True)
        assert np.array_equal(again.channels["temperature"], rec.channels["temperature"])


def test_times_of_every_kind() -> None:
    ns = np.array([1_700_000_000_123_456_789, 1_700_000_000_133_456_789])
    q = [[0.0], [1.0]]
    for t in (ns, ns.view("datetime64[ns]"), ns.tolist()):
        assert np.array_equal(sgpr.Recording(t, q).time_ns, ns)
    assert np.array_equal(sgpr.Recording(np.array([1, 2], np.int32), q).time_ns, [1, 2])
    # Seconds of 1970 in doubles are good to a quarter of a microsecond, and not made worse.
    seconds = ns / 1e9
    assert np.abs(sgpr.Recording(seconds, q).time_ns - ns).max() <= 239
    exact = sgpr.Recording([0.1, 0.3], q).time_ns
    assert np.array_equal(exact, [100_000_000, 300_000_000])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 1], [[0.0]]), r"q: got \(1, 1\), expected \(2, n\), one row per time"),
        (([0, 1], [0.0, 1.0]), r"q: got \(2,\), expected \(2, n\)"),
        (([0, 1], np.zeros((2, 0))), r"q: got \(2, 0\), expected"),
        (([[0, 1]], np.zeros((2, 1))), r"t: got an array of 2 axes, expected \(N,\)"),
        (([[0.0, 1.0]], np.zeros((2, 1))), r"t: got \(1, 2\), expected \(N,\)"),
        (([0.0, np.nan], np.zeros((2, 1))), r"t\[1\] is NaN: not a time"),
        (([0.0, 1e300], np.zeros((2, 1))), r"t\[1\] is 1.*: not a time"),
        (([0, 1], np.zeros((2, 1)), np.zeros((3, 1))), r"dq: got \(3, 1\), expected \(2, 1\)"),
        (([0, 1], np.zeros((2, 1)), None, np.zeros((2, 2))), r"tau: got \(2, 2\), expected \(2, 1\)"),
    ],
)
def test_arrays_that_do_not_fit(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.Recording(*arguments)  # type: ignore[arg-type]


def test_names_that_do_not_fit() -> None:
    t, q = [0, 1], np.zeros((2, 2))
    with pytest.raises(sgpr.SgprError, match="joint_names: got 1, expected 2: one name for each joint"):
        sgpr.Recording(t, q, joint_names=["a"])
    with pytest.raises(sgpr.RecordingError, match="the joint `a` occurs twice"):
        sgpr.Recording(t, q, joint_names=["a", "a"])
    with pytest.raises(sgpr.SgprError, match=r"channels\['x'\]: got \(3,\), expected \(2,\)"):
        sgpr.Recording(t, q, channels={"x": [1, 2, 3]})
    with pytest.raises(TypeError, match="channels: got list, expected a dict"):
        sgpr.Recording(t, q, channels=[1])  # type: ignore[arg-type]


def test_an_empty_recording_is_one() -> None:
    rec = sgpr.Recording(np.zeros(0), np.zeros((0, 2)))
    assert len(rec) == 0
    assert (rec.duration, rec.sample_rate_hz) == (0.0, None)
    assert rec.q.shape == (0, 2)
    assert isinstance(rec.issues, list)
    with pytest.raises(sgpr.SgprError):
        sgpr.identify(sgpr.robots.two_link(), [rec])


def test_issues_have_names_and_places() -> None:
    t = np.arange(200) / 100
    q = np.sin(t)[:, None].copy()
    q[50] = np.nan
    t[120:] += 1
    rec = sgpr.Recording(t, q)
    issues = {issue.kind: issue for issue in rec.issues}
    assert issues["not_finite"].severity == "error"
    assert issues["not_finite"].time == 0.5
    assert issues["not_finite"].count == 1
    assert issues["not_finite"].channel == "joint_1_position"
    assert issues["gap"].severity in ("warning", "error")
    assert rec.issues[0].severity == "error"
    assert "not_finite" in repr(issues["not_finite"])
    assert rec.issues[0] is rec.issues[0]


def test_parts() -> None:
    rec = sgpr.Recording(np.arange(10.0), np.arange(20.0).reshape(10, 2), joint_names=["a", "b"])
    assert np.array_equal(rec.select(["b", "a"]).q, rec.q[:, ::-1])
    assert rec.renamed(["c", "d"]).joint_names == ["c", "d"]
    assert np.array_equal(rec.slice(2, 5).q, rec.q[2:5])
    assert len(rec.slice(3, 3)) == 0
    for start, stop in ((-1, 3), (3, 2), (0, 11)):
        with pytest.raises(sgpr.SgprError, match="expected 0 <= start <= stop <= 10"):
            rec.slice(start, stop)
    with pytest.raises(sgpr.RecordingError, match="there is no joint `c`; the joints are `a`, `b`"):
        rec.select(["c"])
    with pytest.raises(sgpr.RecordingError, match="got 1 value for 2 joints"):
        rec.renamed(["c"])
    with pytest.raises(sgpr.RecordingError, match="occurs twice"):
        rec.renamed(["c", "c"])
    with pytest.raises(TypeError, match="joints: got a str"):
        rec.select("a")


def test_repair_does_what_is_asked_and_says_so() -> None:
    t = np.array([0.0, 0.1, 0.1, 0.3, 0.2, 5.0, 5.1, 5.2])
    q = np.arange(8.0)[:, None].copy()
    q[6] = np.inf
    rec = sgpr.Recording(t, q, source="log")
    repaired = rec.repair(sort=True, drop_duplicates=True, drop_not_finite=True, split_gaps=1.0)
    assert [part.q.ravel().tolist() for part in repaired.recordings] == [[0, 1, 4, 3], [5, 7]]
    assert len(repaired.actions) == 4
    assert all(action.startswith("log: ") for action in repaired.actions)
    assert len(rec.repair(trim=(0.0, 0.15)).recordings[0]) == 3
    even = rec.repair(trim=(0.0, 0.3), sort=True, drop_duplicates=True, resample=20.0).recordings[0]
    assert even.sample_rate_hz == 20.0
    median = rec.repair(trim=(0.0, 0.3), sort=True, drop_duplicates=True, resample="median").recordings[0]
    assert median.sample_rate_hz == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resample": "mean"}, "resample = 'mean': expected a rate in Hz or 'median'"),
        ({"resample": -1.0}, "resample = -1: expected a number greater than zero"),
        ({"resample": np.nan}, "resample = NaN"),
        ({"trim": (1.0, 0.0)}, r"trim = \(1, 0\): expected a start and a later end"),
        ({"trim": (np.nan, 1.0)}, "trim"),
        ({"trim": (50.0, 60.0)}, "no sample is left"),
        ({"split_gaps": 0.0}, "split_gaps"),
    ],
)
def test_repairs_that_cannot_be(options: dict[str, object], message: str) -> None:
    rec = sgpr.Recording([0.0, 0.1, 0.2], [[0.0], [1.0], [2.0]])
    with pytest.raises(sgpr.SgprError, match=message):
        rec.repair(**options)  # type: ignore[arg-type]


def test_periods_are_averaged() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(1100) / 100
    clean = np.sin(2 * np.pi * t)[:, None]
    rec = sgpr.Recording(t, clean, tau=clean + 0.1 * rng.standard_normal((1100, 1)))
    mean, noise = rec.average_periods(1.0, skip=1)
    assert len(mean) == 100
    assert noise["torque_noise"] == pytest.approx(0.1, rel=0.1)
    assert noise["position_noise"] == pytest.approx(0.0, abs=1e-12)
    for period, message in (
        (0.0, "greater than zero"),
        (np.nan, "greater"),
        (1e-9, "shorter than one step"),
        (8.0, "an average needs two"),
        (0.995, "whole number"),
    ):
        with pytest.raises(sgpr.SgprError, match=message):
            rec.average_periods(period)
    with pytest.raises(sgpr.RecordingError, match="no torque"):
        sgpr.Recording(t, clean).average_periods(1.0)


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz", "log.mcap"])
def test_saved_and_read_back(name: str, log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / name
    log.save(path)
    assert_same(sgpr.read(path, log.joint_names), log)
    assert sgpr.read(path).source == str(path)


def test_where_nothing_can_be_saved(log: sgpr.Recording, tmp_path: Path) -> None:
    with pytest.raises(sgpr.SgprError, match=r"expected a name that ends in \.csv, \.csv\.gz or \.mcap"):
        log.save(tmp_path / "log.xlsx")
    with pytest.raises(FileNotFoundError):
        log.save(tmp_path / "nowhere" / "log.csv")
    early = sgpr.Recording([-5, 0], [[0.0], [1.0]])
    with pytest.raises(sgpr.RecordingError, match="does not fit a ROS 2 time stamp"):
        early.save(tmp_path / "log.mcap")


def test_independent_packages_read_our_mcap(log: sgpr.Recording, tmp_path: Path) -> None:
    path = tmp_path / "both.mcap"
    half = log.slice(0, 20).select(["wrist"])
    sgpr.write_mcap(path, {"/measured": log, "/predicted": half})
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        messages = [(channel.topic, message, state) for _, channel, message, state in reader.iter_decoded_messages()]
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 70
    for topic, rec in (("/measured", log), ("/predicted", half)):
        own = [(message, state) for name, message, state in messages if name == topic]
        assert len(own) == len(rec)
        assert rec.dq is not None
        assert rec.tau is not None
        for k, (message, state) in enumerate(own):
            assert list(state.name) == rec.joint_names
            assert list(state.position) == rec.q[k].tolist()
            assert list(state.velocity) == rec.dq[k].tolist()
            assert list(state.effort) == rec.tau[k].tolist()
            stamp = state.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == rec.time_ns[k] == message.log_time


def test_topics_are_recordings(tmp_path: Path, log: sgpr.Recording) -> None:
    with pytest.raises(TypeError):
        sgpr.write_mcap(tmp_path / "x.mcap", {"/a": log.q})  # type: ignore[dict-item]
    with pytest.raises(TypeError, match="topics: got list, expected a dict"):
        sgpr.write_mcap(tmp_path / "x.mcap", [log])  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError):
        sgpr.write_mcap(tmp_path / "nowhere" / "x.mcap", {"/a": log})


def test_csv_options(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("zeit,w1,w2,n1,n2,i1_A,i2_A\n0,180,90,60,0,1,2\n10,90,0,30,60,3,4\n20,0,45,0,0,5,6\n")
    options = {
        "columns": {"time": "zeit", "position": "w{}", "velocity": ["n1", "n2"]},
        "units": {"time": "ms", "position": "deg", "velocity": "rpm"},
        "torque_constants": [2.0, 10.0],
    }
    rec = sgpr.read_csv(path, ["a", "b"], **options)  # type: ignore[arg-type]
    assert rec.joint_names == ["a", "b"]
    assert np.allclose(rec.q[0], [np.pi, np.pi / 2])
    assert rec.dq is not None
    assert np.allclose(rec.dq[0], [2 * np.pi, 0])
    assert rec.tau is not None
    assert np.allclose(rec.tau, [[2, 20], [6, 40], [10, 60]])
    assert np.array_equal(rec.time_ns, [0, 10_000_000, 20_000_000])
    assert len(sgpr.read_csv(path, ["a", "b"], rows=(2, 3), **options)) == 2  # type: ignore[arg-type]
    assert len(sgpr.read_csv(path, ["a", "b"], seconds=(0, 0.01), **options)) == 2  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rows": (0, 3)}, r"rows = \(0, 3\): expected 1 <= first <= last"),
        ({"rows": (3, 1)}, "expected 1 <= first <= last"),
        ({"rows": (1, 2), "seconds": (0, 1)}, "rows and seconds: give one of them"),
        ({"seconds": (2, 1)}, "expected a start and a later end"),
        ({"columns": {"force": "x"}}, "columns: there is no `force`; known are time, position, velocity, torque"),
        ({"units": {"mass": "kg"}}, "units: there is no `mass`"),
        ({"units": {"position": "grad"}}, "`grad` is no unit of position; known are `rad`"),
        ({"columns": {"position": "x{}"}}, "there is no column `x1`"),
        ({"sample_rate_hz": 0.0}, "sample_rate_hz = 0"),
        ({"torque_constants": [1.0]}, "say which they are with `columns.torque`"),
        ({"limit_bytes": 3}, "more than 3 bytes"),
        ({"joints": []}, "at least one joint"),
    ],
)
def test_csv_options_that_cannot_be(options: dict[str, object], message: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q_1,tau_1\n0,1,2\n1,2,3\n")
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.read_csv(path, **options)  # type: ignore[arg-type]


def test_csv_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for content, message in (
        (b"", "empty"),
        (b"t,q_1\n", "no data rows"),
        (b"\x89MCAP0\r\n", "MCAP"),
        (b"t,q_1\n0,x\n", "`x` is not a number"),
        (gzip.compress(b"t,q_1\n" + b"0,1\n" * 99)[:-9], "gzip"),
    ):
        path.write_bytes(content)
        with pytest.raises(sgpr.RecordingError, match=message):
            sgpr.read_csv(path)
    with pytest.raises(FileNotFoundError):
        sgpr.read_csv(tmp_path / "nowhere.csv")


def test_mcap_files_of_other_programs(data: Path, log: sgpr.Recording) -> None:
    for name in ("zstd", "lz4", "uncompressed"):
        rec = sgpr.read_mcap(data / "recording" / f"{name}.mcap", log.joint_names)
        assert np.array_equal(rec.time_ns, log.time_ns)
        assert np.allclose(rec.q, log.q, rtol=0, atol=1e-15)
        assert rec.tau is not None
        assert log.tau is not None
        assert np.allclose(rec.tau, log.tau, rtol=0, atol=1e-13)


def test_mcap_options(data: Path) -> None:
    folder = data / "recording"
    header = sgpr.read_mcap(folder / "zstd.mcap")
    received = sgpr.read_mcap(folder / "zstd.mcap", clock="log")
    assert np.all(received.time_ns - header.time_ns == 1_000_000)
    named = sgpr.read_mcap(folder / "zstd.mcap", ["a"], logged_names=["elbow"])
    assert named.joint_names == ["a"]
    with pytest.raises(sgpr.SgprError, match="clock = 'wall': expected 'header' or 'log'"):
        sgpr.read_mcap(folder / "zstd.mcap", clock="wall")  # type: ignore[arg-type]
    with pytest.raises(sgpr.RecordingError, match=r"truncated.*set `recover`"):
        sgpr.read_mcap(folder / "truncated_zstd.mcap")
    rescued = sgpr.read_mcap(folder / "truncated_zstd.mcap", recover=True)
    assert 0 < len(rescued) < 50
    assert any("recovered" in note for note in rescued.notes)
    with pytest.raises(sgpr.RecordingError, match="there is no topic `/nothing`"):
        sgpr.read_mcap(folder / "zstd.mcap", topics=["/nothing"])


def test_channels_and_notes_of_mcap(data: Path) -> None:
    rec = sgpr.read_mcap(data / "recording" / "extras.mcap", topics=["/joint_states"])
    assert rec.channels
    assert all(values.shape == (len(rec),) for values in rec.channels.values())
    assert rec.notes
    json.dumps(rec.notes)


def test_a_test_log_with_the_motion_of_the_training_is_found(
    demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording, log: sgpr.Recording
) -> None:
    again = demo_logs[0].slice(1000, 4000)
    assert sgpr.repeated_share(demo_logs, again) == 1.0
    assert sgpr.repeated_share(demo_logs, demo_test) == 0.0
    assert sgpr.shared_samples(demo_logs, again) == [(0, 0, 3000)]
    assert sgpr.shared_samples(demo_logs, demo_test) == []
    with pytest.raises(ValueError, match="joints"):
        sgpr.repeated_share(demo_logs, log)
