"""Frames of pandas and polars, MATLAB and HDF5 files."""

from pathlib import Path

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
