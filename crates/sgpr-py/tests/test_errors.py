"""Exceptions: one family, and the system's own for files."""

import os
from pathlib import Path

import pytest
import sgpr


def test_one_family() -> None:
    assert issubclass(sgpr.SgprError, ValueError)
    for error in (sgpr.RobotError, sgpr.RecordingError, sgpr.IdentificationError, sgpr.ModelFileError):
        assert issubclass(error, sgpr.SgprError)
        assert error.__doc__
        assert error.__module__ == "sgpr"


@pytest.mark.parametrize("call", [sgpr.Robot.from_urdf, sgpr.read, sgpr.read_csv, sgpr.read_mcap, sgpr.load])
def test_missing_files_are_what_open_says(call: object, tmp_path: Path) -> None:
    missing = tmp_path / "nothing.csv"
    with pytest.raises(FileNotFoundError) as expected:
        missing.open()
    for path in (missing, str(missing)):
        with pytest.raises(FileNotFoundError) as found:
            call(path)  # type: ignore[operator]
        assert found.value.args == expected.value.args
        assert str(found.value.filename) == str(expected.value.filename)
        assert found.value.errno == expected.value.errno


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root reads everything")
def test_locked_files_are_permission_errors(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.touch(mode=0)
    with pytest.raises(PermissionError):
        sgpr.read(path)


def test_paths_that_are_none() -> None:
    for call in (sgpr.Robot.from_urdf, sgpr.read_csv, sgpr.read_mcap, sgpr.load, sgpr.read):
        with pytest.raises(TypeError):
            call(3)  # type: ignore[arg-type]
        with pytest.raises((ValueError, OSError)):
            call("nul\0byte")
