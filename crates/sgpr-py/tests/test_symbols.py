"""The compiled module shows nothing but itself: another BLAS in the process keeps its own symbols."""

import shutil
import subprocess
import sys

import pytest
from sgpr import _sgpr


@pytest.mark.skipif(sys.platform != "linux" or shutil.which("nm") is None, reason="needs nm, and ELF")
def test_the_module_exports_no_symbol_of_blas_or_lapack() -> None:
    command = ["nm", "--dynamic", "--defined-only", _sgpr.__file__]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    exported = [line.split()[-1].split("@")[0] for line in lines]
    assert "PyInit__sgpr" in exported
    assert [name for name in exported if name != "PyInit__sgpr"] == []
