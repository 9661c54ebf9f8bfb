"""The notebook runs from its first cell to its last."""

import os
from pathlib import Path

import pytest

LARGEST = 400_000
NOTEBOOK = Path(__file__).resolve().parents[1] / "docs" / "diagnosis.ipynb"


@pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_the_notebook_runs() -> None:
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed: the notebook is not run")
    client = pytest.importorskip("nbclient", reason="nbclient is not installed: the notebook is not run")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed: the notebook is not run")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    kept = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [output for output in kept if "image/png" in output.get("data", {})]
    assert len(pictures) >= 3 and NOTEBOOK.stat().st_size < LARGEST, "make notebook: outputs that a code host shows"
    runner = client.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(NOTEBOOK.parent)}})
    runner.execute()
    printed = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []))
    assert "stribeck_friction at joint_2" in printed
    if not os.environ.get("SGPR_DATA"):
        assert "no real logs here" in printed
